"""Every scene of the studies, once and by name: what scatters, the layers made of it, what lies below them.

A study adds what it asks of a scene: directions, depths, nodes, options. Tests and benchmarks take theirs here, too.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import PhaseMatrix, henyey_greenstein, isotropic, rayleigh
from vrte.optics.size_distribution import Gamma, Tabulated
from vrte.optics.spheres import spheres
from vrte.scene.boundary import Boundary, Lambertian, MuellerBase
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer
from vrte.scene.mirror import Mirror
from vrte.scene.scene import Scene

POLARIZED = (1.0, 0.3, -0.2, 0.1)  # a beam's Stokes vector [W m-2]
# Siewert, JQSRT 64, 227 (2000), problem IIA: a1, a2, a3, a4, b1, b2 of the twelve degrees
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
PEAKED_TERMS = 1500  # so many that Henyey and Greenstein's function of g = +-0.99 stays positive
METAL, GLASS = 0.2 + 3.0j, 1.5 + 0.0j  # refractive indices of the spheres "metal-x30", "glass-x1", ...
LOBE_WIDTH_DEG = 5.0
LOBE_AMPLITUDE = 6.0  # reflects 0.28 of what comes straight down
LOBE_MATRIX = np.array([[1.0, 0.3, 0.0, 0.0], [0.3, 1.0, 0.0, 0.0], [0.0, 0.0, 0.8, 0.4], [0.0, 0.0, -0.4, 0.8]])


def make_haze_l() -> PhaseMatrix:
    """Deirmendjian's haze L, water spheres at 0.7 um: number density r^2 exp(-15.1186 sqrt(r)), r in um, tabulated.

    Source: Garcia and Siewert, JQSRT 36, 401 (1986).

    >>> round(make_haze_l().asymmetry, 3)
    0.804
    """
    radii = np.linspace(1e-3, 4.0, 401)
    density = radii**2 * np.exp(-15.1186 * np.sqrt(radii))
    return spheres(1.33, size=Tabulated(radii, density), wavelength_um=0.7).phase_matrix


def make_cloud_c1() -> Particles:
    """Deirmendjian's cloud C1, water spheres at 0.7 um: number density r^6 exp(-1.5 r), r in um, mode at 4 um.

    Source: D. Deirmendjian, Electromagnetic Scattering on Spherical Polydispersions (1969).
    """
    return spheres(1.33, size=Gamma(r_eff_um=6.0, v_eff=1.0 / 9.0), wavelength_um=0.7)


def make_rounded_henyey_greenstein(g: float, terms: int, width: float) -> PhaseMatrix:
    """a1[l] = (2l+1) g^l exp(-width^2 l (l+1)/2): the function's peak rounded by a Gaussian of ``width`` [rad].

    So it ends with fewer terms than it would otherwise take, and stays positive.

    >>> round(make_rounded_henyey_greenstein(0.5, 60, 0.01).asymmetry, 6)
    0.49995
    """
    degrees = np.arange(terms, dtype=float)
    return PhaseMatrix((2.0 * degrees + 1.0) * g**degrees * np.exp(-0.5 * width**2 * degrees * (degrees + 1.0)))


MATTER: dict[str, Callable[[], Particles | PhaseMatrix]] = {
    "isotropic": isotropic,
    "rayleigh": rayleigh,
    "spheroids": lambda: PhaseMatrix(*np.array(SPHEROIDS).T),
    "haze-L": make_haze_l,
    "cloud C1": make_cloud_c1,
    "HG 0.9999, rounded": lambda: make_rounded_henyey_greenstein(0.9999, 100_000, 8e-5),
    "clear spheres": lambda: spheres(1.5, size=Gamma(0.3, 0.1), wavelength_um=0.55),
    "gold powder": lambda: spheres((1.658, 1.956), radius_um=0.6, wavelength_um=0.4),
    "red gold powder": lambda: spheres("gold", radius_um=0.3, wavelength_um=0.64),
    "rutile": lambda: spheres(2.7533359265887323, size=Gamma(0.12, 0.1), wavelength_um=0.55),  # n alone: it conserves
    "coarse pigment": lambda: spheres(2.7, size=Gamma(1.0, 0.05), wavelength_um=0.55, host_index=1.5),
    "droplets": lambda: spheres(1.33, size=Gamma(3.0, 0.1), wavelength_um=0.865),
    "droplets, scalar": lambda: PhaseMatrix(
        spheres(1.33, size=Gamma(4.0, 0.1), wavelength_um=2.2).phase_matrix.a1  # without polarization
    ),
}


@cache
def find_matter(name: str) -> Particles | PhaseMatrix:
    """What scatters, by its name in MATTER, or made of the numbers in it; the same object every time.

    "HG 0.9" is Henyey and Greenstein's with all terms above 1e-10, "HG 0.9 264" with so many; "gold 0.6" are spheres of
    gold of that radius [um] at 0.4 um; "metal-x30" and "glass-x30" spheres of that size parameter.

    >>> find_matter("HG 0.5").terms, find_matter("HG 0.5 12").terms
    (34, 12)
    """
    if name in MATTER:
        return MATTER[name]()
    kind, *numbers = name.split()
    if kind == "HG":
        g = float(numbers[0])
        return henyey_greenstein(g, int(numbers[1]) if numbers[1:] else math.ceil(math.log(1e-10) / math.log(g)))
    if kind == "gold":
        return spheres("gold", radius_um=float(numbers[0]), wavelength_um=0.4)
    if name.startswith("HG"):
        return henyey_greenstein(float(name[2:]), PEAKED_TERMS)
    kind, size = name.split("-x")
    wavelength = 0.5
    radius = float(size) * wavelength / (2.0 * math.pi)
    return spheres({"metal": METAL, "glass": GLASS}[kind], radius_um=radius, wavelength_um=wavelength)


def find_phase_matrix(name: str) -> PhaseMatrix:
    """The phase matrix of what scatters.

    >>> find_phase_matrix("metal-x1e-3").asymmetry < 1e-5
    True
    """
    found = find_matter(name)
    return found if isinstance(found, PhaseMatrix) else found.phase_matrix


OWN = math.nan  # an albedo: that of the particles


@dataclass(frozen=True)
class Slab:
    """A homogeneous layer by the name of what scatters, its single-scattering albedo (or OWN) and optical thickness.

    ``stored``: the phase matrix of that name as a table of answers has it, to the last bit.
    """

    phase: str
    albedo: float
    thickness: float
    stored: PhaseMatrix | None = field(default=None, compare=False, repr=False)

    @property
    def phase_matrix(self) -> PhaseMatrix:
        """The stored one, or that of the name."""
        return find_phase_matrix(self.phase) if self.stored is None else self.stored

    @property
    def layer(self) -> Layer:
        """As a `vrte.Layer`; slabs of one name share one phase matrix."""
        if math.isnan(self.albedo) and isinstance(found := find_matter(self.phase), Particles):
            return Layer.of(found, thickness=self.thickness)
        return Layer(self.phase_matrix, self.albedo, self.thickness)


def store_phase_matrices(slabs: Iterable[Slab]) -> dict[str, Array]:
    """Expansion coefficients by the key that `restore_slabs` reads, (terms, 6) each.

    >>> {key: values.shape for key, values in store_phase_matrices([Slab("rayleigh", 0.9, 1.0)]).items()}
    {'phase/rayleigh': (3, 6)}
    """
    return {f"phase/{slab.phase}": slab.phase_matrix.coefficients for slab in slabs}


def restore_slabs(slabs: Iterable[Slab], table: Mapping[str, Array]) -> tuple[Slab, ...]:
    """The slabs with the coefficients that a table of answers was made from. Computed again, they may differ in the
    last bits from one processor or BLAS to another."""
    slabs = tuple(slabs)
    found = {name: PhaseMatrix(*table[f"phase/{name}"].T) for name in {slab.phase for slab in slabs}}
    return tuple(replace(slab, stored=found[slab.phase]) for slab in slabs)


PERFECT = 1e-3 + 1e3j  # a mirror that keeps 4e-9 of the light
Base = float | str | None  # nothing, the albedo of a Lambertian base, "lobe", "mirror" of METAL, or "perfect mirror"


def evaluate_mueller_lobe(mu_i: Any, mu_o: Any, phi_deg: Any) -> Array:
    """A lobe LOBE_WIDTH_DEG wide about the mirror direction: (..., 4, 4) [1/sr].

    A exp(-(1 - c)/width^2) M, with c the cosine of the angle between the outgoing and the mirror direction.

    >>> evaluate_mueller_lobe(1.0, 1.0, 0.0)[0].tolist()
    [6.0, 1.7999999999999998, 0.0, 0.0]
    """
    mu_i, mu_o, phi = (np.asarray(values, dtype=np.float64) for values in (mu_i, mu_o, phi_deg))
    sines = np.sqrt((1.0 - mu_i) * (1.0 + mu_i)) * np.sqrt((1.0 - mu_o) * (1.0 + mu_o))
    cosine = np.cos(np.radians(np.remainder(phi, 360.0)))
    away = 1.0 - (mu_i * mu_o + sines * cosine)
    return LOBE_AMPLITUDE * np.exp(-away / math.radians(LOBE_WIDTH_DEG) ** 2)[..., None, None] * LOBE_MATRIX


def make_scene(slabs: tuple[Slab, ...], base: Base = None, media: tuple[float, ...] = ()) -> Scene:
    """The slabs, top first, over a base; ``media``: refractive indices above, of each slab and below, if not all 1.

    >>> make_scene((Slab("rayleigh", 0.9, 1.0),), 1.0).base
    Lambertian(albedo=1.0)
    >>> make_scene((Slab("rayleigh", 0.9, 1.0),), None, (1.0, 1.5, 1.0)).indices
    (1.5,)
    """
    below: Boundary | None = None
    if base == "lobe":
        below = MuellerBase(evaluate_mueller_lobe)
    elif base in ("mirror", "perfect mirror"):
        below = Mirror(METAL if base == "mirror" else PERFECT)
    elif base is not None:
        below = Lambertian(float(base))
    interfaces = [Interface(*pair) if pair[0] != pair[1] else None for pair in itertools.pairwise(media)]
    return Scene([slab.layer for slab in slabs], below, interfaces)


def make_one_slab(phase: str, albedo: float, thickness: float, base: Base = None) -> tuple[tuple[Slab, ...], Base]:
    """One layer over a base."""
    return (Slab(phase, albedo, thickness),), base


INF = math.inf
FORWARD_PEAK = "HG 0.9 264"  # terms down to 1e-12 of 2 l + 1
SCENES: dict[str, tuple[tuple[Slab, ...], Base]] = {
    "gold": make_one_slab("gold 0.6", OWN, 100.0),  # the GPU paper's, Table 3
    "gold powder, thickness 100": make_one_slab("gold powder", 0.607, 100.0),
    "gold powder, semi-infinite": make_one_slab("gold powder", 0.607, INF),
    "red gold powder": make_one_slab("red gold powder", OWN, 100.0),
    "rutile powder": make_one_slab("rutile", OWN, 20.0),
    "spheroids": make_one_slab("spheroids", 0.973527, 1.0),  # Siewert's problem IIA
    "absorbing spheroids, thickness 5": make_one_slab("spheroids", 0.2, 5.0),
    "Rayleigh, thickness 0.01": make_one_slab("rayleigh", 1.0, 0.01),
    "Rayleigh, thickness 0.02": make_one_slab("rayleigh", 1.0, 0.02),
    "Rayleigh, thickness 0.5": make_one_slab("rayleigh", 1.0, 0.5),
    "Rayleigh, thickness 10": make_one_slab("rayleigh", 1.0, 10.0),
    "Rayleigh, thickness 50": make_one_slab("rayleigh", 1.0, 50.0),
    "isotropic": make_one_slab("isotropic", 0.9, 1.0),
    "HG 0.5, thickness 1": make_one_slab("HG 0.5", 0.95, 1.0),
    "HG 0.5, thickness 5": make_one_slab("HG 0.5", 0.2, 5.0),
    "HG 0.5, semi-infinite": make_one_slab("HG 0.5 12", 0.9, INF),
    "HG 0.75, thickness 0.1": make_one_slab("HG 0.75", 0.9, 0.1),
    "HG 0.75, thickness 0.1, clearer": make_one_slab("HG 0.75", 0.95, 0.1),
    "HG 0.75, thickness 5": make_one_slab("HG 0.75", 0.99, 5.0),
    "HG 0.75, white, semi-infinite": make_one_slab("HG 0.75", 1.0, INF),
    "HG 0.85, semi-infinite": make_one_slab("HG 0.85", 0.99, INF),
    "HG 0.75, 128 terms": make_one_slab("HG 0.75 128", 0.99, 1.0),
    "HG 0.9, 384 terms": make_one_slab("HG 0.9 384", 0.99, 100.0),
    "forward peak": make_one_slab(FORWARD_PEAK, 0.99, 2.0),
    "peak below Rayleigh": ((Slab("rayleigh", 1.0, 0.2), Slab("HG 0.9", 0.95, 3.0)), None),
    "haze L, thickness 1": make_one_slab("haze-L", 0.9, 1.0),
    "haze L, thickness 2.5": make_one_slab("haze-L", 1.0, 2.5),
    "haze L, thickness 10": make_one_slab("haze-L", 1.0, 10.0),
    "cloud C1": make_one_slab("cloud C1", 1.0, 3.3),
    "g = 0.9": make_one_slab("HG 0.9 200", 1.0, 5.0),
    "g = 0.99": make_one_slab("HG 0.99 2000", 1.0, 50.0),
    "g = 0.9999": make_one_slab("HG 0.9999, rounded", 1.0, 5e3),
    "cloud": make_one_slab("droplets, scalar", 1.0, 16.0),
    "water cloud, thickness 5": make_one_slab("droplets", 1.0, 5.0),
    "coarse pigment, thickness 10": make_one_slab("coarse pigment", 0.999, 10.0),
    "clear spheres, thickness 2": make_one_slab("clear spheres", 0.99, 2.0),
    "clear spheres, thickness 2, over a base": make_one_slab("clear spheres", 0.99, 2.0, 0.1),
    "clear spheres, thickness 8": make_one_slab("clear spheres", 1.0, 8.0),
    "two layers over a base": ((Slab("rayleigh", 1.0, 0.3), Slab("clear spheres", 0.9, 2.0)), 0.3),
}


@cache
def find_scene(name: str) -> Scene:
    """The scene of that name in SCENES.

    >>> find_scene("spheroids").thickness
    1.0
    """
    return make_scene(*SCENES[name])


def make_gold_scene(radius_um: float, thickness: float = 100.0) -> Scene:
    """The GPU paper's layer, of spheres of gold of one radius at 400 nm."""
    return make_scene((Slab(f"gold {radius_um}", OWN, thickness),))
