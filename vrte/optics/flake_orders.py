"""Fourier orders of what oriented flakes scatter, between a solver's nodes and any directions.

C^m(mu, mu') of a unit of area has a kink where both are equal, and lobes that may be narrower than nodes are apart. So
no pair of directions is sampled: the light that a direction d scatters is integrated against the polynomials L_j
through the nodes of a panel, in the panel's own variable,

    C_jd = (1/w_j) int L_j(mu) C(mu, mu_d) dmu,    odd orders with L_j sin(theta)/sin(theta_j),

and the light that d receives is the same by reciprocity. What is scattered twice is then off by the product of what
both integrals miss, and no light is lost: the polynomials add up to 1.
"""

import itertools
import math

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.quadrature import Panel, RefractedNodes, make_double_gauss
from vrte.basics.running import ThreadTeam
from vrte.optics.facet_integrals import NODES_AT_ONCE, choose_points, find_cosines, interpolate_nodes, list_panels
from vrte.optics.flakes import Flakes

WIDEST = 2.0  # sigmas of polar angle in one piece of the integral over cosines
FEW, MANY, FEW_ARE_ENOUGH = 8, 10, 1e-6  # points in a piece, and the accuracy from which on few will do
DOUBLES_AT_ONCE = 1 << 22  # of orders, before they are summed
SAME, OPPOSITE = 0, 1  # the hemisphere that light comes from, or the other
TURNED = np.array([1.0, 1.0, -1.0, 1.0])  # C^m of light turned round: TURNED C^T TURNED
MIRRORED = np.array([1.0, 1.0, -1.0, -1.0])  # and in a horizontal mirror


def gather_flake_orders(
    flakes: Flakes,
    nodes: RefractedNodes,
    directions: Array,
    n_order: int,
    accuracy: float,
    threads: int = 1,
    first_order: int = 0,
) -> Array:
    """C^m [per unit of area], n_order of them from a first one on, from downward directions (d,), the nodes of the
    flakes' medium and then those of positive cosines ``directions``, into its nodes: (order, d, 2, node, 4, 4), down
    (SAME) and up (OPPOSITE), the integral of Z with cos, sin(m phi) as in (1:6), public frame.

    Between nodes it is reciprocal to the last digit, and without loss where flakes reflect everything: the sum over
    weights of C^0_00 is G to rounding.
    """
    index = flakes.host_index
    mu_node, weight = nodes.carried(index)
    mu_from = np.concatenate([mu_node, directions])
    found = np.zeros((n_order, mu_from.size, 2, mu_node.size, 4, 4))
    points = FEW if accuracy >= FEW_ARE_ENOUGH else MANY
    for own, panel, x_node in list_panels(nodes, index):
        edges = find_edges(flakes, panel, x_node)
        step = max(1, DOUBLES_AT_ONCE // (16 * n_order * points * edges.size))
        depth_from = (panel.high - index) * (panel.high + index) + (index * mu_from) ** 2
        for way in (SAME, OPPOSITE):
            for first in range(0, mu_from.size, step):
                some = slice(first, first + step)
                kinks = panel.locate(depth_from[some]) if way == SAME else np.zeros(mu_from[some].size)
                x, share, start = spread_points(edges, kinks, points)
                depth, rate = panel.spread(x)
                mu = find_cosines(index, panel, depth)
                orders = integrate_azimuths(
                    flakes, -mu if way == SAME else mu, -mu_from[some][start], n_order, accuracy, threads, first_order
                )
                even = (share * rate / (index * index * mu))[:, None] * interpolate_nodes(x_node, x) / weight[own]
                sine, sine_node = (np.sqrt((1.0 - each) * (1.0 + each)) for each in (mu, mu_node[own]))
                odd = even * (sine[:, None] / sine_node)
                bounds = np.searchsorted(start, np.arange(kinks.size + 1))
                for d, (low, high) in enumerate(itertools.pairwise(bounds), first):
                    for parity, basis in ((first_order % 2, even), (1 - first_order % 2, odd)):
                        summed = np.tensordot(basis[low:high], orders[low:high, parity::2], (0, 0))
                        found[parity::2, d, way, own] = summed.reshape(*summed.shape[:2], 4, 4).swapaxes(0, 1)
    between = found[:, : mu_node.size]
    for way, turned in ((SAME, TURNED * MIRRORED), (OPPOSITE, TURNED)):
        part = between[:, :, way]
        part[...] = 0.5 * (part + turned[:, None] * part.transpose(0, 2, 1, 4, 3) * turned)
    if flakes.is_conserving and first_order == 0:
        missing = flakes.extinguish(mu_node)[:, 0, 0] - np.einsum("dsj,j->d", between[0, :, :, :, 0, 0], weight)
        here = np.arange(mu_node.size)
        between[0, here, SAME, here, 0, 0] += missing / weight
    return found


def find_edges(flakes: Flakes, panel: Panel, x_node: Array) -> Array:
    """Where pieces of the integral over a panel meet, (edge,) from 0 to 1: few nodes, and no lobe narrower than one."""
    edges = np.concatenate([[0.0], (0.5 * (x_node[:-1] + x_node[1:]))[NODES_AT_ONCE - 1 :: NODES_AT_ONCE], [1.0]])
    angle = np.arccos(find_cosines(flakes.host_index, panel, panel.spread(edges)[0]))
    parts = np.ceil(-np.diff(angle) / (WIDEST * flakes.width)).astype(int)
    return np.concatenate([np.linspace(*each) for each in zip(edges[:-1], edges[1:], parts + 1, strict=True)])


def spread_points(edges: Array, kinks: Array, points: int) -> tuple[Array, Array, IntArray]:
    """Gauss points of integrals in pieces between ``edges`` and the kink of each direction (d,): x, weight, and the
    direction of each, ascending, (point,)."""
    x, weights = make_double_gauss(points)
    ends = np.sort(np.concatenate([np.broadcast_to(edges, (kinks.size, edges.size)), kinks[:, None]], axis=1), axis=1)
    size = np.diff(ends, axis=1)
    d, piece = np.nonzero(size > 1e-15)
    start, size = ends[d, piece], size[d, piece]
    return (start[:, None] + size[:, None] * x).ravel(), (size[:, None] * weights).ravel(), np.repeat(d, points)


def integrate_azimuths(
    flakes: Flakes,
    mu_out: Array,
    mu_in: Array,
    n_order: int,
    accuracy: float,
    threads: int = 1,
    first_order: int = 0,
) -> Array:
    """C^m of a unit of area for pairs of signed cosines (pair,), (pair, order, 16): the integral of Z with cos, sin(m
    phi), as in (1:6)."""
    points, reach = choose_points(accuracy)
    x, weights = make_double_gauss(points)
    index = complex(1.0 if flakes.index is None else flakes.index / flakes.host_index)
    edges = flakes.panels
    if flakes.tilt_deg is not None:
        edges = edges[: 2 + np.searchsorted(edges[1:], math.sqrt(2.0) * reach * flakes.width)]
    return _core.flake_orders(
        ThreadTeam(threads, np.zeros(threads), np.zeros(1, np.int32)),
        n_order=n_order,
        first_order=first_order,
        index=index.real,
        absorption=index.imag,
        mirror=flakes.mirror,
        roughness=math.radians(flakes.tilt_deg or 0.0),
        edges=np.ascontiguousarray(edges),
        density=flakes.find_density(edges),
        mu_i=np.ascontiguousarray(mu_in),
        mu_o=np.ascontiguousarray(mu_out),
        points=np.ascontiguousarray(x),
        point_weights=np.ascontiguousarray(weights),
    )


def reverse_orders(found: Array) -> Array:
    """The same scattering the other way round, from nodes into upward directions d, of what `gather_flake_orders`
    finds: (order, d, 2, node, 4, 4), the node's light going up (SAME) or down (OPPOSITE)."""
    return TURNED[:, None] * found.swapaxes(-1, -2) * TURNED
