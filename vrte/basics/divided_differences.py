"""Divided differences of smooth functions, also where the points are close to each other or the same.

Those of exp have their own, right to rounding for any spacing; the core's are in core/complex.pxi, those of OpenCL in
cl/complexes.cl.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array

ComplexArray = NDArray[np.complex128]
Function = Callable[[ComplexArray], ComplexArray]
NEAR = 0.1  # of the largest point: closer ones go around by Cauchy's integral
RADIUS, SAMPLES = 0.3, 32  # of that circle over its centre; 0.3^32 is below rounding
SMALL = 1e-5  # gaps that the series of exp[a, b] is for
TERMS = 21  # of the series of exp[a, b, c], for gaps below 1


def divide_once(function: Function, a: Array | ComplexArray, b: Array | ComplexArray) -> ComplexArray:
    """f[a, b] = (f(a) - f(b))/(a - b), f'(a) where they are the same; a and b broadcast.

    The function is analytic off the negative real axis, on which no points lie that are near each other.

    >>> round(float(divide_once(np.sqrt, np.array([4.0]), np.array([4.0]))[0].real), 12)
    0.25
    """
    x, y = np.asarray(a, complex), np.asarray(b, complex)
    gap = x - y
    near = np.abs(gap) < NEAR * np.maximum(np.abs(x), np.abs(y))
    found = np.asarray((function(x) - function(y)) / np.where(near, 1.0, gap))
    if near.any():
        shape = gap.shape
        found[near] = integrate_around(function, [np.broadcast_to(points, shape)[near] for points in (x, y)])
    return found


def divide_twice(function: Function, a: Array, b: ComplexArray, c: Array) -> ComplexArray:
    """f[a, b, c]; a, b and c broadcast. From the two points that are farthest apart, so that no digits are lost."""
    x, y, z = (np.asarray(points, complex) for points in (a, b, c))
    xy, yz, xz = divide_once(function, x, y), divide_once(function, y, z), divide_once(function, x, z)
    gaps = np.stack(np.broadcast_arrays(x - z, y - z, x - y))
    steps = np.stack(np.broadcast_arrays(xy - yz, xy - xz, xz - yz))
    farthest = np.abs(gaps).argmax(axis=0)[None]
    gap, step = (np.take_along_axis(values, farthest, axis=0)[0] for values in (gaps, steps))
    near = np.abs(gap) < NEAR * np.maximum(np.maximum(np.abs(x), np.abs(y)), np.abs(z))
    found = np.asarray(step / np.where(near, 1.0, gap))
    if near.any():
        shape = gap.shape
        found[near] = integrate_around(function, [np.broadcast_to(points, shape)[near] for points in (x, y, z)])
    return found


def integrate_around(function: Function, points: list[ComplexArray]) -> ComplexArray:
    """The divided difference at points (n,) near each other: 1/(2 pi i) times the integral of f(z)/prod(z - point)."""
    centre = np.mean(points, axis=0)
    ring = RADIUS * centre[:, None] * np.exp(2j * np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)
    z = centre[:, None] + ring
    share = ring / np.prod([z - point[:, None] for point in points], axis=0)
    return np.asarray((function(z) * share).mean(axis=1))


def divide_exp_once(a: Any, b: Any) -> Any:
    """exp[a, b] = (e^a - e^b)/(a - b) for complex a, e^b where they meet, of any shapes; real parts <= 0."""
    gap = a - b
    small = np.abs(gap) < SMALL
    # the larger one in front: expm1 of what does not grow
    ahead = np.where(gap.real > 0.0, a, b)
    turned = np.where(gap.real > 0.0, -gap, gap)
    slope = np.where(small, 1.0 + turned / 2.0 + turned**2 / 6.0, np.expm1(turned) / np.where(small, 1.0, turned))
    return np.exp(ahead) * slope


def divide_exp_twice(*points: Any) -> Array:
    """exp[a, b, c] at three real points <= 0, any shapes that broadcast.

    >>> divide_exp_twice(0.0, 0.0, 0.0).item()
    0.5
    """
    high, middle, low = -np.sort(-np.stack(np.broadcast_arrays(*points)), axis=0)
    x, y = high - middle, high - low
    near = y < 1.0
    apart = np.where(near, 1.0, y)
    by_quotient = (divide_exp_once(np.zeros(1), -x) - divide_exp_once(-x, -y)) / apart
    return np.exp(high) * np.where(near, _sum_series(np.where(near, x, 0.0), np.where(near, y, 0.0)), by_quotient)


def _sum_series(x: Array, y: Array) -> Array:
    """The second divided difference of exp at 0, -x, -y: sum over n of (-1)^n h_n(x, y)/(n + 2)!, h_n complete and
    homogeneous; 0 <= x <= y < 1."""
    power, h = np.ones_like(x), np.ones_like(x)
    share = 0.5
    total = share * h
    for n in range(1, TERMS):
        power = power * x
        h = y * h + power
        share /= -(n + 2.0)
        total = total + share * h
    return total
