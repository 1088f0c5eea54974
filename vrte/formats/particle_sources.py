"""Sources of particles, by the name that a table [particles.NAME] of a scene file gives in ``source``.

A new source is a maker and a row in `SOURCES` (docs/extending.md); scene files, sweeps and spectra then know it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from vrte.formats.media import ONE_WAVELENGTH, WAVE_KEYS, check_material, find_clear_index, read_material
from vrte.formats.toml_table import Table, locate_errors
from vrte.optics.particles import Particles
from vrte.optics.size_distribution import Gamma, Lognormal

Make = Callable[[], Particles]
SIZES: dict[str, tuple[Callable[..., Lognormal | Gamma], tuple[str, ...]]] = {
    "lognormal": (Lognormal, ("median_um", "sigma")),
    "gamma": (Gamma, ("r_eff_um", "v_eff")),
}
DIAMETERS = {"radius_um": "diameter_um", "median_um": "median_diameter_um", "r_eff_um": "d_eff_um"}
SIZE_KEYS = ("radius_um", "diameter_um", "size")
HALVED = {name: (key, "half of it, ") for name, key in DIAMETERS.items()}  # who is told of the one wrote the other
SPHERES = "spheres"  # where a table names no source


class Source(NamedTuple):
    """``keys`` of its table beside ``source``; ``check`` reads the table (of a file, in a folder), refuses what is
    wrong there, and returns what makes the particles when a layer first asks for them; ``spheres_of`` is called like
    `vrte.spheres`; ``example``: a table that it takes, for tests."""

    keys: tuple[str, ...]
    check: Callable[[Table, Table, Callable[..., Particles], Path], Make]
    example: dict[str, Any]


def check_source(
    file: Table, name: str, content: dict[str, Any], spheres_of: Callable[..., Particles], folder: Path
) -> Make:
    """What makes the particles of one table [particles.NAME]: by the source that it names, its keys checked."""
    given = content.get("source", SPHERES)
    if not (isinstance(given, str) and given in SOURCES):
        table = Table(("particles", name), content, tuple(content))
        raise table.wrong("source", f"must be {' or '.join(map(repr, SOURCES))}")
    source = SOURCES[given]
    return source.check(file, Table(("particles", name), content, ("source", *source.keys)), spheres_of, folder)


def check_spheres_table(file: Table, table: Table, spheres_of: Callable[..., Particles], folder: Path) -> Make:
    """Homogeneous spheres: an index, and a radius or a size distribution, in the file's host medium or their own."""
    check_material(table, "index")
    table.exactly_one(*SIZE_KEYS)
    size, around = _read_size(table), table if "host_index" in table else file
    if "host_index" in around:
        check_material(around, "host_index")

    def made() -> Particles:
        light = {"wavelength_um": file.number("wavelength_um", ONE_WAVELENGTH)}
        if "host_index" in around:
            light["host_index"] = find_clear_index(file, around, "host_index", folder)
        material = read_material(table, "index", folder)
        outside = [key for key in WAVE_KEYS if key not in table]
        keys = [key for key in table.allowed if key not in outside]
        with locate_errors(table.place, keys, outside, HALVED if "diameter_um" in table else {}):
            return spheres_of(material, **light, **size)

    return made


def _read_size(table: Table) -> dict[str, Any]:
    """The keyword of ``spheres`` that says how large the particles are."""
    for key, factor in (("radius_um", 1.0), ("diameter_um", 0.5)):
        if key in table:
            return {"radius_um": factor * table.number(key, f"a {key.removesuffix('_um')} in micrometres > 0")}
    size = table.table("size", tuple(SIZES))
    if len(size.content) != 1:
        raise table.wrong("size", f"must be exactly one of {', '.join(SIZES)}")
    (name,) = size.content
    distribution, keys = SIZES[name]
    radius, diameter = keys[0], DIAMETERS[keys[0]]
    numbers = size.table(name, (*keys, diameter))
    numbers.not_both(radius, diameter)
    values = {key: numbers.number(key) for key in keys if key != radius or diameter not in numbers}
    if diameter in numbers:
        values[radius] = 0.5 * numbers.number(diameter)
    with locate_errors(numbers.place, numbers.allowed, said=HALVED if diameter in numbers else {}):
        return {"size": distribution(**values)}


SOURCES: dict[str, Source] = {
    SPHERES: Source(("index", *SIZE_KEYS, "host_index"), check_spheres_table, {"index": [1.5, 0.0], "radius_um": 0.1}),
}
