"""Slabs joined by the star product, (2:8), and the field between them: core/joining.pxi for many at once."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.doubling import Frame, compute_householder_vector, upload_blocks
from vrte.cl.extended import Algebra, Extended, make_row_stack, take_row
from vrte.cl.matrices import Stack, make_stack, upload_stack
from vrte.cl.session import Reading, Session
from vrte.cl.stages import stand_in_for

MOST_KEPT = 1 << 23  # doubles kept of the slabs' matrices copied to every item
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
    """up, down (item, level, r, o), flux (item, level, 2, r) and info (item,) on the device; residual (item, place),
    yet to be read."""

    up: Any
    down: Any
    flux: Any
    info: Any
    residual: Reading


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


class Joining:
    """The work on one stack of stacks with as many places each."""

    def __init__(
        self, session: Session, frame: Frame, slab_stacks: SlabStacks, R: Extended, T: Extended, lost: Any
    ) -> None:
        self.session, self.frame, self.slab_stacks, self.R, self.T, self.lost = session, frame, slab_stacks, R, T, lost
        self.sizes = s = frame.sizes
        self.count, self.places = slab_stacks.slab.shape
        self.algebra = Algebra(session, s, self.count)
        self.all = np.ones(self.count, bool)
        self.kept = 2 * self.places * self.count * s.ld * s.columns <= MOST_KEPT
        self.brought: dict[int, tuple[Extended, Extended]] = {}
        self.r, self.t = self.algebra.new(), self.algebra.new()
        self.row, self.lost_here = (session.zeros((self.count, s.n)) for _ in range(2))
        self.rate_II = session.constant(np.repeat(1.0 / frame.mu0, frame.columns.shape[0]) if s.r else np.zeros(1))
        self.depths = [session.constant(np.ascontiguousarray(above)) for above in slab_stacks.above.T]
        self.missing: dict[int, tuple[Any, Any]] = {}
        ground = slab_stacks.ground
        start = np.zeros((self.count, s.n)) if ground is None else ground.absorbed
        if ground is None:
            start[:, s.axis] = 1.0
        self.absorbed = session.upload(start)
        self.below = None if ground is None else upload_stack(session, ground.matrix)
        self.out = None if ground is None else upload_stack(session, ground.out)
        self.vectors = self.beams(), self.beams()

    def square(self) -> Stack:
        """Zeros (n, n)."""
        return make_stack(self.session, self.count, self.sizes.n, self.sizes.n)

    def beams(self) -> Stack:
        """Zeros (n, r)."""
        return make_stack(self.session, self.count, self.sizes.n, self.sizes.r)

    def copy(self, a: Stack, out: Stack) -> None:
        """out = a."""
        self.algebra.blend(self.all, 1.0, a, out)

    def multiply(self, a: Stack, b: Stack, c: Stack, beta: float = 0.0, alpha: float = 1.0) -> None:
        """c = alpha a b + beta c."""
        self.algebra.multiply(self.all, a, b, c, alpha, beta)

    def decay(self, index: int, a: Stack, out: Stack, straight: Any = None, running: Stack | None = None) -> None:
        """out = what the beam, attenuated on its way to the interface, makes by `a`, and what went on straight."""
        before = out if running is None else running
        weak, each = (self.rate_II, 0) if straight is None else (straight, self.sizes.o)
        arguments = a.rows, self.rate_II, self.depths[index], a, running is not None, weak, each, before, out
        self.algebra.launch("decay", self.all, *arguments, columns=self.sizes.r)

    def bring(self, index: int) -> None:
        """R, T and lost of what lies there as r, t and lost_here; r and t are kept where there is room for them."""
        of = self.session.constant(np.ascontiguousarray(self.slab_stacks.slab[:, index]))
        if index in self.brought:
            self.r, self.t = self.brought[index]
        else:
            if self.kept:
                self.brought[index] = self.r, self.t = self.algebra.new(), self.algebra.new()
            for source, target in ((self.R, self.r), (self.T, self.t)):
                self.algebra.combine(self.all, 1.0, source, target, places=of)
        if self.slab_stacks.turned.any():
            self.algebra.blend(self.all, 1.0, make_row_stack(self.lost), make_row_stack(self.lost_here), places=of)

    def run(self, stop: IntArray) -> Joined:
        """From the base up, then from the top down, then out of the nodes."""
        found: list[tuple[Stack | None, Stack | None]] = []
        up: list[Stack | None] = [self.emitted_by_base()]
        for index in range(self.places - 1, -1, -1):
            self.bring(index)
            G, g, above = self.put_upon(index, up[0])
            found.insert(0, (G, g))
            up.insert(0, above)
            if stop[0]:
                break
        down: list[Stack | None] = [None]
        for index in range(self.places if not stop[0] else 0):
            self.bring_again(index)
            falling, rising = self.downward_sweep(index, down[-1], *found[index])
            down.append(falling)
            up[index + 1] = rising
        if stop[0]:
            return Joined(None, None, None, self.algebra.info, self.residual())
        return self.leave(up, down)

    def emitted_by_base(self) -> Stack | None:
        """The beam that the base sends back, None of a black one."""
        if self.slab_stacks.ground is None:
            return None
        source, out = upload_stack(self.session, self.slab_stacks.ground.source), self.beams()
        self.decay(self.places, source, out)
        return out

    def put_upon(self, index: int, up: Stack | None) -> tuple[Stack | None, Stack | None, Stack]:
        """Puts a slab upon what lies below: G = (1 - below R)^-1 below, g = (1 - below R)^-1 up, below <- R + T G T,
        and what comes up above it, emitted up + T (G emitted down + g)."""
        r, t, above = self.r, self.t, self.beams()
        self.decay(index, r.NI, above)
        if self.below is None:
            self.below = self.square()
            self.copy(r.N, self.below)
            self.flux_row_of(self.lost_here, self.absorbed)  # a black base absorbs all
            return None, None, above
        assert up is not None
        G, g = self.solve(index, up)
        GT = self.square()
        self.multiply(G, t.N, GT)
        self.absorb(GT)
        self.copy(r.N, self.below)
        self.multiply(t.N, GT, self.below, beta=1.0)
        emitted, through = self.vectors
        self.decay(index, t.NI, emitted)
        self.copy(g, through)
        self.multiply(G, emitted, through, beta=1.0)
        self.multiply(t.N, through, above, beta=1.0)
        return G, g, above

    def solve(self, index: int, up: Stack) -> tuple[Stack, Stack]:
        """(1 - below R)^-1 below and (1 - below R)^-1 up. In order 0 the flux's row, small where nothing absorbs, is
        summed from what is lost: lost + T's row + absorbed R."""
        s, algebra, below, turned = self.sizes, self.algebra, self.below, self.slab_stacks.turned
        assert below is not None
        M, known, G, g, vector, right = *(self.square() for _ in range(3)), self.beams(), self.beams(), below
        algebra.blend(self.all, 0.0, below, M, gamma=1.0)
        self.multiply(below, self.r.N, M, beta=1.0, alpha=-1.0)
        self.copy(up, vector)
        if turned.any():
            right = self.square()
            self.copy(below, right)
            self.add_lost_and_absorbed()
            self.flux_row_of(self.row, self.row)
            algebra.launch("put_flux_row", turned, s.n, s.r, s.axis, self.row, M, right, vector)
        self.copy(M, known)
        algebra.invert_stack(self.all, M)
        self.multiply(M, right, G)
        self.multiply(M, vector, g)
        size = algebra.largest(self.all, vector)
        self.multiply(known, g, vector, beta=1.0, alpha=-1.0)
        self.missing[index] = algebra.largest(self.all, vector), size
        return G, g

    def residual(self) -> Reading:
        """What each interface's system misses, relative, (item, place)."""
        arrays = [array for pair in self.missing.values() for array in pair]
        shape, indices, faintest = (self.count, self.places), list(self.missing), self.session.faintest
        return Reading(arrays, partial(find_relative_misses, shape, indices, faintest))

    def row_times(self, x: Any, M: Stack, out: Any, beta: float = 0.0) -> None:
        """out = x M + beta out, rows of order 0."""
        n, algebra = self.sizes.n, self.algebra
        algebra.launch("row_times", self.slab_stacks.turned, n, x, M, beta, out, columns=algebra.count_pieces(n))

    def flux_row_of(self, a: Any, out: Any) -> None:
        """out = a + T's row of the flux, rows of order 0."""
        flux_row = take_row(self.t.N, self.sizes.axis)
        self.algebra.blend(self.slab_stacks.turned, 1.0, make_row_stack(a), make_row_stack(out), 1.0, flux_row)

    def add_lost_and_absorbed(self) -> None:
        """row = lost + absorbed R, rows of order 0."""
        self.row_times(self.absorbed, self.r.N, self.row)
        row = make_row_stack(self.row)
        self.algebra.blend(self.slab_stacks.turned, 1.0, make_row_stack(self.lost_here), row, 1.0, row)

    def absorb(self, GT: Stack) -> None:
        """absorbed <- lost + (lost + absorbed R) G T + absorbed T."""
        if not self.slab_stacks.turned.any():
            return
        new = self.session.zeros((self.count, self.sizes.n))
        self.add_lost_and_absorbed()
        self.algebra.blend(self.slab_stacks.turned, 1.0, make_row_stack(self.lost_here), make_row_stack(new))
        self.row_times(self.row, GT, new, beta=1.0)
        self.row_times(self.absorbed, self.t.N, new, beta=1.0)
        self.absorbed = new

    def downward_sweep(
        self, index: int, down: Stack | None, G: Stack | None, g: Stack | None
    ) -> tuple[Stack, Stack | None]:
        """What falls at the bottom of a slab and what rises there: T down + emitted, then G falling + g, then R up on
        top of it."""
        falling = self.beams()
        self.decay(index, self.t.NI, falling)
        if down is not None:
            self.multiply(self.t.N, down, falling, beta=1.0)
        if G is None or g is None:
            return falling, None
        self.multiply(G, falling, g, beta=1.0)
        self.multiply(self.r.N, g, falling, beta=1.0)
        return falling, g

    def leave(self, up: list[Stack | None], down: list[Stack | None]) -> Joined:
        """The field off the nodes at every wanted interface, first up through the slabs, then down."""
        s, interface, zeros = self.sizes, self.slab_stacks.interface, self.session.zeros
        shape = self.count, interface.size, s.r, max(1, s.o)
        upward, downward, flux = zeros(shape), zeros(shape), zeros((*shape[:2], 2, s.r))
        running, falling = None, down[self.places]
        if self.out is not None and falling is not None:
            running = make_stack(self.session, self.count, s.o, s.r)
            self.multiply(self.out, falling, running)
        for index in range(self.places, -1, -1):
            self.put(index, running, upward)
            if index > 0 and (interface < index).any():
                self.bring_again(index - 1)
                running = self.pass_on(index - 1, self.r.OI, running, up[index], down[index - 1])
        running = None
        for index in range(self.places + 1):
            self.put(index, running, downward)
            if index < self.places and (interface > index).any():
                self.bring_again(index)
                running = self.pass_on(index, self.t.OI, running, down[index], up[index + 1])
        for index, pair in enumerate(zip(up, down, strict=True)):
            self.put_flux(index, pair, flux)
        return Joined(upward, downward, flux, self.algebra.info, self.residual())

    def bring_again(self, index: int) -> None:
        """A single slab is there already."""
        if self.places > 1:
            self.bring(index)

    def pass_on(
        self, index: int, OI: Stack, running: Stack | None, through: Stack | None, turned: Stack | None
    ) -> Stack:
        """direct running + T_ON through + R_ON turned + OI of the attenuated beam."""
        out = make_stack(self.session, self.count, self.sizes.o, self.sizes.r)
        self.decay(index, OI, out, None if running is None else self.t.OO, running)
        if through is not None:
            self.multiply(self.t.ON, through, out, beta=1.0)
        if turned is not None:
            self.multiply(self.r.ON, turned, out, beta=1.0)
        return out

    def put(self, index: int, running: Stack | None, out: Any) -> None:
        """What leaves at an interface goes to the levels (item, level, r, o) that lie there."""
        s = self.sizes
        for level in np.flatnonzero(self.slab_stacks.interface == index).tolist() if running is not None else ():
            assert running is not None
            each = s.r * s.o
            self.copy(running, Stack(out, s.o, s.r, s.o, self.slab_stacks.interface.size * each, level * each))

    def put_flux(self, index: int, going: tuple[Stack | None, Stack | None], out: Any) -> None:
        """The flux of order 0, up and down, at the levels (item, level, 2, r) that lie at an interface."""
        r, size = self.sizes.r, float(np.sqrt((self.frame.flux**2).sum()))
        for level in np.flatnonzero(self.slab_stacks.interface == index).tolist():
            for way, light in enumerate(going):
                if light is not None:
                    to = Stack(out, 1, r, 1, self.slab_stacks.interface.size * 2 * r, (2 * level + way) * r)
                    self.algebra.blend(self.slab_stacks.turned, -size, take_row(light, self.sizes.axis), to)


def find_relative_misses(shape: tuple[int, int], indices: list[int], faintest: float, *sizes: Array) -> Array:
    """(item, place) of what interfaces at some places miss and of their sizes, (item,) each in turn; 0 elsewhere."""
    found = np.zeros(shape)
    for index, missing, size in zip(indices, sizes[::2], sizes[1::2], strict=True):
        lit = size > faintest
        found[:, index] = np.where(lit, missing / np.where(lit, size, 1.0), 0.0)
    return found


@stand_in_for(_core.join_slabs)
def join_slabs(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills up, down, flux, residual and info."""
    orders, up, n_out, row = given.orders, given.up, given.n_out, given.base_row
    n_col, stokes = up.shape[2] // given.mu0.size, up.shape[3] // n_out
    frame = Frame(given.nodes, given.weights, given.mu0, np.zeros((n_col, stokes)), np.ones(n_out))
    turned = (orders == 0) & given.conserving
    base = given.base, given.base_source, given.base_out
    dark = not (row >= 0).any() or not any(a.any() for a in base)
    ground = None if dark else turn_ground(frame, turned, row, *base)
    slab = (np.arange(orders.size)[:, None] * given.R.shape[1] + given.slabs).astype(np.int32)
    depths = np.broadcast_to(given.above, (orders.size, given.above.size))
    R, T = (upload_blocks(session, frame.sizes, a.reshape(-1, a.shape[2])) for a in (given.R, given.T))
    lost = session.upload(given.lost.reshape(-1, given.lost.shape[2]))
    found = Joining(session, frame, SlabStacks(slab, depths, turned, given.interface, ground), R, T, lost).run(
        crew.stop
    )
    given.info[:] = session.download(found.info)
    if not crew.stop[0]:
        up[:], given.down[:], given.flux[:] = (session.download(a) for a in (found.up, found.down, found.flux))
    (given.residual[:],) = session.read([found.residual])
