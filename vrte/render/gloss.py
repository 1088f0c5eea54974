"""What a smooth surface mirrors to the camera: the sky, the ground and the disc of the sun.

A mirror has no BRDF that a quadrature could take: each pixel shows the one direction that its normal mirrors,

    L(n) = R_camera S(mu) R_facet L_sky(k),    k = k_camera - 2 (k_camera.n) n,    mu = k_camera.n,

S (4x4) the share of a beam that comes back as a beam. The sun is a disc of even brightness, some pixels large.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.render.geometry import UP, Camera, compute_normals, convert_to_polar, find_turn, turn_stokes
from vrte.render.sky import STEEPEST, Sky
from vrte.results.splines import make_spline_matrix

if TYPE_CHECKING:
    from vrte.render.spheres import View

SUN_RADIUS = np.radians(0.2666)  # of its disc, from 1 au
FINE = 48  # points across the sun's image
LEAST_COSINE = 0.02  # of incidence on the facet that mirrors the sun


@dataclass(frozen=True, eq=False)
class Gloss:
    """The light that each pixel (n,) would mirror: from where, and how its Stokes axes turn.

    ``to_table``: matrix to splines over the table's angles; ``above``: to the sky's; ``azimuth`` [rad] of travel in the
    world; ``facet``, ``back``: turns from sky to surface, and from surface to picture; ``from_sky``: the pixel's share
    that mirrors sky and not ground; ``sun``: mean radiance of the sun's image for an irradiance of 1 [1/sr], and
    ``to_glint``, ``glint_back`` the like of ``to_table`` and ``back`` at its middle.
    """

    to_table: Any
    above: Any
    azimuth: Array
    facet: Array
    back: Array
    from_sky: Array
    sun: Array
    to_glint: Any
    glint_back: Array

    @classmethod
    def of(cls, view: "View") -> "Gloss":
        _, theta, psi = view.pixels
        normal, x = compute_normals(view.camera, theta, psi)
        cosine, sine = np.cos(theta)[:, None], np.sin(theta)[:, None]
        travel = sine * x - cosine * normal
        height, heading, in_world = convert_to_polar(travel, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP)
        half = view.camera.toward - view.sky.beam
        halfway = np.array([np.arccos(np.clip(0.5 * np.linalg.norm(half), LEAST_COSINE, 1.0))])
        across = 2.0 / (view.radius * np.maximum(cosine[:, 0], 1.0 / view.radius))  # of a pixel, in what it mirrors
        return cls(
            make_spline_matrix((view.resolution.theta,), (theta,)),
            make_spline_matrix((view.sky.theta,), (np.arccos(np.clip(-height, STEEPEST, 1.0)),)),
            heading,
            find_turn(travel, in_world, -cosine * x - sine * normal),
            psi - 0.5 * np.pi,
            np.clip(0.5 - height / across, 0.0, 1.0),
            mirror_sun(view.camera, view.sky.beam, view.radius, view.size)[view.pixels[0]],
            make_spline_matrix((view.resolution.theta,), (halfway,)),
            np.arctan2([half @ view.camera.up], [half @ view.camera.right]) - 0.5 * np.pi,
        )

    def stokes(self, specular: Array, sky: Sky, place: int) -> Array:
        """Stokes radiance (n, 4) to the camera, ``specular`` (theta, 16) being splines of S."""
        falls_in = self.from_sky[:, None] * sky.stokes(place, self.above, self.azimuth)
        falls_in[:, 0] += (1.0 - self.from_sky) * sky.ground[place]
        matrices = (self.to_table @ specular).reshape(-1, 4, 4)
        leaves = (matrices @ turn_stokes(falls_in, self.facet)[:, :, None])[..., 0]
        glint = turn_stokes((self.to_glint @ specular)[:, ::4], self.glint_back)  # of unpolarized light
        return turn_stokes(leaves, self.back) + self.sun[:, None] * sky.sun[place] * glint


def mirror_sun(camera: Camera, beam: Array, radius: float, size: int) -> Array:
    """Mean radiance (size * size,) [1/sr] of the sun's image on a mirroring sphere, for an irradiance of 1.

    A sphere sends back 1/4 of what falls on its cross section into every steradian: so much is in all pixels together.
    """
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
