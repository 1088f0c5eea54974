"""From scene files to what a picture shows: colours and luminance-weighted Stokes vectors of each sphere."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.appearance.lights import import_colour_science
from vrte.basics.arrays import Array
from vrte.optics.facets import RoughSurface
from vrte.render import colour
from vrte.render.geometry import UP, place_camera
from vrte.render.setting import Material, Setting
from vrte.render.sky import make_sky
from vrte.render.spheres import Resolution, Table, View, compute_irradiance, leave_out_facets, tabulate_brdf
from vrte.results.brdf import Brdf

RESOLUTIONS = (Resolution(), Resolution(48, 180), Resolution(64, 240))
FINE_ENOUGH = 3e-3  # error of a BRDF between the directions of its table


@dataclass(frozen=True, eq=False)
class Sphere:
    """One sphere, ready to be shown.

    ``xyz`` (size, size, 3), CIE XYZ, and ``stokes`` (size, size, 4), weighted by luminance; Y and I are 1 for a white
    Lambertian surface that faces the sun in the same light. NaN around the sphere. Stokes axes: l upright, r to the
    right, so that angles of polarization run clockwise from the upright. ``film`` makes colours of ``xyz``, and
    ``cover`` (size, size) is the sphere's share of each pixel. ``error`` is that of the BRDF between the directions of
    its table, as `measure_interpolation_error` found it.
    """

    material: Material
    xyz: Array
    stokes: Array
    cover: Array
    film: colour.Film
    error: float

    @property
    def rgba(self) -> Array:
        """The sphere in colour, (size, size, 4) from 0 to 1, transparent around it."""
        return np.concatenate([self.film(np.nan_to_num(self.xyz)), self.cover[..., None]], axis=-1)


def compute_spheres(
    materials: Sequence[Material],
    setting: Setting,
    progress: Callable[[int, int, str], None] | None = None,
    resolutions: Sequence[Resolution] = RESOLUTIONS,
) -> list[Sphere]:
    """The spheres of one picture; ``progress`` is called with (steps done, steps, what begins).

    The first of ``resolutions`` that is fine enough is taken, or the last. Raises MissingExtraError without
    colour-science, SceneError, and what `vrte.brdf` raises.
    """
    import_colour_science(*colour.NEEDED)
    tell = progress or (lambda *_: None)
    views: dict[tuple[Any, ...], View] = {}  # the last one: a view takes some hundred megabytes
    steps, done = sum(material.wavelengths_um.size for material in materials), 0
    spheres = []
    for material in materials:
        tell(done, steps, material.title)
        table, error = find_fine_table(material, resolutions)
        key = (table.resolution, *material.wavelengths_um.tolist())
        if key not in views:
            views.clear()
            views[key] = make_view(setting, material.wavelengths_um, table.resolution)
        seen = []
        for place, wavelength in enumerate(material.wavelengths_um.tolist()):
            if place and material.coloured:
                table = _tabulate_material(material, wavelength, table.resolution)
            seen.append(views[key].stokes(table, place).astype(np.float32))
            done += 1
            tell(done, steps, material.title)
        spheres.append(_develop_sphere(material, views[key], np.stack(seen), setting.exposure, error))
    return spheres


def find_fine_table(material: Material, resolutions: Sequence[Resolution]) -> tuple[Table, float]:
    """The table at the first, shortest wavelength, where BRDFs vary most, fine enough; and its error."""
    wavelength = float(material.wavelengths_um[0])
    for resolution in resolutions:
        table = _tabulate_material(material, wavelength, resolution)
        error = measure_interpolation_error(material, wavelength, table)
        if error <= FINE_ENOUGH:
            break
    return table, error


def _tabulate_material(material: Material, wavelength_um: float, resolution: Resolution) -> Table:
    brdf = material.brdf(wavelength_um, resolution.mu, resolution.mu, resolution.phi)
    return tabulate_brdf(brdf, resolution, find_facets(brdf, material.surface(wavelength_um)))


def find_facets(brdf: Brdf, surface: RoughSurface | None) -> RoughSurface | None:
    """The surface's facets, each by itself, where it is all that reflects without any particle: in closed form."""
    if surface is None:
        return None
    alone = surface.reflect(brdf.mu_i[:, None, None], brdf.mu_o[:, None], brdf.phi)
    found = brdf.mueller if brdf.surface is None else brdf.surface
    known = np.allclose(found, alone, rtol=1e-6, atol=1e-6 * np.abs(alone).max())
    return replace(surface, conserving=False) if known else None


def measure_interpolation_error(material: Material, wavelength_um: float, table: Table) -> float:
    """The largest error of any element of the BRDF times mu_i in 512 directions off the table's grid, all cosines above
    0.05, over the largest such value; or that of the share mirrored as a beam, where it is larger."""
    draw = np.random.default_rng(0)
    mu_i, mu_o = draw.uniform(0.05, 1.0, (2, 8))
    phi = draw.uniform(0.0, 180.0, 8)
    brdf = material.brdf(wavelength_um, mu_i, mu_o, phi)
    exact = leave_out_facets(brdf, table.facets) * mu_i[:, None, None, None, None]
    points = [part.ravel() for part in np.meshgrid(mu_i, mu_o, np.radians(phi), indexing="ij")]
    found = table.mueller(*points).reshape(exact.shape) * mu_i[:, None, None, None, None]
    largest = float(np.abs(brdf.mueller * mu_i[:, None, None, None, None]).max())
    error = float(np.abs(found - exact).max()) / largest if largest else 0.0
    if brdf.specular is None or table.specular is None:
        return error
    return max(error, float(np.abs(table.mirror(mu_i) - brdf.specular).max()))


def make_view(setting: Setting, wavelengths_um: Array, resolution: Resolution) -> View:
    """Camera and light of a setting; the sun stands at azimuth 0."""
    sky = make_sky(setting.sky, wavelengths_um.tolist(), setting.sun_elevation_deg, setting.ground_albedo)
    # the sun is to the right of a camera that stands clockwise of it
    camera = place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)
    return View(camera, sky, setting.size_px, resolution)


def _develop_sphere(material: Material, view: View, stokes: Array, stops: float, error: float) -> Sphere:
    """Colours and luminance-weighted Stokes vectors, from Stokes vectors (wavelength, pixel, 4)."""
    observer = colour.weigh_wavelengths(material.wavelengths_um)
    light = observer @ compute_irradiance(view.sky, np.stack([-view.sky.beam, UP])) / np.pi
    unit, level = light[1, 0], light[:, 1]
    return Sphere(
        material,
        _place_in_picture(view, np.einsum("cw,wp->pc", observer, stokes[..., 0]) / unit),
        _place_in_picture(view, np.einsum("w,wps->ps", observer[1], stokes) / unit),
        view.cover,
        colour.make_film(level, stops),
        error,
    )


def _place_in_picture(view: View, values: Array) -> Array:
    """Values (pixel, c) where they belong, (size, size, c); NaN elsewhere."""
    flat = np.full((view.size**2, values.shape[1]), np.nan)
    flat[view.pixels[0]] = values
    return flat.reshape(view.size, view.size, -1)
