"""Matrices with their incident and outgoing directions, (p + o) rows and (n + r) columns: see doubling.cl."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.cl.matrices import PANEL, Stack, invert, multiply_stacks, pad_to_strips, stack_in
from vrte.cl.session import Placed, Session

BoolArray = NDArray[np.bool_]
TANH, COMPLEMENT, FADE, NOTHING = 0, 1, 2, 3  # kinds of `go_straight`


@dataclass(frozen=True)
class Sizes(Placed):
    """n unknowns of a hemisphere, r incident columns, o outgoing rows, S Stokes parameters a direction."""

    n: int
    r: int
    o: int
    stokes: int

    @property
    def p(self) -> int:
        """Where the rows of the outgoing directions begin."""
        return pad_to_strips(self.n)

    @property
    def ld(self) -> int:
        """Distance of two columns."""
        return pad_to_strips(self.p + self.o)

    @property
    def columns(self) -> int:
        """Of N and NI together."""
        return self.n + self.r

    @property
    def axis(self) -> int:
        """The axis that carries the flux once order 0 is turned: I of the last node."""
        return self.n - self.stokes

    @property
    def place(self) -> tuple[Any, ...]:
        """And the doubles of an item."""
        return self.n, self.p, self.r, self.o, self.ld, self.ld * self.columns


@dataclass(frozen=True, eq=False)
class Extended(Placed):
    """A stack of such matrices: data, and OO (o,) and II (r,) of each item, or, ``shared``, the same for all."""

    sizes: Sizes
    data: Any
    OO: Any
    II: Any
    shared: bool = False

    @property
    def place(self) -> tuple[Any, ...]:
        """Memory of each, and how far items' OO and II are apart."""
        o, r = (0, 0) if self.shared else (self.sizes.o, self.sizes.r)
        return self.data, self.OO, o, self.II, r

    def part(self, row: int, column: int, rows: int, columns: int) -> Stack:
        """A block of every matrix."""
        return stack_in(self.data, self.sizes.ld, self.sizes.columns).part(row, column, rows, columns)

    @property
    def N(self) -> Stack:
        """From nodes to nodes."""
        return self.part(0, 0, self.sizes.n, self.sizes.n)

    @property
    def NI(self) -> Stack:
        """From the incident directions to the nodes."""
        return self.part(0, self.sizes.n, self.sizes.n, self.sizes.r)

    @property
    def ON(self) -> Stack:
        """From the nodes to the outgoing directions."""
        return self.part(self.sizes.p, 0, self.sizes.o, self.sizes.n)

    @property
    def OI(self) -> Stack:
        """From the incident to the outgoing directions."""
        return self.part(self.sizes.p, self.sizes.n, self.sizes.o, self.sizes.r)


class Algebra:
    """What is done to stacks of ``items`` matrices, those ``chosen`` by (item,) of bool, and to extended ones of one
    size. ``rates``: 1/mu of outgoing and incident directions, of light that goes straight."""

    def __init__(
        self, session: Session, sizes: Sizes, items: int, rates: tuple[Array, Array] = (np.zeros(1), np.zeros(1))
    ) -> None:
        self.session, self.sizes, self.items = session, sizes, items
        self.rate_OO, self.rate_II = (session.constant(rate) for rate in rates)
        self.rest = session.empty((items, PANEL * sizes.n))
        self.pivots = session.empty((items, sizes.n), np.int32)
        self.info = session.zeros((items,), np.int32)

    def new(self) -> Extended:
        """Extended matrices of zeros."""
        s = self.sizes
        shapes = (max(1, s.columns), s.ld), (max(1, s.o),), (max(1, s.r),)
        whole, OO, II = (self.session.zeros((self.items, *shape)) for shape in shapes)
        return Extended(s, whole, OO, II)

    def with_rates(self, a: Extended) -> Extended:
        """The same with 1/mu as its light that goes straight."""
        return replace(a, OO=self.rate_OO, II=self.rate_II, shared=True)

    def where(self, chosen: BoolArray) -> Any:
        """The items chosen, as kernels take them."""
        return self.session.constant(np.flatnonzero(chosen).astype(np.int32))

    def launch(self, name: str, chosen: BoolArray, *arguments: Any, columns: int | None = None) -> None:
        """A kernel over items, or over ``columns`` of each."""
        items = self.where(chosen)
        self.session.launch(name, (items.size,) if columns is None else (columns, items.size), *arguments, items)

    def count_pieces(self, number: int) -> int:
        """Pieces of work, where each lane of one has one of a ``number``."""
        return -(-number // self.session.lanes)

    def multiply(self, chosen: BoolArray, a: Stack, b: Stack, c: Stack, alpha: float = 1.0, beta: float = 0.0) -> None:
        """c = alpha a b + beta c, stacks; c is neither a nor b."""
        multiply_stacks(self.session, self.where(chosen), a, b, c, alpha, beta)

    def blend(
        self,
        chosen: BoolArray,
        alpha: float,
        a: Stack,
        out: Stack,
        beta: float = 0.0,
        b: Stack | None = None,
        gamma: float = 0.0,
        places: Any = None,
    ) -> None:
        """out = alpha a + beta b + gamma 1, stacks; places (item,): of which item a is taken."""
        b = out if b is None else b
        self.launch("blend", chosen, out.rows, alpha, a, places, beta, b, gamma, out, columns=out.columns)

    def invert_stack(self, chosen: BoolArray, a: Stack) -> None:
        """a <- a^-1."""
        invert(self.session, self.where(chosen), a, self.rest, self.pivots, self.info)

    def product(
        self,
        chosen: BoolArray,
        alpha: float,
        a: Extended,
        b: Extended,
        c: Extended,
        gamma: float = 0.0,
        straight: tuple[int, Array] | None = None,
    ) -> None:
        """c = alpha a b + gamma 1; c is neither a nor b; ``straight``: kind and h (item,) of `go_straight`, where c's
        OO and II are to be those."""
        s = self.sizes
        whole = c.part(0, 0, s.ld, s.columns)
        self.multiply(chosen, a.part(0, 0, s.ld, s.n), b.part(0, 0, s.n, s.columns), whole, alpha)
        kind, h = straight or (NOTHING, None)
        each = None if h is None else self.session.constant(h)
        rates = self.rate_OO, self.rate_II
        self.launch("add_straight", chosen, s, alpha, a, b, c, gamma, kind, each, *rates, columns=s.columns)

    def combine(
        self,
        chosen: BoolArray,
        alpha: float,
        a: Extended,
        c: Extended,
        beta: float = 0.0,
        b: Extended | None = None,
        gamma: float = 0.0,
        factor: Array | None = None,
        places: Any = None,
    ) -> None:
        """c = factor alpha a + beta b + gamma 1; factor (item,); places (item,): of which item a is taken."""
        each, b = None if factor is None else self.session.constant(factor), c if b is None else b
        arguments = self.sizes, each, alpha, a, places, beta, b, gamma, c
        self.launch("combine", chosen, *arguments, columns=self.sizes.columns)

    def invert(self, chosen: BoolArray, a: Extended, spare: Extended) -> tuple[Extended, Extended]:
        """a^-1 in the place of a, with the OO and II of `spare`, and what is free now."""
        s = self.sizes
        self.invert_stack(chosen, a.N)
        if s.o + s.r == 0:
            return a, spare
        self.launch("prepare_inverse", chosen, s, a, spare, columns=s.columns)
        self.multiply(chosen, spare.ON, a.N, a.ON)
        whole = a.part(0, s.n, s.p + s.o, s.r)
        self.multiply(chosen, a.part(0, 0, s.p + s.o, s.n), spare.NI, whole, beta=1.0)
        return replace(a, OO=spare.OO, II=spare.II), replace(spare, OO=a.OO, II=a.II)

    def go_straight(self, chosen: BoolArray, kind: int, h: Array | None, a: Extended) -> None:
        """OO and II of light that is not scattered, over h."""
        each = self.rate_OO if h is None else self.session.constant(h)
        self.launch("go_straight", chosen, self.sizes, kind, each, self.rate_OO, self.rate_II, a)

    def mirror_flux(self, chosen: BoolArray, a: Extended) -> None:
        """Reciprocity of the flux's row and column of order 0."""
        s = self.sizes
        self.launch("mirror_flux", chosen, s, s.axis, 3 if s.stokes == 4 else -1, s.stokes, a.data)

    def largest(self, chosen: BoolArray, a: Stack, sums: bool = False) -> Any:
        """Of a's elements, or of the sums over its columns, (item,) on the device."""
        found = self.session.zeros((self.items,))
        self.launch("largest_size", chosen, a.rows, a.columns, sums, a, found)
        return found

    def replace(self, chosen: BoolArray, old: Extended, new: Extended) -> tuple[Extended, Extended]:
        """`new` in the place of `old` for the items chosen, and what is free now: exchanged where all are chosen."""
        if chosen.all():
            return new, old
        self.combine(chosen, 1.0, new, old)
        return old, new


def make_row_stack(data: Any) -> Stack:
    """Rows (item, n) on the device as a stack of matrices of one row."""
    n = data.shape[1]
    return Stack(data, 1, n, 1, n)


def take_row(a: Stack, row: int) -> Stack:
    """A row of every matrix, as the same."""
    return Stack(a.data, 1, a.columns, a.ld, a.stride, a.first + row)
