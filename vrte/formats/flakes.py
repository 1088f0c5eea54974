"""Oriented flakes of a scene file: the table ``flakes`` of a [[layer]], and what it makes (`vrte.flakes`)."""

from collections.abc import Iterator
from typing import Any

from vrte.basics.errors import Place
from vrte.formats.keys import WAVE_KEYS, Flag, Key, Number, Numbers, Reading, Substance, list_names, read_keys
from vrte.formats.toml_table import Table, is_number, locate_errors
from vrte.optics.flakes import Flakes, flakes

FILM = Substance("substance of a film")
ROWS = 'a list of films from the outside in, each a substance and its thickness in micrometres: [["silica", 0.3]]'


class Stack(Key):
    """Thin films, from the outside in."""

    def read(self, table: Table, name: str, reading: Reading) -> list[tuple[Any, float]]:
        value = table.content[name]
        rows = value if isinstance(value, list) else [None]
        if not all(isinstance(row, list) and len(row) == 2 and is_number(row[1]) for row in rows):
            raise table.wrong(name, f"must be {ROWS}")
        films = [Table((*table.place, name, k), {"material": row[0]}, ("material",)) for k, row in enumerate(rows)]
        return [(FILM.read(film, "material", reading), float(row[1])) for film, row in zip(films, rows, strict=True)]


def list_films(place: Place, stack: Any) -> Iterator[tuple[Place, Key, Any]]:
    """The substances of films: place, key and value, whatever else is there."""
    for k, row in enumerate(stack if isinstance(stack, list) else []):
        if isinstance(row, list) and row:
            yield (*place, k, 0), FILM, row[0]


TILTS: dict[str, Key] = {
    "angle_deg": Numbers("tilts [°]", [0.0, 10.0, 30.0]),
    "density": Numbers("density of normals", [1.0, 0.6, 0.0]),
}


class Tilts(Key):
    """A table of the density of normals over their tilt."""

    inside = TILTS

    def read(self, table: Table, name: str, reading: Reading) -> tuple[list[float], list[float]]:
        values = read_keys(TILTS, table.table(name, list_names(TILTS)), reading)
        return values["angle_deg"], values["density"]


FLAKES: dict[str, Key] = {
    "index": Substance("core", "aluminium", hint="a name, or n, k; none: perfect mirrors", needed=False),
    "substrate": Substance("substrate of clear plates", "mica", hint="in place of a core", needed=False),
    "transparent": Flag("let light through", hint="true with a substrate, or left out", needed=False),
    "tilt_deg": Number("tilt σ [°]", 12.0, hint="0.5 to 60", needed=False),
    "stack": Stack("films from the outside in", needed=False),
    "tilts": Tilts("a table in place of tilt σ", needed=False),
}


class FlakeTable(Key):
    """The flakes of a layer, as arguments of `vrte.flakes`."""

    inside = FLAKES

    def read(self, table: Table, name: str, reading: Reading) -> dict[str, Any]:
        values = read_keys(FLAKES, table.table(name, list_names(FLAKES)), reading)
        return values | ({"wavelength_um": reading.wavelength} if WAVE_KEYS[0] in reading.file else {})


def make_flakes(values: dict[str, Any], host_index: Any, layer: Table) -> Flakes:
    """The flakes of a layer's table in a medium. Raises SceneError."""
    with locate_errors((*layer.place, "flakes"), list_names(FLAKES), WAVE_KEYS):
        return flakes(**values, host_index=host_index)
