"""What a scene file names and does not hold: substances, and files beside it; whatever else is in it."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import BASES
from vrte.formats.columns import read_index
from vrte.formats.keys import TABLE, FilePath, Key, Substance, join_rows
from vrte.formats.layers import LAYER
from vrte.formats.paints import expand_content, expand_paint
from vrte.formats.particle_sources import HOST, SIZED, SOURCES
from vrte.optics.refractive_index import find_wavelength_range


def list_keys(content: Mapping[str, Any]) -> Iterator[tuple[Place, Key, Any]]:
    """Every key of a registry that a scene file's content gives: its place (of a paint, where it is expanded), what it
    is, and its value."""
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
    """Those of the keys that a table has, and those of the tables below it."""
    for name, key in keys.items() if isinstance(table, dict) else ():
        if name in table:
            yield (*place, name), key, table[name]
            yield from list_given((*place, name), table[name], key.inside)


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
    """The wavelengths [um] from and to which all indices of a scene file are known, and the last substance that ends
    them; (0, inf, "") where none does. Indices that are wrong count as known. Raises OSError."""
    found = (0.0, math.inf, "")
    with suppress(SceneError):
        content = expand_content(content, folder)
    for _, index in list_substances(content):
        with suppress(SceneError):
            low, high = find_wavelength_range(read_index(folder / index) if index.endswith(TABLE) else index)
            if low > found[0] or high < found[1]:
                found = max(low, found[0]), min(high, found[1]), index
    return found
