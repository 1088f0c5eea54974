"""A slab over a black base by successive scatterings, for phase matrices of few terms: at its faces by a sum over the
poles of tanh(x)/x, inside by sums of cosh(z x)/cosh(x) and sinh(z x)/cosh(x)."""

import math
from functools import cache
from typing import ClassVar

import numpy as np
import scipy.linalg

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary

MOST_POLES = 35  # of the steepest slabs, at whose faces there are at most 26, and inside which at most 35

STEEPEST = 8192.0  # largest half thickness over the lowest cosine for which fractions reach FINEST in doubles
STEEPEST_INSIDE = 1024.0  # the same limit for light inside: little of a grazing beam reaches the depths
FINEST = 1e-9  # smallest accuracy for which fractions are used; they are right to a tenth of it
PLACES_A_FACTOR = 60  # fit points of the fractions for each factor of two in x
LOWEST = 1e-2  # smallest x of the fit points
EXACT = ((np.arange(2) + 0.5) * np.pi) ** 2  # the lowest poles, which are those of tanh itself
PLACES_INSIDE, LOW, LADDER = 20, 10, 0.17  # of poles for all depths: places a factor of two, exact ones, their ladder
CONVERGED = 1e-3  # error of an order's moments, as a fraction of the requested accuracy, at which GMRES stops


@record
class Tangent:
    """tanh(x)/x = constant + sum share/(x^2 + place), all positive; ``place``, ``share`` (pole,)."""

    place: Array
    share: Array
    constant: float


def find_tangent(largest: float) -> Tangent:
    """The fractions for x up to ``largest``, one set a factor of two. Raises AccuracyError beyond STEEPEST."""
    if not largest <= STEEPEST:
        raise AccuracyError(f"partial fractions are for slabs of at most {STEEPEST:g} half thicknesses over mu")
    return fit_tangent(2.0 ** max(2, math.ceil(math.log2(largest))))


@cache
def fit_tangent(largest: float) -> Tangent:
    """By the AAA algorithm, beside the lowest poles: rational interpolation where the error is largest, with the
    smallest singular vector as weights; poles by an eigenproblem, shares by least squares."""
    x = np.geomspace(LOWEST, largest, PLACES_A_FACTOR * math.ceil(math.log2(largest / LOWEST)))
    square, whole = (x / largest) ** 2, np.tanh(x) / x
    wanted = whole - (2.0 / np.add.outer(x * x, EXACT)).sum(axis=1)
    chosen: list[int] = []
    weights = np.ones(0)
    found = np.full_like(wanted, wanted.mean())
    while True:
        error = np.abs(found - wanted) / whole
        if error.max() < 0.1 * FINEST:
            break
        chosen.append(int(np.argmax(error)))
        left = np.setdiff1d(np.arange(x.size), chosen)
        cauchy = 1.0 / np.subtract.outer(square[left], square[chosen])
        differences = np.subtract.outer(wanted[left], wanted[chosen]) * cauchy / whole[left, None]
        weights = np.linalg.svd(differences, full_matrices=False)[2][-1]
        found = wanted.copy()
        found[left] = (cauchy @ (weights * wanted[chosen])) / (cauchy @ weights)
    count = len(chosen) + 1
    arrow, ones = np.zeros((count, count)), np.eye(count)
    arrow[0, 1:], arrow[1:, 0], ones[0, 0] = weights, 1.0, 0.0
    arrow[1:, 1:] = np.diag(square[chosen])
    roots = np.asarray(scipy.linalg.eigvals(arrow, ones).real, float)
    index: Array = np.concatenate([EXACT / largest**2, np.sort(-1.0 * roots[np.isfinite(roots)])])
    columns = np.hstack([1.0 / np.add.outer(square, index), np.ones((x.size, 1))]) / whole[:, None]
    lengths = np.linalg.norm(columns, axis=0)
    shares = np.linalg.lstsq(columns / lengths, np.ones(x.size), rcond=None)[0] / lengths
    return Tangent(index * largest**2, shares[:-1] * largest**2, float(shares[-1]))


def place_poles(largest: float) -> Array:
    """Poles, (pole,), for light at any depth and x up to ``largest``: the lowest are those of 1/cosh; above these a
    ladder x/sinh(j LADDER), with which bounded functions, smooth but for negative x^2, converge exponentially."""
    exact, after = (np.arange(LOW) + 0.5) * np.pi, (LOW + 0.5) * np.pi
    rungs = round(math.asinh(largest / after) / LADDER)
    step = math.asinh(largest / after) / max(rungs, 1)
    return np.concatenate([exact, largest / np.sinh(step * np.arange(rungs, 0, -1))]) ** 2


def fit_depths(largest: float, depths: Array) -> tuple[Tangent, Array]:
    """tanh by the poles for light inside, and constant and shares, (2, depth, 1 + pole), of cosh(z x)/cosh(x) and
    sinh(z x)/(x cosh(x)) at ``depths`` z from -1 to 1; right to 1e-11, of 1 and of tanh(x)/x. Raises AccuracyError
    beyond STEEPEST_INSIDE."""
    if not largest <= STEEPEST_INSIDE:
        raise AccuracyError(f"light inside is for slabs of at most {STEEPEST_INSIDE:g} half thicknesses over mu")
    basis = find_basis(2.0 ** max(3, math.ceil(math.log2(largest))))
    x, z = basis.x[:, None], np.append(depths, 1.0)
    near, both = np.exp((np.abs(z) - 1.0) * x), 1.0 + np.exp(-2.0 * x)
    even = near * (1.0 + np.exp(-2.0 * np.abs(z) * x)) / both
    odd = -np.sign(z) * near * np.expm1(-2.0 * np.abs(z) * x) / both / np.tanh(x)
    shares = np.array([basis.even.solve(even).T, basis.odd.solve(odd).T])
    tanh = shares[1, -1]
    return Tangent(basis.place, np.ascontiguousarray(tanh[1:]), float(tanh[0])), np.ascontiguousarray(shares[:, :-1])


@record
class Columns:
    """Least squares by columns of the lengths given, places counted by ``weights``: orthogonal ones (place, column)
    times a triangle."""

    weights: Array
    lengths: Array
    orthogonal: Array
    triangle: Array

    def solve(self, wanted: Array) -> Array:
        """Shares, (column, n), of functions (place, n): no inverse, whose rounding the columns would not cancel."""
        shares = scipy.linalg.solve_triangular(self.triangle, self.orthogonal.T @ (self.weights * wanted))
        return shares / self.lengths[:, None]


@record
class Basis:
    """A constant and fractions of poles ``place`` (pole,) at places ``x``; the columns of ``odd`` times x/tanh(x)."""

    x: Array
    place: Array
    even: Columns
    odd: Columns


@cache
def find_basis(largest: float) -> Basis:
    """For x from LOWEST up to ``largest``; errors at steep x, which grazing light meets that has little to lose, count
    more."""
    index = place_poles(largest)
    x = np.geomspace(LOWEST, largest, PLACES_INSIDE * math.ceil(math.log2(largest / LOWEST)))
    columns = np.hstack([np.ones((x.size, 1)), 1.0 / np.add.outer(x * x, index)])

    weights = np.sqrt(np.maximum(x, 1.0))[:, None]

    def factor(columns: Array) -> Columns:
        lengths = np.linalg.norm(weights * columns, axis=0)
        return Columns(weights, lengths, *np.linalg.qr(weights * columns / lengths))

    return Basis(x, index, factor(columns), factor(columns * (x / np.tanh(x))[:, None]))


@record
class Faces:
    """Light that leaves slabs, up at the top and down at the bottom: ``out`` (order, scene, 2, n_rhs, S n_out), times
    2 pi for a unit beam, ``on_nodes`` (order, scene, 2, n_rhs, n), times sqrt(weight mu); residual (order, scene).
    ``out_inside``, ``on_nodes_inside``: light up and down at depths inside, with an axis of them before the 2."""

    out: Array
    on_nodes: Array
    residual: Array
    out_inside: Array
    on_nodes_inside: Array


def find_depths(problem: Problem) -> Array:
    """Levels in half thicknesses below the middle of their layer, (n_tau,)."""
    return 2.0 * problem.level / problem.thickness[problem.level_layer] - 1.0


def find_steepest(problem: Problem) -> float:
    """The largest x: half the thickness over the lowest cosine."""
    return 0.5 * float(problem.thickness.max()) / float(problem.directions.min())


def scatter_by_fractions(problem: Problem, orders: IntArray, accuracy: float, run: Run) -> Faces:
    """Light of every layer, each a scene by itself. Raises AccuracyError where scatterings do not converge."""
    depths = find_depths(problem)
    depths = depths[np.abs(depths) < 1.0]
    if depths.size:
        tangent, inside = fit_depths(find_steepest(problem), depths)
    else:
        tangent = find_tangent(find_steepest(problem))
        inside = np.empty((2, 0, 1 + tangent.place.size))
    with run.timed("fractions") as crew:
        found = _core.scatter_by_fractions(
            crew,
            orders=orders,
            **problem.phase_arguments,
            thickness=problem.thickness,
            columns=problem.columns,
            poles=tangent.place,
            shares=tangent.share,
            constant=tangent.constant,
            inside=inside,
            tolerance=CONVERGED * accuracy,
        )
    info = found.pop("info")
    if info.any():
        raise AccuracyError(f"scatterings of order {orders[np.argwhere(info)[0][0]]} do not converge")
    return Faces(**found)


def gather_levels(problem: Problem, faces: Array, inside: Array) -> Array:
    """(order, n_tau, 2, n_rhs, row): light up and down at all levels of the one layer; none comes in at a face."""
    depths = find_depths(problem)
    found = np.zeros((faces.shape[0], depths.size, *faces.shape[2:]))
    found[:, depths == -1.0, 0], found[:, depths == 1.0, 1] = faces[:, :1, 0], faces[:, :1, 1]
    found[:, np.abs(depths) < 1.0] = inside[:, 0]
    return found


def find_kernels(problem: Problem, faces: Faces) -> Array:
    """(order, n_tau, n_in, n_col, n_out, S): radiance at levels of the one layer, public frame."""
    found = gather_levels(problem, faces.out, faces.out_inside)
    shape = (problem.mu0.size, len(problem.columns), problem.mu_out.size, len(problem.stokes))
    found = found.reshape(*found.shape[:3], *shape)
    kernels, up = np.empty((*found.shape[:2], *shape)), problem.n_up
    kernels[..., :up, :] = found[:, :, 0, ..., :up, :] * (problem.flip / (2.0 * np.pi))
    kernels[..., up:, :] = found[:, :, 1, ..., up:, :] / (2.0 * np.pi)
    return kernels


def find_fluxes(problem: Problem, orders: IntArray, faces: Faces) -> tuple[Array, Array]:
    """Diffuse flux up and down at the levels, (n_tau, n_in, n_col); 0 without order 0."""
    shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
    if not (problem.conserves and orders[0] == 0):
        return np.zeros(shape), np.zeros(shape)
    found = gather_levels(problem, faces.on_nodes[:1], faces.on_nodes_inside[:1])[0]
    flux = found[..., :: len(problem.stokes)] @ np.sqrt(problem.weights * problem.nodes)
    return flux[:, 0].reshape(shape), flux[:, 1].reshape(shape)


class Scatterings:
    """One slab over a black base, under a few beams, by successive scatterings (GMRES)."""

    name, other = "scatterings", "modes"
    allowed: ClassVar = {"residual_of_scatterings": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.accuracy = problem, accuracy

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(self.count_doubles(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        problem = self.problem
        faces = scatter_by_fractions(problem, orders, self.accuracy, run)
        residuals = {"residual_of_scatterings": faces.residual.max(axis=1)}
        return Orders(find_kernels(problem, faces), *find_fluxes(problem, orders, faces), residuals)

    @staticmethod
    def count_doubles(problem: Problem) -> tuple[float, float]:
        """Doubles of an order's arrays, and of a thread's scratch memory."""
        sizes = problem.sizes | {"n_pole": MOST_POLES, "n_depth": problem.level.size}
        work = _core.count_scratch("scatter_by_fractions", **sizes)
        return 2.0 * (1 + problem.level.size) * problem.n_rhs * (problem.size + problem.rows_out), float(work)

    @staticmethod
    def list_left_out(problem: Problem, accuracy: float) -> list[tuple[str, str]]:
        """See `Way`."""
        return []
