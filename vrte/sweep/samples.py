"""The appearance of each scene of a sweep: a panel at several wavelengths, and what a laboratory reads off it.

    [appearance]
    wavelengths_um = { start = 0.43, stop = 0.70, count = 10 }     # or as the file's wavelength_um lists them
    quantities = ["contrast_ratio", "L", "a", "b"]                 # any of `vrte.appearance.quantities.QUANTITIES`
    geometry = "45:0"                                              # and more of how it is looked at

Particles are worked out by whatever makes those of the sweep; each panel is solved as often as its quantities take.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.panel import Panel, choose_wavelengths, make_panel
from vrte.appearance.quantities import PARTS, QUANTITIES, Conditions, check_conditions, read_quantities
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.plan import make_request
from vrte.formats.contents import WAVELENGTH, Described, Kind
from vrte.formats.particle_sources import Compute
from vrte.formats.toml_table import Table, locate_errors, show_toml, suggest_nearest
from vrte.request.request import Request
from vrte.results.spectrum import check_ascending
from vrte.scene.scene import MOST_LAYERS
from vrte.sweep.results import Results, lay_out_results

TABLE = "appearance"
OTHERS = ("brdf", "field")  # tables of a scene file that ask for something else
OPTIONS = tuple(option.name for option in fields(Conditions))
KEYS = ("wavelengths_um", "layer", "quantities", *OPTIONS)
USUAL = ("contrast_ratio", "Y", "L", "a", "b")


@dataclass(frozen=True, eq=False)
class Asked:
    """What is read off each panel, all alike: ``wavelengths_um`` (n,), names of QUANTITIES, the conditions; ``layer``,
    counted from 1, says which layer is the film where there are several."""

    wavelengths_um: Array
    quantities: tuple[str, ...]
    conditions: Conditions
    layer: int | None = None

    @property
    def at_one(self) -> "Asked":
        """The same at a wavelength amid the others, to look at the form of a scene, or at what it costs."""
        middle = self.wavelengths_um.size // 2
        return replace(self, wavelengths_um=self.wavelengths_um[middle : middle + 1])

    @property
    def solves(self) -> int:
        """How many scenes of one wavelength each panel takes, roughly."""
        parts = {part for name in self.quantities for part in QUANTITIES[name].takes}
        return self.wavelengths_um.size * sum(PARTS[part] for part in parts)


@dataclass(frozen=True, eq=False)
class Sample:
    """The panel at a place of the grid, and what is read off it."""

    panel: Panel
    asked: Asked

    def read(self) -> Mapping[str, Array | float]:
        """The quantities by name. Raises SceneError, AccuracyError."""
        return read_quantities(self.panel, self.asked.quantities, self.asked.conditions)

    def make_request(self) -> Request:
        """What is solved of it at the first of its wavelengths, again and again, to foretell how long it takes."""
        how = {**self.panel.asked, "threads": 1, "time_limit_s": np.inf}
        return make_request("brdf", self.panel.scenes[0], mu_i=np.cos(np.pi / 4.0), mu_o=1.0, **how)


def read_asked(template: Mapping[str, Any], folder: Path) -> Asked:
    """What the table [appearance] of a sweep file asks for, alike of all scenes. Raises SceneError."""
    file = Table((), dict(template), tuple(template))
    table = file.table(TABLE, KEYS)
    for other in OTHERS:
        if other in file:
            raise SceneError(f"{other}: a table holds one kind of result: leave out [{other}] or [{TABLE}]", other)
    names = read_names(table)
    for name in (*OPTIONS, "layer"):
        if name in table and not any(name in QUANTITIES[one].uses for one in names):
            raise table.wrong(name, f"none of the quantities depends on it: {', '.join(names)}")
    layer = table.whole("layer", 1, MOST_LAYERS) if "layer" in table else None
    with locate_errors(table.place, KEYS):
        wavelengths = check_ascending(read_wavelengths(file, table, folder))
        conditions = Conditions(**{name: table.content[name] for name in OPTIONS if name in table})
        check_conditions(names, conditions, wavelengths)
    return Asked(wavelengths, names, conditions, layer)


def read_wavelengths(file: Table, table: Table, folder: Path) -> Sequence[float] | Array:
    """Of the table, of the file, or of its substances. Raises SceneError."""
    if "wavelength_um" in file:
        if not isinstance(file.content["wavelength_um"], (list, dict)):
            raise file.wrong("wavelength_um", f"an appearance is of several: list them in {TABLE}.wavelengths_um")
        if "wavelengths_um" in table:
            raise table.wrong("wavelengths_um", "the file lists others as wavelength_um: leave one of the two out")
    return table.numbers("wavelengths_um") if "wavelengths_um" in table else choose_wavelengths(file.content, folder)


def read_names(table: Table) -> tuple[str, ...]:
    """The quantities, by default USUAL."""
    allowed = f"a list of some of {', '.join(QUANTITIES)}"
    given = table.content.get("quantities", USUAL)
    if not isinstance(given, (list, tuple)) or not given:
        raise table.wrong("quantities", f"must be {allowed}")
    for name in given:
        if name not in tuple(QUANTITIES):
            hint = suggest_nearest(name, QUANTITIES) if isinstance(name, str) else ""
            raise table.wrong("quantities", f"{show_toml(name)} is none{hint}. It must be {allowed}")
        if given.count(name) > 1:
            raise table.wrong("quantities", f"{show_toml(name)} is there twice")
    return tuple(given)


def make_sample(content: dict[str, Any], folder: Path, asked: Asked, compute: Compute) -> Sample:
    """The panel of a scene's content, its particles made by ``compute``. Raises SceneError."""
    alone = {key: value for key, value in content.items() if key not in (TABLE, "wavelength_um")}
    return Sample(make_panel(alone, asked.wavelengths_um, folder, layer=asked.layer, compute=compute), asked)


def describe_sample(asked: Asked) -> Results:
    """What each scene brings: numbers, and spectra over the wavelengths."""
    rows = {name: QUANTITIES[name] for name in asked.quantities}
    variables = {name: Described(row.dims, row.units, row.long_name) for name, row in rows.items()}
    kind = Kind(TABLE, TABLE, {"wavelength_um": WAVELENGTH}, variables)
    return lay_out_results(kind, {"wavelength_um": asked.wavelengths_um}, (), (), {})
