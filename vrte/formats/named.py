"""What a scene file names and does not hold: substances, and files beside it; whatever else is in it."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import BASES
from vrte.formats.columns import read_index
from vrte.formats.keys import TABLE, FilePath, Key, Substance
from vrte.formats.layers import SIDES
from vrte.formats.materials import SUFFIX
from vrte.formats.paints import expand_content, expand_paint
from vrte.formats.particle_sources import HOST, SOURCES
from vrte.formats.phases import PHASES
from vrte.formats.sizes import SIZES
from vrte.optics.refractive_index import find_wavelength_range

LAYER: dict[str, Key] = {"phase": FilePath(), "material": FilePath(suffixes=(SUFFIX,))}


def list_keys(content: Mapping[str, Any]) -> Iterator[tuple[Place, Key, Any]]:
    """Every key of a registry that a scene file's content gives: its place (of a paint, where it is expanded), what it
    is, and its value."""
    with suppress(SceneError):
        content = expand_paint(content)
    particles, layers = content.get("particles"), content.get("layer")
    yield from list_given((), content, HOST)
    for name, kind in particles.items() if isinstance(particles, dict) else ():
        place: Place = ("particles", name)
        for source in SOURCES.values():
            yield from list_given(place, kind, {**source.keys, **HOST})
        size: Any = kind.get("size") if isinstance(kind, dict) else None
        for word, row in SIZES.items() if isinstance(size, dict) else ():
            if word in row.keys:
                yield from list_given((*place, "size"), size, row.keys)
            else:
                yield from list_given((*place, "size", word), size.get(word), row.keys)
    for number, layer in enumerate(layers if isinstance(layers, list) else []):
        place = ("layer", number)
        yield from list_given(place, layer, {**LAYER, **HOST})
        if isinstance(layer, dict):
            yield from list_given((*place, "interface"), layer.get("interface"), SIDES)
            for phase in PHASES.values():
                yield from list_given((*place, "phase"), layer.get("phase"), phase.keys)
    for base in BASES.values():
        yield from list_given(("base",), content.get("base"), base.keys)


def list_given(place: Place, table: Any, keys: Mapping[str, Key]) -> Iterator[tuple[Place, Key, Any]]:
    """Those of the keys that a table has."""
    for name, key in keys.items() if isinstance(table, dict) else ():
        if name in table:
            yield (*place, name), key, table[name]


def list_materials(content: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Names of substances, and of tables of one's own, with the places of a scene file that have them.

    >>> layers = [{"interface": {"above": 1.0, "below": "water"}}]
    >>> list(list_materials({"particles": {"clay": {"index": "clay.csv"}}, "layer": layers}))
    [(('particles', 'clay', 'index'), 'clay.csv'), (('layer', 0, 'interface', 'below'), 'water')]
    """
    found = {place: value for place, key, value in list_keys(content) if isinstance(key, Substance)}
    return ((place, value) for place, value in found.items() if isinstance(value, str))


def find_named_tables(content: Mapping[str, Any]) -> dict[Place, str]:
    """The files that a scene file names, by the place that does.

    >>> layers = [{"phase": "fog.csv"}, {"phase": "rayleigh"}]
    >>> find_named_tables({"particles": {"clay": {"index": "clay.csv"}}, "layer": layers})
    {('particles', 'clay', 'index'): 'clay.csv', ('layer', 0, 'phase'): 'fog.csv'}
    """
    return {
        place: value
        for place, key, value in list_keys(content)
        if isinstance(value, str)
        and value.endswith(key.suffixes if isinstance(key, FilePath) else TABLE)
        and isinstance(key, (FilePath, Substance))
    }


def find_known_wavelengths(content: Mapping[str, Any], folder: Path = Path()) -> tuple[float, float, str]:
    """The wavelengths [um] from and to which all indices of a scene file are known, and the last substance that ends
    them; (0, inf, "") where none does. Indices that are wrong count as known. Raises OSError."""
    found = (0.0, math.inf, "")
    with suppress(SceneError):
        content = expand_content(content, folder)
    for _, index in list_materials(content):
        with suppress(SceneError):
            low, high = find_wavelength_range(read_index(folder / index) if index.endswith(TABLE) else index)
            if low > found[0] or high < found[1]:
                found = max(low, found[0]), min(high, found[1]), index
    return found
