"""Small solves side by side: one a core, where each by itself would leave the others idle."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import IntArray
from vrte.basics.blas import keep_to_one_thread
from vrte.basics.running import Progress, Run, count_usable_cpus
from vrte.calls.alike import solve_batch, sort_into_batches
from vrte.calls.brdf import make_brdf
from vrte.calls.radiance import make_field
from vrte.methods import make_run, solve_request
from vrte.request.request import Request
from vrte.results.brdf import Brdf
from vrte.results.field import Field

Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class Share:
    """How many cores whoever calls may use, and the flag (1,) that stops all that goes on there."""

    cores: int
    stop: IntArray = field(default_factory=lambda: np.zeros(1, np.int32))


_share: ContextVar[Share | None] = ContextVar("cores", default=None)


@contextmanager
def share_cores(share: Share) -> Iterator[None]:
    """Within it, what runs side by side has so many cores: for one of several threads that are at work, whose time was
    predicted.

    >>> with share_cores(Share(1)):
    ...     run_side_by_side([lambda: 1, lambda: 2])
    [1, 2]
    """
    before = _share.set(share)
    try:
        yield
    finally:
        _share.reset(before)


def is_shared() -> bool:
    """Whether others are at work beside this thread."""
    return _share.get() is not None


def run_side_by_side(
    calls: Sequence[Callable[[], Made]], progress: Progress | None = None, workers: int | None = None, stop: Any = None
) -> list[Made]:
    """What the calls return, in their order; the first error in that order is raised, and what has not begun by then
    never does. ``progress`` gets how many are done; ``workers``: by default one a usable CPU; ``stop``, a flag (1,)
    that the calls look at, is set where this thread is interrupted.

    >>> run_side_by_side([lambda: 1, lambda: 2])
    [1, 2]
    """
    share = _share.get()

    def perform(call: Callable[[], Made]) -> Made:
        if share and share.stop[0]:
            raise KeyboardInterrupt
        return call()

    def collect(results: Iterable[Made]) -> list[Made]:
        found = []
        for result in results:
            found.append(result)
            if progress is not None:
                progress(len(found), len(calls))
        return found

    count = min(workers or (share.cores if share else count_usable_cpus()), len(calls))
    if count < 2:
        return collect(map(perform, calls))
    with keep_to_one_thread(), ThreadPoolExecutor(count, "vrte-side-by-side") as pool:
        futures = [pool.submit(perform, call) for call in calls]
        try:
            return collect(future.result() for future in futures)
        except BaseException:
            if stop is not None:
                stop[0] = 1
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def solve_side_by_side(requests: Sequence[Request], progress: Progress | None = None) -> list[Any]:
    """A Brdf or a Field, by their kind, of requests of one thread each that differ in their scenes alone, their methods
    named: scenes that are alike together; how long they take was said."""
    share = _share.get()
    stop = share.stop if share else np.zeros(1, np.int32)
    cores = share.cores if share else count_usable_cpus()
    found: dict[int, Any] = {}

    def start() -> Run:
        run = make_run(requests[0])
        run.stop, run.runtime_warned = stop, True
        return run

    def solve(indices: list[int]) -> dict[int, Any]:
        if len(indices) > 1:
            with keep_to_one_thread():
                return solve_batch(requests, indices, start())
        return {index: solve_one(requests[index], start()) for index in indices}

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(len(found), len(requests))

    def perform(jobs: list[list[int]]) -> None:
        calls = [partial(lambda job: found.update(solve(job)), job) for job in jobs]
        run_side_by_side(calls, report, stop=None if share else stop)  # a flag of several stops none of the others

    batches = [part for batch in sort_into_batches(requests) for part in split_among(batch, cores)]
    perform(batches)
    perform([[index] for index in range(len(requests)) if index not in found])
    return [found[index] for index in range(len(requests))]


def solve_one(request: Request, run: Run) -> Brdf | Field:
    """What a request of either kind asks."""
    mu, solution = solve_request(request, run)
    return make_brdf(request, solution) if request.kind == "brdf" else make_field(request, mu, solution)


def split_among(batch: list[int], cores: int) -> list[list[int]]:
    """A batch in as many parts as there are cores, each of two or more.

    >>> split_among([0, 1, 2, 3, 4], 2), split_among([0, 1, 2], 8)
    ([[0, 1, 2], [3, 4]], [[0, 1], [2]])
    """
    step = max(2, -(-len(batch) // cores))
    return [batch[first : first + step] for first in range(0, len(batch), step)]
