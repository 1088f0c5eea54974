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
    with run.timed("doubling") as crew:
        run.kernels.double_slabs(
            crew,
            orders=orders,
            conserving=problem.conserves,
            clear=problem.skip_flags.clear,
            converged=problem.skip_flags.doublings,
            material=material,
            thickness=thickness,
            albedo=problem.albedo,
            asymmetry=find_asymmetry(problem),
            nodes=problem.nodes,
            weights=problem.weights,
            mu0=problem.mu0,
            columns=problem.columns,
            mu_out=problem.mu_out,
            E=matrices.E,
            F=matrices.F,
            G_E=matrices.G_E,
            G_F=matrices.G_F,
            source_s=matrices.source_s,
            source_d=matrices.source_d,
            R=slabs.R,
            T=slabs.T,
            lost=slabs.lost,
            residual=slabs.residual,
            doublings=slabs.doublings,
            info=info,
        )
    if info.any():
        order, slab = np.argwhere(info)[0]
        raise AccuracyError(f"a doubling step of order {orders[order]}, slab {slab + 1} is singular")
    return slabs


def find_asymmetry(problem: Problem) -> Array:
    """g of every material, (material,)."""
    several = problem.coefficients.shape[1] > 1
    return np.ascontiguousarray(problem.coefficients[:, 1, 0] / 3.0) if several else np.zeros_like(problem.albedo)
