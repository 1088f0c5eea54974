"""One Fourier order after another by one of the two exact routes, what fails by the other, and the azimuthal sum."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.arrays import Array
from vrte.blas import single_threaded
from vrte.discrete_ordinates.azimuths import fold
from vrte.discrete_ordinates.choice import choose
from vrte.discrete_ordinates.memory import check_memory
from vrte.discrete_ordinates.problem import IntArray, Problem, Progress, Run
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.routes import OTHER, ROUTES, Orders, Route
from vrte.discrete_ordinates.summing import Block, Wanted, fill, number_of_pieces
from vrte.errors import AccuracyError
from vrte.scene import MuellerBase, Scene

BoolArray = NDArray[np.bool_]
NO_LIGHT = 1e-290  # per unit of incident light: below, numbers lose digits
LAST_PLACES = 4.0  # what sums of thicknesses may be off by
WORTH_THREADS = 1e5  # products of matrices, in multiplications: about a millisecond of all stages
NEGLIGIBLE = 1e-15  # of the single-scattering albedo: a bound on what the orders left out could add


@dataclass(frozen=True, eq=False)
class Solution:
    """Radiance for each incident Stokes column, and fluxes.

    parts: one array (n_level, n_in, n_mu, n_phi, 4, n_place) for each that was wanted, diffuse, public frame; flux_up,
    flux_down (n_tau, n_in, n_col).
    """

    parts: list[Array]
    flux_up: Array
    flux_down: Array
    diagnostics: dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How to solve: nodes of a hemisphere, algorithm "auto", "modes" or "doubling", and whether to run both."""

    nodes: int
    algorithm: str = "auto"
    verify: bool = False


def solve(
    scene: Scene,
    mu0: Array,
    columns: Array,
    mu: Array,
    phi: Array,
    tau: Array,
    wanted: Wanted,
    options: Options,
    run: Run,
    progress: Progress | None = None,
) -> Solution:
    """The diffuse field at depths tau (n_tau,), signed cosines mu (n_mu,) and azimuths phi (degrees).

    ``columns`` (n_col, 4): incident Stokes vectors, each within (I, Q) or within (U, V). ``progress`` counts Fourier
    orders, then pieces of the result. Raises AccuracyError where neither route can vouch for its answer.
    """
    start, threads = time.perf_counter(), run.threads
    with single_threaded():
        # light going up first
        rank = np.argsort(mu < 0.0, kind="stable")
        problem = discretise(scene, mu0, columns, mu[rank], tau, options.nodes)
        choice = choose(options.algorithm, problem)
        azimuths = fold(phi)
        check_memory(scene, problem, wanted.doubles(phi.size), azimuths, run.threads, choice.name)
        run = worth_threads(run, problem)
        orders = orders_needed(scene, problem, run)
        steps = int(orders.size) + number_of_pieces(wanted, phi.size)

        def told(done: int) -> None:
            if progress is not None:
                progress(done, steps)

        result, repeated = solve_orders(scene, problem, orders, choice.name, run, told)
        everything = np.arange(4, dtype=np.int32), np.arange(columns.shape[0], dtype=np.int32)
        blocks = [Block(orders, *everything, result.kernels)]
        parts = fill(wanted, blocks, scene, problem, mu, azimuths, run, lambda pieces: told(int(orders.size) + pieces))
        agreement = None
        if options.verify:
            size = largest(parts, wanted, tau.size)
            agreement = compare_routes(scene, problem, orders, choice.name, result, repeated, size, run)
    longest = max(layer.phase_matrix.terms for layer in scene.layers)
    diagnostics = {
        "method": "discrete-ordinates",
        "algorithm": choice.name,
        "algorithm_rule": choice.reason,
        "orders_repeated": {"by": OTHER[choice.name], "orders": repeated} if repeated else None,
        "nodes": int(options.nodes),
        "threads": threads,
        "openmp": _core.HAS_OPENMP,
        "orders": int(orders.size),
        "orders_of_phase_matrix": longest,
        "terms_cut": max(0, longest - 2 * options.nodes),
        "base": base_statement(scene),
        **{name: float(values.max()) for name, values in result.residuals.items()},
        **({} if agreement is None else {"agreement": agreement}),
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Solution(parts, result.flux_up, result.flux_down, diagnostics)


def base_statement(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    name = "black" if scene.base is None else type(scene.base).__name__
    return name if scene.base_is_reached or scene.base is None else f"{name}, not reached below an infinite layer"


def discretise(scene: Scene, mu0: Array, columns: Array, mu: Array, tau: Array, nodes: int) -> Problem:
    """Nodes, cut coefficients and the layer every depth lies in."""
    points, weights = double_gauss(nodes)
    terms = np.array([min(layer.phase_matrix.terms, 2 * nodes) for layer in scene.layers], np.int32)
    coefficients = np.zeros((len(scene.layers), int(terms.max()), 6))
    for k, layer in enumerate(scene.layers):
        coefficients[k, : terms[k]] = layer.phase_matrix.coefficients[: terms[k]]
    thickness = np.array([layer.thickness for layer in scene.layers])
    above = np.concatenate([[0.0], np.cumsum(thickness[:-1])])
    level, at = place_levels(tau, above, thickness, scene.thickness)
    return Problem(
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([layer.albedo for layer in scene.layers]),
        thickness=thickness,
        above=above,
        nodes=points,
        weights=weights,
        mu_out=np.abs(mu),
        n_up=int(np.count_nonzero(mu > 0.0)),
        mu0=np.ascontiguousarray(mu0),
        columns=np.ascontiguousarray(columns),
        level=level,
        level_layer=at,
    )


def place_levels(tau: Array, above: Array, thickness: Array, total: float) -> tuple[Array, IntArray]:
    """The depth of each tau below the top of its layer, and the layer.

    What lies within rounding of an interface lies on it: along a cosine of 1e-8 the last place of 1 is a path of 2e-8.
    """
    at = np.clip(np.searchsorted(above, tau, side="right") - 1, 0, None).astype(np.int32)
    at[tau >= total] = above.size - 1
    level = np.clip(tau - above[at], 0.0, thickness[at])
    rounding = LAST_PLACES * np.finfo(float).eps * tau
    level = np.where(level <= rounding, 0.0, level)
    level = np.where(thickness[at] - level <= rounding, thickness[at], level)
    return np.where(tau >= total, thickness[-1], level), at


def orders_needed(scene: Scene, problem: Problem, run: Run) -> IntArray:
    """Orders 0 .. last: beyond, a bound on multiple scattering is below 1e-15 of the albedo. At least order 0.

    A Mueller base can feed light back at any order, so there all orders of the phase matrix run.
    """
    n_order = int(problem.terms.max())
    if not (isinstance(scene.base, MuellerBase) and scene.base_is_reached):
        bounds, directions = np.empty(n_order), problem.directions
        run.timed(
            "order bounds",
            _core.order_bounds,
            problem.coefficients,
            problem.terms,
            problem.albedo,
            directions,
            problem.weights,
            problem.mu_out.size,
            bounds,
            run.threads,
            run.work(_core.bounds_work(directions.size, n_order)),
        )
        tail = np.cumsum(2.0 * bounds[::-1])[::-1]
        n_order = max(1, int(np.count_nonzero(tail > NEGLIGIBLE * max(problem.albedo.max(), 1e-300))))
    return np.arange(n_order, dtype=np.int32)


def worth_threads(run: Run, problem: Problem) -> Run:
    """The run, on one thread where starting another would take longer than the solve."""
    n = float(problem.size)
    work = float(problem.terms.max()) * n * (n * n + problem.n_rhs * 4.0 * problem.mu_out.size)
    return run if work > WORTH_THREADS else replace(run, threads=1)


def solve_orders(
    scene: Scene,
    problem: Problem,
    orders: IntArray,
    name: str,
    run: Run,
    told: Callable[[int], None] = lambda done: None,
) -> tuple[Orders, list[int]]:
    """All orders by the named route, a few at a time to bound memory, and which of them took the other one.

    Raises AccuracyError where an order passes the checks of neither.
    """
    base = scene.base if scene.base_is_reached else None
    n_order = int(orders[-1]) + 1
    route: Route = ROUTES[name](problem, base, n_order)
    other: Route | None = None
    parts: list[Orders] = []
    repeated: list[int] = []
    done = 0
    while done < orders.size:
        part = orders[done : done + route.chunk(run.threads)]
        result, doubt = attempt(route, part, run)
        if doubt:
            if other is None:
                other = ROUTES[OTHER[name]](problem, base, n_order)
            again, still = attempt(other, part[list(doubt)], run)
            if still:
                place, reason = next(iter(still.items()))
                bad = list(doubt)[place]
                raise AccuracyError(
                    f"neither algorithm can vouch for Fourier order {part[bad]}: {route.name} ({doubt[bad]}), "
                    f"{other.name} ({reason}){advice(scene, problem)}"
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
    for place in range(orders.size):
        for name, values in result.residuals.items():
            if not values[place] <= route.allowed[name]:
                doubt[place] = f"{name} {values[place]:.2g}, allowed {route.allowed[name]:g}"
        if not np.isfinite(result.kernels[place]).all():
            doubt[place] = "the answer is not finite"
    return result, doubt


def merged(result: Orders | None, again: Orders | None, places: list[int]) -> Orders:
    """`result` with the orders at `places` as the other route found them; residuals stay with those that count."""
    assert again is not None
    if result is None or len(places) == result.kernels.shape[0]:
        return again
    result.kernels[places] = again.kernels
    kept = np.delete(np.arange(result.kernels.shape[0]), places)
    first = again if places[0] == 0 else result
    residuals = {name: values[kept] for name, values in result.residuals.items()} | again.residuals
    return Orders(result.kernels, first.flux_up, first.flux_down, residuals)


def concatenated(parts: list[Orders]) -> Orders:
    """All orders in one piece; the fluxes are those of the first."""
    names = {name for part in parts for name in part.residuals}
    residuals = {
        name: np.concatenate([part.residuals[name] for part in parts if name in part.residuals])
        for name in sorted(names)
    }
    kernels = parts[0].kernels if len(parts) == 1 else np.concatenate([part.kernels for part in parts])
    return Orders(kernels, parts[0].flux_up, parts[0].flux_down, residuals)


def advice(scene: Scene, problem: Problem) -> str:
    """What a user can do about a scene that no route solves."""
    longest = max(layer.phase_matrix.terms for layer in scene.layers)
    resolved = longest <= problem.terms.max()
    return "" if resolved else f"; {problem.nodes.size} nodes do not resolve {longest} terms, use more"


def compare_routes(
    scene: Scene,
    problem: Problem,
    orders: IntArray,
    name: str,
    result: Orders,
    repeated: list[int],
    size: Array,
    run: Run,
) -> dict[str, Any]:
    """All orders once more by the other route: the largest difference of the field and of the fluxes.

    Both relative, depth by depth, to the largest there, ``size`` (n_tau,) for the field; None where nothing could be
    compared, because one of the routes alone vouches for every order. Raises AccuracyError where the other route finds
    no answer either.
    """
    other, other_repeated = solve_orders(scene, problem, orders, OTHER[name], run)
    both = ~np.isin(orders, repeated + other_repeated)
    agreement: dict[str, Any] = {
        "with": OTHER[name],
        "orders_compared": int(both.sum()),
        "radiance": None,
        "flux": None,
    }
    if both.any():
        twice = np.where(orders[both] == 0, 1.0, 2.0)
        gap = twice @ np.abs(other.kernels[both] - result.kernels[both]).max(axis=(2, 3, 4, 5))
        agreement["radiance"] = float((gap / positive(size)).max())
    if both[0]:
        flux, other_flux = (np.stack([found.flux_up, found.flux_down]) for found in (result, other))
        gap, largest = (np.abs(values).max(axis=(0, 2, 3)) for values in (other_flux - flux, flux))
        agreement["flux"] = float((gap / positive(largest)).max())
    return agreement


def positive(values: Array) -> Array:
    """`values`, never so small that what divides by them is noise."""
    return np.maximum(values, NO_LIGHT)


def largest(parts: list[Array], wanted: Wanted, n_tau: int) -> Array:
    """The largest intensity at each depth for a unit beam, (n_tau,); 0 where none was wanted."""
    size = np.zeros(n_tau)
    for values, (levels, _) in zip(parts, wanted.parts, strict=True):
        for i, scale in enumerate(wanted.scale):
            found = np.abs(values[:, i, :, :, 0]).max(axis=(1, 2, 3)) / scale
            size[levels] = np.maximum(size[levels], found)
    return size
