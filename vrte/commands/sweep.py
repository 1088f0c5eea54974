"""`vrte sweep`: a sweep file in, one table of many scenes out."""

import argparse
import time
from typing import TYPE_CHECKING

import numpy as np

from vrte import __version__
from vrte.basics.errors import SceneError, SweepError
from vrte.commands.common import check_extra, label_errors, make_option_reader, report_written, show_progress
from vrte.sweep import sweep
from vrte.sweep.page.writing import check_sweep_for_page, save_page
from vrte.sweep.template import read_sweep

if TYPE_CHECKING:
    import xarray

MOST_NAMED = 3  # failures that --strict names
read_time_limit = make_option_reader("time_limit_s")
HOW = ("engine", "scheduler", "workers", "chunk", "time_limit_s", "precision")


def check(options: argparse.Namespace) -> None:
    """Whether tables can be written. Raises MissingExtraError."""
    check_extra("a sweep", "files", ("xarray", "zarr", "h5netcdf"))


def run(options: argparse.Namespace) -> None:
    with label_errors(options.file, reading=True):
        asked = read_sweep(options.file)
    if options.page is not None:
        check_sweep_for_page(asked)
    start = time.monotonic()
    with show_progress() as (phase, tick):
        phase("scenes")
        how = {name: getattr(options, name) for name in HOW}
        table = sweep(options.file, options.output, **how, progress=tick)
    errors = table["error"]
    failed = int((errors != "").sum())
    lengths = " x ".join(f"{length} {name}" for name, length in errors.sizes.items())
    without = f", {failed} without result" if failed else ""
    print(f"vrte {__version__}: sweep of {options.file}")
    print(f"  {errors.size} scenes ({lengths}){without}, {time.monotonic() - start:.1f} s")
    print(f"  {', '.join(name for name in map(str, table.data_vars) if name != 'error')}")
    report_written(options.output)
    if failed == errors.size:
        raise SceneError(f"all scenes failed; the first: {errors.values.flat[0]}")
    if failed and options.strict:
        first = "; ".join(describe_failures(errors))
        raise SweepError(f"{options.file}: {failed} of {errors.size} scenes failed: {first}")
    if options.page is not None:
        (off,) = save_page({options.file.stem: table}, options.page, folder=options.file.parent).values()
        report_written(options.page)
        print(f"  between its scenes and directions off by at most {100.0 * off.max():.2g} % at {off.size} points")
    table.close()


def describe_failures(errors: "xarray.DataArray") -> list[str]:
    """The coordinates of the first scenes without a result, and their errors."""
    found = []
    for index in np.argwhere(errors.values != "")[:MOST_NAMED]:
        here = errors[tuple(index)]
        values = ", ".join(f"{name} = {value.item():g}" for name, value in here.coords.items())
        found.append(f"{values}: {here.item()}")
    return found
