"""Synthetic iteration, section 5 of the second paper: a guess of the field, then its source function along each ray.

The guess has an anisotropic part, the beam as it spreads by small angles, and a regular part of which another method
says how much light goes down and up at each depth. One iteration scatters this guess once more towards the wanted
directions alone: in closed form where the regular part is. Further ones scatter along nodes first, orders and depths
on a grid, by the whole phase matrices as delta-M leaves them. Q, U and V come from the anisotropic part and from
these further iterations: the regular part is that of light without polarization.
"""

from dataclasses import dataclass, replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, check_choice, check_whole
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.errors import SceneError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import find_peak_flux
from vrte.methods import solve_request
from vrte.methods.diffusion import BOUNDARIES, solve_diffusion
from vrte.methods.parts.method import Answer, Method, Setting
from vrte.methods.parts.task import Task, discretise_request
from vrte.methods.parts.two_fluxes import TwoFluxes, convert_to_kernels, cut_to_two
from vrte.methods.small_angle import expand_diffuse_part
from vrte.methods.two_stream import solve_two_streams
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.request.how import EXACT, METHODS
from vrte.request.request import Request
from vrte.scene.scene import Scene

NAME, CLOSED = "synthetic-iteration", ("two-stream", "diffusion")
REGULAR = tuple(name for name in METHODS if name not in (NAME, "small-angle"))
NODES = 8  # of a hemisphere, where none are asked for
FIRST_STEP = 1e-3  # from each face of a layer
LONGEST_STEP, MOST = 8.0, 12  # over the number of depths, optical depth; times it, how many such steps at most


def solve_by_synthetic_iteration(task: Task) -> Answer:
    """Radiance by the iterations, fluxes those of the regular part."""
    request, settings = task.request, task.settings
    if request.truncation not in ("auto", "small-angle"):
        raise SceneError(f"method {NAME!r} separates small angles: leave truncation out", "method")
    regular, iterations = settings["regular"], settings["iterations"]
    request = replace(request, truncation="delta-m")
    two = problem = cut_to_two(request)
    down, up = compute_regular_fluxes(regular, request, request.tau, task.run)
    if iterations == 1 and regular in CLOSED:
        kernels = convert_to_kernels(problem, solve_closed_form(regular, request, task.run).orders)
    else:
        if iterations > 1:
            problem = discretise_request(request, request.nodes or NODES, "all")
        with keep_to_one_thread():
            kernels = iterate_field(task, request, problem)
    parts = task.sum_orders(problem, kernels, bool(problem.fraction.any()))
    I = request.columns[:, 0]
    fluxes = up[..., None] * I, down[..., None] * I + find_peak_flux(two, request.tau)[1]
    return task.answer(parts, fluxes, problem, orders=len(kernels), regular=regular, iterations=iterations)


def solve_closed_form(regular: str, request: Request, run: Run) -> TwoFluxes:
    """The regular part, and its orders scattered once more, by one of the methods in closed form."""
    problem, below = cut_to_two(request), request.scene.below
    if regular == "two-stream":
        return solve_two_streams(problem, below, run)
    return solve_diffusion(problem, below, BOUNDARIES["marshak"], run)


def compute_regular_fluxes(regular: str, request: Request, tau: Array, run: Run) -> tuple[Array, Array]:
    """Diffuse fluxes down and up by the method named, without polarization, for unit beams, (n_tau, n_in), less those
    of the peaks that delta-M takes off for two terms."""
    unit = np.array([[1.0, 0.0, 0.0, 0.0]])
    request = replace(request, tau=tau, mu=np.ones(1), columns=unit)
    if regular in CLOSED:
        found = solve_closed_form(regular, request, run)
        return found.down, found.up
    down, up = solve_for_fluxes(regular, request, run)
    return down - find_peak_flux(cut_to_two(request), tau)[1, ..., 0], up


def solve_for_fluxes(regular: str, request: Request, run: Run) -> tuple[Array, Array]:
    """The same by any method, the peaks' with them."""
    asked = replace(
        request,
        scene=remove_polarization(request.scene),
        phi=np.zeros(1),
        wanted=None,
        method=regular,
        settings={},
        truncation="delta-m" if regular == EXACT else "auto",
        fluxes_only=True,
        given=frozenset(),
    )
    quiet = replace(run, stages={})
    solution = solve_request(asked, quiet)[1]
    return solution.flux_down[..., 0], solution.flux_up[..., 0]


def remove_polarization(scene: Scene) -> Scene:
    """The scene with a1 alone."""
    if all(layer.phase_matrix.is_scalar for layer in scene.layers):
        return scene
    a1 = (PhaseMatrix(layer.phase_matrix.a1, tolerance=layer.phase_matrix.tolerance) for layer in scene.layers)
    return Scene(
        [replace(layer, phase_matrix=matrix) for layer, matrix in zip(scene.layers, a1, strict=True)], scene.base
    )


@dataclass(frozen=True, eq=False)
class Grid:
    """Depths of all layers, both faces of each: ``layer`` (D,), ``tau`` (D,) in the scene, ``depth`` (D,) in the
    truncated layers; ``asked`` (n_tau,): which of them the levels are."""

    layer: Array
    tau: Array
    depth: Array
    asked: Array


def make_depth_grid(request: Request, problem: Problem, depths: int) -> Grid:
    """Close together near the faces, where light changes by steps of their distance."""
    layers, taus = [], []
    top = 0.0
    for k, h in enumerate(each.thickness for each in request.scene.layers):
        near = np.geomspace(min(FIRST_STEP, 0.1 * h), 0.5 * h, depths) if h > 0.0 else np.zeros(0)
        levels = request.tau[problem.level_layer == k] - top
        even = np.linspace(0.0, h, min(MOST * depths, int(np.ceil(h * depths / LONGEST_STEP)) + 1))
        points = np.unique(np.clip(np.concatenate([[0.0], near, h - near, even, [h], levels]), 0.0, h))
        layers.append(np.full(points.size, k))
        taus.append(top + points)
        top += h
    layer, tau = np.concatenate(layers), np.concatenate(taus)
    bottom = request.scene.thickness
    tau = np.minimum(tau, bottom)
    tops = np.array([tau[layer == k][0] for k in range(len(request.scene.layers))])
    stretch = 1.0 - np.array([each.albedo for each in request.scene.layers]) * problem.fraction
    depth = problem.above[layer] + stretch[layer] * (tau - tops[layer])
    asked = [
        int(np.flatnonzero(layer == k)[np.argmin(np.abs(depth[layer == k] - at))])
        for k, at in zip(problem.level_layer.tolist(), problem.depth.tolist(), strict=True)
    ]
    return Grid(layer, tau, depth, np.array(asked))


def iterate_field(task: Task, request: Request, problem: Problem) -> Array:
    """Multiply scattered light of the problem's orders, (order, n_tau, n_in, n_col, n_out, 4)."""
    regular, iterations, depths = (task.settings[name] for name in ("regular", "iterations", "depths"))
    if not np.isfinite(request.scene.thickness):
        raise SceneError(
            f"method {NAME!r} needs layers that end, but for one iteration with regular 'two-stream' or 'diffusion'"
        )
    members = [0] if problem.is_scalar else [0, 1, 2, 3]
    grid, albedo = make_depth_grid(request, problem, depths), request.scene.below.even_albedo
    out = np.concatenate([-problem.mu_out[: problem.n_up], problem.mu_out[problem.n_up :]])  # > 0 down, as inside
    nodes = np.concatenate([problem.nodes, -problem.nodes])
    moments = compute_regular_moments(request, grid, regular, task.run)
    downward = 0.5 * moments[0] + moments[1], moments[1]  # of light even over each hemisphere
    base_light = albedo / np.pi * 0.5 * downward[0][-1][:, None] * problem.columns[:, 0]
    direct = albedo / np.pi * (problem.mu0 * np.exp(-grid.depth[-1] / problem.mu0))[:, None] * problem.columns[:, 0]
    tables = compute_anisotropic_tables(request, problem, grid)
    orders = range(problem.coefficients.shape[1])
    on_nodes, towards = (build_operators(problem, orders, to, nodes, members) for to in (nodes, out))
    first = out if iterations == 1 else nodes
    source = np.array([guess(problem, grid, moments, tables, m, first, members) for m in orders])
    beam = (
        np.array([compute_beam_source(problem, grid, m, nodes, members) for m in orders]) if iterations > 1 else source
    )
    for step in range(iterations - 1):
        task.tell(step, iterations)
        field = sweep_light(grid, nodes, source + beam, base_light + direct)
        source = scatter_field(grid, towards if step == iterations - 2 else on_nodes, field)
        flux = field[0, :, :, -1, : problem.nodes.size, 0] @ (problem.weights * problem.nodes)
        base_light = 2.0 * albedo * flux
    task.tell(iterations, iterations)
    found = sweep_light(grid, out, source, base_light)[:, :, :, grid.asked]
    kernels = np.zeros((*found.shape[:-1], 4))
    kernels[..., members] = found
    return kernels.transpose(0, 3, 1, 2, 4, 5)


def compute_regular_moments(request: Request, grid: Grid, regular: str, run: Run) -> tuple[Array, Array]:
    """E_0 and E_z of the regular part at the grid's depths, (D, n_in), of light even over each hemisphere."""
    levels, at = np.unique(grid.tau, return_inverse=True)
    down, up = (flux[at] for flux in compute_regular_fluxes(regular, request, levels, run))
    return 2.0 * (down + up), down - up


def compute_anisotropic_tables(request: Request, problem: Problem, grid: Grid) -> Array:
    """Coefficients of the source of the anisotropic part about the beam, (D, n_in, terms, 6): what is spread, less the
    truncated layers' direct beam; of degrees 0 and 1 only what delta-M takes off the beam for two terms, but not here,
    for the rest of them is regular."""
    terms, layers = problem.coefficients.shape[1], request.scene.layers
    tau, mu0 = grid.tau[:, None], problem.mu0
    whole_scene = replace(request, tau=grid.tau)
    plain = discretise_scene(request.scene, mu0, request.columns, np.ones(1), whole_scene.tau, 1)
    plain = replace(plain, level_layer=grid.layer.astype(np.int32), level=grid.tau - plain.above[grid.layer])
    spread = expand_diffuse_part(request.scene, plain)[:, :, :terms]
    spread = np.pad(spread, ((0, 0), (0, 0), (0, terms - spread.shape[2]), (0, 0)))
    faded = np.exp(-tau / mu0) - np.exp(-grid.depth[:, None] / mu0)
    degrees = 2.0 * np.arange(terms) + 1.0
    scalar = problem.is_scalar
    spread[..., : 1 if scalar else 4] += (faded[..., None] * degrees)[..., None]
    two = cut_to_two(whole_scene)
    stretch = 1.0 - np.array([layer.albedo for layer in layers]) * two.fraction
    depth = two.above[grid.layer] + stretch[grid.layer] * (grid.tau - plain.above[grid.layer])
    beam = np.exp(-depth[:, None] / mu0) - np.exp(-grid.depth[:, None] / mu0)
    spread[..., :2, :] = 0.0
    spread[..., :2, 0] = beam[..., None] * degrees[:2]
    S = problem.coefficients[grid.layer][:, None] / degrees[:, None]
    a1, a2, a3, a4, b1, b2 = np.moveaxis(S, -1, 0)
    e1, e2, e3, e4, d1, d2 = np.moveaxis(spread, -1, 0)
    found = [a1 * e1 + b1 * d1, a2 * e2 + b1 * d1, a3 * e3 - b2 * d2, a4 * e4 - b2 * d2]
    crossed = [0.5 * (a1 * d1 + b1 * e2 + b1 * e1 + a2 * d1), 0.5 * (a3 * d2 + b2 * e4 + b2 * e3 + a4 * d2)]
    return np.stack([*found, *crossed], axis=-1)


def build_operators(problem: Problem, orders: range, to: Array, nodes: Array, members: list[int]) -> list[Array]:
    """albedo/2 times weights times A^m from the nodes, one a layer, (order, S n_from, S n_to)."""
    weights = np.concatenate([problem.weights, problem.weights])[:, None, None]
    found = []
    for albedo, coefficients in zip(problem.albedo, problem.coefficients, strict=True):
        matrices = np.array([_core.phase_matrices(m, coefficients, to, nodes) for m in orders])
        scaled = 0.5 * albedo * weights * matrices[..., members, :][..., members]  # (order, to, from, S, S)
        turned = scaled.transpose(0, 2, 4, 1, 3)
        found.append(turned.reshape(len(orders), nodes.size * len(members), to.size * len(members)))
    return found


def guess(
    problem: Problem, grid: Grid, moments: tuple[Array, Array], tables: Array, order: int, to: Array, members: list[int]
) -> Array:
    """The source of both parts towards the cosines ``to``, (n_in, n_col, D, n_to, S)."""
    shape = problem.mu0.size, problem.columns.shape[0], grid.depth.size, to.size, len(members)
    found = np.zeros(shape)
    strength = problem.albedo[grid.layer] / (4.0 * np.pi)
    left = _core.generalized_spherical_functions(order, tables.shape[2], to)
    for i, mu0 in enumerate(problem.mu0.tolist()):
        right = _core.generalized_spherical_functions(order, tables.shape[2], [mu0])[:, 0]
        if members == [0]:
            values = (tables[:, i, :, 0] * right[:, 0]) @ left[..., 0]
            found[i, ..., 0] = problem.columns[:, 0, None, None] * (strength[:, None] * values)
        else:
            for d in range(grid.depth.size):
                matrix = _core.phase_matrices(order, tables[d, i], to, [mu0])[:, 0]
                found[i, :, d] = strength[d] * np.einsum("oab,cb->coa", matrix, problem.columns)
    if order == 0:
        E_0, E_z = moments
        a1 = problem.coefficients[grid.layer, 1, 0] if problem.coefficients.shape[1] > 1 else np.zeros(grid.layer.size)
        regular = strength[:, None, None] * (E_0[..., None] + (a1[:, None] * E_z)[..., None] * to)  # (D, n_in, n_to)
        found[..., 0] += problem.columns[:, 0][:, None, None] * regular.transpose(1, 0, 2)[:, None]
    return found


def compute_beam_source(problem: Problem, grid: Grid, order: int, to: Array, members: list[int]) -> Array:
    """The direct beam's source, (n_in, n_col, D, n_to, S)."""
    fade = problem.albedo[grid.layer] / (4.0 * np.pi) * np.exp(-grid.depth / problem.mu0[:, None])  # (n_in, D)
    matrices = [
        _core.phase_matrices(order, each, to, problem.mu0.copy())[..., members, :] for each in problem.coefficients
    ]
    by_layer = np.einsum("koiab,cb->ickoa", np.array(matrices), problem.columns)
    found: Array = fade[:, None, :, None, None] * by_layer[:, :, grid.layer]
    return found


def scatter_field(grid: Grid, by_layer: list[Array], field: Array) -> Array:
    """The source of a field (order, n_in, n_col, D, n_node, S), by `operators`."""
    flat, size = field.reshape(*field.shape[:4], -1), field.shape[-1]
    found = [flat[:, :, :, grid.layer == k] @ operator[:, None, None] for k, operator in enumerate(by_layer)]
    joined = np.concatenate(found, axis=3)
    return joined.reshape(*joined.shape[:4], -1, size)


def sweep_light(grid: Grid, mu: Array, source: Array, base_light: Array) -> Array:
    """Light along mu (n_mu,), positive down, of a source (order, n_in, n_col, D, n_mu, S), linear between depths;
    ``base_light`` (n_in, n_col): I of order 0 that the base sends up. (2:25)-(2:26)."""
    step = np.maximum(np.diff(grid.depth), 0.0)[:, None] / np.abs(mu)
    step[np.diff(grid.layer) > 0] = 0.0
    fade, mean = np.exp(-step), np.where(step > 0.0, -np.expm1(-step) / np.where(step > 0.0, step, 1.0), 1.0)
    near, far = 1.0 - mean, mean - fade
    field = np.zeros_like(source)
    for downward, part in ((True, mu > 0.0), (False, mu < 0.0)):
        turn = slice(None) if downward else slice(None, None, -1)
        J = np.moveaxis(source[..., part, :], 3, 0)[turn]
        ways = [each[:, part, None][turn] for each in (near, far, fade)]
        light = np.zeros_like(J)
        if not downward:
            light[0, 0, ..., 0] = base_light[..., None]
        added = ways[0][:, None, None, None] * J[1:] + ways[1][:, None, None, None] * J[:-1]
        for d, kept in enumerate(ways[2]):
            np.multiply(kept, light[d], out=light[d + 1])
            light[d + 1] += added[d]
        field[..., part, :] = np.moveaxis(light[turn], 0, 3)
    return field


METHOD = Method(
    name=NAME,
    solve=solve_by_synthetic_iteration,
    purpose="light near the beam below layers with a strong forward peak; no quicker than discrete ordinates here",
    conserves="fluxes as the regular part does; the radiance does not sum to them",
    source="section 5, (2:4), (2:25)-(2:29)",
    conserves_energy=True,
    base="even",
    options=("nodes", "truncation", "backend"),
    settings={
        "regular": Setting(
            "two-stream",
            lambda value: check_choice(f"setting 'regular' of method {NAME!r}", value, REGULAR),
            "the method that finds the regular part",
        ),
        "iterations": Setting(
            1,
            lambda value: check_whole(f"setting 'iterations' of method {NAME!r}", value, 1, 1000),
            "of the source function; each beyond the first along nodes",
        ),
        "depths": Setting(
            32,
            lambda value: check_whole(f"setting 'depths' of method {NAME!r}", value, 2, 1000),
            "of the grid towards each face of a layer, where there is a grid",
        ),
    },
)
