"""Which inverse a device should take: matrices with spectra in [1, 2], as impedance doubling inverts them.

    python -m bench.inverses

A work-item a matrix (`invert`), a work-group a matrix (`invert_gpu`), Newton-Schulz steps by `product`, and LAPACK with
a thread a processor; milliseconds for all matrices of a call, the fastest of some rounds, all four in turn.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyopencl

from vrte.basics.arrays import Array
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.running import count_usable_cpus
from vrte.cl.device import session
from vrte.cl.matrices import Stack, download_stack, invert, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import FORMS, Session, open_session
from vrte.commands.device_rates import time_calls

SIZES = ((40, 256), (80, 64), (160, 24))  # rows, matrices in a call
STEPS = 5  # of Newton-Schulz from 2/3: 1/3 to the power of 32 is 5e-16


def matrices(rows: int, count: int) -> Array:
    """(item, row, row), symmetric, eigenvalues from 1 to 2."""
    vectors = np.linalg.qr(np.random.default_rng(rows).standard_normal((count, rows, rows)))[0]
    found: Array = vectors @ (np.linspace(1.0, 2.0, rows)[:, None] * vectors.transpose(0, 2, 1))
    return found


def by_elimination(opened: Session, stored: Array) -> tuple[Callable[[], None], Stack]:
    """Inverts a copy each time."""
    count, rows, _ = stored.shape
    source, made = upload_stack(opened, stored), make_stack(opened, count, rows, rows)
    scratch = opened.empty((count, 16 * rows)), opened.empty((count, rows), np.int32), opened.zeros((count,), np.int32)
    items = opened.upload(np.arange(count, dtype=np.int32))

    def call() -> None:
        pyopencl.enqueue_copy(opened.queue, made.data.data, source.data.data)
        invert(opened, items, made, *scratch)
        opened.finish()

    return call, made


def by_newton_schulz(opened: Session, stored: Array) -> tuple[Callable[[], None], Stack]:
    """X <- X + X (1 - L X), its first step written out: 4/3 - 4/9 L."""
    count, rows, _ = stored.shape
    one = np.broadcast_to(np.eye(rows), stored.shape)
    identity, begun, source = (
        upload_stack(opened, values) for values in (one, 4.0 / 3.0 * one - 4.0 / 9.0 * stored, stored)
    )
    found, other, rest = (make_stack(opened, count, rows, rows) for _ in range(3))
    items = opened.upload(np.arange(count, dtype=np.int32))

    def copy(target: Stack, origin: Stack) -> None:
        pyopencl.enqueue_copy(opened.queue, target.data.data, origin.data.data)

    def call() -> None:
        copy(found, begun)
        for step in range(1, STEPS):
            now, after = (found, other) if step % 2 else (other, found)
            copy(rest, identity)
            multiply_stacks(opened, items, source, now, rest, alpha=-1.0, beta=1.0)
            copy(after, now)
            multiply_stacks(opened, items, now, rest, after, beta=1.0)
        opened.finish()

    return call, found


def by_lapack(pool: ThreadPoolExecutor, threads: int, stored: Array) -> Callable[[], None]:
    """A thread a share of the matrices."""
    shares = [part for part in np.array_split(stored, threads) if len(part)]

    def call() -> None:
        list(pool.map(np.linalg.inv, shares))

    return call


def rows_of_table(threads: int) -> list[str]:
    """A line a size: milliseconds, and the largest error of the three on the device."""
    opened = session()
    forms = {form: opened if form == opened.form else open_session(opened.device, form) for form in FORMS}
    lines = []
    with ThreadPoolExecutor(threads) as pool, keep_to_one_thread():
        for rows, count in SIZES:
            stored = matrices(rows, count)
            made = [(forms[form], *by_elimination(forms[form], stored)) for form in FORMS]
            made.append((opened, *by_newton_schulz(opened, stored)))
            seconds = time_calls([*(call for _, call, _ in made), by_lapack(pool, threads, stored)])
            exact = np.linalg.inv(stored)
            errors = [np.abs(download_stack(where, stack) - exact).max() for where, _, stack in made]
            times = " | ".join(f"{1e3 * value:.1f}" for value in seconds)
            lines.append(f"| {rows} | {count} | {times} | {max(errors):.0e} |")
    return lines


def main() -> None:
    """Prints the table."""
    threads = count_usable_cpus()
    print(f"{session().device.name}, {threads} threads; milliseconds\n")
    print("| rows | matrices | work-item a matrix | work-group a matrix | Newton-Schulz | LAPACK | largest error |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(rows_of_table(threads)))


if __name__ == "__main__":
    main()
