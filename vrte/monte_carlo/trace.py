"""Photons in batches: the core follows them, and bases that the core does not know reflect them here."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array, BoolArray
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run
from vrte.monte_carlo.describe import describe_scene, find_rates
from vrte.optics.facets import make_rotation
from vrte.scene.beams import locate_depths
from vrte.scene.boundary import Boundary
from vrte.scene.scene import Scene

BATCHES = 128  # of a beam: errors are those of their means, known to 6 %
AT_ONCE = 16  # batches of a call of the core
MOST_BYTES = 2e9  # of the bins of these
MOST_EVENTS = 1e6  # collisions and surfaces of a photon, which is given up then
LEAST_KEPT = 0.05  # of a photon's weight: the least chance that a base sends it on
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX = (np.uint64(30), np.uint64(0xBF58476D1CE4E5B9)), (np.uint64(27), np.uint64(0x94D049BB133111EB))


@dataclass(frozen=True, eq=False)
class Places:
    """Where photons are counted: of each depth its place (n_tau,), 0 outside at the top, 1 outside at the bottom, else
    a level; ``layer`` and ``depth`` of all places."""

    of: NDArray[np.int32]
    layer: NDArray[np.int32]
    depth: Array


def find_places(scene: Scene, tau: Array, under: BoolArray) -> Places:
    """The places of depths (n_tau,), at interfaces on their lower side where they are ``under`` (n_tau,)."""
    found = locate_depths(scene, tau, under)
    of, layer, depth = [], [-1, -1], [0.0, 0.0]
    for k, below, inside, share in zip(found.interface, found.under, found.layer, found.share, strict=True):
        if k == 0 and not below:
            of.append(0)
        elif k == len(scene.layers) and below:
            of.append(1)
        else:
            of.append(len(layer))
            if k >= 0:
                inside, share = (k, 0.0) if below else (k - 1, 1.0)
            extent = scene.layers[inside].extent
            layer.append(int(inside))
            depth.append(float(share if math.isinf(extent) else share * extent))
    return Places(np.array(of, np.int32), np.array(layer, np.int32), np.array(depth))


@dataclass(frozen=True, eq=False)
class Views:
    """Single directions at depths: directions of travel and theta-hat (n_view, 6), the layer and the depth in it
    (n_view,)."""

    along: Array
    layer: NDArray[np.int32]
    depth: Array


NO_VIEWS = Views(np.empty((0, 6)), np.empty(0, np.int32), np.empty(0))


def make_views(scene: Scene, places: Places, mu: Array, phi: Array) -> Views:
    """Views of signed cosines (n_mu,) and azimuths [degrees] (n_phi,) at all depths, (n_tau n_mu n_phi) one by one."""
    last = len(scene.layers) - 1
    layer = np.concatenate([[0, last], places.layer[2:]]).astype(np.int32)[places.of]
    depth = np.concatenate([[0.0, scene.layers[last].extent], places.depth[2:]])[places.of]
    k, x, y = (each.ravel() for each in np.meshgrid(np.arange(layer.size), mu, np.radians(phi), indexing="ij"))
    sine, c, s = np.sqrt((1.0 - x) * (1.0 + x)), np.cos(y), np.sin(y)
    return Views(np.stack([sine * c, sine * s, x, x * c, x * s, -sine], axis=-1), layer[k], depth[k])


@dataclass(frozen=True, eq=False)
class Counted:
    """Means over batches and their standard errors, (2, ...) each, a photon: bins (2, place, 2, n_mu, n_phi, 4, 4) up
    and down; beams (2, place, 2, 4, 4); kept (2, keeper) of unpolarized light; spent (2, 4): collisions, photons given
    up, what leaves at the top and at the bottom; viewed (2, n_view, 4, 4) [1/sr], a BRDF along each view."""

    bins: Array
    beams: Array
    kept: Array
    spent: Array
    viewed: Array


def trace_beam(
    scene: Scene,
    mu_i: float,
    places: Places,
    edges: tuple[Array, Array],
    each: int,
    seed: int,
    beam: int,
    run: Run,
    progress: Progress | None = None,
    views: Views = NO_VIEWS,
) -> Counted:
    """Photons of a beam along mu_i, ``each`` of a batch; ``beam`` is its number among those of one seed. Views are of a
    scene without surfaces, over a black or a Lambertian base."""
    inside = places.depth[places.layer == len(scene.layers) - 1]
    described = describe_scene(scene, mu_i, float(inside.max(initial=0.0)))
    count = (edges[0].size - 1) * (edges[1].size - 1)
    shapes = {"bins": (places.layer.size, 2, count, 16), "beams": (places.layer.size, 2, 16)}
    shapes |= {"kept": (2 * len(scene.layers) + 1, 4), "spent": (4,), "viewed": (views.layer.size, 16)}
    together = max(AT_ONCE, 2 * run.threads)
    for name, what in (("bins", "mu_edges and phi_edges"), ("viewed", "mu and phi")):
        if 8.0 * together * np.prod(shapes[name], dtype=float) > MOST_BYTES:
            words = f"those of {places.layer.size} places take more than {MOST_BYTES / 1e9:g} GB at a time"
            raise SceneError.of(what, f"must be fewer: {words}")
    arrays = described.arrays | {
        "level_layer": places.layer,
        "level_depth": places.depth,
        "mu_edges": edges[0],
        "phi_edges": edges[1],
        "key": np.array([seed & 0xFFFFFFFF, seed >> 32], np.uint32).view(np.int32),
        "photons_each": each,
        "most_events": MOST_EVENTS,
        "views": views.along,
        "view_layer": views.layer,
        "view_depth": views.depth,
        "view_rate": find_rates(scene, views.along[:, 2]),
    }
    sums: dict[str, Array] = {name: np.zeros((2, *shape)) for name, shape in shapes.items()}
    for first in range(0, BATCHES, together):
        some = min(together, BATCHES - first)
        found = {name: np.zeros((some, *shape)) for name, shape in shapes.items()}
        arrays |= {"first_batch": beam * BATCHES + first}
        follow(arrays | found, described.parks, scene.below, scene.index_below, each, run)
        for name, values in found.items():
            for one in values / each:  # in order, whatever the number of batches at a time
                sums[name][0] += one
                sums[name][1] += one * one
        if progress is not None:
            progress(min(first + some, BATCHES), BATCHES)
    for both in sums.values():
        both[0] /= BATCHES
        both[1] = np.sqrt(np.maximum(both[1] / BATCHES - both[0] ** 2, 0.0) / (BATCHES - 1))
    sums["beams"][0, 0, 1] = np.eye(4).ravel()  # what comes in
    bins = sums["bins"].reshape(2, places.layer.size, 2, edges[0].size - 1, edges[1].size - 1, 4, 4)
    beams, viewed = sums["beams"].reshape(2, -1, 2, 4, 4), sums["viewed"].reshape(2, -1, 4, 4)
    return Counted(bins, beams, sums["kept"][..., 0], sums["spent"], viewed)


def follow(arrays: dict[str, Any], parks: bool, below: Boundary, index: float, each: int, run: Run) -> None:
    """Follows all photons of some batches to their ends; those that the core parks are sent on here."""
    n_batch = len(arrays["bins"])
    arrays = arrays | {"parked": np.zeros((n_batch, each if parks else 0, 24))}
    arrays |= {"parked_count": np.zeros(n_batch, np.int32)}
    while True:
        with run.timed("photons") as team:
            _core.trace_photons(team, **arrays)
        counts = arrays["parked_count"]
        if not counts.any():
            return
        starts, start_count = arrays["parked"][:, : counts.max()].copy(), np.zeros(n_batch, np.int32)
        for batch, count in enumerate(counts.tolist()):
            sent, lost = reflect_at_base(below, index, starts[batch, :count])
            start_count[batch] = len(sent)
            starts[batch, : len(sent)] = sent
            arrays["kept"][batch, -1] += lost
        arrays |= {"starts": starts[:, : max(1, start_count.max())].copy(), "start_count": start_count}
        if not start_count.any():
            return


def draw(states: NDArray[np.uint64]) -> Array:
    """The next chance of each photon, and its state moved on, as in core/photons.h."""
    states += GOLDEN
    mixed = states.copy()
    for shift, factor in MIX:
        mixed = (mixed ^ (mixed >> shift)) * factor
    mixed ^= mixed >> np.uint64(31)
    return ((mixed >> np.uint64(11)).astype(float) + 0.5) * 2.0**-53


def reflect_at_base(below: Boundary, index: float, photons: Array) -> tuple[Array, Array]:
    """Photons (n, 24) as parked, and what a base sends on of them, in directions evenly lit: (n_sent, 24); and the I
    that it keeps, by incident Stokes parameter (4,)."""
    if not len(photons):
        return photons, np.zeros(4)
    states = photons[:, 22].copy().view(np.uint64)
    w, m = photons[:, :3], photons[:, 6:22].reshape(-1, 4, 4)
    phi_i, into = find_meridians(w)
    m = turn_axes(w, photons[:, 3:6], into) @ m
    mu_i = np.clip(-w[:, 2], 1e-12, 1.0)
    mirrors = below.keeps_beams * (0.5 if below.orders_reflected else 1.0)
    mirrored = draw(states) < mirrors
    mu_o, phi = np.sqrt(draw(states)), 2.0 * np.pi * draw(states)
    mu_o, phi = np.where(mirrored, mu_i, mu_o), np.where(mirrored, 0.0, phi)
    act = np.zeros((len(photons), 4, 4))
    if mirrored.any():
        act[mirrored] = below.reflect_beam(index, mu_i[mirrored]) / mirrors
    if not mirrored.all():
        some = ~mirrored
        f = below.reflect(mu_i[some, None], mu_o[some, None], np.degrees(phi[some, None]))
        size = f.shape[-1]
        f = np.broadcast_to(f.reshape(-1, size, size), (int(some.sum()), size, size))
        act[some, :size, :size] = np.pi / (1.0 - mirrors) * f
    sent = act @ m
    lost = (m[:, 0] - sent[:, 0]).sum(axis=0)
    chance = np.clip(sent[:, 0, 0] / m[:, 0, 0], LEAST_KEPT, 1.0)
    goes_on = (draw(states) < chance) & (sent[:, 0, 0] > 0.0)
    sine, phi = np.sqrt((1.0 - mu_o) * (1.0 + mu_o)), phi_i + phi
    out = np.empty_like(photons)
    out[:, :3] = np.stack([sine * np.cos(phi), sine * np.sin(phi), mu_o], axis=-1)
    out[:, 3:6] = np.stack([mu_o * np.cos(phi), mu_o * np.sin(phi), -sine], axis=-1)
    out[:, 6:22] = (sent / chance[:, None, None]).reshape(-1, 16)
    out[:, 22], out[:, 23] = states.view(float), photons[:, 23] * mirrored
    return out[goes_on], lost


def find_meridians(w: Array) -> tuple[Array, Array]:
    """Azimuths [radians] (n,) and theta-hat (n, 3) of directions (n, 3)."""
    phi, across = np.arctan2(w[:, 1], w[:, 0]), np.hypot(w[:, 0], w[:, 1])
    return phi, np.stack([w[:, 2] * np.cos(phi), w[:, 2] * np.sin(phi), -across], axis=-1)


def turn_axes(w: Array, before: Array, after: Array) -> Array:
    """Rotations (n, 4, 4) of Stokes vectors of light along w from one axis to another, (n, 3) each."""
    across = np.cross(before, w)
    c, s = (before * after).sum(axis=-1), (across * after).sum(axis=-1)
    return make_rotation(-s, c)  # whose second axis is across the one that is meant
