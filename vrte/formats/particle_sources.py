"""Particles of a scene file: sources by the name that a table [particles.NAME] gives in ``source``, and their sizes.

A new source is two functions, of which one makes particles and the other only checks, and a row in `SOURCES`; a new
distribution of sizes is a class with a ``quadrature``, and a row in `SIZES` (docs/how_to/extending.md).
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from vrte.basics.errors import Place, SceneError
from vrte.formats.columns import read_sizes
from vrte.formats.keys import (
    WAVE_KEYS,
    FilePath,
    Key,
    Number,
    Numbers,
    Other,
    Reading,
    Row,
    Substance,
    find_given_as,
    list_names,
    make_of_keys,
    read_keys,
)
from vrte.formats.toml_table import Table, locate_errors, show_place
from vrte.optics.particles import Particles
from vrte.optics.shapes import check_cylinders, check_spheroids, cylinders, spheroids
from vrte.optics.size_distribution import Gamma, Lognormal, Tabulated
from vrte.optics.spheres import check_coated_spheres, check_spheres, coated_spheres, spheres

SIZE_KEYS = ("radius_um", "diameter_um", "size")
DIAMETERS = {"radius_um": "diameter_um", "median_um": "median_diameter_um", "r_eff_um": "d_eff_um"}
DIAMETER_LABELS = {"radius_um": "diameters [µm]", "median_um": "median diameter [µm]", "r_eff_um": "d_eff [µm]"}


def halve(value: Any) -> Any:
    """Half of a number, or of each of a list: radii of diameters."""
    return [0.5 * one for one in value] if isinstance(value, list) else 0.5 * value


MEDIAN, R_EFF, RADIUS = (Other(DIAMETERS[key], halve, "half of it, ") for key in ("median_um", "r_eff_um", "radius_um"))
SIZES: dict[str, Row] = {  # one with a key of its own name is written size = { name = value }
    "lognormal": Row(
        "lognormal",
        Lognormal,
        {"median_um": Number("median radius [µm]", 0.2, other=MEDIAN), "sigma": Number("sigma", 1.4)},
    ),
    "gamma": Row("gamma", Gamma, {"r_eff_um": Number("r_eff [µm]", 0.2, other=R_EFF), "v_eff": Number("v_eff", 0.07)}),
    "tabulated": Row(
        "tabulated",
        Tabulated,
        {
            "radius_um": Numbers("radii [µm]", [0.1, 0.2, 0.4], other=RADIUS),
            "density": Numbers("number density", [0.0, 1.0, 0.0]),
        },
    ),
    "table": Row("a table of sizes", lambda table: table, {"table": FilePath("file", open=read_sizes)}),
}
ONE: dict[str, Key] = {"radius_um": Number("radius [µm]", 0.3), "diameter_um": Number("diameter [µm]", 0.6)}


class Size(Key):
    """A key whose value is a distribution of sizes, one of `SIZES` with its own keys."""

    @property
    def inside(self) -> dict[str, Key]:
        return {name: row.keys[name] for name, row in SIZES.items() if name in row.keys}

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        size = table.table(name, tuple(SIZES))
        if len(size.content) != 1:
            raise table.wrong(name, f"must be exactly one of {', '.join(SIZES)}")
        (kind,) = size.content
        row = SIZES[kind]
        return make_of_keys(row, size if kind in row.keys else size.table(kind, list_names(row.keys)), reading)


SIZED: dict[str, Key] = {  # the keys of particles that say how large they are
    "radius_um": Number(allowed="a length in micrometres > 0", other=RADIUS, needed=False),
    "size": Size(needed=False),
}


SPHERES = "spheres"  # where a table names no source
INDEX = Substance("substance", "rutile")
HOST: dict[str, Key] = {"host_index": Substance(needed=False, hint="")}
COATED: dict[str, Key] = {
    "core": Substance("substance of the core", "rutile"),
    "shell": Substance("substance of the shell", "silica"),
    "shell_um": Number("thickness of the shell [µm]", hint="this, or one of the next two", needed=False),
    "core_ratio": Number("radius of the core over the whole", 0.8, needed=False),  # which goes with every size
    "core_radius_um": Number("radius of the core [µm]", needed=False),
}
WIDTH = Number("width over length along the axis", 1.5, hint="above 1 flat, below 1 long")
SHAPED: dict[str, Key] = {"index": INDEX, "aspect_ratio": WIDTH}
Compute = Callable[[str, dict[str, Any]], Particles]  # a source's name and its keywords: the particles


SOURCES: dict[str, Row] = {
    SPHERES: Row("spheres", spheres, {"index": INDEX}, check_spheres, sized=True),
    "coated-spheres": Row("coated spheres", coated_spheres, COATED, check_coated_spheres, sized=True),
    "spheroids": Row("spheroids", spheroids, SHAPED, check_spheroids, sized=True),
    "cylinders": Row("cylinders", cylinders, SHAPED, check_cylinders, sized=True),
}


def make_particles(source: str, given: dict[str, Any]) -> Particles:
    """The particles of a source, by its name and its keywords."""
    return call_source(SOURCES[source].make, **given)


def check_particles(source: str, given: dict[str, Any]) -> Particles:
    """Particles to go on with, all that makes them checked."""
    return call_source(SOURCES[source].check or SOURCES[source].make, **given)


def call_source(make: Callable[..., Particles], **given: Any) -> Particles:
    """What a function makes of the keys of a table, of which an ``index`` is its first argument."""
    first = [given.pop("index")] if "index" in given else []
    return make(*first, **given)


def describe_particles(source: str, given: dict[str, Any]) -> str:
    """A source and its keywords as a text that tells them from every other, to all digits."""
    return repr((source, sorted((name, describe_value(value)) for name, value in given.items())))


def describe_value(value: Any) -> Any:
    """A value as its ``repr`` tells it from every other: fields of a class, and numbers of an array, one by one."""
    if dataclasses.is_dataclass(value):
        return type(value).__name__, [describe_value(getattr(value, field.name)) for field in dataclasses.fields(value)]
    return value.tolist() if isinstance(value, np.ndarray) else value


class Kinds:
    """The particles of a file by name: all are checked at once, each is computed when a layer first asks for it."""

    def __init__(self, compute: Compute, reading: Reading) -> None:
        content = reading.file.content.get("particles", {})
        if not isinstance(content, dict) or not all(isinstance(kind, dict) for kind in content.values()):
            raise reading.file.wrong("particles", "must be tables headed [particles.NAME]")
        self.compute, self.reading = compute, reading
        self.tables = {name: self.read(("particles", name), kind) for name, kind in content.items()}
        self.computed: dict[str, Particles] = {}
        self.in_hosts: dict[tuple[str, str], tuple[int, Particles]] = {}

    def read(self, place: Place, content: dict[str, Any]) -> tuple[Table, str, dict[str, Any]]:
        """The table of a kind, its source and the values of its keys. Raises SceneError."""
        source = content.get("source", SPHERES)
        if not (isinstance(source, str) and source in SOURCES):
            raise Table(place, content, tuple(content)).wrong("source", f"must be {' or '.join(map(repr, SOURCES))}")
        row = SOURCES[source]
        table = Table(place, content, ("source", *row.keys, *(SIZE_KEYS if row.sized else ()), *HOST))
        values = read_keys(HOST, self.reading.file, self.reading) | read_keys(row.keys | HOST, table, self.reading)
        if row.sized:
            table.exactly_one(*SIZE_KEYS)
            values |= read_keys(SIZED, table, self.reading)
        return table, source, values

    def find(self, name: str, layer: Table) -> tuple[int, Particles]:
        """Particles of a name in the medium of a layer, computed once, and how many were computed before them."""
        place = (name, repr(layer.content.get("host_index")))
        if place not in self.in_hosts:
            found = self.make(*self.tables[name], layer)
            self.in_hosts[place] = len(self.in_hosts), found
            self.computed.setdefault(name, found)
        return self.in_hosts[place]

    def make(self, table: Table, source: str, values: dict[str, Any], layer: Table) -> Particles:
        """Particles in the medium of a layer, or of their own, or of the file: whichever says ``host_index`` first."""
        if "host_index" in layer and "host_index" in table:
            raise layer.wrong("host_index", f"{show_place(table.place)} has a host_index of its own: give it once")
        given = {"wavelength_um": self.reading.wavelength, **values, **read_keys(HOST, layer, self.reading)}
        outside = [key for key in WAVE_KEYS if key not in table]
        own = [key for key in table.allowed if key not in outside]
        try:
            with locate_errors(table.place, own, outside, find_given_as(SIZED, table)):
                return self.compute(source, given)
        except SceneError as error:
            if "host_index" in layer and error.place == ("host_index",):
                raise SceneError(str(error), *layer.place, "host_index") from error
            raise
