"""Stages of the core by themselves: small eigenproblems and systems of its own, and all of modes in one call.

Whether a stage is right is tested by its light, in tests/test_every_way.py.
"""

from typing import Any

import flint
import numpy as np
import pytest
import scipy.linalg

import vrte
from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.boundary import OPEN
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.fused_modes import STAGES, complain_of_order, solve_by_modes, solve_by_stages
from vrte.discrete_ordinates.orders.modes import Modes
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import make_route
from vrte.discrete_ordinates.orders.single_interface import SingleInterface
from vrte.scene.boundary import BLACK, Boundary

from .helpers import assert_close

HAZE = vrte.Layer(vrte.henyey_greenstein(0.6, 24), 0.95, 0.7)
AIR = vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
CLEAR = vrte.Layer(vrte.isotropic(), 0.0, 0.3)
MIXING = vrte.Layer(vrte.spheres("gold", radius_um=0.1, wavelength_um=0.64).phase_matrix, 0.9, np.inf)
GLOSS = vrte.Interface(1.0, 1.5)


def problem_of(layers: list[Any], grading: int = 1) -> Problem:
    directions = np.array([0.3, 0.8]), np.eye(4), np.array([0.2, 0.9, -0.5]), np.array([0.0, 0.5])
    return discretise_scene(vrte.Scene(layers), *directions, 6, grading=grading)


def route_of(layers: list[vrte.Layer], base: Boundary | None = None) -> Modes:
    return Modes(problem_of(layers), base or BLACK, 4, 1e-8)


@pytest.mark.parametrize(
    ("layers", "base", "grading"),
    [
        ([HAZE, CLEAR, AIR], vrte.Lambertian(0.3), 1),
        ([AIR, HAZE, AIR, CLEAR, HAZE], None, 1),
        ([MIXING], None, 1),
        ([HAZE, AIR], vrte.Lambertian(0.8), 3),
        ([GLOSS, AIR, HAZE, AIR], vrte.Lambertian(0.3), 1),
    ],
)
def test_one_call_finds_what_five_find(layers: list[Any], base: Boundary | None, grading: int) -> None:
    """All stages of modes in one call, and one after another: to the last bit, also of equal layers, on nodes that are
    not Gauss's, and under a surface."""
    problem, orders, alone, together = problem_of(layers, grading), np.arange(4, dtype=np.int32), Run(1), Run(2)
    made = make_route("modes", problem, base or BLACK, 4, 1e-8)
    assert isinstance(made, Modes | SingleInterface)
    under = isinstance(made, SingleInterface)
    given = (made.inside if under else problem, orders, made.base, made.quick), (made.top if under else OPEN,)
    (one, _), (other, _) = solve_by_modes(*given[0], alone, *given[1]), solve_by_stages(*given[0], together, *given[1])
    for name in ("kernels", "flux_up", "flux_down"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name, values in other.residuals.items():
        np.testing.assert_array_equal(one.residuals[name], values)
    assert sorted(alone.stages) == sorted(together.stages) == sorted(STAGES)
    assert all(clock["thread_seconds"] > 0.0 for clock in alone.stages.values())


def test_a_run_that_is_stopped_gives_up_and_what_fails_is_named() -> None:
    run, orders = Run(1), np.array([3, 5], np.int32)
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        route_of([AIR, HAZE]).solve(np.arange(2, dtype=np.int32), run)
    with pytest.raises(AccuracyError, match="eigenproblem of order 5, layer 2 did not converge"):
        complain_of_order(orders, np.array([[0, 0], [1, 1]], np.int32))
    with pytest.raises(AccuracyError, match="boundary system of order 3 is singular"):
        complain_of_order(orders, np.array([[3, 0], [0, 0]], np.int32))


def make_graded(n: int) -> Array:
    """What L^T E L of an order is like: the square of 1/mu on the diagonal, less what is scattered between nodes."""
    mu, weights = make_double_gauss(n)
    scattered = 0.4 * np.cos(np.subtract.outer(mu, mu)) * np.sqrt(np.outer(weights, weights))
    return (np.diag(mu) - scattered * np.sqrt(np.outer(mu, mu))) / np.outer(mu, mu) ** 1.5


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 7, 16, 33, 64, 96])
def test_small_symmetric_eigenproblems(n: int, wide: bool) -> None:
    """With AVX2 and without: vectors are orthonormal and diagonalise, values are LAPACK's."""
    for matrix in (make_graded(n), np.eye(n), np.zeros((n, n)), np.ones((n, n)), 1e-100 * make_graded(n)):
        found = _core.symmetric_eigenproblem(matrix, wide)
        values, vectors = found["values"], found["vectors"]
        assert not found["info"].any()
        largest = np.linalg.norm(matrix, 2)
        assert np.abs(vectors @ vectors.T - np.eye(n)).max() < 1e-14 * np.sqrt(n) + 4e-15
        assert np.abs(vectors @ matrix - values[:, None] * vectors).max() <= 3e-15 * np.sqrt(n) * largest
        assert_close(np.sort(values), np.linalg.eigvalsh(matrix), rtol=0.0, atol=2e-14 * n * largest)


def test_small_eigenvalues_of_a_graded_matrix_keep_their_digits() -> None:
    """Beside 200 bits: what is 1e-6 of the largest is right to 1e-13 of itself; with AVX2 and without alike."""
    matrix = make_graded(16)
    with flint.ctx.workprec(200):
        exact = flint.acb_mat(flint.arb_mat(matrix.tolist())).eig()
    wanted = np.sort([float(value.real.mid()) for value in exact])
    assert wanted[-1] / wanted[0] > 1e4
    for wide in (False, True):
        assert_close(np.sort(_core.symmetric_eigenproblem(matrix, wide)["values"]), wanted, rtol=1e-13, atol=0.0)


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
def test_systems_of_few_rows(n: int, from_right: bool, columns: int, wide: bool) -> None:
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
    found, others = _core.solve_by_factors(factors, pivots, given), np.arange(9) != 4
    assert np.array_equal(found[others], clean[others])
    assert np.isnan(found[4]).any()
