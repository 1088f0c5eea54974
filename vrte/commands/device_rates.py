"""OpenCL devices as a table, and what one of them computes in a second."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.blas import keep_to_one_thread
from vrte.cl.device import Device
from vrte.cl.matrices import make_stack, multiply_stacks, upload_stack
from vrte.cl.session import Session

SIZES = ((40, 512), (80, 256), (160, 64), (240, 32))  # rows and columns, matrices in one call
ROUNDS = 7  # of both in turn; the fastest of each counts
SECONDS = 0.03  # of one round, about
NONE: Mapping[int, str] = MappingProxyType({})


@dataclass(frozen=True)
class Rate:
    """Products of ``count`` matrices of ``rows`` rows and columns: 1e9 operations a second, on the device and by BLAS
    on as many threads as were asked for."""

    rows: int
    count: int
    device: float
    blas: float


@dataclass(frozen=True)
class Costs:
    """Seconds that a launch and a blocking read of eight bytes take; bytes a second of the device's memory, read and
    written, and of the way there."""

    launch: float
    read: float
    bandwidth: float
    link: float


def measure_costs(session: Session, megabytes: float = 64.0) -> Costs:
    """What a device takes beside its work.

    Raises DeviceError as whatever runs on a device does.
    """
    import pyopencl

    values = np.zeros(int(megabytes * 1e6 / 8.0))
    first, second, small = session.empty(values.shape), session.empty(values.shape), session.zeros((1,))
    stack = make_stack(session, 1, 8, 8)
    items = session.upload(np.zeros(1, np.int32))
    launches, reads = 100, 20

    def launch() -> None:
        for _ in range(launches):
            session.launch("add_rates", (1,), 0, 1, small, stack, stack, items)
        session.finish()

    def read() -> None:
        for _ in range(reads):
            session.download(small)

    def copy() -> None:
        pyopencl.enqueue_copy(session.queue, second.data, first.data, byte_count=values.nbytes)
        session.finish()

    def put() -> None:
        session.put(values, first)
        session.finish()

    with session.lock:
        took = time_calls((launch, read, copy, put))
    return Costs(took[0] / launches, took[1] / reads, 2.0 * values.nbytes / took[2], values.nbytes / took[3])


def describe_devices(
    found: Sequence[Device], taken: int | None, reason: str, complaints: Mapping[int, str] = NONE
) -> str:
    """A line a device, and which one is taken and why; complaints: of those that do not compute, by index.

    >>> cpu = Device("PoCL", "a processor", "cpu", True, 16 << 30, 4 << 30, 8, "3.0")
    >>> print(describe_devices([cpu], 0, "the only device"))
         device                                      kind         fp64    memory   largest  units  driver
     * 0 a processor                                 cpu          yes    17.2 GB    4.3 GB      8  3.0
         on PoCL
    <BLANKLINE>
      taken: 0, the only device
    """
    columns = f"{'memory':>10}{'largest':>10}{'units':>7}  driver"
    lines = [f"     {'device':44}{'kind':13}{'fp64':4}{columns}"]
    for index, device in enumerate(found):
        precision = "yes" if device.double_precision else "no"
        sizes = "".join(f"{size / 1e9:7.1f} GB" for size in (device.memory, device.largest))
        mark = "*" if index == taken else " "
        text = f"{device.name[:43]:44}{device.kind:13}{precision:4}{sizes}{device.units:7}  {device.driver}"
        lines.append(f" {mark}{index:2} {text}")
        lines.append(f"     on {device.platform}{describe_power(device)}")
        if complaints.get(index):
            lines.append(f"     never taken: {complaints[index]}")
    return "\n".join([*lines, "", f"  taken: {'none' if taken is None else taken}, {reason}"])


def describe_power(device: Device) -> str:
    """What graphics devices are chosen by."""
    if device.kind != "gpu":
        return ""
    memory = "the processor's memory" if device.shared else "memory of its own"
    doubles = f", about {device.rate / 1e9:.3g}e9 operations a second in doubles" if device.double_precision else ""
    return f"; {memory}{doubles}"


def measure_rates(
    session: Session, threads: int, told: Callable[[int, int], None] = lambda done, total: None
) -> list[Rate]:
    """Rates of products in double precision, the device and BLAS in turn.

    Raises DeviceError as whatever runs on a device does.
    """
    rates = []
    with ThreadPoolExecutor(threads) as pool, keep_to_one_thread(), session.lock:
        for done, (rows, count) in enumerate(SIZES):
            told(done, len(SIZES))
            rates.append(_measure_rate(session, pool, threads, rows, count))
    return rates


def _measure_rate(session: Session, pool: ThreadPoolExecutor, threads: int, rows: int, count: int) -> Rate:
    a, b = np.random.default_rng(0).random((2, count, rows, rows))
    c = np.empty_like(a)
    first, second, made = upload_stack(session, a), upload_stack(session, b), make_stack(session, count, rows, rows)
    items = session.upload(np.arange(count, dtype=np.int32))
    shares = [part for part in np.array_split(np.arange(count), threads) if part.size]

    def on_device() -> None:
        multiply_stacks(session, items, first, second, made)
        session.finish()

    def by_blas() -> None:
        list(pool.map(lambda part: _multiply_share(a, b, c, part[0], part[-1] + 1), shares))

    operations = 2.0 * rows**3 * count
    best = time_calls((on_device, by_blas))
    return Rate(rows, count, *(operations / 1e9 / seconds for seconds in best))


def _multiply_share(a: Array, b: Array, c: Array, first: int, last: int) -> None:
    """A thread's share, a matrix at a time."""
    for item in range(first, last):
        np.matmul(a[item], b[item], out=c[item])


def time_calls(calls: Sequence[Callable[[], None]]) -> list[float]:
    """Seconds of each call, the fastest of some rounds, all of them in turn; the first round warms up."""
    times: list[list[float]] = [[] for _ in calls]
    for round_ in range(ROUNDS):
        for call, seconds in zip(calls, times, strict=True):
            repeats = max(1, int(SECONDS / seconds[0])) if round_ else 1
            start = time.perf_counter()
            for _ in range(repeats):
                call()
            seconds.append((time.perf_counter() - start) / repeats)
    return [min(seconds[1:]) for seconds in times]


def describe_rates(rates: Sequence[Rate], threads: int) -> str:
    """A line a size.

    >>> print(describe_rates([Rate(160, 64, 90.0, 100.0)], 2))
      products in double precision, 1e9 operations a second
      size        matrices    device   BLAS, 2 threads   ratio
      160 x 160         64      90.0             100.0    0.90
    """
    title = f"BLAS, {threads} thread{'s' if threads > 1 else ''}"
    lines = [
        "  products in double precision, 1e9 operations a second",
        f"  size        matrices    device{title:>18}   ratio",
    ]
    for rate in rates:
        size = f"{rate.rows} x {rate.rows}"
        lines.append(f"  {size:12}{rate.count:8}{rate.device:10.1f}{rate.blas:18.1f}{rate.device / rate.blas:8.2f}")
    return "\n".join(lines)
