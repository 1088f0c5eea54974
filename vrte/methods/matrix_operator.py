"""The matrix operator method: R and T of slabs, (2:8), from the modes of the layer matrix, joined by adding.

The modes are those of discrete ordinates, of a slab lit along every node and by every beam. The transmission of a slab
that conserves light, which falls like 1/tau, is good to 1e-16 tau of itself.
"""

from functools import partial

from vrte.basics import cost
from vrte.discrete_ordinates.orders.responses import respond_by_beams
from vrte.discrete_ordinates.orders.slabs import cut_layers
from vrte.methods.parts.method import Answer, Method
from vrte.methods.parts.on_nodes import count_sizes
from vrte.methods.parts.slab import join_slabs
from vrte.methods.parts.task import Task


def solve_by_matrix_operators(task: Task) -> Answer:
    """Every Fourier order that the nodes carry, one after another."""
    return task.answer_on_nodes(*join_slabs(task, partial(respond_by_beams, "modes", quick=False)))


def predict_operations(task: Task) -> float:
    """Modes of each material, and each distinct slab lit along the nodes and by the beams."""
    problem = task.problem
    slabs = cut_layers(problem)
    n, r, c = count_sizes(task)
    modes = slabs.problem.albedo.size * cost.MODES_GENERAL * n**3
    return problem.coefficients.shape[1] * (modes + slabs.thickness.size * cost.RESPONSE * n * c * r)


METHOD = Method(
    name="matrix-operator",
    solve=solve_by_matrix_operators,
    purpose="slabs as matrices, to be joined and looked at; as exact as discrete ordinates on the same nodes",
    conserves="energy and reciprocity, to rounding",
    source="(2:6)-(2:9), (2:10)-(2:15)",
    conserves_energy=True,
    interfaces="smooth",
    options=("nodes", "accuracy", "backend"),
    finest=1e-12,
    operations=predict_operations,
)
