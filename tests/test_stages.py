"""Every compiled stage against its equation written out in NumPy."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg

import vrte
from tests import exact
from vrte import _core
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.boundary import solve_boundary
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.particular import find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import find_mode_coordinates, reconstruct
from vrte.discrete_ordinates.orders.slabs import cut_layers, join_stack
from vrte.scene.boundary import BLACK

from .helpers import assert_close, close_to
from .literal import slab
from .samples import spheroids

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
    table = spheroids().coefficients
    same = _core.phase_matrices(m, table, to, frm)
    other = _core.phase_matrices(m, table, to, -frm) @ FLIP
    flat = [a.transpose(0, 2, 1, 3).reshape(4 * to.size, 4 * frm.size) for a in (same + other, same - other)]
    return flat[0], flat[1]


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


def test_the_field_obeys_its_equation_and_its_boundaries(problem: Problem, matrices: Assembled, modes: Modes) -> None:
    """s' = -F d + q_s, d' = -E s + q_d by central differences; nothing falls in at the top or at the bottom."""
    run = Run(1)
    order = np.array([0], np.int32)
    first = Assembled(*(getattr(matrices, name)[:1] for name in Assembled.__dataclass_fields__))
    found = find_modes(problem, order, first, run)
    beam = find_beam_field(problem, first, found, run)
    amplitudes = solve_boundary(problem, order, found, beam, expand_base(BLACK, problem, 1), run)

    def field(depth: float) -> tuple[np.ndarray, np.ndarray]:
        y, z = find_mode_coordinates(problem, 0, depth, found, beam, amplitudes)
        return y @ found.X[0, 0], z @ found.Y[0, 0]

    depth, step = 0.8, 1e-4
    (s, d), (s2, d2), (s1, d1) = field(depth), field(depth + step), field(depth - step)
    E, F = first.E[0, 0].T, first.F[0, 0].T
    light = np.exp(-depth / MU0)
    assert_close((s2 - s1) / (2 * step), -d @ F.T + light * first.source_s[0, 0], rtol=0.0, atol=1e-5)
    assert_close((d2 - d1) / (2 * step), -s @ E.T + light * first.source_d[0, 0], rtol=0.0, atol=1e-5)
    (s, d), (s2, d2) = field(0.0), field(THICKNESS)
    assert np.abs(s + d).max() < 1e-13
    assert np.abs(s2 - d2).max() < 1e-13


def test_reconstruction_at_a_node_is_the_nodal_field(problem: Problem) -> None:
    """Source-function integration, plus single scattering, gives back what the modes say on the nodes."""
    scene = vrte.Scene([vrte.Layer(spheroids(), ALBEDO, THICKNESS)])
    field = exact.radiance(scene, MU0, tau=[0.8], phi=np.arange(16) * 22.5, nodes=NODES)
    up = field.stokes[0, :NODES, :, 0].mean(axis=1)
    assert 2 * np.pi * (problem.weights * problem.nodes) @ up == close_to(field.flux_up[0], rtol=1e-12, atol=0.0)
    down = field.stokes[0, NODES:, :, 0].mean(axis=1)
    assert 2 * np.pi * (problem.weights * problem.nodes) @ down == close_to(field.flux_down[0], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize("stage", ["assemble", "homogeneous", "particular", "boundary", "reconstruct"])
def test_stages_do_not_depend_on_threads(problem: Problem, stage: str) -> None:
    def run_all(threads: int) -> dict[str, list[np.ndarray]]:
        run = Run(threads)
        built = assemble(problem, ORDERS, run)
        found = find_modes(problem, ORDERS, built, run)
        beam = find_beam_field(problem, built, found, run)
        base = expand_base(BLACK, problem, 4)
        amplitudes = solve_boundary(problem, ORDERS, found, beam, base, run)
        out = reconstruct(problem, ORDERS, built, found, beam, amplitudes, base, run)
        return {
            "assemble": list(vars(built).values()),
            "homogeneous": list(vars(found).values()),
            "particular": list(vars(beam).values()),
            "boundary": list(vars(amplitudes).values()),
            "reconstruct": [out],
        }

    for one, other in zip(run_all(1)[stage], run_all(2)[stage], strict=True):
        assert np.array_equal(one, other)


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
    pile = cut_layers(replace(problem, level=problem.level[:1], level_layer=problem.level_layer[:1]))
    matrices = assemble(pile.problem, ORDERS, Run(1))
    slabs = double_slabs(pile.problem, pile.material, np.array([thickness]), ORDERS, matrices, Run(1))
    out, n = pile.problem.mu_out, problem.size
    mu = np.concatenate([problem.nodes, out, [MU0]])
    weights = np.concatenate([problem.weights, np.zeros(out.size), [1.0]])
    scale = np.repeat(np.sqrt(problem.weights * problem.nodes), 4)
    rows, beam = slice(n, n + 4 * out.size), slice(n + 4 * out.size, None)
    for o, m in enumerate(ORDERS):
        turn = flux_turn(problem) if m == 0 else np.eye(n)
        literal = slab(int(m), spheroids().coefficients, ALBEDO, thickness, mu, weights, 1)
        plus, minus = kernel(int(m), out, np.array([MU0]))
        once = 0.25 * ALBEDO * np.repeat(1.0 / out, 4)[:, None] * np.array([plus - minus, plus + minus])
        sums, gaps = np.repeat(1.0 / out + 1.0 / MU0, 4), np.repeat(1.0 / out - 1.0 / MU0, 4)
        once[0] *= (-np.expm1(-thickness * sums) / sums)[:, None]
        once[1] *= (np.exp(-thickness / MU0) * -np.expm1(-thickness * gaps) / gaps)[:, None]
        for full, single, values in zip(literal, once, (slabs.R[o, 0], slabs.T[o, 0]), strict=True):
            found = blocks(pile.problem, values)
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
            R, T = (blocks(pile.problem, x[o, 0])["N"] for x in (slabs.R, slabs.T))
            row = np.eye(n)[n - 4] - R[n - 4] - T[n - 4]
            assert_close(slabs.lost[o, 0], row, rtol=0.0, atol=1e-14)


def test_joining(problem: Problem) -> None:
    """Three slabs over a base, joined, against the star product of their R and T on the nodes."""
    scene = vrte.Scene(
        [
            vrte.Layer(spheroids(), ALBEDO, 0.5),
            vrte.Layer(vrte.rayleigh(), 0.7, 0.8),
            vrte.Layer(spheroids(), ALBEDO, 0.5),
        ],
        vrte.Lambertian(0.4),
    )
    levels = np.array([0.0, 0.5, 1.3, 1.8])
    problem = discretise_scene(scene, np.array([MU0]), np.eye(4), np.array([0.7, -0.3]), levels, NODES)
    pile = cut_layers(problem)
    assert (pile.material.size, pile.slabs.tolist(), pile.interface.tolist()) == (2, [0, 1, 0], [0, 1, 2, 3])
    base = expand_base(scene.below, pile.problem, 4)
    run = Run(1)
    slabs = double_slabs(pile.problem, pile.material, pile.thickness, ORDERS, assemble(pile.problem, ORDERS, run), run)
    kernels, up, down, residual = join_stack(pile, ORDERS, slabs, base, run)
    assert kernels.shape == (3, 4, 1, 4, 2, 4)
    assert residual.max() < 1e-12
    # downward light on the base and upward light at the top, order 0: all interreflections as one big linear system
    n, turn = problem.size, flux_turn(problem)
    R, T, source_R, source_T = [], [], [], []
    for place, slab_here in enumerate(pile.slabs):
        r, t = (blocks(pile.problem, x[0, slab_here]) for x in (slabs.R, slabs.T))
        fade = np.exp(-pile.above[place] / MU0)
        R.append(r["N"])
        T.append(t["N"])
        source_R.append(fade * r["NI"])
        source_T.append(fade * t["NI"])
    ground = turn @ base.matrix[0].T @ turn
    beam = np.exp(-1.8 / MU0) * (turn @ base.source[0].T)
    # unknowns: down below each slab, up above each slab; up[3] = ground down[3] + beam
    size = 2 * len(R) * n
    system, right = np.eye(size), np.zeros((size, 4))
    d = lambda k: slice((k - 1) * n, k * n)  # noqa: E731
    u = lambda k: slice((3 + k) * n, (4 + k) * n)  # noqa: E731
    for k in range(3):
        if k > 0:
            system[d(k + 1), d(k)] -= T[k]
            system[u(k), d(k)] -= R[k]
        right[d(k + 1)] += source_T[k]
        right[u(k)] += source_R[k]
        if k < 2:
            system[d(k + 1), u(k + 1)] -= R[k]
            system[u(k), u(k + 1)] -= T[k]
        else:
            system[d(3), d(3)] -= R[2] @ ground
            system[u(2), d(3)] -= T[2] @ ground
            right[d(3)] += R[2] @ beam
            right[u(2)] += T[2] @ beam
    found = np.linalg.solve(system, right)
    size_of_flux = np.sqrt(problem.weights @ problem.nodes)
    for k in range(3):
        assert_close(up[k, 0], -size_of_flux * found[u(k)][n - 4], rtol=0.0, atol=1e-14)
        assert_close(down[k + 1, 0], -size_of_flux * found[d(k + 1)][n - 4], rtol=0.0, atol=1e-14)
