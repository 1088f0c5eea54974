"""What methods share: the discrete problem, and the result from what multiple scattering adds to each Fourier order."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.quadrature import double_gauss
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Target, fill
from vrte.discrete_ordinates.orders.discretise import discretise
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.planning.azimuths import fold
from vrte.discrete_ordinates.planning.node_choice import given_nodes
from vrte.discrete_ordinates.planning.plan import everything
from vrte.request.request import Request
from vrte.request.wanted import Wanted
from vrte.results.solution import Solution

NODES = 16  # of a hemisphere, where none are asked for


def discrete(request: Request) -> tuple[Array, Problem]:
    """The signed cosines of the result, and the scene on nodes, phase matrices cut to the terms that they carry; the
    problem has light going up first."""
    nodes = request.nodes or NODES
    points = double_gauss(nodes)[0]
    mu = np.concatenate([points, -points]) if request.mu is None else request.mu
    rank = np.argsort(mu < 0.0, kind="stable")
    problem = discretise(request.scene, request.mu0, request.columns, mu[rank], request.tau, nodes)
    return mu, problem


def wanted_of(request: Request, mu: Array) -> Wanted:
    """What becomes of the solution."""
    return request.wanted or everything(request, mu)


def light(orders: Any, kernels: Array, stokes: Sequence[int] = ALL) -> Light:
    """Multiply scattered light of Fourier orders, kernels (order, n_tau, n_in, n_col, n_out, S), radiance for a unit
    beam in the public frame, light going up first."""
    columns = np.arange(kernels.shape[3], dtype=np.int32)
    return Light(np.asarray(orders, np.int32), np.array(stokes, np.int32), columns, kernels)


def summed(
    request: Request, problem: Problem, mu: Array, lights: Sequence[Light], run: Run, spread: bool | BoolArray = False
) -> list[Array]:
    """The radiance of every part of what is wanted: Fourier orders, single scattering and the beam that the base
    reflects; ``spread``, True or (n_mu,): there one scattering of the beam as it spreads by small angles stands for
    single scattering."""
    return fill(target_of(request, problem, mu, spread), lights, PROCESSOR, run)


def target_of(request: Request, problem: Problem, mu: Array, spread: bool | BoolArray = False) -> Target:
    """What light is added up into."""
    spreads = np.broadcast_to(np.asarray(spread), mu.shape)
    return Target(wanted_of(request, mu), request.scene, problem, mu, fold(request.phi), spreads)


def fluxes_by_quadrature(request: Request, lights_at: Any, run: Run) -> tuple[Array, Array]:
    """Diffuse fluxes up and down, (n_tau, n_in, n_col), from the radiance along the nodes averaged over azimuth.

    lights_at(problem): Fourier orders of light in the problem's directions, as `summed` takes them.
    """
    points, weights = double_gauss(request.nodes or NODES)
    mu = np.concatenate([points, -points])
    terms = max(layer.phase_matrix.terms for layer in request.scene.layers)
    phi: Array = np.linspace(0.0, 360.0, 2 * terms, endpoint=False)
    levels, directions = np.arange(request.tau.size, dtype=np.int32), np.arange(mu.size, dtype=np.int32)
    columns = np.arange(request.columns.shape[0], dtype=np.int32)
    wanted = Wanted([(levels, directions)], columns, np.ones(request.mu0.size))
    along = replace(request, mu=mu, phi=phi, wanted=wanted)
    problem = discrete(along)[1]
    (values,) = summed(along, problem, mu, lights_at(problem), run)
    mean = values[..., 0, :].mean(axis=3)  # (n_tau, n_in, n_mu, n_col)
    share = 2.0 * np.pi * weights * points
    up, down = np.split(mean, 2, axis=2)
    return np.einsum("tioc,o->tic", up, share), np.einsum("tioc,o->tic", down, share)


def diagnostics_of(request: Request, problem: Problem, run: Run, start: float, **more: Any) -> dict[str, Any]:
    """What a result says of how it was made."""
    return {
        "method": request.method,
        "nodes": int(problem.nodes.size),
        "terms_cut": problem.terms_cut,
        "threads": run.threads,
        **more,
        "stages": run.stages,
        "wall_seconds": time.perf_counter() - start,
    }


def solution_of(
    request: Request,
    problem: Problem,
    mu: Array,
    orders: IntArray,
    kernels: Array,
    fluxes: tuple[Array, Array],
    run: Run,
    start: float,
    **more: Any,
) -> tuple[Array, Solution]:
    """The result of a method that finds multiple scattering order by order; fluxes up and down (n_tau, n_in, n_col)."""
    parts = summed(request, problem, mu, [light(orders, kernels)], run)
    told = diagnostics_of(request, problem, run, start, orders=orders.size, **more)
    notes = given_nodes(request.scene, problem.nodes.size, "").notes
    if notes:
        told |= {"promised": False, "notes": [*notes, *told.get("notes", ())]}
    return mu, Solution(parts, *fluxes, told)
