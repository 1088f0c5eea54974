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
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.fused_modes import STAGES, solve_by_modes, solve_by_stages
from vrte.discrete_ordinates.orders.invariance import reflect_semi_infinite
from vrte.discrete_ordinates.orders.modes import Modes
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import make_route
from vrte.discrete_ordinates.orders.single_interface import SingleInterface
from vrte.discrete_ordinates.orders.slab_response import respond, respond_by_modes
from vrte.discrete_ordinates.orders.stages import complain_of_order
from vrte.scene.boundary import BLACK, Boundary

from .helpers import assert_close, close_to

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
        complain_of_order("homogeneous", orders, np.array([1, 1]))
    with pytest.raises(AccuracyError, match="boundary system of order 3 is singular"):
        complain_of_order("boundary", orders, np.array([0]))


def test_a_surface_that_cannot_be_joined_is_named() -> None:
    """On one node: a surface that sends back the inverse of what the layer reflects, to the last bits."""
    layer, node = vrte.Layer(vrte.isotropic(), 0.9, np.inf), np.array([0.5])
    problem = discretise_scene(vrte.Scene([layer]), node, np.ones((1, 4)), node, np.zeros(1), 1)
    problem, order = problem.select_stokes((0,), np.ones((1, 1))), np.zeros(1, np.int32)

    def reflect(top: Top) -> float:
        light = reflect_semi_infinite(problem, order, 1e-14, Run(1), top).on_nodes
        return float(light[0, 0, 0]) * np.sqrt(2.0)  # the beam as light on the node

    def under(back: float) -> Top:
        return Top(order, np.full((1, 1, 1, 1), back), OPEN.sent)

    alone = reflect(OPEN)
    assert reflect(under(0.5)) == close_to(alone / (1.0 - 0.5 * alone), rtol=1e-14, atol=0.0)
    inverses = [under((1.0 + bits * 2.0**-52) / alone) for bits in range(-20, 21)]
    with pytest.raises(AccuracyError, match="boundary system of order 0 is singular"):
        [*map(reflect, inverses)]


@pytest.mark.parametrize("n_col", [1, 4, 6])
def test_light_scattered_once_is_seen_by_products(n_col: int) -> None:
    """Escapes times scattering times power, summed over sources, of which one is dark and one is not seen."""
    draw = np.random.default_rng(n_col).standard_normal
    scattered, power, escapes = draw((2, 3, 5, 4, 4, 4)), draw((4, 3, 4, n_col)), draw((6, 4, 4, 4))
    power[1], escapes[:, :, 2] = 0.0, 0.0
    scatterer_of, sight_of = np.array([0, 1, 1, 0], np.int32), np.array([4, 0, 0, 3, 1, 2], np.int32)
    found = _core.see_scattered(scattered, power, escapes, scatterer_of, sight_of)
    light = scattered[scatterer_of][:, :, sight_of]
    expected = np.einsum("oksa,siofab,sibc->iofkc", escapes, light, power)
    assert_close(found, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


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


def integrate_mode(k: float, mu: float, thickness: float, depth: float, upward: bool, decaying: bool) -> list[float]:
    """What the even and the odd mode, and the beam's part, send to a depth from its far face where g_e or g_f is 1 and
    the other 0, (3, 2): integrals of 200 bits with bounds."""
    rate, cosine, whole, at = (flint.acb(value) for value in (k, mu, thickness, depth))
    begin, end, side = (at, whole, 1) if upward else (flint.acb(0), at, -1)

    def integral(profile: Any) -> Any:
        return flint.acb.integral(lambda x, _: profile(x) * (side * (at - x) / cosine).exp() / cosine, begin, end) / 2

    def over_sinh(x: Any) -> Any:
        t = x - whole / 2
        return t * (flint.acb(0, 1) * rate * t).sinc() / (rate * whole / 2).cosh()

    beam = 1 / (1 + rate * cosine) if upward else 1 / (rate * cosine - 1) if abs(k * mu - 1.0) >= 0.02 else flint.acb(0)
    if decaying:
        top, bottom = integral(lambda x: (-rate * x).exp()), integral(lambda x: (rate * (x - whole)).exp())
        found = [top, -side * rate * top, bottom, side * rate * bottom]
    else:
        even = integral(lambda x: (rate * (x - whole / 2)).cosh() / (rate * whole / 2).cosh())
        odd = integral(over_sinh)
        found = [even, side * rate * rate * odd, odd, side * even]
    return [float(value.real.mid()) for value in (*found, beam, -side * rate * beam)]


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("upward", [False, True])
@pytest.mark.parametrize(
    ("thickness", "decaying"), [(1e-3, False), (0.3, False), (5.0, False), (9.0, True), (80.0, True)]
)
def test_gains_are_the_integrals_they_stand_for(thickness: float, decaying: bool, upward: bool, wide: bool) -> None:
    """With AVX2 and without, at every depth, for modes of every rate, in resonance with a direction and not; sinh takes
    both signs in a layer, and rounding counts from its largest."""
    mu = np.array([0.004, 0.1, 0.37, 0.5, 0.501, 0.77, 1.0])
    for k in (0.5, 1.0, 1.99, 2.0, 3.7, 250.0) if decaying else (0.0, 1e-9, 0.02, 0.9, 1.99, 2.0, 9.7, 250.0):
        for depth in (0.0, 1e-3 * thickness, 0.6 * thickness, thickness):
            if depth == (thickness if upward else 0.0):
                continue  # `reconstruct` copies there
            with flint.ctx.workprec(200):
                wanted = np.array([integrate_mode(k, each, thickness, depth, upward, decaying) for each in mu])
            for which in (0, 1):
                rows = np.array([np.full(mu.size, 1.0 - which), np.full(mu.size, float(which))])
                found = _core.real_gains(k * k, thickness, depth, mu, rows, upward, decaying, wide)
                there, largest = wanted[:, which::2].T, np.abs(wanted[:, :1].T) * max(thickness, k * k * thickness)
                assert (np.abs(found - there) <= 2e-13 * np.abs(there) + 1e-15 * largest + 1e-50).all()


def test_gains_of_a_semi_infinite_layer() -> None:
    """Up from its inside: e^(-k depth)/(1 + k mu); down, the mode from below brings nothing."""
    k, depth, mu = 0.7, 1.3, np.array([0.05, 0.6, 1.0])
    rows = np.array([np.ones(3), np.zeros(3)])
    up = _core.real_gains(k * k, np.inf, depth, mu, rows, True, True)
    assert_close(up, [0.5 * np.exp(-k * depth) / (1.0 + k * mu), 0.0 * mu, 1.0 / (1.0 + k * mu)], rtol=1e-15, atol=0.0)
    down = _core.real_gains(k * k, np.inf, depth, mu, rows, False, True)
    wanted = [0.5 * (np.exp(-k * depth) - np.exp(-depth / mu)) / (1.0 - k * mu), 0.0 * mu, 1.0 / (k * mu - 1.0)]
    assert_close(down, wanted, rtol=1e-14, atol=0.0)


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


@pytest.mark.parametrize("layer", [HAZE, AIR, CLEAR, MIXING], ids=["haze", "air", "clear", "mixing"])
def test_slabs_by_modes_do_what_doubled_ones_do(layer: vrte.Layer) -> None:
    """To light on the nodes, from beams and into directions off the nodes, to the last digits of what thin ones send
    back; one without thickness lets all light through."""
    problem, orders = problem_of([layer]), np.arange(3, dtype=np.int32)
    thickness = np.array([0.0, 1e-12, 1e-3, 0.7, 3.0, 40.0, np.inf])
    given = problem, np.zeros(thickness.size, np.int32), thickness, orders, Run(1)
    by_modes, doubled = respond_by_modes(*given, quick=False).expand(), respond("doubling", *given, quick=False)
    for name in ("nodes", "entering", "leaving", "passing"):
        for found, right, tau in zip(getattr(by_modes, name), getattr(doubled, name), thickness, strict=True):
            assert_close(found, right, rtol=0.0, atol=3e-13 * max(1.0, float(np.abs(right).max())))
            if 0.0 < tau < 0.1:  # reflected light is as little as the slab is thick
                assert_close(found[:, 0], right[:, 0], rtol=0.0, atol=1e-12 * tau)
    assert by_modes.residuals["residual_of_boundary"].max() < 1e-11
    assert np.array_equal(
        by_modes.nodes[0, :, 1], np.broadcast_to(np.eye(problem.size), (3, problem.size, problem.size))
    )


@pytest.mark.parametrize("has_base", [True, False])
def test_a_stack_of_media_is_one_linear_system(has_base: bool) -> None:
    """Random slabs of three sizes, between smooth and rough interfaces and cuts, as the equations of all light at once
    solve them."""
    random, N, S, r, orders = np.random.default_rng(5), 4, 2, 3, 2
    n, sizes, kind = N * S, [4, 8, 8, 6], np.array([1, 1, 0, 2, 1 - has_base], np.int32)
    slabs = [0.3 * random.standard_normal((orders, 2, m, m)) for m in sizes]
    interfaces = [
        None if k == 0 else 0.3 * random.standard_normal((1, 4, n, S) if k == 1 else (orders, 4, n, n))
        for k in kind.tolist()
    ]
    base, row = 0.3 * random.standard_normal((1, 6, 6)), np.array([0, -1] if has_base else [-1, -1], np.int32)
    light = random.standard_normal((orders, kind.size, 4, r, n))
    light[:, kind == 0, 2:] = 0.0
    light[:, -1, 0] = light[:, 0, 1] = 0.0
    for k, m in enumerate(sizes):  # no light goes along nodes that a medium does not have
        light[:, k, 0, :, : n - m] = light[:, k + 1, 1, :, : n - m] = 0.0
    light[:, -1, 2] = random.standard_normal((orders, r, n))
    sources = light.copy()

    def join() -> Any:
        smooth = [part for part, k in zip(interfaces, kind, strict=True) if k == 1]
        rough = [part.swapaxes(-1, -2) for part, k in zip(interfaces, kind, strict=True) if k == 2]
        begins = np.cumsum([0, *(part.size for part in slabs[:-1])])
        with Run(1).timed("joining") as crew:
            return _core.join_media(
                crew,
                pieces=np.concatenate([part.ravel() for part in slabs]),
                slab_size=np.array(sizes, np.int32),
                slab_at=begins.astype(np.int32),
                kind=kind,
                which=np.array([0, 1, 0, 0, 2], np.int32),
                smooth=np.concatenate(smooth),
                rough=np.ascontiguousarray(np.stack(rough)),
                base_row=row,
                base=base,
                stokes=S,
                light=light,
            )

    residual = join()["residual"]
    rising, arriving, leaving, entering = range(4)
    for order in range(orders):
        system = np.eye(kind.size * 4 * n).reshape(kind.size, 4, n, kind.size, 4, n)
        for k, m in enumerate(sizes):
            for way in range(2):
                matrix = np.zeros((n, n))
                matrix[n - m :, n - m :] = slabs[k][order, way].T
                ends = (rising, arriving)[way], (arriving, rising)[way]
                system[k + (ends[0] == arriving), ends[0], :, k, entering] -= matrix
                system[k + (ends[1] == arriving), ends[1], :, k + 1, leaving] -= matrix
        for k, part in enumerate(interfaces):
            open_ = float(part is None and not (has_base and k == len(sizes) and row[order] >= 0))
            ways = [np.zeros((n, n)), np.zeros((n, n)), open_ * np.eye(n), open_ * np.eye(n)]
            if part is not None and kind[k] == 2:
                ways = [each.T for each in part[order]]
            elif part is not None:
                ways = [scipy.linalg.block_diag(*each.reshape(N, S, S)) for each in part[0]]
            if has_base and k == len(sizes) and row[order] >= 0:
                ways[0][n - 6 :, n - 6 :] += base[0].T
            pairs = (leaving, arriving), (entering, rising), (entering, arriving), (leaving, rising)
            for matrix, (to, of) in zip(ways, pairs, strict=True):
                system[k, to, :, k, of] -= matrix
        size = kind.size * 4 * n
        right = np.linalg.solve(system.reshape(size, size), sources[order].transpose(0, 1, 3, 2).reshape(size, r))
        right = right.reshape(kind.size, 4, n, r).transpose(0, 1, 3, 2)
        for k, m in enumerate(sizes):
            for at, ways in ((k, (rising, entering)), (k + 1, (arriving, leaving))):
                found = light[order][at, list(ways), :, n - m :]
                limit = 1e-12 * float(np.abs(right).max())
                assert_close(found, right[at, list(ways), :, n - m :], rtol=0.0, atol=limit)
    assert 0.0 < residual.max() < 1e-13
    slabs[1][:] = 0.0
    slabs[1][:, 0] = np.eye(8)  # light that nothing absorbs between mirrors
    interfaces[1] = np.zeros((1, 4, n, S))
    interfaces[1][0, 1] = np.tile(np.eye(S), (N, 1))
    assert join()["info"].all()
