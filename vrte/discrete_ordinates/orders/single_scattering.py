"""Singly scattered light, and light reflected once by the base, in closed form over all Fourier orders."""

import math
from collections.abc import Sequence

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.scene.boundary import Boundary
from vrte.scene.layer import Layer


def find_scatterers(
    layers: Sequence[Layer], problem: Problem, levels: IntArray, mu: Array, whole: bool = True
) -> list[tuple[Array, Array]]:
    """What scatters once: the table of every phase matrix, as the kernel takes it, and what multiplies it.

    That is omega/(4 pi) times the path integral, (n_level, n_in, n_mu), summed over the layers that share it.
    ``whole``: phase matrices with all their terms, omega the gain of the truncated layers, as in the TMS method;
    otherwise both are those of the truncated layers. Source: Nakajima and Tanaka, JQSRT 40, 51 (1988).
    """
    paths = integrate_paths(problem, levels, mu)
    strength = problem.gain if whole else problem.albedo
    found: dict[int, tuple[Array, Array]] = {}
    for k, layer in enumerate(layers):
        if strength[k] > 0.0:
            key = id(layer.phase_matrix)
            weighted = strength[k] / (4.0 * np.pi) * paths[k]
            if key in found:
                found[key][1][:] += weighted
            else:
                table = layer.phase_matrix.series if whole else _core.series_table(problem.coefficients[k])
                found[key] = (table, weighted)
    return list(found.values())


def integrate_paths(problem: Problem, levels: IntArray, mu: Array) -> Array:
    """Optical path integrals of one scattering in each layer, (layer, n_level, n_in, n_mu); mu signed, > 0 up."""
    return _core.path_integrals(
        above=problem.above,
        thickness=problem.thickness,
        level=problem.level,
        level_layer=problem.level_layer,
        chosen=levels,
        mu0=problem.mu0,
        mu=mu,
    )


def integrate_slab_paths(thickness: float, mu_in: Array, mu_out: Array) -> Array:
    """The same of one slab, for light going down mu_in (n_in,): up at its top and down at its bottom, along mu_out
    (n_out,), (2, n_out, n_in)."""
    ends = np.array([0.0, thickness])[: 1 + math.isfinite(thickness)]
    found = np.zeros((2, mu_out.size, mu_in.size))
    for way, level in enumerate(ends.tolist()):
        found[way] = _core.path_integrals(
            above=np.zeros(1),
            thickness=np.array([thickness]),
            level=np.array([level]),
            level_layer=np.zeros(1, np.int32),
            chosen=np.zeros(1, np.int32),
            mu0=np.ascontiguousarray(mu_in),
            mu=-mu_out if way else np.ascontiguousarray(mu_out),
        )[0, 0].T
    return found


def scatter_by_orders(layers: Sequence[Layer], problem: Problem) -> Array:
    """Singly scattered light order by order, (order, n_tau, n_in, n_col, n_out, 4), as the solver's own stages leave
    theirs: what the closed form stands for. No sum over a table of directions needs it."""
    mu = np.concatenate([problem.mu_out[: problem.n_up], -problem.mu_out[problem.n_up :]])
    paths = integrate_paths(problem, np.arange(problem.level.size, dtype=np.int32), mu)
    terms = max(layer.phase_matrix.terms for layer in layers)
    columns = problem.columns.shape[0]
    kernels = np.zeros((terms, problem.level.size, problem.mu0.size, columns, mu.size, 4))
    for layer, gain, path in zip(layers, problem.gain, paths, strict=True):
        if gain > 0.0:
            for order in range(layer.phase_matrix.terms):
                matrix = _core.phase_matrices(order, layer.phase_matrix.coefficients, -mu, problem.mu0.copy())
                scattered = np.einsum("oiab,cb->icoa", matrix, problem.columns)
                kernels[order] += gain / (4.0 * np.pi) * path[:, :, None, :, None] * scattered
    return kernels


def measure_distance(problem: Problem, t: int, k: int) -> float:
    """Optical depth between level t and the nearer face of layer k (number of layers: of the base); 0 inside the layer.

    A sum of thicknesses, never a difference of depths: along a cosine of 1e-8 its last place would be seen.
    """
    at, level = problem.level_layer[t], problem.level[t]
    if k == at:
        return 0.0
    if k > at:
        return float(problem.thickness[at] - level) + math.fsum(problem.thickness[at + 1 : k])
    return float(level) + math.fsum(problem.thickness[k + 1 : at])


def add_base_reflected(
    below: Boundary,
    problem: Problem,
    levels: IntArray,
    mu: Array,
    phi: Array,
    index: IntArray,
    scale: Array,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Adds the beam, reflected by what lies below and decaying on both ways, for the beams first .. last - 1.

    levels (n_level,), mu (n_mu,): depths and signed cosines of out (n_level, n_in, n_mu, n_phi, 4, n_place); place
    (n_col,): where the columns go; scale (n_in,): factor of each incident direction.
    """
    total = problem.above[-1] + problem.thickness[-1]
    up = mu > 0.0
    if not below.orders_reflected or not np.isfinite(total) or not up.any():
        return
    mu0 = problem.mu0[first:last]
    strength = scale[first:last] * mu0 * np.exp(-total / mu0)
    left = np.array([measure_distance(problem, int(t), problem.albedo.size) for t in levels])
    decay = np.where(up, strength[:, None] * np.exp(-left[:, None, None] / np.abs(mu)), 0.0)
    f = below.reflect(mu0[:, None, None], np.abs(mu)[None, :, None], phi)
    seen = f.shape[-1]
    for column, at in zip(problem.columns, index, strict=True):
        light = f @ column[:seen]
        for values, fraction in zip(out, decay, strict=True):
            values[first:last, ..., :seen, at] += fraction[..., None, None] * light
