"""Results as CSV: a commented header that says all that the rows do not, then one row a direction."""

import json
import math
import re
from collections.abc import Iterator, Mapping
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
    read_kind,
    restore_result,
)

LARGEST_HEADER = 50_000_000  # bytes
FIRST = "# vrte result, format 1"
VALUE = re.compile(r"# ([a-z0-9_]+) = (.*)")
AS_JSON = ("diagnostics", NAMES)  # texts that are JSON already


def write_csv(result: Result, path: PathName) -> None:
    """Writes ``result`` to ``path``, all of it or nothing, every digit: a column a coordinate, then those that are
    declared of arrays over directions; all else in lines before them that start with # (docs/how_to/exports.md)."""
    kind, arrays = find_kind(result), collect_arrays(result)
    tables = list_tables(kind, arrays, len(result.jacobian or ()))
    header = [*format_header(kind, arrays, tables, describe_result(result))]
    by_row = [list_directions(kind, arrays)]
    for name, columns in tables.items():
        behind = len(kind.coordinates) * kind.variables[name].is_derivative  # the coordinates, where derivatives go
        by_row.append(np.moveaxis(arrays[name], 0, behind).reshape(len(by_row[0]), len(columns)))
    with write_sealed_text(path) as file:
        file.writelines(f"{line}\n" for line in [*header, ",".join([*kind.coordinates, *chain(*tables.values())])])
        for row in zip(*by_row, strict=True):
            file.write(",".join(map(repr, np.concatenate(row).tolist())) + "\n")


def list_tables(kind: Kind, given: Mapping[str, Any], derivatives: int) -> dict[str, list[str]]:
    """The arrays ``given`` that are rows of the table, and the columns of each."""
    tables = {name: kind.variables[name] for name in kind.variables if name in given}
    return {name: about.name_columns(derivatives) for name, about in tables.items() if about.columns}


def list_directions(kind: Kind, arrays: dict[str, Any]) -> Array:
    """Every combination of the coordinates, the last one fastest: (rows, coordinates)."""
    grids = np.meshgrid(*(arrays[name] for name in kind.coordinates), indexing="ij")
    return np.stack([grid.ravel() for grid in grids], axis=1)


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
    kind, names = read_kind(texts)
    missing = [name for name in kind.coordinates if name not in arrays or arrays[name].ndim != 1]
    if missing:
        raise SceneError(f"the header has no list for {missing[0]}")
    shape = tuple(arrays[name].size for name in kind.coordinates)
    tables = list_tables(kind, kind.variables, len(names))
    tables = {name: columns for name, columns in tables.items() if columns and columns[0] in given}
    wanted = [*kind.coordinates, *chain(*tables.values())]
    if not tables or given != wanted:
        raise SceneError(f"line {lines.place}: the columns must be {','.join(wanted)}")
    rows, first = math.prod(shape), lines.place + 1
    check_size(8.0 * rows * (len(wanted) - len(shape)), most_bytes)
    if rows != lines.total - lines.place:
        raise SceneError(f"there must be {rows} rows, one a direction, not {lines.total - lines.place}")
    numbers = lines.read_numbers(rows, len(wanted))
    own, right = numbers[:, : len(shape)], list_directions(kind, arrays)
    for row in np.flatnonzero((own != right).any(axis=1))[:1]:
        words = f"the row must be for {right[row].tolist()}, as the header says, not {own[row].tolist()}"
        raise SceneError(f"line {first + row}: {words}")
    found, end = {}, len(shape)
    for name, columns in tables.items():
        start, end = end, end + len(columns)
        inner = (4,) * len([dim for dim in kind.variables[name].dims if dim.startswith("stokes")])
        several = (len(names),) * kind.variables[name].is_derivative
        found[name] = np.moveaxis(numbers[:, start:end].reshape(*shape, *several, *inner), len(shape) * len(several), 0)
    return found
