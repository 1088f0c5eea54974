"""What comes before all other modules: answers to Ctrl-C and SIGTERM while they load, and idle threads that sleep.

`import vrte` imports this first, for `vrte` and `python -m vrte.cli` alone: other programs keep their own ways.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

POLICY = "OMP_WAIT_POLICY"  # read once, when the first library brings OpenMP; by default idle threads spin
WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}


@contextmanager
def wait_passively() -> Iterator[None]:
    """The policy for what is loaded within, where the user has set none; other programs' OpenMP keeps its own."""
    if POLICY in os.environ:
        yield
        return
    os.environ[POLICY] = "passive"
    try:
        yield
    finally:
        del os.environ[POLICY]


def is_command() -> bool:
    """Whether this process is the command `vrte`, and none that it has started."""
    begun = sys.argv[0] if sys.argv else ""
    if begun == "-m":
        return "vrte.cli" in sys.orig_argv
    return os.path.basename(begun) in ("vrte", "vrte.exe") and begun in sys.orig_argv


def end(number: int, frame: Any = None) -> None:
    """Ends the process at once, with a line that says why and the code that shells give to this signal."""
    with suppress(OSError):
        os.write(2, f"vrte: error: {WORDS[signal.Signals(number)]}\n".encode())
    os._exit(128 + number)


IS_COMMAND = is_command()  # `python -m vrte.cli` shows it in sys.argv until its module has loaded
if IS_COMMAND:
    for signal_number in WORDS:
        if signal.getsignal(signal_number) is not signal.SIG_IGN:  # as a shell starts what runs in the background
            signal.signal(signal_number, end)
