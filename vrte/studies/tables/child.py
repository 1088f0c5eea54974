"""One process with one SIMD setting of the linear algebra: solves what it is sent, one message after another.

It ends when its input ends, and soon even in the middle of a solve, so that none is left when its parent is gone.
"""

import os
import pickle
import queue
import sys
import threading
import time
from typing import BinaryIO

from vrte.basics.blas import blas_libraries
from vrte.studies.tables.messages import Failure, Hello, Reply, Task
from vrte.studies.tables.problems import answer_of

GRACE = 1.0  # seconds that a solve gets when nobody waits for it any more


def main() -> None:
    """Says hello, then answers every Task by a Reply or a Failure."""
    output = own_output()
    tasks: queue.SimpleQueue[Task | None] = queue.SimpleQueue()
    threading.Thread(target=receive, args=(sys.stdin.buffer, tasks), daemon=True).start()
    send(output, hello())
    while (task := tasks.get()) is not None:
        send(output, answered(task))


def own_output() -> BinaryIO:
    """The standard output for messages alone: what anything prints goes to standard error."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return output


def receive(stream: BinaryIO, tasks: "queue.SimpleQueue[Task | None]") -> None:
    """Puts the messages into the queue, None when the input has ended; does not wait long for a solve then."""
    try:
        while True:
            tasks.put(pickle.load(stream))
    except BaseException:
        tasks.put(None)
        time.sleep(GRACE)
        os._exit(0)


def send(stream: BinaryIO, message: Hello | Reply | Failure) -> None:
    """One message, at once; ends the process where nobody reads it."""
    try:
        pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
        stream.flush()
    except BrokenPipeError:
        os._exit(0)


def hello() -> Hello:
    """With what this process computes."""
    libraries = blas_libraries()
    cores = tuple(str(getattr(library, "architecture", None)) for library in libraries)
    versions = {
        f"{library.internal_api} {library.version} {core}" for library, core in zip(libraries, cores, strict=True)
    }
    return Hello(cores, tuple(sorted(versions)), time.process_time())


def answered(task: Task) -> Reply | Failure:
    """One solve, timed."""
    try:
        start = time.perf_counter()
        result = task.problem.solve(task.options)
        seconds = time.perf_counter() - start
    except Exception as error:
        return Failure(type(error).__name__, str(error))
    made = result.diagnostics
    return Reply(
        seconds=seconds,
        stages={name: clock["wall_seconds"] for name, clock in made["stages"].items()},
        orders_by=dict(made["orders_by"]),
        cpu_seconds=time.process_time(),
        answer=answer_of(result) if task.wants_answer else None,
    )
