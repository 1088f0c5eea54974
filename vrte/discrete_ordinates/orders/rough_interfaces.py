"""Rough interfaces as interfaces of a stack: their orders in the solver's scaling, flipped frame."""

import numpy as np

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.media import ENTERING, LEAVING, Media
from vrte.discrete_ordinates.orders.rough import FacetOrders
from vrte.scene.interface import Interface


@record
class Way:
    """Light that a rough interface reflects, or lets through, from one side: in each order to all nodes from all nodes,
    nodes (order, n, n), and from beams of unit power, entering (order, n_in, S, n); along the sights from all nodes,
    leaving (order, n_sight, S, n). None where there are no beams, or nothing is seen."""

    nodes: Array
    entering: Array | None
    leaving: Array | None

    def collect(self, orders: IntArray, power: Array) -> Array:
        """From beams of that power (n_in, S, n_col) to the nodes, (order, r, n)."""
        if self.entering is None:
            return np.zeros((orders.size, 1, 1))
        found = power.swapaxes(-1, -2) @ self.entering[orders]
        return found.reshape(orders.size, -1, found.shape[-1])

    def send(self, orders: IntArray, light: Array) -> Array:
        """Along the sights from light on the nodes (order, r, n): (order, r, n_sight S)."""
        if self.leaving is None:
            return np.zeros((orders.size, 1, 1))
        rows = self.leaving[orders]
        return light @ rows.reshape(orders.size, -1, rows.shape[-1]).swapaxes(-1, -2)

    def weigh(self, orders: IntArray, weights: Array) -> Array:
        """Weights (n_sight S, seen) of what is seen, as those of light on the nodes, (order, seen, n)."""
        if self.leaving is None:
            return np.zeros((orders.size, 1, 1))
        rows = self.leaving[orders]
        return weights.T @ rows.reshape(orders.size, -1, rows.shape[-1])


@record
class RoughInterface:
    """Reflection of light from above, from below, and what goes down and up through it."""

    above: Way
    below: Way
    down: Way
    up: Way

    def light(self, light: Array, orders: IntArray, falls: Array, rises: Array) -> None:
        """Adds what beams of that power (n_in, S, n_col) from above and from below send to the nodes, (order, 4, r,
        n)."""
        light[:, LEAVING] += self.above.collect(orders, falls) + self.up.collect(orders, rises)
        light[:, ENTERING] += self.down.collect(orders, falls) + self.below.collect(orders, rises)

    def collect(self, orders: IntArray, arriving: Array, rising: Array) -> tuple[Array, Array]:
        """What goes on to the nodes above and below of light on the nodes from above and from below, (order, r, n)."""
        above, below, down, up = (way.nodes[orders].swapaxes(-1, -2) for way in vars(self).values())
        return arriving @ above + rising @ up, arriving @ down + rising @ below

    def send(self, orders: IntArray, arriving: Array, rising: Array) -> tuple[Array, Array]:
        """The same along the sights, (order, r, n_sight S)."""
        return (
            self.above.send(orders, arriving) + self.up.send(orders, rising),
            self.below.send(orders, rising) + self.down.send(orders, arriving),
        )


@record
class Side:
    """One side of a rough interface: its refractive index; cosines of beams that come there and of sights that light
    goes to, 0 where there is none, (n_in,) and (n_sight,), or None where all are dark; whether light on nodes comes
    from there, which outside of a stack is known by its flux alone."""

    index: float
    into: Array | None
    sights: Array | None
    is_inside: bool


def make_rough_interface(
    interface: Interface,
    media: Media,
    sides: tuple[Side, Side],
    members: list[int],
    n_order: int,
    accuracy: float,
    run: Run,
) -> RoughInterface:
    """A rough interface between its sides above and below."""
    surfaces = interface.facets, interface.turned.facets
    stokes, count = len(members), media.nodes.measure.size

    def make_way(here: int, transmitted: bool) -> Way:
        """Of light from that side, 0 above and 1 below."""
        one, other = sides[here], sides[here ^ transmitted]
        facets = FacetOrders(surfaces[here], media.nodes, accuracy, run)
        (mu, weight), (mu_out, weight_out) = media.nodes.carried(one.index), media.nodes.carried(other.index)
        root, root_out = np.sqrt(weight * mu), np.sqrt(weight_out * mu_out)
        first, first_out = count - mu.size, count - mu_out.size
        flip = np.ones(4) if transmitted else FLIP

        def turn(orders: Array, *axes: int) -> Array:
            """R^m (order, into, out, S, S) of the Stokes parameters in another order of axes, flipped."""
            return (flip[members, None] * orders[..., members, :][..., members]).transpose(0, *axes)

        nodes = np.zeros((n_order, count, stokes, count, stokes))
        if one.is_inside:
            orders = facets.between(transmitted, n_order if other.is_inside else 1)
            scale: Array = root_out[:, None, None, None] * root[:, None] * (one.index / other.index)
            nodes[: len(orders), first_out:, :, first:] = turn(orders, 2, 3, 1, 4) * scale
        entering: Array | None = None
        leaving: Array | None = None
        if one.into is not None:
            orders = facets.sent(
                transmitted, np.where(one.into > 0.0, one.into, 1.0), n_order if other.is_inside else 1
            )
            lit = np.where(one.into > 0.0, 1.0 / other.index, 0.0)[:, None, None, None] * root_out[:, None]
            found = np.zeros((n_order, one.into.size, stokes, count, stokes))
            found[: len(orders), :, :, first_out:] = turn(orders, 1, 4, 2, 3) * lit
            entering = found.reshape(*found.shape[:3], -1)
        if other.sights is not None and one.is_inside:
            orders = facets.seen(transmitted, np.where(other.sights > 0.0, other.sights, 1.0), n_order)
            seen = np.where(other.sights > 0.0, one.index / other.index**2, 0.0)[:, None, None, None] * root[:, None]
            found = np.zeros((n_order, other.sights.size, stokes, count, stokes))
            found[..., first:, :] = turn(orders, 2, 3, 1, 4) * seen
            leaving = found.reshape(*found.shape[:3], -1)
        return Way(nodes.reshape(n_order, count * stokes, -1), entering, leaving)

    return RoughInterface(*(make_way(*way) for way in ((0, False), (1, False), (0, True), (1, True))))
