"""Eigenvalues and vectors of small symmetric matrices by our own loops, beside flint's and LAPACK's."""

import flint
import numpy as np
import pytest

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.quadrature import make_double_gauss

from .helpers import assert_close


def make_graded(n: int) -> Array:
    """What L^T E L of an order is like: the square of 1/mu on the diagonal, less what is scattered between nodes."""
    mu, weights = make_double_gauss(n)
    scattered = 0.4 * np.cos(np.subtract.outer(mu, mu)) * np.sqrt(np.outer(weights, weights))
    return (np.diag(mu) - scattered * np.sqrt(np.outer(mu, mu))) / np.outer(mu, mu) ** 1.5


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 16, 33, 64, 96])
def test_it_is_an_eigenproblem_solved(n: int, wide: bool) -> None:
    """Vectors are orthonormal and diagonalise, values are LAPACK's, the small ones relative to themselves."""
    for matrix in (make_graded(n), np.eye(n), np.zeros((n, n)), np.ones((n, n)), 1e-100 * make_graded(n)):
        values, vectors = _core.symmetric_eigenproblem(matrix, wide)
        largest = np.linalg.norm(matrix, 2)
        assert np.abs(vectors @ vectors.T - np.eye(n)).max() < 1e-14 * np.sqrt(n) + 4e-15
        assert np.abs(vectors @ matrix - values[:, None] * vectors).max() <= 3e-15 * np.sqrt(n) * largest
        assert_close(np.sort(values), np.linalg.eigvalsh(matrix), rtol=0.0, atol=2e-14 * n * largest)


def test_small_values_of_a_graded_matrix_keep_their_digits() -> None:
    """Beside 200 bits: what is 1e-6 of the largest is right to 1e-13 of itself, not of the largest."""
    matrix = make_graded(16)
    with flint.ctx.workprec(200):
        exact = flint.acb_mat(flint.arb_mat(matrix.tolist())).eig()
    wanted = np.sort([float(value.real.mid()) for value in exact])
    assert wanted[-1] / wanted[0] > 1e4
    assert_close(np.sort(_core.symmetric_eigenproblem(matrix)[0]), wanted, rtol=1e-13, atol=0.0)


def test_both_copies_of_the_loops_agree() -> None:
    """With AVX2 and without: equal but for rounding."""
    matrix = make_graded(24)
    for one, other in zip(
        _core.symmetric_eigenproblem(matrix, True), _core.symmetric_eigenproblem(matrix, False), strict=True
    ):
        assert_close(one, other, rtol=1e-12, atol=1e-12)
