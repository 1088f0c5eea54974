"""Reflection and transmission of a thin layer: single scattering, and what its source function at Gauss depths adds."""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.divided_differences import divide_exp_once
from vrte.methods.parts.adding import Slab, make_homogeneous_slab
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward, weigh_upward
from vrte.methods.parts.on_nodes import Scattered


def make_thin_slab(scattered: Scattered, tau: float, rows: Array, columns: Array, n: int, points: int) -> Slab:
    """R and T of a layer of optical thickness tau, error of order tau^(2 points) of what is doubled from it.

    ``points`` 0: single scattering, (2:24)-(2:26), an error of order tau; otherwise the source function of light that
    was scattered before is a polynomial through that many Gauss depths, solved for, and single scattering stays exact.
    rows (r,), columns (c,): cosines, the first n those of the nodes.
    """
    lengths = tau / rows[:, None], tau / columns
    R = scattered.back * tau * integrate_once_back(*lengths)
    T = scattered.ahead * tau * integrate_once_ahead(*lengths)
    if points:
        more_R, more_T = scatter_again(scattered, tau, rows, columns, n, points)
        R, T = R + more_R, T + more_T
    return make_homogeneous_slab(R, T, tau, rows, columns, n)


def integrate_once_back(z: Array, beam: Array) -> Array:
    """The integral of exp(-(z + beam) s) ds over (0, 1)."""
    way = z + beam
    faded = way > 0.0  # 0 where the thickness is the smallest number that there is
    return np.where(faded, -np.expm1(-way) / np.where(faded, way, 1.0), 1.0)


def integrate_once_ahead(z: Array, beam: Array) -> Array:
    """The integral of exp(-z (1 - s) - beam s) ds over (0, 1)."""
    found: Array = divide_exp_once(-z + 0.0 * beam, -beam + 0.0 * z)
    return found


def scatter_again(
    scattered: Scattered, tau: float, rows: Array, columns: Array, n: int, points: int
) -> tuple[Array, Array]:
    """R and T of all scatterings but the first, each (r, c)."""
    z, beam = tau / rows[:n], tau / columns
    depths = find_gauss_depths(points)
    # light scattered once, at the depths, (point, n, c)
    once = [
        np.stack(
            [
                scattered.ahead[:n] * tau * x * integrate_once_ahead(x * z[:, None], x * beam),
                scattered.back[:n]
                * tau
                * (1.0 - x)
                * integrate_once_back((1.0 - x) * z[:, None], (1.0 - x) * beam)
                * np.exp(-x * beam),
            ]
        )
        for x in depths
    ]
    first = np.stack(once, axis=1)  # (down or up, point, n, c)
    field = np.linalg.solve(build_scattering_system(scattered, tau, z, n, points), first.reshape(-1, columns.size))
    down, up = field.reshape(first.shape)
    ahead, back = scattered.ahead[:, :n], scattered.back[:, :n]
    lengths = tau / rows
    R = tau * np.einsum("jr,jrc->rc", weigh_upward(lengths, points)[-1], ahead @ up + back @ down)
    T = tau * np.einsum("jr,jrc->rc", weigh_downward(lengths, points)[-1], ahead @ down + back @ up)
    return R, T


def build_scattering_system(scattered: Scattered, tau: float, z: Array, n: int, points: int) -> Array:
    """One less what one scattering makes of the light down and up at the depths, (2 points n, 2 points n)."""
    ahead, back = scattered.ahead[:n, :n], scattered.back[:n, :n]
    falls, rises = tau * weigh_downward(z, points)[:-1], tau * weigh_upward(z, points)[:-1]
    blocks = [
        [np.einsum("kji,il->kijl", way, matrix) for matrix in pair]
        for way, pair in ((falls, (ahead, back)), (rises, (back, ahead)))
    ]
    size = points * n
    return np.eye(2 * size) - np.block([[block.reshape(size, size) for block in row] for row in blocks])
