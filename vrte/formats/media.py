"""Refractive indices in a scene file, of particles, media and bases: numbers, pairs [n, k], names, tables of one's own.

A medium that light goes through may absorb a little: its absorption is counted, and refraction takes its index as real.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from vrte.basics.errors import SceneError
from vrte.formats.columns import read_index
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


def read_beside(table: Table, key: str, read: Callable[[Path], Read], folder: Path) -> Read:
    """What is in the file that a key names, beside the scene file."""
    try:
        return read(folder / table.content[key])
    except SceneError as error:
        raise table.wrong(key, str(error)) from error
    except OSError as error:
        raise table.wrong(key, f"the file cannot be read: {error.strerror}") from error
