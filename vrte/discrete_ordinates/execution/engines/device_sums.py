"""Results added up on a device: scenes that are alike in one launch each of the sum over orders and of single
scattering."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from vrte.basics.arrays import IntArray
from vrte.basics.running import Run
from vrte.cl import sums
from vrte.cl.session import DeviceArray, Session
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Light, Share, Sum, Target, split_into_pieces, weigh_scatterers
from vrte.discrete_ordinates.planning.azimuths import compute_cos_sin

TOGETHER = 32e6  # bytes of results per batch of sums
ORDERS = 32  # cosines and sines are made for a multiple of this many orders, so that scenes reuse them


@dataclass(frozen=True, eq=False)
class Chunk:
    """One part, the ``part``-th, of some results that are alike, for the incident directions first .. last - 1."""

    results: Sequence[Sum]
    part: int
    first: int
    last: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the numbers, (scene, n_level, n_in, n_mu, n_phi, 4, n_place)."""
        n_level, _, *rest = self.results[0].parts[self.part].values.shape
        return len(self.results), n_level, self.last - self.first, *rest

    def take(self, values: Any, more: bool) -> None:
        """Puts numbers of that shape where they belong, or adds them to what is there, ``more``."""
        for result, found in zip(self.results, values, strict=True):
            there = result.parts[self.part].values[:, self.first : self.last]
            if more:
                there += found
            else:
                there[:] = found


def add_up(
    opened: Session,
    doubles: Session | None,
    results: Sequence[Sum],
    run: Run,
    told: Callable[[int], None],
    piece_bytes: float,
) -> None:
    """Adds up results, see `Adding`; single scattering by ``doubles``, a session on the same queue, or without one by
    the processor."""
    done = 0
    for chunks, finished in cut_into_chunks(results, piece_bytes):
        for chunk in chunks:
            tables = [add_chunk(opened, chunk, run, doubles is opened)]
            if chunk.results[0].in_closed_form and doubles not in (None, opened):
                tables.append(add_chunk(doubles, chunk, run, True, orders=False))
            with run.timed("from the device"):
                for index, table in enumerate(tables):
                    chunk.take(opened.download(table), index > 0)
        done += finished
        told(done)
    for result in results if doubles is None else ():
        if result.in_closed_form:
            add = PROCESSOR.prepare_scattering(result.target, result.parts, run)
            for part in result.parts:
                add(Share(part, 0, result.target.wanted.scale.size))


def cut_into_chunks(results: Sequence[Sum], piece_bytes: float) -> Iterator[tuple[list[Chunk], int]]:
    """All parts of as many results as go together, or of a piece of one, and how many pieces that finishes."""
    groups: dict[Any, list[Sum]] = {}
    for result in results:
        groups.setdefault(make_key(result), []).append(result)
    for group in groups.values():
        one = group[0]
        pieces = list(split_into_pieces(one.target.wanted, one.target.azimuths.phi.size, piece_bytes))
        size = sum(part.values.nbytes for part in one.parts) / len(pieces)
        together = max(1, int(min(TOGETHER, piece_bytes) // max(size, 1.0))) if len(pieces) == 1 else 1
        for begin in range(0, len(group), together):
            some = group[begin : begin + together]
            for first, last in pieces:
                yield [Chunk(some, part, first, last) for part in range(len(one.parts))], len(some)


def make_key(result: Sum) -> tuple[Any, ...]:
    """Alike for results that are added up in one table."""
    target, parts = result.target, result.parts
    problem, wanted = target.problem, target.wanted
    arrays = problem.mu0, problem.columns, wanted.place, wanted.scale, target.azimuths.phi, target.azimuths.distinct
    each = ((part.values.shape, part.levels.tobytes(), part.rows.tobytes(), part.mu.tobytes()) for part in parts)
    return result.in_closed_form, *(array.tobytes() for array in arrays), *each


def add_chunk(opened: Session, chunk: Chunk, run: Run, scattering: bool, orders: bool = True) -> DeviceArray:
    """Sums over ``orders`` and single ``scattering`` of a chunk, on the device."""
    scenes, *one = chunk.shape
    room = opened.zeros(chunk.shape)
    table = sums.Table(room.data, tuple(one), scenes)
    with run.timed("fourier sum", opened.finish):
        most = max(len(result.lights) for result in chunk.results)
        for index in range(most if orders else 0):
            for lights in group_lights(chunk.results, index):
                add_lights(opened, chunk, lights, table)
    if scattering and chunk.results[0].in_closed_form:
        with run.timed("single scattering", opened.finish):
            add_scattering(opened, chunk, table)
    return room


def group_lights(results: Sequence[Sum], index: int) -> Iterator[list[tuple[int, Light]]]:
    """The ``index``-th light of every result, with its number, those together that lie in the same memory."""
    groups: dict[Any, list[tuple[int, Light]]] = {}
    for number, result in enumerate(results):
        if index < len(result.lights):
            light = result.lights[index]
            held = light.kernels
            key = id(held.data), held.strides, light.stokes.tobytes(), light.columns.tobytes(), id(light.factors)
            groups.setdefault(key, []).append((number, light))
    yield from groups.values()


def add_lights(opened: Session, chunk: Chunk, lights: Sequence[tuple[int, Light]], table: sums.Table) -> None:
    """Orders that lie in the same memory, added into a table."""
    result, light = chunk.results[0], lights[0][1]
    target, part, upload = result.target, result.parts[chunk.part], opened.constant
    held = light.kernels
    per_item, per_level, per_beam, *_ = held.strides
    begin = min(some.kernels.first for _, some in lights)
    runs = [list_runs(number, (some.kernels.first - begin) // per_item, some.orders) for number, some in lights]
    most = -(-(1 + max(int(some.orders[-1]) for _, some in lights)) // ORDERS) * ORDERS
    levels = part.levels if per_item > per_level else np.zeros_like(part.levels)  # light of the top alone has one
    arrays = levels, part.rows, np.ascontiguousarray(target.wanted.scale[chunk.first : chunk.last]), light.factors
    entries, where = find_entries(opened, target, light, part.values.shape[5], most), upload_azimuths(opened, target)
    levels_there, rows, scale, factors = (upload(values) for values in arrays)
    rest = levels_there, rows, scale, factors, (0, chunk.last - chunk.first), table
    kernels = sums.Kernels(held.data, held.strides, begin + chunk.first * per_beam)
    for turn in range(max(map(len, runs))):  # more than one where orders do not follow each other
        shares = np.array([some[turn] for some in runs if turn < len(some)], np.int32)
        sums.add_orders(opened, kernels, upload(shares), entries, where, *rest)


def list_runs(number: int, item: int, orders: IntArray) -> list[tuple[int, int, int, int]]:
    """Orders that follow each other: of which scene, their first item, how many, the first order.

    >>> list_runs(7, 20, np.array([3, 4, 6]))
    [(7, 20, 2, 3), (7, 22, 1, 6)]
    """
    cuts = [0, *(np.flatnonzero(np.diff(orders) != 1) + 1).tolist(), orders.size]
    return [(number, item + begin, end - begin, int(orders[begin])) for begin, end in pairwise(cuts) if end > begin]


def find_entries(opened: Session, target: Target, light: Light, n_place: int, most: int) -> sums.Entries:
    """Which elements the light of ``most`` orders from 0 on adds to, and its waves, kept for the next time."""
    stokes: Any = light.stokes
    kind: Any = target.kind[light.columns]
    index: Any = target.wanted.place[light.columns]
    distinct = target.azimuths.distinct

    def make() -> sums.Entries:
        waves = target.azimuths.cos_sin(np.arange(most, dtype=np.int32))
        return sums.upload_entries(opened, stokes, kind, index, n_place, *waves)

    tables = stokes, kind, index, distinct
    return opened.remembered(("entries", n_place, most, *(a.tobytes() for a in tables)), make)


def upload_azimuths(opened: Session, target: Target) -> sums.Azimuths:
    """The azimuths of a result, kept for the next time."""
    of: Any = target.azimuths

    def make() -> sums.Azimuths:
        return sums.upload_azimuths(opened, of.angle, of.sign, of.distinct.size)

    return opened.remembered(("azimuths", of.angle.tobytes(), of.sign.tobytes()), make)


def add_scattering(opened: Session, chunk: Chunk, table: sums.Table) -> None:
    """Single scattering in all layers of all scenes, but where small angles are separated."""
    target, part, beams = chunk.results[0].target, chunk.results[0].parts[chunk.part], slice(chunk.first, chunk.last)
    scenes = [
        [(series, path[:, beams]) for series, path in weigh_scatterers(result.target, result.parts[chunk.part])]
        for result in chunk.results
    ]
    if not any(scenes):
        return
    problem = target.problem
    columns: Any = problem.columns, target.kind, target.wanted.place
    seen = problem.mu0[beams], part.mu, *compute_cos_sin(target.azimuths.distinct), *columns
    directions = sums.upload_directions(opened, *seen)
    scatterers = sums.upload_scatterers(opened, scenes)
    incident = 0, chunk.last - chunk.first
    sums.add_scattering(opened, scatterers, directions, upload_azimuths(opened, target), incident, table)
