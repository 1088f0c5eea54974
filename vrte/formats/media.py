"""Refractive indices in a scene file, of particles, media and bases: numbers, pairs [n, k], names, tables of one's own.

The index of a medium that light goes through is real: what absorbs without particles is nothing that is solved here.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from vrte.basics.errors import Place, SceneError
from vrte.formats.index_table import read_index
from vrte.formats.toml_table import Table, is_number, locate_errors
from vrte.optics.refractive_index import Material, refractive_index

Read = TypeVar("Read")
TABLE = ".csv"  # the suffix of tables of one's own
WAVE_KEYS = ("wavelength_um", "host_index")  # of the light, for all particles
ONE_WAVELENGTH = "the wavelength in micrometres; a list is for spectra: `vrte brdf`, `vrte view`, `vrte.spectrum`"
INDEX = (
    'the name of a material, a path in the database such as "main/Au/Johnson", the path of a .csv with the columns '
    "wavelength_um (or wavelength_nm), n, k, or [n, k]"
)
CLEAR = 1e-6  # k of a medium up to which it counts as clear: what is reflected there notices no more of it


def check_material(table: Table, key: str) -> str | tuple[float, float]:
    """The name or the pair n, k at a key that must be there. Raises SceneError for another form."""
    value = table.required(key, INDEX)
    if isinstance(value, str):
        return value
    parts = value if isinstance(value, list) else [value, 0.0]
    if len(parts) != 2 or not all(is_number(part) for part in parts):
        raise table.wrong(key, f"must be {INDEX}")
    return float(parts[0]), float(parts[1])


def read_material(table: Table, key: str, folder: Path) -> Material:
    """The same, tables of one's own beside the scene file read."""
    material = check_material(table, key)
    own = isinstance(material, str) and material.endswith(TABLE)
    return read_beside(table, key, read_index, folder) if own else material


def find_index(file: Table, table: Table, key: str, folder: Path) -> complex:
    """n + ik of the material at a key, at the file's wavelength, which numbers do without. Raises SceneError."""
    material = read_material(table, key, folder)
    if isinstance(material, tuple):
        return complex(*material)
    wavelength = file.number("wavelength_um", ONE_WAVELENGTH)
    with locate_errors(table.place, table.allowed, WAVE_KEYS, {"index": (key, None)}):
        return refractive_index(material, wavelength).value


def find_clear_index(file: Table, table: Table, key: str, folder: Path) -> float:
    """The real index of the medium at a key. Raises SceneError where it absorbs."""
    index = find_index(file, table, key, folder)
    if not 0.0 <= index.imag <= CLEAR:
        raise table.wrong(
            key,
            f"its index is {index.real:.6g} + {index.imag:.3g}i, and light goes through media with k from 0 to "
            f'{CLEAR:g} only; what absorbs can be the base, kind = "mirror"',
        )
    return index.real


def read_beside(table: Table, key: str, read: Callable[[Path], Read], folder: Path) -> Read:
    """What is in the file that a key names, beside the scene file."""
    try:
        return read(folder / table.content[key])
    except SceneError as error:
        raise table.wrong(key, str(error)) from error
    except OSError as error:
        raise table.wrong(key, f"the file cannot be read: {error.strerror}") from error


def list_materials(content: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Names of materials, and of tables of one's own, with the places of a scene file that have them, whatever else is
    in it.

    >>> layers = [{"interface": {"above": 1.0, "below": "water"}}]
    >>> list(list_materials({"particles": {"clay": {"index": "clay.csv"}}, "layer": layers}))
    [(('particles', 'clay', 'index'), 'clay.csv'), (('layer', 0, 'interface', 'below'), 'water')]
    """
    kinds, layers = content.get("particles"), content.get("layer")
    named = kinds.items() if isinstance(kinds, dict) else ()
    places: list[tuple[Place, Any]] = [((), content)]
    places += [(("particles", name), kind) for name, kind in named]
    for number, layer in enumerate(layers if isinstance(layers, list) else []):
        places.append((("layer", number, "interface"), layer.get("interface") if isinstance(layer, dict) else None))
    places.append((("base",), content.get("base")))
    for place, table in places:
        for key in ("host_index", "index", "above", "below") if isinstance(table, dict) else ():
            if isinstance(table.get(key), str):
                yield (*place, key), table[key]
