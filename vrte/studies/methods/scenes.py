"""The scenes of the report, and what is asked of each: the light that leaves it, in directions off every node."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.optics.phase_matrix import PhaseMatrix, henyey_greenstein, isotropic, rayleigh
from vrte.optics.size_distribution import Gamma
from vrte.optics.spheres import Particles, spheres
from vrte.scene.boundary import Lambertian
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene
from vrte.studies.accuracy.scenes import POLARIZED, glass, one_layer, smooth, spheroids
from vrte.studies.methods.peers.asked import Asked
from vrte.studies.stability.phases import haze_l

NATURAL = (1.0, 0.0, 0.0, 0.0)
COSINES = (0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 60.0, 120.0, 180.0)


@dataclass(frozen=True)
class Case:
    """A scene, the beam (cosine and Stokes vector) and the cosines of the light asked for: going up at the top and,
    unless ``top_only``, down at the bottom. ``nodes``: of the reference by modes and of that by doubling."""

    name: str
    words: str
    scene: Scene
    nodes: tuple[int, int]
    mu0: float = 0.6
    stokes: tuple[float, ...] = NATURAL
    cosines: tuple[float, ...] = COSINES
    top_only: bool = False

    @property
    def tau(self) -> tuple[float, ...]:
        """Depths."""
        return (0.0,) if self.top_only else (0.0, self.scene.thickness)

    @property
    def signed_mu(self) -> Array:
        """The cosines up and, where the bottom is looked at, down, (n_mu,)."""
        return np.array([*self.cosines, *(() if self.top_only else (-mu for mu in self.cosines))])

    @property
    def asked(self) -> Asked:
        """For other codes."""
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


@cache
def gold() -> Particles:
    """Gold powder, radius 0.3 um at 0.64 um, 18 terms."""
    return spheres("gold", radius_um=0.3, wavelength_um=0.64)


@cache
def rutile() -> Particles:
    """A white pigment, effective radius 0.12 um at 0.55 um, 19 terms; nothing is absorbed."""
    return spheres("rutile", size=Gamma(0.12, 0.1), wavelength_um=0.55)


@cache
def droplets() -> PhaseMatrix:
    """Cloud droplets, effective radius 4 um at 2.2 um, 125 terms, without polarization."""
    return PhaseMatrix(spheres(1.33, size=Gamma(4.0, 0.1), wavelength_um=2.2).phase_matrix.a1)


def peaked() -> PhaseMatrix:
    """Henyey and Greenstein's with g = 0.9, terms down to 1e-12 of 2 l + 1."""
    return henyey_greenstein(0.9, 264)


CASES: dict[str, Callable[[str], Case]] = {
    "Rayleigh, thin": lambda name: Case(
        name, "albedo 1, thickness 0.02, polarized beam", one_layer(rayleigh(), 1.0, 0.02), (224, 160), stokes=POLARIZED
    ),
    "Rayleigh, thick": lambda name: Case(name, "albedo 1, thickness 50", one_layer(rayleigh(), 1.0, 50.0), (256, 192)),
    "isotropic": lambda name: Case(name, "albedo 0.9, thickness 1", one_layer(isotropic(), 0.9, 1.0), (256, 192)),
    "aerosol, thin": lambda name: Case(
        name, "Henyey-Greenstein 0.75, albedo 0.95, thickness 0.1", one_layer(smooth(0.75), 0.95, 0.1), (256, 192)
    ),
    "absorbing": lambda name: Case(
        name, "Henyey-Greenstein 0.5, albedo 0.2, thickness 5", one_layer(smooth(0.5), 0.2, 5.0), (256, 192)
    ),
    "forward peak": lambda name: Case(
        name, "Henyey-Greenstein 0.9, albedo 0.99, thickness 2", one_layer(peaked(), 0.99, 2.0), (256, 192)
    ),
    "cloud": lambda name: Case(
        name, "droplets of 4 um at 2.2 um, scalar, albedo 1, thickness 16", one_layer(droplets(), 1.0, 16.0), (256, 192)
    ),
    "white, without end": lambda name: Case(
        name,
        "Henyey-Greenstein 0.75, albedo 1, without end",
        one_layer(smooth(0.75), 1.0, math.inf),
        (256, 192),
        top_only=True,
    ),
    "normal incidence": lambda name: Case(
        name,
        "Henyey-Greenstein 0.75, albedo 0.99, thickness 5",
        one_layer(smooth(0.75), 0.99, 5.0),
        (256, 192),
        mu0=1.0,
    ),
    "haze L": lambda name: Case(name, "albedo 0.9, thickness 1, 4x4", one_layer(haze_l(), 0.9, 1.0), (128, 96)),
    "spheroids": lambda name: Case(
        name,
        "Siewert's problem IIA, albedo 0.973527, thickness 1, polarized beam",
        one_layer(spheroids(), 0.973527, 1.0),
        (160, 112),
        stokes=POLARIZED,
    ),
    "gold powder": lambda name: Case(
        name,
        "radius 0.3 um at 0.64 um, thickness 100, light from the top",
        Scene([Layer.of(gold(), thickness=100.0)]),
        (128, 96),
        top_only=True,
    ),
    "rutile powder": lambda name: Case(
        name, "0.12 um at 0.55 um, albedo 1, thickness 20", Scene([Layer.of(rutile(), thickness=20.0)]), (128, 96)
    ),
    "two layers over a base": lambda name: Case(
        name,
        "Rayleigh 0.3, clear spheres 2 (albedo 0.9), Lambertian 0.3",
        Scene([Layer(rayleigh(), 1.0, 0.3), Layer(glass(), 0.9, 2.0)], Lambertian(0.3)),
        (112, 80),
    ),
    "grazing incidence": lambda name: Case(
        name,
        "clear spheres, albedo 0.99, thickness 2, mu0 = 0.05",
        one_layer(glass(), 0.99, 2.0),
        (144, 112),
        mu0=0.05,
        cosines=(0.05, *COSINES),
    ),
}
QUICK = ("isotropic, small", "Rayleigh, small", "without end, small")
SMALL: dict[str, Callable[[str], Case]] = {
    QUICK[0]: lambda name: Case(name, "albedo 0.9, thickness 1", one_layer(isotropic(), 0.9, 1.0), (48, 32)),
    QUICK[1]: lambda name: Case(
        name, "albedo 1, thickness 0.5, polarized beam", one_layer(rayleigh(), 1.0, 0.5), (32, 24), stokes=POLARIZED
    ),
    QUICK[2]: lambda name: Case(
        name,
        "Henyey-Greenstein 0.5, albedo 0.9",
        one_layer(henyey_greenstein(0.5, 12), 0.9, math.inf),
        (32, 24),
        top_only=True,
    ),
}


@cache
def case(name: str) -> Case:
    """The case of that name.

    >>> case("isotropic").is_conservative
    False
    """
    return (CASES | SMALL)[name](name)


def matching(pattern: str, quick: bool = False) -> tuple[str, ...]:
    """The names that a pattern such as "Rayleigh*" fits. Raises SceneError where none does.

    >>> matching("g*")
    ('gold powder', 'grazing incidence')
    """
    known = QUICK if quick else tuple(CASES)
    found = tuple(name for name in known if fnmatchcase(name, pattern))
    if not found:
        raise SceneError(f"--scenes must fit one of {', '.join(map(repr, known))}, not {pattern!r}")
    return found
