"""From a scene and a request to the arrays that every stage works on."""

import math

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.quadrature import make_double_gauss, make_refracted_nodes
from vrte.discrete_ordinates.orders.media import Media
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.truncating import count_terms_carried, truncate_layers
from vrte.scene.beams import locate_depths
from vrte.scene.interface import Interface
from vrte.scene.scene import Scene

LOBE = 6.0  # Fourier orders of a lobe times its width [rad]
MOST_SURFACE_ORDERS = 256
LAST_PLACES = 4.0  # rounding errors of a sum of thicknesses, in units in the last place


def discretise_scene(
    scene: Scene,
    mu0: Array,
    columns: Array,
    mu: Array,
    tau: Array,
    nodes: int,
    peaks: str = "none",
    under: BoolArray | None = None,
    grading: int = 1,
    whole: bool = False,
) -> Problem:
    """Nodes, truncated layers and the one every depth lies in; ``mu`` signed, light going up first.

    ``peaks`` and ``whole``: which layers lose theirs, and what of the rest is kept, as of a `Truncation`; all depths of
    the problem are those of the truncated layers. ``under`` (n_tau,): whether a depth at an interface lies on its lower
    side, None: nowhere.
    """
    media = None
    if scene.keeps_beams:
        shared = make_refracted_nodes(scene.media, nodes, grading, scene.indices)
        points, weights = shared.carried(max(scene.media))
        media = Media(scene, shared, locate_depths(scene, tau, np.zeros(tau.size, bool) if under is None else under))
    else:
        points, weights = make_double_gauss(nodes, grading)
    layers = truncate_layers(scene, peaks, nodes, whole)
    terms = np.array([layer.coefficients.shape[0] for layer in layers], np.int32)
    coefficients = np.zeros((len(scene.layers), max(int(terms.max()), count_surface_orders(scene, nodes)), 6))
    for k, layer in enumerate(layers):
        coefficients[k, : terms[k]] = layer.coefficients
    given = np.array([layer.thickness for layer in scene.layers])
    level, at = place_levels(tau, find_layer_tops(given), given, scene.thickness)
    level = level * np.array([layer.stretch for layer in layers])[at]
    thickness = np.array([layer.thickness for layer in layers])
    return Problem(
        coefficients=coefficients,
        terms=terms,
        albedo=np.array([layer.albedo for layer in layers]),
        thickness=thickness,
        above=find_layer_tops(thickness),
        gain=np.array([layer.gain for layer in layers]),
        fraction=np.array([layer.fraction for layer in layers]),
        nodes=points,
        weights=weights,
        mu_out=np.abs(mu),
        n_up=int(np.count_nonzero(mu > 0.0)),
        mu0=np.ascontiguousarray(mu0),
        columns=np.ascontiguousarray(columns),
        level=level,
        level_layer=at,
        terms_cut=max(0, max(layer.phase_matrix.terms for layer in scene.layers) - count_terms_carried(scene, nodes)),
        media=media,
        grading=grading,
    )


def find_layer_tops(thickness: Array) -> Array:
    """Optical depth of the top of each layer."""
    return np.concatenate([[0.0], np.cumsum(thickness[:-1])])


def place_levels(tau: Array, above: Array, thickness: Array, total: float) -> tuple[Array, IntArray]:
    """The depth of each tau below the top of its layer, and the layer.

    What lies within rounding of an interface lies on it: along a cosine of 1e-8 the last place of 1 is a path of 2e-8.
    """
    if thickness[0] > 0.0 and not tau.any():
        return np.zeros(tau.size), np.zeros(tau.size, np.int32)
    at = np.clip(np.searchsorted(above, tau, side="right") - 1, 0, None).astype(np.int32)
    at[tau >= total] = above.size - 1
    level = np.clip(tau - above[at], 0.0, thickness[at])
    rounding = LAST_PLACES * np.finfo(float).eps * tau
    level = np.where(level <= rounding, 0.0, level)
    level = np.where(thickness[at] - level <= rounding, thickness[at], level)
    return np.where(tau >= total, thickness[-1], level), at


def count_surface_orders(scene: Scene, nodes: int) -> int:
    """Fourier orders in which light goes to and fro between surfaces without meeting a particle, one of them rough or a
    base that scatters unevenly: as many as lobes of that width have, or as nodes carry; 0 where none does."""
    rough = [interface for interface in scene.interfaces if interface is not None and not interface.is_smooth]
    surfaces = sum(interface is not None for interface in scene.interfaces)
    uneven = scene.below.orders_reflected > 1
    if surfaces + (scene.below.keeps_beams or uneven) < 2 or not (rough or uneven):
        return 0
    by_lobes = [math.ceil(LOBE / find_lobe_width(interface)) for interface in rough]
    return min(max([count_terms_carried(scene, nodes) * uneven, *by_lobes]), MOST_SURFACE_ORDERS)


def find_lobe_width(interface: Interface) -> float:
    """About the width [rad] of what a rough interface makes of a beam that goes through it."""
    ratio = interface.index_below / interface.index_above
    return interface.roughness * min(1.0, abs(1.0 - 1.0 / ratio), abs(1.0 - ratio))
