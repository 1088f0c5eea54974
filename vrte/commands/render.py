"""`vrte render`: pictures of spheres and objects with the BRDFs of scene files, under a polarized sky."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vrte.basics.errors import SceneError
from vrte.basics.llvm import OLDEST
from vrte.commands.common import check_extra, join_progress, report_written, show_progress
from vrte.render.geometry import SUFFIXES
from vrte.render.rendering import OBJECTS, SPHERE, check_object, read, split_object
from vrte.render.tracing import SAMPLES

OF_OBJECTS = (
    f"one for all scenes, or one for each: {', '.join(OBJECTS)}, or a mesh ({', '.join(SUFFIXES)}); default: what each "
    f"file says, or {SPHERE}"
)
UPWARD = ("z", "y")
TRACERS = ("auto", "mitsuba", "own")
WRITTEN = (".png", ".svg", ".pdf", ".exr")


def check(options: argparse.Namespace) -> None:
    """Whether colours can be computed. Raises MissingExtraError."""
    check_extra("vrte render", "render", ("colour", "matplotlib"))


def choose_tracing(options: argparse.Namespace, shapes: Sequence[str]) -> Any:
    """How Mitsuba traces, None where it does not. Raises SceneError, MissingExtraError."""
    from vrte.render.tracing import Tracing, is_ready

    asked = [name for name in ("samples", "environment", "caustics") if getattr(options, name) not in (None, False)]
    exr = options.output.suffix.lower() == ".exr"
    needed = [*(f"--{name}" for name in asked), *(["-o OUT.exr"] * exr)] or ["--tracer mitsuba"]
    if options.tracer == "mitsuba" or asked or exr:
        if SPHERE in shapes:
            raise SceneError(f"{needed[0]}: a sphere by itself is not traced; --object ball stands on the ground")
        if options.tracer == "own":
            raise SceneError(f"{needed[0]}: is for Mitsuba, not with --tracer own")
        check_extra(needed[0], "mitsuba", ("mitsuba",))
        if not is_ready():
            raise SceneError(f"{needed[0]}: Mitsuba needs LLVM {OLDEST} or newer; DRJIT_LIBLLVM_PATH may name it")
    elif options.tracer == "own" or not is_ready():
        return None
    if options.environment is not None and not options.environment.is_file():
        raise SceneError(f"--environment: no such file: {options.environment}")
    if options.environment is not None and options.caustics:
        raise SceneError("--caustics: are of the sun, and --environment has none")
    return Tracing(options.samples or SAMPLES, options.environment, options.caustics)


def run(options: argparse.Namespace) -> None:
    shapes = [] if options.object is None else [read_object(name) for name in options.object.split(",")]
    materials, setting = read(options.scenes, options.wavelengths, shapes)
    if options.together and options.sheet:
        raise SceneError("--together and --sheet: a sheet has a row for each scene; leave out one of them")
    if options.together and any(material.shape == SPHERE for material in materials):
        raise SceneError("--together: a sphere is seen by itself; --object ball stands on the ground")
    if any(material.shape != SPHERE for material in materials):
        check_extra("a picture of an object", "render", ("trimesh", "embreex"))
    if options.up is not None:
        if all(split_object(material.shape)[0] in OBJECTS for material in materials):
            raise SceneError("--up: is of own meshes, and there is none")
        materials = [replace(material, up=options.up) for material in materials]
    if options.size:
        setting = replace(setting, size_px=options.size)
    tracing = choose_tracing(options, [material.shape for material in materials])
    if options.output.suffix.lower() == ".exr" and len(materials) > 1 and not options.together:
        raise SceneError("-o OUT.exr: holds one picture; --together makes one of several objects")
    if options.output.suffix.lower() == ".exr" and (options.sheet or options.colour_only or options.glare):
        raise SceneError("-o OUT.exr: holds radiances, neither a --sheet nor --colour-only nor --glare")
    from vrte.pictures.figures import save
    from vrte.render import picture
    from vrte.render.rendering import compute_pictures

    with show_progress() as (phase, tick):
        phase("colours")
        report = join_progress(phase, tick)
        renderings = compute_pictures(materials, setting, report, together=options.together, tracing=tracing)
        renderings = [replace(rendering, glare=options.glare) for rendering in renderings]
        phase("picture")
        if options.output.suffix.lower() == ".exr":
            picture.save_radiances(renderings[0], options.output)
        elif options.colour_only:
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
        if rendering.noise is not None:
            print(f"  {tracing.samples} samples of a pixel and wavelength by Mitsuba: noise {rendering.noise:.1%}")
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
