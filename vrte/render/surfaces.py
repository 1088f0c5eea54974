"""Light that surfaces under sun, sky and ground send to the camera.

A place p of a surface with the normal n sends

    L(p) = integral over k with -k.n > 0 of  V(p, k) R_camera f R_surface L(k) (-k.n) dk  +  the like for the sun,

f the BRDF (4x4), R turns of Stokes axes. V is 0 where the way back along k meets an object, which counts as black:
light that goes from object to object, or from one side of it to another, is left out; V is 1 on a sphere by itself.
L(k) is that of the sky, or of the ground where k comes from, in the objects' shadow. A smooth surface mirrors the one
direction of k that its normal does,

    L(p) = R_camera S(mu) R_surface L(k),    k = k_camera - 2 (k_camera.n) n,    mu = k_camera.n,

S (4x4) the fraction of a beam that is reflected as a beam. Of a rough surface the facets h take the place of n, each
with the BRDF of all of them, 4 (k_camera.h) dh being the solid angle that it mirrors: a quadrature over slopes finds
the peak wherever it is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.polarization import FLIP
from vrte.basics.splines import make_spline_matrix
from vrte.optics.facets import RoughSurface
from vrte.render.geometry import (
    NORTH,
    OFF_SURFACE,
    UP,
    Body,
    Camera,
    Lens,
    Rays,
    convert_to_polar,
    find_turn,
    find_turn_from_world,
    normalize,
    turn_stokes,
)
from vrte.render.sky import Sky
from vrte.render.tables import STEEPEST, Lookup, Resolution

USUAL = Resolution()
BLOCK = 32_768  # directions or samples at a time
GROUND_STEPS, GROUND_REACH = 97, 12.0  # places each way whose shadow is known, and how far from the objects
GROUND_ALONG, GROUND_AROUND = 14, 32  # directions of the sky that light the ground
SLOPES = {"beckmann": 10, "ggx": 14}  # of a quadrature over slopes of facets: sizes, and
AROUND = 16  # their directions


@dataclass(frozen=True, eq=False)
class Points:
    """Places on surfaces: ``position``, unit ``normal``, and the directions ``toward`` the camera and ``upright``, the
    Stokes axis l there (n, 3). Normals that turn away from the camera are bent back to the rim."""

    position: Array
    normal: Array
    toward: Array
    upright: Array

    @classmethod
    def seen(cls, position: Array, normal: Array, lens: Lens) -> "Points":
        """Points of surfaces as a near camera sees them."""
        toward = normalize(lens.place - position)
        away = np.maximum(STEEPEST - (normal * toward).sum(axis=1), 0.0)
        return cls(position, normalize(normal + away[:, None] * toward), toward, lens.find_upright(toward))

    @classmethod
    def far(cls, normal: Array, camera: Camera) -> "Points":
        """Points with these normals, wherever they are, as a far camera sees them."""
        toward, upright = (np.broadcast_to(axis, normal.shape) for axis in (camera.toward, camera.up))
        return cls(np.zeros_like(normal), normal, toward, upright)

    def choose(self, which: Any) -> "Points":
        """The points that an index or a mask names."""
        return Points(self.position[which], self.normal[which], self.toward[which], self.upright[which])

    @cached_property
    def mu_o(self) -> Array:
        """Cosines (n,) between normal and camera."""
        return np.clip((self.normal * self.toward).sum(axis=1), STEEPEST, 1.0)

    @cached_property
    def x(self) -> Array:
        """The surface's axis x' (n, 3), which heads for the camera."""
        along = self.toward - (self.normal * self.toward).sum(axis=1, keepdims=True) * self.normal
        level = np.linalg.norm(along, axis=1, keepdims=True) < 1e-9
        return normalize(np.where(level, np.cross(self.normal, self.upright), along))

    @cached_property
    def y(self) -> Array:
        return np.cross(self.normal, self.x)

    @cached_property
    def back(self) -> Array:
        """The turn (n,) [rad] of Stokes axes from the surface's to the picture's, for light to the camera."""
        sine = np.sqrt(1.0 - self.mu_o**2)
        return find_turn(self.toward, self.mu_o[:, None] * self.x - sine[:, None] * self.normal, self.upright)

    @cached_property
    def mirrored(self) -> Array:
        """Directions of travel (n, 3) of light that smooth surfaces mirror to the camera."""
        return normalize(self.toward - 2.0 * self.mu_o[:, None] * self.normal)


@dataclass(frozen=True, eq=False)
class ShadedGround:
    """The ground: places ``east`` and ``north`` (steps,), whether the ``sun`` reaches them, and ``seen`` (place,
    direction) of the sky along ``travel`` (direction, 3) with ``weights`` of an even sky."""

    east: Array
    north: Array
    sun: Array
    seen: Array
    travel: Array
    weights: Array

    @classmethod
    def below(cls, bodies: Sequence[Body], rays: Rays, beam: Array) -> "ShadedGround":
        """The ground that bodies stand on."""
        corners = np.concatenate([body.corners for body in bodies])
        low, high = corners.min(axis=0), corners.max(axis=0)
        t = np.linspace(-1.0, 1.0, GROUND_STEPS)
        east, north = (
            0.5 * (low[axis] + high[axis]) + 0.8 * (high[axis] - low[axis]) * t + GROUND_REACH * t**7 for axis in (0, 1)
        )
        indices = np.stack(
            [*(part.ravel() for part in np.meshgrid(east, north, indexing="ij")), 0.0 * t.repeat(t.size)]
        )
        start = indices.T + OFF_SURFACE * UP
        points, quadrature = np.polynomial.legendre.leggauss(GROUND_ALONG)
        cosine = np.sqrt(0.5 * (points + 1.0))  # even steps of its square: of what falls on level ground
        steps = np.arange(GROUND_AROUND) + 0.5 * (np.arange(GROUND_ALONG) % 2)[:, None]
        around = steps * (2.0 * np.pi / GROUND_AROUND)
        sine = np.sqrt(1.0 - cosine**2)[:, None]
        level = np.broadcast_to(cosine[:, None], around.shape)
        travel = -np.stack([sine * np.cos(around), sine * np.sin(around), level], axis=-1).reshape(-1, 3)
        weights = np.repeat(0.5 * quadrature / GROUND_AROUND, GROUND_AROUND)
        sun, *seen = (~rays.find_blocked(start, np.broadcast_to(-one, start.shape)) for one in (beam, *travel))
        return cls(east, north, sun.astype(float), np.stack(seen, axis=1), travel, weights)

    def rows(self, x: Array, y: Array) -> Any:
        """The matrix from values at the places to others (n,)."""
        return make_spline_matrix((self.east, self.north), (x, y), degree=1)


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Sun, sky and ground at some wavelengths: of the ``sky``, ``sunlit`` and ``skylit`` (wavelength,) radiance of the
    ground from each, where nothing stands in the light; ``ground``, None where nothing stands on it, has shadows."""

    sky: Sky
    sunlit: Array
    skylit: Array
    ground: ShadedGround | None

    @classmethod
    def of(cls, sky: Sky, albedo: float = 1.0, ground: ShadedGround | None = None) -> "SceneLight":
        """The light of a sky over ground of this albedo."""
        sunlit = np.minimum(albedo * sky.sun * -sky.beam[2] / np.pi, sky.ground)
        return cls(sky, sunlit, sky.ground - sunlit, ground)

    @cached_property
    def skylight_fractions(self) -> Array:
        """The fraction of the sky's light that reaches the places of the ground (place, wavelength)."""
        assert self.ground is not None
        light = self.sky.find(self.ground.travel)[..., 0] * self.ground.weights[:, None]
        total = light.sum(axis=0)
        return self.ground.seen.astype(np.float32) @ light / np.where(total > 0.0, total, 1.0)

    @cached_property
    def at_places(self) -> Array:
        """Radiance of the ground at its places (place, wavelength)."""
        assert self.ground is not None
        return self.sunlit * self.ground.sun[:, None] + self.skylit * self.skylight_fractions

    def find_ground(self, position: Array, travel: Array) -> Array:
        """Radiance (n, wavelength) that comes up along ``travel`` from the ground to these places."""
        if self.ground is None:
            return np.broadcast_to(self.sky.ground, (len(travel), self.sky.ground.size))
        start = position - travel * (position[:, 2] / np.maximum(travel[:, 2], 1e-9))[:, None]
        return self.ground.rows(start[:, 0], start[:, 1]) @ self.at_places

    def find(self, position: Array, travel: Array, edge: Any = None) -> Array:
        """Stokes radiance (n, wavelength, 3) along ``travel`` at these places, where no object is in its way; ``edge``,
        of all or of each (n,): the height over which the horizon is spread."""
        if edge is not None:
            weight = np.clip(0.5 - travel[:, 2] / edge, 0.0, 1.0)[:, None]
            found = weight[..., None] * self.sky.find(travel)
            found[..., 0] += (1.0 - weight) * self.find_ground(position, travel)
            return found
        found = np.zeros((len(travel), self.sky.sun.size, 3))
        down = travel[:, 2] < 0.0
        found[down] = self.sky.find(travel[down])
        if self.sky.ground.any():
            found[~down, :, 0] = self.find_ground(position[~down], travel[~down])
        return found


def find_incoming_directions(normal: Array, resolution: Resolution, ground: bool) -> tuple[Array, Array]:
    """Directions of travel (normal, n, 3) of light from above the tangent planes, and weights (normal, n) [sr].

    Tangent plane and horizon cut the sphere of directions into lunes, of sky and of ground. Gauss quadrature takes each
    by itself, from pole to pole and across: no edge of the sky lies within one.
    """
    axis = np.cross(normal, UP)
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    level = length < 1e-9  # any axis where both planes coincide
    axis = np.where(level, -NORTH, axis / np.where(level, 1.0, length))
    across = np.cross(axis, normal)
    tilt = np.arctan2(across @ UP, normal @ UP)
    quarter = np.full_like(tilt, 0.5 * np.pi)
    lunes = [(tilt - quarter, quarter), *([(-quarter, tilt - quarter)] if ground else [])]
    points, quadrature = np.polynomial.legendre.leggauss(resolution.along)
    pole, pole_weights = 0.5 * np.pi * (points + 1.0), 0.5 * np.pi * quadrature
    points, quadrature = np.polynomial.legendre.leggauss(resolution.across)
    travel, weights = [], []
    for low, high in lunes:
        half = 0.5 * (high - low)[:, None]
        around = 0.5 * (high + low)[:, None] + half * points  # (normal, across)
        equator = np.cos(around)[..., None] * normal[:, None] + np.sin(around)[..., None] * across[:, None]
        toward = np.sin(pole)[:, None, None] * equator[:, None] + np.cos(pole)[:, None, None] * axis[:, None, None]
        travel.append(-toward.reshape(len(normal), -1, 3))
        weights.append(
            ((np.sin(pole) * pole_weights)[:, None] * (half * quadrature)[:, None, :]).reshape(len(normal), -1)
        )
    return np.concatenate(travel, axis=1), np.concatenate(weights, axis=1)


def compute_irradiance(sky: Sky, normal: Array, resolution: Resolution = USUAL) -> Array:
    """Irradiance (wavelength, n) [W m-2] on surfaces with these normals (n, 3), sun included."""
    travel, weights = find_incoming_directions(normal, resolution, ground=True)
    weights = weights * -np.einsum("nkc,nc->nk", travel, normal)
    light = SceneLight.of(sky).find(np.zeros((weights.size, 3)), travel.reshape(-1, 3))[..., 0]
    found = np.einsum("nk,nkw->wn", weights, light.reshape(*weights.shape, -1))
    return found + sky.sun[:, None] * np.maximum(-normal @ sky.beam, 0.0)


def add_up(values: Array, counts: Any) -> Array:
    """Sums of the first, the next, ... ``counts`` (n,) of values (all, ...)."""
    from scipy.sparse import csr_array

    starts = np.concatenate([[0], np.cumsum(counts)])
    sums = csr_array((np.ones(len(values)), np.arange(len(values)), starts), shape=(len(counts), len(values)))
    found: Array = sums @ values.reshape(len(values), int(np.prod(values.shape[1:])))
    return found.reshape(len(counts), *values.shape[1:])


def split(count: int, each: int) -> Iterator[slice]:
    """Slices of ``each`` that make up ``count``."""
    return (slice(start, start + each) for start in range(0, count, each))


def find_free(rays: Rays | None, points: Points, travel: Array) -> tuple[Any, Array]:
    """Indices of the rays along ``travel`` (n each, 3) that reach their points (n), and where they end (free, 3)."""
    start = np.repeat(points.position + OFF_SURFACE * points.normal, len(travel) // len(points.normal), axis=0)
    free = np.arange(len(travel)) if rays is None else np.flatnonzero(~rays.find_blocked(start, -travel))
    return free, start[free]


def gather_skylight(
    points: Points, lookup: Lookup, light: SceneLight, rays: Rays | None, resolution: Resolution
) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of the light that sky and ground send to these places."""
    found = np.zeros((len(points.position), len(lookup.tables), 4))
    for block in split(len(points.position), max(1, BLOCK // (resolution.along * resolution.across))):
        here = points.choose(block)
        travel, weights = find_incoming_directions(here.normal, resolution, ground=bool(light.sky.ground.any()))
        each, travel = travel.shape[1], travel.reshape(-1, 3)
        free, start = find_free(rays, here, travel)
        owner, travel = free // each, travel[free]
        mu_o = here.mu_o[owner]
        cosine, azimuth, on_surface = convert_to_polar(travel, here.x[owner], here.y[owner], here.normal[owner])
        matrix, mirrored = lookup.rows(-cosine, mu_o, -azimuth)
        matrices = (matrix @ lookup.values.reshape(len(lookup.values), -1)).reshape(free.size, len(lookup.tables), 4, 3)
        falls_in = light.find(start, travel)
        falls_in = turn_stokes(falls_in, find_turn_from_world(travel, on_surface)[:, None])
        falls_in *= (weights.ravel()[free] * -cosine)[:, None, None]
        falls_in[mirrored] *= FLIP[:3]
        leaves = np.einsum("nwst,nwt->nws", matrices, falls_in.astype(matrices.dtype))
        leaves = leaves * lookup.slabs(-cosine, mu_o)[..., None]
        leaves[mirrored] *= FLIP
        found[block] = add_up(leaves, np.bincount(owner, minlength=len(here.position)))
    return turn_stokes(found, points.back[:, None])


def reflect_sunlight(points: Points, lit: Any, lookup: Lookup, sky: Sky) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of sunlight at those places that are ``lit`` (n,)."""
    found = np.zeros((len(points.position), len(lookup.tables), 4))
    mu_i = -(points.normal @ sky.beam)
    which = np.flatnonzero(lit & (mu_i > 0.0))
    here, mu_i = points.choose(which), mu_i[which]
    _, azimuth, _ = convert_to_polar(sky.beam, here.x, here.y, here.normal)
    matrix, mirrored = lookup.rows(mu_i, here.mu_o, -azimuth)
    leaves = (matrix @ lookup.of_sunlight).reshape(which.size, len(lookup.tables), 4).astype(float)
    leaves *= (sky.sun * mu_i[:, None] * lookup.slabs(mu_i, here.mu_o))[..., None]
    leaves[mirrored] *= FLIP
    surface = lookup.tables[0].facets
    if surface is not None:
        shone = surface.reflect(np.maximum(mu_i, STEEPEST), here.mu_o, -np.degrees(azimuth))[:, :, 0] * mu_i[:, None]
        leaves += sky.sun[:, None] * shone[:, None]
    found[which] = turn_stokes(leaves, here.back[:, None])
    return found


def mirror_surroundings(
    points: Points, lookup: Lookup, light: SceneLight, rays: Rays | None, edge: Any = None
) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of sky and ground that smooth surfaces mirror, but the sun."""
    travel, cosine = points.mirrored, points.mu_o[:, None]
    free, start = find_free(rays, points, travel)
    falls_in = np.zeros((len(travel), len(lookup.tables), 4))
    falls_in[free, :, :3] = light.find(start, travel[free], edge)
    on_surface = -cosine * points.x - np.sqrt(1.0 - cosine**2) * points.normal
    falls_in = turn_stokes(falls_in, find_turn_from_world(travel, on_surface)[:, None])
    matrices = np.stack([table.mirror(points.mu_o) for table in lookup.tables], axis=1)
    return turn_stokes((matrices @ falls_in[..., None])[..., 0], points.back[:, None])


def gather_off_facets(points: Points, lookup: Lookup, light: SceneLight, rays: Rays | None) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of sky and ground off the facets of a rough surface on top."""
    found = np.zeros((len(points.position), len(lookup.tables), 4))
    surface = lookup.tables[0].facets
    assert surface is not None
    for block in split(len(points.position), max(1, BLOCK // (AROUND * SLOPES[surface.distribution]))):
        here = points.choose(block)
        travel, operators = spread_over_facets(surface, here)
        free, start = find_free(rays, here, travel)
        lit = operators[free, 0, 0] > 0.0
        free, start = free[lit], start[lit]
        falls_in = light.find(start, travel[free], surface.roughness)
        leaves = np.einsum("nst,nwt->nws", operators[free][:, :, :3], falls_in)
        owner = free // (len(travel) // len(here.normal))
        found[block] = add_up(leaves, np.bincount(owner, minlength=len(here.normal)))
    return turn_stokes(found, points.back[:, None])


def sample_slopes(surface: RoughSurface) -> tuple[Array, Array, Array]:
    """Slopes of facets (n,) along x and y, and weights of a quadrature that have the slopes' density in them."""
    count = SLOPES[surface.distribution]
    if surface.distribution == "beckmann":
        square, weight = np.polynomial.laguerre.laggauss(count)
    else:
        points, weight = np.polynomial.legendre.leggauss(count)
        square, weight = (1.0 + points) / (1.0 - points), 0.5 * weight
    turned = 2.0 * np.pi * (np.arange(AROUND) + 0.5 * (np.arange(count) % 2)[:, None]) / AROUND
    slope = surface.roughness * np.sqrt(square)[:, None]
    return (slope * np.cos(turned)).ravel(), (slope * np.sin(turned)).ravel(), np.repeat(weight, AROUND) / AROUND


def spread_over_facets(surface: RoughSurface, points: Points) -> tuple[Array, Array]:
    """Directions of travel (n facets, 3) of light that facets at the points (n) mirror to the camera, and operators (n
    facets, 4, 4) from its Stokes vectors in the world's frame to the surface's."""
    along, across, weight = sample_slopes(surface)
    n, facets = len(points.normal), weight.size
    facet = points.normal[:, None] - along[:, None] * points.x[:, None] - across[:, None] * points.y[:, None]
    upright = 1.0 / np.linalg.norm(facet, axis=-1)  # cosine between facet and surface
    facet, upright = (facet * upright[..., None]).reshape(-1, 3), upright.ravel()
    owner = np.repeat(np.arange(n), facets)
    toward, x, y, normal = (part[owner] for part in (points.toward, points.x, points.y, points.normal))
    cosine = (facet * toward).sum(axis=1)
    travel = toward - 2.0 * cosine[:, None] * facet
    mu, azimuth, on_surface = convert_to_polar(travel, x, y, normal)
    lit = (cosine > 0.0) & (mu < 0.0)
    mu_i, weight = np.where(lit, -mu, 1.0), np.tile(weight, n)
    density = surface.find_density(1.0 / upright**2 - 1.0)
    weights = weight / density * upright**3 * 4.0 * cosine * mu_i
    matrices = surface.reflect(mu_i, points.mu_o[owner], -np.degrees(azimuth))
    matrices = matrices * np.where(lit, weights, 0.0)[:, None, None]
    turns = turn_stokes(np.eye(4), find_turn_from_world(travel, on_surface)[:, None])  # each column turned
    return travel, matrices @ np.swapaxes(turns, 1, 2)
