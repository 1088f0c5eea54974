"""How polarized light is: degrees and angle, from its Stokes vector.

Angles are taken from the local meridian plane, l, towards r: clockwise for whoever the light comes to, since r x l
points along its travel (docs/reference/conventions.md).
"""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array


def find_degree_of_polarization(stokes: Any) -> Array:
    """sqrt(Q^2 + U^2 + V^2)/I of Stokes vectors (..., 4); NaN where there is no light: (...)."""
    return _divide_by_intensity(np.sqrt((np.asarray(stokes, float)[..., 1:] ** 2).sum(axis=-1)), stokes)


def find_degree_of_linear_polarization(stokes: Any) -> Array:
    """sqrt(Q^2 + U^2)/I of Stokes vectors (..., 4); NaN where there is no light: (...)."""
    values = np.asarray(stokes, float)
    return _divide_by_intensity(np.hypot(values[..., 1], values[..., 2]), stokes)


def find_degree_of_circular_polarization(stokes: Any) -> Array:
    """V/I of Stokes vectors (..., 4), from -1 to 1; NaN where there is no light: (...)."""
    return _divide_by_intensity(np.asarray(stokes, float)[..., 3], stokes)


def find_angle_of_linear_polarization(stokes: Any) -> Array:
    """Half the argument of Q + iU [degrees], from 0 (meridian plane) to below 180; NaN without it: (...)."""
    values = np.asarray(stokes, float)
    q, u = values[..., 1], values[..., 2]
    angle = np.degrees(0.5 * np.arctan2(u, q)) % 180.0
    return np.where((q != 0.0) | (u != 0.0), np.where(angle < 180.0, angle, 0.0), np.nan)


def _divide_by_intensity(part: Array, stokes: Any) -> Array:
    intensity = np.asarray(stokes, float)[..., 0]
    lit = intensity > 0.0
    return np.where(lit, part / np.where(lit, intensity, 1.0), np.nan)


FLIP = np.array([1.0, 1.0, -1.0, -1.0])  # D of (1:11)
