"""Directions of a problem whose layers lie in several media, linked by Snell's law in this one place."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.quadrature import RefractedNodes
from vrte.scene.beams import (
    Depths,
    Interfaces,
    Passing,
    find_cosines,
    find_decaying,
    follow_beams,
    make_interfaces,
    pass_along,
)
from vrte.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Media:
    """What a problem is in beside its layers: the scene whose interfaces and base lie between them, the nodes of all
    media, and where the depths lie."""

    scene: Scene
    nodes: RefractedNodes
    depths: Depths
    _known: dict[bytes, Interfaces] = field(default_factory=dict)

    def interfaces_along(self, cosines: Array) -> Interfaces:
        """The scene's interfaces along directions (medium, n), found once: all blocks of orders ask for the same."""
        key = cosines.tobytes()
        if key not in self._known:
            self._known[key] = make_interfaces(self.scene, cosines)
        return self._known[key]

    @cached_property
    def cosines(self) -> Array:
        """Of the nodes in every medium, (medium, N); 0 where there is none."""
        found = np.zeros((len(self.scene.media), self.nodes.measure.size))
        for cosines, index in zip(found, self.scene.media, strict=True):
            own, _ = self.nodes.carried(index)
            cosines[cosines.size - own.size :] = own
        return found


@dataclass(frozen=True, eq=False)
class Cut:
    """The layers cut wherever the field is wanted: pieces, and an interface above each and below the last.

    layer (piece,); thickness (piece,), of the truncated layers; interface (piece + 1,): its index in the scene,
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


@dataclass(frozen=True, eq=False)
class Sights:
    """Directions that light is seen along, off the nodes: cosines (medium, n_sight), 0 where they do not go; place
    (n_tau, n_out): which of them each outgoing direction of a problem is at each depth; index (n_tau,)."""

    cosines: Array
    place: IntArray
    index: Array


def list_sights(media: Media, mu_out: Array) -> Sights:
    """The cosines of all outgoing directions mu_out (n_out,) in the media in which the requested depths lie."""
    index = media.depths.medium(media.scene.media)
    own, kind = np.unique(index, return_inverse=True)
    mu, row = np.unique(mu_out, return_inverse=True)
    cosines = np.concatenate([find_cosines(media.scene.media, n, mu) for n in own.tolist()], axis=1)
    place = kind[:, None] * mu.size + row
    return Sights(cosines, place.astype(np.int32), index)


def join_pieces(interfaces: Interfaces, cut: Cut) -> Interfaces:
    """The interfaces of a cut stack from those of its scene: nothing happens at a mere cut. Complex where thicknesses
    are, as derivatives take them."""
    count = interfaces.above.shape[1]
    nothing, all_ = np.zeros((1, count, 4, 4)), np.broadcast_to(np.eye(4), (1, count, 4, 4))
    ways = (("above", nothing), ("below", nothing), ("down", all_), ("up", all_))
    parts = (np.concatenate([getattr(interfaces, name), cut_])[cut.interface] for name, cut_ in ways)
    return Interfaces(*(part.astype(cut.thickness.dtype, copy=False) for part in parts))


def find_decaying_of_pieces(cut: Cut, cosines: Array) -> Array:
    """e^(-thickness/mu) of every piece, (piece, n); cosines (medium, n)."""
    inside = np.concatenate([cosines[:1], cosines[1 + cut.layer], cosines[-1:]])
    return find_decaying(cut.thickness, inside)


def find_beams(media: Media, cut: Cut, mu0: Array) -> tuple[Array, Passing]:
    """Cosines (medium, n_in) of the incident directions, and Mueller matrices of beams at interfaces of the pieces."""
    cosines = find_cosines(media.scene.media, media.scene.index_above, mu0)
    interfaces = join_pieces(media.interfaces_along(cosines), cut)
    return cosines, follow_beams(interfaces, find_decaying_of_pieces(cut, cosines))


def find_escapes(media: Media, cut: Cut, sights: Sights, n_up: int, members: list[int], sources: Array) -> Array:
    """What is seen of light that sets out along the sights, (n_tau, n_out, S, source, S), flipped frame.

    sources (source, 2): at which interface, and on which way: 0 coming up below it, 1 coming down above it, 2 going up
    above it, 3 going down below it; the first n_up outgoing directions see light going up."""
    interfaces = join_pieces(media.interfaces_along(sights.cosines), cut)
    chosen = np.ix_(members, members)
    interfaces = Interfaces(*(part[..., chosen[0], chosen[1]] for part in vars(interfaces).values()))
    n_interface, n_sight, size = cut.interface.size, sights.cosines.shape[1], len(members)
    kind = cut.thickness.dtype
    parts = [np.zeros((n_interface, n_sight, size, len(sources), size), kind) for _ in range(4)]
    for source, (interface, way) in enumerate(sources.tolist()):
        parts[way][interface, :, :, source] = np.eye(size)
    rising, arriving, leaving, entering = (part.reshape(n_interface, n_sight, size, -1) for part in parts)
    found = pass_along(
        interfaces, find_decaying_of_pieces(cut, sights.cosines), Passing(arriving, leaving, entering, rising)
    )
    shape = (n_interface, n_sight, size, len(sources), size)
    n_out = sights.place.shape[1]
    seen = np.empty((cut.at.size, n_out, *shape[2:]), kind)
    for t, (interface, under) in enumerate(zip(cut.at.tolist(), media.depths.under.tolist(), strict=True)):
        up, down = (found.rising, found.entering) if under else (found.leaving, found.arriving)
        seen[t, :n_up] = up.reshape(shape)[interface, sights.place[t, :n_up]]
        seen[t, n_up:] = down.reshape(shape)[interface, sights.place[t, n_up:]]
    return seen
