"""Every compiled stage against its equation written out in NumPy, or LAPACK's answer."""

from dataclasses import replace
from functools import reduce
from itertools import pairwise

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
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.fused_modes import STAGES, complain_of_order
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.invariance import reflect_semi_infinite
from vrte.discrete_ordinates.orders.particular import find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import Modes as RouteOfModes
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.discrete_ordinates.orders.slabs import cut_layers, join_stack
from vrte.scene.boundary import BLACK, Boundary

from .helpers import assert_close
from .literal import a_matrix, slab, star
from .samples import largest_gap, spheroids

NODES, ALBEDO, THICKNESS, MU0 = 6, 0.9, 2.0, 0.45
ORDERS = np.array([0, 1, 3], np.int32)
FLIP = np.diag([1.0, 1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def problem() -> Problem:
    scene = vrte.Scene([vrte.Layer(spheroids(), ALBEDO, THICKNESS)])
    return discretise_scene(
        scene, np.array([MU0]), np.eye(4), np.array([0.7, -0.3]), np.array([0.0, 0.8, THICKNESS]), NODES
    )


@pytest.fixture(scope="module")
def matrices(problem: Problem) -> Assembled:
    return assemble(problem, ORDERS, Run(1))


@pytest.fixture(scope="module")
def modes(problem: Problem, matrices: Assembled) -> Modes:
    return find_modes(problem, ORDERS, matrices, Run(1))


def kernel(m: int, to: np.ndarray, frm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pp + Pm and Pp - Pm, (4 to, 4 from): A(mu, mu') and A(mu, -mu') D."""
    same, other = (a_matrix(m, spheroids().coefficients, to, sign * frm) for sign in (1.0, -1.0))
    other = other @ np.kron(np.eye(frm.size), FLIP)
    return same + other, same - other


def exponents(modes: Modes, o: int) -> np.ndarray:
    """lambda as a real block-diagonal matrix in the coordinates of the modes."""
    blocks, j = [], 0
    re, im = modes.lam_re[o, 0], modes.lam_im[o, 0]
    while j < re.size:
        if im[j] == 0.0:
            blocks.append(np.array([[re[j]]]))
        else:
            blocks.append(np.array([[re[j], im[j]], [-im[j], re[j]]]))
        j += len(blocks[-1])
    return scipy.linalg.block_diag(*blocks)


def test_assembly(problem: Problem, matrices: Assembled) -> None:
    mu, weights, out = problem.nodes, problem.weights, problem.mu_out
    scale, mu4 = np.repeat(np.sqrt(weights * mu), 4), np.repeat(mu, 4)
    for o, m in enumerate(ORDERS):
        for sign, stored, led, source in (
            (0, matrices.E, matrices.G_E, matrices.source_d),
            (1, matrices.F, matrices.G_F, matrices.source_s),
        ):
            plain = (np.eye(4 * NODES) - ALBEDO / 2 * kernel(m, mu, mu)[sign] * np.repeat(weights, 4)) / mu4[:, None]
            assert_close(stored[o, 0].T, plain * scale[:, None] / scale, rtol=0.0, atol=1e-12)
            rows = ALBEDO / 2 * kernel(m, out, mu)[sign] * np.repeat(weights, 4) / scale
            assert_close(led[o, 0].T, rows, rtol=0.0, atol=1e-13)
            beam = ALBEDO / 2 * kernel(m, mu, np.array([MU0]))[sign] * (scale / mu4)[:, None]
            assert_close(source[o, 0].T, beam, rtol=0.0, atol=1e-13)


def test_modes_solve_the_halved_eigenproblem(matrices: Assembled, modes: Modes) -> None:
    complex_pairs = 0
    for o in range(ORDERS.size):
        E, F, X, Y = (stored[o, 0].T for stored in (matrices.E, matrices.F, modes.X, modes.Y))
        lam = exponents(modes, o)
        assert_close(F @ E @ X, X @ lam, rtol=0.0, atol=1e-11 * np.abs(lam).max())
        assert_close(F @ Y, X, rtol=0.0, atol=1e-12)
        assert_close(E @ X, Y @ lam, rtol=0.0, atol=1e-11 * np.abs(lam).max())
        complex_pairs += int(np.count_nonzero(modes.lam_im[o]))
    assert complex_pairs > 0


def flux_turn(problem: Problem) -> np.ndarray:
    """The reflection that turns sqrt(weight mu) on I to the axis of the flux, I of the last node."""
    v = np.zeros(problem.size)
    v[::4] = np.sqrt(problem.weights * problem.nodes)
    v[-4] += np.linalg.norm(v)
    return np.eye(problem.size) - 2.0 * np.outer(v, v) / (v @ v)


def blocks(problem: Problem, values: np.ndarray) -> dict[str, np.ndarray]:
    """N, NI, ON, OI as matrices, OO and II as numbers, from what `double_slabs` leaves."""
    n, r, o = problem.size, problem.n_rhs, 4 * problem.mu_out.size
    shapes = {"N": (n, n), "NI": (r, n), "ON": (n, o), "OI": (r, o), "OO": (o,), "II": (r,)}
    edges = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes.values())])
    parts = (values[a:b] for a, b in pairwise(edges))
    return {name: part.reshape(shape).T for (name, shape), part in zip(shapes.items(), parts, strict=True)}


@pytest.mark.parametrize("thickness", [1e-8, 0.3, 5.0])
def test_doubling(problem: Problem, thickness: float) -> None:
    """R and T on the nodes and off them, against a matrix exponential and plain doublings of R and T."""
    stack = cut_layers(replace(problem, level=problem.level[:1], level_layer=problem.level_layer[:1]))
    matrices = assemble(stack.problem, ORDERS, Run(1))
    slabs = double_slabs(stack.problem, stack.material, np.array([thickness]), ORDERS, matrices, Run(1))
    out, n = stack.problem.mu_out, problem.size
    mu = np.concatenate([problem.nodes, out, [MU0]])
    weights = np.concatenate([problem.weights, np.zeros(out.size), [1.0]])
    scale = np.repeat(np.sqrt(problem.weights * problem.nodes), 4)
    rows, beam = slice(n, n + 4 * out.size), slice(n + 4 * out.size, None)
    for o, m in enumerate(ORDERS):
        turn = flux_turn(problem) if m == 0 else np.eye(n)
        literal = slab(int(m), spheroids().coefficients, ALBEDO, thickness, mu, weights, 1)
        plus, minus = kernel(int(m), out, np.array([MU0]))
        once = 0.25 * ALBEDO * np.repeat(1.0 / out, 4)[:, None] * np.array([plus - minus, plus + minus])
        sums, differences = np.repeat(1.0 / out + 1.0 / MU0, 4), np.repeat(1.0 / out - 1.0 / MU0, 4)
        once[0] *= (-np.expm1(-thickness * sums) / sums)[:, None]
        once[1] *= (np.exp(-thickness / MU0) * -np.expm1(-thickness * differences) / differences)[:, None]
        for full, single, values in zip(literal, once, (slabs.R[o, 0], slabs.T[o, 0]), strict=True):
            found = blocks(stack.problem, values)
            # 2.5e-13 at most: what some twenty doublings leave of digits
            expected = turn @ (scale[:, None] * full[:n, :n] / scale) @ turn
            assert_close(found["N"], expected, rtol=0.0, atol=4e-13 * np.abs(expected).max())
            expected = turn @ (scale[:, None] * full[:n, beam])
            assert_close(found["NI"], expected, rtol=0.0, atol=4e-13 * np.abs(expected).max())
            expected = (full[rows, :n] / scale) @ turn
            assert_close(found["ON"], expected, rtol=0.0, atol=4e-13 * np.abs(expected).max())
            size = max(np.abs(full[rows, beam]).max(), np.abs(single).max())  # of what is subtracted
            assert_close(found["OI"], full[rows, beam] - single, rtol=0.0, atol=1e-13 * size)
        assert_close(found["OO"], np.exp(-thickness * np.repeat(1.0 / out, 4)), rtol=1e-14, atol=0.0)
        assert slabs.residual[o].max() < 1e-12
        if m == 0:
            R, T = (blocks(stack.problem, x[o, 0])["N"] for x in (slabs.R, slabs.T))
            row = np.eye(n)[n - 4] - R[n - 4] - T[n - 4]
            assert_close(slabs.lost[o, 0], row, rtol=0.0, atol=1e-14)


def test_joining(problem: Problem) -> None:
    """Fluxes between three slabs over a base, against the star products of what lies above and below."""
    layers = [(spheroids(), ALBEDO, 0.5), (vrte.rayleigh(), 0.7, 0.8), (spheroids(), ALBEDO, 0.5)]
    scene = vrte.Scene([vrte.Layer(*layer) for layer in layers], vrte.Lambertian(0.4))
    levels = np.array([0.0, 0.5, 1.3, 1.8])
    problem = discretise_scene(scene, np.array([MU0]), np.eye(4), np.array([0.7, -0.3]), levels, NODES)
    stack = cut_layers(problem)
    assert (stack.material.size, stack.slabs.tolist(), stack.interface.tolist()) == (2, [0, 1, 0], [0, 1, 2, 3])
    base, run = expand_base(scene.below, stack.problem, 4), Run(1)
    slabs = double_slabs(
        stack.problem, stack.material, stack.thickness, ORDERS, assemble(stack.problem, ORDERS, run), run
    )
    kernels, up, down, residual = join_stack(stack, ORDERS, slabs, base, run)
    assert kernels.shape == (3, 4, 1, 4, 2, 4)
    assert residual.max() < 1e-12
    mu, weights, n = np.append(problem.nodes, MU0), np.append(problem.weights, 1.0), problem.size
    zero, one = np.zeros((n + 4, n + 4)), np.eye(n + 4)
    ground, flux = zero.copy(), problem.weights * problem.nodes
    ground[:n:4, ::4] = 2.0 * 0.4 * mu * weights
    parts = [2 * slab(0, phase.coefficients, albedo, depth, mu, weights, 1) for phase, albedo, depth in layers]
    for k in range(4):
        _, T, back, _ = reduce(star, parts[:k], (zero, one, zero, one))
        R = reduce(star, [*parts[k:], (ground, zero, zero, zero)])[0]
        falling = np.linalg.solve(one - back @ R, T)[:, n:]
        assert_close(down[k, 0], flux @ falling[:n:4], rtol=0.0, atol=1e-14)
        assert_close(up[k, 0], flux @ (R @ falling)[:n:4], rtol=0.0, atol=1e-14)


def test_invariance() -> None:
    """D R + R D = ((1 + R) e (1 + R) - (1 - R) f (1 - R))/2, R from the field on the nodes for beams along them."""
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.9, np.inf)])
    nodes, orders = make_double_gauss(8)[0], np.array([1], np.int32)
    problem = discretise_scene(scene, nodes, np.eye(4), nodes, np.zeros(1), 8)
    found, matrices = reflect_semi_infinite(problem, orders, 1e-14, Run(1)), assemble(problem, orders, Run(1))
    # the source of a unit beam is sqrt(weight/mu) times less than that of a scaled node
    R = found.on_nodes[0].T * np.repeat(np.sqrt(problem.weights / problem.nodes), 4)
    rate, one = np.diag(np.repeat(1.0 / nodes, 4)), np.eye(R.shape[0])
    e, f = rate - matrices.E[0, 0].T, rate - matrices.F[0, 0].T
    right = ((one + R) @ e @ (one + R) - (one - R) @ f @ (one - R)) / 2.0
    assert largest_gap(rate @ R + R @ rate, right) < 1e-12


HAZE = vrte.Layer(vrte.henyey_greenstein(0.6, 24), 0.95, 0.7)
AIR = vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
CLEAR = vrte.Layer(vrte.isotropic(), 0.0, 0.3)
MIXING = vrte.Layer(vrte.spheres("gold", radius_um=0.1, wavelength_um=0.64).phase_matrix, 0.9, np.inf)


def route_of(layers: list[vrte.Layer], base: Boundary | None = None) -> RouteOfModes:
    directions = np.array([0.3, 0.8]), np.eye(4), np.array([0.2, 0.9, -0.5]), np.array([0.0, 0.5])
    return RouteOfModes(discretise_scene(vrte.Scene(layers, base), *directions, 6), base or BLACK, 4, 1e-8)


@pytest.mark.parametrize(
    ("layers", "base"), [([HAZE, CLEAR, AIR], vrte.Lambertian(0.3)), ([AIR, HAZE], None), ([MIXING], None)]
)
def test_one_call_finds_what_five_find(layers: list[vrte.Layer], base: Boundary | None) -> None:
    """All stages of modes in one call, as one thread takes them, and one after another, as two do: to the last bit."""
    route, orders, alone, together = route_of(layers, base), np.arange(4, dtype=np.int32), Run(1), Run(2)
    one, other = route.solve(orders, alone), route.solve(orders, together)
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


@pytest.mark.parametrize("nodes", [4, 16])
def test_symmetric_modes_invert_themselves(nodes: int) -> None:
    """X^-1 = Y^T: the beam's solution is that of the general modes, to what the eigensolver is good for. Rayleigh
    scattering keeps I, Q and U together."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.2))
    whole = discretise_scene(scene, np.array([0.6]), np.eye(4)[:1], np.array([0.5]), np.zeros(1), nodes)
    problem = replace(whole, stokes=(0, 1, 2), columns=np.eye(4)[:1, :3].copy())
    orders, run = np.arange(3, dtype=np.int32), Run(1)
    matrices = assemble(problem, orders, run)
    quick, general = (find_modes(problem, orders, matrices, run, quick) for quick in (True, False))
    paired = quick.X_pivots[..., 0] == -1
    assert (paired.ravel() == [False, True, True]).all()  # order 0 conserves the flux: its modes are polished
    identity = np.einsum("olji,olki->oljk", quick.Y, quick.X)[1:]
    assert_close(identity, np.broadcast_to(np.eye(problem.size), identity.shape), rtol=0.0, atol=1e-11)
    fields = []
    for modes in (quick, general):
        beam = find_beam_field(problem, matrices, modes, run)
        # each c alone depends on how k stands to 1/mu0, but c X summed over the modes does not depend on their scale
        fields.append(np.stack([np.einsum("olrj,olji->olri", c, modes.X) for c in (beam.c, beam.zeta)]))
    assert_close(fields[0], fields[1], rtol=0.0, atol=1e-10 * np.abs(fields[1]).max())


def test_path_integrals_by_quadrature() -> None:
    layers = [vrte.Layer(vrte.isotropic(), 0.9, thickness) for thickness in (0.3, 1.2, 0.5)]
    mu, mu0, tau = np.array([0.3, -0.7, -0.4]), np.array([0.4, 0.8]), np.array([0.0, 0.9, 1.5, 2.0])
    problem = discretise_scene(vrte.Scene(layers), mu0, np.eye(4)[:1], mu, tau, 4)
    found = integrate_paths(problem, np.arange(4, dtype=np.int32), mu)
    x, weights = np.polynomial.legendre.leggauss(60)
    for k, (top, thickness) in enumerate(zip(problem.above, problem.thickness, strict=True)):
        for t, depth in enumerate(tau):
            for j, direction in enumerate(mu):
                low, high = (max(top, depth), top + thickness) if direction > 0 else (top, min(top + thickness, depth))
                index = 0.5 * (low + high) + 0.5 * max(high - low, 0.0) * x
                light = np.exp(-index / mu0[:, None] - np.abs(index - depth) / abs(direction)) / abs(direction)
                expected = 0.5 * max(high - low, 0.0) * light @ weights
                assert_close(found[k, t, :, j], expected, rtol=1e-12, atol=1e-15)


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
        values, vectors = _core.symmetric_eigenproblem(matrix, wide)
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
        assert_close(np.sort(_core.symmetric_eigenproblem(matrix, wide)[0]), wanted, rtol=1e-13, atol=0.0)


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
