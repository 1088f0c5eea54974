"""Slabs joined by the star product, (2:8), and the field between them: core/joining.pxi for many at once."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import Crew
from vrte.cl.doubling import Frame, axis_of, turning
from vrte.cl.extended import Algebra, Extended
from vrte.cl.matrices import PANEL, Stack, invert, new_stack, product, upload_stack
from vrte.cl.session import Session

MOST_KEPT = 1 << 23  # doubles of what was brought from the slabs of every place
IntArray = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Ground:
    """The base, item by item: matrix (item, n, n), source (item, r, n) and out (item, n, o), all (column, row), as the
    handling of order 0 has turned them; absorbed (item, n): the flux's row of 1 - matrix."""

    matrix: Array
    source: Array
    out: Array
    absorbed: Array


@dataclass(frozen=True, eq=False)
class Piles:
    """slab (item, place): which of the slabs lies there, top first; above (item, place + 1): optical depth of each
    interface; turned (item,): whether it is order 0 and carries the flux; interface (level,); ground: None: black."""

    slab: IntArray
    above: Array
    turned: NDArray[np.bool_]
    interface: IntArray
    ground: Ground | None


@dataclass(frozen=True, eq=False)
class Joined:
    """up, down (item, level, r, o), flux (item, level, 2, r) and info (item,) on the device; residual (item, place)."""

    up: Any
    down: Any
    flux: Any
    info: Any
    residual: Array


def ground_of(
    frame: Frame, turned: NDArray[np.bool_], row: IntArray, matrix: Array, source: Array, out: Array
) -> Ground:
    """The base of each item: row (item,) of the arrays, -1 for none; order 0 turned like its slabs."""
    s, (v, _) = frame.sizes, turning(frame)
    seen = row >= 0
    below, up, leaving = (np.where(seen.reshape(-1, 1, 1), a[np.maximum(row, 0)], 0.0) for a in (matrix, source, out))
    absorbed = np.zeros((row.size, s.n))
    absorbed[:, axis_of(s)] = 1.0
    for item in np.flatnonzero(turned & seen):
        below[item] -= np.outer(v, v @ below[item])
        below[item] -= np.outer(below[item] @ v, v)
        up[item] -= np.outer(up[item] @ v, v)
        leaving[item] -= np.outer(v, v @ leaving[item])
        absorbed[item] -= below[item][:, axis_of(s)]
        absorbed[item][np.abs(absorbed[item]) < _core.ROUNDING] = 0.0
    return Ground(below, up, leaving, absorbed)


class Joining:
    """The work on one stack of piles with as many places each."""

    def __init__(self, session: Session, frame: Frame, piles: Piles, R: Extended, T: Extended, lost: Any) -> None:
        self.session, self.frame, self.piles, self.R, self.T, self.lost = session, frame, piles, R, T, lost
        self.sizes = s = frame.sizes
        self.count, self.places = piles.slab.shape
        self.algebra = Algebra(session, s, self.count)
        self.items = self.algebra.where(np.ones(self.count, bool))
        self.turned = self.algebra.where(piles.turned) if piles.turned.any() else None
        self.kept = 2 * self.places * self.count * s.stride <= MOST_KEPT
        self.brought: dict[int, tuple[Extended, Extended]] = {}
        self.r, self.t = self.algebra.new(), self.algebra.new()
        self.row, self.lost_here = (session.zeros((self.count, s.n)) for _ in range(2))
        self.rate_II = session.constant(np.repeat(1.0 / frame.mu0, frame.columns.shape[0]) if s.r else np.zeros(1))
        self.depths = [session.constant(np.ascontiguousarray(above)) for above in piles.above.T]
        self.missing: dict[int, tuple[Any, Any]] = {}
        ground = piles.ground
        start = np.zeros((self.count, s.n)) if ground is None else ground.absorbed
        if ground is None:
            start[:, axis_of(s)] = 1.0
        self.absorbed = session.upload(start)
        self.below = None if ground is None else upload_stack(session, ground.matrix)
        self.out = None if ground is None else upload_stack(session, ground.out)
        self.vectors = [new_stack(session, self.count, s.n, s.r) for _ in range(2)]

    def square(self) -> Stack:
        """Zeros (n, n)."""
        return new_stack(self.session, self.count, self.sizes.n, self.sizes.n)

    def beams(self) -> Stack:
        """Zeros (n, r)."""
        return new_stack(self.session, self.count, self.sizes.n, self.sizes.r)

    def blend(self, alpha: float, a: Stack, out: Stack, beta: float = 0.0, gamma: float = 0.0) -> None:
        """out = alpha a + beta out + gamma 1."""
        numbers = np.float64(beta), np.float64(gamma)
        arguments = np.int32(a.rows), np.float64(alpha), *a.place, *numbers, *out.place, self.items
        self.session.launch("blend", (a.columns, self.count), *arguments)

    def product(self, a: Stack, b: Stack, c: Stack, beta: float = 0.0, alpha: float = 1.0) -> None:
        """c = alpha a b + beta c."""
        product(self.session, self.items, a, b, c, alpha, beta)

    def fade(self, place: int, a: Stack, out: Stack, straight: Any = None, running: Stack | None = None) -> None:
        """out = what the beam, attenuated on its way to the interface, makes by `a`, and what went on straight."""
        before = out if running is None else running
        weak = self.rate_II if straight is None else straight
        each = np.int32(0 if straight is None else self.sizes.o)
        arguments = (
            *(np.int32(a.rows), self.rate_II, self.depths[place], *a.place, np.int32(running is not None)),
            *(weak, each, *before.place, *out.place, self.items),
        )
        self.session.launch("fade", (self.sizes.r, self.count), *arguments)

    def bring(self, place: int) -> None:
        """R and T of what lies there as r and t, kept for the next time where there is room."""
        if place in self.brought:
            self.r, self.t = self.brought[place]
        else:
            if self.kept:
                self.brought[place] = self.r, self.t = self.algebra.new(), self.algebra.new()
            self.gather(place)
        if self.turned is not None:
            self.gather_lost(place)

    def gather(self, place: int) -> None:
        """R and T of what lies there into r and t."""
        of = self.session.constant(np.ascontiguousarray(self.piles.slab[:, place]))
        for source, target in ((self.R, self.r), (self.T, self.t)):
            arguments = *self.sizes.arguments, *source.arguments, *target.arguments, of, self.items
            self.session.launch("gather", (self.sizes.columns, self.count), *arguments)

    def gather_lost(self, place: int) -> None:
        """What is lost there into lost_here."""
        of = self.session.constant(np.ascontiguousarray(self.piles.slab[:, place]))
        if self.turned is not None:
            lost = Stack(self.lost, self.sizes.n, 1, self.sizes.n, self.sizes.n)
            here = Stack(self.lost_here, self.sizes.n, 1, self.sizes.n, self.sizes.n)
            self.session.launch(
                "gather_rows", (1, self.count), np.int32(self.sizes.n), lost.data, here.data, of, self.items
            )

    def run(self, stop: IntArray) -> Joined:
        """From the base up, then from the top down, then out of the nodes."""
        found: list[tuple[Stack | None, Stack | None]] = []
        up: list[Stack | None] = [self.emitted_by_base()]
        for place in range(self.places - 1, -1, -1):
            self.bring(place)
            G, g, above = self.put_upon(place, up[0])
            found.insert(0, (G, g))
            up.insert(0, above)
            if stop[0]:
                break
        down: list[Stack | None] = [None]
        for place in range(self.places if not stop[0] else 0):
            if self.places > 1:
                self.bring(place)
            falling, rising = self.fall(place, down[-1], *found[place])
            down.append(falling)
            up[place + 1] = rising
        if stop[0]:
            return Joined(None, None, None, self.algebra.info, self.residual())
        return self.leave(up, down)

    def emitted_by_base(self) -> Stack | None:
        """The beam that the base sends back, None of a black one."""
        if self.piles.ground is None:
            return None
        source, out = upload_stack(self.session, self.piles.ground.source), self.beams()
        self.fade(self.places, source, out)
        return out

    def put_upon(self, place: int, up: Stack | None) -> tuple[Stack | None, Stack | None, Stack]:
        """Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T,
        and what comes up above it, emitted up + T (G emitted down + g)."""
        r, t, above = self.r, self.t, self.beams()
        self.fade(place, r.NI, above)
        if self.below is None:
            self.below = self.square()
            self.blend(1.0, r.N, self.below)
            self.absorb_into_nothing()
            return None, None, above
        assert up is not None
        G, g = self.solve(place, up)
        GT = self.square()
        self.product(G, t.N, GT)
        self.absorb(GT)
        self.blend(1.0, r.N, self.below)
        self.product(t.N, GT, self.below, beta=1.0)
        emitted, through = self.vectors
        self.fade(place, t.NI, emitted)
        self.blend(1.0, g, through)
        self.product(G, emitted, through, beta=1.0)
        self.product(t.N, through, above, beta=1.0)
        return G, g, above

    def solve(self, place: int, up: Stack) -> tuple[Stack, Stack]:
        """(1 - below R)^-1 below and (1 - below R)^-1 up. In order 0 the flux's row, small where nothing absorbs, is
        summed from what is lost: lost + T's row + absorbed R."""
        s, session, below = self.sizes, self.session, self.below
        assert below is not None
        M, known, G, g = self.square(), self.square(), self.square(), self.beams()
        vector = self.beams()
        self.blend(0.0, below, M, gamma=1.0)
        self.product(below, self.r.N, M, beta=1.0, alpha=-1.0)
        self.blend(1.0, up, vector)
        right = below
        if self.turned is not None:
            right = self.square()
            self.blend(1.0, below, right)
            self.row_times(self.absorbed, self.r.N, self.row)
            self.add(self.lost_here, self.row)
            self.flux_row_of(self.row, self.t.N, self.row)
            shape = np.int32(s.n), np.int32(s.r), np.int32(axis_of(s)), self.row, M.data, right.data
            places = np.int32(M.ld), np.int64(M.stride), vector.data, np.int32(vector.ld), np.int64(vector.stride)
            session.launch("put_flux_row", (self.turned.size,), *shape, *places, self.turned)
        self.blend(1.0, M, known)
        rest, pivots = session.empty((self.count, PANEL * s.n)), session.empty((self.count, s.n), np.int32)
        invert(session, self.items, M, rest, pivots, self.algebra.info)
        self.product(M, right, G)
        self.product(M, vector, g)
        size = self.algebra.largest(self.items, vector)
        self.product(known, g, vector, beta=1.0, alpha=-1.0)
        self.missing[place] = self.algebra.largest(self.items, vector), size
        return G, g

    def residual(self) -> Array:
        """What each joint's system misses, relative, (item, place)."""
        found = np.zeros((self.count, self.places))
        for place, pair in self.missing.items():
            missing, size = (self.session.download(a) for a in pair)
            found[:, place] = np.where(size > _core.NO_LIGHT, missing / np.where(size > _core.NO_LIGHT, size, 1.0), 0.0)
        return found

    def row_times(self, x: Any, M: Stack, out: Any, beta: float = 0.0) -> None:
        """out = x M + beta out, rows of order 0."""
        assert self.turned is not None
        size = self.sizes.n, self.turned.size
        self.session.launch("row_times", size, np.int32(self.sizes.n), x, *M.place, np.float64(beta), out, self.turned)

    def flux_row_of(self, a: Any, M: Stack, out: Any) -> None:
        """out = a + M's row of the flux."""
        assert self.turned is not None
        place = np.int32(self.sizes.n), np.int32(axis_of(self.sizes)), a, *M.place, out
        self.session.launch("add_row", (self.sizes.n, self.turned.size), *place, self.turned)

    def add(self, a: Any, out: Any) -> None:
        """out += a, rows."""
        n = self.sizes.n
        one, other = Stack(a, n, 1, n, n), Stack(out, n, 1, n, n)
        self.blend(1.0, one, other, beta=1.0)

    def absorb(self, GT: Stack) -> None:
        """absorbed <- lost + (lost + absorbed R) G T + absorbed T."""
        if self.turned is None:
            return
        new = self.session.zeros((self.count, self.sizes.n))
        self.row_times(self.absorbed, self.r.N, self.row)
        self.add(self.lost_here, self.row)
        self.add(self.lost_here, new)
        self.row_times(self.row, GT, new, beta=1.0)
        self.row_times(self.absorbed, self.t.N, new, beta=1.0)
        self.absorbed = new

    def absorb_into_nothing(self) -> None:
        """The same above a black base, which absorbs all: lost + T's row."""
        if self.turned is not None:
            self.flux_row_of(self.lost_here, self.t.N, self.absorbed)

    def fall(self, place: int, down: Stack | None, G: Stack | None, g: Stack | None) -> tuple[Stack, Stack | None]:
        """What falls at the bottom of a slab and what rises there: T down + emitted, then G falling + g, then R up on
        top of it."""
        falling = self.beams()
        self.fade(place, self.t.NI, falling)
        if down is not None:
            self.product(self.t.N, down, falling, beta=1.0)
        if G is None or g is None:
            return falling, None
        self.product(G, falling, g, beta=1.0)
        self.product(self.r.N, g, falling, beta=1.0)
        return falling, g

    def leave(self, up: list[Stack | None], down: list[Stack | None]) -> Joined:
        """The field off the nodes at every wanted interface, first up through the slabs, then down."""
        s, levels = self.sizes, self.piles.interface.size
        shape = (self.count, levels, s.r, max(1, s.o))
        upward, downward, flux = (
            self.session.zeros(shape),
            self.session.zeros(shape),
            self.session.zeros((*shape[:2], 2, s.r)),
        )
        running = new_stack(self.session, self.count, s.o, s.r) if self.out is not None else None
        if running is not None and self.out is not None and down[self.places] is not None:
            self.product(self.out, self.known(down[self.places]), running)
        for place in range(self.places, -1, -1):
            self.put(place, running, upward)
            if place > 0 and (self.piles.interface < place).any():
                self.bring_again(place - 1)
                running = self.pass_on(place - 1, self.r.OI, running, up[place], down[place - 1])
        running = None
        for place in range(self.places + 1):
            self.put(place, running, downward)
            if place < self.places and (self.piles.interface > place).any():
                self.bring_again(place)
                running = self.pass_on(place, self.t.OI, running, down[place], up[place + 1])
        for place, (rising, falling) in enumerate(zip(up, down, strict=True)):
            self.put_flux(place, 0, rising, flux)
            self.put_flux(place, 1, falling, flux)
        return Joined(upward, downward, flux, self.algebra.info, self.residual())

    def known(self, stack: Stack | None) -> Stack:
        """What is there."""
        assert stack is not None
        return stack

    def bring_again(self, place: int) -> None:
        """A single slab is there already."""
        if self.places > 1:
            self.bring(place)

    def pass_on(
        self, place: int, OI: Stack, running: Stack | None, through: Stack | None, turned: Stack | None
    ) -> Stack:
        """direct running + T_ON through + R_ON turned + OI of the attenuated beam."""
        out = new_stack(self.session, self.count, self.sizes.o, self.sizes.r)
        self.fade(place, OI, out, None if running is None else self.t.OO, running)
        if through is not None:
            self.product(self.t.ON, through, out, beta=1.0)
        if turned is not None:
            self.product(self.r.ON, turned, out, beta=1.0)
        return out

    def put(self, place: int, running: Stack | None, out: Any) -> None:
        """What leaves at an interface goes to the levels that lie there."""
        for level in np.flatnonzero(self.piles.interface == place) if running is not None else ():
            assert running is not None
            shape = (np.int32(k) for k in (self.sizes.r, self.sizes.o, self.piles.interface.size, level))
            self.session.launch("put_level", (self.sizes.r, self.count), *shape, *running.place, out, self.items)

    def put_flux(self, place: int, downward: int, going: Stack | None, out: Any) -> None:
        """The flux of order 0 at the levels that lie at an interface."""
        if self.turned is None or going is None:
            return
        size = np.float64(np.sqrt((self.frame.flux**2).sum()))
        for level in np.flatnonzero(self.piles.interface == place):
            shape = (
                np.int32(k) for k in (self.sizes.r, self.piles.interface.size, level, downward, axis_of(self.sizes))
            )
            arguments = *shape, size, *going.place, out, self.turned
            self.session.launch("put_flux", (self.sizes.r, self.turned.size), *arguments)


def join_slabs(
    session: Session,
    crew: Crew,
    *,
    orders: IntArray,
    conserving: bool,
    slabs: IntArray,
    above: Array,
    nodes: Array,
    weights: Array,
    mu0: Array,
    n_out: int,
    R: Array,
    T: Array,
    lost: Array,
    base_row: IntArray,
    base: Array,
    base_source: Array,
    base_out: Array,
    interface: IntArray,
    up: Array,
    down: Array,
    flux: Array,
    residual: Array,
    info: IntArray,
) -> None:
    """`_core.join_slabs` on a device: the same arrays."""
    start = time.perf_counter()
    stokes = up.shape[3] // n_out
    n_col = up.shape[2] // mu0.size
    frame = Frame(nodes, weights, mu0, np.zeros((n_col, stokes)), np.ones(n_out))
    turned = (orders == 0) & conserving
    dark = not (base_row >= 0).any() or not any(a.any() for a in (base, base_source, base_out))
    ground = None if dark else ground_of(frame, turned, base_row, base, base_source, base_out)
    slab = (np.arange(orders.size)[:, None] * R.shape[1] + slabs).astype(np.int32)
    depths = np.broadcast_to(above, (orders.size, above.size))
    with session.lock:
        reflected, through = (extended_of(session, frame, a.reshape(-1, a.shape[2])) for a in (R, T))
        uploaded = session.upload(lost.reshape(-1, lost.shape[2]))
        piles = Piles(slab, depths, turned, interface, ground)
        found = Joining(session, frame, piles, reflected, through, uploaded).run(crew.stop)
        info[:] = session.download(found.info)
        if not crew.stop[0]:
            up[:], down[:], flux[:] = (session.download(a) for a in (found.up, found.down, found.flux))
    residual[:] = found.residual
    crew.seconds[0] += time.perf_counter() - start


def extended_of(session: Session, frame: Frame, rows: Array) -> Extended:
    """Extended matrices from (item, extended size): N, NI, ON, OI, OO, II one behind the other, as `_core` has them."""
    s, count = frame.sizes, rows.shape[0]
    counts = s.n * s.n, s.r * s.n, s.n * s.o, s.r * s.o, s.o, s.r
    N, NI, ON, OI, OO, II = np.split(rows, np.cumsum(counts)[:-1], axis=1)
    whole = np.zeros((count, s.columns, s.ld))
    whole[:, : s.n, : s.n], whole[:, s.n :, : s.n] = N.reshape(count, s.n, s.n), NI.reshape(count, s.r, s.n)
    whole[:, : s.n, s.p : s.p + s.o] = ON.reshape(count, s.n, s.o)
    whole[:, s.n :, s.p : s.p + s.o] = OI.reshape(count, s.r, s.o)
    return Extended(s, session.upload(whole), session.upload(OO), session.upload(II))
