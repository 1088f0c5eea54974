"""Section 2.C.4, reconstruction: multiply scattered light at any depth and direction, and fluxes on the nodes."""

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import Amplitudes
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.particular import Beam
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem


def reconstruct(
    problem: Problem,
    orders: IntArray,
    matrices: Assembled,
    modes: Modes,
    beam: Beam,
    amplitudes: Amplitudes,
    base: Base,
    run: Run,
) -> Array:
    """(order, n_tau, n_in, n_col, n_out, S): radiance of each order for a unit beam, public frame."""
    n_out = problem.mu_out.size
    with run.timed("reconstruction") as crew:
        out = run.kernels.reconstruct(
            crew,
            G_E=matrices.G_E,
            G_F=matrices.G_F,
            lam_re=modes.lam_re,
            lam_im=modes.lam_im,
            X=modes.X,
            Y=modes.Y,
            c=beam.c,
            zeta=beam.zeta,
            even=amplitudes.even,
            odd=amplitudes.odd,
            base_down=amplitudes.base_down,
            decaying=amplitudes.decaying,
            base_row=base.row[orders],
            base_out=base.out,
            thickness=problem.thickness,
            above=problem.above,
            mu0=problem.mu0,
            mu_out=problem.mu_out,
            n_up=problem.n_up,
            level=problem.level,
            level_layer=problem.level_layer,
        )
    out = out.reshape(*out.shape[:2], problem.mu0.size, problem.columns.shape[0], n_out, len(problem.stokes))
    out[..., : problem.n_up, :] *= problem.flip
    return out / (2.0 * np.pi)


def find_nodal_fluxes(
    problem: Problem, orders: IntArray, modes: Modes, beam: Beam, amplitudes: Amplitudes
) -> tuple[Array, Array]:
    """Diffuse flux up and down through a horizontal plane at every level, (n_tau, n_in, n_col); 0 without order 0."""
    shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
    if not problem.conserves or orders[0] > 0:
        return np.zeros(shape), np.zeros(shape)
    up, down = _core.nodal_fluxes(
        lam_re=modes.lam_re[:1],
        lam_im=modes.lam_im[:1],
        X=modes.X[:1],
        Y=modes.Y[:1],
        c=beam.c[:1],
        zeta=beam.zeta[:1],
        even=amplitudes.even[:1],
        odd=amplitudes.odd[:1],
        decaying=amplitudes.decaying[:1],
        thickness=problem.thickness,
        above=problem.above,
        mu0=problem.mu0,
        nodes=problem.nodes,
        weights=problem.weights,
        level=problem.level,
        level_layer=problem.level_layer,
    )
    return up.reshape(shape), down.reshape(shape)
