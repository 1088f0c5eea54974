"""The processes of the two SIMD settings: the end that measures and, `serve`, the end that solves.

OpenBLAS takes its kernels once, when it is loaded: two settings are two processes. Both are started before any timing
and solve one message after another, pickled on standard input and output; what is timed is the solve alone, in the
process itself, so that both pay alike. One ends when its input ends, and soon even in the middle of a solve, so that
none is left when its parent is gone.
"""

import os
import pickle
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any, BinaryIO

from bench.tables import Configuration, Problem
from vrte.basics.arrays import Array
from vrte.basics.blas import find_blas_libraries
from vrte.basics.errors import AccuracyError, DeviceError, SceneError
from vrte.results.field import Field

VARIABLE, BASELINE_CORE = "OPENBLAS_CORETYPE", "Prescott"
BASELINE_NAMES = ("Katmai", "Prescott")  # what OpenBLAS calls it once loaded; SciPy's says Katmai
START = "import sys; sys.path[:] = {path!r}; from bench.processes import serve; serve()"
PATIENCE = 5.0  # seconds that a process gets to end by itself
GRACE = 1.0  # seconds that a solve gets when nobody waits for it any more
ERRORS = (SceneError, AccuracyError, DeviceError, MemoryError)  # that users meet


@dataclass(frozen=True)
class Hello:
    """A process is ready. ``cores``: for which processor each of its BLAS libraries took its kernels; ``versions``: of
    those libraries, in words; ``cpu_seconds`` of the process so far."""

    cores: tuple[str, ...]
    versions: tuple[str, ...]
    cpu_seconds: float


@dataclass(frozen=True)
class Task:
    """One solve; ``wants_answer``: whether the reply is to carry Stokes vectors or Mueller matrices."""

    problem: Problem
    options: dict[str, Any]
    wants_answer: bool = False


@dataclass(frozen=True, eq=False)
class Reply:
    """Wall ``seconds`` of the call in the process itself, of its stages, and ``cpu_seconds`` of the process so far."""

    seconds: float
    stages: dict[str, float]
    orders_by: dict[str, int]
    cpu_seconds: float
    answer: Array | None = None


def serve() -> None:
    """Says hello, then answers every Task by a Reply or an error; what anything prints goes to standard error."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
    threading.Thread(target=receive, args=(sys.stdin.buffer, tasks), daemon=True).start()
    libraries = find_blas_libraries()
    cores = tuple(str(getattr(library, "architecture", None)) for library in libraries)
    names = {f"{library.internal_api} {library.version} {core}" for library, core in zip(libraries, cores, strict=True)}
    send(output, Hello(cores, tuple(sorted(names)), time.process_time()))
    while (task := tasks.get()) is not None:
        send(output, answer_task(task))


def receive(stream: BinaryIO, tasks: "queue.SimpleQueue[Task | None]") -> None:
    """Puts the messages into the queue, None when the input has ended; does not wait long for a solve then."""
    try:
        while True:
            tasks.put(pickle.load(stream))
    except BaseException:
        tasks.put(None)
        time.sleep(GRACE)
        os._exit(0)


def send(stream: BinaryIO, message: Hello | Reply | Exception) -> None:
    """One message, at once; ends the process where nobody reads it."""
    try:
        pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
        stream.flush()
    except BrokenPipeError:
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
    return Reply(seconds, stages, dict(made["orders_by"]), time.process_time(), answer if task.wants_answer else None)


class Child:
    """One process; ``simd`` is "baseline" or "full". Of a session of its own: Ctrl-C reaches its parent alone."""

    def __init__(self, simd: str) -> None:
        self.simd, self.cpu_seconds = simd, 0.0
        self._said = tempfile.TemporaryFile()  # noqa: SIM115  open as long as the process is
        self._process = subprocess.Popen(
            [sys.executable, "-c", START.format(path=sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env=make_environment(simd),
            start_new_session=True,
        )
        self._hello: Hello | None = None

    @property
    def hello(self) -> Hello:
        """Waits until it is ready. Raises SceneError where its linear algebra is not what it is to be."""
        if self._hello is None:
            found: Hello = self._receive()
            if (reason := explain_unfit_kernels(self.simd, found.cores)) is not None:
                raise SceneError(reason)
            self._hello, self.cpu_seconds = found, found.cpu_seconds
        return self._hello

    def solve(self, task: Task) -> Reply:
        """Sends the task and waits. Raises what the solver raises, ChildProcessError where the process has died."""
        assert self._process.stdin is not None
        try:
            pickle.dump(task, self._process.stdin)
            self._process.stdin.flush()
        except OSError as error:
            raise self._died() from error
        found: Reply | Exception = self._receive()
        if isinstance(found, Exception):
            raise found
        self.cpu_seconds = found.cpu_seconds
        return found

    def _receive(self) -> Any:
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise self._died() from error

    def _died(self) -> ChildProcessError:
        """In one sentence, with the last thing that it said."""
        self._stop()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        last = next((line for line in reversed(lines) if line.strip()), "it said nothing")
        return ChildProcessError(
            f"the process for {self.simd} SIMD has died with code {self._process.returncode}: {last}"
        )

    def _stop(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):  # it may have gone before it read all
                stream.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def end(self) -> None:
        """Ends it: by itself when its input ends, by force where it does not."""
        self._stop()
        self._said.close()


def make_environment(simd: str) -> dict[str, str]:
    """Of the process: the setting alone differs."""
    kept = {name: value for name, value in os.environ.items() if name != VARIABLE}
    return kept | {VARIABLE: BASELINE_CORE} if simd == "baseline" else kept


def explain_unfit_kernels(simd: str, cores: Iterable[str]) -> str | None:
    """Why a process with these kernels of BLAS must not be measured, None where it may.

    >>> explain = explain_unfit_kernels
    >>> explain("baseline", ["Katmai", "Katmai"]) is None, explain("full", ["SkylakeX", "SkylakeX"]) is None
    (True, True)
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
        for child in children.values():
            _ = child.hello
        yield children


def describe_processes(children: Mapping[str, Child], configurations: Iterable[Configuration]) -> list[str]:
    """With what linear algebra and on what device they computed, a sentence each."""
    told = [f"linear algebra, {simd} SIMD: {', '.join(child.hello.versions)}" for simd, child in children.items()]
    if any(each.needs_device for each in configurations):
        from importlib.metadata import version

        from vrte.cl.device import find_chosen_device

        device = find_chosen_device()
        told.append(f"OpenCL device: {device.name} ({device.platform} {device.driver}), pyopencl {version('pyopencl')}")
    return told
