"""Reflection of a layer without end: the algebraic Riccati equation by structure-preserving doubling.

Guo, Lin and Xu, Numer. Math. 103, 393 (2006): SDA. At albedo 1 two eigenvalues meet at 0, where doubling would be right
to 1e-8 only; the known one is moved away, Guo, Iannazzo and Meini, SIAM J. Matrix Anal. Appl. 29, 1083 (2007).
"""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.methods.parts.on_nodes import OnNodes, Scattered

SETTLED = 1e-15
MOST_DOUBLINGS = 60


def compute_endless_reflection(on_nodes: OnNodes, scattered: Scattered, conserves: bool) -> tuple[Array, int]:
    """R (r, c) of b + a R + R a + R b R = R/mu + R/mu', and doublings; ``conserves``: order 0 at albedo 1."""
    n = on_nodes.n
    ahead, back = scattered
    rate, columns = 1.0 / on_nodes.rows, 1.0 / on_nodes.columns
    lost = np.diag(rate[:n]) - ahead[:n, :n]
    isotropic = np.tile(np.eye(len(on_nodes.members))[0], on_nodes.problem.nodes.size) if conserves else None
    R, doublings = solve_on_nodes(lost, back[:n, :n], isotropic)
    result = np.empty_like(back)
    result[:n, :n] = R
    # columns of beams, then rows of outgoing directions, are linear once R on the nodes is known
    left = lost - R @ back[:n, :n]
    given = back[:n, n:] + R @ ahead[:n, n:]
    result[:n, n:] = solve_shifted(left, columns[n:], given)
    right = (lost - back[:n, :n] @ R).T
    result[n:, :n] = solve_shifted(right, rate[n:], (back[n:, :n] + ahead[n:, :n] @ R).T).T
    out, into = result[n:, :n], result[:n, n:]
    more = back[n:, n:] + ahead[n:, :n] @ into + out @ ahead[:n, n:] + out @ back[:n, :n] @ into
    result[n:, n:] = more / (rate[n:, None] + columns[n:])
    return result, doublings


def solve_shifted(matrix: Array, shifts: Array, given: Array) -> Array:
    """x_k of (matrix + shift_k) x_k = given_k, one column each, (n, k)."""
    if shifts.size == 0:
        return given
    shifted = matrix + shifts[:, None, None] * np.eye(matrix.shape[0])
    found: Array = np.asarray(np.linalg.solve(shifted, given.T[..., None])[..., 0].T, np.float64)
    return found


def solve_on_nodes(lost: Array, back: Array, isotropic: Array | None) -> tuple[Array, int]:
    """R (n, n) of back - lost R - R lost + R back R = 0, and doublings; (lost - back) isotropic (n,) is 0."""
    A, B, C, D = lost, back, back, lost
    if isotropic is not None:
        v = isotropic
        p = v / (2.0 * (v @ v))
        A, B, C, D = A - np.outer(v, p), B + np.outer(v, p), C - np.outer(v, p), D + np.outer(v, p)
    return double_until_settled(A, B, C, D)


def double_until_settled(A: Array, B: Array, C: Array, D: Array) -> tuple[Array, int]:
    """The smallest solution of X C X - X D - A X + B = 0, and doublings. Raises AccuracyError where none is found."""
    one = np.eye(len(A))
    gamma = max(float(np.diag(A).max()), float(np.diag(D).max()))
    A_g, D_g = A + gamma * one, D + gamma * one
    back_over_D = np.linalg.solve(D_g.T, B.T).T
    W = A_g - back_over_D @ C
    V = D_g - C @ np.linalg.solve(A_g, B)
    E, F = one - 2.0 * gamma * np.linalg.inv(V), one - 2.0 * gamma * np.linalg.inv(W)
    G = 2.0 * gamma * np.linalg.solve(D_g, C) @ np.linalg.inv(W)
    H = 2.0 * gamma * np.linalg.solve(W, back_over_D)
    for doubling in range(1, MOST_DOUBLINGS + 1):
        E_over, F_over = np.linalg.solve((one - G @ H).T, E.T).T, np.linalg.solve((one - H @ G).T, F.T).T
        added = F_over @ H @ E
        G, H, E, F = G + E_over @ G @ F, H + added, E_over @ E, F_over @ F
        if np.abs(added).max() <= SETTLED * np.abs(H).max():
            return H, doubling
    raise AccuracyError(f"the reflection of a layer without end does not settle in {MOST_DOUBLINGS} doublings")
