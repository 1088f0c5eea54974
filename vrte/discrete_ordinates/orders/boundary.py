"""Section 2.C.3, boundary conditions: the amplitudes of all modes in all layers."""

from dataclasses import dataclass

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
    """even, odd (order, layer, n_rhs, n); base_down (order, n_rhs, n); decaying (order, layer): every mode decays,
    and amplitudes are of what decays from the top and from the bottom; residual (order, layer)."""

    even: Array
    odd: Array
    base_down: Array
    decaying: IntArray
    residual: Array


NO_SURFACE = np.zeros((0, 1, 1))


def solve_boundary(
    problem: Problem, orders: IntArray, modes: Modes, beam: Beam, base: Base, run: Run, top: Array = NO_SURFACE
) -> Amplitudes:
    """Solves the boundary systems of every order; ``top`` (N, S, S): what an interface above sends back down along each
    node. Raises AccuracyError where one is singular."""
    n, n_layer, n_rhs = problem.size, problem.albedo.size, problem.n_rhs
    shape = (orders.size, n_layer, n_rhs, n)
    result = Amplitudes(
        even=np.empty(shape),
        odd=np.empty(shape),
        base_down=np.empty((orders.size, n_rhs, n)),
        decaying=np.empty((orders.size, n_layer), np.int32),
        residual=np.zeros((orders.size, n_layer)),
    )
    info = np.zeros(orders.size, np.int32)
    with run.timed("boundary") as crew:
        run.kernels.boundary(
            crew,
            lam_re=modes.lam_re,
            lam_im=modes.lam_im,
            X=modes.X,
            Y=modes.Y,
            c=beam.c,
            zeta=beam.zeta,
            clear=np.where((problem.albedo == 0.0) & problem.skip_flags.clear, 1, 0).astype(np.int32),
            thickness=problem.thickness,
            mu0=problem.mu0,
            above=problem.above,
            base_row=base.row[orders],
            base=base.matrix,
            base_source=base.source,
            top=top,
            even=result.even,
            odd=result.odd,
            base_down=result.base_down,
            decaying=result.decaying,
            residual=result.residual,
            info=info,
        )
    if info.any():
        raise AccuracyError(f"the boundary system of order {orders[np.argmax(info != 0)]} is singular")
    return result
