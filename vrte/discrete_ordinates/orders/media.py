"""Directions of a problem whose layers lie in several media, linked by Snell's law in this one place."""

from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.quadrature import RefractedNodes
from vrte.scene.beams import (
    Depths,
    Interfaces,
    Passing,
    find_cosines,
    find_decays,
    follow_beams,
    make_interfaces,
    pass_along,
)
from vrte.scene.oriented import Oriented
from vrte.scene.scene import Scene

Found = TypeVar("Found")
RISING, ARRIVING, LEAVING, ENTERING = range(4)  # ways of light at an interface: up below, down above, up above, down


@record
class Media:
    """What a problem is in beside its layers: the scene whose interfaces and base lie between them, the nodes of all
    media, where the depths lie, and the flakes of each truncated layer, if any has them."""

    scene: Scene
    nodes: RefractedNodes
    depths: Depths
    oriented: tuple[Oriented | None, ...] = ()
    _known: dict[tuple[str | bytes, ...], Any] = field(default_factory=dict)

    def find_once(self, find: Callable[[], Found], name: str, *given: Array | IntArray) -> Found:
        """What ``find`` finds of the arrays given, found once: all blocks of orders ask for the same. Of complex ones,
        as derivatives take them, anew."""
        if any(np.iscomplexobj(each) for each in given):
            return find()
        key: tuple[str | bytes, ...] = (name, *[each.tobytes() for each in given])
        if key not in self._known:
            self._known[key] = find()
        found: Found = self._known[key]
        return found

    def interfaces_along(self, cosines: Array) -> Interfaces:
        """The scene's interfaces along directions (medium, n)."""
        return self.find_once(lambda: make_interfaces(self.scene, cosines), "interfaces", cosines)

    def cut(self, thickness: Array, level: Array) -> "Cut":
        """The layers of that ``thickness`` (layer,) cut at the depths inside them, ``level`` (n_tau,)."""
        return self.find_once(lambda: cut_pieces(self.depths, thickness, level), "cut", thickness, level)

    @cached_property
    def cosines(self) -> Array:
        """Of the nodes in every medium, (medium, N); 0 where there is none."""
        found = np.zeros((len(self.scene.media), self.nodes.measure.size))
        for cosines, index in zip(found, self.scene.media, strict=True):
            own, _ = self.nodes.carried(index)
            cosines[cosines.size - own.size :] = own
        return found


@record
class Cut:
    """The layers cut wherever the field is wanted: pieces, and an interface above each and below the last.

    layer (piece,); thickness (piece,), of the truncated layers, or (piece, several) of stacks that are followed
    together, direction by direction of one after another; interface (piece + 1,): its index in the scene,
    -1 for a mere cut; at (n_tau,): the interface that each depth lies at.
    """

    layer: IntArray
    thickness: Array
    interface: IntArray
    at: IntArray


def cut_pieces(depths: Depths, thickness: Array, level: Array) -> Cut:
    """Cuts layers of that ``thickness`` (layer,) at the depths inside them, ``level`` (n_tau,) below their tops."""
    layers: list[int] = []
    lengths: list[float] = []
    interfaces: list[int] = []
    at = np.zeros(level.size, np.int32)
    for k, total in enumerate(thickness.tolist()):
        at[depths.interface == k] = len(interfaces)
        interfaces.append(k)
        here = (depths.interface < 0) & (depths.layer == k)
        cuts = np.unique(np.concatenate([[0.0, total], level[here]]))
        if total == 0.0:
            cuts = np.zeros(2)
        at[here] = len(interfaces) - 1 + np.searchsorted(cuts, level[here])
        lengths += np.diff(cuts).tolist()
        layers += [k] * (cuts.size - 1)
        interfaces += [-1] * (cuts.size - 2)
    at[depths.interface == thickness.size] = len(interfaces)
    interfaces.append(thickness.size)
    return Cut(np.array(layers, np.int32), np.array(lengths), np.array(interfaces, np.int32), at)


def find_rough_places(media: Media, cut: Cut) -> list[int]:
    """Which interfaces of the pieces are rough interfaces."""
    kinds = media.scene.interfaces
    rough = {k for k, kind in enumerate(kinds) if kind is not None and not kind.is_smooth}
    return [index for index, interface in enumerate(cut.interface.tolist()) if interface in rough]


@record
class Sights:
    """Directions that light is seen along, off the nodes: cosines (medium, n_sight), 0 where they do not go; place
    (n_tau, n_out): which of them each outgoing direction of a problem is at each depth; index (n_tau,)."""

    cosines: Array
    place: IntArray
    index: Array


def list_sights(media: Media, mu_out: Array) -> Sights:
    """The cosines of all outgoing directions mu_out (n_out,) in the media in which the requested depths lie."""

    def find() -> Sights:
        index = media.depths.medium(media.scene.media)
        own, kind = np.unique(index, return_inverse=True)
        mu, row = np.unique(mu_out, return_inverse=True)
        cosines = np.concatenate([find_cosines(media.scene.media, n, mu) for n in own.tolist()], axis=1)
        place = kind[:, None] * mu.size + row
        return Sights(cosines, place.astype(np.int32), index)

    return media.find_once(find, "sights", mu_out)


def join_pieces(interfaces: Interfaces, cut: Cut) -> Interfaces:
    """The interfaces of a cut stack from those of its scene: nothing happens at a mere cut. Complex where thicknesses
    are, as derivatives take them."""
    count = interfaces.above.shape[1]
    nothing, all_ = np.zeros((1, count, 4, 4)), np.broadcast_to(np.eye(4), (1, count, 4, 4))
    ways = (("above", nothing), ("below", nothing), ("down", all_), ("up", all_))
    parts = [np.concatenate([getattr(interfaces, name), cut_])[cut.interface] for name, cut_ in ways]
    if cut.thickness.ndim > 1:
        parts = [np.concatenate([part] * cut.thickness.shape[1], axis=1) for part in parts]
    return Interfaces(*(part.astype(cut.thickness.dtype, copy=False) for part in parts))


def find_decaying_of_pieces(media: Media, cut: Cut, cosines: Array) -> Array:
    """What every piece leaves of light, (piece, n), or (piece, n, 4, 4) as of `find_decays`; cosines (medium, n)."""
    oriented = [media.oriented[layer] for layer in cut.layer.tolist()] if media.oriented else []
    along = cosines[1:-1][cut.layer]
    each = [find_decays(oriented, one, along) for one in cut.thickness.reshape(cut.layer.size, -1).T]
    return np.concatenate(each, axis=1)


def find_beams(media: Media, cut: Cut, mu0: Array) -> tuple[Array, Passing]:
    """Cosines (medium, n_in) of the incident directions, and Mueller matrices of beams at interfaces of the pieces."""
    cosines = find_cosines(media.scene.media, media.scene.index_above, mu0)

    def follow() -> Passing:
        interfaces = join_pieces(media.interfaces_along(cosines), cut)
        return follow_beams(interfaces, find_decaying_of_pieces(media, cut, cosines))

    return cosines, media.find_once(follow, "beams", cosines, cut.thickness, cut.interface)


def find_escapes(media: Media, cut: Cut, sights: Sights, n_up: int, members: list[int], sources: Array) -> Array:
    """What is seen of light that sets out along the sights, (n_tau, n_out, S, source, S), flipped frame.

    sources (source, 2): at which interface, and on which way: 0 coming up below it, 1 coming down above it, 2 going up
    above it, 3 going down below it; the first n_up outgoing directions see light going up."""

    def trace() -> Array:
        return trace_sights(media, cut, sights.cosines)

    traced = media.find_once(trace, "escapes", sights.cosines, cut.thickness, cut.interface, cut.at)
    return take_escapes(traced, sights, n_up, members, sources)


def take_escapes(traced: Array, sights: Sights, n_up: int, members: list[int], sources: Array) -> Array:
    """The same of what `trace_sights` found."""
    interface, way = sources.T
    found = []
    for t, place in enumerate(sights.place):
        direction = (np.arange(place.size) >= n_up).astype(np.int32)
        one = traced[t, direction[:, None], way, interface, place[:, None]]  # (n_out, source, S sent, S seen)
        found.append(one[..., members, :][..., members].transpose(0, 3, 1, 2))
    return np.stack(found)


def trace_sights(media: Media, cut: Cut, cosines: Array) -> Array:
    """What is seen at every depth, going up and down, of light that sets out on any way at any interface along the
    sights, (n_tau, 2, 4, interface, n_sight, S sent, S seen): light seen is followed backwards, where an interface's
    matrices are transposed, and transmit up what they transmitted down."""
    ways = join_pieces(media.interfaces_along(cosines), cut)
    above, below, down, up = (part.swapaxes(-1, -2) for part in vars(ways).values())
    shape = cut.interface.size, above.shape[1], 4, cut.at.size, 2, 4
    rising, arriving, leaving, entering = (np.zeros(shape, cut.thickness.dtype) for _ in range(4))
    for t, (interface, under) in enumerate(zip(cut.at.tolist(), media.depths.under.tolist(), strict=True)):
        ends = (entering, rising) if under else (arriving, leaving)
        for end, part in enumerate(ends):  # what was seen coming up goes down again, and the other way round
            part[interface, :, :, t, end] = np.eye(4)
    flat = (part.reshape(*shape[:3], -1) for part in (arriving, leaving, entering, rising))
    decays = find_decaying_of_pieces(media, cut, cosines)
    decays = decays if decays.ndim == 2 else decays.swapaxes(-1, -2)
    back = pass_along(Interfaces(above, below, up, down), decays, Passing(*flat))
    parts = np.stack([back.entering, back.leaving, back.arriving, back.rising])
    return parts.reshape(4, *shape).transpose(4, 5, 0, 1, 2, 3, 6)
