"""The command `vrte`: a scene file in, result files out; what its commands do is in vrte/commands.

Exit code 0, 1 for a failure, 2 for bad input, 130 for Ctrl-C and 143 for SIGTERM; every error is one line on standard
error.
"""

import codecs
import logging
import os
import signal
import sys
import threading
import time
import unicodedata
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from vrte import __version__
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError
from vrte.basics.running import is_left_working
from vrte.basics.starting import IS_COMMAND, WORDS, end
from vrte.commands.common import Parser, carry_out, find_page, make_parser

IMPATIENT = 1.0  # seconds after which a second Ctrl-C is one
SPELLED = {"\u03bc": "u", "°": " deg", "±": "+-", "\u2212": "-", "–": "-"}  # on terminals that have no such signs


def replace_signs(error: UnicodeError) -> tuple[str, int]:
    """What is printed where an encoding lacks a sign, and where to go on.

    >>> "2 µm²".encode("ascii", "vrte")
    b'2 um2'
    """
    assert isinstance(error, UnicodeEncodeError)
    signs = unicodedata.normalize("NFKD", error.object[error.start : error.end])
    plain = (sign if sign.isascii() else SPELLED.get(sign, "?") for sign in signs if not unicodedata.combining(sign))
    return "".join(plain), error.end


codecs.register_error("vrte", replace_signs)


def main(arguments: Sequence[str] | None = None, parser: Parser | None = None) -> int:
    """Runs the command line, by default this process's own, by a parser, by default that of `vrte`; returns the exit
    code.

    >>> main(["material", "water", "--wavelength-um", "nonsense"])
    Traceback (most recent call last):
    SystemExit: 2
    """
    with _catch_signals() as came:
        try:
            if sys.stdout is None:
                return _complain("standard output is closed, and nobody would see what was found", 1)
            for stream in (sys.stdout, sys.stderr):
                if hasattr(stream, "reconfigure"):
                    stream.reconfigure(errors="vrte")
            if parser is None:
                typed = sys.argv[1:] if arguments is None else arguments
                parser = make_parser(typed)
            options = parser.parse_args(arguments)
            if options.version:
                from vrte.calls.versions import describe_versions

                print(describe_versions() if options.verbose else f"vrte {__version__}", flush=True)
                return 0
            if options.verbose or options.run is None:
                parser.error("--verbose goes with --version" if options.verbose else "COMMAND is missing")
            with _shorten_warnings():
                carry_out(options)
                sys.stdout.flush()
        except BaseException as error:
            if came and IS_COMMAND and is_left_working():
                end(came[0])
            return _complain(WORDS[came[0]], 128 + came[0]) if came else _answer(error)
    return 0


def _answer(error: BaseException) -> int:
    """One line on what went wrong, and the exit code; an unforeseen error is raised again."""
    if isinstance(error, OSError):
        _release(sys.stdout)
    if isinstance(error, BrokenPipeError):
        return 1  # the reader of standard output has gone
    if isinstance(error, KeyboardInterrupt):
        return _complain(WORDS[signal.SIGINT], 128 + signal.SIGINT)
    if isinstance(error, (SceneError, AccuracyError, DeviceError, MissingExtraError, SweepError, OSError)):
        page = find_page(error)
        return _complain(f"{error} ({page})" if page else str(error), 2 if isinstance(error, SceneError) else 1)
    if isinstance(error, MemoryError):
        return _complain("not enough memory for this scene: fewer directions or nodes need less", 1)
    raise error


def _release(stream: TextIO) -> None:
    """Sends a stream that cannot be written to nowhere: its flush at exit would fail again."""
    try:
        stream.flush()
    except OSError:
        with suppress(OSError), open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), stream.fileno())


def _complain(message: str, code: int) -> int:
    if sys.stderr is not None:
        print(f"vrte: error: {' '.join(message.split())}", file=sys.stderr)
    return code


@contextmanager
def _catch_signals() -> Iterator[list[signal.Signals]]:
    """Lets the first SIGINT or SIGTERM unwind the stack, so that half-written files go; yields those that came.

    Messages of libraries about the interrupt are not shown. A second signal, a while later, ends the process at once.
    Only a main thread may do that.
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
            # the command has reported why it ends: no second line while the interpreter does
            reported = bool(came) and handler is end
            signal.signal(number, (lambda *_: os._exit(128 + came[0])) if reported else handler)


@contextmanager
def _shorten_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = lambda message, *_, **__: print(f"vrte: warning: {message}", file=sys.stderr)
        yield


if __name__ == "__main__":
    sys.exit(main())
