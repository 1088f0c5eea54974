"""The light that a sphere by itself, and objects that stand on the ground, send to the camera.

What leaves a place is in surfaces.py. A sphere is convex, and nothing stands in its light: what leaves a point depends
on its normal alone. The sky's part varies slowly: it is computed on rings of normals around the line of sight and
splined, of an object at the corners of the mesh and linear between them. The sun's part, with its shadows, and what a
smooth surface mirrors have sharp edges: they are computed for each pixel, of an object for each of its samples.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, make_spline_matrix, repeat_grid
from vrte.render import surfaces
from vrte.render.geometry import (
    EAST,
    NORTH,
    OFF_SURFACE,
    UP,
    Body,
    Camera,
    Lens,
    Rays,
    compute_normals,
    find_turn_from_world,
    normalize,
    turn_stokes,
)
from vrte.render.sky import Sky, make_horizon_angles
from vrte.render.surfaces import BLOCK, Points, SceneLight, ShadedGround, split
from vrte.render.tables import BrdfTable, Lookup, Resolution

MARGIN = 0.94  # of a square picture's half side: the sphere's radius
SUN_RADIUS = np.radians(0.2666)  # of its disc, from 1 au
SUN_DISC = np.pi * np.sin(SUN_RADIUS) ** 2  # its solid angle [sr]
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
        """The pixels that the sphere touches: place in the flat picture, angle from the line of sight, and psi."""
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
        """Stokes radiance (pixel, wavelength, 4) to the camera, with these tables at ``chosen`` wavelengths."""
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


CHANNELS = 6  # X, Y and Z of I, and Q, U and V weighted as Y is
SAMPLES = 3  # of a pixel, each way
GLINT_SAMPLES = 24  # of a pixel in which the sun may be mirrored, each way
SKYLIGHT = Resolution(along=16, across=12)  # directions that light is taken from, in a lune of the sky or the ground


@dataclass(frozen=True, eq=False)
class Samples:
    """What is seen of objects, by samples of pixels (n,): the pixel, which body and triangle, where in it (n, 2), and
    which of the sun's disc ``sun`` the sample takes for all of it."""

    pixel: Any
    body: Any
    triangle: Any
    where: Any
    sun: Any

    def choose(self, which: Any) -> "Samples":
        """The samples that an index or a mask names."""
        return Samples(*(getattr(self, field.name)[which] for field in fields(self)))

    @property
    def weights(self) -> Array:
        """The weights (n, 3) of the triangles' corners."""
        return np.concatenate([1.0 - self.where.sum(axis=1, keepdims=True), self.where], axis=1)


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Samples of several parts in one table, in their order."""
    return Samples(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Samples)))


@dataclass(frozen=True, eq=False)
class Stage:
    """Bodies on the ground before a camera, with the sun's ``beam``: all that no wavelength changes."""

    bodies: Sequence[Body]
    lens: Lens
    beam: Array
    standing: bool = True

    @cached_property
    def rays(self) -> Rays:
        return Rays(self.bodies)

    @cached_property
    def ground(self) -> ShadedGround | None:
        """The objects' shadow on it; None where they do not stand on it."""
        return ShadedGround.below(self.bodies, self.rays, self.beam) if self.standing else None

    @cached_property
    def suns(self) -> Array:
        """Directions (samples, 3) that lead to points of the sun's disc."""
        count = SAMPLES**2
        x = normalize(np.cross(-self.beam, EAST if abs(self.beam[0]) < 0.9 else NORTH))
        y = np.cross(-self.beam, x)
        distance = SUN_RADIUS * np.sqrt((np.arange(count) + 0.5) / count)
        turn = 2.399963 * np.arange(count)  # the golden angle: no two near each other
        return normalize(-self.beam + np.stack([distance * np.cos(turn), distance * np.sin(turn)], axis=1) @ [x, y])

    def look(self, pixel: Any, across: Any, down: Any) -> tuple[Array, Array]:
        """Origins of rays, near the objects, and their unit vectors (n, 3), at these places of pixels."""
        heading = self.lens.look(pixel % self.lens.width + across, pixel // self.lens.width + down)
        near = max(self.lens.distance - 50.0, 0.0)  # a far camera's rays would begin too far away for single precision
        return self.lens.place + near * heading, heading

    def sample(self, pixel: Any) -> Iterator[tuple[Samples, Array]]:
        """What pixels (n,) show, body -1 for nothing, and where their rays head (n, 3), one sample of each at a
        time."""
        for index in range(SAMPLES**2):
            row, column = divmod(index, SAMPLES)
            start, heading = self.look(pixel, np.array((column + 0.5) / SAMPLES), np.array((row + 0.5) / SAMPLES))
            sun = (index + 4 * (pixel % self.lens.width) + 7 * (pixel // self.lens.width)) % SAMPLES**2
            yield Samples(pixel.astype(np.int32), *self.rays.find_hits(start, heading), sun), heading

    def find_samples(self) -> Samples:
        """What all pixels show of bodies."""
        pixel = np.arange(self.lens.width * self.lens.height)
        return join_samples([shown.choose(shown.body >= 0) for shown, _ in self.sample(pixel)])

    def find_points(self, samples: Samples) -> Points:
        """The places that samples, all of one body, show."""
        body = self.bodies[int(samples.body[0])]
        corner, weights = body.triangles[samples.triangle], samples.weights
        normal = normalize(np.einsum("nk,nkc->nc", weights, body.normals[corner]))
        return Points.seen(np.einsum("nk,nkc->nc", weights, body.corners[corner]), normal, self.lens)

    def find_lit(self, samples: Samples, points: Points) -> Any:
        """Whether the sun reaches the places (n,) that samples show; rays begin outside flat triangles, on the surface
        that the normals belong to: triangles would shadow themselves."""
        body = self.bodies[int(samples.body[0])]
        corner = body.triangles[samples.triangle]
        below = ((body.corners[corner] - points.position[:, None]) * body.normals[corner]).sum(axis=2)
        raised = np.einsum("nk,nkc->nc", samples.weights * np.maximum(below, 0.0), body.normals[corner])
        start = points.position + raised + OFF_SURFACE * points.normal
        return ~self.rays.find_blocked(start, self.suns[samples.sun])


def draw_background(stage: Stage, light: SceneLight, observer: Array) -> tuple[Array, Samples]:
    """Sky and ground as channels (pixel, 6), and samples of objects; ``observer`` (3, wavelength) weighs."""
    lens, count = stage.lens, stage.lens.width * stage.lens.height
    found, kept = np.zeros((count, CHANNELS)), []
    fraction = 1.0 / SAMPLES**2
    sunlit, skylit = observer @ light.sunlit, observer @ light.skylit
    skylight = light.skylight_fractions * light.skylit @ observer.T if light.ground is not None else None
    for block in split(count, BLOCK):
        pixel = np.arange(count)[block]
        clear = np.zeros(pixel.size)
        for shown, heading in stage.sample(pixel):
            missed = shown.body < 0
            kept.append(shown.choose(~missed))
            clear[missed & (heading[:, 2] >= 0.0)] += fraction
            below = np.flatnonzero(missed & (heading[:, 2] < 0.0))
            spot = lens.place + heading[below] * (lens.place[2] / -heading[below, 2])[:, None]
            if light.ground is None or skylight is None:
                found[pixel[below], :3] += fraction * (sunlit + skylit)
                continue
            lit = ~stage.rays.find_blocked(spot + OFF_SURFACE * UP, stage.suns[shown.sun[below]])
            bright = lit[:, None] * sunlit + light.ground.rows(spot[:, 0], spot[:, 1]) @ skylight
            found[pixel[below], :3] += fraction * bright
        free = np.flatnonzero(clear)
        travel = -lens.look(pixel[free] % lens.width + 0.5, pixel[free] // lens.width + 0.5)
        turn = find_turn_from_world(travel, lens.find_upright(travel))
        stokes = turn_stokes(light.sky.find(travel), turn[:, None])
        found[pixel[free], :5] += clear[free, None] * weigh_channels(stokes, observer)[:, :5]
    return found, join_samples(kept)


def weigh_channels(stokes: Array, observer: Array) -> Array:
    """Channels (n, 6) of Stokes vectors (n, wavelength, 3 or 4)."""
    found = np.zeros((len(stokes), CHANNELS))
    found[:, :3] = stokes[..., 0] @ observer.T
    found[:, 3 : 2 + stokes.shape[-1]] = np.einsum("w,nws->ns", observer[1], stokes[..., 1:])
    return found


def draw_object(
    stage: Stage, samples: Samples, tables: Sequence[BrdfTable], light: SceneLight, observer: Array
) -> Array:
    """A body's light as channels (pixel, 6), from its ``samples`` and its tables at the wavelengths of ``light``."""
    lookup = Lookup.between_values(tables)
    body = stage.bodies[int(samples.body[0])]
    corner = body.triangles[samples.triangle]
    needed, own = np.unique(corner, return_inverse=True)  # corners, and the samples' own three among these (n, 3)
    own = own.reshape(corner.shape)
    corners = Points.seen(body.corners[needed], body.normals[needed], stage.lens)
    found = np.zeros((stage.lens.width * stage.lens.height, CHANNELS))
    smooth = np.empty((needed.size, CHANNELS))
    for block in split(needed.size, 512):
        here = corners.choose(block)
        stokes = surfaces.gather_skylight(here, lookup, light, stage.rays, SKYLIGHT)
        if tables[0].facets is not None:
            stokes += surfaces.gather_off_facets(here, lookup, light, stage.rays)
        smooth[block] = weigh_channels(stokes, observer)
    for block in split(len(samples.pixel), BLOCK):
        some = samples.choose(block)
        points = stage.find_points(some)
        stokes = surfaces.reflect_sunlight(points, stage.find_lit(some, points), lookup, light.sky)
        if tables[0].specular is not None:
            stokes += surfaces.mirror_surroundings(points, lookup, light, stage.rays)
        seen = weigh_channels(stokes, observer) + np.einsum("nk,nkc->nc", some.weights, smooth[own[block]])
        np.add.at(found, some.pixel, seen / SAMPLES**2)
    if tables[0].specular is not None:
        add_glints(found, stage, samples, [table.mirror for table in tables], light.sky, observer)
    return found


def add_glints(
    found: Array, stage: Stage, samples: Samples, mirrors: Sequence[Callable[[Array], Array]], sky: Sky, observer: Array
) -> None:
    """Adds the sun's image in a body's smooth surface, an even disc of 0.53 degrees, to channels (pixel, 6), from the
    body's ``samples`` and the fraction that is mirrored at each wavelength, of cosines. Pixels whose samples mirror
    places near the sun, nearer than they are apart, are sampled once more, closely."""
    away = np.empty(len(samples.pixel))
    for block in split(len(samples.pixel), BLOCK):
        points = stage.find_points(samples.choose(block))
        away[block] = np.arccos(np.clip(points.mirrored @ sky.beam, -1.0, 1.0))
    count = stage.lens.width * stage.lens.height
    least, most = np.full(count, np.inf), np.zeros(count)
    np.minimum.at(least, samples.pixel, away)
    np.maximum.at(most, samples.pixel, away)
    chosen = np.flatnonzero(least < SUN_RADIUS + 1.5 * (most - least) + 1e-3)
    body = int(samples.body[0])
    for here, _ in look_closely(stage, chosen):
        here = here.choose(here.body == body)
        if not here.pixel.size:
            continue
        points = stage.find_points(here)
        shine = np.flatnonzero(points.mirrored @ sky.beam > np.cos(SUN_RADIUS))
        if shine.size:
            bright = points.choose(shine)
            shine = shine[surfaces.find_free(stage.rays, bright, bright.mirrored)[0]]
        if not shine.size:
            continue
        points = points.choose(shine)
        stokes = np.stack([mirror(points.mu_o)[:, :, 0] for mirror in mirrors], axis=1) * (sky.sun / SUN_DISC)[:, None]
        stokes = turn_stokes(stokes, points.back[:, None])
        np.add.at(found, here.pixel[shine], weigh_channels(stokes, observer) / GLINT_SAMPLES**2)


def look_closely(stage: Stage, pixel: Any) -> Iterator[tuple[Samples, Array]]:
    """What pixels (n,) show, body -1 for nothing, and where their rays head, of GLINT_SAMPLES x GLINT_SAMPLES samples
    of each, some pixels at a time."""
    steps = (np.arange(GLINT_SAMPLES) + 0.5) / GLINT_SAMPLES
    across, down = (part.ravel() for part in np.meshgrid(steps, steps))
    for block in split(pixel.size, max(1, BLOCK // across.size)):
        some, times = np.repeat(pixel[block], across.size), pixel[block].size
        start, heading = stage.look(some, np.tile(across, times), np.tile(down, times))
        yield Samples(some, *stage.rays.find_hits(start, heading), 0 * some), heading


def add_sun(found: Array, stage: Stage, sky: Sky, observer: Array) -> None:
    """Adds the sun's disc to channels (pixel, 6), where it is in the picture by itself."""
    lens, toward = stage.lens, -sky.beam
    ahead = -float(toward @ lens.camera.toward)
    if ahead <= 0.0:
        return
    unit = 0.5 * lens.height / (lens.spread * ahead)
    middle = (
        0.5 * lens.width + unit * (toward @ lens.camera.right),
        0.5 * lens.height - unit * (toward @ lens.camera.up),
    )
    reach = unit * np.tan(SUN_RADIUS) / ahead + 1.0
    columns, rows = (
        np.arange(max(0, int(place - reach)), min(size, int(place + reach) + 1))
        for place, size in zip(middle, (lens.width, lens.height), strict=True)
    )
    stokes = np.zeros((1, sky.sun.size, 3))
    stokes[0, :, 0] = sky.sun / SUN_DISC
    for here, heading in look_closely(stage, np.add.outer(rows * lens.width, columns).ravel()):
        bright = (here.body < 0) & (heading @ toward > np.cos(SUN_RADIUS))
        np.add.at(found, here.pixel[bright], weigh_channels(stokes, observer) / GLINT_SAMPLES**2)
