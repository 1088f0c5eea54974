"""The parser of `vrte`, with all its commands as --help lists them."""

from collections.abc import Sequence

from vrte.commands import (
    completion,
    devices,
    fit,
    init,
    material,
    materials,
    paint,
    phase,
    render,
    solve,
    sweep,
    view,
)
from vrte.commands.common import Parser

COMMANDS = (
    init,
    solve,
    sweep,
    fit,
    view,
    render,
    material,
    materials,
    paint,
    phase,
    devices,
    completion,
)
TOUR = (
    ("vrte init powder", "writes powder.toml, a scene file with comments"),
    ("vrte brdf powder.toml --plot powder.png", "solves it: its BRDF as a picture; -o powder.csv: as a table"),
    ("vrte view powder.toml", "a page in the browser: change the scene, turn its BRDF around"),
)

STUDIES = ("tables", "report", "stability", "benchmarks", "cost")  # targets of the source tree's Makefile


def explain_study(parser: Parser, arguments: Sequence[str]) -> None:
    """Says where a study of vrte itself is, where the first argument names one."""
    if arguments and arguments[0] in STUDIES:
        parser.error(f"{arguments[0]} is a study of vrte itself: run `make {arguments[0]}` in its source tree")


def make_parser() -> Parser:
    """The parser of the command line.

    >>> make_parser().parse_args(["brdf", "gold.toml", "--nodes", "8"]).nodes
    8
    """
    parser = Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.examples, parser.heading = TOUR, "a short tour"
    parser.set_defaults(run=None)
    parser.add_argument("--version", action="store_true", help="the version; with --verbose what a bug report needs")
    parser.add_argument("--verbose", action="store_true", help="with --version: machine, libraries, extras as well")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
