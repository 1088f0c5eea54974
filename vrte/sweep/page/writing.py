"""A table of BRDFs, or several, as a page to look at: what it holds, how wrong that is between the scenes, the file."""

import html
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import compute_weights, extend_over_pole, mirror_azimuths, repeat_grid
from vrte.formats.atomic import write_atomically
from vrte.results.over_hemisphere import HOLE, check_directions, stokes_over_hemisphere
from vrte.sweep.interpolation import DEGREE, TABLES, interpolate, is_logarithmic, sample_axis, solve_point
from vrte.sweep.page.packing import pack_matrices, take_half_circle, unpack_matrices
from vrte.sweep.template import Sweep, read_sweep

if TYPE_CHECKING:
    import xarray

POINTS = 4  # at which a table is compared with exact solves
LARGEST_PAGE = 60e6  # bytes: beyond, phones give up
FEWEST_RINGS, MOST_RINGS, SPOKES = 36, 72, 72  # of the body that is drawn
SUFFIX = ".html"
UNITS = {"um": "µm", "1": ""}
SHARES = ("reflectance", "total_reflectance", "specular")


def save_page(
    tables: Mapping[str, "xarray.Dataset"],
    path: str | os.PathLike[str],
    points: int = POINTS,
    folder: Path | None = None,
) -> dict[str, Array]:
    """Writes a page with the lobes of tables to turn around: one file without network or server, all of it or nothing.

    Parameters
    ----------
    tables : mapping of str to xarray.Dataset
        Tables of BRDFs of `vrte.sweep` by the names that the page shows.
    path : path
        Ends in .html.
    points : int
        At how many random points, between the scenes and directions of each table, an exact solve tells how far the
        page is off; the page says what came out.
    folder : path, optional
        Where the files are that the sweeps name; by default the working folder.

    Returns
    -------
    dict of str to numpy.ndarray
        For each table the errors (points,), as `measure_page_error` finds them.

    Raises
    ------
    SceneError
        For a table of fields or appearances, axes that are no grid, too few directions, scenes without result or
        without light, and a page larger than 60 MB.
    OSError
        Where the file cannot be written.

    Examples
    --------
    >>> import vrte
    >>> from vrte.sweep.page.writing import save_page
    >>> layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    >>> brdf = {"mu_i": 0.5, "mu_o": [0.2, 0.6, 1.0], "phi_deg": [0, 90, 180]}
    >>> axes = {"layer[1].thickness": [0.5, 1.0, 2.0, 4.0]}
    >>> table = vrte.sweep({"nodes": 4, "layer": [layer], "brdf": brdf, "axes": axes}, workers=1)
    >>> save_page({"a layer": table}, "layer.html", points=1)["a layer"].shape
    (1,)
    """
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
    text = fill_page({"meshes": meshes, "tables": described})
    if len(text) > LARGEST_PAGE:
        raise SceneError(
            f"the page would have {len(text) / 1e6:.0f} MB, at most {LARGEST_PAGE / 1e6:.0f} are allowed: "
            "fewer scenes or directions"
        )
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8", newline="")
    return errors


def fill_page(content: dict[str, Any]) -> str:
    """The page's text with style, script and content inside."""
    here = files("vrte.sweep.page")
    data = json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    title = html.escape(", ".join(table["name"] for table in content["tables"][:3]))
    parts = {"TITLE": title, "STYLE": (here / "page.css").read_text("utf-8")}
    parts |= {"SCRIPT": (here / "page.js").read_text("utf-8"), "CONTENT": data}
    text = (here / "page.html").read_text("utf-8")
    for name, part in parts.items():
        text = text.replace(f"@{name}@", part, 1)
    return text


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
    table = sort_table(table.load(), sweep)
    azimuths, matrices = take_half_circle(table)
    check_directions(table.mu_o.values, azimuths)
    failed = int((table.error.values != "").sum())
    if failed:
        raise SceneError(f"{failed} of its {sweep.count} scenes have no result, and a page needs all")
    if not (np.isfinite(matrices).all() and (matrices[..., 0, 0] > 0.0).all()):
        raise SceneError("a page needs light in every direction: f_00 is not above 0 everywhere")
    packed = pack_matrices(matrices)
    seen = replace_matrices(table, azimuths, unpack_matrices(packed))
    errors = measure_page_error(seen, sweep, points)
    said = {
        "axes": [describe_page_axis(axis.name, axis.key, table) for axis in sweep.axes],
        "mu_i": table.mu_i.values.tolist(),
        "mu_o": table.mu_o.values.tolist(),
        "phi": azimuths.tolist(),
        "packed": asdict(packed),
        "shares": {name: round_numbers(table[name].values) for name in SHARES if name in table},
        "surface": "total_reflectance" in table,
        "error": {"largest": float(errors.max()), "median": float(np.median(errors)), "points": points},
        "source": table.attrs["source"],
    }
    return said, make_mesh(table.mu_o.values, azimuths), errors


def sort_table(table: "xarray.Dataset", sweep: Sweep) -> "xarray.Dataset":
    """The table with ascending axes, incidence and exit from the normal on. Raises SceneError for the same incidence or
    exit twice."""
    table = table.sortby([axis.name for axis in sweep.axes]).sortby(["mu_i", "mu_o"], ascending=False)
    for name in ("mu_i", "mu_o"):
        if (np.diff(table[name].values) == 0.0).any():
            raise SceneError(f"brdf.{name} has the same value twice")
    return table


def replace_matrices(table: "xarray.Dataset", azimuths: Array, matrices: Array) -> "xarray.Dataset":
    """The table with other azimuths and Mueller matrices (axes ..., mu_i, mu_o, phi, 4, 4)."""
    dims = table.mueller.dims
    return table.drop_dims("phi_deg").assign_coords(phi_deg=azimuths).assign(mueller=(dims, matrices))


def describe_page_axis(name: str, key: str, table: "xarray.Dataset") -> dict[str, Any]:
    """What a slider is called and goes along."""
    values = np.asarray(table[name].values, np.float64)
    unit = str(table[name].attrs.get("units", "1"))
    label = name.removesuffix("_um").replace("_", " ") if unit == "um" else name.replace("_", " ")
    shown = {"label": label, "key": key, "unit": UNITS.get(unit, unit)}
    return {
        "name": name,
        **shown,
        "values": values.tolist(),
        "log": is_logarithmic(values),
        "between": is_between(values),
    }


def round_numbers(values: Array) -> Any:
    """Shares to six digits, as lists."""
    return np.round(values, 6).tolist()


def make_mesh(mu_o: Array, azimuths: Array) -> dict[str, Any]:
    """Rings and spokes of the bodies, and the splines that lead there from the directions of a table, as weights.

    ``around`` (SPOKES, full circle) takes Stokes vectors in axes that do not turn to the spokes, ``over`` (rings, great
    circle) those on a spoke and half a turn away to the rings, as `vrte.over_hemisphere` does.
    """
    theta = np.degrees(np.arccos(mu_o))
    circle, _ = mirror_azimuths(azimuths)
    spokes = np.linspace(0.0, 360.0, SPOKES, endpoint=False)
    grid, turn = repeat_grid(circle, 360.0)
    around = np.zeros((SPOKES, circle.size))
    np.add.at(around.T, turn, compute_weights(grid, spokes).T)
    first = float(theta[0]) if theta[0] > HOLE else 0.0
    rings = np.linspace(first, float(theta[-1]), min(MOST_RINGS, max(FEWEST_RINGS, 2 * theta.size)))
    place: Array = np.arange(float(theta.size))
    along, order = extend_over_pole(theta, place, place)
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
    """How far lobes (points,) between a table's scenes and directions are from exact solves, by the largest difference
    of a Mueller element at random directions over the largest f_00. Where the page goes in steps, it is on one."""
    chance = np.random.default_rng(seed)
    drawn = {
        axis.name: (sample_axis if is_between(axis.values) else sample_values)(axis.values, points, chance)
        for axis in sweep.axes
    }
    angle_o = np.arccos(table.mu_o.values)
    errors = []
    for place in range(points):
        point = {name: float(values[place]) for name, values in drawn.items()}
        mu_i = float(chance.choice(table.mu_i.values))
        theta = np.sort(chance.uniform(angle_o[0], angle_o[-1], 12))
        phi = np.sort(chance.uniform(0.0, 180.0, 12))
        directions = {"mu_i": mu_i, "mu_o": np.cos(theta).tolist(), "phi_deg": phi.tolist()}
        exact = solve_point(replace(sweep, template={**sweep.template, "brdf": directions}), point)
        near = interpolate(table, point | {"mu_i": mu_i}).mueller.values
        seen = replace(
            exact, mueller=near[None], mu_o=table.mu_o.values, phi=table.phi_deg.values, surface=None, transmission=None
        )
        columns = [stokes_over_hemisphere(seen, 0, np.degrees(theta), phi, unit) for unit in np.eye(4)]
        off = np.abs(np.stack(columns, axis=-1) - exact.mueller[0]).max()
        errors.append(float(off / near[..., 0, 0].max()))
    return np.array(errors)


def is_between(values: Array) -> bool:
    """Whether the page goes between the values of an axis: where it has enough of them for a cubic.

    >>> is_between(np.arange(4.0)), is_between(np.arange(3.0))
    (True, False)
    """
    return values.size > DEGREE


def sample_values(values: Array, count: int, chance: np.random.Generator) -> Array:
    """Random ones of the values of an axis."""
    return chance.choice(values, count)
