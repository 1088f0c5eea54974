"""Stacks of matrices on a device: products and inverses of all of them in one call."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.cl.session import Session

STRIP = 8  # rows of a product per step
PANEL = 16  # columns eliminated per step
STRIPS = 10  # of a product that a single lane makes: they share what is read of the second factor
SHARED_STRIPS, SHARED_COLUMNS = 8, 48  # of a product that the lanes of a work-group share: 64 tiles


def pad_to_strips(rows: int) -> int:
    """The next multiple of a strip.

    >>> pad_to_strips(81)
    88
    """
    return -(-rows // STRIP) * STRIP


@dataclass(frozen=True, eq=False)
class Stack:
    """Matrices (rows, columns), one an item, column by column, ``ld`` doubles apart; a part of a larger stack begins at
    its double ``first``. What lies between rows and the next multiple of 8 is zero."""

    data: Any
    rows: int
    columns: int
    ld: int
    stride: int
    first: int = 0

    def part(self, row: int, column: int, rows: int, columns: int) -> "Stack":
        """A block of every matrix; ``row`` a multiple of 8."""
        assert row % STRIP == 0
        return Stack(self.data, rows, columns, self.ld, self.stride, self.first + column * self.ld + row)

    @property
    def place(self) -> tuple[Any, ...]:
        """Memory, first double, distance of columns and of items."""
        return self.data.data, self.first, self.ld, self.stride

    @property
    def shape(self) -> tuple[int, int, int]:
        """(item, column, row), without padding."""
        return self.data.shape[0], self.columns, self.rows


def stack_in(data: Any, rows: int, columns: int) -> Stack:
    """Matrices in device memory (item, columns, rows up to a multiple of 8)."""
    ld = data.shape[2]
    return Stack(data, rows, columns, ld, data.shape[1] * ld)


def make_stack(session: Session, items: int, rows: int, columns: int, bare: bool = False) -> Stack:
    """Matrices of zeros, or ``bare``, yet to be written, the rows up to the next multiple of 8 too."""
    make = session.empty if bare else session.zeros
    return stack_in(make((items, max(columns, 1), pad_to_strips(max(rows, 1)))), rows, columns)


def upload_stack(session: Session, matrices: Array) -> Stack:
    """Matrices (item, column, row) as `_core` has them."""
    items, columns, rows = matrices.shape
    room = np.zeros((items, max(columns, 1), pad_to_strips(max(rows, 1))))
    room[:, :columns, :rows] = matrices
    return stack_in(session.upload(room), rows, columns)


def download_stack(session: Session, stack: Stack) -> Array:
    """(item, column, row), of a stack that is no part."""
    room = session.download(stack.data)
    return np.ascontiguousarray(room.reshape(-1, stack.stride // stack.ld, stack.ld)[:, : stack.columns, : stack.rows])


def multiply_stacks(
    session: Session,
    a: Stack,
    b: Stack,
    c: Stack,
    alpha: float = 1.0,
    beta: float = 0.0,
    transposed: bool = False,
    part: int = -1,
    counts: Any = None,
) -> None:
    """c = alpha a b + beta c, or a b^T, of every item; c is neither a nor b.

    With counts (item, 2) the sum is over E's columns (part 0), F's (1) or either's (2).
    """
    padded = pad_to_strips(c.rows)
    each, wide = (STRIPS, max(c.columns, 1)) if session.lanes == 1 else (SHARED_STRIPS, SHARED_COLUMNS)
    session.launch(
        "product",
        (-(-padded // (STRIP * each)), -(-c.columns // wide), c.data.shape[0]),
        {"padded": padded, "each": each, "wide": wide, "alpha": alpha, "beta": beta, "part": part},
        counts=counts,
        inner=a.columns,
        transposed=transposed,
        A=a,
        B=b,
        C=c,
    )


def invert(session: Session, m: Stack) -> Any:
    """m <- m^-1 of every item; 1 where a matrix is singular, (item,) on the device."""
    count = m.data.shape[0]
    info = session.zeros((count,), np.int32)
    session.launch("invert", (count,), make_scratch(session, count, m.rows), M=m, info=info)
    return info


def make_scratch(session: Session, items: int, n: int) -> dict[str, Any]:
    """Memory that inverses of (n, n) take, as kernels name it."""
    return {"rest": session.empty((items, PANEL * n)), "pivots": session.empty((items, n), np.int32)}
