"""Rough surfaces order by order: what facets send between nodes of the media on both sides, from beams to nodes, and
from nodes along directions that are asked for.

What is seen of the nodes' light is an integral over facets (vrte/optics/facet_integrals.py). What a beam sends into
nodes is the same the other way round, by reciprocity, f_12(i, o)/n_2^2 = Q f_21(o, i)^T Q/n_1^2; between nodes it is
the mean of both.

Light is as it is where it comes from above: from below it is the same surface in a mirror (vrte/optics/facets.py).
"""

from collections.abc import Callable
from dataclasses import field, replace

import numpy as np

from vrte.basics.arrays import Array, Remembered, record
from vrte.basics.quadrature import RefractedNodes
from vrte.basics.running import Run
from vrte.optics.facet_energy import find_lost, find_strengths
from vrte.optics.facet_integrals import gather_orders
from vrte.optics.facets import RoughSurface

_EXPANDED = Remembered()
REFLECTED, TRANSMITTED = np.array([1.0, 1.0, -1.0, 1.0]), np.array([1.0, 1.0, 1.0, -1.0])  # Q, and of orders Q D


@record
class FacetOrders:
    """R^m of facets between the nodes of both media, (order, into, out, 4, 4), of light from one side to an accuracy:
    the radiance of order m is the sum of R^m weight mu L over nodes, R^m mu F of a beam, as in
    `Boundary.reflect_orders`. They are remembered: nothing of what lies below a surface matters for them."""

    surface: RoughSurface
    nodes: RefractedNodes
    accuracy: float
    run: Run = field(default_factory=lambda: Run(1))

    @property
    def turned(self) -> "FacetOrders":
        """Of light from the other side."""
        return replace(self, surface=self.surface.turned)

    def between(self, transmitted: bool, n_order: int) -> Array:
        """From nodes to the nodes on the side that light goes to."""
        back = self.turned if transmitted else self

        def integrate() -> Array:
            found = self.gather(transmitted, back.cosines, n_order)
            other = back.gather(transmitted, self.cosines, n_order) if transmitted else found
            found = 0.5 * (found + self.turn_back(other, transmitted))
            if self.surface.conserving:
                self.add_lost(found, transmitted, find_lost(back.surface).spread(self.nodes))
            return found

        return self.remember("between", transmitted, np.zeros(0), n_order, integrate)

    def seen(self, transmitted: bool, cosines: Array, n_order: int) -> Array:
        """From nodes along directions of those cosines on the side that light goes to."""

        def integrate() -> Array:
            found = self.gather(transmitted, cosines, n_order)
            if self.surface.conserving:
                back = self.turned if transmitted else self
                self.add_lost(found, transmitted, find_lost(back.surface).find(cosines))
            return found

        return self.remember("seen", transmitted, cosines, n_order, integrate)

    def sent(self, transmitted: bool, cosines: Array, n_order: int) -> Array:
        """From beams to the nodes on the side that light goes to."""
        back = self.turned if transmitted else self
        return self.turn_back(back.seen(transmitted, cosines, n_order), transmitted)

    @property
    def cosines(self) -> Array:
        """Of the nodes on the side that light comes from, (node,)."""
        return self.nodes.carried(self.surface.index_from)[0]

    def gather(self, transmitted: bool, cosines: Array, n_order: int) -> Array:
        """From nodes along directions, of single bounces."""
        return gather_orders(self.surface, transmitted, self.nodes, cosines, n_order, self.accuracy, self.run)

    def turn_back(self, back: Array, transmitted: bool) -> Array:
        """By reciprocity, from what light takes the other way round: (order, into, out, 4, 4) from (order, out, into,
        4, 4)."""
        signs = TRANSMITTED if transmitted else REFLECTED
        gain = self.surface.ratio.real**2 if transmitted else 1.0
        found: Array = (back * (gain * np.outer(signs, signs))).transpose(0, 2, 1, 4, 3)
        return found

    def add_lost(self, found: Array, transmitted: bool, out: Array) -> None:
        """Adds, in place, what single bounces lose, of which ``out`` (out, 2) goes along each direction."""
        into = find_lost(self.surface).spread(self.nodes)
        found[0, ..., :2, :2] += find_strengths(self.surface)[transmitted] * out[:, :, None] * into[:, None, None, :]

    def remember(
        self, kind: str, transmitted: bool, cosines: Array, n_order: int, integrate: Callable[[], Array]
    ) -> Array:
        """What is integrated, once."""
        nodes = self.nodes
        placed = tuple(part.tobytes() for part in (nodes.highest, nodes.depth, nodes.measure, cosines))
        key = kind, self.surface, transmitted, nodes.panels, placed, n_order, self.accuracy
        return _EXPANDED.find(key, lambda: (integrate(),))[0]


def reflect_off_facets(
    surface: RoughSurface, nodes: RefractedNodes, beams: Array, seen: Array, n_order: int, accuracy: float
) -> Array:
    """R^m of a rough base, (order, into, out, 4, 4): into nodes, then beams; out to nodes, then directions asked for,
    nothing from beams to these."""
    facets = FacetOrders(surface, nodes, accuracy)
    between = facets.between(False, n_order)
    count = between.shape[1]
    found = np.zeros((n_order, count + beams.size, count + seen.size, 4, 4))
    found[:, :count, :count], found[:, :count, count:] = between, facets.seen(False, seen, n_order)
    found[:, count:, :count] = facets.sent(False, beams, n_order)
    return found
