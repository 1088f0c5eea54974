"""The exponent p of t = c x^p, by least squares of log t against log x."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array

FEWEST = 3  # points: two leave nothing to tell the uncertainty from


@dataclass(frozen=True)
class Fit:
    """``exponent`` with its standard error, ``factor`` c [s], and the range of x it is from.

    The error is that of the scatter about the straight line, so it holds curvature as well as noise.
    """

    exponent: float
    error: float
    factor: float
    lowest: float
    highest: float
    points: int

    def __str__(self) -> str:
        return f"{self.exponent:z.2f} ± {self.error:.2f}"

    def at(self, x: Any) -> Any:
        """Seconds on the fitted line."""
        return self.factor * np.asarray(x, dtype=np.float64) ** self.exponent


def fit_exponent(x: Any, seconds: Any) -> Fit | None:
    """The fit through the points with x > 0 and a time above 0; None of fewer than 3, or of one x alone.

    >>> str(fit_exponent([1, 2, 4], [0.5, 4.0, 32.0]))
    '3.00 ± 0.00'
    """
    x, seconds = np.asarray(x, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
    there = (x > 0.0) & (seconds > 0.0)
    x, seconds = x[there], seconds[there]
    if x.size < FEWEST or np.ptp(x) == 0.0:
        return None
    along, up = np.log(x), np.log(seconds)
    from_mean = along - along.mean()
    spread = float(from_mean @ from_mean)
    exponent = float(from_mean @ up) / spread
    intercept = float(up.mean() - exponent * along.mean())
    residual = up - (intercept + exponent * along)
    error = math.sqrt(float(residual @ residual) / (x.size - 2) / spread)
    return Fit(exponent, error, math.exp(intercept), float(x.min()), float(x.max()), int(x.size))


def upper_half(x: Array) -> Array:
    """Which points lie in the upper half of the axis, on a logarithmic scale: (points,) of bool.

    There a constant cost weighs least, so the exponent is nearest to that of the term that grows.

    >>> upper_half(np.array([1.0, 4.0, 16.0])).tolist()
    [False, True, True]
    """
    return np.asarray(x >= math.sqrt(float(x.min()) * float(x.max())) * (1.0 - 1e-12))
