"""Section 2.C.2, particular solution, in the coordinates of the modes and without a resonance."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, IntArray, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem


@dataclass(frozen=True, eq=False)
class Beam:
    """c, zeta (order, layer, n_rhs, n): see the formulas at `particular` in core/particular.pxi."""

    c: Array
    zeta: Array


def find_beam_field(problem: Problem, matrices: Assembled, modes: Modes, run: Run) -> Beam:
    """The beam's own field, every order, layer and right-hand side."""
    with run.timed("particular") as crew:
        found = run.kernels.particular(
            crew,
            F=matrices.F,
            source_s=matrices.source_s,
            source_d=matrices.source_d,
            mu0=problem.mu0,
            columns=problem.columns,
            lam_re=modes.lam_re,
            lam_im=modes.lam_im,
            X=modes.X,
            Y=modes.Y,
            X_lu=modes.X_lu,
            X_pivots=modes.X_pivots,
        )
    return Beam(**found)


def copy_to_layers(kinds: IntArray, matrices: Assembled, modes: Modes, beam: Beam) -> tuple[Assembled, Modes, Beam]:
    """What was found for each material, in the layers made of it, (order, layer, ...): what the next stages read."""
    return (
        replace_unchecked(matrices, G_E=np.take(matrices.G_E, kinds, axis=1), G_F=np.take(matrices.G_F, kinds, axis=1)),
        replace_unchecked(
            modes,
            lam_re=np.take(modes.lam_re, kinds, axis=1),
            lam_im=np.take(modes.lam_im, kinds, axis=1),
            X=np.take(modes.X, kinds, axis=1),
            Y=np.take(modes.Y, kinds, axis=1),
        ),
        Beam(np.take(beam.c, kinds, axis=1), np.take(beam.zeta, kinds, axis=1)),
    )
