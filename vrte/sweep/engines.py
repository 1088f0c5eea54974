"""The engines of a sweep: each yields, in any order, the number of scenes of each piece of work that is finished."""

import atexit
import queue
import threading
from collections.abc import Iterable, Iterator

import numpy as np

from vrte.basics.running import PATIENCE, wait_for
from vrte.calls.batch import Share, share_cores
from vrte.sweep.chunks import Job, make_processor_solver, perform
from vrte.sweep.store import Work

ENGINES = ("threads", "dask", "opencl")


def perform_on_threads(work: Work, jobs: Iterable[Job], count: int, cores: int) -> Iterator[int]:
    """Does ``count`` jobs on so many cores of this process, each thread one after another; a scene begun when few
    threads are left gets several cores, for its Fourier orders. An interrupt stops the compiled loops: unfinished
    chunks are lost."""
    workers = max(1, min(cores, count))
    stop = np.zeros(1, np.int32)
    busy = [workers]
    results: queue.SimpleQueue[int | BaseException | None] = queue.SimpleQueue()
    waiting, lock = iter(jobs), threading.Lock()
    all_left = threading.Event()
    solve = make_processor_solver(lambda: max(1, cores // max(1, busy[0])), stop)

    def take_job() -> Job | None:
        with lock:
            return None if stop[0] else next(waiting, None)

    def run_worker() -> None:
        try:
            with share_cores(Share(1, stop)):
                while (job := take_job()) is not None:
                    results.put(perform(work, job, solve))
        except BaseException as error:
            results.put(error)
        finally:
            with lock:
                busy[0] -= 1
                if not busy[0]:
                    all_left.set()
            results.put(None)

    for index in range(workers):
        threading.Thread(target=run_worker, name=f"vrte-sweep-{index}", daemon=True).start()
    try:
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
    except BaseException:
        stop[0] = 1
        if not wait_for(all_left, PATIENCE):
            atexit.register(wait_for, all_left, 3600.0)
        raise
