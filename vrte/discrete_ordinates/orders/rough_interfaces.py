"""Rough interfaces as interfaces of a stack: their orders in the solver's scaling, flipped frame."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.polarization import FLIP
from vrte.discrete_ordinates.orders.media import ENTERING, LEAVING, Media
from vrte.discrete_ordinates.orders.rough import expand_interface


@dataclass(frozen=True, eq=False)
class Way:
    """Light that a rough interface reflects, or lets through, from one side: in each order to all nodes from all nodes,
    nodes (order, n, n), and from beams of unit power, entering (order, n, n_in, S); along the sights from all nodes,
    leaving (order, n_sight, S, n)."""

    nodes: Array
    entering: Array
    leaving: Array

    def collect(self, orders: IntArray, power: Array) -> Array:
        """From beams of that power (n_in, S, n_col) to the nodes, (order, r, n)."""
        found = np.einsum("onia,iac->oicn", self.entering[orders], power)
        return found.reshape(orders.size, -1, found.shape[-1])

    def send(self, orders: IntArray, light: Array) -> Array:
        """Along the sights from light on the nodes (order, r, n): (order, r, n_sight S)."""
        rows = self.leaving[orders]
        return light @ rows.reshape(orders.size, -1, rows.shape[-1]).swapaxes(-1, -2)


@dataclass(frozen=True, eq=False)
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


def make_rough_interface(
    media: Media, number: int, into: Array, sights: Array, members: list[int], n_order: int, accuracy: float
) -> RoughInterface:
    """That interface of the scene, which is rough; into (medium, n_in), sights (medium, n_sight): cosines."""
    interface = media.scene.interfaces[number]
    assert interface is not None
    beams, seen = ([np.where(mu > 0.0, mu, 1.0) for mu in part[number : number + 2]] for part in (into, sights))
    found = expand_interface(
        interface, media.nodes, (beams[0], beams[1]), (seen[0], seen[1]), n_order, accuracy, threads=1
    )

    def scale(orders: Array, here: int, there: int, flips: bool) -> Way:
        """R^m (order, into, out, 4, 4) as a way from one side to the other, 0 above and 1 below."""
        index, behind = media.scene.media[number + here], media.scene.media[number + there]
        (mu, weight), (mu_out, weight_out) = media.nodes.carried(index), media.nodes.carried(behind)
        orders = (FLIP[:, None] * orders if flips else orders)[..., members, :][..., members]
        orders = orders.transpose(0, 2, 3, 1, 4)  # (order, out, S, into, S)
        stokes, count = len(members), media.nodes.measure.size
        root, root_out = np.sqrt(weight * mu), np.sqrt(weight_out * mu_out)
        first, first_out = count - mu.size, count - mu_out.size
        shape = orders.shape[0], count, stokes, count, stokes
        nodes = np.zeros(shape)
        nodes[:, first_out:, :, first:] = orders[:, : mu_out.size, :, : mu.size] * (index / behind)
        nodes[:, first_out:, :, first:] *= root_out[:, None, None, None] * root[:, None]
        entering = np.zeros((*shape[:3], into.shape[1], stokes))
        lit = into[number + here] > 0.0
        entering[:, first_out:] = orders[:, : mu_out.size, :, mu.size :] * root_out[:, None, None, None] / behind
        entering *= lit[:, None]
        leaving = np.zeros((shape[0], sights.shape[1], stokes, count, stokes))
        leaving[..., first:, :] = orders[:, mu_out.size :, :, : mu.size] * root[:, None] * (index / behind**2)
        leaving *= (sights[number + there] > 0.0)[:, None, None, None]
        n = count * stokes
        return Way(
            nodes.reshape(-1, n, n),
            entering.reshape(shape[0], n, into.shape[1], stokes),
            leaving.reshape(*leaving.shape[:3], n),
        )

    return RoughInterface(
        above=scale(found.reflected[0], 0, 0, True),
        below=scale(found.reflected[1], 1, 1, True),
        down=scale(found.transmitted[0], 0, 1, False),
        up=scale(found.transmitted[1], 1, 0, False),
    )
