"""Numbers of a scene file by their keys, which sweeps, fits and derivatives change; one may act on several layers."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vrte.basics.errors import Place, SceneError
from vrte.formats.materials import find_expanded_place
from vrte.formats.toml_table import find_number, put, show_place, show_toml, split_key

SEVERAL = re.compile(r"""layer\[(?:(\d{1,9}):(\d{1,9})|([A-Za-z_-][\w-]*|"[^"]*"|'[^']*'))\]\.(.+)""")
TOTALS = ("thickness", "thickness_um")  # of several layers: the sum, of which each layer keeps its part


@dataclass(frozen=True)
class SceneNumber:
    """One number of a scene file: its ``value``, the ``places`` where it stands, and the ``parts`` of it there."""

    places: tuple[Place, ...]
    value: float
    parts: tuple[float, ...] = (1.0,)

    def put(self, content: dict[str, Any], value: float) -> None:
        """Sets the number in the content of its file."""
        for place, part in zip(self.places, self.parts, strict=True):
            number = float(value * part)  # what counts something is a whole one
            put(content, place, int(number) if number.is_integer() else number)


def find_places(content: Mapping[str, Any], key: str, given: Mapping[str, Any]) -> tuple[Place, ...]:
    """Where the number of a key stands in ``content``, which is ``given`` with its paint expanded: at one place, or in
    several layers, layer[2:5].albedo, or in those of a kind of particles, layer[dust].thickness. Raises SceneError."""
    several = SEVERAL.fullmatch(key)
    if not several:
        return (find_expanded_place(given, split_key(key)),)
    kind, below, shown = (several[3] or "").strip("\"'"), split_key(several[4]), show_toml(key)
    layers = content.get("layer")
    tables = layers if isinstance(layers, list) and all(isinstance(table, dict) for table in layers) else []
    if several[3]:
        found = [index for index, table in enumerate(tables) if kind in list_kinds(table)]
        mixed = [index for index in found if len(list_kinds(tables[index])) > 1]
        if not found:
            raise SceneError(f"{shown}: no layer holds particles {show_toml(kind)}")
        if mixed and below == ("thickness",):
            words = f"holds other particles too, which have one thickness with {show_toml(kind)}"
            raise SceneError(f"{shown}: layer[{mixed[0] + 1}] {words}")
    else:
        first, last = int(several[1]), int(several[2])
        if not 1 <= first <= last <= len(tables):
            raise SceneError(f"{shown}: a range of layers must ascend, from 1 at least to {len(tables)} at most")
        at_interfaces = below[0] == "interface"
        found = [index for index in range(first - 1, last) if ("interface" in tables[index]) == at_interfaces]
        if not found:
            raise SceneError(f"{shown}: there are only {'layers' if at_interfaces else 'interfaces'}")
    return tuple(("layer", index, *below) for index in found)


def list_kinds(layer: Mapping[str, Any]) -> list[str]:
    """The kinds of particles that the table of a layer names, unchecked."""
    held = layer.get("particles", layer.get("volume_fractions", {}))
    return [held] if isinstance(held, str) else [*held] if isinstance(held, dict) else []


def find_scene_number(
    content: Mapping[str, Any], key: str, places: tuple[Place, ...], default: float | None = None
) -> SceneNumber:
    """The number of a key at its places, ``default`` where a table has none. Raises SceneError that names the key."""
    if len(places) == 1:
        return SceneNumber(places, find_number(content, places[0], key, default))
    values = [find_number(content, place, show_place(place), default) for place in places]
    if places[0][-1] in TOTALS:
        total = math.fsum(values)
        if not 0.0 < total < math.inf:
            raise SceneError(f"{show_toml(key)} is {total:g} in all, and only a finite sum above 0 can be scaled")
        return SceneNumber(places, total, tuple(value / total for value in values))
    for place, value in zip(places, values, strict=True):
        if value != values[0]:
            words = f"{show_place(places[0])} is {values[0]:g} and {show_place(place)} is {value:g}"
            raise SceneError(f"{show_toml(key)}: {words}; one number for several layers must be the same in all")
    return SceneNumber(places, values[0], (1.0,) * len(places))


def share_places(numbers: list[SceneNumber]) -> bool:
    """Whether two of the numbers stand at the same place."""
    places = [place for number in numbers for place in number.places]
    return len(set(places)) < len(places)
