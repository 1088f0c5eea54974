"""Integrals over depth of a source times decaying exponentials: exact where the source is a polynomial."""

from functools import lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import find_gauss_legendre

STEEP = 8.0  # beyond, recurrence over powers is stable up to POINTS
POINTS = 8  # most depths of a polynomial
EXACT = 28  # Gauss points that integrate exp(-8 x) times such a polynomial to rounding


@lru_cache(maxsize=16)
def find_gauss_depths(points: int) -> Any:
    """Gauss points of (0, 1), ascending, (points,)."""
    return 0.5 * (find_gauss_legendre(points)[0] + 1.0)


@lru_cache(maxsize=16)
def compute_lagrange_coefficients(points: int) -> Array:
    """Coefficients of the Lagrange polynomials through the Gauss points, (power, point)."""
    return np.linalg.inv(np.vander(find_gauss_depths(points), increasing=True))


def integrate_faded_powers(z: Array, x: float, points: int) -> Array:
    """The integral of s^p exp(-z (x - s)) ds from 0 to x, (power, *z.shape)."""
    nodes, weights = find_gauss_legendre(EXACT)
    s = 0.5 * x * (nodes + 1.0)
    steep = z * x > STEEP
    mild = np.where(steep, 0.0, z)
    fade = np.exp(-mild[..., None] * (x - s)) * (0.5 * x * weights)
    result = np.moveaxis(fade @ np.vander(s, points, increasing=True), -1, 0)
    rate = np.where(steep, z, 1.0)
    below = -np.expm1(-rate * x) / rate
    for power in range(points):
        if power:
            below = (x**power - power * below) / rate
        result[power] = np.where(steep, below, result[power])
    return result


def weigh_downward(z: Array, points: int) -> Array:
    """Weights (points + 1, points, *z.shape) of the source at the Gauss points of (0, 1) for the integral of
    exp(-z (x - s)) S(s) ds from 0 to x: x at each of them, then 1.

    >>> np.round(weigh_downward(np.array(0.0), 1), 3)
    array([[0.5],
           [1. ]])
    """
    ends = [*find_gauss_depths(points).tolist(), 1.0]
    return np.stack(
        [
            np.einsum("p...,pj->j...", integrate_faded_powers(z, x, points), compute_lagrange_coefficients(points))
            for x in ends
        ]
    )


def weigh_upward(z: Array, points: int) -> Array:
    """The same for exp(-z (s - x)) S(s) ds from x to 1; the last x is 0."""
    mirrored = weigh_downward(z, points)[:, ::-1]
    return np.concatenate([mirrored[:-1][::-1], mirrored[-1:]])
