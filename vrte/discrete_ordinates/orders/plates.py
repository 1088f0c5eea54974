"""Slabs in which plates let light through: extinction is a matrix, which nodes have in their block of E and F, and
directions off the nodes as further nodes of a weight that no sum sees.

A direction d with the weight w_d receives and sends what its column and row of E say, all of it with sqrt(w_d): light
on the nodes is changed by w_d of itself. Beams and directions that are seen are nodes of their own, though the cosine
be the same, so that no light straight on hides what is scattered.
"""

import numpy as np

from vrte.basics.arrays import Array, IntArray, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slab_response import Responding, Response, respond
from vrte.scene.oriented import polarizes_beams

WEIGHTS = {"doubling": 1e-16, "modes": 3e-6}  # of directions off the nodes, over the mean of a node. Doubling is right
# to rounding from 1e-20 to 1e-14; modes, whose rounding is that of the largest element, to 3e-6 of these matrices
RECIPROCAL = np.array([1.0, 1.0, 1.0, -1.0])


def respond_with_plates(
    name: str, problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> Responding:
    """What `respond` finds, where plates polarize light in any of the layers: as many seen directions at a time as
    there are nodes."""
    if not polarizes_beams(problem.oriented):
        return respond(name, problem, material, thickness, orders, run, quick)
    matrices, stokes, step = assemble(problem, orders, run), len(problem.stokes), problem.nodes.size
    seen: tuple[list[Array], list[Array]] = [], []  # light from the nodes and from beams
    unit = np.repeat(problem.mu0, stokes)  # over its scale: a beam of unit flux across itself
    for first in range(0, problem.mu_out.size, step):
        some = replace_unchecked(problem, mu_out=problem.mu_out[first : first + step], n_up=0)
        rows = slice(stokes * first, stokes * (first + step))
        own = replace_unchecked(matrices, G_E=matrices.G_E[..., rows], G_F=matrices.G_F[..., rows])
        wide, whole = add_directions(some, own, WEIGHTS[name])
        found = respond(name, wide, material, thickness, orders, run, quick, whole)
        scale = np.repeat(np.sqrt(wide.weights * wide.nodes), stokes)[: -problem.size]
        beams, on_nodes = found.nodes[..., : unit.size] * (unit / scale[: unit.size]), found.nodes[..., scale.size :]
        for sent, part in zip(seen, (on_nodes, beams), strict=True):
            sent.append(part[..., unit.size : scale.size, :] / scale[unit.size :, None])
    leaving, passing = (np.concatenate(sent, axis=-2) for sent in seen)
    edge = slice(scale.size, None)
    return Response(
        np.ascontiguousarray(on_nodes[..., edge, :]), beams[..., edge, :], leaving, passing, found.residuals
    )


def add_directions(problem: Problem, matrices: Assembled, weight: float) -> tuple[Problem, Assembled]:
    """A problem whose first nodes are its beams and then the directions that are seen, and its matrices, of the same
    light; off the nodes it has the normal alone, which nothing leads to."""
    stokes, mu = len(problem.stokes), np.concatenate([problem.mu0, problem.mu_out])
    light = weight * float(problem.weights.mean())
    wide = replace_unchecked(
        problem,
        nodes=np.concatenate([mu, problem.nodes]),
        weights=np.concatenate([np.full(mu.size, light), problem.weights]),
        mu0=np.ones(1),
        mu_out=np.ones(1),
        n_up=0,
        columns=np.eye(stokes),
    )
    members, first, edge = list(problem.stokes), stokes * mu.size, stokes * problem.mu0.size
    root = np.repeat(np.sqrt(light / mu), stokes)  # of what directions receive and send, over what nodes do
    turn = RECIPROCAL[members * problem.nodes.size]
    apart = np.arange(first).reshape(mu.size, stokes)
    found = np.zeros((2, *matrices.E.shape[:2], wide.size, wide.size))
    found[:, ..., first:, first:] = matrices.E, matrices.F
    for k in range(problem.albedo.size):
        one = problem.oriented[k] if problem.oriented else None
        K = np.broadcast_to(np.eye(4), (mu.size, 4, 4)) if one is None else one.extinguish(mu)
        lost = K[:, members][:, :, members] / mu[:, None, None]
        rates = root[edge:] * np.repeat(K[problem.mu0.size :, 0, 0], stokes)
        for own, G, source in zip(
            found[:, :, k],
            (matrices.G_E[:, k], matrices.G_F[:, k]),
            (matrices.source_d[:, k], matrices.source_s[:, k]),
            strict=True,
        ):
            sent, seen = -source * root[:edge, None], -G * rates  # (order, column, row) each
            own[:, :edge, first:], own[:, first:, edge:first] = sent, seen
            # the same light turned round: to beams from the nodes, and from directions that are seen
            own[:, first:, :edge] = turn[:, None] * sent.swapaxes(1, 2) * RECIPROCAL[members * problem.mu0.size]
            own[:, edge:first, first:] = RECIPROCAL[members * problem.mu_out.size][:, None] * seen.swapaxes(1, 2) * turn
            own[:, apart[:, None], apart[:, :, None]] = lost
    nothing, dark = np.zeros((*found.shape[1:4], stokes)), np.zeros((*found.shape[1:3], stokes, wide.size))
    return wide, Assembled(found[0], found[1], nothing, nothing, dark, dark)
