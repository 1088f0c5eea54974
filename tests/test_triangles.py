"""Systems of few rows by triangles of our own and products between them, beside LAPACK's."""

import numpy as np
import pytest
import scipy.linalg

from vrte import _core
from vrte.basics.arrays import Array, IntArray

from .helpers import assert_close

SIZES = [1, 2, 3, 4, 7, 15, 16, 17, 33, 64, 100]


def factorise(n: int, rng: np.random.Generator) -> tuple[Array, Array, IntArray]:
    """A matrix (row, column), not a good one, its factors (column, row) and pivots from 1."""
    matrix = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-3.0, 3.0, n)
    factors, pivots, info = scipy.linalg.lapack.dgetrf(matrix)
    assert info == 0
    return matrix, np.ascontiguousarray(factors.T), (pivots + 1).astype(np.int32)


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("columns", [1, 4, 8, 63, 64, 65, 130])
@pytest.mark.parametrize("n", SIZES)
def test_systems_are_solved(n: int, columns: int, wide: bool) -> None:
    """M^-1 b: what is left over is as small as after LAPACK's, but for rounding."""
    rng = np.random.default_rng(1000 * n + columns)
    matrix, factors, pivots = factorise(n, rng)
    wanted = rng.normal(size=(n, columns))
    found = _core.solve_by_factors(factors, pivots, np.ascontiguousarray(wanted.T), wide=wide).T
    scale = np.abs(matrix) @ np.abs(found) + np.abs(wanted)
    assert (np.abs(matrix @ found - wanted) <= 4e-16 * (n + 4) * scale.max(axis=0)).all()


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("rows", [1, 5, 16, 70])
@pytest.mark.parametrize("n", SIZES)
def test_systems_are_solved_from_the_right(n: int, rows: int, wide: bool) -> None:
    """b M^-1, the same."""
    rng = np.random.default_rng(1000 * n + rows)
    matrix, factors, pivots = factorise(n, rng)
    wanted = rng.normal(size=(rows, n))
    given = np.ascontiguousarray(wanted.T)
    found = _core.solve_by_factors(factors, pivots, given, from_right=True, wide=wide).T
    scale = np.abs(found) @ np.abs(matrix) + np.abs(wanted)
    assert (np.abs(found @ matrix - wanted) <= 4e-16 * (n + 4) * scale.max(axis=1)[:, None]).all()


def test_both_copies_of_the_loops_agree_with_lapack() -> None:
    """On one matrix of the kind that slabs bring: near 1."""
    rng = np.random.default_rng(5)
    matrix = np.eye(48) + 0.1 * rng.normal(size=(48, 48))
    factors, pivots, _ = scipy.linalg.lapack.dgetrf(matrix)
    given = rng.normal(size=(48, 20))
    wanted = scipy.linalg.lapack.dgetrs(factors, pivots, given)[0]
    for wide in (False, True):
        found = _core.solve_by_factors(
            np.ascontiguousarray(factors.T), (pivots + 1).astype(np.int32), np.ascontiguousarray(given.T), wide=wide
        )
        assert_close(found.T, wanted, rtol=0.0, atol=1e-13)


def test_what_is_no_number_stays_in_its_column() -> None:
    """A right-hand side that is nan spoils no other."""
    rng = np.random.default_rng(6)
    _, factors, pivots = factorise(20, rng)
    given = rng.normal(size=(9, 20))
    clean = _core.solve_by_factors(factors, pivots, given)
    given[4, 3] = np.nan
    found = _core.solve_by_factors(factors, pivots, given)
    others = np.arange(9) != 4
    assert np.array_equal(found[others], clean[others])
    assert np.isnan(found[4]).any()
