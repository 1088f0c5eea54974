"""What the result files hold, whatever their format, declared once: names, dimensions, units, meanings.

From the declaration follow the labelled data set, what every format writes and reads, and the result from it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError, import_extra
from vrte.results.brdf import BRDF_DERIVATIVES, Brdf
from vrte.results.field import FIELD_DERIVATIVES, Field
from vrte.results.quantities import MUELLER, STOKES
from vrte.results.spectrum import SCENE, Spectrum
from vrte.results.views import Views

if TYPE_CHECKING:
    import xarray

Result = Brdf | Field | Spectrum
MEANINGLESS = (LookupError, TypeError, ValueError, AttributeError, RecursionError)  # what a strange file raises
LARGEST_RESULT = 2e9  # bytes of values in memory, unless a caller allows more
LABELLED = "a labelled or NetCDF result"
RADIANCE, IRRADIANCE = "W m-2 sr-1", "W m-2"
CF = "CF-1.11"
CONVENTIONS = (
    "phi_deg is outgoing minus incident azimuth, both along the direction of travel (0 forward, 180 back), growing "
    "counter-clockwise seen from above; Stokes vectors I, Q, U, V refer to the local meridian plane, "
    "Q = I_parallel - I_perpendicular, U and V in the signs of Hovenier and van der Mee; cosines are in the medium of "
    "the light that they describe: mu_i, mu_o and mu0 outside, mu where its depth lies; without an interface in the "
    "scene all is inside the host medium, and nothing is refracted or reflected at its surface; what smooth surfaces "
    "mirror and let through as beams is in specular and specular_transmission, shares of a beam's power, and not in "
    "mueller, transmission, reflectance and stokes"
)


@dataclass(frozen=True)
class Described:
    """One array of a file: its dimensions, its unit as UDUNITS writes it, what it means, its name in CF's table of
    standard names where it has one, and its columns in a table of one row a direction where it is there."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    standard_name: str | None = None
    columns: tuple[str, ...] = ()

    @property
    def attributes(self) -> dict[str, str]:
        """As CF names them."""
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


BEAM, DEPTH = ("mu_i",), ("tau",)
MATRIX = ("stokes_out", "stokes_in")
PAIRS = ("mu_i", "mu_o", "phi_deg", *MATRIX)
STOKES_AXIS = "stokes_parameter"  # "stokes" is a variable: no dimension with labels may be called so too
PARAMETER = "parameter"  # the dimension of derivatives, labelled by the names of the numbers
NAMES = "derivatives"  # the attribute that lists these names, as JSON
TEXTS = ("kind", "diagnostics", SCENE, NAMES)  # the attributes that make a result
DERIVED = ("specular_reflectance", "total_reflectance")  # from other variables: in files for who reads them elsewhere


def describe_pairs(letter: str, long_name: str) -> Described:
    """Mueller matrices of all pairs of directions [sr-1], columns ``letter``00 to ``letter``33."""
    return Described(PAIRS, "sr-1", long_name, columns=tuple(name.replace("f", letter) for name in MUELLER))


def add_derivatives(variables: dict[str, Described], derivatives: Mapping[str, str]) -> dict[str, Described]:
    """Variables and the derivatives of some of them."""
    words = f"derivatives of {{}} by each number of {PARAMETER}, per unit of the number"
    return variables | {
        name: replace(variables[value].along(PARAMETER), long_name=words.format(value))
        for name, value in derivatives.items()
    }


BRDF = Kind(
    "brdf",
    "BRDF of a particulate layer",
    {
        "mu_i": Described(BEAM, "1", "cosine of the angle of incidence"),
        "mu_o": Described(("mu_o",), "1", "cosine of the angle of exit"),
        "phi_deg": Described(
            ("phi_deg",), "degree", "azimuth, outgoing minus incident, both along the direction of travel"
        ),
    },
    add_derivatives(
        {
            "mueller": describe_pairs("f", "BRDF, Mueller matrix: diffuse radiance out per irradiance in"),
            "reflectance": Described(BEAM, "1", "directional-hemispherical diffuse reflectance, unpolarized light"),
            "transmission": describe_pairs(
                "t", "BTDF, Mueller matrix: diffuse radiance out of the other face per irradiance in"
            ),
            "direct_transmittance": Described(
                BEAM, "1", "share of unpolarized light that leaves the other face as a beam, unscattered"
            ),
            "specular": Described(
                (*BEAM, *MATRIX), "1", "Mueller matrix of the share of a beam's power that comes back as a beam"
            ),
            "specular_transmission": Described(
                (*BEAM, *MATRIX),
                "1",
                "Mueller matrix of the share of a beam's power that leaves the other face as a beam",
            ),
            "surface": describe_pairs(
                "s", "the part of mueller that rough surfaces send back without any particle: radiance/irradiance"
            ),
            "specular_reflectance": Described(BEAM, "1", "share of unpolarized light that comes back as a beam"),
            "total_reflectance": Described(BEAM, "1", "reflectance and specular_reflectance together"),
        },
        BRDF_DERIVATIVES,
    ),
)
WAVELENGTH = Described(("wavelength_um",), "um", "wavelength in vacuum", "radiation_wavelength")
SPECTRUM = Kind(
    "spectrum",
    "BRDF of a particulate layer at several wavelengths",
    {"wavelength_um": WAVELENGTH, **BRDF.coordinates},
    {name: about.along("wavelength_um") for name, about in BRDF.variables.items()},
)
FIELD = Kind(
    "field",
    "radiance field of a particulate layer",
    {
        "tau": Described(DEPTH, "1", "optical depth, growing downward from the top"),
        "mu": Described(("mu",), "1", "cosine of the direction of travel with the upward normal: > 0 up, < 0 down"),
        "phi_deg": Described(("phi_deg",), "degree", "azimuth relative to the beam, along the directions of travel"),
    },
    add_derivatives(
        {
            "stokes": Described(
                ("tau", "mu", "phi_deg", STOKES_AXIS),
                RADIANCE,
                "radiance I, Q, U, V, diffuse light only",
                columns=tuple(STOKES),
            ),
            "flux_up": Described(DEPTH, IRRADIANCE, "diffuse flux going up through a horizontal plane"),
            "flux_down": Described(DEPTH, IRRADIANCE, "diffuse flux going down through a horizontal plane"),
            "direct": Described(
                DEPTH,
                IRRADIANCE,
                "flux of the direct beam through a horizontal plane; where light is refracted, of all beams that go "
                "down",
            ),
            "direct_up": Described(DEPTH, IRRADIANCE, "flux of all beams that go up through a horizontal plane"),
            "index": Described(DEPTH, "1", "refractive index of the medium that the depth lies in"),
            "mu0": Described((), "1", "cosine of the beam's angle of incidence"),
            "incident_stokes": Described(
                (STOKES_AXIS,), IRRADIANCE, "the beam's I, Q, U, V as flux through a plane perpendicular to it"
            ),
        },
        FIELD_DERIVATIVES,
    ),
)
OF_ALL_BEAMS = ("index", "incident_stokes")
FIELDS = Kind(
    "fields",
    "radiance field of a particulate layer, for several beams",
    {"mu0": Described(("mu0",), "1", "cosine of each beam's angle of incidence"), **FIELD.coordinates},
    {
        name: about if name in OF_ALL_BEAMS else about.along("mu0")
        for name, about in FIELD.variables.items()
        if name != "mu0"
    },
)
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


def list_derivatives(result: Result) -> list[str]:
    """The names of a result's derivatives, in their order in files."""
    return list(result.jacobian or ())


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
    if names := list_derivatives(result):
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
    """What another library says, in one line and not too long."""
    return put_in_one_line(f"{type(error).__name__}: {error}", 200)


def find_stored_kind(texts: Mapping[str, str]) -> Kind:
    """The kind that a file's texts name. Raises SceneError."""
    if texts.get("kind") not in KINDS:
        raise SceneError(f"it must say its kind, one of {', '.join(KINDS)}")
    return KINDS[texts["kind"]]


def read_derivatives(texts: Mapping[str, str]) -> list[str]:
    """The names of derivatives that a file's texts list, all different. Raises SceneError."""
    names = json.loads(texts.get(NAMES, "[]"))
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names) and len({*names}) == len(names)):
        raise SceneError(f"its {NAMES} must be a list of different names")
    return names


def restore_result(texts: Mapping[str, str], arrays: Mapping[str, Any]) -> Result:
    """The result that has the texts of `describe_result` and these arrays. Raises SceneError where they do not fit
    together, another of MEANINGLESS where something is missing or not what it should be."""
    kind, diagnostics, names = find_stored_kind(texts), json.loads(texts["diagnostics"]), read_derivatives(texts)
    scene = {SCENE: texts[SCENE]} if SCENE in texts else {}
    found: dict[str, Any] = {}
    for name, about in kind.arrays.items():
        if name in arrays and name not in DERIVED:
            values = arrays[name]
            values = dict(zip(names, values, strict=True)) if about.is_derivative else values
            found[name.removesuffix("_deg")] = values
    if kind is SPECTRUM:
        wavelengths, directions = (
            found.pop("wavelength_um"),
            {name: found.pop(name) for name in ("mu_i", "mu_o", "phi")},
        )
        if len(diagnostics) != len(wavelengths):
            raise SceneError("there must be diagnostics for each wavelength")
        brdfs = (
            Brdf(**directions, **{name: pick_wavelength(found[name], k) for name in found}, diagnostics=one | scene)
            for k, one in enumerate(diagnostics)
        )
        return Spectrum(wavelengths, tuple(brdfs))
    if kind is FIELD:
        found["mu0"] = float(found["mu0"].item())
    return (Brdf if kind is BRDF else Field)(**found, diagnostics=diagnostics | scene)


def pick_wavelength(values: Any, k: int) -> Any:
    """The part of an array over wavelengths, or of each one of a dictionary of arrays, at wavelength ``k``."""
    return {name: one[k] for name, one in values.items()} if isinstance(values, dict) else values[k]


def check_size(size: float, most_bytes: float) -> None:
    """Raises SceneError, which says how to go on, where a result takes more memory than it may."""
    if size > most_bytes:
        raise SceneError(
            f"its values take {size / 1e9:.3g} GB, more than the {most_bytes / 1e9:.3g} GB that are read: "
            f"if you trust it, vrte.load(path, most_bytes={-(-size // 1e9):.0f}e9)"
        )


def to_xarray(result: Result) -> "xarray.Dataset":
    """A labelled copy of ``result``: every variable and coordinate has ``units`` and ``long_name``, Stokes parameters
    have the labels "I", "Q", "U" and "V", derivatives those of their numbers. Raises MissingExtraError without xarray.

    >>> to_xarray(brdf).mueller.sel(stokes_out="I", stokes_in="I").dims
    ('mu_i', 'mu_o', 'phi_deg')
    """
    xarray = import_extra("xarray", LABELLED, "files")
    kind, arrays = find_kind(result), collect_arrays(result)
    about = {name: (of.dims, arrays[name], of.attributes) for name, of in kind.arrays.items() if name in arrays}
    data = {name: about[name] for name in kind.variables if name in about}
    coords: dict[str, Any] = {name: about[name] for name in kind.coordinates}
    labels = (STOKES_AXIS,) if "stokes" in kind.variables else MATRIX
    coords |= {axis: (axis, list(STOKES), {"long_name": "Stokes parameter"}) for axis in labels}
    if names := list_derivatives(result):
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
