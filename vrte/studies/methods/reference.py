"""What is right: the exact method on many more nodes than any run, by modes, confirmed by doubling on other nodes."""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.calls.radiance import radiance
from vrte.formats.atomic import atomic_write
from vrte.results.field import Field
from vrte.studies.methods.records import fingerprint
from vrte.studies.methods.scenes import PHI, Case

FINEST = 1e-14  # accuracy: no Fourier order is left out that could matter
NO_LIGHT = 1e-290
FOLDER = "references"


@dataclass(frozen=True)
class Answer:
    """The light that leaves, (n_out, n_phi, 4), each direction over the largest I at its depth, and the shares of the
    incident flux that go up at the top and, with the beam, down at the bottom, (n_tau,)."""

    light: Array
    shares: Array


@dataclass(frozen=True)
class Reference:
    """``answer`` in units of the largest I at each depth, ``largest`` (n_out, 1, 1); ``within``: the largest difference
    of the two routes in light and shares."""

    answer: Answer
    largest: Array
    within: float


def ask(case: Case, **options: Any) -> Field:
    """The case solved; what the plan warns of is measured here anyway."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return radiance(case.scene, case.mu0, case.stokes, case.signed_mu, PHI, case.tau, **options)


def leaving(case: Case, field: Field) -> Array:
    """The light that leaves, (n_out, n_phi, 4)."""
    return field.stokes[case.outgoing]


def shares(case: Case, field: Field) -> Array:
    """Of the incident flux, (n_tau,): reflected, and transmitted with the beam."""
    incident = case.mu0 * case.stokes[0]
    below = (field.flux_down + field.direct)[1:]
    return np.concatenate([field.flux_up[:1], below]) / incident


def largest_of(case: Case, light: Array) -> Array:
    """The largest I at each direction's depth, (n_out, 1, 1)."""
    level = np.nonzero(case.outgoing)[0]
    most = np.array([np.abs(light[level == place, :, 0]).max() for place in range(len(case.tau))])
    return np.maximum(most, NO_LIGHT)[level][:, None, None]


def answered(case: Case, field: Field, largest: Array) -> Answer:
    """What was found, in units of the reference's largest I."""
    return Answer(leaving(case, field) / largest, shares(case, field))


def solved_twice(case: Case) -> Reference:
    """By modes on more nodes, which is taken, and by doubling on fewer, which tells how well it is known."""
    fine, coarse = (
        ask(case, nodes=nodes, accuracy=FINEST, algorithm=algorithm, truncation="none")
        for nodes, algorithm in zip(case.nodes, ("modes", "doubling"), strict=True)
    )
    largest = largest_of(case, leaving(case, fine))
    one, other = answered(case, fine, largest), answered(case, coarse, largest)
    gaps = np.abs(one.light - other.light).max(), np.abs(one.shares - other.shares).max()
    return Reference(one, largest, float(max(gaps)))


def reference(case: Case, folder: Path) -> Reference:
    """Of a case, from the folder if it is there and nothing has changed since, else solved and kept. Raises OSError."""
    mark = fingerprint("reference", case.fingerprint)
    path = folder / FOLDER / f"{slug(case.name)}.npz"
    if path.exists():
        with np.load(path) as kept:
            if str(kept["mark"]) == mark:
                return Reference(Answer(kept["light"], kept["shares"]), kept["largest"], float(kept["within"]))
    found = solved_twice(case)
    path.parent.mkdir(exist_ok=True)
    with atomic_write(path) as part, open(part, "wb") as file:
        np.savez(
            file,
            mark=mark,
            light=found.answer.light,
            shares=found.answer.shares,
            largest=found.largest,
            within=found.within,
        )
    return found


def slug(name: str) -> str:
    """A name that a file can have.

    >>> slug("Rayleigh, thin")
    'rayleigh_thin'
    """
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name.lower()).split())
