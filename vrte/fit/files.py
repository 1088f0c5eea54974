"""Files of a fit: the scene with a table [fit] that asks for one, how far it has come, and what it has found."""

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arguments import check_arguments
from vrte.basics.arrays import check_whole
from vrte.basics.errors import SceneError
from vrte.fit.instruments import KEYWORDS
from vrte.fit.measurement import COLUMNS, Measurement, read_measurement
from vrte.fit.model import make_model
from vrte.fit.problem import JACOBIANS, LOSSES, MOST_STARTS, FitProblem, Parameter
from vrte.fit.result import ARRAYS, Fit, Start
from vrte.formats.atomic import check_file_name, read_journal, write_journal
from vrte.formats.scene_file import find_named_tables, read_content
from vrte.formats.toml_table import Table
from vrte.scene.scene import Scene

KIND = "vrte fit, format 1"
WRITER = "a fit"
PLAIN = [one.name for one in fields(Fit) if one.name not in (*ARRAYS, "measurement", "starts", "problem")]


def describe_problem(problem: FitProblem) -> dict[str, Any]:
    """All that makes a problem beside its measurement, as JSON has it; the content is None of a `vrte.Scene`."""
    model = problem.model
    is_scene = isinstance(model.source.source, Scene)
    return {
        "content": None if is_scene else model.source.content_at(model.source.values),
        "options": model.options,
        "jacobian": model.jacobian,
        "colours_um": model.colours_um.tolist(),
        "parameters": [asdict(one) for one in problem.parameters],
        "priors": problem.priors.tolist(),
        "sigma": problem.sigma.tolist(),
        "loss": problem.loss,
    }


def find_fingerprint(problem: FitProblem, record: Mapping[str, Any]) -> str:
    """Of all that decides about a fit: data, scene, the tables it names, free numbers, priors, and how it is made."""
    from vrte import __version__

    described, source, scene = describe_problem(problem), problem.model.source, problem.model.source.source
    known: list[Any] = []
    if isinstance(scene, Scene):
        layers = [
            (x.thickness, x.albedo, x.host_index, x.phase_matrix.coefficients.tolist(), x.flake_area, repr(x.flakes))
            for x in scene.layers
        ]
        known = [repr(scene.base), repr(scene.interfaces), layers]
    else:
        tables = sorted({*find_named_tables(described["content"]).values()})
        known = [
            (name, hashlib.sha256((Path(source.folder or ".") / name).read_bytes()).hexdigest()) for name in tables
        ]
    rows = {name: getattr(problem.model.measurement, name).tolist() for name in COLUMNS}
    everything = [__version__, rows, known, described, dict(record)]
    return hashlib.sha256(json.dumps(everything, sort_keys=True, default=str).encode()).hexdigest()


class Journal:
    """How far a fit has come, in a file that is written anew after each step; without a path nothing is kept.

    ``finished``: the starts that are at their end; ``here``: the values of the next one so far; ``nodes``: of all
    solves. Raises SceneError for the file of another fit, or what is none, OSError.
    """

    def __init__(self, path: str | os.PathLike[str] | None, fingerprint: str) -> None:
        self.path, self.fingerprint = path, fingerprint
        self.finished: list[Start] = []
        self.here: list[float] | None = None
        self.nodes: int | None = None
        if path is None or not os.path.lexists(check_file_name(path)):
            return
        record = read_journal(path, WRITER)
        if not isinstance(record, dict) or record.get("kind") != KIND or "fingerprint" not in record:
            raise SceneError(f"{os.fspath(path)}: no file of a fit that was under way", "resume")
        if record["fingerprint"] != fingerprint:
            words = "is of another fit: other data, another scene, or other free numbers or options"
            raise SceneError(f"{os.fspath(path)} {words}", "resume")
        self.finished = [Start(**one) for one in map(restore_tuples, record["finished"])]
        self.here, self.nodes = record["here"], record["nodes"]

    def note(self, here: list[float] | None, nodes: int | None) -> None:
        """Writes where the start is that is under way; None where it is at its end, the last of ``finished``."""
        self.here, self.nodes = here, nodes
        if self.path is not None:
            record = {"kind": KIND, "fingerprint": self.fingerprint, "nodes": nodes}
            write_journal(self.path, record | {"finished": [asdict(one) for one in self.finished], "here": here})


def restore_tuples(record: Mapping[str, Any]) -> dict[str, Any]:
    """Fields as JSON gives them, lists as tuples again."""
    return {name: tuple(one) if isinstance(one, list) else one for name, one in record.items()}


def save_fit(fit: Fit, path: str | os.PathLike[str]) -> None:
    """Writes a fit as JSON that ends in its checksum. Raises OSError."""
    record: dict[str, Any] = {"kind": KIND, **{name: getattr(fit, name) for name in PLAIN}}
    record |= {name: getattr(fit, name).tolist() for name in ARRAYS}
    record["starts"] = [asdict(one) for one in fit.starts]
    record["measurement"] = {name: getattr(fit.measurement, name).tolist() for name in COLUMNS}
    described = fit.problem and describe_problem(fit.problem)
    if described and described["content"] is not None:
        record["problem"] = described
    write_journal(path, record)


def load_fit(path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> Fit:
    """What `save_fit` wrote; tables that its scene names lie in ``folder``, by default beside the file."""
    record = read_journal(path, WRITER)
    try:
        measurement = Measurement(**record["measurement"])
        fields = restore_tuples({name: one for name, one in record.items() if name in PLAIN})
        arrays: dict[str, Any] = {name: np.array(record[name], float) for name in ARRAYS}
        starts = tuple(Start(**restore_tuples(one)) for one in record["starts"])
        problem = None
        if "problem" in record:
            tables = Path(path).parent if folder is None else Path(folder)
            problem = restore_problem(record["problem"], measurement, fields, tables)
        return Fit(measurement=measurement, starts=starts, problem=problem, **fields, **arrays)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, SceneError):
            raise error.behind(os.fspath(path)) from error
        raise SceneError(f"{os.fspath(path)}: no fit that vrte wrote ({type(error).__name__}: {error})") from error


def restore_problem(
    record: Mapping[str, Any], measurement: Measurement, fields: Mapping[str, Any], folder: Path
) -> Any:
    """The problem of a saved fit."""
    at = record["colours_um"] or None
    model = make_model(
        measurement, record["content"], fields["names"], None, None, at, folder, jacobian=record["jacobian"]
    )
    model.options, model.nodes = dict(record["options"]), fields["nodes"]
    parameters = tuple(Parameter(**one) for one in record["parameters"])
    priors = np.array([[math.nan if one is None else one for one in pair] for pair in record["priors"]], float)
    return FitProblem(model, parameters, priors.reshape(-1, 2), np.array(record["sigma"], float), record["loss"])


@dataclass(frozen=True, eq=False)
class FitFile:
    """What a file with a table [fit] holds: the measurement, the scene's content without the table, keywords of
    `vrte.fit`, names of numbers whose profile is asked for, and the file's folder."""

    measurement: Measurement
    content: dict[str, Any]
    asked: dict[str, Any]
    profiles: tuple[str, ...]
    folder: Path


def read_fit(path: str | os.PathLike[str]) -> FitFile:
    """A fit from a scene file with a table [fit] (docs/how_to/fitting.md); its measurement lies beside it."""
    content, folder = read_content(path), Path(path).parent
    if not isinstance(content.get("fit"), dict):
        raise SceneError("fit is missing: the file needs a table [fit], with a measurement and what is free", "fit")
    table = Table(("fit",), content.pop("fit"), KEYS)
    measurement = read_measured(table, folder)
    free = table.required("free", "a list of names, or a table of tables by names")
    if not isinstance(free, dict) and not (isinstance(free, list) and all(isinstance(one, str) for one in free)):
        raise table.wrong("free", "must be a list of names, or a table of tables by names")
    asked = {"free": free, **{key: read(table, key) for key, read in READERS.items() if key in table}}
    profiles = table.content.get("profiles", [])
    names = list(free)
    if not isinstance(profiles, list) or any(one not in names for one in profiles):
        raise table.wrong("profiles", f"must be a list of names that are free: {', '.join(names)}")
    return FitFile(measurement, content, asked, tuple(profiles), folder)


def read_measured(table: Table, folder: Path) -> Measurement:
    """The measurement of a table [fit]: a file, or a table of one with keywords of `vrte.read_measurement`, or a
    list of these. Raises SceneError, OSError."""
    given = table.required("measurement", "the name of a file, a table with its file, or a list of these")
    parts = []
    for one in given if isinstance(given, list) and given else [given]:
        entry = {"file": one} if isinstance(one, str) else one
        if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
            raise table.wrong("measurement", "must be the name of a file, a table with its file, or a list of these")
        keywords = dict(Table(("fit", "measurement"), entry, ("file", *KEYWORDS)).content)
        parts.append(check_arguments(read_measurement)(folder / keywords.pop("file"), **keywords))
    return parts[0].join(parts[1:]) if parts[1:] else parts[0]


def read_whole(table: Table, key: str) -> int:
    """A whole number, whose range the call knows."""
    given = table.content[key]
    if type(given) is not int:
        raise table.wrong(key, "must be a whole number")
    return check_whole(f"fit.{key}", given, *RANGES[key])


RANGES = {"starts": (1, MOST_STARTS), "seed": (0, 2**31), "most_steps": (1, 100_000)}
READERS: dict[str, Any] = {
    "priors": lambda table, key: table.right(
        key, "a table of [mean, standard deviation] by names", lambda value: isinstance(value, dict)
    ),
    **dict.fromkeys(RANGES, read_whole),
    "loss": lambda table, key: table.choice(key, LOSSES),
    "jacobian": lambda table, key: table.choice(key, JACOBIANS),
    "wavelengths_um": Table.numbers,
}
KEYS = ("measurement", "free", "profiles", *READERS)
