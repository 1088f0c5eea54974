"""From scene files to what a picture shows: colours and luminance-weighted Stokes vectors of each object."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vrte.appearance.colours import import_colour_science
from vrte.basics.arrays import Array
from vrte.optics.facets import RoughSurface
from vrte.render.geometry import UP, place_camera, place_lens
from vrte.render.objects import CHANNELS, Stage, View, draw_background, draw_object, weigh_channels
from vrte.render.setting import SPHERE, Material, PictureSetting
from vrte.render.shapes import find_shape
from vrte.render.sky import NEEDED, Film, Sky, make_film, make_sky, weigh_wavelengths
from vrte.render.surfaces import SceneLight, compute_irradiance
from vrte.render.tables import BrdfTable, Resolution, leave_out_facets, tabulate_brdf
from vrte.results.brdf import Brdf

RESOLUTIONS = (Resolution(), Resolution(48, 180), Resolution(64, 240))
MOST_AT_ONCE = 12  # wavelengths whose tables are in memory, 24 MB each and as much again while they are made
MOST_SPLINES = 2_000_000  # coefficients, of 128 bytes each, of all tables of a sphere that are in memory
APART = 1.15  # middles of objects beside each other
FINE_ENOUGH = 3e-3  # error of a BRDF between the directions of its table


@dataclass(frozen=True, eq=False)
class Rendering:
    """One picture before it is drawn, of a material, or of more that stand beside each other.

    CIE ``xyz`` (height, width, 3) and ``stokes`` (height, width, 4), weighted by luminance; Y and I are 1 for a white
    Lambertian surface that faces the sun, NaN around a sphere. Stokes axes: l upright, r to the right. ``cover``
    (height, width) is a sphere's fraction of each pixel, 1 around what stands on the ground. ``errors`` of the BRDFs
    between the directions of their tables; middles of objects are ``apart`` [pixels].
    """

    materials: Sequence[Material]
    xyz: Array
    stokes: Array
    cover: Array
    film: Film
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
    setting: PictureSetting,
    progress: Callable[[int, int, str], None] | None = None,
    resolutions: Sequence[Resolution] = RESOLUTIONS,
    together: bool = False,
) -> list[Rendering]:
    """The pictures of all materials, or the one in which they stand beside each other; ``progress`` is called with
    (steps done, steps, what begins). The first of ``resolutions`` that is fine enough is taken, or the last. Raises
    MissingExtraError, SceneError, and what `vrte.brdf` raises."""
    import_colour_science(*NEEDED)
    done, steps = 0, sum(2 * material.wavelengths_um.size for material in materials)  # a table and a picture each

    def step(count: int, title: str) -> None:
        nonlocal done
        done += count
        if progress is not None:
            progress(done, steps, title)

    if together:
        return [draw_on_ground(materials, setting, step, resolutions)]
    return [
        draw_sphere(material, setting, step, resolutions)
        if material.shape == SPHERE
        else draw_on_ground([material], setting, step, resolutions)
        for material in materials
    ]


Step = Callable[[int, str], None]


@dataclass(frozen=True, eq=False)
class Lit:
    """A material in its light: sky, observer and film for its wavelengths, and the tables of its BRDF."""

    material: Material
    setting: PictureSetting
    resolutions: Sequence[Resolution]
    step: Step

    @cached_property
    def sky(self) -> Sky:
        setting = self.setting
        wavelengths = self.material.wavelengths_um.tolist()
        return make_sky(setting.sky, wavelengths, setting.sun_elevation_deg, setting.ground_albedo)

    @cached_property
    def weighed(self) -> tuple[Array, Film]:
        """The observer, Y = 1 for a white surface that faces the sun, and the film for level ground's light."""
        observer = weigh_wavelengths(self.material.wavelengths_um)
        white = observer @ compute_irradiance(self.sky, np.stack([-self.sky.beam, UP])) / np.pi
        return observer / white[1, 0], make_film(white[:, 1], self.setting.exposure)

    @cached_property
    def first(self) -> tuple[BrdfTable, float]:
        """The table that is fine enough at the first, shortest wavelength, where BRDFs vary most, and its error."""
        return find_fine_table(self.material, self.resolutions)

    def tabulate(self, most: int) -> Iterator[tuple[Any, list[BrdfTable]]]:
        """Indices of wavelengths, at most so many at once, and the tables there."""
        material, table = self.material, self.first[0]
        wavelengths = material.wavelengths_um
        for chosen in np.array_split(np.arange(wavelengths.size), -(-wavelengths.size // most)):
            tables = []
            for index in chosen.tolist():
                same = index == 0 or not material.coloured
                tables.append(table if same else tabulate_material(material, wavelengths[index], table.resolution))
                self.step(1, material.title)
            yield chosen, tables
            self.step(chosen.size, material.title)


def draw_sphere(
    material: Material, setting: PictureSetting, step: Step, resolutions: Sequence[Resolution]
) -> Rendering:
    """One sphere without surroundings."""
    step(0, material.title)
    lit = Lit(material, setting, resolutions, step)
    table, error = lit.first
    camera = place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)  # the sun stands at azimuth 0
    view = View(camera, lit.sky, setting.size_px, table.resolution)
    observer, film = lit.weighed
    found = np.full((view.size**2, CHANNELS), np.nan)
    found[view.pixels[0]] = 0.0
    for chosen, tables in lit.tabulate(max(1, MOST_SPLINES // (table.splines.size // 16))):
        found[view.pixels[0]] += weigh_channels(view.stokes(tables, chosen), observer[:, chosen])
    picture = found.reshape(view.size, view.size, CHANNELS)
    return Rendering([material], picture[..., :3], picture[..., [1, 3, 4, 5]], view.cover, film, [error])


def draw_on_ground(
    materials: Sequence[Material], setting: PictureSetting, step: Step, resolutions: Sequence[Resolution]
) -> Rendering:
    """Objects beside each other, on the ground under the sky."""
    stage = set_stage(materials, setting)
    all_lit = [Lit(material, setting, resolutions, step) for material in materials]
    step(0, materials[0].title)
    light = SceneLight.of(all_lit[0].sky, setting.ground_albedo, stage.ground)
    found, samples = draw_background(stage, light, all_lit[0].weighed[0])
    for index, lit in enumerate(all_lit):
        step(0, lit.material.title)
        own = samples.choose(np.flatnonzero(samples.body == index))
        for chosen, tables in lit.tabulate(MOST_AT_ONCE):
            light = SceneLight.of(lit.sky.choose(chosen), setting.ground_albedo, stage.ground)
            if own.pixel.size:
                found += draw_object(stage, own, tables, light, lit.weighed[0][:, chosen])
    picture = found.reshape(stage.lens.height, stage.lens.width, CHANNELS)
    apart = APART * stage.lens.height / (2.0 * stage.lens.spread * stage.lens.distance)
    errors = [lit.first[1] for lit in all_lit]
    cover, film = np.ones(picture.shape[:2]), all_lit[0].weighed[1]
    return Rendering(materials, picture[..., :3], picture[..., [1, 3, 4, 5]], cover, film, errors, apart)


def set_stage(materials: Sequence[Material], setting: PictureSetting) -> Stage:
    """Objects in a row on the ground, before the camera. Raises SceneError, OSError, MissingExtraError."""
    camera = place_camera(setting.camera_elevation_deg, -setting.sun_azimuth_deg)  # the sun stands at azimuth 0
    bodies = []
    for index, material in enumerate(materials):
        shape = find_shape(material.shape)
        sideways = APART * (index - 0.5 * (len(materials) - 1)) * camera.right
        turn = material.turn_deg - setting.sun_azimuth_deg  # the same side faces the camera, wherever the sun is
        bodies.append(shape.place(turn, (float(sideways[0]), float(sideways[1]))))
    sky = make_sky("sun", [1.0], setting.sun_elevation_deg, 0.0)
    return Stage(bodies, place_lens(camera, bodies, setting.size_px), sky.beam)


def find_fine_table(material: Material, resolutions: Sequence[Resolution]) -> tuple[BrdfTable, float]:
    """The table at the first, shortest wavelength, where BRDFs vary most, fine enough; and its error."""
    wavelength = float(material.wavelengths_um[0])
    for resolution in resolutions:
        table = tabulate_material(material, wavelength, resolution)
        error = measure_interpolation_error(material, wavelength, table)
        if error <= FINE_ENOUGH:
            break
    return table, error


def tabulate_material(material: Material, wavelength_um: float, resolution: Resolution) -> BrdfTable:
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


def measure_interpolation_error(material: Material, wavelength_um: float, table: BrdfTable) -> float:
    """The largest error of any element of the BRDF times mu_i in 512 directions off the table's grid, all cosines above
    0.05, over the largest such value; or that of the fraction mirrored as a beam, where it is larger."""
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
