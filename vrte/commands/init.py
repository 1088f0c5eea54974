"""`vrte init`: a commented scene file to begin with, or a table for what was measured."""

import argparse
import importlib.util
import shlex
from pathlib import Path

from vrte.basics.errors import SceneError
from vrte.commands.common import STARTERS, find_starter, write
from vrte.formats.atomic import write_text


def check(options: argparse.Namespace) -> None:
    """Whether a kind is named where it has to be, and no file is lost. Raises SceneError."""
    if options.kind is None:
        if options.output or options.force:
            raise SceneError(f"{'-o' if options.output else '--force'} needs a kind before it: {', '.join(STARTERS)}")
        return
    options.output = options.output or Path(find_starter(options.kind).name)
    if options.output.suffix.lower() != find_starter(options.kind).suffix:
        raise SceneError(f"{options.output} must end in {find_starter(options.kind).suffix}, as {options.kind} does")
    if options.output.is_file() and not options.force:
        raise SceneError(f"{options.output} is there already: -o names another file, --force writes over it")


def run(options: argparse.Namespace) -> None:
    if options.kind is None:
        for kind, (_, purpose) in STARTERS.items():
            print(f"{kind:12}{purpose}")
        print("next: vrte init powder")
        return
    starter = find_starter(options.kind).read_text("utf-8")
    write(options.output, lambda path: write_text(starter, path))
    print(f"next: {suggest_next(options.kind, options.output)}")
    if options.output.suffix.lower() == ".toml" and options.kind != "match":
        print(f"in a browser: {shlex.join(['vrte', 'view', str(options.output)])}")


def suggest_next(kind: str, path: Path) -> str:
    """The command that solves a scene file: into a picture, or a table without matplotlib; a paint into its page."""
    draws = importlib.util.find_spec("matplotlib") is not None
    output = ["--plot", path.with_suffix(".png")] if draws else ["-o", path.with_suffix(".csv")]
    if kind == "match":
        return shlex.join(["vrte", "paint", "--match", str(path)])
    output = [] if kind in ("paint", "measurement") else output
    return shlex.join(["vrte", STARTERS[kind][0], str(path), *map(str, output)])
