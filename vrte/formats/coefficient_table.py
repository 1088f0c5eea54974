"""Expansion coefficients of a phase matrix from a CSV table."""

import os

import numpy as np

from vrte.basics.errors import SceneError
from vrte.formats.atomic import write_sealed_text
from vrte.formats.text_file import read_rows
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix

LARGEST_FILE = 100_000_000  # bytes
COLUMNS = ["l", "a1", "a2", "a3", "a4", "b1", "b2"]


def read_coefficients(path: str | os.PathLike[str], tolerance: float = 0.0) -> PhaseMatrix:
    """The phase matrix in a CSV file with the header l,a1,a2,a3,a4,b1,b2 and one row a degree, l = 0 first.

    Lines that start with # are comments; the signs are those of docs/reference/conventions.md; ``tolerance`` is that
    of a PhaseMatrix. Raises SceneError naming the line, OSError where the file cannot be read.

    >>> read_coefficients("rayleigh.csv").terms
    3
    """
    header, rows = read_rows(path, LARGEST_FILE, MOST_TERMS)
    if header != COLUMNS:
        raise SceneError(f"the first line must be {','.join(COLUMNS)}")
    if not rows:
        raise SceneError("the table has no rows")
    columns = np.array([_check_coefficients(degree, *row) for degree, row in enumerate(rows)]).T
    return PhaseMatrix(*columns, tolerance=tolerance)


def _check_coefficients(degree: int, line: int, values: list[float]) -> list[float]:
    """The six coefficients of one line, which must be of the given degree."""
    if len(values) != len(COLUMNS):
        raise SceneError(f"line {line}: {len(COLUMNS)} numbers are needed, not {len(values)}")
    if values[0] != degree:
        raise SceneError(f"line {line}: l must count 0, 1, 2, ...: {degree} is next, not {values[0]:g}")
    return values[1:]


def write_coefficients(phase_matrix: PhaseMatrix, path: str | os.PathLike[str]) -> None:
    """Writes the table that `read_coefficients` reads: every digit, all of it or nothing.

    >>> write_coefficients(read_coefficients("rayleigh.csv"), "again.csv")
    >>> read_coefficients("again.csv").terms
    3
    """
    with write_sealed_text(path) as file:
        file.write(",".join(COLUMNS) + "\n")
        for degree, row in enumerate(phase_matrix.coefficients.tolist()):
            file.write(",".join([str(degree), *map(repr, row)]) + "\n")
