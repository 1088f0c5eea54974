"""The engines of a sweep: each yields, in any order, the number of scenes of each piece of work that is finished.

Jobs of a Dask cluster go to its workers, who write their results to the folder of the sweep.
"""

import logging
import signal
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Any

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import MissingExtraError, SweepError, import_extra
from vrte.basics.running import PATIENCE
from vrte.calls.brdfs import Share, share_cores
from vrte.sweep.chunks import Job, make_processor_solver, open_work, perform
from vrte.sweep.store import Work

ENGINES = ("threads", "dask", "opencl")


def perform_on_threads(work: Work, jobs: Iterable[Job], count: int, cores: int) -> Iterator[int]:
    """Does ``count`` jobs on so many cores of this process, the last ones on several; an interrupt stops them."""
    workers, left, stop = max(1, min(cores, count)), count, np.zeros(1, np.int32)
    waiting, running = iter(jobs), set[Future[int]]()
    solve = make_processor_solver(lambda: max(1, cores // max(1, min(workers, left))), stop)

    def run(job: Job) -> int:
        with share_cores(Share(1, stop)):
            return perform(work, job, solve)

    pool = ThreadPoolExecutor(workers, "vrte-sweep")
    try:
        while True:
            running |= {pool.submit(run, job) for job in islice(waiting, workers - len(running))}
            if not running:
                break
            done, running = wait(running, 0.2, FIRST_COMPLETED)  # in short waits, so that Ctrl-C is heard
            left -= len(done)
            for each in done:
                yield each.result()
    except BaseException:
        stop[0] = 1
        pool.shutdown(wait=False, cancel_futures=True)
        wait(running, PATIENCE)
        raise
    pool.shutdown()


AHEAD = 2  # jobs for each thread of the cluster that are sent before they can begin
WORKERS_PATIENCE = 60.0  # seconds that a cluster gets for a worker to appear
WAITING = ("pending", "lost")  # a worker died with a result before it was fetched: the job is sent again
WITHOUT_WORKERS = 300.0  # seconds that a cluster may be without any before it is given up
LOST = "the Dask cluster was lost; started again, the sweep goes on"
OURS = {  # how a cluster of our own is to behave
    # nothing goes over HTTP, which knows no certificates
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    "distributed.scheduler.preload": [__name__],  # see `dask_setup`
    "distributed.worker.preload": [__name__],
    "distributed.scheduler.allowed-failures": 10,  # workers killed under one task: then it is the job's doing
    # a worker killed twice in so much time would otherwise not be started again
    "distributed.deploy.lost-worker-timeout": "365 days",
    "distributed.comm.timeouts.connect": WORKERS_PATIENCE,
}


def dask_setup(server: Any) -> None:
    """What Dask calls in scheduler and workers: closes their ports for HTTP, which know no certificates."""
    server.http_server.stop()


def perform_there(folder: str, stamp: str, job: Job) -> int:
    """Does one job in a worker process, which finds everything else in the folder."""
    with share_cores(Share(1)):
        return perform(open_work(folder, stamp), job, make_processor_solver())


def perform_on_cluster(
    work: Work, stages: Iterable[Iterable[Job]], scheduler: str | None, workers: int
) -> Iterator[int]:
    """Does the jobs, one stage after another, on the cluster at that address or on one of so many processes."""
    import_extra("distributed", "engine 'dask'", "dask")
    with start_own_cluster(work, workers) if scheduler is None else connect_client(scheduler) as client:
        try:
            client.wait_for_workers(1, timeout=WORKERS_PATIENCE)
        except TimeoutError as error:
            raise SweepError(f"the Dask scheduler had no worker for {WORKERS_PATIENCE:g} seconds") from error
        threads = max(1, sum(client.nthreads().values()))
        for stage in stages:
            yield from send_jobs(client, work, stage, AHEAD * threads)


@contextmanager
def start_own_cluster(work: Work, workers: int) -> Iterator[Any]:
    """A connection to so many processes of this machine, encrypted, on loopback. Raises SweepError."""
    import dask
    from distributed import Client, LocalCluster, Security

    try:
        security = Security.temporary()
    except ImportError as error:
        raise MissingExtraError("engine 'dask'", "dask") from error
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(OURS))
        loop = stack.enter_context(start_deaf_loop())
        try:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
                security=security,
                local_directory=str(work.folder / "dask"),
                memory_limit=None,
                silence_logs=logging.CRITICAL,
                loop=loop,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster), security=security))
        except (OSError, RuntimeError) as error:
            reason = put_in_one_line(str(error), 200)
            raise SweepError(
                f"the Dask cluster did not start, or a worker process ended before it was ready ({reason}); started "
                "again, the sweep goes on"
            ) from error
        yield client


@contextmanager
def start_deaf_loop() -> Iterator[Any]:
    """Dask's event loop in a thread without Ctrl-C, as all processes that it starts are from their first moment."""
    from multiprocessing import resource_tracker

    from distributed.utils import LoopRunner

    runner = LoopRunner()
    resource_tracker.ensure_running()  # where it starts by itself, it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        runner.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        yield runner.loop
    finally:
        runner.stop()


def connect_client(scheduler: str) -> Any:
    """A connection to a cluster. Raises SweepError."""
    from distributed import Client

    try:
        return Client(scheduler, timeout=WORKERS_PATIENCE)
    except (OSError, ValueError) as error:
        raise SweepError(f"no Dask scheduler answers at {scheduler}: {type(error).__name__}") from error


def send_jobs(client: Any, work: Work, jobs: Iterable[Job], most: int) -> Iterator[int]:
    """Does the jobs, no more than ``most`` of them known to the cluster at a time."""
    from distributed import KilledWorker
    from distributed import wait as wait_there

    waiting, lost = iter(jobs), []
    known: dict[Any, Job] = {}
    seen = time.monotonic()
    while True:
        for job in islice(waiting, most - len(known)):
            known[client.submit(perform_there, str(work.folder), work.stamp, job, pure=False)] = job
        if not known:
            break
        try:
            finished = wait_there(list(known), timeout=1.0, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            seen = find_last_seen(client, seen)
            continue
        seen = time.monotonic()
        for future in finished:
            if future.status in WAITING:
                continue
            job = known.pop(future)
            error = future.exception() if future.status == "error" else None
            if future.status == "finished":
                yield future.result()
            elif isinstance(error, KilledWorker):
                lost.append(job)
            else:
                raise error or SweepError(LOST)
    if lost:
        raise SweepError(
            f"{len(lost)} tasks brought their workers down again and again, the first of them that of chunk {lost[0]}; "
            "all others are done"
        )


def find_last_seen(client: Any, before: float) -> float:
    """When there was a worker for the last time. Raises SweepError where that is long ago, or the scheduler gone."""
    if client.status not in ("running", "connecting"):
        raise SweepError(LOST)
    if client.status == "running" and client.nthreads():
        return time.monotonic()
    if time.monotonic() - before > WITHOUT_WORKERS:
        raise SweepError("the Dask cluster has no workers any more; started again, the sweep goes on")
    return before
