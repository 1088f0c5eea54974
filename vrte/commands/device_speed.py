"""How fast an OpenCL device is: products in double precision beside BLAS, and what it takes beside its work."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from vrte.basics.blas import keep_to_one_thread
from vrte.basics.running import Progress
from vrte.cl.matrices import make_stack, multiply_stacks, upload_stack
from vrte.cl.session import Session

SIZES = ((40, 512), (80, 256), (160, 64), (240, 32))  # rows and columns, matrices in one call
ROUNDS = 7  # of all calls in turn; the fastest of each counts
SECONDS = 0.03  # of one round, about


@dataclass(frozen=True)
class Rate:
    """Products of ``count`` matrices of ``rows`` rows and columns: 1e9 operations a second, on the device and by BLAS
    on as many threads as were asked for."""

    rows: int
    count: int
    device: float
    blas: float


def measure_rates(session: Session, threads: int, progress: Progress = lambda done, total: None) -> list[Rate]:
    """Rates of products in double precision, the device and BLAS in turn. Raises DeviceError."""
    rates = []
    with ThreadPoolExecutor(threads) as pool, keep_to_one_thread(), session.lock:
        for done, (rows, count) in enumerate(SIZES):
            progress(done, len(SIZES))
            seconds = time_calls(make_products(session, pool, threads, rows, count))
            rates.append(Rate(rows, count, *(2e-9 * rows**3 * count / each for each in seconds)))
    return rates


def make_products(
    session: Session, pool: ThreadPoolExecutor, threads: int, rows: int, count: int
) -> tuple[Callable[[], object], Callable[[], object]]:
    """Calls that multiply matrices of one size on the device, and by BLAS on threads."""
    a, b = np.random.default_rng(0).random((2, count, rows, rows))
    c, items = np.empty_like(a), session.upload(np.arange(count, dtype=np.int32))
    stacks = upload_stack(session, a), upload_stack(session, b), make_stack(session, count, rows, rows)
    ends = np.linspace(0, count, threads + 1).astype(int)
    parts = list(map(slice, ends[:-1], ends[1:]))

    def on_device() -> None:
        multiply_stacks(session, items, *stacks)
        session.finish()

    return on_device, lambda: list(pool.map(lambda part: np.matmul(a[part], b[part], out=c[part]), parts))


def time_calls(calls: Sequence[Callable[[], object]]) -> list[float]:
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
    lines = ["  products in double precision, 1e9 operations a second"]
    lines.append(f"  size        matrices    device{title:>18}   ratio")
    for rate in rates:
        size = f"{rate.rows} x {rate.rows}"
        lines.append(f"  {size:12}{rate.count:8}{rate.device:10.1f}{rate.blas:18.1f}{rate.device / rate.blas:8.2f}")
    return "\n".join(lines)


def measure_costs(session: Session, megabytes: float = 16.0) -> str:
    """Launches, reads and copies of a device, in words. Raises DeviceError."""
    import pyopencl

    values = np.zeros(int(megabytes * 1e6 / 8.0))
    first, second, small = session.empty(values.shape), session.empty(values.shape), session.zeros((1,))
    stack, items = make_stack(session, 1, 8, 8), session.upload(np.zeros(1, np.int32))

    def launch() -> None:
        for _ in range(100):
            session.launch("add_rates", (1,), 0, 1, small, stack, stack, items)
        session.finish()

    def copy() -> None:
        pyopencl.enqueue_copy(session.queue, second.data, first.data, byte_count=values.nbytes)
        session.finish()

    def put() -> None:
        session.put(values, first)
        session.finish()

    with session.lock:
        launched, was_read, copied, sent = time_calls((launch, lambda: session.download(small), copy, put))
    return (
        f"  a launch {1e4 * launched:.1f} us, a blocking read {1e6 * was_read:.1f} us, memory "
        f"{2e-9 * values.nbytes / copied:.0f} GB/s, to the device {1e-9 * values.nbytes / sent:.1f} GB/s"
    )
