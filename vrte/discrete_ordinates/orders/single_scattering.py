"""Singly scattered light, and light reflected once by the base, in closed form over all Fourier orders."""

import math
from collections.abc import Sequence

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.scene.boundary import Boundary
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene


def find_scatterers(
    scenes: Sequence[Scene], problem: Problem, levels: IntArray, mu: Array, whole: bool = True
) -> list[tuple[Array, Array]]:
    """What scatters once: the tables of every phase matrix, as the kernel takes them, a scene's behind another's, and
    what multiplies it.

    That is omega/(4 pi) times the path integral, (scene n_level, n_in, n_mu), summed over the layers that share it, the
    same in all scenes. ``whole``: phase matrices with all their terms, omega the gain of the truncated layers, as in
    the TMS method; otherwise both are those of the truncated layers. Source: Nakajima and Tanaka, JQSRT 40, 51 (1988).
    """
    paths, count = integrate_paths(problem, levels, mu), problem.scenes
    strength = problem.gain if whole else problem.albedo
    paths *= (strength / (4.0 * np.pi))[:, None, None, None]
    by_scene = paths.reshape(count, -1, *paths.shape[1:])
    first: dict[int, int] = {}
    for k, layer in enumerate(scenes[0].layers):
        if strength[k] > 0.0:
            of = first.setdefault(id(layer.phase_matrix), k)
            if of != k:
                by_scene[:, of] += by_scene[:, k]
    return [
        (stack_tables(scenes, problem, k, whole), np.ascontiguousarray(by_scene[:, k].reshape(-1, *paths.shape[2:])))
        for k in first.values()
    ]


def stack_tables(scenes: Sequence[Scene], problem: Problem, k: int, whole: bool) -> Array:
    """The series of layer ``k`` of all scenes, (scene row, SERIES), all with as many rows; not ``whole``: of what is
    left of those that have lost a forward peak."""
    every, cut = [scene.layers[k].phase_matrix for scene in scenes], problem.fraction.reshape(problem.scenes, -1)
    tables = [
        matrix.series if whole or not cut[i].any() else _core.series_table(problem.coefficients[i * problem.layers + k])
        for i, matrix in enumerate(every)
    ]
    if len(tables) == 1:
        return tables[0]
    found = np.zeros((len(tables), max(table.shape[0] for table in tables), _core.SERIES))
    for own, table in zip(found, tables, strict=True):
        own[: table.shape[0]] = table
    return found.reshape(-1, _core.SERIES)


def integrate_paths(problem: Problem, levels: IntArray, mu: Array) -> Array:
    """Optical path integrals of one scattering in each layer, (scene layer, n_level, n_in, n_mu); mu signed, > 0 up."""
    return _core.path_integrals(
        above=problem.above,
        thickness=problem.thickness,
        level=problem.level,
        level_layer=problem.level_layer,
        chosen=levels,
        mu0=problem.mu0,
        mu=mu,
        slab_stacks=problem.scenes,
    )


def integrate_slab_paths(thickness: Array, mu_in: Array, mu_out: Array) -> Array:
    """The same of slabs (slab,), for light going down mu_in (n_in,): up at their tops and down at their bottoms, along
    mu_out (n_out,), (2, slab, n_in, n_out)."""
    ends = np.stack([np.zeros(thickness.size), np.where(np.isfinite(thickness), thickness, 0.0)], axis=1).ravel()
    found = np.empty((2, thickness.size, mu_in.size, mu_out.size))
    for way in range(2):
        found[way] = _core.path_integrals(
            above=np.zeros(thickness.size),
            thickness=thickness,
            level=ends,
            level_layer=np.zeros(2, np.int32),
            chosen=np.array([way], np.int32),
            mu0=np.ascontiguousarray(mu_in),
            mu=-mu_out if way else np.ascontiguousarray(mu_out),
            slab_stacks=thickness.size,
        )[:, 0]
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


def measure_distance(problem: Problem, t: int, k: int, scene: int = 0) -> float:
    """Optical depth between level t and the nearer face of layer k (number of layers: of the base) of a scene; 0 inside
    the layer.

    A sum of thicknesses, never a difference of depths: along a cosine of 1e-8 its last place would be seen.
    """
    at, level = problem.level_layer[t], problem.level[scene * problem.level_layer.size + t]
    thickness = problem.thickness[scene * problem.layers : (scene + 1) * problem.layers]
    if k == at:
        return 0.0
    if k > at:
        return float(thickness[at] - level) + math.fsum(thickness[at + 1 : k])
    return float(level) + math.fsum(thickness[k + 1 : at])


def add_base_reflected(
    bases: Sequence[Boundary],
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
    """Adds beams, reflected by what lies below each scene and decaying on both ways: the beams first .. last - 1.

    levels (n_level,), mu (n_mu,): depths and signed cosines of out (scene n_level, n_in, n_mu, n_phi, 4, n_place);
    index (n_col,): where the columns go; scale (n_in,): factor of each incident direction. Bases of several scenes are
    even.
    """
    if not any([base.orders_reflected for base in bases]):
        return
    up, count, below = mu > 0.0, problem.scenes, bases[0]
    total = (problem.above + problem.thickness).reshape(count, -1)[:, -1:]
    if not np.isfinite(total).all() or not up.any():
        return
    mu0 = problem.mu0[first:last]
    strength = scale[first:last] * mu0 * np.exp(-total / mu0)
    left = [[measure_distance(problem, t, problem.layers, k) for t in levels.tolist()] for k in range(count)]
    decay = strength[:, None, :, None] * np.exp(-np.array(left)[:, :, None, None] / np.abs(mu))
    decay = np.where(up, decay, 0.0)[..., None]
    values = out.reshape(count, -1, *out.shape[1:])[:, :, first:last]
    if below.is_uneven:
        f = below.reflect(mu0[:, None, None], np.abs(mu)[None, :, None], phi)
    else:
        f = (np.array([base.even_albedo for base in bases]) / np.pi).reshape(-1, 1, 1, 1, 1, 1, 1)
    seen = f.shape[-1]
    for column, at in zip(problem.columns, index.tolist(), strict=True):
        if column[:seen].any():
            values[..., :seen, at] += decay[..., None] * (f @ column[:seen])
