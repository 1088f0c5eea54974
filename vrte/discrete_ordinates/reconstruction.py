"""Section 2.C.4, reconstruction: multiply scattered light at any depth and direction, and fluxes on the nodes."""

import numpy as np

from vrte import _core
from vrte.arrays import Array
from vrte.discrete_ordinates.base import Base
from vrte.discrete_ordinates.boundary import Amplitudes
from vrte.discrete_ordinates.homogeneous import Modes
from vrte.discrete_ordinates.particular import Beam
from vrte.discrete_ordinates.phase_assembly import Assembled
from vrte.discrete_ordinates.problem import IntArray, Problem, Run


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
    n_out, n_rhs = problem.mu_out.size, problem.n_rhs
    out = np.empty((orders.size, problem.level.size, n_rhs, problem.rows_out))
    run.timed(
        "reconstruction",
        _core.reconstruct,
        matrices.G_E,
        matrices.G_F,
        modes.lam_re,
        modes.lam_im,
        modes.X,
        modes.Y,
        beam.c,
        beam.zeta,
        amplitudes.even,
        amplitudes.odd,
        amplitudes.base_down,
        base.row[orders],
        base.out,
        problem.thickness,
        problem.above,
        problem.mu0,
        problem.mu_out,
        problem.n_up,
        problem.level,
        problem.level_layer,
        out,
        run.threads,
        run.work(_core.reconstruction_work(problem.size, problem.rows_out, n_rhs, problem.albedo.size)),
    )
    out = out.reshape(*out.shape[:2], problem.mu0.size, problem.columns.shape[0], n_out, len(problem.stokes))
    out[..., : problem.n_up, :] *= problem.flip
    return out / (2.0 * np.pi)


def nodal_fluxes(
    problem: Problem, orders: IntArray, modes: Modes, beam: Beam, amplitudes: Amplitudes
) -> tuple[Array, Array]:
    """Diffuse flux up and down through a horizontal plane at every level, (n_tau, n_in, n_col); 0 without order 0."""
    shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
    up, down = np.zeros(shape), np.zeros(shape)
    if not problem.conserves or orders[0] > 0:
        return up, down
    weight = np.sqrt(problem.weights * problem.nodes)
    for t, (level, layer) in enumerate(zip(problem.level, problem.level_layer, strict=True)):
        y, z = mode_coordinates(problem, int(layer), float(level), modes, beam, amplitudes)
        total, difference = y @ modes.X[0, layer], z @ modes.Y[0, layer]
        up[t] = ((total - difference)[:, :: len(problem.stokes)] @ weight / 2.0).reshape(shape[1:])
        down[t] = ((total + difference)[:, :: len(problem.stokes)] @ weight / 2.0).reshape(shape[1:])
    return up, down


def mode_coordinates(
    problem: Problem, layer: int, depth: float, modes: Modes, beam: Beam, amplitudes: Amplitudes
) -> tuple[Array, Array]:
    """y, z of order 0 at a depth below a layer's top, (n_rhs, n) each; see `boundary` in _core.pyx."""
    lam = modes.lam_re[0, layer] + 1j * modes.lam_im[0, layer]
    even = pair(amplitudes.even[0, layer], lam)
    odd = pair(amplitudes.odd[0, layer], lam)
    fed = pair(beam.c[0, layer], lam)
    held = pair(beam.zeta[0, layer], lam)
    rate = np.repeat(1.0 / problem.mu0, problem.columns.shape[0])[:, None]
    light = np.exp(-problem.above[layer] * rate)
    k = np.sqrt(lam)
    response = light * _core.beam_responses(k, rate[:, 0], depth)
    y_even, z_even, y_odd, z_odd = _core.mode_profiles(k, float(problem.thickness[layer]), depth)
    y = even * y_even + odd * y_odd + fed * response
    z = even * z_even + odd * z_odd
    z = z + light * held * np.exp(-depth * rate) + fed * k * response
    return unpair(y, lam), unpair(z, lam)


def pair(values: Array, lam: np.ndarray) -> np.ndarray:
    """y1 - i y2 for complex modes at the first of their two places (the second is unused), y for real ones."""
    paired = values.astype(complex)
    first = np.flatnonzero(lam.imag > 0.0)
    paired[:, first] -= 1j * values[:, first + 1]
    return paired


def unpair(values: np.ndarray, lam: np.ndarray) -> Array:
    """Back to two real coordinates."""
    real = np.ascontiguousarray(values.real)
    first = np.flatnonzero(lam.imag > 0.0)
    real[:, first + 1] = -values.imag[:, first]
    return real
