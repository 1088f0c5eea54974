"""Slabs joined by the star product, (2:8), and the field between them: core/joining.pxi for many orders at once."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import ThreadTeam
from vrte.cl.doubling import Frame, compute_householder_vector, put_blocks
from vrte.cl.matrices import make_scratch, make_stack, pad_to_strips, upload_stack
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for


@dataclass(frozen=True, eq=False)
class Ground:
    """The base, item by item: matrix (item, n, n), source (item, r, n) and out (item, n, o), all (column, row), as the
    handling of order 0 has turned them; absorbed (item, n): the flux's row of 1 - matrix."""

    matrix: Array
    source: Array
    out: Array
    absorbed: Array


@dataclass(frozen=True, eq=False)
class SlabStacks:
    """slab (item, place): which of the slabs lies there, top first; above (item, place + 1): optical depth of each
    interface; turned (item,): whether it is order 0 and carries the flux; interface (level,); ground: None: black."""

    slab: IntArray
    above: Array
    turned: NDArray[np.bool_]
    interface: IntArray
    ground: Ground | None


@dataclass(frozen=True, eq=False)
class Joined:
    """On the device: up, down (item, level, r, o), flux (item, level, 2, r), info (item,) and residual (item,
    place)."""

    up: Any
    down: Any
    flux: Any
    info: Any
    residual: Any


def turn_ground(
    frame: Frame, turned: NDArray[np.bool_], row: IntArray, matrix: Array, source: Array, out: Array
) -> Ground:
    """The base of each item: row (item,) of the arrays, -1 for none; order 0 turned like its slabs."""
    s, (v, _) = frame.sizes, compute_householder_vector(frame)
    seen = row >= 0
    below, up, leaving = (np.where(seen.reshape(-1, 1, 1), a[np.maximum(row, 0)], 0.0) for a in (matrix, source, out))
    absorbed = np.zeros((row.size, s.n))
    absorbed[:, s.axis] = 1.0
    for item in np.flatnonzero(turned & seen):
        below[item] -= np.outer(v, v @ below[item])
        below[item] -= np.outer(below[item] @ v, v)
        up[item] -= np.outer(up[item] @ v, v)
        leaving[item] -= np.outer(v, v @ leaving[item])
        absorbed[item] -= below[item][:, s.axis]
        absorbed[item][np.abs(absorbed[item]) < _core.ROUNDING] = 0.0
    return Ground(below, up, leaving, absorbed)


def join(session: Session, frame: Frame, of: SlabStacks, R: Any, T: Any, lost: Any) -> Joined:
    """The field of all stacks, which have as many places each, at the wanted interfaces. Enqueues only."""
    s, (count, places), levels, new = frame.sizes, of.slab.shape, of.interface.size, session.zeros
    each = s.p * (s.n * (places + 4) + s.r * (3 * places + 4) + 2) + 2 * pad_to_strips(s.o) * s.r
    known = make_scratch(session, count, s.n) | {"room": new((count, each)), "R": R, "T": T, "lost": lost}
    known |= {"n": s.n, "n_rhs": s.r, "stokes": s.stokes, "flux_size": frame.flux_size, "dark": of.ground is None}
    known |= {"rates": frame.rates[s.n + s.o :], "slab": of.slab, "above": of.above, "interface": of.interface}
    if of.ground is None:
        black = make_stack(session, count, s.n, s.n)
        known |= {"below": black, "emitted": black.part(0, 0, s.n, s.r), "base_out": black.part(0, 0, s.o, s.n)}
        known["absorbed"] = new((count, s.n))
    else:
        arrays = {"below": of.ground.matrix, "emitted": of.ground.source, "base_out": of.ground.out}
        known |= {name: upload_stack(session, array) for name, array in arrays.items()}
        known["absorbed"] = session.upload(of.ground.absorbed)
    field = count, levels, s.r, s.o
    found = Joined(new(field), new(field), new((count, levels, 2, s.r)), new((count,), np.int32), new((count, places)))
    session.launch("join_slabs", (count,), known | vars(found), turned=of.turned.astype(np.int32), n_out_rows=s.o)
    return found


@stand_in_for(_core.join_slabs)
def join_slabs(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills up, down, flux, residual and info."""
    orders, up, n_out, row = given.orders, given.up, given.n_out, given.base_row
    if crew.stop[0]:
        return
    n_col, stokes = up.shape[2] // given.mu0.size, up.shape[3] // n_out
    frame = Frame(given.nodes, given.weights, given.mu0, np.zeros((n_col, stokes)), np.ones(n_out))
    turned = (orders == 0) & given.conserving
    base = given.base, given.base_source, given.base_out
    dark = not (row >= 0).any() or not any(a.any() for a in base)
    ground = None if dark else turn_ground(frame, turned, row, *base)
    slab = (np.arange(orders.size)[:, None] * given.R.shape[1] + given.slabs).astype(np.int32)
    depths = np.broadcast_to(given.above, (orders.size, given.above.size))
    R, T = (session.upload(put_blocks(frame.sizes, a.reshape(-1, a.shape[2]))) for a in (given.R, given.T))
    lost = session.upload(given.lost.reshape(-1, given.lost.shape[2]))
    found = join(session, frame, SlabStacks(slab, depths, turned, given.interface, ground), R, T, lost)
    for name, array in zip(vars(found), session.download_all(list(vars(found).values())), strict=True):
        getattr(given, name)[:] = array
