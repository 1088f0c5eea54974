"""Scattering matrices tabulated over angle, from CSV: columns by name, as another code or a measurement has them."""

import itertools
import math
import os
import re
from typing import NamedTuple

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.text_file import read_rows
from vrte.optics.angle_tables import MOST_ANGLES
from vrte.optics.conventions import ELEMENTS, Convention, find_convention

LARGEST_FILE = 100_000_000  # bytes
ANGLE, COSINE = "angle_deg", "cosine"
OF_EXPANSIONS = {"a1": 0, "b1": 1, "a2": 2, "a3": 3, "b2": 4, "a4": 5}  # the same elements, by Hovenier's letters
PLACES = {"11": 0, "12": 1, "21": 1, "22": 2, "33": 3, "34": 4, "43": 4, "44": 5}
ELEMENT = re.compile(r"(-?)([FPSM])(\d\d)(/\2?11)?")  # F12, P43/P11, -F12/F11, S34
RATIO = "/F11"


class AngleTable(NamedTuple):
    """Angles [degrees], ascending, and six columns in the order of ELEMENTS, None where one is missing; whether it is
    known to be of spheres."""

    angle_deg: Array
    columns: tuple[Array | None, ...]
    spheres: bool = False


def read_angle_table(path: str | os.PathLike[str], convention: str = "vrte") -> AngleTable:
    """The table over angle in a CSV file: its first line names the columns, lines that start with # are comments.

    One column is angle_deg, ascending from 0 to 180, or cosine, in either order; the others are elements, F11, P11, S11
    or M11 to F44, a1 to b2, or what the convention calls them, such as -F12/F11. Raises SceneError naming the line,
    OSError where the file cannot be read.

    >>> with open("fog.csv", "w") as file:
    ...     _ = file.write("cosine,F11\\n-1,0.5\\n0,1\\n1,1.5\\n")
    >>> read_angle_table("fog.csv").angle_deg.tolist()
    [0.0, 90.0, 180.0]
    """
    about = find_convention(convention)
    header, rows = read_rows(path, LARGEST_FILE, MOST_ANGLES)
    places = find_columns(header, about, convention)
    if not rows:
        raise SceneError("the table has no rows")
    by_cosine = COSINE in header
    for line, values in rows:
        check_row(line, values, header, places)
    table = np.array([values for _, values in rows]).T
    angles = table[header.index(COSINE if by_cosine else ANGLE)]
    if by_cosine:
        angles = np.degrees(np.arccos(angles))
        if angles[0] > angles[1 if angles.size > 1 else 0]:
            angles, table, rows = angles[::-1], table[:, ::-1], rows[::-1]
    lines = [line for line, _ in rows]
    for pair, (before, after) in zip(itertools.pairwise(lines), itertools.pairwise(angles), strict=True):
        if after <= before:
            order = "in one order" if by_cosine else "ascending"
            fault = f"{before:g} and {after:g} degrees are not"
            raise SceneError(f"line {max(pair)}: the angles must be {order}, each once; {fault}")
    columns = {place: table[number] for number, place in enumerate(places) if place is not None}
    return AngleTable(angles, tuple(columns.get(place) for place in range(len(ELEMENTS))))


def check_row(line: int, values: list[float], header: list[str], places: list[int | None]) -> None:
    """Raises SceneError for a row that no scattering matrix has."""
    if len(values) != len(header):
        raise SceneError(f"line {line}: {len(header)} numbers are needed, not {len(values)}")
    for name, place, value in zip(header, places, values, strict=True):
        if not math.isfinite(value):
            raise SceneError(f"line {line}: {name} must be a finite number, not {value}")
        if name == ANGLE and not 0.0 <= value <= 180.0:
            raise SceneError(f"line {line}: {name} must be from 0 to 180, not {value:g}")
        if name == COSINE and not -1.0 <= value <= 1.0:
            raise SceneError(f"line {line}: {name} must be from -1 to 1, not {value:g}")
        if place == 0 and value < 0.0:
            raise SceneError(f"line {line}: {name} must not be negative, and is {value:g}")


def find_columns(header: list[str], about: Convention, convention: str) -> list[int | None]:
    """The place in ELEMENTS of each column, None for the angle. Raises SceneError for names that do not go together."""
    places = [None if name in (ANGLE, COSINE) else find_element(name, about, convention) for name in header]
    if places.count(None) != 1:
        raise SceneError(f"the first line must name the columns, one of them {ANGLE} or {COSINE}")
    elements = [place for place in places if place is not None]
    for place in elements:
        if elements.count(place) > 1:
            raise SceneError(f"the column {about.columns[place]} must be there once, not {elements.count(place)} times")
    if 0 not in elements:
        raise SceneError(f"the column {about.columns[0]} is missing: it is {', '.join(header)}")
    return places


def find_element(name: str, about: Convention, convention: str) -> int:
    """The place in ELEMENTS of a column's name. Raises SceneError where the convention has it in another way."""
    if name in about.columns:
        return about.columns.index(name)
    if name in OF_EXPANSIONS:
        return OF_EXPANSIONS[name]
    found = ELEMENT.fullmatch(name)
    if not found or found[3] not in PLACES or "Pll" in about.columns:
        raise SceneError(
            f"the column {put_in_one_line(repr(name), 40)} is not known: there may be {ANGLE} or {COSINE}, and "
            f'{", ".join(about.columns)} (P, S or M in place of F) in the convention "{convention}"'
        )
    place = PLACES[found[3]]
    meant = about.columns[place]
    other_sign = (found[1] == "-" and not meant.startswith("-")) or (found[3] == "43" and about.circular > 0)
    if other_sign or (found[4] and not meant.endswith(RATIO)):
        raise SceneError(
            f'the column {name} is {meant} in the convention "{convention}": give the one that the table is in, '
            "convention=..."
        )
    return place
