"""Cubic splines on products of grids, as sparse matrices: directions do not depend on the wavelength, values do."""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array

WRAPPED = 16  # points of a period that are repeated at each end: what the ends spoil has faded to 1e-9 there


def coefficients(grids: tuple[Array, ...], values: Array) -> Array:
    """B-spline coefficients of ``values`` (n_1, n_2, ..., more) on ascending grids (n_1,), (n_2,), ...: as many."""
    from scipy.interpolate import make_interp_spline

    for axis, grid in enumerate(grids):
        values = np.moveaxis(make_interp_spline(grid, np.moveaxis(values, axis, 0), k=3).c, 0, axis)
    return values


def rows(grids: tuple[Array, ...], points: tuple[Array, ...]) -> Any:
    """The sparse matrix (n, n_1 n_2 ...) that takes flattened coefficients to the points, one coordinate (n,) a grid.

    Points beyond a grid are taken at its end.
    """
    from scipy.interpolate import BSpline, make_interp_spline
    from scipy.sparse import csr_array

    columns, weights = np.zeros((points[0].size, 1), dtype=np.int32), np.ones((points[0].size, 1))
    for grid, point in zip(grids, points, strict=True):
        knots = make_interp_spline(grid, np.zeros(grid.size), k=3).t
        one = BSpline.design_matrix(np.clip(point, grid[0], grid[-1]), knots, 3)
        place, share = one.indices.astype(np.int32).reshape(-1, 4), one.data.reshape(-1, 4)
        columns = (columns[:, :, None] * np.int32(grid.size) + place[:, None, :]).reshape(len(point), -1)
        weights = (weights[:, :, None] * share[:, None, :]).reshape(len(point), -1)
    count, each = columns.shape
    shape = count, int(np.prod([grid.size for grid in grids]))
    return csr_array(
        (weights.ravel(), columns.ravel(), np.arange(0, count * each + 1, each, dtype=np.int32)), shape=shape
    )


def wrapped_grid(count: int) -> Array:
    """Equal steps of one turn [rad] from 0, and WRAPPED more at each end.

    >>> wrapped_grid(36).size
    68
    """
    return np.asarray(np.arange(-WRAPPED, count + WRAPPED) * (2.0 * np.pi / count), dtype=np.float64)


def wrapped(values: Array, axis: int) -> Array:
    """Values on equal steps of one turn, repeated as `wrapped_grid` wants them."""
    count = values.shape[axis]
    return np.take(values, np.arange(-WRAPPED, count + WRAPPED) % count, axis=axis)
