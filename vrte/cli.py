"""The command `vrte`: a scene file in, result files out; what its commands do is in vrte/commands.

Exit code 0, 1 for a failure, 2 for bad input, 130 for an interrupt; every error is one line on standard error.
"""

import argparse
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from vrte import __version__
from vrte.commands import devices, material, render, report, solve, stability, sweep, tables, view
from vrte.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError

COMMANDS = (solve, sweep, view, render, material, stability, tables, report, devices)  # as --help lists them


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line, by default this process's own; returns the exit code.

    >>> main(["material", "water", "--wavelength-um", "nonsense"])
    Traceback (most recent call last):
    SystemExit: 2
    """
    options = _parser().parse_args(arguments)
    try:
        with _termination_cleans_up(), _warnings_in_one_line():
            options.run(options)
            sys.stdout.flush()
    except KeyboardInterrupt:
        return _complain("interrupted", 130)
    except BrokenPipeError:
        # whoever read our output has gone: nobody is left to tell, and the flush at exit would fail again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except SceneError as error:
        return _complain(str(error), 2)
    except (AccuracyError, DeviceError, MissingExtraError, SweepError, OSError) as error:
        return _complain(str(error), 1)
    except MemoryError:
        return _complain("not enough memory for this scene: fewer directions or nodes need less", 1)
    return 0


def _complain(message: str, code: int) -> int:
    print(f"vrte: error: {' '.join(message.split())}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"vrte: error: {message} (see `{self.prog} --help`)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.add_argument("--version", action="version", version=f"vrte {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser


@contextmanager
def _termination_cleans_up() -> Iterator[None]:
    """Lets SIGTERM unwind the stack, so that half-written files go; only a main thread may ask for that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_, **__: print(f"vrte: warning: {message}", file=sys.stderr)
        yield


if __name__ == "__main__":
    sys.exit(main())
