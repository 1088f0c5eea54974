"""Route 2, impedance doubling: reflection and transmission of homogeneous slabs without an eigenproblem."""

from typing import ClassVar

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.modes import count_repeats
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import Slabs, cut_layers, join_stack
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary

OPAQUE = 80.0  # optical thickness whose half transmits less than the rounding of 1


def double_slabs(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, matrices: Assembled, run: Run
) -> Slabs:
    """R and T of every order and slab. Raises AccuracyError where a system is singular.

    ``problem``'s layers are the materials; material, thickness (slab,).
    """
    with run.timed("doubling") as crew:
        found = run.kernels.double_slabs(
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
            n_extended=_core.extended_size(problem.size, problem.n_rhs, problem.rows_out),
            **problem.slants,
        )
    info = found.pop("info")
    if info.any():
        order, slab = np.argwhere(info)[0]
        raise AccuracyError(f"a doubling step of order {orders[order]}, slab {slab + 1} is singular")
    return Slabs(**found)


def find_asymmetry(problem: Problem) -> Array:
    """g of every material, (material,)."""
    several = problem.coefficients.shape[1] > 1
    return np.ascontiguousarray(problem.coefficients[:, 1, 0] / 3.0) if several else np.zeros_like(problem.albedo)


class Doubling:
    """Impedance doubling of homogeneous slabs, joined by the star product."""

    name, other = "doubling", "modes"
    allowed: ClassVar = {"residual_of_reflection": 1e-9, "residual_of_transmission": 1e-6, "residual_of_adding": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.slab_stack = problem, cut_layers(problem)
        self.base = expand_base(base, self.slab_stack.problem, n_order, accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(self.count_doubles(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        slab_stack = self.slab_stack
        matrices = assemble(slab_stack.problem, orders, run)
        slabs = double_slabs(slab_stack.problem, slab_stack.material, slab_stack.thickness, orders, matrices, run)
        kernels, up, down, residual = join_stack(slab_stack, orders, slabs, self.base, run)
        worst = slabs.residual.max(axis=1, initial=0.0)  # there may be no slab
        residuals = {
            "residual_of_reflection": worst[:, 0],
            "residual_of_transmission": worst[:, 1],
            "residual_of_adding": residual,
        }
        return Orders(kernels, up, down, residuals)

    @staticmethod
    def count_doubles(problem: Problem) -> tuple[float, float]:
        """Doubles of an order's arrays, and of a thread's scratch memory."""
        slab_stack = cut_layers(problem)
        problem = slab_stack.problem
        n, n_rhs, out, into = problem.size, problem.n_rhs, problem.rows_out, len(problem.stokes) * problem.mu0.size
        per_order = (
            2.0 * problem.albedo.size * n * (n + out + into)
            + 2.0 * max(1, slab_stack.material.size) * _core.extended_size(n, n_rhs, out)
            + 2.0 * slab_stack.interface.size * n_rhs * out
        )
        scratch = (
            _core.count_scratch("assemble", **problem.sizes),
            _core.count_scratch("double_slabs", **problem.sizes),
            _core.count_scratch("join_slabs", **problem.sizes, n_place=slab_stack.slabs.size),
        )
        return per_order, float(max(scratch))

    @staticmethod
    def list_left_out(problem: Problem, accuracy: float) -> list[tuple[str, str]]:
        """See `Way`."""
        slab_stack = cut_layers(problem)
        thick = ((slab_stack.thickness > OPAQUE) & np.isfinite(slab_stack.thickness)).any()
        squared = [("doublings", "its transmission alone is squared")] * bool(thick)
        return squared + count_repeats(slab_stack.slabs.size - slab_stack.material.size, "slab")
