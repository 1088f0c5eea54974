"""Reflection of a semi-infinite layer by invariance: Ambarzumian's functions as matrices, without an eigenproblem."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Reflected:
    """kernels (order, 1, n_in, n_col, n_out, S), public frame; on_nodes (order, n_in n_col, n); residual, steps
    (order,)."""

    kernels: Array
    on_nodes: Array
    residual: Array
    steps: IntArray


def reflect_semi_infinite(problem: Problem, orders: IntArray, tolerance: float, run: Run) -> Reflected:
    """What the first layer of a problem, taken as semi-infinite, sends back in each order."""
    off, indices = problem.off_nodes
    n_out, n_in, n_col = problem.mu_out.size, problem.mu0.size, problem.columns.shape[0]
    stokes, terms = len(problem.stokes), int(problem.terms[0])
    up = np.empty((orders.size, n_in, n_col, stokes * n_out))
    found = Reflected(
        kernels=up.reshape(orders.size, 1, n_in, n_col, n_out, stokes),
        on_nodes=np.empty((orders.size, n_in * n_col, problem.size)),
        residual=np.empty(orders.size),
        steps=np.empty(orders.size, np.int32),
    )
    with run.timed("invariance") as crew:
        run.kernels.reflect_semi_infinite(
            crew,
            orders=orders,
            members=np.array(problem.stokes, np.int32),
            coefficients=problem.coefficients[0],
            terms=terms,
            albedo=float(problem.albedo[0]),
            directions=np.concatenate([problem.nodes, off]),
            weights=problem.weights,
            out=indices[:n_out],
            into=indices[n_out:],
            columns=problem.columns,
            tolerance=tolerance,
            halves=problem.skip_flags.halves,
            up=up,
            on_nodes=found.on_nodes,
            residual=found.residual,
            steps=found.steps,
        )
    found.kernels[..., : problem.n_up, :] *= problem.flip / (2.0 * np.pi)
    found.kernels[..., problem.n_up :, :] = 0.0  # nothing comes down upon the top
    return found


def find_flux_up(problem: Problem, on_nodes: Array) -> Array:
    """Diffuse flux up through the top, from order 0's field on the nodes: (1, n_in, n_col)."""
    n_in, n_col = problem.mu0.size, problem.columns.shape[0]
    if not problem.conserves:
        return np.zeros((1, n_in, n_col))
    flux: Array = on_nodes[:, :: len(problem.stokes)] @ np.sqrt(problem.weights * problem.nodes)
    return flux.reshape(1, n_in, n_col)
