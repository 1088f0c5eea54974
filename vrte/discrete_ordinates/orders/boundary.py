"""Section 2.C.3, boundary conditions: the amplitudes of all modes in all layers."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.particular import Beam
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """even, odd (order, layer, n_rhs, n); base_down, rising (order, n_rhs, n): light that falls on the base, and, where
    a top sends light down, that comes up to it; decaying (order, layer): every mode decays, and amplitudes are of what
    decays from the top and from the bottom; residual (order, layer)."""

    even: Array
    odd: Array
    base_down: Array
    rising: Array
    decaying: IntArray
    residual: Array


@dataclass(frozen=True, eq=False)
class Top:
    """An interface above the layers, in the scaled and flipped frame: row (order,), of `reflection` (row, block, b, b),
    which light coming up goes down again by, S x S along each node or n x n; sent (order, n_rhs, n): light on the nodes
    that it makes of beams, which then meet no layer; of no orders where they go through. Rows and orders by number."""

    row: IntArray
    reflection: Array
    sent: Array

    def arguments_of(self, orders: IntArray) -> dict[str, Any]:
        """What the core takes of it: nothing where nothing lies above, no light where beams go through."""
        if not self.row.size:
            return {}
        sent = {"sent": self.sent[orders]} if self.sent.size else {}
        return {"top_row": self.row[orders], "top": self.reflection} | sent


OPEN = Top(np.zeros(0, np.int32), np.zeros((1, 1, 1, 1)), np.zeros((0, 1, 1)))  # nothing above the layers


def solve_boundary(
    problem: Problem, orders: IntArray, modes: Modes, beam: Beam, base: Base, run: Run, top: Top = OPEN
) -> Amplitudes:
    """Solves the boundary systems of every order, ``top`` above the layers. Raises AccuracyError where one is
    singular."""
    with run.timed("boundary") as crew:
        found = run.kernels.boundary(
            crew,
            lam_re=modes.lam_re,
            lam_im=modes.lam_im,
            X=modes.X,
            Y=modes.Y,
            c=beam.c,
            zeta=beam.zeta,
            clear_layers=problem.clear_layers,
            thickness=problem.thickness,
            mu0=problem.mu0,
            above=problem.above,
            base_row=base.row[orders],
            base=base.matrix,
            base_source=base.source,
            **top.arguments_of(orders),
        )
    info = found.pop("info")
    if info.any():
        raise AccuracyError(f"the boundary system of order {orders[np.argmax(info != 0)]} is singular")
    return Amplitudes(**found)
