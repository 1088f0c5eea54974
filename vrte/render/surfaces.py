"""Places on surfaces under sun, sky and ground: the light that reaches them, and what of it goes to the camera.

As of a sphere (spheres.py), but that surfaces stand in their own light: of a place p with the normal n the camera gets

    L(p) = integral over k with -k.n > 0 of  V(p, k) R_camera f R_surface L(k) (-k.n) dk  +  the like for the sun,

V is 0 where the way back along k meets an object, which counts as black: light that goes from object to object, or from
one side of it to another, is left out. L(k) is that of the sky, or of the ground where k comes from, in the objects'
shadow.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.polarization import FLIP
from vrte.basics.splines import make_spline_matrix
from vrte.render.geometry import UP, convert_to_polar, find_turn, turn_stokes
from vrte.render.gloss import spread_over_facets
from vrte.render.rays import OFF_SURFACE, Lens, Rays
from vrte.render.shapes import Body
from vrte.render.sky import STEEPEST as HORIZON
from vrte.render.sky import Sky, make_horizon_angles
from vrte.render.spheres import STEEPEST, Resolution, Table, find_incoming_directions

ALONG, ACROSS = 16, 12  # directions that light is taken from, in a lune of the sky and in one of the ground
BLOCK = 32_768  # directions or samples at a time
ANGLES, AZIMUTHS = 64, 121  # of the table between whose values a BRDF is linear
SKY_ANGLES = 1024  # between which the sky is linear
GROUND_STEPS, GROUND_REACH = 97, 12.0  # places each way whose shadow is known, and how far from the objects
GROUND_ALONG, GROUND_AROUND = 14, 32  # directions of the sky that light the ground
EAST, NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


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
        """Points of surfaces as a camera sees them: normals, directions towards it, what is upright for it."""
        toward = lens.place - position
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        away = np.maximum(STEEPEST - (normal * toward).sum(axis=1), 0.0)
        normal = normal + away[:, None] * toward
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return cls(position, normal, toward, lens.find_upright(toward))

    def choose(self, which: Any) -> "Points":
        """Those points alone that an index or a mask names."""
        return Points(self.position[which], self.normal[which], self.toward[which], self.upright[which])

    @cached_property
    def mu_o(self) -> Array:
        """Cosines (n,) between normal and camera."""
        return np.clip((self.normal * self.toward).sum(axis=1), STEEPEST, 1.0)

    @cached_property
    def x(self) -> Array:
        """The surface's axis x' (n, 3) that heads for the camera."""
        along = self.toward - (self.normal * self.toward).sum(axis=1, keepdims=True) * self.normal
        length = np.linalg.norm(along, axis=1, keepdims=True)
        level = length < 1e-9
        any_axis = np.cross(self.normal, self.upright)
        found: Array = np.where(level, any_axis, along / np.where(level, 1.0, length))
        return found

    @property
    def y(self) -> Array:
        return np.cross(self.normal, self.x)

    @property
    def back(self) -> Array:
        """The turn (n,) [rad] of Stokes axes from the surface's to the picture's, for light to the camera."""
        sine = np.sqrt(1.0 - self.mu_o**2)
        return find_turn(self.toward, self.mu_o[:, None] * self.x - sine[:, None] * self.normal, self.upright)


@dataclass(frozen=True, eq=False)
class Lookup:
    """BRDFs at some wavelengths, linear between directions: ``values`` (theta_i theta_o phi, wavelength, 4, 3) without
    the last column, for light that is not circularly polarized; phi from 0 to half a turn."""

    values: Any  # single precision
    tables: Sequence[Table]

    @classmethod
    def of(cls, tables: Sequence[Table]) -> "Lookup":
        values = np.empty((ANGLES * ANGLES * AZIMUTHS, len(tables), 4, 3), dtype=np.float32)
        for place, table in enumerate(tables):
            theta, turn = table.resolution.theta, table.resolution.turn
            fine = make_spline_matrix((theta,), (cls.theta(),)).toarray()
            around = make_spline_matrix((turn,), (np.linspace(0.0, np.pi, AZIMUTHS),)).toarray()
            splines = table.splines.reshape(*table.splines.shape[:3], 4, 4)[..., :3]
            found = np.einsum("ai,bo,cp,iopst->abcst", fine, fine, around, splines, optimize=True)
            values[:, place] = found.reshape(-1, 4, 3)
        return cls(values, tables)

    @staticmethod
    def theta() -> Array:
        return make_horizon_angles(ANGLES, STEEPEST)

    @cached_property
    def of_sunlight(self) -> Array:
        """The first column, for unpolarized light: (theta_i theta_o phi, wavelength 4)."""
        return np.ascontiguousarray(self.values[..., 0]).reshape(self.values.shape[0], -1)

    def rows(self, mu_i: Array, mu_o: Array, phi: Array) -> tuple[Any, Any]:
        """The matrix from the values to directions (n,), phi in radians; and where its mirror image is meant."""
        from scipy.sparse import csr_array

        phi = phi % (2.0 * np.pi)
        mirrored = phi > np.pi
        grid = self.theta()
        parts = [np.interp(np.arccos(np.clip(mu, STEEPEST, 1.0)), grid, np.arange(grid.size)) for mu in (mu_i, mu_o)]
        parts.append(np.where(mirrored, 2.0 * np.pi - phi, phi) * ((AZIMUTHS - 1) / np.pi))
        columns, shares = np.zeros((phi.size, 1), dtype=np.int32), np.ones((phi.size, 1), dtype=np.float32)
        for part, count in zip(parts, (ANGLES, ANGLES, AZIMUTHS), strict=True):
            low = np.clip(part.astype(np.int32), 0, count - 2)
            share = (part - low).astype(np.float32)
            both, weigh = np.stack([low, low + 1], axis=1), np.stack([1.0 - share, share], axis=1)
            columns = (columns[:, :, None] * np.int32(count) + both[:, None, :]).reshape(phi.size, 2 * columns.shape[1])
            shares = (shares[:, :, None] * weigh[:, None, :]).reshape(phi.size, 2 * shares.shape[1])
        starts = np.arange(0, columns.size + 1, columns.shape[1], dtype=np.int32)
        return csr_array((shares.ravel(), columns.ravel(), starts), shape=(phi.size, len(self.values))), mirrored

    def slabs(self, mu_i: Array, mu_o: Array) -> Array:
        """The factors (n, wavelength) that were taken out of the tables."""
        mu_i = np.clip(mu_i, STEEPEST, 1.0)
        found: dict[float, Array] = {}
        for table in self.tables:
            if table.thickness not in found:
                found[table.thickness] = table.slab(mu_i, mu_o)
        return np.stack([found[table.thickness] for table in self.tables], axis=1)


@dataclass(frozen=True, eq=False)
class Ground:
    """Where the objects' shadow lies: ``east`` and ``north`` (steps,) span places, which the ``sun`` reaches or not,
    and ``seen`` (place, direction) of the sky above, light from ``travel`` (direction, 3) with the shares ``weights``
    of the irradiance that the same light from everywhere would make."""

    east: Array
    north: Array
    sun: Array
    seen: Array
    travel: Array
    weights: Array

    @classmethod
    def below(cls, bodies: Sequence[Body], rays: Rays, beam: Array) -> "Ground":
        low, high = (np.stack([getattr(body, end) for body in bodies]) for end in ("lowest", "highest"))
        t = np.linspace(-1.0, 1.0, GROUND_STEPS)
        east, north = (
            0.5 * (low[:, axis].min() + high[:, axis].max())
            + 0.5 * (high[:, axis].max() - low[:, axis].min()) * 1.6 * t
            + GROUND_REACH * t**7
            for axis in (0, 1)
        )
        places = np.stack([*(part.ravel() for part in np.meshgrid(east, north, indexing="ij")), 0.0 * t.repeat(t.size)])
        start = places.T + OFF_SURFACE * UP
        points, shares = np.polynomial.legendre.leggauss(GROUND_ALONG)
        cosine = np.sqrt(0.5 * (points + 1.0))  # even steps of its square: of what falls on level ground
        around = (np.arange(GROUND_AROUND) + 0.5 * (np.arange(GROUND_ALONG) % 2)[:, None]) * (
            2.0 * np.pi / GROUND_AROUND
        )
        sine = np.sqrt(1.0 - cosine**2)[:, None]
        level = np.broadcast_to(cosine[:, None], around.shape)
        travel = -np.stack([sine * np.cos(around), sine * np.sin(around), level], axis=-1).reshape(-1, 3)
        weights = np.repeat(0.5 * shares / GROUND_AROUND, GROUND_AROUND)
        seen = np.empty((len(start), len(travel)), dtype=bool)
        for place, back in enumerate(-travel):
            seen[:, place] = ~rays.find_blocked(start, np.broadcast_to(back, start.shape))
        sun = ~rays.find_blocked(start, np.broadcast_to(-beam, start.shape))
        return cls(east, north, sun.astype(float), seen, travel, weights)

    def rows(self, x: Array, y: Array) -> Any:
        """The matrix from values at the places to others (n,)."""
        return make_spline_matrix((self.east, self.north), (x, y), degree=1)


@dataclass(frozen=True, eq=False)
class Light:
    """Sun, sky and ground at some wavelengths: of the ``sky``, ``sunlit`` and ``skylit`` (wavelength,) radiance of the
    ground from each, where nothing stands in the light; ``ground``, None where nothing stands on it, tells shadows."""

    sky: Sky
    sunlit: Array
    skylit: Array
    ground: Ground | None

    @classmethod
    def of(cls, sky: Sky, albedo: float, ground: Ground | None) -> "Light":
        sunlit = np.minimum(albedo * sky.sun * -sky.beam[2] / np.pi, sky.ground)
        return cls(sky, sunlit, sky.ground - sunlit, ground)

    @cached_property
    def skylight_shares(self) -> Array:
        """What is left of the sky's light at the places of the ground (place, wavelength)."""
        assert self.ground is not None
        light = self.find_sky(self.ground.travel)[..., 0] * self.ground.weights[:, None]
        total = light.sum(axis=0)
        found: Array = self.ground.seen.astype(np.float32) @ light / np.where(total > 0.0, total, 1.0)
        return found

    @cached_property
    def at_places(self) -> Array:
        """Radiance of the ground at its places (place, wavelength)."""
        assert self.ground is not None
        return self.sunlit * self.ground.sun[:, None] + self.skylit * self.skylight_shares

    @cached_property
    def sky_steps(self) -> tuple[Array, Array]:
        """Angles [rad] from the zenith between which the sky is linear, and their numbers."""
        return make_horizon_angles(SKY_ANGLES, HORIZON), np.arange(SKY_ANGLES, dtype=np.float64)

    @cached_property
    def sky_by_angle(self) -> Array:
        """The sky's Fourier orders of I, Q and U there, (angle, wavelength, order, 3)."""
        sky = self.sky
        to_steps = make_spline_matrix((sky.theta,), (self.sky_steps[0],))
        by_angle = np.moveaxis(sky.splines[..., :3], 0, 1)
        found: Array = to_steps @ by_angle.reshape(sky.theta.size, -1)
        return found.reshape(SKY_ANGLES, *by_angle.shape[1:])

    def find_sky(self, travel: Array) -> Array:
        """Stokes radiance (n, wavelength, 3) without V, which molecules do not make, of skylight along ``travel``
        (n, 3); in the frame of the vertical."""
        sky, by_angle = self.sky, self.sky_by_angle
        place = np.interp(np.arccos(np.clip(-travel[:, 2], HORIZON, 1.0)), *self.sky_steps)
        low = np.minimum(place.astype(np.intp), len(by_angle) - 2)
        share = (place - low)[:, None, None, None]
        orders = (1.0 - share) * by_angle[low] + share * by_angle[low + 1]
        angles = (np.arctan2(travel[:, 1], travel[:, 0]) - np.arctan2(sky.beam[1], sky.beam[0]))[:, None] * np.arange(3)
        even, odd = np.cos(angles), np.sin(angles)
        return np.einsum("nwms,nms->nws", orders, np.stack([even, even, odd], axis=-1))

    def find_ground(self, position: Array, travel: Array) -> Array:
        """Radiance (n, wavelength) that comes up along ``travel`` from the ground to these places."""
        if self.ground is None:
            return np.broadcast_to(self.sky.ground, (len(travel), self.sky.ground.size))
        start = position - travel * (position[:, 2] / np.maximum(travel[:, 2], 1e-9))[:, None]
        found: Array = self.ground.rows(start[:, 0], start[:, 1]) @ self.at_places
        return found

    def find(self, position: Array, travel: Array) -> Array:
        """Stokes radiance (n, wavelength, 3) along ``travel`` at these places, where no object is in its way."""
        found = np.zeros((len(travel), self.sky.sun.size, 3))
        down = travel[:, 2] < 0.0
        found[down] = self.find_sky(travel[down])
        if self.sky.ground.any():
            found[~down, :, 0] = self.find_ground(position[~down], travel[~down])
        return found

    def find_softly(self, position: Array, travel: Array, edge: float) -> Array:
        """The like with a horizon whose height is spread over ``edge``, for quadratures of few directions."""
        share = np.clip(0.5 - travel[:, 2] / edge, 0.0, 1.0)[:, None]
        found = share[..., None] * self.find_sky(travel)
        found[..., 0] += (1.0 - share) * self.find_ground(position, travel)
        return found


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


def gather_skylight(points: Points, lookup: Lookup, light: Light, rays: Rays) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of what sky and ground send to these places."""
    resolution = Resolution(along=ALONG, across=ACROSS)
    found = np.zeros((len(points.position), len(lookup.tables), 4))
    for block in split(len(points.position), max(1, BLOCK // (ALONG * ACROSS))):
        here = points.choose(block)
        travel, weights, _ = find_incoming_directions(here.normal, resolution, ground=bool(light.sky.ground.any()))
        each, travel = travel.shape[1], travel.reshape(-1, 3)
        start = np.repeat(here.position + OFF_SURFACE * here.normal, each, axis=0)
        free = np.flatnonzero(~rays.find_blocked(start, -travel))
        owner, travel = free // each, travel[free]
        normal, x, mu_o = here.normal[owner], here.x[owner], here.mu_o[owner]
        cosine, azimuth, on_surface = convert_to_polar(travel, x, here.y[owner], normal)
        matrix, mirrored = lookup.rows(-cosine, mu_o, -azimuth)
        matrices = (matrix @ lookup.values.reshape(len(lookup.values), -1)).reshape(free.size, len(lookup.tables), 4, 3)
        falls_in = light.find(start[free], travel)
        turn = find_turn(travel, convert_to_polar(travel, EAST, NORTH, UP)[2], on_surface)
        falls_in = turn_linear(falls_in, turn[:, None])
        falls_in *= (weights.ravel()[free] * -cosine)[:, None, None]
        falls_in[mirrored] *= FLIP[:3]
        leaves = (
            np.einsum("nwst,nwt->nws", matrices, falls_in.astype(np.float32)) * lookup.slabs(-cosine, mu_o)[..., None]
        )
        leaves[mirrored] *= FLIP
        found[block] = add_up(leaves, np.bincount(owner, minlength=len(here.position)))
    return turn_stokes(found, points.back[:, None])


def turn_linear(stokes: Array, angle: Array) -> Array:
    """`turn_stokes` for vectors (..., 3) without V."""
    cosine, sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
    found = stokes.copy()
    found[..., 1] = cosine * stokes[..., 1] + sine * stokes[..., 2]
    found[..., 2] = cosine * stokes[..., 2] - sine * stokes[..., 1]
    return found


def reflect_sunlight(points: Points, lit: Any, lookup: Lookup, sky: Sky) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of what the sun sends to those places that are ``lit`` (n,)."""
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


def mirror_surroundings(points: Points, lookup: Lookup, light: Light, rays: Rays) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of what smooth surfaces mirror: sky and ground, not the sun."""
    cosine = points.mu_o[:, None]
    travel = points.toward - 2.0 * cosine * points.normal
    travel /= np.linalg.norm(travel, axis=1, keepdims=True)
    start = points.position + OFF_SURFACE * points.normal
    free = np.flatnonzero(~rays.find_blocked(start, -travel))
    falls_in = np.zeros((len(travel), len(lookup.tables), 4))
    falls_in[free, :, :3] = light.find(start[free], travel[free])
    on_surface = -cosine * points.x - np.sqrt(1.0 - cosine**2) * points.normal
    turn = find_turn(travel, convert_to_polar(travel, EAST, NORTH, UP)[2], on_surface)
    falls_in = turn_stokes(falls_in, turn[:, None])
    leaves = np.stack(
        [
            (table.mirror(points.mu_o) @ falls_in[:, place, :, None])[..., 0]
            for place, table in enumerate(lookup.tables)
        ],
        axis=1,
    )
    return turn_stokes(leaves, points.back[:, None])


def gather_off_facets(points: Points, lookup: Lookup, light: Light, rays: Rays) -> Array:
    """Stokes radiance (n, wavelength, 4) to the camera of sky and ground off the facets of a rough surface on top."""
    found = np.zeros((len(points.position), len(lookup.tables), 4))
    surface = lookup.tables[0].facets
    assert surface is not None
    for block in split(len(points.position), max(1, BLOCK // 224)):
        here = points.choose(block)
        travel, operators = spread_over_facets(surface, here.normal, here.x, here.toward, here.mu_o)
        each = len(travel) // len(here.position)
        start = np.repeat(here.position + OFF_SURFACE * here.normal, each, axis=0)
        free = np.flatnonzero((operators[:, 0, 0] > 0.0) & ~rays.find_blocked(start, -travel))
        falls_in = light.find_softly(start[free], travel[free], surface.roughness)
        leaves = np.einsum("nst,nwt->nws", operators[free][:, :, :3], falls_in)
        found[block] = add_up(leaves, np.bincount(free // each, minlength=len(here.position)))
    return turn_stokes(found, points.back[:, None])
