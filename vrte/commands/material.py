"""`vrte material`: refractive indices by name, how spheres of a substance scatter, and how a ready material does, over
wavelengths."""

import argparse
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.commands.common import show_progress, write
from vrte.formats.atomic import write_text
from vrte.formats.columns import read_index, write_table
from vrte.formats.materials import SUFFIX, ReadyMaterial, choose_material, expand_materials, find_material
from vrte.formats.scene_file import find_known_wavelengths, make_scene_file
from vrte.formats.toml_table import Table, write_toml
from vrte.optics.refractive_index import MATERIALS, Material, refractive_index
from vrte.optics.spheres import spheres
from vrte.pictures.figures import save_figure
from vrte.results.brdf import MOST_WAVELENGTHS, check_ascending

PLACE = "material"  # of its options, for the page that says more
INDEX = ("n", "k")
SCATTERING = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "absorption_um2")
PER_LENGTH = ("extinction_per_um", "transport_um")
OPTIONS = ("wavelength_um", "wavelengths_um", "range_um", "radius_um", "host_index", "output", "plot", "scene")
Columns = dict[str, list[float]]
Groups = Sequence[tuple[str, tuple[str, ...]]]  # of columns that are drawn together, with a title


def read_range(text: str) -> list[float]:
    """Numbers, evenly from LOW:HIGH:COUNT."""
    try:
        low, high, count = text.split(":")
        if not (count.isdecimal() and 2 <= int(count) <= MOST_WAVELENGTHS):
            raise ValueError
        found: list[float] = check_ascending(np.linspace(float(low), float(high), int(count)).round(12)).tolist()
    except ValueError:  # a SceneError is one
        words = f"must be LOW:HIGH:COUNT, ascending and 2 to {MOST_WAVELENGTHS} of them, such as 0.4:0.7:31"
        raise argparse.ArgumentTypeError(f"{words}, not {text!r}") from None
    return found


def check(options: argparse.Namespace) -> None:
    """Notes the wavelengths, ``at``, and whether the material is ``ready``. Raises SceneError for bad options."""
    one = [] if options.wavelength_um is None else [options.wavelength_um]
    name, at = options.name, options.wavelengths_um or options.range_um or one
    ready = name is not None and (name.endswith(SUFFIX) or find_material(name) is not None)
    options.at, options.ready = at, ready
    given = [option for option in OPTIONS if getattr(options, option) is not None]
    if name is None:
        for option in given:
            raise SceneError(f"--{option.replace('_', '-')} needs the name of a material before it", PLACE)
        return
    for option in ("radius_um", "host_index") if ready else ("scene",):
        if option in given:
            kind = "substances, not with ready materials" if ready else "ready materials (`vrte materials`) only"
            raise SceneError(f"--{option.replace('_', '-')} goes with {kind}", PLACE)
    if not at and (not ready or options.output):
        words = "an index depends on the wavelength (--wavelengths-um and --range-um: several)"
        raise SceneError(f"--wavelength-um is missing: {words}", PLACE)
    if options.host_index is not None and options.radius_um is None:
        raise SceneError("--host-index says what is around spheres: it needs their --radius-um", PLACE)
    if options.plot and len(at) < 2:
        raise SceneError("--plot draws over wavelengths: it needs --wavelengths-um or --range-um", PLACE)


def run(options: argparse.Namespace) -> None:
    if options.name is None:
        for name, entry in MATERIALS.items():
            pages = " and ".join(entry.pages) if entry.pages else f"n = {entry.index:g}"
            print(f"{name:18}{pages}: {entry.reason}")
    elif options.ready:
        show_ready_material(options)
    else:
        show_substance(options)


def show_substance(options: argparse.Namespace) -> None:
    """The index of a substance, and of its spheres albedo, asymmetry and cross sections [um2], over wavelengths."""
    material = read_index(options.name) if options.name.endswith(".csv") else options.name
    index, radius = refractive_index(material, options.at[0]), options.radius_um
    host = 1.0 if options.host_index is None else options.host_index
    columns = tabulate(options, lambda at: describe_substance(material, at, radius, host))
    if len(options.at) == 1 and radius is None:
        print(f"{options.name} at {options.at[0]:g} um: n = {index.n:.6g}, k = {index.k:.6g}")
    else:
        print_table(columns)
    print(f"from {index.source}")
    spheres_of = "" if radius is None else f"spheres of radius {radius:g} µm"
    write_columns(columns, options, [("refractive index", INDEX), *group_scattering(columns, spheres_of)])


def describe_substance(material: Material, at: float, radius_um: float | None, host: float) -> dict[str, float]:
    """A row of the table of a substance."""
    index = refractive_index(material, at)
    row = {"wavelength_um": at, "n": index.n, "k": index.k}
    if radius_um is None:
        return row
    found = spheres(index, radius_um=radius_um, wavelength_um=at, host_index=host)
    return row | {"albedo": found.albedo, "asymmetry": found.asymmetry} | list_cross_sections(found)


def list_cross_sections(particles: Any) -> dict[str, float]:
    """Extinction, scattering and absorption [um2] of a particle."""
    extinction, scattering = particles.extinction_um2, particles.scattering_um2
    return dict(zip(SCATTERING[2:], (extinction, scattering, max(extinction - scattering, 0.0)), strict=True))


def show_ready_material(options: argparse.Namespace) -> None:
    """What a ready material is, how its layer scatters over wavelengths, and a scene file to begin with."""
    material = choose_material(Table((), {"material": options.name}, ("material",)), Path())
    print(f"{material.title}: {material.description}")
    for words, listed in (("approximated", material.approximations), ("from", material.sources)):
        for line in listed:
            print(f"  {words}: {line}")
    if options.scene:
        example = write_toml(make_example(options.name, material, options.scene.parent))
        write(options.scene, lambda path: write_text(example, path))
    if options.at:
        columns = tabulate(options, lambda at: describe_layer(options.name, at))
        print_table(columns)
        write_columns(columns, options, group_scattering(columns, "layer"))
    elif not options.scene:
        print("--wavelength-um, --wavelengths-um or --range-um: how it scatters there")


def describe_layer(name: str, wavelength_um: float) -> dict[str, float]:
    """How a ready material's layer scatters: extinction [1/um], transport length, cross sections [um2]."""
    request = {"brdf": {"mu_i": 1.0, "mu_o": 1.0}}
    file = make_scene_file({"wavelength_um": wavelength_um, "layer": [{"material": name}], **request})
    layer = file.scene.layers[0]
    length = expand_materials({"layer": [{"material": name}]})["layer"][0].get("thickness_um", math.inf)
    found = {"wavelength_um": wavelength_um, "host_index": layer.host_index or 1.0, "albedo": layer.albedo}
    found |= {"asymmetry": layer.phase_matrix.asymmetry, "thickness": layer.thickness}
    if math.isfinite(length) and length > 0.0:
        extinction = layer.thickness / length
        found |= {"extinction_per_um": extinction, "transport_um": layer.transport_mean_free_path / extinction}
    if len(file.particles) == 1:
        found |= list_cross_sections(*file.particles.values())
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


def tabulate(options: argparse.Namespace, describe: Callable[[float], dict[str, float]]) -> Columns:
    """Columns by name, with one row for each wavelength."""
    rows = []
    with show_progress() as (phase, tick):
        phase(options.name)
        for wavelength in options.at:
            rows.append(describe(wavelength))
            tick(len(rows), len(options.at))
    return {name: [row[name] for row in rows] for name in rows[0]}


def print_table(columns: Columns) -> None:
    """Prints a column a quantity, a row a wavelength, six digits of each."""
    widths = [max(16, len(name) + 2) for name in columns]
    print("".join(f"{name:>{width}}" for name, width in zip(columns, widths, strict=True)))
    for row in zip(*columns.values(), strict=True):
        print("".join(f"{value:{width}.6g}" for value, width in zip(row, widths, strict=True)))


def group_scattering(columns: Columns, title: str) -> Groups:
    """Groups of those columns of scattering that there are, to be drawn."""
    groups = ((title, SCATTERING[:2]), ("lengths [µm, 1/µm]", PER_LENGTH), ("cross sections [µm²]", SCATTERING[2:]))
    there = [(title, tuple(name for name in names if name in columns)) for title, names in groups]
    return [group for group in there if group[1]]


def write_columns(columns: Columns, options: argparse.Namespace, groups: Groups) -> None:
    """The table and the picture that are asked for."""
    write(options.output, lambda path: write_table(columns, path))
    write(options.plot, lambda path: save_figure(draw_columns(columns, options.name, groups), path))


def draw_columns(columns: Columns, name: str, groups: Groups) -> Any:
    """Groups of columns beside each other, each with its title, over the wavelength."""
    from vrte.pictures.describe import BLUE, GREEN, ORANGE, Axis, Curve, Picture, PlotPanel
    from vrte.pictures.figures import draw_picture

    panels, at = [], columns["wavelength_um"]
    for title, names in groups:
        least = min(0.0, 1.05 * min(min(columns[column]) for column in names))
        curves = [
            Curve(at, columns[one], one.removesuffix("_um2"), colour, size=3.0, marker="o" if len(at) < 40 else "")
            for one, colour in zip(names, (BLUE, ORANGE, GREEN), strict=False)
        ]
        panels.append(PlotPanel(curves, Axis("wavelength [µm]"), Axis(low=least), title))
    return draw_picture(Picture([panels], 4.8 * len(groups), 4.0, name))
