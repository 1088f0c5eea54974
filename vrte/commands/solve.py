"""`vrte brdf` and `vrte field`: a scene file in, result files out."""

import argparse
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.basics.running import Run
from vrte.calls.brdf import brdf
from vrte.calls.mitsuba import check_nested, write_table
from vrte.calls.radiance import radiance
from vrte.calls.spectrum import prepare_scenes, solve_spectrum, vary_files
from vrte.commands.common import PICTURES, Parser, label_errors, say_written, show_progress
from vrte.commands.describe import describe, print_times
from vrte.formats import measured_polarized as mitsuba
from vrte.formats import result_file
from vrte.formats.contents import Result
from vrte.formats.result_file import write_csv
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import SceneFile, read_content, read_listed_wavelengths, read_scene
from vrte.request.how import OPTIONS
from vrte.request.request import SIDES
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.over_hemisphere import check_directions
from vrte.results.spectrum import add_scene_text, check_ascending

HOW = tuple(name for name in OPTIONS if name != "settings")  # options that win over the scene file


def add(command: Parser) -> None:
    """The arguments of `vrte brdf` and of `vrte field`."""
    kind = command.prog.split()[-1]
    command.epilog = "What is said here wins over the scene file."
    command.set_defaults(kind=kind, wavelengths_um=None, mitsuba=None)
    command.take("scene SCENE.toml", "what light meets, and what is asked")
    help_text = ".nc: NetCDF; .csv: a table, which needs no extra; .zarr: Zarr"
    command.take("-o --output OUT", help_text, suffixes=tuple(result_file.FORMATS))
    command.take("--csv OUT.csv", "beside -o or alone: one row a direction")
    command.take("--plot OUT.png", "a picture; .svg and .pdf too", suffixes=PICTURES)
    command.take_options(*HOW)
    help_text = "also how all changes with this number of the scene, such as layer[1].thickness; any number of times"
    command.take("--derivative NAME", help_text, dest="derivatives", action="append", default=[])
    help_text = "a setting of the method, any number of times"
    command.take("--set NAME=VALUE", help_text, type=read_setting, action="append", default=[])
    if kind == "field":
        help_text = "of an interface, for depths tau at one; default: above, so that 0 is outside"
        command.take("--side", help_text, choices=SIDES)
        return
    help_text = "ascending; they win over the scene file, and particles are worked out anew at each"
    command.take("--wavelengths-um UM,UM,...", help_text)
    command.take("--mitsuba OUT.bsdf", "a table for Mitsuba 3, measured_polarized, of exactly five wavelengths")
    help_text = f"step of its angles theta; default: {mitsuba.STEP:g}"
    command.take("--mitsuba-step-deg DEG", help_text, default=mitsuba.STEP)
    help_text = (
        "the table of what lies below the smooth surface on top, and OUT.xml with Mitsuba's own surface above it"
    )
    command.take("--mitsuba-nested", help_text)


def read_setting(text: str) -> tuple[str, Any]:
    """Name and value of a method's setting: a number where it is one, otherwise a word.

    >>> read_setting("orders=3"), read_setting("boundary=mark")
    (('orders', 3), ('boundary', 'mark'))
    """
    name, sign, value = text.partition("=")
    if not (name and sign):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    for read in (int, float):
        with suppress(ValueError):
            return name, read(value)
    return name, value


def check(options: argparse.Namespace) -> None:
    """Whether options go together and something is written; wavelengths from the file. Raises SceneError."""
    if not (options.output or options.csv or options.plot or options.mitsuba):
        raise SceneError("nothing to write: -o, --csv or --plot names a file for the result")
    if options.kind == "field":
        return
    if options.mitsuba_nested and not options.mitsuba:
        raise SceneError("--mitsuba-nested goes with --mitsuba", "mitsuba")
    if options.wavelengths_um is None:
        with label_errors(options.scene, reading=True):
            listed = read_listed_wavelengths(read_content(options.scene))
            options.wavelengths_um = listed and check_ascending(listed).tolist()
    if options.mitsuba:
        mitsuba.make_axes(options.mitsuba_step_deg)
        if not options.wavelengths_um:
            words = f"{mitsuba.WAVELENGTHS} wavelengths, by --wavelengths-um or in the scene file"
            raise SceneError(f"--mitsuba needs {words}", "mitsuba")
        mitsuba.check_wavelengths(options.wavelengths_um)
        if options.mitsuba_nested:
            check_nested(options.mitsuba, {"illuminate": options.illuminate or "top"})


def run(options: argparse.Namespace) -> None:
    asked = {name: getattr(options, name) for name in (*HOW, "side") if getattr(options, name, None) is not None}
    asked |= {"settings": dict(options.set)} if options.set else {}
    clock, paths, notes = Run(1), list[Path](), list[str]()
    with show_progress() as (phase, tick):
        phase("particles")
        with clock.timed("particles"), label_errors(options.scene, reading=True):
            files, solve = (prepare_several if options.wavelengths_um else prepare)(options, asked, tick)
        phase("wavelengths" if options.wavelengths_um else "Fourier orders, then directions")
        with clock.timed("solver"):
            result = solve()
        if options.mitsuba:
            phase("directions of the table")
            at, step, nested = np.array(options.wavelengths_um), options.mitsuba_step_deg, options.mitsuba_nested
            with clock.timed("table for Mitsuba"):
                notes = write_table(files, at, options.mitsuba, step, nested, tick, **asked)[1]
            paths = [options.mitsuba, *([options.mitsuba.with_suffix(".xml")] if nested else [])]
    describe(options.scene, files, result)
    writers = {"output": result_file.save, "csv": write_csv, "plot": save_picture}
    for path, save in ((getattr(options, name), save) for name, save in writers.items()):
        if path is not None:
            with clock.timed(f"writing {path.suffix}"):
                save(result, path)
            paths.append(path)
    for note in notes:
        print(f"  Mitsuba's table: {note}")
    print_times(clock.stages, result)
    for path in paths:
        say_written(path)


def prepare(
    options: argparse.Namespace, asked: dict[str, Any], tick: Any
) -> tuple[list[SceneFile], Callable[[], Result]]:
    """The scene at the wavelength of its file, and what solves it."""
    file = read_scene(options.scene, options.kind)
    variations = SceneFamily(options.scene, options.derivatives).variations() if options.derivatives else None
    if options.plot and file.kind == "brdf":
        check_directions(file.request["mu_o"], file.request.get("phi", 0.0))

    def solve() -> Result:
        call: Callable[..., Brdf | Field] = brdf if file.kind == "brdf" else radiance
        with file.located():
            found = call(file.scene, progress=tick, derivatives=variations, **file.keywords(asked))
        return add_scene_text(found, file.text)

    return [file], solve


def prepare_several(
    options: argparse.Namespace, asked: dict[str, Any], tick: Any
) -> tuple[list[SceneFile], Callable[[], Result]]:
    """The scenes at several wavelengths, and what solves them."""
    at = np.array(options.wavelengths_um)
    files, warned = prepare_scenes(options.scene, at, progress=tick, asked=asked)
    variations = vary_files(options.scene, at, options.derivatives or None)
    return files, lambda: solve_spectrum(files, at, tick, warned, variations, **asked)


def save_picture(result: Result, path: Path) -> None:
    """The picture of a result."""
    from vrte.pictures.results import save_plot

    save_plot(result, path)
