"""The top of a layer without end, by invariance, on a device: `_core.reflect_endless` for all items at once.

Every item takes its own steps, so that what comes out of one does not depend on which others there are. On a GPU all
take a step together, and those that have settled leave the list; on a CPU a work-item takes all steps of an item."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Crew
from vrte.cl.assembly import (
    Columns,
    Scattering,
    bare_stack,
    parity_columns,
    pieces,
    product_over_columns,
    tiles_of,
    times_coefficients,
)
from vrte.cl.matrices import GROUP, STRIP, Stack, padded
from vrte.cl.session import Session

MOST_STEPS = 400
STEPS_A_LOOK = 4  # fixed points between two looks at what has settled, each of which waits
MIXED = 64  # work-items of a work-group that makes R on a GPU
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
    """Some rows: phi, H and HC of E's and F's columns, Hf with the other sign; signed_mu: the cosine of each row, minus
    where it is V's."""

    phi: Stack
    H: Stack
    HC: Stack
    signed_mu: Any


@dataclass(frozen=True, eq=False)
class Judged:
    """What decides when an item has settled, and how it did, (item,) each."""

    rate: Any
    tolerance: Any
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
    A GPU is waited for at every few steps, and ``stop[0]`` looked at, then nothing that comes out counts."""
    what = Scattering(items, order, material, tuple(members), coefficients, terms, albedo)
    n_off = directions.size - weights.size
    phi = parity_columns(session, what, directions, weights, n_off)
    nodes = sheet_of(session, what, phi, 0, directions, 0, weights.size)
    off = sheet_of(session, what, phi, 1, directions, weights.size, n_off)
    judged = Judged(
        rate=session.empty((what.room,)),
        tolerance=tolerance,
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
    H, HC = (bare_stack(session, what.room, rows, columns.phi.columns) for _ in range(2))
    return Sheet(columns.rows(part, rows), H, HC, signed_mu)


@dataclass(eq=False)
class FixedPoints:
    """Steps for R of some rows, the nodes' or others.

    ``led`` to which R the last steps led, ``moved`` by how much, this one first: memory for matrices like R. On a CPU
    R, the last steps and HC are stored strip by strip, on a GPU column by column."""

    session: Session
    what: Scattering
    counts: Any
    rows: Sheet
    nodes: Sheet
    judged: Judged
    R: Any
    led: list[Any]
    moved: list[Any]

    @property
    def n(self) -> int:
        """Columns of R."""
        return self.nodes.phi.rows

    @property
    def phi(self) -> tuple[Any, ...]:
        """phi on the nodes as kernels take it, and where that of the rows begins."""
        phi = self.nodes.phi
        return phi.data, np.int32(phi.ld), np.int64(phi.stride), np.int32(self.rows.phi.first)

    def settle_each(self) -> None:
        """All steps of an item by one work-item: what belongs to it stays in the cache, and nobody waits for others."""
        session, what, judged, H, nodes_H = self.session, self.what, self.judged, self.rows.H, self.nodes.H
        session.launch(
            "invariance_settle",
            (what.items.size,),
            *(np.int32(session.device.max_compute_units), np.int32(MOST_STEPS), np.int32(H.ld // STRIP)),
            *(np.int32(self.rows is self.nodes), np.int32(self.n)),
            *(np.int32(what.n_term), what.bits, what.coefficients, what.order, what.material, what.terms, what.albedo),
            *(self.counts, self.rows.signed_mu, self.nodes.signed_mu, *self.phi),
            *(nodes_H.data, np.int32(nodes_H.ld), np.int64(nodes_H.stride), *self.led, *self.moved, self.R),
            *(H.data, np.int32(H.ld), np.int64(H.stride), np.int32(H.columns), self.rows.HC.data),
            *(judged.rate, judged.tolerance, judged.residual, judged.steps, what.items),
        )

    def settle_together(self, stop: IntArray | None) -> None:
        """A step of all items, and another, without those that have settled."""
        session, what, judged, items = self.session, self.what, self.judged, self.what.items
        across, along = tiles_of(self.rows.H.ld, self.n)
        tiles = across // GROUP * along // GROUP
        found, state = session.empty((what.room, tiles, 5)), session.zeros((what.room,), np.int32)
        settling = session.zeros((what.room, 7))
        self.renew(items, settling, state, starting=True)
        for step in range(MOST_STEPS):
            self.step(items, found, state)
            session.launch(
                "invariance_judge",
                (items.size,),
                *(np.int32(step), np.int32(MOST_STEPS), np.int32(tiles), found, judged.rate, judged.tolerance),
                *(settling, judged.residual, judged.steps, state, items),
            )
            self.renew(items, settling, state)
            self.led, self.moved = self.led[2:] + self.led[:2], self.moved[2:] + self.moved[:2]
            if step % STEPS_A_LOOK == STEPS_A_LOOK - 1:
                items = unsettled(session, items, state)
                if not items.size or (stop is not None and stop[0]):
                    return

    def step(self, items: Any, found: Any, state: Any) -> None:
        """Where R leads, and what that moves; found (item, tile, 5)."""
        nodes, ld = self.nodes.H, self.rows.H.ld
        self.session.launch(
            "invariance_step_gpu",
            (*tiles_of(ld, self.n), items.size),
            *(
                np.int32(ld),
                np.int32(self.n),
                self.counts,
                self.rows.signed_mu,
                self.nodes.signed_mu,
                self.rows.HC.data,
            ),
            *(nodes.data, np.int32(nodes.ld), np.int64(nodes.stride), np.int32(nodes.columns)),
            *(self.R, self.led[0], *self.moved, found, state, items),
            group=(GROUP, GROUP, 1),
        )

    def renew(self, items: Any, settling: Any, state: Any, starting: bool = False) -> None:
        """R of the steps, then H, then HC."""
        H, size = self.rows.H, self.rows.H.ld * self.n
        self.session.launch(
            "invariance_mix",
            (-(-size // MIXED) * MIXED, items.size),
            *(np.int32(starting), np.int32(size), *self.led, self.R, settling, state, items),
            group=(MIXED, 1),
        )
        self.session.launch(
            "invariance_renew_gpu",
            (*tiles_of(H.ld, H.columns), items.size),
            *(np.int32(starting), np.int32(self.n), self.counts, *self.phi),
            *(self.R, H.data, np.int32(H.ld), np.int64(H.stride), state, items),
            group=(GROUP, GROUP, 1),
        )
        listed = replace(self.what, items=items)
        times_coefficients(self.session, listed, self.counts, H, self.rows.HC, v_sign=-1.0, odd_sign=-1.0)


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
    """R of some rows, the nodes' or others, after as many fixed points as each item needs; their H with it."""
    R = session.empty((what.room, nodes.phi.rows, rows.H.ld))
    points = FixedPoints(session, what, counts, rows, nodes, judged, R, room[:3], room[3:])
    if stop is not None and stop[0]:
        return R
    if session.form == "cpu":
        points.settle_each()
    else:
        points.settle_together(stop)
    return R


def unsettled(session: Session, items: Any, state: Any) -> Any:
    """The listed items that go on; waits."""
    listed = session.download(items)
    going_on = listed[session.download(state)[listed] == 0]
    return items if going_on.size == listed.size else session.constant(going_on)


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
    ld, strip_by_strip = off.H.ld, session.form == "cpu"
    number, each, group = pieces(session, what.stokes * out.size + n, what.stokes * out.size + n)
    session.launch(
        "invariance_results",
        (number, n_in, what.items.size),
        *(np.int32(size) for size in (n, each, what.stokes, place, out.size, n_col)),
        *(off.signed_mu, out, into, columns, Ruu.data, np.int32(Ruu.ld), np.int64(Ruu.stride)),
        *(Ru, np.int32(STRIP * n if strip_by_strip else STRIP), np.int32(STRIP if strip_by_strip else ld)),
        *(np.int64(ld * n), up, on_nodes, what.items),
        group=(group, 1, 1),
    )
    return Endless(up, on_nodes, judged.residual, judged.steps)


def reflect_endless_arrays(
    session: Session,
    crew: Crew,
    *,
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
) -> None:
    """As `_core.reflect_endless`: fills up, on_nodes, residual and steps. halves plays no part: R on
    the nodes is made up to its diagonal on a CPU, wholly on a GPU."""
    start = time.perf_counter()
    if orders.size and not crew.stop[0]:
        upload, count = session.constant, orders.size
        pairs = upload(np.arange(count, dtype=np.int32)), upload(orders), upload(np.zeros(count, np.int32))
        materials = upload(coefficients[np.newaxis]), upload(np.array([terms], np.int32)), upload(np.array([albedo]))
        cosines = upload(directions), upload(weights), upload(out), upload(into), upload(columns)
        tolerances = upload(np.full(count, tolerance))
        found = reflect_endless(session, *pairs, members.tolist(), *materials, *cosines, tolerances, crew.stop)
        for array, values in (
            (up, found.up),
            (on_nodes, found.on_nodes),
            (residual, found.residual),
            (steps, found.steps),
        ):
            array[...] = session.download(values)
    crew.seconds[0] += time.perf_counter() - start
