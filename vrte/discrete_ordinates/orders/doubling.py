"""Route 2, impedance doubling: reflection and transmission of homogeneous slabs without an eigenproblem."""

from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Slabs:
    """R, T (order, slab, blocks), see core/doubling.pxi; lost (order, slab, n); residual (order, slab, 2) of
    R and of T; doublings (order, slab)."""

    R: Array
    T: Array
    lost: Array
    residual: Array
    doublings: IntArray


def double_slabs(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, matrices: Assembled, run: Run
) -> Slabs:
    """R and T of every order and slab. Raises AccuracyError where a system is singular.

    ``problem``'s layers are the materials; material, thickness (slab,).
    """
    shape = (orders.size, max(1, material.size))
    size = _core.extended_size(problem.size, problem.n_rhs, problem.rows_out)
    slabs = Slabs(
        R=np.empty((*shape, size)),
        T=np.empty((*shape, size)),
        lost=np.empty((*shape, problem.size)),
        residual=np.zeros((*shape, 2)),
        doublings=np.zeros(shape, np.int32),
    )
    info = np.zeros(shape, np.int32)
    run.timed(
        "doubling",
        run.kernels.double_slabs,
        orders,
        problem.conserves,
        problem.leave_out.clear,
        problem.leave_out.doublings,
        material,
        thickness,
        problem.albedo,
        asymmetry_of(problem),
        problem.nodes,
        problem.weights,
        problem.mu0,
        problem.columns,
        problem.mu_out,
        matrices.E,
        matrices.F,
        matrices.G_E,
        matrices.G_F,
        matrices.source_s,
        matrices.source_d,
        slabs.R,
        slabs.T,
        slabs.lost,
        slabs.residual,
        slabs.doublings,
        info,
        run.threads,
        run.work(_core.doubling_work(problem.size, problem.n_rhs, problem.rows_out)),
        run.pivots(problem.size),
    )
    if info.any():
        order, slab = np.argwhere(info)[0]
        raise AccuracyError(f"a doubling step of order {orders[order]}, slab {slab + 1} is singular")
    return slabs


def asymmetry_of(problem: Problem) -> Array:
    """g of every material, (material,)."""
    several = problem.coefficients.shape[1] > 1
    return np.ascontiguousarray(problem.coefficients[:, 1, 0] / 3.0) if several else np.zeros_like(problem.albedo)
