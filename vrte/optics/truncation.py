"""Peaked phase matrices made fit for few nodes: the forward peak counted as light that was not scattered (delta-M).

With f the share of the peak, diag(1, 1, 1, 1) delta(1 - cos), which turns and polarizes nothing, the rest has the
coefficients (a - (2l+1) f)/(1 - f), and light is scattered less: depths shrink by the factor 1 - albedo f, the albedo
becomes albedo (1 - f)/(1 - albedo f). The peak has the first coefficient that the nodes do not carry in common with the
phase matrix, so that of the rest is zero. Nothing makes sure that the rest is physical, so it is a table of
coefficients and no PhaseMatrix. Source: Wiscombe, J. Atmos. Sci. 34, 1408 (1977), here for 4x4 matrices.

Not every matrix has Q, U and V in its peak: scalar phase functions scatter none straight on. Light that comes in as Q,
U or V meets such a layer with its terms cut and without a peak taken off (`has_polarized_peak`).
"""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.phase_matrix import PhaseMatrix

TRUNCATIONS = ("none", "delta-m", "small-angle")
CHOICES = ("auto", *TRUNCATIONS)


@dataclass(frozen=True, eq=False)
class Truncated:
    """A layer as multiple scattering sees it: ``coefficients`` (terms, 6), albedo, optical thickness; ``fraction`` f of
    light in the peak, ``stretch`` 1 - albedo f of depths, ``gain`` albedo/stretch of the whole matrix."""

    coefficients: Array
    albedo: float
    thickness: float
    fraction: float
    stretch: float
    gain: float


def truncate_layer(name: str, phase_matrix: PhaseMatrix, albedo: float, thickness: float, terms: int) -> Truncated:
    """The layer with ``terms`` coefficients at most: cut for "none", by delta-M for "delta-m" and "small-angle"."""
    if name == "none":
        return Truncated(phase_matrix.coefficients[:terms], albedo, thickness, fraction=0.0, stretch=1.0, gain=albedo)
    return remove_forward_peak(phase_matrix, albedo, thickness, terms)


def remove_forward_peak(phase_matrix: PhaseMatrix, albedo: float, thickness: float, terms: int) -> Truncated:
    """The layer without its forward peak, ``terms`` >= 1 at most; else as it is, to the last bit."""
    f = find_peak_fraction(phase_matrix, terms)
    if f == 0.0:
        return truncate_layer("none", phase_matrix, albedo, thickness, terms)
    stretch = 1.0 - albedo * f
    rest = (phase_matrix.coefficients[:terms] - f * expand_peak(terms)) / (1.0 - f)
    return Truncated(rest, albedo * (1.0 - f) / stretch, thickness * stretch, f, stretch, albedo / stretch)


def find_peak_fraction(phase_matrix: PhaseMatrix, terms: int) -> float:
    """f, the first a1 left out over its 2 l + 1; 0 where none is, or where signs of coefficients alternate."""
    left_out = phase_matrix.a1[terms : terms + 2]
    if left_out.size == 0 or (left_out < 0.0).any():
        return 0.0
    return float(left_out[0]) / (2 * terms + 1)


def has_polarized_peak(phase_matrix: PhaseMatrix, terms: int) -> bool:
    """Whether Q and U are in the forward peak as I is: half of it at least, summed up over the terms left out."""
    a1, a2, a3 = phase_matrix.coefficients[terms:, :3].sum(axis=0).tolist()
    return bool(a2 + a3 >= a1)


def expand_peak(terms: int) -> Array:
    """The coefficients of diag(1, 1, 1, 1) delta(1 - cos): 2 l + 1, and none of a2 and a3 below l = 2; (terms, 6)."""
    coefficients = np.zeros((terms, 6))
    coefficients[:, :4] = (2.0 * np.arange(terms) + 1.0)[:, None]
    coefficients[:2, 1:3] = 0.0
    return coefficients
