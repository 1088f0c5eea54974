"""The processes of the two SIMD settings: the end that measures and, `serve`, the end that solves.

OpenBLAS takes its kernels once, when it is loaded: two settings are two processes. Both are started before any timing
and solve one task after another; what is timed is the solve alone, in the process itself, so that both pay alike. A
process ends when nobody sends it tasks any more, and soon even in the middle of a solve.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from bench.tables import Configuration, Problem
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, DeviceError, SceneError
from vrte.basics.running import find_blas_libraries
from vrte.results.field import Field

VARIABLE, BASELINE_CORE = "OPENBLAS_CORETYPE", "Prescott"
BASELINE_NAMES = ("Katmai", "Prescott")  # what OpenBLAS calls it once loaded; SciPy's says Katmai
PATIENCE = 5.0  # seconds that a process gets to end by itself
ERRORS = (SceneError, AccuracyError, DeviceError, MemoryError)  # that users meet


@dataclass(frozen=True)
class Hello:
    """A process is ready. ``cores``: for which processor each of its BLAS libraries took its kernels; ``versions``: of
    those libraries, in words."""

    cores: tuple[str, ...]
    versions: tuple[str, ...]


@dataclass(frozen=True)
class Task:
    """One solve; ``wants_answer``: whether the reply is to carry Stokes vectors or Mueller matrices."""

    problem: Problem
    options: dict[str, Any]
    wants_answer: bool = False


@dataclass(frozen=True, eq=False)
class Reply:
    """Wall ``seconds`` of the call in the process itself, and of its stages."""

    seconds: float
    stages: dict[str, float]
    orders_by: dict[str, int]
    answer: Array | None = None


def serve(connection: Connection) -> None:
    """Says hello, then answers every Task by a Reply or an error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the parent alone
    threading.Thread(target=end_with_parent, daemon=True).start()
    libraries = find_blas_libraries()
    cores = tuple(str(getattr(library, "architecture", None)) for library in libraries)
    names = {f"{library.internal_api} {library.version} {core}" for library, core in zip(libraries, cores, strict=True)}
    connection.send(Hello(cores, tuple(sorted(names))))
    with suppress(EOFError, BrokenPipeError):
        while True:
            connection.send(answer_task(connection.recv()))


def end_with_parent() -> None:
    """Ends this process with the one that started it, even in the middle of a solve."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(0)


def answer_task(task: Task) -> Reply | Exception:
    """One solve, timed; an error as it is where that is one that users meet."""
    try:
        start = time.perf_counter()
        result = task.problem.solve(task.options)
        seconds = time.perf_counter() - start
    except ERRORS as error:
        return error
    except Exception as error:
        return ChildProcessError(f"{type(error).__name__}: {error}")
    made = result.diagnostics
    stages = {name: clock["wall_seconds"] for name, clock in made["stages"].items()}
    answer = result.stokes if isinstance(result, Field) else result.mueller
    return Reply(seconds, stages, dict(made["orders_by"]), answer if task.wants_answer else None)


class Child:
    """One process; ``simd`` is "baseline" or "full"."""

    def __init__(self, simd: str) -> None:
        self.simd = simd
        context, before = multiprocessing.get_context("spawn"), os.environ.pop(VARIABLE, None)
        self._connection, other = context.Pipe()
        self.process = context.Process(target=serve, args=(other,), daemon=True)
        try:
            os.environ.update(choose_environment(simd))
            self.process.start()
        finally:
            os.environ.pop(VARIABLE, None)
            os.environ.update({} if before is None else {VARIABLE: before})
        other.close()

    def start(self) -> "Child":
        """Waits until it is ready. Raises SceneError where its linear algebra is not what it is to be."""
        self.hello: Hello = self._receive()
        if (reason := explain_unfit_kernels(self.simd, self.hello.cores)) is not None:
            raise SceneError(reason)
        return self

    def solve(self, task: Task) -> Reply:
        """Sends the task and waits. Raises what the solver raises, ChildProcessError where the process has died."""
        with suppress(OSError):  # of a dead process: it does not answer either
            self._connection.send(task)
        found: Reply | Exception = self._receive()
        if isinstance(found, Exception):
            raise found
        return found

    def _receive(self) -> Any:
        try:
            found = self._connection.recv()
        except (EOFError, OSError):
            self.process.join(PATIENCE)
            code = self.process.exitcode
            raise ChildProcessError(f"the process for {self.simd} SIMD has died with code {code}") from None
        return found

    def end(self) -> None:
        """Ends it: by itself when nothing more comes, by force where it does not."""
        self._connection.close()
        self.process.join(PATIENCE)
        self.process.kill()
        self.process.join()


def choose_environment(simd: str) -> dict[str, str]:
    """What a process has in its environment, where the user's own setting is taken out."""
    return {VARIABLE: BASELINE_CORE} if simd == "baseline" else {}


def explain_unfit_kernels(simd: str, cores: Iterable[str]) -> str | None:
    """Why a process with these kernels of BLAS must not be measured, None where it may.

    >>> explain_unfit_kernels("baseline", ["Katmai", "Katmai"]) is None
    True
    >>> explain_unfit_kernels("baseline", ["Katmai", "SkylakeX"])
    'OpenBLAS took its kernels for Katmai, SkylakeX where baseline SIMD was asked for: nothing is measured'
    """
    cores = list(cores)
    is_baseline = [core in BASELINE_NAMES for core in cores]
    if cores and (all(is_baseline) if simd == "baseline" else not any(is_baseline)):
        return None
    found = ", ".join(cores) or "no processor that it names"
    return f"OpenBLAS took its kernels for {found} where {simd} SIMD was asked for: nothing is measured"


@contextmanager
def start_processes(settings: Iterable[str]) -> Iterator[dict[str, Child]]:
    """A process for each SIMD setting, ready; all have ended when the block ends, however it ends."""
    with ExitStack() as stack:
        children: dict[str, Child] = {}
        for simd in dict.fromkeys(settings):
            children[simd] = Child(simd)
            stack.callback(children[simd].end)
        yield {simd: child.start() for simd, child in children.items()}


def describe_processes(children: Mapping[str, Child], configurations: Iterable[Configuration]) -> list[str]:
    """With what linear algebra and on what device they computed, a sentence each."""
    reported = [f"linear algebra, {simd} SIMD: {', '.join(child.hello.versions)}" for simd, child in children.items()]
    if any(each.needs_device for each in configurations):
        from importlib.metadata import version

        from vrte.cl.device import find_chosen_device

        device = find_chosen_device()
        reported.append(
            f"OpenCL device: {device.name} ({device.platform} {device.driver}), pyopencl {version('pyopencl')}"
        )
    return reported
