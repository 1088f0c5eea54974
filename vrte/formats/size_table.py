"""Sizes of particles as they were measured, from a CSV table of one's own."""

import math
import os

from vrte.basics.errors import SceneError
from vrte.formats.text_file import read_rows
from vrte.optics.size_distribution import Tabulated

MOST_ROWS = 10_000  # each a radius for which spheres are computed
LARGEST_FILE = 1_000_000  # bytes
RADII = {"radius_um": 1.0, "diameter_um": 0.5}  # names of the first column, and what makes a radius of it
IN_WORDS = "radius_um,density or diameter_um,density"


def read_sizes(path: str | os.PathLike[str]) -> Tabulated:
    """The size distribution in a CSV file, for `vrte.spheres`, its kin and scene files.

    Parameters
    ----------
    path : path
        A text file whose header is radius_um,density or diameter_um,density, with one row a size, ascending; density
        is the number of particles a length, in any unit, >= 0. Lines that start with # are comments.

    Returns
    -------
    Tabulated
        Linear between rows, nothing outside.

    Raises
    ------
    SceneError
        Naming the line.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import vrte
    >>> with open("sizes.csv", "w") as file:
    ...     _ = file.write("diameter_um,density\\n0.2,0\\n0.3,5\\n0.6,0\\n")
    >>> vrte.read_sizes("sizes.csv")
    Tabulated(3 radii from 0.1 to 0.3 um)
    """
    header, rows = read_rows(path, LARGEST_FILE, MOST_ROWS)
    if len(header) != 2 or header[0] not in RADII or header[1] != "density":
        raise SceneError(f"the first line must be {IN_WORDS}")
    if len(rows) < 2:
        raise SceneError(f"there must be at least 2 rows below the header, not {len(rows)}")
    before = 0.0
    for line, row in rows:
        if len(row) != 2 or not all(map(math.isfinite, row)):
            raise SceneError(f"line {line}: 2 finite numbers are needed, {header[0]} and density")
        if row[0] <= before:
            raise SceneError(f"line {line}: {header[0]} must be above 0 and increase, not {row[0]:g} after {before:g}")
        if row[1] < 0.0:
            raise SceneError(f"line {line}: density must be >= 0, not {row[1]:g}")
        before = row[0]
    return Tabulated([RADII[header[0]] * row[0] for _, row in rows], [row[1] for _, row in rows])
