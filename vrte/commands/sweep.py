"""`vrte sweep`: a sweep file in, one table of many scenes out."""

import argparse
import time
from typing import TYPE_CHECKING

import numpy as np

from vrte import __version__
from vrte.basics.errors import SceneError, SweepError
from vrte.commands.common import Parser, check_extra, make_option_reader, say_written, show_progress
from vrte.sweep import sweep
from vrte.sweep.engines import ENGINES
from vrte.sweep.page.writing import SUFFIX as PAGE_SUFFIX
from vrte.sweep.page.writing import check_sweep_for_page, save_page
from vrte.sweep.run import MOST_WORKERS
from vrte.sweep.table import SUFFIXES
from vrte.sweep.template import read_sweep

if TYPE_CHECKING:
    import xarray

MOST_NAMED = 3  # failures that --strict names
HOW = ("engine", "scheduler", "workers", "chunk", "time_limit_s", "precision")


def add(command: Parser) -> None:
    """The arguments of `vrte sweep`."""
    command.take("file SWEEP.toml", "a scene file with a table [axes]")
    help_text = ".zarr for large tables, or .nc"
    command.take("-o --output OUT.zarr", help_text, suffixes=SUFFIXES, required=True)
    command.take("--engine", "what computes; default: threads", choices=ENGINES, default="threads")
    command.take("--scheduler ADDRESS", "of a Dask cluster; default: one on this machine")
    help_text = "cores, or Dask worker processes; default: all that may be used"
    command.take("--workers N", help_text, limits=(1, MOST_WORKERS))
    command.take("--chunk N", "scenes that are computed and written together", limits=(1, 10**6))
    help_text = "refuse what is predicted to take longer in all; default: none"
    command.take("--time-limit-s X", help_text, type=make_option_reader("time_limit_s"))
    command.take_options("precision")
    help_text = "also a page with the lobes to turn around in any browser: one file that needs no network"
    command.take("--page OUT.html", help_text, suffixes=(PAGE_SUFFIX,))
    command.take("--strict", "a failure (exit code 1) where any scene has no result")


def check(options: argparse.Namespace) -> None:
    """Whether tables can be written. Raises MissingExtraError."""
    check_extra("a sweep", "files", ("xarray", "zarr", "h5netcdf"))


def run(options: argparse.Namespace) -> None:
    if options.page is not None:
        check_sweep_for_page(read_sweep(options.file))
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
    say_written(options.output)
    if failed == errors.size:
        raise SceneError(f"all scenes failed; the first: {errors.values.flat[0]}")
    if failed and options.strict:
        first = "; ".join(describe_failures(errors))
        raise SweepError(f"{options.file}: {failed} of {errors.size} scenes failed: {first}")
    if options.page is not None:
        (off,) = save_page({options.file.stem: table}, options.page, folder=options.file.parent).values()
        say_written(options.page)
        print(f"  between its scenes and directions off by at most {100.0 * off.max():.2g} % at {off.size} points")
    table.close()


def describe_failures(errors: "xarray.DataArray") -> list[str]:
    """Where the first scenes without result are, and their errors."""
    found = []
    for index in np.argwhere(errors.values != "")[:MOST_NAMED]:
        here = errors[tuple(index)]
        values = ", ".join(f"{name} = {value.item():g}" for name, value in here.coords.items())
        found.append(f"{values}: {here.item()}")
    return found
