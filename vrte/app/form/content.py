"""The content of a scene file as a form changes it: a plain dict, in which a field is named by its place."""

import math
from collections.abc import Mapping
from typing import Any

from vrte.basics.errors import Place, SceneError
from vrte.formats.bases import BASES
from vrte.formats.keys import Key, make_start
from vrte.formats.scene_file import ANGLES, REQUEST_KEYS, SceneFile, read_listed_wavelengths
from vrte.formats.toml_table import is_number
from vrte.results.spectrum import check_ascending

Content = dict[str, Any]

MOST_WAVELENGTHS = 40  # that a page shows
HUGE = 10**9
DEEPEST = 10.0  # optical depth down to which the field is shown where nothing is said

START: Content = {
    "wavelength_um": 0.64,
    "particles": {"gold": {"index": "gold", "radius_um": 0.6}},
    "layer": [{"particles": "gold", "thickness": 100.0}],
    "base": {"kind": "black"},
    "brdf": {
        "mu_i": {"start": 0.2, "stop": 1.0, "count": 9},
        "mu_o": {"start": 0.05, "stop": 1.0, "count": 20},
        "phi_deg": {"start": 0, "stop": 360, "count": 37},
    },
    "field": {"mu0": 0.6, "mu": {"start": -1.0, "stop": 1.0, "count": 120}, "phi_deg": [0, 180]},
}


def get_value(content: Content, place: Place) -> Any:
    """What is there, or None."""
    found: Any = content
    for step in place:
        try:
            found = found[step]
        except (KeyError, IndexError, TypeError):
            return None
    return found


def put(content: Content, place: Place, value: Any) -> None:
    """Sets what is at a place of a table, or of a list, that is there; None removes it."""
    table: Any = get_value(content, place[:-1])
    step: Any = place[-1]
    if isinstance(table, dict) and value is None:
        table.pop(step, None)
    elif isinstance(table, dict if isinstance(step, str) else list):  # it may have gone while somebody typed
        table[step] = value


def is_interface(layer: Content) -> bool:
    """Whether there is nothing but an interface between two media."""
    return "interface" in layer


def name_layers(layers: list[Content]) -> list[str]:
    """What layers are called, counted as messages about a file do it.

    >>> name_layers([{"interface": {}}, {"phase": "rayleigh"}])
    ['interface', 'layer 2']
    """
    return ["interface" if is_interface(layer) else f"layer {place}" for place, layer in enumerate(layers, 1)]


# base and directions


def set_base(content: Content, kind: str) -> None:
    """What lies beneath; what both kinds know of stays."""
    before = content.get("base", {})
    known = BASES[before["kind"]].keys if before.get("kind") in BASES else {}
    row = BASES[kind]
    content["base"] = {"kind": kind} | make_start(row.keys) | keep_values(before, known, row.keys)


def keep_values(table: Content, known: Mapping[str, Key], keys: Mapping[str, Key]) -> Content:
    """Those values of a table that mean the same among other keys.

    >>> keep_values({"index": 1.5}, BASES["mirror"].keys, BASES["facets"].keys)
    {'index': 1.5}
    """
    return {name: table[name] for name, key in keys.items() if name in table and known.get(name) == key}


def is_in_degrees(content: Content) -> bool:
    """Whether directions are told in degrees from the normal."""
    return any(key in content.get(kind, {}) for kind in REQUEST_KEYS for key in ANGLES.values())


def set_degrees(content: Content, degrees: bool) -> None:
    """Directions in degrees from the normal, or as cosines; a range keeps its ends and its number."""
    new = ANGLES if degrees else {key: name for name, key in ANGLES.items()}
    for kind in REQUEST_KEYS:
        if isinstance(content.get(kind), dict):
            content[kind] = {
                new.get(key, key): convert_angles(value, degrees) if key in new else value
                for key, value in content[kind].items()
            }


def convert_angles(value: Any, degrees: bool) -> Any:
    """Cosines as degrees, or degrees as cosines; what is neither stays.

    >>> convert_angles([0.5, 1.0], True), convert_angles({"start": 60, "stop": 0, "count": 3}, False)
    ([60.0, 0.0], {'start': 0.5, 'stop': 1.0, 'count': 3})
    """
    if isinstance(value, list):
        return [convert_angles(one, degrees) for one in value]
    if isinstance(value, dict):
        return {key: one if key == "count" else convert_angles(one, degrees) for key, one in value.items()}
    if not is_number(value) or not (0.0 < value <= 1.0 if degrees else 0.0 <= value < 90.0):
        return value
    angle = math.degrees(math.acos(value)) if degrees else math.cos(math.radians(value))
    return float(f"{angle:.6g}")


# what is asked of the library


def count_of(value: Any) -> int:
    """How many numbers a list or a range has; 1 for what is neither."""
    if isinstance(value, list):
        return max(1, len(value))
    count = value.get("count") if isinstance(value, dict) else 1
    return min(count, HUGE) if isinstance(count, int) and count > 0 else 1


def list_page_wavelengths(content: Content) -> list[float]:
    """The wavelengths [um], ascending; one where no particles need any. Raises SceneError for what are none."""
    value: Any = content.get("wavelength_um")
    if not isinstance(value, (list, dict)):
        return [value] if is_number(value) else [math.nan]
    try:
        if count_of(value) > MOST_WAVELENGTHS:
            raise SceneError(
                f"wavelength_um: the page takes at most {MOST_WAVELENGTHS} wavelengths, not {count_of(value)}"
            )
        return [
            float(one)
            for one in check_ascending(value if isinstance(value, list) else read_listed_wavelengths(content))
        ]
    except SceneError as error:
        raise SceneError(str(error), "wavelength_um") from error


def select_wavelength(content: Content, wavelength: float) -> Content:
    """The content of a scene file for one of the wavelengths."""
    several = isinstance(content.get("wavelength_um"), (list, dict))
    return {**content, "wavelength_um": wavelength} if several else content


def choose_keywords(file: SceneFile) -> Content:
    """The keywords of `vrte.brdf` or `vrte.radiance`; the depths of a field where nothing is said: five, evenly."""
    found = file.keywords({})
    if file.kind == "field" and "tau" not in found:
        bottom = min(file.scene.thickness, DEEPEST)
        found["tau"] = [bottom * step / 4.0 for step in range(5)]
    return found
