"""Where things are: camera, sun and sky in one frame, and how Stokes axes turn between them.

World frame: z up, azimuths counter-clockwise seen from above. Every Stokes vector refers to axes (l, r) across its
direction of travel k with r = l x k (docs/reference/conventions.md); l is the polar unit vector of that direction about
the normal in question: the vertical for the sky, the surface's for the BRDF. For the camera l is the picture's upright.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array

EAST, NORTH, UP = np.eye(3)
FIELD_DEG = 32.0  # from the lower to the upper edge of a picture
FILLED = 0.80  # of a picture's height or width: what objects take at most


@dataclass(frozen=True, eq=False)
class Camera:
    """A far camera: ``right``, ``up`` (3,) span the picture, ``toward`` (3,) leads from the scene to the camera."""

    right: Array
    up: Array
    toward: Array


def place_camera(elevation_deg: float, azimuth_deg: float) -> Camera:
    """The camera that stands in this direction, seen from the scene."""
    elevation, azimuth = np.radians([elevation_deg, azimuth_deg])
    heading = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    toward = np.cos(elevation) * heading + np.sin(elevation) * UP
    right = np.array([-heading[1] + 0.0, heading[0], 0.0])
    return Camera(right, np.cross(toward, right), toward)


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera at a ``distance`` from what stands in the ``middle`` (3,) of its picture of ``width`` x ``height``
    pixels; ``spread`` is the tangent of half the angle between the lower and the upper edge."""

    camera: Camera
    middle: Array
    distance: float
    spread: float
    width: int
    height: int

    @property
    def place(self) -> Array:
        """The position (3,) of the camera."""
        return self.middle + self.distance * self.camera.toward

    def look(self, across: Any, down: Any) -> Array:
        """Unit vectors (n, 3) from the camera through places in the picture, in pixels from its upper left corner."""
        unit = 2.0 * self.spread / self.height
        x, y = unit * (across - 0.5 * self.width), -unit * (down - 0.5 * self.height)
        return normalize(x[:, None] * self.camera.right + y[:, None] * self.camera.up - self.camera.toward)

    def find_upright(self, toward: Array) -> Array:
        """The picture's upright across light that travels along ``toward`` (n, 3): its Stokes axis l."""
        return normalize(self.camera.up - (toward @ self.camera.up)[:, None] * toward)


def place_lens(camera: Camera, bodies: Sequence[Any], height: int) -> Lens:
    """The lens that sees all bodies, in a picture as wide as they need: square for one."""
    corners = np.concatenate([body.corners for body in bodies])
    spread = float(np.tan(np.radians(0.5 * FIELD_DEG)))
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    for _ in range(8):  # until the bodies are in the middle of their picture
        x, y, near = ((corners - middle) @ axis for axis in (camera.right, camera.up, camera.toward))
        size = np.maximum(np.abs(x), np.abs(y)) if len(bodies) == 1 else np.abs(y)
        distance = float((size / (FILLED * spread) + near).max())
        seen = [part / (distance - near) for part in (x, y)]
        shift = [0.5 * distance * float(part.min() + part.max()) for part in seen]
        middle = middle + shift[0] * camera.right + shift[1] * camera.up
    wide = float(np.abs(seen[0]).max()) / spread
    width = height if len(bodies) == 1 else round(height * (wide + 1.0 - FILLED))
    return Lens(camera, middle, distance, spread, width, height)


def normalize(vectors: Array) -> Array:
    """Vectors (n, 3) of length 1; those without a length stay so."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def compute_normals(camera: Camera, theta: Array, psi: Array) -> Array:
    """Surface normals (..., 3) seen at the angle theta from the line of sight, psi from right to up (...) [rad]."""
    radial = np.cos(psi)[..., None] * camera.right + np.sin(psi)[..., None] * camera.up
    return np.cos(theta)[..., None] * camera.toward + np.sin(theta)[..., None] * radial


def convert_to_polar(travel: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Signed cosine, azimuth [rad], 0 at poles, and axis l (..., 3) of travel (..., 3) in the frame x, y, z."""
    cosine = np.clip((travel * z).sum(axis=-1), -1.0, 1.0)
    azimuth = np.arctan2((travel * y).sum(axis=-1), (travel * x).sum(axis=-1))
    sine = np.sqrt(1.0 - cosine**2)
    heading = np.cos(azimuth)[..., None] * x + np.sin(azimuth)[..., None] * y
    return cosine, azimuth, cosine[..., None] * heading - sine[..., None] * z


def find_turn_from_world(travel: Array, new: Array) -> Array:
    """The angle (...) [rad] by which the axis l of the vertical's frame has to turn to ``new`` (..., 3)."""
    return find_turn(travel, convert_to_polar(travel, EAST, NORTH, UP)[2], new)


def find_turn(travel: Array, old: Array, new: Array) -> Array:
    """The angle (...) [rad] by which the axis l has to turn, toward r = l x k, from ``old`` to ``new`` (..., 3)."""
    return np.arctan2((new * np.cross(old, travel)).sum(axis=-1), (new * old).sum(axis=-1))


def turn_stokes(stokes: Array, angle: Array) -> Array:
    """Stokes vectors (..., 4), or (..., 3) without V, on axes turned by ``angle`` (...) [rad] from l toward r."""
    cosine, sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
    intensity, q, u, *v = np.moveaxis(stokes, -1, 0)
    return np.stack(np.broadcast_arrays(intensity, cosine * q + sine * u, cosine * u - sine * q, *v), axis=-1)
