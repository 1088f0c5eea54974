"""The scenes of the report, and what is asked of each: the light that leaves it, in directions off every node."""

import hashlib
import math
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from bench import cases
from bench.cases import POLARIZED
from bench.methods.peers.asked import Asked
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.scene.scene import Scene

NATURAL = (1.0, 0.0, 0.0, 0.0)
COSINES = (0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 60.0, 120.0, 180.0)


@dataclass(frozen=True)
class Case:
    """A scene, by its name in `cases`, the beam (cosine and Stokes vector) and the cosines of the light asked for:
    going up at the top and, unless ``top_only``, down at the bottom. ``nodes``: of the reference by modes, and by
    doubling."""

    name: str
    of: str
    words: str
    nodes: tuple[int, int] = (256, 192)
    mu0: float = 0.6
    stokes: tuple[float, ...] = NATURAL
    cosines: tuple[float, ...] = COSINES
    top_only: bool = False

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return cases.find_scene(self.of)

    @property
    def tau(self) -> tuple[float, ...]:
        """Optical depths asked for: the top and, unless ``top_only``, the bottom."""
        return (0.0,) if self.top_only else (0.0, self.scene.thickness)

    @property
    def signed_mu(self) -> Array:
        """The cosines up and, where the bottom is looked at, down, (n_mu,)."""
        return np.array([*self.cosines, *(() if self.top_only else (-mu for mu in self.cosines))])

    @property
    def asked(self) -> Asked:
        """The scene and what is asked of it, as other codes take it."""
        return Asked(self.scene, self.mu0, np.array(self.stokes), self.signed_mu, np.array(PHI), np.array(self.tau))

    @property
    def is_conservative(self) -> bool:
        """Whether all light comes out again, through the faces that are looked at."""
        scattered = all(layer.albedo == 1.0 or layer.thickness == 0.0 for layer in self.scene.layers)
        everything = not self.top_only or math.isinf(self.scene.thickness)
        return scattered and everything and self.scene.base is None

    @property
    def outgoing(self) -> Array:
        """Which of the depths and signed cosines is light that leaves, (n_tau, n_mu)."""
        up = self.signed_mu > 0.0
        return np.array([up if tau == 0.0 else ~up for tau in self.tau])

    @property
    def fingerprint(self) -> str:
        """Changes with anything that changes an answer."""
        found = hashlib.sha256()
        for layer in self.scene.layers:
            matrix = layer.phase_matrix
            for name in ("a1", "a2", "a3", "a4", "b1", "b2"):
                found.update(np.ascontiguousarray(getattr(matrix, name)).tobytes())
            found.update(repr((layer.albedo, layer.thickness)).encode())
        asked = (self.scene.base, self.nodes, self.mu0, self.stokes, self.cosines, PHI, self.tau)
        found.update(repr(asked).encode())
        return found.hexdigest()[:16]


SMALL = {
    case.name: case
    for case in (
        Case("isotropic, small", "isotropic", "albedo 0.9, thickness 1", (48, 32)),
        Case(
            *("Rayleigh, small", "Rayleigh, thickness 0.5", "albedo 1, thickness 0.5, polarized beam", (32, 24)),
            stokes=POLARIZED,
        ),
        Case(
            *("without end, small", "HG 0.5, without end", "Henyey-Greenstein 0.5, albedo 0.9", (32, 24)), top_only=True
        ),
    )
}
QUICK = tuple(SMALL)
CASES = {
    case.name: case
    for case in (
        Case(
            *("Rayleigh, thin", "Rayleigh, thickness 0.02", "albedo 1, thickness 0.02, polarized beam", (224, 160)),
            stokes=POLARIZED,
        ),
        Case("Rayleigh, thick", "Rayleigh, thickness 50", "albedo 1, thickness 50"),
        Case("isotropic", "isotropic", "albedo 0.9, thickness 1"),
        Case(
            "aerosol, thin",
            "HG 0.75, thickness 0.1, clearer",
            "Henyey-Greenstein 0.75, albedo 0.95, thickness 0.1",
        ),
        Case("absorbing", "HG 0.5, thickness 5", "Henyey-Greenstein 0.5, albedo 0.2, thickness 5"),
        Case("forward peak", "forward peak", "Henyey-Greenstein 0.9, albedo 0.99, thickness 2"),
        Case("cloud", "cloud", "droplets of 4 um at 2.2 um, scalar, albedo 1, thickness 16"),
        Case(
            *("white, without end", "HG 0.75, white, without end", "Henyey-Greenstein 0.75, albedo 1, without end"),
            top_only=True,
        ),
        Case(
            "normal incidence",
            "HG 0.75, thickness 5",
            "Henyey-Greenstein 0.75, albedo 0.99, thickness 5",
            mu0=1.0,
        ),
        Case("haze L", "haze L, thickness 1", "albedo 0.9, thickness 1, 4x4", (128, 96)),
        Case(
            "spheroids",
            "spheroids",
            "Siewert's problem IIA, albedo 0.973527, thickness 1, polarized beam",
            (160, 112),
            stokes=POLARIZED,
        ),
        Case(
            *("gold powder", "red gold powder", "radius 0.3 um at 0.64 um, thickness 100, light from the top"),
            nodes=(128, 96),
            top_only=True,
        ),
        Case("rutile powder", "rutile powder", "0.12 um at 0.55 um, albedo 1, thickness 20", (128, 96)),
        Case(
            "two layers over a base",
            "two layers over a base",
            "Rayleigh 0.3, clear spheres 2 (albedo 0.9), Lambertian 0.3",
            (112, 80),
        ),
        Case(
            *("grazing incidence", "clear spheres, thickness 2"),
            "clear spheres, albedo 0.99, thickness 2, mu0 = 0.05",
            (144, 112),
            mu0=0.05,
            cosines=(0.05, *COSINES),
        ),
    )
}


def find_case(name: str) -> Case:
    """The case of that name.

    >>> find_case("isotropic").is_conservative
    False
    """
    return (CASES | SMALL)[name]


def find_matching_scenes(pattern: str, quick: bool = False) -> tuple[str, ...]:
    """The names that a pattern such as "Rayleigh*" fits. Raises SceneError where none does.

    >>> find_matching_scenes("g*")
    ('gold powder', 'grazing incidence')
    """
    known = QUICK if quick else tuple(CASES)
    found = tuple(name for name in known if fnmatchcase(name, pattern))
    if not found:
        raise SceneError(f"--scenes must fit one of {', '.join(map(repr, known))}, not {pattern!r}")
    return found
