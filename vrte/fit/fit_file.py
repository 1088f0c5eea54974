"""A fit as a scene file says it: the scene, and a table [fit] with the measurement and what is free."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vrte.basics.arrays import check_whole
from vrte.basics.errors import SceneError
from vrte.fit.measurement import Measurement, read_measurement
from vrte.fit.problem import LOSSES
from vrte.fit.run import JACOBIANS, MOST_STARTS
from vrte.formats.scene_file import read_content
from vrte.formats.toml_table import Table


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
    """A fit from a scene file with a table [fit] (docs/how_to/fitting.md); the measurement that it names lies beside
    it. Raises SceneError, which names the key, OSError."""
    content, folder = read_content(path), Path(path).parent
    if not isinstance(content.get("fit"), dict):
        raise SceneError("fit is missing: the file needs a table [fit], with a measurement and what is free", "fit")
    table = Table(("fit",), content.pop("fit"), KEYS)
    name = table.right("measurement", "the name of a file, .csv or .nc", lambda value: isinstance(value, str))
    free = table.required("free", "a list of names, or a table of tables by names")
    if not isinstance(free, dict) and not (isinstance(free, list) and all(isinstance(one, str) for one in free)):
        raise table.wrong("free", "must be a list of names, or a table of tables by names")
    asked: dict[str, Any] = {"free": free}
    for key, read in READERS.items():
        if key in table:
            asked[key] = read(table, key)
    profiles = table.content.get("profiles", [])
    names = list(free)
    if not isinstance(profiles, list) or any(one not in names for one in profiles):
        raise table.wrong("profiles", f"must be a list of names that are free: {', '.join(names)}")
    return FitFile(read_measurement(folder / name), content, asked, tuple(profiles), folder)


def read_priors_table(table: Table, key: str) -> dict[str, Any]:
    """Means and standard deviations by names."""
    found: dict[str, Any] = table.right(key, "a table of [mean, standard deviation] by names", is_table)
    return found


def is_table(value: Any) -> bool:
    """Whether a value of TOML is a table."""
    return isinstance(value, dict)


def read_whole(table: Table, key: str) -> int:
    """A whole number, whose range the call knows."""
    given = table.content[key]
    if type(given) is not int:
        raise table.wrong(key, "must be a whole number")
    return check_whole(f"fit.{key}", given, *RANGES[key])


RANGES = {"starts": (1, MOST_STARTS), "seed": (0, 2**31), "most_steps": (1, 100_000)}
READERS = {
    "priors": read_priors_table,
    **dict.fromkeys(RANGES, read_whole),
    "loss": lambda table, key: table.choice(key, LOSSES),
    "jacobian": lambda table, key: table.choice(key, JACOBIANS),
    "wavelengths_um": Table.numbers,
}
KEYS = ("measurement", "free", "profiles", *READERS)
