"""Piles with interfaces for methods that find R and T of slabs: the joining is that of discrete ordinates."""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError
from vrte.discrete_ordinates.orders.base import UNTOLD
from vrte.discrete_ordinates.orders.problem import ALL
from vrte.discrete_ordinates.orders.refracting import Refracting, Responder
from vrte.discrete_ordinates.orders.responses import Response, shape_response
from vrte.methods.parts.adding import Slab
from vrte.methods.parts.on_nodes import OnNodes
from vrte.methods.parts.task import Task


def join_through_interfaces(task: Task, respond: Responder) -> tuple[Array, tuple[Array, Array]]:
    """Kernels of all Fourier orders (order, n_tau, n_in, n_col, n_out, 4) and fluxes up and down (n_tau, n_in, n_col):
    slabs as ``respond`` finds them, interfaces and mirrors as slabs without thickness between them. Raises
    AccuracyError where a joint is not solved."""
    problem, run = task.problem, task.run
    count = problem.coefficients.shape[1]
    route = Refracting(respond, problem, task.request.scene.below, count, UNTOLD)
    shape = problem.level.size, problem.mu0.size, problem.columns.shape[0]
    kernels = np.empty((count, *shape, problem.mu_out.size, len(ALL)))
    fluxes = np.zeros(shape), np.zeros(shape)
    for order in range(count):
        found = route.solve(np.array([order], np.int32), run)
        for name, residual in found.residuals.items():
            if not residual[0] <= route.allowed[name]:
                words = f"at order {order} the {name.replace('_', ' ')} is {residual[0]:.1e}"
                raise AccuracyError(f"method {task.request.method!r}: {words}: ask for 'discrete-ordinates'")
        kernels[order] = found.kernels[0]
        if order == 0:
            fluxes = found.flux_up, found.flux_down
        task.tell(order + 1, count)
    return kernels, fluxes


def respond_as_slab(on_nodes: OnNodes, slab: Slab) -> Response:
    """R and T of one order from those of a slab on nodes, with unit Stokes vectors as incident columns."""
    problem, n = on_nodes.problem, on_nodes.n
    scale = np.repeat(np.sqrt(problem.weights * problem.nodes), len(on_nodes.members))
    both = np.stack([slab.R, slab.T])[None]
    both[0, 1, np.arange(n), np.arange(n)] += slab.passed[:n]
    both[..., :n, :] *= scale[:, None]
    both[..., :n] /= scale
    onto, off = both[..., :n, :], both[..., n:, :]
    return shape_response(problem, onto[..., :n], onto[..., n:], off[..., :n], off[..., n:], {})
