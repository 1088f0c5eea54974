"""What is wrong with a scene, in the library's words and in milliseconds, by the field that it is about.

Parts that are made from files, a phase matrix or a base, are read in a process of their own, once each: the checks put
something simple in their place."""

import copy
import math
import warnings
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from vrte.app.form import content as form
from vrte.app.form.content import Content
from vrte.app.form.fields import find_field, get_value
from vrte.basics.errors import Place, SceneError
from vrte.calls.plan import make_request
from vrte.formats.keys import FilePath
from vrte.formats.particle_sources import check_particles
from vrte.formats.scene_file import ANGLES, find_named_tables, list_keys, make_scene_file
from vrte.formats.toml_table import is_number, show_place, show_toml
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
