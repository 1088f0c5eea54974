"""`vrte phase`: a table of scattering matrices over angle as a phase matrix; and conventions of other codes."""

import argparse
from pathlib import Path

from vrte.basics.errors import SceneError
from vrte.commands.common import write
from vrte.formats.columns import write_coefficients
from vrte.formats.scattering import read_angle_table, read_scattering
from vrte.optics.angle_tables import describe_expansion
from vrte.optics.convention_card import CARD_DEG, INDEX, RADIUS_UM, WAVELENGTH_UM, recognise_convention, tabulate_card
from vrte.optics.conventions import CONVENTIONS
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.pictures.figures import save_figure

OF_FILES = ("wavelength_um", "effective_radius_um", "humidity_percent")  # with several
OPTIONS = ("convention", "normalise", "spheres", "ends", "accuracy", "tolerance", *OF_FILES)
EXCLUDED = (*OPTIONS, "output", "plot")  # by --recognise


def check(options: argparse.Namespace) -> None:
    """Whether the options go together. Raises SceneError."""
    given = [f"--{name.replace('_', '-')}" for name in EXCLUDED if getattr(options, name) is not None]
    if options.file is None and (given or options.recognise):
        raise SceneError(f"{next(iter(given), '--recognise')} needs the name of a file before it", "phase")
    if options.recognise and given:
        raise SceneError(f"--recognise finds the convention, and {given[0]} plays no part in it", "phase")


def run(options: argparse.Namespace) -> None:
    if options.file is None:
        print_conventions()
        return
    if options.recognise:
        print(f"{options.file} is in the convention {' or '.join(identify_convention(options.file))}")
        return
    given = {name: value for name in OPTIONS if (value := getattr(options, name)) is not None}
    matrix = read_scattering(options.file, **given)
    assert isinstance(matrix, PhaseMatrix)  # no density is given
    made = matrix.expansion
    assert made is not None  # it is from a table
    print(f"{options.file}: {made.table.angle_deg.size} angles, convention {made.convention}; {made.way}")
    for name, words in describe_expansion(matrix).items():
        print(f"{name:12}{words}")
    write(options.output, lambda path: write_coefficients(matrix, path))
    if options.output and matrix.tolerance > (options.tolerance or 0.0):
        print(f"to be read with tolerance = {matrix.tolerance:.2g}")
    write(options.plot, lambda path: save_figure(matrix.plot(), path))


def identify_convention(path: Path) -> list[str]:
    """The conventions that both the names and the numbers of a file's columns are those of. Raises SceneError."""
    fault = SceneError("its columns are named after one convention and hold another's")
    found = []
    for name in CONVENTIONS:
        try:
            table = read_angle_table(path, name)
            if name in recognise_convention(table.angle_deg, *table.columns):
                found.append(name)
        except SceneError as error:
            fault = error
    if not found:
        raise fault
    return found


def print_conventions() -> None:
    """Every convention, and what a code of it gives for the sphere of the card."""
    print(f"A sphere of refractive index {INDEX:g}, radius {RADIUS_UM:g} um, wavelength {WAVELENGTH_UM:g} um, in air")
    for name, about in CONVENTIONS.items():
        print(f"\n{name}: {about.words}\n  {about.in_words}\n  known from: {about.source}")
        for label, row in zip(about.in_words.partition(";")[0].split(", "), tabulate_card(about), strict=True):
            values = (f"{value:12.4g} at {angle:g}" for value, angle in zip(row, CARD_DEG, strict=True))
            print(f"  {label:>10}{''.join(values)}")
