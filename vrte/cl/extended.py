"""Matrices with their incident and outgoing directions, (p + o) rows and (n + r) columns: see doubling.cl."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.cl.matrices import PANEL, STRIP, Stack, invert, padded, product
from vrte.cl.session import Session

BoolArray = NDArray[np.bool_]
TANH, COMPLEMENT, FADE, NOTHING = 0, 1, 2, 3  # kinds of `go_straight`


@dataclass(frozen=True)
class Sizes:
    """n unknowns of a hemisphere, r incident columns, o outgoing rows, S Stokes parameters a direction."""

    n: int
    r: int
    o: int
    stokes: int

    @property
    def p(self) -> int:
        """Where the rows of the outgoing directions begin."""
        return padded(self.n)

    @property
    def ld(self) -> int:
        """Distance of two columns."""
        return padded(self.p + self.o)

    @property
    def columns(self) -> int:
        """Of N and NI together."""
        return self.n + self.r

    @property
    def stride(self) -> int:
        """Doubles of an item."""
        return self.ld * self.columns

    @property
    def arguments(self) -> tuple[Any, ...]:
        """As kernels take them."""
        return (*map(np.int32, (self.n, self.p, self.r, self.o, self.ld)), np.int64(self.stride))


@dataclass(frozen=True, eq=False)
class Extended:
    """A stack of such matrices: data, and OO (o,) and II (r,) of each item, or, ``shared``, the same for all."""

    sizes: Sizes
    data: Any
    OO: Any
    II: Any
    shared: bool = False

    @property
    def arguments(self) -> tuple[Any, ...]:
        """As kernels take them."""
        o, r = (0, 0) if self.shared else (self.sizes.o, self.sizes.r)
        return self.data, self.OO, np.int32(o), self.II, np.int32(r)

    def part(self, row: int, column: int, rows: int, columns: int) -> Stack:
        """A block of every matrix."""
        s = self.sizes
        return Stack(self.data, s.ld, s.columns, s.ld, s.stride).part(row, column, rows, columns)

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
    """What is done to extended matrices of one size: scratch memory for `items` of them, and lists of items."""

    def __init__(self, session: Session, sizes: Sizes, items: int) -> None:
        self.session, self.sizes, self.items = session, sizes, items
        self.rest = session.empty((items, PANEL * sizes.n))
        self.pivots = session.empty((items, sizes.n), np.int32)
        self.info = session.zeros((items,), np.int32)

    def new(self) -> Extended:
        """Zeros."""
        s, zeros = self.sizes, self.session.zeros
        straight = zeros((self.items, max(1, s.o))), zeros((self.items, max(1, s.r)))
        return Extended(s, zeros((self.items, max(1, s.columns), s.ld)), *straight)

    def where(self, chosen: BoolArray) -> Any:
        """The items chosen, (item,) of bool, as kernels take them."""
        return self.session.constant(np.flatnonzero(chosen).astype(np.int32))

    def columns_of(self, items: Any) -> tuple[int, int]:
        """The size of a launch over columns."""
        return self.sizes.columns, items.size

    def product(self, items: Any, alpha: float, a: Extended, b: Extended, c: Extended) -> None:
        """c = alpha a b; c is neither a nor b."""
        s = self.sizes
        arguments = (*s.arguments, np.float64(alpha), *a.arguments, *b.arguments, *c.arguments, items)
        if self.session.form == "cpu":
            self.session.launch("product_extended", (s.ld // STRIP, 1, items.size), *arguments)
            return
        left, right = a.part(0, 0, s.ld, s.n), b.part(0, 0, s.n, s.columns)
        product(self.session, items, left, right, c.part(0, 0, s.ld, s.columns), alpha)
        self.session.launch("add_straight", self.columns_of(items), *arguments)

    def combine(
        self,
        items: Any,
        alpha: float,
        a: Extended,
        c: Extended,
        beta: float = 0.0,
        b: Extended | None = None,
        gamma: float = 0.0,
        factor: Any = None,
    ) -> None:
        """c = factor alpha a + beta b + gamma 1; factor (item,) on the device."""
        other = a if b is None else b
        arguments = (
            *self.sizes.arguments,
            *(np.int32(factor is not None), a.OO if factor is None else factor, np.float64(alpha)),
            *a.arguments,
            np.float64(beta),
            *other.arguments,
            np.float64(gamma),
            *c.arguments,
            items,
        )
        self.session.launch("combine", self.columns_of(items), *arguments)

    def invert(self, items: Any, a: Extended, spare: Extended) -> None:
        """a <- a^-1."""
        s = self.sizes
        invert(self.session, items, a.N, self.rest, self.pivots, self.info)
        if s.o + s.r == 0:
            return
        self.session.launch(
            "prepare_inverse", self.columns_of(items), *s.arguments, *a.arguments, *spare.arguments, items
        )
        if s.o:
            product(self.session, items, spare.ON, a.N, a.ON)
        if s.r:
            whole = a.part(0, s.n, s.p + s.o, s.r)
            product(self.session, items, a.part(0, 0, s.p + s.o, s.n), spare.NI, whole, beta=1.0)
        each = np.int32(s.r), np.int32(s.o), np.int64(s.stride)
        self.session.launch("invert_straight", (items.size,), *each, *a.arguments, items)

    def go_straight(self, items: Any, kind: int, h: Any, rate: Extended, a: Extended) -> None:
        """OO and II of light that is not scattered, over h."""
        s = self.sizes
        each = np.int32(s.r), np.int32(s.o), np.int64(s.stride), np.int32(kind)
        self.session.launch("go_straight", (items.size,), *each, h, rate.OO, rate.II, *a.arguments, items)

    def largest(self, items: Any, a: Stack, sums: bool = False) -> Any:
        """Of a's elements, or of the sums over its columns, (item,) on the device."""
        sizes, found = self.session.empty((self.items, a.columns)), self.session.zeros((self.items,))
        rows, columns = np.int32(a.rows), np.int32(a.columns)
        self.session.launch(
            "column_sizes", (a.columns, items.size), rows, columns, np.int32(sums), *a.place, sizes, items
        )
        self.session.launch("largest_size", (items.size,), columns, sizes, found, items)
        return found

    def each_column(self, name: str, columns: int, items: Any, *arguments: Any) -> None:
        """A launch over columns."""
        self.session.launch(name, (columns, items.size), *arguments, items)

    def replace(self, chosen: BoolArray, old: Extended, new: Extended) -> tuple[Extended, Extended]:
        """`new` in the place of `old` for the items chosen, and what is free now: exchanged where all are chosen."""
        if chosen.all():
            return new, old
        self.combine(self.where(chosen), 1.0, new, old)
        return old, new
