"""The top of a semi-infinite layer, by invariance, on a device: `_core.reflect_semi_infinite` for all items at once.

A work-group takes all steps of an item, so that what comes out of one does not depend on which others there are."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import IntArray
from vrte.basics.running import ThreadTeam
from vrte.cl.assembly import (
    Columns,
    Scattering,
    compute_parity_columns,
    multiply_by_coefficients,
    multiply_over_columns,
)
from vrte.cl.matrices import STRIP, Stack, make_stack, pad_to_strips
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

V = 3


@dataclass(frozen=True, eq=False)
class SemiInfinite:
    """On the device: up (item, n_in, n_col, S n_out), on_nodes (item, n_in n_col, n), residual and steps, (item,), as
    of `_core.reflect_semi_infinite`."""

    up: Any
    on_nodes: Any
    residual: Any
    steps: Any


@dataclass(frozen=True, eq=False)
class FactorColumns:
    """Some rows: phi and H of E's and F's columns, Hf with the other sign; signed_mu: the cosine of each row, minus
    where it is V's."""

    phi: Stack
    H: Stack
    signed_mu: Any


def reflect_semi_infinite(
    session: Session,
    items: Any,
    order: Any,
    material: Any,
    members: Sequence[int],
    coefficients: Any,
    terms: Any,
    albedo: Any,
    directions: Any,
    weights: Any,
    out: Any,
    into: Any,
    columns: Any,
    tolerance: Any,
    stop: IntArray | None = None,
) -> SemiInfinite:
    """The light that semi-infinite layers send back, for the listed items, single scattering left out.

    directions: nodes, then off the nodes; out, into: places among the latter; columns (n_col, S); tolerance (item,).
    Once ``stop[0]`` is set nothing that comes out counts."""
    what = Scattering(items, order, material, tuple(members), coefficients, terms, albedo)
    n_node, n_off = weights.size, directions.size - weights.size
    phi = compute_parity_columns(session, what, directions, weights, n_off)
    nodes = make_factor_columns(session, what, phi, 0, directions, 0, n_node)
    off = make_factor_columns(session, what, phi, 1, directions, n_node, n_off)
    rate, residual = session.empty((what.room,)), session.zeros((what.room,))
    steps = session.zeros((what.room,), np.int32)
    session.launch("invariance_rate", (items.size,), what, rate, items)
    n = nodes.phi.rows
    shape = what.room, n, max(nodes.H.ld, off.H.ld)
    # the first two steps read by how much steps moved that there were not, and do nothing with it
    room = [session.empty(shape) for _ in range(4)] + [session.zeros(shape) for _ in range(2)]
    for rows in (nodes, off):
        R, HC = session.empty((what.room, n, rows.H.ld)), stack_like(session, what, rows.H)
        if stop is None or not stop[0]:
            sizes = session.device.max_compute_units, _core.MOST_STEPS, rows.H.ld // STRIP, rows is nodes, n
            arrays = phi.counts, rows.signed_mu, nodes.signed_mu, rows.phi, nodes.H, R, *room, rows.H, HC.columns
            judged = rate, tolerance, residual, steps
            session.launch("invariance_converge", (items.size,), what, *sizes, *arrays, HC.data, *judged, items)
    u, n_in, n_col = off.phi.rows, into.size, columns.shape[0]
    Ruu, psi = (make_stack(session, what.room, u, size, bare=True) for size in (u, off.phi.columns))
    for columns_of, alpha, beta in [(off.H, 1.0, 0.0), (off.phi, -1.0, 1.0)]:
        multiply_by_coefficients(session, what, phi.counts, columns_of, psi, v_sign=-1.0, odd_sign=-1.0)
        multiply_over_columns(session, items, phi.counts, 2, psi, columns_of, Ruu, alpha, beta)
    up = session.empty((what.room, n_in, n_col, what.stokes * out.size))
    on_nodes = session.empty((what.room, n_in * n_col, n))
    sizes = n, what.stokes, place_of_v(what), out.size, n_col
    arrays = off.signed_mu, out, into, columns, Ruu, R, n * off.H.ld, up, on_nodes
    session.launch("invariance_results", (n_in, items.size), *sizes, *arrays, items)
    return SemiInfinite(up, on_nodes, residual, steps)


def place_of_v(what: Scattering) -> int:
    """Of V among the members, -1 where it is none."""
    return what.members.index(V) if V in what.members else -1


def stack_like(session: Session, what: Scattering, stack: Stack) -> Stack:
    """Another stack of that shape, yet to be written."""
    return make_stack(session, what.room, stack.rows, stack.columns, bare=True)


def make_factor_columns(
    session: Session, what: Scattering, columns: Columns, part: int, directions: Any, first: int, n_mu: int
) -> FactorColumns:
    """Of some directions, the part of phi's rows that is theirs."""
    phi = columns.rows(part, what.stokes * n_mu)
    signed_mu = session.empty((pad_to_strips(phi.rows),))
    session.launch("cosines_of_rows", (1,), n_mu, what.stokes, place_of_v(what), directions, first, signed_mu)
    return FactorColumns(phi, stack_like(session, what, phi), signed_mu)


@stand_in_for(_core.reflect_semi_infinite)
def reflect_semi_infinite_arrays(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills up, on_nodes, residual and steps; halves plays no part: R on the nodes is made up to its diagonal."""
    count, upload = given.orders.size, session.constant
    if not count or crew.stop[0]:
        return
    pairs = upload(np.arange(count, dtype=np.int32)), upload(given.orders), upload(np.zeros(count, np.int32))
    scene = {
        "tolerance": np.full(count, given.tolerance),
        "out": given.out_places,
        "into": given.in_places,
    }
    names = "coefficients", "terms", "albedo", "directions", "weights", "columns"
    asked = {name: getattr(given, name) for name in names}
    uploaded: dict[str, Any] = {name: upload(values) for name, values in (scene | asked).items()}
    found = reflect_semi_infinite(session, *pairs, given.members.tolist(), **uploaded, stop=crew.stop)
    for name in ("up", "on_nodes", "residual", "steps"):
        getattr(given, name)[...] = session.download(getattr(found, name))
