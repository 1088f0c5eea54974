"""Results as labelled data sets, in memory (xarray) and on disk (NetCDF)."""

import json
import os
from typing import TYPE_CHECKING, Any

from vrte.arrays import in_one_line
from vrte.brdf import Brdf
from vrte.errors import MissingExtraError, SceneError
from vrte.field import Field
from vrte.formats.atomic import atomic_write
from vrte.formats.text_file import file_name

if TYPE_CHECKING:
    import xarray

STOKES = ["I", "Q", "U", "V"]
RADIANCE = "W m-2 sr-1"
IRRADIANCE = "W m-2"
CONVENTIONS = (
    "phi_deg is outgoing minus incident azimuth, both along the direction of travel (0 forward, 180 back); "
    "Stokes vectors refer to the local meridian plane, Q = I_parallel - I_perpendicular, U and V in the "
    "signs of Hovenier and van der Mee; the light is inside the host medium, nothing is refracted or "
    "reflected at its surface"
)

BRDF_VARIABLES: dict[str, tuple[list[str], str, str]] = {
    "mueller": (
        ["mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in"],
        "sr-1",
        "subsurface BRDF, Mueller matrix: radiance out per irradiance in",
    ),
    "reflectance": (["mu_i"], "1", "directional-hemispherical subsurface reflectance, unpolarized light"),
    "transmission": (
        ["mu_i", "mu_o", "phi_deg", "stokes_out", "stokes_in"],
        "sr-1",
        "subsurface BTDF, Mueller matrix: diffuse radiance out of the other face per irradiance in",
    ),
    "direct_transmittance": (["mu_i"], "1", "share of the beam that reaches the other face unscattered"),
}
BRDF_COORDINATES = {
    "mu_i": ("1", "cosine of the angle of incidence"),
    "mu_o": ("1", "cosine of the angle of exit"),
    "phi_deg": ("degree", "azimuth, outgoing minus incident, along the directions of travel"),
}
FIELD_VARIABLES: dict[str, tuple[list[str], str, str]] = {
    "stokes": (["tau", "mu", "phi_deg", "stokes"], RADIANCE, "subsurface radiance I, Q, U, V, diffuse light only"),
    "flux_up": (["tau"], IRRADIANCE, "diffuse subsurface flux going up through a horizontal plane"),
    "flux_down": (["tau"], IRRADIANCE, "diffuse subsurface flux going down through a horizontal plane"),
    "direct": (["tau"], IRRADIANCE, "flux of the direct beam through a horizontal plane"),
    "mu0": ([], "1", "cosine of the beam's angle of incidence"),
    "incident_stokes": (["stokes"], IRRADIANCE, "the beam's I, Q, U, V as flux through a plane perpendicular to it"),
}
FIELD_COORDINATES = {
    "tau": ("1", "optical depth, growing downward from the top"),
    "mu": ("1", "cosine of the direction of travel with the upward normal: > 0 up, < 0 down"),
    "phi_deg": ("degree", "azimuth relative to the beam, along the directions of travel"),
}


def to_xarray(result: Brdf | Field) -> "xarray.Dataset":
    """A labelled copy of ``result``; every variable and coordinate has ``units`` and ``long_name``.

    ``mueller`` has the dims (mu_i, mu_o, phi_deg, stokes_out, stokes_in), ``stokes`` has (tau, mu, phi_deg,
    stokes). Raises MissingExtraError without xarray.

    >>> to_xarray(brdf).mueller.sel(stokes_out="I", stokes_in="I").dims
    ('mu_i', 'mu_o', 'phi_deg')
    """
    xarray = _xarray()
    is_brdf = isinstance(result, Brdf)
    variables = BRDF_VARIABLES if is_brdf else FIELD_VARIABLES
    coordinates = BRDF_COORDINATES if is_brdf else FIELD_COORDINATES
    # a field's variable and its last dimension are both called stokes: the labels need a name of their own
    labels = {"stokes_out": "stokes_out", "stokes_in": "stokes_in"} if is_brdf else {"stokes_parameter": "stokes"}
    data = {
        name: (dims, getattr(result, name), {"units": units, "long_name": long_name})
        for name, (dims, units, long_name) in variables.items()
        if getattr(result, name) is not None
    }
    coords: dict[str, Any] = {
        name: (name, getattr(result, name.removesuffix("_deg")), {"units": units, "long_name": long_name})
        for name, (units, long_name) in coordinates.items()
    }
    coords |= {name: (axis, STOKES, {"long_name": "Stokes parameter"}) for name, axis in labels.items()}
    dataset = xarray.Dataset(data, coords, _attributes(result)).copy(deep=True)
    return dataset if is_brdf else dataset.reset_coords("stokes")  # xarray takes it for a coordinate


def save(result: Brdf | Field, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to the NetCDF file ``path``, all of it or nothing.

    Raises MissingExtraError without the extra "files", or OSError.

    >>> save(brdf, "result.nc")
    """
    dataset = to_xarray(result)
    _require_h5netcdf()
    with atomic_write(path) as part:
        dataset.to_netcdf(part, engine="h5netcdf")


def load(path: str | os.PathLike[str]) -> Brdf | Field:
    """The result that ``save`` wrote to ``path``, every digit as it was.

    Raises FileNotFoundError, SceneError for a file that holds no result of this package, MissingExtraError.

    >>> save(brdf, "result.nc")
    >>> load("result.nc").mueller.shape
    (2, 20, 37, 4, 4)
    """
    xarray = _xarray()
    _require_h5netcdf()
    name = file_name(path)
    if not os.path.isfile(name):
        raise FileNotFoundError(f"no such file: {name}")
    try:
        dataset = xarray.load_dataset(name, engine="h5netcdf", mask_and_scale=False)
    except Exception as error:  # whatever four libraries below make of bytes that mean nothing
        raise SceneError(f"{name} is not a NetCDF file: {_reason(error)}") from error
    try:
        return _from_xarray(dataset)
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise SceneError(f"{name} holds no BRDF or field written by vrte: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """What another library says, in one line and not too long."""
    return in_one_line(f"{type(error).__name__}: {error}", 200)


def _from_xarray(dataset: "xarray.Dataset") -> Brdf | Field:
    diagnostics = json.loads(dataset.attrs["diagnostics"])
    if "mueller" in dataset:
        optional = ("transmission", "direct_transmittance")
        return Brdf(
            diagnostics=diagnostics,
            phi=dataset["phi_deg"].values,
            **{name: dataset[name].values for name in ("mueller", "reflectance", "mu_i", "mu_o")},
            **{name: dataset[name].values for name in optional if name in dataset},
        )
    names = [name for name in FIELD_VARIABLES if name != "mu0"] + ["tau", "mu"]
    return Field(
        diagnostics=diagnostics,
        phi=dataset["phi_deg"].values,
        mu0=float(dataset["mu0"]),
        **{name: dataset[name].values for name in names},
    )


def _attributes(result: Brdf | Field) -> dict[str, str]:
    from vrte import __version__

    kind = "subsurface BRDF" if isinstance(result, Brdf) else "subsurface radiance field"
    return {
        "title": f"Polarized {kind} of a particulate layer",
        "source": f"vrte {__version__}",
        "comment": CONVENTIONS,
        "diagnostics": _as_json(result.diagnostics),
    }


def _as_json(diagnostics: dict[str, Any]) -> str:
    try:
        return json.dumps(diagnostics)
    except (TypeError, ValueError, RecursionError) as error:
        raise SceneError(f"diagnostics must be what JSON can hold: {_reason(error)}") from error


def _xarray() -> Any:
    try:
        import xarray
    except ImportError as error:
        raise MissingExtraError("a labelled or NetCDF result", "files") from error
    return xarray


def _require_h5netcdf() -> None:
    try:
        import h5netcdf  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("reading or writing NetCDF", "files") from error
