"""A scene file (TOML): what light meets, and what is asked about it.

Every key is checked before anything is computed; a key that nobody knows is an error, because a mistyped one
would silently leave its default in place. Tables of one's own, coefficients and refractive indices, are
looked for beside the scene file.
"""

import math
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.atomic import read_text
from vrte.formats.bases import read_base
from vrte.formats.keys import (
    WAVE_KEYS,
    Choice,
    Flag,
    Key,
    Numbers,
    Other,
    Reading,
    find_given_as,
    list_names,
    read_keys,
)
from vrte.formats.layers import FilledLayer, make_layer, read_layers
from vrte.formats.materials import WORDS, read_words
from vrte.formats.paints import expand_content, locate_expanded_errors
from vrte.formats.particle_sources import Compute, Kinds, make_particles
from vrte.formats.toml_table import LARGEST_FILE, Table, locate_errors, parse_toml
from vrte.optics.particles import Particles
from vrte.request.how import AUTO, OPTIONS
from vrte.request.request import SIDES
from vrte.scene.scene import Scene

OPTION_KEYS = ("nodes", "grading", "accuracy", "truncation", "method", "illuminate", "settings", "precision")
FILE_KEYS = (*WAVE_KEYS, *OPTION_KEYS, "particles", "layer", "base", "paint", "render", "fit", "brdf", "field", *WORDS)
ANGLES = {"mu_i": "angle_i_deg", "mu_o": "angle_o_deg", "mu0": "angle0_deg"}  # from the normal, for cosines


class Option(Key):
    """How to solve, checked as the calls check it."""

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        known, value = OPTIONS[name], table.content[name]
        if known.choices:
            return table.choice(name, known.choices)
        if type(value) is known.of or (known.of is float and type(value) is int):
            with suppress(SceneError):
                return known.check(name, value)
        raise table.wrong(name, f"must be {known.allowed}")


def find_cosines(degrees: Any) -> Any:
    """Cosines of angles from the normal [degrees], one or a list; None where one of them is none."""
    listed = degrees if isinstance(degrees, list) else [degrees]
    found = [math.cos(math.radians(angle)) for angle in listed if 0.0 <= angle < 90.0]
    if len(found) < len(listed):
        return None
    return found if isinstance(degrees, list) else found[0]


ANGLE = "degrees from the normal, from 0 to below 90"
INCIDENT, OUTGOING, BEAM = (Other(key, find_cosines, allowed=ANGLE) for key in ANGLES.values())
AZIMUTHS = Numbers(argument="phi", needed=False)
REQUESTS: dict[str, dict[str, Key]] = {  # what is asked for: the keys of [brdf] and [field]
    "brdf": {
        "mu_i": Numbers(other=INCIDENT),
        "mu_o": Numbers(other=OUTGOING),
        "phi_deg": AZIMUTHS,
        "transmission": Flag(needed=False),
    },
    "field": {
        "mu0": Numbers(other=BEAM, single=True, allowed="a cosine above 0, up to 1, or a list of them"),
        "stokes": Numbers(needed=False, count=4, allowed="four numbers I, Q, U, V"),
        "mu": Numbers(needed=False, may_be_empty=True),
        "phi_deg": AZIMUTHS,
        "tau": Numbers(needed=False),
        "side": Choice(names=dict.fromkeys(SIDES, ""), needed=False),
    },
}
REQUEST_KEYS = {kind: list_names(keys) for kind, keys in REQUESTS.items()}


@dataclass(frozen=True, eq=False)
class SceneFile:
    """What a scene file holds.

    ``kind`` is "brdf" or "field"; ``request`` holds the keywords of ``vrte.brdf`` or ``vrte.radiance``, ``options``
    those of them that say how to solve, OPTION_KEYS, as far as they are given; ``particles`` the kinds that the layers
    hold, by name; ``text`` the file as it is, "" where there was none; ``asked`` the table of the request; ``filled``
    the layers that hold particles."""

    scene: Scene
    kind: str
    request: dict[str, Any]
    options: dict[str, Any]
    particles: dict[str, Particles]
    text: str = ""
    asked: Table = field(default_factory=lambda: Table((), {}, ()))
    filled: list[FilledLayer] = field(default_factory=list)

    def keywords(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """All keywords of ``vrte.brdf`` or ``vrte.radiance`` but the scene, those ``asked`` in place of the file's;
        settings by other names stay, but not those of another method, nor nodes where "auto" is to choose."""
        found = self.request | self.options | dict(asked)
        if asked.get("method") == AUTO and "nodes" not in asked:
            found.pop("nodes", None)
            found.pop("grading", None)
        if "settings" in self.options:
            of_file = {} if "method" in asked else self.options["settings"]
            found["settings"] = of_file | asked.get("settings", {})
        return found

    def located(self) -> AbstractContextManager[None]:
        """Puts the dotted key of the file in front of the library's complaints about the request."""
        given_as = find_given_as(REQUESTS[self.kind], self.asked)
        return locate_errors((self.kind,), REQUEST_KEYS[self.kind], given_as=given_as, keys_only=True)


def read_scene(path: str | os.PathLike[str], kind: str | None = None, wavelength_um: float | None = None) -> SceneFile:
    """Reads and checks the scene file ``path`` for the command ``kind``, "brdf" or "field"; without it the file must
    have one of the two tables. ``wavelength_um`` wins over the file's. Raises SceneError naming the dotted key, what
    was given and what is allowed, OSError where the file cannot be read."""
    text = read_text(path, LARGEST_FILE)
    changed = {} if wavelength_um is None else {"wavelength_um": wavelength_um}
    return replace(make_scene_file(parse_toml(text) | changed, kind, Path(path).parent), text=text)


def read_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The keys and tables of a file in TOML, as they are. Raises SceneError where it is none, OSError."""
    return parse_toml(read_text(path, LARGEST_FILE))


def read_listed_wavelengths(content: dict[str, Any]) -> list[float] | None:
    """``wavelength_um`` where it is a list or a range, for a spectrum; None where it is one number, or not there.
    Raises SceneError."""
    if not isinstance(content.get("wavelength_um"), (list, dict)):
        return None
    return Table((), content, FILE_KEYS).numbers("wavelength_um")


def make_scene_file(
    content: dict[str, Any], kind: str | None = None, folder: Path = Path(), compute: Compute = make_particles
) -> SceneFile:
    """What a scene file with this content would hold; files that it names lie in ``folder``. Errors as `read_scene`.
    ``compute`` is called with the source and the keywords of each kind of particle: who reads many files can remember
    its answers, and who only checks one can do without them (`check_particles`)."""
    file = Table((), expand_content(content, folder), FILE_KEYS)
    for key in WORDS:
        read_words(file, key)
    reading, there = Reading(file, folder), [name for name in REQUESTS if name in file]
    if kind is None and len(there) != 1:
        raise SceneError(f"exactly one of the tables [brdf] and [field] is needed, not {len(there)}")
    kind = kind or there[0]
    if kind not in there:
        other = f" (there is [{there[0]}], for `vrte {there[0]}`)" if there else ""
        raise SceneError(f"{kind} is missing: the file needs a table [{kind}]{other}", kind)
    asked = {name: file.table(name, keys) for name, keys in REQUEST_KEYS.items() if name in file}[kind]
    request = read_keys(REQUESTS[kind], asked, reading)
    options = read_keys(dict.fromkeys(OPTION_KEYS, Option(needed=False)), file, reading)
    filled: list[FilledLayer] = []
    with locate_expanded_errors(content):
        kinds = Kinds(compute, reading)
        layers = read_layers(reading)  # all are checked before one is made
        base = read_base(reading)
        made: list[Any] = [make_layer(*layer, kinds, filled) for layer in layers]
    return SceneFile(Scene(made, base), kind, request, options, kinds.computed, asked=asked, filled=filled)
