"""Stacks of matrices on a device: products and inverses of all of them in one call."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import DeviceError
from vrte.cl.session import Placed, Session

STRIP = 8  # rows of a product per step
PANEL = 16  # columns eliminated per step
GROUP, TILE = 16, 64  # of `product_gpu`: work-items, and elements of the product, along each side
TILED = {64: "product_gpu", 40: "product_gpu_40", 32: "product_gpu_32"}  # kernels by their tile
WORKERS = 256  # work-items that invert one matrix in `invert_gpu`
LOCAL_BESIDE = 16 * 8 + WORKERS * (8 + 4) + 256  # bytes of local memory beside the matrix, some to spare


def pad_to_strips(rows: int) -> int:
    """The next multiple of a strip.

    >>> pad_to_strips(81)
    88
    """
    return -(-rows // STRIP) * STRIP


@dataclass(frozen=True, eq=False)
class Stack(Placed):
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
        return self.data, self.first, self.ld, self.stride


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
    items: Any,
    a: Stack,
    b: Stack,
    c: Stack,
    alpha: float = 1.0,
    beta: float = 0.0,
    transposed: bool = False,
    part: int = -1,
    counts: Any = None,
    each: int = 1,
) -> None:
    """c = alpha a b + beta c, or a b^T, for the listed items (device array of int32); c is neither a nor b.

    With counts (item, 2) the sum is over E's columns (part 0), F's (1) or either's (2). ``each``: strips of 8 rows that
    a work-item makes of c on a processor; they share what is read of b.
    """
    data, first, ld, stride = b.place
    steps = (ld, 1) if transposed else (1, ld)
    rows = pad_to_strips(c.rows)
    sums = rows, each, c.columns, a.columns, alpha, beta, part, counts
    arguments = *sums, a, data, first, *steps, stride, c, items
    if session.form == "cpu":
        session.launch("product", (-(-rows // (STRIP * each)), 1, items.size), *arguments)
    else:
        tile = choose_tile(rows, c.columns)
        session.launch(TILED[tile], (-(-rows // tile), -(-c.columns // tile), items.size), *arguments)


def choose_tile(rows: int, columns: int) -> int:
    """The tile that pads a matrix least; of equals the largest, which reads least.

    >>> choose_tile(160, 160), choose_tile(96, 96), choose_tile(128, 64), choose_tile(88, 80)
    (40, 32, 64, 32)
    """
    return min(TILED, key=lambda tile: -(-rows // tile) * -(-columns // tile) * tile * tile)


def count_work_items(rows: int, columns: int) -> tuple[int, int]:
    """Work-items for the tiles of a matrix.

    >>> count_work_items(160, 80)
    (48, 32)
    """
    return -(-rows // TILE) * GROUP, -(-columns // TILE) * GROUP


def invert(session: Session, items: Any, m: Stack, rest: Any, pivots: Any, info: Any) -> None:
    """m <- m^-1 for the listed items; rest (item, 16 n), pivots (item, n) and info (item,) are scratch memory, info is
        1 where a matrix is singular.

    Raises DeviceError where a GPU's local memory does not hold one column.
    """
    arguments = m.rows, m, rest, pivots, info, items
    if session.form == "cpu":
        session.launch("invert", (items.size,), *arguments)
    elif m.rows:
        width = choose_panel_width(m.rows, session.device.local_mem_size)
        panel = session.local_memory(8 * m.rows * width)
        session.launch("invert_gpu", (WORKERS * items.size,), *arguments, width, panel, group=(WORKERS,))


def choose_panel_width(rows: int, local_bytes: int) -> int:
    """Columns of ``rows`` doubles that local memory holds beside what else `invert_gpu` keeps there.

    >>> choose_panel_width(160, 48 << 10), choose_panel_width(640, 48 << 10), choose_panel_width(3000, 48 << 10)
    (16, 8, 1)
    """
    columns = (local_bytes - LOCAL_BESIDE) // (8 * rows)
    if columns < 1:
        raise DeviceError(
            f"matrices of {rows} rows are too large for the local memory of this OpenCL device ({local_bytes} bytes)"
        )
    return min(PANEL, int(columns))
