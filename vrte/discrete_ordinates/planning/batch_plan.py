"""Small scenes that are lit and seen along the same directions, planned together: each as it would be by itself."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray, replace_unchecked
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import choose_truncation, has_unpolarized_peak, truncate_layers
from vrte.discrete_ordinates.planning.choice import (
    ONE_LAYER,
    THIN,
    count_doubling_steps,
    count_operations_of_modes,
    count_operations_of_scatterings,
    is_for_scatterings,
    predict_doubling_time,
)
from vrte.discrete_ordinates.planning.order_bounds import (
    DECAYS,
    LARGEST_BOUND,
    ORDERS,
    SHARE,
    add_brightness,
    bound_orders,
    find_stokes_sets,
    spread_places,
)
from vrte.request.backends import Backend
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.scene.scene import Scene

Sets = tuple[tuple[tuple[int, ...], ...], ...]  # of Stokes parameters that each order keeps apart
DECAY = 0.8  # decay rate of an order as a fraction of 1 - q, as in `count_layers_reached`


class BatchKey(NamedTuple):
    """What scenes have in common that are solved together: how many layers, which of them share a phase matrix (the
    first of its layers, -1 where nothing scatters), and whether I alone is scattered."""

    layers: int
    shared: tuple[int, ...]
    scalar: bool


@dataclass(frozen=True, eq=False)
class Alike:
    """Scenes of one likeness, asked the same.

    albedo, thickness, above, gain (scene, layer), terms (scene, layer), coefficients (scene, layer, term, 6): of the
    truncated layers, as in `Problem`; tables (scene, layer, row, SERIES): those of single scattering, and ``faint``
    those that it is estimated by; cut (scene,): whether terms are cut; level (scene, n_tau): depths below
    the top of the layers
    level_layer (n_tau,); even (scene,): albedos of the bases; wanted: of each set of Stokes parameters, in the order in
    which their light is added up, the orders of each scene, (order, scene).
    """

    request: Request
    likeness: BatchKey
    scenes: Sequence[Scene]
    nodes: Array
    weights: Array
    mu: Array
    albedo: Array
    thickness: Array
    above: Array
    terms: IntArray
    gain: Array
    cut: BoolArray
    coefficients: Array
    tables: Array
    faint: Array
    level: Array
    level_layer: IntArray
    even: Array
    wanted: dict[tuple[int, ...], BoolArray]

    @property
    def size(self) -> int:
        """How many scenes are planned together."""
        return len(self.scenes)

    @property
    def directions(self) -> Array:
        """Nodes, then outgoing, then incident cosines."""
        return np.concatenate([self.nodes, np.abs(self.mu), self.request.mu0])

    def integrate_paths(self, levels: IntArray, mu: Array, strength: Array) -> Array:
        """``strength`` (scene, layer) over 4 pi, times the path integrals of what scatters once, (scene, layer,
        n_level, n_in, n_mu); those of layers that share a phase matrix are in the first of them."""
        found = _core.path_integrals(
            above=self.above.ravel(),
            thickness=self.thickness.ravel(),
            level=self.level.ravel(),
            level_layer=self.level_layer,
            chosen=levels,
            mu0=self.request.mu0,
            mu=mu,
            slab_stacks=self.size,
        )
        paths = found.reshape(*self.albedo.shape, *found.shape[1:])
        paths = (strength / (4.0 * np.pi))[..., None, None, None] * paths
        for layer, first in enumerate(self.likeness.shared):
            if first not in (layer, -1):
                paths[:, first] += paths[:, layer]
        return paths


def is_shared_request(request: Request) -> bool:
    """Whether what is asked lets scenes be solved together, whatever they are."""
    along_normal = bool((request.mu0 == 1.0).all() or (np.abs(request.mu) == 1.0).all())  # type: ignore[arg-type]
    return (
        request.kind == "brdf"
        and request.method == EXACT
        and not request.verify
        and request.backend in (Backend.OPENMP, Backend.SEQUENTIAL)
        and request.nodes is not None
        and (request.grading or 1) == 1
        and request.algorithm in ("auto", "direct", "modes")
        and request.illuminate == "top"
        and not along_normal
    )


def find_batch_key(scene: Scene, request: Request) -> BatchKey | None:
    """What a scene has in common with those that it is solved together with; None where it is solved by itself: for
    refraction, uneven bases, semi-infinite layers or of no thickness, and truncations that spread light or depend on
    its polarization."""
    nodes = request.nodes or 0
    below = scene.below
    if scene.keeps_beams or below.is_uneven or below.orders_reflected > 1:
        return None
    first: dict[int, int] = {}
    shared, scalar, longest = [], True, 0
    for k, layer in enumerate(scene.layers):
        matrix = layer.phase_matrix
        if not 0.0 < layer.thickness < math.inf:
            return None
        shared.append(first.setdefault(id(matrix), k) if layer.albedo > 0.0 else -1)
        scalar, longest = scalar and matrix.is_scalar, max(longest, matrix.terms)
    if longest > 2 * nodes:
        if (
            (not scalar and has_unpolarized_peak(scene, nodes))
            or request.tau.size > 1
            or request.truncation == "small-angle"
        ):
            return None
        longest = 2 * nodes
    # many unknowns: the orders are counted again on the way, and Python's share is small
    if longest * float(nodes if scalar else 4 * nodes) ** 3 > cost.WORTH_STAGES:
        return None
    return BatchKey(len(shared), tuple(shared), scalar)


def estimate_bytes(request: Request, likeness: BatchKey, terms: int) -> float:
    """Of what is worked with for a scene, and of its result."""
    assert request.nodes is not None
    assert request.mu is not None
    stokes = 1 if likeness.scalar else 4
    n, into, out = stokes * request.nodes, stokes * request.mu0.size, stokes * request.mu.size
    order = 5.0 * n * n + 2.0 * n * (out + into) + 4.0 * n * stokes * into
    result = 16.0 * request.mu0.size * request.mu.size * request.phi.size
    return 8.0 * (likeness.layers * terms * order + result)


def plan_batch(request: Request, likeness: BatchKey, scenes: Sequence[Scene], run: Run) -> tuple[Alike, BoolArray]:
    """Their plan, and which of the scenes it stands for: for the others, by themselves, another algorithm is chosen,
    fewer layers, or several looks at how many orders are left."""
    assert request.nodes is not None
    assert request.mu is not None
    count, layers = len(scenes), likeness.layers
    nodes, weights = make_double_gauss(request.nodes)
    each = [layer for scene in scenes for layer in scene.layers]
    cut = np.array([max(layer.phase_matrix.terms for layer in scene.layers) > 2 * request.nodes for scene in scenes])
    truncated = [
        one
        for scene, is_cut in zip(scenes, cut.tolist(), strict=True)
        for one in truncate_layers(scene, find_peaks(request, scene) if is_cut else "none", request.nodes)
    ]
    peaked = np.repeat(np.array([one.fraction > 0.0 for one in truncated]).reshape(count, layers).any(axis=1), layers)
    terms = np.array([one.coefficients.shape[0] for one in truncated], np.int32)
    longest = max(layer.phase_matrix.terms for layer in each)
    coefficients = np.zeros((len(each), int(terms.max()), 6))
    tables = np.zeros((len(each), longest + longest % 2, _core.SERIES))
    faint = np.zeros_like(tables) if peaked.any() else tables
    for index, layer in enumerate(each):
        coefficients[index, : terms[index]] = truncated[index].coefficients
        if likeness.shared[index % layers] == index % layers:
            table = layer.phase_matrix.series
            tables[index, : table.shape[0]] = table
            if faint is not tables:
                table = _core.series_table(truncated[index].coefficients) if peaked[index] else table
                faint[index, : table.shape[0]] = table
    thickness = np.array([one.thickness for one in truncated]).reshape(count, layers)
    above = np.zeros_like(thickness)
    np.cumsum(thickness[:, :-1], axis=1, out=above[:, 1:])
    level = np.zeros((count, request.tau.size))
    level[:, 1:] = thickness[:, -1:]  # the bottom
    alike = Alike(
        request,
        likeness,
        scenes,
        nodes,
        weights,
        request.mu,
        np.array([one.albedo for one in truncated]).reshape(count, layers),
        thickness,
        above,
        terms.reshape(count, layers),
        np.array([one.gain for one in truncated]).reshape(count, layers),
        cut,
        coefficients.reshape(count, layers, -1, 6),
        tables.reshape(count, layers, -1, _core.SERIES),
        faint.reshape(count, layers, -1, _core.SERIES),
        level,
        np.array([0, layers - 1], np.int32)[: request.tau.size],
        np.array([scene.below.even_albedo for scene in scenes]),
        {},
    )
    strength, bounds = find_bounds(alike, run)
    brightest = find_brightest(alike, run)
    orders = count_orders(alike, strength, bounds, brightest)
    fits = is_seen_to_the_base(alike)
    sets = list_sets(alike)
    wanted: dict[tuple[int, ...], BoolArray] = {}
    slow = choose_by_time(alike)
    for index, (own, size) in enumerate(zip(sets, orders.tolist(), strict=True)):
        blocks, at_once = sort_orders(own[:size])
        if not (at_once and all(slow[len(stokes)][index] for stokes, _ in blocks)):
            fits[index] = False
        for stokes, members in blocks if fits[index] else ():
            if stokes not in wanted:
                wanted[stokes] = np.zeros((alike.coefficients.shape[2], count), bool)
            wanted[stokes][list(members), index] = True
    first = {stokes: (int(np.argmax(which.any(axis=1))), stokes) for stokes, which in wanted.items()}
    return replace_unchecked(alike, wanted={key: wanted[key] for key in sorted(wanted, key=first.__getitem__)}), fits


def find_peaks(request: Request, scene: Scene) -> str:
    """Which layers lose their forward peak: see `Truncation`."""
    assert request.nodes is not None
    assert request.mu is not None
    asked = request.mu0, request.columns, request.mu, request.tau, request.nodes, request.accuracy
    return choose_truncation(request.truncation, scene, *asked).peaks


def find_bounds(alike: Alike, run: Run) -> tuple[Array, Array]:
    """Strength and bounds, (scene, order): see `OrderBounds`."""
    count, layers, n_order = alike.coefficients.shape[:3]
    all_layers = alike.coefficients.reshape(-1, n_order, 6), alike.terms.ravel(), alike.albedo.ravel()
    by_layer, bounds = bound_orders(*all_layers, alike.directions, alike.nodes.size, alike.mu.size, run, count)
    return by_layer.reshape(count, layers, n_order).max(axis=1), bounds


def find_brightest(alike: Alike, run: Run) -> Array:
    """See `find_brightness`, (scene, n_tau, n_in)."""
    request = alike.request
    mu, angles = alike.mu[spread_places(alike.mu.size)], np.radians(request.phi[spread_places(request.phi.size)])
    levels = np.arange(request.tau.size, dtype=np.int32)
    light = np.zeros((alike.size * levels.size, request.mu0.size, mu.size, angles.size, 4, 1))
    paths = alike.integrate_paths(levels, mu, alike.albedo)
    for layer, first in enumerate(alike.likeness.shared):
        if first != layer:
            continue
        table = np.ascontiguousarray(alike.faint[:, layer]).reshape(-1, _core.SERIES)
        path = np.ascontiguousarray(paths[:, layer]).reshape(-1, *paths.shape[3:])
        add_brightness(light, table, path, (request.mu0, mu, angles), run, alike.size)
    found: Array = light[..., 0, 0].max(axis=(2, 3), initial=0.0)
    return found.reshape(alike.size, levels.size, -1)


def count_orders(alike: Alike, strength: Array, bounds: Array, brightest: Array) -> IntArray:
    """How many Fourier orders of each scene matter, (scene,): see `count_orders_that_matter`."""
    request, n_order = alike.request, bounds.shape[1]
    at_top = _core.bounds_at(strength=strength.ravel(), bounds=bounds.ravel(), depth=np.zeros(1), decays=DECAYS)
    at = at_top.reshape(alike.size, n_order, 1)
    if request.tau.size > 1:
        depths = (alike.above[:, -1] + alike.level[:, -1])[:, None]
        each = [
            _core.bounds_at(strength=q, bounds=bound, depth=depth, decays=DECAYS)
            for q, bound, depth in zip(strength, bounds, depths, strict=True)
        ]
        at = np.concatenate([at, np.stack(each)], axis=2)
    tail = 2.0 * np.cumsum(np.minimum(at, LARGEST_BOUND)[:, ::-1], axis=1)[:, ::-1]
    faint = (tail[..., None] <= ORDERS * request.accuracy * brightest[:, None]).all(axis=(2, 3))
    found: IntArray = np.maximum(1, np.count_nonzero(~faint, axis=1))
    return np.minimum(found, alike.terms.max(axis=1))


def is_seen_to_the_base(alike: Alike) -> BoolArray:
    """Whether light of every order comes back from the base of a scene, (scene,): see `count_layers_reached`."""
    if alike.request.tau.size > 1:  # the bottom is where the light is wanted
        return np.ones(alike.size, bool)
    return DECAY * alike.thickness.sum(axis=1) < -0.5 * math.log(SHARE * alike.request.accuracy)


def choose_by_time(alike: Alike) -> dict[int, BoolArray]:
    """Of so many Stokes parameters, whether each scene takes modes for all orders: see `choose_algorithms`."""
    if alike.request.algorithm == "modes":
        return dict.fromkeys(range(1, 5), np.ones(alike.size, bool))
    thickness, layers = alike.thickness, alike.likeness.layers
    scatters = np.where(alike.albedo > 0.0, thickness, 0.0).sum(axis=1) >= THIN
    steps = np.where(find_repeated(alike), 0.0, count_doubling_steps(thickness, float(alike.directions.min())))
    found = {}
    for stokes in range(1, 5):
        ratio = predict_doubling_time(steps.sum(axis=1), stokes * alike.nodes.size, layers) / layers
        thick = thickness[:, 0] > ONE_LAYER * alike.nodes[0] if layers == 1 else np.zeros(alike.size, bool)
        found[stokes] = scatters & (thick | (ratio >= cost.WORTH_DOUBLING))
        if layers == 1 and alike.request.algorithm == "auto":
            found[stokes] &= [not is_partly_by_scatterings(alike, index, stokes) for index in range(alike.size)]
    return found


def find_repeated(alike: Alike) -> BoolArray:
    """Which layers are slabs like one above them, (scene, layer): these are doubled once (see `list_slabs`)."""
    repeated = np.zeros(alike.albedo.shape, bool)
    for one, other in itertools.combinations(range(alike.likeness.layers), 2):
        same = [each[:, one] == each[:, other] for each in (alike.albedo, alike.terms)]
        coefficients = (alike.coefficients[:, one] == alike.coefficients[:, other]).all(axis=(1, 2))
        is_clear = (alike.albedo[:, [one, other]] == 0.0).all(axis=1)
        equal = is_clear | (same[0] & same[1] & coefficients)
        repeated[:, other] |= equal & (alike.thickness[:, one] == alike.thickness[:, other])
    return repeated


def is_partly_by_scatterings(alike: Alike, index: int, stokes: int) -> bool:
    """Whether some orders of a scene of one layer go by successive scatterings: see `split_at_scatterings`."""
    problem = make_frame(alike, tuple(range(stokes)), index)
    if not is_for_scatterings(problem, alike.request.accuracy):
        return False
    orders = np.arange(alike.terms[index, 0], dtype=np.int32)
    fraction = count_operations_of_scatterings(problem, orders) / count_operations_of_modes(problem)
    return bool((fraction < cost.WORTH_SCATTERINGS).any())


def make_frame(alike: Alike, stokes: tuple[int, ...], index: int = 0) -> Problem:
    """What all scenes have in common for a set of Stokes parameters, with the layers of one."""
    request = alike.request
    columns: Array = request.columns.take(stokes, axis=0).take(stokes, axis=1)
    return Problem(
        coefficients=alike.coefficients[index],
        terms=alike.terms[index],
        albedo=alike.albedo[index],
        thickness=alike.thickness[index],
        above=alike.above[index],
        gain=alike.gain[index],
        fraction=np.zeros(alike.likeness.layers),
        nodes=alike.nodes,
        weights=alike.weights,
        mu_out=np.abs(alike.mu),
        n_up=int(np.count_nonzero(alike.mu > 0.0)),
        mu0=request.mu0,
        columns=columns,
        level=alike.level[index],
        level_layer=alike.level_layer,
        stokes=stokes,
    )


def list_sets(alike: Alike) -> list[Sets]:
    """The sets of Stokes parameters that each order of each scene keeps apart: see `list_stokes_sets`."""
    n_order = alike.coefficients.shape[2]
    if alike.likeness.scalar:
        return [(((0,),),) * n_order] * alike.size
    present = ((alike.coefficients != 0.0) & (alike.albedo > 0.0)[..., None, None]).any(axis=1)
    present = np.logical_or.accumulate(present[:, ::-1], axis=1)[:, ::-1, 1:]
    return [name_sets(rows.tobytes(), n_order) for rows in np.ascontiguousarray(present)]


@cache
def name_sets(present: bytes, n_order: int) -> Sets:
    """The same of one scene, of whose coefficients a2 .. b2 some are there in the degrees l >= m, (order, 5)."""
    rows = np.frombuffer(present, bool).reshape(n_order, 5).tolist()
    return tuple(find_stokes_sets(order > 0, *row) for order, row in enumerate(rows))


@cache
def sort_orders(sets: Sets) -> tuple[tuple[tuple[tuple[int, ...], tuple[int, ...]], ...], bool]:
    """The orders of each set of Stokes parameters, and whether all are solved without a second look at how many are
    left: where no set begins beyond the orders of those before it.

    >>> sort_orders((((0, 1), (3,)), ((0, 1, 2), (3,))))
    ((((0, 1), (0,)), ((3,), (0, 1)), ((0, 1, 2), (1,))), True)
    """
    parts: dict[tuple[int, ...], list[int]] = {}
    for order, found in enumerate(sets):
        for stokes in found:
            parts.setdefault(stokes, []).append(order)
    blocks = tuple(
        sorted(((stokes, tuple(members)) for stokes, members in parts.items()), key=lambda b: (b[1][0], b[0]))
    )
    last, at_once = -1, True
    for index, (_, members) in enumerate(blocks):
        at_once = at_once and (index == 0 or members[0] <= last)
        last = members[-1]
    return blocks, at_once
