"""The top of a semi-infinite layer, by invariance, on a device: `_core.reflect_semi_infinite` for all items at once.

Every item takes its own steps, so that what comes out of one does not depend on which others there are. On a CPU a
work-item takes all steps of an item, on a GPU all take a step together: see `convergence`."""

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
    launch_pieces,
    multiply_by_coefficients,
    multiply_over_columns,
)
from vrte.cl.matrices import STRIP, Stack, make_stack, pad_to_strips
from vrte.cl.session import Placed, Session
from vrte.cl.stages import stand_in_for

V = 3


@dataclass(frozen=True, eq=False)
class Asked:
    """Semi-infinite layers on the same nodes, and what is asked of them, on the device. directions: nodes, then off the
    nodes; out, into: places among the latter; columns (n_col, S); tolerance (item,)."""

    what: Scattering
    directions: Any
    weights: Any
    out: Any
    into: Any
    columns: Any
    tolerance: Any

    @property
    def n_off(self) -> int:
        """Directions off the nodes."""
        return int(self.directions.size - self.weights.size)


@dataclass(frozen=True, eq=False)
class SemiInfinite:
    """On the device: up (item, n_in, n_col, S n_out), on_nodes (item, n_in n_col, n), residual and steps, (item,) from
    item ``first`` on, as of `_core.reflect_semi_infinite`."""

    up: Any
    on_nodes: Any
    residual: Any
    steps: Any
    first: int = 0


@dataclass(frozen=True, eq=False)
class FactorColumns:
    """Some rows: phi and H of E's and F's columns, Hf with the other sign; signed_mu: the cosine of each row, minus
    where it is V's, from the ``mu_first``-th number on."""

    phi: Stack
    H: Stack
    signed_mu: Any
    mu_first: int = 0


@dataclass(frozen=True, eq=False)
class Judged(Placed):
    """What decides when an item has converged, and how it did, (item,) each."""

    rate: Any
    tolerance: Any
    residual: Any
    steps: Any

    @property
    def place(self) -> tuple[Any, ...]:
        """The arguments that it stands for, in the order of its fields."""
        return tuple(vars(self).values())


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
    A GPU is waited for at every few steps, and ``stop[0]`` looked at, then nothing that comes out counts."""
    what = Scattering(items, order, material, tuple(members), coefficients, terms, albedo)
    (found,) = reflect_sorts(session, [Asked(what, directions, weights, out, into, columns, tolerance)], stop)
    return found


def reflect_sorts(session: Session, asked: Sequence[Asked], stop: IntArray | None = None) -> list[SemiInfinite]:
    """The same for layers on several sets of nodes, or of several sets of Stokes parameters."""
    if session.form == "gpu":
        from vrte.cl import invariance_gpu

        return invariance_gpu.reflect_batch(session, asked, stop)
    return [reflect_alone(session, one, stop) for one in asked]


def reflect_alone(session: Session, asked: Asked, stop: IntArray | None) -> SemiInfinite:
    """As a CPU wants it: all steps of an item by one work-item."""
    what, n_node, items = asked.what, asked.weights.size, asked.what.items
    columns = compute_parity_columns(session, what, asked.directions, asked.weights, asked.n_off)
    nodes = make_sheet(session, what, columns, 0, asked.directions, 0, n_node)
    off = make_sheet(session, what, columns, 1, asked.directions, n_node, asked.n_off)
    rate, residual, steps = (
        session.empty((what.room,)),
        session.zeros((what.room,)),
        session.zeros((what.room,), np.int32),
    )
    session.launch("invariance_rate", (items.size,), what, rate, items)
    judged = Judged(rate, asked.tolerance, residual, steps)
    n = nodes.phi.rows
    shape = what.room, n, max(nodes.H.ld, off.H.ld)
    # the first two steps read by how much steps moved that there were not, and do nothing with it
    room = [session.empty(shape) for _ in range(4)] + [session.zeros(shape) for _ in range(2)]
    for rows in (nodes, off):
        R, HC = session.empty((what.room, n, rows.H.ld)), stack_like(session, what, rows.H)
        if stop is None or not stop[0]:
            sizes = session.device.max_compute_units, _core.MOST_STEPS, rows.H.ld // STRIP, rows is nodes, n
            arrays = columns.counts, rows.signed_mu, nodes.signed_mu, rows.phi, nodes.H, R, *room, rows.H, HC.columns
            session.launch("invariance_converge", (items.size,), what, *sizes, *arrays, HC.data, judged, items)
    up, on_nodes = compute_off_node_results(session, asked, columns.counts, off, R, 0, n * off.H.ld, n)
    return SemiInfinite(up, on_nodes, residual, steps)


def place_of_v(what: Scattering) -> int:
    """Of V among the members, -1 where it is none."""
    return what.members.index(V) if V in what.members else -1


def stack_like(session: Session, what: Scattering, stack: Stack) -> Stack:
    """Another stack of that shape, yet to be written."""
    return make_stack(session, what.room, stack.rows, stack.columns, bare=True)


def make_sheet(
    session: Session, what: Scattering, columns: Columns, part: int, directions: Any, first: int, n_mu: int
) -> FactorColumns:
    """Of some directions, the part of phi's rows that is theirs."""
    rows = what.stokes * n_mu
    signed_mu = session.empty((pad_to_strips(rows),))
    put_cosines(session, what, directions, first, n_mu, signed_mu, 0)
    return FactorColumns(
        columns.rows(part, rows), make_stack(session, what.room, rows, columns.phi.columns, bare=True), signed_mu
    )


def put_cosines(
    session: Session, what: Scattering, directions: Any, first: int, n_mu: int, signed_mu: Any, to: int
) -> None:
    """The cosine of each row of some directions."""
    sizes = n_mu, what.stokes, place_of_v(what)
    session.launch("cosines_of_rows", (1,), *sizes, directions, first, to, signed_mu)


def compute_off_node_results(
    session: Session,
    asked: Asked,
    counts: Any,
    off: FactorColumns,
    Ru: Any,
    first: int,
    stride: int,
    n: int,
    steps: tuple[int, int] | None = None,
) -> tuple[Any, Any]:
    """From off the nodes to off the nodes, less what is scattered once, and to the nodes; Ru of each item from double
    ``first`` on, ``stride`` apart; ``steps``: how far strips of 8 rows are apart, and columns, by default on a CPU
    strip by strip, on a GPU column by column."""
    what, out, into, columns = asked.what, asked.out, asked.into, asked.columns
    u, n_in, n_col = off.phi.rows, into.size, columns.shape[0]
    Ruu, psi = (make_stack(session, what.room, u, size, bare=True) for size in (u, off.phi.columns))
    for columns_of, alpha, beta in [(off.H, 1.0, 0.0), (off.phi, -1.0, 1.0)]:
        multiply_by_coefficients(session, what, counts, columns_of, psi, v_sign=-1.0, odd_sign=-1.0)
        multiply_over_columns(session, what.items, counts, 2, psi, columns_of, Ruu, alpha, beta)
    up = session.empty((what.room, n_in, n_col, what.stokes * out.size))
    on_nodes = session.empty((what.room, n_in * n_col, n))
    ld, size = off.H.ld, what.stokes * out.size + n
    steps = steps or ((STRIP * n, STRIP) if session.form == "cpu" else (STRIP, ld))
    sizes = n, ..., what.stokes, place_of_v(what), out.size, n_col
    arrays = off.signed_mu, off.mu_first, out, into, columns, Ruu, Ru, first, *steps, stride, up, on_nodes
    launch_pieces(session, "invariance_results", size, size, what.items, *sizes, *arrays, between=(n_in,))
    return up, on_nodes


@stand_in_for(_core.reflect_semi_infinite)
def reflect_semi_infinite_arrays(session: Session, crew: ThreadTeam, given: Any) -> None:
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
    found = reflect_semi_infinite(session, *pairs, given.members.tolist(), **uploaded, stop=crew.stop)
    for name in ("up", "on_nodes", "residual", "steps"):
        getattr(given, name)[...] = session.download(getattr(found, name))
