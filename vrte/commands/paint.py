"""`vrte paint`: all that a coatings laboratory reads off a paint, on one page."""

import argparse
from pathlib import Path

from vrte.commands.common import (
    Parser,
    add_options,
    check_extra,
    check_output,
    label_reading_errors,
    read_wavelengths,
    say_written,
    show_progress,
)


def add(command: Parser) -> None:
    """The arguments of `vrte paint`."""
    command.add_argument("scene", metavar="PAINT.toml", type=Path, help="with a table [paint], or any other scene")
    command.add_argument("-o", "--output", metavar="OUT.html", type=Path, help="the page; default: PAINT.html, here")
    command.add_argument("--png", metavar="OUT.png", type=Path, help="its pictures on one sheet")
    command.add_argument("--csv", metavar="OUT.csv", type=Path, help="all numbers, one a row")
    command.add_argument("--wavelengths-um", metavar="A,B,...", type=read_wavelengths, help="over the visible")
    command.add_argument("--illuminant", metavar="NAME", default="D65", help="of colours; default: D65")
    command.add_argument("--observer", type=int, choices=(2, 10), default=10, help="degrees; default: 10")
    command.add_argument("--layer", metavar="N", type=int, help="which layer is the film, counted from 1")
    add_options(command, "accuracy", "nodes")


def run(options: argparse.Namespace) -> None:
    page = options.output or Path(f"{options.scene.stem}.html")
    outputs = [(page, ".html"), (options.png, ".png"), (options.csv, ".csv")]
    for path, suffix in outputs:
        if path is not None:
            check_output(path, suffix)
    check_extra("vrte paint", "appearance", ("colour", "matplotlib"))
    from vrte.appearance.paint import paint

    asked = {name: getattr(options, name) for name in ("accuracy", "nodes") if getattr(options, name) is not None}
    light = {"illuminant": options.illuminant, "observer": options.observer, "layer": options.layer}
    with show_progress() as (phase, tick), label_reading_errors(options.scene):
        phase("paint")
        found = paint(options.scene, options.wavelengths_um, progress=tick, **light, **asked)
    print(found)
    for path, _ in outputs:
        if path is not None:
            found.save(path)
            say_written(path)
