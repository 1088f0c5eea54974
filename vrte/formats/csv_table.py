"""Results as CSV: a commented header that says all that the rows do not, then one row a direction."""

import json
import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vrte.arrays import Array, in_one_line
from vrte.errors import SceneError
from vrte.formats.atomic import atomic_write
from vrte.formats.contents import (
    KINDS,
    Kind,
    Result,
    arrays_of,
    as_json,
    described,
    kind_of,
    reason,
    restored,
    undescribed,
)
from vrte.formats.text_file import file_name, read_text
from vrte.spectrum import SCENE

LARGEST_FILE = 4_000_000_000  # bytes
ELEMENTS = [f"{row}{column}" for row in range(4) for column in range(4)]
TABLES = {  # the arrays that are rows of the table, and the columns of each
    "mueller": [f"f{element}" for element in ELEMENTS],
    "transmission": [f"t{element}" for element in ELEMENTS],
    "stokes": ["I", "Q", "U", "V"],
}
FIRST = "# vrte result, format 1"
VALUE = re.compile(r"# ([a-z0-9_]+) = (.*)")


def write_csv(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to ``path``, all of it or nothing; numbers keep every digit, and `vrte.load` brings them back.

    A BRDF has the columns mu_i, mu_o, phi_deg, f00 .. f33 [sr-1], then t00 .. t33 where transmission was computed; a
    spectrum has wavelength_um before them; a field has tau, mu, phi_deg, I, Q, U, V, with mu0 before them for several
    beams. All else is in lines before them that start with # (docs/exports.md). Raises OSError.

    >>> write_csv(brdf, "result.csv")
    """
    kind, arrays = kind_of(result), arrays_of(result)
    header = _header(kind, arrays, described(result))
    with atomic_write(path) as part, open(part, "w", encoding="ascii", newline="") as file:
        file.writelines(f"{line}\n" for line in header)
        file.write(",".join(_columns(kind, arrays)) + "\n")
        file.writelines(_lines(kind, arrays))


def _header(kind: Kind, arrays: dict[str, Any], told: dict[str, str]) -> Iterator[str]:
    """What people want to know, then every array that is no table and every text, each as JSON."""
    about = kind.coordinates | kind.variables
    yield FIRST
    yield "# The columns below, and the values in these lines:"
    for name, values in arrays.items():
        columns = f", columns {TABLES[name][0]} .. {TABLES[name][-1]}" if name in TABLES else ""
        size = " x ".join(map(str, np.shape(values))) or "1"
        yield f"#   {name} ({size}) [{about[name].units}]: {about[name].long_name}{columns}"
    for name, text in told.items():
        yield f"# {name} = {text if name == 'diagnostics' else as_json(text)}"
    for name, values in arrays.items():
        if name not in TABLES:
            yield f"# {name} = {as_json(np.asarray(values).tolist())}"


def _columns(kind: Kind, arrays: dict[str, Any]) -> list[str]:
    return [*kind.coordinates, *(column for name in TABLES if name in arrays for column in TABLES[name])]


def _lines(kind: Kind, arrays: dict[str, Any]) -> Iterator[str]:
    tables = [arrays[name].reshape(-1, len(TABLES[name])) for name in TABLES if name in arrays]
    for place, directions in enumerate(_directions(kind, arrays)):
        numbers = np.concatenate([directions, *(table[place] for table in tables)])
        yield ",".join(map(repr, numbers.tolist())) + "\n"


def _directions(kind: Kind, arrays: dict[str, Any]) -> Array:
    """Every combination of the coordinates, the last one fastest: (rows, coordinates)."""
    grids = np.meshgrid(*(arrays[name] for name in kind.coordinates), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1)


def load_csv(path: str | os.PathLike[str]) -> Result:
    """The result that `write_csv` wrote to ``path``, every digit as it was.

    Raises FileNotFoundError, and SceneError, which names the line, for a file that is not as it was written.

    >>> write_csv(brdf, "result.csv")
    >>> load_csv("result.csv").mueller.shape
    (2, 20, 37, 4, 4)
    """
    name = file_name(path)
    if not Path(name).is_file():
        raise FileNotFoundError(f"no such file: {name}")
    try:
        return _restored(read_text(name, LARGEST_FILE))
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from error


def _restored(text: str) -> Result:
    if not text.startswith(FIRST + "\n"):
        raise SceneError(f"line 1: not a result that vrte can read back, it must be {FIRST!r}")
    if not text.endswith("\n"):
        raise SceneError("the file is cut off: its last line has no end")
    lines = text.split("\n")[:-1]
    count = next((place for place, line in enumerate(lines) if not line.startswith("#")), len(lines))
    header = _values(lines[:count])
    kind = KINDS.get(str(header.get("kind")))
    if kind is None:
        raise SceneError(f"the header must say its kind, one of {', '.join(KINDS)}")
    names = [name for name in (*kind.coordinates, *kind.variables) if name in header]
    arrays = {name: _array(name, header[name]) for name in names}
    arrays |= _tables(kind, arrays, lines[count:], count + 1)
    try:
        return restored(kind, arrays, undescribed(header["diagnostics"], header.get(SCENE)))
    except KeyError as error:
        raise SceneError(f"the header has no line for {error}") from error
    except (TypeError, ValueError, AttributeError, RecursionError) as error:
        raise SceneError(f"the header does not fit the rows: {reason(error)}") from error


def _values(header: list[str]) -> dict[str, Any]:
    """What the lines of the form "# name = JSON" say."""
    found = {}
    for place, line in enumerate(header, 1):
        match = VALUE.fullmatch(line)
        if match:
            try:
                found[match[1]] = json.loads(match[2])
            except (ValueError, RecursionError) as error:
                raise SceneError(f"line {place}: {match[1]} is not valid JSON ({reason(error)})") from error
    return found


def _array(name: str, value: Any) -> Array:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SceneError(f"the header's {name} must be numbers: {reason(error)}") from error


def _tables(kind: Kind, arrays: dict[str, Array], lines: list[str], first: int) -> dict[str, Array]:
    """The tables below the header, whose first line is the line ``first`` of the file."""
    missing = [name for name in kind.coordinates if name not in arrays or arrays[name].ndim != 1]
    if missing:
        raise SceneError(f"the header has no list for {missing[0]}")
    shape = tuple(arrays[name].size for name in kind.coordinates)
    count = math.prod(shape)
    given = lines[0].split(",") if lines else []
    tables = [name for name in TABLES if name in kind.variables and TABLES[name][0] in given]
    wanted = _columns(kind, dict.fromkeys(tables))
    if not tables or given != wanted:
        raise SceneError(f"line {first}: the columns must be {','.join(wanted)}")
    if len(lines) - 1 != count:
        raise SceneError(f"there must be {count} rows, one a direction, not {len(lines) - 1}")
    rows = np.empty((count, len(wanted)))
    for place, line in enumerate(lines[1:]):
        rows[place] = _row(first + 1 + place, line, len(wanted))
    _check_directions(rows[:, : len(shape)], _directions(kind, arrays), first + 1)
    end, found = len(shape), {}
    for name in tables:
        start, end = end, end + len(TABLES[name])
        cells = (4,) if name == "stokes" else (4, 4)
        found[name] = rows[:, start:end].reshape(*shape, *cells)
    return found


def _row(place: int, line: str, count: int) -> list[float]:
    try:
        values = [float(item) for item in line.split(",")]
    except ValueError:
        given = in_one_line(repr(line), 60)
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
