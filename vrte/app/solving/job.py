"""Tasks in processes of their own, seen from the viewer: whatever becomes of one, the server goes on."""

import pickle
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from typing import IO

from vrte.app.form.parts import Said
from vrte.app.solving.messages import Adopt, Adopted, Fitted, Look, Outcome, Progress, Step, Task, Written
from vrte.basics.memory import find_available_bytes

START = "import sys; sys.path[:] = {path!r}; from vrte.app.solving.{module} import main; main()"
AT_ONCE = 2  # solves; others wait
PLACES = threading.BoundedSemaphore(AT_ONCE)
DESKS = threading.BoundedSemaphore(AT_ONCE)  # of those who only look at a file, or read a scene
LARGEST_SHARE = 0.8  # of the memory that is free, for all solves together
PATIENCE = 5.0  # seconds that a process gets to end


def find_memory_share() -> float:
    """Bytes that a solve may take."""
    return LARGEST_SHARE * find_available_bytes() / AT_ONCE


class Job:
    """A task on its way. What it says may be read at any time; ``ended`` is the last thing to change.

    ``share`` from 0 to 1 and ``stage`` tell how far it is, ``step`` where a fit is; at the end there is an ``outcome``,
    or a ``message`` that says why not.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.share, self.stage = 0.0, "waiting for other solves to end"
        self.step: Step | None = None
        self.outcome: Outcome | Written | Said | Fitted | Adopted | None = None
        self.message, self.ended = "", False
        self._cancelled, self._sent = threading.Event(), threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        threading.Thread(target=self._run, args=(task,), name="vrte-view-job", daemon=True).start()

    def cancel(self) -> None:
        """Ends it at once, however deep it is in a compiled loop."""
        with self._lock:
            self._cancelled.set()
            if self._process is not None:
                self._process.kill()

    def stop(self) -> None:
        """Asks for the best so far, of a fit; ends it where it has not begun."""
        with self._lock, suppress(OSError, ValueError):  # it has gone, or its pipe is closed
            if self._sent.is_set() and self._process is not None and self._process.stdin is not None:
                self._process.stdin.write(b"\n")
                self._process.stdin.flush()
                return
        if not self._sent.is_set():
            self.cancel()

    def _run(self, task: Task) -> None:
        try:
            places = DESKS if isinstance(task, (Look, Adopt)) else PLACES
            while not places.acquire(timeout=0.1):
                if self._cancelled.is_set():
                    return
            try:
                self._follow(task)
            finally:
                places.release()
        except Exception as error:  # a page must not wait for ever
            self.message = f"the process that solves could not be followed: {type(error).__name__}: {error}"
        finally:
            if self._cancelled.is_set():
                self.outcome, self.message = None, "cancelled"
            self.ended = True

    def _follow(self, task: Task) -> None:
        """Starts the process, and takes what it says."""
        self.stage = "starting"
        with tempfile.TemporaryFile() as said:
            with self._lock:
                if self._cancelled.is_set():
                    return
                self._process = process = start_process("worker", said)
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                with suppress(OSError, EOFError, pickle.UnpicklingError):  # it has gone: its code says why
                    pickle.dump(task, process.stdin)
                    process.stdin.flush()
                    self._sent.set()
                    while isinstance(message := pickle.load(process.stdout), Progress):
                        self.share, self.stage = message.share, message.stage
                        self.step = message if isinstance(message, Step) else self.step
                    if isinstance(message, str):
                        self.message = message
                    else:
                        self.outcome = message
            finally:
                end_process(process)
            if self.outcome is None and not self.message:
                self.message = explain_end(process.returncode, said)


def start_process(module: str, said: IO[bytes]) -> "subprocess.Popen[bytes]":
    """A process of a session of its own (Ctrl-C reaches its parent alone), told and asked by its pipes."""
    return subprocess.Popen(
        [sys.executable, "-c", START.format(path=sys.path, module=module)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=said,
        start_new_session=True,
    )


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


def explain_end(code: int, said: IO[bytes]) -> str:
    """Why a process went without an answer."""
    said.seek(0)
    lines = [line.strip() for line in said.read().decode(errors="replace").split("\n") if line.strip()]
    whys = {-9: "been ended by the system, which it does when memory is short", -24: "taken too long, and was ended"}
    why = whys.get(code, f"ended with code {code}")
    return f"the process of this task has {why}{f': {lines[-1][:300]}' if lines else ''}"
