"""Section 2.C.2, particular solution, in the coordinates of the modes and without a resonance."""

from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Beam:
    """c, zeta (order, layer, n_rhs, n): see the formulas at `particular` in core/particular.pxi."""

    c: Array
    zeta: Array


def particular(problem: Problem, matrices: Assembled, modes: Modes, run: Run) -> Beam:
    """The beam's own field, every order, layer and right-hand side."""
    shape = (*modes.lam_re.shape[:2], problem.n_rhs, problem.size)
    beam = Beam(np.empty(shape), np.empty(shape))
    run.timed(
        "particular",
        run.kernels.particular,
        matrices.F,
        matrices.source_s,
        matrices.source_d,
        problem.mu0,
        problem.columns,
        modes.lam_re,
        modes.lam_im,
        modes.X,
        modes.Y,
        modes.X_lu,
        modes.X_pivots,
        beam.c,
        beam.zeta,
        run.threads,
        run.work(_core.particular_work(problem.size, problem.mu0.size, len(problem.stokes))),
    )
    return beam
