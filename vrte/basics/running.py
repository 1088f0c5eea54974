"""How a solve runs: threads, progress, Ctrl-C, and one thread of BLAS inside it, whose parallel loops are our own.

Solves under way are counted for forks: a process that was forked while another thread of its parent was solving would
wait for ever for the locks of Python, BLAS and OpenMP that this thread held.
"""

import atexit
import ctypes
import math
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from vrte import _core
from vrte.basics import cost
from vrte.basics.arrays import Array, IntArray, check_whole, replace_unchecked
from vrte.basics.memory import find_group_cores

_lock = threading.Lock()
_before: list[tuple[Callable[[int], Any], int]] = []  # setters of threads of each BLAS, and how many it had
_state: dict[str, Any] = {"libraries": None, "inside": 0}
SETTERS = [f"{one}openblas_set_num_threads{end}" for one in ("scipy_", "") for end in ("64_", "_64", "")]
FORKED = (
    "this process was forked while another thread of its parent was solving, and would wait for that thread for ever: "
    'start processes by multiprocessing.get_context("spawn"), or before or after the solve'
)
_under_way: list[None] = []  # one for each
_forked = {"stranded": False}


@contextmanager
def count_solve() -> Iterator[None]:
    """Counts a solve, or a part of one, as long as it lasts. Raises RuntimeError in a fork that cannot solve."""
    if _forked["stranded"]:
        raise RuntimeError(FORKED)
    _under_way.append(None)
    try:
        yield
    finally:
        _under_way.pop()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _forked.update(stranded=bool(_under_way)))


@contextmanager
def keep_to_one_thread() -> Iterator[None]:
    """Limits every BLAS of this process to one thread; the last to leave restores what the first one found."""
    with count_solve():
        with _lock:
            if _state["libraries"] is None:
                _state["libraries"] = [(find_setter(library), library) for library in find_blas_libraries()]
            if _state["inside"] == 0:
                _before[:] = [(change, library.get_num_threads()) for change, library in _state["libraries"]]
                _set_threads(lambda threads: 1)
            _state["inside"] += 1
        try:
            yield
        finally:
            with _lock:
                _state["inside"] -= 1
                if _state["inside"] == 0:
                    _set_threads(lambda threads: threads)


def _set_threads(choose: Callable[[int], int]) -> None:
    """Sets each BLAS that had other than one thread."""
    for change, threads in _before:
        if threads is not None and threads != 1:
            change(choose(threads))


def find_setter(library: Any) -> Callable[[int], Any]:
    """What sets the number of threads of a BLAS, whichever thread calls it: threadpoolctl from 3.6 on leaves OpenBLAS
    to the first thread that has set it, for as long as that one lives, and does nothing for others."""
    loaded = ctypes.CDLL(library.filepath) if library.internal_api == "openblas" else None
    found: Callable[[int], Any] = library.set_num_threads
    return next((getattr(loaded, name) for name in SETTERS if hasattr(loaded, name)), found)


def find_blas_libraries() -> list[Any]:
    """threadpoolctl's handles of every BLAS of this process, SciPy's own included."""
    import scipy.linalg.cython_lapack  # noqa: F401  the controller must see SciPy's own OpenBLAS
    from threadpoolctl import ThreadpoolController

    return [library for library in ThreadpoolController().lib_controllers if library.user_api == "blas"]


Progress = Callable[[int, int], None]
Result = TypeVar("Result")
PATIENCE = 0.5  # seconds that an interrupted solve gets to stop by itself
_left: list[threading.Event] = []  # set once what was interrupted is over


class ThreadTeam(NamedTuple):
    """Who does one loop of `_core`: so many threads, their seconds (thread,), and the flag that stops them (1,)."""

    threads: int
    seconds: Array
    stop: IntArray


@dataclass(eq=False)
class Run:
    """One solve's threads, stop flag (1,) and ``stages``, wall and thread seconds by name; ``brief``: it takes some
    milliseconds, on one thread; ``kernels``: the stages' loops; ``runtime_warned``: its time was warned of already;
    ``kept``: what its derivatives can use, if it has any."""

    threads: int
    brief: bool = False
    kernels: "_core.Stages" = _core
    stop: IntArray = field(default_factory=lambda: np.zeros(1, np.int32))
    stages: dict[str, dict[str, float]] = field(default_factory=dict)
    runtime_warned: bool = False
    kept: dict[Any, Any] | None = None

    @cached_property
    def helpers(self) -> ThreadPoolExecutor:
        """The threads beside the one that the run is called in, which `release_threads` ends."""
        return ThreadPoolExecutor(self.threads - 1, "vrte-job")

    def release_threads(self) -> None:
        """Ends the threads that helped, so that a process forked later finds none."""
        helpers = vars(self).pop("helpers", None)
        if helpers is not None:
            helpers.shutdown()

    def timed(self, name: str, wait: Callable[[], object] | None = None) -> "Timed":
        """Threads for one loop of `_core`, timed under `name`, ``wait`` included. Raises KeyboardInterrupt."""
        return Timed(self, name, wait)

    def record(self, name: str, wall: float, busy: float | None = None) -> None:
        """Adds seconds to a stage."""
        clock = self.stages.get(name)
        if clock is None:
            clock = self.stages[name] = {"wall_seconds": 0.0, "thread_seconds": 0.0}
        clock["wall_seconds"] += wall
        clock["thread_seconds"] += wall if busy is None else busy


class Timed:
    """Within it a stage of a run is at work, see `Run.timed`."""

    __slots__ = ("name", "run", "start", "team", "wait")

    def __init__(self, run: Run, name: str, wait: Callable[[], object] | None) -> None:
        self.run, self.name, self.wait = run, name, wait

    def __enter__(self) -> ThreadTeam:
        run = self.run
        self.team = ThreadTeam(run.threads, np.zeros(run.threads), run.stop)
        self.start = time.perf_counter()
        return self.team

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            return
        if self.wait is not None:
            self.wait()
        wall = time.perf_counter() - self.start
        self.run.record(self.name, wall, sum(self.team.seconds.tolist()) or wall)
        if self.run.stop[0]:
            raise KeyboardInterrupt


def count_usable_cpus() -> int:
    """The CPUs this process may use: those it is tied to, or fewer where a control group has a quota of their time."""
    tied = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return math.ceil(min(tied, find_group_cores()))


def start_run(threads: int | None, operations: float = math.inf) -> Run:
    """A run on `threads` threads, all usable CPUs for None; a brief one has no thread but the one it is called in."""
    count = count_usable_cpus() if threads is None else check_whole("threads", threads, 1, 4096)
    brief = operations < cost.BRIEF
    return Run(1 if brief else count, brief=brief)


def run_interruptible(run: Run, call: Callable[[], Result]) -> Result:
    """call() in a thread of its own, so that Ctrl-C reaches compiled loops; a brief one in this thread."""
    with count_solve():
        return call() if run.brief else _run_in_thread(run, call)


def _run_in_thread(run: Run, call: Callable[[], Result]) -> Result:
    box: dict[str, Any] = {}
    done = threading.Event()  # Thread.join, interrupted, takes a running thread for a finished one (CPython 3.11)

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
        if not wait_for(done, PATIENCE):
            # one large eigenproblem cannot be stopped, nor a driver's compiler: whoever asked goes on, only the end of
            # the process waits for it
            _left.append(done)
            atexit.register(wait_for, done, 3600.0)
        raise
    if "error" in box:
        raise box["error"]
    return box["result"]


def is_left_working() -> bool:
    """Whether something is still at work that was interrupted and does not stop by itself."""
    return any(not done.is_set() for done in _left)


def run_jobs(
    run: Run, jobs: Sequence[Callable[[Run], Result]], report: Callable[[int], None] = lambda done: None
) -> list[Result]:
    """What jobs find, side by side on the threads of a run; report(k) is called in this thread after k of them."""
    workers = min(run.threads, len(jobs))
    found: list[Any] = [None] * len(jobs)
    failed: dict[int, BaseException] = {}
    indices, done, reported = iter(range(len(jobs))), [], 0
    runs = [replace_unchecked(run, threads=1, stages={}) for _ in range(workers)]

    def work(own: Run) -> None:
        nonlocal reported
        for index in indices:
            try:
                found[index] = jobs[index](own)
                done.append(index)
                if own is runs[0]:
                    reported = len(done)
                    report(reported)
            except BaseException as error:
                failed[index] = error
                for _ in indices:  # nobody begins another
                    pass

    others = [run.helpers.submit(work, own) for own in runs[1:]]
    work(runs[0])
    for each in others:
        each.result()
    if not failed and reported < len(jobs):  # the last one was another thread's
        report(len(jobs))
    for own in runs:
        for name, clock in own.stages.items():
            run.record(name, clock["wall_seconds"] / workers, clock["thread_seconds"])
    if failed:
        raise failed[min(failed)]
    return found


def wait_for(done: threading.Event, seconds: float) -> bool:
    """Whether the compiled loops are left within the time: a process that ends before them would crash in BLAS."""
    end = time.monotonic() + seconds
    while not done.is_set() and time.monotonic() < end:
        with suppress(KeyboardInterrupt, SystemExit):  # an impatient second signal
            done.wait(0.1)
    return done.is_set()


def share_progress(progress: Progress | None, index: int, count: int, steps: int = 100) -> Progress | None:
    """Progress of one of ``count`` equal parts of the work, in ``steps`` of each, whatever the part counts."""
    if progress is None:
        return None
    return lambda done, total: progress(steps * index + steps * done // max(total, 1), steps * count)
