"""What a solve asks of a device: every launch, read and copy of it, and the work of each kernel by a formula.

The formulas are those of matrices: a product of (n, k) and (k, m) has 2 n k m operations, and reads and writes each
matrix once; tests hold them to what the arrays of real launches weigh.
"""

import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.cl.building import KERNEL, LISTS
from vrte.cl.matrices import TILE
from vrte.cl.session import DeviceArray, Session, read_sources
from vrte.cl.steps import KINDS, OF_OPERAND, OF_OPERANDS, SIZE

REAL = 8  # bytes of a number
DEPTH = 16  # terms of a tile's sum between two reads of memory
UNITS = 132  # of an H100
ROWS_OF_CREW = 4  # columns that a crew has in hand at once
ROOT = 20.0  # operations that a root or a quotient counts for
MACRO = re.compile(r"\b([A-Z_]+)\b(?:\((\w+)\))?")


@dataclass(frozen=True)
class Work:
    """Of one launch: operations, bytes of the device's memory, bytes of local memory, and ``rounds``: how often a
    work-item waits for memory, or for the others of its group, one time after the other."""

    flops: float = 0.0
    bytes: float = 0.0
    local: float = 0.0
    rounds: float = 0.0


@dataclass(frozen=True, eq=False)
class Call:
    """A launch: its kernel's arguments by name, and its sizes."""

    session: Session
    given: Mapping[str, Any]
    size: tuple[int, ...]
    group: tuple[int, ...]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.given[name]
        except KeyError:
            raise AttributeError(name) from None

    def read(self, name: str) -> IntArray:
        """Whole numbers that lie on the device."""
        import pyopencl

        found = np.empty(self.given[name].size // 4, np.int32)
        pyopencl.enqueue_copy(self.session.queue, found, self.given[name])
        return found

    def read_rows(self, name: str, width: int) -> IntArray:
        """The same, so many in a row; the memory may be larger than what is in use."""
        found = self.read(name)
        return found[: found.size // width * width].reshape(-1, width)

    @property
    def pieces(self) -> tuple[int, ...]:
        """Work-groups in each dimension."""
        return tuple(size // each for size, each in zip(self.size, self.group, strict=True))

    @cached_property
    def items(self) -> IntArray:
        """Those listed."""
        count = self.pieces[-1]
        listed = self.read("items")[:count] if "items" in self.given else np.arange(count, dtype=np.int32)
        return listed

    def count_columns(self, part: int) -> Array:
        """E's columns (part 0), F's (1) or both (2) of each of these items."""
        pairs = self.read_rows("counts", 2)[self.items].astype(float)
        return pairs.sum(axis=1) if part == 2 else pairs[:, part]


def pad_to_tiles(length: Any, tile: int) -> Any:
    """What tiles make of rows or columns."""
    return np.ceil(np.asarray(length) / tile) * tile


def weigh_tiles(rows: Any, columns: Any, inner: Array, beside: float, tile: int = TILE, each: int = 4) -> Work:
    """A product (rows, inner) x (inner, columns) of each item by tiles; ``beside``: matrices (rows, columns) that are
    read or written. A work-item reads 2 ``each`` numbers of local memory for its each^2 multiply-adds."""
    flops = 2.0 * (pad_to_tiles(rows, tile) * pad_to_tiles(columns, tile) * np.ceil(inner / DEPTH) * DEPTH).sum()
    count = (rows * inner + inner * columns + beside * rows * columns).sum()
    return Work(flops, REAL * float(count), REAL / each * flops, float(np.ceil(inner / DEPTH).max(initial=0)))


def weigh_elements(count: float, touched: float = 2.0, flops: float = 1.0) -> Work:
    """So many elements, each with so many reads and writes, and operations."""
    return Work(flops * count, REAL * touched * count)


def weigh_product(tile: int, each: int = 4) -> Callable[[Call], Work]:
    """A product by tiles of that size, a work-item with ``each`` elements along either side."""

    def weigh(call: Call) -> Work:
        items = call.items
        inner = np.full(items.size, float(call.all)) if call.part < 0 else call.count_columns(call.part)
        return weigh_tiles(call.rows, call.columns, inner, 2.0 if call.beta else 1.0, tile, each)

    return weigh


def read_running(call: Call, state: str) -> tuple[Array, Array, Array]:
    """Of the items that have not settled: rows and columns of R, and columns of H, of which each item has its own."""
    running = np.flatnonzero(call.read(state)[: call.pieces[-1]] == 0)
    places = call.read_rows("places", 24).view(np.int64)  # of `Place` in invariance.cl, the last two
    rows, columns = places[running, 10:].astype(float).T
    return rows, columns, call.read_rows("counts_of", 2)[running].sum(axis=1).astype(float)


def weigh_step(call: Call) -> Work:
    """Columns of HC are made of two of H's; five matrices like R beside the product."""
    rows, columns, inner = read_running(call, "state")
    return weigh_tiles(rows, columns, inner, 5.0)


def weigh_renewal(call: Call) -> Work:
    """R is mixed of the last three steps as its tiles are read; written once."""
    rows, columns, inner = read_running(call, "state_before")
    made = weigh_tiles(rows, inner, np.zeros_like(rows) if call.step < 0 else columns, 2.0)
    mixed = float((3.0 * rows * columns).sum())
    return Work(made.flops + 5.0 * mixed, made.bytes + REAL * mixed, made.local, made.rounds)


def weigh_inverse(call: Call) -> Work:
    """A panel of 16 columns after the other; each column is searched, turned and eliminated between barriers."""
    return weigh_inverses(call.n, call.items.size)


def weigh_inverses(n: float, count: int) -> Work:
    """Inverses of so many matrices (n, n)."""
    panels = np.ceil(n / DEPTH)
    return Work(
        2.0 * n**3 * count, REAL * 2.0 * n**2 * panels * count, REAL * 1.25 * n**3 * count, 0.6 * n + 6 * panels
    )


def weigh_steps(call: Call) -> Work:
    """Every step of a list, of the items that take part; each row of a crew has a column. An item's rounds follow each
    other."""
    programs, told = call.read_rows("programs", 3), call.read_rows("all_told", 2 * SIZE).view(np.int64)
    chosen = call.read("chosen")
    total, rounds = Work(), np.zeros(len(programs))
    items = programs[: call.pieces[0], 2]
    for kind, flags, rows, columns, inner, n, _, r, *rest in told[: programs[0, 1]].tolist():
        taking = chosen[flags + items] > 0
        ld, count = rest[OF_OPERANDS - 8 + 2 * OF_OPERAND + 2], np.full(int(taking.sum()), 1.0)
        if KINDS[kind] == "product":
            one = weigh_tiles(rows, columns, inner * count, 1.0)
            waits = one.rounds * pad_to_tiles(rows, TILE) * pad_to_tiles(columns, TILE) / TILE**2
        elif KINDS[kind] == "invert":
            one = weigh_inverses(rows, count.size)
            waits = one.rounds
        else:
            shapes = {"blend": (columns, rows), "largest": (columns, rows), "mirror": (1, n), "go": (1, n)}
            wide, high = shapes.get(KINDS[kind], (n + r, ld))
            one, waits = weigh_elements(count.size * float(wide * high), 2.5, 2.0), wide / ROWS_OF_CREW
        rounds[: items.size][taking] += waits
        total = Work(total.flops + one.flops, total.bytes + one.bytes, total.local + one.local)
    return replace(total, rounds=float(rounds.max()))


def weigh_degrees(call: Call) -> Work:
    """Three recurrences in the degree, quotients in each; a column of phi for each Stokes parameter is written."""
    orders = call.read("order")[call.items]
    steps = float(np.maximum(call.n_term - orders, 0).sum() * call.n_all)
    return weigh_elements(steps, call.members.bit_count() ** 2, 20.0 + 3.0 * ROOT)


def weigh_scattering(call: Call) -> Work:
    """Six series, four angles at a time, the turns, the columns; a row of the result is read and written."""
    tables = int(call.read("first_table").max())
    pairs = float(call.n_here * call.n_mu)
    terms = float(np.mean(call.read("terms")[:tables])) if tables else 0.0
    each = 36.0 * terms + 150.0 + 10.0 * ROOT + 60.0 * call.n_col
    written = pairs * call.n_level * call.n_phi * 4.0 * call.n_place
    return Work(tables * pairs * 4.0 * np.ceil(call.n_angle / 4.0) * each, REAL * 2.0 * tables * written)


def weigh_orders(call: Call) -> Work:
    """Every group of four elements, every order and angle, of which each reads what its neighbours have in the cache,
    as fast as local memory; a row of the result is read and written."""
    orders = call.read_rows("shares", 4)[: call.size[2], 2].astype(float)
    rows = float(call.n_here * call.n_level * call.n_mu)
    steps = rows * call.n_group * orders.sum()
    written = 2.0 * rows * orders.size * call.n_phi * 4.0 * call.n_place
    count = REAL * (written + 4.0 * steps)
    return Work(12.0 * steps * call.n_angle, count, 8.0 * REAL * steps * call.n_angle)


def weigh_columns(touched: float, flops: float = 1.0, rows: str = "ld") -> Callable[[Call], Work]:
    """Elements of whole columns of every item, a work-item or group a column or a piece of it."""

    def weigh(call: Call) -> Work:
        return weigh_elements(float(call.items.size * count_columns_of(call) * call.given[rows]), touched, flops)

    return weigh


def count_columns_of(call: Call) -> float:
    """As many as an extended matrix has, or as were launched."""
    given = call.given
    return float(given["n"] + given["r"]) if {"n", "r", "p"} <= given.keys() else float(call.pieces[0])


def weigh_rows(touched: float, flops: float, *names: str) -> Callable[[Call], Work]:
    """Vectors of every item, as long as those arguments together."""
    return lambda call: weigh_elements(float(call.items.size * sum(call.given[name] for name in names)), touched, flops)


def weigh_results(call: Call) -> Work:
    """Rows off the nodes and on them for each beam and column, Stokes parameters summed."""
    count = float(call.items.size * (call.stokes * call.n_out + call.n) * call.size[1] * call.n_col)
    return weigh_elements(count, 1.0 + call.stokes, 2.0 * call.stokes)


def weigh_coefficients(call: Call) -> Work:
    return weigh_elements(float(call.count_columns(2).sum() * call.phi_ld), 2.0, 4.0)


def weigh_leaving(call: Call) -> Work:
    return weigh_elements(float(np.prod(call.pieces)) * call.n_mu * call.stokes, 2.0, 1.0)


def weigh_largest(call: Call) -> Work:
    return weigh_elements(float(np.prod(call.pieces)) * call.n_col * call.n_seen * call.stokes, 1.0, 2.0)


# One row a kernel of the form for a GPU.
FORMULAS: Mapping[str, Callable[[Call], Work]] = MappingProxyType(
    {
        "add_orders_gpu": weigh_orders,
        "add_rates": weigh_rows(4.0, 2.0 * ROOT, "n"),
        "add_scattering_gpu": weigh_scattering,
        "add_straight": weigh_columns(2.0, 2.0),
        "blend": weigh_columns(2.0, 2.0, "rows"),
        "carry_out_steps": weigh_steps,
        "clear_nodes": weigh_rows(3.0, 2.0 * ROOT, "n"),
        "column_sizes": weigh_columns(1.0, 2.0, "rows"),
        "combine": weigh_columns(2.5, 2.0),
        "conserve": weigh_rows(4.0, 4.0, "n", "r", "o"),
        "cosines_of_rows": lambda call: weigh_elements(float(call.n_mu * call.stokes), 2.0),
        "diagonal_gap": weigh_rows(1.0, 2.0, "n", "r", "o"),
        "divide_by_rates": weigh_columns(2.0, ROOT, "o"),
        "extend": weigh_columns(2.0, 2.0),
        "fade": weigh_columns(3.0, 3.0, "rows"),
        "go_straight": weigh_rows(2.0, 2.0 * ROOT, "r", "o"),
        "invariance_pairs": weigh_rows(20.0, 2.0 * ROOT, "n_term"),
        "invariance_rate": weigh_rows(6.0, 2.0 * ROOT, "n_term"),
        "invariance_renew_gpu": weigh_renewal,
        "invariance_results": weigh_results,
        "invariance_step_gpu": weigh_step,
        "invert_gpu": weigh_inverse,
        "largest_light": weigh_largest,
        "largest_size": weigh_rows(1.0, 1.0, "n"),
        "lead_straight": weigh_columns(2.0, 1.0),
        "leaving": weigh_leaving,
        "mirror_flux": weigh_rows(2.0, 1.0, "n"),
        "parity_columns": weigh_degrees,
        "prepare_inverse": weigh_columns(2.0, 1.0),
        "product_gpu": weigh_product(TILE),
        "product_gpu_32": weigh_product(32),
        "product_gpu_40": weigh_product(40, 5),
        "put_flux_row": weigh_rows(6.0, ROOT, "n"),
        "row_times": lambda call: weigh_elements(float(call.items.size * call.n**2), 1.0, 2.0),
        "times_coefficients": weigh_coefficients,
        "turn_columns": weigh_columns(0.75, 1.0, "n"),
        "turn_rows": weigh_columns(0.75, 1.0, "n"),
        "wigner_factors": weigh_rows(4.0, 8.0 * ROOT, "n_term"),
    }
)


def name_arguments(text: str) -> dict[str, list[str]]:
    """The names of the arguments of each kernel of a source, macros written out.

    >>> name_arguments("#define STACK(x) __global double* x, long x##_first\\n__kernel void fill(int n, STACK(a)) { }")
    {'fill': ['n', 'a', 'a_first']}
    """
    text = text.replace("\\\n", " ")
    lists = dict(LISTS.findall(text))

    def write_out(macro: re.Match[str]) -> str:
        written = lists.get(macro[1])
        if written is None:
            return macro[0]
        return re.sub(r"\bx\b", macro[2], written.replace("x##", f"{macro[2]}")) if macro[2] else written

    found = {}
    for name, arguments in KERNEL.findall(text):
        before = ""
        while before != arguments:
            before, arguments = arguments, MACRO.sub(write_out, arguments)
        found[name] = [re.findall(r"\w+", argument)[-1] for argument in arguments.split(",")]
    return found


@dataclass(frozen=True)
class Event:
    """What the host asked for: "launch" of a kernel ``name``, "read", "put" or "fill" of ``bytes``, "wait", a "call"
    that takes the device no time, or nothing ("host"); ``host``: seconds of the host's processor since the event
    before; ``groups`` of so many ``lanes``."""

    what: str
    host: float
    name: str = ""
    bytes: float = 0.0
    groups: float = 1.0
    lanes: int = 1
    work: Work = Work()


@dataclass(eq=False)
class Recorder(Session):
    """A session that puts down what it is asked for, and that says of itself that it is no processor; ``weighing``:
    the work of each launch is found too, for which memory is read between launches; otherwise it only seems to
    compute, which shows what the host does: what comes down is what came down when it was weighed, ``kept``."""

    events: list[Event] = field(default_factory=list)
    weighing: bool = True
    kept: list[Any] = field(default_factory=list)
    place: int = 0
    thread: int = 0
    last: float = 0.0

    @property
    def on_host(self) -> bool:
        """So that work is cut as for a GPU."""
        return False

    @property
    def units(self) -> int:
        """As many as a large GPU has."""
        return UNITS

    def note(self, what: str, **more: Any) -> None:
        """Puts an event down; the time of putting it down is nobody's."""
        if self.thread != threading.get_ident():  # a solve has its own, whose clock begins with it
            self.thread, self.last = threading.get_ident(), 0.0
        self.events.append(Event(what, time.thread_time() - self.last, **more))
        self.last = time.thread_time()

    def count_read(self, size: int) -> None:
        """Has waited for so many bytes."""
        super().count_read(size)
        self.note("read", bytes=size)

    def download_all(self, arrays: Sequence[DeviceArray]) -> list[Any]:
        """Waits for arrays: one read of all their bytes, and a call for each but the last, whose copy is waited for."""
        self.catch_up()
        for _ in arrays[1:]:
            self.note("call")
        if self.weighing:
            self.kept.append(super().download_all(arrays))
        else:
            self.place += 1
            self.count_read(sum(each.nbytes for each in arrays))
        return [copy.copy() for copy in self.kept[-1 if self.weighing else self.place - 1]]

    def finish(self) -> None:
        """Waits for all."""
        self.catch_up()
        if self.weighing:
            super().finish()
        self.note("wait")

    def put(self, values: Array, made: DeviceArray) -> None:
        """Counts an array that goes up to the device."""
        self.catch_up()
        if self.weighing:
            super().put(values, made)
        self.note("put", bytes=made.nbytes)

    def zeros(self, shape: tuple[int, ...], dtype: Any = None) -> DeviceArray:
        """Counts memory of the device that is filled with zeros."""
        made = super().zeros(shape, dtype) if self.weighing else self.empty(shape, dtype)
        self.note("fill", bytes=made.nbytes, groups=max(1.0, made.nbytes / 2048.0), lanes=64)
        return made


class Watched(dict[str, Any]):
    """A session's kernels, each of which says when it is launched."""

    def __init__(self, kernels: Any, names: Mapping[str, list[str]]) -> None:
        super().__init__()
        self.kernels, self.names = kernels, names
        self.recorder: Recorder | None = None

    @property
    def groups(self) -> Mapping[str, tuple[int, ...]]:
        """The size of the work-group that each asks for."""
        found: Mapping[str, tuple[int, ...]] = self.kernels.groups
        return found

    def __missing__(self, name: str) -> Any:
        kernel = self.kernels[name]

        def launch(queue: Any, size: tuple[int, ...], group: tuple[int, ...], *arguments: Any) -> None:
            recorder = self.recorder
            assert recorder is not None
            work = Work()
            if recorder.weighing:
                given = dict(zip(self.names[name], arguments, strict=True))
                work = FORMULAS[name](Call(recorder, given, size, group))
                recorder.last = time.thread_time()
                kernel(queue, size, group, *arguments)
            else:
                kernel.set_args(*arguments)
            lanes = int(np.prod(group))
            recorder.note("launch", name=name, groups=float(np.prod(size)) / lanes, lanes=lanes, work=work)

        self[name] = launch
        return launch


def make_recorder(opened: Session) -> Recorder:
    """A recorder that shares an open session's queue and kernels."""
    watched = Watched(opened.kernels, name_arguments(read_sources()))
    same: dict[str, Any] = {each.name: getattr(opened, each.name) for each in fields(Session)}
    made = Recorder(**{**same, "kernels": watched, "constants": {}, "beside": {}})
    watched.recorder = made
    return made


@contextmanager
def record_events(recorder: Recorder, weighing: bool = False) -> Iterator[list[Event]]:
    """The events of what is solved within it, one of the caller's own thread at the end; to be weighed first."""
    start = time.thread_time()
    recorder.events, recorder.weighing, recorder.place = [], weighing, 0
    if weighing:
        recorder.kept = []
    recorder.thread, recorder.last = threading.get_ident(), start
    try:
        yield recorder.events
    finally:
        recorder.weighing = True
    if recorder.thread != threading.get_ident():
        recorder.events.append(Event("host", time.thread_time() - start))
    else:
        recorder.note("host")
