"""Phase matrices of Fourier orders, literally: from Wigner's d by its explicit sum, nothing shared with the package."""

from math import comb, sqrt

import numpy as np

D = np.diag([1.0, 1.0, -1.0, -1.0])


def wigner(l, m, k, u):
    """d^l_{m,k} at cosine u, by the explicit sum (exact integers, so good to about l = 20)."""
    if l < max(abs(m), abs(k)):
        return np.zeros_like(u)
    c, s = np.sqrt((1 + u) / 2), np.sqrt((1 - u) / 2)
    # sqrt((l+m)!(l-m)!(l+k)!(l-k)!) times the sum over j, regrouped into binomials
    total = np.zeros_like(u)
    for j in range(max(0, k - m), min(l + k, l - m) + 1):
        sign = (-1.0) ** (m - k + j)
        total = total + sign * comb(l + k, j) * comb(l - k, l - m - j) * c ** (2 * l + k - m - 2 * j) * s ** (
            m - k + 2 * j
        )
    return sqrt(comb(2 * l, l + k) / comb(2 * l, l + m)) * total


def legendre_matrix(l, m, u):
    """P_l^m (n, 4, 4) at the cosines u."""
    p, plus, minus = wigner(l, m, 0, u), wigner(l, m, 2, u), wigner(l, m, -2, u)
    out = np.zeros((u.size, 4, 4))
    out[:, 0, 0] = out[:, 3, 3] = p
    out[:, 1, 1] = out[:, 2, 2] = (plus + minus) / 2
    out[:, 1, 2] = out[:, 2, 1] = -(plus - minus) / 2
    return out


def a_matrix(m, coefficients, u, v):
    """A^m(u, v), (1:9), cosines positive downward: (4 n_u, 4 n_v)."""
    total = np.zeros((u.size, 4, v.size, 4))
    for l in range(m, len(coefficients)):
        a1, a2, a3, a4, b1, b2 = coefficients[l]
        middle = np.array([[a1, -b1, 0, 0], [-b1, a2, 0, 0], [0, 0, a3, -b2], [0, 0, b2, a4]])
        total += np.einsum("uij,jk,vkl->uivl", legendre_matrix(l, m, u), middle, legendre_matrix(l, m, v))
    return total.reshape(4 * u.size, 4 * v.size)


def azimuthal_sum(orders, phi_deg):
    """sum_m (2 - delta) of cosine and sine blocks: (in, out, phi, 4, 4)."""
    total = 0.0
    for m, f in enumerate(orders):
        c, s = np.cos(np.radians(m * phi_deg))[:, None, None], np.sin(np.radians(m * phi_deg))[:, None, None]
        blocks = np.block([[np.ones((2, 2)) * c, -np.ones((2, 2)) * s], [np.ones((2, 2)) * s, np.ones((2, 2)) * c]])
        total = total + (1 if m == 0 else 2) * blocks * f[:, :, None]
    return total
