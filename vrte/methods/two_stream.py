"""Discrete ordinates with one node, 4.1 of the second paper: one direction down, one up, at cosine 1/2.

One node carries two terms of the phase function and so two Fourier orders, each a pair of fluxes of its own. Other
directions come by integration of the source function along them, light scattered once with all terms in closed form.
"""

import numpy as np

from vrte.basics.errors import SceneError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.methods.parts.method import Answer, Task
from vrte.methods.parts.two_fluxes import (
    TwoFluxes,
    answer_two_fluxes,
    cut_to_two,
    list_asymmetries,
    put_on_one_node,
    solve_one_node,
)
from vrte.scene.boundary import Boundary

NODE, WEIGHT = 0.5, 1.0  # of Gauss's rule with one node on a hemisphere


def solve_by_two_streams(task: Task) -> Answer:
    """Orders 0 and 1; fluxes on the node. ``request.nodes`` says along which directions light is wanted by default."""
    problem = cut_to_two(task.request)
    return answer_two_fluxes(task, problem, solve_two_streams(problem, task.request.scene.below, task.run))


def solve_two_streams(problem: Problem, below: Boundary, run: Run) -> TwoFluxes:
    """The field of a problem cut to two terms. Raises SceneError where one node makes light grow with depth."""
    asymmetries = list_asymmetries(problem)
    one = put_on_one_node(problem, NODE, WEIGHT)
    matrices = assemble(one, np.arange(2 if asymmetries.any() else 1, dtype=np.int32), run)
    for g, albedo in zip(asymmetries.tolist(), problem.albedo.tolist(), strict=True):
        if 1.5 * albedo * g * (1.0 - NODE**2) > 1.0:  # E of order 1 below 0
            raise SceneError(
                f"method 'two-stream': on one node an asymmetry of {g:g} with an albedo of {albedo:g} makes light of "
                "order 1 from nothing (9/8 of their product is above 1): ask for truncation 'delta-m'"
            )
    return solve_one_node(one, matrices, expand_base(below, one, len(matrices.E)), run)
