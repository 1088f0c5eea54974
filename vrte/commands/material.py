"""`vrte material`: refractive indices by name, and how spheres of a material scatter, over wavelengths."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError
from vrte.commands.common import add_command, check_extra, check_output, read_wavelengths, say_written, show_progress
from vrte.formats.atomic import write_atomically
from vrte.formats.index_table import read_index
from vrte.optics.refractive_index import MATERIALS, Material, refractive_index
from vrte.optics.spheres import spheres
from vrte.pictures.figures import SUFFIXES, save_figure
from vrte.results.spectrum import MOST_WAVELENGTHS, check_ascending

INDEX = ("n", "k")
SCATTERING = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "absorption_um2")
Columns = dict[str, list[float]]


def add(commands: Any) -> None:
    """`vrte material [NAME]`."""
    told = "the refractive index of a material, and how its spheres scatter; without a name, a list of all names"
    material = add_command(commands, "material", run, told)
    material.add_argument(
        "name",
        nargs="?",
        help='a name, a path in the database such as "main/Au/Johnson", or a .csv of your own (wavelength_um,n,k)',
    )
    where = material.add_mutually_exclusive_group()
    where.add_argument("--wavelength-um", type=float, metavar="UM", help="wavelength in vacuum [micrometres]")
    where.add_argument("--wavelengths-um", metavar="UM,UM,...", type=read_wavelengths, help="ascending: a table")
    where.add_argument(
        "--range-um", metavar="LOW:HIGH:COUNT", type=read_range, help="so many, evenly from LOW to HIGH: a table"
    )
    material.add_argument("--radius-um", type=float, metavar="UM", help="of spheres: albedo, g, cross sections too")
    material.add_argument("--host-index", type=float, metavar="N", help="around the spheres; default: 1")
    material.add_argument("-o", "--output", type=Path, metavar="OUT.csv", help="the table, every digit")
    material.add_argument("--plot", type=Path, metavar="OUT.png", help="a picture; .svg and .pdf too")


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
    at = (
        options.wavelengths_um or options.range_um or ([] if options.wavelength_um is None else [options.wavelength_um])
    )
    check_options(options, at)
    if options.name is None:
        for name, entry in MATERIALS.items():
            print(f"{name:12}{' and '.join(entry.pages)}: {entry.reason}")
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
    if options.output:
        write_table(columns, options.output)
        say_written(options.output)
    if options.plot:
        save_figure(draw_columns(columns, options.name, options.radius_um), options.plot)
        say_written(options.plot)


def check_options(options: argparse.Namespace, at: list[float]) -> None:
    """Whether they go together, before the work is done. Raises SceneError."""
    if options.name is None:
        for option in ("wavelength_um", "wavelengths_um", "range_um", "radius_um", "host_index", "output", "plot"):
            if getattr(options, option) is not None:
                raise SceneError(f"--{option.replace('_', '-')} needs the name of a material before it")
        return
    if not at:
        raise SceneError(
            "--wavelength-um is missing: an index depends on the wavelength (--wavelengths-um and --range-um: several)"
        )
    if options.host_index is not None and options.radius_um is None:
        raise SceneError("--host-index says what is around spheres: it needs their --radius-um")
    if options.output:
        check_output(options.output, ".csv")
    if options.plot:
        check_output(options.plot, *SUFFIXES)
        check_extra(f"writing {options.plot}", "plot", ("matplotlib",))
        if len(at) < 2:
            raise SceneError("--plot draws over wavelengths: it needs --wavelengths-um or --range-um")


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
    print("".join(f"{name:>16}" for name in columns))
    for row in zip(*columns.values(), strict=True):
        print("".join(f"{value:16.6g}" for value in row))


def write_table(columns: Columns, path: Path) -> None:
    """CSV, every digit, all of it or nothing."""
    with write_atomically(path) as part, open(part, "w", encoding="ascii", newline="") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*columns.values(), strict=True))


def draw_columns(columns: Columns, name: str, radius_um: float | None) -> Any:
    """n and k, albedo and g, cross sections, over the wavelength."""
    from vrte.pictures.figures import finish, make_figure

    groups: list[tuple[str, tuple[str, ...]]] = [("refractive index", INDEX)]
    if radius_um is not None:
        groups += [(f"spheres of radius {radius_um:g} µm", SCATTERING[:2]), ("cross sections [µm²]", SCATTERING[2:])]
    figure = make_figure(4.8 * len(groups), 4.0)
    panels = figure.subplots(1, len(groups), squeeze=False)[0]
    for panel, (title, names) in zip(panels, groups, strict=True):
        for column, colour in zip(names, ("#1f4e79", "#d98200", "#2a8f5b"), strict=False):
            style = {"color": colour, "marker": "o" if len(columns[column]) < 40 else None, "markersize": 3}
            panel.plot(columns["wavelength_um"], columns[column], label=column.removesuffix("_um2"), **style)
        finish([panel], (title,), "wavelength [µm]")
        panel.set_ylim(bottom=min(0.0, 1.05 * min(min(columns[column]) for column in names)))
    figure.suptitle(name, fontsize=12)
    figure.tight_layout()
    return figure
