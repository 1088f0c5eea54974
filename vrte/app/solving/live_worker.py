"""The process that answers a tab's questions while somebody changes its scene: it stays, and the newest question wins.

It ends when its input does, also in the middle of an answer, so that none is left when the viewer is gone.
"""

import os
import pickle
import sys
import threading
from collections.abc import Callable
from typing import Any

from vrte.app.solving.appearance import Studio
from vrte.app.solving.worker import open_output
from vrte.appearance.colours import import_colour_science
from vrte.basics.errors import MissingExtraError
from vrte.basics.limits import limit_memory


class Inbox:
    """The newest question; those that nobody took in time are gone."""

    def __init__(self) -> None:
        self._newest: Any = None
        self._changed = threading.Condition()

    def put(self, question: Any) -> None:
        """In place of the one that waits."""
        with self._changed:
            self._newest = question
            self._changed.notify()

    def take(self) -> Any:
        """The newest question, once there is one."""
        with self._changed:
            self._changed.wait_for(self.has_newer)
            question, self._newest = self._newest, None
            assert question is not None
            return question

    def has_newer(self) -> bool:
        """Whether one waits."""
        return self._newest is not None


def main() -> None:
    """What a scene looks like, again and again."""
    answer_questions(Studio().answer, load_colours)


def answer_questions(
    answer: Callable[[Any, Callable[[Any], None], Callable[[], bool]], None], begin: Callable[[], None] = lambda: None
) -> None:
    """Reads how much memory it may take, does what it begins with, then answers questions until its input ends."""
    output = open_output()
    limit_memory(pickle.load(sys.stdin.buffer))
    inbox = Inbox()
    threading.Thread(target=fill_inbox, args=(inbox,), daemon=True).start()

    def tell(reply: Any) -> None:
        pickle.dump(reply, output, protocol=pickle.HIGHEST_PROTOCOL)
        output.flush()

    begin()
    while True:
        answer(inbox.take(), tell, inbox.has_newer)


def fill_inbox(inbox: Inbox) -> None:
    """Takes questions in as they come, and ends the process after the last."""
    question: Any = None
    try:
        while True:
            question = pickle.load(sys.stdin.buffer)
            inbox.put(question)
    finally:
        os._exit(1)


def load_colours() -> None:
    """Before the first question, which would do so, and not beside it: modules that two threads import at once may be
    seen half made."""
    try:
        import_colour_science()
    except MissingExtraError:
        return  # the answer says so
