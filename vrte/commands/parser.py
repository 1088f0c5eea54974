"""The parser of `vrte`, with all its commands as --help lists them."""

from collections.abc import Sequence
from importlib import import_module

from vrte.commands.common import Parser
from vrte.commands.pages import OF_COMMANDS

COMMANDS: dict[str, tuple[str, str, tuple[tuple[str, str], ...]]] = {  # by name: module, what comes of it, examples
    "init": (
        "init",
        "a commented scene file to begin with; without a kind, a list of them",
        (
            ("vrte init", "lists the kinds"),
            ("vrte init paint -o white.toml", "writes a white paint into white.toml, and says what to type next"),
        ),
    ),
    "brdf": (
        "solve",
        "the Mueller BRDF of a scene, at one wavelength or several",
        (
            ("vrte brdf powder.toml --plot powder.png", "its lobes as a picture"),
            (
                "vrte brdf paint.toml --wavelengths-um 0.45,0.55,0.65 -o paint.csv",
                "three wavelengths, a row a direction",
            ),
        ),
    ),
    "field": (
        "solve",
        "the Stokes field inside and above a scene",
        (
            ("vrte field cloud.toml --plot cloud.png", "light above and below a cloud, as a picture"),
            (
                "vrte field cloud.toml --nodes 24 --verify -o cloud.csv",
                "finer, checked by another algorithm, as a table",
            ),
        ),
    ),
    "sweep": (
        "sweep",
        "the Mueller BRDFs, or Stokes fields, of many scenes, as one table",
        (
            (
                "vrte sweep examples/gold_table.toml -o gold.zarr",
                "588 gold powders, by radius and wavelength, into a folder",
            ),
            ("vrte sweep examples/gold_table.toml -o gold.nc --workers 2", "the same as one file, on two cores"),
        ),
    ),
    "fit": (
        "fit",
        "the numbers of a scene that fit a measurement best, with error bars",
        (
            ("vrte fit examples/fit_film.toml -o film.html", "thickness and albedo of a film, as a page with pictures"),
            (
                "vrte fit examples/fit_film.toml --resume film.state -o film.toml",
                "the fitted scene as a file; after Ctrl-C the same goes on from there",
            ),
        ),
    ),
    "view": (
        "view",
        "a local web page: describe a scene as a form, solve it, turn its BRDF around",
        (
            ("vrte view powder.toml", "the page, with this scene in it"),
            ("vrte view --no-browser --port 9000", "prints the address and opens nothing"),
        ),
    ),
    "render": (
        "render",
        "pictures of spheres and other objects with the BRDFs of scenes, under a polarized sky",
        (
            ("vrte render paint.toml -o paint.png", "a sphere of the paint, its colour and its polarization"),
            (
                "vrte render paint.toml powder.toml --object vase --sheet -o both.png",
                "vases, and the lobes of both materials",
            ),
        ),
    ),
    "material": (
        "material",
        "the index of a substance and how its spheres scatter, or how a ready material does; without a name, a list",
        (
            ("vrte material gold --wavelength-um 0.64", "n and k of gold, and where they come from"),
            (
                "vrte material rutile --range-um 0.45:0.7:6 --radius-um 0.11 --host-index 1.5 -o rutile.csv",
                "n, k and how spheres of rutile in a resin scatter, as a table",
            ),
        ),
    ),
    "materials": (
        "materials",
        "the ready materials, paints, powders and snow, that scene files name",
        (
            ("vrte materials", "lists them, one line each"),
            ("vrte materials -o cards.png", "and draws the colour of each: a minute"),
        ),
    ),
    "paint": (
        "paint",
        "colour, hiding, gloss, Kubelka-Munk and more of a paint on one page",
        (
            ("vrte paint paint.toml", "its page, paint.html"),
            (
                "vrte paint paint.toml -o white.html --csv white.csv --illuminant A",
                "for lamp light, and all numbers as a table",
            ),
        ),
    ),
    "phase": (
        "phase",
        "a table of scattering matrices over angle as a phase matrix; without a file, conventions of other codes",
        (
            ("vrte phase", "lists the conventions of other codes"),
            (
                "vrte phase examples/rayleigh.csv -o rayleigh.csv",
                "the coefficients of a table over angle, as scene files take them",
            ),
        ),
    ),
    "devices": (
        "devices",
        "a list of OpenCL platforms and devices, and which one is taken",
        (
            ("vrte devices", "what there is, and which one is taken"),
            ("vrte devices --measure", "and how many products each computes in a second"),
            ("vrte devices --verify", "whether it computes what the processor does"),
        ),
    ),
    "completion": (
        "completion",
        "a script by which a shell completes what is typed after vrte, to be kept in a file",
        (
            (
                "vrte completion bash > ~/.local/share/bash-completion/completions/vrte",
                "for bash, from the next shell on",
            ),
            ("vrte completion fish > ~/.config/fish/completions/vrte.fish", "for fish, in its own folder"),
        ),
    ),
}
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


def make_parser(arguments: Sequence[str] | None = None) -> Parser:
    """The parser of the command line: with the arguments of all commands, or of that alone which the words typed name.

    >>> make_parser().parse_args(["brdf", "gold.toml", "--nodes", "8"]).nodes
    8
    """
    parser = Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.examples, parser.heading = TOUR, "a short tour"
    parser.set_defaults(run=None)
    parser.add_argument("--version", action="store_true", help="the version; with --verbose what a bug report needs")
    parser.add_argument("--verbose", action="store_true", help="with --version: machine, libraries, extras as well")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    typed = next((word for word in arguments or () if not word.startswith("-")), "")
    for name, (module, told, examples) in COMMANDS.items():
        command = commands.add_parser(name, help=told, description=f"{told[0].upper()}{told[1:]}.")
        if arguments is None or name == typed:
            command.examples, command.page = examples, OF_COMMANDS[name]
            made = import_module(f"vrte.commands.{module}")
            command.set_defaults(run=made.run)
            made.add(command)
    return parser
