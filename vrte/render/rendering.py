"""From scene files to what a picture shows: colours and luminance-weighted Stokes vectors of each object."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.appearance.lights import import_colour_science
from vrte.basics.arrays import Array
from vrte.optics.facets import RoughSurface
from vrte.render import colour
from vrte.render.geometry import UP, Camera, place_camera
from vrte.render.objects import Stage, draw_background, draw_object
from vrte.render.rays import place_lens
from vrte.render.setting import SPHERE, Material, Setting
from vrte.render.shapes import find_shape
from vrte.render.sky import Sky, make_sky
from vrte.render.spheres import Resolution, Table, View, compute_irradiance, leave_out_facets, tabulate_brdf
from vrte.render.surfaces import Light
from vrte.results.brdf import Brdf

RESOLUTIONS = (Resolution(), Resolution(48, 180), Resolution(64, 240))
MOST_AT_ONCE = 12  # wavelengths whose tables are in memory, 24 MB each and as much again while they are made
APART = 1.15  # middles of objects beside each other
FINE_ENOUGH = 3e-3  # error of a BRDF between the directions of its table


@dataclass(frozen=True, eq=False)
class Rendering:
    """One picture before it is drawn, of a material, or of more that stand beside each other.

    ``xyz`` (height, width, 3), CIE XYZ, and ``stokes`` (height, width, 4), weighted by luminance; Y and I are 1 for a
    white Lambertian surface that faces the sun in the same light. NaN around a sphere. Stokes axes: l upright, r to the
    right, so that angles of polarization run clockwise from the upright. ``film`` makes colours of ``xyz``, and
    ``cover`` (height, width) is a sphere's share of each pixel, 1 around what stands on the ground. ``errors``: those
    of the BRDFs between the directions of their tables, as `measure_interpolation_error` found them. Middles of objects
    are ``apart`` [pixels].
    """

    materials: Sequence[Material]
    xyz: Array
    stokes: Array
    cover: Array
    film: colour.Film
    errors: Sequence[float]
    apart: float = 0.0

    @property
    def title(self) -> str:
        """The words above a picture that say which material it shows."""
        return ", ".join(material.title for material in self.materials)

    @property
    def rgba(self) -> Array:
        """In colour, (height, width, 4) from 0 to 1, transparent around a sphere."""
        return np.concatenate([self.film(np.nan_to_num(self.xyz)), self.cover[..., None]], axis=-1)


def compute_pictures(
    materials: Sequence[Material],
    setting: Setting,
    progress: Callable[[int, int, str], None] | None = None,
    resolutions: Sequence[Resolution] = RESOLUTIONS,
    together: bool = False,
) -> list[Rendering]:
    """The pictures of all materials, or the one in which they stand beside each other; ``progress`` is called with
    (steps done, steps, what begins).

    The first of ``resolutions`` that is fine enough is taken, or the last. Raises MissingExtraError without
    colour-science or what objects take, SceneError, and what `vrte.brdf` raises.
    """
    import_colour_science(*colour.NEEDED)
    told = progress or (lambda *_: None)
    done, steps = 0, sum(_count_steps(material) for material in materials)

    def tell(count: int, title: str) -> None:
        nonlocal done
        told(done, steps, title)
        done += count
        told(done, steps, title)

    if together:
        return [_draw_on_ground(materials, setting, tell, resolutions)]
    views: dict[tuple[Any, ...], View] = {}  # the last one: a view takes some hundred megabytes
    return [
        _draw_sphere(material, setting, tell, resolutions, views)
        if material.shape == SPHERE
        else _draw_on_ground([material], setting, tell, resolutions)
        for material in materials
    ]


def _count_steps(material: Material) -> int:
    """Of the work: the table and the picture of each wavelength."""
    return 2 * material.wavelengths_um.size


def _draw_sphere(
    material: Material,
    setting: Setting,
    tell: Callable[[int, str], None],
    resolutions: Sequence[Resolution],
    views: dict[tuple[Any, ...], View],
) -> Rendering:
    """One sphere without surroundings, its wavelengths weighed to a picture in colour and one of polarization."""
    tell(0, material.title)
    table, error = find_fine_table(material, resolutions)
    key = (table.resolution, *material.wavelengths_um.tolist())
    if key not in views:
        views.clear()
        views[key] = make_view(setting, material.wavelengths_um, table.resolution)
    view, seen = views[key], []
    for place, wavelength in enumerate(material.wavelengths_um.tolist()):
        if place and material.coloured:
            table = _tabulate_material(material, wavelength, table.resolution)
        seen.append(view.stokes(table, place).astype(np.float32))
        tell(2, material.title)
    stokes, observer = np.stack(seen), colour.weigh_wavelengths(material.wavelengths_um)
    light = weigh_light(view.sky, observer)
    return Rendering(
        [material],
        _place_in_picture(view, np.einsum("cw,wp->pc", observer, stokes[..., 0]) / light[1, 0]),
        _place_in_picture(view, np.einsum("w,wps->ps", observer[1], stokes) / light[1, 0]),
        view.cover,
        colour.make_film(light[:, 1], setting.exposure),
        [error],
    )


def _draw_on_ground(
    materials: Sequence[Material],
    setting: Setting,
    tell: Callable[[int, str], None],
    resolutions: Sequence[Resolution],
) -> Rendering:
    """Objects beside each other, on the ground under the sky."""
    stage = set_stage(materials, setting)
    found, samples, errors, films = np.zeros(0), None, [], []
    for place, material in enumerate(materials):
        tell(0, material.title)
        wavelengths = material.wavelengths_um
        sky = _make_sky(setting, wavelengths)
        observer = colour.weigh_wavelengths(wavelengths)
        white = weigh_light(sky, observer)
        observer /= white[1, 0]
        films.append(colour.make_film(white[:, 1], setting.exposure))
        if samples is None:
            found, samples = draw_background(stage, Light.of(sky, setting.ground_albedo, stage.ground), observer)
        own = samples.choose(np.flatnonzero(samples.body == place))
        table, error = find_fine_table(material, resolutions)
        errors.append(error)
        for chosen in np.array_split(np.arange(wavelengths.size), -(-wavelengths.size // MOST_AT_ONCE)):
            tables = []
            for wavelength in wavelengths[chosen].tolist():
                coloured = material.coloured and wavelength != wavelengths[0]
                tables.append(_tabulate_material(material, wavelength, table.resolution) if coloured else table)
                tell(1, material.title)
            part = replace(sky, sun=sky.sun[chosen], splines=sky.splines[chosen], ground=sky.ground[chosen])
            light = Light.of(part, setting.ground_albedo, stage.ground)
            if own.pixel.size:
                found += draw_object(stage, own, tables, light, observer[:, chosen])
            tell(chosen.size, material.title)
    shape = stage.lens.height, stage.lens.width
    return Rendering(
        materials,
        found[:, :3].reshape(*shape, 3),
        found[:, [1, 3, 4, 5]].reshape(*shape, 4),
        np.ones(shape),
        films[0],
        errors,
        APART * stage.lens.height / (2.0 * stage.lens.spread * stage.lens.distance),
    )


def set_stage(materials: Sequence[Material], setting: Setting) -> Stage:
    """Objects in a row on the ground, before the camera. Raises SceneError, OSError, MissingExtraError."""
    camera = _place_camera(setting)
    bodies = []
    for place, material in enumerate(materials):
        shape = find_shape(material.shape)
        sideways = APART * (place - 0.5 * (len(materials) - 1)) * camera.right
        turn = material.turn_deg - setting.sun_azimuth_deg  # the same side faces the camera, wherever the sun is
        bodies.append(shape.place(turn, (float(sideways[0]), float(sideways[1]))))
    sky = make_sky("sun", [1.0], setting.sun_elevation_deg, 0.0)
    return Stage(bodies, place_lens(camera, bodies, setting.size_px), sky.beam)


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
    return View(_place_camera(setting), _make_sky(setting, wavelengths_um), setting.size_px, resolution)


def _make_sky(setting: Setting, wavelengths_um: Array) -> Sky:
    """Sun, sky and ground that a setting asks for, solved at the wavelengths."""
    return make_sky(setting.sky, wavelengths_um.tolist(), setting.sun_elevation_deg, setting.ground_albedo)


def _place_camera(setting: Setting) -> Camera:
    """The camera of a setting: the sun is to the right of one that stands clockwise of it."""
    return place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)


def weigh_light(sky: Sky, observer: Array) -> Array:
    """XYZ (3, 2) of a white Lambertian surface that faces the sun, and of one that lies level."""
    found: Array = observer @ compute_irradiance(sky, np.stack([-sky.beam, UP])) / np.pi
    return found


def _place_in_picture(view: View, values: Array) -> Array:
    """Values (pixel, c) where they belong, (size, size, c); NaN elsewhere."""
    flat = np.full((view.size**2, values.shape[1]), np.nan)
    flat[view.pixels[0]] = values
    return flat.reshape(view.size, view.size, -1)
