"""`vrte sweep`: a sweep file in, one table of many scenes out."""

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte import __version__, sweep
from vrte.commands.common import Tick, check_extra, check_output, whole_number
from vrte.errors import SceneError
from vrte.sweep.engines import ENGINES
from vrte.sweep.run import MOST_WORKERS
from vrte.sweep.store import SUFFIXES

if TYPE_CHECKING:
    import xarray


def add(commands: Any) -> None:
    """`vrte sweep`."""
    help_text = "the Mueller BRDFs, or Stokes fields, of many scenes, as one table"
    command = commands.add_parser("sweep", help=help_text, description=f"Computes {help_text}; docs/sweeps.md.")
    command.add_argument("file", metavar="SWEEP.toml", type=Path, help="a scene file with a table [axes]")
    command.add_argument(
        "-o", "--output", metavar="TABLE.zarr", type=Path, required=True, help=".zarr for large tables, or .nc"
    )
    command.add_argument("--engine", choices=ENGINES, default="threads", help="what computes; default: threads")
    command.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster; default: one on this machine")
    command.add_argument(
        "--workers",
        metavar="N",
        type=whole_number(1, MOST_WORKERS),
        help="cores, or Dask worker processes; default: all that may be used",
    )
    command.add_argument(
        "--chunk", metavar="N", type=whole_number(1, 10**6), help="scenes that are computed and written together"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    check_extra("a sweep", "files", ("xarray", "zarr", "h5netcdf"))
    if not (options.output.suffix == ".zarr" and options.output.is_dir()):
        check_output(options.output, *SUFFIXES)
    start = time.monotonic()
    with told() as tick:
        table = made(options, tick)
    describe(options, table, time.monotonic() - start)


def made(options: argparse.Namespace, tick: Tick) -> "xarray.Dataset":
    """The table; complaints about the sweep file begin with its name."""
    try:
        return sweep(
            options.file,
            options.output,
            engine=options.engine,
            scheduler=options.scheduler,
            workers=options.workers,
            chunk=options.chunk,
            progress=tick,
        )
    except SceneError as error:
        raise SceneError(f"{options.file}: {error}") from error


def describe(options: argparse.Namespace, table: "xarray.Dataset", seconds: float) -> None:
    """What is in the table, and how many of its scenes failed."""
    errors = table["error"]
    failed = int((errors != "").sum())
    lengths = " x ".join(f"{length} {name}" for name, length in errors.sizes.items())
    print(f"vrte {__version__}: sweep of {options.file}")
    print(f"  {errors.size} scenes ({lengths}){f', {failed} without result' if failed else ''}, {seconds:.1f} s")
    print(f"wrote {options.output} ({size_of(options.output) / 1e3:,.0f} kB)")
    table.close()
    if failed == errors.size:
        raise SceneError(f"{options.file}: all scenes failed; the first: {errors.values.flat[0]}")


def size_of(path: Path) -> int:
    """Bytes of a file, or of all in a folder."""
    return sum(file.stat().st_size for file in ([path] if path.is_file() else path.rglob("*")) if file.is_file())


@contextmanager
def told() -> Iterator[Tick]:
    """A bar with the time left on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.fields[left]}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, left="")
        guess = TimeLeft(time.monotonic)
        yield lambda done, total: bar.update(task, completed=done, total=total, left=guess(done, total))


class TimeLeft:
    """An estimate from what was done since the start: chunks that an earlier call finished took no time."""

    def __init__(self, clock: Any) -> None:
        self.clock = clock
        self.start: float | None = None
        self.before = 0

    def __call__(self, done: int, total: int) -> str:
        """The time left in words, nothing while nobody can know.

        >>> seconds = iter([0.0, 60.0])
        >>> left = TimeLeft(lambda: next(seconds))
        >>> left(100, 200), left(110, 200)
        ('', 'about 9 min left')
        """
        now = self.clock()
        if self.start is None:
            self.start, self.before = now, done
        if done == self.before:
            return ""
        return f"about {in_words((now - self.start) * (total - done) / (done - self.before))} left"


def in_words(seconds: float) -> str:
    """A time that is only roughly known.

    >>> in_words(9.4), in_words(200.0), in_words(7200.0), in_words(1e6)
    ('9 s', '3 min', '2.0 h', '11.6 days')
    """
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.1f} days"
