"""Light of many directions upon facets: integrals of interpolated light against their lobes, order by order.

Lobes of facets are narrower than nodes are apart, so nothing is sampled at pairs of nodes. For one outgoing direction
the light that comes in is interpolated between the nodes of a panel, in the panel's own variable, and integrated
against the lobe with as many points as that takes (product integration): the smooth surface as roughness tends to zero.
"""

import math
from collections.abc import Iterator

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.quadrature import Panel, RefractedNodes, make_double_gauss
from vrte.basics.running import Run, ThreadTeam
from vrte.optics.facets import RoughSurface

NODES_AT_ONCE = 4  # between them, at most, one piece of the integral
DOUBLES_AT_ONCE = 1 << 21  # of orders, before they are summed
SLOPES = {  # over alpha, where pieces of the integral meet
    "beckmann": np.array([0.5, 1.0, 2.25, 3.75, 6.0]),
    "ggx": 2.0 ** np.arange(-1.0, 12.0),
}
UPRIGHT = 1e-8  # sine at which a cosine has lost all of its digits
CLOSE = 10.0 ** -np.arange(1.0, 4.1, 0.5)  # [rad] to critical angles, where pieces meet
CLOSEST = 1e-8  # smallest accuracy for which the last two of them are not needed
FINEST = 1e-9  # largest accuracy that integrals over facets reach for all light, also inside a plate


def integrate_azimuths(
    surface: RoughSurface,
    transmitted: bool,
    mu_i: Array,
    mu_o: Array,
    n_order: int,
    accuracy: float,
    team: ThreadTeam | None = None,
) -> Array:
    """R^m of pairs of directions (pair,), (pair, order, 16): the integral of f with cos, sin(m phi), as in (1:6)."""
    points, reach = choose_points(accuracy)
    x, weights = make_double_gauss(points)
    return _core.facet_orders(
        team or ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)),
        n_order=n_order,
        index=complex(surface.ratio).real,
        absorption=complex(surface.ratio).imag,
        roughness=surface.roughness,
        is_ggx=surface.distribution == "ggx",
        shadowing=surface.shadows(transmitted),
        transmitted=transmitted,
        mu_i=np.ascontiguousarray(mu_i),
        mu_o=np.ascontiguousarray(mu_o),
        points=np.ascontiguousarray(x),
        point_weights=np.ascontiguousarray(weights),
        reach=reach,
    )


def choose_points(accuracy: float) -> tuple[int, float]:
    """The number of points in a piece of an integral, and the slope over alpha beyond which a Gaussian is left out."""
    digits = -math.log10(accuracy)
    return min(max(3 + round(0.75 * digits), 5), 16), math.sqrt(math.log(10.0) * digits + 10.0)


def gather_orders(
    surface: RoughSurface,
    transmitted: bool,
    nodes: RefractedNodes,
    mu_out: Array,
    n_order: int,
    accuracy: float,
    run: Run,
) -> Array:
    """R^m from the nodes of the medium that light comes from into any directions, (order, node, out, 4, 4)."""
    points, reach = choose_points(accuracy)
    mu_node, weight = nodes.carried(surface.index_from)
    if transmitted:  # beside the normal cosines would not resolve the lobe
        upright = UPRIGHT / math.sqrt(surface.roughness * abs(surface.ratio.real - 1.0))
        mu_out = np.minimum(mu_out, math.sqrt(1.0 - upright * upright))
    found = np.zeros((n_order, mu_node.size, mu_out.size, 4, 4))
    met = find_pieces(surface, transmitted, mu_out, accuracy)
    for index, panel, x_node in list_panels(nodes, surface.index_from):
        out, x, share = spread_points(panel, x_node, met, surface, transmitted, mu_out, points, reach)
        depth, rate = panel.spread(x)
        mu = find_cosines(surface.index_from, panel, depth)
        share = share * rate / surface.index_from**2
        sine, sine_node = np.sqrt((1.0 - mu) * (1.0 + mu)), np.sqrt((1.0 - mu_node[index]) * (1.0 + mu_node[index]))
        even = share[:, None] * interpolate_nodes(x_node, x)
        odd = even * sine[:, None] / sine_node  # light of odd orders is the sine times what is smooth
        bounds = np.searchsorted(out, np.arange(mu_out.size + 1))
        some = max(1, DOUBLES_AT_ONCE // (16 * n_order))
        first = 0
        while first < mu_out.size:
            last = max(first + 1, int(np.searchsorted(bounds, bounds[first] + some, "right")) - 1)
            here = slice(bounds[first], bounds[last])
            with run.timed("facets") as team:
                pairs = mu[here], mu_out[out[here]]
                orders = integrate_azimuths(surface, transmitted, *pairs, n_order, accuracy, team)
            for k in range(first, last):
                own = slice(bounds[k], bounds[k + 1])
                part = orders[own.start - bounds[first] : own.stop - bounds[first]]
                for parity, weights in ((0, even), (1, odd)):
                    summed = np.tensordot(weights[own], part[:, parity::2], (0, 0))  # (node, order, 16)
                    found[parity::2, index, k] = summed.reshape(*summed.shape[:2], 4, 4).transpose(1, 0, 2, 3)
            first = last
    found /= (weight * mu_node)[:, None, None, None]
    return found


def list_panels(nodes: RefractedNodes, index: float) -> Iterator[tuple[slice, Panel, Array]]:
    """Which nodes of a medium each of its panels has, the panel, and where its nodes are in its own variable."""
    missing = nodes.highest.size - nodes.count(index)
    for first, end, panel in nodes.panels:
        if panel.high <= index:
            yield slice(first - missing, end - missing), panel, make_double_gauss(end - first)[0]


def find_pieces(surface: RoughSurface, transmitted: bool, mu_out: Array, accuracy: float) -> Array:
    """n sin(theta) of the light that facets in the plane of incidence send into each direction, (out, tilt): facets of
    some slopes, and those where total reflection begins; -1 where there is none."""
    theta = np.arccos(mu_out)[:, None]
    slopes = surface.roughness * SLOPES[surface.distribution]
    tilt = np.broadcast_to(np.arctan(np.concatenate([-slopes, [0.0], slopes])), (mu_out.size, 2 * slopes.size + 1))
    ratio = surface.ratio.real
    if transmitted or surface.reflects_totally:
        edge = 0.5 * np.pi if transmitted and ratio < 1.0 else math.asin(min(ratio, 1.0 / ratio))
        close = CLOSE if accuracy < CLOSEST else CLOSE[:-2]
        close = np.concatenate([-close, [0.0], close])
        tilt = np.concatenate([tilt, edge + close - theta, -edge - close - theta], axis=1)
    local = theta + tilt  # from the facet's normal to the outgoing direction
    if transmitted:
        bent = ratio * np.sin(local)
        possible = (np.abs(bent) <= 1.0 + 1e-12) & (np.abs(local) < 0.5 * np.pi + 1e-12)
        incoming = np.arcsin(np.clip(bent, -1.0, 1.0)) - tilt
    else:
        incoming, possible = theta + 2.0 * tilt, np.ones(tilt.shape, bool)
    met = np.where(possible & (np.abs(incoming) < 0.5 * np.pi), np.abs(np.sin(incoming)), -1.0)
    if transmitted:  # upright facets, at every azimuth
        met = np.append(met, np.sqrt(np.maximum(1.0 - (ratio * mu_out[:, None]) ** 2, 0.0)), axis=1)
    if surface.shadows(transmitted) == 2:  # directions of one cosine, hidden alike
        met = np.append(met, np.sqrt(1.0 - mu_out[:, None] ** 2), axis=1)
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
    """Gauss points of the integrals over a panel: outgoing direction (ascending), x and weight, (point,)."""
    x_piece, w_piece = make_double_gauss(points)
    between = np.append(0.5 * (x_node[:-1] + x_node[1:])[NODES_AT_ONCE - 1 :: NODES_AT_ONCE], [0.0, 1.0])
    inside = panel.locate((panel.high - met) * (panel.high + met))
    edges = np.sort(np.concatenate([inside, np.broadcast_to(between, (met.shape[0], between.size))], axis=1), axis=1)
    out, piece = np.nonzero(np.diff(edges, axis=1) > 2e-16)
    start, size = edges[out, piece], np.diff(edges, axis=1)[out, piece]
    x = (start[:, None] + size[:, None] * x_piece).ravel()
    share = (size[:, None] * w_piece).ravel()
    out = np.repeat(out, points)
    if surface.distribution == "beckmann":  # facets too steep to be there
        depth, _ = panel.spread(x)
        ratio = surface.ratio.real if transmitted else 1.0
        mu = find_cosines(surface.index_from, panel, depth)
        mu_o = mu_out[out]
        across = np.sqrt((1.0 - mu) * (1.0 + mu)) - ratio * np.sqrt((1.0 - mu_o) * (1.0 + mu_o))
        along = mu - ratio * mu_o if transmitted else mu + mu_o
        there = across**2 < (reach * surface.roughness * along) ** 2
        out, x, share = out[there], x[there], share[there]
    return out, x, share


def find_cosines(index: float, panel: Panel, depth: Array) -> Array:
    """Cosines in a medium of that index, at most 1, of directions of a panel."""
    return np.minimum(np.sqrt((index - panel.high) * (index + panel.high) + depth) / index, 1.0)


def interpolate_nodes(x_node: Array, x: Array) -> Array:
    """Lagrange's polynomials through Gauss nodes in (0, 1) at x, (point, node)."""
    _, weight = make_double_gauss(x_node.size)
    barycentric = np.sqrt(weight * x_node * (1.0 - x_node)) * (-1.0) ** np.arange(x_node.size)
    difference = x[:, None] - x_node
    share = barycentric / np.where(difference == 0.0, 1e-30, difference)
    return share / share.sum(axis=1, keepdims=True)
