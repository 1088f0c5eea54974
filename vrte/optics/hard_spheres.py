"""Hard spheres of many sizes side by side, after Percus and Yevick: how light of neighbours interferes.

With n_i spheres of diameter d_i a volume, xi_k = pi/6 sum n_i d_i^k, the matrix of structure factors is
S(q) = [Q(q)^H Q(q)]^-1 with Baxter's factor

    Q_ij(q) = delta_ij - 2 pi sqrt(n_i n_j) int_s^r [a_i/2 (t^2 - r^2) + b_i (t - r)] exp(iqt) dt,
    s = (d_i - d_j)/2,  r = (d_i + d_j)/2,
    a_i = (1 - xi_3 + 3 d_i xi_2)/(1 - xi_3)^2,  b_i = -3/2 d_i^2 xi_2/(1 - xi_3)^2

Counted from s, the integral is exp(iq(d_i - d_j)/2) times two products of what belongs to i and what belongs to j: Q is
the identity less a matrix of rank 2, whose spherical Bessel functions lose no digits at small q.

Source: Baxter, J. Chem. Phys. 52, 4559 (1970); Vrij, J. Chem. Phys. 71, 3267 (1979).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from vrte.basics.arrays import Array
from vrte.optics.populations import Complex


def compute_structure_factor(q_um: ArrayLike, radius_um: float, volume_fraction: float) -> Array:
    """Structure factor S(q) (n,) of hard spheres of one radius [um]: their light together over that of each alone, at q
    = 2 k sin(theta/2) [1/um] (n,), k in the medium."""
    q = np.asarray(q_um, dtype=np.float64)
    alone = np.ones((1, 1, q.size), dtype=np.complex128)
    return np.abs(join_amplitudes(alone, q, np.array([radius_um]), np.ones(1), volume_fraction)[0, 0]) ** 2


def join_amplitudes(amplitudes: Complex, q: Array, radii: Array, weights: Array, volume_fraction: float) -> Complex:
    """Q^-H F of amplitudes F (kinds, sizes, angles), each times the root of its size's number share ``weights``: sums
    over sizes of products F F'* become sums over pairs, F_i S_ij F'_j*."""
    start, end = find_factors(q, radii, weights, volume_fraction)
    # Woodbury: (1 - v* u^H)^-1 = 1 + v* (1 - u^H v*)^-1 u^H, with matrices of rank 2
    inner = np.eye(2) - np.einsum("kis,lis->skl", start.conj(), end.conj())
    shared = np.linalg.solve(inner, np.einsum("kis,fis->skf", start.conj(), amplitudes))
    return amplitudes + np.einsum("kis,skf->fis", end.conj(), shared)


def find_factors(q: Array, radii: Array, weights: Array, volume_fraction: float) -> tuple[Complex, Complex]:
    """u and v of Q_ij = delta_ij - sum over k of u_ki v_kj: each (2, sizes, angles)."""
    from scipy.special import spherical_jn

    diameter = 2.0 * radii[:, None]
    filling = math.pi / 6.0 * (weights @ diameter**3)
    root = np.sqrt(weights * volume_fraction / filling)[:, None]  # of n_i
    free = 1.0 - volume_fraction
    crowd = volume_fraction * (weights @ diameter**2) / (weights @ diameter**3)  # xi_2
    phase = q * radii[:, None]  # q d/2
    j0, j1, j2 = (spherical_jn(order, phase) for order in range(3))
    turn = root * np.exp(1j * phase)
    start = np.stack([turn * (0.5 * (1.0 + 3.0 * diameter * crowd / free) / free), turn * (0.5 * diameter / free)])
    shell = 2.0 * math.pi * root * radii[:, None] ** 2
    # int (s^2 - 1) exp(iys) ds = -4 j1(y)/y and int (s - 1) exp(iys) ds = 2i j1(y) - 2 j0(y), both from -1 to 1
    end = np.stack([shell * radii[:, None] * (-4.0 / 3.0 * (j0 + j2)), shell * (2j * j1 - 2.0 * j0)])
    return start, end
