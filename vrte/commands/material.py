"""`vrte material`: refractive indices by name, how spheres of a substance scatter, and how a ready material does, over
wavelengths."""

import argparse
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.commands.common import Parser, check_extra, check_output, read_wavelengths, say_written, show_progress
from vrte.formats.atomic import write_atomically, write_sealed_text
from vrte.formats.columns import read_index
from vrte.formats.materials import SUFFIX, ReadyMaterial, choose_material, expand_materials, find_material
from vrte.formats.named import find_known_wavelengths
from vrte.formats.scene_file import make_scene_file
from vrte.formats.scene_writer import write_toml
from vrte.formats.toml_table import Table
from vrte.optics.refractive_index import MATERIALS, Material, refractive_index
from vrte.optics.spheres import spheres
from vrte.pictures.figures import SUFFIXES, save_figure
from vrte.results.spectrum import MOST_WAVELENGTHS, check_ascending

PLACE = "material"  # of its options, for the page that says more
INDEX = ("n", "k")
SCATTERING = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "absorption_um2")
PER_LENGTH = ("extinction_per_um", "transport_um")
CROSS_SECTIONS = "cross sections [µm²]"
Columns = dict[str, list[float]]


def add(command: Parser) -> None:
    """The arguments of `vrte material`."""
    command.add_argument(
        "name",
        nargs="?",
        help='a name, a path in the database such as "main/Au/Johnson", or a .csv of your own (wavelength_um,n,k); '
        "or a ready material (`vrte materials`), or a .toml of your own",
    )
    where = command.add_mutually_exclusive_group()
    where.add_argument("--wavelength-um", type=float, metavar="UM", help="wavelength in vacuum [micrometres]")
    where.add_argument("--wavelengths-um", metavar="UM,UM,...", type=read_wavelengths, help="ascending: a table")
    where.add_argument(
        "--range-um", metavar="LOW:HIGH:COUNT", type=read_range, help="so many, evenly from LOW to HIGH: a table"
    )
    command.add_argument("--radius-um", type=float, metavar="UM", help="of spheres: albedo, g, cross sections too")
    command.add_argument("--host-index", type=float, metavar="N", help="around the spheres; default: 1")
    command.add_argument("-o", "--output", type=Path, metavar="OUT.csv", help="the table, every digit")
    command.add_argument("--plot", type=Path, metavar="OUT.png", help="a picture; .svg and .pdf too")
    command.add_argument(
        "--scene", type=Path, metavar="OUT.toml", help="of a ready material: a scene file to begin with"
    )


def read_range(text: str) -> list[float]:
    """What reads LOW:HIGH:COUNT.

    >>> read_range("0.4:0.7:4")
    [0.4, 0.5, 0.6, 0.7]
    """
    try:
        low, high, count = text.split(":")
        if not (count.isdecimal() and 2 <= int(count) <= MOST_WAVELENGTHS):
            raise ValueError
        found: list[float] = check_ascending(np.linspace(float(low), float(high), int(count)).round(12)).tolist()
    except ValueError:  # a SceneError is one
        raise argparse.ArgumentTypeError(
            f"must be LOW:HIGH:COUNT, ascending and 2 to {MOST_WAVELENGTHS} of them, such as 0.4:0.7:31, not {text!r}"
        ) from None
    return found


def run(options: argparse.Namespace) -> None:
    one = [] if options.wavelength_um is None else [options.wavelength_um]
    at = options.wavelengths_um or options.range_um or one
    ready = options.name is not None and (options.name.endswith(SUFFIX) or find_material(options.name) is not None)
    check_options(options, at, ready)
    if options.name is None:
        for name, entry in MATERIALS.items():
            pages = " and ".join(entry.pages) if entry.pages else f"n = {entry.index:g}"
            print(f"{name:18}{pages}: {entry.reason}")
        return
    if ready:
        show_ready_material(options, at)
        return
    material = read_index(options.name) if options.name.endswith(".csv") else options.name
    index = refractive_index(material, at[0])
    with show_progress() as (phase, tick):
        phase(options.name)
        columns = compute_columns(material, at, options.radius_um, options.host_index, tick)
    if len(at) == 1 and options.radius_um is None:
        print(f"{options.name} at {at[0]:g} um: n = {index.n:.6g}, k = {index.k:.6g}")
    else:
        print_table(columns)
    print(f"from {index.source}")
    groups: list[tuple[str, tuple[str, ...]]] = [("refractive index", INDEX)]
    if options.radius_um is not None:
        groups += [(f"spheres of radius {options.radius_um:g} µm", SCATTERING[:2]), (CROSS_SECTIONS, SCATTERING[2:])]
    write_columns(columns, options, groups)


def write_columns(columns: Columns, options: argparse.Namespace, groups: list[tuple[str, tuple[str, ...]]]) -> None:
    """The table and the picture that are asked for."""
    if options.output:
        write_table(columns, options.output)
        say_written(options.output)
    if options.plot:
        save_figure(draw_columns(columns, options.name, groups), options.plot)
        say_written(options.plot)


def show_ready_material(options: argparse.Namespace, at: list[float]) -> None:
    """What a ready material is, how its layer scatters over wavelengths, and a scene file to begin with."""
    material = choose_material(Table((), {"material": options.name}, ("material",)), Path())
    print(f"{material.title}: {material.description}")
    for words, listed in (("approximated", material.approximations), ("from", material.sources)):
        for line in listed:
            print(f"  {words}: {line}")
    if options.scene:
        write_whole_text(write_toml(make_example(options.name, material, options.scene.parent)), options.scene)
        say_written(options.scene)
    if not at:
        if not options.scene:
            print("--wavelength-um, --wavelengths-um or --range-um: how it scatters there")
        return
    rows = []
    with show_progress() as (phase, tick):
        phase(options.name)
        for place, wavelength in enumerate(at):
            rows.append(describe_layer(options.name, wavelength))
            tick(place + 1, len(at))
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    print_table(columns)
    lengths = tuple(name for name in PER_LENGTH if name in columns)
    sections = tuple(name for name in SCATTERING[2:] if name in columns)
    groups = [("layer", SCATTERING[:2]), ("lengths [µm, 1/µm]", lengths), (CROSS_SECTIONS, sections)]
    write_columns(columns, options, [group for group in groups if group[1]])


def describe_layer(name: str, wavelength_um: float) -> dict[str, float]:
    """How a ready material's layer scatters: with a geometrical thickness, extinction a length and the transport mean
    free path 1/(extinction (1 - albedo g)); of one kind of particles, cross sections [um2] of each alone."""
    request = {"brdf": {"mu_i": 1.0, "mu_o": 1.0}}
    file = make_scene_file({"wavelength_um": wavelength_um, "layer": [{"material": name}], **request})
    layer = file.scene.layers[0]
    length = expand_materials({"layer": [{"material": name}]})["layer"][0].get("thickness_um", math.inf)
    g = layer.phase_matrix.asymmetry
    found = {"wavelength_um": wavelength_um, "host_index": layer.host_index or 1.0, "albedo": layer.albedo}
    found |= {"asymmetry": g, "thickness": layer.thickness}
    if math.isfinite(length) and length > 0.0:
        extinction = layer.thickness / length
        found |= {"extinction_per_um": extinction, "transport_um": 1.0 / (extinction * (1.0 - layer.albedo * g))}
    if len(file.particles) == 1:
        (alone,) = file.particles.values()
        absorbed = max(alone.extinction_um2 - alone.scattering_um2, 0.0)
        found |= dict(zip(SCATTERING[2:], (alone.extinction_um2, alone.scattering_um2, absorbed), strict=True))
    return found


def make_example(name: str, material: ReadyMaterial, folder: Path) -> dict[str, Any]:
    """The content of a scene file in a folder: a layer of a material under the surface of its resin, over black."""
    named = os.path.relpath(name, folder) if name.endswith(SUFFIX) else name
    content: dict[str, Any] = {"layer": [{"material": named}]}
    low, high, _ = find_known_wavelengths(content, folder)
    surface = {"interface": {"above": 1.0, "below": material.layer.get("host_index", 1.0)}}
    layers = [surface, *content["layer"]] if "host_index" in material.layer else content["layer"]
    cosines = {"start": 0.1, "stop": 1.0, "count": 10}
    request = {"mu_i": [0.5, 1.0], "mu_o": cosines, "phi_deg": {"start": 0, "stop": 180, "count": 19}}
    wavelength = min(max(0.55, low), high)
    return {"wavelength_um": wavelength, "layer": layers, "base": {"kind": "black"}, "brdf": request}


def write_whole_text(text: str, path: Path) -> None:
    """A text file, all of it or nothing."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


def check_options(options: argparse.Namespace, at: list[float], ready: bool) -> None:
    """Whether they go together, before the work is done. Raises SceneError."""
    if options.name is None:
        for option in (
            "wavelength_um",
            "wavelengths_um",
            "range_um",
            "radius_um",
            "host_index",
            "output",
            "plot",
            "scene",
        ):
            if getattr(options, option) is not None:
                raise SceneError(f"--{option.replace('_', '-')} needs the name of a material before it", PLACE)
        return
    for option in ("radius_um", "host_index") if ready else ("scene",):
        if getattr(options, option) is not None:
            kind = "substances, not with ready materials" if ready else "ready materials (`vrte materials`) only"
            raise SceneError(f"--{option.replace('_', '-')} goes with {kind}", PLACE)
    if options.scene:
        check_output(options.scene, SUFFIX)
    if not at and (not ready or options.output):
        raise SceneError(
            "--wavelength-um is missing: an index depends on the wavelength (--wavelengths-um and --range-um: several)",
            PLACE,
        )
    if options.host_index is not None and options.radius_um is None:
        raise SceneError("--host-index says what is around spheres: it needs their --radius-um", PLACE)
    if options.output:
        check_output(options.output, ".csv")
    if options.plot:
        check_output(options.plot, *SUFFIXES)
        check_extra(f"writing {options.plot}", "plot", ("matplotlib",))
        if len(at) < 2:
            raise SceneError("--plot draws over wavelengths: it needs --wavelengths-um or --range-um", PLACE)


def compute_columns(
    material: Material, at: list[float], radius_um: float | None, host_index: float | None, tick: Any
) -> Columns:
    """Wavelength, n and k, and of spheres of a radius albedo, asymmetry and cross sections [um2]."""
    rows = []
    for place, wavelength in enumerate(at):
        index = refractive_index(material, wavelength)
        row = [wavelength, index.n, index.k]
        if radius_um is not None:
            host = 1.0 if host_index is None else host_index
            found = spheres(index, radius_um=radius_um, wavelength_um=wavelength, host_index=host)
            row += [found.albedo, found.asymmetry, found.extinction_um2, found.scattering_um2]
            row += [max(found.extinction_um2 - found.scattering_um2, 0.0)]
        rows.append(row)
        tick(place + 1, len(at))
    names = ("wavelength_um", *INDEX, *(() if radius_um is None else SCATTERING))
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


def print_table(columns: Columns) -> None:
    """Prints a column a quantity, a row a wavelength, six digits of each."""
    widths = [max(16, len(name) + 2) for name in columns]
    print("".join(f"{name:>{width}}" for name, width in zip(columns, widths, strict=True)))
    for row in zip(*columns.values(), strict=True):
        print("".join(f"{value:{width}.6g}" for value, width in zip(row, widths, strict=True)))


def write_table(columns: Columns, path: Path) -> None:
    """CSV, every digit, all of it or nothing."""
    with write_sealed_text(path) as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*columns.values(), strict=True))


def draw_columns(columns: Columns, name: str, groups: list[tuple[str, tuple[str, ...]]]) -> Any:
    """Groups of columns beside each other, each with its title, over the wavelength."""
    from vrte.pictures.describe import BLUE, GREEN, ORANGE, Axis, Curve, Picture, PlotPanel
    from vrte.pictures.figures import draw_picture

    panels = []
    for title, names in groups:
        least = min(0.0, 1.05 * min(min(columns[column]) for column in names))
        curves = [
            Curve(columns["wavelength_um"], columns[column], column.removesuffix("_um2"), colour, size=3.0,
                  marker="o" if len(columns[column]) < 40 else "")
            for column, colour in zip(names, (BLUE, ORANGE, GREEN), strict=False)
        ]  # fmt: skip
        panels.append(PlotPanel(curves, Axis("wavelength [µm]"), Axis(low=least), title))
    return draw_picture(Picture([panels], 4.8 * len(groups), 4.0, name))
