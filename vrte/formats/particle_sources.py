"""Sources of particles, by the name that a table [particles.NAME] of a scene file gives in ``source``.

A new source is two functions, of which one makes particles and the other only checks, and a row in `SOURCES`
(docs/how_to/extending.md); scene files, sweeps, spectra and the viewer then know it.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.errors import SceneError
from vrte.formats.keys import SUBSTANCE_HINT, Key, Number, Reading, Substance, check_keys, read_keys
from vrte.formats.media import ONE_WAVELENGTH, WAVE_KEYS, check_material, read_material
from vrte.formats.sizes import HALVED, SIZE_KEYS, read_size
from vrte.formats.toml_table import Table, locate_errors
from vrte.optics.particles import Particles
from vrte.optics.shapes import check_cylinders, check_spheroids, cylinders, spheroids
from vrte.optics.spheres import check_coated_spheres, check_spheres, coated_spheres, spheres

SPHERES = "spheres"  # where a table names no source


class Source(NamedTuple):
    """``words`` of a form; what makes the particles, and what only checks them and gives back some to go on with, both
    called with ``wavelength_um``, ``host_index`` where there is one, the values of the keys by their names and, where
    it is ``sized``, ``radius_um`` or ``size``; the keys."""

    words: str
    make: Callable[..., Particles]
    check: Callable[..., Particles]
    keys: dict[str, Key]
    sized: bool = True

    @property
    def allowed(self) -> tuple[str, ...]:
        """All keys of its table."""
        return ("source", *self.keys, *(SIZE_KEYS if self.sized else ()), "host_index")


def put_index_first(make: Callable[..., Particles]) -> Callable[..., Particles]:
    """The same function, called with the key ``index`` of a table for its first argument."""
    return lambda index, **how: make(index, **how)


INDEX = Substance("substance", "rutile", hint=SUBSTANCE_HINT)
COATED: dict[str, Key] = {
    "core": Substance("substance of the core", "rutile", hint=SUBSTANCE_HINT),
    "shell": Substance("substance of the shell", "silica", hint=SUBSTANCE_HINT),
    "shell_um": Number("thickness of the shell [µm]", hint="this, or one of the next two", needed=False),
    "core_ratio": Number("radius of the core over the whole", 0.8, needed=False),  # which goes with every size
    "core_radius_um": Number("radius of the core [µm]", needed=False),
}
WIDTH = Number("width over length along the axis", 1.5, hint="above 1 flat, below 1 long")
SHAPED: dict[str, Key] = {"index": INDEX, "aspect_ratio": WIDTH}
SOURCES: dict[str, Source] = {
    SPHERES: Source("spheres", put_index_first(spheres), put_index_first(check_spheres), {"index": INDEX}),
    "coated-spheres": Source("coated spheres", coated_spheres, check_coated_spheres, COATED),
    "spheroids": Source("spheroids", put_index_first(spheroids), put_index_first(check_spheroids), SHAPED),
    "cylinders": Source("cylinders", put_index_first(cylinders), put_index_first(check_cylinders), SHAPED),
}
Compute = Callable[[str, dict[str, Any]], Particles]  # a source's name and its keywords: the particles
Make = Callable[[Table], Particles]  # the same, of the layer that they lie in


def make_particles(source: str, given: dict[str, Any]) -> Particles:
    """The particles of a source, by its name and its keywords.

    >>> make_particles("spheres", {"index": 1.5, "radius_um": 0.1, "wavelength_um": 0.5}).albedo
    1.0
    """
    return SOURCES[source].make(**given)


def check_particles(source: str, given: dict[str, Any]) -> Particles:
    """Particles to go on with, all that makes them checked."""
    return SOURCES[source].check(**given)


def describe_value(value: Any) -> Any:
    """A value as its ``repr`` tells it from every other: fields of a class, and numbers of an array, one by one."""
    if dataclasses.is_dataclass(value):
        return type(value).__name__, [describe_value(getattr(value, field.name)) for field in dataclasses.fields(value)]
    return value.tolist() if isinstance(value, np.ndarray) else value


def prepare_particles(name: str, content: dict[str, Any], compute: Compute, reading: Reading) -> Make:
    """What makes the particles of one table [particles.NAME] in a layer: by the source that it names, its keys checked.

    They lie in the medium of the layer, or of their own, or of the file: whichever says ``host_index`` first.
    """
    given = content.get("source", SPHERES)
    if not (isinstance(given, str) and given in SOURCES):
        table = Table(("particles", name), content, tuple(content))
        raise table.wrong("source", f"must be {' or '.join(map(repr, SOURCES))}")
    source = SOURCES[given]
    table = Table(("particles", name), content, source.allowed)
    check_keys(source.keys, table)
    if source.sized:
        table.exactly_one(*SIZE_KEYS)
    size = read_size(table, reading) if source.sized else {}
    for around in (table, reading.file):
        if "host_index" in around:
            check_material(around, "host_index")

    def made(layer: Table) -> Particles:
        keywords: dict[str, Any] = {"wavelength_um": reading.file.number("wavelength_um", ONE_WAVELENGTH)}
        around = next((one for one in (layer, table, reading.file) if "host_index" in one), None)
        if around is layer and "host_index" in table:
            raise layer.wrong("host_index", f"particles.{name} has a host_index of its own: give it once")
        if around is not None:
            keywords["host_index"] = read_material(around, "host_index", reading.folder)
        keywords |= read_keys(source.keys, table, reading) | size
        outside = [key for key in WAVE_KEYS if key not in table]
        keys = [key for key in table.allowed if key not in outside]
        try:
            with locate_errors(table.place, keys, outside, HALVED if "diameter_um" in table else {}):
                return compute(given, keywords)
        except SceneError as error:
            if around is layer and error.place == ("host_index",):
                raise SceneError(str(error), *layer.place, "host_index") from error
            raise

    return made
