"""Objects that stand on the ground under the sky, as the camera sees them: which places, and how bright.

What a place sends to the camera is in surfaces.py. The sky's part varies slowly over a surface: it is computed at the
corners of the mesh and is linear between them. The sun's, with its shadows, and what a smooth surface mirrors are
computed for each of a pixel's samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.render.geometry import UP, convert_to_polar, find_turn, turn_stokes
from vrte.render.gloss import SUN_RADIUS
from vrte.render.rays import OFF_SURFACE, Lens, Rays
from vrte.render.shapes import Body
from vrte.render.spheres import Table
from vrte.render.surfaces import (
    BLOCK,
    EAST,
    NORTH,
    Ground,
    Light,
    Lookup,
    Points,
    gather_off_facets,
    gather_skylight,
    mirror_surroundings,
    reflect_sunlight,
    split,
    turn_linear,
)

CHANNELS = 6  # X, Y and Z of I, and Q, U and V weighted as Y is
SAMPLES = 3  # of a pixel, each way
GLINT_SAMPLES = 24  # of a pixel in which the sun may be mirrored, each way


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
        """Those samples alone that an index or a mask names."""
        return Samples(*(part[which] for part in (self.pixel, self.body, self.triangle, self.where, self.sun)))


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
    def ground(self) -> Ground | None:
        """The objects' shadow on it; None where they do not stand on it."""
        return Ground.below(self.bodies, self.rays, self.beam) if self.standing else None

    @cached_property
    def suns(self) -> Array:
        """Directions (samples, 3) that lead to points of the sun's disc."""
        count = SAMPLES**2
        x, y, _ = _make_axes_across(-self.beam)
        distance = SUN_RADIUS * np.sqrt((np.arange(count) + 0.5) / count)
        turn = 2.399963 * np.arange(count)  # the golden angle: no two near each other
        found = -self.beam + (distance * np.cos(turn))[:, None] * x + (distance * np.sin(turn))[:, None] * y
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def look(self, pixel: Any, across: Any, down: Any) -> tuple[Array, Array]:
        """Where rays begin, near the objects, and along which unit vectors (n, 3), at these places of pixels."""
        heading = self.lens.look(pixel % self.lens.width + across, pixel // self.lens.width + down)
        near = max(self.lens.distance - 50.0, 0.0)  # a far camera's rays would begin too far away for single precision
        return self.lens.place + near * heading, heading

    def find_points(self, samples: Samples) -> Points:
        """The places that samples, all of one body, show."""
        body = self.bodies[int(samples.body[0])]
        return Points.seen(*self._interpolate(body, samples), self.lens)

    def _interpolate(self, body: Body, samples: Samples) -> tuple[Array, Array]:
        """Positions and normals (n, 3)."""
        shares = np.concatenate([1.0 - samples.where.sum(axis=1, keepdims=True), samples.where], axis=1)
        corner = body.triangles[samples.triangle]
        normal = np.einsum("nk,nkc->nc", shares, body.normals[corner])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        return np.einsum("nk,nkc->nc", shares, body.corners[corner]), normal

    def find_lit(self, samples: Samples, points: Points) -> Any:
        """Whether the sun reaches the places (n,) that samples show.

        Rays begin on the surface that the normals belong to, outside flat triangles: those would shadow themselves.
        """
        body = self.bodies[int(samples.body[0])]
        shares = np.concatenate([1.0 - samples.where.sum(axis=1, keepdims=True), samples.where], axis=1)
        corner = body.triangles[samples.triangle]
        below = ((body.corners[corner] - points.position[:, None]) * body.normals[corner]).sum(axis=2)
        raised = np.einsum("nk,nkc->nc", shares * np.maximum(below, 0.0), body.normals[corner])
        start = points.position + raised + OFF_SURFACE * points.normal
        return ~self.rays.find_blocked(start, self.suns[samples.sun])

    def find_corners(self, samples: Samples) -> tuple[Any, Any]:
        """Which corners of the body samples need, and the samples' own three among these (n, 3)."""
        corner = self.bodies[int(samples.body[0])].triangles[samples.triangle]
        needed, own = np.unique(corner, return_inverse=True)
        return needed, own.reshape(corner.shape)


def _make_axes_across(axis: Array) -> tuple[Array, Array, Array]:
    """Two unit vectors across a third."""
    x = np.cross(axis, EAST if abs(axis[0]) < 0.9 else NORTH)
    x /= np.linalg.norm(x)
    return x, np.cross(axis, x), axis


def draw_background(stage: Stage, light: Light, observer: Array) -> tuple[Array, Samples]:
    """Sky and ground as channels (pixel, 6), each as much as is seen of it, and the samples of all objects.

    ``observer`` (3, wavelength) weighs wavelengths.
    """
    lens, rays = stage.lens, stage.rays
    count = lens.width * lens.height
    found, kept = np.zeros((count, CHANNELS)), []
    share = 1.0 / SAMPLES**2
    sunlit, skylit = observer @ light.sunlit, observer @ light.skylit
    shares = light.skylight_shares * light.skylit @ observer.T if light.ground is not None else None
    for block in split(count, BLOCK):
        pixel = np.arange(count)[block]
        clear = np.zeros(pixel.size)
        for place in range(SAMPLES**2):
            row, column = divmod(place, SAMPLES)
            start, heading = stage.look(pixel, np.array((column + 0.5) / SAMPLES), np.array((row + 0.5) / SAMPLES))
            hits = rays.find_hits(start, heading)
            sun = (place + 4 * (pixel % lens.width) + 7 * (pixel // lens.width)) % SAMPLES**2
            struck = np.flatnonzero(hits.body >= 0)
            kept.append(
                Samples(*(part[struck] for part in (pixel.astype(np.int32), hits.body, hits.triangle, hits.where, sun)))
            )
            missed = hits.body < 0
            clear[missed & (heading[:, 2] >= 0.0)] += share
            below = np.flatnonzero(missed & (heading[:, 2] < 0.0))
            spot = lens.place + heading[below] * (lens.place[2] / -heading[below, 2])[:, None]
            if light.ground is None or shares is None:
                found[pixel[below], :3] += share * (sunlit + skylit)
                continue
            lit = ~rays.find_blocked(spot + OFF_SURFACE * UP, stage.suns[sun[below]])
            found[pixel[below], :3] += share * (
                lit[:, None] * sunlit + light.ground.rows(spot[:, 0], spot[:, 1]) @ shares
            )
        free = np.flatnonzero(clear)
        heading = lens.look(pixel[free] % lens.width + 0.5, pixel[free] // lens.width + 0.5)
        in_world = convert_to_polar(-heading, EAST, NORTH, UP)[2]
        stokes = turn_linear(
            light.find_sky(-heading), find_turn(-heading, in_world, lens.find_upright(-heading))[:, None]
        )
        found[pixel[free], :5] += clear[free, None] * weigh_channels(stokes, observer)[:, :5]
    return found, Samples(*(np.concatenate([getattr(part, name) for part in kept]) for name in Samples.__annotations__))


def weigh_channels(stokes: Array, observer: Array) -> Array:
    """Channels (n, 6) of Stokes vectors (n, wavelength, 3 or 4)."""
    found = np.zeros((len(stokes), CHANNELS))
    found[:, :3] = stokes[..., 0] @ observer.T
    found[:, 3 : 2 + stokes.shape[-1]] = np.einsum("w,nws->ns", observer[1], stokes[..., 1:])
    return found


def draw_object(
    stage: Stage,
    samples: Samples,
    tables: Sequence[Table],
    light: Light,
    observer: Array,
    tell: Callable[[float], None] = lambda _: None,
) -> Array:
    """One body's light as channels (pixel, 6), from all its ``samples`` and the tables of its material at the
    wavelengths of ``light``; ``tell`` is called with the share that is done."""
    lookup = Lookup.of(tables)
    body = stage.bodies[int(samples.body[0])]
    needed, own = stage.find_corners(samples)
    corners = Points.seen(body.corners[needed], body.normals[needed], stage.lens)
    found = np.zeros((stage.lens.width * stage.lens.height, CHANNELS))
    smooth = np.empty((needed.size, CHANNELS))
    size = 512
    for block in split(needed.size, size):
        here = corners.choose(block)
        stokes = gather_skylight(here, lookup, light, stage.rays)
        if tables[0].facets is not None:
            stokes += gather_off_facets(here, lookup, light, stage.rays)
        smooth[block] = weigh_channels(stokes, observer)
        tell(0.8 * (block.start + size) / needed.size)
    shares = np.concatenate([1.0 - samples.where.sum(axis=1, keepdims=True), samples.where], axis=1)
    for block in split(len(samples.pixel), BLOCK):
        some = samples.choose(block)
        points = stage.find_points(some)
        stokes = reflect_sunlight(points, stage.find_lit(some, points), lookup, light.sky)
        if tables[0].specular is not None:
            stokes += mirror_surroundings(points, lookup, light, stage.rays)
        seen = weigh_channels(stokes, observer) + np.einsum("nk,nkc->nc", shares[block], smooth[own[block]])
        np.add.at(found, some.pixel, seen / SAMPLES**2)
        tell(0.8 + 0.2 * block.stop / len(samples.pixel))
    if tables[0].specular is not None:
        add_glints(found, stage, samples, tables, light, observer)
    return found


def add_glints(
    found: Array, stage: Stage, samples: Samples, tables: Sequence[Table], light: Light, observer: Array
) -> None:
    """Adds the sun's image in smooth surfaces, an even disc of 0.53 degrees, to channels (pixel, 6).

    Pixels whose samples mirror places near the sun, nearer than they are apart, are looked at once more, closely.
    """
    away = np.empty(len(samples.pixel))
    for block in split(len(samples.pixel), BLOCK):
        points = stage.find_points(samples.choose(block))
        away[block] = np.arccos(np.clip(_mirror(points) @ -light.sky.beam, -1.0, 1.0))
    count = stage.lens.width * stage.lens.height
    least, most = np.full(count, np.inf), np.zeros(count)
    np.minimum.at(least, samples.pixel, away)
    np.maximum.at(most, samples.pixel, away)
    chosen = np.flatnonzero(least < SUN_RADIUS + 1.5 * (most - least) + 1e-3)
    body = int(samples.body[0])
    steps = (np.arange(GLINT_SAMPLES) + 0.5) / GLINT_SAMPLES
    across, down = (part.ravel() for part in np.meshgrid(steps, steps))
    brightness = light.sky.sun / (np.pi * np.sin(SUN_RADIUS) ** 2)
    for block in split(chosen.size, max(1, BLOCK // across.size)):
        pixel = np.repeat(chosen[block], across.size)
        times = chosen[block].size
        start, heading = stage.look(pixel, np.tile(across, times), np.tile(down, times))
        hits = stage.rays.find_hits(start, heading)
        struck = np.flatnonzero(hits.body == body)
        if not struck.size:
            continue
        here = Samples(*(part[struck] for part in (pixel, hits.body, hits.triangle, hits.where, 0 * pixel)))
        points = stage.find_points(here)
        to_sun = _mirror(points)
        shine = np.flatnonzero(to_sun @ -light.sky.beam > np.cos(SUN_RADIUS))
        if not shine.size:
            continue
        points = points.choose(shine)
        shine = shine[~stage.rays.find_blocked(points.position + OFF_SURFACE * points.normal, to_sun[shine])]
        points = stage.find_points(here.choose(shine)) if shine.size else points.choose(slice(0))
        stokes = np.stack([table.mirror(points.mu_o)[:, :, 0] for table in tables], axis=1) * brightness[:, None]
        stokes = turn_stokes(stokes, points.back[:, None])
        np.add.at(found, here.pixel[shine], weigh_channels(stokes, observer) / across.size)


def _mirror(points: Points) -> Array:
    """Where the camera's rays go on to from smooth surfaces (n, 3)."""
    found: Array = 2.0 * points.mu_o[:, None] * points.normal - points.toward
    return found / np.linalg.norm(found, axis=1, keepdims=True)
