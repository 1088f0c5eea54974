"""Light added up: the sum over Fourier orders, single scattering, light of the forward peak, the base's reflection."""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray, record, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.through_interfaces import add_vertices, list_vertices
from vrte.discrete_ordinates.orders.discretise import sort_up_first
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import add_base_reflected, find_scatterers, scatter_by_orders
from vrte.discrete_ordinates.orders.small_angle import Anisotropic
from vrte.discrete_ordinates.planning.azimuths import Azimuths
from vrte.request.request import Wanted
from vrte.scene.beams import find_cosines
from vrte.scene.scene import Scene


@record
class Light:
    """Multiply scattered light of some Fourier orders, with the same Stokes components and incident columns.

    orders (order,); stokes (S,): which of I, Q, U, V; columns (n_col,): which of the problem's; kernels (order, n_tau,
    n_in, n_col, n_out, S): multiply scattered radiance for a unit beam, public frame, light going up first.
    """

    orders: IntArray
    stokes: IntArray
    columns: IntArray
    kernels: Any


@record
class Target:
    """What light is added up into: the parts ``wanted`` of the radiance in scenes, and their discrete problem.

    mu (n_mu,): signed cosines in the order of the result; spreads (n_mu,): for which of them light of the forward
    peak stands for single scattering.
    """

    wanted: Wanted
    scenes: Sequence[Scene]
    problem: Problem
    mu: Array
    azimuths: Azimuths
    spreads: BoolArray

    @property
    def scene(self) -> Scene:
        """The only scene, or the first."""
        return self.scenes[0]

    @cached_property
    def kind(self) -> IntArray:
        """1 for incident Stokes vectors within (U, V), 0 for those within (I, Q), (n_col,)."""
        return np.array(self.problem.columns[:, 2:].any(axis=1), np.int32)


@record
class Part:
    """One array of the result, values (scene n_level, n_in, n_mu, n_phi, 4, n_place).

    levels (n_level,): indices of depths; places (scene n_level,): those among the depths of all scenes; rows (n_mu,):
    places of its directions among the problem's; mu (n_mu,): signed cosines; spreads (n_mu,): whether small angles are
    separated there.
    """

    levels: IntArray
    places: IntArray
    rows: IntArray
    mu: Array
    spreads: BoolArray
    values: Array


@record
class Share:
    """The incident directions first .. last - 1 of a part."""

    part: Part
    first: int
    last: int


Adder = Callable[..., None]  # of a share, and of the run that does it, where that is another than it was prepared for


@record
class Sum:
    """A result on its way: what is to be added up into its parts, zeros at first; ``in_closed_form``: whether single
    scattering is added so, in all layers, but where small angles are separated."""

    target: Target
    lights: Sequence[Light]
    parts: list[Part]
    in_closed_form: bool


class Adding(Protocol):
    """What an engine does of the sums."""

    @property
    def piece_bytes(self) -> float:
        """Of a result that is added up at a time."""

    def add_up(self, sums: Sequence[Sum], run: Run, report: Callable[[int], None]) -> None:
        """Adds the sums over Fourier orders, (1:6)-(1:8), and single scattering to all parts of all results; report(k)
        is called when k pieces of them are done."""


def fill_parts(
    target: Target, lights: Sequence[Light], engine: Adding, run: Run, report: Callable[[int], None] = lambda done: None
) -> list[Array]:
    """The radiance of every part that is wanted, (n_level, n_in, n_mu, n_phi, 4, n_place): see `fill_results`."""
    (parts,) = fill_results([(target, lights)], engine, run, report)
    return parts


def fill_results(
    lit: Sequence[tuple[Target, Sequence[Light]]],
    engine: Adding,
    run: Run,
    report: Callable[[int], None] = lambda done: None,
) -> list[list[Array]]:
    """The radiance of every part of many results, (n_level, n_in, n_mu, n_phi, 4, n_place) each.

    An engine adds up Fourier orders and single scattering; light of the forward peak and the beam reflected by the base
    come from the processor. report(k) is called when the engine is done with k pieces.
    """
    sums = [prepare_sum(target, lights, run) for target, lights in lit]
    seen = [result for result in sums if any(part.rows.size for part in result.parts)]  # else fluxes alone
    engine.add_up(seen, run, report)
    for result in seen:
        adders, n_phi = prepare_rest(result, choose_sum_threads(result, run)), result.target.azimuths.phi.size
        for first, last in split_into_pieces(result.target.wanted, n_phi, engine.piece_bytes):
            for part in result.parts:
                for add in adders:
                    add(Share(part, first, last))
    return [[part.values for part in result.parts] for result in sums]


def prepare_sum(target: Target, lights: Sequence[Light], run: Run) -> Sum:
    """What an engine is to add up; single scattering by orders, where its closed form is not to be used."""
    skip_flags, through_interfaces = target.problem.skip_flags, target.problem.media is not None
    by_orders = not (skip_flags.single or through_interfaces)
    more = [find_single_scattering(target, run)] if by_orders else []
    return Sum(target, [*lights, *more], make_parts(target), not (by_orders or through_interfaces))


def choose_sum_threads(result: Sum, run: Run) -> Run:
    """The run, on one thread where starting another would take longer than the sums."""
    if run.threads == 1:
        return run
    small = sum(part.values.nbytes for part in result.parts) < cost.WORTH_THREADS_SUMS
    return replace_unchecked(run, threads=1) if small else run


def prepare_rest(result: Sum, run: Run) -> list[Adder]:
    """What the processor adds to a result beside an engine."""
    target = result.target
    if target.problem.media is not None:
        return [prepare_vertices(target, run) if target.problem.scenes == 1 else prepare_under_smooth(target, run)]
    spread = result.in_closed_form and bool(target.spreads.any())
    return [*([prepare_spreading(target, run)] if spread else []), prepare_base(target, run)]


def split_evenly(first: int, last: int, parts: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 of so many parts, or of as many as there are.

    >>> list(split_evenly(2, 7, 2))
    [(2, 4), (4, 7)]
    """
    parts = min(parts, last - first)
    return itertools.pairwise(first + k * (last - first) // parts for k in range(parts + 1))


def make_parts(target: Target) -> list[Part]:
    """Zeros; the problem has light going up first, in the order of the request otherwise."""
    mu, wanted, count = target.mu, target.wanted, target.problem.scenes
    row = sort_up_first(mu.tobytes())[1]
    tail = target.azimuths.phi.size, 4, int(wanted.place.max()) + 1
    before = np.arange(count, dtype=np.int32)[:, None] * target.problem.level_layer.size
    return [
        Part(
            levels,
            (before + levels).ravel(),
            row[directions],
            mu[directions],
            target.spreads[directions],
            np.zeros((count * levels.size, wanted.scale.size, directions.size, *tail)),
        )
        for levels, directions in wanted.parts
    ]


def count_pieces(wanted: Wanted, n_phi: int, piece_bytes: float) -> int:
    """Pieces that the result is filled in, each some of the incident directions."""
    size = 8.0 * wanted.doubles(n_phi)
    if wanted.scale.size == 1 or not size:
        return int(size > 0.0)
    return max(1, min(wanted.scale.size, math.ceil(size / piece_bytes)))


def split_into_pieces(wanted: Wanted, n_phi: int, piece_bytes: float) -> Iterator[tuple[int, int]]:
    """First and last + 1 incident direction of every piece."""
    count = count_pieces(wanted, n_phi, piece_bytes)
    return itertools.pairwise(k * wanted.scale.size // count for k in range(count + 1))


def weigh_scatterers(target: Target, part: Part) -> list[tuple[Array, Array]]:
    """The tables of every phase matrix and what multiplies it, (scene n_level, n_in, n_mu): 0 where small angles are
    separated."""
    scale, spreading = target.wanted.scale[:, None], part.spreads.any()
    return [
        (table, np.where(part.spreads, 0.0, scale * path) if spreading else scale * path)
        for table, path in find_scatterers(target.scenes, target.problem, part.levels, part.mu)
    ]


def find_single_scattering(target: Target, run: Run) -> Light:
    """Single scattering by Fourier orders, where its closed form shall not be used."""
    with run.timed("single scattering"):
        kernels = scatter_by_orders(target.scene.layers, target.problem)
    orders, columns = (np.arange(kernels.shape[axis], dtype=np.int32) for axis in (0, 3))
    return Light(orders, np.array(ALL, np.int32), columns, kernels)


def prepare_closed_form(target: Target, run: Run) -> Callable[..., None]:
    """What adds a phase matrix times path (n_level, n_in, n_mu) to values, for the beams mu0 from first to last - 1."""
    columns, azimuths, stacks = target.problem.columns, target.azimuths, target.problem.scenes
    several: dict[str, Any] = {"slab_stacks": stacks} if stacks > 1 else {}
    kind, index = target.kind, target.wanted.place

    def add(
        stage: str,
        table: Array,
        path: Array,
        mu0: Array,
        mu: Array,
        first: int,
        last: int,
        values: Array,
        own: Run = run,
        **more: Any,
    ) -> None:
        with own.timed(stage) as crew:
            own.kernels.add_single_scattering(
                crew,
                table=table,
                path=path,
                mu0=mu0,
                mu=mu,
                **azimuths.arguments,
                columns=columns,
                kind=kind,
                place=index,
                first=first,
                last=last,
                out=values,
                **several,
                **more,
            )

    return add


def prepare_spreading(target: Target, run: Run) -> Adder:
    """What adds one scattering of the beam, as it spreads by small angles, (2:4), where that is asked for."""
    scatter, problem = prepare_closed_form(target, run), target.problem
    alone = replace_unchecked(run, threads=1, kernels=_core)
    anisotropic = Anisotropic(target.scene, problem)

    def add(share: Share) -> None:
        part, towards = share.part, np.flatnonzero(share.part.spreads).astype(np.int32)
        for i in range(share.first, share.last):
            begin = time.perf_counter()
            mu0, strength = float(problem.mu0[i]), float(target.wanted.scale[i]) / (4.0 * np.pi)
            beams = anisotropic.beams(mu0)
            for t, level in enumerate(part.levels.tolist()):
                for indices, tables in anisotropic.sources(mu0, beams, level, part.mu[towards]):
                    run.record("small angles", time.perf_counter() - begin)
                    for before, first, last in list_runs(towards[indices]):
                        count = last - first
                        here = problem.mu0[i : i + 1], part.mu[first:last], 0, 1
                        path, values = np.full((1, 1, count), strength), part.values[t : t + 1, i : i + 1, first:last]
                        own = tables[before : before + count].reshape(-1, tables.shape[2])
                        table = _core.series_table(own, count)
                        scatter("small angles", table, path, *here, values, alone, apiece=True)
                    begin = time.perf_counter()

    return add


def list_runs(indices: IntArray) -> Iterator[tuple[int, int, int]]:
    """Where numbers that rise by 1 begin in an array, which they are, first and last + 1.

    >>> list(list_runs(np.array([4, 5, 6, 9])))
    [(0, 4, 7), (3, 9, 10)]
    """
    ends = [0, *(np.flatnonzero(np.diff(indices) != 1) + 1).tolist(), indices.size]
    return ((begin, int(indices[begin]), int(indices[end - 1]) + 1) for begin, end in itertools.pairwise(ends))


def prepare_base(target: Target, run: Run) -> Adder:
    """What adds the beam that the base reflects."""
    wanted, bases = target.wanted, [scene.below for scene in target.scenes]

    def add(share: Share, own: Run = run) -> None:
        part, index = share.part, (wanted.place, wanted.scale, share.first, share.last)
        with own.timed("single scattering"):
            add_base_reflected(bases, target.problem, part.levels, part.mu, target.azimuths.phi, *index, part.values)

    return add


def prepare_under_smooth(target: Target, run: Run) -> Adder:
    """What adds light scattered or reflected once in many scenes under the same smooth surface, seen from above it: as
    without the surface, along refracted directions, and then through it."""
    media, problem, wanted = target.problem.media, target.problem, target.wanted
    assert media is not None
    scene, inner = media.scene, media.scene.indices[0]
    into, out = (find_cosines(scene.media, scene.index_above, mu) for mu in (problem.mu0, problem.mu_out))
    lit, seen = (np.where(each[1] > 0.0, each[1], 1.0) for each in (into, out))
    enters = media.interfaces_along(into).down[0] * ((into[1] > 0.0) * problem.mu0 / lit)[:, None, None]
    leaves = media.interfaces_along(out).up[0] * ((out[1] > 0.0) * (scene.index_above / inner) ** 2)[:, None, None]
    inside = replace_unchecked(problem, media=None, mu0=lit, mu_out=seen, columns=np.eye(4))
    every = Wanted(wanted.parts, np.arange(4, dtype=np.int32), np.ones(lit.size))
    below = replace(target, wanted=every, problem=inside, mu=seen)
    columns = enters @ problem.columns.T * wanted.scale[:, None, None]
    scatter, reflect = prepare_closed_form(below, run), prepare_base(below, run)

    def add(share: Share) -> None:
        part, (first, last) = share.part, (share.first, share.last)
        mu = seen[part.rows]
        light = np.zeros((*part.values.shape[:-1], 4))
        own = replace(part, mu=mu, values=light)
        for table, path in find_scatterers(target.scenes, inside, part.levels, mu):
            scatter("single scattering", table, path, lit, mu, first, last, light)
        reflect(Share(own, first, last))
        light = light[:, first:last] @ columns[None, first:last, None, None]
        light = leaves[part.rows][:, None] @ light
        for column, at in enumerate(wanted.place.tolist()):
            part.values[:, first:last, ..., at] += light[..., column]

    return add


def prepare_vertices(target: Target, run: Run) -> Adder:
    """What adds light scattered or reflected once, seen through interfaces."""
    wanted, n_up = target.wanted, target.problem.n_up
    sights, vertices = list_vertices(target.problem, target.scene.below, target.azimuths, run)
    scaled = [vertex.weigh(wanted.scale) for vertex in vertices]

    def add(share: Share) -> None:
        part, onto = share.part, share.part.values[:, share.first : share.last]
        add_vertices(sights, scaled, n_up, part.levels, part.rows, wanted.place, onto, share.first)

    return add
