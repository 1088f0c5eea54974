"""The top of a semi-infinite layer where doubles are slow: fixed points in floats, what they miss in doubles, and a
linear correction in floats, until the same check passes as in doubles. See correction.cl."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.cl.assembly import Scattering, compute_parity_columns, multiply_by_coefficients, multiply_over_columns
from vrte.cl.invariance import (
    Asked,
    FactorColumns,
    SemiInfinite,
    compute_off_node_results,
    make_sheet,
    reflect_semi_infinite,
    stack_like,
)
from vrte.cl.matrices import STRIP, Stack, make_stack, multiply_stacks, stack_in
from vrte.cl.session import Session

ROUGH = 2e-6  # estimated error of R at which fixed-point iterations in floats stop: its square is rounding
PROPER = 1e-5  # relative error at which a correction stops
MOST_ROUNDS = 3  # corrections at most; an item still in doubt is solved in doubles
STEPS_A_LOOK = 4  # iterations between two checks of convergence, each of which waits for the device


def upload_all(session: Session, given: Sequence[Any]) -> list[Any]:
    """Arrays of the host on the device, tuples as they are."""
    return [each if isinstance(each, tuple) else session.constant(each) for each in given]


def reflect_semi_infinite_mixed(
    high: Session, given: Sequence[Any], stop: IntArray | None = None
) -> tuple[SemiInfinite, IntArray]:
    """As `reflect_semi_infinite` with the arguments behind its session, ``given`` on the host: to the same tolerance;
    and the items that did not converge and were solved in doubles."""
    work = make_mixing(high, given)
    found, doubted = work.run(stop)
    if doubted.size and not (stop is not None and stop[0]):
        again = reflect_semi_infinite(high, *upload_all(high, (doubted, *given[1:])), *[stop])
        for name in ("up", "on_nodes", "residual", "steps"):
            high.copy_items(getattr(again, name), getattr(found, name), doubted)
    return found, doubted


@dataclass(frozen=True, eq=False)
class Prepared:
    """What fixed points begin with, on a session: what is asked, how many columns E and F have, the nodes' rows and
    those off the nodes, and what a step gains at least, (item,)."""

    asked: Asked
    counts: Any
    nodes: FactorColumns
    off: FactorColumns
    rate: Any

    @property
    def what(self) -> Scattering:
        """What scatters."""
        return self.asked.what


def prepare_semi_infinite(session: Session, given: Sequence[Any]) -> Prepared:
    """The same of arguments of `reflect_semi_infinite` on the host."""
    items, order, material, members, coefficients, terms, albedo, *rest = upload_all(session, given)
    what = Scattering(items, order, material, members, coefficients, terms, albedo)
    asked = Asked(what, *rest)
    columns = compute_parity_columns(session, what, asked.directions, asked.weights, asked.n_off, bare=False)
    n_node = asked.weights.size
    nodes = make_sheet(session, what, columns, 0, asked.directions, 0, n_node)
    off = make_sheet(session, what, columns, 1, asked.directions, n_node, asked.n_off)
    rate = session.empty((what.room,))
    session.launch("invariance_rate", (items.size,), what, rate, items)
    return Prepared(asked, columns.counts, nodes, off, rate)


def make_mixing(high: Session, given: Sequence[Any]) -> "Mixing":
    """The work on items ``given`` on the host."""
    low = high.in_precision("single")
    sides = (prepare_semi_infinite(one, given) for one in (high, low))
    return Mixing(high, low, np.asarray(given[0]), np.asarray(given[-1]), *sides)


@dataclass(frozen=True, eq=False)
class Mixing:
    """The work on all items: sessions in doubles and in floats on the same queue, and what is prepared on each."""

    high: Session
    low: Session
    items: IntArray
    tolerance: Array
    wide: Prepared
    narrow: Prepared

    @property
    def n(self) -> int:
        """Unknowns on the nodes: columns of the reflection R."""
        return self.wide.nodes.phi.rows

    def run(self, stop: IntArray | None) -> tuple[SemiInfinite, IntArray]:
        """What comes back, and the items that are in doubt."""
        high, low, wide, narrow = self.high, self.low, self.wide, self.narrow
        steps = low.zeros((wide.what.room,), np.int32)
        missing, doubted, found = np.zeros(wide.what.room), self.items[:0], []
        rough = [self.converge_roughly(rows, steps, stop) for rows in (narrow.nodes, narrow.off)]
        K = self.make_K()
        for rows, rough_rows, begin in ((wide.nodes, narrow.nodes, rough[0]), (wide.off, narrow.off, rough[1])):
            R, left, misses = self.bring(rows, rough_rows, begin, K, stop)
            found.append(R)
            doubted, missing = np.union1d(doubted, left).astype(np.int32), np.maximum(missing, misses)
        Ru = found[1]
        indices = 0, Ru.stride, self.n, (STRIP, Ru.ld)
        up, on_nodes = compute_off_node_results(high, wide.asked, wide.counts, wide.off, Ru.data, *indices)
        return SemiInfinite(up, on_nodes, high.upload(missing), steps), doubted

    def make_K(self) -> Stack:
        """phi C H^T on the nodes, (n, n), in floats."""
        low, what, counts, nodes = self.low, self.narrow.what, self.narrow.counts, self.narrow.nodes
        psi, K = stack_like(low, what, nodes.phi), make_stack(low, what.room, self.n, self.n, bare=True)
        multiply_by_coefficients(low, what, counts, nodes.phi, psi, v_sign=-1.0, odd_sign=-1.0)
        multiply_over_columns(low, what.items, counts, 2, psi, nodes.H, K, 1.0)
        return K

    def renew(self, session: Session, rows: FactorColumns, R: Stack, Y: Stack, items: Any) -> None:
        """H = +-phi + R phi_nodes, and Y = H C H_nodes^T, in doubles or floats."""
        side = self.wide if session is self.high else self.narrow
        H, phi = rows.H, side.nodes.phi
        session.launch("signed_phi", (H.columns, items.size), H.rows, side.counts, rows.phi, H, items)
        multiply_stacks(session, items, R, phi, H, 1.0, 1.0)
        HC, listed = stack_like(session, side.what, H), replace(side.what, items=items)
        multiply_by_coefficients(session, listed, side.counts, H, HC, v_sign=-1.0, odd_sign=-1.0)
        multiply_over_columns(session, items, side.counts, 2, HC, side.nodes.H, Y, 1.0)

    def converge_roughly(self, rows: FactorColumns, steps: Any, stop: IntArray | None) -> Any:
        """R of some rows by fixed points in floats, (item, n, row), and their H; the nodes' own come first."""
        low, what = self.low, self.narrow.what
        shape = what.room, self.n, rows.H.ld
        R, r, P = low.zeros(shape), low.zeros(shape), stack_in(low.zeros(shape), rows.phi.rows, self.n)
        stack = stack_in(R, rows.phi.rows, self.n)
        tolerance = low.constant(np.maximum(self.tolerance, ROUGH))

        def renew(items: Any) -> None:
            self.renew(low, rows, stack, P, items)

        self.fixed_point(rows, r, R, P, False, renew, tolerance, what.items, steps, stop)
        renew(what.items)
        return R

    def bring(
        self, rows: FactorColumns, rough_rows: FactorColumns, begin: Any, K: Stack, stop: IntArray | None
    ) -> tuple[Stack, IntArray, Array]:
        """R of some rows in doubles from that in floats, which items miss more than they may, and what each misses."""
        high, room, n, left = self.high, self.wide.what.room, self.n, self.items
        R, Y = (make_stack(high, room, rows.phi.rows, n, bare=True) for _ in range(2))
        high.launch("widen", (n, left.size), begin, R, self.wide.what.items)
        difference, missing, found = high.empty((room,)), high.zeros((room,)), high.empty((room, n, 2))
        sizes = rows.phi.rows, rows.signed_mu, self.wide.nodes.signed_mu
        for turn in range(MOST_ROUNDS + 1):
            items = high.constant(left)
            self.renew(high, rows, R, Y, items)
            high.launch("find_missing", (n, left.size), *sizes, Y, R, found, items)
            high.launch("judge_missing", (left.size,), n, found, self.wide.rate, difference, missing, items)
            misses = high.download(missing)
            left = left[~(misses[left] <= self.tolerance[left])]
            if not left.size or turn == MOST_ROUNDS or (stop is not None and stop[0]):
                break
            items = high.constant(left)
            r, d = (self.low.zeros((room, n, R.ld)) for _ in range(2))
            high.launch("narrow_missing", (n, left.size), *sizes, difference, Y, R, r, items)
            self.correct(rough_rows, r, d, K, items, stop)
            high.launch("add_correction", (n, left.size), rows.phi.rows, difference, d, R, items)
        return R, left, misses

    def correct(self, rows: FactorColumns, r: Any, d: Any, K: Stack, items: Any, stop: IntArray | None = None) -> None:
        """d = r + what d K makes of it, in floats; d is zero before."""
        low, room = self.low, self.narrow.what.room
        P, D = (stack_in(one, rows.phi.rows, self.n) for one in (low.zeros(r.shape), d))

        def multiply(items: Any) -> None:
            multiply_stacks(low, items, D, K, P)

        steps, proper = low.zeros((room,), np.int32), low.constant(np.full(room, PROPER))
        self.fixed_point(rows, r, d, P, rows is self.narrow.nodes, multiply, proper, items, steps, stop)

    def fixed_point(
        self,
        rows: FactorColumns,
        r: Any,
        R: Any,
        P: Stack,
        mirrored: bool,
        renew: Callable[[Any], None],
        tolerance: Any,
        items: Any,
        steps: Any,
        stop: IntArray | None,
    ) -> None:
        """R = r + P over the rates, P being what renew(items) makes of R, in floats, by fixed points with Anderson's
        acceleration; all items take a step together, those that have converged leave."""
        low, room, n = self.low, self.narrow.what.room, self.n
        led, moved = ([low.zeros(r.shape) for _ in range(3)] for _ in range(2))
        state, convergence, found = low.zeros((room,), np.int32), low.zeros((room, 7)), low.empty((room, n, 5))
        sizes = mirrored, rows.phi.rows, rows.signed_mu, self.narrow.nodes.signed_mu
        for step in range(_core.MOST_STEPS):
            renew(items)
            low.launch("lead_on", (n, items.size), *sizes, P, r, R, *led, *moved, found, state, items)
            judged = found, self.narrow.rate, tolerance, convergence, steps, state
            low.launch("judge_step", (items.size,), step, n, *judged, items)
            mixed = rows.phi.rows, P.ld, R, *led, *moved, convergence, state
            low.launch("mix_steps", (n, items.size), *mixed, items)
            led, moved = led[2:] + led[:2], moved[2:] + moved[:2]
            if step % STEPS_A_LOOK == STEPS_A_LOOK - 1:
                listed = low.download(items)
                going_on = listed[low.download(state)[listed] == 0]
                if not going_on.size or (stop is not None and stop[0]):
                    return
                items = items if going_on.size == listed.size else low.constant(going_on)
