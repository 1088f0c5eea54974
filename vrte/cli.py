"""The command `vrte`: a scene file in, result files out; what its commands do is in vrte/commands.

Exit code 0, 1 for a failure, 2 for bad input, 130 for Ctrl-C and 143 for SIGTERM; every error is one line on standard
error.
"""

import argparse
import logging
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NoReturn, TextIO

from vrte import __version__
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError
from vrte.basics.starting import WORDS, end
from vrte.commands import (
    benchmarks,
    devices,
    material,
    materials,
    paint,
    phase,
    render,
    report,
    solve,
    stability,
    sweep,
    tables,
    view,
)

COMMANDS = (
    solve,
    sweep,
    view,
    render,
    material,
    materials,
    paint,
    phase,
    stability,
    benchmarks,
    tables,
    report,
    devices,
)  # as --help lists them

IMPATIENT = 1.0  # seconds after which a second Ctrl-C is one


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line, by default this process's own; returns the exit code.

    >>> main(["material", "water", "--wavelength-um", "nonsense"])
    Traceback (most recent call last):
    SystemExit: 2
    """
    with _catch_signals() as came:
        try:
            if sys.stdout is None:
                return _complain("standard output is closed, and nobody would see what was found", 1)
            options = _make_parser().parse_args(arguments)
            with _shorten_warnings():
                options.run(options)
                sys.stdout.flush()
        except BaseException as error:
            return _complain(WORDS[came[0]], 128 + came[0]) if came else _answer(error)
    return 0


def _answer(error: BaseException) -> int:
    """One line on what went wrong, and the exit code; what nobody has foreseen is raised again."""
    if isinstance(error, OSError) and not _is_open(sys.stdout):
        _let_go_of(sys.stdout)
    if isinstance(error, BrokenPipeError):
        return 1  # whoever read our output has gone: nobody is left to tell
    if isinstance(error, KeyboardInterrupt):
        return _complain(WORDS[signal.SIGINT], 128 + signal.SIGINT)
    if isinstance(error, SceneError):
        return _complain(str(error), 2)
    if isinstance(error, (AccuracyError, DeviceError, MissingExtraError, SweepError, OSError)):
        return _complain(str(error), 1)
    if isinstance(error, MemoryError):
        return _complain("not enough memory for this scene: fewer directions or nodes need less", 1)
    raise error


def _is_open(stream: TextIO) -> bool:
    """Whether what is printed still gets somewhere."""
    try:
        stream.flush()
    except OSError:
        return False
    return True


def _let_go_of(stream: TextIO) -> None:
    """Nothing more comes to a stream that cannot be written to: its flush at exit would fail again."""
    with suppress(OSError), open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def _complain(message: str, code: int) -> int:
    if sys.stderr is not None:
        print(f"vrte: error: {' '.join(message.split())}", file=sys.stderr)
    return code


class _Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"vrte: error: {message} (see `{self.prog} --help`)\n")


def _make_parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.add_argument("--version", action="version", version=f"vrte {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser


@contextmanager
def _catch_signals() -> Iterator[list[signal.Signals]]:
    """Lets the first SIGINT or SIGTERM unwind the stack, so that half-written files go; yields those that came.

    From then on what libraries say of being stopped is no news. A second signal, a while later, ends the process at
    once. Only a main thread may ask for that.
    """
    came: list[signal.Signals] = []
    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    since = [0.0]

    def answer(number: int, frame: Any) -> None:
        if came:
            if time.monotonic() - since[0] > IMPATIENT:
                end(number)
            return
        came.append(signal.Signals(number))
        since[0] = time.monotonic()
        logging.disable(logging.CRITICAL)
        sys.unraisablehook = lambda _: None
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(128 + number)

    before = {number: signal.getsignal(number) for number in WORDS}
    before = {number: handler for number, handler in before.items() if handler not in (signal.SIG_IGN, None)}
    for number in before:
        signal.signal(number, answer)
    try:
        yield came
    finally:
        for number, handler in before.items():
            # the command has said why it ends: no second line while the interpreter does
            said = bool(came) and handler is end
            signal.signal(number, (lambda *_: os._exit(128 + came[0])) if said else handler)


@contextmanager
def _shorten_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_, **__: print(f"vrte: warning: {message}", file=sys.stderr)
        yield


if __name__ == "__main__":
    sys.exit(main())
