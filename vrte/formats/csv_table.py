"""Results as CSV: a commented header that says all that the rows do not, then one row a direction."""

import json
import math
import re
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.formats.atomic import PathName, check_file, write_sealed_text
from vrte.formats.columns import Lines
from vrte.formats.contents import (
    ARRAYS,
    NAMES,
    Kind,
    Result,
    check_size,
    collect_arrays,
    convert_to_json,
    describe_result,
    explain_error,
    find_kind,
    find_stored_kind,
    list_derivatives,
    read_derivatives,
    restore_result,
)

LARGEST_HEADER = 50_000_000  # bytes
FIRST = "# vrte result, format 1"
VALUE = re.compile(r"# ([a-z0-9_]+) = (.*)")
AS_JSON = ("diagnostics", NAMES)  # texts that are JSON already


def write_csv(result: Result, path: PathName) -> None:
    """Writes ``result`` to ``path``, all of it or nothing; numbers keep every digit, and `vrte.load` brings them back.

    A BRDF has the columns mu_i, mu_o, phi_deg, f00 .. f33 [sr-1], then t00 .. t33 where transmission was computed and
    s00 .. s33 of rough surfaces; a spectrum has wavelength_um before them; a field has tau, mu, phi_deg, I, Q, U, V,
    with mu0 before them for several beams. Of the first of the derivatives that the header lists columns begin with
    d1_. All else is in lines before them that start with # (docs/how_to/exports.md).
    Raises OSError.
    """
    kind, arrays = find_kind(result), collect_arrays(result)
    tables = list_tables(kind, arrays, len(list_derivatives(result)))
    header = [*format_header(kind, arrays, tables, describe_result(result))]
    axes = [arrays[name] for name in kind.coordinates]
    directions = np.stack([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")], axis=1)
    by_row = [directions]
    for name, columns in tables.items():
        by_row.append(put_in_rows(kind, name, arrays[name]).reshape(len(directions), len(columns)))
    with write_sealed_text(path) as file:
        file.writelines(f"{line}\n" for line in [*header, ",".join([*kind.coordinates, *chain(*tables.values())])])
        for row in zip(*by_row, strict=True):
            file.write(",".join(map(repr, np.concatenate(row).tolist())) + "\n")


def list_tables(kind: Kind, given: Iterable[str], derivatives: int) -> dict[str, list[str]]:
    """The arrays ``given`` that are rows of the table, and the columns of each."""
    there = {*given}
    return {
        name: about.name_columns(derivatives)
        for name, about in kind.variables.items()
        if name in there and about.columns
    }


def put_in_rows(kind: Kind, name: str, values: Array) -> Array:
    """The values of a table with its coordinates in front, derivatives behind them."""
    return np.moveaxis(values, 0, len(kind.coordinates)) if kind.variables[name].is_derivative else values


def format_header(
    kind: Kind, arrays: dict[str, Any], tables: dict[str, list[str]], texts: dict[str, str]
) -> Iterator[str]:
    """What people want to know, then every array that is no table and every text, each as JSON."""
    yield FIRST
    yield "# The columns below, and the values in these lines:"
    for name, values in arrays.items():
        columns = f", columns {tables[name][0]} .. {tables[name][-1]}" if name in tables else ""
        size = " x ".join(map(str, np.shape(values))) or "1"
        yield f"#   {name} ({size}) [{kind.arrays[name].units}]: {kind.arrays[name].long_name}{columns}"
    for name, text in texts.items():
        yield f"# {name} = {text if name in AS_JSON else convert_to_json(text)}"
    for name, values in arrays.items():
        if name not in tables:
            yield f"# {name} = {convert_to_json(np.asarray(values).tolist())}"


def load_csv(path: PathName, most_bytes: float) -> Result:
    """The result that `write_csv` wrote to ``path``, every digit as it was; ``most_bytes`` and errors, which name the
    line, as of `vrte.load`. It is read line by line, into no more memory than the values take."""
    with open(check_file(path), "rb") as file:
        lines = Lines(file)
        texts, arrays, columns = read_header(lines)
        return restore_result(texts, arrays | read_tables(texts, arrays, columns, lines, most_bytes))


def read_header(lines: Lines) -> tuple[dict[str, str], dict[str, Array], list[str]]:
    """The texts and arrays in the lines at the beginning, and the names of the columns in the first line below them."""
    if lines.is_sealed:
        next(lines)
    if next(lines, "") != FIRST:
        raise SceneError(f"line {max(lines.place, 1)}: not a result that vrte can read back, it must be {FIRST!r}")
    texts: dict[str, str] = {}
    arrays: dict[str, Array] = {}
    left = LARGEST_HEADER
    while (line := next(lines, "")).startswith("#"):
        left -= len(line)
        if left < 0:
            raise SceneError(f"the header is longer than {LARGEST_HEADER} bytes")
        if match := VALUE.fullmatch(line):
            name, text = match.groups()
            try:
                value = json.loads(text)
                if name in ARRAYS:
                    arrays[name] = np.array(value, dtype=np.float64)
                else:
                    texts[name] = text if name in AS_JSON else value
            except (TypeError, ValueError, OverflowError, RecursionError) as error:
                raise SceneError(f"line {lines.place}: {name} cannot be read ({explain_error(error)})") from error
    return texts, arrays, line.split(",")


def read_tables(
    texts: dict[str, str], arrays: dict[str, Array], given: list[str], lines: Lines, most_bytes: float
) -> dict[str, Array]:
    """The tables below the header, whose last line names the columns ``given``."""
    kind, derivatives = find_stored_kind(texts), len(read_derivatives(texts))
    missing = [name for name in kind.coordinates if name not in arrays or arrays[name].ndim != 1]
    if missing:
        raise SceneError(f"the header has no list for {missing[0]}")
    axes = [arrays[name] for name in kind.coordinates]
    shape = tuple(axis.size for axis in axes)
    tables = list_tables(kind, kind.variables, derivatives)
    tables = {name: columns for name, columns in tables.items() if columns and columns[0] in given}
    wanted = [*kind.coordinates, *chain(*tables.values())]
    if not tables or given != wanted:
        raise SceneError(f"line {lines.place}: the columns must be {','.join(wanted)}")
    rows, first = math.prod(shape), lines.place + 1
    check_size(8.0 * rows * (len(wanted) - len(shape)), most_bytes)
    if rows != lines.total - lines.place:
        raise SceneError(f"there must be {rows} rows, one a direction, not {lines.total - lines.place}")
    numbers = lines.read_numbers(rows, len(wanted))
    for column, axis in enumerate(np.meshgrid(*axes, indexing="ij", sparse=True)):
        wrong = np.flatnonzero(numbers[:, column] != np.broadcast_to(axis, shape).ravel())
        if wrong.size:
            place = np.unravel_index(wrong[0], shape)
            right = [float(axes[k][place[k]]) for k in range(len(axes))]
            found = numbers[wrong[0], : len(axes)].tolist()
            raise SceneError(f"line {first + wrong[0]}: the row must be for {right}, as the header says, not {found}")
    ends = np.cumsum([len(axes), *map(len, tables.values())])
    found = {}
    for name, start, end in zip(tables, ends, ends[1:], strict=False):
        about, table = kind.variables[name], numbers[:, start:end]
        inner = (derivatives,) * about.is_derivative + (4,) * (len(about.dims) - about.is_derivative - len(axes))
        table = table.reshape(*shape, *inner)
        found[name] = np.moveaxis(table, len(axes), 0) if about.is_derivative else table
    return found
