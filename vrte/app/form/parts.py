"""Parts of a scene that are made from files, a phase matrix or a base: read in a process of their own, once each.

The page's checks, many a second, put something simple in their place; what has been said of them stands at their field.
"""

import copy
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vrte.app.form.content import Content, get_value
from vrte.basics.errors import Place
from vrte.formats.keys import FilePath
from vrte.formats.named import list_keys
from vrte.formats.toml_table import show_place

WAITS = "the file is being read"
PLAIN_LAYER: Content = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
PLAIN_BASE: Content = {"kind": "lambertian", "albedo": 0.5}


@dataclass(frozen=True)
class Said:
    """What there is to say of a part that is made from a file: ``words`` about it, or a ``message`` about a place."""

    words: str = ""
    message: str = ""
    place: Place = ()
    follows = False  # as `vrte.app.solving.messages.Message` has it


def list_parts(content: Content, names: Collection[str]) -> Iterator[Place]:
    """The parts that are made from files of such names.

    >>> layers = [{"phase": "isotropic"}, {"phase": "fog.csv", "albedo": 1.0, "thickness": 1.0}]
    >>> list(list_parts({"layer": layers}, {"fog.csv"}))
    [('layer', 1, 'phase')]
    """
    for place, key, value in list_keys(content):
        aside = place[0] == "base" or place[2:3] == ("phase",)
        if aside and isinstance(key, FilePath) and isinstance(value, str) and value in names:
            yield place[:1] if place[0] == "base" else place[:3]


def select_part(content: Content, place: Place) -> Content:
    """A scene of that part alone, whose messages are about the same places."""
    layers = [dict(PLAIN_LAYER) for _ in content["layer"]]
    base: Content = {"kind": "black"}
    if place[0] == "base":
        base = content["base"]
    else:
        layer = content["layer"][place[1]]
        layers[int(place[1])] |= {key: layer[key] for key in ("phase", "tolerance") if key in layer}
    found = {"layer": layers, "base": base, "brdf": {"mu_i": 0.5, "mu_o": 0.5}}
    return found | {key: content[key] for key in ("wavelength_um",) if key in content}


def name_part(content: Content, place: Place) -> str:
    """All that decides what comes of a part; a file never changes under its name."""
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


def list_messages(content: Content, places: Collection[Place], said: Mapping[str, Said]) -> Iterator[tuple[Place, str]]:
    """What is wrong with parts, or that they are still being read."""
    for place in places:
        found = said.get(name_part(content, place))
        if found is None:
            yield place, f"{show_place(place)}: {WAITS}"
        elif found.message:
            yield found.place, found.message
