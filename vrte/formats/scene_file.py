"""A scene file (TOML): what light meets, what is asked about it, and which substances and files it names.

Every key is checked before anything is computed; an unknown key is an error, because a mistyped one
would silently leave its default in place. Tables of one's own, coefficients and refractive indices, are
looked for beside the scene file.
"""

import math
import os
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import Place, SceneError
from vrte.formats.atomic import read_text, write_text
from vrte.formats.bases import BASES, read_base_table
from vrte.formats.columns import read_index
from vrte.formats.flakes import Stack, list_films
from vrte.formats.keys import (
    TABLE,
    WAVE_KEYS,
    Choice,
    FilePath,
    Flag,
    Key,
    Numbers,
    Other,
    Reading,
    Substance,
    find_given_as,
    join_rows,
    list_names,
    read_keys,
)
from vrte.formats.layers import LAYER, FilledLayer, make_layer, read_layers
from vrte.formats.materials import WORDS, expand_content, expand_paint, locate_expanded_errors, read_words
from vrte.formats.particle_sources import HOST, SIZED, SOURCES, Compute, Kinds, make_particles
from vrte.formats.toml_table import LARGEST_FILE, Table, locate_errors, parse_toml, write_toml
from vrte.optics.particles import Particles
from vrte.optics.refractive_index import find_wavelength_range
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
        "coherent": Flag(needed=False),
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
    """What a scene file holds: the ``request`` of a ``kind``, "brdf" or "field", as keywords, and as the table that was
    ``asked``; OPTION_KEYS among them; ``particles`` by name; ``filled`` layers; its ``text``, "" without a file."""

    scene: Scene
    kind: str
    request: dict[str, Any]
    options: dict[str, Any]
    particles: dict[str, Particles]
    text: str = ""
    asked: Table = field(default_factory=lambda: Table((), {}, ()))
    filled: list[FilledLayer] = field(default_factory=list)

    def keywords(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """All keywords of the call but the scene, those ``asked`` in place of the file's, settings merged by name."""
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
    """The scene file at ``path`` for a ``kind``, checked, at its wavelength or another. Raises SceneError, OSError."""
    text = read_text(path, LARGEST_FILE)
    changed = {} if wavelength_um is None else {"wavelength_um": wavelength_um}
    return replace(make_scene_file(parse_toml(text) | changed, kind, Path(path).parent), text=text)


def read_content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The keys and tables of a file in TOML, as they are. Raises SceneError where it is none, OSError."""
    return parse_toml(read_text(path, LARGEST_FILE))


def write_content(content: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Writes a scene file (.toml). Raises SceneError, OSError."""
    if not os.fspath(path).lower().endswith(".toml"):
        raise SceneError(f"the scene file {put_in_one_line(os.fspath(path))} must end in .toml")
    write_text(write_toml(dict(content)), path)


def read_listed_wavelengths(content: dict[str, Any]) -> list[float] | None:
    """``wavelength_um`` where it is a list or a range, else None. Raises SceneError."""
    if not isinstance(content.get("wavelength_um"), (list, dict)):
        return None
    return Table((), content, FILE_KEYS).numbers("wavelength_um")


def make_scene_file(
    content: dict[str, Any], kind: str | None = None, folder: Path = Path(), compute: Compute = make_particles
) -> SceneFile:
    """What a scene file of this content holds; ``compute`` makes or checks particles. Raises as `read_scene`."""
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
        base = read_base_table(reading)
        made: list[Any] = [make_layer(*layer, kinds, filled) for layer in layers]
    return SceneFile(Scene(made, base), kind, request, options, kinds.computed, asked=asked, filled=filled)


def list_keys(content: Mapping[str, Any]) -> Iterator[tuple[Place, Key, Any]]:
    """Every key of a registry that a file's content gives: its place (a paint's is expanded), key and value."""
    with suppress(SceneError):
        content = expand_paint(content)
    particles, layers = content.get("particles"), content.get("layer")
    yield from list_given((), content, HOST)
    for name, kind in particles.items() if isinstance(particles, dict) else ():
        yield from list_given(("particles", name), kind, join_rows(SOURCES) | SIZED | HOST)
    for number, layer in enumerate(layers if isinstance(layers, list) else []):
        yield from list_given(("layer", number), layer, LAYER)
    yield from list_given(("base",), content.get("base"), join_rows(BASES))


def list_given(place: Place, table: Any, keys: Mapping[str, Key]) -> Iterator[tuple[Place, Key, Any]]:
    """The keys that a table has, with those of the tables in it: place, key and value."""
    for name, key in keys.items() if isinstance(table, dict) else ():
        if name in table:
            yield (*place, name), key, table[name]
            yield from list_given((*place, name), table[name], key.inside)
            if isinstance(key, Stack):
                yield from list_films((*place, name), table[name])


def list_substances(content: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Names of substances, and of tables of one's own, with the places of a scene file that have them."""
    found = list_keys(content)
    return ((place, value) for place, key, value in found if isinstance(key, Substance) and isinstance(value, str))


def find_named_tables(content: Mapping[str, Any]) -> dict[Place, str]:
    """The files that a scene file names, by the place that does."""
    endings = (
        (place, value, key.suffixes if isinstance(key, FilePath) else TABLE if isinstance(key, Substance) else ())
        for place, key, value in list_keys(content)
    )
    return {place: value for place, value, ending in endings if isinstance(value, str) and value.endswith(ending)}


def find_known_wavelengths(content: Mapping[str, Any], folder: Path = Path()) -> tuple[float, float, str]:
    """Wavelengths [um] that all indices of a scene file are known for, and the last substance that ends them."""
    found = (0.0, math.inf, "")
    with suppress(SceneError):
        content = expand_content(content, folder)
    for _, index in list_substances(content):
        with suppress(SceneError):
            low, high = find_wavelength_range(read_index(folder / index) if index.endswith(TABLE) else index)
            if low > found[0] or high < found[1]:
                found = max(low, found[0]), min(high, found[1]), index
    return found
