"""The matrix operator method: R and T of slabs, (2:8), from the modes of the layer matrix, joined by adding.

The modes are those of discrete ordinates, of a slab lit along every node and by every beam. The transmission of a slab
that conserves light, which falls like 1/tau, is good to 1e-16 tau of itself.
"""

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
from vrte.methods.parts.method import NODES, Answer, Task
from vrte.methods.parts.slab import count_sizes, join_slabs
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
    if scene.keeps_beams:
        raise SceneError("the propagator (2:9) is that of layers in one medium, without interfaces")
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


def predict_operations(task: Task) -> float:
    """Modes of each material, and each distinct slab lit along the nodes and by the beams."""
    problem = task.problem
    slabs = cut_layers(problem)
    n, r, c = count_sizes(task.request, task.problem)
    modes = slabs.problem.albedo.size * cost.MODES_GENERAL * n**3
    return problem.coefficients.shape[1] * (modes + slabs.thickness.size * cost.RESPONSE * n * c * r)
