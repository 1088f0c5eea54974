"""One Fourier order after another by one of the two exact routes, what fails by the other, and the azimuthal sum."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.arrays import Array
from vrte.blas import single_threaded
from vrte.discrete_ordinates.choice import choose
from vrte.discrete_ordinates.memory import check_memory
from vrte.discrete_ordinates.problem import IntArray, Problem, Progress, Run
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.routes import OTHER, ROUTES, Orders, Route
from vrte.discrete_ordinates.single_scattering import (
    base_reflected,
    cos_sin_deg,
    layer_paths,
    phase_matrices_of_layers,
)
from vrte.discrete_ordinates.small_angle import add_anisotropic
from vrte.errors import AccuracyError
from vrte.optics.truncation import Truncated, truncated
from vrte.scene import MuellerBase, Scene

BoolArray = NDArray[np.bool_]
NO_LIGHT = 1e-290  # per unit of incident light: below, numbers lose digits
LAST_PLACES = 4.0  # what sums of thicknesses may be off by
NEGLIGIBLE = 1e-15  # of the single-scattering albedo: a bound on what the orders left out could add


@dataclass(frozen=True, eq=False)
class Solution:
    """Radiance for each incident Stokes column, and fluxes.

    radiance (n_tau, n_in, n_mu, n_phi, 4, n_col), diffuse, public frame; flux_up, flux_down (n_tau, n_in, n_col).
    """

    radiance: Array
    flux_up: Array
    flux_down: Array
    diagnostics: dict[str, Any]


@dataclass(frozen=True)
class Options:
    """How to solve: nodes of a hemisphere, algorithm "auto", "modes" or "doubling", and whether to run both; what is
    done about more terms than the nodes carry."""

    nodes: int
    algorithm: str = "auto"
    verify: bool = False
    truncation: str = "none"


def solve(
    scene: Scene,
    mu0: Array,
    columns: Array,
    mu: Array,
    phi: Array,
    tau: Array,
    options: Options,
    run: Run,
    progress: Progress | None = None,
) -> Solution:
    """The diffuse field at depths tau (n_tau,), signed cosines mu (n_mu,) and azimuths phi (degrees).

    ``columns`` (n_col, 4): incident Stokes vectors, each within (I, Q) or within (U, V). Raises AccuracyError where
    neither route can vouch for its answer.
    """
    start = time.perf_counter()
    with single_threaded():
        # light going up first
        rank = np.argsort(mu < 0.0, kind="stable")
        layers = truncated_layers(scene, options)
        problem = discretise(scene, mu0, columns, mu[rank], tau, options.nodes, layers)
        choice = choose(options.algorithm, problem)
        check_memory(scene, problem, phi.size, run.threads, choice.name)
        orders = orders_needed(scene, problem, run)
        result, repeated = solve_orders(scene, problem, orders, choice.name, run, progress)
        begin = time.perf_counter()
        radiance = np.empty((tau.size, mu0.size, mu.size, phi.size, 4, columns.shape[0]))
        radiance[:, :, rank] = fourier_sum(result.kernels, orders, columns, phi)
        run.book("fourier sum", time.perf_counter() - begin)
        if options.truncation == "small-angle" and any(layer.fraction for layer in layers):
            add_anisotropic(radiance, scene, layers, problem, mu, phi, is_scalar(scene), run)
        else:
            add_scattered_once(radiance, scene, layers, problem, mu, phi, run)
        add_reflected_once(radiance, scene, problem, mu, phi)
        agreement = None
        if options.verify:
            size = np.abs(radiance[..., 0, :]).max(axis=(1, 2, 3, 4))
            agreement = compare_routes(scene, problem, orders, choice.name, result, repeated, size, run)
    longest = max(layer.phase_matrix.terms for layer in scene.layers)
    diagnostics = {
        "method": "discrete-ordinates",
        "algorithm": choice.name,
        "algorithm_rule": choice.reason,
        "orders_repeated": {"by": OTHER[choice.name], "orders": repeated} if repeated else None,
        "nodes": int(options.nodes),
        "threads": run.threads,
        "openmp": _core.HAS_OPENMP,
        "orders": int(orders.size),
        "orders_of_phase_matrix": longest,
        "terms_cut": max(0, longest - 2 * options.nodes),
        "truncation": options.truncation,
        "peak_fractions": [layer.fraction for layer in layers],
        "base": base_statement(scene),
        **{name: float(values.max()) for name, values in result.residuals.items()},
        **({} if agreement is None else {"agreement": agreement}),
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    flux_down = result.flux_down + flux_of_the_peak(problem, tau)
    return Solution(radiance, result.flux_up, flux_down, diagnostics)


def base_statement(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    name = "black" if scene.base is None else type(scene.base).__name__
    return name if scene.base_is_reached or scene.base is None else f"{name}, not reached below an infinite layer"


def truncated_layers(scene: Scene, options: Options) -> list[Truncated]:
    """The layers as multiple scattering sees them."""
    scalar = is_scalar(scene)
    return [
        truncated(options.truncation, layer.phase_matrix, layer.albedo, layer.thickness, 2 * options.nodes, scalar)
        for layer in scene.layers
    ]


def is_scalar(scene: Scene) -> bool:
    """True where polarized light matters nowhere: no layer scatters it and the base does not reflect it."""
    return not isinstance(scene.base, MuellerBase) and all(layer.phase_matrix.is_scalar for layer in scene.layers)


def discretise(
    scene: Scene,
    mu0: Array,
    columns: Array,
    mu: Array,
    tau: Array,
    nodes: int,
    layers: list[Truncated] | None = None,
) -> Problem:
    """Nodes, truncated coefficients (cut, unless ``layers`` are given) and the layer every depth lies in; all depths as
    the truncated layers have them."""
    points, weights = double_gauss(nodes)
    layers = layers or truncated_layers(scene, Options(nodes))
    terms = np.array([layer.coefficients.shape[0] for layer in layers], np.int32)
    coefficients = np.zeros((len(layers), int(terms.max()), 6))
    for k, layer in enumerate(layers):
        coefficients[k, : terms[k]] = layer.coefficients
    thickness = np.array([layer.thickness for layer in scene.layers])
    level, at = place_levels(tau, tops(thickness), thickness, scene.thickness)
    level = level * np.array([layer.stretch for layer in layers])[at]
    thickness = np.array([layer.thickness for layer in layers])
    above = tops(thickness)
    return Problem(
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([layer.albedo for layer in layers]),
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


def tops(thickness: Array) -> Array:
    """Optical depth of the top of each layer."""
    return np.concatenate([[0.0], np.cumsum(thickness[:-1])])


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


def solve_orders(
    scene: Scene, problem: Problem, orders: IntArray, name: str, run: Run, progress: Progress | None = None
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
        if progress is not None:
            progress(done, int(orders.size))
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


def fourier_sum(kernels: Array, orders: IntArray, columns: Array, phi: Array) -> Array:
    """(1:6)-(1:8), (1:12) without its 1/2: (n_tau, n_in, n_out, n_phi, 4, n_col), orders summed in order."""
    cosine, sine = cos_sin_deg(orders[:, None] * phi)
    twice = np.where(orders == 0, 1.0, 2.0)[:, None]
    cosine, sine = twice * cosine, twice * sine
    n_order, *shape, _ = kernels.shape  # order, tau, in, col, out
    result = np.empty((*shape, 4, phi.size))
    for col, column in enumerate(columns):
        first = bool(column[:2].any()) or not column.any()
        for part, angular in ((slice(0, 2), cosine if first else -sine), (slice(2, 4), sine if first else cosine)):
            values = kernels[:, :, :, col, :, part].reshape(n_order, -1)
            result[:, :, col, :, part] = (values.T @ angular).reshape(shape[0], shape[1], shape[3], 2, phi.size)
    return result.transpose(0, 1, 3, 5, 4, 2)


def flux_of_the_peak(problem: Problem, tau: Array) -> Array:
    """Light scattered into the forward peaks alone, (n_tau, n_in, n_col): delta-M counts it as direct, it is diffuse.

    ``tau`` (n_tau,): the depths in the scene as it is.
    """
    depth = (problem.above[problem.level_layer] + problem.level)[:, None]
    added = np.exp(-depth / problem.mu0) * -np.expm1((depth - tau[:, None]) / problem.mu0) * problem.mu0
    return np.where(depth < tau[:, None], added, 0.0)[..., None] * problem.columns[:, 0]


def add_scattered_once(
    radiance: Array, scene: Scene, layers: list[Truncated], problem: Problem, mu: Array, phi: Array, run: Run
) -> None:
    """Adds single scattering to radiance, in place.

    Light is scattered once by the whole phase matrix, and attenuated as by the truncated layers. Source: Nakajima and
    Tanaka, JQSRT 40, 51 (1988), their TMS.
    """
    phase = phase_matrices_of_layers(tuple(scene.layers), problem.mu0, mu, phi, run)
    begin = time.perf_counter()
    paths = layer_paths(problem, mu)
    stokes = problem.columns.T
    for z, path, layer in zip(phase, paths, layers, strict=True):
        if layer.gain > 0.0:
            scattered = z @ stokes
            radiance += (layer.gain / (4.0 * np.pi)) * path[..., None, None, None] * scattered
    run.book("single scattering", time.perf_counter() - begin)


def add_reflected_once(radiance: Array, scene: Scene, problem: Problem, mu: Array, phi: Array) -> None:
    """Adds the base's direct reflection of the beam to radiance, in place."""
    reflected = base_reflected(scene.base, problem, mu, phi)
    if reflected is not None:
        radiance += reflected @ problem.columns.T
