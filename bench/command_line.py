"""What the studies' command lines have in common: how they are read, and how they answer."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from vrte.cli import main
from vrte.commands.common import Parser

Run = Callable[[argparse.Namespace], None]


def make_command(name: str, told: str, *examples: tuple[str, str]) -> Parser:
    """The parser of ``python -m bench.NAME``; ``told`` says in one line what comes of it."""
    command = Parser(prog=f"python -m bench.{name}", description=f"{told[0].upper()}{told[1:]}.")
    command.examples = examples
    return command


def add_study(command: Parser, quick: str, fresh: bool = True) -> None:
    """Options that most studies share: where to write, and how much is measured."""
    folder = Path(command.prog.rpartition(".")[-1])
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=folder, help="made if absent")
    command.add_argument("--quick", action="store_true", help=quick)
    if fresh:
        command.add_argument("--fresh", action="store_true", help="forget what an earlier run has finished")


def run_command(command: Parser, run: Run, arguments: Sequence[str] | None = None) -> int:
    """Runs a study as `vrte` runs a command; returns the exit code."""
    command.set_defaults(run=run, version=False, verbose=False)
    return main(arguments, command)
