"""`vrte brdf` and `vrte field`: a scene file in, result files out."""

import argparse
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vrte import __version__
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.commands import spectrum
from vrte.commands.common import (
    Found,
    Parser,
    Seconds,
    Tick,
    add_options,
    check_extra,
    check_output,
    label_errors,
    label_reading_errors,
    say_written,
    show_progress,
    tell_derivatives,
)
from vrte.formats.contents import Result
from vrte.formats.csv_table import write_csv
from vrte.formats.result_file import FORMATS
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import SceneFile, read_scene
from vrte.pictures.figures import SUFFIXES as PICTURES
from vrte.request.how import EXACT, OPTIONS
from vrte.request.request import SIDES
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.results.spectrum import add_scene_text
from vrte.scene.interface import Interface

HOW = tuple(name for name in OPTIONS if name != "settings")  # options that win over the scene file
OUTPUTS = {"output": tuple(FORMATS), "csv": (".csv",), "plot": tuple(PICTURES)}
EXTRAS = {  # by suffix
    ".nc": ("files", ("xarray", "h5netcdf")),
    ".zarr": ("files", ("xarray", "zarr")),
    **dict.fromkeys(PICTURES, ("plot", ("matplotlib",))),
}


def add(command: Parser) -> None:
    """The arguments of `vrte brdf` and of `vrte field`."""
    kind = command.prog.split()[-1]
    command.epilog = "What is said here wins over the scene file."
    command.set_defaults(kind=kind, wavelengths_um=None, mitsuba=None)
    command.add_argument("scene", metavar="SCENE.toml", type=Path, help="what light meets, and what is asked")
    written = ".nc: NetCDF; .csv: a table, which needs no extra; .zarr: Zarr"
    command.add_argument("-o", "--output", metavar="OUT", type=Path, help=written)
    command.add_argument("--csv", metavar="OUT.csv", type=Path, help="beside -o or alone: one row a direction")
    command.add_argument("--plot", metavar="OUT.png", type=Path, help="a picture; .svg and .pdf too")
    add_options(command, *HOW)
    told = "also how all changes with this number of the scene, such as layer[1].thickness; any number of times"
    command.add_argument("--derivative", metavar="NAME", dest="derivatives", action="append", default=[], help=told)
    told = "a setting of the method, any number of times"
    command.add_argument("--set", metavar="NAME=VALUE", type=read_setting, action="append", default=[], help=told)
    if kind == "brdf":
        spectrum.add_options(command)
    else:
        told = "of an interface, for depths tau at one; default: above, so that 0 is outside"
        command.add_argument("--side", choices=SIDES, help=told)


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


def run(options: argparse.Namespace) -> None:
    check_outputs(options)
    several, seconds = bool(options.wavelengths_um), Seconds()
    with show_progress() as (phase, tick):
        found = (spectrum.solve if several else solve)(options, collect_keywords(options), seconds, phase, tick)
    (spectrum.describe if several else describe)(options.scene, found)
    paths = [write_result(found.result, options, name, seconds) for name in OUTPUTS if getattr(options, name)]
    if found.table:
        paths += spectrum.write_table(found, options, seconds)
    print_times(seconds, spectrum.sum_stages(found.result))
    for path in paths:
        say_written(path)


def solve(
    options: argparse.Namespace, asked: dict[str, Any], seconds: Seconds, phase: Callable[[str], None], tick: Tick
) -> Found:
    """At the wavelength of the scene file."""
    phase("particles")
    with seconds.of("particles"), label_reading_errors(options.scene):
        file = read_scene(options.scene, options.kind)
        variations = SceneFamily(options.scene, options.derivatives).variations() if options.derivatives else None
    check_picture(options, file)
    phase("Fourier orders, then directions")
    call: Callable[..., Brdf | Field] = brdf if file.kind == "brdf" else radiance
    with seconds.of("solver"), label_errors(options.scene), file.located():
        result = call(file.scene, progress=tick, derivatives=variations, **file.keywords(asked))
    return Found([file], add_scene_text(result, file.text))


def check_outputs(options: argparse.Namespace) -> None:
    """Whatever would fail after the work is done, as far as it can be seen before."""
    asked = {name: getattr(options, name) for name in OUTPUTS if getattr(options, name)}
    if not asked and not options.mitsuba:
        raise SceneError("nothing to write: -o, --csv or --plot names a file for the result")
    for name, path in asked.items():
        check_output(path, *OUTPUTS[name])
    if options.kind == "brdf":
        options.wavelengths_um = options.wavelengths_um or spectrum.read_file_wavelengths(options.scene)
        spectrum.check_options(options)
    for path in asked.values():
        if path.suffix.lower() in EXTRAS:
            check_extra(f"writing {path}", *EXTRAS[path.suffix.lower()])


def check_picture(options: argparse.Namespace, file: SceneFile) -> None:
    if options.plot and file.kind == "brdf":
        from vrte.results.over_hemisphere import check_directions

        check_directions(file.request["mu_o"], file.request.get("phi", 0.0))


def collect_keywords(options: argparse.Namespace) -> dict[str, Any]:
    """The keywords that the command line wins with over the scene file."""
    found = {name: getattr(options, name) for name in (*HOW, "side") if getattr(options, name, None) is not None}
    return found | ({"settings": dict(options.set)} if options.set else {})


def write_result(result: Result, options: argparse.Namespace, name: str, seconds: Seconds) -> Path:
    path: Path = getattr(options, name)
    with seconds.of(f"writing {path.suffix}"):
        if name == "output":
            result.save(path)
        elif name == "csv":
            write_csv(result, path)
        else:
            from vrte.pictures.results import save_plot

            save_plot(result, path)
    return path


def describe(path: Path, found: Found) -> None:
    """What was computed, of what, and how."""
    file, result = found.files[0], found.result
    what = "BRDF" if isinstance(result, Brdf) else "field"
    print(f"vrte {__version__}: {'' if file.scene.has_interfaces else 'subsurface '}{what} of {path}")
    for name, particles in file.particles.items():
        print(f"  {name}: {particles.description}")
    for place, (layer, index) in enumerate(zip(file.scene.layers, file.scene.indices, strict=True)):
        tell_interface(file.scene.interfaces[place])
        matrix, medium = layer.phase_matrix, f", in index {index:g}" if file.scene.has_interfaces else ""
        print(
            f"  layer {place + 1}: optical thickness {layer.thickness:g}, single-scattering albedo {layer.albedo:.6g}, "
            f"asymmetry {matrix.asymmetry:.4f}, {matrix.terms} terms{medium}"
        )
    tell_interface(file.scene.interfaces[-1])
    base = "black" if file.scene.base is None else str(file.scene.base)
    print(f"  base: {base}{'' if file.scene.base_is_reached else ', which no light reaches'}")
    made = result.diagnostics
    print(f"  {result!r}")
    where = f"OpenCL device {made['device']}" if "device" in made else f"{made['threads']} threads"
    orders = f", {made['orders']} Fourier orders" if "orders" in made else ""
    print(f"  {made['method']}, {made['nodes']} nodes{orders}, {where}")
    tell_derivatives(result, made)
    if "method_rule" in made:
        print(f"  {made['method_rule']}")
    if made["method"] == EXACT:
        describe_plan(made)
    if "agreement" in made:
        print(f"  {describe_agreement(made['agreement'])}")
    if isinstance(result, Brdf):
        diffuse = "" if result.specular is None else ", diffuse"
        print(f"  directional-hemispherical reflectance{diffuse}: {list_shares(result.reflectance, result.mu_i)}")
        if result.specular_reflectance is not None:
            print(f"  mirrored as a beam, and not in it: {list_shares(result.specular_reflectance, result.mu_i)}")
        if result.surface is not None:
            print("  with what rough surfaces send back without any particle, which is in surface as well")
    elif result.index is not None:
        print(f"  depths in media of index {', '.join(f'{index:g}' for index in np.unique(result.index))}")


def tell_interface(interface: Interface | None) -> None:
    """Prints a line about an interface where there is one."""
    if interface is not None:
        print(f"  {interface.in_words}")


def list_shares(shares: Array, mu_i: Array) -> str:
    """The first few shares of light, and at which cosines they are."""
    shown = ", ".join(f"{share:.4f} at mu_i {mu:g}" for share, mu in zip(shares[:6], mu_i[:6], strict=True))
    return f"{shown}{', ...' if mu_i.size > 6 else ''}"


def describe_plan(made: dict[str, Any]) -> None:
    """How discrete ordinates went about it."""
    print(f"  by {made['algorithm']} ({made['algorithm_rule']})")
    print(f"  truncation: {made['truncation']} ({made['truncation_rule']})")
    if made["orders_repeated"]:
        print(f"  {len(made['orders_repeated']['orders'])} orders repeated by {made['orders_repeated']['by']}")


def describe_agreement(found: dict[str, Any]) -> str:
    """What `verify` found, in words."""
    if not found["orders_compared"]:
        return f"{found['with']} cannot vouch for any order: nothing to compare"
    flux = "" if found["flux"] is None else f", {found['flux']:.1e} in flux"
    agreed = f"{found['with']} agrees to {found['radiance']:.1e} in radiance{flux}"
    return f"{agreed} ({found['orders_compared']} orders compared)"


def print_times(seconds: Seconds, stages: dict[str, dict[str, float]]) -> None:
    """A table of wall seconds, and of seconds summed over the threads for the stages of the solver."""
    print(f"\n  {'stage':22}{'wall s':>9}{'thread s':>10}")
    for name, wall in seconds.items():
        print(f"  {name:22}{wall:9.3f}")
        if name == "solver":
            for stage, took in stages.items():
                print(f"    {stage:20}{took['wall_seconds']:9.3f}{took['thread_seconds']:10.3f}")
    print(f"  {'total':22}{sum(seconds.values()):9.3f}\n")
