"""A table of BRDFs, or several, as a page with lobes to turn: the packed table, its error between the scenes, the file.

The BRDFs are packed as f_00 by its logarithm and the other Mueller elements over it, both in even steps, as differences
between neighbours, deflated. `vrte.interpolate` works with the same variables, so that the page interpolates what it
unpacks. Of azimuths those from 0 to 180 degrees are kept: the others are mirror images.
"""

import base64
import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import MIRROR, compute_weights, extend_over_pole, mirror_azimuths, repeat_grid
from vrte.pictures import page
from vrte.results.over_hemisphere import HOLE, check_directions, stokes_over_hemisphere
from vrte.sweep.interpolation import DEGREE, TABLES, interpolate, is_logarithmic, sample_axis, solve_point
from vrte.sweep.template import Sweep, SweepAxis, read_sweep

if TYPE_CHECKING:
    import xarray

POINTS = 4  # random points at which a table is compared with exact solves
LARGEST_PAGE = 60e6  # bytes: beyond, phones give up
FEWEST_RINGS, MOST_RINGS, SPOKES = 36, 72, 72  # of the body that is drawn
SUFFIX = ".html"
UNITS = {"um": "µm", "1": ""}
SHARES = ("reflectance", "total_reflectance", "specular")
STEP = 2.0**-10  # of elements over f_00, and of the logarithm of f_00: f_00 is off by at most a 2048th of itself
LARGEST = 32_767  # in two bytes
ALONG = 4  # the last so many dimensions are differenced: an axis, incidence, exit and azimuth


def take_half_circle(table: "xarray.Dataset") -> tuple[Array, Array]:
    """Azimuths (n,) [degrees] from 0 to 180, and the Mueller matrices (axes ..., mu_i, mu_o, n, 4, 4) there."""
    given = np.asarray(table.phi_deg.values, np.float64)
    azimuths, indices = mirror_azimuths(given)
    here = azimuths <= 180.0
    azimuths, indices = azimuths[here], indices[here]
    sign = np.where((indices >= given.size)[:, None, None], MIRROR, 1.0)
    return azimuths, table.mueller.values[..., indices % given.size, :, :] * sign


def pack_matrices(matrices: Array) -> dict[str, Any]:
    """Mueller matrices (axes ..., mu_i, mu_o, phi, 4, 4), packed: f_00 = exp(``middle`` + ``step`` n), rest over it."""
    brightness = matrices[..., 0, 0]
    logarithm = np.log(brightness)
    low, high = float(logarithm.min()), float(logarithm.max())
    middle, step = 0.5 * (low + high), max(STEP, (high - low) / (2.0 * LARGEST))
    ratios = matrices / (STEP * brightness[..., None, None])
    numbers = np.moveaxis(ratios.reshape(*brightness.shape, 16), -1, 0).copy()
    numbers[0] = (logarithm - middle) / step
    steps = np.round(numbers).astype(np.int16)
    for axis in list_packed_axes(steps.ndim):
        steps = np.diff(steps, axis=axis, prepend=np.int16(0))  # what overflows comes back when it is summed up again
    folded = ((steps << 1) ^ (steps >> 15)).astype("<u2")  # small numbers of either sign become small ones
    planes = np.ascontiguousarray(folded).view(np.uint8).reshape(-1, 2).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()
    return {"text": text, "shape": steps.shape, "middle": middle, "step": step}


def unpack_matrices(packed: Mapping[str, Any]) -> Array:
    """The Mueller matrices (axes ..., mu_i, mu_o, phi, 4, 4) [sr-1] as the page has them."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["text"])), np.uint8)
    folded = np.ascontiguousarray(planes.reshape(2, -1).T).view("<u2").reshape(packed["shape"])
    steps = ((folded >> 1) ^ (0 - (folded & 1))).astype(np.int16)
    for axis in reversed(list_packed_axes(steps.ndim)):
        steps = np.cumsum(steps, axis=axis, dtype=np.int16)
    elements = STEP * steps.astype(np.float64)
    elements[0] = 1.0
    elements *= np.exp(packed["middle"] + packed["step"] * steps[0])
    return np.moveaxis(elements, 0, -1).reshape(*packed["shape"][1:], 4, 4)


def list_packed_axes(dimensions: int) -> list[Any]:
    """Which axes are differenced, in this order; the first is the Mueller element."""
    return list(range(dimensions - 1, max(0, dimensions - 1 - ALONG), -1))


def save_page(
    tables: Mapping[str, "xarray.Dataset"],
    path: str | os.PathLike[str],
    points: int = POINTS,
    folder: Path | None = None,
) -> dict[str, Array]:
    """Writes a page of tables of BRDFs by name; their errors (points,). Raises SceneError, above 60 MB too, OSError."""
    if Path(path).suffix.lower() != SUFFIX:
        raise SceneError(f"the page {path} must end in {SUFFIX}")
    check_whole("points", points, 1, 1000)
    if not isinstance(tables, Mapping) or not tables:
        raise SceneError("tables must be a dictionary of at least one table by name")
    meshes: list[dict[str, Any]] = []
    described, errors = [], {}
    for name, table in tables.items():
        try:
            one, mesh, errors[name] = describe_lobes(table, points, folder)
        except SceneError as error:
            raise error.behind(name) from error
        meshes += [] if mesh in meshes else [mesh]
        described.append({"name": name, "mesh": meshes.index(mesh)} | one)
    data = json.dumps({"meshes": meshes, "tables": described}, ensure_ascii=False, separators=(",", ":"))
    body, style, script = ((files(__package__) / f"page.{end}").read_text("utf-8") for end in ("html", "css", "js"))
    body = body.replace("@CONTENT@", data.replace("<", "\\u003c"), 1)
    title = f"{', '.join(list(tables)[:3])} - lobes to turn around"
    text = page.make_page(title, body, style, script)
    if len(text) > LARGEST_PAGE:
        raise SceneError(
            f"the page would have {len(text) / 1e6:.0f} MB, at most {LARGEST_PAGE / 1e6:.0f} are allowed: "
            "fewer scenes or directions"
        )
    page.save_page(text, path)
    return errors


def check_sweep_for_page(sweep: Sweep) -> None:
    """Whether the table of a sweep can be shown on a page, before any scene is computed. Raises SceneError."""
    if sweep.kind != "brdf":
        raise SceneError(f"a page shows lobes of BRDFs, and this is a table of {TABLES[sweep.kind]}")
    for axis in sweep.axes:
        if axis.name != axis.dimension or [other.dimension for other in sweep.axes].count(axis.dimension) > 1:
            raise SceneError(
                f"axes.{axis.name}: is one of several along {axis.dimension}: a page needs axes that span a grid"
            )
        if not np.isfinite(axis.values).all():
            raise SceneError(f"axes.{axis.name}: has an infinite value, and a page interpolates between all of them")
        if np.unique(axis.values).size < axis.values.size:
            raise SceneError(f"axes.{axis.name}: has the same value twice")


def describe_lobes(
    table: "xarray.Dataset", points: int, folder: Path | None
) -> tuple[dict[str, Any], dict[str, Any], Array]:
    """What the page needs of a table, the mesh of its bodies, and how far it is off."""
    sweep = read_sweep(json.loads(table.attrs["sweep"]), folder)
    check_sweep_for_page(sweep)
    table = table.load().sortby([axis.name for axis in sweep.axes]).sortby(["mu_i", "mu_o"], ascending=False)
    for name in ("mu_i", "mu_o"):
        if (np.diff(table[name].values) == 0.0).any():
            raise SceneError(f"brdf.{name} has the same value twice")
    azimuths, matrices = take_half_circle(table)
    check_directions(table.mu_o.values, azimuths)
    failed = int((table.error.values != "").sum())
    if failed:
        raise SceneError(f"{failed} of its {sweep.count} scenes have no result, and a page needs all")
    if not (np.isfinite(matrices).all() and (matrices[..., 0, 0] > 0.0).all()):
        raise SceneError("a page needs light in every direction: f_00 is not above 0 everywhere")
    packed = pack_matrices(matrices)
    seen = table.drop_dims("phi_deg").assign_coords(phi_deg=azimuths)
    seen = seen.assign(mueller=(table.mueller.dims, unpack_matrices(packed)))
    errors = measure_page_error(seen, sweep, points)
    described = {
        "axes": [
            describe_page_axis(axis, table[axis.name].values.astype(float), table[axis.name].attrs.get("units", "1"))
            for axis in sweep.axes
        ],
        "mu_i": table.mu_i.values.tolist(),
        "mu_o": table.mu_o.values.tolist(),
        "phi": azimuths.tolist(),
        "packed": packed,
        "shares": {name: np.round(table[name].values, 6).tolist() for name in SHARES if name in table},
        "surface": "total_reflectance" in table,
        "error": {"largest": float(errors.max()), "median": float(np.median(errors)), "points": points},
        "source": table.attrs["source"],
    }
    return described, make_mesh(table.mu_o.values, azimuths), errors


def describe_page_axis(axis: SweepAxis, values: Array, unit: str) -> dict[str, Any]:
    """The name, unit and values of a slider."""
    label = (axis.name.removesuffix("_um") if unit == "um" else axis.name).replace("_", " ")
    shown = {"name": axis.name, "label": label, "key": axis.key, "unit": UNITS.get(unit, unit)}
    return {**shown, "values": values.tolist(), "log": is_logarithmic(values), "between": is_between(values)}


def make_mesh(mu_o: Array, azimuths: Array) -> dict[str, Any]:
    """Rings and spokes of the bodies, and weights of the splines to them: ``around`` (SPOKES, full circle) for Stokes
    vectors in axes that do not turn, ``over`` (rings, great circle), as `vrte.over_hemisphere` interpolates."""
    theta = np.degrees(np.arccos(mu_o))
    circle, _ = mirror_azimuths(azimuths)
    spokes = np.linspace(0.0, 360.0, SPOKES, endpoint=False)
    grid, turn = repeat_grid(circle, 360.0)
    around = np.zeros((SPOKES, circle.size))
    np.add.at(around.T, turn, compute_weights(grid, spokes).T)
    first = float(theta[0]) if theta[0] > HOLE else 0.0
    rings = np.linspace(first, float(theta[-1]), min(MOST_RINGS, max(FEWEST_RINGS, 2 * theta.size)))
    index: Array = np.arange(float(theta.size))
    along, order = extend_over_pole(theta, index, index)
    behind = along.size - theta.size
    over = compute_weights(along, rings)
    return {
        "theta": np.round(rings, 9).tolist(),
        "spokes": SPOKES,
        "around": np.round(around, 7).ravel().tolist(),
        "behind": order[:behind].astype(int).tolist(),
        "over": np.round(over, 7).ravel().tolist(),
    }


def measure_page_error(table: "xarray.Dataset", sweep: Sweep, points: int, seed: int = 0) -> Array:
    """How far lobes (points,) between scenes and directions are from exact ones, over the largest f_00."""
    chance = np.random.default_rng(seed)
    drawn = {
        axis.name: sample_axis(axis.values, points, chance)
        if is_between(axis.values)
        else chance.choice(axis.values, points)
        for axis in sweep.axes
    }
    angle_o = np.arccos(table.mu_o.values)
    errors = []
    for index in range(points):
        point = {name: float(values[index]) for name, values in drawn.items()}
        mu_i = float(chance.choice(table.mu_i.values))
        theta = np.sort(chance.uniform(angle_o[0], angle_o[-1], 12))
        phi = np.sort(chance.uniform(0.0, 180.0, 12))
        directions = {"mu_i": mu_i, "mu_o": np.cos(theta).tolist(), "phi_deg": phi.tolist()}
        exact = solve_point(replace(sweep, template={**sweep.template, "brdf": directions}), point)
        near = interpolate(table, point | {"mu_i": mu_i}).mueller.values
        axes = {"mu_o": table.mu_o.values, "phi": table.phi_deg.values}
        seen = replace(exact, mueller=near[None], **axes, surface=None, transmission=None)
        columns = [stokes_over_hemisphere(seen, 0, np.degrees(theta), phi, unit) for unit in np.eye(4)]
        off = np.abs(np.stack(columns, axis=-1) - exact.mueller[0]).max()
        errors.append(float(off / near[..., 0, 0].max()))
    return np.array(errors)


def is_between(values: Array) -> bool:
    """Whether the page goes between the values of an axis: where it has enough of them for a cubic."""
    return values.size > DEGREE
