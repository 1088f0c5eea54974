"""Singly scattered light, and light reflected once by the base, in closed form over all Fourier orders."""

import math

import numpy as np

from vrte import _core
from vrte.arrays import Array
from vrte.discrete_ordinates.azimuths import cos_sin_deg
from vrte.discrete_ordinates.problem import Problem, Run
from vrte.scene import Lambertian, Layer, MuellerBase


def exp_difference(a: Array, b: Array) -> Array:
    """(e^a - e^b)/(a - b), e^a where they meet; for a, b <= 0."""
    high, low = np.maximum(a, b), np.minimum(a, b)
    gap = np.where(np.isfinite(low), low, -1e300) - high
    safe = np.where(gap == 0.0, 1.0, gap)
    return np.exp(high) * np.where(gap == 0.0, 1.0, np.expm1(safe) / safe)


def layer_paths(problem: Problem, mu: Array) -> Array:
    """Optical path integrals of one scattering in each layer, (layer, n_tau, n_in, n_mu); mu signed, > 0 up.

    The integral of e^(-t/mu0) e^(-|t - tau|/|mu|) dt/|mu| over the part of the layer that light at tau comes from.
    """
    rate_in = 1.0 / problem.mu0[:, None]
    rate = 1.0 / np.abs(mu)
    result = np.zeros((problem.albedo.size, problem.level.size, problem.mu0.size, mu.size))
    for t, (level, at) in enumerate(zip(problem.level, problem.level_layer, strict=True)):
        for k, (top, thickness) in enumerate(zip(problem.above, problem.thickness, strict=True)):
            if k >= at:  # light going up comes from below tau
                start, length = (top + level, thickness - level) if k == at else (top, thickness)
                both = rate_in + rate
                way = distance(problem, t, k)
                up = np.exp(-start * rate_in - way * rate) * -np.expm1(-length * both) * rate / both
                result[k, t] += np.where(mu > 0.0, up, 0.0)
            if k <= at:
                length = level if k == at else thickness
                down = length * rate * exp_difference(-length * rate_in, -length * rate)
                down *= np.exp(-top * rate_in - distance(problem, t, k) * rate)
                result[k, t] += np.where(mu < 0.0, down, 0.0)
    return result


def distance(problem: Problem, t: int, k: int) -> float:
    """Optical depth between level t and the nearer face of layer k (number of layers: of the base); 0 inside the layer.

    A sum of thicknesses, never a difference of depths: along a cosine of 1e-8 its last place would be seen.
    """
    at, level = problem.level_layer[t], problem.level[t]
    if k == at:
        return 0.0
    if k > at:
        return float(problem.thickness[at] - level) + math.fsum(problem.thickness[at + 1 : k])
    return float(level) + math.fsum(problem.thickness[k + 1 : at])


def phase_matrices_of_layers(layers: tuple[Layer, ...], mu0: Array, mu: Array, phi: Array, run: Run) -> list[Array]:
    """omega/(4 pi) Z(mu, mu0, phi) of every layer, (n_in, n_mu, n_phi, 4, 4); a shared phase matrix is done once."""
    done: dict[int, Array] = {}
    cosine, sine = (np.ascontiguousarray(values) for values in cos_sin_deg(phi))
    for layer in layers:
        key = id(layer.phase_matrix)
        if key not in done:
            done[key] = np.empty((mu0.size, mu.size, phi.size, 4, 4))
            table = np.ascontiguousarray(layer.phase_matrix.coefficients)
            run.timed("single scattering", _core.scattered_once, table, mu0, mu, cosine, sine, done[key], run.threads)
    return [done[id(layer.phase_matrix)] for layer in layers]


def base_reflected(base: Lambertian | MuellerBase | None, problem: Problem, mu: Array, phi: Array) -> Array | None:
    """The beam, reflected by the base and attenuated both ways: (n_tau, n_in, n_mu, n_phi, 4, 4), or None."""
    total = problem.above[-1] + problem.thickness[-1]
    up = mu > 0.0
    if base is None or not np.isfinite(total) or not up.any():
        return None
    mu_i, mu_o = problem.mu0[:, None, None], np.abs(mu)[None, :, None]
    if isinstance(base, Lambertian):
        f = np.zeros((problem.mu0.size, mu.size, phi.size, 4, 4))
        f[..., 0, 0] = base.albedo / np.pi
    else:
        f = base(mu_i, mu_o, phi)
    left = np.array([distance(problem, t, problem.albedo.size) for t in range(problem.level.size)])
    left = left[:, None, None] / np.abs(mu)
    fade = np.where(up, np.exp(-total / problem.mu0[:, None] - left) * problem.mu0[:, None], 0.0)
    return fade[..., None, None, None] * f
