"""What is right: the exact method on many more nodes than any run, by modes, confirmed by doubling on other nodes."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.methods.scenes import PHI, Case
from bench.study import make_fingerprint
from vrte.basics.arrays import Array
from vrte.calls.radiance import radiance
from vrte.formats.atomic import write_atomically
from vrte.results.field import Field

FINEST = 1e-14  # accuracy: no Fourier order is left out that could matter
NO_LIGHT = 1e-290
FOLDER = "references"


@dataclass(frozen=True)
class Reference:
    """The light that leaves, (n_out, n_phi, 4), each direction over the largest I at its depth, which is ``largest``,
    (n_out, 1, 1); the shares of the incident flux that go up at the top and, with the beam, down at the bottom,
    (n_tau,); ``within``: the largest difference of two routes in light and shares."""

    light: Array
    shares: Array
    largest: Array
    within: float

    @staticmethod
    def of(case: Case, field: Field, within: float = 0.0) -> "Reference":
        """What was found, in units of its own largest I."""
        light, level = field.stokes[case.outgoing], np.nonzero(case.outgoing)[0]
        most = np.array([np.abs(light[level == place, :, 0]).max() for place in range(len(case.tau))])
        largest = np.maximum(most, NO_LIGHT)[level][:, None, None]
        return Reference(light / largest, find_flux_shares(case, field), largest, within)

    def gaps(self, case: Case, field: Field) -> tuple[Array, Array]:
        """By what another answer is off: light as here, and shares."""
        return field.stokes[case.outgoing] / self.largest - self.light, find_flux_shares(case, field) - self.shares


def solve_case(case: Case, **options: Any) -> Field:
    """The case solved; what the plan warns of is measured here anyway."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return radiance(case.scene, case.mu0, case.stokes, case.signed_mu, PHI, case.tau, **options)


def find_flux_shares(case: Case, field: Field) -> Array:
    """Of the incident flux, (n_tau,): reflected, and transmitted with the beam."""
    below = (field.flux_down + field.direct)[1:]
    return np.concatenate([field.flux_up[:1], below]) / (case.mu0 * case.stokes[0])


def solve_twice(case: Case) -> Reference:
    """By modes on more nodes, which is taken, and by doubling on fewer, which tells how well it is known."""
    fine, coarse = (
        solve_case(case, nodes=nodes, accuracy=FINEST, algorithm=algorithm, truncation="none")
        for nodes, algorithm in zip(case.nodes, ("modes", "doubling"), strict=True)
    )
    gaps = Reference.of(case, fine).gaps(case, coarse)
    return Reference.of(case, fine, float(max(np.abs(gap).max() for gap in gaps)))


def get_reference(case: Case, folder: Path) -> Reference:
    """Of a case, from the folder if it is there and nothing has changed since, else solved and kept. Raises OSError."""
    mark = make_fingerprint("reference", case.fingerprint)
    path = folder / FOLDER / f"{make_file_stem(case.name)}.npz"
    if path.exists():
        with np.load(path) as kept:
            if str(kept["mark"]) == mark:
                return Reference(kept["light"], kept["shares"], kept["largest"], float(kept["within"]))
    found = solve_twice(case)
    path.parent.mkdir(exist_ok=True)
    with write_atomically(path) as part, open(part, "wb") as file:
        np.savez(file, mark=mark, **vars(found))
    return found


def make_file_stem(name: str) -> str:
    """A name that a file can have.

    >>> make_file_stem("Rayleigh, thin")
    'rayleigh_thin'
    """
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name.lower()).split())
