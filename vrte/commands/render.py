"""`vrte render`: pictures of spheres with the BRDFs of scene files, under a polarized sky."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from vrte.commands.common import (
    add_command,
    check_extra,
    check_output,
    join_progress,
    make_whole_number_reader,
    say_written,
    show_progress,
)
from vrte.render.colour import FEWEST, MOST
from vrte.render.setting import LARGEST_SIZE, SMALLEST_SIZE, read


def add(commands: Any) -> None:
    """Adds `vrte render`, which draws spheres with the BRDFs of scenes, to the commands."""
    told = "pictures of spheres with the BRDFs of scenes, under a polarized sky"
    command = add_command(
        commands,
        "render",
        run,
        told,
        ("vrte render paint.toml -o paint.png", "a sphere of the paint, its colour and its polarization"),
        ("vrte render paint.toml powder.toml -o both.png --size 200", "two small ones beside each other"),
    )
    command.add_argument("scenes", metavar="SCENE.toml", type=Path, nargs="+", help="a sphere each")
    command.add_argument("-o", "--output", metavar="OUT.png", type=Path, required=True, help="the picture")
    command.add_argument(
        "--size",
        metavar="PIXELS",
        type=make_whole_number_reader(SMALLEST_SIZE, LARGEST_SIZE),
        help="of a sphere's side",
    )
    command.add_argument(
        "--wavelengths",
        metavar="N",
        type=make_whole_number_reader(FEWEST, MOST),
        help=f"from 0.4 to 0.7 um; default: {FEWEST}",
    )
    kind = command.add_mutually_exclusive_group()
    kind.add_argument("--colour-only", action="store_true", help="no polarization, no text, transparent background")
    kind.add_argument(
        "--sheet", action="store_true", help="beside each sphere its lobes at mu_i = 0.6 and 1, at 0.64 um"
    )


def run(options: argparse.Namespace) -> None:
    check_output(options.output, ".png")
    check_extra("vrte render", "render", ("colour", "matplotlib"))
    materials, setting = read(options.scenes, options.wavelengths)
    if options.size:
        setting = replace(setting, size_px=options.size)
    from vrte.render import gallery, picture
    from vrte.render.rendering import compute_spheres

    with show_progress() as (phase, tick):
        phase("colours")
        spheres = compute_spheres(materials, setting, join_progress(phase, tick))
        phase("picture")
        if options.colour_only:
            picture.save_colours(spheres, options.output)
        elif options.sheet:
            gallery.save(spheres, setting, options.output, join_progress(phase, tick))
        else:
            picture.save(spheres, setting, options.output)
    for sphere in spheres:
        print(f"  {sphere.material.title}: {describe_sphere(sphere)}")
    say_written(options.output)


def describe_sphere(sphere: Any) -> str:
    """At which wavelengths, and how well its BRDF is known between directions."""
    from vrte.render.picture import say_wavelengths

    wavelengths = say_wavelengths(sphere.material.wavelengths_um.tolist())
    note = f" ({sphere.material.note})" if sphere.material.note else ""
    return f"{wavelengths}{note}; BRDF between the directions solved for good to {sphere.error:.0e} of its largest"
