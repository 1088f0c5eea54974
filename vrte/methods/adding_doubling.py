"""Adding and doubling: slabs doubled from a thin layer, then layers and base added, (2:8)."""

import math
from dataclasses import replace

import numpy as np

from vrte.basics import cost
from vrte.discrete_ordinates.orders.slabs import cut_layers
from vrte.methods.parts.method import Answer, Task
from vrte.methods.parts.slab import OnNodes, Scattered, Slab, connect_media, count_sizes, make_thin_slab, solve_by_slabs

LOWEST = 1e-4  # cosine: below it starting layers are so thin that rounding is seen
DARK = 1e-16  # transmission of a slab that may as well be semi-infinite
NEARLY_DARK = 1e-6  # transmission of a white slab whose R lacks of the semi-infinite layer's just what it transmits
MOST_DOUBLINGS = 70
ENOUGH = 1e-3, 1e-6, 1e-10  # accuracy that 1, 2 and 3 depths of a starting layer of 0.25 keep: a tenth and less is seen
BY_ACCURACY = {"start": lambda accuracy: 1 + sum(accuracy < limit for limit in ENOUGH)}


def solve_by_adding_doubling(task: Task) -> Answer:
    """Every Fourier order of the truncated phase matrices in turn."""
    doublings: list[int] = []

    def build(on_nodes: OnNodes, scattered: Scattered, tau: float, conserves: bool) -> Slab:
        thin = limit_starting_thickness(on_nodes, task.settings["thin"])
        slab, done = build_slab(on_nodes, scattered, tau, thin, task.settings["start"], conserves)
        doublings.append(done)
        return slab

    mu, found = solve_by_slabs(task, build, "doubling")
    return mu, replace(found, diagnostics=found.diagnostics | {"doublings": max(doublings, default=0)})


def limit_starting_thickness(on_nodes: OnNodes, thin: float) -> float:
    """Largest optical thickness of the starting layer: ``thin`` along the lowest cosine of nodes and beams, and between
    interfaces along the lowest cosine of outgoing directions as well, which mirrored light of every node takes."""
    media = on_nodes.problem.media
    mirrors = media is not None and media.scene.keeps_beams
    lowest = min(float(on_nodes.columns.min()), float(on_nodes.rows.min()) if mirrors else math.inf)
    return thin * max(LOWEST, lowest)


def count_doublings(tau: float, thin: float) -> int:
    """How often a starting layer of an optical thickness of at most ``thin`` is doubled, or is at most."""
    if math.isinf(tau):
        return MOST_DOUBLINGS
    return max(0, math.ceil(math.log2(tau / thin))) if tau > 0.0 else 0


def build_slab(
    on_nodes: OnNodes, scattered: Scattered, tau: float, thin: float, start: int, conserves: bool
) -> tuple[Slab, int]:
    """A homogeneous slab and its doublings from a layer of at most ``thin``; a semi-infinite layer is doubled until
    nothing comes through, one that ``conserves`` (order 0 at albedo 1) until what comes through is what R lacks."""
    most = count_doublings(tau, thin)
    slab = make_thin_slab(on_nodes, scattered, thin if math.isinf(tau) else tau / 2.0**most, start)
    for done in range(most + 1):
        slab = balance_flux(slab) if conserves else slab
        if math.isinf(tau):
            through = float(np.abs(slab.T).max())
            if conserves and through < NEARLY_DARK:
                return Slab(on_nodes, tau, slab.R + slab.T, np.zeros_like(slab.T)), done
            if max(through, math.exp(-slab.tau / float(on_nodes.problem.nodes.max()))) < DARK:
                return Slab(on_nodes, tau, slab.R, slab.T), done
        slab = slab.double() if done < most else slab
    return slab, most


def balance_flux(slab: Slab) -> Slab:
    """A white slab whose flux out is the flux in, exactly: what doubling misses by the error of its starting layer and
    by rounding is transmitted, evenly.

    The row of fluxes, weight mu for I, is then a left eigenvector of R + T, on which the inverse of 1 - R R hangs."""
    on_nodes, problem = slab.on_nodes, slab.on_nodes.problem
    stokes = len(problem.stokes)
    row, evenly = np.zeros(on_nodes.n), np.zeros(on_nodes.rows.size)
    row[::stokes] = problem.weights * problem.nodes
    evenly[::stokes] = 1.0 / row.sum()
    into = np.concatenate([row, np.outer(problem.mu0, problem.columns[:, 0]).ravel()])
    missing = into * -np.expm1(-slab.tau / on_nodes.columns) - row @ (slab.R + slab.T)[: on_nodes.n]
    return Slab(on_nodes, slab.tau, slab.R, slab.T + np.outer(evenly, missing))


def predict_operations(task: Task) -> float:
    """Doublings of each distinct slab, starting layers, slabs joined."""
    problem, settings = connect_media(task.request, task.problem), task.settings
    slabs, on_nodes = cut_layers(task.problem), OnNodes(problem)
    n, r, c = count_sizes(task.request, task.problem)
    thin = limit_starting_thickness(on_nodes, settings["thin"])
    doublings = sum(
        cost.SLAB_STEPS_ENDLESS if math.isinf(tau) else count_doublings(tau, thin)
        for tau in np.unique(slabs.thickness).tolist()
    )
    start = (2.0 * settings["start"] * n) ** 2 * (settings["start"] * n + 2.0 * c)
    each = slabs.slabs.size * (start + 40.0 * r * n * c) + doublings * (12.0 * r * n * c + cost.A_DOUBLING)
    return problem.coefficients.shape[1] * each
