"""The one spline of a BRDF, in angles from the normal and azimuth: for pictures, tables, renderers and bases.

A spline is its coefficients, and a sparse matrix that takes them to directions; `compute_weights` is both in one, for
few points. Grids go on beyond the data: periodically in azimuth, along great circles over the pole, mirrored at the
horizon.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.basics.polarization import FLIP
from vrte.basics.running import keep_to_one_thread

MARGIN = 16  # points repeated beyond each end: errors of the ends have decayed to 1e-9 there
MIRROR = np.outer(FLIP, FLIP)  # f(-phi) = f(phi) times this
POLE = 1e-6  # of the unit of a grid: nearer to the normal is on it
DEGREE = 3  # of the polynomials


def compute_coefficients(grids: tuple[Array, ...], values: Array, degree: int = DEGREE) -> Array:
    """B-spline coefficients of ``values`` (n_1, n_2, ..., more) on ascending grids (n_1,), (n_2,), ...: as many."""
    from scipy.interpolate import make_interp_spline

    with keep_to_one_thread():  # of BLAS: its threads wait for each other longer than banded systems take
        for axis, grid in enumerate(grids):
            inverse = make_interp_spline(grid, np.eye(grid.size), k=min(degree, grid.size - 1)).c
            values = np.moveaxis(np.tensordot(inverse, values, (1, axis)), 0, axis)
    return values


def make_spline_matrix(grids: tuple[Array, ...], points: tuple[Array, ...], degree: int = DEGREE) -> Any:
    """The sparse matrix (n, n_1 n_2 ...) from coefficients to points (n,) a grid; beyond a grid its end counts."""
    from scipy.interpolate import NdBSpline, make_interp_spline
    from scipy.sparse import csr_array

    shape = points[0].size, int(np.prod([grid.size for grid in grids]))
    if not points[0].size:
        return csr_array(shape)
    degrees = tuple(min(degree, grid.size - 1) for grid in grids)
    knots = tuple(make_interp_spline(grid, 0.0 * grid, k=k).t for grid, k in zip(grids, degrees, strict=True))
    inside = [np.clip(point, grid[0], grid[-1]) for grid, point in zip(grids, points, strict=True)]
    found = NdBSpline.design_matrix(np.stack(inside, axis=1), knots, degrees)
    return csr_array((found.data, found.indices, found.indptr), shape=shape)


def compute_weights(grid: Array, points: Array, degree: int = DEGREE) -> Array:
    """The weight (points, n) of each value on a grid (n,); one polynomial through few values."""
    coefficients = compute_coefficients((grid,), np.eye(grid.size), degree)
    return make_spline_matrix((grid,), (points,), degree) @ coefficients


def repeat_grid(
    grid: Array, period: float = 2.0 * np.pi, low: float = 0.0, high: float = np.inf, margin: int = MARGIN
) -> tuple[Array, NDArray[np.intp]]:
    """A period's points from ``low`` to ``high``, ``margin`` more at each end, and which of ``grid`` (n,) each is."""
    turns = -(-margin // grid.size) + 1
    count = np.arange(-turns * grid.size, (turns + 1) * grid.size + 1)
    going_on = grid[count % grid.size] + period * (count // grid.size)
    first, last = np.searchsorted(going_on, [low, min(high, period)])
    there = slice(max(0, first - margin), last + margin + 1)
    return going_on[there], count[there] % grid.size


def mirror_azimuths(phi: Array) -> tuple[Array, NDArray[np.intp]]:
    """Ascending azimuths [degrees] of ``phi`` (n,) and its mirror images, and where each is in both together."""
    found, indices = np.unique(np.round(np.concatenate([phi, -phi]) % 360.0, 9) % 360.0, return_index=True)
    return found, indices


def extend_azimuths(
    phi: Array,
    matrices: Array,
    low: float = 0.0,
    high: float = 360.0,
    margin: int = MARGIN,
    mirror: Array = MIRROR,
) -> tuple[Array, Array]:
    """Azimuths (m,) [degrees] from ``low`` to ``high`` and beyond, and the Mueller matrices (..., m, 4, 4) there, of
    those (..., n, 4, 4) at ``phi`` (n,) [degrees]; missing azimuths are mirror images, ``mirror`` times as large."""
    azimuths, indices = mirror_azimuths(phi)
    grid, turn = repeat_grid(azimuths, 360.0, low, high, margin)
    sign = np.where((indices[turn] >= phi.size)[:, None, None], mirror, 1.0)
    return grid, matrices[..., indices[turn] % phi.size, :, :] * sign


def extend_over_pole(
    theta: Array, here: Array, opposite: Array, axis: int = 0, margin: int = MARGIN
) -> tuple[Array, Array]:
    """Angles (m,), values along great circles, ``opposite`` at angles below 0; ``theta`` (n,) ascends on ``axis``."""
    behind = np.flatnonzero(theta > POLE)[:margin][::-1]  # the pole itself counts once
    return np.concatenate([-theta[behind], theta]), np.concatenate([opposite.take(behind, axis), here], axis)


def extend_over_horizon(s: Array, values: Array, axis: int = 0, margin: int = MARGIN) -> tuple[Array, Array]:
    """Variables (m,) of `stretch_cosines` and values, mirrored at the horizon s = 1; ``s`` (n,) ascends on ``axis``."""
    there = np.flatnonzero(s < 1.0 - POLE)[-margin:][::-1]
    return np.concatenate([s, 2.0 - s[there]]), np.concatenate([values, values.take(there, axis)], axis)


def stretch_cosines(mu: Array) -> Array:
    """s from 0 at the normal to 1 at the horizon, theta = 90 degrees sin(pi s/2): smooth at both ends."""
    return np.arcsin(np.minimum(np.arccos(mu) / (0.5 * np.pi), 1.0)) / (0.5 * np.pi)


def make_cosines(count: int) -> Array:
    """Descending cosines (count,), evenly spaced in s of `stretch_cosines`, half a step from both its ends."""
    middles = (np.arange(count) + 0.5) / count
    return np.cos(0.5 * np.pi * np.sin(0.5 * np.pi * middles))
