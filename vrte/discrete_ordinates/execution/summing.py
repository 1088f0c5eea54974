"""The result, filled piece by piece in place: the sum over Fourier orders, single scattering, the base's reflection."""

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.memory import PIECE_BYTES
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_scattering import add_base_reflected, scatter_by_orders, scatterers
from vrte.discrete_ordinates.orders.small_angle import Anisotropic
from vrte.discrete_ordinates.planning.azimuths import Azimuths, cos_sin_deg
from vrte.request.wanted import Wanted
from vrte.scene.scene import Scene

WORTH_THREADS = 1e5  # bytes of a result: below, starting threads takes longer than the sums


@dataclass(frozen=True, eq=False)
class Light:
    """Multiply scattered light of some Fourier orders, with the same Stokes components and incident columns.

    orders (order,); stokes (S,): which of I, Q, U, V; columns (n_col,): which of the problem's; kernels (order, n_tau,
    n_in, n_col, n_out, S): multiply scattered radiance for a unit beam, public frame, light going up first.
    """

    orders: IntArray
    stokes: IntArray
    columns: IntArray
    kernels: Array


@dataclass(frozen=True, eq=False)
class Part:
    """One array of the result, values (n_level, n_in, n_mu, n_phi, 4, n_place).

    levels (n_level,): indices of depths; rows (n_mu,): places of its directions among the problem's; mu (n_mu,):
    signed cosines; spreads (n_mu,): whether small angles are separated there.
    """

    levels: IntArray
    rows: IntArray
    mu: Array
    spreads: BoolArray
    values: Array


def fill(
    wanted: Wanted,
    lights: Sequence[Light],
    scene: Scene,
    problem: Problem,
    mu: Array,
    azimuths: Azimuths,
    run: Run,
    told: Callable[[int], None],
    spreads: BoolArray,
) -> list[Array]:
    """The radiance of every part of `wanted`, (n_level, n_in, n_mu, n_phi, 4, n_place).

    mu (n_mu,): signed cosines in the order of the result; told(k) is called when k pieces are done; spreads (n_mu,):
    towards which of them light of small angles stands for single scattering.
    """
    parts = make_parts(wanted, mu, spreads, azimuths.phi.size)
    kind = column_kinds(problem.columns)
    if sum(part.values.nbytes for part in parts) < WORTH_THREADS:
        run = replace(run, threads=1)
    if not problem.leave_out.single:
        lights = [*lights, singly_scattered(scene, problem, run)]
    sums = [prepare_sum(light, wanted, kind, azimuths, run) for light in lights]
    single = []
    if problem.leave_out.single:
        single.append(prepare_scattering(parts, wanted, scene, problem, kind, azimuths, run))
        if spreads.any():
            single.append(prepare_spreading(wanted, scene, problem, kind, azimuths, run))
    for k, (first, last) in enumerate(pieces(wanted, azimuths.phi.size), 1):
        for part in parts:
            for add in sums + single:
                add(part, first, last)
            begin = time.perf_counter()
            add_base_reflected(
                scene.below,
                problem,
                part.levels,
                part.mu,
                azimuths.phi,
                wanted.place,
                wanted.scale,
                first,
                last,
                part.values,
            )
            run.book("single scattering", time.perf_counter() - begin)
        told(k)
    return [part.values for part in parts]


Adder = Callable[[Part, int, int], None]


def make_parts(wanted: Wanted, mu: Array, spreads: BoolArray, n_phi: int) -> list[Part]:
    """Empty arrays; the problem has light going up first, in the order of the request otherwise."""
    row = np.empty(mu.size, np.int32)
    row[np.argsort(mu < 0.0, kind="stable")] = np.arange(mu.size, dtype=np.int32)
    n_place = int(wanted.place.max()) + 1
    return [
        Part(
            levels,
            row[directions],
            mu[directions],
            spreads[directions],
            np.zeros((levels.size, wanted.scale.size, directions.size, n_phi, 4, n_place)),
        )
        for levels, directions in wanted.parts
    ]


def column_kinds(columns: Array) -> IntArray:
    """1 for incident Stokes vectors within (U, V), 0 for those within (I, Q), (n_col,)."""
    return np.where(columns[:, 2:].any(axis=1), 1, 0).astype(np.int32)


def number_of_pieces(wanted: Wanted, n_phi: int) -> int:
    """Pieces that the result is filled in, each some of the incident directions."""
    return max(1, min(wanted.scale.size, math.ceil(8.0 * wanted.doubles(n_phi) / PIECE_BYTES)))


def pieces(wanted: Wanted, n_phi: int) -> Iterator[tuple[int, int]]:
    """First and last + 1 incident direction of every piece."""
    count = number_of_pieces(wanted, n_phi)
    edges = [k * wanted.scale.size // count for k in range(count + 1)]
    return itertools.pairwise(edges)


def prepare_sum(light: Light, wanted: Wanted, kind: IntArray, azimuths: Azimuths, run: Run) -> Adder:
    """What adds a light's orders to a piece."""
    cosine, sine = azimuths.cos_sin(light.orders)
    n_angle = azimuths.distinct.size
    work = run.work(_core.azimuthal_work(light.orders.size, light.columns.size, light.stokes.size, n_angle))
    columns = kind[light.columns], wanted.place[light.columns]

    def add(part: Part, first: int, last: int) -> None:
        run.timed(
            "fourier sum",
            run.kernels.azimuthal_sum,
            light.kernels,
            light.stokes,
            *columns,
            cosine,
            sine,
            azimuths.angle,
            azimuths.sign,
            part.levels,
            part.rows,
            wanted.scale,
            first,
            last,
            part.values,
            run.threads,
            work,
        )

    return add


def singly_scattered(scene: Scene, problem: Problem, run: Run) -> Light:
    """Single scattering by Fourier orders, where its closed form shall not be used."""
    begin = time.perf_counter()
    kernels = scatter_by_orders(scene.layers, problem)
    run.book("single scattering", time.perf_counter() - begin)
    orders, columns = (np.arange(kernels.shape[axis], dtype=np.int32) for axis in (0, 3))
    return Light(orders, np.array(ALL, np.int32), columns, kernels)


def prepare_scattering(
    parts: Sequence[Part],
    wanted: Wanted,
    scene: Scene,
    problem: Problem,
    kind: IntArray,
    azimuths: Azimuths,
    run: Run,
) -> Adder:
    """What adds single scattering in all layers to a piece, but where small angles are separated."""
    cosine, sine = cos_sin_deg(azimuths.distinct)
    work = run.work(_core.scattering_work(problem.columns.shape[0], azimuths.distinct.size))
    begin = time.perf_counter()
    tables = {
        id(part): [
            (table, np.where(part.spreads, 0.0, wanted.scale[:, None] * path))
            for table, path in scatterers(scene.layers, problem, part.levels, part.mu)
        ]
        for part in parts
    }
    run.book("single scattering", time.perf_counter() - begin)

    def add(part: Part, first: int, last: int) -> None:
        for table, path in tables[id(part)]:
            run.timed(
                "single scattering",
                run.kernels.add_single_scattering,
                table,
                path,
                problem.mu0,
                part.mu,
                cosine,
                sine,
                azimuths.angle,
                azimuths.sign,
                problem.columns,
                kind,
                wanted.place,
                first,
                last,
                part.values,
                run.threads,
                work,
            )

    return add


def prepare_spreading(
    wanted: Wanted, scene: Scene, problem: Problem, kind: IntArray, azimuths: Azimuths, run: Run
) -> Adder:
    """What adds one scattering of the beam, as it spreads by small angles, (2:4), where that is asked for."""
    cosine, sine = cos_sin_deg(azimuths.distinct)
    work = run.work(_core.scattering_work(problem.columns.shape[0], azimuths.distinct.size))
    anisotropic = Anisotropic(scene, problem)

    def scatter(part: Part, t: int, i: int, o: int, table: Array) -> None:
        run.timed(
            "small angles",
            run.kernels.add_single_scattering,
            _core.series_table(table),
            np.full((1, 1, 1), wanted.scale[i] / (4.0 * np.pi)),
            problem.mu0[i : i + 1],
            part.mu[o : o + 1],
            cosine,
            sine,
            azimuths.angle,
            azimuths.sign,
            problem.columns,
            kind,
            wanted.place,
            0,
            1,
            part.values[t : t + 1, i : i + 1, o : o + 1],
            1,
            work,
        )

    def add(part: Part, first: int, last: int) -> None:
        for i in range(first, last):
            begin = time.perf_counter()
            mu0, towards = float(problem.mu0[i]), np.flatnonzero(part.spreads)
            beams = anisotropic.beams(mu0)
            for t, level in enumerate(part.levels.tolist()):
                for places, tables in anisotropic.sources(mu0, beams, level, part.mu[towards]):
                    run.book("small angles", time.perf_counter() - begin)
                    for o, table in zip(towards[places].tolist(), tables, strict=True):
                        scatter(part, t, i, o, table)
                    begin = time.perf_counter()

    return add
