"""Where light goes that meets no particle: refracted and mirrored at every interface of a stack, along one direction.

All in the flipped frame, in which light going up has U and V turned over: a stack and its mirror image then look alike.
Numbers are powers through a horizontal plane, or radiances over the square of the refractive index: what Fresnel's
transmitted power acts upon, the same on both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray, make_readonly
from vrte.basics.polarization import FLIP
from vrte.optics.fresnel import reflect_smooth, transmit_smooth
from vrte.scene.boundary import BLACK, Boundary
from vrte.scene.interface import Interface
from vrte.scene.oriented import Oriented, find_oriented, find_slants, polarizes_beams
from vrte.scene.scene import Scene

LAST_PLACES = 4.0  # what sums of thicknesses may be off by
KEPT = 512  # cosines of directions, up to which matrices of interfaces are kept: 64 times 260 kB at most
LOWEST = 1e-8  # cosines below are along the surface: they lead nowhere


@dataclass(frozen=True, eq=False)
class Interfaces:
    """Mueller matrices (interface, n, 4, 4) of power reflected from above and below, transmitted down and up."""

    above: Array
    below: Array
    down: Array
    up: Array


@dataclass(frozen=True, eq=False)
class Passing:
    """Light at every interface, (interface, n, 4, columns): above it down and up, below it down and up."""

    arriving: Array
    leaving: Array
    entering: Array
    rising: Array


def find_cosines(media: tuple[float, ...], index: float, mu: Array) -> Array:
    """Cosines (medium, n) of directions mu (n,) in a medium of that index, by Snell's law; 0 where they do not go.
    Read-only, few ones kept."""
    find = _keep_cosines if mu.size <= KEPT else _keep_cosines.__wrapped__
    return find(media, index, mu.tobytes())


@lru_cache(maxsize=64)  # of a solve some ten are asked for twice, and again at other wavelengths
def _keep_cosines(media: tuple[float, ...], index: float, along: bytes) -> Array:
    """The same of directions as they lie in memory."""
    mu = np.frombuffer(along)
    indices = np.array(media)[:, None]
    square = (indices - index) * (indices + index) + (index * mu) ** 2
    kept = (indices == index) | (mu == 1.0)  # the normal to the last place: odd orders would see the rest
    cosines = np.where(kept, mu, np.sqrt(np.maximum(square, 0.0)) / indices)
    return make_readonly(np.where(cosines < LOWEST, 0.0, np.minimum(cosines, 1.0)))


def make_interfaces(scene: Scene, cosines: Array) -> Interfaces:
    """Interfaces of a scene along cosines (medium, n); rough ones send no beam on. Read-only, few ones kept."""
    ends = None if scene.base is None else -1
    thin = tuple([layer.extent == 0.0 for layer in scene.layers[:ends]])
    if cosines.size > KEPT or scene.below.keeps_beams:
        return _find_interfaces(scene.media, scene.interfaces, thin, scene.base, cosines)
    return _keep_interfaces(scene.media, tuple(scene.interfaces), thin, scene.base is None, cosines.tobytes())


@lru_cache(maxsize=64)
def _keep_interfaces(
    media: tuple[float, ...],
    interfaces: Sequence[Interface | None],
    thin: tuple[bool, ...],
    is_open: bool,
    along: bytes,
) -> Interfaces:
    """The same of a scene without a base (``is_open``), or with one that sends no beam up."""
    cosines = np.frombuffer(along).reshape(len(media), -1)
    return _find_interfaces(media, interfaces, thin, None if is_open else BLACK, cosines)


def _find_interfaces(
    media: tuple[float, ...],
    interfaces: Sequence[Interface | None],
    thin: tuple[bool, ...],
    base: Boundary | None,
    cosines: Array,
) -> Interfaces:
    """The same, worked out; ``thin``: which layers, but for the last over a base, have no thickness."""
    found = Interfaces(*(np.zeros((len(media) - 1, cosines.shape[1], 4, 4)) for _ in range(4)))
    for k, interface in enumerate(interfaces):
        if interface is None:
            found.down[k] = found.up[k] = np.eye(4)
        elif interface.is_smooth:
            ways = (
                (media[k], media[k + 1], cosines[k], cosines[k + 1], found.above, found.down),
                (media[k + 1], media[k], cosines[k + 1], cosines[k], found.below, found.up),
            )
            for index, behind, here, there, reflected, passed in ways:
                through, turned = (here > 0.0) & (there > 0.0), (here > 0.0) & (there == 0.0)
                both = behind / index, here[through], there[through]  # grazing, neither cosine tells the other
                passed[k, through] = transmit_smooth(*both)
                reflected[k, through] = FLIP[:, None] * reflect_smooth(*both)
                reflected[k, turned] = FLIP[:, None] * reflect_smooth(behind / index, here[turned])
    if base is not None:
        lit = cosines[-1] > 0.0
        found.down[-1] = found.up[-1] = 0.0
        found.above[-1, lit] = FLIP[:, None] * base.reflect_beam(media[-1], cosines[-1, lit])
    for k in np.flatnonzero(thin).tolist():  # what nothing leads into or out of, and nothing absorbs, is dark
        trapped = ~(found.down[k] + found.up[k] + found.down[k + 1] + found.up[k + 1]).any(axis=(1, 2))
        found.below[k, trapped] = 0.0
    for part in vars(found).values():
        make_readonly(part)
    return found


def pass_along(interfaces: Interfaces, decay: Array, sources: Passing) -> Passing:
    """Light everywhere from ``sources`` on both sides of every interface; decay (layer, n) or (layer, n, 4, 4) through
    each layer."""
    last, every = interfaces.above.shape[0] - 1, (1, 2, 3)
    one = np.eye(interfaces.above.shape[-1])
    acts = (np.stack([interfaces.down, interfaces.up]) != one).any(axis=(0, 2, 3, 4))
    acts |= np.stack([interfaces.above, interfaces.below]).any(axis=(0, 2, 3, 4))
    lit = {name: part.any(every) for name, part in vars(sources).items()}

    def add(light: Array, name: str, k: int) -> Array:
        return light + getattr(sources, name)[k] if lit[name][k] else light

    back: list[Array] = [np.zeros_like(interfaces.above[0])] * (last + 1)  # reflection of what lies below an interface
    sent = [sources.rising[last]] * (last + 1)  # and its own light, as they rise to the interface
    inverse: list[Array] = [one] * (last + 1)
    seen, own = back[last], sources.rising[last]
    for k in range(last, -1, -1):
        if k < last:
            own = own + seen @ sources.arriving[k + 1] if lit["arriving"][k + 1] else own
            own = add(attenuate(decay[k], own), "rising", k)
            seen = attenuate(decay[k], seen)
            seen = attenuate(decay[k], seen) if decay.ndim == 2 else seen @ decay[k]
        back[k], sent[k] = seen, own
        own = seen @ sources.entering[k] + own if lit["entering"][k] else own
        if acts[k]:
            inverse[k] = np.linalg.inv(one - seen @ interfaces.below[k])
            up = interfaces.up[k] @ inverse[k]
            own, seen = up @ own, interfaces.above[k] + up @ seen @ interfaces.down[k]
        own = add(own, "leaving", k)
    found = Passing(*(np.empty_like(part) for part in vars(sources).values()))
    arriving = sources.arriving[0]
    for k in range(last + 1):
        through = add(interfaces.down[k] @ arriving if acts[k] else arriving, "entering", k)
        rising = leaving = back[k] @ through + sent[k]
        if acts[k]:
            rising = inverse[k] @ rising
            leaving = interfaces.above[k] @ arriving + interfaces.up[k] @ rising
            through = through + interfaces.below[k] @ rising
        found.arriving[k], found.leaving[k] = arriving, add(leaving, "leaving", k)
        found.rising[k], found.entering[k] = rising, through
        arriving = add(attenuate(decay[k], through), "arriving", k + 1) if k < last else arriving
    return found


def find_decaying(thickness: Array, slants: Array) -> Array:
    """e^(-thickness/slant) of layers (layer,), slants (layer, n), 0 where light does not go."""
    with np.errstate(divide="ignore", invalid="ignore"):
        decay = np.exp(-thickness[:, None] / slants)
    return np.where(slants > 0.0, decay, 0.0)


def find_decays(oriented: Sequence[Oriented | None], thickness: Array, cosines: Array) -> Array:
    """What layers of that thickness (layer,) leave of light along cosines (layer, n), 0 where it does not go: numbers
    (layer, n), or matrices (layer, n, 4, 4) where plates polarize it. ``oriented`` is empty where none has flakes."""
    decays = find_decaying(thickness, find_slants(oriented, cosines))
    if not polarizes_beams(oriented):
        return decays
    found = decays[..., None, None] * np.eye(4)
    for k, one in enumerate(oriented):
        if one is not None and one.polarizes and np.isfinite(thickness[k]):
            goes = cosines[k] > 0.0
            rates, parts = one.find_rates(cosines[k, goes])
            left = np.exp(-rates * (thickness[k] / cosines[k, goes, None]))
            found[k, goes] = np.einsum("nr,nrab->nab", left, parts).real
    return found


def attenuate(decay: Array, light: Array) -> Array:
    """Light (n, 4, columns) that a layer leaves, decay (n,) or (n, 4, 4)."""
    return decay[:, None, None] * light if decay.ndim == 1 else decay @ light


def follow_beams(interfaces: Interfaces, decay: Array) -> Passing:
    """Mueller matrices of beams that come in from above, at every interface."""
    dark = np.zeros_like(interfaces.above)
    arriving = dark.copy()
    arriving[0] = np.eye(4)
    return pass_along(interfaces, decay, Passing(arriving, dark, dark, dark))


@dataclass(frozen=True, eq=False)
class Depths:
    """Where depths (n_tau,) lie: interface and side ``under``, or -1 and the ``share`` of the ``layer``'s thickness."""

    interface: IntArray
    under: BoolArray
    layer: IntArray
    share: Array

    def medium(self, media: tuple[float, ...]) -> Array:
        """The refractive index at every depth, (n_tau,)."""
        index = np.where(self.interface < 0, self.layer + 1, self.interface + self.under)
        return np.array(media)[index]


def locate_depths(scene: Scene, tau: Array, under: BoolArray) -> Depths:
    """Where optical depths lie; of layers without thickness the first interface above and the last below count."""
    return _locate_again(
        tuple([layer.extent for layer in scene.layers]), scene.base is None, tau.tobytes(), under.tobytes()
    )


@lru_cache(maxsize=8)  # asked for the light, its beams, its balance and the medium that it is in
def _locate_again(extents: tuple[float, ...], is_open: bool, depths: bytes, sides: bytes) -> Depths:
    """The same of depths and sides as they lie in memory, under layers so thick, with nothing below or with a base."""
    thickness, tau, under = np.array(extents), np.frombuffer(depths), np.frombuffer(sides, bool)
    tops = np.concatenate([[0.0], np.cumsum(thickness)])
    near = np.abs(tops - tau[:, None]) <= LAST_PLACES * np.finfo(float).eps * tau[:, None]
    first, last = near.argmax(axis=1), near.shape[1] - 1 - near[:, ::-1].argmax(axis=1)
    interface = np.where(near.any(axis=1), np.where(under, last, first), -1)
    if not is_open:  # nothing lies below a base
        under = under & (interface < thickness.size)
    layer = np.clip(np.searchsorted(tops, tau, side="right") - 1, 0, thickness.size - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(np.isinf(thickness[layer]), tau - tops[layer], (tau - tops[layer]) / thickness[layer])
    found = interface.astype(np.int32), under, layer.astype(np.int32), np.where(interface < 0, share, 0.0)
    for each in found:
        each.flags.writeable = False  # shared by all who ask
    return Depths(*found)


@lru_cache(maxsize=4)  # of a result are asked: the beams, the balance of light, the forward peak
def _follow_into(scene: Scene, mu0: bytes) -> tuple[list[Oriented | None], Array, Array, Passing]:
    """Of beams that come in along mu0 the flakes and the thickness of each layer, cosines (layer, n_in), and light."""
    cosines = find_cosines(scene.media, scene.index_above, np.frombuffer(mu0))
    thickness = np.array([layer.extent for layer in scene.layers])
    oriented = [find_oriented(layer, layer.thickness) for layer in scene.layers]
    decays = find_decays(oriented, thickness, cosines[1:-1])
    return oriented, thickness, cosines[1:-1], follow_beams(make_interfaces(scene, cosines), decays)


def find_direct_light(scene: Scene, mu0: Array, depths: Depths) -> Array:
    """Beams up and down over the power of the incident one, (n_tau, n_in, 2, 4, 4), public frame."""
    oriented, thickness, cosines, passing = _follow_into(scene, mu0.tobytes())
    found = np.empty((depths.interface.size, mu0.size, 2, 4, 4))
    for t, k in enumerate(depths.interface.tolist()):
        if k >= 0:
            parts = (passing.rising, passing.entering) if depths.under[t] else (passing.leaving, passing.arriving)
            found[t] = np.stack([part[k] for part in parts], axis=1)
            continue
        k, share = int(depths.layer[t]), float(depths.share[t])
        length = thickness[k : k + 1] if np.isfinite(thickness[k]) else np.ones(1)
        shares = (1.0 - share, share) if np.isfinite(thickness[k]) else (np.inf, share)
        upward, down = (find_decays(oriented[k : k + 1], part * length, cosines[k : k + 1])[0] for part in shares)
        found[t, :, 0] = attenuate(upward, passing.leaving[k + 1])
        found[t, :, 1] = attenuate(down, passing.entering[k])
    found[:, :, 0] = FLIP[:, None] * found[:, :, 0]
    return found
