"""Steps of many items in one launch: a list goes up to the device, and a crew of work-items an item goes through it.

A launch each would cost more than the work where matrices are small, or so many that every unit of the device has one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.cl.matrices import PANEL, WORKERS, choose_panel_width
from vrte.cl.rates import estimate_rate, name_architecture
from vrte.cl.session import DeviceArray, Session

KINDS = ("product", "straight", "combine", "invert", "prepare", "largest", "blend", "mirror", "go", "lead", "divide")
SIZE, OF_OPERANDS, OF_OPERAND = 40, 16, 8  # numbers of a step, those before its operands, those of each
TILES = 16 * (64 + 65)  # numbers of both factors of a product held in local memory
LAUNCH = {"cpu": 25e-6, "gpu": 20e-6}  # seconds per launch, host time included, by form of the kernels
RATE = {"cpu": 3.5e10, "gpu": 1e11}  # largest operations per second of a compute unit, by form of the kernels
SHARE = 0.4  # fraction of its peak rate in doubles that a GPU unit reaches
LONGEST = 0.2  # seconds of a launch at most, so that an interrupt is obeyed soon
LAUNCHES = 19  # launches of a doubling where each of its operations is a launch of its own


def is_quicker_fused(session: Session, items: int, work: float) -> bool:
    """Whether doublings with so many operations an item, inverses left out, take less time by one crew an item than by
    launches that all units share."""
    idle = -(-items // session.units) - items / session.units  # rounds of items that not all units have one of
    return bool(idle * work / find_rate(session) < LAUNCHES * LAUNCH[session.form])


def find_rate(session: Session) -> float:
    """Operations a second of a unit: few in doubles where graphics come first."""
    import pyopencl

    device, rate = session.device, RATE[session.form]
    if device.type & pyopencl.device_type.CPU or session.precision == "single":
        return rate
    clock = 1e6 * float(device.max_clock_frequency or 1000)
    return min(rate, SHARE * estimate_rate(name_architecture(device), "gpu", 1, clock))


class Memory:
    """One allocation of zeros on a device, of which arrays are parts."""

    def __init__(self, session: Session, size: int) -> None:
        self.session, self.used = session, 0
        self.whole = session.zeros((size // session.real.itemsize,))
        self.buffer = find_buffer(self.whole)

    @staticmethod
    def pad(session: Session, size: int) -> int:
        """Bytes of a part, up to where the next may begin."""
        grain = max(64, session.device.mem_base_addr_align // 8)
        return -(-max(size, 1) // grain) * grain

    def take(self, shape: tuple[int, ...], dtype: Any = None) -> DeviceArray:
        """The part of this memory that nothing has yet."""
        import pyopencl

        kind = self.session.real if dtype is None else np.dtype(dtype)
        size, begin = self.pad(self.session, int(np.prod(shape)) * kind.itemsize), self.used
        self.used += size
        assert self.used <= self.whole.nbytes
        part = self.buffer.get_sub_region(begin, size, pyopencl.mem_flags.READ_WRITE)
        return DeviceArray(part, tuple(shape), kind, self.whole, begin // self.session.real.itemsize)

    def copy(self, values: DeviceArray) -> DeviceArray:
        """A part with the same numbers."""
        import pyopencl

        made = self.take(values.shape, values.dtype)
        pyopencl.enqueue_copy(self.session.queue, made.data, values.data, byte_count=values.nbytes)
        return made


def find_buffer(array: DeviceArray) -> Any:
    """The memory of an array as pyopencl divides it, which it does not do to memory of a pool."""
    import pyopencl

    return pyopencl.Buffer.from_int_ptr(array.data.int_ptr, True)


@dataclass(frozen=True, eq=False)
class Operand:
    """An array of a step as the kernel has it: memory, where item 0 begins, distances of columns and items; the same
    but the columns' of light that goes straight."""

    array: DeviceArray
    first: int
    ld: int
    stride: int
    straight: tuple[int, int, int, int] = (0, 0, 0, 0)


class Steps:
    """Of so many items, none of them carried out before something else is launched or read."""

    def __init__(self, session: Session, items: int, rows: int) -> None:
        self.session, self.items, self.rows = session, items, rows
        self.begin()

    def begin(self) -> None:
        """Starts a list without steps."""
        self.told: list[list[int]] = []
        self.shares: list[tuple[float, float, float]] = []
        self.chosen: dict[bytes, int] = {}
        self.numbers: dict[bytes, int] = {}
        self.length = self.work = 0.0
        self.memories: list[DeviceArray] = []

    def add(
        self,
        kind: str,
        chosen: NDArray[np.bool_],
        operands: Sequence[Operand | None],
        shares: tuple[float, float, float] = (1.0, 0.0, 0.0),
        shape: Sequence[int] = (0, 0, 0),
        sizes: Sequence[int] = (0, 0, 0, 0),
        way: int = 0,
        h: NDArray[np.float64] | None = None,
        rates: Sequence[NDArray[np.float64]] = (),
        work: float = 0.0,
    ) -> None:
        """A step for the items ``chosen``: a kind, operands a, b and c, alpha, beta and gamma, and what steps.cl calls
        so; ``work``: its operations."""
        if not chosen.any():
            return
        if not self.told:
            self.session.waiting.append(self.carry_out)
        flags = self.chosen.setdefault(chosen.tobytes(), len(self.chosen) * self.items)
        reported = [KINDS.index(kind), flags, *shape, *sizes, way]
        reported += [-1 if h is None else self.put(h), *(self.put(rate) for rate in rates)]
        reported += [0] * (OF_OPERANDS - len(reported))
        for operand in operands:
            reported += self.tell(operand)
        self.told.append(reported)
        self.shares.append(shares)
        self.work += work
        if self.work > LONGEST * find_rate(self.session):
            self.session.catch_up()
            if self.session.form == "cpu":
                self.session.finish()

    def put(self, values: NDArray[np.float64]) -> int:
        """Where these numbers lie among all."""
        key = np.ascontiguousarray(values, np.float64).tobytes()
        if key not in self.numbers:
            self.numbers[key] = int(self.length)
            self.length += len(key) // 8
        return self.numbers[key]

    def tell(self, operand: Operand | None) -> list[int]:
        """An operand's numbers; what is not there is whatever comes first in memory."""
        if operand is None:
            return [0] * OF_OPERAND
        memory = operand.array.memory
        if memory not in self.memories:
            self.memories.append(memory)
        return [self.memories.index(memory), operand.first, operand.ld, operand.stride, *operand.straight]

    def carry_out(self) -> None:
        """Launches all steps of the list."""
        session, reported = self.session, np.array(self.told, np.int64)
        chosen = np.concatenate([np.frombuffer(flags, bool) for flags in self.chosen]).astype(np.int32)
        numbers = np.concatenate([np.zeros(0), *(np.frombuffer(key) for key in self.numbers), np.zeros(1)])
        taking = np.flatnonzero(chosen.reshape(-1, self.items).any(axis=0))
        programs = np.stack(np.broadcast_arrays(0, len(reported), taking), axis=1).astype(np.int32)
        memories = [memory.data for memory in self.memories]
        width, shelf = 0, 1
        if session.form == "gpu":
            width = choose_panel_width(max(self.rows, 1), session.device.local_mem_size)
            shelf = max(TILES, PANEL + 2 * WORKERS + self.rows * width)
        arguments = (
            *(session.constant(each) for each in (programs, reported, np.array(self.shares), chosen, numbers)),
            *(
                memories[0],
                memories[-1],
                width,
                session.local_memory(shelf * session.real.itemsize),
            ),
        )
        self.begin()
        session.launch("carry_out_steps", (taking.size, 1), *arguments)
