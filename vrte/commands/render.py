"""`vrte render`: pictures of spheres and objects with the BRDFs of scene files, under a polarized sky."""

import argparse
from dataclasses import replace
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import check_extra, join_progress, report_written, show_progress
from vrte.render.geometry import SUFFIXES
from vrte.render.rendering import OBJECTS, SPHERE, check_object, read

OF_OBJECTS = (
    f"one for all scenes, or one for each: {', '.join(OBJECTS)}, or a mesh ({', '.join(SUFFIXES)}); default: what each "
    f"file says, or {SPHERE}"
)


def check(options: argparse.Namespace) -> None:
    """Whether colours can be computed. Raises MissingExtraError."""
    check_extra("vrte render", "render", ("colour", "matplotlib"))


def run(options: argparse.Namespace) -> None:
    shapes = [] if options.object is None else [read_object(name) for name in options.object.split(",")]
    materials, setting = read(options.scenes, options.wavelengths, shapes)
    if options.together and options.sheet:
        raise SceneError("--together and --sheet: a sheet has a row for each scene; leave out one of them")
    if options.together and any(material.shape == SPHERE for material in materials):
        raise SceneError("--together: a sphere is seen by itself; --object ball stands on the ground")
    if any(material.shape != SPHERE for material in materials):
        check_extra("a picture of an object", "render", ("trimesh", "embreex"))
    if options.size:
        setting = replace(setting, size_px=options.size)
    from vrte.pictures.figures import save
    from vrte.render import picture
    from vrte.render.rendering import compute_pictures

    with show_progress() as (phase, tick):
        phase("colours")
        report = join_progress(phase, tick)
        renderings = compute_pictures(materials, setting, report, together=options.together)
        phase("picture")
        if options.colour_only:
            picture.save_colours(renderings, options.output)
        elif options.sheet:
            save(picture.draw_sheet(renderings, setting, report), options.output, few_colours=False)
        elif options.together:
            save(picture.draw_row(renderings[0], setting), options.output, few_colours=False)
        else:
            save(picture.draw_figure(renderings, setting), options.output, few_colours=False)
    for rendering in renderings:
        for material, error in zip(rendering.materials, rendering.errors, strict=True):
            print(f"  {material.title}: {describe_picture(material, error)}")
    report_written(options.output)


def read_object(name: str) -> str:
    """The object of --object. Raises SceneError."""
    try:
        return check_object(name)
    except SceneError as error:
        raise SceneError(f"--object {name}: {error}") from None


def describe_picture(material: Any, error: float) -> str:
    """At which wavelengths, and how well its BRDF is known between directions."""
    from vrte.render.picture import describe_wavelengths

    wavelengths = describe_wavelengths(material.wavelengths_um.tolist())
    note = f" ({material.note})" if material.note else ""
    return f"{wavelengths}{note}; BRDF between the directions solved for good to {error:.0e} of its largest"
