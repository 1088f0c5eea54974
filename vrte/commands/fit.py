"""`vrte fit`: a scene file with a measurement in, the numbers that fit it best out."""

import argparse
from pathlib import Path

from vrte import __version__
from vrte.basics.errors import SceneError
from vrte.commands.common import PICTURES, check_extra, label_errors, show_progress, write
from vrte.fit.files import read_fit
from vrte.fit.result import Fit
from vrte.fit.run import fit
from vrte.fit.verdict import Profile
from vrte.pictures.figures import save_figure

OUTPUTS = (".html", ".json", ".toml", *PICTURES)


def check(options: argparse.Namespace) -> None:
    """Whether pages can be drawn. Raises MissingExtraError."""
    for path in options.output:
        if path.suffix.lower() == ".html":
            check_extra(f"writing {path}", "plot", ("matplotlib",))


def run(options: argparse.Namespace) -> None:
    with label_errors(options.file, reading=True):
        given = read_fit(options.file)
    free = list(given.asked["free"])
    for name in options.profile:
        if name not in free:
            raise SceneError(f"--profile {name} is not free: there are {', '.join(free)}")
    asked = {name: getattr(options, name) for name in ("starts", "jacobian", "nodes", "accuracy", "threads")}
    asked = given.asked | {name: value for name, value in asked.items() if value is not None}
    with show_progress() as (phase, tick), label_errors(options.file, reading=True):
        phase("steps")
        found = fit(
            given.measurement, given.content, folder=given.folder, progress=tick, resume=options.resume, **asked
        )
        profiles = []
        for name in () if found.interrupted else dict.fromkeys((*given.profiles, *options.profile)):
            phase(f"profile of {name}")
            profiles.append(found.profile(name, progress=tick))
    print(f"vrte {__version__}: fit of {options.file}")
    for line in (*str(found).splitlines(), *map(repr, profiles)):
        print(f"  {line}")
    for path in (*options.output, options.plot):
        write(path, lambda path: write_output(path, found, profiles, options.file))
    if found.interrupted:
        raise KeyboardInterrupt


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
