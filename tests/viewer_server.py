"""A viewer's server for tests, started, and ended as Ctrl-C ends it; and tasks for its worker processes."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vrte.app.solving.worker import Exchange, Query, Task, explain_failure

from .helpers import wait_until

ROOT = Path(__file__).parents[1]


@contextmanager
def viewer(*options: str, warning: str = "", ended_by: signal.Signals = signal.SIGINT, code: int = 0) -> Iterator[str]:
    """The address, with its token, of a server that must end by itself when it gets the signal, with this code, and say
    nothing but that and the ``warning``."""
    process = subprocess.Popen(
        [sys.executable, "-m", "vrte.cli", "view", "--no-browser", "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"},
    )
    try:
        assert not warning or warning in process.stdout.readline()
        found = re.search(r"http://[\w.-]+:\d+/\?token=[\w-]+", process.stdout.readline())
        assert found, process.communicate()[1]
        yield found[0]
        process.send_signal(ended_by)
        time.sleep(0.05)
        process.send_signal(ended_by)  # an impatient second one, which must leave no trace
        reported, complained = process.communicate(timeout=20)
        assert (process.returncode, reported, complained) == (code, "vrte view: ended\n", ""), complained
    finally:
        process.kill()
        process.communicate()


def ask(query: Query, call: str, content: Any, folder: Path = Path(), memory: float | None = None, **more: Any) -> Any:
    """The last answer of a worker process."""
    query.ask(Task(call, content, folder, more), memory)
    wait_until(lambda: not query.waits)
    return query.answer


def work(answer: Callable[..., Any], content: Any, newer: int = 99, **more: Any) -> list[Any]:
    """All messages about a task that is answered in this process, with a newer one waiting after so many."""
    reported: list[Any] = []
    exchange = Exchange(reported.append, lambda: len(reported) >= newer)
    reported.append(explain_failure(answer, Task("", content, Path(), more), exchange))
    return reported


def get_process(query: Query) -> "subprocess.Popen[bytes]":
    """A query's process, once there is one."""
    wait_until(lambda: query.worker is not None and query.worker.process is not None)
    assert query.worker.process is not None
    return query.worker.process
