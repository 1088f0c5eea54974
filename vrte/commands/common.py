"""What commands share: the parser, arguments as they are typed, files that come out, complaints, progress, the table of
all commands, commands.toml, and the page of the documents that says more of a command, a key or an error."""

import argparse
import importlib.util
import os
import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NoReturn

from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError, SweepError

_TABLES = tomllib.loads(Path(__file__).with_name("commands.toml").read_text("utf-8"))
COMMANDS: dict[str, dict[str, Any]] = _TABLES["commands"]
STARTERS: dict[str, tuple[str, str]] = _TABLES["starters"]  # by kind: the command that reads it, and what it is of
FOLDER = Path(__file__).parents[1] / "starters"
OF_KEYS: dict[str, str] = {key: page for page, keys in _TABLES["pages"].items() for key in keys}
OF_ERRORS: dict[type[BaseException], str] = {
    AccuracyError: "reference/stability.md",
    DeviceError: "how_to/opencl.md",
    MissingExtraError: "how_to/install.md",
    SweepError: "how_to/sweeps.md",
}


def find_starter(kind: str) -> Path:
    """The file that `vrte init` copies."""
    return next(FOLDER.glob(f"{kind}.*"))


def find_page(error: BaseException) -> str | None:
    """The page that says more about what is wrong, as it is named to a user; None where none would help."""
    if isinstance(error, SceneError):
        page = next((OF_KEYS[step] for step in reversed(error.place) if step in OF_KEYS), None)
    else:
        page = OF_ERRORS.get(type(error))
    return page and locate_page(page)


def locate_page(page: str) -> str:
    """Where a page is read: on the site that the package's metadata name as Documentation, or in the source tree."""
    site = find_site()
    return f"{site}/{page.replace('README', 'index').removesuffix('.md')}.html" if site else f"docs/{page}"


@cache
def find_site() -> str:
    """The address of the documents on the web, "" where the package has none."""
    try:
        urls = metadata.metadata("vrte").get_all("Project-URL") or []
    except metadata.PackageNotFoundError:  # built in place and never installed
        return ""
    named = dict(url.split(", ", 1) for url in urls)
    return named.get("Documentation", "").rstrip("/")


Tick = Callable[[int, int], None]
Reader = Callable[[str], Any]
PICTURES = (".png", ".svg", ".pdf")
EXTRAS = {  # by suffix of what is written
    ".nc": ("files", ("xarray", "h5netcdf")),
    ".zarr": ("files", ("xarray", "zarr")),
    **dict.fromkeys(PICTURES, ("plot", ("matplotlib",))),
}


class Parser(argparse.ArgumentParser):
    """Complains in one line, without the usage; its help ends with examples, command lines and what each does."""

    examples: Sequence[Sequence[str]] = ()
    heading = "examples"
    page = ""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self.outputs: dict[str, tuple[str, ...]] = {}  # suffixes of files that are written, by the argument's name

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"vrte: error: {message} (see `{self.prog} --help`)\n")

    def format_help(self) -> str:
        lines = [f"  {line}\n      {purpose}\n" for line, purpose in self.examples]
        more = f"\nmore: {locate_page(self.page)}\n" if self.page else ""
        return f"{super().format_help()}\n{self.heading}{self.list_sources()}:\n{''.join(lines)}{more}"

    def list_sources(self) -> str:
        """The sources of the examples' scene files, for help."""
        words = [word for line, _ in self.examples for word in line.split() if "vrte init" not in line]
        files = {kind: find_starter(kind).name for kind in STARTERS}
        notes = [f"`vrte init {kind}` writes {name}" for kind, name in files.items() if name in words]
        notes += ["examples/ is in the source tree"] if any(word.startswith("examples/") for word in words) else []
        return f" ({', '.join(notes)})" if notes and self.page else ""

    def take(
        self,
        typed: str,
        help_text: str | None,
        limits: tuple[int, int] | None = None,
        suffixes: Sequence[str] | None = None,
        group: Any = None,
        **more: Any,
    ) -> None:
        """An argument as typed, "-o --output OUT.csv"; ``limits`` of a number N, ``suffixes`` of a file OUT."""
        *names, word = typed.split()
        if word.startswith("-"):
            more = more if "choices" in more else {"action": "store_true"} | more
            (group or self).add_argument(*names, word, help=help_text, **more)
            return
        reads = make_whole_number_reader(*limits) if limits else find_reader(word)
        metavar = {} if word in names else {"metavar": None if "choices" in more else word}
        dest = (group or self).add_argument(*names, help=help_text, **{"type": reads} | metavar | more).dest
        if word.startswith("OUT") or suffixes is not None:
            self.outputs[dest] = (Path(word).suffix,) if suffixes is None else tuple(suffixes)
        elif reads is Path and not names[0].startswith("-") and more.get("nargs") != "+":
            self.set_defaults(reads_from=dest)

    def take_rows(self, rows: Iterable[dict[str, Any]]) -> None:
        """The arguments that rows of commands.toml declare, in their order."""
        groups: dict[str, Any] = {}
        for row in rows:
            found = {key: resolve_value(value) for key, value in row.items()}
            if "options" in found:
                self.take_options(*found["options"])
                continue
            help_text = found.pop("help").format_map(found)
            if "choices" in found:
                found["choices"] = tuple(found["choices"])
            if group := found.pop("group", None):
                found["group"] = groups[group] = groups.get(group) or self.add_mutually_exclusive_group()
            if found.pop("unset", False):
                found["default"] = None
            if found.get("type") == "int":
                found["type"] = int
            self.take(found.pop("typed"), help_text, **found)

    def take_options(self, *names: str) -> None:
        """Options of a call by name, with the words that vrte/request/how.py has for them."""
        from vrte.request.how import OPTIONS

        for name in names:
            option, flag = OPTIONS[name], f"--{name.replace('_', '-')}"
            more: dict[str, Any] = {"choices": option.choices} if option.choices else {"default": None}
            if option.of is not bool and not option.choices:
                flag, more = f"{flag} {'N' if option.of is int else 'X'}", {"type": make_option_reader(name)}
            self.take(flag, option.short, **more)


def resolve_value(value: Any) -> Any:
    """A value of commands.toml, or what it names in a module of vrte."""
    if isinstance(value, list):
        return [resolve_value(one) for one in value]
    return resolve_name(value) if isinstance(value, str) and re.fullmatch(r"vrte[\w.]*:\w+", value) else value


def find_reader(word: str) -> Reader:
    """What reads an argument, by the word that stands for it in the help."""
    if word in ("X", "UM", "DEG"):
        return float
    if word == "UM,UM,...":
        return read_wavelengths
    if word == "INDEX":
        return int
    is_file = word.startswith("OUT") or Path(word).suffix or word in ("FILE", "STATE", "FOLDER")
    return Path if is_file else str


def make_option_reader(name: str) -> Reader:
    """What reads the number of an option of a call."""
    from vrte.request.how import OPTIONS

    option = OPTIONS[name]

    def read(text: str) -> Any:
        with suppress(ValueError):  # a SceneError is one
            if (option.of is not int or text.isdecimal()) and option.check(name, option.of(text)):
                return option.of(text)
        raise argparse.ArgumentTypeError(f"must be {option.allowed}, not {text!r}")

    return read


def make_whole_number_reader(low: int, high: int) -> Reader:
    """What reads another whole number."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            raise argparse.ArgumentTypeError(f"must be a whole number from {low} to {high}, not {text!r}")
        return int(text)

    return read


def read_wavelengths(text: str) -> list[float]:
    """Ascending wavelengths [um], with commas between them."""
    from vrte.results.brdf import check_ascending

    try:
        found: list[float] = check_ascending([float(item) for item in text.split(",")]).tolist()
    except ValueError:  # a SceneError is one
        raise argparse.ArgumentTypeError(f"must be ascending wavelengths such as 0.45,0.55, not {text!r}") from None
    return found


def carry_out(options: argparse.Namespace) -> None:
    """Runs a command, its options and outputs checked first; complaints begin with its file. Raises SceneError."""
    given = vars(options)
    if given.get("check"):
        options.check(options)
    source: Path | None = given.get(given.get("reads_from", ""))
    for name, suffixes in given.get("outputs", {}).items():
        for path in given[name] if isinstance(given[name], list) else [given[name]]:
            if path is not None:
                check_output(path, *suffixes, source=source)
    with label_errors(source) if source else nullcontext():
        options.run(options)


def check_output(path: Path, *suffixes: str, source: Path | None = None) -> None:
    """Whether a file of these suffixes can be written, before the work. Raises SceneError, MissingExtraError."""
    from vrte.formats.result_file import METADATA

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
    if source and path.exists() and source.exists() and path.samefile(source):
        raise SceneError(f"the output {path} is the file that is read: name another")
    if path.suffix.lower() in EXTRAS:
        check_extra(f"writing {path}", *EXTRAS[path.suffix.lower()])


def check_extra(purpose: str, extra: str, modules: Iterable[str]) -> None:
    """Whether an extra is installed, before the work is done. Raises MissingExtraError."""
    if any(importlib.util.find_spec(module) is None for module in modules):
        raise MissingExtraError(purpose, extra)


def write(path: Path | None, writer: Callable[[Path], object]) -> None:
    """Writes a file, where one is asked for, and says so."""
    if path is not None:
        writer(path)
        report_written(path)


def report_written(path: Path) -> None:
    """Prints the path of a file or folder that was written, and its size."""
    files = [file for file in (path, *path.rglob("*")) if file.is_file()]
    print(f"wrote {path} ({sum(file.stat().st_size for file in files) / 1e3:,.0f} kB)")


@contextmanager
def label_errors(path: Path, reading: bool = False) -> Iterator[None]:
    """Complaints about a scene file with its name in front; ``reading``: also of files that cannot be read."""
    try:
        yield
    except SceneError as error:
        raise (error if str(error).startswith(f"{path}: ") else error.behind(path)) from error
    except OSError as error:
        if not reading:
            raise
        other = error.filename not in (None, path, str(path))
        raise SceneError(f"{path}: " + f"{error.filename}: " * other + (error.strerror or str(error))) from error


@contextmanager
def show_progress() -> Iterator[tuple[Callable[[str], None], Tick]]:
    """Two calls, one names what begins and one ticks: a bar with the time left on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None, lambda done, total: None
        return
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        progress.TextColumn("left"),
    )
    # steps may take minutes each: the time left is estimated from the last hour
    with progress.Progress(*columns, console=Console(stderr=True), transient=True, speed_estimate_period=3600.0) as bar:
        task = bar.add_task("", total=None)
        yield (
            lambda name: bar.update(task, description=name),
            lambda done, total: bar.update(task, completed=done, total=total),
        )


def join_progress(phase: Callable[[str], None], tick: Tick) -> Callable[[int, int, str], None]:
    """One call for both: what begins, and how much is done."""

    def report(done: int, total: int, name: str) -> None:
        phase(name)
        tick(done, total)

    return report


TOUR = (
    ("vrte init powder", "writes powder.toml, a scene file with comments"),
    ("vrte brdf powder.toml --plot powder.png", "solves it: its BRDF as a picture; -o powder.csv: as a table"),
    ("vrte view powder.toml", "a page in the browser: change the scene, turn its BRDF around"),
)
STUDIES = ("tables", "report", "stability", "benchmarks", "cost")  # targets of the source tree's Makefile


def make_parser(arguments: Sequence[str] | None = None) -> Parser:
    """The parser of the command line, with the arguments of all commands, or of the one that the words typed name."""
    parser = Parser(prog="vrte", description="Polarized subsurface reflectance of particulate layers.")
    parser.examples, parser.heading = TOUR, "a short tour"
    parser.set_defaults(run=None)
    parser.take("--version", "the version; with --verbose what a bug report needs")
    parser.take("--verbose", "with --version: machine, libraries, extras as well")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    typed = next((word for word in arguments or () if not word.startswith("-")), "")
    if arguments and arguments[0] in STUDIES:
        parser.error(f"{typed} is a study of vrte itself: run `make {typed}` in its source tree")
    for name, row in COMMANDS.items():
        command = commands.add_parser(name, help=row["help"], description=f"{row['help'][0].upper()}{row['help'][1:]}.")
        if arguments is None or name == typed:
            command.examples, command.page = row["examples"], row["page"]
            module = import_module(f"vrte.commands.{row['module']}")
            command.epilog = row.get("epilog")
            command.take_rows([*_TABLES["shared"].get(row.get("shared"), ()), *row.get("arguments", ())])
            command.set_defaults(
                **row.get("defaults", {}), run=module.run, outputs=command.outputs, check=getattr(module, "check", None)
            )
    return parser
