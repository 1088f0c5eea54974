"""Divided differences of exp, right to rounding for any spacing; the core's are in core/complex.pxi, those of OpenCL in
cl/complexes.cl."""

from typing import Any

import numpy as np

SMALL = 1e-5  # differences of the points that the series of exp[a, b] is for


def divide_exp_once(a: Any, b: Any) -> Any:
    """exp[a, b] = (e^a - e^b)/(a - b) for complex a, e^b where they meet, of any shapes; real parts <= 0."""
    gap = a - b
    small = np.abs(gap) < SMALL
    # the larger one in front: expm1 of what does not grow
    ahead = np.where(gap.real > 0.0, a, b)
    turned = np.where(gap.real > 0.0, -gap, gap)
    slope = np.where(small, 1.0 + turned / 2.0 + turned**2 / 6.0, np.expm1(turned) / np.where(small, 1.0, turned))
    return np.exp(ahead) * slope
