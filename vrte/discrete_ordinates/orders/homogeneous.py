"""Section 2.C.1, homogeneous solution: the halved eigenproblem (1:43), with its complex pairs."""

from dataclasses import fields

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.stages import list_known, run_stage


@record
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
    known = list_known(problem, orders, quick) | vars(matrices)
    run_stage("homogeneous", known, run)
    return Modes(**{each.name: known[each.name] for each in fields(Modes)})
