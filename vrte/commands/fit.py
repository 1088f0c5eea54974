"""`vrte fit`: a scene file with a measurement in, the numbers that fit it best out."""

import argparse
from pathlib import Path

from vrte import __version__
from vrte.basics.errors import SceneError
from vrte.commands.common import (
    Parser,
    add_options,
    check_extra,
    check_output,
    label_reading_errors,
    make_whole_number_reader,
    say_written,
    show_progress,
)
from vrte.fit.files import FitFile, read_fit
from vrte.fit.problem import JACOBIANS, MOST_STARTS
from vrte.fit.result import Fit
from vrte.fit.run import fit
from vrte.fit.verdict import Profile
from vrte.pictures.figures import SUFFIXES as PICTURES
from vrte.pictures.figures import save_figure

OUTPUTS = (".html", ".json", ".toml", *PICTURES)


def add(command: Parser) -> None:
    """The arguments of `vrte fit`."""
    command.add_argument("file", metavar="FILE.toml", type=Path, help="a scene file with a table [fit]")
    told = "any number of times: .html a page, .toml the fitted scene, .json all of it, .png (.svg, .pdf) a picture"
    command.add_argument("-o", "--output", metavar="OUT", type=Path, action="append", default=[], help=told)
    command.add_argument("--plot", metavar="OUT.png", type=Path, help="a picture, as -o OUT.png")
    told = "notes after each step how far it is, and goes on from there"
    command.add_argument("--resume", metavar="STATE", type=Path, help=told)
    told = "also how chi2 rises along this free number, all others fitted anew; any number of times"
    command.add_argument("--profile", metavar="NAME", action="append", default=[], help=told)
    told = "how many, spread over the bounds; default: 1, the scene as it is"
    command.add_argument("--starts", metavar="N", type=make_whole_number_reader(1, MOST_STARTS), help=told)
    told = "how derivatives are found; default: exact"
    command.add_argument("--jacobian", choices=JACOBIANS, help=told)
    add_options(command, "nodes", "accuracy", "threads")


def run(options: argparse.Namespace) -> None:
    if options.resume:
        check_output(options.resume)
    outputs = [*options.output, *([options.plot] if options.plot else [])]
    for path in outputs:
        check_output(path, *(PICTURES if path is options.plot else OUTPUTS))
        if path.suffix.lower() == ".html" or path.suffix.lower() in PICTURES:
            check_extra(f"writing {path}", "plot", ("matplotlib",))
        if path.exists() and path.samefile(options.file):
            raise SceneError(f"the output {path} is the file of the fit itself: name another")
    with label_reading_errors(options.file):
        given = read_fit(options.file)
        check_profiles(given, options.profile)
    asked = {name: getattr(options, name) for name in ("starts", "jacobian", "nodes", "accuracy", "threads")}
    asked = given.asked | {name: value for name, value in asked.items() if value is not None}
    with show_progress() as (phase, tick), label_reading_errors(options.file):
        phase("steps")
        found = fit(
            given.measurement, given.content, folder=given.folder, progress=tick, resume=options.resume, **asked
        )
        profiles = []
        for name in () if found.interrupted else dict.fromkeys((*given.profiles, *options.profile)):
            phase(f"profile of {name}")
            profiles.append(found.profile(name, progress=tick))
    describe(options.file, found, profiles)
    for path in outputs:
        write_output(path, found, profiles, options.file)
        say_written(path)
    if found.interrupted:
        raise KeyboardInterrupt


def check_profiles(given: FitFile, names: list[str]) -> None:
    """Whether the numbers whose profile is asked for are free. Raises SceneError."""
    free = list(given.asked["free"])
    for name in names:
        if name not in free:
            raise SceneError(f"--profile {name} is not free: there are {', '.join(free)}")


def describe(path: Path, found: Fit, profiles: list[Profile]) -> None:
    """Values, errors, and what the data cannot tell."""
    print(f"vrte {__version__}: fit of {path}")
    print("\n".join(f"  {line}" for line in str(found).splitlines()))
    for one in profiles:
        print(f"  {one!r}")


def write_output(path: Path, found: Fit, profiles: list[Profile], file: Path) -> None:
    """A page, the scene, all of it or a picture, by the suffix."""
    suffix = path.suffix.lower()
    if suffix == ".html":
        from vrte.pictures.fit import save_fit_page

        save_fit_page(found, path, file.stem.replace("_", " "), profiles)
    elif suffix == ".toml":
        found.write_scene(path)
    elif suffix == ".json":
        found.save(path)
    else:
        save_figure(found.plot(), path)
