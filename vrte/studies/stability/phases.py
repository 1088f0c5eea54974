"""The phase matrices of the stability scenes, by name."""

import math
from functools import cache

import numpy as np

from vrte.optics.phase_matrix import PhaseMatrix, henyey_greenstein, isotropic, rayleigh
from vrte.optics.size_distribution import Tabulated
from vrte.optics.spheres import spheres

METAL, GLASS = 0.2 + 3.0j, 1.5 + 0.0j
SIZES = ("1e-3", "1", "30", "200")  # size parameters of the Mie spheres
PEAKED_TERMS = 1500  # so many that Henyey and Greenstein's function of g = +-0.99 stays positive
GROUPS = {
    "isotropic, Rayleigh": ("isotropic", "rayleigh"),
    "haze L": ("haze-L",),
    "Henyey-Greenstein, g = +-0.99": ("HG+0.99", "HG-0.99"),
    "Mie metal": tuple(f"metal-x{size}" for size in SIZES),
    "Mie dielectric": tuple(f"glass-x{size}" for size in SIZES),
}
PHASES = tuple(name for names in GROUPS.values() for name in names)


@cache
def phase_matrix(name: str) -> PhaseMatrix:
    """The phase matrix of that name, one of PHASES; the same object every time.

    >>> phase_matrix("metal-x1e-3").asymmetry < 1e-5
    True
    """
    if name == "isotropic":
        return isotropic()
    if name == "rayleigh":
        return rayleigh()
    if name == "haze-L":
        return haze_l()
    if name.startswith("HG"):
        return henyey_greenstein(float(name[2:]), PEAKED_TERMS)
    kind, size = name.split("-x", 1)
    index, wavelength = (METAL if kind == "metal" else GLASS), 0.5
    radius = float(size) * wavelength / (2.0 * math.pi)
    return spheres(index, radius_um=radius, wavelength_um=wavelength).phase_matrix


def haze_l() -> PhaseMatrix:
    """Deirmendjian's haze L, water spheres at 0.7 um: number density r^2 exp(-15.1186 sqrt(r)), r in um, tabulated.

    Source: Garcia and Siewert, JQSRT 36, 401 (1986).

    >>> round(haze_l().asymmetry, 3)
    0.804
    """
    radii = np.linspace(1e-3, 4.0, 401)
    return spheres(
        1.33, size=Tabulated(radii, radii**2 * np.exp(-15.1186 * np.sqrt(radii))), wavelength_um=0.7
    ).phase_matrix


def group(name: str) -> str:
    """The group of GROUPS that a phase matrix belongs to.

    >>> group("metal-x30")
    'Mie metal'
    """
    return next(title for title, names in GROUPS.items() if name in names)
