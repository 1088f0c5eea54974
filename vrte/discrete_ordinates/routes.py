"""The two exact routes from the discrete problem to its field, order by order, behind one signature."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.base import expand_base
from vrte.discrete_ordinates.blocks import Base
from vrte.discrete_ordinates.boundary import boundary
from vrte.discrete_ordinates.doubling import double_slabs
from vrte.discrete_ordinates.homogeneous import homogeneous
from vrte.discrete_ordinates.invariance import flux_up, reflect_endless
from vrte.discrete_ordinates.memory import doubles_of_doubling, doubles_of_modes, orders_at_once
from vrte.discrete_ordinates.particular import particular
from vrte.discrete_ordinates.phase_assembly import assemble
from vrte.discrete_ordinates.problem import IntArray, Problem, Run
from vrte.discrete_ordinates.reconstruction import nodal_fluxes, reconstruct
from vrte.discrete_ordinates.slabs import cut, join

QUICK = 3e-12  # accuracy that the symmetric eigensolver is good for on 16 nodes; ten times the largest error measured
TIGHTER = 0.5  # of the accuracy asked for: where iterations stop


@dataclass(frozen=True, eq=False)
class Orders:
    """Multiply scattered light of some Fourier orders.

    kernels (order, n_tau, n_in, n_col, n_out, S): radiance for a unit beam, public frame; flux_up, flux_down (n_tau,
    n_in, n_col): of the first of the orders, all diffuse light on the nodes; residuals: how well the route's own
    equations hold, by name, each (order,).
    """

    kernels: Array
    flux_up: Array
    flux_down: Array
    residuals: dict[str, Array]


class Modes:
    """Eigenmodes, beam, boundary, reconstruction: section 2.C of Collin, Pattanaik and Bouatouch."""

    name = "modes"
    # residuals up to which the answer counts
    allowed: ClassVar = {"residual_of_modes": 1e-9, "residual_of_boundary": 1e-9}

    def __init__(self, problem: Problem, base: Base, n_order: int, accuracy: float) -> None:
        self.problem, self.base = problem, expand_base(base, problem, n_order)
        self.quick = accuracy >= QUICK * max(1.0, problem.nodes.size / 16.0) ** 3.3

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return orders_at_once(doubles_of_modes(self.problem)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        matrices = assemble(self.problem, orders, run)
        modes = homogeneous(self.problem, orders, matrices, run, self.quick)
        beam = particular(self.problem, matrices, modes, run)
        amplitudes = boundary(self.problem, orders, modes, beam, self.base, run)
        kernels = reconstruct(self.problem, orders, matrices, modes, beam, amplitudes, self.base, run)
        residuals = {
            "residual_of_modes": modes.residual.max(axis=1),
            "residual_of_boundary": amplitudes.residual.max(axis=1),
        }
        return Orders(kernels, *nodal_fluxes(self.problem, orders, modes, beam, amplitudes), residuals)


class Doubling:
    """Impedance doubling of homogeneous slabs, joined by the star product."""

    name = "doubling"
    allowed: ClassVar = {"residual_of_reflection": 1e-9, "residual_of_transmission": 1e-6, "residual_of_joints": 1e-9}

    def __init__(self, problem: Problem, base: Base, n_order: int, accuracy: float) -> None:
        self.pile = cut(problem)
        self.base = expand_base(base, self.pile.problem, n_order)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return orders_at_once(doubles_of_doubling(self.pile)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        pile = self.pile
        matrices = assemble(pile.problem, orders, run)
        slabs = double_slabs(pile.problem, pile.material, pile.thickness, orders, matrices, run)
        kernels, up, down, residual = join(pile, orders, slabs, self.base, run)
        worst = slabs.residual.max(axis=1)
        residuals = {
            "residual_of_reflection": worst[:, 0],
            "residual_of_transmission": worst[:, 1],
            "residual_of_joints": residual,
        }
        return Orders(kernels, up, down, residuals)


class Invariance:
    """Fixed points of the invariance equation: the top of a layer without end alone."""

    name = "invariance"

    def __init__(self, problem: Problem, base: Base, n_order: int, accuracy: float) -> None:
        self.problem, self.tolerance = problem, TIGHTER * accuracy

    @property
    def allowed(self) -> dict[str, float]:
        """Residuals up to which the answer counts."""
        return {"residual_of_invariance": max(1e-9, 2.0 * self.tolerance)}

    def chunk(self, threads: int) -> int:
        """Orders to be done at once: all, their matrices are scratch memory."""
        return 1 << 20

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        found = reflect_endless(self.problem, orders, self.tolerance, run)
        up = flux_up(self.problem, found.on_nodes[0])
        up = np.broadcast_to(up, (self.problem.level.size, *up.shape[1:]))
        kernels = np.broadcast_to(found.kernels, (orders.size, self.problem.level.size, *found.kernels.shape[2:]))
        return Orders(kernels, up, np.zeros_like(up), {"residual_of_invariance": found.residual})


Route = Modes | Doubling | Invariance
ROUTES: dict[str, type[Modes] | type[Doubling] | type[Invariance]] = {
    "modes": Modes,
    "doubling": Doubling,
    "invariance": Invariance,
}
OTHER = {"modes": "doubling", "doubling": "modes", "invariance": "doubling"}
