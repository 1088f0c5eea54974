"""One Fourier order after another: assembly, modes, beam, boundary, reconstruction, and the sum over azimuth."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.arrays import Array
from vrte.blas import single_threaded
from vrte.discrete_ordinates.base import expand_base
from vrte.discrete_ordinates.boundary import boundary
from vrte.discrete_ordinates.homogeneous import homogeneous
from vrte.discrete_ordinates.particular import particular
from vrte.discrete_ordinates.phase_assembly import assemble
from vrte.discrete_ordinates.problem import IntArray, Problem, Progress, Run
from vrte.discrete_ordinates.quadrature import double_gauss
from vrte.discrete_ordinates.reconstruction import nodal_fluxes, reconstruct
from vrte.discrete_ordinates.single_scattering import (
    base_reflected,
    cos_sin_deg,
    layer_paths,
    phase_matrices_of_layers,
)
from vrte.errors import AccuracyError
from vrte.scene import MuellerBase, Scene

NEGLIGIBLE = 1e-15  # of the single-scattering albedo: a bound on what the orders left out could add
RESIDUAL_ALLOWED = 1e-6
CHUNK_BYTES = 48e6


@dataclass(frozen=True, eq=False)
class Solution:
    """Radiance for each incident Stokes column, and fluxes.

    radiance (n_tau, n_in, n_mu, n_phi, 4, n_col), diffuse, public frame; flux_up, flux_down (n_tau, n_in, n_col).
    """

    radiance: Array
    flux_up: Array
    flux_down: Array
    diagnostics: dict[str, Any]


def solve(
    scene: Scene,
    mu0: Array,
    columns: Array,
    mu: Array,
    phi: Array,
    tau: Array,
    nodes: int,
    run: Run,
    progress: Progress | None = None,
) -> Solution:
    """The diffuse field at depths tau (n_tau,), signed cosines mu (n_mu,) and azimuths phi (degrees).

    ``columns`` (n_col, 4): incident Stokes vectors, each within (I, Q) or within (U, V). Raises AccuracyError where
    the solver's own residuals are too large.
    """
    start = time.perf_counter()
    with single_threaded():
        # light going up first
        rank = np.argsort(mu < 0.0, kind="stable")
        problem = discretise(scene, mu0, columns, mu[rank], tau, nodes)
        orders = orders_needed(scene, problem, run)
        kernels, up, down, residuals = solve_orders(scene, problem, orders, run, progress)
        begin = time.perf_counter()
        radiance = np.empty((tau.size, mu0.size, mu.size, phi.size, 4, columns.shape[0]))
        radiance[:, :, rank] = fourier_sum(kernels, orders, columns, phi)
        run.book("fourier sum", time.perf_counter() - begin)
        add_closed_forms(radiance, scene, problem, mu, phi, run)
    longest = max(layer.phase_matrix.terms for layer in scene.layers)
    diagnostics = {
        "method": "discrete-ordinates",
        "algorithm": "modes",
        "nodes": int(nodes),
        "threads": run.threads,
        "openmp": _core.HAS_OPENMP,
        "orders": int(orders.size),
        "orders_of_phase_matrix": longest,
        "terms_cut": max(0, longest - 2 * nodes),
        "base": base_statement(scene),
        "residual_of_modes": residuals[0],
        "residual_of_boundary": residuals[1],
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }
    return Solution(radiance, up, down, diagnostics)


def base_statement(scene: Scene) -> str:
    """What the base is, and whether light gets there."""
    name = "black" if scene.base is None else type(scene.base).__name__
    return name if scene.base_is_reached or scene.base is None else f"{name}, not reached below an infinite layer"


def discretise(scene: Scene, mu0: Array, columns: Array, mu: Array, tau: Array, nodes: int) -> Problem:
    """Nodes, cut coefficients and the layer every depth lies in."""
    points, weights = double_gauss(nodes)
    terms = np.array([min(layer.phase_matrix.terms, 2 * nodes) for layer in scene.layers], np.int32)
    coefficients = np.zeros((len(scene.layers), int(terms.max()), 6))
    for k, layer in enumerate(scene.layers):
        coefficients[k, : terms[k]] = layer.phase_matrix.coefficients[: terms[k]]
    thickness = np.array([layer.thickness for layer in scene.layers])
    above = np.concatenate([[0.0], np.cumsum(thickness[:-1])])
    at = np.clip(np.searchsorted(above, tau, side="right") - 1, 0, None).astype(np.int32)
    return Problem(
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([layer.albedo for layer in scene.layers]),
        thickness=thickness,
        above=above,
        nodes=points,
        weights=weights,
        mu_out=np.abs(mu),
        n_up=int(np.count_nonzero(mu > 0.0)),
        mu0=np.ascontiguousarray(mu0),
        columns=np.ascontiguousarray(columns),
        level=np.clip(tau - above[at], 0.0, thickness[at]),
        level_layer=at,
    )


def orders_needed(scene: Scene, problem: Problem, run: Run) -> IntArray:
    """Orders 0 .. last: beyond, a bound on multiple scattering is below 1e-15 of the albedo. At least order 0.

    A Mueller base can feed light back at any order, so there all orders of the phase matrix run.
    """
    n_order = int(problem.terms.max())
    if not (isinstance(scene.base, MuellerBase) and scene.base_is_reached):
        bounds, directions = np.empty(n_order), problem.directions
        run.timed(
            "order bounds",
            _core.order_bounds,
            problem.coefficients,
            problem.terms,
            problem.albedo,
            directions,
            problem.weights,
            problem.mu_out.size,
            bounds,
            run.threads,
            run.work(_core.bounds_work(directions.size, n_order)),
        )
        tail = np.cumsum(2.0 * bounds[::-1])[::-1]
        n_order = max(1, int(np.count_nonzero(tail > NEGLIGIBLE * max(problem.albedo.max(), 1e-300))))
    return np.arange(n_order, dtype=np.int32)


def solve_orders(
    scene: Scene, problem: Problem, orders: IntArray, run: Run, progress: Progress | None
) -> tuple[Array, Array, Array, tuple[float, float]]:
    """Kernels (order, n_tau, n_in, n_col, n_out, 4), fluxes and residuals, a few orders at a time to bound memory."""
    base = expand_base(scene.base if scene.base_is_reached else None, problem, orders.size)
    shape = (orders.size, problem.level.size, problem.mu0.size, problem.columns.shape[0], problem.mu_out.size, 4)
    kernels = np.empty(shape)
    worst_mode = worst_boundary = 0.0
    step = chunk(problem, run.threads)
    for first in range(0, orders.size, step):
        part = orders[first : first + step]
        matrices = assemble(problem, part, run)
        modes = homogeneous(problem, part, matrices, run)
        beam = particular(problem, matrices, modes, run)
        amplitudes = boundary(problem, part, modes, beam, base, run)
        kernels[first : first + step] = reconstruct(problem, part, matrices, modes, beam, amplitudes, base, run)
        if first == 0:
            up, down = nodal_fluxes(problem, modes, beam, amplitudes)
        worst_mode = max(worst_mode, float(modes.residual.max()))
        worst_boundary = max(worst_boundary, float(amplitudes.residual.max()))
        if progress is not None:
            progress(min(first + step, orders.size), int(orders.size))
    if not max(worst_mode, worst_boundary) <= RESIDUAL_ALLOWED or not np.isfinite(kernels).all():
        longest = max(layer.phase_matrix.terms for layer in scene.layers)
        advice = (
            f": {problem.nodes.size} nodes do not resolve {longest} terms, use more"
            if longest > problem.terms.max()
            else ""
        )
        raise AccuracyError(
            f"the residuals of the eigenproblems ({worst_mode:.2g}) and of the boundary systems ({worst_boundary:.2g}) "
            f"must be at most {RESIDUAL_ALLOWED:g}{advice}"
        )
    return kernels, up, down, (worst_mode, worst_boundary)


def chunk(problem: Problem, threads: int) -> int:
    """Orders done at once: as many as fit the memory meant for it, at least one a thread."""
    n, out, n_layer = problem.size, 4 * problem.mu_out.size, problem.albedo.size
    doubles = n_layer * n * (5 * n + 2 * out + 8 * problem.mu0.size + 4 * problem.n_rhs)
    return max(threads, int(CHUNK_BYTES / (8 * doubles)))


def fourier_sum(kernels: Array, orders: IntArray, columns: Array, phi: Array) -> Array:
    """(1:6)-(1:8), (1:12) without its 1/2: (n_tau, n_in, n_out, n_phi, 4, n_col), orders summed in order."""
    cosine, sine = cos_sin_deg(orders[:, None] * phi)
    twice = np.where(orders == 0, 1.0, 2.0)[:, None]
    cosine, sine = twice * cosine, twice * sine
    n_order, *shape, _ = kernels.shape  # order, tau, in, col, out
    result = np.empty((*shape, 4, phi.size))
    for col, column in enumerate(columns):
        first = bool(column[:2].any()) or not column.any()
        for part, angular in ((slice(0, 2), cosine if first else -sine), (slice(2, 4), sine if first else cosine)):
            values = kernels[:, :, :, col, :, part].reshape(n_order, -1)
            result[:, :, col, :, part] = (values.T @ angular).reshape(shape[0], shape[1], shape[3], 2, phi.size)
    return result.transpose(0, 1, 3, 5, 4, 2)


def add_closed_forms(radiance: Array, scene: Scene, problem: Problem, mu: Array, phi: Array, run: Run) -> None:
    """Adds single scattering and the base's direct reflection to radiance, in place."""
    phase = phase_matrices_of_layers(tuple(scene.layers), problem.mu0, mu, phi, run)
    begin = time.perf_counter()
    paths = layer_paths(problem, mu)
    stokes = problem.columns.T
    for z, path, layer in zip(phase, paths, scene.layers, strict=True):
        if layer.albedo > 0.0:
            scattered = z @ stokes
            radiance += (layer.albedo / (4.0 * np.pi)) * path[..., None, None, None] * scattered
    reflected = base_reflected(scene.base, problem, mu, phi)
    if reflected is not None:
        radiance += reflected @ stokes
    run.book("single scattering", time.perf_counter() - begin)
