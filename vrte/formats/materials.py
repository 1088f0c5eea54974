"""Ready materials: paints, powders, snow, by name, each a small file in vrte/materials that says where it comes from.

A layer of a scene file names one, and may change how thick and how dense it is; before anything else is read, its
particles and its layer are put in the name's place. One's own is a file of the same form beside the scene file.
"""

import copy
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from vrte.formats.atomic import read_text
from vrte.formats.keys import FilePath, Key, read_beside
from vrte.formats.toml_table import LARGEST_FILE, Table, parse_toml, show_key, suggest_nearest

FOLDER = Path(__file__).parents[1]
SUFFIX = ".toml"  # of one's own
MATERIAL: dict[str, Key] = {"material": FilePath(suffixes=(SUFFIX,))}
WORDS = ("title", "description", "approximations", "sources")  # what a file may say of itself
KEYS = (*WORDS, "particles", "layer")
CHANGED = ("thickness", "thickness_um", "volume_fraction", "packing", "host_index")  # by a layer that names a material
HOW_THICK = CHANGED[:2]


@dataclass(frozen=True, eq=False)
class ReadyMaterial:
    """A ready material or paint: its ``name``; a heading; what it is; in which ways it is not the real thing; where its
    numbers come from; and its tables as scene files have them, ``particles`` by name and ``layer``, or ``paint``."""

    name: str
    title: str
    description: str
    approximations: tuple[str, ...]
    sources: tuple[str, ...]
    particles: dict[str, Any] = field(default_factory=dict)
    layer: dict[str, Any] = field(default_factory=dict)
    paint: dict[str, Any] = field(default_factory=dict)

    @property
    def content(self) -> dict[str, Any]:
        """A scene file's content of the paint, or of one layer of the material, but for light and directions."""
        if self.paint:
            return {"title": self.title, "paint": copy.deepcopy(self.paint)}
        return expand_materials({"layer": [{"material": self.name}]})


@cache
def list_materials() -> dict[str, ReadyMaterial]:
    """The ready materials by name, in alphabetical order.

    Returns
    -------
    dict of str to ReadyMaterial
        What each is, in which ways it is approximated, where its numbers come from, and its tables for a scene file.

    Examples
    --------
    >>> import vrte
    >>> vrte.materials()["chalk"].particles["calcite"]["index"]
    'calcite'
    """
    return list_ready("materials", "particles", "layer")


def list_ready(folder: str, *tables: str) -> dict[str, ReadyMaterial]:
    """What is in the files of a folder of vrte, by name, each with those tables."""
    paths = {path.stem.replace("_", " "): path for path in (FOLDER / folder).glob(f"*{SUFFIX}")}
    return {name: read_ready_file(paths[name], name, *tables) for name in sorted(paths)}


def read_ready_file(path: Path, name: str, *tables: str) -> ReadyMaterial:
    """What the file of a ready material or paint says. Raises SceneError naming the key, OSError."""
    file = Table((), parse_toml(read_text(path, LARGEST_FILE)), (*WORDS, *tables))
    for key in tables:
        file.right(key, f"a table [{key}]", lambda value: isinstance(value, dict))
    words = {key: read_words(file, key) for key in WORDS}
    title, description = (" ".join(words[key]) for key in WORDS[:2])
    found = {key: file.content[key] for key in tables}
    return ReadyMaterial(name, title or name, description, words["approximations"], words["sources"], **found)


def read_words(file: Table, key: str) -> tuple[str, ...]:
    """A text, or several, where they are given."""
    given = file.content.get(key, [])
    listed = given if isinstance(given, list) else [given]
    if not all(isinstance(one, str) for one in listed):
        raise file.wrong(key, "must be a text, or a list of texts")
    return tuple(listed)


def read_material_file(path: Path, name: str) -> ReadyMaterial:
    """A material of one's own, which stands by itself. Raises SceneError naming the key, OSError."""
    found = read_ready_file(path, name, "particles", "layer")
    file = Table((), {"particles": found.particles}, KEYS)
    for kind, table in found.particles.items():
        if not isinstance(table, dict):
            raise file.wrong("particles", f"must be tables headed [particles.NAME], which {show_key(kind)} is not")
        for key, value in table.items():
            if isinstance(value, str) and value.endswith(".csv"):
                index = Table(("particles", kind), table, tuple(table))
                raise index.wrong(key, "a material names no other files; such particles go into the scene file")
    if "material" in found.layer:
        raise Table(("layer",), found.layer, tuple(found.layer)).wrong("material", "a material is not made of another")
    return found


def find_material(name: str) -> ReadyMaterial | None:
    """A ready material by its name, capitals, hyphens and underscores aside."""
    plain = {known.replace("-", " "): material for known, material in list_materials().items()}
    return plain.get(" ".join(re.split("[-_ ]+", name.lower())))


def choose_material(layer: Table, folder: Path) -> ReadyMaterial:
    """The material that a layer names: a ready one, or a file of one's own. Raises SceneError."""
    name = layer.content["material"]
    if isinstance(name, str) and name.endswith(SUFFIX):
        return read_beside(layer, "material", lambda path: read_material_file(path, name), folder)
    found = find_material(name) if isinstance(name, str) else None
    if found is None:
        known, hint = ", ".join(list_materials()), suggest_nearest(name, list_materials())
        raise layer.wrong("material", f"must be a {SUFFIX} beside the scene file or one of {known}{hint}")
    return found


def list_named(content: Mapping[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """The layers of a scene file that name a material, with their numbers, whatever else is in it."""
    layers = content.get("layer")
    if isinstance(content.get("particles", {}), dict):  # where it is none, that is reported first
        for number, layer in enumerate(layers if isinstance(layers, list) else []):
            if isinstance(layer, dict) and "material" in layer:
                yield number, layer


def name_kind(material: Any, kind: str) -> str:
    """The name of a material's particles in a scene file, such as "fresh snow: ice"."""
    return f"{material}: {kind}"


def expand_materials(content: Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """The content of a scene file with the particles and layers of the materials that it names; one's own lie in
    ``folder``. What else is in it stays, right or wrong. Raises SceneError naming the layer."""
    named = list(list_named(content))
    if not named:
        return dict(content)
    layers, particles = list(content["layer"]), dict(content.get("particles", {}))
    for number, given in named:
        layer = Table(("layer", number), given, ("material", *CHANGED))
        material = choose_material(layer, folder)
        names = {kind: name_kind(given["material"], kind) for kind in material.particles}
        for kind, name in names.items():
            if name in content.get("particles", {}):
                raise layer.wrong("material", f"calls its particles {show_key(name)}, as a table of the file is called")
            particles[name] = copy.deepcopy(material.particles[kind])
        layers[number] = merge_layers(material.layer, layer, names)
    return {**content, "particles": particles, "layer": layers}


def merge_layers(ready: Mapping[str, Any], given: Table, names: Mapping[str, str]) -> dict[str, Any]:
    """The layer of a material with what the layer that names it gives in place of that."""
    changed = {key: value for key, value in given.content.items() if key in CHANGED}
    found = copy.deepcopy(dict(ready))
    for key in HOW_THICK if {*HOW_THICK} & {*changed} else ():
        found.pop(key, None)
    for key in ("particles", "volume_fractions"):
        held = found.get(key)
        if isinstance(held, dict):
            found[key] = {names.get(kind, kind): fraction for kind, fraction in held.items()}
        elif isinstance(held, str):
            found[key] = names.get(held, held)
    fractions = found.get("volume_fractions")
    if "volume_fraction" in changed and isinstance(fractions, dict):
        part = given.fraction("volume_fraction", "a number above 0 and below 1")
        if not 0.0 < part < 1.0:
            raise given.wrong("volume_fraction", "must be above 0 and below 1")
        whole = math.fsum(fractions.values())
        found["volume_fractions"] = {kind: fraction * part / whole for kind, fraction in fractions.items()}
        del changed["volume_fraction"]
    return found | changed
