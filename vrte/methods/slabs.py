"""Methods that add R and T of slabs, (2:5)-(2:8).

Matrix operators: R and T from the modes of the layer matrix, those of discrete ordinates, of a slab lit along every
node and by every beam; the transmission of a slab that conserves light, which falls like 1/tau, is good to 1e-16 tau of
itself. Adding and doubling: slabs doubled from a thin layer. Invariant imbedding: layers that grow in thickness by the
matrix Riccati equation, and semi-infinite layers by its algebraic form.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.slab_response import respond_by_modes
from vrte.discrete_ordinates.orders.slabs import cut_layers
from vrte.discrete_ordinates.planning.order_bounds import find_order_bounds
from vrte.methods.parts.method import NODES, Answer, Task
from vrte.methods.parts.slab import (
    STEP_POINTS,
    OnNodes,
    Scattered,
    Slab,
    connect_media,
    count_sizes,
    grow_slab,
    join_slabs,
    make_thin_slab,
    reflect_semi_infinite,
    solve_by_slabs,
)
from vrte.request.how import MOST_NODES
from vrte.request.request import check_scene
from vrte.scene.scene import Scene

LARGEST_CONDITION = 1e8  # of T_minus, for the propagator


def solve_by_matrix_operators(task: Task) -> Answer:
    """Every Fourier order that the nodes carry in turn: R and T of (2:5)-(2:8) from beams along the nodes."""
    return task.answer_on_nodes(*join_slabs(task, partial(respond_by_modes, quick=False)))


def propagator(scene: Scene, order: int = 0, nodes: int = NODES) -> Array:
    """The matrix of (2:9) that takes a Fourier order's radiance at the top of a scene to that at its bottom, public
    frame: (2, nodes, 4, 2, nodes, 4), hemisphere (0: up, 1: down), node and Stokes parameter at the bottom, then at the
    top. Raises AccuracyError where T_minus of (2:8), scaled by sqrt(weight mu), has a condition number above 1e8, and
    SceneError for a base, a semi-infinite layer, interfaces or bad input.

    >>> from vrte import Layer, Scene, isotropic
    >>> propagator(Scene([Layer(isotropic(), albedo=0.5, thickness=0.01)]), nodes=2).shape
    (2, 2, 4, 2, 2, 4)
    """
    scene = check_scene(scene)
    order, nodes = check_whole("order", order, 0, 2 * MOST_NODES), check_whole("nodes", nodes, 1, MOST_NODES)
    if scene.base is not None or np.isinf(scene.thickness):
        raise SceneError("the propagator (2:9) is that of layers which end, without a base")
    if scene.needs_beam_paths:
        raise SceneError("the propagator (2:9) is that of layers in one medium, without interfaces")
    if scene.has_flakes:
        raise SceneError("the propagator (2:9) is that of particles: a layer has oriented flakes")
    problem = discretise_scene(scene, np.ones(1), np.eye(4), np.ones(1), np.zeros(1), nodes)
    one = np.eye(problem.size)
    R_minus, T_minus, R_plus, T_plus = 0.0 * one, one, 0.0 * one, one
    layers = np.arange(problem.albedo.size, dtype=np.int32)
    slabs = respond_by_modes(problem, layers, problem.thickness, np.array([order], np.int32), Run(1), quick=False)
    for R, T in slabs.nodes[:, 0]:
        down, up = np.linalg.solve(one - R_plus @ R, T_plus), np.linalg.solve(one - R @ R_plus, T)
        R_minus, T_minus = R_minus + T_minus @ R @ down, T_minus @ up
        R_plus, T_plus = R + T @ R_plus @ up, T @ down
    condition = np.linalg.cond(T_minus)
    if not condition <= LARGEST_CONDITION:
        raise AccuracyError(
            f"the propagator (2:9) of this scene is of no use: the condition number of T_minus is {condition:.1e}, "
            f"above {LARGEST_CONDITION:.0e}; R and T of (2:8), method 'matrix-operator', have no such limit"
        )
    up = np.linalg.solve(T_minus, np.concatenate([one, -R_minus], axis=1))
    down = R_plus @ up
    down[:, problem.size :] += T_plus
    scale = np.repeat(np.sqrt(problem.weights * problem.nodes), 4)
    frame = np.concatenate([np.tile(FLIP, nodes) / scale, 1.0 / scale])
    whole_matrix: Array = np.concatenate([up, down]) * frame[:, None] / frame
    return whole_matrix.reshape(2, nodes, 4, 2, nodes, 4)


def predict_responses(task: Task) -> float:
    """Operations of the modes of each material, and of the light of nodes and beams in each distinct slab."""
    problem = task.problem
    slabs = cut_layers(problem)
    n, r, c = count_sizes(task.request, task.problem)
    modes = slabs.problem.albedo.size * cost.MODES_GENERAL * n**3
    return problem.coefficients.shape[1] * (modes + slabs.thickness.size * cost.RESPONSE * n * c * r)


LOWEST = 1e-4  # cosine: below it starting layers are so thin that rounding is seen
DARK = 1e-16  # transmission of a slab that may as well be semi-infinite
NEARLY_DARK = 1e-6  # transmission of a white slab whose R lacks of the semi-infinite layer's just what it transmits
MOST_DOUBLINGS = 70
ENOUGH = 1e-3, 1e-6, 1e-10  # accuracy that 1, 2 and 3 depths of a starting layer of 0.25 keep: a tenth and less is seen
BY_ACCURACY = {  # settings, by the accuracy asked for
    "start": lambda accuracy: 1 + sum(accuracy < limit for limit in ENOUGH),
    "rtol": lambda accuracy: max(accuracy / STEPS_TOGETHER, FINEST_RTOL),
}


def solve_by_adding_doubling(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn."""
    doublings: list[int] = []

    def build(on_nodes: OnNodes, scattered: Scattered, tau: float, conserves: bool) -> Slab:
        thin = limit_starting_thickness(on_nodes, task.settings["thin"])
        slab, done = build_slab(on_nodes, scattered, tau, thin, task.settings["start"], conserves)
        doublings.append(done)
        return slab

    mu, found = solve_by_slabs(task, build, "doubling")
    return mu, replace(found, diagnostics=found.diagnostics | {"doublings": max(doublings, default=0)})


def limit_starting_thickness(on_nodes: OnNodes, thin: float) -> float:
    """Optical thickness of the starting layer: ``thin`` along the lowest cosine, of exit too where light is
    mirrored."""
    media = on_nodes.problem.media
    mirrors = media is not None and media.scene.needs_beam_paths
    lowest = min(float(on_nodes.columns.min()), float(on_nodes.rows.min()) if mirrors else math.inf)
    return thin * max(LOWEST, lowest)


def count_doublings(tau: float, thin: float) -> int:
    """How often a starting layer of an optical thickness of at most ``thin`` is doubled, or is at most."""
    if math.isinf(tau):
        return MOST_DOUBLINGS
    return max(0, math.ceil(math.log2(tau / thin))) if tau > 0.0 else 0


def build_slab(
    on_nodes: OnNodes, scattered: Scattered, tau: float, thin: float, start: int, conserves: bool
) -> tuple[Slab, int]:
    """A slab doubled from at most ``thin``, and how often; a semi-infinite one until nothing comes through."""
    most = count_doublings(tau, thin)
    slab = make_thin_slab(on_nodes, scattered, thin if math.isinf(tau) else tau / 2.0**most, start)
    for done in range(most + 1):
        slab = balance_flux(slab) if conserves else slab
        if math.isinf(tau):
            through = float(np.abs(slab.T).max())
            if conserves and through < NEARLY_DARK:
                return Slab(on_nodes, tau, slab.R + slab.T, np.zeros_like(slab.T)), done
            if max(through, math.exp(-slab.tau / float(on_nodes.problem.nodes.max()))) < DARK:
                return Slab(on_nodes, tau, slab.R, slab.T), done
        slab = slab.double() if done < most else slab
    return slab, most


def balance_flux(slab: Slab) -> Slab:
    """A white slab whose flux out is the flux in, exactly: what doubling misses is transmitted, evenly; the row weight
    mu of I is then a left eigenvector of R + T."""
    on_nodes, problem = slab.on_nodes, slab.on_nodes.problem
    stokes = len(problem.stokes)
    row, evenly = np.zeros(on_nodes.n), np.zeros(on_nodes.rows.size)
    row[::stokes] = problem.weights * problem.nodes
    evenly[::stokes] = 1.0 / row.sum()
    into = np.concatenate([row, np.outer(problem.mu0, problem.columns[:, 0]).ravel()])
    missing = into * -np.expm1(-slab.tau / on_nodes.columns) - row @ (slab.R + slab.T)[: on_nodes.n]
    return Slab(on_nodes, slab.tau, slab.R, slab.T + np.outer(evenly, missing))


def predict_doubling(task: Task) -> float:
    """Operations of the doublings of each distinct slab, of its starting layer, and of adding the slabs."""
    problem, settings = connect_media(task.request, task.problem), task.settings
    slabs, on_nodes = cut_layers(task.problem), OnNodes(problem)
    n, r, c = count_sizes(task.request, task.problem)
    thin = limit_starting_thickness(on_nodes, settings["thin"])
    doublings = sum(
        cost.SLAB_STEPS_ENDLESS if math.isinf(tau) else count_doublings(tau, thin)
        for tau in np.unique(slabs.thickness).tolist()
    )
    start = (2.0 * settings["start"] * n) ** 2 * (settings["start"] * n + 2.0 * c)
    each = slabs.slabs.size * (start + 40.0 * r * n * c) + doublings * (12.0 * r * n * c + cost.A_DOUBLING)
    return problem.coefficients.shape[1] * each


FINEST_RTOL = 1e-13
STEPS_TOGETHER = 100.0  # error of R and T over that of a step: 30 was seen


def solve_by_invariant_imbedding(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn."""
    count = dict.fromkeys(("steps", "steps_repeated", "sweeps", "doublings"), 0)

    def build(on_nodes: OnNodes, scattered: Scattered, tau: float, conserves: bool) -> Slab:
        if np.isfinite(tau):
            return grow_slab(on_nodes, scattered, tau, task.settings["rtol"], count)
        slab, doublings = reflect_semi_infinite(on_nodes, scattered, conserves)
        count["doublings"] = max(count["doublings"], doublings)
        return slab

    mu, found = solve_by_slabs(task, build, "invariant imbedding")
    return mu, replace(found, diagnostics=found.diagnostics | count)


def predict_imbedding(task: Task) -> float:
    """Operations of the sweeps of all steps; a Fourier order that scatters more needs more steps."""
    problem = task.problem
    n, r, c = count_sizes(task.request, task.problem)
    finite = np.where(np.isfinite(problem.thickness), problem.thickness, 0.0)
    strength = np.minimum(find_order_bounds(problem, task.run)[0].by_layer, 1.0)  # (layer, order)
    steps = cost.LEAST_STEPS * problem.albedo.size + cost.STEPS_A_DEPTH * (finite @ strength)
    sweep = STEP_POINTS * ((2.0 * n * n + 8.0 * r * n) * c + 40.0 * STEP_POINTS * r * c)
    return float(steps.sum()) * cost.SWEEPS * (sweep + 10.0 * cost.OVERHEAD)
