"""Light scattered once, (2:24)-(2:26) with s = 1, in closed form, and the beam that the base sends back."""

from dataclasses import replace

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.basics.quadrature import make_double_gauss
from vrte.methods.parts.method import NODES, Answer, Task, discretise_request
from vrte.request.request import Wanted


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


def predict_operations(task: Task) -> float:
    """Series of all terms towards the nodes at twice as many azimuths, for the fluxes."""
    layers = task.request.scene.layers
    terms = float(max(layer.phase_matrix.terms for layer in layers))
    towards = task.request.mu0.size * 2.0 * task.problem.nodes.size * 2.0 * terms
    return cost.A_TERM * len(layers) * terms * towards
