"""The parser of `vrte`, with all its commands as --help lists them."""

from vrte.commands import (
    benchmarks,
    completion,
    devices,
    fit,
    init,
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
    stability,
    benchmarks,
    tables,
    report,
    devices,
    completion,
)
TOUR = (
    ("vrte init powder", "writes powder.toml, a scene file with comments"),
    ("vrte brdf powder.toml --plot powder.png", "solves it: its BRDF as a picture; -o powder.csv: as a table"),
    ("vrte view powder.toml", "a page in the browser: change the scene, turn its BRDF around"),
)


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
