"""The light that a sphere by itself sends to the camera.

A sphere is convex, and nothing stands in its light: what leaves a point depends on its normal alone (surfaces.py). The
sky's part is smooth over the sphere: it is computed on rings of normals around the line of sight and splined; the sun's
ends at a sharp edge, and what a smooth surface mirrors has one: both are computed for each pixel.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, make_spline_matrix, repeat_grid
from vrte.render import surfaces
from vrte.render.geometry import Camera, compute_normals, turn_stokes
from vrte.render.sky import Sky, make_horizon_angles
from vrte.render.surfaces import BLOCK, Points, SceneLight, split
from vrte.render.tables import BrdfTable, Lookup, Resolution

MARGIN = 0.94  # of a square picture's half side: the sphere's radius
SUN_RADIUS = np.radians(0.2666)  # of its disc, from 1 au
FINE = 48  # points across the sun's image
LEAST_COSINE = 0.02  # of incidence on the facet that mirrors the sun


@dataclass(frozen=True, eq=False)
class View:
    """A sphere as a far camera sees it: ``size`` is the side of the square picture [pixels]."""

    camera: Camera
    sky: Sky
    size: int
    resolution: Resolution

    @property
    def radius(self) -> float:
        """The sphere's radius in the picture [pixels]."""
        return 0.5 * MARGIN * self.size

    @cached_property
    def pixels(self) -> tuple[Any, Array, Array]:
        """Of the pixels that the sphere touches: place in the flat picture, angle from the line of sight, and psi."""
        across = np.arange(self.size) + 0.5 - 0.5 * self.size
        x, y = across[None, :] + 0.0 * across[:, None], -across[:, None] + 0.0 * across
        distance = np.hypot(x, y).ravel()
        inside = np.flatnonzero(distance < self.radius + 0.5)
        # a pixel on the rim shows the sphere's edge
        sine = np.minimum(distance[inside] / self.radius, np.sin(self.resolution.theta[-1]))
        return inside, np.arcsin(sine), np.arctan2(y, x).ravel()[inside]

    @cached_property
    def cover(self) -> Array:
        """The fraction (size, size) of each pixel that the sphere covers."""
        across = np.arange(self.size) + 0.5 - 0.5 * self.size
        return np.clip(self.radius - np.hypot(across, across[:, None]) + 0.5, 0.0, 1.0)

    def find_points(self, theta: Array, psi: Array) -> Points:
        """The points that are seen at these angles (n,) [rad]."""
        return Points.far(compute_normals(self.camera, theta, psi), self.camera)

    def stokes(self, tables: Sequence[BrdfTable], chosen: Any = slice(None)) -> Array:
        """Stokes radiance (pixel, wavelength, 4) to the camera, of a material with these tables at the wavelengths of
        the sky that are ``chosen``, by default at all."""
        sky, lookup = self.sky.choose(chosen), Lookup.between_splines(tables)
        light, resolution = SceneLight.of(sky), self.resolution
        _, theta, psi = self.pixels
        found = np.zeros((theta.size, len(tables), 4))
        if sky.splines.any() or sky.ground.any():

            def gather(ring: int, points: Points) -> Array:
                return surfaces.gather_skylight(points, lookup.at_outgoing(ring), light, None, resolution)

            found += self.spread(resolution.theta, resolution.around, gather)
        for block in split(theta.size, BLOCK):
            points = self.find_points(theta[block], psi[block])
            found[block] += surfaces.reflect_sunlight(points, True, lookup, sky)
            if tables[0].specular is not None:
                edge = 2.0 / np.maximum(self.radius * points.mu_o, 1.0)  # height that a pixel spans in what it mirrors
                found[block] += surfaces.mirror_surroundings(points, lookup, light, None, edge)
        if tables[0].specular is not None:
            found += self.mirror_sun(tables, sky)
        surface = tables[0].facets
        if surface is not None:
            step = max(0.5 * surface.roughness, 0.02)  # [rad] between normals: what they mirror is blurred by more
            count = max(resolution.angles, min(64, round(1.6 / step)))
            around = max(resolution.around, min(180, 4 * round(np.pi / (2.0 * step))))
            rings = make_horizon_angles(count, float(np.cos(resolution.theta[-1])))
            # facets that do not hide each other are ever brighter towards the rim
            power = 0.0 if surface.shadowing else 1.0
            cosine = np.cos(rings) ** power

            def gather_off(ring: int, points: Points) -> Array:
                return surfaces.gather_off_facets(points, lookup, light, None) * cosine[ring]

            found += self.spread(rings, around, gather_off) / np.cos(theta)[:, None, None] ** power
        return found

    def spread(self, rings: Array, around: int, gather: Callable[[int, Points], Array]) -> Array:
        """Light (pixel, wavelength, 4) that varies smoothly over the sphere, from the light that ``gather`` finds on
        each ring at an angle of ``rings`` [rad], at so many points ``around``."""
        psi = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
        values = np.stack([gather(k, self.find_points(np.full(around, angle), psi)) for k, angle in enumerate(rings)])
        grid, which = repeat_grid(psi)
        splines = compute_coefficients((rings, grid), values[:, which])
        _, pixel_theta, pixel_psi = self.pixels
        to_pixels = make_spline_matrix((rings, grid), (pixel_theta, pixel_psi % (2.0 * np.pi)))
        found: Array = to_pixels @ splines.reshape(rings.size * grid.size, -1)
        return found.reshape(-1, *values.shape[2:])

    def mirror_sun(self, tables: Sequence[BrdfTable], sky: Sky) -> Array:
        """Stokes radiance (pixel, wavelength, 4) of the sun's image in a smooth surface, polarized as at its middle."""
        half = self.camera.toward - sky.beam
        cosine = np.clip([0.5 * np.linalg.norm(half)], LEAST_COSINE, 1.0)
        glint = np.stack([table.mirror(cosine)[0, :, 0] for table in tables])  # of unpolarized light
        turn = np.arctan2(half @ self.camera.up, half @ self.camera.right) - 0.5 * np.pi
        image = mirror_sun(self.camera, sky.beam, self.radius, self.size)[self.pixels[0]]
        return image[:, None, None] * sky.sun[:, None] * turn_stokes(glint, turn)


def mirror_sun(camera: Camera, beam: Array, radius: float, size: int) -> Array:
    """Mean radiance (size * size,) [1/sr] of the sun's image, an even disc, on a mirroring sphere, for an irradiance of
    1: all pixels together hold 1/4 of what falls on the cross section."""
    found = np.zeros((size, size))
    half = camera.toward - beam
    cosine = 0.5 * float(np.linalg.norm(half))
    if cosine < LEAST_COSINE:
        return found.ravel()
    middle = np.array([half @ camera.right, half @ camera.up]) / (2.0 * cosine)
    reach = 0.55 * SUN_RADIUS / cosine  # a normal that turns across the plane of incidence turns the ray by less
    steps = reach * (2.0 * (np.arange(FINE) + 0.5) / FINE - 1.0)
    x, y = np.meshgrid(middle[0] + steps, middle[1] + steps)
    square = x**2 + y**2
    depth = np.sqrt(np.maximum(1.0 - square, 0.0))
    normal = x[..., None] * camera.right + y[..., None] * camera.up + depth[..., None] * camera.toward
    mirrored = 2.0 * depth[..., None] * normal - camera.toward  # to where the pixel looks
    lit = (square < 1.0) & (mirrored @ -beam > np.cos(SUN_RADIUS))
    rows, columns = (np.floor(0.5 * size + radius * part[lit]).astype(int) for part in (-y, x))
    np.add.at(found, (rows, columns), 0.25 * radius**2 / max(int(lit.sum()), 1))
    return found.ravel()
