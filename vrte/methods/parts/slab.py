"""What layers scatter on nodes, and reflection R and transmission T of homogeneous slabs: a thin start, doubling,
growth by the matrix Riccati equation, semi-infinite layers by its algebraic form; slabs joined by adding.

Light is a column of Stokes vectors along positive cosines, upward light in the flipped frame D I(-mu). Rows are the
nodes, then the outgoing directions; columns are the nodes, then the beams. Beams scatter into the nodes alone, and T is
diffuse, without exp(-tau/mu): light scattered once is added in closed form over all orders. A slab does the same to
light from above and from below.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.differences import divide_exp_once
from vrte.basics.errors import AccuracyError
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import Panel, RefractedNodes, find_gauss_legendre
from vrte.basics.running import Run, keep_to_one_thread
from vrte.discrete_ordinates.orders.base import DEFAULT_ACCURACY
from vrte.discrete_ordinates.orders.media import Media
from vrte.discrete_ordinates.orders.phase_assembly import find_even_shifts
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.refracting import Refracting, Responder
from vrte.discrete_ordinates.orders.slab_response import Response
from vrte.methods.parts.method import Answer, Fluxes, Task
from vrte.request.request import Request
from vrte.scene.beams import locate_depths

LARGEST_RESIDUAL = 1e-6  # of the systems that join slabs in one medium: conservative ones of tau 1e8 leave 3e-9
STEEP = 8.0  # optical path beyond which recurrence over powers of depth is stable up to MOST_POINTS
MOST_POINTS = 8  # most depths of a polynomial
EXACT_POINTS = 28  # Gauss points that integrate exp(-8 x) times such a polynomial to rounding
STEP_POINTS = 5  # Gauss depths of a step of invariant imbedding
MARGIN = 10.0  # estimated error of a step over what its highest resolved power of depth suggests
NO_LIGHT = 1e-290
MOST_SWEEPS, MOST_STEPS = 20, 20_000
LEAST_STEP = 1e-14  # of the layer's optical thickness
SAFETY, GROWTH, SHRINKING = 0.8, 4.0, 0.2  # of the next step: share of the estimate, most and least of the last step
CONVERGED = 1e-15  # last change of the reflection of a semi-infinite layer, over its largest entry
MOST_SDA_DOUBLINGS = 60


def connect_media(request: Request, problem: Problem) -> Problem:
    """A request's problem with nodes that Snell's law links through its media; for I alone where it suffices."""
    scene = request.scene
    if problem.media is not None:
        return problem
    index, nodes = scene.media[0], problem.nodes
    panel = 0, nodes.size, Panel(0.0, index, np.inf, problem.grading)
    shared = RefractedNodes(
        np.full(nodes.size, index), (index * nodes) ** 2, index**2 * nodes * problem.weights, (panel,)
    )
    under = np.zeros(request.tau.size, bool) if request.under is None else request.under
    stokes = (0,) if problem.is_scalar and not scene.below.mixes_stokes else ALL
    columns = np.ascontiguousarray(problem.columns[:, list(stokes)])
    return replace(
        problem, media=Media(scene, shared, locate_depths(scene, request.tau, under)), stokes=stokes, columns=columns
    )


def count_sizes(request: Request, problem: Problem) -> tuple[float, float, float]:
    """Unknowns of a hemisphere, rows with the outgoing directions, columns with the beams, for predictions."""
    problem = connect_media(request, problem)
    stokes, n = len(problem.stokes), problem.size
    return float(n), float(n + stokes * np.unique(problem.mu_out).size), float(n + stokes * problem.mu0.size)


class Scattered(NamedTuple):
    """What a layer scatters per optical depth, forwards and backwards, each (r, c): (omega/2) A W/mu of the row."""

    ahead: Array
    back: Array


@record
class OnNodes:
    """A problem seen as rows and columns; its columns (n_col, S) are incident Stokes vectors."""

    problem: Problem

    @property
    def n(self) -> int:
        """Unknowns of a hemisphere, S N."""
        return self.problem.size

    @cached_property
    def rows(self) -> Array:
        """Cosines of the rows, (r,)."""
        return np.repeat(np.concatenate([self.problem.nodes, self.problem.mu_out]), len(self.problem.stokes))

    @cached_property
    def columns(self) -> Array:
        """Cosines of the columns, (c,)."""
        nodes = np.repeat(self.problem.nodes, len(self.problem.stokes))
        return np.concatenate([nodes, np.repeat(self.problem.mu0, self.problem.columns.shape[0])])

    def scatter(self, order: int, layer: int) -> Scattered:
        """What a layer scatters, (1:18)-(1:23)."""
        problem = self.problem
        table = problem.coefficients[layer, : problem.terms[layer]]
        rows, into = (np.concatenate([problem.nodes, more]) for more in (problem.mu_out, problem.mu0))
        strength = 0.5 * problem.albedo[layer] / rows[:, None, None, None]
        shifts = find_even_shifts(problem, int(problem.terms.max()))
        back, ahead = scatter_once(order, table, rows, into, shifts) * strength
        return Scattered(self.put_in_weights(ahead), self.put_in_weights(back))

    def put_in_weights(self, matrices: Array) -> Array:
        """(r, c) from Mueller matrices (row, node or beam, 4, 4): weights of nodes, Stokes vectors of beams."""
        problem, n_node, members = self.problem, self.problem.nodes.size, list(self.problem.stokes)
        matrices = matrices[..., members, :][..., members]
        on_nodes = matrices[:, :n_node] * problem.weights[:, None, None]
        beams = np.einsum("riab,cb->raic", matrices[:, n_node:], problem.columns)
        beams[n_node:] = 0.0
        left = on_nodes.transpose(0, 2, 1, 3).reshape(self.rows.size, self.n)
        return np.concatenate([left, beams.reshape(self.rows.size, -1)], axis=1)


def scatter_once(order: int, coefficients: Array, mu_out: Array, mu_in: Array, shifts: Array) -> Array:
    """A^m into light going up (flipped) and down from light going down, (2, n_out, n_in, 4, 4), times 1; ``shifts``
    (term, 2): what order 0's functions of even degree are multiplied with and lessened by, see `find_even_shifts`."""
    terms = coefficients.shape[0]
    if order >= terms:
        return np.zeros((2, mu_out.size, mu_in.size, 4, 4))
    functions = [
        _core.generalized_spherical_functions(order, terms, cosines)[order:] for cosines in (-mu_out, mu_out, mu_in)
    ]
    up, down, into = (_core.legendre_matrices(table) for table in functions)
    if order == 0:
        for matrices in (up, down, into):  # I alone: V has the same functions, and no flux
            matrices[:, :, 0, 0] = shifts[:terms, :1] * matrices[:, :, 0, 0] - shifts[:terms, 1:]
    a1, a2, a3, a4, b1, b2 = coefficients[order:].T
    middle = np.zeros((terms - order, 4, 4))
    middle[:, 0, 0], middle[:, 1, 1], middle[:, 2, 2], middle[:, 3, 3] = a1, a2, a3, a4
    middle[:, 0, 1] = middle[:, 1, 0] = -b1
    middle[:, 2, 3], middle[:, 3, 2] = -b2, b2
    right = into.transpose(0, 2, 1, 3).reshape(-1, 4 * mu_in.size)
    found = np.empty((2, mu_out.size, mu_in.size, 4, 4))
    for way, left in enumerate((up, down)):
        rows = np.matmul(left, middle[:, None]).transpose(1, 2, 0, 3).reshape(4 * mu_out.size, -1)
        found[way] = (rows @ right).reshape(mu_out.size, 4, mu_in.size, 4).transpose(0, 2, 1, 3)
    found[0] *= FLIP[:, None]
    return found


@lru_cache(maxsize=16)
def find_gauss_depths(points: int) -> Any:
    """Gauss points of (0, 1), ascending, (points,)."""
    return 0.5 * (find_gauss_legendre(points)[0] + 1.0)


@lru_cache(maxsize=16)
def compute_lagrange_coefficients(points: int) -> Array:
    """Coefficients of the Lagrange polynomials through the Gauss points, (power, point)."""
    return np.linalg.inv(np.vander(find_gauss_depths(points), increasing=True))


def integrate_decaying_powers(z: Array, x: float, points: int) -> Array:
    """The integral of s^p exp(-z (x - s)) ds from 0 to x, (power, *z.shape)."""
    nodes, weights = find_gauss_legendre(EXACT_POINTS)
    s = 0.5 * x * (nodes + 1.0)
    steep = z * x > STEEP
    mild = np.where(steep, 0.0, z)
    decay = np.exp(-mild[..., None] * (x - s)) * (0.5 * x * weights)
    result = np.moveaxis(decay @ np.vander(s, points, increasing=True), -1, 0)
    rate = np.where(steep, z, 1.0)
    below = -np.expm1(-rate * x) / rate
    for power in range(points):
        if power:
            below = (x**power - power * below) / rate
        result[power] = np.where(steep, below, result[power])
    return result


def weigh_downward(z: Array, points: int) -> Array:
    """Weights (points + 1, points, *z.shape) of the source at the Gauss points of (0, 1) for the integral of
    exp(-z (x - s)) S(s) ds from 0 to x: x at each of them, then 1.

    >>> np.round(weigh_downward(np.array(0.0), 1), 3).tolist()
    [[0.5], [1.0]]
    """
    ends, lagrange = (*find_gauss_depths(points).tolist(), 1.0), compute_lagrange_coefficients(points)
    powers = [integrate_decaying_powers(z, x, points) for x in ends]
    return np.stack([np.einsum("p...,pj->j...", each, lagrange) for each in powers])


def weigh_upward(z: Array, points: int) -> Array:
    """The same for exp(-z (s - x)) S(s) ds from x to 1; the last x is 0."""
    mirrored = weigh_downward(z, points)[:, ::-1]
    return np.concatenate([mirrored[:-1][::-1], mirrored[-1:]])


@record
class Slab:
    """Diffuse reflection R and transmission T (r, c) of a slab of optical thickness tau."""

    on_nodes: OnNodes
    tau: float
    R: Array
    T: Array

    def double(self) -> "Slab":
        """Two such slabs, one on the other, (2:8)."""
        n, R, T = self.on_nodes.n, self.R, self.T
        falls, rises = np.exp(-self.tau / self.on_nodes.columns), np.exp(-self.tau / self.on_nodes.rows)[:, None]
        # light between the slabs, lit from above: up along the nodes, down, up
        up = np.linalg.solve(np.eye(n) - R[:n, :n] @ R[:n, :n], R[:n] * falls + R[:n, :n] @ T[:n])
        down = T + R[:, :n] @ up
        up = R * falls + R[:, :n] @ down[:n]
        reflected = R + rises * up + T[:, :n] @ up[:n]
        return Slab(self.on_nodes, 2.0 * self.tau, reflected, rises * down + T * falls + T[:, :n] @ down[:n])

    def respond(self) -> tuple[Array, Array, Array, Array]:
        """The slab as `Response` has it: on the nodes scaled by sqrt(weight mu), unscattered light included."""
        problem, n = self.on_nodes.problem, self.on_nodes.n
        scale = np.repeat(np.sqrt(problem.weights * problem.nodes), len(problem.stokes))
        both = np.array([self.R, self.T])[None]
        both[0, 1, np.arange(n), np.arange(n)] += np.exp(-self.tau / self.on_nodes.columns[:n])
        both[..., :n, :] *= scale[:, None]
        both[..., :n] /= scale
        onto, off = both[..., :n, :], both[..., n:, :]
        return onto[..., :n], onto[..., n:], off[..., :n], off[..., n:]


# R and T of a slab: nodes, what it scatters, its optical thickness, whether it conserves the flux of order 0
Builder = Callable[[OnNodes, Scattered, float, bool], Slab]


def solve_by_slabs(task: Task, build: Builder, stage: str) -> Answer:
    """The answer from slabs that ``build`` makes, their time timed under the name of a stage."""

    def respond(problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run) -> Response:
        on_nodes, order = OnNodes(problem), int(orders[0])
        with run.timed(stage):
            scattered = [on_nodes.scatter(order, kind) for kind in range(problem.albedo.size)]
            slabs = [
                build(on_nodes, scattered[kind], tau, order == 0 and problem.albedo[kind] == 1.0).respond()
                for kind, tau in zip(material.tolist(), thickness.tolist(), strict=True)
            ]
            nodes, entering, leaving, passing = map(np.stack, zip(*slabs, strict=True))
            return Response(nodes, entering, leaving, passing)

    return task.answer_on_nodes(*join_slabs(task, respond))


def join_slabs(task: Task, respond: Responder) -> tuple[Array, Fluxes]:
    """Kernels of all orders and fluxes of order 0 of slabs, added as in (2:8). Raises AccuracyError by residuals."""
    problem, run = connect_media(task.request, task.problem), task.run
    route = Refracting(respond, problem, task.request.scene.below, problem.coefficients.shape[1], DEFAULT_ACCURACY)
    if task.problem.media is None:
        route.allowed["residual_of_adding"] = LARGEST_RESIDUAL

    fluxes: list[Fluxes] = []

    def solve(order: int) -> Array:
        with keep_to_one_thread():
            found = route.solve(np.array([order], np.int32), run)
        for name, residual in found.residuals.items():
            if not residual[0] <= route.allowed[name]:
                words = f"at order {order} the {name.replace('_', ' ')} is {residual[0]:.1e}"
                raise AccuracyError(f"method {task.request.method!r}: {words}: ask for 'discrete-ordinates'")
        fluxes.append((found.flux_up, found.flux_down))
        return found.kernels[0]

    return task.solve_orders(problem, solve), fluxes[0]


def make_thin_slab(on_nodes: OnNodes, scattered: Scattered, tau: float, points: int) -> Slab:
    """R and T of a thin layer to order tau^(2 points); points 0: single scattering alone, (2:24)-(2:26)."""
    z, beam = tau / on_nodes.rows[:, None], tau / on_nodes.columns
    R, T = scattered.back * tau * integrate_once_back(z, beam), scattered.ahead * tau * integrate_once_ahead(z, beam)
    if points:
        more_R, more_T = scatter_again(on_nodes, scattered, tau, points)
        R, T = R + more_R, T + more_T
    return Slab(on_nodes, tau, R, T)


def integrate_once_back(z: Array, beam: Array) -> Array:
    """The integral of exp(-(z + beam) s) ds over (0, 1)."""
    way = np.maximum(z + beam, 1e-300)  # 0 where the thickness is the smallest number that there is
    return -np.expm1(-way) / way


def integrate_once_ahead(z: Array, beam: Array) -> Array:
    """The integral of exp(-z (1 - s) - beam s) ds over (0, 1)."""
    return divide_exp_once(-z + 0.0 * beam, -beam + 0.0 * z)


def scatter_again(on_nodes: OnNodes, scattered: Scattered, tau: float, points: int) -> tuple[Array, Array]:
    """R and T of all scatterings but the first, each (r, c)."""
    n = on_nodes.n
    z, beam = tau / on_nodes.rows[:n, None], tau / on_nodes.columns
    ahead, back = scattered.ahead[:n] * tau, scattered.back[:n] * tau
    x = find_gauss_depths(points)[:, None, None]
    # light scattered once, down and up at the Gauss depths, (2, point, n, c)
    once = np.stack(
        [
            ahead * x * integrate_once_ahead(x * z, x * beam),
            back * (1.0 - x) * integrate_once_back((1.0 - x) * z, (1.0 - x) * beam) * np.exp(-x * beam),
        ]
    )
    falls, rises = weigh_downward(z[:, 0], points)[:-1], weigh_upward(z[:, 0], points)[:-1]
    blocks = [
        [np.einsum("kji,il->kijl", way, matrix[:, :n]) for matrix in pair]
        for way, pair in ((falls, (ahead, back)), (rises, (back, ahead)))
    ]
    size = points * n
    system = np.eye(2 * size) - np.block([[block.reshape(size, size) for block in row] for row in blocks])
    down, up = np.linalg.solve(system, once.reshape(2 * size, -1)).reshape(once.shape)
    ahead, back = scattered.ahead[:, :n], scattered.back[:, :n]
    lengths = tau / on_nodes.rows
    R = tau * np.einsum("jr,jrc->rc", weigh_upward(lengths, points)[-1], ahead @ up + back @ down)
    T = tau * np.einsum("jr,jrc->rc", weigh_downward(lengths, points)[-1], ahead @ down + back @ up)
    return R, T


def grow_slab(on_nodes: OnNodes, scattered: Scattered, tau: float, rtol: float, count: dict[str, int]) -> Slab:
    """R and T by the matrix Riccati equation of invariant imbedding, thin layers added on top, from nothing on:

    dR/dz = b + a R + R a + R b R - R/mu - R/mu',  dT/dz = E (a + b R) + T (a + b R) - T/mu',  E = exp(-z/mu).

    Decays are taken exactly, and what is left is a polynomial through Gauss points of a step, found by sweeps: no step
    is bound by the lowest cosine. Raises AccuracyError where steps get too small or too many.
    """
    both = np.zeros((2, on_nodes.rows.size, on_nodes.columns.size))  # R and T
    done, taken = 0.0, 0
    scatters = scattered.ahead.any() or scattered.back.any()
    step = 0.5 * float(min(on_nodes.rows.min(), on_nodes.columns.min())) if scatters else tau
    while done < tau:
        step = min(step, tau - done)
        found, error = take_step(on_nodes, scattered, done, step, both, rtol, count)
        taken += 1
        if error <= 1.0:
            both, done = found, tau if tau - done <= step else done + step
            count["steps"] += 1
        else:
            count["steps_repeated"] += 1
        factor = SAFETY * max(error, 1e-20) ** (-0.5 / STEP_POINTS)
        step *= min(GROWTH, max(SHRINKING, factor))
        if step < LEAST_STEP * tau or taken > MOST_STEPS:
            raise AccuracyError(f"invariant imbedding is at its smallest or last step and not at rtol {rtol:g}")
    return Slab(on_nodes, tau, *both)


def take_step(
    on_nodes: OnNodes, scattered: Scattered, done: float, step: float, both: Array, rtol: float, count: dict[str, int]
) -> tuple[Array, float]:
    """R and T after a step, (2, r, c), and error over tolerance; infinite where sweeps do not converge."""
    ways, decays = compute_step_weights(on_nodes, step)
    unscattered = np.exp(-(done + step * find_gauss_depths(STEP_POINTS)[:, None]) / on_nodes.rows)
    start = both[:, None] * decays  # (R or T, point + 1, r, c)
    allowed = np.maximum(rtol * np.abs(both).max(axis=(1, 2)), NO_LIGHT)  # (R or T,)
    now = np.repeat(both[:, None], STEP_POINTS, axis=1)
    change = np.inf
    for _ in range(MOST_SWEEPS):
        count["sweeps"] += 1
        sources = compute_growth(scattered, now, unscattered, on_nodes.n)
        found = start[:, :-1] + np.einsum("tkjrc,tjrc->tkrc", ways[:, :-1], sources)
        before, change = change, float(np.abs(found - now).max())
        now = found
        allowed = np.maximum(allowed, rtol * np.abs(now).max(axis=(1, 2, 3)))
        if change <= 0.01 * allowed.min() or change >= 2.0 * before:
            break
    sources = compute_growth(scattered, now, unscattered, on_nodes.n)
    end = start[:, -1] + np.einsum("tjrc,tjrc->trc", ways[:, -1], sources)
    if change > 0.01 * allowed.min():
        return end, np.inf
    # Gauss points integrate twice as many powers as they resolve: the error is about the square of what the highest
    # resolved power adds
    last = np.einsum("tjrc,jk,tkrc->trc", ways[:, -1], project_highest_degree(STEP_POINTS), sources)
    relative = rtol * np.abs(last).max(axis=(1, 2)) / allowed
    return end, float(MARGIN / rtol * relative.max() ** 2)


def compute_growth(scattered: Scattered, both: Array, unscattered: Array, n: int) -> Array:
    """What makes R and T grow besides their own decay, (R or T, point, r, c)."""
    ahead, back = scattered
    R, T = both
    down = ahead[:n] + back[:n, :n] @ R[:, :n]
    return np.stack(
        [
            back + ahead[:, :n] @ R[:, :n] + R[..., :n] @ down,
            unscattered[..., None] * (ahead + back[:, :n] @ R[:, :n]) + T[..., :n] @ down,
        ]
    )


def compute_step_weights(on_nodes: OnNodes, step: float) -> tuple[Array, Array]:
    """Weights of sources (2, point + 1, point, r, c), and decays (2, point + 1, r, c), at points and the end."""
    cosines, at = np.unique(np.concatenate([on_nodes.rows, on_nodes.columns]), return_inverse=True)
    rows, columns = at[: on_nodes.rows.size, None], at[on_nodes.rows.size :]
    once = step / cosines
    rates = np.stack([once[:, None] + once, np.broadcast_to(once, (once.size, once.size))])
    weights = step * np.moveaxis(weigh_downward(rates, STEP_POINTS), 2, 0)
    x = np.append(find_gauss_depths(STEP_POINTS), 1.0)[:, None, None]
    return weights[..., rows, columns], np.exp(-x * rates[:, None])[..., rows, columns]


def project_highest_degree(points: int) -> Array:
    """The part of values at the Gauss points that only a polynomial of the highest degree has, (points, points)."""
    x, weights = np.polynomial.legendre.leggauss(points)
    legendre = np.polynomial.legendre.legvander(x, points - 1)[:, -1]
    return np.outer(legendre, legendre * weights) * (points - 0.5)


def reflect_semi_infinite(on_nodes: OnNodes, scattered: Scattered, conserves: bool) -> tuple[Slab, int]:
    """R (r, c) of a semi-infinite layer, and its doublings; ``conserves``: order 0 at albedo 1."""
    n, (ahead, back) = on_nodes.n, scattered
    rate, columns = 1.0 / on_nodes.rows, 1.0 / on_nodes.columns
    lost = np.diag(rate[:n]) - ahead[:n, :n]
    A, b = lost, back[:n, :n]
    if conserves:  # two eigenvalues meet at 0, and doubling is right to 1e-8 only: the known one is moved away
        isotropic = np.tile(np.eye(len(on_nodes.problem.stokes))[0], on_nodes.problem.nodes.size)
        shift = np.outer(isotropic, isotropic) / (2.0 * (isotropic @ isotropic))
        A, b = A - shift, b + shift
        on_both, doublings = solve_riccati(A, b, back[:n, :n] - shift, lost + shift)
    else:
        on_both, doublings = solve_riccati(A, b, b, A)
    R = np.empty_like(back)
    R[:n, :n] = on_both
    # columns of beams, then rows of outgoing directions, are linear once R on the nodes is known
    R[:n, n:] = solve_shifted(lost - on_both @ back[:n, :n], columns[n:], back[:n, n:] + on_both @ ahead[:n, n:])
    right = (lost - back[:n, :n] @ on_both).T
    R[n:, :n] = solve_shifted(right, rate[n:], (back[n:, :n] + ahead[n:, :n] @ on_both).T).T
    out, into = R[n:, :n], R[:n, n:]
    more = back[n:, n:] + ahead[n:, :n] @ into + out @ ahead[:n, n:] + out @ back[:n, :n] @ into
    R[n:, n:] = more / (rate[n:, None] + columns[n:])
    return Slab(on_nodes, np.inf, R, np.zeros_like(R)), doublings


def solve_shifted(matrix: Array, shifts: Array, given: Array) -> Array:
    """x_k of (matrix + shift_k) x_k = given_k, one column each, (n, k)."""
    shifted = matrix + shifts[:, None, None] * np.eye(matrix.shape[0])
    return np.asarray(np.linalg.solve(shifted, given.T[..., None])[..., 0].T, np.float64)


def solve_riccati(A: Array, B: Array, C: Array, D: Array) -> tuple[Array, int]:
    """The smallest solution of X C X - X D - A X + B = 0 and its doublings: Guo, Lin and Xu, Numer. Math. 103, 393
    (2006), shift of Guo, Iannazzo and Meini, SIAM J. Matrix Anal. Appl. 29, 1083 (2007). Raises AccuracyError."""
    one = np.eye(len(A))
    gamma = max(float(np.diag(A).max()), float(np.diag(D).max()))
    A_g, D_g = A + gamma * one, D + gamma * one
    back_over_D = np.linalg.solve(D_g.T, B.T).T
    W = A_g - back_over_D @ C
    V = D_g - C @ np.linalg.solve(A_g, B)
    E, F = one - 2.0 * gamma * np.linalg.inv(V), one - 2.0 * gamma * np.linalg.inv(W)
    G = 2.0 * gamma * np.linalg.solve(D_g, C) @ np.linalg.inv(W)
    H = 2.0 * gamma * np.linalg.solve(W, back_over_D)
    for doubling in range(1, MOST_SDA_DOUBLINGS + 1):
        E_over, F_over = np.linalg.solve((one - G @ H).T, E.T).T, np.linalg.solve((one - H @ G).T, F.T).T
        added = F_over @ H @ E
        G, H, E, F = G + E_over @ G @ F, H + added, E_over @ E, F_over @ F
        if np.abs(added).max() <= CONVERGED * np.abs(H).max():
            return H, doubling
    raise AccuracyError(f"the reflection of a semi-infinite layer does not converge in {MOST_SDA_DOUBLINGS} doublings")
