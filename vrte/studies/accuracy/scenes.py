"""The scenes of the sweep: thin and thick, smooth and peaked, clear and absorbing, from above, below and inside."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.phase_matrix import PhaseMatrix, henyey_greenstein, rayleigh
from vrte.optics.size_distribution import Gamma
from vrte.optics.spheres import spheres
from vrte.scene.boundary import Lambertian
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene
from vrte.studies.stability.phases import haze_l

MU = (0.02, 0.1, 0.35, 0.6, 0.85, 1.0)
PHI = (0.0, 30.0, 90.0, 150.0, 180.0)
POLARIZED = (1.0, 0.3, -0.2, 0.1)
# Siewert, JQSRT 64, 227 (2000), problem IIA, spheroids: a1, a2, a3, a4, b1, b2 of the twelve degrees
SPHEROIDS = (
    (1.0, 0.0, 0.0, 0.915207, 0.0, 0.0),
    (2.104031, 0.0, 0.0, 2.095727, 0.0, 0.0),
    (2.095158, 3.726079, 3.615946, 2.008624, 0.116688, 0.065456),
    (1.414939, 2.202868, 2.240516, 1.436545, 0.20937, 0.221658),
    (0.703593, 1.190694, 1.139473, 0.706244, 0.227137, 0.097752),
    (0.235001, 0.391203, 0.365605, 0.238475, 0.144524, 0.052458),
    (0.064039, 0.105556, 0.082779, 0.056448, 0.05264, 0.009239),
    (0.012837, 0.020484, 0.013649, 0.009703, 0.0124, 0.001411),
    (0.00201, 0.003097, 0.001721, 0.001267, 0.002093, 0.000133),
    (0.000246, 0.000366, 0.000172, 0.00013, 0.000267, 1.1e-05),
    (2.4e-05, 3.5e-05, 1.4e-05, 1.1e-05, 2.7e-05, 1e-06),
    (2e-06, 3e-06, 1e-06, 1e-06, 2e-06, 0.0),
)


@dataclass(frozen=True)
class Probe:
    """A scene and what is asked of it: a BRDF between ``mu0`` (n_in,) and ``mu``, with the transmission where the layer
    ends, or, with ``tau``, the field of a polarized beam at those depths, up and down. ``nodes``: of the discrete
    problem; ``more``: two numbers of nodes that the continuous problem is taken from."""

    name: str
    scene: Scene
    nodes: int
    more: tuple[int, int]
    mu0: tuple[float, ...] = (0.2, 0.8)
    mu: tuple[float, ...] = MU
    tau: tuple[float, ...] = ()

    @property
    def signed_mu(self) -> Array:
        """The cosines up and down."""
        return np.array([*self.mu, *(-mu for mu in self.mu)])


def one_layer(matrix: PhaseMatrix, albedo: float, thickness: float, base: float = 0.0) -> Scene:
    """A layer over a Lambertian base, black where that reflects nothing."""
    return Scene([Layer(matrix, albedo, thickness)], Lambertian(base) if base else None)


@cache
def metal() -> PhaseMatrix:
    """Gold powder, radius 0.6 um at 0.4 um, 41 terms."""
    return spheres((1.658, 1.956), radius_um=0.6, wavelength_um=0.4).phase_matrix


@cache
def glass() -> PhaseMatrix:
    """Clear spheres, a narrow distribution of 0.3 um at 0.55 um."""
    return spheres(1.5, size=Gamma(0.3, 0.1), wavelength_um=0.55).phase_matrix


def smooth(g: float) -> PhaseMatrix:
    """Henyey and Greenstein's, with all terms above 1e-10."""
    return henyey_greenstein(g, math.ceil(math.log(1e-10) / math.log(g)))


@cache
def droplets() -> PhaseMatrix:
    """Cloud droplets, effective radius 3 um at 0.865 um, 279 terms."""
    return spheres(1.33, size=Gamma(3.0, 0.1), wavelength_um=0.865).phase_matrix


@cache
def pigment() -> PhaseMatrix:
    """Coarse grains of high index in a binder, effective radius 1 um at 0.55 um, 135 terms."""
    return spheres(2.7, size=Gamma(1.0, 0.05), wavelength_um=0.55, host_index=1.5).phase_matrix


def spheroids() -> PhaseMatrix:
    """Siewert's problem IIA."""
    return PhaseMatrix(*np.array(SPHEROIDS).T)


PROBES: dict[str, Callable[[str], Probe]] = {
    "Rayleigh, thickness 0.01": lambda name: Probe(name, one_layer(rayleigh(), 1.0, 0.01), 16, (160, 240)),
    "Rayleigh, thickness 10, field": lambda name: Probe(
        name, one_layer(rayleigh(), 1.0, 10.0), 16, (96, 128), mu0=(0.6,), tau=(0.0, 5.0, 10.0)
    ),
    "HG 0.5, thickness 1": lambda name: Probe(name, one_layer(smooth(0.5), 0.95, 1.0), 20, (96, 128)),
    "HG 0.75, thickness 0.1": lambda name: Probe(name, one_layer(smooth(0.75), 0.9, 0.1), 41, (120, 160)),
    "HG 0.85, without end": lambda name: Probe(name, one_layer(smooth(0.85), 0.99, math.inf), 72, (112, 144)),
    "clear spheres, thickness 8": lambda name: Probe(name, one_layer(glass(), 1.0, 8.0), 24, (72, 96)),
    "gold powder, thickness 100": lambda name: Probe(name, one_layer(metal(), 0.607, 100.0), 24, (72, 96)),
    "gold powder, without end": lambda name: Probe(name, one_layer(metal(), 0.607, math.inf), 24, (72, 96)),
    "spheroids, field": lambda name: Probe(
        name, one_layer(spheroids(), 0.973527, 1.0), 16, (96, 128), mu0=(0.6,), tau=(0.0, 0.2, 1.0)
    ),
    "haze L, thickness 1": lambda name: Probe(name, one_layer(haze_l(), 0.9, 1.0), 50, (72, 96), mu0=(0.5,)),
    "two layers over a base": lambda name: Probe(
        name,
        Scene([Layer(rayleigh(), 1.0, 0.3), Layer(glass(), 0.9, 2.0)], Lambertian(0.3)),
        24,
        (72, 96),
    ),
    "absorbing spheroids, thickness 5": lambda name: Probe(name, one_layer(spheroids(), 0.2, 5.0), 16, (96, 128)),
    "clear spheres, grazing beam": lambda name: Probe(
        name, one_layer(glass(), 0.99, 2.0, 0.1), 24, (96, 128), mu0=(0.02, 0.05)
    ),
    "clear spheres, normal beam, field": lambda name: Probe(
        name, one_layer(glass(), 0.99, 2.0), 24, (160, 224), mu0=(1.0,), tau=(0.0, 0.01, 1.0, 2.0)
    ),
    "water cloud, thickness 5": lambda name: Probe(name, one_layer(droplets(), 1.0, 5.0), 24, (80, 104), mu0=(0.5,)),
    "coarse pigment, thickness 10": lambda name: Probe(name, one_layer(pigment(), 0.999, 10.0), 24, (72, 96)),
    "peak below Rayleigh": lambda name: Probe(
        name, Scene([Layer(rayleigh(), 1.0, 0.2), Layer(smooth(0.9), 0.95, 3.0)]), 24, (112, 144)
    ),
}


@cache
def probe(name: str) -> Probe:
    """The probe of that name."""
    return PROBES[name](name)
