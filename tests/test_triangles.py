"""Systems of few rows by triangles of our own and products between them, beside LAPACK's."""

import numpy as np
import pytest
import scipy.linalg

from vrte import _core
from vrte.basics.arrays import Array, IntArray


def factorise(matrix: Array) -> tuple[Array, IntArray]:
    """The factors (column, row) of a matrix (row, column), and pivots from 1."""
    factors, pivots, info = scipy.linalg.lapack.dgetrf(matrix)
    assert info == 0
    return np.ascontiguousarray(factors.T), (pivots + 1).astype(np.int32)


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize(
    ("from_right", "columns"),
    [*((False, count) for count in (1, 4, 8, 63, 64, 65, 130)), *((True, count) for count in (1, 5, 16, 70))],
)
@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 15, 16, 17, 33, 64, 100])
def test_systems_are_solved(n: int, from_right: bool, columns: int, wide: bool) -> None:
    """M^-1 b or b M^-1, of no good matrices: the residual is as small as after LAPACK's, but for rounding."""
    rng = np.random.default_rng(1000 * n + columns)
    matrix = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-3.0, 3.0, n)
    factors, pivots = factorise(matrix)
    wanted = rng.normal(size=(n, columns))
    given = wanted if from_right else np.ascontiguousarray(wanted.T)
    found = _core.solve_by_factors(factors, pivots, given, from_right=from_right, wide=wide).T
    if from_right:  # as M^T x^T = b^T
        found, matrix = found.T, matrix.T
    scale = np.abs(matrix) @ np.abs(found) + np.abs(wanted)
    assert (np.abs(matrix @ found - wanted) <= 4e-16 * (n + 4) * scale.max(axis=0)).all()


def test_what_is_no_number_stays_in_its_column() -> None:
    """A right-hand side that is nan spoils no other."""
    rng = np.random.default_rng(6)
    factors, pivots = factorise(rng.normal(size=(20, 20)) * 10.0 ** rng.uniform(-3.0, 3.0, 20))
    given = rng.normal(size=(9, 20))
    clean = _core.solve_by_factors(factors, pivots, given)
    given[4, 3] = np.nan
    found = _core.solve_by_factors(factors, pivots, given)
    others = np.arange(9) != 4
    assert np.array_equal(found[others], clean[others])
    assert np.isnan(found[4]).any()
