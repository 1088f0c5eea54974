"""The way by modes: section 2.C of Collin, Pattanaik and Bouatouch, all stages for some Fourier orders."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from vrte import _core
from vrte.basics.arrays import BoolArray, IntArray
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.fused_modes import (
    Part,
    find_twins,
    make_orders,
    run_fused_modes,
    solve_by_modes,
    spread_over_scenes,
)
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import find_materials, merge_materials
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary

QUICK = 3e-12  # accuracy of the symmetric eigensolver on 16 nodes: ten times the largest error measured


def is_quick(problem: Problem, accuracy: float) -> bool:
    """Whether the symmetric eigensolver is accurate enough, where there is something symmetric."""
    return problem.skip_flags.symmetric and accuracy >= QUICK * max(1.0, problem.nodes.size / 16.0) ** 3.3


def count_repeats(twice: int, kind: str) -> list[tuple[str, str]]:
    """What a way says of so many layers or slabs that are solved once with others."""
    return [("repeats", f"{twice} {kind}{'s'[: twice > 1]}")] if twice else []


def solve_together(
    asked: Sequence[tuple[Problem, Boundary, IntArray, BoolArray | None]], accuracy: float, run: Run
) -> list[Orders]:
    """Orders for several sets of Stokes parameters, by one call: of each its problem, with the layers of all, the base
    and the orders; of many scenes those that are wanted (order, scene). Residuals are no numbers where a stage failed.
    """
    parts = []
    for problem, boundary, orders, wanted in asked:
        base = expand_base(boundary, problem, int(orders[-1]) + 1, accuracy)
        numbers, slab_stack = orders, np.zeros_like(orders)
        if wanted is not None:
            row, scene = np.nonzero(wanted)
            numbers, slab_stack = orders[row], scene.astype(np.int32)
        parts.append(Part(problem, numbers, slab_stack, base, base.find_rows(numbers, slab_stack)))
    first = asked[0][0]
    twin = find_twins(first) if first.scenes == 1 else np.arange(first.layers, dtype=np.int32)
    found = run_fused_modes(parts, is_quick(first, accuracy), run, twin)
    return [
        make_orders(each) if wanted is None else spread_over_scenes(part, orders, wanted, each)
        for part, each, (_, _, orders, wanted) in zip(parts, found, asked, strict=True)
    ]


class Modes:
    """Eigenmodes, beam, boundary, reconstruction: section 2.C of Collin, Pattanaik and Bouatouch."""

    name, other = "modes", "doubling"
    # residuals up to which the answer counts
    allowed: ClassVar = {"residual_of_modes": 1e-9, "residual_of_boundary": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.base = problem, expand_base(base, problem, n_order, accuracy)
        self.quick = is_quick(problem, accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(self.count_doubles(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        return solve_by_modes(self.problem, orders, self.base, self.quick, run)[0]

    @staticmethod
    def count_doubles(problem: Problem) -> tuple[float, float]:
        """Doubles of an order's arrays, and of a thread's scratch memory."""
        n, n_layer, n_rhs = problem.size, problem.albedo.size, problem.n_rhs
        out, into = problem.rows_out, len(problem.stokes) * problem.mu0.size
        materials, kinds = merge_materials(problem)
        per_order = float(materials.albedo.size) * n * (5 * n + 2 * out + 2 * into + 2 * n_rhs)
        per_order += n_layer * n * (2.0 * n_rhs if kinds is None else 2.0 * n + 2.0 * out + 4.0 * n_rhs)
        stages = "assemble", "homogeneous", "boundary", "reconstruct"
        scratch = [_core.count_scratch(name, **problem.sizes) for name in stages]
        return per_order, float(max(scratch))

    @staticmethod
    def list_left_out(problem: Problem, accuracy: float) -> list[tuple[str, str]]:
        """See `Way`."""
        materials, kinds = find_materials(problem)
        quick = problem.is_symmetric and is_quick(problem, accuracy)
        return [("symmetric", "{orders}")] * quick + count_repeats(kinds.size - len(materials), "layer")
