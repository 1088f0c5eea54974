"""Crowded spheres, slow and plain: Wertheim's closed form in ball arithmetic, Baxter's factor integrated number by
number, the Ornstein-Zernike equation on a grid, and Mie's series as a textbook has it."""

import math

import numpy as np
from flint import arb, ctx
from scipy.special import spherical_jn, spherical_yn

from vrte.basics.arrays import Array


def structure_factor_by_wertheim(x: float, fraction: float) -> float:
    """S(x = q d) of one size, to all digits of a double: cancellation is left to 400 bits."""
    before, ctx.prec = ctx.prec, 400
    try:
        y, e = arb(x), arb(fraction)
        sine, cosine = y.sin(), y.cos()
        first, second = (1 + 2 * e) ** 2 / (1 - e) ** 4, -((1 + e / 2) ** 2) / (1 - e) ** 4
        a = first * (sine - y * cosine) / y**3
        b = -6 * e * second * (y**2 * cosine - 2 * y * sine - 2 * cosine + 2) / y**4
        c = y**4 * cosine - 4 * y**3 * sine - 12 * y**2 * cosine + 24 * y * sine + 24 * cosine - 24
        return float(1 / (1 + 24 * e * (a + b - e * first / 2 * c / y**6)))
    finally:
        ctx.prec = before


def structure_matrix_by_integration(q: float, diameters: Array, densities: Array) -> Array:
    """S_ij(q) of a mixture: Baxter's functions integrated by 100 Gauss-Legendre nodes, the dense matrix inverted."""
    xi = [math.pi / 6.0 * densities @ diameters**power for power in range(4)]
    nodes, weights = np.polynomial.legendre.leggauss(100)
    count = diameters.size
    factor = np.eye(count, dtype=np.complex128)
    for i in range(count):
        a = (1.0 - xi[3] + 3.0 * diameters[i] * xi[2]) / (1.0 - xi[3]) ** 2
        b = -1.5 * diameters[i] ** 2 * xi[2] / (1.0 - xi[3]) ** 2
        for j in range(count):
            low, high = 0.5 * (diameters[i] - diameters[j]), 0.5 * (diameters[i] + diameters[j])
            t = 0.5 * (high - low) * nodes + 0.5 * (high + low)
            inside = (0.5 * a * (t**2 - high**2) + b * (t - high)) * np.exp(1j * q * t)
            integral = 0.5 * (high - low) * (weights @ inside)
            factor[i, j] -= 2.0 * math.pi * math.sqrt(densities[i] * densities[j]) * integral
    return np.linalg.inv(factor.conj().T @ factor)


def amplitudes_by_textbook(m: complex, x: float, cosine: float) -> tuple[complex, complex]:
    """S1 and S2 of a sphere: Bohren and Huffman (1983), (4.53), (4.47) and (4.74), by SciPy's Bessel functions."""
    orders = np.arange(1, int(x + 4.05 * x ** (1 / 3) + 10))

    def riccati(z: complex) -> tuple[Array, Array]:
        return z * spherical_jn(orders, z), spherical_jn(orders, z) + z * spherical_jn(orders, z, derivative=True)

    (inner, inner_slope), (outer, outer_slope) = riccati(m * x), riccati(complex(x))
    waves = x * (spherical_jn(orders, x) + 1j * spherical_yn(orders, x))
    slopes = waves / x + x * (spherical_jn(orders, x, derivative=True) + 1j * spherical_yn(orders, x, derivative=True))
    a = (m * inner * outer_slope - outer * inner_slope) / (m * inner * slopes - waves * inner_slope)
    b = (inner * outer_slope - m * outer * inner_slope) / (inner * slopes - m * waves * inner_slope)
    pi_before, pi, s1, s2 = 0.0, 1.0, 0j, 0j
    for n, one, other in zip(orders.tolist(), a, b, strict=True):
        tau = n * cosine * pi - (n + 1) * pi_before
        factor = (2 * n + 1) / (n * (n + 1))
        s1, s2 = s1 + factor * (one * pi + other * tau), s2 + factor * (one * tau + other * pi)
        pi_before, pi = pi, ((2 * n + 1) * cosine * pi - (n + 1) * pi_before) / n
    return s1, s2
