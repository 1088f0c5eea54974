"""Rough surfaces order by order: what facets send between the nodes of the media on both sides, beams, and directions
that are asked for.

Lobes of facets are narrower than nodes are apart, so nothing is sampled at pairs of nodes. For one outgoing direction
the light that comes in is interpolated between the nodes of a panel, in the panel's own variable, and integrated
against the lobe with as many points as that takes (product integration): the smooth surface as roughness tends to zero.
What a beam sends into nodes is the same the other way round, by reciprocity, f_12(i, o)/n_2^2 = Q f_21(o, i)^T Q/n_1^2;
between nodes it is the mean of both.

Light is as it is where it comes from above: from below it is the same surface in a mirror (vrte/optics/facets.py).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.quadrature import Panel, RefractedNodes, make_double_gauss
from vrte.basics.running import Crew
from vrte.optics.facets import RoughSurface
from vrte.scene.interface import Interface

NODES_AT_ONCE = 4  # between them, at most, one piece of the integral
DOUBLES_AT_ONCE = 1 << 21  # of orders, before they are summed
SLOPES = {  # over alpha, where pieces of the integral meet
    "beckmann": np.array([0.5, 1.0, 1.75, 2.5, 3.5, 4.5, 6.0]),
    "ggx": 2.0 ** np.arange(-1.0, 12.0),
}
CLOSE = np.array([-0.1, -0.01, -1e-3, 0.0, 1e-3, 0.01, 0.1])  # [rad] to critical angles, where pieces meet
REFLECTED, TRANSMITTED = np.diag([1.0, 1.0, -1.0, 1.0]), np.diag([1.0, 1.0, 1.0, -1.0])  # Q, and of orders Q D


@dataclass(frozen=True, eq=False)
class RoughOrders:
    """R^m of an interface, (order, into, out, 4, 4) each: of light from above and from below.

    Into: nodes of the medium it comes from, then beams there; out: nodes of the medium it goes to, then directions
    asked for there, nothing from beams to these. The radiance of order m is the sum of R^m weight mu L over nodes,
    R^m mu F of a beam, as in `Boundary.reflect_orders`.
    """

    reflected: tuple[Array, Array]
    transmitted: tuple[Array, Array]


def expand_interface(
    interface: Interface,
    nodes: RefractedNodes,
    beams: tuple[Array, Array],
    seen: tuple[Array, Array],
    n_order: int,
    accuracy: float = 1e-9,
    threads: int = 1,
) -> RoughOrders:
    """What a rough interface does in the orders 0 .. n_order - 1; ``beams``, ``seen``: cosines above and below."""
    indices = interface.index_above, interface.index_below
    sides = [
        RoughSurface(here, there, interface.roughness, interface.distribution, interface.shadowing)
        for here, there in (indices, indices[::-1])
    ]
    carried = [nodes.carried(index) for index in indices]
    out = [np.concatenate([carried[k][0], seen[k], beams[k]]) for k in (0, 1)]

    def gather(side: int, transmitted: bool) -> Array:
        goes = 1 - side if transmitted else side
        return gather_orders(sides[side], transmitted, nodes, out[goes], n_order, accuracy, threads)

    reflected, transmitted = ([gather(side, way) for side in (0, 1)] for way in (False, True))
    gains = [(indices[1] / indices[0]) ** 2, (indices[0] / indices[1]) ** 2]
    sizes = [(carried[side][0].size, seen[side].size, beams[side].size) for side in (0, 1)]
    return RoughOrders(
        (
            join_ways(reflected[0], reflected[0], sizes[0], sizes[0], REFLECTED),
            join_ways(reflected[1], reflected[1], sizes[1], sizes[1], REFLECTED),
        ),
        (
            join_ways(transmitted[0], gains[0] * transmitted[1], sizes[0], sizes[1], TRANSMITTED),
            join_ways(transmitted[1], gains[1] * transmitted[0], sizes[1], sizes[0], TRANSMITTED),
        ),
    )


def join_ways(
    there: Array, back: Array, sizes_from: tuple[int, int, int], sizes_to: tuple[int, int, int], turned: Array
) -> Array:
    """R^m (order, into, out, 4, 4) from what both ways gather, (order, node, direction, 4, 4), where directions and
    sizes are those of nodes, of what is asked for, and of beams."""
    (n_into, _, n_beam), (n_out, n_seen, _) = sizes_from, sizes_to
    returned = (turned @ back @ turned).transpose(0, 2, 1, 4, 3)
    found = np.zeros((there.shape[0], n_into + n_beam, n_out + n_seen, 4, 4))
    found[:, :n_into] = there[:, :, : n_out + n_seen]
    found[:, :n_into, :n_out] += returned[:, :n_into]
    found[:, :n_into, :n_out] *= 0.5
    found[:, n_into:, :n_out] = returned[:, returned.shape[1] - n_beam :]
    return found


def gather_orders(
    surface: RoughSurface,
    transmitted: bool,
    nodes: RefractedNodes,
    mu_out: Array,
    n_order: int,
    accuracy: float,
    threads: int,
) -> Array:
    """R^m from the nodes of the medium that light comes from into any directions, (order, node, out, 4, 4)."""
    digits = -math.log10(accuracy)
    points = min(max(3 + round(0.75 * digits), 5), 16)  # of a piece, over cosines and over azimuths
    reach = math.sqrt(math.log(10.0) * digits + 10.0)
    mu_node, weight = nodes.carried(surface.index_from)
    found = np.zeros((n_order, mu_node.size, mu_out.size, 4, 4))
    x_azimuth, w_azimuth = (np.ascontiguousarray(values) for values in make_double_gauss(points))
    seconds, stop = np.zeros(threads), np.zeros(1, np.int32)
    met = find_pieces(surface, transmitted, mu_out)
    for place, panel, x_node in list_panels(nodes, surface.index_from):
        out, x, share = spread_points(panel, x_node, met, surface, transmitted, mu_out, points, reach)
        depth, rate = panel.spread(x)
        mu = np.sqrt((surface.index_from - panel.high) * (surface.index_from + panel.high) + depth) / surface.index_from
        share = share * rate / surface.index_from**2
        sine, sine_node = np.sqrt((1.0 - mu) * (1.0 + mu)), np.sqrt((1.0 - mu_node[place]) * (1.0 + mu_node[place]))
        even = share[:, None] * interpolate_nodes(x_node, x)
        odd = even * sine[:, None] / sine_node  # light of odd orders is the sine times what is smooth
        bounds = np.searchsorted(out, np.arange(mu_out.size + 1))
        some = max(1, DOUBLES_AT_ONCE // (16 * n_order))
        first = 0
        while first < mu_out.size:
            last = max(first + 1, int(np.searchsorted(bounds, bounds[first] + some, "right")) - 1)
            here = slice(bounds[first], bounds[last])
            orders = np.empty((bounds[last] - bounds[first], n_order, 16))
            _core.facet_orders(
                Crew(threads, seconds, stop),
                index=complex(surface.ratio),
                roughness=surface.roughness,
                is_ggx=surface.distribution == "ggx",
                shadowing=surface.shadowing,
                transmitted=transmitted,
                mu_i=np.ascontiguousarray(mu[here]),
                mu_o=np.ascontiguousarray(mu_out[out[here]]),
                points=x_azimuth,
                weights=w_azimuth,
                reach=reach,
                out=orders,
            )
            for k in range(first, last):
                own, part = (
                    slice(bounds[k], bounds[k + 1]),
                    slice(bounds[k] - bounds[first], bounds[k + 1] - bounds[first]),
                )
                for parity, weights in ((0, even), (1, odd)):
                    of_parity = orders[part, parity::2]
                    summed = np.tensordot(weights[own], of_parity, (0, 0))  # (node, order, 16)
                    found[parity::2, place, k] = summed.reshape(*summed.shape[:2], 4, 4).transpose(1, 0, 2, 3)
            first = last
    found /= (weight * mu_node)[:, None, None, None]
    return found


def list_panels(nodes: RefractedNodes, index: float) -> Iterator[tuple[slice, Panel, Array]]:
    """Which nodes of a medium each of its panels has, the panel, and where its nodes are in its own variable."""
    missing, above = nodes.highest.size - nodes.count(index), math.inf
    for first, end, low, high in nodes.panels:
        if high <= index:
            yield slice(first - missing, end - missing), Panel(low, high, above), make_double_gauss(end - first)[0]
        above = high


def find_pieces(surface: RoughSurface, transmitted: bool, mu_out: Array) -> Array:
    """n sin(theta) of the light that facets in the plane of incidence send into each direction, (out, tilt): facets of
    some slopes, and those where total reflection begins; -1 where there is none."""
    theta = np.arccos(mu_out)[:, None]
    slopes = surface.roughness * SLOPES[surface.distribution]
    tilt = np.broadcast_to(np.arctan(np.concatenate([-slopes, [0.0], slopes])), (mu_out.size, 2 * slopes.size + 1))
    ratio = surface.ratio.real
    edge = math.asin(min(ratio, 1.0 / ratio))
    if transmitted or surface.reflects_totally:
        tilt = np.concatenate([tilt, edge + CLOSE - theta, -edge - CLOSE - theta], axis=1)
    local = theta + tilt  # from the facet's normal to the outgoing direction
    if transmitted:
        bent = ratio * np.sin(local)
        possible = (np.abs(bent) <= 1.0 + 1e-12) & (np.abs(local) < 0.5 * np.pi)
        incoming = np.arcsin(np.clip(bent, -1.0, 1.0)) - tilt
    else:
        incoming, possible = theta + 2.0 * tilt, np.ones(tilt.shape, bool)
    met = np.where(possible & (np.abs(incoming) < 0.5 * np.pi), np.abs(np.sin(incoming)), -1.0)
    if transmitted:  # upright facets, at every azimuth
        met = np.append(met, np.sqrt(np.maximum(1.0 - (ratio * mu_out[:, None]) ** 2, 0.0)), axis=1)
    return surface.index_from * met


def spread_points(
    panel: Panel,
    x_node: Array,
    met: Array,
    surface: RoughSurface,
    transmitted: bool,
    mu_out: Array,
    points: int,
    reach: float,
) -> tuple[np.ndarray, Array, Array]:
    """Gauss points of the integrals over one panel: to which outgoing direction each belongs (ascending), where it is
    and its weight, (point,) each."""
    x_piece, w_piece = make_double_gauss(points)
    between = np.append(0.5 * (x_node[:-1] + x_node[1:])[NODES_AT_ONCE - 1 :: NODES_AT_ONCE], [0.0, 1.0])
    inside = panel.locate((panel.high - met) * (panel.high + met))
    edges = np.sort(np.concatenate([inside, np.broadcast_to(between, (met.shape[0], between.size))], axis=1), axis=1)
    out, piece = np.nonzero(np.diff(edges, axis=1) > 1e-12)
    start, size = edges[out, piece], np.diff(edges, axis=1)[out, piece]
    x = (start[:, None] + size[:, None] * x_piece).ravel()
    share = (size[:, None] * w_piece).ravel()
    out = np.repeat(out, points)
    if surface.distribution == "beckmann":  # facets too steep to be there
        depth, _ = panel.spread(x)
        index, ratio = surface.index_from, surface.ratio.real if transmitted else 1.0
        mu = np.sqrt((index - panel.high) * (index + panel.high) + depth) / index
        mu_o = mu_out[out]
        across = np.sqrt((1.0 - mu) * (1.0 + mu)) - ratio * np.sqrt((1.0 - mu_o) * (1.0 + mu_o))
        along = mu - ratio * mu_o if transmitted else mu + mu_o
        there = across**2 < (reach * surface.roughness * along) ** 2
        out, x, share = out[there], x[there], share[there]
    return out, x, share


def interpolate_nodes(x_node: Array, x: Array) -> Array:
    """Lagrange's polynomials through Gauss nodes in (0, 1) at x, (point, node)."""
    _, weight = make_double_gauss(x_node.size)
    barycentric = np.sqrt(weight * x_node * (1.0 - x_node)) * (-1.0) ** np.arange(x_node.size)
    gap = x[:, None] - x_node
    share = barycentric / np.where(gap == 0.0, 1e-30, gap)
    found: Array = share / share.sum(axis=1, keepdims=True)
    return found
