"""How light that is scattered or reflected once changes, in closed form: each factor of it in turn."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.changes import Change, change_escapes, find_change
from vrte.discrete_ordinates.execution.through_interfaces import (
    Vertex,
    make_base_reflector,
    make_facet_scatterer,
    make_scatterer,
    make_vertex,
)
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.media import Sights, find_escapes
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_slab_paths
from vrte.discrete_ordinates.planning.azimuths import Azimuths
from vrte.scene.boundary import BLACK, Boundary
from vrte.scene.vary import Variation


def list_changed_vertices(
    problem: Problem, base: Boundary, variations: Sequence[Variation], carried: int, azimuths: Azimuths, run: Run
) -> tuple[Sights, list[list[Vertex]]]:
    """For each variation, vertices whose light adds up to the derivative of all that is scattered once."""
    beam_paths = BeamPaths(replace(problem, stokes=ALL), BLACK, 1, 1.0)
    sources = [*beam_paths.sources, (beam_paths.cut.interface.size - 1, 2)]  # the base's, whether it reflects or not
    found = []
    escapes = find_escapes(
        beam_paths.media, beam_paths.cut, beam_paths.sights, problem.n_up, list(ALL), np.array(sources)
    )
    for variation in variations:
        change = find_change(beam_paths, variation, carried)
        changed = change_escapes(beam_paths, change, np.array(sources))
        found.append(list_vertices_of(beam_paths, base, change, escapes, changed, azimuths, run))
    return beam_paths.sights, found


def list_vertices_of(
    beam_paths: BeamPaths,
    base: Boundary,
    change: Change,
    escapes: Array,
    changed: Array | None,
    azimuths: Azimuths,
    run: Run,
) -> list[Vertex]:
    """Of one variation: for each way that light goes, what changes of the beam, the scatterer, and the way out."""
    problem, media, cut, beams, moved = (
        beam_paths.problem,
        beam_paths.media,
        beam_paths.cut,
        beam_paths.beams,
        change.beams,
    )
    into, sights = beam_paths.into, beam_paths.sights
    lit, columns = problem.mu0[:, None, None], problem.columns.T
    found: list[Vertex] = []

    def add(light: Array, new_light: Array | None, source: int, scatter: object, is_surface: bool = False) -> None:
        seen = escapes[:, :, :, source]
        if new_light is not None and new_light.any() and seen.any():
            found.append(make_vertex(lit * (new_light @ columns), seen, scatter, is_surface))  # type: ignore[arg-type]
        if changed is not None and light.any() and changed[:, :, :, source].any():
            found.append(make_vertex(lit * (light @ columns), changed[:, :, :, source], scatter, is_surface))  # type: ignore[arg-type]

    for k, layer in enumerate(cut.layer.tolist()):
        ways = (
            (beams.entering[k], None if moved is None else moved.entering[k], 0),
            (beams.leaving[k + 1], None if moved is None else moved.leaving[k + 1], 1),
        )
        for light, new_light, below in ways:
            for end in range(2):
                way, source = int(end != below), 2 * k + end
                given = problem, media, cut, np.array([k], np.int32), into, sights, azimuths, way, run
                if problem.gain[layer] > 0.0:
                    add(light, new_light, source, make_scatterer(*given))
                seen = escapes[:, :, :, source]
                if light.any() and seen.any():
                    power = lit * (light @ columns)
                    for table, path in change_scatterer(beam_paths, change, k, way):
                        scatter = make_scatterer(*given, table=table, path=path[None])
                        found.append(make_vertex(power, seen, scatter))
    for k, index in enumerate(beam_paths.rough):
        sides = (
            (beams.arriving[index], None if moved is None else moved.arriving[index], 0),
            (beams.rising[index], None if moved is None else moved.rising[index], 1),
        )
        for light, new_light, side in sides:
            for transmitted in (False, True):
                scatter = make_facet_scatterer(
                    media, int(cut.interface[index]), side, transmitted, into, sights, azimuths
                )
                add(light, new_light, 2 * cut.layer.size + 2 * k + (side ^ transmitted), scatter, is_surface=True)
    if beams.arriving[-1].any() or (moved is not None and moved.arriving[-1].any()):
        light, new_light = beams.arriving[-1], None if moved is None else moved.arriving[-1]
        if base.orders_reflected:
            add(light, new_light, -1, make_base_reflector(base, media, into, sights, azimuths))
        for weight, boundary in change.variation.base:
            if boundary.orders_reflected and weight:
                reflect = make_base_reflector(boundary, media, into, sights, azimuths)
                found.append(make_vertex(weight * lit * (light @ columns), escapes[:, :, :, -1], reflect))
    return found


def change_scatterer(beam_paths: BeamPaths, change: Change, k: int, way: int) -> list[tuple[Array, Array]]:
    """What a piece's scattering changes by, as tables of phase matrices and what they are multiplied with instead of
    gain times path, (n_in, n_sight)."""
    problem, layer = beam_paths.problem, int(beam_paths.cut.layer[k])
    own, deeper = change.layers[layer], float(change.pieces[k])
    index, length, gain = 1 + layer, float(beam_paths.cut.thickness[k]), float(problem.gain[layer])
    mu_in, mu_out = (np.where(mu > 0.0, mu, 1.0) for mu in (beam_paths.into[index], beam_paths.sights.cosines[index]))
    path = integrate_slab_paths(np.array([length]), mu_in, mu_out)[way, 0]
    found = []
    strength = own.gain * path
    if deeper:
        slope = np.exp(-length / mu_in)[:, None] / mu_out
        slope = slope - path / mu_out if way else slope * np.exp(-length / mu_out)
        strength = strength + gain * deeper * slope
    if strength.any():
        found.append((beam_paths.media.scene.layers[layer].phase_matrix.series, strength))
    if gain > 0.0 and own.whole.any():
        found.append((_core.series_table(own.whole), gain * path))
    return found
