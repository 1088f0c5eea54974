"""From a scene and a request to the arrays that every stage works on."""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.quadrature import make_double_gauss, make_refracted_nodes
from vrte.discrete_ordinates.orders.media import Media
from vrte.discrete_ordinates.orders.oriented_flakes import find_largest_albedo
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import count_terms_carried, truncate_layers
from vrte.optics.truncation import Truncated
from vrte.scene.beams import find_cosines, locate_depths
from vrte.scene.interface import Interface
from vrte.scene.layer import Layer
from vrte.scene.oriented import Oriented, find_oriented
from vrte.scene.scene import Scene

LOBE = 6.0  # Fourier orders of a lobe times its width [rad]
REFLECTED = 0.6  # width [rad] of what facets reflect over alpha; with 1, a film at alpha 0.3 missed 2e-8 of its light
MOST_SURFACE_ORDERS = 256
FINEST, EVEN = 1e-9, 8  # least accuracy of the Fourier orders of lobes of flakes; orders beside those counted
SAMPLES = 33  # directions of each kind that these are looked at in
LAST_PLACES = 4.0  # rounding errors of a sum of thicknesses, in units in the last place


def discretise_scene(
    scene: Scene, mu0: Array, columns: Array, mu: Array, tau: Array, nodes: int, peaks: str = "none", **more: Any
) -> Problem:
    """One scene, with depths tau (n_tau,); see `discretise_scenes`."""
    return discretise_scenes([scene], mu0, columns, mu, tau[None], nodes, [peaks], **more)


def discretise_scenes(
    scenes: Sequence[Scene],
    mu0: Array,
    columns: Array,
    mu: Array,
    tau: Array,
    nodes: int,
    peaks: Sequence[str],
    under: BoolArray | None = None,
    grading: int = 1,
    whole: bool = False,
    accuracy: float = 1e-9,
) -> Problem:
    """Nodes, truncated layers and the one every depth lies in, the same in all scenes; tau (scene, n_tau); ``mu``
    signed, light going up first.

    ``peaks`` (scene,) and ``whole``: which layers lose theirs, and what of the rest is kept, as of a `Truncation`; all
    depths of the problem are those of the truncated layers. ``under`` (n_tau,): whether a depth at an interface lies on
    its lower side, None: nowhere. ``accuracy``: to which lobes of flakes have Fourier orders. More than one scene
    refract alike, if at all: under the same smooth surface.
    """
    scene, count = scenes[0], len(scenes)
    layers = [one for each, of in zip(scenes, peaks, strict=True) for one in truncate_layers(each, of, nodes, whole)]
    oriented: tuple[Oriented | None, ...] = ()
    if scene.has_flakes:
        oriented = tuple(
            find_oriented(*each) for each in zip(scene.layers, [one.thickness for one in layers], strict=True)
        )
        layers = [mix(*each) for each in zip(scene.layers, layers, oriented, strict=True)]
    media = None
    if scene.needs_beam_paths:
        shared = make_refracted_nodes(scene.media, nodes, grading, scene.indices)
        points, weights = shared.carried(max(scene.media))
        sides = np.zeros(tau.shape[1], bool) if under is None else under
        media = Media(scene, shared, locate_depths(scene, tau[0], sides), oriented)
    else:
        points, weights = make_double_gauss(nodes, grading)
    of_layers = [(one.albedo, one.thickness, one.gain, one.fraction, one.stretch) for one in layers]
    albedo, thickness, gain, fraction, stretch = np.array(of_layers).T.copy()
    sizes = [one.coefficients.shape[0] for one in layers]
    orders = count_surface_orders(scene, nodes)
    if scene.has_flakes:
        orders = max(orders, min(count_flake_orders(scene, mu0, np.abs(mu), tau[0], accuracy), MOST_SURFACE_ORDERS))
    coefficients = np.zeros((len(layers), max(*sizes, orders), 6))
    for k, one in enumerate(layers):
        coefficients[k, : sizes[k]] = one.coefficients
    level, at = place_levels(tau, scenes)
    if level.any():
        level *= stretch.reshape(count, -1)[:, at]
    longest = max(layer.phase_matrix.terms for each in scenes for layer in each.layers)
    return Problem(
        coefficients=coefficients,
        terms=np.array(sizes, np.int32),
        albedo=albedo,
        thickness=thickness,
        above=find_layer_tops(thickness.reshape(count, -1)).ravel(),
        gain=gain,
        fraction=fraction,
        nodes=points,
        weights=weights,
        mu_out=np.abs(mu),
        n_up=int(np.count_nonzero(mu > 0.0)),
        mu0=np.ascontiguousarray(mu0),
        columns=np.ascontiguousarray(columns),
        level=level.ravel(),
        level_layer=at,
        terms_cut=max(0, longest - count_terms_carried(scene, nodes)),
        media=media,
        grading=grading,
        scenes=count,
        oriented=oriented,
    )


@lru_cache(maxsize=32)
def sort_up_first(mu: bytes) -> tuple[IntArray, IntArray]:
    """The order of signed cosines, as they lie in memory, with light going up first, and the place of each in it."""
    rank = np.argsort(np.frombuffer(mu) < 0.0, kind="stable").astype(np.int32)
    return rank, np.argsort(rank).astype(np.int32)


def find_layer_tops(thickness: Array) -> Array:
    """Optical depth of the top of each layer; (scene, layer) both."""
    tops = np.zeros(thickness.shape)
    if thickness.shape[1] > 1:
        np.cumsum(thickness[:, :-1], axis=1, out=tops[:, 1:])
    return tops


def place_levels(tau: Array, scenes: Sequence[Scene]) -> tuple[Array, IntArray]:
    """The depth of each tau (scene, n_tau) below the top of its layer, and the layer (n_tau,), that of all scenes.

    What lies within rounding of an interface lies on it: along a cosine of 1e-8 the last place of 1 is a path of 2e-8.
    """
    if not tau.any() and all([scene.layers[0].extent for scene in scenes]):
        return np.zeros(tau.shape), np.zeros(tau.shape[1], np.int32)
    thickness = np.array([[layer.extent for layer in scene.layers] for scene in scenes])
    above, total = find_layer_tops(thickness), np.array([scene.thickness for scene in scenes])[:, None]
    at = np.maximum((above[:, None] <= tau[..., None]).sum(axis=2) - 1, 0)
    at[tau >= total] = above.shape[1] - 1
    own = np.take_along_axis(thickness, at, axis=1)
    level = np.minimum(np.maximum(tau - np.take_along_axis(above, at, axis=1), 0.0), own)
    rounding = LAST_PLACES * sys.float_info.epsilon * tau
    level = np.where(level <= rounding, 0.0, level)
    level = np.where(own - level <= rounding, own, level)
    return np.where(tau >= total, thickness[:, -1:], level), at[0].astype(np.int32)


def count_surface_orders(scene: Scene, nodes: int) -> int:
    """Fourier orders in which light goes to and fro between surfaces without meeting a particle, one of them rough or a
    base that scatters unevenly: as many as lobes of that width have, or as nodes carry; 0 where none does."""
    surfaces = sum(interface is not None for interface in scene.interfaces)
    if surfaces + mirrors_light(scene) < 2:
        return 0
    uneven = scene.below.orders_reflected > 1
    return min(max(count_terms_carried(scene, nodes) * uneven, count_lobe_orders(scene)), MOST_SURFACE_ORDERS)


def mirrors_light(scene: Scene) -> bool:
    """Whether the base reflects beams, or light unevenly."""
    return scene.below.keeps_beams or scene.below.orders_reflected > 1


def count_lobe_orders(scene: Scene) -> int:
    """Fourier orders of the narrowest lobe that a rough interface makes of a beam between surfaces, where what the last
    of them lets through into layers meets no other; 0 without one. Out of a film it is counted: GGX's tail has 1e-8."""
    surfaces = [interface for interface in scene.interfaces if interface is not None]
    counted = scene.interfaces[-1] is not None or mirrors_light(scene)
    ways = [(surface, k < len(surfaces) or counted) for k, surface in enumerate(surfaces, 1)]
    widths = [find_lobe_width(*way) for way in ways if not way[0].is_smooth]
    return max([math.ceil(LOBE / width) for width in widths], default=0)


def count_flake_orders(scene: Scene, mu0: Array, mu: Array, tau: Array, accuracy: float) -> int:
    """Fourier orders of light that flakes scatter twice or more often, of beams mu0 (n_in,) towards directions mu (n,)
    at depths: until the accuracy is left of the narrowest lobes, see `count_orders_between`."""
    found, orders = locate_depths(scene, tau, np.zeros(tau.size, bool)).medium(scene.media), 0
    for place, layer in enumerate(scene.layers, 1):
        if layer.flakes is not None and layer.has_flakes:
            ways = (scene.index_above, mu0), *((index, mu) for index in set(found.tolist()))
            into, *seen = (np.unique(find_cosines(scene.media, *way)[place]) for way in ways)
            out = np.unique(np.concatenate(seen))
            if into[-1] > 0.0 and out[-1] > 0.0:
                pair = into[into > 0.0], out[out > 0.0]
                orders = max(orders, count_orders_between(layer.flakes.width, *pair, accuracy))
    return orders


def count_orders_between(tilt: float, into: Array, out: Array, accuracy: float) -> int:
    """Fourier orders of light scattered twice by flakes of that tilt, between cosines, by way of the direction that has
    the most: a lobe from mu to mu' is tilt (mu + mu') wide in azimuth, lobes are Gaussians, and so is their strength in
    the tilts that turn light that far: about a tenth of the accuracy is left beyond."""
    into, out = (each[np.linspace(0, each.size - 1, min(each.size, SAMPLES)).astype(int)] for each in (into, out))
    first, last, by = into[:, None, None], out[:, None], np.linspace(0.0, 1.0, SAMPLES)
    turned = [(np.arcsin(mu) - np.arcsin(by)) / (2.0 * tilt) for mu in (first, last)]
    left = np.maximum(-math.log(max(accuracy, FINEST)) - 0.5 * (turned[0] ** 2 + turned[1] ** 2), 0.0)
    return math.ceil(float((np.sqrt(2.0 * left) / np.hypot(first + by, last + by)).max() / tilt)) + EVEN


def mix(layer: Layer, one: Truncated, oriented: Oriented | None) -> Truncated:
    """What truncation left of a layer's particles, with its flakes: all per unit of their common depth."""
    if oriented is None:
        return one
    scattered = oriented.particles * one.albedo
    albedo, thickness = 1.0, one.thickness + layer.flake_area
    if not (oriented.flakes.is_conserving and scattered == oriented.particles):
        albedo = find_largest_albedo(oriented, scattered)
    gain = layer.albedo * layer.thickness / thickness if layer.thickness else 0.0
    stretch = thickness / layer.extent if layer.thickness else 1.0
    coefficients = one.coefficients * (scattered / albedo)
    return replace(one, coefficients=coefficients, albedo=albedo, thickness=thickness, stretch=stretch, gain=gain)


def find_lobe_width(interface: Interface, goes_on: bool) -> float:
    """About the width [rad] of what a rough interface makes of a beam that it reflects, or lets through where that
    light ``goes_on`` to another surface."""
    ratio = interface.index_below / interface.index_above
    return interface.roughness * min([REFLECTED, *([abs(1.0 - 1.0 / ratio), abs(1.0 - ratio)] if goes_on else [])])
