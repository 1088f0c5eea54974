"""What each scene of a sweep brings: a BRDF, the field of one beam or several, or the appearance of a panel.

[appearance]
wavelengths_um = { start = 0.43, stop = 0.70, count = 10 }     # or as the file's wavelength_um lists them
quantities = ["contrast_ratio", "L", "a", "b"]                 # any of `vrte.appearance.quantities.QUANTITIES`
geometry = "45:0"                                              # and more of how the panel is looked at
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.hiding import Conditions
from vrte.appearance.panel import Panel, choose_wavelengths
from vrte.appearance.quantities import PARTS, QUANTITIES, check_conditions, read_quantities
from vrte.basics.arrays import Array, check_vector
from vrte.basics.errors import SceneError
from vrte.calls.brdf import make_brdf
from vrte.calls.plan import make_request
from vrte.calls.radiance import make_field
from vrte.formats.contents import BRDF, DERIVED, FIELDS, PARAMETER, STOKES_AXIS, WAVELENGTH, Described, Kind
from vrte.formats.scene_file import SceneFile
from vrte.formats.toml_table import Table, locate_errors, show_toml, suggest_nearest
from vrte.request.how import EXACT
from vrte.request.request import Request, make_brdf_request, make_radiance_request
from vrte.results.brdf import Brdf, check_ascending
from vrte.results.field import Field
from vrte.results.result import Solution
from vrte.scene.scene import MOST_LAYERS

TABLE = "appearance"
OTHERS = ("brdf", "field")  # tables of a scene file that ask for something else
OPTIONS = tuple(option.name for option in fields(Conditions))
KEYS = ("wavelengths_um", "layer", "quantities", *OPTIONS)
USUAL = ("contrast_ratio", "Y", "L", "a", "b")
OF_BEAMS = ("specular", *DERIVED)  # variables of scenes with a smooth surface
OF_MEDIA = ("direct_up", "index")  # variables of fields where light is refracted
ALGORITHM = "direct"  # that of vrte.brdf, without those that have a tolerance: no engine's numbers differ
RESERVED = {  # names that no axis can have; those of light of surfaces neither where a table has them
    *("error", "checksum", "chunk", "stokes_out", "stokes_in", STOKES_AXIS),
    *(name for kind in (BRDF, FIELDS) for name in (*kind.coordinates, *kind.variables)),
} - {*OF_BEAMS, *OF_MEDIA, "specular_transmission", "surface"}


@dataclass(frozen=True, eq=False)
class Results:
    """``coordinates`` (n,) that all scenes share, ``variables`` of each scene with dimensions and shape, ``labels``:
    dimensions of Stokes parameters, ``constants`` of the whole table with dimensions and values."""

    kind: Kind
    coordinates: dict[str, Array]
    variables: dict[str, tuple[tuple[str, ...], tuple[int, ...]]]
    labels: tuple[str, ...]
    constants: dict[str, tuple[tuple[str, ...], Array]]

    @property
    def bytes_of_a_scene(self) -> int:
        return sum(8 * math.prod(shape) for _, shape in self.variables.values())


def make_scene_request(file: SceneFile, backend: str | None = None) -> Request:
    """The request of a scene, of a backend that its precision goes with unless one is given. Raises SceneError."""
    usual = "openmp" if file.options.get("precision", "auto") == "auto" else "opencl"
    how = {"algorithm": ALGORITHM, "backend": backend or usual} | file.options
    if how.get("method", EXACT) != EXACT:
        raise SceneError(f"method = {show_toml(how['method'])}: a sweep is made by {EXACT!r} alone", "method")
    with file.located():
        if file.kind == "brdf":
            return make_brdf_request(file.scene, **file.request, **how, time_limit_s=math.inf)
        if "mu" not in file.request:
            words = "is missing: all scenes of a table share their directions; mu = [] asks for fluxes alone"
            raise SceneError.of("mu", words)
        return make_radiance_request(file.scene, **file.request, **how, time_limit_s=math.inf)


def make_result(request: Request, directions: Array, solution: Solution) -> Brdf | Field:
    """The result that the solution of a request is."""
    if request.kind == "brdf":
        return make_brdf(request, solution)
    found = make_field(request, directions, solution)
    if found.index is not None:
        return found
    # one medium: other scenes of the table may have several
    index = np.full(found.tau.size, request.scene.index_above)
    return replace(found, index=index, direct_up=np.zeros_like(found.direct))


def describe_results(file: SceneFile, roughnesses: set[float], has_rough_interfaces: bool = False) -> Results:
    """The results of a sweep by its first scene, without its particles, and all scenes' roughnesses."""
    if file.kind == "brdf":
        request = make_scene_request(file)
        assert request.mu is not None
        coordinates = {"mu_i": request.mu0, "mu_o": request.mu[request.mu > 0.0], "phi_deg": request.phi}
        left_out: tuple[str, ...] = ()
        if request.tau.size == 1 or 0.0 not in roughnesses:
            left_out += ("specular_transmission",)
        left_out += () if request.tau.size > 1 else ("transmission",)  # the bottom, too
        left_out += () if 0.0 in roughnesses else OF_BEAMS
        left_out += () if has_rough_interfaces else ("surface",)
        left_out += () if request.coherent else ("coherent",)
        return lay_out_results(BRDF, coordinates, left_out, ("stokes_out", "stokes_in"))
    # the depth of a scene depends on its particles: each scene checks its own tau
    alone = {name: value for name, value in file.request.items() if name != "side"}
    request = make_scene_request(replace(file, request=alone | {"tau": 0.0}))
    incident = np.asarray(file.request.get("stokes", (1.0, 0.0, 0.0, 0.0)), np.float64)
    coordinates = {"mu0": request.mu0, "tau": check_vector("tau", file.request.get("tau", 0.0))}
    left_out = ("incident_stokes", *(("stokes",) if request.fluxes_only else ()), *(() if roughnesses else OF_MEDIA))
    if not request.fluxes_only:
        assert request.mu is not None
        up = -1.0 if request.illuminate == "bottom" else 1.0  # such a request is that of the scene upside down
        coordinates |= {"mu": up * request.mu, "phi_deg": request.phi}
    found = lay_out_results(FIELDS, coordinates, left_out, (STOKES_AXIS,))
    return replace(found, constants={"incident_stokes": ((STOKES_AXIS,), incident)})


def lay_out_results(
    kind: Kind, coordinates: dict[str, Array], left_out: tuple[str, ...], labels: tuple[str, ...]
) -> Results:
    """Results with the shapes of their variables."""
    lengths = {name: values.size for name, values in coordinates.items()} | dict.fromkeys(labels, 4)
    variables = {
        name: (about.dims, tuple(lengths[dim] for dim in about.dims))
        for name, about in kind.variables.items()
        if name not in left_out and PARAMETER not in about.dims  # of derivatives there are none
    }
    return Results(kind, coordinates, variables, labels, {})


@dataclass(frozen=True, eq=False)
class AskedAppearance:
    """The table [appearance]: ``wavelengths_um`` (n,), QUANTITIES, conditions; ``layer``: the film, from 1."""

    wavelengths_um: Array
    quantities: tuple[str, ...]
    conditions: Conditions
    layer: int | None = None

    @property
    def at_one(self) -> "AskedAppearance":
        """The same at the middle wavelength alone, to look at the form of a scene, or at what it costs."""
        middle = self.wavelengths_um.size // 2
        return replace(self, wavelengths_um=self.wavelengths_um[middle : middle + 1])

    @property
    def solves(self) -> int:
        """Number of solves of one wavelength for each panel, roughly."""
        parts = {part for name in self.quantities for part in QUANTITIES[name].takes}
        return self.wavelengths_um.size * sum(PARTS[part] for part in parts)

    def describe(self) -> Results:
        """The results of each panel: numbers, and spectra over the wavelengths."""
        rows = {name: QUANTITIES[name] for name in self.quantities}
        variables = {name: Described(row.dims, row.units, row.long_name) for name, row in rows.items()}
        kind = Kind(TABLE, TABLE, {"wavelength_um": WAVELENGTH}, variables)
        return lay_out_results(kind, {"wavelength_um": self.wavelengths_um}, (), ())


@dataclass(frozen=True, eq=False)
class Sample:
    """The panel at a place of the grid, and what is read off it."""

    panel: Panel
    asked: AskedAppearance

    def read(self) -> Mapping[str, Array | float]:
        """The quantities by name. Raises SceneError, AccuracyError."""
        return read_quantities(self.panel, self.asked.quantities, self.asked.conditions)

    def make_request(self) -> Request:
        """One of the panel's solves, at the first of its wavelengths, to predict the time of all."""
        how = {**self.panel.asked, "threads": 1, "time_limit_s": np.inf}
        return make_request("brdf", self.panel.scenes[0], mu_i=np.cos(np.pi / 4.0), mu_o=1.0, **how)


def read_asked(template: Mapping[str, Any], folder: Path) -> AskedAppearance:
    """The table [appearance] of a sweep file, the same for all scenes. Raises SceneError."""
    file = Table((), dict(template), tuple(template))
    table = file.table(TABLE, KEYS)
    for other in OTHERS:
        if other in file:
            raise SceneError(f"{other}: a table holds one kind of result: leave out [{other}] or [{TABLE}]", other)
    if "wavelength_um" in file and not isinstance(file.content["wavelength_um"], (list, dict)):
        raise file.wrong("wavelength_um", f"an appearance is of several: list them in {TABLE}.wavelengths_um")
    if "wavelength_um" in file and "wavelengths_um" in table:
        raise table.wrong("wavelengths_um", "the file lists others as wavelength_um: leave one of the two out")
    names = read_names(table)
    for name in (*OPTIONS, "layer"):
        if name in table and not any(name in QUANTITIES[one].uses for one in names):
            raise table.wrong(name, f"none of the quantities depends on it: {', '.join(names)}")
    layer = table.whole("layer", 1, MOST_LAYERS) if "layer" in table else None
    with locate_errors(table.place, KEYS):
        listed = table.numbers("wavelengths_um") if "wavelengths_um" in table else None
        wavelengths = check_ascending(choose_wavelengths(file.content, folder) if listed is None else listed)
        conditions = Conditions(**{name: table.content[name] for name in OPTIONS if name in table})
        check_conditions(names, conditions, wavelengths)
    return AskedAppearance(wavelengths, names, conditions, layer)


def read_names(table: Table) -> tuple[str, ...]:
    """Names of the quantities, by default USUAL."""
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
