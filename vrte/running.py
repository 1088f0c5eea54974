"""How a solve runs: threads, progress, and Ctrl-C."""

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from vrte.arrays import whole
from vrte.discrete_ordinates.problem import Run

Result = TypeVar("Result")


def usable_cpus() -> int:
    """The CPUs this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def new_run(threads: int | None) -> Run:
    """A run on `threads` threads, all usable CPUs for None."""
    return Run(usable_cpus() if threads is None else whole("threads", threads, 1, 4096))


def interruptible(run: Run, call: Callable[[], Result]) -> Result:
    """call() in a thread of its own while this one waits, so that Ctrl-C reaches the compiled loops.

    The OpenMP threads then belong to that short-lived thread, and a child forked later starts its own.
    """
    box: dict[str, Any] = {}
    done = (
        threading.Event()
    )  # not Thread.join: interrupted, it takes a running thread for a finished one (CPython 3.11)

    def work() -> None:
        try:
            box["result"] = call()
        except BaseException as error:
            box["error"] = error
        finally:
            done.set()

    threading.Thread(target=work, name="vrte-solve", daemon=True).start()
    try:
        while not done.wait(0.2):
            pass
    except BaseException:
        run.stop[0] = 1
        wait_for(done)
        raise
    if "error" in box:
        raise box["error"]
    result: Result = box["result"]
    return result


def wait_for(done: threading.Event) -> None:
    """Until the compiled loops are left: a process that ends before them would crash in BLAS."""
    while not done.is_set():
        with suppress(KeyboardInterrupt, SystemExit):  # an impatient second signal
            done.wait(0.1)
