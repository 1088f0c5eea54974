"""The parser of `vrte`, with all its commands as --help lists them."""

from collections.abc import Sequence
from importlib import import_module

from vrte.commands.common import COMMANDS, Parser

TOUR = (
    ("vrte init powder", "writes powder.toml, a scene file with comments"),
    ("vrte brdf powder.toml --plot powder.png", "solves it: its BRDF as a picture; -o powder.csv: as a table"),
    ("vrte view powder.toml", "a page in the browser: change the scene, turn its BRDF around"),
)
STUDIES = ("tables", "report", "stability", "benchmarks", "cost")  # targets of the source tree's Makefile


def make_parser(arguments: Sequence[str] | None = None) -> Parser:
    """The parser of the command line: with the arguments of all commands, or of that alone which the words typed name.

    >>> make_parser().parse_args(["brdf", "gold.toml", "--nodes", "8"]).nodes
    8
    """
    parser = Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.examples, parser.heading = TOUR, "a short tour"
    parser.set_defaults(run=None)
    parser.take("--version", "the version; with --verbose what a bug report needs")
    parser.take("--verbose", "with --version: machine, libraries, extras as well")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    typed = next((word for word in arguments or () if not word.startswith("-")), "")
    if arguments and arguments[0] in STUDIES:
        parser.error(f"{typed} is a study of vrte itself: run `make {typed}` in its source tree")
    for name, row in COMMANDS.items():
        command = commands.add_parser(name, help=row["help"], description=f"{row['help'][0].upper()}{row['help'][1:]}.")
        if arguments is None or name == typed:
            command.examples, command.page = row["examples"], row["page"]
            module = import_module(f"vrte.commands.{row['module']}")
            module.add(command)
            command.set_defaults(run=module.run, outputs=command.outputs, check=getattr(module, "check", None))
    return parser
