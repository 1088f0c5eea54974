"""From scene files to what a picture shows: colours and luminance-weighted Stokes vectors of each sphere."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vrte.arrays import Array
from vrte.render import colour
from vrte.render.geometry import UP, camera_at
from vrte.render.setting import Material, Setting
from vrte.render.sky import sky_of
from vrte.render.spheres import Resolution, View, irradiance, sphere

SUN_AZIMUTH = 0.0  # in the world; the camera stands where the setting says
STEPS = 100  # of progress at each stage


@dataclass(frozen=True, eq=False)
class Sphere:
    """One sphere, ready to be shown.

    ``xyz`` (size, size, 3), CIE XYZ, and ``stokes`` (size, size, 4), weighted by luminance; Y and I are 1 for a white
    Lambertian surface that faces the sun in the same light. NaN around the sphere. Stokes axes: l upright, r to the
    right, so that angles of polarization run clockwise from the upright. ``film`` makes colours of ``xyz``, and
    ``cover`` (size, size) is the sphere's share of each pixel.
    """

    material: Material
    xyz: Array
    stokes: Array
    cover: Array
    film: colour.Film

    @property
    def rgba(self) -> Array:
        """The sphere in colour, (size, size, 4) from 0 to 1, transparent around it."""
        return np.concatenate([self.film(np.nan_to_num(self.xyz)), self.cover[..., None]], axis=-1)


def rendered(
    materials: Sequence[Material],
    setting: Setting,
    progress: Callable[[int, int, str], None] | None = None,
    resolution: Resolution = Resolution(),  # noqa: B008 (frozen)
) -> list[Sphere]:
    """The spheres of one picture; ``progress`` is called with (steps done, steps, what begins).

    Raises MissingExtraError without colour-science, SceneError, and what `vrte.brdf` raises.
    """
    colour.science()
    views: dict[tuple[float, ...], View] = {}
    spheres = []
    for place, material in enumerate(materials):
        told = [_part(progress, 2 * place + half, 2 * len(materials), material.title) for half in (0, 1)]
        brdfs = material.brdfs(resolution, told[0])
        key = tuple(material.wavelengths_um.tolist())
        if key not in views:
            views[key] = view_of(setting, material.wavelengths_um, resolution)
        found = sphere(views[key], brdfs, told[1])
        spheres.append(_developed(material, views[key], found, setting.exposure))
    return spheres


def view_of(setting: Setting, wavelengths_um: Array, resolution: Resolution) -> View:
    """Camera and light of a setting; the sun stands at azimuth 0."""
    sky = sky_of(setting.sky, wavelengths_um.tolist(), setting.sun_elevation_deg, setting.ground_albedo)
    # the sun is to the right of a camera that stands clockwise of it
    camera = camera_at(setting.camera_elevation_deg, -setting.sun_azimuth_deg)
    return View(camera, sky, setting.size_px, resolution)


def _developed(material: Material, view: View, stokes: Array, stops: float) -> Sphere:
    """Colours and luminance-weighted Stokes vectors, from Stokes vectors (wavelength, pixel, 4)."""
    observer = colour.weights(material.wavelengths_um)
    light = observer @ irradiance(view.sky, np.stack([-view.sky.beam, UP])) / np.pi
    unit, level = light[1, 0], light[:, 1]
    return Sphere(
        material,
        _in_picture(view, np.einsum("cw,wp->pc", observer, stokes[..., 0]) / unit),
        _in_picture(view, np.einsum("w,wps->ps", observer[1], stokes) / unit),
        view.cover,
        colour.film(level, stops),
    )


def _in_picture(view: View, values: Array) -> Array:
    """Values (pixel, c) where they belong, (size, size, c); NaN elsewhere."""
    flat = np.full((view.size**2, values.shape[1]), np.nan)
    flat[view.pixels[0]] = values
    return flat.reshape(view.size, view.size, -1)


def _part(
    progress: Callable[[int, int, str], None] | None, place: int, count: int, name: str
) -> Callable[[int, int], None] | None:
    """Progress at one of ``count`` stages."""
    if progress is None:
        return None
    return lambda done, total: progress(STEPS * place + STEPS * done // max(total, 1), STEPS * count, name)
