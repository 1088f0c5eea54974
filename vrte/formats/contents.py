"""What the result files hold, whatever their format: names, dimensions, units, meanings; and the result from it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.results.brdf import BRDF_DERIVATIVES, Brdf
from vrte.results.field import FIELD_DERIVATIVES, Field
from vrte.results.spectrum import SCENE, Spectrum

Result = Brdf | Field | Spectrum
MEANINGLESS = (LookupError, TypeError, ValueError, AttributeError, RecursionError)  # what a strange file raises

RADIANCE = "W m-2 sr-1"
IRRADIANCE = "W m-2"
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
    """One array of a file: its dimensions, its unit as UDUNITS writes it, what it means, and its name in CF's table of
    standard names where it has one."""

    dims: tuple[str, ...]
    units: str
    long_name: str
    standard_name: str | None = None

    @property
    def attributes(self) -> dict[str, str]:
        """As CF names them."""
        standard = {"standard_name": self.standard_name} if self.standard_name else {}
        return {"units": self.units, "long_name": self.long_name} | standard


@dataclass(frozen=True)
class Kind:
    """One kind of result: its name, what it is called, its coordinates and its variables."""

    name: str
    title: str
    coordinates: dict[str, Described]
    variables: dict[str, Described]


PAIRS = ("mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in")
BEAMS = ("mu_i", "stokes_out", "stokes_in")
PARAMETER = "parameter"  # the dimension of derivatives, labelled by the names of the numbers
NAMES = "derivatives"  # the attribute that lists these names, as JSON
DERIVED = ("specular_reflectance", "total_reflectance")  # from other variables: in files for who reads them elsewhere


def add_derivatives(variables: dict[str, Described], derivatives: Mapping[str, str]) -> dict[str, Described]:
    """Variables with their derivatives among them."""
    found = dict(variables)
    for name, value in derivatives.items():
        about = variables[value]
        words = f"derivatives of {value} by each number of {PARAMETER}, per unit of the number"
        found[name] = Described((PARAMETER, *about.dims), about.units, words)
    return found


def put_in_front(axis: str, dims: tuple[str, ...]) -> tuple[str, ...]:
    """One more dimension in front of all others but that of derivatives.

    >>> put_in_front("mu0", ("parameter", "tau"))
    ('parameter', 'mu0', 'tau')
    """
    return (PARAMETER, axis, *dims[1:]) if dims[:1] == (PARAMETER,) else (axis, *dims)


BRDF = Kind(
    "brdf",
    "BRDF of a particulate layer",
    {
        "mu_i": Described(("mu_i",), "1", "cosine of the angle of incidence"),
        "mu_o": Described(("mu_o",), "1", "cosine of the angle of exit"),
        "phi_deg": Described(
            ("phi_deg",), "degree", "azimuth, outgoing minus incident, both along the direction of travel"
        ),
    },
    add_derivatives(
        {
            "mueller": Described(PAIRS, "sr-1", "BRDF, Mueller matrix: diffuse radiance out per irradiance in"),
            "reflectance": Described(
                ("mu_i",), "1", "directional-hemispherical diffuse reflectance, unpolarized light"
            ),
            "transmission": Described(
                PAIRS, "sr-1", "BTDF, Mueller matrix: diffuse radiance out of the other face per irradiance in"
            ),
            "direct_transmittance": Described(
                ("mu_i",), "1", "share of unpolarized light that leaves the other face as a beam, unscattered"
            ),
            "specular": Described(
                BEAMS, "1", "Mueller matrix of the share of a beam's power that comes back as a beam"
            ),
            "specular_transmission": Described(
                BEAMS, "1", "Mueller matrix of the share of a beam's power that leaves the other face as a beam"
            ),
            "surface": Described(
                PAIRS,
                "sr-1",
                "the part of mueller that rough surfaces send back without any particle: radiance/irradiance",
            ),
            "specular_reflectance": Described(("mu_i",), "1", "share of unpolarized light that comes back as a beam"),
            "total_reflectance": Described(("mu_i",), "1", "reflectance and specular_reflectance together"),
        },
        BRDF_DERIVATIVES,
    ),
)
WAVELENGTH = Described(("wavelength_um",), "um", "wavelength in vacuum", "radiation_wavelength")
SPECTRUM = Kind(
    "spectrum",
    "BRDF of a particulate layer at several wavelengths",
    {"wavelength_um": WAVELENGTH, **BRDF.coordinates},
    {
        name: Described(put_in_front("wavelength_um", variable.dims), variable.units, variable.long_name)
        for name, variable in BRDF.variables.items()
    },
)
STOKES_AXIS = "stokes_parameter"  # "stokes" is a variable: no dimension with labels may be called so too
FIELD = Kind(
    "field",
    "radiance field of a particulate layer",
    {
        "tau": Described(("tau",), "1", "optical depth, growing downward from the top"),
        "mu": Described(("mu",), "1", "cosine of the direction of travel with the upward normal: > 0 up, < 0 down"),
        "phi_deg": Described(("phi_deg",), "degree", "azimuth relative to the beam, along the directions of travel"),
    },
    add_derivatives(
        {
            "stokes": Described(
                ("tau", "mu", "phi_deg", STOKES_AXIS), RADIANCE, "radiance I, Q, U, V, diffuse light only"
            ),
            "flux_up": Described(("tau",), IRRADIANCE, "diffuse flux going up through a horizontal plane"),
            "flux_down": Described(("tau",), IRRADIANCE, "diffuse flux going down through a horizontal plane"),
            "direct": Described(
                ("tau",),
                IRRADIANCE,
                "flux of the direct beam through a horizontal plane; where light is refracted, of all beams that go "
                "down",
            ),
            "direct_up": Described(("tau",), IRRADIANCE, "flux of all beams that go up through a horizontal plane"),
            "index": Described(("tau",), "1", "refractive index of the medium that the depth lies in"),
            "mu0": Described((), "1", "cosine of the beam's angle of incidence"),
            "incident_stokes": Described(
                (STOKES_AXIS,), IRRADIANCE, "the beam's I, Q, U, V as flux through a plane perpendicular to it"
            ),
        },
        FIELD_DERIVATIVES,
    ),
)
BY_BEAM = ("stokes", "flux_up", "flux_down", "direct", "direct_up", *FIELD_DERIVATIVES)
FIELDS = Kind(
    "fields",
    "radiance field of a particulate layer, for several beams",
    {"mu0": Described(("mu0",), "1", "cosine of each beam's angle of incidence"), **FIELD.coordinates},
    {
        name: replace(variable, dims=put_in_front("mu0", variable.dims)) if name in BY_BEAM else variable
        for name, variable in FIELD.variables.items()
        if name != "mu0"
    },
)
KINDS = {kind.name: kind for kind in (BRDF, FIELD, FIELDS, SPECTRUM)}
CLASSES: dict[type, Kind] = {Brdf: BRDF, Field: FIELD, Spectrum: SPECTRUM}


def find_kind(result: Result) -> Kind:
    """The kind of a result."""
    if isinstance(result, Field) and not isinstance(result.mu0, float):
        return FIELDS
    try:
        return CLASSES[type(result)]
    except KeyError:
        raise SceneError(f"a result must be a Brdf, a Field or a Spectrum, not {type(result).__name__}") from None


def collect_arrays(result: Result) -> dict[str, Any]:
    """All coordinates and variables that a result has, by their names in files."""
    kind = find_kind(result)
    found = {name: getattr(result, name.removesuffix("_deg")) for name in (*kind.coordinates, *kind.variables)}
    left_out = DERIVED if found.get("specular") is None else ()
    return {
        name: np.stack([*values.values()]) if isinstance(values, dict) else values
        for name, values in found.items()
        if values is not None and name not in left_out
    }


def list_derivatives(result: Result) -> list[str]:
    """The names of a result's derivatives, in their order in files."""
    return list(result.jacobian or ())


def restore_result(
    kind: Kind, arrays: Mapping[str, Array], diagnostics: Any, scene: str | None, derivatives: Any = None
) -> Result:
    """The result that has these arrays, what `describe_result` said of it, and these names of derivatives. Raises
    SceneError where they do not fit together, another of MEANINGLESS where something is missing or not what it should
    be."""
    named: dict[str, Any] = {name.removesuffix("_deg"): array for name, array in arrays.items() if name not in DERIVED}
    names = check_names(derivatives)
    for name, about in kind.variables.items():
        if name in named and about.dims[:1] == (PARAMETER,):
            named[name] = dict(zip(names, named[name], strict=True))
    also = {} if scene is None else {SCENE: scene}
    if kind is SPECTRUM:
        directions = {name: named[name] for name in ("mu_i", "mu_o", "phi")}
        found = {name: named[name] for name in kind.variables if name in named}
        if len(diagnostics) != len(named["wavelength_um"]):
            raise SceneError("there must be diagnostics for each wavelength")
        brdfs = (
            Brdf(diagnostics=one | also, **directions, **{name: take_place(found[name], place) for name in found})
            for place, one in enumerate(diagnostics)
        )
        return Spectrum(named["wavelength_um"], tuple(brdfs))
    if kind is BRDF:
        return Brdf(diagnostics=diagnostics | also, **named)
    mu0 = named.pop("mu0")
    return Field(diagnostics=diagnostics | also, mu0=float(mu0.item()) if kind is FIELD else mu0, **named)


def check_names(derivatives: Any) -> list[str]:
    """The names of derivatives as a file lists them, all different. Raises SceneError."""
    names = [] if derivatives is None else derivatives
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names) and len({*names}) == len(names)):
        raise SceneError(f"its {NAMES} must be a list of different names")
    return names


def take_place(values: Any, place: int) -> Any:
    """What an array over wavelengths has at one of them, or each one of a dictionary of arrays."""
    return {name: one[place] for name, one in values.items()} if isinstance(values, dict) else values[place]


def describe_result(result: Result) -> dict[str, str]:
    """What else a file says: title, source, comment, ``diagnostics`` as JSON, and the scene file where it is known."""
    from vrte import __version__

    diagnostics = [one.diagnostics for one in result] if isinstance(result, Spectrum) else result.diagnostics
    every = diagnostics if isinstance(diagnostics, list) else [diagnostics]
    scene = every[0].get(SCENE)
    told = {
        "title": f"Polarized {find_kind(result).title}",
        "source": f"vrte {__version__}, vector radiative transfer",
        "comment": CONVENTIONS,
        "kind": find_kind(result).name,
    }
    if names := list_derivatives(result):
        told[NAMES] = convert_to_json(names)
    if isinstance(scene, str) and all(one.get(SCENE) == scene for one in every):
        told[SCENE] = scene
        every = [{name: value for name, value in one.items() if name != SCENE} for one in every]
    return told | {"diagnostics": convert_to_json(every if isinstance(diagnostics, list) else every[0])}


def convert_to_json(value: Any) -> str:
    """JSON in one line of ASCII, every digit of every number. Raises SceneError for what has no place in it."""
    try:
        return json.dumps(value)
    except (TypeError, ValueError, RecursionError) as error:
        raise SceneError(f"diagnostics must be what JSON can hold: {explain_error(error)}") from error


def explain_error(error: Exception) -> str:
    """What another library says, in one line and not too long."""
    return put_in_one_line(f"{type(error).__name__}: {error}", 200)
