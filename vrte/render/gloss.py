"""What surfaces mirror to the camera: the sky, the ground and the sun; smooth ones first, then those of facets.

A mirror has no BRDF that a quadrature could take: each pixel shows the one direction that its normal mirrors,

    L(n) = R_camera S(mu) R_facet L_sky(k),    k = k_camera - 2 (k_camera.n) n,    mu = k_camera.n,

S (4x4) the share of a beam that comes back as a beam. The sun is a disc of even brightness, some pixels large. Of a
rough surface the facets h take the place of n, each with the BRDF of all of them, 4 (k_camera.h) dh being the solid
angle that it mirrors: a quadrature over slopes finds the peak wherever it is.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, make_spline_matrix, repeat_grid
from vrte.optics.facets import RoughSurface, tell_density
from vrte.render.geometry import UP, Camera, compute_normals, convert_to_polar, find_turn, turn_stokes
from vrte.render.sky import STEEPEST, Sky, make_horizon_angles

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


SLOPES = {"beckmann": 10, "ggx": 14}  # of a quadrature over slopes: sizes, and
AROUND = 16  # their directions


def sample_slopes(surface: RoughSurface) -> tuple[Array, Array, Array]:
    """Slopes of facets (n,) along x and y, and weights of a quadrature that have the slopes' density in them."""
    count = SLOPES[surface.distribution]
    if surface.distribution == "beckmann":
        square, share = np.polynomial.laguerre.laggauss(count)
    else:
        points, share = np.polynomial.legendre.leggauss(count)
        square, share = (1.0 + points) / (1.0 - points), 0.5 * share
    turned = 2.0 * np.pi * (np.arange(AROUND) + 0.5 * (np.arange(count) % 2)[:, None]) / AROUND
    slope = surface.roughness * np.sqrt(square)[:, None]
    weights = np.repeat(share, AROUND) / AROUND
    return (slope * np.cos(turned)).ravel(), (slope * np.sin(turned)).ravel(), weights


@dataclass(frozen=True, eq=False)
class RoughGloss:
    """What a surface of facets mirrors to the camera: skylight on ``theta`` x ``psi`` normals, sunlight on pixels.

    ``rings``: for each theta the operators (psi * facets, 4, 4) from Stokes vectors of the sky in the world's frame,
    behind what finds these, a matrix and azimuths, and the shares that come from sky and not ground. ``sunlit``: which
    pixels, and Stokes vectors of a sun of irradiance 1. ``factor``: whether the cosine is taken out of what is splined.
    """

    theta: Array
    psi: Array
    rings: "list[tuple[Any, Array, Array, Array]]"
    sunlit: tuple[Any, Array]
    factor: bool

    @classmethod
    def of(cls, view: "View", surface: RoughSurface) -> "RoughGloss":
        step = max(0.5 * surface.roughness, 0.02)  # [rad] between normals: what they mirror is blurred by more
        count = max(view.resolution.angles, min(64, round(1.6 / step)))
        around = max(view.resolution.around, min(180, 4 * round(np.pi / (2.0 * step))))
        theta = make_horizon_angles(count, float(np.cos(view.resolution.theta[-1])))
        psi = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
        rings = [look_at_facets(view, surface, float(angle), psi) for angle in theta]
        lit, _, mu_i, mu_o = view.lit
        _, pixel_theta, pixel_psi = view.pixels
        normal, x = compute_normals(view.camera, pixel_theta[lit], pixel_psi[lit])
        _, azimuth, _ = convert_to_polar(view.sky.beam, x, np.cross(normal, x), normal)
        sunlight = surface.reflect(mu_i, mu_o, -np.degrees(azimuth))[:, :, 0] * mu_i[:, None]
        sunlit = lit, turn_stokes(sunlight, pixel_psi[lit] - 0.5 * np.pi)
        return cls(theta, psi, rings, sunlit, not surface.shadowing)

    def stokes(self, view: "View", place: int) -> Array:
        """Stokes radiance (n, 4) to the camera at a wavelength."""
        sky, values = view.sky, np.zeros((self.theta.size, self.psi.size, 4))
        for ring, (above, azimuth, from_sky, operators) in enumerate(self.rings):
            light = from_sky[:, None] * sky.stokes(place, above, azimuth)
            light[:, 0] += (1.0 - from_sky) * sky.ground[place]
            values[ring] = (operators @ light[:, :, None])[..., 0].reshape(self.psi.size, -1, 4).sum(axis=1)
        places, which = repeat_grid(self.psi)
        _, theta, psi = view.pixels
        if self.factor:  # facets that do not hide each other are ever brighter towards the rim
            values *= np.cos(self.theta)[:, None, None]
        splines = compute_coefficients((self.theta, places), values[:, which])
        to_pixels = make_spline_matrix((self.theta, places), (theta, psi % (2.0 * np.pi)))
        found: Array = to_pixels @ splines.reshape(-1, 4)
        if self.factor:
            found /= np.cos(theta)[:, None]
        lit, sunlight = self.sunlit
        found[lit] += sky.sun[place] * sunlight
        return found


def look_at_facets(view: "View", surface: RoughSurface, theta: float, psi: Array) -> tuple[Any, Array, Array, Array]:
    """One of `RoughGloss.rings`."""
    normal, x = compute_normals(view.camera, np.full(psi.shape, theta), psi)
    toward = np.broadcast_to(view.camera.toward, normal.shape)
    travel, operators = spread_over_facets(surface, normal, x, toward, np.full(psi.shape, np.cos(theta)))
    height, heading, _ = convert_to_polar(travel, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP)
    back = make_turns(np.repeat(psi - 0.5 * np.pi, len(travel) // psi.size))
    above = make_spline_matrix((view.sky.theta,), (np.arccos(np.clip(-height, STEEPEST, 1.0)),))
    from_sky = np.clip(0.5 - height / surface.roughness, 0.0, 1.0)  # an edge that so few facets show would be many
    return above, heading, from_sky, back @ operators


def spread_over_facets(
    surface: RoughSurface, normal: Array, x: Array, toward: Array, mu_o: Array
) -> tuple[Array, Array]:
    """Of facets at places with these normals, axes x' and directions to the camera (n, 3), at the cosines mu_o (n,):
    directions of travel (n facets, 3) of the light that each mirrors there, and operators (n facets, 4, 4) from its
    Stokes vectors in the world's frame to their parts of the reflection, in the surface's."""
    along, across, share = sample_slopes(surface)
    n, facets = len(normal), share.size
    facet = normal[:, None] - along[:, None] * x[:, None] - across[:, None] * np.cross(normal, x)[:, None]
    upright = 1.0 / np.linalg.norm(facet, axis=-1)  # mu_n
    facet = (facet * upright[..., None]).reshape(-1, 3)
    normal, x, toward = (np.repeat(part, facets, axis=0) for part in (normal, x, toward))
    cosine = (facet * toward).sum(axis=1)
    travel = toward - 2.0 * cosine[:, None] * facet
    mu, azimuth, on_facet = convert_to_polar(travel, x, np.cross(normal, x), normal)
    in_world = convert_to_polar(travel, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), UP)[2]
    lit = (cosine > 0.0) & (mu < 0.0)
    mu_i, upright, share = np.where(lit, -mu, 1.0), upright.ravel(), np.tile(share, n)
    density = tell_density(surface.roughness, surface.distribution, 1.0 / upright**2 - 1.0)
    weights = share / density * upright**3 * 4.0 * cosine * mu_i
    matrices = surface.reflect(mu_i, np.repeat(mu_o, facets), -np.degrees(azimuth))
    matrices = matrices * np.where(lit, weights, 0.0)[:, None, None]
    return travel, matrices @ make_turns(find_turn(travel, in_world, on_facet))


def make_turns(angle: Array) -> Array:
    """What `turn_stokes` does, as matrices (n, 4, 4)."""
    return np.swapaxes(turn_stokes(np.eye(4), angle[:, None]), 1, 2)
