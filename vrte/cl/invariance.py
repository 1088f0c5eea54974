"""The top of a layer without end, by invariance, on a device: `_core.reflect_endless` for all items at once.

Every item takes its own steps and leaves the list when it has settled, so that what comes out of one does not depend on
which others there are."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.arrays import Array
from vrte.cl.assembly import Columns, Scattering, bare_stack, parity_columns, product_over_columns, times_coefficients
from vrte.cl.matrices import STRIP, Stack, padded
from vrte.cl.session import Session
from vrte.discrete_ordinates.problem import IntArray

MOST_STEPS = 400
STEPS_A_LOOK = 4  # fixed points between two looks at what has settled: 2 to 6 take the same time, 1 takes a tenth more
V = 3


@dataclass(frozen=True, eq=False)
class Endless:
    """On the device: up (item, n_in, n_col, S n_out), on_nodes (item, n_in n_col, n), residual and steps (item,), as of
    `_core.reflect_endless`."""

    up: Any
    on_nodes: Any
    residual: Any
    steps: Any


@dataclass(frozen=True, eq=False)
class Sheet:
    """Some rows: phi and H, E's and F's columns, Hf with the other sign; HC and room for R and the last steps, strip by
    strip; signed_mu: the cosine of each row, minus where it is V's."""

    phi: Stack
    H: Stack
    HC: Any
    signed_mu: Any


@dataclass(frozen=True, eq=False)
class Judged:
    """What decides when an item has settled, (item,) each but settling (item, 7)."""

    rate: Any
    tolerance: Any
    settling: Any
    residual: Any
    steps: Any


def reflect_endless(
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
) -> Endless:
    """The light that layers without end send back, for the listed items, single scattering left out.

    directions: nodes, then off the nodes; out, into: places among the latter; columns (n_col, S); tolerance (item,).
    Waits for the steps, not for the results; ends early once ``stop[0]`` is set."""
    what = Scattering(items, order, material, tuple(members), coefficients, terms, albedo)
    n_off = directions.size - weights.size
    phi = parity_columns(session, what, directions, weights, n_off)
    nodes = sheet_of(session, what, phi, 0, directions, 0, weights.size)
    off = sheet_of(session, what, phi, 1, directions, weights.size, n_off)
    judged = Judged(
        rate=session.empty((what.room,)),
        tolerance=tolerance,
        settling=session.empty((what.room, 7)),
        residual=session.zeros((what.room,)),
        steps=session.zeros((what.room,), np.int32),
    )
    session.launch(
        "invariance_rate",
        (items.size,),
        *(np.int32(what.n_term), coefficients, order, material, terms, albedo, judged.rate, items),
    )
    n = nodes.phi.rows
    room = [session.empty((what.room, n, max(nodes.H.ld, off.H.ld))) for _ in range(6)]
    settle(session, what, phi.counts, nodes, nodes, judged, room, stop)
    Ru = settle(session, what, phi.counts, off, nodes, judged, room, stop)
    return results(session, what, phi.counts, off, Ru, n, out, into, columns, judged)


def sheet_of(
    session: Session, what: Scattering, columns: Columns, part: int, directions: Any, first: int, n_mu: int
) -> Sheet:
    """Of some directions, the part of phi's rows that is theirs."""
    rows, place = what.stokes * n_mu, what.members.index(V) if V in what.members else -1
    signed_mu = session.empty((padded(rows),))
    sizes = np.int32(n_mu), np.int32(what.stokes), np.int32(place)
    session.launch("cosines_of_rows", (1,), *sizes, directions, np.int32(first), signed_mu)
    H = bare_stack(session, what.room, rows, columns.phi.columns)
    return Sheet(columns.rows(part, rows), H, session.empty(H.data.shape), signed_mu)


def settle(
    session: Session,
    what: Scattering,
    counts: Any,
    rows: Sheet,
    nodes: Sheet,
    judged: Judged,
    room: list[Any],
    stop: IntArray | None,
) -> Any:
    """R of some rows, the nodes' or others, strip by strip, after as many fixed points as each item needs; their H with
    it."""
    state = session.zeros((what.room,), np.int32)
    n, strips, items = nodes.phi.rows, rows.H.ld // STRIP, what.items
    R = session.empty((what.room, n, rows.H.ld))
    H = rows.H.data, np.int32(rows.H.ld), np.int64(rows.H.stride), np.int32(rows.H.columns)
    nodes_H = nodes.H.data, np.int32(nodes.H.ld), np.int64(nodes.H.stride), np.int32(nodes.H.columns)
    led, moved = room[:3], room[3:]
    found = session.empty((what.room, strips, 5))

    def renew(starting: bool) -> None:
        """R, H and HC."""
        session.launch(
            "invariance_renew",
            (strips, items.size),
            *(np.int32(starting), np.int32(n), np.int32(what.n_term), what.bits, what.coefficients),
            *(what.order, what.material, what.terms, what.albedo, counts),
            *(nodes.phi.data, np.int32(nodes.phi.ld), np.int64(nodes.phi.stride), np.int32(rows.phi.first)),
            *(*led, R, *H, rows.HC),
            *(judged.settling, state, items),
        )

    renew(starting=True)
    for step in range(MOST_STEPS):
        session.launch(
            "invariance_step",
            (strips, items.size),
            *(np.int32(n), counts, rows.signed_mu, nodes.signed_mu, rows.HC, *nodes_H, R),
            *(led[0], *moved, found, state, items),
        )
        session.launch(
            "invariance_judge",
            (items.size,),
            *(np.int32(step), np.int32(MOST_STEPS), np.int32(strips), found, judged.rate, judged.tolerance),
            *(judged.settling, judged.residual, judged.steps, state, items),
        )
        renew(starting=False)
        led, moved = led[2:] + led[:2], moved[2:] + moved[:2]
        if step % STEPS_A_LOOK == STEPS_A_LOOK - 1:
            items = unsettled(session, items, state)
            if not items.size or (stop is not None and stop[0]):
                break
    return R


def unsettled(session: Session, items: Any, state: Any) -> Any:
    """The listed items that go on; waits."""
    listed = session.download(items)
    going_on = listed[session.download(state)[listed] == 0]
    return items if going_on.size == listed.size else session.upload(going_on)


def results(
    session: Session,
    what: Scattering,
    counts: Any,
    off: Sheet,
    Ru: Any,
    n: int,
    out: Any,
    into: Any,
    columns: Any,
    judged: Judged,
) -> Endless:
    """From off the nodes to off the nodes, less what is scattered once, and to the nodes."""
    u, n_in, n_col = off.phi.rows, into.size, columns.shape[0]
    Ruu, psi = bare_stack(session, what.room, u, u), bare_stack(session, what.room, u, off.phi.columns)
    for columns_of, alpha, beta in [(off.H, 1.0, 0.0), (off.phi, -1.0, 1.0)]:
        times_coefficients(session, what, counts, columns_of, psi, v_sign=-1.0, odd_sign=-1.0)
        product_over_columns(session, what.items, counts, 2, psi, columns_of, Ruu, alpha, beta)
    up = session.empty((what.room, n_in, n_col, what.stokes * out.size))
    on_nodes = session.empty((what.room, n_in * n_col, n))
    place = what.members.index(V) if V in what.members else -1
    session.launch(
        "invariance_results",
        (n_in, what.items.size),
        *(np.int32(n), np.int32(what.stokes), np.int32(place), np.int32(out.size), np.int32(n_col)),
        *(off.signed_mu, out, into, columns, Ruu.data, np.int32(Ruu.ld), np.int64(Ruu.stride)),
        *(Ru, np.int32(off.H.ld // STRIP), up, on_nodes, what.items),
    )
    return Endless(up, on_nodes, judged.residual, judged.steps)


def reflect_endless_arrays(
    session: Session,
    orders: IntArray,
    members: IntArray,
    coefficients: Array,
    terms: int,
    albedo: float,
    directions: Array,
    weights: Array,
    out: IntArray,
    into: IntArray,
    columns: Array,
    tolerance: float,
    halves: bool,
    up: Array,
    on_nodes: Array,
    residual: Array,
    steps: IntArray,
    threads: int,
    work: Array,
    seconds: Array,
    stop: IntArray,
) -> None:
    """As `_core.reflect_endless`: fills up, on_nodes, residual and steps; halves, threads and work are the processor's
    (every product here is a whole one)."""
    start = time.perf_counter()
    if orders.size and not stop[0]:
        upload, count = session.upload, orders.size
        pairs = upload(np.arange(count, dtype=np.int32)), upload(orders), upload(np.zeros(count, np.int32))
        materials = upload(coefficients[np.newaxis]), upload(np.array([terms], np.int32)), upload(np.array([albedo]))
        cosines = upload(directions), upload(weights), upload(out), upload(into), upload(columns)
        tolerances = upload(np.full(count, tolerance))
        found = reflect_endless(session, *pairs, members.tolist(), *materials, *cosines, tolerances, stop)
        for array, values in (
            (up, found.up),
            (on_nodes, found.on_nodes),
            (residual, found.residual),
            (steps, found.steps),
        ):
            array[...] = session.download(values)
    seconds[0] += time.perf_counter() - start
