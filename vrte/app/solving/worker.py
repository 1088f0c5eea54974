"""Worker processes of the viewer, from both sides: whatever becomes of one, the server goes on.

The protocol is one for all: the process reads its limits, of memory [bytes] and of work [s, 0: any], then tasks as
(number, task), or None to be interrupted; of those that wait it answers the newest, by (number, message): any number of
messages that say ``follows`` and one that does not. It ends when its input does, also in the middle of a solve, so that
none is left when the viewer is gone.
"""

import _thread
import copy
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.basics.memory import find_available_bytes, limit_memory, limit_time
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.results.brdf import Brdf
from vrte.results.field import Field


@dataclass(frozen=True)
class Task:
    """Work for a worker process: ``call``, a function of this folder by its module and name, gets the form's content or
    a file's bytes, the folder of the tables that it names, and the keywords ``more``."""

    call: str
    content: Any = None
    folder: Path = Path()
    more: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Message:
    """Something that a worker process reports on a task; ``follows``: another message does."""

    follows = False


@dataclass(frozen=True)
class Refused(Message):
    """Why there is no answer, in a sentence."""

    message: str


@dataclass(frozen=True)
class Progress(Message):
    """How far a task is, from 0 to 1, and with what."""

    fraction: float
    stage: str
    follows = True


@dataclass(frozen=True, eq=False)
class Step(Progress):
    """A step that a fit has accepted: its values (n,), their chi2, and what the scene shows with them, (rows,)."""

    values: Array
    chi2: float
    predicted: Array


@dataclass(frozen=True)
class Adopted(Message):
    """The ``content`` that the form gets, and a sentence for each part that was filled in."""

    content: dict[str, Any]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Written(Message):
    """A file to be downloaded."""

    name: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Fitted(Message):
    """What a fit found: ``content`` as it began, keys, values and errors (n,), inf or NaN if unknown, correlations (n,
    n), chi2, predictions (rows,); sentences on blind spots, notes, a page or b""."""

    content: dict[str, Any]
    names: tuple[str, ...]
    values: Array
    errors: Array
    correlations: Array
    chi2: float
    predicted: Array
    sentences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    page: bytes = b""

    @classmethod
    def of_step(cls, task: Task, step: Step, why: str) -> "Fitted":
        """The last step of a fit that ended without a result, without errors."""
        names = tuple(task.more["free"])
        unknown = np.full(len(names), np.nan), np.full((len(names),) * 2, np.nan)
        notes = (f"{why}: these are the values of the last step, without errors",)
        return cls(task.content, names, step.values, *unknown, step.chi2, step.predicted, notes=notes)


class Planned(NamedTuple):
    """The plan of the BRDF at the first wavelength: its table, and what is left out and shared, line by line."""

    text: str
    left_out: tuple[str, ...]
    shared: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Reflectances:
    """Reflectances of unpolarized light incident along ``mu_i`` (n,): ``curves`` (wavelength, n) by the base, and where
    some light is mirrored as a beam, with that and without it.

    ``colours`` are "#rrggbb" by the same names, one a mu_i, of the scene under an evenly white, unpolarized sky seen
    from there: by reciprocity the same reflectances. ``why_none`` says why there are no colours.
    """

    mu_i: Array
    curves: dict[str, Array]
    colours: dict[str, tuple[str, ...]] = field(default_factory=dict)
    why_none: str = ""


@dataclass(frozen=True)
class Outcome(Message):
    """Everything there is to see: the scene as solved, None where a result file was ``opened`` that does not hold it;
    BRDFs and fields one a wavelength, or none; phase matrices by the names of their layers, at each wavelength."""

    content: dict[str, Any] | None
    wavelength_um: tuple[float, ...] = ()
    brdfs: tuple[Brdf, ...] = ()
    fields: tuple[Field, ...] = ()
    inside: tuple[dict[str, PhaseMatrix], ...] = ()
    plan: Planned | None = None
    notes: tuple[str, ...] = ()
    opened: bool = False
    reflectances: Reflectances | None = None

    @property
    def count(self) -> int:
        """The number of wavelengths."""
        return max(len(self.brdfs), len(self.fields))

    @property
    def size(self) -> int:
        """Bytes of the large arrays."""
        matrices = sum(one.mueller.nbytes * (1 if one.transmission is None else 2) for one in self.brdfs)
        return matrices + sum(field.stokes.nbytes for field in self.fields)


EMPTY = Outcome(None)


MOST_NOTES = 30  # sentences about one answer
SENTENCES = SceneError, AccuracyError, DeviceError, MissingExtraError, OSError  # errors that are sentences already
END = object()  # behind all tasks
START = "import sys; sys.path[:] = {path!r}; from vrte.app.solving.worker import main; main()"
AT_ONCE = 2  # solves; others wait
SOLVE_PLACES = threading.BoundedSemaphore(AT_ONCE)
READ_PLACES = threading.BoundedSemaphore(AT_ONCE)  # for tasks that only read a file or a scene
READERS = "solve.adopt", "solve.look_at_part"
LARGEST_SHARE = 0.8  # of the memory that is free, for all solves together
PATIENCE = 5.0  # seconds that a process gets to end
ADOPTING = 5e8, 10.0  # bytes of memory and seconds of work for reading a stranger's scene
MOST_LIVE = 3  # processes that stay, of all tabs; the one not asked for longest ends when one more is needed
STUCK = 4.0  # seconds that a task waits behind an older one before it gets a process of its own


# in the process


class NewerError(Exception):
    """There is a newer task."""


class Exchange:
    """What an answer has: ``report`` for messages before it, ``check`` whether it is wanted, ``notes`` of warnings."""

    def __init__(self, report: Callable[[Message], None], is_old: Callable[[], bool] = lambda: False) -> None:
        self.report, self.is_old = report, is_old
        self.caught: Sequence[warnings.WarningMessage] = ()

    def check(self, *_: Any) -> None:
        """Raises NewerError where a newer task waits."""
        if self.is_old():
            raise NewerError

    def notes(self, *silent: type[Warning], before: Sequence[str] = ()) -> tuple[str, ...]:
        """The sentences ``before`` and the warnings so far, each once, but those ``silent``."""
        found = (str(one.message) for one in self.caught if not issubclass(one.category, silent))
        return tuple(dict.fromkeys((*before, *found)))[:MOST_NOTES]


def take_newest(inbox: SimpleQueue[Any]) -> Any:
    """The newest of what came in, once there is anything; older messages are dropped."""
    found = inbox.get()
    while not inbox.empty():
        found = inbox.get()
    return found


def fill_inbox(inbox: SimpleQueue[Any]) -> None:
    """Takes tasks from standard input; None interrupts the process as Ctrl-C does, the end of the input ends it."""
    try:
        while True:
            given = pickle.load(sys.stdin.buffer)
            if given is None:
                _thread.interrupt_main()
            else:
                inbox.put(given)
    finally:
        os._exit(1)


def main() -> None:
    """Reads its limits, then answers tasks until its input ends."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything prints goes to standard error
    memory_bytes, seconds = pickle.load(sys.stdin.buffer)
    limit_memory(memory_bytes)
    if seconds:
        limit_time(seconds)
    inbox: SimpleQueue[Any] = SimpleQueue()
    lock = threading.Lock()
    works: dict[str, Callable[..., Message]] = {}
    threading.Thread(target=fill_inbox, args=(inbox,), daemon=True).start()
    while True:
        number, task = take_newest(inbox)

        def report(message: Message, number: int = number) -> None:
            with lock:
                pickle.dump((number, message), output, protocol=pickle.HIGHEST_PROTOCOL)
                output.flush()

        if task.call not in works:  # of a class one instance answers all such tasks
            module, _, name = task.call.partition(".")
            found = getattr(import_module(f"vrte.app.solving.{module}"), name)
            works[task.call] = found().answer if isinstance(found, type) else found
        answer = explain_failure(works[task.call], task, Exchange(report, lambda: not inbox.empty()))
        if answer is not None:
            report(answer)


def explain_failure(work: Callable[..., Message], task: Task, exchange: Exchange) -> Message | None:
    """What comes of a task; any error is a sentence, and None comes of what is no longer wanted."""
    try:
        with warnings.catch_warnings(record=True) as exchange.caught:
            warnings.simplefilter("always", UserWarning)
            return work(exchange, task.content, task.folder, **task.more)
    except NewerError:
        return None
    except SENTENCES as error:  # the path of the folder is private
        text = str(error).replace(f"{task.folder}{os.sep}", "") if task.folder.is_absolute() else str(error)
    except MemoryError:
        text = "not enough memory for this scene: smaller particles, fewer directions or nodes need less"
    except KeyboardInterrupt:
        text = "stopped before there was anything to keep"
    except Exception as error:  # never seen; a page must not wait for ever
        text = f"{type(error).__name__}: {error}"
    return Refused(put_in_one_line(text, 1000))


# in the server


def find_memory_share() -> float:
    """Bytes that a solve may take."""
    return LARGEST_SHARE * find_available_bytes() / AT_ONCE


class WorkerProcess:
    """A process that answers tasks, of those that wait the newest. ``hear`` gets each message with its task's number;
    a `Refused` says why the process has ended, unless it was killed. It starts once there is one of ``places``."""

    def __init__(
        self, hear: Callable[["WorkerProcess", int, Any], None], limits: tuple[float, float], indices: Any = None
    ) -> None:
        self.process: subprocess.Popen[bytes] | None = None
        self.started = self.ended = False
        self._hear, self._limits, self._places = hear, limits, indices
        self._outbox: SimpleQueue[Any] = SimpleQueue()  # what is still to be sent: of tasks, the newest
        self._asked = self._answered = 0  # numbers of tasks
        self._waits_since: float | None = None  # behind an older task
        self._lock = threading.Lock()
        threading.Thread(target=self._run, name="vrte-view-worker", daemon=True).start()

    def ask(self, number: int, task: Task) -> None:
        """A task in place of the one that waits."""
        with self._lock:
            if self._asked > self._answered:
                self._waits_since = self._waits_since or time.monotonic()
            self._asked = number
        self._outbox.put((number, task))

    def interrupt(self) -> bool:
        """Asks for the best so far, as Ctrl-C does; False where no task has been sent."""
        if not self.started or not self._outbox.empty():
            return False
        self._outbox.put(None)
        return True

    def is_stuck(self) -> bool:
        """Whether an older task does not make room for the newest."""
        since = self._waits_since
        return since is not None and time.monotonic() - since > STUCK

    def kill(self) -> None:
        """Ends it at once, however deep it is in a compiled loop."""
        with self._lock:
            self.ended = True
            if self.process is not None:
                self.process.kill()

    def _run(self) -> None:
        """Waits for a place, starts the process and hears it until it ends."""
        while self._places is not None and not self._places.acquire(timeout=0.1):
            if self.ended:
                return
        try:
            with tempfile.TemporaryFile() as complaints:
                why = self._follow(complaints)
        except Exception as error:  # a page must not wait for ever
            why = f"the process that solves could not be followed: {type(error).__name__}: {error}"
        finally:
            if self._places is not None:
                self._places.release()
        with self._lock:
            killed, self.ended = self.ended, True
        self._outbox.put(END)
        if not killed:
            self._hear(self, self._asked, Refused(why))

    def _follow(self, complaints: IO[bytes]) -> str:
        """Starts the process and hears it; why it has ended."""
        with self._lock:
            if self.ended:
                return ""
            self.process = process = subprocess.Popen(
                [sys.executable, "-c", START.format(path=sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=complaints,
                start_new_session=True,  # Ctrl-C reaches its parent alone
            )
        threading.Thread(target=self._send, args=(process.stdin,), name="vrte-view-send", daemon=True).start()
        assert process.stdout is not None
        try:
            with suppress(OSError, EOFError, pickle.UnpicklingError):  # it has gone: its code says why
                while not self.ended:
                    self._take(*pickle.load(process.stdout))
        finally:
            end_process(process)
        return explain_end(process.returncode, complaints)

    def _take(self, number: int, message: Any) -> None:
        with self._lock:
            if self._waits_since is not None:  # it goes on: to the newest task, or nearer to it
                self._waits_since = None if number == self._asked else time.monotonic()
            if not message.follows:
                self._answered = number
        self._hear(self, number, message)

    def _send(self, stdin: IO[bytes]) -> None:
        """Hands tasks over, aside: a page must not wait until they are read."""
        with suppress(OSError, ValueError):  # it has gone, or its pipe is closed
            pickle.dump(self._limits, stdin)
            while (task := take_newest(self._outbox)) is not END:
                pickle.dump(task, stdin)
                stdin.flush()
                self.started = True


def end_process(process: "subprocess.Popen[bytes]") -> None:
    """Closes its pipes, and waits for its end, but not long."""
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # it may have gone before it read all
            if stream is not None:
                stream.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE)
    process.kill()  # nothing, where it has ended
    process.wait()


def explain_end(code: int, complaints: IO[bytes]) -> str:
    """Why a process went without an answer."""
    complaints.seek(0)
    lines = [line.strip() for line in complaints.read().decode(errors="replace").split("\n") if line.strip()]
    whys = {-9: "been ended by the system, which it does when memory is short", -24: "taken too long, and was ended"}
    why = whys.get(code, f"ended with code {code}")
    return f"the process of this task has {why}{f': {lines[-1][:300]}' if lines else ''}"


class Query:
    """Tasks of one tab, the last of which counts: ``task``, and whether it ``waits`` for something to come.

    ``answer`` is the last message that came, ``answered`` the task that it is of, None where another was asked since;
    ``progress`` says how far the task is, ``step`` where a fit is. A process that ``stays`` answers all tasks, and may
    have to make room for another tab's; otherwise each task has a process of its own, and ends the one before.
    """

    _in_use: list["Query"] = []  # noqa: RUF012 - of the whole server: those whose process stays, the last asked last
    _lock = threading.RLock()

    def __init__(self, stays: bool = False) -> None:
        self.stays, self.waits = stays, False
        self.worker: WorkerProcess | None = None
        self._number = 0  # of the task
        self.forget()

    def forget(self) -> None:
        """Ends the process, and forgets the task and what came of it."""
        self.close()
        self.task: Task | None = None
        self.answered: Task | None = None
        self.answer: Any = None
        self.step: Step | None = None
        self.progress = Progress(0.0, "waiting for other solves to end")

    def ask(self, task: Task, memory_bytes: float | None = None) -> None:
        """A task in place of the one that waits; nothing where a process that stays was asked for it last."""
        if self.stays and task == self.task:
            return
        if not self.stays:
            self.forget()
        self.task = replace(task, content=copy.deepcopy(task.content))  # the page changes it
        self.answered, self._number = None, self._number + 1
        self._put(memory_bytes)

    def refresh(self) -> None:
        """Gives the task another process where an older one does not make room for it."""
        if self.worker is not None and self.worker.is_stuck():
            self.worker.kill()
            self._put()

    def take(self) -> Any:
        """The answer, once, when nothing more is to come; None before and after."""
        if self.waits:
            return None
        answer, self.answer = self.answer, None
        return answer

    def stop(self) -> None:
        """Asks for the best so far, of a fit; ends it where it has not begun."""
        if self.worker is None or not self.worker.interrupt():
            self.close()

    def close(self) -> None:
        """Ends the process. One that stays keeps its last answer, and the next task starts another."""
        with Query._lock:
            if self.waits and self.stays:
                self.task = None
            elif self.waits:
                self.answer = Refused("cancelled")
            self.waits = False
            worker, self.worker = self.worker, None
            if self in Query._in_use:
                Query._in_use.remove(self)
        if worker is not None:
            worker.kill()

    def _put(self, memory_bytes: float | None = None) -> None:
        assert self.task is not None
        call = self.task.call
        limits = memory_bytes or find_memory_share() / (MOST_LIVE if self.stays else 1), 0.0
        if call == "solve.adopt":
            limits = ADOPTING
        indices = None if self.stays else READ_PLACES if call in READERS else SOLVE_PLACES
        with Query._lock:
            if self.stays:
                Query._in_use[:] = [one for one in Query._in_use if one is not self] + [self]
                for other in Query._in_use[:-MOST_LIVE]:
                    other.close()
            if self.worker is None or self.worker.ended:
                self.worker = WorkerProcess(self._hear, limits, indices)
            self.waits = True
            self.worker.ask(self._number, self.task)

    def _hear(self, worker: WorkerProcess, number: int, message: Any) -> None:
        with Query._lock:
            if worker is not self.worker:
                return
            if isinstance(message, Progress):
                self.progress = message
                self.step = message if isinstance(message, Step) else self.step
                return
            self.answer = message
            if number == self._number:
                self.answered, self.waits = self.task, message.follows
        if not self.stays and not message.follows:
            worker.kill()
