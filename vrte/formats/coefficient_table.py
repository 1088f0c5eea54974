"""Expansion coefficients of a phase matrix from a CSV table."""

import os
from pathlib import Path

import numpy as np

from vrte.arrays import in_one_line
from vrte.errors import SceneError
from vrte.formats.text_file import read_text
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix

LARGEST_FILE = 100_000_000  # bytes
COLUMNS = ["l", "a1", "a2", "a3", "a4", "b1", "b2"]


def read_coefficients(path: str | os.PathLike[str]) -> PhaseMatrix:
    """The phase matrix in a CSV file with the header l,a1,a2,a3,a4,b1,b2 and one row a degree, l = 0 first.

    Lines that start with # are comments; the signs are those of docs/conventions.md. Raises SceneError
    naming the line, OSError where the file cannot be read.

    >>> read_coefficients("rayleigh.csv").terms
    3
    """
    if Path(path).exists() and not Path(path).is_file():
        raise SceneError("it is no file")  # a device or a pipe may have no end
    text = read_text(path, LARGEST_FILE)
    lines = [(place, line) for place, line in enumerate(text.splitlines(), 1) if _counts(line)]
    if not lines or [name.strip() for name in lines[0][1].split(",")] != COLUMNS:
        raise SceneError(f"the first line must be {','.join(COLUMNS)}")
    if len(lines) > MOST_TERMS + 1:
        raise SceneError(f"the table must have at most {MOST_TERMS} rows, not {len(lines) - 1}")
    rows = [_row(place, line, degree) for degree, (place, line) in enumerate(lines[1:])]
    if not rows:
        raise SceneError("the table has no rows")
    return PhaseMatrix(*np.array(rows).T)


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _row(place: int, line: str, degree: int) -> list[float]:
    """The six coefficients of one line, which must be of the given degree."""
    try:
        values = [float(item) for item in line.split(",")]
    except ValueError:
        given = in_one_line(repr(line.strip()), 60)
        raise SceneError(f"line {place}: {given} holds something that is not a number") from None
    if len(values) != len(COLUMNS):
        raise SceneError(f"line {place}: {len(COLUMNS)} numbers are needed, not {len(values)}")
    if values[0] != degree:
        raise SceneError(f"line {place}: l must count 0, 1, 2, ...: {degree} is next, not {values[0]:g}")
    return values[1:]
