"""What all studies of vrte share: cases measured in every way, rows kept as they come, pages that say what was found.

A `Study` is what is measured; `carry_out` measures it, takes a stopped run up again, and writes its page. Below are
the clocks, records, tables and command lines that studies use.
"""

import csv
import hashlib
import json
import math
import os
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import scipy

import vrte
from vrte.basics.errors import SceneError
from vrte.basics.running import count_usable_cpus
from vrte.cli import main
from vrte.commands.common import Parser, join_progress, report_written, show_progress
from vrte.formats.atomic import write_atomically
from vrte.pictures.describe import BLUE, FAINT, GREEN, ORANGE, PURPLE, RED

Case = TypeVar("Case")
Way = TypeVar("Way")
Row = TypeVar("Row")
Tick = Callable[[int, int, str], None]  # what is done, of how much, and what comes now
COLOURS = {"homogeneous": BLUE, "particular": ORANGE, "boundary": GREEN, "reconstruction": RED, "assembly": PURPLE}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")  # of lines, in turn
PLAIN = {str: str, int: int, float: float}  # what a record writes as it is; all else is JSON
SOURCES = {".py", ".pyx", ".pxi", ".h", ".cl", ".so", ".pyd"}


def ignore_tick(done: int, total: int, name: str) -> None:
    """Tells nobody."""


@dataclass(frozen=True)
class Study(Generic[Case, Way, Row]):
    """Every case in each of its ways: ``measure`` makes a row of one in a round, ``name`` says what comes next, and
    ``page`` writes all rows, with a sentence on the run, as files into a folder.

    ``rounds``: fewest and most, and the seconds that the rounds of a case may take together. ``kept``: the kind of
    rows and the file that holds them as they come; ``mark``, the fingerprint by which a row is found there again.
    ``describe``: the rows for a terminal. ``require`` raises where a result is wrong.
    """

    cases: Sequence[Case]
    ways: Callable[[Case], Sequence[Way]]
    measure: Callable[[Case, Way, int], Row]
    name: Callable[[Case, Way], str]
    page: Callable[[list[Row], Path, str], list[Path]]
    describe: Callable[[list[Row]], str] = lambda rows: ""
    require: Callable[[list[Row]], None] = lambda rows: None
    rounds: tuple[int, int, float] = (1, 1, 0.0)
    kept: tuple[type[Row], str] | None = None
    mark: Callable[[Case, Way], str] = lambda case, way: ""
    settings: str = ""

    def measure_rows(self, folder: Path, fresh: bool = False, tick: Tick = ignore_tick) -> list[Row]:
        """All rows, round after round, so that a disturbance meets a round of many cases and not all rounds of one;
        those that an earlier run kept in the folder are taken from there, unless ``fresh``. Raises OSError."""
        log = Records(self.kept[0], folder / self.kept[1]) if self.kept else None
        known = {} if log is None or fresh else log.read()
        if log is not None:
            log.write(known.values())  # without torn lines
        fewest, most, available = self.rounds
        ways = [self.ways(case) for case in self.cases]
        wanted, rows = [fewest] * len(ways), list[Row]()
        for number in range(most):
            for index, case in enumerate(self.cases):
                if number >= wanted[index]:
                    continue
                start = time.perf_counter()
                for way in ways[index]:
                    total = sum(count * len(each) for count, each in zip(wanted, ways, strict=True))
                    tick(len(rows), total, self.name(case, way))
                    row = known.get(self.mark(case, way)) if log is not None else None
                    if row is None:
                        row = self.measure(case, way, number)
                        if log is not None:
                            log.append(row)
                    rows.append(row)
                if number == 0 and most > fewest:
                    wanted[index] = count_fitting_rounds(time.perf_counter() - start, available, fewest, most)
        tick(len(rows), len(rows), "")
        return rows


def carry_out(study: Study[Any, Any, Any], output: Path | None, fresh: bool = False) -> None:
    """Measures a study with a bar of progress, prints what was found, writes its page, unless ``output`` is None, and
    says where."""
    folder = Path() if output is None else make_folder(output)
    with show_progress() as (phase, tick):
        before = describe_load()
        rows = study.measure_rows(folder, fresh, join_progress(phase, tick))
    busy = f"load (1, 5, 15 minutes) {before} before, {describe_load()} after"
    print("\n".join(filter(None, [study.describe(rows), f"  {busy}"])))
    if output is not None:
        for path in study.page(rows, folder, "; ".join(filter(None, [study.settings, busy]))):
            report_written(path)
    study.require(rows)


def make_folder(folder: Path) -> Path:
    """A folder to write in, made if absent."""
    if folder.exists() and not (folder.is_dir() and os.access(folder, os.W_OK)):
        raise SceneError(f"the output {folder} must be a folder that can be written in")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def make_markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """With every row's cells between bars.

    >>> print(make_markdown_table(["a", "b"], [["1", "x|y"]]), end="")
    | a | b |
    |---|---|
    | 1 | x\\|y |
    """
    texts = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in [header, *rows]]
    return "\n".join([texts[0], "|" + "---|" * len(header), *texts[1:]]) + "\n"


def make_command(name: str, purpose: str, *examples: tuple[str, str]) -> Parser:
    """The parser of ``python -m bench.NAME``; ``purpose`` says in one line what comes of it."""
    command = Parser(prog=f"python -m bench.{name}", description=f"{purpose[0].upper()}{purpose[1:]}.")
    command.examples = examples
    return command


def add_study(command: Parser, quick: str, fresh: bool = True) -> None:
    """Options that most studies share: where to write, and how much is measured."""
    folder = Path(command.prog.rpartition(".")[-1])
    command.add_argument("-o", "--output", metavar="FOLDER", type=Path, default=folder, help="made if absent")
    command.add_argument("--quick", action="store_true", help=quick)
    if fresh:
        command.add_argument("--fresh", action="store_true", help="forget what an earlier run has finished")


def run_command(command: Parser, run: Callable[[Any], None], arguments: Sequence[str] | None = None) -> int:
    """Runs a study as `vrte` runs a command; returns the exit code."""
    command.set_defaults(run=run, version=False, verbose=False)
    return main(arguments, command)


def count_fitting_rounds(first: float, available: float, fewest: int, most: int) -> int:
    """How many rounds fit into the ``available`` seconds if the first is typical, from ``fewest`` to ``most``.

    >>> [count_fitting_rounds(first, 1.5, 3, 15) for first in (0.3, 2.0, 1e-6)]
    [5, 3, 15]
    """
    return int(min(max(available / first, fewest), most))


@dataclass(frozen=True)
class Times:
    """Seconds of several rounds."""

    median: float
    least: float
    greatest: float
    rounds: int

    @staticmethod
    def of(seconds: Sequence[float]) -> "Times":
        """What some rounds come to."""
        return Times(float(np.median(seconds)), min(seconds), max(seconds), len(seconds))


def describe_load() -> str:
    """The load averages of the last 1, 5 and 15 minutes, where the system tells them."""
    if not hasattr(os, "getloadavg"):
        return "unknown"
    return ", ".join(f"{average:.2f}" for average in os.getloadavg())


class Records(Generic[Row]):
    """The rows of a study in a file: instances of a dataclass whose last field is their ``fingerprint``."""

    def __init__(self, kind: type[Row], path: Path) -> None:
        self.kind, self.path = kind, path
        self.readers = {item.name: PLAIN.get(item.type, json.loads) for item in fields(kind)}  # type: ignore

    def read(self) -> dict[str, Row]:
        """Rows by fingerprint; a line that an interrupted run left torn, or that another version wrote, is passed over.
        Raises OSError."""
        if not self.path.exists():
            return {}
        with open(self.path, encoding="utf-8", newline="") as file:
            rows = [self.row_of(texts) for texts in list(csv.reader(file))[1:]]
        return {row.fingerprint: row for row in rows if row is not None}  # type: ignore[attr-defined]

    def row_of(self, texts: list[str]) -> Row | None:
        """A row of its cells, None where they are no row."""
        if len(texts) != len(self.readers) or len(texts[-1]) != len(make_fingerprint("")):
            return None
        try:
            return self.kind(
                **{name: read(text) for (name, read), text in zip(self.readers.items(), texts, strict=True)}
            )
        except (ValueError, TypeError):
            return None

    def cells(self, row: Row) -> list[object]:
        """As in the file: every digit of a number, so that it comes back as it was."""
        values: dict[str, Any] = asdict(row)  # type: ignore[call-overload]
        return [
            (repr(value) if isinstance(value, float) else value) if reader in PLAIN.values() else json.dumps(value)
            for value, reader in zip(values.values(), self.readers.values(), strict=True)
        ]

    def append(self, row: Row) -> None:
        """Adds a row, on disk before anything else happens, under a header if the file is new. Raises OSError."""
        is_new = not self.path.exists()
        with open(self.path, "a", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([list(self.readers)] * is_new + [self.cells(row)])
            file.flush()
            os.fsync(file.fileno())

    def write(self, rows: Iterable[Row]) -> None:
        """All rows, the file as a whole or not at all. Raises OSError."""
        write_rows(self.path, list(self.readers), [self.cells(row) for row in rows])


def make_fingerprint(*parts: str) -> str:
    """Of what was solved, and with what: another version, source file or machine gives another.

    >>> make_fingerprint("a") == make_fingerprint("b")
    False
    """
    return hashlib.sha256("\n".join([*parts, identify_setup()]).encode()).hexdigest()[:16]


@cache
def identify_setup() -> str:
    """The package's version and sources, NumPy's and SciPy's versions, the processor."""
    folder = Path(vrte.__file__).parent
    paths = [path for path in folder.rglob("*") if path.suffix in SOURCES]
    return f"{vrte.__version__} {hash_files(paths)} {np.__version__} {scipy.__version__} {find_processor_name()}"


def hash_files(paths: Iterable[Path]) -> str:
    """Of the bytes of some files."""
    found = hashlib.sha256()
    for path in sorted(paths):
        found.update(path.read_bytes())
    return found.hexdigest()


def make_markdown_list(facts: Iterable[str]) -> str:
    """One item a line.

    >>> make_markdown_list(["two cores"])
    '- two cores\\n'
    """
    return "".join(f"- {fact}\n" for fact in facts)


def list_run_facts(settings: str) -> list[str]:
    """Date and settings, machine, versions: a sentence each."""
    versions = f"vrte {vrte.__version__}, numpy {np.__version__}, scipy {scipy.__version__}"
    return [
        f"{datetime.now(UTC):%Y-%m-%d}, {settings}",
        f"{find_processor_name()}, {count_usable_cpus()} cores",
        f"{versions}, Python {platform.python_version()}, {platform.system()}",
    ]


def find_processor_name() -> str:
    """The processor's name, as the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [text.split(":", 1)[1].strip() for text in file if text.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()


def show_two_digits(value: float | None) -> str:
    """Two digits, or a dash for what is not there or not a number.

    >>> show_two_digits(3.14e-12), show_two_digits(0.0), show_two_digits(None), show_two_digits(math.nan)
    ('3.1e-12', '0', '-', '-')
    """
    if value is None or math.isnan(value):
        return "-"
    return "0" if value == 0.0 else f"{value:.1e}"


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """A text file, all of it or nothing. Raises OSError."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


def write_rows(path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A CSV file, all of it or nothing. Raises OSError."""
    with write_atomically(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def finish_panel(panel: Any, title: str, below: str, beside: str = "") -> None:
    """Logarithmic axes with their names, a title and a grid."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel(below)
    if beside:
        panel.set_ylabel(beside)
    panel.set_title(title, fontsize=10)
    panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
