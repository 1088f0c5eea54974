"""`vrte phase`: a table of scattering matrices over angle as a phase matrix; and conventions of other codes."""

import argparse
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.commands.common import Parser, check_extra, check_output, say_written
from vrte.formats.columns import write_coefficients
from vrte.formats.scattering import CSV, read_angle_table, read_scattering
from vrte.optics.angle_tables import EXTRAPOLATE, describe_expansion
from vrte.optics.convention_card import CARD_DEG, INDEX, RADIUS_UM, WAVELENGTH_UM, recognise_convention, tabulate_card
from vrte.optics.conventions import CONVENTIONS
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.pictures.figures import SUFFIXES, save_figure

OPTIONS = (
    "convention",
    "normalise",
    "spheres",
    "ends",
    "accuracy",
    "tolerance",
    "wavelength_um",
    "effective_radius_um",
    "humidity_percent",
)


def add(command: Parser) -> None:
    """The arguments of `vrte phase`."""
    command.add_argument("file", nargs="?", type=Path, help="a .csv with named columns, or NetCDF (.nc, .cdf)")
    command.add_argument(
        "--convention", choices=tuple(CONVENTIONS), help="signs, ratios and scale; default: the file's"
    )
    command.add_argument(
        "--normalise", action="store_true", default=None, help="divide by the integral, whatever it is"
    )
    command.add_argument("--spheres", action="store_true", default=None, help="F22 = F11 and F44 = F33, left out")
    command.add_argument("--ends", choices=(EXTRAPOLATE,), help="where the angles do not reach 0 and 180 degrees")
    command.add_argument("--accuracy", type=float, metavar="X", help="error of the expansion over F11")
    command.add_argument("--tolerance", type=float, metavar="X", help="how far below zero eigenvalues may be")
    command.add_argument("--wavelength-um", type=float, metavar="UM", help="of a NetCDF file with several")
    command.add_argument("--effective-radius-um", type=float, metavar="UM", help="of a NetCDF file with several")
    command.add_argument("--humidity-percent", type=float, metavar="X", help="of a NetCDF file with several")
    command.add_argument(
        "--recognise",
        action="store_true",
        help="which convention the file is in: a code's numbers for the sphere below",
    )
    command.add_argument(
        "-o", "--output", type=Path, metavar="OUT.csv", help="the coefficients, as scene files take them"
    )
    command.add_argument("--plot", type=Path, metavar="OUT.png", help="the expansion over the table; .svg and .pdf too")


def run(options: argparse.Namespace) -> None:
    given = {name: getattr(options, name) for name in OPTIONS if getattr(options, name) is not None}
    check_options(options, given)
    if options.file is None:
        print_conventions()
        return
    if options.recognise:
        print(f"{options.file} is in the convention {' or '.join(identify_convention(options.file))}")
        return
    try:
        matrix = read_scattering(options.file, **given)
    except SceneError as error:
        raise error.behind(options.file) from error
    assert isinstance(matrix, PhaseMatrix)  # no density is given
    print_expansion(matrix, options.file)
    if options.output:
        write_coefficients(matrix, options.output)
        say_written(options.output)
        if matrix.tolerance > (options.tolerance or 0.0):
            print(f"to be read with tolerance = {matrix.tolerance:.2g}")
    if options.plot:
        save_figure(matrix.plot(), options.plot)
        say_written(options.plot)


def check_options(options: argparse.Namespace, given: dict[str, Any]) -> None:
    """Whether they go together, before the work is done. Raises SceneError."""
    more = {**given, **{name: True for name in ("output", "plot") if getattr(options, name)}}
    if options.file is None and (more or options.recognise):
        name = next(iter(more), "recognise")
        raise SceneError(f"--{name.replace('_', '-')} needs the name of a file before it", "phase")
    if options.recognise and more:
        raise SceneError(
            f"--recognise finds the convention, and --{next(iter(more)).replace('_', '-')} plays no part in it",
            "phase",
        )
    if options.output:
        check_output(options.output, CSV)
    if options.plot:
        check_output(options.plot, *SUFFIXES)
        check_extra(f"writing {options.plot}", "plot", ("matplotlib",))


def identify_convention(path: Path) -> list[str]:
    """The conventions that both the names and the numbers of a file's columns are those of. Raises SceneError."""
    faults: list[SceneError] = []
    found = []
    for name in CONVENTIONS:
        try:
            table = read_angle_table(path, name)
            if name in recognise_convention(table.angle_deg, *table.columns):
                found.append(name)
        except SceneError as error:
            faults.append(error)
    if not found:
        fault = faults[-1] if faults else SceneError("its columns are named after one convention and hold another's")
        raise fault.behind(path)
    return found


def print_expansion(matrix: PhaseMatrix, path: Path) -> None:
    """What was found: integral, peak, asymmetry, terms, error, coherency."""
    told = matrix.expansion
    assert told is not None  # it is from a table
    print(f"{path}: {told.table.angle_deg.size} angles, convention {told.convention}; {told.way}")
    for name, words in describe_expansion(matrix).items():
        print(f"{name:12}{words}")


def print_conventions() -> None:
    """Every convention, and what a code of it gives for the sphere of the card."""
    print(f"A sphere of refractive index {INDEX:g}, radius {RADIUS_UM:g} um, wavelength {WAVELENGTH_UM:g} um, in air")
    for name, about in CONVENTIONS.items():
        print(f"\n{name}: {about.words}\n  {about.in_words}\n  known from: {about.source}")
        card = tabulate_card(about)
        for label, row in zip(about.in_words.partition(";")[0].split(", "), card, strict=True):
            print(
                f"  {label:>10}"
                + "".join(f"{value:12.4g} at {angle:g}" for value, angle in zip(row, CARD_DEG, strict=True))
            )
