"""Results to files and back, in the format that the file's name asks for: NetCDF (netcdf.py), CSV, or Zarr.

CSV has a commented header that says all that the rows do not, then one row a direction. Zarr (format 3) is a folder of
unpacked arrays; an attribute has a checksum of its numbers and texts: a copy in other chunks keeps it.
"""

import hashlib
import json
import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import PathName, check_file, check_file_name, write_atomically, write_sealed_text
from vrte.formats.columns import Lines
from vrte.formats.contents import (
    ARRAYS,
    LARGEST_RESULT,
    MEANINGLESS,
    NAMES,
    TEXTS,
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
    to_xarray,
)
from vrte.formats.netcdf import LARGEST_TEXT, load_netcdf, save_netcdf

LARGEST_HEADER = 50_000_000  # bytes
FIRST = "# vrte result, format 1"
VALUE = re.compile(r"# ([a-z0-9_]+) = (.*)")
AS_JSON = ("diagnostics", NAMES)  # texts that are JSON already


def write_csv(result: Result, path: PathName) -> None:
    """Writes ``result`` as CSV, all or nothing, every digit: rows are directions, all else is above them behind #."""
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
    """The result that `write_csv` wrote, read line by line; ``most_bytes`` and errors as of `vrte.load`."""
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


PURPOSE = "reading or writing Zarr"
FORMAT = 3
METADATA = "zarr.json"

SEAL = "sha256"  # the attribute


def save_zarr(result: Result, path: PathName) -> None:
    """Writes ``result`` to a Zarr folder, all or nothing, in place of such a one. Raises MissingExtraError, OSError."""
    import_extra("zarr", PURPOSE, "files")
    dataset = to_xarray(result)
    dataset.attrs[SEAL] = hash_content(dataset.attrs, collect_arrays(result))
    unpacked: Any = {name: {"compressors": []} for name, array in dataset.variables.items() if array.dtype.kind == "f"}
    with write_atomically(path, METADATA) as part, warnings.catch_warnings():
        # words are not part of Zarr's specification yet; they only label the Stokes parameters
        warnings.filterwarnings("ignore", "The data type")
        dataset.to_zarr(part, mode="w", zarr_format=FORMAT, consolidated=False, encoding=unpacked)


def load_zarr(path: PathName, most_bytes: float) -> Result:
    """The result in a Zarr folder of plain numbers, format 3; ``most_bytes`` and errors as of `vrte.load`."""
    zarr = import_extra("zarr", PURPOSE, "files")
    folder = Path(check_file_name(path))
    if not folder.is_dir():
        raise SceneError("it is no folder, but a file, a pipe or a device")
    for found in folder.rglob("*"):
        if found.is_symlink() or not (found.is_file() or found.is_dir()):
            raise SceneError("something in it is a link, a pipe or a device: only files in the folder are read")
    attributes = read_metadata(folder).get("attributes", {})
    names = [name for name in ARRAYS if (folder / name).is_dir()]
    check_size(sum(count_declared_bytes(folder, name) for name in names), most_bytes)
    group = zarr.open_group(folder, mode="r", zarr_format=FORMAT)
    arrays = {name: np.asarray(group[name][...]) for name in names}
    if SEAL in attributes and attributes[SEAL] != hash_content(attributes, arrays):
        words = f"if they were changed on purpose, take its attribute {SEAL} away"
        raise SceneError(f"it is damaged: its numbers or texts are not those that were written (checksum); {words}")
    return restore_result(attributes, arrays)


def hash_content(attributes: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    """SHA-256 of all that makes a result: texts, and arrays by their names, every bit."""
    made = hashlib.sha256(json.dumps([attributes.get(name) for name in TEXTS]).encode())
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name], "<f8")
        made.update(json.dumps([name, values.shape]).encode())
        made.update(values.data)
    return made.hexdigest()


def read_metadata(folder: Path) -> Any:
    """The metadata of a Zarr folder."""
    with open(folder / METADATA, "rb") as file:
        text = file.read(LARGEST_TEXT + 1)
    if len(text) > LARGEST_TEXT:
        raise SceneError(f"its {METADATA} is longer than {LARGEST_TEXT} bytes")
    found = json.loads(text)
    if found["zarr_format"] != FORMAT:
        raise SceneError(f"it is of Zarr format {found['zarr_format']!r}: only {FORMAT} is read")
    return found


def count_declared_bytes(folder: Path, name: str) -> float:
    """Bytes of an array, if it is of plain numbers that are all there. Raises SceneError."""
    about = read_metadata(folder / name)
    shape, codecs = [int(length) for length in about["shape"]], [codec["name"] for codec in about["codecs"]]
    if about["data_type"] != "float64" or codecs != ["bytes"] or about.get("storage_transformers"):
        raise SceneError(f"its {name} must be plain numbers of 8 bytes, not {about['data_type']} by {codecs}")
    size = 8.0 * math.prod(shape)
    if size > sum(file.stat().st_size for file in (folder / name).rglob("*") if file.is_file()):
        raise SceneError(f"its {name} declares {size:.4g} bytes of numbers, and parts of them are not there")
    return size


Writer = Callable[[Result, PathName], None]
Reader = Callable[[PathName, float], Result]
FORMATS: dict[str, tuple[Writer, Reader]] = {  # another one: a file that writes and reads it, and a row
    ".nc": (save_netcdf, load_netcdf),
    ".csv": (write_csv, load_csv),
    ".zarr": (save_zarr, load_zarr),
}


def save(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes a result to .nc, .csv or .zarr, all or nothing. Raises SceneError, OSError, MissingExtraError."""
    suffix = Path(check_file_name(path)).suffix.lower()
    if suffix not in FORMATS:
        raise SceneError(f"the name of a result must end in {', '.join(FORMATS)}, not {check_file_name(path)!r}")
    FORMATS[suffix][0](result, path)


def load(path: str | os.PathLike[str], *, most_bytes: float = LARGEST_RESULT) -> Result:
    """The BRDF, field or spectrum in a file, every digit as it was saved.

    Parameters
    ----------
    path : path
        Its name ends in .csv for a table, in .zarr for a folder of Zarr, otherwise it is NetCDF.
    most_bytes : float
        A result whose values take more than this in memory is refused before it takes them: allow more for a file that
        you trust. Nothing but numbers and texts is read, and nothing from another file (docs/reference/security.md).

    Returns
    -------
    Brdf, Field or Spectrum
        What was saved.

    Raises
    ------
    FileNotFoundError
        Where there is no such file.
    SceneError
        For a file that holds no result of this package.
    MissingExtraError
        For NetCDF and Zarr without the extra "files".

    Examples
    --------
    >>> import vrte
    >>> from vrte.formats.result_file import save
    >>> save(brdf, "result.nc")
    >>> vrte.load("result.nc").mueller.shape
    (2, 20, 37, 4, 4)
    """
    most_bytes = check_number("most_bytes", most_bytes, 0.0, math.inf, "a number of bytes >= 0")
    name = check_file_name(path)
    if not os.path.exists(name):
        raise FileNotFoundError(f"no such file: {name}")
    _, read = FORMATS.get(Path(name).suffix.lower(), FORMATS[".nc"])
    try:
        return read(path, most_bytes)
    except SceneError as error:
        raise error.behind(name) from error
    except (*MEANINGLESS, FileNotFoundError) as error:  # a file of a folder that is not there
        raise SceneError(f"{name} holds no BRDF, field or spectrum written by vrte: {explain_error(error)}") from error
