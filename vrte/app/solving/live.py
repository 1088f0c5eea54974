"""A warm process for a tab's questions, seen from the viewer: it stays, the newest question wins, and it may die."""

import copy
import pickle
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from vrte.app.solving.appearance import Appeared, Question, Shares, Viewing
from vrte.app.solving.job import end_process, explain_end, find_memory_share, start_process
from vrte.app.solving.measuring import Compared, Comparison
from vrte.app.solving.questions import Refused

MOST_WARM = 3  # processes of all tabs; the one that was not asked for longest ends when one more is needed
SLIDERS, COMPARER = "live_worker", "measurement_worker"  # what such a process runs
STUCK = 4.0  # seconds that a question waits behind an older one before it gets a process of its own


Asked = Question | Comparison
Reply = Appeared | Compared | Refused


def is_last(reply: Reply) -> bool:
    """Whether no other reply to the same question follows."""
    return isinstance(reply, Refused) or not reply.follows


class Warm:
    """A process of a ``worker``, questions to it and what it ``hear``s: each reply, and why it has ended unless it was
    killed."""

    def __init__(self, worker: str, hear: Callable[["Warm", Reply], None]) -> None:
        self.ended, self.worker = False, worker
        self.process: subprocess.Popen[bytes] | None = None
        self._hear = hear
        self._newest: Asked | None = None
        self._asked, self._told = 0, 0  # numbers of questions
        self._waits_since: float | None = None  # behind an older question
        self._changed = threading.Condition()
        threading.Thread(target=self._run, name="vrte-view-live", daemon=True).start()

    def put(self, question: Asked) -> None:
        """A question in place of the one that waits."""
        with self._changed:
            if self._asked > self._told:
                self._waits_since = self._waits_since or time.monotonic()
            self._newest, self._asked = question, question.number
            self._changed.notify()

    def is_stuck(self) -> bool:
        """Whether an older question does not make room."""
        since = self._waits_since
        return since is not None and time.monotonic() - since > STUCK

    def kill(self) -> None:
        """Ends it at once, however deep it is in a compiled loop."""
        with self._changed:
            self.ended = True
            if self.process is not None:
                self.process.kill()
            self._changed.notify()

    def _run(self) -> None:
        """Starts the process and takes what it says."""
        with tempfile.TemporaryFile() as said:
            with self._changed:
                if self.ended:
                    return
                self.process = process = start_process(self.worker, said)
            threading.Thread(target=self._send, args=(process,), name="vrte-view-ask", daemon=True).start()
            assert process.stdout is not None
            try:
                with suppress(OSError, EOFError, pickle.UnpicklingError):  # it has gone: its code says why
                    while not self.ended:
                        self._take(pickle.load(process.stdout))
            finally:
                end_process(process)
            with self._changed:
                killed, self.ended = self.ended, True
                self._changed.notify()
            if not killed:
                self._hear(self, Refused(self._asked, explain_end(process.returncode, said)))

    def _take(self, reply: Reply) -> None:
        with self._changed:
            if self._waits_since is not None:  # it goes on: to the newest question, or nearer to it
                self._waits_since = None if reply.number == self._asked else time.monotonic()
            if is_last(reply):
                self._told = reply.number
        self._hear(self, reply)

    def _send(self, process: "subprocess.Popen[bytes]") -> None:
        """Hands questions over, aside: a page must not wait until they are read."""
        assert process.stdin is not None
        with suppress(OSError, ValueError):  # it has gone, or its pipe is closed
            pickle.dump(find_memory_share() / MOST_WARM, process.stdin)
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self.ended or self._newest is not None)
                    if self.ended:
                        return
                    question, self._newest = self._newest, None
                pickle.dump(question, process.stdin)
                process.stdin.flush()


class Live:
    """The questions of one tab to a ``worker``. ``answer`` is the last that came, to the question of its ``number``;
    ``asked`` is the last question, ``answered`` the one that the answer is to, None where it is not the last."""

    _in_use: list["Live"] = []  # noqa: RUF012 - of the whole server: those with a process, the last asked last
    _lock = threading.Lock()

    def __init__(self, worker: str = SLIDERS) -> None:
        self.worker = worker
        self.answer: Reply | None = None
        self.asked: Asked | None = None
        self.answered: Asked | None = None
        self._warm: Warm | None = None
        self._count = 0

    @property
    def waits(self) -> bool:
        """Whether something is to come."""
        answer, asked = self.answer, self.asked
        if asked is None or self._warm is None:
            return False
        return answer is None or answer.number < asked.number or not is_last(answer)

    def ask(self, content: dict[str, Any], folder: Path, viewing: Viewing, before: Shares | None = None) -> None:
        """What a scene looks like."""
        self.put(Question(0, content, folder, viewing, before))

    def put(self, question: Asked) -> None:
        """A question in place of the one that waits; nothing where it was asked last."""
        last = self.asked
        if last is not None and replace(question, number=last.number) == last:
            return
        self._count += 1
        content: Any = copy.deepcopy(question.content)  # the page changes it
        self.asked = replace(question, number=self._count, content=content)
        self._put(self.asked)

    def refresh(self) -> None:
        """Gives the question another process where an older one does not make room for it."""
        if self._warm is not None and self.asked is not None and self._warm.is_stuck():
            self._warm.kill()
            self._put(self.asked)

    def close(self) -> None:
        """Ends the process; the next question starts another, also the one that it leaves open."""
        if self.waits:
            self.asked = None
        with Live._lock:
            if self in Live._in_use:
                Live._in_use.remove(self)
        if self._warm is not None:
            self._warm.kill()
            self._warm = None

    def _put(self, question: Asked) -> None:
        with Live._lock:
            if self in Live._in_use:
                Live._in_use.remove(self)
            Live._in_use.append(self)
            others = Live._in_use[:-MOST_WARM]
        for other in others:
            other.close()
        if self._warm is None or self._warm.ended:
            self._warm = Warm(self.worker, self._hear)
        self._warm.put(question)

    def _hear(self, warm: Warm, reply: Reply) -> None:
        if warm is self._warm:
            asked = self.asked
            self.answer, self.answered = reply, asked if asked and asked.number == reply.number else None
