"""Invariant imbedding: reflection and transmission grown from the base up by the matrix Riccati equation, and the
algebraic one for a layer without end."""

from dataclasses import dataclass, field

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, check_number
from vrte.basics.blas import keep_to_one_thread
from vrte.discrete_ordinates.planning.needs import find_needs
from vrte.methods.parts.endless import compute_endless_reflection
from vrte.methods.parts.imbedding import POINTS, Count, State, grow
from vrte.methods.parts.method import Answer, Method, Setting
from vrte.methods.parts.on_nodes import OnNodes, find_distinct_directions, solve_in_turn
from vrte.methods.parts.task import Task

FINEST_RTOL = 1e-13
STEPS_TOGETHER = 100.0  # error of R and T over that of a step: 30 was seen


@dataclass(eq=False)
class Work:
    """What it took, over all orders."""

    riccati: Count = field(default_factory=Count)
    doublings: int = 0


def solve_by_invariant_imbedding(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn."""
    distinct, out = find_distinct_directions(task.problem)
    on_nodes = OnNodes(distinct, task.request.scene.below)
    work, at_bottom = Work(), task.request.tau > 0.0

    def field_of(order: int, base: Array) -> tuple[Array, Array]:
        light = solve_faces(on_nodes, order, base, bool(at_bottom.any()), task.settings["rtol"], work)
        up, down = (pair[at_bottom.astype(int), :, on_nodes.n :] for pair in light)
        return up, down

    with keep_to_one_thread():
        kernels, fluxes = solve_in_turn(task, on_nodes, out, field_of)
    more = {
        "steps": work.riccati.steps,
        "steps_repeated": work.riccati.repeated,
        "sweeps": work.riccati.sweeps,
        "doublings": work.doublings,
    }
    return task.answer_on_nodes(kernels, fluxes, **more)


def solve_faces(
    on_nodes: OnNodes, order: int, base: Array, through: bool, rtol: float, work: Work
) -> tuple[Array, Array]:
    """Light up and down at the top and the bottom of an order, each (2, r, c); ``through``: the bottom is wanted."""
    problem = on_nodes.problem
    scattered = [on_nodes.scattered(order, layer) for layer in range(problem.albedo.size)]
    layers = list(zip(scattered, problem.thickness.tolist(), strict=True))
    ground = base
    if np.isinf(layers[-1][1]):
        ground, doublings = compute_endless_reflection(
            on_nodes, layers.pop()[0], order == 0 and problem.albedo[-1] == 1.0
        )
        work.doublings = max(work.doublings, doublings)
    nothing = np.zeros_like(ground)
    state = State(np.stack([ground, nothing] if through else [ground]), np.ones(on_nodes.rows.size))
    for matrices, thickness in reversed(layers):
        state = grow(on_nodes, matrices, thickness, state, rtol, work.riccati)
    if not through:
        return np.stack([state.both[0], nothing]), np.stack([nothing, nothing])
    R, T = state.both
    passed = np.exp(-problem.thickness.sum() / on_nodes.columns)
    below = ground * passed + ground[:, : on_nodes.n] @ T[: on_nodes.n]
    return np.stack([R, below]), np.stack([nothing, T])


def predict_operations(task: Task) -> float:
    """Sweeps of all steps: their number grows with what an order scatters on its way."""
    problem = task.problem
    n, r, c = OnNodes(find_distinct_directions(problem)[0], task.request.scene.below).sizes
    finite = np.where(np.isfinite(problem.thickness), problem.thickness, 0.0)
    strength = np.minimum(find_needs(problem, task.run).by_layer, 1.0)  # (layer, order)
    steps = cost.LEAST_STEPS * problem.albedo.size + cost.STEPS_A_DEPTH * (finite @ strength)
    parts = 2.0 if (task.request.tau > 0.0).any() else 1.0
    sweep = POINTS * ((2.0 * n * n + 4.0 * parts * r * n) * c + 20.0 * parts * POINTS * r * c)
    return float(steps.sum()) * cost.SWEEPS * (sweep + 10.0 * cost.OVERHEAD)


METHOD = Method(
    name="invariant-imbedding",
    solve=solve_by_invariant_imbedding,
    purpose="layers without end, and layers that grow on a base; light at the two faces",
    conserves="flux to rtol; to rounding below a layer without end",
    source="dR/dtau as the thin layer of (2:8) on top; SDA for its algebraic form",
    depths=False,
    options=("nodes", "accuracy", "backend"),
    finest=1e-9,
    operations=predict_operations,
    settings={
        "rtol": Setting(
            1e-8,
            lambda value: check_number("rtol", value, FINEST_RTOL, 0.1, f"between {FINEST_RTOL:g} and 0.1"),
            "estimated error of a step in thickness, relative to the largest entry of R and of T",
            for_accuracy=lambda accuracy: max(accuracy / STEPS_TOGETHER, FINEST_RTOL),
        ),
    },
)
