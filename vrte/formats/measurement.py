"""Measurements as files: a long table, one number a row, as CSV or NetCDF, or arrays over angles in NetCDF.

What the columns mean, and which quantities there are, is known above: vrte/fit/quantities.py.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import PathName, check_file_name
from vrte.formats.columns import Columns, read_any_text
from vrte.formats.instrument_files import find_table
from vrte.formats.netcdf import Stored, read_netcdf

LARGEST_FILE = 100_000_000  # bytes
MOST_ROWS = 1_000_000
WORDS = ("quantity", "geometry", "illuminant")  # columns of words, the others hold numbers
SIGMA = "_sigma"  # behind the name of a quantity in NetCDF: its standard deviations


def read_columns(path: PathName, names: Sequence[str]) -> dict[str, list[Any]] | Columns:
    """A measurement file's columns among ``names``, or the table of an instrument. Raises SceneError, OSError."""
    if Path(check_file_name(path)).suffix.lower() == ".nc":
        found = read_netcdf(path, None, LARGEST_FILE)
        if "quantity" not in found.arrays:
            return spread_quantities(found, names)
        check_names([*found.arrays], names)
        return {name: np.ravel(values).tolist() for name, values in found.arrays.items()}
    text, encoding = read_any_text(path, LARGEST_FILE)
    try:
        columns = Columns.parse(text, MOST_ROWS)
    except SceneError:  # of a line before the table of an instrument
        return find_table(text, encoding)
    if not {"quantity", "value"} & {*columns.names}:
        return find_table(text, encoding)
    if not columns.rows:
        raise SceneError("the table is empty: it needs a line with the names of columns, a row a number measured")
    check_names(columns.names, names)
    columns.check()
    return {
        name: columns.words(name) if name in WORDS else columns.numbers(name, may_be_empty=True).tolist()
        for name in columns.names
    }


def check_names(given: Sequence[str], names: Sequence[str]) -> None:
    """Raises SceneError for an unknown column, and for a missing one that the others need."""
    for name in given:
        if name not in names:
            raise SceneError(f"the column {name!r} is unknown: there are {', '.join(names)}")
    for name in ("quantity", "value"):
        if name not in given:
            raise SceneError(f"the column {name} is missing: the columns are {', '.join(names)}")


def spread_quantities(stored: Stored, names: Sequence[str]) -> dict[str, list[Any]]:
    """The rows of quantities that are arrays over coordinates, with those in _sigma. Raises SceneError."""
    xarray = import_extra("xarray", "reading a measurement in NetCDF", "files")
    data = xarray.Dataset({name: (stored.dims[name], values) for name, values in stored.arrays.items()})
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
        there = ~np.isnan(values.values)
        count = int(there.sum())
        parts = {one: data[one] for one in coordinates if {*data[one].dims} <= {*values.dims}}
        parts |= {"sigma": data[f"{name}{SIGMA}"]} if f"{name}{SIGMA}" in data else {}
        found["quantity"] += [str(name)] * count
        found["value"] += values.values[there].tolist()
        for one in (*coordinates, "sigma"):
            empty = ["" if one in WORDS else np.nan] * count
            spread = parts[one].broadcast_like(values).transpose(*values.dims).values[there] if one in parts else None
            found[one] += empty if spread is None else spread.tolist()
    return found
