"""Which rays meet which surface: Embree's answers, and the lens through which a near camera sees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import import_extra
from vrte.render.geometry import Camera
from vrte.render.shapes import NEEDED, Body

FIELD_DEG = 32.0  # from the lower to the upper edge of a picture
FILLED = 0.80  # of a picture's height or width: what objects take at most
OFF_SURFACE = 2e-4  # where rays begin above a surface, in sizes of an object


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays (n,) meet first: ``body`` and ``triangle``, -1 for nothing, where in it (n, 2), and how far away."""

    body: Any
    triangle: Any
    where: Array
    distance: Array


class Rays:
    """Bodies among which rays are followed. Raises MissingExtraError without Embree."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        meshes = import_extra("embreex.mesh_construction", *NEEDED)
        self._scene = import_extra("embreex.rtcore_scene", *NEEDED).EmbreeScene()
        self._meshes = [  # the scene keeps no hold on them itself
            meshes.TriangleMesh(self._scene, body.corners.astype(np.float32), body.triangles.astype(np.int32))
            for body in bodies
        ]

    def find_hits(self, start: Array, heading: Array) -> Hits:
        """What rays from ``start`` along unit vectors ``heading`` (n, 3) meet first."""
        found = self._scene.run(start.astype(np.float32), heading.astype(np.float32), output=True)
        missed = found["geomID"] < 0
        body, triangle = (np.where(missed, -1, found[name]) for name in ("geomID", "primID"))
        return Hits(body, triangle, np.stack([found["u"], found["v"]], axis=-1), found["tfar"])

    def find_blocked(self, start: Array, heading: Array) -> Any:
        """Whether rays meet anything (n,)."""
        single = (np.ascontiguousarray(part, dtype=np.float32) for part in (start, heading))
        return self._scene.run(*single, query="OCCLUDED") == 0


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
        """Where the camera is (3,)."""
        return self.middle + self.distance * self.camera.toward

    def look(self, across: Any, down: Any) -> Array:
        """Unit vectors (n, 3) from the camera through places in the picture, in pixels from its upper left corner."""
        unit = 2.0 * self.spread / self.height
        x, y = unit * (across - 0.5 * self.width), -unit * (down - 0.5 * self.height)
        heading = x[:, None] * self.camera.right + y[:, None] * self.camera.up - self.camera.toward
        found: Array = heading / np.linalg.norm(heading, axis=1, keepdims=True)
        return found

    def find_upright(self, toward: Array) -> Array:
        """The picture's upright across light that travels along ``toward`` (n, 3): its Stokes axis l."""
        upright = self.camera.up - (toward @ self.camera.up)[:, None] * toward
        found: Array = upright / np.linalg.norm(upright, axis=1, keepdims=True)
        return found


def place_lens(camera: Camera, bodies: Sequence[Body], height: int) -> Lens:
    """The lens that sees all bodies, in a picture as wide as they need: square for one."""
    corners = np.concatenate([body.corners for body in bodies])
    spread = float(np.tan(np.radians(0.5 * FIELD_DEG)))
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    for _ in range(8):  # until the bodies are in the middle of their picture
        x, y, near = ((corners - middle) @ axis for axis in (camera.right, camera.up, camera.toward))
        if len(bodies) == 1:
            distance = float((np.maximum(np.abs(x), np.abs(y)) / (FILLED * spread) + near).max())
        else:
            distance = float((np.abs(y) / (FILLED * spread) + near).max())
        seen = [part / (distance - near) for part in (x, y)]
        shift = [0.5 * distance * float(part.min() + part.max()) for part in seen]
        middle = middle + shift[0] * camera.right + shift[1] * camera.up
    wide = float(np.abs(seen[0]).max()) / spread
    width = height if len(bodies) == 1 else round(height * (wide + 1.0 - FILLED))
    return Lens(camera, middle, distance, spread, width, height)
