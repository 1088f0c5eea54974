"""`vrte paint`: all that a coatings laboratory reads off a paint, on one page; first, if asked, matched to a target."""

import argparse
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import check_extra, label_errors, show_progress, write

OPTIONS = ("illuminant", "observer", "layer", "accuracy", "nodes")


def check(options: argparse.Namespace) -> None:
    """Sets the page's default path, and checks that it can be drawn. Raises SceneError, MissingExtraError."""
    source = options.scene or options.match
    if source is None:
        raise SceneError("PAINT.toml is missing: a scene file, or --match TARGET.toml, which names a paint")
    if options.toml and not options.match:
        raise SceneError("--toml goes with --match: the scene file of the recipe")
    options.output = options.output or Path(f"{source.stem}.html")
    check_extra("vrte paint", "appearance", ("colour", "matplotlib"))


def run(options: argparse.Namespace) -> None:
    from vrte.appearance.paint import paint
    from vrte.fit.match import match_file

    asked: dict[str, Any] = {name: value for name in OPTIONS if (value := getattr(options, name)) is not None}
    scene = options.scene
    with show_progress() as (phase, tick):
        if options.match:
            with label_errors(options.match, reading=True):
                phase("match")
                matched = match_file(options.match, scene, progress=tick)
                scene, asked["folder"] = dict(matched.content), matched.folder
        with label_errors(options.scene or options.match, reading=True):
            phase("paint")
            found = paint(scene, options.wavelengths_um, progress=tick, spread=options.spread, **asked)
    if options.match:
        print(matched)
        write(options.toml, matched.write_scene)
    print(found)
    for path in (options.output, options.png, options.csv):
        write(path, found.save)
