"""Rough surfaces order by order: what facets send between the nodes of the media on both sides, beams, and directions
that are asked for.

What is seen of the nodes' light is an integral over facets (vrte/optics/facet_integrals.py). What a beam sends into
nodes is the same the other way round, by reciprocity, f_12(i, o)/n_2^2 = Q f_21(o, i)^T Q/n_1^2; between nodes it is
the mean of both.

Light is as it is where it comes from above: from below it is the same surface in a mirror (vrte/optics/facets.py).
"""

import math
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, Remembered
from vrte.basics.quadrature import RefractedNodes
from vrte.optics.facet_energy import find_lost, find_strengths
from vrte.optics.facet_integrals import gather_orders
from vrte.optics.facets import RoughSurface
from vrte.scene.interface import Interface

_EXPANDED = Remembered()
TOGETHER = 8  # orders but 0 that facets are integrated for at once
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
    """What a rough interface does in the orders 0 .. n_order - 1; ``beams``, ``seen``: cosines above and below. It is
    remembered: nothing of what lies below a surface matters for it."""
    placed = (nodes.highest, nodes.depth, nodes.measure, *beams, *seen)
    key = interface, nodes.panels, tuple(part.tobytes() for part in placed), n_order, accuracy
    found = _EXPANDED.find(key, lambda: integrate_interface(interface, nodes, beams, seen, n_order, accuracy, threads))
    return RoughOrders((found[0], found[1]), (found[2], found[3]))


def integrate_interface(
    interface: Interface,
    nodes: RefractedNodes,
    beams: tuple[Array, Array],
    seen: tuple[Array, Array],
    n_order: int,
    accuracy: float,
    threads: int,
) -> tuple[Array, Array, Array, Array]:
    """What `expand_interface` remembers: reflected from above and below, let through from above and below."""
    indices = interface.index_above, interface.index_below
    sides = [interface.facets, interface.turned.facets]
    carried = [nodes.carried(index) for index in indices]
    out = [np.concatenate([carried[k][0], seen[k], beams[k]]) for k in (0, 1)]

    def gather(side: int, transmitted: bool) -> Array:
        goes = 1 - side if transmitted else side
        return gather_orders(sides[side], transmitted, nodes, out[goes], n_order, accuracy, threads)

    reflected, transmitted = ([gather(side, way) for side in (0, 1)] for way in (False, True))
    gains = [(indices[1] / indices[0]) ** 2, (indices[0] / indices[1]) ** 2]
    sizes = [(carried[side][0].size, seen[side].size, beams[side].size) for side in (0, 1)]
    found = RoughOrders(
        (
            join_ways(reflected[0], reflected[0], sizes[0], sizes[0], REFLECTED),
            join_ways(reflected[1], reflected[1], sizes[1], sizes[1], REFLECTED),
        ),
        (
            join_ways(transmitted[0], gains[0] * transmitted[1], sizes[0], sizes[1], TRANSMITTED),
            join_ways(transmitted[1], gains[1] * transmitted[0], sizes[1], sizes[0], TRANSMITTED),
        ),
    )
    if interface.conserving:
        for k in (0, 1):
            add_lost(found.reflected[k], sides[k], False, (nodes, beams[k]), (nodes, seen[k]))
            add_lost(found.transmitted[k], sides[k], True, (nodes, beams[k]), (nodes, seen[1 - k]))
    return *found.reflected, *found.transmitted


@dataclass(frozen=True, eq=False)
class TopOrders:
    """R^m of an interface above layers, as of `RoughOrders`: back (order, node, out, 4, 4) of light from below, out:
    nodes, then directions seen there; up (order, node, out, 4, 4), to directions seen above; down (order, beam, node,
    4, 4); I of the power that leaves upwards, of light on each node below (node, 4) and of each beam (beam, 4)."""

    back: Array
    up: Array
    down: Array
    leaving: Array
    mirrored: Array


def expand_top(
    interface: Interface,
    nodes: RefractedNodes,
    beams: Array,
    seen: tuple[Array, Array],
    n_order: int,
    accuracy: float,
) -> TopOrders:
    """What matters of a rough interface above layers in the orders 0 .. n_order - 1; beams from above, ``seen`` above
    and below. It is remembered, order 0 and a multiple of TOGETHER: blocks of orders come one after another."""
    asked, n_order = n_order, 1 + TOGETHER * max(1, math.ceil((n_order - 1) / TOGETHER))
    placed = (nodes.highest, nodes.depth, nodes.measure, beams, *seen)
    key = "top", interface, nodes.panels, tuple(part.tobytes() for part in placed), n_order, accuracy

    def integrate() -> tuple[Array, ...]:
        above, below, none = interface.facets, interface.turned.facets, np.zeros(0)
        (mu, weights), (inner, _) = nodes.carried(interface.index_above), nodes.carried(interface.index_below)
        gain = (interface.index_below / interface.index_above) ** 2
        back = reflect_off_facets(below, nodes, none, seen[1], n_order, accuracy)
        up, down = send_through(interface, nodes, beams, seen[0], n_order, accuracy)
        # fluxes are of order 0 alone
        rising, falling = (
            gather_orders(facets, True, nodes, to, 1, accuracy) for facets, to in ((below, mu), (above, inner))
        )
        rising = join_ways(rising, falling / gain, (inner.size, 0, 0), (mu.size, 0, 0), TRANSMITTED)
        mirrored = turn_way(gather_orders(above, False, nodes, beams, 1, accuracy), REFLECTED)
        if interface.conserving:
            add_lost(rising, below, True, (nodes, none), (nodes, none))
            add_lost(mirrored, above, False, (None, beams), (nodes, none))
        power = weights * mu
        return back, up, down, *(np.einsum("iob,o->ib", part[0, ..., 0, :], power) for part in (rising, mirrored))

    back, up, down, leaving, mirrored = _EXPANDED.find(key, integrate)
    return TopOrders(back[:asked], up[:asked], down[:asked], leaving, mirrored)


def send_through(
    interface: Interface, nodes: RefractedNodes, beams: Array, seen: Array, n_order: int, accuracy: float
) -> tuple[Array, Array]:
    """R^m of light let through, from nodes below to directions ``seen`` above, (order, node, out, 4, 4), and down from
    beams to these nodes, (order, beam, node, 4, 4). It is remembered."""
    placed = (nodes.highest, nodes.depth, nodes.measure, beams, seen)
    key = "through", interface, nodes.panels, tuple(part.tobytes() for part in placed), n_order, accuracy

    def integrate() -> tuple[Array, Array]:
        above, below, none = interface.facets, interface.turned.facets, np.zeros(0)
        gain = (interface.index_below / interface.index_above) ** 2
        through = gather_orders(below, True, nodes, np.concatenate([seen, beams]), n_order, accuracy)
        up, down = through[:, :, : seen.size], turn_way(gain * through[:, :, seen.size :], TRANSMITTED)
        if interface.conserving:
            add_lost(up, below, True, (nodes, none), (None, seen))
            add_lost(down, above, True, (None, beams), (nodes, none))
        return up, down

    up, down = _EXPANDED.find(key, integrate)
    return up, down


def add_lost(
    found: Array,
    surface: RoughSurface,
    transmitted: bool,
    into: tuple[RefractedNodes | None, Array],
    out: tuple[RefractedNodes | None, Array],
) -> None:
    """Adds to R^m (order, into, out, 4, 4), in place, what single bounces lose; into, out: nodes, if any, and cosines
    off them, between which nothing is added."""
    n_node, lost = [], []
    for side, (nodes, cosines) in ((surface, into), (surface.turned if transmitted else surface, out)):
        light = find_lost(side)
        along = np.zeros((0, 2)) if nodes is None else light.spread(nodes)
        n_node.append(len(along))
        lost.append(np.concatenate([along, light.find(cosines)]))
    more = find_strengths(surface)[transmitted] * lost[1][:, :, None] * lost[0][:, None, None, :]
    more[n_node[0] :, n_node[1] :] = 0.0
    found[0, ..., :2, :2] += more


def reflect_off_facets(
    surface: RoughSurface, nodes: RefractedNodes, beams: Array, seen: Array, n_order: int, accuracy: float
) -> Array:
    """R^m of a rough base, (order, into, out, 4, 4), into and out as in `RoughOrders`; the medium above it has all of
    the cosines."""
    mu, _ = nodes.carried(surface.index_from)
    sizes = mu.size, seen.size, beams.size
    gathered = gather_orders(surface, False, nodes, np.concatenate([mu, seen, beams]), n_order, accuracy)
    found = join_ways(gathered, gathered, sizes, sizes, REFLECTED)
    if surface.conserving:
        add_lost(found, surface, False, (nodes, beams), (nodes, seen))
    return found


def join_ways(
    there: Array, back: Array, sizes_from: tuple[int, int, int], sizes_to: tuple[int, int, int], turned: Array
) -> Array:
    """R^m (order, into, out, 4, 4) from what both ways gather, (order, node, direction, 4, 4), where directions and
    sizes are those of nodes, of what is asked for, and of beams."""
    (n_into, _, n_beam), (n_out, n_seen, _) = sizes_from, sizes_to
    returned = turn_way(back, turned)
    found = np.zeros((there.shape[0], n_into + n_beam, n_out + n_seen, 4, 4))
    found[:, :n_into] = there[:, :, : n_out + n_seen]
    found[:, :n_into, :n_out] += returned[:, :n_into]
    found[:, :n_into, :n_out] *= 0.5
    found[:, n_into:, :n_out] = returned[:, returned.shape[1] - n_beam :]
    return found


def turn_way(back: Array, turned: Array) -> Array:
    """The other way round by reciprocity: (order, into, out, 4, 4) from (order, out, into, 4, 4)."""
    return (turned @ back @ turned).transpose(0, 2, 1, 4, 3)
