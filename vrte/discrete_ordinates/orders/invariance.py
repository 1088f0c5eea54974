"""Reflection of a semi-infinite layer by invariance: Ambarzumian's functions as matrices, without an eigenproblem."""

from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import CHUNK_BYTES
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary

TIGHTER = 0.5  # iterations stop at this fraction of the requested accuracy


def is_halved(problem: Problem) -> bool:
    """Whether fixed points begin on every other node: Gauss's own, which a polynomial runs through."""
    plain = problem.media is None and problem.grading == 1
    return problem.skip_flags.coarse and plain and problem.nodes.size >= _core.FEWEST_TO_HALVE


@record
class Reflected:
    """kernels (order, 1, n_in, n_col, n_out, S), public frame; on_nodes (order, n_in n_col, n), light that comes up to
    the top; residual, steps (order,)."""

    kernels: Array
    on_nodes: Array
    residual: Array
    steps: IntArray


def reflect_semi_infinite(problem: Problem, orders: IntArray, tolerance: float, run: Run, top: Top = OPEN) -> Reflected:
    """What the first layer of a problem, taken as semi-infinite, sends back in each order, up to ``top``. Raises
    AccuracyError where it cannot be joined with that."""
    n_out, n_in, n_col = problem.mu_out.size, problem.mu0.size, problem.columns.shape[0]
    with run.timed("invariance") as crew:
        asked = list_arguments(problem, orders, tolerance) | top.arguments_of(orders)
        if run.kept is None or top is not OPEN or run.kernels is not _core:
            found = run.kernels.reflect_semi_infinite(crew, columns=problem.columns, **asked)
        else:
            found = _core.keep_semi_infinite(crew, columns=problem.columns, **asked)
            keep_reflections(run.kept, asked, found.pop("kept_R"), found["residual"])
    info = found.pop("info")
    if info.any():
        raise AccuracyError(f"the boundary system of order {orders[np.argmax(info != 0)]} is singular")
    kernels = found.pop("up").reshape(orders.size, 1, n_in, n_col, n_out, len(problem.stokes))
    kernels[..., : problem.n_up, :] *= problem.flip / (2.0 * np.pi)
    kernels[..., problem.n_up :, :] = 0.0  # nothing comes down upon the top
    return Reflected(kernels, **found)


def list_arguments(problem: Problem, orders: IntArray, tolerance: float) -> dict[str, Any]:
    """What the stages of a semi-infinite layer read, but for beams."""
    off, indices = problem.off_nodes
    n_out = problem.mu_out.size
    return {
        "orders": orders,
        "members": np.array(problem.stokes, np.int32),
        "coefficients": problem.coefficients[:1],
        "terms": problem.terms[:1],
        "albedo": problem.albedo[:1],
        "directions": np.concatenate([problem.nodes, off]),
        "weights": problem.weights,
        "out_places": indices[:n_out],
        "in_places": indices[n_out:],
        "tolerance": tolerance,
        "halves": problem.skip_flags.halves,
        "coarse": problem.skip_flags.coarse,
    }


def keep_reflections(kept: dict[Any, Any], asked: dict[str, Any], each: Array, residual: Array) -> None:
    """Keeps R of each order and what it misses for `recall_reflections`, as far as memory is meant for that."""
    if (len(kept) + len(each)) * each[0].nbytes <= CHUNK_BYTES:
        key = name_arguments(asked)
        for order, *found in zip(asked["orders"].tolist(), each, residual, strict=True):
            kept[order, *key] = found


def recall_reflections(kept: dict[Any, Any] | None, asked: dict[str, Any]) -> dict[str, Array]:
    """R of all orders and what it misses, as stages of derivatives read it; nothing unless all were kept."""
    key = name_arguments(asked) if kept else ()
    each = [(order, *key) for order in asked["orders"].tolist()]
    if kept is None or not all(one in kept for one in each):
        return {}
    R, missing = zip(*(kept[one] for one in each), strict=True)
    return {"kept_R": np.stack(R), "kept_missing": np.array(missing)}


def name_arguments(asked: dict[str, Any]) -> tuple[Any, ...]:
    """What tells the arguments of two layers apart, their orders left out."""
    each = (value for name, value in asked.items() if name != "orders")
    return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in each)


def find_flux_up(problem: Problem, on_nodes: Array) -> Array:
    """Diffuse flux up through the top, from order 0's field on the nodes: (1, n_in, n_col)."""
    n_in, n_col = problem.mu0.size, problem.columns.shape[0]
    if not problem.conserves:
        return np.zeros((1, n_in, n_col))
    flux: Array = on_nodes[:, :: len(problem.stokes)] @ np.sqrt(problem.weights * problem.nodes)
    return flux.reshape(1, n_in, n_col)


def find_allowed_residuals(accuracy: float) -> dict[str, float]:
    """Residuals up to which the answer of invariance counts."""
    return {"residual_of_invariance": max(1e-9, 2.0 * TIGHTER * accuracy)}


def solve_by_invariance(
    problem: Problem, orders: IntArray, tolerance: float, run: Run, top: Top = OPEN
) -> tuple[Orders, Array]:
    """The given orders at the top of a semi-infinite layer, and the light on the nodes that comes up to ``top``,
    (order, n_rhs, n)."""
    found = reflect_semi_infinite(problem, orders, tolerance, run, top)
    up = find_flux_up(problem, found.on_nodes[0])
    up = np.broadcast_to(up, (problem.level.size, *up.shape[1:]))
    kernels = np.broadcast_to(found.kernels, (orders.size, problem.level.size, *found.kernels.shape[2:]))
    return Orders(kernels, up, np.zeros_like(up), {"residual_of_invariance": found.residual}), found.on_nodes


class Invariance:
    """Fixed points of the invariance equation: the top of a semi-infinite layer alone."""

    name, other = "invariance", "doubling"

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.tolerance = problem, TIGHTER * accuracy
        self.allowed = find_allowed_residuals(accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once: all, their matrices are scratch memory."""
        return 1 << 20

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        return solve_by_invariance(self.problem, orders, self.tolerance, run)[0]

    @staticmethod
    def count_doubles(problem: Problem) -> tuple[float, float]:
        """Doubles of an order's arrays, and of a thread's scratch memory."""
        sizes = problem.sizes | {"n_off": problem.off_nodes[0].size, "n_term": int(problem.terms.max())}
        work = _core.count_scratch("reflect_semi_infinite", **sizes)
        return float(problem.n_rhs * (problem.rows_out + problem.size)), float(work)

    @staticmethod
    def list_left_out(problem: Problem, accuracy: float) -> list[tuple[str, str]]:
        """See `Way`."""
        found = [("halves", "the other is its mirror image")]
        if is_halved(problem):
            found.append(("coarse", "it begins on every other node"))
        return found
