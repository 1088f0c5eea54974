"""What multiple scattering of each Fourier order can do, known beforehand: how much of a scene matters."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from vrte import _core
from vrte.arrays import Array
from vrte.discrete_ordinates.problem import ALL, IntArray, Problem, Run
from vrte.discrete_ordinates.single_scattering import scatterers
from vrte.scene import Scene

SHARE = 0.25  # of the accuracy asked for, for each thing left out
SAMPLES = 5  # directions of each kind that singly scattered light is looked at
DECAYS = np.array([0.0, 0.25, 0.5, 0.75, 0.9])  # fractions of 1 - q that light of an order may fade with
LARGEST_GAIN = 1e4  # 1/(1 - q)^2 counts no higher: orders as strong as that see every node
WORTH_THREADS = 1e6  # spherical functions: a few milliseconds
ALMOST_ONE = 1.0 - 1e-12  # of q: light of a stronger order never fades


@dataclass(frozen=True, eq=False)
class Needs:
    """by_layer (layer, order), its largest, strength (order,), bounds (order,), effect (order, node): see
    `order_bounds` in _core.pyx."""

    by_layer: Array
    strength: Array
    bounds: Array
    effect: Array


def needs_of(problem: Problem, run: Run) -> Needs:
    """Strength of each order, and bounds on what it adds and on what passes by way of each node."""
    n_order, directions = int(problem.terms.max()), problem.directions
    by_layer = np.empty((problem.albedo.size, n_order))
    bounds, effect = np.empty(n_order), np.empty((n_order, problem.nodes.size))
    if directions.size * n_order**2 < WORTH_THREADS:
        run = replace(run, threads=1)
    run.timed(
        "planning",
        _core.order_bounds,
        problem.coefficients,
        problem.terms,
        problem.albedo,
        directions,
        problem.weights,
        problem.mu_out.size,
        by_layer,
        bounds,
        effect,
        run.threads,
        run.work(_core.bounds_work(directions.size, n_order)),
    )
    return Needs(by_layer, by_layer.max(axis=0), bounds, effect)


def brightness(scene: Scene, problem: Problem, mu: Array, run: Run) -> Array:
    """Singly scattered I per unit of incident light, seen along a few of the directions ``mu``: the brightest at each
    depth for the beam that it is faintest of, (n_tau,). Never more than the light there is."""
    out, into = mu[spread(mu.size)], np.ascontiguousarray(problem.mu0[spread(problem.mu0.size)])
    few = replace(problem, mu0=into)
    levels = np.arange(problem.level.size, dtype=np.int32)
    light = np.zeros((levels.size, into.size, out.size, 2, 4, 1))
    for coefficients, path in scatterers(scene.layers, few, levels, out):
        run.timed(
            "planning",
            _core.add_single_scattering,
            coefficients,
            path,
            into,
            out,
            np.array([1.0, -1.0]),
            np.zeros(2),
            np.arange(2, dtype=np.int32),
            np.ones(2),
            np.array([[1.0, 0.0, 0.0, 0.0]]),
            np.zeros(1, np.int32),
            np.zeros(1, np.int32),
            0,
            into.size,
            light,
            1,
            run.work(_core.scattering_work(1, 2)),
        )
    brightest: Array = light[..., 0, 0].max(axis=(2, 3), initial=0.0).min(axis=1)
    return brightest


@cache
def spread(count: int) -> IntArray:
    """A few places among ``count``, first and last included."""
    places: IntArray = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(np.int32))
    return places


def orders_that_matter(needs: Needs, depth: Array, brightest: Array, accuracy: float) -> int:
    """So many orders that all others together add less, at every depth, than a share of the accuracy; at least 1."""
    return _core.orders_that_matter(needs.strength, needs.bounds, depth, brightest, DECAYS, SHARE * accuracy)


def nodes_seen(needs: Needs, brightest: float, accuracy: float) -> IntArray:
    """How many nodes, from the lowest mu, each order needs: what passes by way of the others is less than a share."""
    allowed = SHARE * accuracy * brightest / needs.strength.size
    return _core.nodes_seen(needs.strength, needs.effect, allowed, LARGEST_GAIN)


def layers_reached(problem: Problem, strengths: Array, accuracy: float) -> tuple[list[int], list[bool]]:
    """How many layers light of each order comes back from, and whether it comes back from the end of the last of them.

    On its way down from the lowest level asked for, and up again, it fades with kappa = 0.8 (1 - q) at least.
    """
    deepest, n_layer, n_order = int(problem.level_layer.max()), problem.albedo.size, strengths.shape[1]
    start = float(problem.level[problem.level_layer == deepest].max())
    enough = -0.5 * math.log(SHARE * accuracy)
    if 0.8 * (float(problem.thickness[deepest:].sum()) - start) < enough:  # no light fades that much on the way
        return [n_layer] * n_order, [True] * n_order
    layers, has_end = np.full(n_order, n_layer), np.full(n_order, not math.isinf(problem.thickness[-1]))
    path, gain, left = np.zeros(n_order), np.ones(n_order), np.ones(n_order, bool)
    for layer in range(deepest, n_layer):
        q = np.minimum(strengths[layer], ALMOST_ONE)
        kappa = np.where(q < ALMOST_ONE, 0.8 * (1.0 - q), 0.0)
        gain = np.maximum(gain, (0.2 + 0.8 * q) / (0.2 * (1.0 - q)))
        length = min(float(problem.thickness[layer]), 1e300) - (start if layer == deepest else 0.0)
        path = path + kappa * length
        found = left & (path >= np.log(gain) + enough)
        layers[found], has_end[found] = layer + 1, False
        left &= ~found
        if not left.any():
            break
    return layers.tolist(), has_end.tolist()


def stokes_sets(problem: Problem) -> list[tuple[tuple[int, ...], ...]]:
    """The sets of Stokes parameters that each order keeps apart, ascending, without those that do not scatter."""
    if not problem.coefficients[..., 1:].any():
        return [((0,),)] * problem.coefficients.shape[1]
    present = (problem.coefficients[problem.albedo > 0.0] != 0.0).any(axis=0)
    present = np.logical_or.accumulate(present[::-1], axis=0)[::-1]  # in the degrees l >= m
    return [sets_of(order > 0, *row) for order, row in enumerate(present[:, 1:].tolist())]


@cache
def sets_of(turns: bool, a2: bool, a3: bool, a4: bool, b1: bool, b2: bool) -> tuple[tuple[int, ...], ...]:
    """Which of I, Q, U, V mix, given which coefficients there are, and whether the order turns Q into U."""
    parent = list(ALL)

    def join(a: int, b: int) -> None:
        old, new = max(parent[a], parent[b]), min(parent[a], parent[b])
        parent[:] = [new if p == old else p for p in parent]

    if turns and (a2 or a3):
        join(1, 2)
    if b1:
        join(0, 1)
        if turns:
            join(0, 2)
    if b2:
        join(2, 3)
        if turns:
            join(1, 3)
    scatters = [True, a2 or a3 or b1, a2 or a3 or b2, a4 or b2]
    sets = [tuple(i for i in ALL if parent[i] == p) for p in sorted(set(parent))]
    return tuple(members for members in sets if any(scatters[i] for i in members))
