"""What several commands share: how options are read, where output goes, and how progress is shown."""

import argparse
import importlib.util
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vrte.basics.cost import in_words
from vrte.basics.errors import MissingExtraError, SceneError
from vrte.formats.scene_file import SceneFile, read_scene
from vrte.formats.zarr_folder import METADATA
from vrte.request.request import COARSEST, FINEST
from vrte.results.spectrum import ascending

Tick = Callable[[int, int], None]


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """What reads a whole number of an option."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, not {text!r}")
        return int(text)

    return read


def a_setting(text: str) -> tuple[str, Any]:
    """Name and value of a method's setting: a number where it is one, otherwise a word."""
    name, sign, value = text.partition("=")
    if not (name and sign):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    for read in (int, float):
        try:
            return name, read(value)
        except ValueError:
            continue
    return name, value


def an_accuracy(text: str) -> float:
    """What an answer may be wrong by."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not FINEST <= value <= COARSEST:
        raise argparse.ArgumentTypeError(f"must be a number between {FINEST:g} and {COARSEST:g}, not {text!r}")
    return value


def a_time(text: str) -> float:
    """Seconds above 0, inf included."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"must be seconds above 0, inf for no limit, not {text!r}")
    return value


def wavelengths(text: str) -> list[float]:
    """What reads ascending wavelengths, with commas between them."""
    try:
        found: list[float] = ascending([float(item) for item in text.split(",")]).tolist()
    except ValueError:  # a SceneError is one
        raise argparse.ArgumentTypeError(f"must be ascending wavelengths such as 0.45,0.55, not {text!r}") from None
    return found


def made_folder(folder: Path) -> Path:
    """A folder to write in, made if absent."""
    if folder.exists() and not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise SceneError(f"the output {folder} must be a folder that can be written in")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def check_output(path: Path, *suffixes: str) -> None:
    """Whether a file can be written there, before the work is done. Raises SceneError."""
    if path.suffix.lower() not in suffixes:
        raise SceneError(f"the output {path} must end in {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise SceneError(f"the output {path} lies in a folder that does not exist: {path.parent}")
    if path.is_dir() and not (path / METADATA).is_file():
        raise SceneError(f"the output {path} cannot be written: it is a folder")
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


def read_file(path: Path, kind: str) -> SceneFile:
    """A scene file, complained about by its name."""
    with reading(path):
        return read_scene(path, kind)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Complaints about a scene file, or that it cannot be read, with its name in front."""
    with named_by(path):
        try:
            yield
        except OSError as error:
            raise SceneError(error.strerror or str(error)) from error


@contextmanager
def named_by(path: Path) -> Iterator[None]:
    """Complaints about what a scene file asks for, with its name in front."""
    try:
        yield
    except SceneError as error:
        raise error.behind(path) from error


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Adds the wall seconds of what happens within."""
    start = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - start


@contextmanager
def progress() -> Iterator[tuple[Callable[[str], None], Tick]]:
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
        return f"about {in_words((now - self.start) * (total - done) / (done - self.before))} left"


def told_as_one(phase: Callable[[str], None], tick: Tick) -> Callable[[int, int, str], None]:
    """One call for both: what begins, and how much is done."""

    def told(done: int, total: int, name: str) -> None:
        phase(name)
        tick(done, total)

    return told
