"""An oracle nobody can argue with: adding-doubling of the discrete system in ball arithmetic (python-flint).

The same system that the package solves (double-Gauss nodes, l < 2 N terms), with directions off the nodes as nodes of
weight zero and the beams as nodes into which nothing scatters. Every number is a ball that contains the true value, so
its digits are right, whatever the thickness and the albedo.
"""

import math
from collections.abc import Sequence

import numpy as np
from flint import arb, arb_mat, ctx, fmpq

BITS = 256


def exact(value: float) -> arb:
    """The double itself, not a rounding of it."""
    numerator, denominator = float(value).as_integer_ratio()
    return arb(fmpq(numerator, denominator))


def wigner(m: int, k: int, terms: int, mu: arb) -> list[arb]:
    """d^l_{m,k}(mu) for l = 0 .. terms - 1, upward in l; m >= 0, k = 0 or +-2."""
    start = max(m, abs(k))
    values = [arb(0)] * terms
    if start >= terms:
        return values
    sign = 1 if k >= m else (-1) ** (m - k)
    scale = arb(math.factorial(2 * start)) / (math.factorial(abs(m - k)) * math.factorial(abs(m + k)))
    now = sign * scale.sqrt() / 2**start * power(1 - mu, abs(m - k)) * power(1 + mu, abs(m + k))
    before = arb(0)
    for l in range(start, terms):
        values[l] = now
        if l == 0:
            after = mu
        else:
            lower = (l + 1) * arb((l * l - m * m) * (l * l - k * k)).sqrt()
            upper = l * arb(((l + 1) ** 2 - m * m) * ((l + 1) ** 2 - k * k)).sqrt()
            after = ((2 * l + 1) * (l * (l + 1) * mu - m * k) * now - lower * before) / upper
        before, now = now, after
    return values


def power(base: arb, twice: int) -> arb:
    """base^(twice/2); base >= 0."""
    whole = base ** (twice // 2)
    return whole * base.sqrt() if twice % 2 else whole


def legendre_matrices(m: int, terms: int, mu: arb) -> list[arb_mat]:
    """P_l^m, l = 0 .. terms - 1."""
    p, plus, minus = (wigner(m, k, terms, mu) for k in (0, 2, -2))
    matrices = []
    for l in range(terms):
        r, t = (plus[l] + minus[l]) / 2, (plus[l] - minus[l]) / 2
        matrices.append(arb_mat([[p[l], 0, 0, 0], [0, r, -t, 0], [0, -t, r, 0], [0, 0, 0, p[l]]]))
    return matrices


def coefficient_matrix(row: Sequence[float]) -> arb_mat:
    """B_l of (1:9)."""
    a1, a2, a3, a4, b1, b2 = (exact(value) for value in row)
    return arb_mat([[a1, -b1, 0, 0], [-b1, a2, 0, 0], [0, 0, a3, -b2], [0, 0, b2, a4]])


def blocks(matrices: list[list[arb_mat]]) -> arb_mat:
    """One matrix from a square array of 4x4 blocks."""
    size = len(matrices)
    return arb_mat([[matrices[i // 4][j // 4][i % 4, j % 4] for j in range(4 * size)] for i in range(4 * size)])


def slab(
    m: int, coefficients: np.ndarray, albedo: float, thickness: float, mu: list[arb], weight: list[arb], n_in: int
) -> tuple[arb_mat, arb_mat]:
    """R and T of the slab on the directions mu; the last n_in carry the beams."""
    terms = len(coefficients)
    count, omega, none = len(mu), exact(albedo), arb_mat(4, 4)
    here = [legendre_matrices(m, terms, u) for u in mu]
    middle = [coefficient_matrix(row) for row in coefficients]
    flip = arb_mat([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1]])
    left = [[here[i][l] * middle[l] for l in range(m, terms)] for i in range(count)]
    # Pm = A(mu, -mu') D, with P_l^m(-u) = (-1)^(l-m) D P_l^m(u) D
    turned = [[(-1) ** (l - m) * (flip * matrix) if l >= m else none for l, matrix in enumerate(row)] for row in here]
    forward, back = [], []
    for i in range(count):
        forward.append([none] * count)
        back.append([none] * count)
        if i >= count - n_in:
            continue
        for j in range(count):
            if weight[j] == 0:
                continue
            same, other = none, none
            for l in range(m, terms):
                same = same + left[i][l - m] * here[j][l]
                other = other + left[i][l - m] * turned[j][l]
            scale = omega / 2 * weight[j] / mu[i]
            forward[i][j] = scale * same
            back[i][j] = scale * other
    size = 4 * count
    a, b = blocks(forward), blocks(back)
    for i in range(size):
        a[i, i] = a[i, i] - 1 / mu[i // 4]
    steepest = max(float(1 / u) for u in mu)
    doublings = max(0, math.ceil(math.log2(max(thickness * steepest, 1e-300))))
    h = exact(thickness) / 2**doublings
    whole = arb_mat(2 * size, 2 * size)
    for i in range(size):
        for j in range(size):
            whole[i, j], whole[i, size + j] = h * a[i, j], h * b[i, j]
            whole[size + i, j], whole[size + i, size + j] = -h * b[i, j], -h * a[i, j]
    start = whole.exp()
    part = lambda top, side: arb_mat([[start[top + i, side + j] for j in range(size)] for i in range(size)])  # noqa: E731
    R = -1 * part(size, size).solve(part(size, 0))
    T = part(0, 0) + part(0, size) * R
    one = arb_mat([[int(i == j) for j in range(size)] for i in range(size)])
    for _ in range(doublings):
        inner = (one - R * R).solve(T)
        R, T = R + T * (R * inner), T * inner
    return R, T


def centre(ball: arb) -> float:
    """The double nearest to a ball's centre, which must leave no doubt of it."""
    assert float(ball.rad()) < 1e-30
    return float(ball)


def brdf_order(
    m: int,
    coefficients: np.ndarray,
    albedo: float,
    thickness: float,
    mu_i: Sequence[float],
    mu_o: Sequence[float],
    nodes: int,
) -> tuple[np.ndarray, np.ndarray]:
    """f^m and the diffuse BTDF's (in, out, 4, 4) [1/sr], public frame, over a black base."""
    ctx.prec = BITS
    roots = [arb.legendre_p_root(nodes, k, weight=True) for k in range(nodes)]
    mu = [(x + 1) / 2 for x, _ in roots] + [exact(u) for u in [*mu_o, *mu_i]]
    weight = [w / 2 for _, w in roots] + [arb(0)] * len(mu_o) + [arb(1)] * len(mu_i)
    R, T = slab(m, coefficients[: 2 * nodes], albedo, thickness, mu, weight, len(mu_i))
    reflected, transmitted = (np.empty((len(mu_i), len(mu_o), 4, 4)) for _ in range(2))
    for i, u in enumerate(mu_i):
        for o in range(len(mu_o)):
            row, column = 4 * (nodes + o), 4 * (nodes + len(mu_o) + i)
            for a in range(4):
                for b in range(4):
                    scale = 2 * arb.pi() * exact(u)
                    reflected[i, o, a, b] = centre(R[row + a, column + b] / scale) * (1 if a < 2 else -1)
                    transmitted[i, o, a, b] = centre(T[row + a, column + b] / scale)
    return reflected, transmitted
