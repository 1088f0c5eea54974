"""Worker processes seen from the viewer: whatever becomes of one, the server goes on.

The protocol is one for all: the process reads its limits, of memory [bytes] and of work [s, 0: any], then tasks as
(number, task), or None to be interrupted; it answers (number, message), any number of messages that say ``follows`` and
one that does not (`worker`).
"""

import copy
import pickle
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from queue import SimpleQueue
from typing import IO, Any

from vrte.app.solving.messages import Progress, Refused, Step, Task
from vrte.app.solving.worker import take_newest
from vrte.basics.memory import find_available_bytes

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
