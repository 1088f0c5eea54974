"""How scenes come to the form, and leave it: files, links, what they lack filled in. Whoever sends one is a stranger.

A link carries a scene's TOML, compressed, in signs that an address takes.
"""

import base64
import copy
import zlib
from collections.abc import Iterator
from pathlib import Path

from vrte.app.form.checks import check, find_card, list_parts, repair_field, replace_parts
from vrte.app.form.content import START, Content, count_of, list_page_wavelengths
from vrte.app.form.fields import find_field, write_field_text
from vrte.basics.errors import SceneError
from vrte.formats.keys import make_start
from vrte.formats.layers import PHASES
from vrte.formats.materials import (
    ReadyMaterial,
    expand_materials,
    expand_paint,
    list_materials,
    list_named,
    list_paints,
)
from vrte.formats.scene_file import find_named_tables
from vrte.formats.toml_table import RANGE_KEYS, parse_toml, show_key, show_toml, write_toml

MOST_OF_AXIS = 10  # wavelengths that are taken of a sweep's
VISIBLE: Content = {"start": 0.43, "stop": 0.7, "count": 7}  # um: makes a colour, within the tables of all pigments
GREEN_UM = 0.55  # the wavelength that a ready material begins with
LONGEST_LINK = 200_000  # signs; browsers take no more than some 100 000 to 2 million
LARGEST_SCENE = 1_000_000  # bytes of a scene in a link, or that is opened


def adopt_with_notes(
    content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset(), aside: bool = False
) -> tuple[Content, tuple[str, ...]]:
    """The content of a file, checked, with what a form needs besides; and a sentence for each part that the file lacks
    or that the page cannot show. Raises SceneError.

    Files that it names, and that are not among ``tables`` in ``folder``, are still to be put in; ``aside``: what is
    made from those that are there is not looked at here.
    """
    found = expand_paint(copy.deepcopy(content))
    if "base" in found:  # which may be bare: the form shows a layer that light does not notice
        found.setdefault("layer", [{"phase": "isotropic", "albedo": 0.0, "thickness": 0.0}])
    notes = (*remove_axes(found), *add_defaults(found))
    trial = replace_parts(found, list(list_parts(found, tables)) if aside else ())
    missing = {index: name for index, name in find_named_tables(found).items() if name not in tables}
    asked_for = {index: name for index, name in missing.items() if find_field(index, found).label}
    for index in asked_for:
        repair_field(trial, find_card(index))
    check(trial, folder, tables)
    found = expand_materials(found, folder)  # the form shows particles, one by one
    here = "is not here: put it in where the form asks for it"
    notes += tuple(f"{show_toml(name)} {here}" for name in asked_for.values())
    found.setdefault("base", {"kind": "black"})
    for layer in found["layer"]:
        named = layer.get("phase")
        if isinstance(named, str) and named in PHASES:
            layer["phase"] = make_start(PHASES[named].keys) or named  # the same, with fields for what it begins with
    return found, notes


def begin_with_material(material: ReadyMaterial) -> tuple[Content, tuple[str, ...]]:
    """A scene of a ready material or paint, with all its numbers, and the sentences about its approximations."""
    light = {"wavelength_um": GREEN_UM, "brdf": copy.deepcopy(START["brdf"])}
    words = (material.description, *material.approximations)
    return adopt_with_notes(light | material.content)[0], tuple(text.rstrip(".") for text in words)


def list_films() -> dict[str, ReadyMaterial]:
    """Ready paints, and materials of which there is a film, by their titles."""
    films = [one for one in list_materials().values() if "thickness_um" in one.layer]
    known: list[ReadyMaterial] = [*list_paints().values(), *films]
    return {one.title: one for one in known}


def remove_axes(content: Content) -> Iterator[str]:
    """A sweep's template is one scene; of its axes, the wavelengths can be shown."""
    axes = content.pop("axes", None)
    if axes is None:
        return
    table = axes if isinstance(axes, dict) else {}
    along = table.get("wavelength_um")
    values = along.get("values") if isinstance(along, dict) else along
    if isinstance(along, dict) and set(along) == set(RANGE_KEYS):
        values = along | {"count": min(count_of(along), MOST_OF_AXIS)}
    elif isinstance(values, list):
        values = values[:: -(-len(values) // MOST_OF_AXIS)]
    if isinstance(values, (list, dict)) and values:
        content["wavelength_um"] = values
        if count_of(values) < count_of(along):
            yield f"axes.wavelength_um: {count_of(values)} of its {count_of(along)} wavelengths are taken"
    others = [show_key(name) for name in table if name != "wavelength_um" or "wavelength_um" not in content]
    if others or not table:
        yield f"axes: {', '.join(others)} stay as the template has them; `vrte sweep` computes them all"


def add_defaults(content: Content) -> Iterator[str]:
    """What a scene file for another command does not have."""
    if "brdf" not in content:
        content["brdf"] = copy.deepcopy(START["brdf"])
        yield "[brdf] is missing: directions all over the hemisphere are taken"
    if "wavelength_um" not in content and ("particles" in content or any(True for _ in list_named(content))):
        render = content.get("render")
        listed = render.get("wavelengths_um") if isinstance(render, dict) else None
        content["wavelength_um"] = copy.deepcopy(VISIBLE if listed is None else listed)
        yield f"wavelength_um is missing: {write_field_text(content['wavelength_um'])} is taken"


def parse_content(data: bytes) -> Content:
    """The content of a scene file, its bytes. Raises SceneError."""
    try:
        return parse_toml(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise SceneError(f"not a text file in UTF-8 (byte {error.start})") from error


def write_content(content: Content) -> str:
    """A scene file. Raises SceneError."""
    list_page_wavelengths(content)
    return write_toml(content)


def write_link(content: Content) -> str:
    """A scene's content as the end of an address, behind "#scene=". Raises SceneError where it is too long."""
    packed = base64.urlsafe_b64encode(zlib.compress(write_toml(content).encode(), 9)).decode().rstrip("=")
    if len(packed) > LONGEST_LINK:
        raise SceneError(
            f"the scene makes a link of {len(packed)} signs, and at most {LONGEST_LINK} work: download it instead"
        )
    return packed


def read_link(text: str) -> Content:
    """The content of a scene that a link carries. Raises SceneError for what is none, before it takes any memory."""
    if len(text) > LONGEST_LINK:
        raise SceneError(f"a link must have at most {LONGEST_LINK} signs, not {len(text)}")
    try:
        unpacker, packed = zlib.decompressobj(), base64.b64decode(text + "=" * (-len(text) % 4), "-_", validate=True)
        data = unpacker.decompress(packed, LARGEST_SCENE + 1)
        if len(data) > LARGEST_SCENE:
            raise SceneError(f"a scene in a link must have at most {LARGEST_SCENE} bytes")
        if not unpacker.eof:
            raise SceneError("the link is cut short")
        return parse_toml(data.decode())
    except SceneError:
        raise
    except (zlib.error, ValueError) as error:
        raise SceneError("the link holds no scene, or it is damaged") from error
