"""What several commands share: how options are read, where output goes, and how progress is shown."""

import argparse
import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from vrte.basics.cost import say_time
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.commands.pages import locate_page
from vrte.commands.starters import KINDS

if TYPE_CHECKING:
    from vrte.formats.scene_file import SceneFile
    from vrte.results.spectrum import Spectrum

Tick = Callable[[int, int], None]
METAVARS = {int: "N", float: "X"}


class Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage; its help ends with examples, command lines and what each does."""

    examples: tuple[tuple[str, str], ...] = ()
    heading = "examples"
    page = ""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"vrte: error: {message} (see `{self.prog} --help`)\n")

    def format_help(self) -> str:
        lines = [f"  {line}\n      {told}\n" for line, told in self.examples]
        more = f"\nmore: {locate_page(self.page)}\n" if self.page else ""
        return f"{super().format_help()}\n{self.heading}{self.tell_files()}:\n{''.join(lines)}{more}"

    def tell_files(self) -> str:
        """Where the scene files of the examples come from."""
        words = [word for line, _ in self.examples for word in line.split() if "vrte init" not in line]
        told = [f"`vrte init {kind}` writes {kind}.toml" for kind in KINDS if f"{kind}.toml" in words]
        told += ["examples/ is in the source tree"] if any(word.startswith("examples/") for word in words) else []
        return f" ({', '.join(told)})" if told and self.page else ""


def add_options(command: argparse.ArgumentParser, *names: str) -> None:
    """Options of a call by name, with the words that vrte/request/how.py has for them."""
    from vrte.request.how import OPTIONS

    for name in names:
        option, flag = OPTIONS[name], f"--{name.replace('_', '-')}"
        if option.of is bool:
            command.add_argument(flag, action="store_true", default=None, help=option.short)
        elif option.choices:
            command.add_argument(flag, choices=option.choices, help=option.short)
        else:
            command.add_argument(flag, metavar=METAVARS[option.of], type=make_option_reader(name), help=option.short)


def make_option_reader(name: str) -> Callable[[str], Any]:
    """What reads the number of an option of a call.

    >>> make_option_reader("nodes")("8"), make_option_reader("time_limit_s")("inf")
    (8, inf)
    """
    from vrte.request.how import OPTIONS

    option = OPTIONS[name]

    def read(text: str) -> Any:
        with suppress(ValueError):  # a SceneError is one
            if (option.of is not int or text.isdecimal()) and option.check(name, option.of(text)):
                return option.of(text)
        raise argparse.ArgumentTypeError(f"must be {option.allowed}, not {text!r}")

    return read


def make_whole_number_reader(low: int, high: int) -> Callable[[str], int]:
    """What reads another whole number."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, not {text!r}")
        return int(text)

    return read


def read_wavelengths(text: str) -> list[float]:
    """What reads ascending wavelengths, with commas between them."""
    from vrte.results.spectrum import check_ascending

    try:
        found: list[float] = check_ascending([float(item) for item in text.split(",")]).tolist()
    except ValueError:  # a SceneError is one
        raise argparse.ArgumentTypeError(f"must be ascending wavelengths such as 0.45,0.55, not {text!r}") from None
    return found


def make_folder(folder: Path) -> Path:
    """A folder to write in, made if absent."""
    if folder.exists() and not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise SceneError(f"the output {folder} must be a folder that can be written in")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def check_output(path: Path, *suffixes: str) -> None:
    """Whether a file can be written there, of any suffix or of these, before the work is done. Raises SceneError."""
    from vrte.formats.zarr_folder import METADATA

    if suffixes and path.suffix.lower() not in suffixes:
        raise SceneError(f"the output {path} must end in {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise SceneError(f"the output {path} lies in a folder that does not exist: {path.parent}")
    if path.is_dir() and not (path / METADATA).is_file():
        raise SceneError(f"the output {path} cannot be written: it is a folder")
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise SceneError(f"the output {path} cannot be written: it is a pipe or a device")
    if not os.access(path.parent, os.W_OK):
        raise SceneError(f"the output {path} cannot be written: no permission to write in {path.parent}")


def check_extra(purpose: str, extra: str, modules: Iterable[str]) -> None:
    """Whether an extra is installed, before the work is done. Raises MissingExtraError."""
    if any(importlib.util.find_spec(module) is None for module in modules):
        raise MissingExtraError(purpose, extra)


def say_written(path: Path) -> None:
    """One line a file."""
    files = [path, *path.rglob("*")] if path.is_dir() else [path]
    print(f"wrote {path} ({sum(file.stat().st_size for file in files) / 1e3:,.0f} kB)")


@contextmanager
def label_reading_errors(path: Path) -> Iterator[None]:
    """Complaints about a scene file, or that it or a file that it names cannot be read, with its name in front."""
    with label_errors(path):
        try:
            yield
        except OSError as error:
            other = error.filename not in (None, path, str(path))
            raise SceneError(f"{error.filename}: " * other + (error.strerror or str(error))) from error


@contextmanager
def label_errors(path: Path) -> Iterator[None]:
    """Complaints about what a scene file asks for, with its name in front."""
    try:
        yield
    except SceneError as error:
        raise error.behind(path) from error


def tell_derivatives(result: Any, made: dict[str, Any]) -> None:
    """The largest of each derivative of f00 or of I, of which radiance, and how it was found; one line each."""
    from vrte.results.field import Field

    for name, values in (result.jacobian or {}).items():
        is_field = isinstance(result, Field)
        of = np.abs(result.stokes if is_field else result.mueller[..., 0])[..., 0].max(initial=0.0)
        largest = np.abs(values if is_field else values[..., 0])[..., 0].max(initial=0.0)
        what, unit = ("I", "W/m2/sr") if is_field else ("f00", "1/sr")
        how = made["derivatives"][name]
        print(f"  derivative with {name}: {what} by at most {largest:.4g} {unit} a unit, of {of:.4g} ({how})")


class Seconds(dict[str, float]):
    """Wall seconds of what was done, by its name."""

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Notes how long that takes which happens within."""
        start = time.perf_counter()
        yield
        self[name] = time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class Found:
    """The scene at each wavelength, the result of them all, and two spectra where a table for Mitsuba is asked for: the
    table's and those that check it, and the indices above and below the surface that is taken off for it."""

    files: "list[SceneFile]"
    result: Any
    table: "tuple[Spectrum, Spectrum] | None" = None
    surface: tuple[float, float] | None = None


@contextmanager
def show_progress() -> Iterator[tuple[Callable[[str], None], Tick]]:
    """Two calls, one names what begins and one ticks: a bar with the time left on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None, lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    left = TextColumn("{task.fields[left]}")
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), left
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, left="")
        guess = TimeLeft(time.monotonic)
        yield (
            lambda name: bar.update(task, description=name),
            lambda done, total: bar.update(task, completed=done, total=total, left=guess(done, total)),
        )


class TimeLeft:
    """An estimate from what was done since counting began: what was done before took no time."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.clock = clock
        self.start, self.before, self.last, self.total = 0.0, 0, 0, -1

    def __call__(self, done: int, total: int) -> str:
        """The time left in words, nothing while nobody can know.

        >>> seconds = iter([0.0, 60.0])
        >>> left = TimeLeft(lambda: next(seconds))
        >>> left(100, 200), left(110, 200)
        ('', 'about 9 min left')
        """
        now = self.clock()
        if total != self.total or done < self.last:  # something else is counted
            self.start, self.before, self.total = now, done, total
        self.last = done
        if done == self.before or done == total:
            return ""
        return f"about {say_time((now - self.start) * (total - done) / (done - self.before))} left"


def join_progress(phase: Callable[[str], None], tick: Tick) -> Callable[[int, int, str], None]:
    """One call for both: what begins, and how much is done."""

    def told(done: int, total: int, name: str) -> None:
        phase(name)
        tick(done, total)

    return told
