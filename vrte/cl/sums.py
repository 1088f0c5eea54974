"""The end of a solve on a device: sums over Fourier orders and single scattering, added into a table of radiances."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import Crew
from vrte.cl.lending import lent
from vrte.cl.matrices import padded
from vrte.cl.session import Session

TILE_OF_ORDERS, TILE_OF_SCATTERING = 12, 4  # azimuths that are done at once
PIECES = 64  # of a launch on a processor, so that its cores end together
WIDE = 1 << 16  # pieces that a graphics device wants


@dataclass(frozen=True, eq=False)
class Azimuths:
    """The azimuths (n_phi,) of a table, sorted by the distinct angle (n_angle,) that each is or mirrors.

    first_use (n_angle + 1,): where an angle's azimuths begin in ``azimuth`` (n_phi,), their places in the table, and
    ``mirror`` (n_phi,), -1 for mirror images, otherwise 1.
    """

    first_use: Any
    azimuth: Any
    mirror: Any

    @property
    def place(self) -> tuple[Any, ...]:
        """As kernels take them."""
        sizes = np.int32(self.first_use.size - 1), np.int32(self.azimuth.size)
        return self.first_use, self.azimuth, self.mirror, *sizes


def upload_azimuths(session: Session, angle: Array, sign: Array, n_angle: int) -> Azimuths:
    """angle (n_phi,): which of the ``n_angle`` distinct angles an azimuth is; sign (n_phi,): -1 for a mirror image."""
    azimuth = np.argsort(angle, kind="stable").astype(np.int32)
    first_use = np.searchsorted(angle[azimuth], np.arange(n_angle + 1)).astype(np.int32)
    return Azimuths(session.constant(first_use), session.constant(azimuth), session.constant(np.sign(sign)[azimuth]))


@dataclass(frozen=True, eq=False)
class Table:
    """Radiances on a device, (scene, n_level, n_in, n_mu, n_phi, 4, n_place), from double ``first`` of ``data`` on; a
    scene takes ``stride`` doubles."""

    data: Any
    shape: tuple[int, int, int, int, int, int]
    scenes: int = 1
    first: int = 0
    stride: int = 0

    def place(self, first_in: int, last_in: int, mu_each: int, tiles_each: int) -> tuple[Any, ...]:
        """What kernels want to know of it, for some incident directions."""
        n_level, n_in, n_mu, _, _, n_place = self.shape
        sizes = n_place, n_level, n_in, n_mu, first_in, last_in - first_in, mu_each, tiles_each
        return *(np.int32(size) for size in sizes), self.data, np.int64(self.first), np.int64(self.stride)


@dataclass(frozen=True, eq=False)
class Kernels:
    """Light of Fourier orders on a device: (scene, order, n_tau, n_in, n_col, n_out, S), ``strides`` doubles apart from
    double ``first`` of ``data`` on."""

    data: Any
    strides: tuple[int, int, int, int, int, int, int]
    first: int = 0

    @property
    def place(self) -> tuple[Any, ...]:
        """As kernels take it."""
        return self.data, np.int64(self.first), *(np.int64(stride) for stride in self.strides)


def dense(data: Any, shape: Sequence[int], first: int = 0) -> Kernels:
    """Kernels of one scene (order, n_tau, n_in, n_col, n_out, S), or of some (scene, order, ...)."""
    strides = np.cumprod([1, *shape[:0:-1]])[::-1]
    full = [0] * (7 - len(shape)) + strides.tolist()
    return Kernels(data, tuple(full), first)


@dataclass(frozen=True, eq=False)
class Entries:
    """The elements of a Mueller matrix that kernels hold, in groups of four neighbours in a row (4, n_place) of a
    table, and the waves that their orders are multiplied by: see `add_orders` in sums.cl."""

    where: Any
    sense: Any
    waves: Any
    mirrored: Any


def upload_entries(
    session: Session, stokes: Array, kind: Array, place: Array, n_place: int, cosine: Array, sine: Array
) -> Entries:
    """(1:6)-(1:8): cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V); arguments as
    those of `azimuthal_sum`."""
    groups: dict[tuple[int, int], list[tuple[int, int, int, float]]] = {}
    used = [0] * (4 * n_place)
    for column, (second, at) in enumerate(zip(kind.tolist(), place.tolist(), strict=True)):
        for component, s in enumerate(stokes.tolist()):
            target, with_sine = s * n_place + at, (s >= 2) != (second == 1)
            group = groups.setdefault((target // 4, used[target]), [(0, 0, 0, 0.0)] * 4)
            group[target % 4] = column, component, int(with_sine), -1.0 if with_sine and s < 2 else 1.0
            used[target] += 1
    patterns = sorted({tuple(sines for _, _, sines, _ in group) for group in groups.values()})
    where = [
        (
            *(lane[0] for lane in group),
            *(lane[1] for lane in group),
            patterns.index(tuple(lane[2] for lane in group)),
            at,
        )
        for (at, _), group in groups.items()
    ]
    waves = np.zeros((len(patterns), cosine.shape[0], -(-cosine.shape[1] // TILE_OF_ORDERS) * TILE_OF_ORDERS, 4))
    for lanes, pattern in zip(waves, patterns, strict=True):
        for lane, with_sine in enumerate(pattern):
            lanes[:, : cosine.shape[1], lane] = sine if with_sine else cosine
    return Entries(
        session.constant(np.array(where, np.int32)),
        session.constant(np.array([[lane[3] for lane in group] for group in groups.values()])),
        session.constant(waves),
        session.constant(1.0 - 2.0 * np.array(patterns)),
    )


def tiles_of(azimuths: Azimuths, tile: int) -> int:
    """Tiles of so many distinct angles."""
    return -(-(int(azimuths.first_use.size) - 1) // tile)


def shares(session: Session, n_mu: int, tiles: int, others: int) -> tuple[int, int]:
    """Outgoing directions and tiles of azimuths of one piece of a launch, which has ``others`` times as many: large
    pieces on a processor, where each costs time, one tile on a graphics device, which wants many."""
    if session.on_host:
        return max(1, min(n_mu, n_mu * others // PIECES)), tiles
    return max(1, min(n_mu, n_mu * tiles * others // WIDE)), 1


def add_orders(
    session: Session,
    kernels: Kernels,
    n_order: Any,
    entries: Entries,
    azimuths: Azimuths,
    levels: Any,
    rows: Any,
    scale: Any,
    factors: Any,
    incident: tuple[int, int],
    table: Table,
) -> None:
    """Adds the sum over orders of kernels times cos or sin(m phi) to a table, of all scenes in one launch.

    Device arrays: n_order (scene,): how many of the orders a scene has; levels (n_level,), rows (n_mu,): what of the
    kernels' n_tau and n_out is wanted; scale (n_in,): factor of each incident direction; factors (n_out, S): of each
    outgoing one and Stokes component. ``incident``: the first direction and the one behind the last.
    """
    n_level, _, n_mu, *_ = table.shape
    _, n_order_most, n_angle_padded, _ = entries.waves.shape
    tiles, others = tiles_of(azimuths, TILE_OF_ORDERS), table.scenes * n_level * (incident[1] - incident[0])
    mu_each, tiles_each = shares(session, n_mu, tiles, others)
    session.launch(
        "add_orders",
        (-(-n_mu // mu_each), -(-tiles // tiles_each), others),
        *kernels.place,
        n_order,
        *(np.int32(entries.where.shape[0]), entries.where, entries.sense, entries.waves),
        *(np.int32(size) for size in (n_order_most, 4 * n_angle_padded)),
        entries.mirrored,
        *(levels, rows, scale, factors),
        np.int32(factors.shape[1]),
        *azimuths.place,
        *table.place(*incident, mu_each, tiles_each),
    )


@dataclass(frozen=True, eq=False)
class Scatterers:
    """What scatters once, on a device: phase matrices of all scenes, one scene's behind the other's.

    first (scene + 1,): where a scene's begin; tables (table, most terms, SERIES): of `series_table`, zeros behind their
    terms (table,); path (table, n_level, n_in, n_mu): what multiplies them, nothing is done where it is zero.
    """

    first: Any
    tables: Any
    terms: Any
    path: Any


def upload_scatterers(session: Session, scenes: Sequence[Sequence[tuple[Array, Array]]]) -> Scatterers:
    """Of every scene its tables of `series_table` and their paths (n_level, n_in, n_mu)."""
    found = [pair for scene in scenes for pair in scene]
    tables = np.zeros((len(found), max(table.shape[0] for table, _ in found), _core.SERIES))
    for room, (table, _) in zip(tables, found, strict=True):
        room[: table.shape[0]] = table
    return Scatterers(
        session.constant(np.cumsum([0, *(len(scene) for scene in scenes)]).astype(np.int32)),
        session.upload(tables),
        session.constant(np.array([table.shape[0] for table, _ in found], np.int32)),
        session.upload(np.array([path for _, path in found])),
    )


@dataclass(frozen=True, eq=False)
class Directions:
    """Device arrays: mu0 (n_in,) > 0, light going down; mu (n_mu,), signed public cosines; cosine, sine of the distinct
    angles, padded to a multiple of 8; columns (n_col, 4), their kind and place (n_col,)."""

    mu0: Any
    mu: Any
    cosine: Any
    sine: Any
    columns: Any
    kind: Any
    place: Any


def upload_directions(
    session: Session, mu0: Array, mu: Array, cosine: Array, sine: Array, columns: Array, kind: Array, place: Array
) -> Directions:
    """Arguments as those of `add_single_scattering`."""
    waves = np.zeros((2, padded(cosine.size)))
    waves[:, : cosine.size] = cosine, sine
    return Directions(*(session.constant(values) for values in (mu0, mu, *waves, columns, kind, place)))


def add_scattering(
    session: Session,
    scatterers: Scatterers,
    directions: Directions,
    azimuths: Azimuths,
    incident: tuple[int, int],
    table: Table,
) -> None:
    """Adds path times the phase matrix times columns, all scatterers of all scenes in one launch."""
    n_mu = table.shape[2]
    tiles, others = tiles_of(azimuths, TILE_OF_SCATTERING), table.scenes * (incident[1] - incident[0])
    mu_each, tiles_each = shares(session, n_mu, tiles, others)
    _, most_terms, numbers = scatterers.tables.shape
    session.launch(
        "add_scattering",
        (-(-n_mu // mu_each), -(-tiles // tiles_each), others),
        *(scatterers.first, scatterers.tables, np.int64(most_terms * numbers), scatterers.terms, scatterers.path),
        *(directions.mu0, directions.mu, directions.cosine, directions.sine),
        np.int32(directions.kind.size),
        *(directions.columns, directions.kind, directions.place),
        *azimuths.place,
        *table.place(*incident, mu_each, tiles_each),
    )


def azimuthal_sum(
    session: Session,
    crew: Crew,
    *,
    kernels: Array,
    stokes: Array,
    kind: Array,
    place: Array,
    cosine: Array,
    sine: Array,
    angle: Array,
    sign: Array,
    levels: Array,
    rows: Array,
    scale: Array,
    first: int,
    last: int,
    out: Array,
) -> None:
    """`vrte._core.azimuthal_sum` on a device: adds to out (n_level, n_in, n_mu, n_phi, 4, n_place) what Fourier orders
    hold."""
    start = time.perf_counter()
    if kernels.size and out.size and last > first:
        here = np.ascontiguousarray(kernels)
        weights = np.ones((kernels.shape[4], kernels.shape[5]))
        with lent(session, here, False) as light, lent(session, out) as result:
            add_orders(
                session,
                dense(light, kernels.shape),
                session.constant(np.array([kernels.shape[0]], np.int32)),
                upload_entries(session, stokes, kind, place, out.shape[5], cosine, sine),
                upload_azimuths(session, angle, sign, cosine.shape[1]),
                session.constant(levels),
                session.constant(rows),
                session.constant(scale),
                session.constant(weights),
                (first, last),
                Table(result, out.shape),
            )
    crew.seconds[0] += time.perf_counter() - start


def add_single_scattering(
    session: Session,
    crew: Crew,
    *,
    table: Array,
    path: Array,
    mu0: Array,
    mu: Array,
    cos_phi: Array,
    sin_phi: Array,
    angle: Array,
    sign: Array,
    columns: Array,
    kind: Array,
    place: Array,
    first: int,
    last: int,
    out: Array,
    wide: bool = True,
) -> None:
    """`vrte._core.add_single_scattering` on a device: adds path times the phase matrix times columns to out (n_level,
    n_in, n_mu, n_phi, 4, n_place). ``wide`` is not used. Raises ValueError for too many
    columns or a table that is not of `series_table`."""
    if columns.shape[0] > _core.MOST_COLUMNS:
        raise ValueError(f"at most {_core.MOST_COLUMNS} columns")
    if table.shape[0] % 2 or table.shape[1] != _core.SERIES:
        raise ValueError("the table must be one of series_table")
    start = time.perf_counter()
    if out.size and last > first:
        with lent(session, out) as result:
            add_scattering(
                session,
                upload_scatterers(session, [[(table, path)]]),
                upload_directions(session, mu0, mu, cos_phi, sin_phi, columns, kind, place),
                upload_azimuths(session, angle, sign, cos_phi.size),
                (first, last),
                Table(result, out.shape),
            )
    crew.seconds[0] += time.perf_counter() - start
