"""How the light of a semi-infinite layer changes with its scattering: the invariance equation, linearized, without an
eigenproblem (core/invariance_change.pxi)."""

from collections.abc import Sequence

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.slab_stack import ChangedOrders
from vrte.discrete_ordinates.orders.invariance import TIGHTER, find_flux_up, list_arguments, recall_reflections
from vrte.discrete_ordinates.orders.problem import Problem


def change_semi_infinite(
    problem: Problem, tables: Sequence[Array], orders: IntArray, accuracy: float, run: Run
) -> ChangedOrders:
    """Derivatives of the given orders with albedo times coefficients, each table (term, 6) a change of these; residual
    (order,): what the fixed points miss."""
    shape = len(tables), orders.size, 1, problem.mu0.size, problem.columns.shape[0], problem.mu_out.size, -1
    with run.timed("derivatives") as crew:
        asked = list_arguments(problem, orders, TIGHTER * accuracy)
        asked |= recall_reflections(run.kept, asked)
        found = _core.change_semi_infinite(crew, columns=problem.columns, changes=np.stack(tables), **asked)
    kernels = found["up"].reshape(shape)
    kernels[..., : problem.n_up, :] *= problem.flip / (2.0 * np.pi)
    kernels[..., problem.n_up :, :] = 0.0
    up = np.stack([find_flux_up(problem, each[0]) for each in found["on_nodes"]])
    levels = problem.level.size
    flux = np.zeros((len(tables), 2, levels, *up.shape[2:]))
    flux[:, 0] = up
    return ChangedOrders(np.repeat(kernels, levels, axis=2), flux, found["residual"])


def pull_semi_infinite(
    problem: Problem, weights: Array, orders: IntArray, accuracy: float, run: Run
) -> tuple[Array, Array]:
    """From what radiances weigh, times 2 pi and flipped, for unit Stokes vectors, (order, n_in S, n_out S), the
    derivatives with albedo times coefficients, (order, term, 6), and what the fixed points miss, (order,)."""
    with run.timed("derivatives") as crew:
        asked = list_arguments(problem, orders, TIGHTER * accuracy)
        asked |= recall_reflections(run.kept, asked)
        found = _core.pull_semi_infinite(crew, pull_weights=np.ascontiguousarray(weights), **asked)
    return found["gradient"], found["residual"]
