"""Results as labelled data sets, in memory (xarray) and on disk (NetCDF), by the CF conventions."""

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.errors import MissingExtraError, SceneError
from vrte.formats.atomic import atomic_write
from vrte.formats.contents import (
    BRDF,
    FIELD,
    KINDS,
    Result,
    arrays_of,
    described,
    kind_of,
    reason,
    restored,
    undescribed,
)
from vrte.formats.text_file import file_name
from vrte.geometries import Views
from vrte.spectrum import SCENE

if TYPE_CHECKING:
    import xarray

STOKES = ["I", "Q", "U", "V"]
CF = "CF-1.11"


def to_xarray(result: Result) -> "xarray.Dataset":
    """A labelled copy of ``result``; every variable and coordinate has ``units`` and ``long_name``.

    ``mueller`` has the dims (mu_i, mu_o, phi_deg, stokes_out, stokes_in), with wavelength_um in front for a spectrum;
    ``stokes`` has (tau, mu, phi_deg, stokes), with mu0 in front for several beams. Raises MissingExtraError without
    xarray.

    >>> to_xarray(brdf).mueller.sel(stokes_out="I", stokes_in="I").dims
    ('mu_i', 'mu_o', 'phi_deg')
    """
    xarray = _xarray()
    kind, arrays = kind_of(result), arrays_of(result)
    # a field's variable and its last dimension are both called stokes: the labels need a name of their own
    labels = (
        {"stokes_parameter": "stokes"}
        if "stokes" in kind.variables
        else {name: name for name in ("stokes_out", "stokes_in")}
    )
    data = {
        name: (about.dims, arrays[name], about.attributes) for name, about in kind.variables.items() if name in arrays
    }
    coords: dict[str, Any] = {
        name: (about.dims, arrays[name], about.attributes) for name, about in kind.coordinates.items()
    }
    coords |= {name: (axis, STOKES, {"long_name": "Stokes parameter"}) for name, axis in labels.items()}
    dataset = xarray.Dataset(data, coords, _conventions(arrays, kind.coordinates) | described(result)).copy(deep=True)
    return dataset.reset_coords("stokes") if "stokes" in kind.variables else dataset  # xarray takes it for a coordinate


def views_to_xarray(views: Views) -> "xarray.Dataset":
    """A labelled copy of the Stokes vectors of single geometries, ``stokes`` (geometry, stokes_parameter)."""
    about = {name: FIELD.variables.get(name) or FIELD.coordinates[name] for name in ("stokes", "mu0", "mu", "phi_deg")}
    rows = {"mu0": views.mu0, "mu": views.mu, "phi_deg": views.phi}
    data = {"stokes": (("geometry", "stokes_parameter"), views.stokes, about["stokes"].attributes)}
    coords = {name: ("geometry", values, about[name].attributes) for name, values in rows.items()}
    labels = {"stokes_parameter": STOKES, "tau": ((), views.tau, FIELD.coordinates["tau"].attributes)}
    return _xarray().Dataset(data, coords | labels).copy(deep=True)


def _conventions(arrays: dict[str, Any], coordinates: Any) -> dict[str, str]:
    """The name of the conventions, where they hold: their coordinates must be strictly monotonic."""
    steps = [np.diff(arrays[name]) for name in coordinates]
    return {"Conventions": CF} if all(np.all(step > 0.0) or np.all(step < 0.0) for step in steps) else {}


def save_netcdf(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to the NetCDF file ``path``, all of it or nothing; the same result makes the same bytes.

    Raises MissingExtraError without the extra "files", or OSError.

    >>> save_netcdf(brdf, "result.nc")
    """
    dataset = to_xarray(result)
    _require_h5netcdf()
    as_it_is = {name: {"_FillValue": None} for name, array in dataset.variables.items() if array.dtype.kind == "f"}
    with atomic_write(path) as part:
        dataset.to_netcdf(part, engine="h5netcdf", encoding=as_it_is)


def load_netcdf(path: str | os.PathLike[str]) -> Result:
    """The result that `save_netcdf` wrote to ``path``, every digit as it was.

    Raises FileNotFoundError, SceneError for a file that holds no result of this package, MissingExtraError.

    >>> save_netcdf(brdf, "result.nc")
    >>> load_netcdf("result.nc").mueller.shape
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
        raise SceneError(f"{name} is not a NetCDF file: {reason(error)}") from error
    try:
        return _from_xarray(dataset)
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise SceneError(f"{name} holds no BRDF, field or spectrum written by vrte: {reason(error)}") from error


def _from_xarray(dataset: "xarray.Dataset") -> Result:
    # files of version 0.1 do not say their kind
    kind = KINDS[dataset.attrs.get("kind", BRDF.name if "mueller" in dataset else FIELD.name)]
    names = [name for name in (*kind.coordinates, *kind.variables) if name in dataset]
    diagnostics = undescribed(json.loads(dataset.attrs["diagnostics"]), dataset.attrs.get(SCENE))
    return restored(kind, {name: dataset[name].values for name in names}, diagnostics)


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
