"""Roughly how many operations a method beside the exact one takes, before it starts: right to about a factor of 3."""

import math
from collections.abc import Callable, Mapping

import numpy as np

from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.planning.needs import needs_of
from vrte.discrete_ordinates.planning.operations import A_TERM
from vrte.methods import adding_doubling, successive_orders
from vrte.methods.parts import imbedding
from vrte.methods.parts.method import Settings
from vrte.methods.parts.on_nodes import OnNodes
from vrte.methods.parts.task import NODES, discrete
from vrte.request.request import Request

ENDLESS = 25  # doublings of a slab without end
MODES, DIFFERENCES = 500.0, 400.0  # operations over n^3 of complex eigenvectors and functions of them; of a difference
STEPS_A_DEPTH, STEPS, SWEEPS = 3.0, 12.0, 12.0  # of imbedding: an optical depth, at least, sweeps of each
OVERHEAD = 3e5  # operations that a call of NumPy takes the time of
OF_A_DOUBLING, OF_MODES = 2e7, 3.4e8  # that what is no product takes the time of, of an order


def operations_before(request: Request, settings: Settings, run: Run) -> float:
    """Of the method that the request names; 0 where closed forms are a matter of seconds whatever is asked."""
    count = COSTS.get(request.method)
    return count(request, settings, run) if count else 0.0


def of_adding_doubling(request: Request, settings: Settings, run: Run) -> float:
    """Doublings of each distinct slab, starting layers, joints."""
    problem = discrete(request)
    n, r, c = sizes(request, problem)
    thin = settings["thin"] * max(adding_doubling.LOWEST, float(np.min([*problem.nodes, *problem.mu0])))
    cuts = np.unique(
        np.concatenate([np.append(problem.above, problem.above[-1] + problem.thickness[-1]), problem.depth])
    )
    slabs = np.diff(cuts)
    doublings = sum(
        ENDLESS if math.isinf(tau) else adding_doubling.doublings_of(tau, thin) for tau in np.unique(slabs).tolist()
    )
    start = (2.0 * settings["start"] * n) ** 2 * (settings["start"] * n + 2.0 * c)
    return orders_of(problem) * (
        slabs.size * (start + 40.0 * r * n * c) + doublings * (12.0 * r * n * c + OF_A_DOUBLING)
    )


def of_matrix_operator(request: Request, settings: Settings, run: Run) -> float:
    """Modes of each layer, functions of them, and what goes from beams by way of modes into directions."""
    problem = discrete(request)
    n, r, c = sizes(request, problem)
    each = MODES * n**3 + DIFFERENCES * n * (c - n) * max(1.0, (r - n) / 4.0) + OF_MODES
    return orders_of(problem) * (problem.albedo.size + problem.level.size) * each


def of_invariant_imbedding(request: Request, settings: Settings, run: Run) -> float:
    """Sweeps of all steps: their number grows with what an order scatters on its way."""
    problem = discrete(request)
    n, r, c = sizes(request, problem)
    finite = np.where(np.isfinite(problem.thickness), problem.thickness, 0.0)
    strength = np.minimum(needs_of(problem, run).by_layer, 1.0)  # (layer, order)
    steps = STEPS * problem.albedo.size + STEPS_A_DEPTH * (finite @ strength)
    parts = 2.0 if (request.tau > 0.0).any() else 1.0
    sweep = imbedding.POINTS * ((2.0 * n * n + 4.0 * parts * r * n) * c + 20.0 * parts * imbedding.POINTS * r * c)
    return float(steps.sum()) * SWEEPS * (sweep + 10.0 * OVERHEAD)


def of_successive_orders(request: Request, settings: Settings, run: Run) -> float:
    """As many orders as it takes, by how strongly a Fourier order scatters and how much leaves through the faces."""
    problem = discrete(request)
    n, _, c = sizes(request, problem)
    levels = successive_orders.depths_of(problem, settings["levels"]).layer.size * successive_orders.POINTS
    depth = float(problem.thickness.sum())
    kept = 1.0 - min(0.5, math.pi**2 / (3.0 * (depth + 1.42) ** 2))
    ratio = np.clip(needs_of(problem, run).strength * kept, 1e-6, 1.0 - 1e-9)
    scatterings = np.minimum(settings["orders"], 1.0 + math.log(settings["tolerance"]) / np.log(ratio)).sum()
    beams = c - n
    a_row = levels * (8.0 * n * beams + 4.0 * (successive_orders.POINTS + 1) * beams)
    return float(scatterings) * (n * a_row * 2.0 + levels / successive_orders.POINTS * OVERHEAD / 30.0)


def of_single_scattering(request: Request, settings: Settings, run: Run) -> float:
    """Series of all terms towards the nodes at twice as many azimuths, for the fluxes."""
    terms = float(max(layer.phase_matrix.terms for layer in request.scene.layers))
    towards = request.mu0.size * 2.0 * (request.nodes or NODES) * 2.0 * terms
    return A_TERM * len(request.scene.layers) * terms * towards


def sizes(request: Request, problem: Problem) -> tuple[float, float, float]:
    """Unknowns of a hemisphere, rows with the outgoing directions, columns with the beams."""
    on_nodes = OnNodes(problem, request.scene.below)
    n = float(on_nodes.n)
    return n, n + np.unique(problem.mu_out).size * float(len(on_nodes.members)), float(on_nodes.columns.size)


def orders_of(problem: Problem) -> float:
    """How many Fourier orders a method solves: as many as its problem has terms."""
    return float(problem.coefficients.shape[1])


COSTS: Mapping[str, Callable[[Request, Settings, Run], float]] = {
    "single-scattering": of_single_scattering,
    "adding-doubling": of_adding_doubling,
    "matrix-operator": of_matrix_operator,
    "invariant-imbedding": of_invariant_imbedding,
    "successive-orders": of_successive_orders,
}
