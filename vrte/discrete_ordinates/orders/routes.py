"""The two exact routes from the discrete problem to its field, order by order, behind one signature."""

from functools import partial
from typing import ClassVar

import numpy as np

from vrte import _core
from vrte.basics.arrays import IntArray
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.boundary import solve_boundary
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.fused_modes import solve_fused_modes
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.invariance import find_flux_up, reflect_semi_infinite
from vrte.discrete_ordinates.orders.particular import copy_to_layers, find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import find_nodal_fluxes, reconstruct
from vrte.discrete_ordinates.orders.refracting import Refracting
from vrte.discrete_ordinates.orders.single_interface import SingleInterface, is_under_one_surface
from vrte.discrete_ordinates.orders.slab_response import respond
from vrte.discrete_ordinates.orders.slabs import cut_layers, find_materials, join_stack, merge_materials
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.orders.storage import (
    count_doubles_of_doubling,
    count_doubles_of_modes,
    count_doubles_of_scatterings,
)
from vrte.discrete_ordinates.orders.tanh_poles import find_fluxes, find_kernels, scatter_by_fractions
from vrte.scene.boundary import Boundary

QUICK = 3e-12  # accuracy of the symmetric eigensolver on 16 nodes: ten times the largest error measured
TIGHTER = 0.5  # iterations stop at this fraction of the requested accuracy


def is_quick(problem: Problem, accuracy: float) -> bool:
    """Whether the symmetric eigensolver is accurate enough, where there is something symmetric."""
    return problem.skip_flags.symmetric and is_quick_on(problem.nodes.size, accuracy)


def is_quick_on(nodes: int, accuracy: float) -> bool:
    """Whether the symmetric eigensolver is accurate enough on so many nodes."""
    return accuracy >= QUICK * max(1.0, nodes / 16.0) ** 3.3


class Modes:
    """Eigenmodes, beam, boundary, reconstruction: section 2.C of Collin, Pattanaik and Bouatouch."""

    name = "modes"
    # residuals up to which the answer counts
    allowed: ClassVar = {"residual_of_modes": 1e-9, "residual_of_boundary": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.base = problem, expand_base(base, problem, n_order, accuracy)
        self.distinct, self.kinds = merge_materials(problem)
        self.quick = is_quick(problem, accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(count_doubles_of_modes(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        if run.threads == 1 and run.kernels is _core and self.kinds is None and self.problem.is_exact:
            return solve_fused_modes(self.problem, orders, self.base, self.quick, run)
        matrices = assemble(self.distinct, orders, run)
        modes = find_modes(self.distinct, orders, matrices, run, self.quick)
        beam = find_beam_field(self.distinct, matrices, modes, run)
        if self.kinds is not None:
            matrices, modes, beam = copy_to_layers(self.kinds, matrices, modes, beam)
        amplitudes = solve_boundary(self.problem, orders, modes, beam, self.base, run)
        kernels = reconstruct(self.problem, orders, matrices, modes, beam, amplitudes, self.base, run)
        residuals = {
            "residual_of_modes": modes.residual.max(axis=1),
            "residual_of_boundary": amplitudes.residual.max(axis=1),
        }
        return Orders(kernels, *find_nodal_fluxes(self.problem, orders, modes, beam, amplitudes), residuals)


class Doubling:
    """Impedance doubling of homogeneous slabs, joined by the star product."""

    name = "doubling"
    allowed: ClassVar = {"residual_of_reflection": 1e-9, "residual_of_transmission": 1e-6, "residual_of_adding": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.slab_stack = cut_layers(problem)
        self.base = expand_base(base, self.slab_stack.problem, n_order, accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(count_doubles_of_doubling(self.slab_stack)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        slab_stack = self.slab_stack
        matrices = assemble(slab_stack.problem, orders, run)
        slabs = double_slabs(slab_stack.problem, slab_stack.material, slab_stack.thickness, orders, matrices, run)
        kernels, up, down, residual = join_stack(slab_stack, orders, slabs, self.base, run)
        worst = slabs.residual.max(axis=1)
        residuals = {
            "residual_of_reflection": worst[:, 0],
            "residual_of_transmission": worst[:, 1],
            "residual_of_adding": residual,
        }
        return Orders(kernels, up, down, residuals)


def find_allowed_residuals(accuracy: float) -> dict[str, float]:
    """Residuals up to which the answer of invariance counts."""
    return {"residual_of_invariance": max(1e-9, 2.0 * TIGHTER * accuracy)}


class Invariance:
    """Fixed points of the invariance equation: the top of a semi-infinite layer alone."""

    name = "invariance"

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.tolerance = problem, TIGHTER * accuracy
        self.allowed = find_allowed_residuals(accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once: all, their matrices are scratch memory."""
        return 1 << 20

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        found = reflect_semi_infinite(self.problem, orders, self.tolerance, run)
        up = find_flux_up(self.problem, found.on_nodes[0])
        up = np.broadcast_to(up, (self.problem.level.size, *up.shape[1:]))
        kernels = np.broadcast_to(found.kernels, (orders.size, self.problem.level.size, *found.kernels.shape[2:]))
        return Orders(kernels, up, np.zeros_like(up), {"residual_of_invariance": found.residual})


class Scatterings:
    """One slab over a black base, under a few beams, by successive scatterings (GMRES)."""

    name = "scatterings"
    allowed: ClassVar = {"residual_of_scatterings": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        self.problem, self.accuracy = problem, accuracy

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(count_doubles_of_scatterings(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        problem = self.problem
        faces = scatter_by_fractions(problem, orders, self.accuracy, run)
        residuals = {"residual_of_scatterings": faces.residual.max(axis=1)}
        return Orders(find_kernels(problem, faces), *find_fluxes(problem, orders, faces), residuals)


Route = Modes | Doubling | Invariance | Scatterings | Refracting | SingleInterface
ROUTES: dict[str, type[Modes] | type[Doubling] | type[Invariance] | type[Scatterings]] = {
    "modes": Modes,
    "doubling": Doubling,
    "invariance": Invariance,
    "scatterings": Scatterings,
}


def make_route(name: str, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> Route:
    """The named way through a problem, in one medium or in several."""
    if problem.media is not None:
        if name == "modes" and is_under_one_surface(problem.media):
            return SingleInterface(problem, base, n_order, accuracy, is_quick(problem, accuracy))
        slabs = partial(respond, name, quick=is_quick(problem, accuracy))
        return Refracting(slabs, problem, base, n_order, accuracy)
    return ROUTES[name](problem, base, n_order, accuracy)


OPAQUE = 80.0  # optical thickness whose half transmits less than the rounding of 1


def list_left_out(name: str, problem: Problem, accuracy: float) -> list[tuple[str, str]]:
    """What a route leaves out of the orders of a problem: the name of a switch, and the reason with {orders} in it."""
    if name == "invariance":
        return [("halves", "the other is its mirror image")]
    if name == "scatterings":
        return []
    if name == "doubling":
        slab_stack = cut_layers(problem)
        twice, kind = slab_stack.slabs.size - slab_stack.material.size, "slab"
        thick = (slab_stack.thickness > OPAQUE) & np.isfinite(slab_stack.thickness)
        found = [("doublings", "its transmission alone is squared")] if thick.any() else []
    else:
        materials, kinds = find_materials(problem)
        twice, kind = kinds.size - len(materials), "layer"
        quick = problem.is_symmetric and is_quick(problem, accuracy)
        found = [("symmetric", "{orders}")] if quick else []
    return [*found, *([("repeats", f"{twice} {kind}{'s'[: twice > 1]}")] if twice else [])]


OTHER = {"modes": "doubling", "doubling": "modes", "invariance": "doubling", "scatterings": "modes"}
