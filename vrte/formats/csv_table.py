"""Results as CSV: a commented header that says all that the rows do not, then one row a direction."""

import json
import math
import os
import re
from collections.abc import Iterable, Iterator
from typing import Any, BinaryIO

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.atomic import check_file, check_file_name, check_text, read_blocks, write_sealed_text
from vrte.formats.contents import (
    KINDS,
    MEANINGLESS,
    NAMES,
    Kind,
    Result,
    check_names,
    collect_arrays,
    convert_to_json,
    describe_result,
    explain_error,
    find_kind,
    list_derivatives,
    restore_result,
)
from vrte.formats.hdf5_file import LARGEST_RESULT, check_size
from vrte.results.quantities import MUELLER, STOKES
from vrte.results.spectrum import SCENE

LARGEST_HEADER = 50_000_000  # bytes
LONGEST_ROW, LONGEST_NUMBER = 10_000, 500  # bytes
BLOCK = 4096  # rows that are text in memory at a time
TABLES = {  # the arrays that are rows of the table, and the columns of each
    "mueller": list(MUELLER),
    "transmission": [name.replace("f", "t") for name in MUELLER],
    "surface": [name.replace("f", "s") for name in MUELLER],
    "stokes": list(STOKES),
}
CHANGES = {
    "jacobian": ("mueller", "stokes"),
    "transmission_jacobian": ("transmission",),
}  # tables of derivatives, of what
FIRST = "# vrte result, format 1"
VALUE = re.compile(r"# ([a-z0-9_]+) = (.*)")


def write_csv(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to ``path``, all of it or nothing; numbers keep every digit, and `vrte.load` brings them back.

    A BRDF has the columns mu_i, mu_o, phi_deg, f00 .. f33 [sr-1], then t00 .. t33 where transmission was computed and
    s00 .. s33 of rough surfaces; a spectrum has wavelength_um before them; a field has tau, mu, phi_deg, I, Q, U, V,
    with mu0 before them for several beams. Of the first of the derivatives that the header lists columns begin with
    d1_. All else is in lines before them that start with # (docs/how_to/exports.md).
    Raises OSError.

    >>> write_csv(brdf, "result.csv")
    """
    kind, arrays = find_kind(result), collect_arrays(result)
    tables = _list_tables(kind, arrays, len(list_derivatives(result)))
    header = _format_header(kind, arrays, describe_result(result))
    with write_sealed_text(path) as file:
        file.writelines(f"{line}\n" for line in header)
        file.write(",".join(_list_columns(kind, tables)) + "\n")
        file.writelines(_format_lines(kind, arrays, tables))


def _format_header(kind: Kind, arrays: dict[str, Any], told: dict[str, str]) -> Iterator[str]:
    """What people want to know, then every array that is no table and every text, each as JSON."""
    about = kind.coordinates | kind.variables
    yield FIRST
    yield "# The columns below, and the values in these lines:"
    for name, values in arrays.items():
        listed = _name_columns(kind, name, np.shape(values)[0] if name in CHANGES else 0)
        columns = f", columns {listed[0]} .. {listed[-1]}" if listed else ""
        size = " x ".join(map(str, np.shape(values))) or "1"
        yield f"#   {name} ({size}) [{about[name].units}]: {about[name].long_name}{columns}"
    for name, text in told.items():
        yield f"# {name} = {text if name in ('diagnostics', NAMES) else convert_to_json(text)}"
    for name, values in arrays.items():
        if name not in TABLES and name not in CHANGES:
            yield f"# {name} = {convert_to_json(np.asarray(values).tolist())}"


def _name_columns(kind: Kind, name: str, derivatives: int) -> list[str]:
    """The columns of an array that is rows of the table, none of any other; d1_ before those of a first derivative."""
    if name not in CHANGES:
        return TABLES.get(name, [])
    (value,) = (one for one in CHANGES[name] if one in kind.variables)
    return [f"d{number}_{column}" for number in range(1, derivatives + 1) for column in TABLES[value]]


def _list_tables(kind: Kind, given: Iterable[str], derivatives: int) -> dict[str, list[str]]:
    """The arrays ``given`` that are rows of the table, in its order, and the columns of each."""
    there = {*given} & kind.variables.keys()
    return {name: _name_columns(kind, name, derivatives) for name in (*TABLES, *CHANGES) if name in there}


def _list_columns(kind: Kind, tables: dict[str, list[str]]) -> list[str]:
    return [*kind.coordinates, *(column for columns in tables.values() for column in columns)]


def _format_lines(kind: Kind, arrays: dict[str, Any], listed: dict[str, list[str]]) -> Iterator[str]:
    directions = _list_directions(kind, arrays)
    tables = []
    for name, columns in listed.items():
        by_row = np.moveaxis(arrays[name], 0, len(kind.coordinates)) if name in CHANGES else arrays[name]
        tables.append(by_row.reshape(len(directions), len(columns)))
    for place, direction in enumerate(directions):
        numbers = np.concatenate([direction, *(table[place] for table in tables)])
        yield ",".join(map(repr, numbers.tolist())) + "\n"


def _list_directions(kind: Kind, arrays: dict[str, Any]) -> Array:
    """Every combination of the coordinates, the last one fastest: (rows, coordinates)."""
    grids = np.meshgrid(*(arrays[name] for name in kind.coordinates), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1)


def load_csv(path: str | os.PathLike[str], most_bytes: float = LARGEST_RESULT) -> Result:
    """The result that `write_csv` wrote to ``path``, every digit as it was; ``most_bytes`` as in `vrte.load`.

    It is read line by line, into no more memory than the values take. Raises FileNotFoundError, and SceneError, which
    names the line, for a file that is not as it was written.

    >>> write_csv(brdf, "result.csv")
    >>> load_csv("result.csv").mueller.shape
    (2, 20, 37, 4, 4)
    """
    name = check_file_name(path)
    if not os.path.exists(name):
        raise FileNotFoundError(f"no such file: {name}")
    try:
        with open(check_file(name), "rb") as file:
            return _read_result(Lines(file), most_bytes)
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from error


class Lines:
    """The lines of a file, one after another, none longer than makes sense; ``place`` is the last one's, from 1.

    A first line that is a checksum is checked, and passed over. Raises SceneError."""

    def __init__(self, file: BinaryIO) -> None:
        first = file.readline(LONGEST_ROW)
        sealed = check_text(first, read_blocks(file))
        file.seek(len(first) if sealed else 0)
        self.place, self._file = int(sealed), file

    def is_whole(self) -> bool:
        """Whether the last line has an end."""
        here, size = self._file.tell(), self._file.seek(0, os.SEEK_END)
        self._file.seek(max(size - 1, 0))
        last = self._file.read(1)
        self._file.seek(here)
        return last == b"\n"

    def left(self) -> int:
        """How many lines there still are."""
        here = self._file.tell()
        count = sum(block.count(b"\n") for block in iter(lambda: self._file.read(1 << 20), b""))
        self._file.seek(here)
        return count

    def next(self, most: int = LONGEST_ROW) -> str:
        """The next line without its end, empty after the last. Raises SceneError."""
        line = self._file.readline(most + 1)
        if not line:
            return ""
        self.place += 1
        if len(line) > most:
            raise SceneError(f"line {self.place}: longer than {most} bytes")
        try:
            return line.removesuffix(b"\n").decode("utf-8").removeprefix("\ufeff" if self.place == 1 else "")
        except UnicodeDecodeError as error:
            raise SceneError(f"line {self.place}: not a text file in UTF-8 (byte {error.start} of the line)") from error


def _read_result(lines: Lines, most_bytes: float) -> Result:
    header, columns = _read_header(lines)
    kind = KINDS.get(str(header.get("kind")))
    if kind is None:
        raise SceneError(f"the header must say its kind, one of {', '.join(KINDS)}")
    names = [name for name in (*kind.coordinates, *kind.variables) if name in header]
    arrays = {name: _convert_to_array(name, header[name]) for name in names}
    try:
        names = check_names(header.get(NAMES))
    except SceneError as error:
        raise SceneError(f"the header does not fit the rows: {error}") from error
    arrays |= _read_tables(kind, arrays, columns, lines, most_bytes, len(names))
    try:
        return restore_result(kind, arrays, header["diagnostics"], header.get(SCENE), names)
    except KeyError as error:
        raise SceneError(f"the header has no line for {error}") from error
    except MEANINGLESS as error:
        raise SceneError(f"the header does not fit the rows: {explain_error(error)}") from error


def _read_header(lines: Lines) -> tuple[dict[str, Any], list[str]]:
    """What the lines at the beginning say, and the names of the columns in the first line below them."""
    try:
        first = lines.next()
    except SceneError:
        first = None
    if first != FIRST:
        raise SceneError(f"line {max(lines.place, 1)}: not a result that vrte can read back, it must be {FIRST!r}")
    if not lines.is_whole():
        raise SceneError("the file is cut off: its last line has no end")
    found: dict[str, Any] = {}
    left = LARGEST_HEADER
    while (line := lines.next(LARGEST_HEADER)).startswith("#"):
        left -= len(line)
        if left < 0:
            raise SceneError(f"the header is longer than {LARGEST_HEADER} bytes")
        found |= _read_value(lines.place, line)
    return found, line.split(",")


def _read_value(place: int, line: str) -> dict[str, Any]:
    """What a line of the form "# name = JSON" says; nothing, where it has another."""
    match = VALUE.fullmatch(line)
    if not match:
        return {}
    try:
        return {match[1]: json.loads(match[2])}
    except (ValueError, RecursionError) as error:
        raise SceneError(f"line {place}: {match[1]} is not valid JSON ({explain_error(error)})") from error


def _convert_to_array(name: str, value: Any) -> Array:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(f"the header's {name} must be numbers: {explain_error(error)}") from error


def _read_tables(
    kind: Kind, arrays: dict[str, Array], given: list[str], lines: Lines, most_bytes: float, derivatives: int
) -> dict[str, Array]:
    """The tables below the header, whose last line names the columns ``given``, of so many derivatives."""
    missing = [name for name in kind.coordinates if name not in arrays or arrays[name].ndim != 1]
    if missing:
        raise SceneError(f"the header has no list for {missing[0]}")
    shape = tuple(arrays[name].size for name in kind.coordinates)
    count, first = math.prod(shape), lines.place + 1
    every = _list_tables(kind, kind.variables, derivatives)
    tables = {name: columns for name, columns in every.items() if columns and columns[0] in given}
    wanted = _list_columns(kind, tables)
    if not tables or given != wanted:
        raise SceneError(f"line {first - 1}: the columns must be {','.join(wanted)}")
    check_size(8.0 * count * (len(wanted) - len(shape)), most_bytes)
    left = lines.left()
    if left != count:
        raise SceneError(f"there must be {count} rows, one a direction, not {left}")
    found = {name: np.empty((count, len(columns))) for name, columns in tables.items()}
    for start in range(0, count, BLOCK):
        end = min(start + BLOCK, count)
        rows = np.array([_read_row(lines, len(wanted)) for _ in range(start, end)])
        places = np.unravel_index(np.arange(start, end), shape)
        directions = [arrays[name][place] for name, place in zip(kind.coordinates, places, strict=True)]
        _check_directions(rows[:, : len(shape)], np.stack(directions, axis=1), first + start)
        column = len(shape)
        for name, table in found.items():
            table[start:end] = rows[:, column : (column := column + len(tables[name]))]
    each = (4,) if "stokes" in kind.variables else (4, 4)
    return {
        name: np.moveaxis(table.reshape(*shape, derivatives, *each), len(shape), 0)
        if name in CHANGES
        else table.reshape(*shape, *each)
        for name, table in found.items()
    }


def _read_row(lines: Lines, count: int) -> list[float]:
    """The numbers in the next line."""
    line, place = lines.next(max(LONGEST_ROW, count * LONGEST_NUMBER)), lines.place
    try:
        values = [float(item) for item in line.split(",")]
    except ValueError:
        given = put_in_one_line(repr(line), 60)
        raise SceneError(f"line {place}: {given} holds something that is not a number") from None
    if len(values) != count:
        raise SceneError(f"line {place}: {count} numbers are needed, not {len(values)}")
    return values


def _check_directions(given: Array, wanted: Array, first: int) -> None:
    """Whether the rows are for the directions of the header, in their order."""
    wrong = np.flatnonzero((given != wanted).any(axis=1))
    if wrong.size:
        place = int(wrong[0])
        raise SceneError(
            f"line {first + place}: the row must be for {wanted[place].tolist()}, as the header says, "
            f"not {given[place].tolist()}"
        )
