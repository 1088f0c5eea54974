"""A device at work: its queue, its compiled kernels, its memory."""

import math
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from operator import mul
from types import MappingProxyType
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import DeviceError
from vrte.cl.building import Kernels, arrange, build_kernels

SHARED = "complexes", "paths", "wigner", "series", "steps", "doubling"  # of core/kernels/; then the kernels
KERNELS = "products", "inverse", "extended", "doubling", "assembly", "invariance", "joining", "sums"
IN_DOUBLES = "cl/scattering.cl", "cl/reconstruction.cl"  # left out of a program in single precision
SOURCES = (
    "core/constants.h",
    "cl/common.cl",
    *(f"core/kernels/{name}.h" for name in SHARED),
    *(f"cl/{name}.cl" for name in KERNELS),
    *IN_DOUBLES,
)
SMALL, MOST_CONSTANTS = 1 << 14, 4096  # bytes of an array that is kept; how many of them
OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable")
REALS = {"double": np.dtype(np.float64), "single": np.dtype(np.float32)}  # what kernels compute with, by precision
OPTIONS_OF = {"double": OPTIONS, "single": (*OPTIONS, "-D", "SINGLE", "-cl-single-precision-constant")}
LANES = 64  # work-items that share a piece of work on anything but a processor, where it is 1
FORKED = (
    "this process was forked from one that had used OpenCL, whose threads it does not have: start processes by "
    'multiprocessing.get_context("spawn"), or use OpenCL after the fork only'
)


@dataclass
class Traffic:
    """What went between the host and a device: ``launches`` of kernels, ``fills`` of arrays with zeros, ``reads`` that
    the host waited for, other ``waits`` (for large arrays on their way up, and for the queue to be empty), bytes."""

    launches: int = 0
    fills: int = 0
    reads: int = 0
    waits: int = 0
    bytes_up: int = 0
    bytes_down: int = 0

    def since(self, before: "Traffic") -> "Traffic":
        """What came after that."""
        return Traffic(*(now - then for now, then in zip(vars(self).values(), vars(before).values(), strict=True)))


@dataclass(frozen=True, eq=False)
class DeviceArray:
    """Numbers on a device, row by row in the memory ``data``. Making a pyopencl array takes forty microseconds."""

    data: Any
    shape: tuple[int, ...]
    dtype: Any

    @property
    def place(self) -> tuple[Any, ...]:
        """The memory that it lies in, as a kernel takes it."""
        return (self.data,)

    @property
    def size(self) -> int:
        """How many."""
        return math.prod(self.shape)

    @property
    def nbytes(self) -> int:
        """Of all."""
        return self.size * self.dtype.itemsize

    def reshape(self, shape: tuple[int, ...]) -> "DeviceArray":
        """The same numbers in another shape."""
        assert math.prod(shape) == self.size
        return replace(self, shape=shape)


@dataclass(eq=False)
class Session:
    """context, queue and kernels (by name) of one device; ``memory``: what was freed is kept for the next array;
    ``lock``: held during a solve, because a kernel's arguments belong to it. ``lanes``: work-items of a work-group,
    which share a piece of work. ``precision``: "double" or "single"; numbers with a fraction go up as what the kernels
    compute with, and come down as doubles; ``room``: bytes that matrices take at most, though there be more;
    ``beside``: sessions on the same queue and memory, by precision."""

    context: Any
    queue: Any
    kernels: Kernels
    memory: Any
    lanes: int = 1
    lock: threading.RLock = field(default_factory=threading.RLock)
    process: int = field(default_factory=os.getpid)
    constants: dict[Any, Any] = field(default_factory=dict)
    precision: str = "double"
    traffic: Traffic = field(default_factory=Traffic)
    room: float = math.inf
    beside: "dict[str, Session]" = field(default_factory=dict)

    @property
    def real(self) -> Any:
        """The type of what its kernels compute with."""
        return REALS[self.precision]

    def in_precision(self, precision: str) -> "Session":
        """This session, or that on the same queue and memory whose kernels compute in another precision; they are
        compiled when it is first asked for."""
        self.beside.setdefault(self.precision, self)
        if precision not in self.beside:
            kernels = build_for(self.context, self.lanes, precision)
            self.beside[precision] = replace(self, kernels=kernels, constants={}, precision=precision)
        return self.beside[precision]

    def narrow(self, values: Any) -> Any:
        """An array as it goes up, row by row: doubles as what the kernels compute with."""
        array = np.asarray(values, order="C")
        if array.dtype != np.float64 or self.precision == "double":
            return array
        with np.errstate(over="ignore"):  # what has no end is infinite
            return array.astype(self.real)

    @property
    def device(self) -> Any:
        """The pyopencl device."""
        return self.queue.device

    @property
    def on_host(self) -> bool:
        """Whether the device is the processor itself, and its memory that of the machine."""
        import pyopencl

        return bool(self.device.type & pyopencl.device_type.CPU)

    def empty(self, shape: tuple[int, ...], dtype: Any = None) -> DeviceArray:
        """An array with nothing in it, of what the kernels compute with unless told otherwise."""
        self._check_process()
        kind = self.real if dtype is None else np.dtype(dtype)
        return DeviceArray(self.memory(max(math.prod(shape), 1) * kind.itemsize), tuple(shape), kind)

    def zeros(self, shape: tuple[int, ...], dtype: Any = None) -> DeviceArray:
        """An array of zeros."""
        import pyopencl

        made = self.empty(shape, dtype)
        if made.nbytes:
            self.traffic.fills += 1
            pyopencl.enqueue_fill_buffer(self.queue, made.data, np.zeros(1, made.dtype), 0, made.nbytes)
        return made

    def upload(self, values: Any) -> DeviceArray:
        """A copy of an array on the device."""
        import pyopencl

        array = self.narrow(values)
        if 0 < array.nbytes <= SMALL:
            self._check_process()
            self.traffic.bytes_up += array.nbytes
            flags = pyopencl.mem_flags.READ_WRITE | pyopencl.mem_flags.COPY_HOST_PTR
            return DeviceArray(pyopencl.Buffer(self.context, flags, hostbuf=array), array.shape, array.dtype)
        made = self.empty(array.shape, array.dtype)
        self.put(array, made)
        return made

    def put(self, values: Array, made: DeviceArray) -> None:
        """Copies an array to where it belongs on the device."""
        import pyopencl

        if made.nbytes:
            self.traffic.bytes_up += made.nbytes
            self.traffic.waits += 1
            pyopencl.enqueue_copy(self.queue, made.data, self.narrow(values))

    def constant(self, values: Any) -> DeviceArray:
        """A copy on the device that nobody writes to: where there is one of the same small array, that."""
        array = self.narrow(values)
        if array.nbytes > SMALL:
            return self.upload(array)
        key = array.dtype.str, array.shape, array.tobytes()
        if key not in self.constants:
            if len(self.constants) >= MOST_CONSTANTS:
                self.constants.clear()
            self.constants[key] = self.upload(array)
        return self.constants[key]

    def download(self, values: DeviceArray) -> Any:
        """A copy of the device's array, in doubles; waits for whatever it comes from."""
        return self.download_all([values])[0]

    def download_all(self, arrays: Sequence[DeviceArray]) -> list[Any]:
        """Copies of arrays of the device, in doubles; waits once, for the last."""
        import pyopencl

        self._check_process()
        found = [np.empty(each.shape, each.dtype) for each in arrays]
        full = [(copy, each) for copy, each in zip(found, arrays, strict=True) if copy.nbytes]
        coming = [pyopencl.enqueue_copy(self.queue, copy, each.data, is_blocking=False) for copy, each in full]
        if coming:
            coming[-1].wait()
            self.traffic.reads += 1
            self.traffic.bytes_down += sum(copy.nbytes for copy, _ in full)
        return [copy.astype(np.float64) if copy.dtype == np.float32 else copy for copy in found]

    def launch(
        self, name: str, size: tuple[int, ...], known: Mapping[str, Any] = MappingProxyType({}), **given: Any
    ) -> None:
        """Enqueues a kernel with what is ``given``, or else ``known``, by the names that core/stages.toml declares:
        numbers, and arrays of the device or of the host, which go up. ``size``: how many pieces of work, each for a
        work-group as large as the kernel says, of one work-item where it says nothing.

        Raises TypeError and ValueError as `arrange` does."""
        if 0 in size:
            return
        self._check_process()
        arguments: list[Any] = []
        for value in arrange(name, known, given):
            placed = self.constant(value) if isinstance(value, np.ndarray) else value
            arguments += getattr(placed, "place", (placed,))
        self.traffic.launches += 1
        kernel = self.kernels[name]
        group = self.kernels.groups[name][: len(size)]
        kernel(self.queue, tuple(map(mul, size, group)), group, *arguments)

    def finish(self) -> None:
        """Waits until all that was enqueued is done."""
        self._check_process()
        self.traffic.waits += 1
        self.queue.finish()

    def _check_process(self) -> None:
        if os.getpid() != self.process:
            raise DeviceError(FORKED)


def read_sources(precision: str = "double") -> str:
    """What kernels share with the core, and all kernels of a precision, one file behind the other."""
    names = (name for name in SOURCES if precision == "double" or name not in IN_DOUBLES)
    return "\n".join(files("vrte").joinpath(name).read_text(encoding="utf-8") for name in names)


def open_session(device: Any, lanes: int | None = None, precision: str = "double") -> Session:
    """A session on a pyopencl device; ``lanes``: work-items of a work-group, a power of two, by default 1 on a
    processor, elsewhere `LANES` or as many as the device allows; ``precision``: "double" or "single".

    Raises DeviceError where the kernels cannot be built.
    """
    import pyopencl

    context = pyopencl.Context([device])
    if lanes is None:
        largest = 1 << (int(device.max_work_group_size).bit_length() - 1)
        lanes = 1 if device.type & pyopencl.device_type.CPU else min(LANES, largest)
    kernels, queue = build_for(context, lanes, precision), pyopencl.CommandQueue(context)
    return Session(context, queue, kernels, _make_memory_pool(queue), lanes, precision=precision)


def build_for(context: Any, lanes: int, precision: str) -> Kernels:
    """The kernels of a precision for work-groups of so many lanes, compiled."""
    options = *OPTIONS_OF[precision], "-D", f"LANES={lanes}"
    if lanes > 1 and "Portable Computing Language" in context.devices[0].platform.name:
        options = *options, "-cl-opt-disable"  # with them PoCL 3.0 gives wrong numbers where lists have barriers
    return build_kernels(context, read_sources(precision), options, REALS[precision])


def _make_memory_pool(queue: Any) -> Any:
    """Where arrays come from. On the processor, memory of the host: PoCL takes it at once and says where there is none;
    other memory it takes when a kernel first uses it, and ends the process where there is none."""
    import pyopencl
    from pyopencl.tools import ImmediateAllocator, MemoryPool

    flags = pyopencl.mem_flags.READ_WRITE
    if queue.device.type & pyopencl.device_type.CPU:
        flags |= pyopencl.mem_flags.ALLOC_HOST_PTR
    return MemoryPool(ImmediateAllocator(queue, flags))
