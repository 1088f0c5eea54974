"""How a solve runs: threads, progress, and Ctrl-C."""

import atexit
import math
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

from vrte.arrays import whole
from vrte.discrete_ordinates.problem import Run

Result = TypeVar("Result")
BRIEF, BRIEF_ALONE = 3e7, 3e8  # operations of a request: a few milliseconds; hundredths of a second, on one thread
PATIENCE = 0.5  # seconds that an interrupted solve gets to stop by itself

Job = Callable[[], None]
_idle: "list[SimpleQueue[Job]]" = []  # threads that wait for work, each by its queue
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a child has none of its parent's threads


def usable_cpus() -> int:
    """The CPUs this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def new_run(threads: int | None, operations: float = math.inf) -> Run:
    """A run on `threads` threads, all usable CPUs for None; a brief one has no thread but the one it is called in."""
    count = usable_cpus() if threads is None else whole("threads", threads, 1, 4096)
    brief = operations < (BRIEF if count > 1 else BRIEF_ALONE)
    return Run(1 if brief else count, brief=brief)


def interruptible(run: Run, call: Callable[[], Result]) -> Result:
    """call() in another thread while this one waits, so that Ctrl-C reaches the compiled loops.

    The OpenMP threads belong to that thread, which is kept for the next call: to start them anew may take longer than a
    solve. A child forked later starts its own. A brief call goes without: its loops are over before anyone waits for
    them, and start no threads.
    """
    if run.brief:
        return call()
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

    in_thread(work)
    try:
        while not done.wait(0.2):
            pass
    except BaseException:
        run.stop[0] = 1
        if not wait_for(done, PATIENCE):
            # one large eigenproblem cannot be stopped: whoever asked goes on, only the end of the process waits for it
            atexit.register(wait_for, done, 3600.0)
        raise
    if "error" in box:
        raise box["error"]
    result: Result = box["result"]
    return result


def in_thread(job: Job) -> None:
    """Does the job in a thread that has nothing to do, or in a new one."""
    try:
        queue = _idle.pop()
    except IndexError:
        queue = SimpleQueue()
        threading.Thread(target=work_off, args=(queue,), name="vrte-solve", daemon=True).start()
    queue.put(job)


def work_off(queue: "SimpleQueue[Job]") -> None:
    """One job after another; between them the thread is idle and holds on to nothing."""
    while True:
        queue.get()()
        _idle.append(queue)


def wait_for(done: threading.Event, seconds: float) -> bool:
    """Whether the compiled loops are left within the time: a process that ends before them would crash in BLAS."""
    end = time.monotonic() + seconds
    while not done.is_set() and time.monotonic() < end:
        with suppress(KeyboardInterrupt, SystemExit):  # an impatient second signal
            done.wait(0.1)
    return done.is_set()
