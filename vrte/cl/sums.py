"""The end of a solve on a device: sums over Fourier orders and single scattering, added into a table of radiances."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.matrices import pad_to_strips
from vrte.cl.session import Placed, Session
from vrte.cl.stages import stand_in_for

TILE_OF_ORDERS, TILE_OF_SCATTERING = 12, 4  # azimuths that are done at once
PIECES = 64  # pieces of a launch, so that a processor's cores finish together


@dataclass(frozen=True, eq=False)
class Azimuths(Placed):
    """The azimuths (n_phi,) of a table, sorted by the distinct angle (n_angle,) that each is or mirrors.

    first_use (n_angle + 1,): where an angle's azimuths begin in ``azimuth`` (n_phi,), their places in the table, and
    ``mirror`` (n_phi,), -1 for mirror images, otherwise 1.
    """

    first_use: Any
    azimuth: Any
    mirror: Any

    @property
    def place(self) -> tuple[Any, ...]:
        """And how many distinct angles and azimuths there are."""
        return self.first_use, self.azimuth, self.mirror, self.first_use.size - 1, self.azimuth.size


def upload_azimuths(session: Session, angle: Array, sign: Array, n_angle: int) -> Azimuths:
    """angle (n_phi,): which of the ``n_angle`` distinct angles an azimuth is; sign (n_phi,): -1 for a mirror image."""
    azimuth = np.argsort(angle, kind="stable").astype(np.int32)
    first_use = np.searchsorted(angle[azimuth], np.arange(n_angle + 1)).astype(np.int32)
    return Azimuths(session.constant(first_use), session.constant(azimuth), session.constant(np.sign(sign)[azimuth]))


@dataclass(frozen=True, eq=False)
class Table:
    """Radiances ``data`` of some ``scenes`` on a device, each of the ``shape`` (n_level, n_in, n_mu, n_phi, 4,
    n_place)."""

    data: Any
    shape: tuple[int, ...]
    scenes: int = 1


@dataclass(frozen=True, eq=False)
class Kernels(Placed):
    """Light of Fourier orders on a device: (item, n_tau, n_in, n_col, n_out, S), ``strides`` doubles apart from double
    ``first`` of ``data`` on; an item is an order of a scene."""

    data: Any
    strides: tuple[int, ...]
    first: int = 0

    @property
    def place(self) -> tuple[Any, ...]:
        """The arguments that it stands for: memory, first place, strides."""
        return self.data, self.first, *self.strides


def make_dense_kernels(data: Any, shape: Sequence[int], first: int = 0) -> Kernels:
    """Kernels (item, n_tau, n_in, n_col, n_out, S) without gaps."""
    strides = np.cumprod([1, *shape[:0:-1]])[::-1]
    return Kernels(data, tuple(strides.tolist()), first)


@dataclass(frozen=True, eq=False)
class Entries:
    """The elements of a Mueller matrix that kernels hold, in groups of four neighbours in a row (4, n_place) of a
    table, and the waves that their orders are multiplied by: see `add_orders` in sums.cl."""

    where: Any
    sense: Any
    waves: Any
    mirrored: Any


def upload_entries(
    session: Session, stokes: Array, kind: Array, index: Array, n_place: int, cosine: Array, sine: Array
) -> Entries:
    """(1:6)-(1:8): cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V); arguments as
    those of `azimuthal_sum`."""
    groups: dict[tuple[int, int], list[tuple[int, int, int, float]]] = {}
    used = [0] * (4 * n_place)
    for column, (second, at) in enumerate(zip(kind.tolist(), index.tolist(), strict=True)):
        for component, s in enumerate(stokes.tolist()):
            target, with_sine = s * n_place + at, (s >= 2) != (second == 1)
            group = groups.setdefault((target // 4, used[target]), [(0, 0, 0, 0.0)] * 4)
            group[target % 4] = column, component, int(with_sine), -1.0 if with_sine and s < 2 else 1.0
            used[target] += 1
    patterns = sorted({tuple(sines for _, _, sines, _ in group) for group in groups.values()})
    where = []
    for (at, _), group in groups.items():
        columns, components, sines, _ = zip(*group, strict=True)
        where.append((*columns, *components, patterns.index(sines), at))
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


def launch_into(
    session: Session,
    name: str,
    tile: int,
    across: tuple[int, int],
    azimuths: Azimuths,
    incident: tuple[int, int],
    table: Table,
    *arguments: Any,
) -> None:
    """A kernel over outgoing directions, tiles of so many distinct angles, and what lies ``across``, levels and
    incident directions, then scenes; what it adds to comes behind its arguments. A piece is some directions and all
    their tiles: as many as lanes, and so few pieces that none is too small for a processor."""
    n_level, n_in, n_mu, _, _, n_place = table.shape
    sizes = n_place, n_level, n_in, n_mu, incident[0], incident[1] - incident[0]
    into = *sizes, table.data, math.prod(table.shape)
    tiles = -(-(int(azimuths.first_use.size) - 1) // tile)
    each = max(1, min(n_mu, max(n_mu * across[0] * across[1] // PIECES, session.lanes // tiles)))
    session.launch(name, (-(-n_mu // each), *across), *arguments, each, azimuths, *into)


def add_orders(
    session: Session,
    kernels: Kernels,
    shares: Any,
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

    Device arrays: shares (share, 4) of int32: which scene's table, the first of the kernels' items, how many of them,
    which row of the waves is the first one's; levels (n_level,), rows (n_mu,): what of the kernels' n_tau and n_out is
    wanted; scale (n_in,): factor of each incident direction; factors (n_out, S): of each outgoing one and Stokes
    component. ``incident``: the first direction and the one behind the last. No scene may have two shares.
    """
    _, n_order_most, n_angle_padded, _ = entries.waves.shape
    groups = entries.where.shape[0], entries.where, entries.sense, entries.waves, n_order_most, 4 * n_angle_padded
    arguments = kernels, shares, *groups, entries.mirrored, levels, rows, scale, factors, factors.shape[1]
    across = table.shape[0] * (incident[1] - incident[0]), shares.shape[0]
    launch_into(session, "add_orders", TILE_OF_ORDERS, across, azimuths, incident, table, *arguments)


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
    session: Session, mu0: Array, mu: Array, cosine: Array, sine: Array, columns: Array, kind: Array, index: Array
) -> Directions:
    """Arguments as those of `add_single_scattering`."""
    waves = np.zeros((2, pad_to_strips(cosine.size)))
    waves[:, : cosine.size] = cosine, sine
    return Directions(*(session.constant(values) for values in (mu0, mu, *waves, columns, kind, index)))


def add_scattering(
    session: Session,
    scatterers: Scatterers,
    directions: Directions,
    azimuths: Azimuths,
    incident: tuple[int, int],
    table: Table,
) -> None:
    """Adds path times the phase matrix times columns, all scatterers of all scenes in one launch."""
    _, most_terms, numbers = scatterers.tables.shape
    tables = scatterers.first, scatterers.tables, most_terms * numbers, scatterers.terms, scatterers.path
    beams = directions.mu0, directions.mu, directions.cosine, directions.sine, directions.kind.size
    arguments = *tables, *beams, directions.columns, directions.kind, directions.place
    across = incident[1] - incident[0], table.scenes
    launch_into(session, "add_scattering", TILE_OF_SCATTERING, across, azimuths, incident, table, *arguments)


@stand_in_for(_core.azimuthal_sum)
def azimuthal_sum(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Adds to out (n_level, n_in, n_mu, n_phi, 4, n_place) what Fourier orders hold."""
    upload, out = session.constant, given.out
    if not given.kernels.size or not out.size or given.last <= given.first:
        return
    kernels, n_angle = np.ascontiguousarray(given.kernels), given.cosine.shape[1]
    kinds = given.members, given.kind, given.place
    with session.lent(kernels, False) as light, session.lent(out) as result:
        add_orders(
            session,
            make_dense_kernels(light, kernels.shape),
            upload(np.array([[0, 0, kernels.shape[0], 0]], np.int32)),
            upload_entries(session, *kinds, out.shape[5], given.cosine, given.sine),
            upload_azimuths(session, given.angle, given.sign, n_angle),
            upload(given.levels),
            upload(given.rows),
            upload(given.scale),
            upload(np.ones(kernels.shape[4:])),
            (given.first, given.last),
            Table(result, out.shape),
        )


@stand_in_for(_core.add_single_scattering)
def add_single_scattering(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Adds path times the phase matrix times columns to out (n_level, n_in, n_mu, n_phi, 4, n_place). ``wide`` is not
    used. Raises ValueError for too many columns or a table that is not of `series_table`."""
    if given.columns.shape[0] > _core.MOST_COLUMNS:
        raise ValueError(f"at most {_core.MOST_COLUMNS} columns")
    if given.table.shape[0] % 2 or given.table.shape[1] != _core.SERIES:
        raise ValueError("the table must be one of series_table")
    if not given.out.size or given.last <= given.first:
        return
    angles = given.mu0, given.mu, given.cos_phi, given.sin_phi
    with session.lent(given.out) as result:
        add_scattering(
            session,
            upload_scatterers(session, [[(given.table, given.path)]]),
            upload_directions(session, *angles, given.columns, given.kind, given.place),
            upload_azimuths(session, given.angle, given.sign, given.cos_phi.size),
            (given.first, given.last),
            Table(result, given.out.shape),
        )
