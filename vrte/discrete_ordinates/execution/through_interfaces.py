"""Light scattered or reflected once, as it is seen through interfaces: in closed form over all Fourier orders."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.memory import BYTES, PIECE_BYTES
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.beam_paths import list_sources
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.media import (
    Cut,
    Media,
    Sights,
    find_beams,
    find_escapes,
    find_rough_places,
    list_sights,
)
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_slab_paths
from vrte.discrete_ordinates.planning.azimuths import Azimuths, fold_azimuths
from vrte.scene.boundary import Boundary
from vrte.scene.interface import Interface
from vrte.scene.oriented import Oriented
from vrte.scene.scene import Scene

COLUMNS = np.arange(4, dtype=np.int32)
Scatter = Callable[[int, int], Array]


@record
class Vertex:
    """Where light changes its direction once: power (source, n_in, 4, n_col) of beams there, through a horizontal
    plane; escapes (n_tau, n_out, 4, source, 4): what is seen of what is sent out; scatter(first, last): radiance
    (piece, n_in, n_sight, n_phi, 4, 4), over the square of the refractive index, for unit power along the incident
    directions first .. last - 1; of (source,): the piece that scatters."""

    power: Array
    escapes: Array
    scatter: Scatter
    of: IntArray
    is_surface: bool = False

    def weigh(self, weights: Array) -> "Vertex":
        """With the power of each incident direction weighed, (n_in,)."""
        return replace(self, power=self.power * weights[:, None, None])


def make_vertex(power: Array, escapes: Array, scatter: Scatter, is_surface: bool = False) -> Vertex:
    """Of one source: power (n_in, 4, n_col), escapes (n_tau, n_out, 4, 4)."""
    return Vertex(power[None], escapes[:, :, :, None], scatter, np.zeros(1, np.int32), is_surface)


def list_vertices(problem: Problem, base: Boundary, azimuths: Azimuths, run: Run) -> tuple[Sights, list[Vertex]]:
    """All of a problem, and the directions they are seen along."""
    media = problem.media
    assert media is not None
    cut = media.cut(problem.thickness, problem.level)
    into, beams = find_beams(media, cut, problem.mu0)
    sights = list_sights(media, problem.mu_out)
    rough = find_rough_places(media, cut)
    first_rough, sources = 2 * cut.layer.size, list_sources(cut, rough, base)
    escapes = find_escapes(media, cut, sights, problem.n_up, list(ALL), np.array(sources))
    lit, columns = problem.mu0[:, None, None], problem.columns.T
    found = []
    size = problem.mu0.size * sights.cosines.shape[1] * azimuths.phi.size
    groups = [(one, way) for way in (False, True) for one in group_pieces(problem, media, cut, size, way)]
    for pieces, is_of_flakes in groups:
        for way in range(2):  # light from above goes on at that end, light from below at the other
            ends = ((beams.entering[pieces], 2 * pieces + way), (beams.leaving[pieces + 1], 2 * pieces + 1 - way))
            lights = [(light, source) for light, source in ends if light.any() and escapes[:, :, :, source].any()]
            if lights:
                power, source = (np.concatenate(parts) for parts in zip(*lights, strict=True))
                if is_of_flakes:
                    scatter = make_flake_scatterer(problem, media, cut, pieces, into, sights, azimuths, way)
                else:
                    scatter = make_scatterer(problem, media, cut, pieces, into, sights, azimuths, way, run)
                of = np.arange(source.size, dtype=np.int32) % pieces.size
                found.append(Vertex(lit * (power @ columns), escapes[:, :, :, source], scatter, of))
    for k, index in enumerate(rough):
        for light, side in ((beams.arriving[index], 0), (beams.rising[index], 1)):
            for transmitted in (False, True):
                seen = escapes[:, :, :, first_rough + 2 * k + (side ^ transmitted)]
                if light.any() and seen.any():
                    number = int(cut.interface[index])
                    interface = media.scene.interfaces[number]
                    scatter = make_facet_scatterer(interface, media, number, side, transmitted, into, sights, azimuths)
                    found.append(make_vertex(lit * (light @ columns), seen, scatter, is_surface=True))
    if base.orders_reflected and beams.arriving[-1].any():
        found.append(
            make_vertex(
                lit * (beams.arriving[-1] @ columns),
                escapes[:, :, :, -1],
                make_base_reflector(base, media, into, sights, azimuths),
            )
        )
    return sights, found


def group_pieces(problem: Problem, media: Media, cut: Cut, size: int, of_flakes: bool = False) -> list[IntArray]:
    """Pieces whose particles scatter, or whose flakes do: those of one medium and of as many terms together, those with
    flakes layer by layer, as many as fit, ``size`` Mueller matrices each."""
    groups: dict[tuple[float, int, int], list[int]] = {}
    for k, layer in enumerate(cut.layer.tolist()):
        has_flakes = bool(problem.oriented) and problem.oriented[layer] is not None
        if has_flakes if of_flakes else problem.gain[layer] != 0.0:
            terms = len(media.scene.layers[layer].phase_matrix.series)
            groups.setdefault((media.scene.indices[layer], terms, layer if has_flakes else -1), []).append(k)
    step = max(1, int(PIECE_BYTES / (16 * BYTES * max(1, size))))
    return [
        np.array(every[first : first + step], np.int32)
        for every in groups.values()
        for first in range(0, len(every), step)
    ]


def make_scatterer(
    problem: Problem,
    media: Media,
    cut: Cut,
    pieces: IntArray,
    into: Array,
    sights: Sights,
    azimuths: Azimuths,
    way: int,
    run: Run,
    table: Array | None = None,
    path: Array | None = None,
) -> Scatter:
    """Of pieces in one medium, for light reflected (way 0) or let through (1); or of another table of a phase matrix,
    with ``path`` (piece, n_in, n_sight) in the place of gain times path."""
    layers = cut.layer[pieces]
    place, index = 1 + layers[0], media.scene.media[1 + layers[0]]
    if table is None:
        table = np.concatenate([media.scene.layers[layer].phase_matrix.series for layer in layers.tolist()])
    lit, out = into[place] > 0.0, sights.cosines[place] > 0.0
    mu_in = np.where(lit, into[place], 1.0)
    mu_out = np.where(out, sights.cosines[place], 1.0)
    plates = problem.oriented[layers[0]] if problem.oriented and path is None else None
    if plates is not None and plates.polarizes:  # all pieces are of one layer
        table = media.scene.layers[layers[0]].phase_matrix.series
        path = np.full((1, mu_in.size, mu_out.size), problem.gain[layers[0]])
    elif path is None:
        path = integrate_pieces(problem, cut, pieces, mu_in, mu_out, way) * problem.gain[layers, None, None]
    weighted = path * (lit[:, None] & out) / (4.0 * np.pi * index**2 * mu_in[:, None])
    signed = -mu_out if way else mu_out

    def scatter(first: int, last: int) -> Array:
        found = np.zeros((len(path), last - first, mu_out.size, azimuths.phi.size, 4, 4))
        with run.timed("single scattering") as crew:
            run.kernels.add_single_scattering(
                crew,
                table=table,
                path=np.ascontiguousarray(weighted[:, first:last]),
                mu0=np.ascontiguousarray(mu_in[first:last]),
                mu=signed,
                **azimuths.arguments,
                columns=np.eye(4),
                kind=np.array([0, 0, 1, 1], np.int32),
                place=COLUMNS,
                first=0,
                last=last - first,
                out=found,
                slab_stacks=len(path),
            )
        if not way:
            found *= FLIP[:, None]
        if plates is None or not plates.polarizes:
            return found
        return pass_plates(plates, cut.thickness[pieces], mu_in[first:last], mu_out, way, found[0])

    return scatter


def integrate_pieces(problem: Problem, cut: Cut, pieces: IntArray, mu_in: Array, mu_out: Array, way: int) -> Array:
    """Path integrals of one scattering in pieces of one layer, or of layers without flakes, for light reflected (way 0)
    or let through (1): over the outgoing cosine, (piece, n_in, n_out)."""
    one = problem.oriented[cut.layer[pieces[0]]] if problem.oriented else None
    if one is None:
        return integrate_slab_paths(cut.thickness[pieces], mu_in, mu_out)[way]
    slants = (mu / one.attenuate(mu) for mu in (mu_in, mu_out))
    return integrate_slab_paths(cut.thickness[pieces], *slants)[way] / one.attenuate(mu_out)


def make_flake_scatterer(
    problem: Problem,
    media: Media,
    cut: Cut,
    pieces: IntArray,
    into: Array,
    sights: Sights,
    azimuths: Azimuths,
    way: int,
) -> Scatter:
    """Of the flakes of pieces of one layer."""
    layer = int(cut.layer[pieces[0]])
    one = problem.oriented[layer]
    assert one is not None
    place, index = 1 + layer, media.scene.media[1 + layer]
    lit, out = into[place] > 0.0, sights.cosines[place] > 0.0
    mu_in, mu_out = np.where(lit, into[place], 1.0), np.where(out, sights.cosines[place], 1.0)
    weighted = np.broadcast_to(one.area * (lit[:, None] & out) / (index**2 * mu_in[:, None]), (1, mu_in.size, out.size))
    if not one.polarizes:
        weighted = weighted * integrate_pieces(problem, cut, pieces, mu_in, mu_out, way)
    phi = np.radians(azimuths.phi)

    def scatter(first: int, last: int) -> Array:
        signed = (-mu_out if way else mu_out)[:, None]
        found = one.flakes.scatter(signed, -mu_in[first:last, None, None], phi)
        if not way:
            found = FLIP[:, None] * found
        found = weighted[:, first:last, :, None, None, None] * found
        if not one.polarizes:
            return found
        return pass_plates(one, cut.thickness[pieces], mu_in[first:last], mu_out, way, found[0])

    return scatter


def pass_plates(one: Oriented, thickness: Array, mu_in: Array, mu_out: Array, way: int, scattered: Array) -> Array:
    """Light scattered once in pieces (piece,), reflected (way 0) or let through (1), where plates polarize it on its
    way in and out: (piece, n_in, n_out, n_phi, 4, 4), from what a unit of depth scatters, ``scattered`` without the
    first.

    That is int e^(-K s/mu) Z e^(-K' s'/mu') ds/mu, summed over pairs of rates of K and K'."""
    (rate_in, part_in), (rate_out, part_out) = (one.find_rates(mu) for mu in (mu_in, mu_out))
    rate_in, rate_out = (rate_in / mu_in[:, None])[:, None, None], (rate_out / mu_out[:, None])[None, :, :, None]
    found = np.empty((thickness.size, *scattered.shape))
    for out, depth in zip(found, thickness.tolist(), strict=True):
        path = find_pair_paths(rate_in, rate_out, depth, way) / mu_out[:, None, None]
        acts = np.einsum("iorq,orac,iqdb->ioabcd", path, part_out, part_in, optimize=True).real
        out[...] = np.einsum("ioabcd,iopcd->iopab", acts, scattered, optimize=True)
    return found


def find_pair_paths(rate_in: Array, rate_out: Array, depth: float, way: int) -> Array:
    """Integrals of e^(-x s) over a slab, x the sum of two rates (way 0), and of e^(-x s - y (depth - s)) (way 1)."""
    if way == 0:
        both = rate_in + rate_out
        return -np.expm1(-both * depth) / both if math.isfinite(depth) else 1.0 / both
    if math.isinf(depth):
        return np.zeros_like(rate_in + rate_out)
    slower = np.where(rate_in.real < rate_out.real, rate_in, rate_out)
    apart = (rate_in + rate_out - 2.0 * slower) * depth
    near = np.abs(apart) < 1e-8
    ratio = np.where(near, 1.0 - 0.5 * apart, -np.expm1(-apart) / np.where(near, 1.0, apart))
    return depth * np.exp(-slower * depth) * ratio


def make_facet_scatterer(
    interface: Interface | None,
    media: Media,
    number: int,
    side: int,
    transmitted: bool,
    into: Array,
    sights: Sights,
    azimuths: Azimuths,
) -> Scatter:
    """Of a rough interface at the place of that number, for light from above (side 0) or below (1)."""
    assert interface is not None
    here, there = number + side, number + (side ^ transmitted)
    surface = (interface.turned if side else interface).facets
    lit, out = into[here] > 0.0, sights.cosines[there] > 0.0
    mu_in, mu_out = np.where(lit, into[here], 1.0), np.where(out, sights.cosines[there], 1.0)

    def scatter(first: int, last: int) -> Array:
        given = mu_in[first:last, None, None], mu_out[:, None], azimuths.phi
        found = surface.transmit(*given) if transmitted else FLIP[:, None] * surface.reflect(*given)
        found = found * (lit[first:last, None] & out)[..., None, None, None]
        return np.asarray(found / media.scene.media[there] ** 2)[None]

    return scatter


def make_base_reflector(base: Boundary, media: Media, into: Array, sights: Sights, azimuths: Azimuths) -> Scatter:
    """How the base scatters a beam that falls on it."""
    index = media.scene.media[-1]
    lit, out = into[-1] > 0.0, sights.cosines[-1] > 0.0
    mu_in, mu_out = np.where(lit, into[-1], 1.0), np.where(out, sights.cosines[-1], 1.0)

    def scatter(first: int, last: int) -> Array:
        f = base.reflect(mu_in[first:last, None, None], mu_out[:, None], azimuths.phi)
        found = np.zeros((last - first, mu_out.size, azimuths.phi.size, 4, 4))
        found[..., : f.shape[-2], : f.shape[-1]] = f
        found *= (lit[first:last, None] & out)[..., None, None, None] / index**2
        return FLIP[:, None] * found[None]

    return scatter


def add_vertices(
    sights: Sights,
    vertices: list[Vertex],
    n_up: int,
    levels: IntArray,
    rows: IntArray,
    place: IntArray,
    onto: Array,
    first: int = 0,
) -> None:
    """Adds what is seen at each level from the incident directions from ``first`` on, each column at its ``place``:
    onto (n_level, n_in, n_row, n_phi, 4, n_place)."""
    last = first + onto.shape[1]
    for vertex in vertices:
        own = replace(vertex, power=np.ascontiguousarray(vertex.power[:, first:last]))
        add_scattered(sights, own, vertex.scatter(first, last), n_up, levels, rows, place, onto)


def add_scattered(
    sights: Sights,
    vertex: Vertex,
    scattered: Array,
    n_up: int,
    levels: IntArray,
    rows: IntArray,
    place: IntArray,
    onto: Array,
) -> None:
    """The same of what the vertex has ``scattered``, of all of its power."""
    flip = np.where((rows < n_up)[:, None], FLIP, 1.0)[:, :, None, None]
    in_order = place.size == onto.shape[-1] and bool((np.diff(place) == 1).all())
    for level, light in zip(levels.tolist(), onto, strict=True):
        escapes = np.ascontiguousarray(flip * vertex.escapes[level, rows] * sights.index[level] ** 2)
        if escapes.any():
            given = np.ascontiguousarray(scattered), vertex.power, escapes, vertex.of, sights.place[level, rows]
            seen = _core.see_scattered(*given, light if in_order else None)
            for column, at in enumerate([] if in_order else place.tolist()):
                light[..., at] += seen[..., column]


def find_rough_reflection(scene: Scene, mu_i: Array, mu_o: Array, phi: Array, run: Run) -> Array:
    """What rough interfaces send back to the top of beams that met no particle, f [1/sr], (mu_i, mu_o, phi, 4, 4)."""
    problem = discretise_scene(scene, mu_i, np.eye(4), mu_o, np.zeros(1), 2)
    sights, vertices = list_vertices(problem, scene.below, fold_azimuths(phi, True), run)
    surfaces = [vertex for vertex in vertices if vertex.is_surface]
    found = np.zeros((mu_i.size, mu_o.size, phi.size, 4, 4))
    level, rows = np.zeros(1, np.int32), np.arange(mu_o.size, dtype=np.int32)
    add_vertices(sights, surfaces, mu_o.size, level, rows, COLUMNS, found[None])
    return found / mu_i[:, None, None, None, None]
