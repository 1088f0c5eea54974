"""The process that answers the viewer's tasks: of those that wait the newest, each by progress and one answer.

It ends when its input does, also in the middle of a solve, so that none is left when the viewer is gone.
"""

import _thread
import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from queue import SimpleQueue
from typing import Any

from vrte.app.solving.messages import Message, Refused, Task
from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.basics.memory import limit_memory, limit_time

MOST_NOTES = 30  # sentences about one answer
SENTENCES = SceneError, AccuracyError, DeviceError, MissingExtraError, OSError  # errors that are sentences already


class NewerError(Exception):
    """There is a newer task."""


class Exchange:
    """What an answer is worked out with: ``report`` messages that come before it, ``check`` whether it is still wanted,
    and the ``notes`` that the library has warned of."""

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
    """The newest of what came in, once there is anything; what nobody took in time is dropped."""
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
    except SENTENCES as error:  # where the folder lies is nobody's business
        text = str(error).replace(f"{task.folder}{os.sep}", "") if task.folder.is_absolute() else str(error)
    except MemoryError:
        text = "not enough memory for this scene: smaller particles, fewer directions or nodes need less"
    except KeyboardInterrupt:
        text = "stopped before there was anything to keep"
    except Exception as error:  # never seen; a page must not wait for ever
        text = f"{type(error).__name__}: {error}"
    return Refused(put_in_one_line(text, 1000))
