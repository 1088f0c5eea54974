"""Where a search for the quadrature of a request starts: counts of nodes in a fixed series, and their grading.

The counts are estimates and nobody's promise: `vrte.methods.parts.refinement` solves the request on neighbouring ones
and believes their difference alone.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.quadrature import count_panel_nodes, make_refracted_nodes
from vrte.discrete_ordinates.orders.discretise import LOBE, count_lobe_orders, count_surface_orders
from vrte.discrete_ordinates.orders.truncating import count_terms_carried, is_scalar
from vrte.discrete_ordinates.planning.choice import is_too_steep
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

SERIES = (4, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 64, 80, 100, 128, 160, 200, 256)  # nodes a hemisphere
FEWEST, MOST = SERIES[0], SERIES[-1]
COUNTS = np.arange(FEWEST, MOST + 1.0)  # of which errors are estimated
LOWEST = 0.02  # smallest |mu| of estimates: lower directions take this one's
AIM, DISCRETE = 0.65, 0.35  # of the accuracy: what the nodes may miss, what the discrete problem is solved to
CAREFUL = 0.3  # fraction of the accuracy aimed at by an estimate that no second count of nodes checks
TERM = 0.3  # largest error of a degree that the nodes do not carry, over the degree's strength
BELIEF = 0.8  # power of that largest error in the first number of nodes
FIRST = 0.75  # first count over the estimate: the trend from two differences then shows that the estimate is enough
GRADED_TERMS = 1.2  # terms that a node with grading 2 carries, at most
DOUBLING = 1.6  # cube root of the time of doubling over that of modes
MOST_GRADED = 64  # largest number of nodes with grading 2: their lowest cosine is 3e-8
MIRRORING = 1.1  # least ratio of refractive indices at which total reflection makes light near the horizon smooth
MIRRORED = 0.1  # least optical thickness of the layers of a medium for that: one of 1.7e-5 missed its promise by 2.5
OF_NODES = np.array([LOWEST, 0.1, 0.35, 0.7, 1.0])  # |mu| compared where light along the nodes is requested


@dataclass(frozen=True)
class NodeChoice:
    """nodes a hemisphere and their grading; rule: how they were found; notes: why the accuracy cannot be promised."""

    nodes: int
    grading: int
    rule: str
    notes: tuple[str, ...]


def take_given_nodes(request: Request, nodes: int) -> NodeChoice:
    """Nodes as somebody gave them: the accuracy is that of the problem on them."""
    scene, carried = request.scene, count_terms_carried(request.scene, nodes)
    terms = max((layer.phase_matrix.terms for layer in scene.layers if layer.albedo * layer.thickness > 0.0), default=0)
    notes = [f"what {nodes} nodes as given miss is not estimated: leave nodes out, or ask for verify"]
    if terms > carried:
        notes.append(
            f"{nodes} nodes carry {carried} of the {terms} terms of the phase matrix, and what is left has the accuracy"
        )
    return NodeChoice(nodes, request.grading or 1, request.nodes_rule, () if request.refined else tuple(notes))


def choose_first_nodes(request: Request) -> NodeChoice:
    """The count at which a search starts, the coarser of the two first compared, and the grading of all its nodes: the
    one that is predicted to take less time."""
    scene, mu = request.scene, np.array([LOWEST, 1.0]) if request.mu is None else request.mu
    aim = AIM * request.accuracy
    carried = count_terms_carried(scene, 1)
    cut = find_unresolved_terms(scene, carried * COUNTS)
    smooth, whole = (estimate_errors(scene, request.mu0, mu, request.tau, left) for left in (np.zeros_like(cut), cut))
    # not where no term that is cut can matter at all: so many are seldom needed, and the way up is cheaper than down
    plain = round(find_fewest_nodes(smooth, aim) ** (1.0 - BELIEF) * find_fewest_nodes(whole, aim) ** BELIEF)
    cut = find_unresolved_terms(scene, min(carried, GRADED_TERMS) * COUNTS)
    graded = find_fewest_nodes(estimate_graded_errors(scene, request.tau, cut), aim)
    allowed = request.method == EXACT and not request.backend.needs_device and graded <= MOST_GRADED
    allowed = allowed and not scene.is_rough  # near the horizon facets turn away on the scale of alpha
    steep = is_too_steep(find_lowest_node(scene, graded, 2), is_scalar(scene), DISCRETE * request.accuracy)
    effort = graded * (DOUBLING if steep else 1.0)
    grading = request.grading or (2 if allowed and effort < plain else 1)
    nodes = graded if grading > 1 else plain
    start = max((count for count in SERIES[:-1] if count <= FIRST * nodes), default=FEWEST)
    return NodeChoice(start, grading, f"estimate {start}", ())


def find_next_count(scene: Scene, nodes: int) -> int | None:
    """The next count of the series with more nodes in every medium's panel of directions; None beyond MOST."""
    now = count_panel_nodes(scene.media, nodes, scene.indices)
    for count in SERIES:
        panels = count_panel_nodes(scene.media, count, scene.indices)
        if all(more > few for more, few in zip(panels, now, strict=True)):
            return count
    return None


def has_mirrored_horizon(scene: Scene) -> bool:
    """Whether every layer's light is reflected totally near its horizon, since the rarest medium has none, and layers
    are thick: light that goes up and light that goes down are then one smooth function of the cosine."""
    thinnest = min(find_scattering_thickness(scene).values(), default=math.inf)
    return thinnest >= MIRRORED and min(scene.media) * MIRRORING <= min(scene.indices)


def find_scattering_thickness(scene: Scene) -> dict[float, float]:
    """Of the layers of each medium that scatter, by its refractive index."""
    found: dict[float, float] = {}
    for index, layer in zip(scene.indices, scene.layers, strict=True):
        if layer.albedo > 0.0 or layer.has_flakes:
            found[index] = found.get(index, 0.0) + layer.extent
    return found


def find_unseen_share(scene: Scene, nodes: int, grading: int) -> float:
    """What two counts can agree on and both miss, over the light: albedo times the thickness t of the scattering layers
    of a medium in which no node of the coarser count lies below t; for thin media their share of all t."""
    ways = find_scattering_thickness(scene)
    whole, found = sum(ways.values()), 0.0
    if 0.0 < whole < 1.0:
        shared = make_refracted_nodes(scene.media, nodes, grading, scene.indices)
        for index, way in ways.items():
            if shared.carried(index)[0][0] > way:
                layers = zip(scene.indices, scene.layers, strict=True)
                sent = sum(scatter_share(layer) for each, layer in layers if each == index)
                found = max(found, sent * way / whole)
    return found


def estimate_nodes(scene: Scene, mu0: Array, mu: Array, tau: Array, aim: float) -> int:
    """The fewest whose relative error, as estimated, is no more than this."""
    cut = find_unresolved_terms(scene, count_terms_carried(scene, 1) * COUNTS)
    return find_fewest_nodes(estimate_errors(scene, mu0, mu, tau, cut), aim)


def find_fewest_nodes(errors: Array, aim: float) -> int:
    """The fewest nodes with no larger error, of errors of FEWEST to MOST nodes; MOST where there are none."""
    enough = np.flatnonzero(errors <= aim)
    return FEWEST + int(enough[0]) if enough.size else MOST


def estimate_graded_errors(scene: Scene, tau: Array, cut: Array) -> Array:
    """Relative, of FEWEST to MOST nodes with grading 2; ``cut``: by terms that they do not carry."""
    nodes = count_nodes_of_horizon(scene, COUNTS)
    error = 0.1 * np.exp((-0.8 if has_mirrored_horizon(scene) else -1.2) * nodes) + cut
    error = np.maximum(error, estimate_unseen_share(scene, COUNTS, 2))
    error = np.maximum(error, estimate_flake_error(scene, COUNTS))
    for length in list_short_ways(scene, tau):
        error = np.maximum(error, min(length, 1.0) * np.exp(-1.55 * length**0.25 * nodes))
    return error


def estimate_errors(scene: Scene, mu0: Array, mu: Array, tau: Array, cut: Array) -> Array:
    """Relative, of FEWEST to MOST nodes; ``cut``: by terms that they do not carry."""
    nodes = count_nodes_of_horizon(scene, COUNTS)
    lowest = max(LOWEST, min(float(mu0.min()), float(np.abs(mu).min())))
    smooth = has_mirrored_horizon(scene)
    error = 0.1 * np.exp(-1.2 * nodes) if smooth else estimate_grazing_error(nodes, lowest)
    error = np.maximum(error + cut, estimate_unseen_share(scene, COUNTS, 1))
    error = np.maximum(error, estimate_flake_error(scene, COUNTS))
    for length in list_short_ways(scene, tau):
        error = np.maximum(error, estimate_thin_error(nodes, length, lowest))
    return np.maximum(error, estimate_facet_error(scene, COUNTS)) if scene.is_rough else error


def estimate_facet_error(scene: Scene, nodes: Array) -> Array:
    """Error by lobes of facets, (nodes,): it falls by a factor exp(-0.23) to exp(-0.36) a node, by alpha, and between
    surfaces, where light scattered by facets alone is seen, once nodes resolve the narrowest lobe."""
    found = 0.05 * np.exp(-0.3 * nodes)
    if count_surface_orders(scene, 1):
        width = LOBE / count_lobe_orders(scene)
        found = np.maximum(found, 0.1 * np.exp(-((nodes * width) ** 2) / 2.4))
    return found


def count_nodes_of_horizon(scene: Scene, nodes: Any) -> Any:
    """Nodes of one medium that are as good as so many of all that a surface joins, as measured with one and two."""
    return nodes / math.sqrt(len(set(scene.media)))


def find_lowest_node(scene: Scene, nodes: Any, grading: int) -> Any:
    """The lowest cosine of so many nodes: of N of Gauss's x it is 1.446/(N + 1/2)^2."""
    return (1.446 / (count_nodes_of_horizon(scene, nodes) + 0.5) ** 2) ** grading


def estimate_unseen_share(scene: Scene, nodes: Array, grading: int) -> Array:
    """`find_unseen_share` of all layers as one."""
    way = sum(find_scattering_thickness(scene).values())
    sent = sum(min(scatter_share(layer), 1.0) for layer in scene.layers)
    return np.where(find_lowest_node(scene, nodes, grading) > way, sent, 0.0)


def estimate_grazing_error(nodes: Array, lowest: float) -> Array:
    """Error by directions of the lowest |mu|: as a function of mu' the light has a pole at -mu and a logarithm at 0."""
    pole = 0.1 * np.exp(-4.0 * nodes * math.asinh(math.sqrt(lowest)))
    logarithm = 20.0 * (LOWEST / lowest) ** 0.7 * nodes**-6.0
    return pole + logarithm


def scatter_share(layer: Layer) -> float:
    """Albedo times thickness of a layer's particles, and the area of its flakes."""
    return layer.albedo * layer.thickness + layer.flake_area


def estimate_flake_error(scene: Scene, nodes: Array) -> Array:
    """Error by the narrowest lobe of flakes, from aluminium with tilts of 3 to 30 degrees, bare and under n = 1.5."""
    tilts = [layer.flakes.width for layer in scene.layers if layer.flakes is not None and layer.has_flakes]
    if not tilts:
        return np.zeros_like(nodes)
    tilt = math.degrees(min(tilts))
    digits = (count_nodes_of_horizon(scene, nodes) + 0.5 + 20.0 / tilt) / (1.25 + 22.5 / tilt)
    return np.asarray(10.0**-digits)


def estimate_thin_error(nodes: Array, length: float, lowest: float) -> Array:
    """Error by e^(-length/mu), which falls between the lowest nodes where light has a short way to go."""
    way = nodes * math.sqrt(length)
    fall = 0.6 * np.exp(-way) if length >= 3.0 * lowest else 0.04 * np.exp(-1.15 * way)
    return length * (2.0 * np.exp(-2.5 * way) + fall)


def find_unresolved_terms(scene: Scene, carried: Array) -> Array:
    """Error by the strongest term, omega |B_l|/(2 l + 1), of the degrees l beyond those that nodes carry. Of a thin
    layer as much counts as is scattered there once more, about 2 thickness."""
    weight: dict[int, float] = {}
    matrices = {id(layer.phase_matrix): layer.phase_matrix for layer in scene.layers}
    for layer in scene.layers:
        key = id(layer.phase_matrix)
        weight[key] = weight.get(key, 0.0) + layer.albedo * min(2.0 * layer.thickness, 1.0)
    strength = np.zeros(1 + max(matrix.terms for matrix in matrices.values()))
    for key, matrix in matrices.items():
        terms = find_strongest_terms(matrix.coefficients[None], np.array([min(weight[key], 1.0)]))[0]
        strength[: terms.size] = np.maximum(strength[: terms.size], terms)
    return TERM * strength[np.minimum(carried, strength.size - 1).astype(int)]


def find_strongest_terms(coefficients: Array, albedo: Array) -> Array:
    """The largest omega |B_l|/(2 l + 1) of the degrees l >= m, (layer, m); coefficients (layer, term, 6)."""
    a1, a2, a3, a4, b1, b2 = np.moveaxis(coefficients, -1, 0)
    first = 0.5 * np.abs(a1 + a2) + np.hypot(0.5 * (a1 - a2), b1)
    norm = np.maximum(first, np.maximum(np.abs(a3), np.abs(a4)) + np.abs(b2))
    degree = np.arange(norm.shape[1])
    strength = albedo[:, None] * norm / (2.0 * degree + 1.0)
    return np.maximum.accumulate(strength[:, ::-1], axis=1)[:, ::-1]


def list_short_ways(scene: Scene, tau: Array) -> list[float]:
    """Short optical ways: the thickness of all that scatters, the distance of depths from the nearer face; and of where
    layers meet from the top, where nothing else makes light near the horizon uneven."""
    total = sum(find_scattering_thickness(scene).values())
    ways = [total, *np.minimum(tau, scene.thickness - tau).tolist()]
    if has_mirrored_horizon(scene):
        ways += np.cumsum([layer.thickness for layer in scene.layers[:-1]]).tolist()
    return sorted({way for way in ways if 0.0 < way < 10.0})
