"""Results on their way down from a device, while it goes on with the next ones."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from vrte.cl.session import DeviceArray, Session

Coming = Callable[[], AbstractContextManager[Any]]


def start_download(session: Session, values: DeviceArray, slot: int) -> Coming:
    """Starts a copy of the device's array to the host and returns what waits for it, as a context in which the numbers
    may be read. A GPU copies, on a queue of its own, to memory that is locked for that: one place a ``slot``, written
    over by the next copy there. A processor's memory is the host's already."""
    if session.form == "cpu":
        return lambda: read_in_place(session, values)
    import pyopencl

    queue, room = find_staging(session, values.nbytes, slot)
    done = pyopencl.enqueue_marker(session.queue)
    session.queue.flush()
    landed = pyopencl.enqueue_copy(queue, room[: values.nbytes], values.data, is_blocking=False, wait_for=[done])
    queue.flush()

    @contextmanager
    def wait() -> Iterator[Any]:
        landed.wait()
        session.count_read(values.nbytes)
        yield room[: values.nbytes].view(values.dtype).reshape(values.shape)

    return wait


@contextmanager
def read_in_place(session: Session, values: DeviceArray) -> Iterator[Any]:
    """The memory of an array of a processor's device, which need not be copied."""
    import pyopencl

    seen, _ = pyopencl.enqueue_map_buffer(
        session.queue, values.data, pyopencl.map_flags.READ, 0, values.shape, values.dtype
    )
    session.count_read(values.nbytes)
    yield seen
    seen.base.release(session.queue)


def find_staging(session: Session, size: int, slot: int) -> tuple[Any, Any]:
    """The queue for copies, and locked memory of the host for at least so many bytes, kept for the next time."""
    import pyopencl

    queue = session.remembered("copies", lambda: pyopencl.CommandQueue(session.context))
    size = 1 << max(12, (size - 1).bit_length())

    def lock() -> Any:
        flags, access = pyopencl.mem_flags, pyopencl.map_flags
        buffer = pyopencl.Buffer(session.context, flags.READ_WRITE | flags.ALLOC_HOST_PTR, size)
        mapped, _ = pyopencl.enqueue_map_buffer(queue, buffer, access.READ | access.WRITE, 0, (size,), "u1")
        return mapped

    return queue, session.remembered(("staging", slot, size), lock)
