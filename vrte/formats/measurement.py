"""Measurements as files: a long table, one number a row, as CSV or NetCDF, or arrays over angles in NetCDF.

What the columns mean, and which quantities there are, is known above: vrte/fit/quantities.py.
"""

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import write_sealed_text
from vrte.formats.text_file import check_file, check_file_name, read_text

if TYPE_CHECKING:
    import xarray

LARGEST_FILE = 100_000_000  # bytes
MOST_ROWS = 1_000_000
WORDS = ("quantity", "geometry", "illuminant")  # columns of words, the others hold numbers
SIGMA = "_sigma"  # behind the name of a quantity in NetCDF: its standard deviations
SUFFIXES = ".csv", ".nc"


def read_columns(path: str | os.PathLike[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """The columns of a measurement's file, numbers or words, NaN or "" where a place is empty.

    ``names``: the columns that there may be. Raises SceneError, which names the line, MissingExtraError, OSError.

    >>> with open("panel.csv", "w") as file:
    ...     _ = file.write("quantity,theta_i_deg,value\\ntotal_reflectance,8,0.5\\n")
    >>> read_columns("panel.csv", ("quantity", "theta_i_deg", "value"))
    {'quantity': ['total_reflectance'], 'theta_i_deg': [8.0], 'value': [0.5]}
    """
    suffix = Path(check_file_name(path)).suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"the measurement {path} must end in {' or '.join(SUFFIXES)}")
    try:
        return (read_table if suffix == ".csv" else read_netcdf)(check_file(path), names)
    except SceneError as error:
        raise error.behind(path) from error


def read_table(path: str | os.PathLike[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """The columns of a CSV file; lines that start with # are comments. Raises SceneError, OSError."""
    lines = read_text(path, LARGEST_FILE).splitlines()
    kept = [(place, line) for place, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    if len(kept) > MOST_ROWS + 1:
        raise SceneError(f"the table must have at most {MOST_ROWS} rows, not {len(kept) - 1}")
    if len(kept) < 2:
        raise SceneError("the table is empty: it needs a line with the names of columns, and a row a number measured")
    header, *rows = (next(csv.reader([line], skipinitialspace=True)) for _, line in kept)
    header = [name.strip() for name in header]
    check_names(header, names)
    found: dict[str, list[Any]] = {name: [] for name in header}
    for (place, _), row in zip(kept[1:], rows, strict=True):
        if len(row) != len(header):
            raise SceneError(f"line {place}: {len(header)} values are needed, as many as columns, not {len(row)}")
        for name, text in zip(header, row, strict=True):
            found[name].append(text.strip() if name in WORDS else read_number(text.strip(), name, place))
    return found


def read_number(text: str, name: str, place: int) -> float:
    """A number of a line, NaN where there is none. Raises SceneError, which names the line."""
    try:
        return float(text) if text else np.nan
    except ValueError:
        raise SceneError(f"line {place}: {name} must be a number, not {put_in_one_line(repr(text), 40)}") from None


def check_names(given: Sequence[str], names: Sequence[str]) -> None:
    """Whether columns are known, each there once, and those without which nothing is said. Raises SceneError."""
    unknown = [name for name in given if name not in names]
    if unknown:
        raise SceneError(f"the column {unknown[0]!r} is unknown: there are {', '.join(names)}")
    if len(set(given)) < len(given):
        raise SceneError("two columns have the same name")
    missing = [name for name in ("quantity", "value") if name not in given]
    if missing:
        raise SceneError(f"the column {missing[0]} is missing: the columns are {', '.join(names)}")


def read_netcdf(path: str | os.PathLike[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """The columns of a NetCDF file: variables named as the columns, or quantities over coordinates named as they are,
    with standard deviations in variables that end in _sigma. Raises SceneError, MissingExtraError, OSError."""
    xarray = import_extra("xarray", "reading a measurement in NetCDF", "files")
    import_extra("h5netcdf", "reading a measurement in NetCDF", "files")
    if not Path(path).is_file():
        raise FileNotFoundError(f"no such file: {os.fsdecode(path)}")
    try:
        with xarray.open_dataset(path, engine="h5netcdf", decode_cf=False) as data:
            data.load()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SceneError(f"not a NetCDF-4 file that can be read ({put_in_one_line(str(error), 100)})") from error
    if "quantity" in data.variables:
        check_names([str(name) for name in data.variables], names)
        return {str(name): list_values(values.values, str(name)) for name, values in data.variables.items()}
    return spread_quantities(data, names)


def spread_quantities(data: "xarray.Dataset", names: Sequence[str]) -> dict[str, list[Any]]:
    """The rows of quantities that are arrays over angles and wavelengths; places without a number are left out."""
    coordinates = [name for name in names if name in data.coords]
    unknown = [str(name) for name in data.coords if name not in names]
    if unknown or not data.data_vars:
        words = f"the coordinate {unknown[0]!r} is unknown" if unknown else "there is no quantity"
        raise SceneError(f"{words}: quantities are variables over coordinates among {', '.join(names)}")
    found: dict[str, list[Any]] = {name: [] for name in ("quantity", *coordinates, "value", "sigma")}
    for name, values in data.data_vars.items():
        dims = values.dims
        if str(name).endswith(SIGMA):
            if str(name).removesuffix(SIGMA) not in data.data_vars:
                raise SceneError(f"{name} belongs to no quantity of the file")
            continue
        there = ~np.isnan(np.asarray(values.values, float))
        found["quantity"] += [str(name)] * int(there.sum())
        found["value"] += values.values[there].tolist()
        sigma, none = data.get(f"{name}{SIGMA}"), [np.nan] * int(there.sum())
        spread = {one: data[one] for one in coordinates if {*data[one].dims} <= {*dims}}
        whole = {one: part.broadcast_like(values).transpose(*dims).values[there] for one, part in spread.items()}
        columns = {one: list_values(part, one) for one, part in whole.items()}
        if sigma is not None:
            none = sigma.broadcast_like(values).transpose(*dims).values[there].tolist()
        found["sigma"] += none
        for one in coordinates:
            found[one] += columns.get(one, ["" if one in WORDS else np.nan] * int(there.sum()))
    return found


def list_values(values: Any, name: str) -> list[Any]:
    """A variable as a list of words or numbers. Raises SceneError."""
    flat = np.atleast_1d(np.asarray(values)).ravel().tolist()
    if name in WORDS:
        return [one.decode() if isinstance(one, bytes) else str(one) for one in flat]
    try:
        return [float(one) for one in flat]
    except (TypeError, ValueError):
        raise SceneError(f"{name} must be numbers") from None


def write_table(columns: Mapping[str, Sequence[Any]], path: str | os.PathLike[str], comment: str = "") -> None:
    """Writes columns as CSV behind a checksum, all of it or nothing; every digit of numbers, nothing for NaN. Raises
    OSError.

    >>> write_table({"quantity": ["f00"], "value": [0.25]}, "one.csv", "a panel")
    >>> print(Path("one.csv").read_text().partition("\\n")[2], end="")
    # a panel
    quantity,value
    f00,0.25
    """
    with write_sealed_text(path) as file:
        file.writelines(f"# {line}\n" for line in comment.splitlines())
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            rows.writerow("" if one != one else one if isinstance(one, str) else repr(float(one)) for one in row)
