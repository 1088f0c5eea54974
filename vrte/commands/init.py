"""`vrte init`: a commented scene file to begin with."""

import argparse
import importlib.util
import shlex
from pathlib import Path

from vrte.basics.errors import SceneError
from vrte.commands.common import Parser, check_output, say_written
from vrte.commands.starters import FOLDER, KINDS
from vrte.formats.atomic import write_atomically


def add(command: Parser) -> None:
    """The arguments of `vrte init`."""
    command.add_argument("kind", nargs="?", choices=tuple(KINDS), help="what the scene is of")
    command.add_argument("-o", "--output", metavar="OUT.toml", type=Path, help="default: KIND.toml, here")
    command.add_argument("--force", action="store_true", help="writes over a file that is there")


def run(options: argparse.Namespace) -> None:
    if options.kind is None:
        if options.output or options.force:
            raise SceneError(f"{'-o' if options.output else '--force'} needs a kind before it: {', '.join(KINDS)}")
        for kind, (_, told) in KINDS.items():
            print(f"{kind:8}{told}")
        print("next: vrte init powder")
        return
    path = options.output or Path(f"{options.kind}.toml")
    check_output(path, ".toml")
    if path.exists() and not options.force:
        raise SceneError(f"{path} is there already: -o names another file, --force writes over it")
    with write_atomically(path) as part:
        part.write_bytes((FOLDER / f"{options.kind}.toml").read_bytes())
    say_written(path)
    print(f"next: {tell_next(options.kind, path)}")
    print(f"in a browser: {shlex.join(['vrte', 'view', str(path)])}")


def tell_next(kind: str, path: Path) -> str:
    """The command that solves a scene file: into a picture, or a table where no picture can be made; of a paint into a
    page, which has its own name without being told.

    >>> tell_next("cloud", Path("cloud.toml")).split(" --")[0]
    'vrte field cloud.toml'
    """
    draws = importlib.util.find_spec("matplotlib") is not None
    output = ["--plot", path.with_suffix(".png")] if draws else ["-o", path.with_suffix(".csv")]
    output = [] if kind == "paint" else output
    return shlex.join(["vrte", KINDS[kind][0], str(path), *map(str, output)])
