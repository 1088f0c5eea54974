"""The plan executed: block after block by its algorithm, what fails by another, and the azimuthal sum."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.blas import single_threaded
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.execution.summing import Light, fill, number_of_pieces
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import OTHER, ROUTES, Orders, Route
from vrte.discrete_ordinates.orders.small_angle import scratch_doubles
from vrte.discrete_ordinates.orders.truncating import flux_of_the_peak, spread_towards
from vrte.discrete_ordinates.planning.azimuths import fold
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.memory import check_memory
from vrte.discrete_ordinates.planning.needs import calibrated, orders_that_matter
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.request.wanted import Wanted
from vrte.results.solution import NO_LIGHT, Solution
from vrte.scene.boundary import Boundary

WORTH_THREADS = 1e5  # products of matrices, in multiplications: about a millisecond of all stages


@dataclass(eq=False)
class Tally:
    """Orders done so far, how many by whom, which were repeated by whom, residuals, unknowns of a hemisphere of all of
    them together, and what verification saw."""

    orders: set[int]
    by: dict[str, int]
    repeated: dict[str, set[int]]
    residuals: dict[str, float]
    unknowns: int = 0
    compared: int = 0
    gap: Array | None = None
    flux_gap: Array | None = None


def solve(plan: Plan, run: Run, progress: Progress | None = None) -> Solution:
    """The diffuse field of a plan. Raises AccuracyError where no algorithm can vouch for its answer."""
    start = time.perf_counter()
    request, problem, wanted = plan.request, plan.problem, plan.wanted
    azimuths = fold(request.phi, problem.leave_out.azimuths)
    total = steps(plan)
    with single_threaded():
        spreads = spread_towards(plan.truncation, problem, plan.mu)
        if not run.brief or spreads.any():
            scratch = scratch_doubles(request.scene) if spreads.any() else 0.0
            check_memory(problem, plan.blocks, wanted.doubles(request.phi.size) + scratch, azimuths, run.threads)
        flux_up, flux_down = np.zeros((2, request.tau.size, request.mu0.size, request.columns.shape[0]))
        lights: list[Light] = []
        tally = Tally(set(), {}, {}, {})
        left, brightest, done = plan.orders, plan.brightest, 0
        found: dict[int, Array] = {}
        for block in plan.blocks:
            if block.orders[0] > max(found, default=left):
                left = orders_left(plan, brightest, found, left)
            orders = block.orders[block.orders < left]
            if orders.size:
                result = solve_block(plan, block, orders, run, tally, sized(progress, done, total))
                lights.append(light_of(block, orders, result))
                if orders[0] == 0:
                    flux_up[..., list(block.columns)] += result.flux_up
                    flux_down[..., list(block.columns)] += result.flux_down
                if orders[0] == 0 and block.stokes[0] == 0:
                    brightest = np.maximum(brightest, brightness_of(result, block))
                note(found, orders, result)
            done += int(block.orders.size)
            if progress is not None:
                progress(done, total)
        pieces = sized(progress, done, total)
        parts = fill(wanted, lights, request.scene, problem, plan.mu, azimuths, run, pieces, spreads)
    flux_down += flux_of_the_peak(problem, request.tau)
    diagnostics = {
        **plan.diagnostics(),
        "threads": run.threads,
        "openmp": _core.HAS_OPENMP,
        "orders": len(tally.orders),
        "unknowns": tally.unknowns,
        "orders_by": tally.by,
        "orders_repeated": statement_of(tally.repeated),
        **{name: float(value) for name, value in sorted(tally.residuals.items())},
        **(
            {"agreement": agreement(tally, largest(parts, wanted, request.tau.size), flux_up, flux_down)}
            if request.verify
            else {}
        ),
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Solution(parts, flux_up, flux_down, diagnostics)


def steps(plan: Plan) -> int:
    """What `progress` counts: orders, and pieces of the result."""
    return sum(block.orders.size for block in plan.blocks) + number_of_pieces(plan.wanted, plan.request.phi.size)


def sized(progress: Progress | None, before: int, total: int) -> Callable[[int], None]:
    """The call-back of one step, counted on from what was done before."""
    return lambda done: None if progress is None else progress(before + done, total)


def light_of(block: Block, orders: IntArray, result: Orders) -> Light:
    """What a block found, with its places in the request."""
    return Light(orders, np.array(block.stokes, np.int32), np.array(block.columns, np.int32), result.kernels)


def note(found: dict[int, Array], orders: IntArray, result: Orders) -> None:
    """Puts down the largest that each order has at each depth for each beam, (n_tau, n_in)."""
    for order, kernels in zip(orders.tolist(), result.kernels, strict=True):
        largest = np.abs(kernels).max(axis=(2, 3, 4), initial=0.0)
        found[order] = np.maximum(found[order], largest) if order in found else largest


def orders_left(plan: Plan, brightest: Array, found: dict[int, Array], left: int) -> int:
    """How many orders matter, now that some are solved."""
    if not plan.counts_again:
        return left
    bounds = calibrated(plan.needs, plan.bounds, found)
    return min(left, orders_that_matter(bounds, brightest, plan.accuracy))


def brightness_of(result: Orders, block: Block) -> Array:
    """The brightest I of order 0 at each depth for each beam, (n_tau, n_in)."""
    lit = np.abs(block.problem.columns).max(axis=1)  # not I alone, which may be none
    kernels = np.abs(result.kernels[0, :, :, int(np.argmax(lit)), :, 0])
    brightest: Array = kernels.max(axis=2, initial=0.0) / max(float(lit.max()), 1e-300)
    return brightest


def solve_block(
    plan: Plan, block: Block, orders: IntArray, run: Run, tally: Tally, told: Callable[[int], None]
) -> Orders:
    """The block's orders; what they took goes into the tally."""
    name, run = block.choice.name, worth_threads(run, block.problem, orders)
    result, repeated = solve_orders(block.problem, block.base, orders, name, run, plan.accuracy, told)
    tally.orders |= set(orders.tolist())
    tally.unknowns += orders.size * block.problem.size
    tally.by[name] = tally.by.get(name, 0) + orders.size - len(repeated)
    if repeated:
        tally.by[OTHER[name]] = tally.by.get(OTHER[name], 0) + len(repeated)
        tally.repeated.setdefault(OTHER[name], set()).update(repeated)
    for key, values in result.residuals.items():
        tally.residuals[key] = max(tally.residuals.get(key, 0.0), float(values.max()))
    if plan.request.verify:
        compare(block, orders, result, repeated, run, plan.accuracy, tally)
    return result


def worth_threads(run: Run, problem: Problem, orders: IntArray) -> Run:
    """The run, on one thread where starting another would take longer than the solve."""
    n = float(problem.size)
    work = orders.size * n * (n * n + problem.n_rhs * problem.rows_out)
    return run if work > WORTH_THREADS and orders.size * problem.albedo.size > 1 else replace(run, threads=1)


def solve_orders(
    problem: Problem,
    base: Boundary,
    orders: IntArray,
    name: str,
    run: Run,
    accuracy: float,
    told: Callable[[int], None] = lambda done: None,
) -> tuple[Orders, list[int]]:
    """All orders by the named route, a few at a time to bound memory, and which of them took the other one.

    Raises AccuracyError where an order passes the checks of neither.
    """
    n_order = int(orders[-1]) + 1
    route: Route = ROUTES[name](problem, base, n_order, accuracy)
    other: Route | None = None
    parts: list[Orders] = []
    repeated: list[int] = []
    done = 0
    while done < orders.size:
        part = orders[done : done + route.chunk(run.threads)]
        result, doubt = attempt(route, part, run)
        if doubt:
            if other is None:
                other = ROUTES[OTHER[name]](problem, base, n_order, accuracy)
            again, still = attempt(other, part[list(doubt)], run)
            if still:
                place, reason = next(iter(still.items()))
                bad = list(doubt)[place]
                raise AccuracyError(
                    f"neither algorithm can vouch for Fourier order {part[bad]}: {route.name} ({doubt[bad]}), "
                    f"{other.name} ({reason}){advice(problem)}"
                )
            result = merged(result, again, list(doubt))
            repeated += part[list(doubt)].tolist()
        assert result is not None
        parts.append(result)
        done += part.size
        told(done)
    return concatenated(parts), repeated


def attempt(route: Route, orders: IntArray, run: Run) -> tuple[Orders | None, dict[int, str]]:
    """The orders by one route (None where it found no answer), and what is wrong with those that fail its checks."""
    try:
        result = route.solve(orders, run)
    except AccuracyError as error:
        return None, dict.fromkeys(range(orders.size), str(error))
    doubt: dict[int, str] = {}
    for name, values in result.residuals.items():
        for place in np.flatnonzero(~(values <= route.allowed[name])).tolist():
            doubt[place] = f"{name} {values[place]:.2g}, allowed {route.allowed[name]:g}"
    finite = np.isfinite(result.kernels)
    if not finite.all():
        for place in np.flatnonzero(~finite.all(axis=tuple(range(1, finite.ndim)))).tolist():
            doubt[place] = "the answer is not finite"
    return result, dict(sorted(doubt.items()))


def merged(result: Orders | None, again: Orders | None, places: list[int]) -> Orders:
    """`result` with the orders at `places` as the other route found them; residuals stay with those that count."""
    assert again is not None
    if result is None or len(places) == result.kernels.shape[0]:
        return again
    kernels = result.kernels if result.kernels.flags.writeable else result.kernels.copy()
    kernels[places] = again.kernels
    kept = np.delete(np.arange(result.kernels.shape[0]), places)
    first = again if places[0] == 0 else result
    residuals = {name: values[kept] for name, values in result.residuals.items()} | again.residuals
    return Orders(kernels, first.flux_up, first.flux_down, residuals)


def concatenated(parts: list[Orders]) -> Orders:
    """All orders in one piece; the fluxes are those of the first."""
    if len(parts) == 1:
        return parts[0]
    names = {name for part in parts for name in part.residuals}
    residuals = {
        name: np.concatenate([part.residuals[name] for part in parts if name in part.residuals])
        for name in sorted(names)
    }
    kernels = np.concatenate([part.kernels for part in parts])
    return Orders(kernels, parts[0].flux_up, parts[0].flux_down, residuals)


def advice(problem: Problem) -> str:
    """What a user can do about a scene that no route solves."""
    resolved = problem.terms_cut == 0
    return "" if resolved else f"; {problem.nodes.size} nodes do not resolve the phase matrix, use more"


def statement_of(repeated: dict[str, set[int]]) -> dict[str, Any] | None:
    """Which orders were done again, for the diagnostics."""
    if not repeated:
        return None
    return {"by": " and ".join(sorted(repeated)), "orders": sorted(set().union(*repeated.values()))}


def compare(
    block: Block, orders: IntArray, result: Orders, repeated: list[int], run: Run, accuracy: float, tally: Tally
) -> None:
    """A block once more by another route: what they differ by at each depth, added up over orders.

    Left out are orders that one of the routes alone vouches for. Raises AccuracyError where the other route finds no
    answer either.
    """
    other, other_repeated = solve_orders(block.problem, block.base, orders, OTHER[block.choice.name], run, accuracy)
    both = ~np.isin(orders, repeated + other_repeated)
    tally.compared += int(both.sum())
    if both.any():
        twice = np.where(orders[both] == 0, 1.0, 2.0)
        gap = twice @ np.abs(other.kernels[both] - result.kernels[both]).max(axis=(2, 3, 4, 5))
        tally.gap = gap if tally.gap is None else tally.gap + gap
    if both[0] and orders[0] == 0 and block.stokes[0] == 0:
        pair = (np.stack([found.flux_up, found.flux_down]) for found in (result, other))
        first, second = pair
        tally.flux_gap = np.abs(second - first).max(axis=(0, 2, 3))


def agreement(tally: Tally, size: Array, flux_up: Array, flux_down: Array) -> dict[str, Any]:
    """The largest difference of the field and of the fluxes, relative, depth by depth, to the largest there; None where
    nothing could be compared, because one of the routes alone vouches for every order."""
    found: dict[str, Any] = {
        "with": " and ".join(sorted({OTHER[name] for name in tally.by})),
        "orders_compared": tally.compared,
        "radiance": None,
        "flux": None,
    }
    if tally.gap is not None:
        found["radiance"] = float((tally.gap / np.maximum(size, NO_LIGHT)).max())
    if tally.flux_gap is not None:
        largest = np.maximum(np.abs(flux_up), np.abs(flux_down)).max(axis=(1, 2))
        found["flux"] = float((tally.flux_gap / np.maximum(largest, NO_LIGHT)).max())
    return found


def largest(parts: list[Array], wanted: Wanted, n_tau: int) -> Array:
    """The largest intensity at each depth for a unit beam, (n_tau,); 0 where none was wanted."""
    size = np.zeros(n_tau)
    for values, (levels, _) in zip(parts, wanted.parts, strict=True):
        for i, scale in enumerate(wanted.scale):
            found = np.abs(values[:, i, :, :, 0]).max(axis=(1, 2, 3)) / scale
            size[levels] = np.maximum(size[levels], found)
    return size
