"""Section 2.C.1, homogeneous solution: the halved eigenproblem (1:43), with its complex pairs."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Modes:
    """lam_re, lam_im (order, layer, n); X, Y and X's factors (order, layer, n, n); residual (order, layer)."""

    lam_re: Array
    lam_im: Array
    X: Array
    Y: Array
    X_lu: Array
    X_pivots: IntArray
    residual: Array


def find_modes(problem: Problem, orders: IntArray, matrices: Assembled, run: Run, quick: bool = False) -> Modes:
    """The modes of every order and layer, ``quick`` where E and F are symmetric. Raises AccuracyError without any."""
    with run.timed("homogeneous") as crew:
        found = run.kernels.homogeneous(
            crew,
            orders=orders,
            conserving=problem.conserves,
            quick=quick,
            clear=problem.skip_flags.clear,
            albedo=problem.albedo,
            nodes=problem.nodes,
            weights=problem.weights,
            E=matrices.E,
            F=matrices.F,
        )
    info = found.pop("info")
    if info.any():
        order, layer = np.argwhere(info)[0]
        raise AccuracyError(f"the eigenproblem of order {orders[order]}, layer {layer + 1} did not converge")
    return Modes(**found)
