"""What multiple scattering of each Fourier order can do, known beforehand: how much of a scene matters."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import find_scatterers
from vrte.scene.beams import find_cosines
from vrte.scene.scene import Scene

ORDERS = 0.4  # fraction of the requested accuracy for Fourier orders left out
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


@dataclass(frozen=True, eq=False)
class OrderBounds:
    """by_layer (layer, order), its largest, strength (order,), bounds (order,): see `order_bounds` in
    core/bounds.pxi."""

    by_layer: Array
    strength: Array
    bounds: Array


def view_from_densest_medium(problem: Problem, mu: Array) -> tuple[Problem, Array]:
    """The problem, and signed directions ``mu`` (n_mu,), as the densest of the media with particles in them sees light
    that comes and goes: scattering there has no surfaces to get through."""
    if problem.media is None:
        return problem, mu
    scene = problem.media.scene
    index = max(scene.indices)
    place = 1 + scene.indices.index(index)

    def refract(medium: float, cosines: Array) -> Array:
        found = find_cosines(scene.media, medium, cosines)[place]
        return np.where(found > 0.0, found, 1.0)

    outside = float(problem.media.depths.medium(scene.media)[0])
    inside = replace_unchecked(
        problem, media=None, mu0=refract(scene.index_above, problem.mu0), mu_out=refract(outside, problem.mu_out)
    )
    return inside, np.sign(mu) * refract(outside, np.abs(mu))


def find_order_bounds(problem: Problem, run: Run) -> OrderBounds:
    """Strength of each order, and a bound on what it adds."""
    directions, terms = problem.directions, problem.coefficients.shape[1]
    if directions.size * terms**2 < cost.WORTH_THREADS_BOUNDS:
        run = replace_unchecked(run, threads=1)
    layers = problem.coefficients, problem.terms, problem.albedo
    by_layer, bounds = bound_orders(*layers, directions, problem.nodes.size, problem.mu_out.size, run)
    return OrderBounds(by_layer, by_layer.max(axis=0), bounds[0])


def bound_orders(
    coefficients: Array,
    terms: IntArray,
    albedo: Array,
    directions: Array,
    n_node: int,
    n_out: int,
    run: Run,
    scenes: int = 1,
) -> tuple[Array, Array]:
    """Strength (layer, order) and bounds (scene, order), of scenes whose layers lie one behind the other; arguments as
    in core/bounds.pxi."""
    by_layer, bounds = np.empty(coefficients.shape[:2]), np.empty((scenes, coefficients.shape[1]))
    with run.timed("planning") as crew:
        _core.order_bounds(
            crew,
            coefficients=coefficients,
            terms=terms,
            albedo=albedo,
            directions=directions,
            n_node=n_node,
            n_out=n_out,
            strength=by_layer,
            bounds=bounds.ravel(),
            slab_stacks=scenes,
        )
    return by_layer, bounds


def find_brightness(scene: Scene, problem: Problem, mu: Array, phi: Array, run: Run) -> Array:
    """Singly scattered I per unit of incident light, seen along a few of the directions ``mu`` and azimuths ``phi``
    (degrees): the brightest at each depth for each beam, (n_tau, n_in). Never more than the light there is, so without
    forward peaks where they are taken off: their light goes on being scattered."""
    out, into, angles = mu[spread_places(mu.size)], problem.mu0, np.radians(phi[spread_places(phi.size)])
    whole = not problem.fraction.any()
    levels = np.arange(problem.level.size, dtype=np.int32)
    light = np.zeros((levels.size, into.size, out.size, angles.size, 4, 1))
    for table, path in find_scatterers(scene.layers, problem, levels, out, whole):
        add_brightness(light, table, path, (into, out, angles), replace_unchecked(run, threads=1))
    return light[..., 0, 0].max(axis=(2, 3), initial=0.0)


def add_brightness(
    light: Array, table: Array, path: Array, seen: tuple[Array, Array, Array], run: Run, scenes: int = 1
) -> None:
    """Adds unpolarized light scattered once to ``light`` (level, n_in, n_mu, n_phi, 4, 1), in place, along mu0, mu and
    azimuths [rad] of what is ``seen``."""
    mu0, mu, angles = seen
    with run.timed("planning") as crew:
        _core.add_single_scattering(
            crew,
            table=table,
            path=path,
            mu0=mu0,
            mu=mu,
            cos_phi=np.cos(angles),
            sin_phi=np.sin(angles),
            angle=np.arange(angles.size, dtype=np.int32),
            sign=np.ones(angles.size),
            columns=np.array([[1.0, 0.0, 0.0, 0.0]]),
            kind=np.zeros(1, np.int32),
            place=np.zeros(1, np.int32),
            first=0,
            last=mu0.size,
            out=light,
            slab_stacks=scenes,
        )


@cache
def spread_places(count: int) -> IntArray:
    """A few places among ``count``, first and last included."""
    indices: IntArray = np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).round().astype(np.int32))
    indices.setflags(write=False)  # shared by all who ask
    return indices


def count_orders_that_matter(bounds: Array, brightest: Array, accuracy: float) -> int:
    """So many orders that all others together add less, at every depth, than a share of the accuracy; at least 1.

    bounds (order, n_tau, n_in or 1), brightest (n_tau, n_in).
    """
    tail = 2.0 * np.minimum(bounds, LARGEST_BOUND)[::-1].cumsum(axis=0)[::-1]
    small = (tail <= ORDERS * accuracy * brightest).reshape(bounds.shape[0], -1).all(axis=1)
    return max(1, bounds.shape[0] - int(np.count_nonzero(small)))


def choose_stages(bounds: Array, brightest: Array, accuracy: float) -> tuple[int, ...]:
    """Orders before which the bounds are compared with what was found: those that would be the first to be left out, at
    the depth that needs fewest and at the one that needs most, were the bounds too careful by a factor."""
    depths = range(brightest.shape[0])
    found = set()
    for careful in CAREFUL:
        counts = [count_orders_that_matter(bounds[:, [t]], brightest[[t]], careful * accuracy) for t in depths]
        found |= {min(counts), max(counts)}
    return tuple(sorted({1 + -(-(first - 1) // TOGETHER) * TOGETHER for first in found}))


def find_bounds_at(needs: OrderBounds, depth: Array) -> Array:
    """What multiple scattering of each order adds at most at each depth, for any beam, (order, n_tau, 1).

    An order decays with depth at least as fast as e^(-kappa tau), kappa < 1 - q: its bound there is
    bound e^(-kappa tau)/((1 - kappa) (1 - q/(1 - kappa))).
    """
    bounds: Array = _core.bounds_at(strength=needs.strength, bounds=needs.bounds, depth=depth, decays=DECAYS)
    return bounds[..., None]


def calibrate_bounds(needs: OrderBounds, bounds: Array, found: dict[int, Array]) -> Array:
    """The bounds (order, n_tau, 1) for each beam, those of orders to come lowered to SAFETY times what the last orders
    showed of them, (order, n_tau, n_in).

    found: the largest of each order solved, (n_tau, n_in). The bounds are compared less their factor 1/(1 - q), which
    falls with the order and is the careful part. Nothing is lowered before there are two orders but 0 to look at, nor
    where the bound of the next one falls much more steeply than light did so far: it is careful in another way then.
    """
    orders = sorted(order for order in found if order > 0)[-LOOKED_AT:]
    if len(orders) < 2 or orders[-1] + 1 >= bounds.shape[0]:
        return bounds
    alone = bounds[orders] * (1.0 - np.minimum(needs.strength[orders], ALMOST_ONE))[:, None, None]
    seen = np.stack([found[order] for order in orders])
    fraction = np.minimum(seen / np.maximum(alone, 1.0 / LARGEST_BOUND), LARGEST_BOUND).max(axis=0)
    fall = (np.minimum(seen[1:], seen[:-1]) / np.maximum(seen[:-1], 1e-300)).max(axis=0)
    trusted = STEEPER * fraction * np.minimum(bounds[orders[-1] + 1], LARGEST_BOUND) >= fall * seen[-1]
    lowered = np.broadcast_to(bounds, (bounds.shape[0], *fraction.shape)).copy()
    factor = np.where(trusted, np.minimum(1.0, SAFETY * fraction), 1.0)
    np.multiply(bounds, factor, out=lowered, where=np.isfinite(bounds))
    lowered[: orders[-1] + 1] = bounds[: orders[-1] + 1]
    return lowered


def count_layers_reached(problem: Problem, strengths: Array, accuracy: float) -> tuple[list[int], list[bool]]:
    """How many layers light of each order comes back from, and whether it comes back from the end of the last of them.

    On its way down from the lowest level asked for, and up again, it decays with kappa = 0.8 (1 - q) at least.
    """
    deepest, n_layer, n_order = int(problem.level_layer.max()), problem.albedo.size, strengths.shape[1]
    start = float(problem.level[problem.level_layer == deepest].max())
    enough = -0.5 * math.log(SHARE * accuracy)
    if 0.8 * (float(problem.thickness[deepest:].sum()) - start) < enough:  # no light decays that much on the way
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


def list_stokes_sets(problem: Problem) -> list[tuple[tuple[int, ...], ...]]:
    """The sets of Stokes parameters that each order keeps apart, ascending, without those that do not scatter."""
    if problem.media is not None:
        sets = list_stokes_sets(replace_unchecked(problem, media=None))
        return [join_stokes_sets(found) for found in sets]
    if problem.is_scalar:
        return [((0,),)] * problem.coefficients.shape[1]
    present = (problem.coefficients[problem.albedo > 0.0] != 0.0).any(axis=0)
    present = np.logical_or.accumulate(present[::-1], axis=0)[::-1]  # in the degrees l >= m
    return [find_stokes_sets(order > 0, *row) for order, row in enumerate(present[:, 1:].tolist())]


@cache
def find_stokes_sets(turns: bool, a2: bool, a3: bool, a4: bool, b1: bool, b2: bool) -> tuple[tuple[int, ...], ...]:
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
    present = (problem.coefficients[problem.albedo > 0.0] != 0.0).any(axis=(0, 1))[1:].tolist()
    missing = set(ALL) - {index for members in find_stokes_sets(True, *present) for index in members}
    letters = " ".join("IQUV"[index] for index in sorted(missing))
    reasons = (
        (order_0, "order 0 keeps I, Q and U, V apart"),
        (not present[-1], "b2 = 0 keeps V apart from I, Q, U"),
        (bool(missing), f"{letters} does not scatter"),
    )
    return f"couplings of Stokes parameters: {'; '.join(reason for holds, reason in reasons if holds)}"
