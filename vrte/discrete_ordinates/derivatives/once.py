"""How light that is scattered or reflected once changes, in closed form: each factor of it in turn."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.changes import Change
from vrte.discrete_ordinates.execution.through_interfaces import (
    Scatter,
    Vertex,
    group_pieces,
    make_base_reflector,
    make_facet_scatterer,
    make_scatterer,
)
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.single_scattering import integrate_slab_paths
from vrte.discrete_ordinates.planning.azimuths import Azimuths
from vrte.scene.beams import Passing
from vrte.scene.boundary import Boundary


@record
class Bend:
    """Where beams change their direction once: what scatters them, unit power of them; ``pick`` of all beams those that
    come there, (source, n_in, 4, 4); the places of what they send out among all sources, (source,); the piece that
    scatters each, (source,)."""

    scatter: Scatter
    pick: Callable[[Passing], Array]
    sources: IntArray
    of: IntArray
    is_surface: bool = False

    def make_vertex(self, lights: Sequence[tuple[Array, Array]], scatter: Scatter | None = None) -> Iterator[Vertex]:
        """A vertex of all beams of power (source, n_in, 4, n_col) of which ``escapes`` (n_tau, n_out, 4, source, 4) let
        something be seen, if any; or with another scatterer."""
        parts = []
        for power, escapes in lights:
            some = np.flatnonzero(power.any(axis=(1, 2, 3)) & escapes.any(axis=(0, 1, 2, 4)))
            if some.size:
                parts.append((power[some], escapes[:, :, :, some], self.of[some]))
        if parts:
            powers, seen, of = zip(*parts, strict=True)
            own = np.concatenate(powers), np.concatenate(seen, axis=3), scatter or self.scatter, np.concatenate(of)
            yield Vertex(*own, self.is_surface)


class OnceScattered:
    """All light of a stack that is scattered or reflected once; its ``escapes`` (n_tau, n_out, 4, source, 4)."""

    def __init__(self, beam_paths: BeamPaths, base: Boundary, escapes: Array, azimuths: Azimuths, run: Run) -> None:
        self.beam_paths, self.base, self.escapes, self.azimuths, self.run = beam_paths, base, escapes, azimuths, run
        media, cut, into, sights = beam_paths.media, beam_paths.cut, beam_paths.into, beam_paths.sights
        self.pieces: list[tuple[Bend, IntArray, int, Array]] = []  # with the pieces, the way on, and their paths
        size = into.shape[1] * sights.cosines.shape[1] * azimuths.phi.size
        every = replace(
            beam_paths.problem, gain=np.ones_like(beam_paths.problem.gain)
        )  # what scatters nothing may begin
        for pieces in group_pieces(every, media, cut, size):
            mu_in, mu_out = self.find_cosines(pieces)
            paths = integrate_slab_paths(cut.thickness[pieces], mu_in, mu_out)
            gain = beam_paths.problem.gain[cut.layer[pieces], None, None]
            for way, path in enumerate(paths):  # light from above goes on at that end, light from below at the other
                sources = np.concatenate([2 * pieces + way, 2 * pieces + 1 - way])
                of = np.arange(sources.size, dtype=np.int32) % pieces.size
                scatter = self.make_scatterer(pieces, way, gain * path)
                bend = Bend(scatter, partial(pick_at_pieces, pieces=pieces), sources, of)
                self.pieces.append((bend, pieces, way, path))
        self.surfaces = [bend for index in beam_paths.rough for bend in self.bend_on_facets(index)]
        if base.orders_reflected:
            self.surfaces.append(self.reflect(base))

    def find_cosines(self, pieces: IntArray) -> tuple[Array, Array]:
        """Of beams (n_in,) and sights (n_sight,) in the medium of some pieces, 1 for those that do not go there."""
        index = 1 + self.beam_paths.cut.layer[pieces[0]]
        into, out = self.beam_paths.into[index], self.beam_paths.sights.cosines[index]
        return np.where(into > 0.0, into, 1.0), np.where(out > 0.0, out, 1.0)

    def make_scatterer(self, pieces: IntArray, way: int, path: Array, table: Array | None = None) -> Scatter:
        """`make_scatterer` of some pieces with a path (piece, n_in, n_sight)."""
        one = self.beam_paths
        given = one.problem, one.media, one.cut, pieces, one.into, one.sights, self.azimuths, way, self.run
        return make_scatterer(*given, table=table, path=path)

    def reflect(self, base: Boundary) -> Bend:
        """The beam that the base, or another one, reflects."""
        one = self.beam_paths
        return make_surface_bend(
            make_base_reflector(base, one.media, one.into, one.sights, self.azimuths), "arriving", -1, -1
        )

    def bend_on_facets(self, index: int) -> Iterator[Bend]:
        """The beams that facets turn at an interface of the pieces."""
        one, number = self.beam_paths, int(self.beam_paths.cut.interface[index])
        for side, transmitted in itertools.product((0, 1), (False, True)):
            given = one.media, number, side, transmitted, one.into, one.sights, self.azimuths
            scatter = make_facet_scatterer(one.find_interface(index), *given)
            source = 2 * (one.cut.layer.size + one.rough.index(index)) + (side ^ transmitted)
            yield make_surface_bend(scatter, ("arriving", "rising")[side], index, source)

    def find_power(self, light: Array) -> Array:
        """Power (source, n_in, 4, n_col) of beams (source, n_in, 4, 4)."""
        problem = self.beam_paths.problem
        return problem.mu0[:, None, None] * (light @ problem.columns.T)

    def differentiate(self, change: Change, changed: Array | None) -> Iterator[Vertex]:
        """Vertices whose light adds up to the derivative; ``changed``: that of the escapes."""
        beams = self.beam_paths.beams
        for bend in [*(bend for bend, *_ in self.pieces), *self.surfaces]:
            lights = []
            if change.beams is not None:
                lights.append((self.find_power(bend.pick(change.beams)), self.escapes[:, :, :, bend.sources]))
            if changed is not None:
                lights.append((self.find_power(bend.pick(beams)), changed[:, :, :, bend.sources]))
            yield from bend.make_vertex(lights)
        for bend, pieces, way, path in self.pieces:
            for some, scatter in self.change_scatterers(change, pieces, way, path):
                here = np.isin(bend.of, some)
                own = replace(
                    bend, sources=bend.sources[here], of=np.searchsorted(some, bend.of[here]).astype(np.int32)
                )
                lights = [(self.find_power(bend.pick(beams)[here]), self.escapes[:, :, :, own.sources])]
                yield from own.make_vertex(lights, scatter)
        for weight, boundary in change.base:
            if boundary.orders_reflected:
                own = self.reflect(boundary)
                power = weight * self.find_power(own.pick(beams))
                yield from own.make_vertex([(power, self.escapes[:, :, :, own.sources])])

    def change_scatterers(
        self, change: Change, pieces: IntArray, way: int, path: Array
    ) -> Iterator[tuple[IntArray, Scatter]]:
        """How the scattering of some pieces changes that have the ``path`` (piece, n_in, n_sight): of which of them."""
        cut, problem = self.beam_paths.cut, self.beam_paths.problem
        mu_in, mu_out = self.find_cosines(pieces)
        layers = cut.layer[pieces]
        length, gain = cut.thickness[pieces, None, None], problem.gain[layers, None, None]
        strength = np.array([change.layers[k].gain for k in layers.tolist()])[:, None, None] * path
        deeper = change.pieces[pieces, None, None]
        if deeper.any():
            slope = np.exp(-length / mu_in[:, None]) / mu_out
            strength = strength + gain * deeper * (slope - path / mu_out if way else slope * np.exp(-length / mu_out))
        some = np.flatnonzero(strength.any(axis=(1, 2))).astype(np.int32)
        if some.size:
            yield some, self.make_scatterer(pieces[some], way, strength[some])
        for layer in np.unique(layers).tolist():
            if change.layers[layer].whole.any():
                some = np.flatnonzero(layers == layer).astype(np.int32)
                table = np.concatenate([_core.series_table(change.layers[layer].whole)] * some.size)
                yield some, self.make_scatterer(pieces[some], way, (gain * path)[some], table)


def pick_at_pieces(beams: Passing, pieces: IntArray) -> Array:
    """Beams that come into pieces from above, then from below, (2 piece, n_in, 4, 4)."""
    return np.concatenate([beams.entering[pieces], beams.leaving[pieces + 1]])


def make_surface_bend(scatter: Scatter, name: str, index: int, source: int) -> Bend:
    """Of beams of that name at an interface."""

    def pick(beams: Passing) -> Array:
        light: Array = getattr(beams, name)[index][None]
        return light

    return Bend(scatter, pick, np.array([source]), np.zeros(1, np.int32), is_surface=True)
