"""Ready materials and paints by name, each a small file in vrte/materials or vrte/paints that says where it comes from.

A layer of a scene file names a material, and may change how thick and how dense it is; a table [paint] says pigments,
binder, dry film, surface and substrate, in the words of who makes paint. Before anything else is read, ordinary
particles, layers and a base are put in their places. One's own material is a file beside the scene file.
"""

import copy
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from vrte.basics.arrays import show_value
from vrte.basics.errors import Place, SceneError
from vrte.formats.atomic import read_text
from vrte.formats.bases import INTERFACE
from vrte.formats.keys import FilePath, Key, read_beside
from vrte.formats.particle_sources import COATED, SIZE_KEYS, SPHERES
from vrte.formats.toml_table import LARGEST_FILE, Table, parse_toml, show_key, show_place, show_toml, suggest_nearest
from vrte.optics.crowding import COHERENT_POTENTIAL, INDEPENDENT
from vrte.optics.refractive_index import MATERIALS

FOLDER = Path(__file__).parents[1]
SUFFIX = ".toml"  # of one's own
MATERIAL: dict[str, Key] = {"material": FilePath(suffixes=(SUFFIX,))}
WORDS = ("title", "description", "approximations", "sources")  # what a file may say of itself
MATERIAL_KEYS = (*WORDS, "particles", "layer")
CHANGED = ("thickness", "thickness_um", "volume_fraction", "packing", "host_index")  # by a layer that names a material
HOW_THICK = CHANGED[:2]


@dataclass(frozen=True, eq=False)
class ReadyMaterial:
    """A ready material or paint: what it is and is not, sources, and its tables as scene files have them."""

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
    """The content of the file of a ready material or paint. Raises SceneError naming the key, OSError."""
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
    file = Table((), {"particles": found.particles}, MATERIAL_KEYS)
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


def find_named(name: str, listed: Mapping[str, ReadyMaterial]) -> ReadyMaterial | None:
    """One of these by its name, capitals, hyphens and underscores aside."""
    plain = {known.replace("-", " "): one for known, one in listed.items()}
    return plain.get(" ".join(re.split("[-_ ]+", name.lower())))


def find_material(name: str) -> ReadyMaterial | None:
    """A ready material by its name."""
    return find_named(name, list_materials())


def find_paint(name: str) -> ReadyMaterial:
    """A ready paint by its name. Raises SceneError for no such paint."""
    if (found := find_named(name, list_paints())) is None:
        words = f"must be a scene file (.toml), its content or a ready paint, {', '.join(list_paints())}"
        raise SceneError.of("paint", f"{words}, not {show_value(name)}{suggest_nearest(name, list_paints())}")
    return found


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
    """A scene file's content with the materials it names, one's own in ``folder``, expanded. Raises SceneError."""
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


FLAKE_KEYS = ("flakes", "flake_area", "flake_thickness_um")
FILM_KEYS = ("pigment", "volume_fraction", "binder", "thickness_um", "surface", "substrate", "packing", "particles")
PAINT_KEYS = (*FILM_KEYS, *FLAKE_KEYS)
SMOOTH, BARE = "smooth", "none"
REPLACED = ("particles", "layer", "base", "host_index")  # by what a paint is expanded to
# keys of a pigment's grains of which one is enough: whichever is given stands in place of the pigment's own
ALTERNATIVES = (SIZE_KEYS, tuple(key for key in COATED if key not in ("core", "shell")))
# the ready material whose grains a pigment has
PIGMENTS = {
    "rutile": "rutile in alkyd",
    "silica-coated rutile": "silica-coated rutile in alkyd",
    "alumina-coated rutile": "alumina-coated rutile in acrylic",
    "hollow polymer": "hollow polymer in acrylic",
    "hematite": "hematite in acrylic",
    "titanium black": "titanium black in acrylic",
    "chalk": "chalk",
    "alumina": "alumina powder",
    "gold": "gold powder",
}


@cache
def list_paints() -> dict[str, ReadyMaterial]:
    """The ready paints by name, in alphabetical order, such as list_paints()["white gloss"]."""
    return list_ready("paints", "paint")


def find_pigment(name: str) -> dict[str, Any] | None:
    """The table [particles.NAME] of a pigment, by its name or that of its substance; None for what is no pigment."""
    for pigment, material in PIGMENTS.items():
        (grains,) = list_materials()[material].particles.values()
        if name in (pigment, grains.get("index")):
            return copy.deepcopy(grains)
    return None


def expand_content(content: Mapping[str, Any], folder: Path = Path()) -> dict[str, Any]:
    """A file's content with paint and ready materials expanded; one's own lie in ``folder``. Raises SceneError."""
    return expand_materials(expand_paint(content), folder)


def expand_paint(content: Mapping[str, Any]) -> dict[str, Any]:
    """A scene file's content with particles, layers and base in place of its table [paint]. Raises SceneError."""
    if "paint" not in content:
        return dict(content)
    for key in REPLACED:
        if key in content:
            raise SceneError(f"paint: a file with a table [paint] has no {key} of its own: the paint makes it", "paint")
    paint = Table((), dict(content), tuple(content)).table("paint", PAINT_KEYS)
    fractions = {} if "flakes" in paint and "pigment" not in paint else _read_pigments(paint)
    binder = paint.required("binder", 'a substance such as "alkyd", or [n, k]')
    thickness = paint.required("thickness_um", "the thickness of the dry film in micrometres, or inf")
    own = paint.content.get("particles", {})
    if not isinstance(own, dict) or not all(isinstance(grains, dict) for grains in own.values()):
        raise paint.wrong("particles", "must be tables headed [paint.particles.NAME]")
    for name in {*own} - {*fractions}:
        raise Table(("paint", "particles"), own, tuple(own)).wrong(name, "is none of the pigments of this paint")
    kinds = {name: _make_grains(paint, name, own.get(name)) for name in fractions}
    spheres = all(kind.get("source", SPHERES) in (SPHERES, "coated-spheres") for kind in kinds.values())
    packing = paint.content.get("packing", COHERENT_POTENTIAL if spheres else INDEPENDENT)
    filling = {"volume_fractions": fractions, "packing": packing}
    if not fractions:
        if "flake_area" in paint:
            raise paint.wrong(
                "flake_area", "is of flakes beside pigments; alone give volume_fraction, flake_thickness_um"
            )
        filling = {key: paint.content[key] for key in ("volume_fraction", "packing") if key in paint}
    filling |= {key: paint.content[key] for key in FLAKE_KEYS if key in paint}
    layers = [{"host_index": binder, **filling, "thickness_um": thickness}]
    surface = paint.content.get("surface", SMOOTH)
    if isinstance(surface, dict):
        paint.table("surface", tuple(INTERFACE))
    elif surface not in (SMOOTH, BARE):
        raise paint.wrong("surface", f'must be "{SMOOTH}", "{BARE}" or a table with {", ".join(INTERFACE)}')
    if surface != BARE:
        facets = surface if isinstance(surface, dict) else {}
        layers.insert(0, {"interface": {"above": 1.0, "below": binder, **facets}})
    found = {key: value for key, value in content.items() if key != "paint"} | {"particles": kinds, "layer": layers}
    return copy.deepcopy(found | ({"base": paint.content["substrate"]} if "substrate" in paint else {}))


def _read_pigments(paint: Table) -> dict[str, Any]:
    """The volume fraction of each pigment, as it is given."""
    given = paint.required("pigment", "a name, or a table { name = volume fraction, ... }")
    if isinstance(given, dict) and given:
        if "volume_fraction" in paint:
            raise paint.wrong("volume_fraction", "goes with one pigment by its name; a table has its own")
        return given
    if not isinstance(given, str):
        raise paint.wrong("pigment", "must be a name, or a table { name = volume fraction, ... }")
    return {given: paint.required("volume_fraction", 'from 0 to below 1, or per cent in quotes, "15 %"')}


def _make_grains(paint: Table, name: str, own: dict[str, Any] | None) -> dict[str, Any]:
    """The table [particles.NAME] of a pigment: the known one's, what the paint gives in place of that; or its own."""
    known = find_pigment(name)
    if own is not None and (known is None or "source" in own):
        return own if {"source", "index"} & {*own} else {"index": name, **own}
    if known is None:
        hint = suggest_nearest(name, [*PIGMENTS, *MATERIALS])
        words = f"no pigment {name!r}{hint or '.'} Known: {', '.join(PIGMENTS)}; any other substance needs its size, as"
        raise paint.wrong("pigment", f'{words} particles."{name}" = {{ diameter_um = 0.3 }}')
    replaced = {key for keys in ALTERNATIVES if own and {*keys} & {*own} for key in keys}
    return {key: value for key, value in known.items() if key not in replaced} | (own or {})


def list_places(content: Mapping[str, Any]) -> list[tuple[Place, Place]]:
    """Places in the expanded scene (particles, layers, base) of each place in [paint]."""
    paint = content.get("paint")
    if not isinstance(paint, dict):
        return []
    film = 0 if paint.get("surface") == BARE else 1
    fractions: Place = ("layer", film, "volume_fractions")
    part: Place = (*fractions, str(paint["pigment"])) if "pigment" in paint else ("layer", film, "volume_fraction")
    found: list[tuple[str, Place]] = [
        ("volume_fraction", part),
        *((key, ("layer", film, key)) for key in FLAKE_KEYS),
        ("pigment", fractions),
        ("particles", ("particles",)),
        ("binder", ("layer", film, "host_index")),
        ("binder", ("layer", 0, "interface", "below")),
        ("thickness_um", ("layer", film, "thickness_um")),
        ("packing", ("layer", film, "packing")),
        ("substrate", ("base",)),
        ("surface", ("layer", 0, "interface")),
    ]
    return [(("paint", ours), theirs) for ours, theirs in found]


def find_expanded_place(content: Mapping[str, Any], place: Place) -> Place:
    """Where a number of a paint stands once expanded, else the same place. Raises SceneError without facets."""
    for ours, theirs in list_places(content):
        if place[: len(ours)] == ours:
            if ours[-1] == "surface" and not isinstance(content["paint"].get("surface"), dict):
                words = "changes facets, and the paint has none: give it a surface = { roughness = 0.1 } to begin with"
                raise SceneError(f"{show_place(place)} {words}", *place)
            return (*theirs, *place[len(ours) :])
    return place


@contextmanager
def locate_expanded_errors(content: Mapping[str, Any]) -> Iterator[None]:
    """Complaints about particles, layers or base of a paint or a material, as ones about what the file says of it."""
    try:
        yield
    except SceneError as error:
        place, words = error.place, str(error)
        for ours, theirs in list_places(content):
            if place[: len(theirs)] == theirs:
                there, here = show_place(theirs), show_place(ours)
                words = here + words.removeprefix(there) if words.startswith(there) else f"{here}: {words}"
                raise SceneError(words, *ours, *place[len(theirs) :]) from error
        for number, layer in list_named(content) if place[:1] == ("particles",) and len(place) > 1 else ():
            if str(place[1]).startswith(name_kind(layer["material"], "")):
                here = f"layer[{number + 1}].material = {show_toml(layer['material'])}"
                raise SceneError(f"{here}: {words}", "layer", number, "material") from error
        raise
