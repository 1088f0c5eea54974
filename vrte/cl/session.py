"""A device at work: its queue, its compiled kernels, its memory."""

import threading
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

import numpy as np

from vrte.arrays import Array

SOURCES = ("common", "products", "inverse", "doubling", "joining")
OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable")


@dataclass(eq=False)
class Session:
    """context, queue, program and kernels (by name) of one device; ``memory``: what was
    freed is kept for the next array; ``lock``: held during a solve, because a kernel's
    arguments belong to it."""

    context: Any
    queue: Any
    program: Any
    kernels: dict[str, Any]
    memory: Any
    lock: threading.RLock = field(default_factory=threading.RLock)

    def empty(self, shape: tuple[int, ...], dtype: Any = np.float64) -> Any:
        """A pyopencl array, nothing in it."""
        import pyopencl.array

        return pyopencl.array.empty(self.queue, shape, dtype, allocator=self.memory)

    def zeros(self, shape: tuple[int, ...], dtype: Any = np.float64) -> Any:
        """A pyopencl array of zeros."""
        import pyopencl

        made = self.empty(shape, dtype)
        if made.nbytes:
            pyopencl.enqueue_fill_buffer(self.queue, made.data, np.zeros(1, dtype), 0, made.nbytes)
        return made

    def upload(self, values: Any) -> Any:
        """A copy of an array on the device."""
        import pyopencl.array

        return pyopencl.array.to_device(self.queue, np.ascontiguousarray(values), allocator=self.memory)

    def download(self, values: Any) -> Array:
        """A copy of the device's array; waits for whatever it comes from."""
        found: Array = values.get(self.queue)
        return found

    def launch(self, name: str, size: tuple[int, ...], *arguments: Any) -> None:
        """Enqueues a kernel: arrays, and numbers of the kernel's own types (np.int32, np.int64, np.float64)."""
        if 0 in size:
            return
        plain = [getattr(argument, "base_data", argument) for argument in arguments]
        self.kernels[name](self.queue, size, (1,) * len(size), *plain)

    def finish(self) -> None:
        """Waits until all that was enqueued is done."""
        self.queue.finish()


def sources() -> str:
    """All kernels, one file behind the other."""
    folder = files("vrte.cl")
    return "\n".join(folder.joinpath(f"{name}.cl").read_text(encoding="utf-8") for name in SOURCES)


def open_session(device: Any) -> Session:
    """A session on a pyopencl device."""
    import pyopencl
    from pyopencl.tools import ImmediateAllocator, MemoryPool

    context = pyopencl.Context([device])
    program = pyopencl.Program(context, sources()).build(list(OPTIONS))
    kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
    queue = pyopencl.CommandQueue(context)
    return Session(context, queue, program, kernels, MemoryPool(ImmediateAllocator(queue)))
