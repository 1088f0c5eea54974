"""`vrte sweep`: a sweep file in, one table of many scenes out."""

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vrte import __version__
from vrte.basics.errors import SceneError, SweepError
from vrte.commands.common import (
    Parser,
    Tick,
    add_options,
    check_extra,
    check_output,
    label_errors,
    make_option_reader,
    make_whole_number_reader,
    say_written,
    show_progress,
)
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


def add(command: Parser) -> None:
    """The arguments of `vrte sweep`."""
    command.add_argument("file", metavar="SWEEP.toml", type=Path, help="a scene file with a table [axes]")
    command.add_argument(
        "-o", "--output", metavar="TABLE.zarr", type=Path, required=True, help=".zarr for large tables, or .nc"
    )
    command.add_argument("--engine", choices=ENGINES, default="threads", help="what computes; default: threads")
    command.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster; default: one on this machine")
    command.add_argument(
        "--workers",
        metavar="N",
        type=make_whole_number_reader(1, MOST_WORKERS),
        help="cores, or Dask worker processes; default: all that may be used",
    )
    command.add_argument(
        "--chunk",
        metavar="N",
        type=make_whole_number_reader(1, 10**6),
        help="scenes that are computed and written together",
    )
    told = "refuse what is predicted to take longer in all; default: none"
    command.add_argument("--time-limit-s", metavar="X", type=make_option_reader("time_limit_s"), help=told)
    add_options(command, "precision")
    told = "also a page with the lobes to turn around in any browser: one file that needs no network"
    command.add_argument("--page", metavar="PAGE.html", type=Path, help=told)
    command.add_argument("--strict", action="store_true", help="a failure (exit code 1) where any scene has no result")


def run(options: argparse.Namespace) -> None:
    check_extra("a sweep", "files", ("xarray", "zarr", "h5netcdf"))
    if not (options.output.suffix == ".zarr" and options.output.is_dir()):
        check_output(options.output, *SUFFIXES)
    if options.page is not None:
        check_output(options.page, PAGE_SUFFIX)
        with label_errors(options.file):
            check_sweep_for_page(read_sweep(options.file))
    start = time.monotonic()
    with show_progress() as (phase, tick):
        phase("scenes")
        table = compute_table(options, tick)
    describe(options, table, time.monotonic() - start)
    if options.page is not None:
        with label_errors(options.file):
            (errors,) = save_page({options.file.stem: table}, options.page, folder=options.file.parent).values()
        say_written(options.page)
        print(
            f"  between its scenes and directions off by at most {100.0 * errors.max():.2g} % at {errors.size} points"
        )
    table.close()


def compute_table(options: argparse.Namespace, tick: Tick) -> "xarray.Dataset":
    """The table; complaints about the sweep file begin with its name."""
    how = {
        name: getattr(options, name)
        for name in ("engine", "scheduler", "workers", "chunk", "time_limit_s", "precision")
    }
    with label_errors(options.file):
        return sweep(options.file, options.output, **how, progress=tick)


def describe(options: argparse.Namespace, table: "xarray.Dataset", seconds: float) -> None:
    """What is in the table, and how many of its scenes failed."""
    errors = table["error"]
    failed = int((errors != "").sum())
    lengths = " x ".join(f"{length} {name}" for name, length in errors.sizes.items())
    print(f"vrte {__version__}: sweep of {options.file}")
    print(f"  {errors.size} scenes ({lengths}){f', {failed} without result' if failed else ''}, {seconds:.1f} s")
    print(f"  {', '.join(name for name in map(str, table.data_vars) if name != 'error')}")
    print(f"wrote {options.output} ({count_bytes(options.output) / 1e3:,.0f} kB)")
    if failed == errors.size:
        raise SceneError(f"{options.file}: all scenes failed; the first: {errors.values.flat[0]}")
    if failed and options.strict:
        raise SweepError(
            f"{options.file}: {failed} of {errors.size} scenes failed: {'; '.join(describe_failures(errors))}"
        )


def describe_failures(errors: "xarray.DataArray") -> list[str]:
    """Where the first scenes without result are, and what they said."""
    found = []
    for place in np.argwhere(errors.values != "")[:MOST_NAMED]:
        here = errors[tuple(place)]
        values = ", ".join(f"{name} = {value.item():g}" for name, value in here.coords.items())
        found.append(f"{values}: {here.item()}")
    return found


def count_bytes(path: Path) -> int:
    """Bytes of a file, or of all in a folder."""
    return sum(file.stat().st_size for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())
