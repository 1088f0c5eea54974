"""Invariant imbedding: reflection and transmission of layers that grow in thickness by the matrix Riccati equation, and
by its algebraic form of semi-infinite layers."""

from dataclasses import replace

import numpy as np

from vrte.basics import cost
from vrte.discrete_ordinates.planning.order_bounds import find_order_bounds
from vrte.methods.parts.method import Answer, Task
from vrte.methods.parts.slab import (
    STEP_POINTS,
    OnNodes,
    Scattered,
    Slab,
    count_sizes,
    grow_slab,
    reflect_semi_infinite,
    solve_by_slabs,
)

FINEST_RTOL = 1e-13
STEPS_TOGETHER = 100.0  # error of R and T over that of a step: 30 was seen
BY_ACCURACY = {"rtol": lambda accuracy: max(accuracy / STEPS_TOGETHER, FINEST_RTOL)}


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


def predict_operations(task: Task) -> float:
    """Sweeps of all steps: their number grows with what an order scatters on its way."""
    problem = task.problem
    n, r, c = count_sizes(task.request, task.problem)
    finite = np.where(np.isfinite(problem.thickness), problem.thickness, 0.0)
    strength = np.minimum(find_order_bounds(problem, task.run)[0].by_layer, 1.0)  # (layer, order)
    steps = cost.LEAST_STEPS * problem.albedo.size + cost.STEPS_A_DEPTH * (finite @ strength)
    sweep = STEP_POINTS * ((2.0 * n * n + 8.0 * r * n) * c + 40.0 * STEP_POINTS * r * c)
    return float(steps.sum()) * cost.SWEEPS * (sweep + 10.0 * cost.OVERHEAD)
