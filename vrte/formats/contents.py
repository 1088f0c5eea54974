"""What the result files hold, whatever their format, as contents.toml declares it: names, dimensions, units, meanings.

From the declaration follow the labelled data set, what every format writes and reads, and the result from it.
"""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError, import_extra
from vrte.results.brdf import BRDF_DERIVATIVES, SCENE, Brdf, Spectrum
from vrte.results.field import FIELD_DERIVATIVES, Field, Views
from vrte.results.photons import Photons
from vrte.results.quantities import MUELLER, STOKES

if TYPE_CHECKING:
    import xarray

Result = Brdf | Field | Spectrum
MEANINGLESS = (LookupError, TypeError, ValueError, AttributeError, RecursionError)  # what a strange file raises
LARGEST_RESULT = 2e9  # bytes of values in memory, unless a caller allows more
LABELLED = "a labelled or NetCDF result"
CF = "CF-1.11"
DECLARED: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
CONVENTIONS: str = DECLARED["conventions"]


@dataclass(frozen=True)
class Described:
    """One array of a file: dimensions, unit (UDUNITS), meaning, columns of a table, CF's standard name or None."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    columns: tuple[str, ...] = ()
    standard_name: str | None = None

    @property
    def attributes(self) -> dict[str, str]:
        """Units and name of the array, by their CF attributes."""
        standard = {"standard_name": self.standard_name} if self.standard_name else {}
        return {"units": self.units, "long_name": self.long_name} | standard

    @property
    def is_derivative(self) -> bool:
        """Whether the array has the dimension of derivatives in front."""
        return self.dims[:1] == (PARAMETER,)

    def along(self, axis: str) -> "Described":
        """The same with one more dimension in front of all others but that of derivatives."""
        first = int(self.is_derivative)
        return replace(self, dims=(*self.dims[:first], axis, *self.dims[first:]))

    def name_columns(self, derivatives: int) -> list[str]:
        """The columns of so many derivatives, d1_ before those of the first; else those of the array itself."""
        if not self.is_derivative:
            return [*self.columns]
        return [f"d{number}_{column}" for number in range(1, derivatives + 1) for column in self.columns]


@dataclass(frozen=True)
class Kind:
    """One kind of result: its name, what it is called, its coordinates and its variables."""

    name: str
    title: str
    coordinates: dict[str, Described]
    variables: dict[str, Described]

    @property
    def arrays(self) -> dict[str, Described]:
        """Coordinates and variables together."""
        return self.coordinates | self.variables


STOKES_AXIS = "stokes_parameter"  # "stokes" is a variable: no dimension with labels may be called so too
MATRIX = ("stokes_out", "stokes_in")
PARAMETER = "parameter"  # the dimension of derivatives, labelled by the names of the numbers
NAMES = "derivatives"  # the attribute that lists these names, as JSON
TEXTS = ("kind", "diagnostics", SCENE, NAMES)  # the attributes that make a result
DERIVED = ("specular_reflectance", "total_reflectance")  # from other variables: in files for who reads them elsewhere
COLUMNS = {  # of the arrays that are rows of a table: elements f00 to f33, t00 to t33, s00 to s33; I to V
    **{name: tuple(one.replace("f", name[0]) for one in MUELLER) for name in ("transmission", "surface")},
    "mueller": tuple(MUELLER),
    "stokes": tuple(STOKES),
}
WAVELENGTH = Described(("wavelength_um",), "um", "wavelength in vacuum", standard_name="radiation_wavelength")


def make_kind(name: str, derivatives: dict[str, str]) -> Kind:
    """The kind of that name, and ``derivatives``, each of one of its variables."""
    axes, found = (
        {
            key: Described(**row | {"dims": tuple(row["dims"])}, columns=COLUMNS.get(key, ()))
            for key, row in rows.items()
        }
        for rows in (DECLARED[name]["coordinates"], DECLARED[name]["variables"])
    )
    for key, value in derivatives.items():
        words = f"derivatives of {value} by each number of {PARAMETER}, per unit of the number"
        found[key] = replace(found[value].along(PARAMETER), long_name=words)
    return Kind(name, DECLARED[name]["title"], axes, found)


def add_axis(kind: Kind, name: str, title: str, axis: str, about: Described, shared: tuple[str, ...] = ()) -> Kind:
    """The kind of several such results along an axis, which all but their coordinates and ``shared`` variables have."""
    several = {key: of if key in shared else of.along(axis) for key, of in kind.variables.items() if key != axis}
    return Kind(name, f"{kind.title}{title}", {axis: about, **kind.coordinates}, several)


BRDF = make_kind("brdf", BRDF_DERIVATIVES)
SPECTRUM = add_axis(BRDF, "spectrum", " at several wavelengths", "wavelength_um", WAVELENGTH)
FIELD = make_kind("field", FIELD_DERIVATIVES)
BEAM_COSINES = Described(("mu0",), "1", "cosine of each beam's angle of incidence")
FIELDS = add_axis(FIELD, "fields", ", for several beams", "mu0", BEAM_COSINES, ("index", "incident_stokes"))
KINDS = {kind.name: kind for kind in (BRDF, FIELD, FIELDS, SPECTRUM)}
ARRAYS = {name for kind in KINDS.values() for name in kind.arrays}


def find_kind(result: Result) -> Kind:
    """The kind of a result."""
    if isinstance(result, Field):
        return FIELD if isinstance(result.mu0, float) else FIELDS
    if not isinstance(result, Brdf | Spectrum):
        raise SceneError(f"a result must be a Brdf, a Field or a Spectrum, not {type(result).__name__}")
    return BRDF if isinstance(result, Brdf) else SPECTRUM


def collect_arrays(result: Result) -> dict[str, Any]:
    """All coordinates and variables that a result has, by their names in files."""
    kind = find_kind(result)
    found = {name: getattr(result, name.removesuffix("_deg")) for name in kind.arrays}
    left_out = DERIVED if found.get("specular") is None else ()
    return {
        name: np.stack([*values.values()]) if isinstance(values, dict) else values
        for name, values in found.items()
        if values is not None and name not in left_out
    }


def describe_result(result: Result) -> dict[str, str]:
    """What else a file says: title, source, comment, ``diagnostics`` as JSON, and the scene file where it is known."""
    from vrte import __version__

    every = [one.diagnostics for one in result] if isinstance(result, Spectrum) else [result.diagnostics]
    scene = every[0].get(SCENE)
    texts = {
        "title": f"Polarized {find_kind(result).title}",
        "source": f"vrte {__version__}, vector radiative transfer",
        "comment": CONVENTIONS,
        "kind": find_kind(result).name,
    }
    if names := list(result.jacobian or ()):
        texts[NAMES] = convert_to_json(names)
    if isinstance(scene, str) and all(one.get(SCENE) == scene for one in every):
        texts[SCENE] = scene
        every = [{name: value for name, value in one.items() if name != SCENE} for one in every]
    return texts | {"diagnostics": convert_to_json(every if isinstance(result, Spectrum) else every[0])}


def convert_to_json(value: Any) -> str:
    """JSON in one line of ASCII, every digit of every number. Raises SceneError for what has no place in it."""
    try:
        return json.dumps(value)
    except (TypeError, ValueError, RecursionError) as error:
        raise SceneError(f"diagnostics must be what JSON can hold: {explain_error(error)}") from error


def explain_error(error: Exception) -> str:
    """The message of another library in one line, cut where it is long."""
    return put_in_one_line(f"{type(error).__name__}: {error}", 200)


def read_kind(texts: Mapping[str, str]) -> tuple[Kind, list[str]]:
    """The kind that a file's texts name, and the different names of derivatives. Raises SceneError."""
    if texts.get("kind") not in KINDS:
        raise SceneError(f"it must say its kind, one of {', '.join(KINDS)}")
    names = json.loads(texts.get(NAMES, "[]"))
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names) and len({*names}) == len(names)):
        raise SceneError(f"its {NAMES} must be a list of different names")
    return KINDS[texts["kind"]], names


def restore_result(texts: Mapping[str, str], arrays: Mapping[str, Any]) -> Result:
    """The result of the texts of `describe_result` and arrays. Raises SceneError or another of MEANINGLESS."""
    (kind, names), diagnostics = read_kind(texts), json.loads(texts["diagnostics"])
    if kind is SPECTRUM:
        if len(diagnostics) != len(arrays["wavelength_um"]):
            raise SceneError("there must be diagnostics for each wavelength")
        brdfs: list[Any] = []
        for k, one in enumerate(diagnostics):
            indices = {name: (slice(None),) * about.is_derivative + (k,) for name, about in kind.variables.items()}
            here = {name: values[indices.get(name, ...)] for name, values in arrays.items()}
            brdfs.append(restore_result({**texts, "kind": BRDF.name, "diagnostics": json.dumps(one)}, here))
        return Spectrum(arrays["wavelength_um"], tuple(brdfs))
    found: dict[str, Any] = {}
    for name, about in kind.arrays.items():
        if name in arrays and name not in DERIVED:
            values = arrays[name]
            values = dict(zip(names, values, strict=True)) if about.is_derivative else values
            found[name.removesuffix("_deg")] = values
    if kind is FIELD:
        found["mu0"] = float(found["mu0"].item())
    scene = {SCENE: texts[SCENE]} if SCENE in texts else {}
    return (Brdf if kind is BRDF else Field)(**found, diagnostics=diagnostics | scene)


def check_size(size: float, most_bytes: float) -> None:
    """Raises SceneError, which says how to go on, where a result takes more memory than it may."""
    if size > most_bytes:
        raise SceneError(
            f"its values take {size / 1e9:.3g} GB, more than the {most_bytes / 1e9:.3g} GB that are read: "
            f"if you trust it, vrte.load(path, most_bytes={-(-size // 1e9):.0f}e9)"
        )


def to_xarray(result: Result) -> "xarray.Dataset":
    """A labelled copy of ``result``, each variable with ``units`` and ``long_name``. Raises MissingExtraError."""
    xarray = import_extra("xarray", LABELLED, "files")
    kind, arrays = find_kind(result), collect_arrays(result)
    about = {name: (of.dims, arrays[name], of.attributes) for name, of in kind.arrays.items() if name in arrays}
    data = {name: about[name] for name in kind.variables if name in about}
    coords: dict[str, Any] = {name: about[name] for name in kind.coordinates}
    labels = (STOKES_AXIS,) if "stokes" in kind.variables else MATRIX
    coords |= {axis: (axis, list(STOKES), {"long_name": "Stokes parameter"}) for axis in labels}
    if names := list(result.jacobian or ()):
        coords[PARAMETER] = PARAMETER, names, {"long_name": "number of the scene that derivatives are by"}
    steps = [np.diff(arrays[name]) for name in kind.coordinates]
    monotonic = all(np.all(step > 0.0) or np.all(step < 0.0) for step in steps)  # as CF demands
    attributes = ({"Conventions": CF} if monotonic else {}) | describe_result(result)
    return xarray.Dataset(data, coords, attributes).copy(deep=True)


def convert_views(views: Views) -> "xarray.Dataset":
    """A labelled copy of the Stokes vectors of single geometries, ``stokes`` (geometry, stokes_parameter)."""
    about = {name: of.attributes for name, of in FIELD.arrays.items()}
    rows = {"mu0": views.mu0, "mu": views.mu, "phi_deg": views.phi}
    coords: dict[str, Any] = {name: ("geometry", values, about[name]) for name, values in rows.items()}
    coords |= {STOKES_AXIS: list(STOKES), "tau": ((), views.tau, about["tau"])}
    coords |= {} if views.index is None else {"index": ((), views.index, about["index"])}
    data = {"stokes": (("geometry", STOKES_AXIS), views.stokes, about["stokes"])}
    return import_extra("xarray", LABELLED, "files").Dataset(data, coords).copy(deep=True)


def convert_photons(photons: Photons) -> "xarray.Dataset":
    """A labelled copy of fluxes (mu_i, tau, mu, phi_deg, stokes_out, stokes_in), bins by their middles."""
    middles = {"mu": photons.mu_edges, "phi_deg": photons.phi_edges}
    coords: dict[str, Any] = {"mu_i": photons.mu_i, "tau": photons.tau, "stokes_out": list(STOKES)}
    coords |= {"stokes_in": list(STOKES)} | {name: 0.5 * (edges[1:] + edges[:-1]) for name, edges in middles.items()}
    beam, matrix = ("mu_i", "tau"), ("stokes_out", "stokes_in")
    data: dict[str, Any] = {"absorbed": (("mu_i", "layer"), photons.absorbed)}
    data |= {name: ("mu_i", getattr(photons, name)) for name in ("lost", "balance")}
    for name in ("up", "down"):
        for part, dims in ((name, (*beam, *middles, *matrix)), (f"beam_{name}", (*beam, *matrix))):
            data |= {each: (dims, getattr(photons, each)) for each in (part, f"{part}_error")}
    data = {name: (*given, {"units": "1"}) for name, given in data.items()}
    return import_extra("xarray", LABELLED, "files").Dataset(data, coords).copy(deep=True)
