"""The top of a layer without end, by invariance, on a device: `_core.reflect_endless` for all items at once.

Every item takes its own steps, so that what comes out of one does not depend on which others there are. On a GPU all
take a step together, and those that have settled leave the list; on a CPU a work-item takes all steps of an item."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import IntArray
from vrte.basics.running import Crew
from vrte.cl.assembly import (
    Columns,
    Scattering,
    compute_parity_columns,
    launch_pieces,
    multiply_by_coefficients,
    multiply_over_columns,
)
from vrte.cl.matrices import GROUP, STRIP, Stack, count_work_items, make_stack, pad_to_strips
from vrte.cl.session import Placed, Session
from vrte.cl.stages import stand_in_for

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
class Judged(Placed):
    """What decides when an item has settled, and how it did, (item,) each."""

    rate: Any
    tolerance: Any
    residual: Any
    steps: Any

    @property
    def place(self) -> tuple[Any, ...]:
        """The arguments that it stands for, in the order of its fields."""
        return tuple(vars(self).values())


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
    phi = compute_parity_columns(session, what, directions, weights, n_off)
    nodes = make_sheet(session, what, phi, 0, directions, 0, weights.size)
    off = make_sheet(session, what, phi, 1, directions, weights.size, n_off)
    rate, residual, steps = (
        session.empty((what.room,)),
        session.zeros((what.room,)),
        session.zeros((what.room,), np.int32),
    )
    session.launch("invariance_rate", (items.size,), what, rate, items)
    judged = Judged(rate, tolerance, residual, steps)
    room = [session.empty((what.room, nodes.phi.rows, max(nodes.H.ld, off.H.ld))) for _ in range(6)]
    for rows in (nodes, off):
        R = session.empty((what.room, nodes.phi.rows, rows.H.ld))
        points = FixedPoints(session, what, phi.counts, rows, nodes, judged, R, room[:3], room[3:])
        if stop is None or not stop[0]:
            points.settle_each() if session.form == "cpu" else points.settle_together(stop)
    up, on_nodes = compute_off_node_results(session, what, phi.counts, off, R, nodes.phi.rows, out, into, columns)
    return Endless(up, on_nodes, residual, steps)


def place_of_v(what: Scattering) -> int:
    """Of V among the members, -1 where it is none."""
    return what.members.index(V) if V in what.members else -1


def make_sheet(
    session: Session, what: Scattering, columns: Columns, part: int, directions: Any, first: int, n_mu: int
) -> Sheet:
    """Of some directions, the part of phi's rows that is theirs."""
    rows = what.stokes * n_mu
    signed_mu = session.empty((pad_to_strips(rows),))
    session.launch("cosines_of_rows", (1,), n_mu, what.stokes, place_of_v(what), directions, first, signed_mu)
    H, HC = (make_stack(session, what.room, rows, columns.phi.columns, bare=True) for _ in range(2))
    return Sheet(columns.rows(part, rows), H, HC, signed_mu)


@dataclass(eq=False)
class FixedPoints:
    """Steps for R of some rows, the nodes' or others, as many as each item needs, and their H with it.

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
    def cosines(self) -> tuple[Any, ...]:
        """Of R's rows and columns, behind the number of E's and F's columns."""
        return self.counts, self.rows.signed_mu, self.nodes.signed_mu

    def settle_each(self) -> None:
        """All steps of an item by one work-item: what belongs to it stays in the cache, and nobody waits for others."""
        H, units = self.rows.H, self.session.device.max_compute_units
        sizes = units, _core.MOST_STEPS, H.ld // STRIP, self.rows is self.nodes, self.n
        steps = self.R, *self.led, *self.moved
        arguments = *sizes, *self.cosines, self.rows.phi, self.nodes.H, *steps, H, H.columns, self.rows.HC.data
        items = self.what.items
        self.session.launch("invariance_settle", (items.size,), self.what, *arguments, self.judged, items)

    def settle_together(self, stop: IntArray | None) -> None:
        """A step of all items, and another, without those that have settled."""
        session, what, items = self.session, self.what, self.what.items
        across, along = count_work_items(self.rows.H.ld, self.n)
        tiles = across // GROUP * along // GROUP
        found, state = session.empty((what.room, tiles, 5)), session.zeros((what.room,), np.int32)
        settling = session.zeros((what.room, 7))
        self.renew(items, settling, state, starting=True)
        for step in range(_core.MOST_STEPS):
            self.step(items, found, state)
            judging = step, _core.MOST_STEPS, tiles, found, self.judged, settling, state, items
            session.launch("invariance_judge", (items.size,), *judging)
            self.renew(items, settling, state)
            self.led, self.moved = self.led[2:] + self.led[:2], self.moved[2:] + self.moved[:2]
            if step % STEPS_A_LOOK == STEPS_A_LOOK - 1:
                items = list_unsettled(session, items, state)
                if not items.size or (stop is not None and stop[0]):
                    return

    def step(self, items: Any, found: Any, state: Any) -> None:
        """Where R leads, and what that moves; found (item, tile, 5)."""
        H, ld = self.nodes.H, self.rows.H.ld
        arguments = ld, self.n, *self.cosines, self.rows.HC.data, H, H.columns, self.R, *self.led, *self.moved
        size = *count_work_items(ld, self.n), items.size
        self.session.launch("invariance_step_gpu", size, *arguments, found, state, items, group=(GROUP, GROUP, 1))

    def renew(self, items: Any, settling: Any, state: Any, starting: bool = False) -> None:
        """R of the steps, then H, then HC."""
        H, size, launch = self.rows.H, self.rows.H.ld * self.n, self.session.launch
        mixed = starting, size, self.R, *self.led, *self.moved, settling, state, items
        launch("invariance_mix", (-(-size // MIXED) * MIXED, items.size), *mixed, group=(MIXED, 1))
        renewed = starting, self.n, self.counts, self.rows.phi, self.R, H, state, items
        launch(
            "invariance_renew_gpu", (*count_work_items(H.ld, H.columns), items.size), *renewed, group=(GROUP, GROUP, 1)
        )
        listed = replace(self.what, items=items)
        multiply_by_coefficients(self.session, listed, self.counts, H, self.rows.HC, v_sign=-1.0, odd_sign=-1.0)


def list_unsettled(session: Session, items: Any, state: Any) -> Any:
    """The listed items that go on; waits."""
    listed = session.download(items)
    going_on = listed[session.download(state)[listed] == 0]
    return items if going_on.size == listed.size else session.constant(going_on)


def compute_off_node_results(
    session: Session, what: Scattering, counts: Any, off: Sheet, Ru: Any, n: int, out: Any, into: Any, columns: Any
) -> tuple[Any, Any]:
    """From off the nodes to off the nodes, less what is scattered once, and to the nodes."""
    u, n_in, n_col = off.phi.rows, into.size, columns.shape[0]
    Ruu, psi = (make_stack(session, what.room, u, size, bare=True) for size in (u, off.phi.columns))
    for columns_of, alpha, beta in [(off.H, 1.0, 0.0), (off.phi, -1.0, 1.0)]:
        multiply_by_coefficients(session, what, counts, columns_of, psi, v_sign=-1.0, odd_sign=-1.0)
        multiply_over_columns(session, what.items, counts, 2, psi, columns_of, Ruu, alpha, beta)
    up = session.empty((what.room, n_in, n_col, what.stokes * out.size))
    on_nodes = session.empty((what.room, n_in * n_col, n))
    ld, size = off.H.ld, what.stokes * out.size + n
    steps = (STRIP * n, STRIP) if session.form == "cpu" else (STRIP, ld)  # strip by strip, or column by column
    sizes = n, ..., what.stokes, place_of_v(what), out.size, n_col
    arguments = *sizes, off.signed_mu, out, into, columns, Ruu, Ru, *steps, ld * n, up, on_nodes
    launch_pieces(session, "invariance_results", size, size, what.items, *arguments, between=(n_in,))
    return up, on_nodes


@stand_in_for(_core.reflect_endless)
def reflect_endless_arrays(session: Session, crew: Crew, given: Any) -> None:
    """Fills up, on_nodes, residual and steps; halves plays no part: R on the nodes is made up to its diagonal on a CPU,
    wholly on a GPU."""
    count, upload = given.orders.size, session.constant
    if not count or crew.stop[0]:
        return
    pairs = upload(np.arange(count, dtype=np.int32)), upload(given.orders), upload(np.zeros(count, np.int32))
    scene = {
        "coefficients": given.coefficients[np.newaxis],
        "terms": np.array([given.terms], np.int32),
        "albedo": np.array([given.albedo]),
        "tolerance": np.full(count, given.tolerance),
    }
    asked = {name: getattr(given, name) for name in ("directions", "weights", "out", "into", "columns")}
    uploaded: dict[str, Any] = {name: upload(values) for name, values in (scene | asked).items()}
    found = reflect_endless(session, *pairs, given.members.tolist(), **uploaded, stop=crew.stop)
    for name, values in vars(found).items():
        getattr(given, name)[...] = session.download(values)
