"""`vrte paint`: all that a coatings laboratory reads off a paint, on one page."""

import argparse
from pathlib import Path

from vrte.commands.common import check_extra, label_errors, show_progress, write

OPTIONS = ("illuminant", "observer", "layer", "accuracy", "nodes")


def check(options: argparse.Namespace) -> None:
    """Sets the page's default path, and checks that it can be drawn. Raises MissingExtraError."""
    options.output = options.output or Path(f"{options.scene.stem}.html")
    check_extra("vrte paint", "appearance", ("colour", "matplotlib"))


def run(options: argparse.Namespace) -> None:
    from vrte.appearance.paint import paint

    asked = {name: value for name in OPTIONS if (value := getattr(options, name)) is not None}
    with show_progress() as (phase, tick), label_errors(options.scene, reading=True):
        phase("paint")
        found = paint(options.scene, options.wavelengths_um, progress=tick, **asked)
    print(found)
    for path in (options.output, options.png, options.csv):
        write(path, found.save)
