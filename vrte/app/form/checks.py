"""What is wrong with a scene, in the library's words and in milliseconds, by the field that it is about; and how scenes
come to the form, and leave it: files, links, what they lack filled in. Whoever sends one is a stranger.

Parts that are made from files, a phase matrix or a base, are read in a process of their own, once each: the checks put
something simple in their place. A link carries a scene's TOML, compressed, in signs that an address takes.
"""

import base64
import copy
import math
import warnings
import zlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from vrte.app.form import content as form
from vrte.app.form.content import START, Content, count_of, list_page_wavelengths
from vrte.app.form.fields import find_field, get_value, write_field_text
from vrte.basics.errors import Place, SceneError
from vrte.calls.plan import make_request
from vrte.formats.keys import FilePath, make_start
from vrte.formats.layers import PHASES
from vrte.formats.materials import (
    ReadyMaterial,
    expand_materials,
    expand_paint,
    list_materials,
    list_named,
    list_paints,
)
from vrte.formats.particle_sources import check_particles
from vrte.formats.scene_file import ANGLES, find_named_tables, list_keys, make_scene_file
from vrte.formats.toml_table import RANGE_KEYS, is_number, parse_toml, show_key, show_place, show_toml, write_toml
from vrte.optics.phase_matrix import MOST_TERMS, count_henyey_greenstein_terms

WAITS = "the file is being read"
PLAIN_LAYER: Content = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
PLAIN_BASE: Content = {"kind": "lambertian", "albedo": 0.5}


@dataclass(frozen=True)
class PartRead:
    """A part that was made from a file, described in ``words``, or a ``message`` about what is wrong at a place."""

    words: str = ""
    message: str = ""
    place: Place = ()
    follows = False  # as `vrte.app.solving.worker.Message` has it


def list_parts(content: Content, names: Collection[str]) -> Iterator[Place]:
    """The parts that are made from files of such names: a base, or the phase function of a layer."""
    for place, key, value in list_keys(content):
        aside = place[0] == "base" or place[2:3] == ("phase",)
        if aside and isinstance(key, FilePath) and isinstance(value, str) and value in names:
            yield place[:1] if place[0] == "base" else place[:3]


def select_part(content: Content, place: Place) -> Content:
    """A scene of that part alone, whose messages are about the same places."""
    layers = [dict(PLAIN_LAYER) for _ in content["layer"]]
    if place[0] == "layer":
        layer = content["layer"][place[1]]
        layers[int(place[1])] |= {key: layer[key] for key in ("phase", "tolerance") if key in layer}
    base = content["base"] if place[0] == "base" else {"kind": "black"}
    found = {"layer": layers, "base": base, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
    return found | {key: content[key] for key in ("wavelength_um",) if key in content}


def name_part(content: Content, place: Place) -> str:
    """A name of all that a part is made from; a file never changes under its name."""
    layer = get_value(content, place[:-1]) if place[0] == "layer" else {}
    return repr((get_value(content, place), layer.get("tolerance"), content.get("wavelength_um")))


def replace_parts(content: Content, places: Collection[Place]) -> Content:
    """The same content with something simple in place of those parts."""
    found = copy.deepcopy(content)
    for place in places:
        if place[0] == "base":
            found["base"] = dict(PLAIN_BASE)
        else:
            layer: Any = found["layer"][place[1]]
            layer["phase"] = PLAIN_LAYER["phase"]
            layer.pop("tolerance", None)
    return found


MOST_DIRECTIONS = 10_000
LARGEST_RESULT = 2e8  # bytes
MOST_ROUNDS = 40  # fields that are wrong at once
DIRECTIONS = {"brdf": ("mu_i", "mu_o", "phi_deg"), "field": ("tau", "mu", "phi_deg")}
BYTES_EACH = {"brdf": 128.0, "field": 32.0}


def find_problems(
    content: Content,
    folder: Path = Path(),
    tables: frozenset[str] = frozenset(),
    parts_read: Mapping[str, PartRead] | None = None,
) -> dict[Place, str]:
    """Messages of the library by the place that they are about, () for none; empty where all is well.

    A field that is wrong is replaced in a copy by what is right, and the check goes on. ``parts_read``: the known
    parts that are made from files, by `name_part`; None: they are read here.
    """
    parts = list(dict.fromkeys(list_parts(content, tables))) if parts_read is not None else []
    waits = {place: PartRead(message=f"{show_place(place)}: {WAITS}", place=place) for place in parts}
    read = [(parts_read or {}).get(name_part(content, place), waits[place]) for place in parts]
    found = {one.place: one.message for one in read if one.message}
    repaired: set[Place] = set()
    trial = replace_parts(content, parts)
    for _ in range(MOST_ROUNDS):
        try:
            check(trial, folder, tables)
            break
        except SceneError as error:
            place, message = error.place, str(error)
        if place[:-1] and not find_field(place, trial).label and find_field(place[:-1], trial).label:
            place = place[:-1]  # of the start, stop or count of a range
        if not any(one[: len(place)] == place for one in found):  # what is wrong with a part of it is found already
            found[place] = message
        if not place or find_card(place) in repaired:
            break
        if place in repaired:  # what is right by itself does not go with the others
            place = find_card(place)
        repair_field(trial, place)
        repaired.add(place)
    return found


def repair_field(content: Content, place: Place) -> None:
    """Puts in something right, or nothing; a layer in place of an interface, whose indices must fit its neighbours."""
    place = place[:2] if place[2:3] == ("interface",) else place
    if place[2:3] == ("phase",):
        form.put(content, (*place[:2], "tolerance"), None)  # which goes with a file alone
    kinds = content.get("particles")
    kind = next(iter(kinds), "") if isinstance(kinds, dict) else ""
    held = {"particles": kind, "volume_fractions": {kind: 0.01}}
    whole = held.get(str(place[2])) if place[0] == "layer" and len(place) == 3 else None
    form.put(content, place, copy.deepcopy(find_field(place, content).start) if whole is None else whole)


def find_card(place: Place) -> Place:
    """The layer, the kind of particles or the base that a place is in."""
    return place[: 1 if place[0] == "base" else 2]


def check(content: Content, folder: Path = Path(), tables: frozenset[str] = frozenset()) -> None:
    """Everything that can be checked in milliseconds. Raises SceneError, with its place.

    ``tables`` in ``folder`` are the only files that a scene may name: who sits before a page must not read others.
    """
    check_amount(content)
    wavelengths = form.list_page_wavelengths(content)
    check_tables(content, tables)
    layers = content.get("layer")
    if isinstance(layers, list):
        content = {**content, "layer": [keep_one_term(layer) for layer in layers]}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # they come with the result
        # tables are ranges: the first and the last wavelength will do
        for wavelength, kind in product(dict.fromkeys((wavelengths[0], wavelengths[-1])), ("brdf", "field")):
            if kind == "brdf" or kind in content:
                file = make_scene_file(form.select_wavelength(content, wavelength), kind, folder, check_particles)
                keywords = form.choose_keywords(file)
                if any(form.is_geometric(layer) for layer in content["layer"]):
                    keywords.pop("tau", None)  # how deep that is optically is not known yet
                with file.located():
                    make_request("brdf" if kind == "brdf" else "radiance", file.scene, **keywords)


def keep_one_term(layer: Any) -> Any:
    """The layer with one term of a Henyey-Greenstein function that may have all of its own: 1e5 of them take 2 s."""
    phase = layer.get("phase") if isinstance(layer, dict) else None
    g: Any = phase.get("henyey_greenstein") if isinstance(phase, dict) else None
    if phase is None or not is_number(g):
        return layer
    terms = phase.get("terms", count_henyey_greenstein_terms(g))
    fine = isinstance(terms, int) and not isinstance(terms, bool) and 1 <= terms <= MOST_TERMS
    return {**layer, "phase": {**phase, "terms": 1}} if fine else layer


def check_amount(content: Content) -> None:
    """Whether a page can show it."""
    limits = ("layer", form.MOST_LAYERS, "layers"), ("particles", form.MOST_KINDS, "kinds of particles")
    for key, most, word in limits:
        count = len(content[key]) if isinstance(content.get(key), (list, dict)) else 0
        if count > most:
            raise SceneError(f"{key}: the page shows at most {most} {word}, not {count}; `vrte brdf` takes more", key)
    wavelengths = form.count_of(content.get("wavelength_um"))
    for kind, keys in DIRECTIONS.items():
        table = content.get(kind)
        if not isinstance(table, dict):
            continue
        for key in ("mu0", ANGLES["mu0"]):
            if kind == "field" and form.count_of(table.get(key)) > 1:
                raise SceneError(f"field.{key}: the page shows one beam; `vrte field` takes more", kind, key)
        names = [ANGLES[key] if ANGLES.get(key) in table else key for key in keys]
        counts = {key: form.count_of(table.get(key, 0.0)) for key in names}
        for key, count in counts.items():
            if count > MOST_DIRECTIONS:
                words = f"the page takes at most {MOST_DIRECTIONS} of them, not {count:.3g}"
                raise SceneError(f"{kind}.{key}: {words}", kind, key)
        needed = math.prod(counts.values()) * BYTES_EACH[kind] * wavelengths
        if needed > LARGEST_RESULT:
            product, limit = " x ".join(map(str, counts.values())), f"at most {LARGEST_RESULT / 1e9:g} GB"
            words = f"{product} directions make {needed / 1e9:.3g} GB; the page takes {limit}: ask for fewer"
            raise SceneError(f"{kind}: {words}; `vrte {kind}` takes more", kind)


def check_tables(content: Content, tables: frozenset[str]) -> None:
    """Whether a scene names no file but those, and every one that it needs."""
    for place, key, value in list_keys(content):
        if isinstance(key, FilePath) and value == "":
            raise SceneError(f"{show_place(place)} needs a file ({' or '.join(key.suffixes)})", *place)
    for place, name in find_named_tables(content).items():
        if name not in tables:
            raise SceneError(
                f"{show_place(place)} = {show_toml(name)}: a page reads no files of the machine that it runs on; put "
                "it in here, or start `vrte view` with this scene",
                *place,
            )


MOST_OF_AXIS = 10  # wavelengths that are taken of a sweep's
VISIBLE: Content = {"start": 0.4, "stop": 0.7, "count": 9}  # um: makes a colour, within the pigments' tables
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
