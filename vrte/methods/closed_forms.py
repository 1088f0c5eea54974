"""Methods in closed form: light scattered once, (2:24)-(2:26) with s = 1, and small angles, (2:28)-(2:29).

Of small angles every direction is taken to travel as steeply as the beam, so degree l of the field's expansion about
the beam decays as E_l = exp(-(1 - omega S_l) tau/mu0), S_l the 4x4 matrix of the coefficients of degree l over 2 l + 1.
The diffuse part has E_l - exp(-tau/mu0) instead, which ends where the phase matrix does: without that the sum does not
converge. Over all Fourier orders the generalized spherical functions of (2:29) add up to those of the angle from the
beam. Light goes down only: nothing is reflected, and what the sum leaves above the horizon is taken as zero.
"""

from dataclasses import replace

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.differences import divide_exp_once
from vrte.basics.quadrature import make_double_gauss
from vrte.discrete_ordinates.execution.sums import Part, make_parts, prepare_closed_form
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.small_angle import Anisotropic, AnySpreading, Beam
from vrte.methods.parts.method import NODES, Answer, Task, discretise_request
from vrte.request.request import Wanted
from vrte.scene.scene import Scene


def solve_by_single_scattering(task: Task) -> Answer:
    """Single scattering with all terms of the phase matrix; fluxes by quadrature over its nodes."""
    parts = task.sum_orders(task.problem)
    return task.answer(parts, integrate_fluxes(task), task.problem)


def integrate_fluxes(task: Task) -> tuple[Array, Array]:
    """Diffuse fluxes up and down, (n_tau, n_in, n_col), from the radiance along the nodes averaged over azimuth."""
    request = task.request
    points, weights = make_double_gauss(request.nodes or NODES)
    mu = np.concatenate([points, -points])
    terms = max(layer.phase_matrix.terms for layer in request.scene.layers)
    phi: Array = np.linspace(0.0, 360.0, 2 * terms, endpoint=False)
    levels, directions = np.arange(request.tau.size, dtype=np.int32), np.arange(mu.size, dtype=np.int32)
    columns = np.arange(request.columns.shape[0], dtype=np.int32)
    wanted = Wanted([(levels, directions)], columns, np.ones(request.mu0.size))
    along = replace(request, mu=mu, phi=phi, wanted=wanted)
    (values,) = replace(task, request=along).sum_orders(discretise_request(along))
    mean = values[..., 0, :].mean(axis=3)  # (n_tau, n_in, n_mu, n_col)
    up, down = (np.einsum("tioc,o->tic", half, 2.0 * np.pi * weights * points) for half in np.split(mean, 2, axis=2))
    return up, down


def predict_fluxes(task: Task) -> float:
    """Operations of the fluxes: series of all terms towards the nodes at twice as many azimuths."""
    layers = task.request.scene.layers
    terms = float(max(layer.phase_matrix.terms for layer in layers))
    towards = task.request.mu0.size * 2.0 * task.problem.nodes.size * 2.0 * terms
    return cost.A_TERM * len(layers) * terms * towards


NO_TENSOR = [1, 2, 4, 5]  # a2, a3, b1 and b2, whose functions vanish below degree 2
NOTE = "small-angle: nothing goes up; radiance there is zero by definition"


def solve_by_small_angles(task: Task) -> Answer:
    """The exact sum (2:29), which solves (2:28); flux down by quadrature without error, flux up zero."""
    mu, problem = task.mu, task.problem
    target = task.target_of(problem)
    tables, parts = expand_diffuse_part(task.request.scene, problem), make_parts(target)
    scatter = prepare_closed_form(target, task.run)

    def spread(part: Part, t: int, i: int) -> None:
        table = _core.series_table(tables[part.levels[t], i])
        share = np.where(part.mu < 0.0, target.wanted.scale[i] / (4.0 * np.pi), 0.0)[None, None]
        values = part.values[t : t + 1, i : i + 1]
        scatter("small angles", table, share, problem.mu0[i : i + 1].copy(), part.mu, 0, 1, values)

    for part in parts:
        for t, i in np.ndindex(part.levels.size, problem.mu0.size):
            spread(part, t, i)
    down = compute_flux_down(problem, tables)
    more = {"notes": [NOTE]} if (mu > 0.0).any() else {}
    return task.answer([part.values for part in parts], (np.zeros_like(down), down), problem, **more)


def expand_diffuse_part(scene: Scene, problem: Problem) -> Array:
    """Coefficients a1 .. b2 of the diffuse part of a unit beam at every depth, (n_tau, n_in, terms, 6)."""
    anisotropic = Anisotropic(scene, problem)
    tables = np.empty((problem.level.size, problem.mu0.size, anisotropic.terms, 6))
    for i, mu0 in enumerate(problem.mu0.tolist()):
        beams = find_diffuse_beams(anisotropic, mu0)
        for t, (layer, level) in enumerate(zip(problem.level_layer.tolist(), problem.level.tolist(), strict=True)):
            spreading = anisotropic.spreadings[layer]
            passed = spread_beam(spreading, scene.layers[layer].albedo, level / mu0, beams[layer])
            tables[t, i] = spreading.coefficients(passed.degrees, 0)
    tables[..., :2, NO_TENSOR] = 0.0
    return tables


def find_diffuse_beams(anisotropic: Anisotropic, mu0: float) -> list[Beam]:
    """The beam at the top of every layer; ``degrees`` without the light never scattered."""
    beams = [Beam(1.0, 0.0 * anisotropic.spreadings[0].identity(anisotropic.terms))]
    for layer, spreading in zip(anisotropic.scene.layers[:-1], anisotropic.spreadings[:-1], strict=True):
        beams.append(spread_beam(spreading, layer.albedo, layer.thickness / mu0, beams[-1]))
    return beams


def spread_beam(spreading: AnySpreading, albedo: float, path: float, beam: Beam) -> Beam:
    """The diffuse beam after a path: what it was spreads on, and scattered light of the direct one joins it."""
    if path == 0.0:
        return beam
    kept = spreading.function(lambda s: np.exp((albedo * s - 1.0) * path))
    gained = spreading.function(
        lambda s: albedo * s * path * divide_exp_once((albedo * s - 1.0) * path, -path * np.ones_like(s))
    )
    return Beam(beam.direct * float(np.exp(-path)), spreading.product(kept, beam.degrees) + beam.direct * gained)


def compute_flux_down(problem: Problem, tables: Array) -> Array:
    """Downward fluxes (n_tau, n_in, n_col): order 0, in P_l(mu), times mu integrated over a hemisphere."""
    share = integrate_legendre(tables.shape[2])
    functions = _core.generalized_spherical_functions(0, tables.shape[2], problem.mu0.copy())  # (term, n_in, P -R T)
    of_I = np.einsum("l,til,li->ti", share, tables[..., 0], functions[..., 0])
    of_Q = -np.einsum("l,til,li->ti", share, tables[..., 4], functions[..., 1])
    return 0.5 * (of_I[..., None] * problem.columns[:, 0] + of_Q[..., None] * problem.columns[:, 1])


def integrate_legendre(terms: int) -> Array:
    """The integral of mu P_l(mu) from 0 to 1, (terms,).

    >>> integrate_legendre(5)[[0, 1, 2, 4]] * [2, 3, 8, -48]
    array([1., 1., 1., 1.])
    """
    found = np.zeros(max(terms, 2))
    found[:2] = 0.5, 1.0 / 3.0
    l = np.arange(0.0, terms - 2.0, 2.0)
    found[2:terms:2] = 0.5 * np.cumprod((1.0 - l) / (l + 4.0))
    return found[:terms]
