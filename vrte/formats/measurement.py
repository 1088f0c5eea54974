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
from vrte.formats.atomic import check_file, check_file_name, write_sealed_text
from vrte.formats.columns import Columns

if TYPE_CHECKING:
    import xarray

LARGEST_FILE = 100_000_000  # bytes
MOST_ROWS = 1_000_000
WORDS = ("quantity", "geometry", "illuminant")  # columns of words, the others hold numbers
SIGMA = "_sigma"  # behind the name of a quantity in NetCDF: its standard deviations


def read_columns(path: str | os.PathLike[str], names: Sequence[str]) -> dict[str, list[Any]]:
    """The columns of a measurement's file, of those that ``names`` lists: numbers or words, NaN or "" where a cell is
    empty. Raises SceneError, which names the line, MissingExtraError, OSError.

    >>> with open("panel.csv", "w") as file:
    ...     _ = file.write("quantity,theta_i_deg,value\\ntotal_reflectance,8,0.5\\n")
    >>> read_columns("panel.csv", ("quantity", "theta_i_deg", "value"))
    {'quantity': ['total_reflectance'], 'theta_i_deg': [8.0], 'value': [0.5]}
    """
    suffix = Path(check_file_name(path)).suffix.lower()
    if suffix not in (".csv", ".nc"):
        raise SceneError(f"the measurement {path} must end in .csv or .nc")
    try:
        if suffix == ".nc":
            return read_netcdf(check_file(path), names)
        columns = Columns(path, LARGEST_FILE, MOST_ROWS)
        if not columns.rows:
            raise SceneError("the table is empty: it needs a line with the names of columns, a row a number measured")
        check_names(columns.names, names)
        columns.check()
        return {
            name: columns.words(name) if name in WORDS else columns.numbers(name, may_be_empty=True).tolist()
            for name in columns.names
        }
    except SceneError as error:
        raise error.behind(path) from error


def check_names(given: Sequence[str], names: Sequence[str]) -> None:
    """Raises SceneError for an unknown column, and where one is missing without which the others say nothing."""
    unknown = [name for name in given if name not in names]
    if unknown:
        raise SceneError(f"the column {unknown[0]!r} is unknown: there are {', '.join(names)}")
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
        if str(name).endswith(SIGMA):
            if str(name).removesuffix(SIGMA) not in data.data_vars:
                raise SceneError(f"{name} belongs to no quantity of the file")
            continue
        there = ~np.isnan(np.asarray(values.values, float))
        count = int(there.sum())

        def spread(part: Any) -> Any:
            return part.broadcast_like(values).transpose(*values.dims).values[there]  # noqa: B023

        found["quantity"] += [str(name)] * count
        found["value"] += values.values[there].tolist()
        sigma = data.get(f"{name}{SIGMA}")
        found["sigma"] += [np.nan] * count if sigma is None else spread(sigma).tolist()
        for one in coordinates:
            empty = ["" if one in WORDS else np.nan] * count
            found[one] += list_values(spread(data[one]), one) if {*data[one].dims} <= {*values.dims} else empty
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
    OSError."""
    with write_sealed_text(path) as file:
        file.writelines(f"# {line}\n" for line in comment.splitlines())
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            rows.writerow("" if one != one else one if isinstance(one, str) else repr(float(one)) for one in row)
