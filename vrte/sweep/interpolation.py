"""Between the scenes of a table: piecewise cubic, in variables in which light is smooth, and how far that is wrong.

Along an axis that is positive and spans a decade or more the logarithm counts, along others the value itself: particles
of 0.1 and 1 um differ as those of 1 and 10 um do, wavelengths within the visible are as good as evenly spaced. Of
directions the angle counts: in its cosine light is steep at the normal. Of a Mueller matrix the logarithm of f_00,
which then stays positive, and the others over f_00, which hardly change where the brightness does; of a transmittance
the logarithm, which is linear in the depth.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, check_number, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import compute_weights
from vrte.formats.scene_file import make_scene_file
from vrte.sweep.chunks import make_processor_solver
from vrte.sweep.results import make_scene_request
from vrte.sweep.template import Sweep, read_sweep

if TYPE_CHECKING:
    import xarray

DEGREE = 3
DECADE = 10.0
COSINES = ("mu_i", "mu_o", "mu0", "mu")
MATRICES = ("mueller", "transmission", "specular", "specular_transmission", "surface", "coherent")
TABLES = {"field": "fields", "appearance": "appearances"}
STOKES = ("stokes_out", "stokes_in", "stokes_parameter")


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scenes between a table's: ``points`` (n,) by axis, ``errors`` (n,) of Mueller elements over the largest."""

    points: dict[str, Array]
    errors: Array

    @property
    def median(self) -> float:
        """The error that half of the scenes stay below."""
        return float(np.median(self.errors))

    @property
    def largest(self) -> float:
        """The largest error of all scenes."""
        return float(self.errors.max())


def interpolate(table: "xarray.Dataset", point: Mapping[str, float]) -> "xarray.Dataset":
    """The BRDF at a point between the scenes of a table of `vrte.sweep`.

    Parameters
    ----------
    table : xarray.Dataset
        Of a sweep whose axes make a grid.
    point : mapping of str to float
        A value for any of the axes, and of mu_i, mu_o and phi_deg; dimensions that it leaves out stay as they are.

    Returns
    -------
    xarray.Dataset
        By piecewise polynomials, cubic where an axis has four values or more: along a decade or more in the axis's
        logarithm, along a cosine in its angle; of f_00 as its logarithm, of other Mueller elements over f_00. Only the
        scenes around the point are read. How far it is wrong, `held_out` of vrte.sweep.interpolation measures
        (docs/how_to/sweeps.md).

    Raises
    ------
    SceneError
        For a point outside, an unknown axis, axes that are no grid, and where a scene nearby has no result.

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> layer = {"phase": "isotropic", "albedo": 0.5, "thickness": 1.0}
    >>> axes = {"depth": {"key": "layer[1].thickness", "values": [0.5, 1.0, 1.5, 2.0]}}
    >>> table = vrte.sweep({"nodes": 8, "layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}, "axes": axes}, workers=1)
    >>> found = vrte.interpolate(table, {"depth": 1.25}).direct_transmittance.item()
    >>> bool(abs(found - np.exp(-2.5)) < 1e-12)
    True
    """
    import xarray

    near, shares = table, {}
    for name, value in point.items():
        indices, shares[str(name)] = find_neighbours(table, str(name), value)
        near = near.isel({name: indices})
    errors = near["error"].values if "error" in near else np.array([""])  # a table that was interpolated has none
    if (errors != "").any():
        raise SceneError(f"a scene near the point has no result: {errors[errors != ''][0]}")
    found = {name: interpolate_variable(near[name].load(), shares) for name in table.data_vars if name != "error"}
    here = {name: float(value) for name, value in point.items()}
    kept = {name: table[name] for name in table.coords if not set(table[name].dims) & set(point)}
    return xarray.Dataset(found, kept | here, table.attrs)


def find_neighbours(table: "xarray.Dataset", name: str, value: float) -> tuple[list[int], Array]:
    """Places of the values next to a point along an axis, and the weight of each."""
    if name not in table.dims or name not in table.coords:
        kind = "is one of several along a list, not a grid" if name in table.coords else "is no axis of the table"
        # in the order of the arrays: that of the table's own list depends on the versions of xarray and zarr
        dims = dict.fromkeys(dim for array in table.data_vars.values() for dim in array.dims)
        axes = [str(dim) for dim in dims if dim in table.coords and dim not in STOKES]
        raise SceneError(f"point: {name!r} {kind}; there are {', '.join(axes)}")
    values = np.asarray(table[name].values, np.float64)
    wanted = check_number(f"point: {name}", value, -math.inf, math.inf, "a number")
    if (values == wanted).any():
        return [int(np.flatnonzero(values == wanted)[0])], np.ones(1)
    finite = np.flatnonzero(np.isfinite(values))
    order = finite[np.argsort(values[finite], kind="stable")]
    ascending = values[order]
    if not ascending.size or not ascending[0] <= wanted <= ascending[-1]:
        raise SceneError(f"point: {name} must lie between {ascending.min()} and {ascending.max()}, not {wanted}")
    if (np.diff(ascending) == 0.0).any():
        raise SceneError(f"point: {name} has the same value twice")
    first = int(np.searchsorted(ascending, wanted)) - (DEGREE + 1) // 2
    start = max(0, min(first, ascending.size - (DEGREE + 1)))
    here = slice(start, start + DEGREE + 1)
    scale = np.arcsin if name in COSINES else np.log if is_logarithmic(ascending) else np.positive
    return order[here].tolist(), compute_weights(scale(ascending[here]), scale(np.array([wanted])))[0]


def is_logarithmic(values: Array) -> bool:
    """Whether an axis counts in decades."""
    return bool(values[0] > 0.0 and values[-1] / values[0] >= DECADE)


def interpolate_variable(near: "xarray.DataArray", weights: dict[str, Array]) -> "xarray.DataArray":
    """One variable, summed over the scenes nearby in variables in which it is smooth."""
    import xarray

    def summed(values: Any) -> Any:
        for name, shares in weights.items():
            if name in values.dims:
                values = values.drop_vars(name).dot(xarray.DataArray(shares, dims=[name]), dim=name)
        return values

    if near.attrs.get("units") == "degree" and near.name not in near.dims:  # an angle: the shorter way around
        angles = np.radians(near)
        found = np.degrees(np.arctan2(summed(np.sin(angles)), summed(np.cos(angles)))) % 360.0
        return found.transpose(*(dim for dim in near.dims if dim not in weights)).assign_attrs(near.attrs)
    with xarray.set_options(keep_attrs=True):
        brightness = near[..., :1, :1] if near.name in MATRICES else near
        if not bool((brightness > 0.0).all()):
            found = summed(near)
        elif near.name in MATRICES:
            found = summed(near / brightness.values) * np.exp(summed(np.log(brightness))).values
        else:
            found = np.exp(summed(np.log(near)))
    return found.transpose(*(dim for dim in near.dims if dim not in weights))


def held_out(table: "xarray.Dataset", points: int = 20, seed: int = 0, folder: Path | None = None) -> HeldOut:
    """The error of a table of BRDFs between its scenes, by solves at random ``points``. Raises SceneError."""
    sweep = read_sweep(json.loads(table.attrs["sweep"]), folder)
    if sweep.kind != "brdf":
        raise SceneError(f"held_out measures BRDFs, and this is a table of {TABLES[sweep.kind]}")
    check_whole("points", points, 1, 10**6)
    chance = np.random.default_rng(seed)
    drawn = {axis.name: sample_axis(axis.values, points, chance) for axis in sweep.axes}
    errors = np.empty(points)
    for index in range(points):
        point = {name: float(values[index]) for name, values in drawn.items()}
        solved = solve_point(sweep, point).mueller
        errors[index] = np.abs(interpolate(table, point).mueller.values - solved).max() / np.abs(solved).max()
    return HeldOut(drawn, errors)


def sample_axis(values: Array, count: int, chance: np.random.Generator) -> Array:
    """Random places in the range of an axis, even in its own variable."""
    finite = np.sort(values[np.isfinite(values)])
    if is_logarithmic(finite):
        return np.exp(chance.uniform(np.log(finite[0]), np.log(finite[-1]), count))
    return chance.uniform(finite[0], finite[-1], count)


def solve_point(sweep: Sweep, point: dict[str, float]) -> Any:
    """The BRDF of the scene at a point."""
    content = sweep.content((0,) * len(sweep.shape))
    for axis in sweep.axes:
        axis.number.put(content, point[axis.name])
    (found,) = make_processor_solver()([make_scene_request(make_scene_file(content, sweep.kind, sweep.folder))])
    if isinstance(found, Exception):
        raise found
    return found
