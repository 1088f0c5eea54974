"""Where things are: camera, sun and sky in one frame, and how Stokes axes turn between them.

World frame: z up, azimuths counter-clockwise seen from above. Every Stokes vector refers to axes (l, r) across its
direction of travel k with r = l x k (docs/reference/conventions.md); l is the polar unit vector of that direction about
the normal in question: the vertical for the sky, the surface's for the BRDF. For the camera l is the picture's upright.
"""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Camera:
    """A far camera: ``right``, ``up`` (3,) span the picture, ``toward`` (3,) leads from the scene to the camera."""

    right: Array
    up: Array
    toward: Array


def place_camera(elevation_deg: float, azimuth_deg: float) -> Camera:
    """The camera that stands in this direction, seen from the scene.

    >>> camera = place_camera(0.0, 0.0)
    >>> camera.toward.tolist(), camera.right.tolist(), camera.up.tolist()
    ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    """
    elevation, azimuth = np.radians([elevation_deg, azimuth_deg])
    heading = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    toward = np.cos(elevation) * heading + np.sin(elevation) * UP
    right = np.array([-heading[1] + 0.0, heading[0], 0.0])
    return Camera(right, np.cross(toward, right), toward)


def compute_normals(camera: Camera, theta: Array, psi: Array) -> tuple[Array, Array]:
    """Surface normals seen at the angle theta from the line of sight, psi from right to up; and the facet's axis x'.

    theta, psi of one shape (...) [rad] -> two arrays (..., 3). x' lies in the surface and heads for the camera; in the
    frame x', n x x', n light leaves for the camera at azimuth 0.
    """
    radial = np.cos(psi)[..., None] * camera.right + np.sin(psi)[..., None] * camera.up
    cosine, sine = np.cos(theta)[..., None], np.sin(theta)[..., None]
    return cosine * camera.toward + sine * radial, sine * camera.toward - cosine * radial


def convert_to_polar(travel: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Signed cosine, azimuth [rad] and axis l (..., 3) of directions of travel (..., 3) in the frame x, y, z.

    At the poles the azimuth is 0 by choice, and l the one that belongs to it.
    """
    cosine = np.clip((travel * z).sum(axis=-1), -1.0, 1.0)
    azimuth = np.arctan2((travel * y).sum(axis=-1), (travel * x).sum(axis=-1))
    sine = np.sqrt(1.0 - cosine**2)
    heading = np.cos(azimuth)[..., None] * x + np.sin(azimuth)[..., None] * y
    return cosine, azimuth, cosine[..., None] * heading - sine[..., None] * z


def find_turn(travel: Array, old: Array, new: Array) -> Array:
    """The angle (...) [rad] by which the axis l has to turn, toward r = l x k, from ``old`` to ``new`` (..., 3)."""
    return np.arctan2((new * np.cross(old, travel)).sum(axis=-1), (new * old).sum(axis=-1))


def turn_stokes(stokes: Array, angle: Array) -> Array:
    """Stokes vectors (..., 4) on axes turned by ``angle`` (...) [rad] from l toward r.

    >>> turn_stokes(np.array([1.0, 1.0, 0.0, 0.5]), np.array(np.pi / 4)).round(12).tolist()
    [1.0, 0.0, -1.0, 0.5]
    """
    cosine, sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
    intensity, q, u, v = np.moveaxis(stokes, -1, 0)
    return np.stack(np.broadcast_arrays(intensity, cosine * q + sine * u, cosine * u - sine * q, v), axis=-1)
