"""A literal solver to test against: adding-doubling of the discrete-ordinate system, Fourier order by order.

Directions off the nodes are extra nodes of weight zero. Nothing is shared with the package but the associated Legendre
matrices, which are built here from Wigner's d by its explicit sum.
"""

from math import comb, sqrt

import numpy as np
from scipy.linalg import expm

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


def slab(m, coefficients, albedo, thickness, mu, weights, n_in):
    """Reflection and total transmission of a slab on the directions mu, flipped frame, acting on radiance.

    The last n_in directions carry the beam: weight 1, and nothing scatters into them.
    """
    size = 4 * mu.size
    inverse = np.repeat(1 / mu, 4)
    flip = np.kron(np.eye(mu.size), D)
    w = np.repeat(weights, 4)
    forward = albedo / 2 * inverse[:, None] * a_matrix(m, coefficients, mu, mu) * w
    back = albedo / 2 * inverse[:, None] * (a_matrix(m, coefficients, mu, -mu) @ flip) * w
    forward[size - 4 * n_in :] = back[size - 4 * n_in :] = 0.0
    through = forward - np.diag(inverse)
    doublings = max(0, int(np.ceil(np.log2(max(thickness, 1e-300) * inverse.max() * 4))))
    start = expm(thickness / 2.0**doublings * np.block([[through, back], [-back, -through]]))
    R = -np.linalg.solve(start[size:, size:], start[size:, :size])
    T = start[:size, :size] + start[:size, size:] @ R
    one = np.eye(size)
    for _ in range(doublings):
        inner = np.linalg.inv(one - R @ R)
        R, T = R + T @ inner @ R @ T, T @ inner @ T
    return R, T


def star(upper, lower):
    """R and T seen from above, and from below, of two joined parts (Ra, Ta, Rb, Tb)."""
    Ra, Ta, Rb, Tb = upper
    Sa, Ua, Sb, Ub = lower
    one = np.eye(len(Ra))
    inner, outer = np.linalg.inv(one - Sa @ Rb), np.linalg.inv(one - Rb @ Sa)
    return Ra + Tb @ inner @ Sa @ Ta, Ua @ outer @ Ta, Sb + Ua @ outer @ Rb @ Ub, Tb @ inner @ Ub


def azimuthal_sum(orders, phi_deg):
    """sum_m (2 - delta) of cosine and sine blocks: (in, out, phi, 4, 4)."""
    total = 0.0
    for m, f in enumerate(orders):
        c, s = np.cos(np.radians(m * phi_deg))[:, None, None], np.sin(np.radians(m * phi_deg))[:, None, None]
        blocks = np.block([[np.ones((2, 2)) * c, -np.ones((2, 2)) * s], [np.ones((2, 2)) * s, np.ones((2, 2)) * c]])
        total = total + (1 if m == 0 else 2) * blocks * f[:, :, None]
    return total
