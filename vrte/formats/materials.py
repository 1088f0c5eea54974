"""Ready materials: paints, powders, snow, by name, each a small file in vrte/materials that says where it comes from.

A layer of a scene file names one, and may change how thick and how dense it is; before anything else is read, its
particles and its layer are put in the name's place. One's own is a file of the same form beside the scene file.
"""

import copy
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.atomic import read_text
from vrte.formats.toml_table import LARGEST_FILE, Table, parse_toml, show_key, show_toml, suggest_nearest

FOLDER = Path(__file__).parents[1] / "materials"
SUFFIX = ".toml"  # of one's own
WORDS = ("title", "description", "approximations", "sources")  # what a file may say of itself
KEYS = (*WORDS, "particles", "layer")
CHANGED = ("thickness", "thickness_um", "volume_fraction", "packing", "host_index")  # by a layer that names a material
HOW_THICK = CHANGED[:2]


@dataclass(frozen=True, eq=False)
class ReadyMaterial:
    """A ready material as its file has it: what it is, how it is approximated, where its numbers come from.

    Attributes
    ----------
    name
        As a layer of a scene names it.
    title
        A heading.
    description
        What it is.
    approximations
        In which ways it is not the real thing.
    sources
        Where its numbers come from.
    particles
        Tables of particles by name, as scene files have them.
    layer
        The table of its layer, as scene files have it.

    Examples
    --------
    >>> import vrte
    >>> vrte.materials()["chalk"].title
    'Chalk'
    """

    name: str
    title: str
    description: str
    approximations: tuple[str, ...]
    sources: tuple[str, ...]
    particles: dict[str, Any]
    layer: dict[str, Any]

    @property
    def content(self) -> dict[str, Any]:
        """A scene file's content of one layer of it, but for light and directions."""
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
    files = {path.stem.replace("_", " "): path for path in FOLDER.glob(f"*{SUFFIX}")}
    return {name: read_material_file(files[name], name) for name in sorted(files)}


def find_material(name: str) -> ReadyMaterial | None:
    """A ready material by its name, capitals, hyphens and underscores aside.

    >>> find_material("Fresh_snow").title
    'Fresh snow'
    """
    plain = {known.replace("-", " "): material for known, material in list_materials().items()}
    return plain.get(" ".join(re.split("[-_ ]+", name.lower())))


def read_material_file(path: Path, name: str) -> ReadyMaterial:
    """What a material's file says. Raises SceneError naming the key, OSError."""
    file = Table((), parse_toml(read_text(path, LARGEST_FILE)), KEYS)
    for key in ("particles", "layer"):
        file.right(key, f"a table [{key}]", lambda value: isinstance(value, dict))
    particles, layer = file.content["particles"], file.content["layer"]
    for kind, table in particles.items():
        if not isinstance(table, dict):
            raise file.wrong("particles", f"must be tables headed [particles.NAME], which {show_key(kind)} is not")
        for key, value in table.items():
            if isinstance(value, str) and value.endswith(".csv"):
                place = Table(("particles", kind), table, tuple(table))
                raise place.wrong(key, "a material names no other files; such particles go into the scene file")
    if "material" in layer:
        raise Table(("layer",), layer, tuple(layer)).wrong("material", "a material is not made of another")
    words = {key: read_words(file, key) for key in ("approximations", "sources")}
    title, description = (read_words(file, key) for key in ("title", "description"))
    return ReadyMaterial(
        name, " ".join(title) or name, " ".join(description), **words, particles=particles, layer=layer
    )


def read_words(file: Table, key: str) -> tuple[str, ...]:
    """A text, or several, where they are given."""
    given = file.content.get(key, [])
    listed = given if isinstance(given, list) else [given]
    if not all(isinstance(one, str) for one in listed):
        raise file.wrong(key, "must be a text, or a list of texts")
    return tuple(listed)


def expand_materials(content: Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """The content of a scene file with the particles and layers of the materials that it names; one's own lie in
    ``folder``. What else is in it stays, right or wrong. Raises SceneError naming the layer.

    >>> expand_materials({"layer": [{"material": "chalk"}]})["layer"]
    [{'particles': 'chalk: calcite', 'thickness': inf}]
    """
    if not any(True for _ in list_named(content)):
        return dict(content)
    layers, particles = list(content["layer"]), dict(content.get("particles", {}))
    for number, given in list_named(content):
        layer = Table(("layer", number), given, ("material", *CHANGED))
        material = choose_material(layer, folder)
        names = {kind: name_kind(given["material"], kind) for kind in material.particles}
        for kind, name in names.items():
            if name in content.get("particles", {}):
                raise layer.wrong("material", f"calls its particles {show_key(name)}, as a table of the file is called")
            particles[name] = copy.deepcopy(material.particles[kind])
        layers[number] = merge_layers(material.layer, layer, names)
    return {**content, "particles": particles, "layer": layers}


def list_named(content: Mapping[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """The layers of a scene file that name a material, with their numbers, whatever else is in it."""
    layers = content.get("layer")
    if isinstance(content.get("particles", {}), dict):  # where it is none, that is told first
        for number, layer in enumerate(layers if isinstance(layers, list) else []):
            if isinstance(layer, dict) and "material" in layer:
                yield number, layer


def name_kind(material: Any, kind: str) -> str:
    """What the particles of a material are called in a scene file.

    >>> name_kind("fresh snow", "ice")
    'fresh snow: ice'
    """
    return f"{material}: {kind}"


def choose_material(layer: Table, folder: Path) -> ReadyMaterial:
    """The material that a layer names: a ready one, or a file of one's own."""
    name = layer.content["material"]
    if isinstance(name, str) and name.endswith(SUFFIX):
        try:
            return read_material_file(folder / name, name)
        except SceneError as error:
            raise layer.wrong("material", str(error)) from error
        except OSError as error:
            raise layer.wrong("material", f"the file cannot be read: {error.strerror}") from error
    found = find_material(name) if isinstance(name, str) else None
    if found is None:
        hint = suggest_nearest(name, list_materials()) if isinstance(name, str) else ""
        known = ", ".join(list_materials())
        raise layer.wrong("material", f"must be a {SUFFIX} beside the scene file or one of {known}{hint}")
    return found


def merge_layers(ready: Mapping[str, Any], given: Table, names: Mapping[str, str]) -> dict[str, Any]:
    """The layer of a material with what the layer that names it gives in place of that."""
    changed = {key: value for key, value in given.content.items() if key in CHANGED}
    found = {
        key: copy.deepcopy(value)
        for key, value in ready.items()
        if key not in HOW_THICK or not {*HOW_THICK} & {*changed}
    }
    for key in ("particles", "volume_fractions"):
        if isinstance(found.get(key), str):
            found[key] = names.get(found[key], found[key])
        elif isinstance(found.get(key), dict):
            found[key] = {names.get(kind, kind): share for kind, share in found[key].items()}
    shares = found.get("volume_fractions")
    if "volume_fraction" in changed and isinstance(shares, dict):
        part = given.share("volume_fraction", "a number above 0 and below 1")
        if not 0.0 < part < 1.0:
            raise given.wrong("volume_fraction", "must be above 0 and below 1")
        whole = math.fsum(shares.values())
        found["volume_fractions"] = {kind: share * part / whole for kind, share in shares.items()}
        del changed["volume_fraction"]
    return found | changed


@contextmanager
def locate_material_errors(content: Mapping[str, Any]) -> Iterator[None]:
    """Puts the layer that names a material in front of complaints about its particles.

    >>> with locate_material_errors({"layer": [{"material": "chalk"}]}):
    ...     raise SceneError("particles.x: no such index", "particles", "chalk: calcite")
    Traceback (most recent call last):
    vrte.SceneError: layer[1].material = "chalk": particles.x: no such index
    """
    try:
        yield
    except SceneError as error:
        for number, layer in list_named(content) if error.place[:1] == ("particles",) else ():
            if any(str(kind).startswith(name_kind(layer["material"], "")) for kind in error.place[1:2]):
                message = f"layer[{number + 1}].material = {show_toml(layer['material'])}: {error}"
                raise SceneError(message, "layer", number, "material") from error
        raise
