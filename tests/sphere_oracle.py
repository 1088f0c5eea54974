"""a_n and b_n of spheres as Bohren and Huffman (1983) write them, in ball arithmetic, and what is made of them, order
by order."""

import itertools
from typing import Any

import numpy as np
from flint import acb, arb, ctx, fmpq


def make_ball(value: complex) -> acb:
    real, imaginary = (arb(fmpq(*float(part).as_integer_ratio())) for part in (value.real, value.imag))
    return acb(real, imaginary)


def find_waves(n: int, z: acb) -> list[acb]:
    """psi_n, psi_n', chi_n and chi_n': z j_n and -z y_n."""
    root, half = (acb.pi() * z / 2).sqrt(), acb(1) / 2
    found = []
    for kind, sign in (("bessel_j", 1), ("bessel_y", -1)):
        wave, before = (sign * root * getattr(z, kind)(n - step + half) for step in (0, 1))
        found += [wave, before - n * wave / z]
    return found


def solve_literally(n: int, arguments: list[acb]) -> list[acb]:
    """(4.53) of an index and a size, (8.2) of two indices and two sizes."""
    outer = arguments[-1]
    psi, psi_slope, chi, chi_slope = find_waves(n, outer)
    xi, xi_slope = psi - acb(0, 1) * chi, psi_slope - acb(0, 1) * chi_slope
    index = arguments[0] if len(arguments) == 2 else arguments[1]
    inside, inside_slope, other, other_slope = find_waves(n, index * outer)
    fields = [(inside, inside_slope)] * 2
    if len(arguments) == 4:
        core, shell, core_size, _ = arguments
        u, du, _, _ = find_waves(n, core * core_size)
        v, dv, c, dc = find_waves(n, shell * core_size)
        mixed = (
            (shell * v * du - core * dv * u) / (shell * c * du - core * dc * u),
            (shell * u * dv - core * v * du) / (shell * dc * u - core * du * c),
        )
        fields = [(inside - part * other, inside_slope - part * other_slope) for part in mixed]
    (u, du), (v, dv) = fields
    return [
        (index * u * psi_slope - psi * du) / (index * u * xi_slope - xi * du),
        (v * psi_slope - index * psi * dv) / (v * xi_slope - index * xi * dv),
    ]


def solve_exactly(n: int, given: tuple[complex, ...]) -> list[complex]:
    """a_n and b_n of indices and size parameters, from the inside out, with as many bits as it takes."""
    for doublings in itertools.count(1):
        with ctx.workprec(64 << doublings):
            found = solve_literally(n, [make_ball(complex(value)) for value in given])
        if min(one.rel_accuracy_bits() for one in found) > 60:
            return [complex(one) for one in found]
    raise AssertionError


def sum_amplitudes(a: Any, b: Any, angle_deg: Any) -> tuple[np.ndarray, np.ndarray]:
    """S1, S2 at scattering angles [degrees] (angles,): (4.74)."""
    cosine = np.cos(np.radians(angle_deg))
    s1, s2 = np.zeros((2, cosine.size), dtype=complex)
    before, pi = np.zeros_like(cosine), np.ones_like(cosine)
    for n, (one, other) in enumerate(zip(a, b, strict=True), 1):
        tau = n * cosine * pi - (n + 1) * before
        factor = (2 * n + 1) / (n * (n + 1))
        s1 += factor * (one * pi + other * tau)
        s2 += factor * (one * tau + other * pi)
        before, pi = pi, ((2 * n + 1) * cosine * pi - (n + 1) * before) / n
    return s1, s2


def sum_efficiencies(a: Any, b: Any, size: float) -> tuple[float, float, float]:
    """Qext, Qsca and g of a size parameter: (4.61), (4.62) and section 4.5."""
    n = np.arange(1, a.size + 1)
    extinction, scattering = (2 * n + 1) @ (a + b).real, (2 * n + 1) @ (abs(a) ** 2 + abs(b) ** 2)
    g = (n * (n + 2) / (n + 1))[:-1] @ (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real
    g += (2 * n + 1) / (n * (n + 1)) @ (a * b.conj()).real
    return 2 * extinction / size**2, 2 * scattering / size**2, 2 * g / scattering
