"""Rough surfaces order by order: what facets send between the nodes of the media on both sides, beams, and directions
that are asked for.

What is seen of the nodes' light is an integral over facets (vrte/optics/facet_integrals.py). What a beam sends into
nodes is the same the other way round, by reciprocity, f_12(i, o)/n_2^2 = Q f_21(o, i)^T Q/n_1^2; between nodes it is
the mean of both.

Light is as it is where it comes from above: from below it is the same surface in a mirror (vrte/optics/facets.py).
"""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.quadrature import RefractedNodes
from vrte.optics.facet_integrals import gather_orders
from vrte.optics.facets import RoughSurface
from vrte.scene.interface import Interface

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


def reflect_off_facets(
    surface: RoughSurface, nodes: RefractedNodes, beams: Array, seen: Array, n_order: int, accuracy: float
) -> Array:
    """R^m of a rough base, (order, into, out, 4, 4), into and out as in `RoughOrders`; the medium above it has all of
    the cosines."""
    mu, _ = nodes.carried(surface.index_from)
    found = gather_orders(surface, False, nodes, np.concatenate([mu, seen, beams]), n_order, accuracy)
    sizes = mu.size, seen.size, beams.size
    return join_ways(found, found, sizes, sizes, REFLECTED)


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
