"""Tables in CSV files: one reader of lines and columns, and the indices, sizes and coefficients that it reads."""

import csv
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.atomic import PathName, check_file, check_file_name, check_text, read_blocks, write_sealed_text
from vrte.optics.phase_matrix import MOST_TERMS, PhaseMatrix
from vrte.optics.refractive_index import IndexTable
from vrte.optics.size_distribution import Tabulated

UNITS = {"wavelength_um": 1.0, "wavelength_nm": 1e3, "radius_um": 1.0, "diameter_um": 2.0}  # to a wavelength or radius
COEFFICIENTS = ["l", "a1", "a2", "a3", "a4", "b1", "b2"]
LONGEST_LINE = 50_000_000  # bytes
SEPARATORS = (";", "\t", ",", " ")
NO_TEXT = {
    b"PK": "a workbook or a zip archive",
    b"\xd0\xcf\x11\xe0": "a workbook of old",
    b"%PDF": "a PDF",
}  # by first bytes
CONTROLS = re.compile("[\x00-\x08\x0e-\x19\x1b-\x1f]")


def read_any_text(path: PathName, most_bytes: int) -> tuple[str, str]:
    """The text of a file in UTF-8, UTF-16 or Windows-1252, and its encoding. Raises SceneError for none, OSError."""
    with open(check_file(path), "rb") as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise SceneError(f"the file is longer than {most_bytes} bytes")
    for start, words in NO_TEXT.items():
        if content.startswith(start):
            raise SceneError(f"it is {words}, and no text: save its table as CSV")
    first, end, rest = content.partition(b"\n")
    check_text(first + end, [rest])
    zeros = content[:2000:2].count(0), content[1:2000:2].count(0)  # every other byte of UTF-16 without a mark
    marks = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
    guess = "utf-16-be" if zeros[0] > zeros[1] else "utf-16-le" if zeros[1] else "utf-8-sig"
    encodings = [marks.get(content[:2], guess), "cp1252", "latin-1"]
    for encoding in encodings[: 1 if encodings[0].startswith("utf-16") else None]:
        try:
            text = content.decode(encoding).removeprefix("\ufeff")
        except UnicodeDecodeError:
            continue
        if not CONTROLS.search(text):
            return text, encoding
    raise SceneError("it is no text: it holds bytes that no text has")


def list_lines(text: str) -> list[tuple[int, str]]:
    """The lines of a text that are not empty, whatever ends them, with their numbers from 1."""
    return [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip()]


def split_cells(line: str, separator: str) -> list[str]:
    """The cells of a line, quotes taken off. Raises csv.Error."""
    line = " ".join(line.split()) if separator == " " else line
    (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=separator != "\t")
    return [cell.strip() for cell in cells]


class Lines:
    """The lines of an open text file in UTF-8, one after another; ``place`` is the number of the last one, from 1,
    ``total`` that of all that have an end. Raises SceneError for a table of vrte's that is not as it was written."""

    def __init__(self, file: BinaryIO) -> None:
        self.is_sealed = check_text(file.readline(LONGEST_LINE), read_blocks(file))
        file.seek(0)
        self.total = sum(block.count(b"\n") for block in read_blocks(file))
        file.seek(0)
        self.place, self._file = 0, file

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line = self._file.readline(LONGEST_LINE + 1)
        if not line:
            raise StopIteration
        self.place += 1
        if len(line) > LONGEST_LINE:
            raise SceneError(f"line {self.place}: longer than {LONGEST_LINE} bytes")
        try:
            return line.removesuffix(b"\n").decode("utf-8").removeprefix("\ufeff" if self.place == 1 else "")
        except UnicodeDecodeError as error:
            raise SceneError(f"line {self.place}: not a text file in UTF-8 (byte {error.start} of the line)") from error

    def read_numbers(self, rows: int, columns: int) -> Array:
        """The numbers in all lines that are left, (rows, columns), commas between them."""
        if not rows:
            return np.empty((0, columns))
        try:
            found = np.loadtxt(self, delimiter=",", comments=None, ndmin=2)
        except SceneError:
            raise
        except ValueError as error:
            words = put_in_one_line(str(error).partition(";")[0], 200)
            raise SceneError(f"line {self.place}: {columns} numbers are needed ({words})") from error
        if found.shape != (rows, columns):
            raise SceneError(f"there must be {rows} rows of {columns} numbers, not {len(found)} of {found.shape[1]}")
        return found


@dataclass
class Columns:
    """A table of text: ``names`` of columns, ``rows`` of cells, the ``lines`` they stand in, the ``separator`` (" ":
    white space), and the lines ``above`` it."""

    names: list[str]
    rows: list[list[str]]
    lines: list[int]
    separator: str = ","
    above: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # how the file is written
    are_fractions: bool = False  # whether the format says that reflectances are

    @classmethod
    def read(cls, path: PathName, most_bytes: int, most_rows: int) -> "Columns":
        """The table of a file. Raises SceneError naming the line, OSError."""
        return cls.parse(read_any_text(path, most_bytes)[0], most_rows)

    @classmethod
    def parse(cls, text: str, most_rows: int) -> "Columns":
        """The table of a text behind comments (#), cells by semicolons, tabs, commas or blanks. Raises SceneError."""
        kept = [(number, line) for number, line in list_lines(text) if line.lstrip()[0] != "#"]
        if len(kept) > most_rows + 1:
            raise SceneError(f"the table must have at most {most_rows} rows, not {len(kept) - 1}")
        separator = next((one for one in SEPARATORS if kept and one in kept[0][1].strip()), ",")
        rows: list[list[str]] = []
        for number, line in kept:
            try:
                rows.append(split_cells(line, separator))
            except csv.Error as error:
                raise SceneError(f"line {number}: no row of a table ({error})") from error
        return cls(rows.pop(0) if kept else [], rows, [number for number, _ in kept[1:]], separator)

    def check(self, headers: Sequence[list[str]] = (), words: str = "", fewest: int = 1) -> None:
        """Raises SceneError unless the header is allowed, names differ, rows are enough and have all columns."""
        if headers and self.names not in headers:
            raise SceneError(f"the first line must be {words}")
        if len({*self.names}) < len(self.names):
            raise SceneError("two columns have the same name")
        if len(self.rows) < fewest:
            rows = f"{fewest} row{'s'[: fewest > 1]}"
            raise SceneError(f"there must be at least {rows} below the header, not {len(self.rows)}")
        for row, cells in enumerate(self.rows):
            if len(cells) != len(self.names):
                words = f"{len(self.names)} values are needed, as many as columns, not {len(cells)}"
                raise self.fault(row, words)

    def fault(self, row: int, words: str) -> SceneError:
        """The error of one row."""
        return SceneError(f"line {self.lines[row]}: {words}")

    def words(self, name: str) -> list[str]:
        """The cells of a column, as they are."""
        index = self.names.index(name)
        return [cells[index] for cells in self.rows]

    def numbers(
        self,
        name: str,
        low: float = -math.inf,
        high: float = math.inf,
        *,
        above: bool = False,
        ascending: bool = False,
        may_be_empty: bool = False,
    ) -> Array:
        """A column's finite numbers (rows,) within limits, ``above`` low, ``ascending``; NaN where one may be empty."""
        allowed = f"from {low:g} to {high:g}" if high < math.inf else f"{'above' if above else '>='} {low:g}"
        found = np.empty(len(self.rows))
        for row, text in enumerate(self.words(name)):
            try:
                number = text.replace(",", ".") if self.separator != "," else text
                found[row] = math.nan if may_be_empty and not text else float(number)
            except ValueError:
                raise self.fault(row, f"{name} must be a number, not {put_in_one_line(repr(text), 40)}") from None
            value = found[row]
            if not (math.isfinite(value) or (may_be_empty and math.isnan(value))):
                raise self.fault(row, f"{name} must be a finite number, not {value}")
            if value < low or value > high or (above and value == low):
                raise self.fault(row, f"{name} must be {allowed}, not {value:g}")
            if ascending and row and value <= found[row - 1]:
                raise self.fault(row, f"{name} must ascend, and {value:g} follows {found[row - 1]:g}")
        return found


def read_index(path: str | os.PathLike[str]) -> IndexTable:
    """The refractive index n + i k over wavelength in a CSV file, for `vrte.spheres` and scene files.

    Parameters
    ----------
    path : path
        A text file whose header is wavelength_um,n,k or wavelength_nm,n,k (k may be left out: no absorption), with one
        row a wavelength in vacuum, ascending; lines that start with # are comments. Semicolons may stand for the
        commas between columns: then numbers may have decimal commas.

    Returns
    -------
    IndexTable
        Between rows n and k are linear in the wavelength; outside, an error gives the table's range.

    Raises
    ------
    SceneError
        Naming the line and the column.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import vrte
    >>> with open("pigment.csv", "w") as file:
    ...     _ = file.write("wavelength_nm,n,k\\n400,2.0,0.25\\n800,1.5,0.0\\n")
    >>> vrte.read_index("pigment.csv").at(0.4)
    (2+0.25j)
    """
    columns = Columns.read(path, 10_000_000, 100_000)
    headers = [[first, *rest] for first in ("wavelength_um", "wavelength_nm") for rest in (["n"], ["n", "k"])]
    columns.check(headers, "wavelength_um,n,k (or wavelength_nm in front; without k nothing is absorbed)")
    first = columns.names[0]
    wavelengths = columns.numbers(first, 0.0, above=True, ascending=True) / UNITS[first]  # 700 nm are 0.7 exactly
    n = columns.numbers("n")
    k = columns.numbers("k", 0.0) if "k" in columns.names else np.zeros(n.size)
    name = os.path.basename(check_file_name(path))
    return IndexTable(tuple(wavelengths.tolist()), tuple(n.tolist()), tuple(k.tolist()), f"the table {name}")


def read_sizes(path: str | os.PathLike[str]) -> Tabulated:
    """The size distribution in a CSV file, for `vrte.spheres`, its kin and scene files.

    Parameters
    ----------
    path : path
        A text file whose header is radius_um,density or diameter_um,density, with one row a size, ascending; density
        is the number of particles a length, in any unit, >= 0. Lines that start with # are comments. Semicolons may
        stand for the commas between columns: then numbers may have decimal commas.

    Returns
    -------
    Tabulated
        Linear between rows, nothing outside.

    Raises
    ------
    SceneError
        Naming the line and the column.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import vrte
    >>> with open("sizes.csv", "w") as file:
    ...     _ = file.write("diameter_um;density\\n0,2;0\\n0,3;5\\n0,6;0\\n")
    >>> vrte.read_sizes("sizes.csv")
    Tabulated(3 radii from 0.1 to 0.3 um)
    """
    columns = Columns.read(path, 1_000_000, 10_000)
    headers = [["radius_um", "density"], ["diameter_um", "density"]]
    columns.check(headers, "radius_um,density or diameter_um,density", fewest=2)
    first = columns.names[0]
    radii = columns.numbers(first, 0.0, above=True, ascending=True) / UNITS[first]
    return Tabulated(radii.tolist(), columns.numbers("density", 0.0).tolist())


def read_coefficients(path: PathName, tolerance: float = 0.0) -> PhaseMatrix:
    """The phase matrix in a CSV file with the header l,a1,a2,a3,a4,b1,b2 and one row a degree, l = 0 first, in the
    signs of docs/reference/conventions.md; ``tolerance`` is that of a PhaseMatrix. Raises SceneError, OSError."""
    columns = Columns.read(path, 100_000_000, MOST_TERMS)
    columns.check([COEFFICIENTS], ",".join(COEFFICIENTS))
    for row, degree in enumerate(columns.numbers("l")):
        if degree != row:
            raise columns.fault(row, f"l must count 0, 1, 2, ...: {row} is next, not {degree:g}")
    return PhaseMatrix(*(columns.numbers(name) for name in COEFFICIENTS[1:]), tolerance=tolerance)


def write_coefficients(phase_matrix: PhaseMatrix, path: PathName) -> None:
    """Writes the table that `read_coefficients` reads: every digit, all of it or nothing."""
    columns = [range(phase_matrix.terms), *phase_matrix.coefficients.T.tolist()]
    write_table(dict(zip(COEFFICIENTS, columns, strict=True)), path)


def write_table(columns: Mapping[str, Sequence[Any]], path: PathName, comment: str = "") -> None:
    """Writes columns as CSV behind a checksum, all or nothing, every digit, nothing for NaN. Raises OSError."""
    with write_sealed_text(path) as file:
        file.writelines(f"# {line}\n" for line in comment.splitlines())
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            rows.writerow("" if one != one else one if isinstance(one, str | int) else repr(float(one)) for one in row)
