"""Threads of this process: each takes chunk after chunk, and together they use every core once."""

import atexit
import queue
import threading
from collections.abc import Iterable, Iterator

import numpy as np

from vrte.basics.running import PATIENCE, wait_for
from vrte.calls.side_by_side import Share, share_cores
from vrte.sweep.chunks import Task, make_processor_solver, perform
from vrte.sweep.store import Work


class Cores:
    """Cores shared by those who are at work: a scene begun when few are left gets several, for its Fourier orders."""

    def __init__(self, cores: int, workers: int) -> None:
        self.cores, self.busy = cores, workers
        self._lock = threading.Lock()

    def share(self) -> int:
        """How many threads a scene that begins now may use."""
        return max(1, self.cores // max(1, self.busy))

    def leave(self) -> None:
        """One worker finds nothing left to do."""
        with self._lock:
            self.busy -= 1


def perform_tasks(work: Work, tasks: Iterable[Task], count: int, cores: int) -> Iterator[int]:
    """Does ``count`` tasks on so many cores. An interrupt stops the compiled loops; unfinished chunks are lost."""
    workers = max(1, min(cores, count))
    stop = np.zeros(1, np.int32)
    shared = Cores(cores, workers)
    results: queue.SimpleQueue[int | BaseException | None] = queue.SimpleQueue()
    waiting, lock = iter(tasks), threading.Lock()
    left, all_left = [workers], threading.Event()
    solve = make_processor_solver(shared.share, stop)

    def labour() -> None:
        try:
            with share_cores(Share(1, stop)):
                while not stop[0] and (task := take_task(waiting, lock)) is not None:
                    results.put(perform(work, task, solve))
        except BaseException as error:
            results.put(error)
        finally:
            shared.leave()
            with lock:
                left[0] -= 1
                if not left[0]:
                    all_left.set()
            results.put(None)

    for place in range(workers):
        threading.Thread(target=labour, name=f"vrte-sweep-{place}", daemon=True).start()
    try:
        yield from gather_outcomes(results, workers)
    except BaseException:
        stop[0] = 1
        if not wait_for(all_left, PATIENCE):
            atexit.register(wait_for, all_left, 3600.0)
        raise


def take_task(waiting: Iterator[Task], lock: threading.Lock) -> Task | None:
    """The next task, or None."""
    with lock:
        return next(waiting, None)


def gather_outcomes(results: "queue.SimpleQueue[int | BaseException | None]", workers: int) -> Iterator[int]:
    """What the workers bring, until all have left; the first error is raised."""
    while workers:
        try:
            found = results.get(timeout=0.2)  # in short waits, so that Ctrl-C is heard
        except queue.Empty:
            continue
        if isinstance(found, BaseException):
            raise found
        if found is None:
            workers -= 1
        else:
            yield found
