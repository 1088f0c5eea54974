"""What multiple scattering of each Fourier order can do, known beforehand: how much of a scene matters."""

import itertools
import math
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray, record, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_interface import replace_dark
from vrte.discrete_ordinates.orders.single_scattering import find_scatterers
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.scene.beams import find_cosines
from vrte.scene.scene import Scene

ORDERS = 0.4  # fraction of the requested accuracy for Fourier orders left out
DECAY = 0.8  # decay rate of an order's light on its way down and up, at least, as a fraction of 1 - q
SHARE = 0.1  # fraction of the requested accuracy for layers left out
SAMPLES = 5  # directions of each kind in which single scattering is evaluated for the bounds
DECAYS = np.array([0.0, 0.25, 0.5, 0.75, 0.9])  # trial decay rates of an order's light, as fractions of 1 - q
TOGETHER = 4  # orders solved between two evaluations of the bounds, for any number of threads
ALMOST_ONE = 1.0 - 1e-12  # q from which the light of an order is taken not to decay
CAREFUL = (1000.0, 30.0)  # trial factors by which bounds may exceed the light that is found
SAFETY = 3.0  # bounds of later orders are at least this many times the orders found
STEEPER = 5.0  # a bound may not fall faster, order to order, than this many times the fall observed
LARGEST_BOUND = 1e150  # upper limit of bounds, so that their products and sums stay finite
LOOKED_AT = 3  # orders, from order 1 on, that bounds are compared with
UNPOLARIZED: dict[str, Any] = {  # incident light of I alone, as the core takes it
    "columns": np.array([[1.0, 0.0, 0.0, 0.0]]),
    "kind": np.zeros(1, np.int32),
    "place": np.zeros(1, np.int32),
}
Sets = tuple[tuple[tuple[int, ...], ...], ...]  # of Stokes parameters that each order keeps apart


@record
class OrderBounds:
    """by_layer (scene layer, order), its largest in each scene, strength (scene, order), bounds (scene, order): see
    `order_bounds` in core/bounds.pxi."""

    by_layer: Array
    strength: Array
    bounds: Array


def list_views(problem: Problem, mu: Array) -> list[tuple[Problem, Array, BoolArray]]:
    """A problem of several media, and signed directions ``mu`` (n_mu,), as each of those with particles in them sees
    light that comes and goes, the densest last, and for which depths (n_tau,): scattering there has no surfaces to get
    through."""
    assert problem.media is not None
    scene, views = problem.media.scene, []
    lies_in = problem.media.depths.medium(scene.media)
    for index, medium in itertools.product(sorted(set(scene.indices)), dict.fromkeys(lies_in.tolist())):
        ways = (scene.index_above, problem.mu0), (medium, problem.mu_out), (medium, np.abs(mu))
        place = 1 + scene.indices.index(index)
        into, out, seen = (replace_dark(find_cosines(scene.media, *way)[place]) for way in ways)
        inside = replace_unchecked(problem, media=None, mu0=into, mu_out=out)
        views.append((inside, np.sign(mu) * seen, lies_in == medium))
    return views


def find_order_bounds(problem: Problem, run: Run, depth: Array | None = None) -> tuple[OrderBounds, Array]:
    """Strength of each order, and bounds on what its multiple scattering adds, for any beam: to all, and at each depth
    (scene, n_tau), (scene, order, n_tau, 1). Light decays with depth at least as fast as e^(-kappa tau), kappa < 1 -
    q."""
    directions, (_, terms, _) = problem.directions, problem.coefficients.shape
    if run.threads > 1 and directions.size * terms**2 < cost.WORTH_THREADS_BOUNDS:
        run = replace_unchecked(run, threads=1)
    with run.timed("planning") as crew:
        found = _core.order_bounds(
            crew,
            coefficients=problem.coefficients,
            terms=problem.terms,
            albedo=problem.albedo,
            directions=directions,
            n_node=problem.nodes.size,
            n_out=problem.mu_out.size,
            depths=np.zeros((problem.scenes, 0)) if depth is None else depth.reshape(problem.scenes, -1),
            rates=DECAYS,
            slab_stacks=problem.scenes,
        )
    by_layer = found["strength"]
    strength = by_layer if problem.layers == 1 else by_layer.reshape(problem.scenes, -1, terms).max(axis=1)
    return OrderBounds(by_layer, strength, found["bounds"]), found["added"][..., None]


def find_brightness(scenes: Sequence[Scene], problem: Problem, mu: Array, phi: Array, run: Run) -> Array:
    """Singly scattered I per unit of incident light, seen along a few of the directions ``mu`` and azimuths ``phi``
    (degrees): the brightest at each depth for each beam, (scene, n_tau, n_in). Never more than the light there is, so
    without forward peaks where they are taken off: their light goes on being scattered."""
    out, into, azimuths = mu[spread_places(mu.size)], problem.mu0, fold_azimuths(phi[spread_places(phi.size)])
    levels = np.arange(problem.level_layer.size, dtype=np.int32)
    alone = run if run.threads == 1 else replace_unchecked(run, threads=1)
    light = np.zeros((problem.scenes, levels.size, into.size, out.size, azimuths.phi.size, 4, 1))
    for table, path in find_scatterers(scenes, problem, levels, out, whole=not problem.fraction.any()):
        with alone.timed("planning") as crew:
            _core.add_single_scattering(
                crew,
                table=table,
                path=path,
                mu0=into,
                mu=out,
                **azimuths.arguments,
                **UNPOLARIZED,
                first=0,
                last=into.size,
                out=light.reshape(-1, *light.shape[2:]),
                slab_stacks=problem.scenes,
            )
    return light[..., 0, 0].max(axis=(3, 4), initial=0.0)


@cache
def spread_places(count: int) -> IntArray:
    """A few places among ``count``, first and last included."""
    indices: IntArray = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(np.int32))
    indices.setflags(write=False)  # shared by all who ask
    return indices


def count_orders_that_matter(bounds: Array, brightest: Array, accuracy: float) -> IntArray:
    """So many orders of each scene that all others together add less, at every depth, than a share of the accuracy; at
    least 1, (scene,).

    bounds (scene, order, n_tau, n_in or 1), brightest (scene, n_tau, n_in).
    """
    return _core.orders_that_matter(
        bounds=bounds, brightest=brightest, allowed=ORDERS * accuracy, largest=LARGEST_BOUND
    )


def choose_stages(
    bounds: Array, brightest: Array, accuracy: float, careful: Sequence[float] = CAREFUL
) -> tuple[int, ...]:
    """Orders before which the bounds of a scene are compared with what was found: those that would be the first to be
    left out, at the depth that needs fewest and at the one that needs most, were the bounds ``careful`` times too
    large."""
    by_depth = bounds[0].transpose(1, 0, 2)[:, :, None].copy(), brightest[0][:, None].copy()
    counts = [count_orders_that_matter(*by_depth, factor * accuracy) for factor in careful]
    ends = {int(end) for count in counts for end in (count.min(), count.max())}
    return tuple(sorted({1 + -(-(first - 1) // TOGETHER) * TOGETHER for first in ends}))


def calibrate_bounds(needs: OrderBounds, bounds: Array, found: dict[int, Array]) -> Array:
    """The bounds (1, order, n_tau, 1) of a scene; for each beam, (1, order, n_tau, n_in), those of orders to come are
    lowered to SAFETY times what the last orders showed of them.

    found: the largest of each order solved, (n_tau, n_in). The bounds are compared less their factor 1/(1 - q), which
    falls with the order and is the careful part. Nothing is lowered before there are two orders but 0 to look at, nor
    where the bound of the next one falls much more steeply than light did so far: it is careful in another way then.
    """
    orders = sorted(order for order in found if order > 0)[-LOOKED_AT:]
    if len(orders) < 2 or orders[-1] + 1 >= bounds.shape[1]:
        return bounds
    (known,), (strength,) = bounds, needs.strength
    alone = known[orders] * (1.0 - np.minimum(strength[orders], ALMOST_ONE))[:, None, None]
    seen = np.stack([found[order] for order in orders])
    fraction = np.minimum(seen / np.maximum(alone, 1.0 / LARGEST_BOUND), LARGEST_BOUND).max(axis=0)
    fall = (np.minimum(seen[1:], seen[:-1]) / np.maximum(seen[:-1], 1e-300)).max(axis=0)
    trusted = STEEPER * fraction * np.minimum(known[orders[-1] + 1], LARGEST_BOUND) >= fall * seen[-1]
    lowered = np.broadcast_to(known, (known.shape[0], *fraction.shape)).copy()
    factor = np.where(trusted, np.minimum(1.0, SAFETY * fraction), 1.0)
    np.multiply(known, factor, out=lowered, where=np.isfinite(known))
    lowered[: orders[-1] + 1] = known[: orders[-1] + 1]
    return lowered[None]


def find_bottoms_seen(problem: Problem, accuracy: float) -> list[bool]:
    """Whether light of every order comes back from the bottom of each scene: what lies below the lowest level asked
    for is too thin for it to decay."""
    layers, levels, at = problem.layers, problem.level_layer.size, problem.level_layer.tolist()
    thickness, level, deepest = problem.thickness.tolist(), problem.level.tolist(), max(at)
    found = []
    for k in range(problem.scenes):
        start = max([depth for depth, layer in zip(level[k * levels :], at, strict=False) if layer == deepest])
        way = sum(thickness[k * layers + deepest : (k + 1) * layers]) - start
        found.append(DECAY * way < -0.5 * math.log(SHARE * accuracy))
    return found


def list_layers_reached(problem: Problem, strengths: Array, accuracy: float) -> tuple[tuple[int, bool], ...]:
    """How many layers light of each order comes back from, and whether it comes back from the end of the last of them;
    strengths (layer, order).

    On its way down from the lowest level asked for, and up again, it decays with kappa = DECAY (1 - q) at least.
    """
    deepest, n_layer, n_order = int(problem.level_layer.max()), problem.albedo.size, strengths.shape[1]
    start = float(problem.level[problem.level_layer == deepest].max())
    enough = -0.5 * math.log(SHARE * accuracy)
    layers, has_end = np.full(n_order, n_layer), np.full(n_order, not math.isinf(problem.thickness[-1]))
    path, gain, left = np.zeros(n_order), np.ones(n_order), np.ones(n_order, bool)
    for layer in range(deepest, n_layer):
        q = np.minimum(strengths[layer], ALMOST_ONE)
        kappa = np.where(q < ALMOST_ONE, DECAY * (1.0 - q), 0.0)
        gain = np.maximum(gain, (0.2 + 0.8 * q) / (0.2 * (1.0 - q)))
        length = min(float(problem.thickness[layer]), 1e300) - (start if layer == deepest else 0.0)
        path = path + kappa * length
        found = left & (path >= np.log(gain) + enough)
        layers[found], has_end[found] = layer + 1, False
        left &= ~found
        if not left.any():
            break
    return tuple(zip(layers.tolist(), has_end.tolist(), strict=True))


def list_stokes_sets(problem: Problem) -> list[Sets]:
    """The sets of Stokes parameters that each order of each scene keeps apart, ascending, without those that do not
    scatter."""
    if problem.media is not None:
        every = list_stokes_sets(replace_unchecked(problem, media=None))
        joined = [[join_stokes_sets(found) for found in sets] for sets in every]
        if problem.media.scene.is_rough:  # whose facets turn Q into U at any order but 0
            joined = [[*sets[:1], *[(ALL,) if found else () for found in sets[1:]]] for sets in joined]
        return [tuple(sets) for sets in joined]
    return [name_stokes_sets(*row) for row in list_couplings(problem)]


def list_couplings(problem: Problem) -> list[list[int]]:
    """Which coefficients there are, by scene and order: see `couplings` in core/stages.toml."""
    slabs = problem.coefficients, problem.albedo, problem.scenes
    found: list[list[int]] = _core.couplings(*slabs).tolist()
    return found


@lru_cache(maxsize=256)
def name_stokes_sets(*present: int) -> Sets:
    """The same of one scene, of whose coefficients these are there in each order."""
    return tuple(find_stokes_sets(order > 0, those) for order, those in enumerate(present))


@cache
def find_stokes_sets(turns: bool, present: int) -> tuple[tuple[int, ...], ...]:
    """Which of I, Q, U, V mix, given which coefficients there are, and whether the order turns Q into U."""
    parent = list(ALL)
    a2, a3, a4, b1, b2 = (bool(present & 1 << k) for k in range(5))

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


@cache
def join_stokes_sets(sets: tuple[tuple[int, ...], ...]) -> tuple[tuple[int, ...], ...]:
    """The same where interfaces mix I with Q and U with V.

    >>> join_stokes_sets(((0,),)), join_stokes_sets(((0, 1, 2), (3,)))
    (((0, 1),), ((0, 1, 2, 3),))
    """
    pairs = ((0, 1), (2, 3))
    if any({0, 1} & set(members) and {2, 3} & set(members) for members in sets):
        return (ALL,)
    return tuple(pair for pair in pairs if any(set(pair) & set(members) for members in sets))


def explain_stokes_sets(problem: Problem, order_0: bool) -> str:
    """Why Stokes parameters are solved apart, or not at all; ``order_0``: whether it is among the orders solved."""
    if problem.is_scalar:
        return "Q, U and V: the phase functions are scalar and scatter I alone"
    present = list_couplings(problem)[0][0]
    missing = set(ALL) - {index for members in find_stokes_sets(True, present) for index in members}
    letters = " ".join("IQUV"[index] for index in sorted(missing))
    reasons = (
        (order_0, "order 0 keeps I, Q and U, V apart"),
        (not present & 16, "b2 = 0 keeps V apart from I, Q, U"),
        (bool(missing), f"{letters} does not scatter"),
    )
    return f"couplings of Stokes parameters: {'; '.join(reason for holds, reason in reasons if holds)}"
