"""Particles close to each other: how they scatter where the light of neighbours interferes, by a named model each."""

import warnings
from collections.abc import Callable
from typing import Any

from vrte.basics.arrays import show_value
from vrte.basics.errors import SceneError
from vrte.optics.particles import Particles

INDEPENDENT = "independent"
INDEPENDENT_UP_TO = 0.1  # volume fraction


class IndependentScatteringWarning(UserWarning):
    """The particles are so close that they no longer scatter independently of each other."""


def scatter_independently(particles: Particles, volume_fraction: float) -> Particles:
    """As if each were alone, which warns above a volume fraction of 0.1."""
    if volume_fraction > INDEPENDENT_UP_TO:
        warnings.warn(
            f"layer: a volume_fraction of {volume_fraction:g} is above {INDEPENDENT_UP_TO}: independent scattering, "
            "which is assumed here, is doubtful",
            IndependentScatteringWarning,
            stacklevel=4,
        )
    return particles


PACKINGS: dict[
    str, Callable[[Particles, float], Particles]
] = {  # by name: particles at a volume fraction, as they scatter
    INDEPENDENT: scatter_independently,
}


def check_packing(packing: Any) -> str:
    """One of PACKINGS. Raises SceneError."""
    if not (isinstance(packing, str) and packing in PACKINGS):
        allowed = " or ".join(f'"{name}"' for name in PACKINGS)
        raise SceneError(f"layer: packing must be {allowed}, not {show_value(packing)}", "packing")
    return packing


def pack(particles: Particles, volume_fraction: float, packing: str) -> Particles:
    """The particles as they scatter where they fill a part of the volume. Raises SceneError for what it cannot do.

    >>> from vrte.optics.spheres import spheres
    >>> pack(spheres(1.5, radius_um=0.1, wavelength_um=0.5), 0.01, "independent").albedo
    1.0
    """
    return PACKINGS[packing](particles, volume_fraction)
