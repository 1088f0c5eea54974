"""Synthetic iteration, section 5 of the second paper: a guess of the field, then its source function along each ray.

The guess has an anisotropic part, the beam as it spreads by small angles, and a regular part of which another method
says how much light goes down and up at each depth. One iteration scatters this guess once more towards the wanted
directions alone: in closed form where the regular part is. Further ones scatter along nodes first, orders and depths
at Gauss depths, by the whole phase matrices as delta-M leaves them. Q, U and V come from the anisotropic part and from
these further iterations: the regular part is that of light without polarization.
"""

from dataclasses import replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.errors import SceneError
from vrte.basics.running import Run, keep_to_one_thread
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import find_peak_flux
from vrte.methods import solve_request
from vrte.methods.closed_forms import expand_diffuse_part
from vrte.methods.parts.method import Answer, Task, discretise_request
from vrte.methods.parts.sections import POINTS, Order, Section, Sections
from vrte.methods.parts.slab import connect_media
from vrte.methods.two_fluxes import (
    BOUNDARIES,
    TwoFluxes,
    convert_to_kernels,
    cut_to_two,
    solve_diffusion,
    solve_two_streams,
)
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.scene.scene import Scene

NAME, CLOSED = "synthetic-iteration", ("two-stream", "diffusion")
NODES = 8  # of a hemisphere, where none are asked for


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
    """Diffuse fluxes down and up of I for unit beams, (n_tau, n_in), less the peaks of delta-M for two terms."""
    request = replace(request, tau=tau, mu=np.ones(1), columns=np.array([[1.0, 0.0, 0.0, 0.0]]))
    if regular in CLOSED:
        found = solve_closed_form(regular, request, run)
        return found.down, found.up
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
    solution = solve_request(asked, replace(run, stages={}))[1]
    peaks = find_peak_flux(cut_to_two(request), tau)[1, ..., 0]
    return solution.flux_down[..., 0] - peaks, solution.flux_up[..., 0]


def remove_polarization(scene: Scene) -> Scene:
    """The scene with a1 alone."""
    if all(layer.phase_matrix.is_scalar for layer in scene.layers):
        return scene
    a1 = (PhaseMatrix(layer.phase_matrix.a1, tolerance=layer.phase_matrix.tolerance) for layer in scene.layers)
    return Scene(
        [replace(layer, phase_matrix=matrix) for layer, matrix in zip(scene.layers, a1, strict=True)], scene.base
    )


@record
class Guess:
    """Both parts at the Gauss depths (D,) of all panels: albedo, a1 of degree 1; E_0 and E_z of the regular part (D,
    n_in); ``tables`` (D, n_in, terms, 6) of the anisotropic part about the beam; ``arriving`` flux (n_in,) at the
    base."""

    stack: Sections
    albedo: Array
    a1: Array
    E_0: Array
    E_z: Array
    tables: Array
    arriving: Array

    def find_source(self, order: int, section: Section, rows: slice) -> Array:
        """The source over mu, down and up, (2, panel, POINTS, rows, b), towards some rows of a section."""
        problem, stokes = self.stack.beam_paths.problem, list(self.stack.beam_paths.problem.stokes)
        mu = section.on_nodes.rows[rows][:: len(stokes)]
        to, here = np.concatenate([mu, -mu]), slice(POINTS * section.panels.start, POINTS * section.panels.stop)
        tables = self.tables[here]
        found = np.zeros((len(tables), 2 * mu.size, len(stokes), problem.mu0.size, problem.columns.shape[0]))
        left = _core.generalized_spherical_functions(order, tables.shape[2], to)[..., 0]
        for i, mu0 in enumerate(problem.mu0.tolist()):
            if stokes == [0]:
                right = _core.generalized_spherical_functions(order, tables.shape[2], [mu0])[:, 0, 0]
                values = (tables[:, i, :, 0] * right) @ left
                found[:, :, 0, i] = values[..., None] * problem.columns[:, 0]
                continue
            for d, table in enumerate(tables[:, i]):
                matrix = _core.phase_matrices(order, table, to, [mu0])[:, 0]
                found[d, :, :, i] = np.einsum("oab,cb->oac", matrix, problem.columns)
        if order == 0:
            E_0, E_z, a1 = self.E_0[here, None], self.E_z[here, None], self.a1[here, None, None]
            regular = E_0 + a1 * E_z * to[:, None]  # (D, to, n_in)
            found[:, :, 0] += regular[..., None] * problem.columns[:, 0]
        found *= 0.5 * self.albedo[here, None, None, None, None] / np.abs(to)[:, None, None, None]
        found[:, mu.size :] *= problem.flip[:, None, None]
        halves = found.reshape(-1, POINTS, 2, mu.size * len(stokes), problem.n_rhs)
        return np.moveaxis(halves, 2, 0)

    def find_arriving(self, order: int) -> Array:
        """Light of the regular part on the nodes at the base, (n, b)."""
        problem = self.stack.beam_paths.problem
        found = np.zeros((problem.size, problem.mu0.size, problem.columns.shape[0]))
        if order == 0:
            found[:: len(problem.stokes)] = 2.0 * self.arriving[:, None] * problem.columns[:, 0]
        return found.reshape(problem.size, -1)


def make_guess(request: Request, stack: Sections, regular: str, run: Run) -> Guess:
    """Both parts at the depths of a stack."""
    problem = stack.beam_paths.problem
    layer = np.repeat([each.layer for each in stack.sections], [each.depths.size for each in stack.sections])
    begin = [float(stack.beam_paths.cut.thickness[: each.place].sum()) for each in stack.sections]
    depth = np.concatenate([top + each.depths.ravel() for top, each in zip(begin, stack.sections, strict=True)])
    layers = request.scene.layers
    tops = np.cumsum([0.0, *(each.thickness for each in layers)])
    stretch = 1.0 - np.array([each.albedo for each in layers]) * problem.fraction
    tau = np.clip(tops[layer] + (depth - problem.above[layer]) / stretch[layer], tops[layer], tops[layer + 1])
    levels, at = np.unique(np.append(tau, request.scene.thickness), return_inverse=True)
    down, up = (flux[at] for flux in compute_regular_fluxes(regular, request, levels, run))
    a1 = problem.coefficients[layer, 1, 0] if problem.coefficients.shape[1] > 1 else np.zeros(layer.size)
    tables = compute_anisotropic_tables(request, problem, layer, tau, depth)
    return Guess(stack, problem.albedo[layer], a1, 2.0 * (down + up)[:-1], (down - up)[:-1], tables, down[-1])


def iterate_field(task: Task, request: Request, problem: Problem) -> Array:
    """Multiply scattered light of the problem's orders, (order, n_tau, n_in, n_col, n_out, 4)."""
    regular, iterations, depths = (task.settings[name] for name in ("regular", "iterations", "depths"))
    if not np.isfinite(request.scene.thickness):
        raise SceneError(
            f"method {NAME!r} needs layers that end, but for one iteration with regular 'two-stream' or 'diffusion'"
        )
    problem = connect_media(request, problem)
    stack = Sections(problem, request.scene.below, depths)
    guess = make_guess(request, stack, regular, task.run)
    sights = [(each, slice(each.on_nodes.n, None), each.along_sights) for each in stack.sections]
    nodes = [(each, slice(0, each.on_nodes.n), each.along_nodes) for each in stack.sections]

    def solve(m: int) -> Array:
        arriving = guess.find_arriving(m)
        made = {
            each.place: paths.carry(*guess.find_source(m, each, rows))
            for each, rows, paths in (sights if iterations == 1 else nodes)
        }
        if iterations == 1:
            return stack.look(m, {index: faces for index, (_, faces) in made.items()}, arriving)
        order = Order(stack, m)
        field = stack.carry(made, order.reflect(arriving)) + order.once
        for _ in range(iterations - 2):
            field = order.scatter(field) + order.once
        return order.view(field)

    return task.solve_orders(problem, solve)


def compute_anisotropic_tables(request: Request, problem: Problem, layer: IntArray, tau: Array, depth: Array) -> Array:
    """Coefficients of the source of the anisotropic part about the beam, (D, n_in, terms, 6), at depths (D,) of layers:
    spread light less the truncated direct beam; of degrees 0, 1 only what delta-M takes off for two terms."""
    terms, mu0 = problem.coefficients.shape[1], problem.mu0
    degrees = 2.0 * np.arange(terms) + 1.0
    whole = replace(request, tau=tau)
    plain = discretise_scene(request.scene, mu0, request.columns, np.ones(1), tau, 1)
    spread = expand_diffuse_part(request.scene, plain)[:, :, :terms]
    spread = np.pad(spread, ((0, 0), (0, 0), (0, terms - spread.shape[2]), (0, 0)))
    direct = np.exp(-depth[:, None] / mu0)
    lost = ((np.exp(-tau[:, None] / mu0) - direct)[..., None] * degrees)[..., None]
    spread[..., : 1 if problem.is_scalar else 4] += lost
    beam = np.exp(-cut_to_two(whole).depth[:, None] / mu0) - direct
    spread[..., :2, :] = 0.0
    spread[..., :2, 0] = beam[..., None] * degrees[:2]
    S = problem.coefficients[layer][:, None] / degrees[:, None]
    a1, a2, a3, a4, b1, b2 = np.moveaxis(S, -1, 0)
    e1, e2, e3, e4, d1, d2 = np.moveaxis(spread, -1, 0)
    found = [a1 * e1 + b1 * d1, a2 * e2 + b1 * d1, a3 * e3 - b2 * d2, a4 * e4 - b2 * d2]
    crossed = [0.5 * (a1 * d1 + b1 * e2 + b1 * e1 + a2 * d1), 0.5 * (a3 * d2 + b2 * e4 + b2 * e3 + a4 * d2)]
    return np.stack([*found, *crossed], axis=-1)
