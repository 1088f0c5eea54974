"""The caller's memory as the device's: what a processor need not copy."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from vrte.basics.arrays import Array
from vrte.cl.session import Session


@contextmanager
def lent(session: Session, values: Array, written: bool = True) -> Iterator[Any]:
    """The caller's own memory as a buffer; what kernels have ``written`` to it is seen when the block is left."""
    import pyopencl

    flags = pyopencl.mem_flags
    access = flags.READ_WRITE if written else flags.READ_ONLY
    buffer = pyopencl.Buffer(session.context, access | flags.USE_HOST_PTR, hostbuf=values)
    yield buffer
    if not written:
        return
    seen, _ = pyopencl.enqueue_map_buffer(session.queue, buffer, pyopencl.map_flags.READ, 0, values.shape, values.dtype)
    seen.base.release(session.queue)
    session.finish()
