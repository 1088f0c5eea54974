"""The end of a solve on a device: sums over Fourier orders and single scattering, added to a table of radiances."""

from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.matrices import pad_to_strips
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

TILE_OF_ORDERS, TILE_OF_SCATTERING = 12, 4  # azimuths that are done at once
PIECES = 64  # pieces of a launch, so that a processor's cores finish together


def list_entries(given: Any) -> tuple[Array, Array, Array, Array]:
    """The elements of a Mueller matrix that kernels hold, in groups of four neighbours in a row (4, n_place) of a
    table, and the waves that their orders are multiplied by: see `add_orders` in sums.cl.

    (1:6)-(1:8): cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V)."""
    groups: dict[tuple[int, int], list[tuple[int, int, int, float]]] = {}
    n_place, (n_order, n_angle) = given.out.shape[5], given.cosine.shape
    used = [0] * (4 * n_place)
    for column, (second, at) in enumerate(zip(given.kind.tolist(), given.place.tolist(), strict=True)):
        for component, s in enumerate(given.members.tolist()):
            target, with_sine = s * n_place + at, (s >= 2) != (second == 1)
            group = groups.setdefault((target // 4, used[target]), [(0, 0, 0, 0.0)] * 4)
            group[target % 4] = column, component, int(with_sine), -1.0 if with_sine and s < 2 else 1.0
            used[target] += 1
    patterns = sorted({tuple(sines for _, _, sines, _ in group) for group in groups.values()})
    where = []
    for (at, _), group in groups.items():
        columns, components, sines, _ = zip(*group, strict=True)
        where.append((*columns, *components, patterns.index(sines), at))
    waves = np.zeros((len(patterns), n_order, -(-n_angle // TILE_OF_ORDERS) * TILE_OF_ORDERS, 4))
    for lanes, pattern in zip(waves, patterns, strict=True):
        for lane, with_sine in enumerate(pattern):
            lanes[:, :n_angle, lane] = given.sine if with_sine else given.cosine
    sense = np.array([[lane[3] for lane in group] for group in groups.values()])
    return np.array(where, np.int32), sense, waves, 1.0 - 2.0 * np.array(patterns)


def add_to_table(session: Session, name: str, tile: int, n_angle: int, stacks: int, given: Any, **own: Any) -> None:
    """Adds what a kernel finds to incident directions first .. last - 1 of out (stack n_level, n_in, n_mu, n_phi, 4,
    n_place). A piece is some directions of a stack and all their tiles of so many distinct angles: as many as lanes,
    and so few pieces that none is too small for a processor."""
    table = given.out[:, given.first : given.last]
    _n_level, n_in, n_mu, _n_phi, _, _n_place = table.shape
    azimuth = np.argsort(given.angle, kind="stable").astype(np.int32)
    first_use = np.searchsorted(given.angle[azimuth], np.arange(n_angle + 1)).astype(np.int32)
    own |= {"first_use": first_use, "azimuth": azimuth, "mirror": np.sign(given.sign)[azimuth], "n_angle": n_angle}
    across = n_in * stacks
    each = max(1, min(n_mu, max(n_mu * across // PIECES, session.lanes // -(-n_angle // tile))))
    made = session.zeros(table.shape)
    session.launch(name, (-(-n_mu // each), across), vars(given), **own, each=each, out=made)
    table += session.download(made)


@stand_in_for(_core.azimuthal_sum)
def azimuthal_sum(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Adds to out (n_level, n_in, n_mu, n_phi, 4, n_place) what Fourier orders hold."""
    lit = slice(given.first, given.last)
    kernels = np.ascontiguousarray(given.kernels[:, :, lit])
    if not kernels.size or not given.out.size:
        return
    entries = dict(zip(("entry", "sense", "waves", "mirrored"), list_entries(given), strict=True))
    own = entries | {"kernels": session.upload(kernels), "scale": given.scale[lit]}
    add_to_table(session, "add_orders", TILE_OF_ORDERS, given.cosine.shape[1], len(given.levels), given, **own)


@stand_in_for(_core.add_single_scattering)
def add_single_scattering(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Adds path times the phase matrix times columns to out (stack n_level, n_in, n_mu, n_phi, 4, n_place). ``wide`` is
    not used. Raises ValueError for too many columns or a table that is not of `series_table`."""
    if given.columns.shape[0] > _core.MOST_COLUMNS:
        raise ValueError(f"at most {_core.MOST_COLUMNS} columns")
    if given.table.shape[0] % 2 or given.table.shape[1] != _core.SERIES:
        raise ValueError("the table must be one of series_table")
    lit = slice(given.first, given.last)
    if not given.out[:, lit].size:
        return
    n_angle, stacks = given.cos_phi.size, getattr(given, "slab_stacks", 1)
    waves = np.zeros((2, pad_to_strips(n_angle)))
    waves[:, :n_angle] = given.cos_phi, given.sin_phi
    own = {"path": session.upload(given.path[:, lit]), "mu0": given.mu0[lit], "cosine": waves[0], "sine": waves[1]}
    own |= {"n_term": given.table.shape[0] // stacks, "n_level": given.path.shape[0] // stacks}
    add_to_table(session, "add_scattering", TILE_OF_SCATTERING, n_angle, stacks, given, **own)
