"""Where things are: camera, sun and sky in one frame, and how Stokes axes turn between them.

World frame: z up, azimuths counter-clockwise seen from above. Every Stokes vector refers to axes (l, r) across its
direction of travel k with r = l x k (docs/reference/conventions.md); l is the polar unit vector of that direction about
the normal in question: the vertical for the sky, the surface's for the BRDF. For the camera l is the picture's upright.

Objects are a few shapes of our own, made from formulas, and meshes from files: closed surfaces of triangles with a
normal at each corner, one unit large, standing on the ground z = 0; rays meet them.
"""

import io
import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import check_file

EAST, NORTH, UP = np.eye(3)
FIELD_DEG = 32.0  # from the lower to the upper edge of a picture
WIDEST_DEG = 45.0  # from its left to its right edge, at most: a near camera makes eggs of balls that stand aside
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

    @property
    def pixel_deg(self) -> float:
        """The angle between neighbours in the middle of the picture [degrees]."""
        return float(np.degrees(2.0 * self.spread / self.height))

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
    spread, widest = (float(np.tan(np.radians(0.5 * field))) for field in (FIELD_DEG, WIDEST_DEG))
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    for _ in range(8):  # until the bodies are in the middle of their picture
        x, y, near = ((corners - middle) @ axis for axis in (camera.right, camera.up, camera.toward))
        size = np.maximum(np.abs(x), np.abs(y)) if len(bodies) == 1 else np.abs(y)
        distance = float((size / (FILLED * spread) + near).max())
        seen = [part / (distance - near) for part in (x, y)]
        shift = [0.5 * distance * float(part.min() + part.max()) for part in seen]
        middle = middle + shift[0] * camera.right + shift[1] * camera.up
        wide = 1.0 if len(bodies) == 1 else float(np.abs(seen[0]).max()) / spread + 1.0 - FILLED
        spread = min(spread, widest / wide)
    return Lens(camera, middle, distance, spread, round(height * wide), height)


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


SUFFIXES = (".obj", ".ply", ".stl")
CREASE = np.radians(30.0)  # between triangles: an edge that is sharper is drawn as one
LONGEST_EDGE = 1.0 / 60.0  # of a file's mesh: the sky's light is computed at corners and interpolated between them
MOST_TRIANGLES = 2_000_000
INDEX_0 = re.compile(rb"^[ \t]*f[ \t][^\n]*?(?<=[ \t])[+-]?0+(?=[/\s]|\Z)", re.MULTILINE)  # in a face of an .obj
OFF_SURFACE = 2e-4  # where rays begin above a surface, in sizes of an object
NEEDED = "a picture of an object", "render"


@dataclass(frozen=True, eq=False)
class Body:
    """Triangles: ``corners`` (n, 3), unit ``normals`` (n, 3), ``triangles`` (m, 3) counter-clockwise from outside."""

    corners: Array
    normals: Array
    triangles: Any

    def place(self, turn_deg: float = 0.0, middle: tuple[float, float] = (0.0, 0.0)) -> "Body":
        """Turned about the vertical, counter-clockwise from above, one unit large, standing on the ground there."""
        cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        corners = self.corners @ turn
        low, high = corners.min(axis=0), corners.max(axis=0)
        corners = (corners - [*(0.5 * (low + high))[:2], low[2]]) / (high - low).max()
        return Body(corners + np.array([*middle, 0.0]), self.normals @ turn, self.triangles)


def make_body(corners: Array, triangles: Any) -> Body:
    """A body with the normals that its own triangles give it, by their angles at each corner."""
    mesh = import_extra("trimesh", *NEEDED).Trimesh(corners, triangles, process=False)
    return Body(corners, np.array(mesh.vertex_normals), triangles)


def join_rings(rings: Array, around: bool) -> Body:
    """The surface through rings of points (rings, spokes, 3), counter-clockwise seen along the way from ring to ring;
    the last is followed by the first where it leads ``around``, otherwise both ends are closed."""
    count, spokes = rings.shape[:2]
    corner = np.arange(count * spokes).reshape(count, spokes)
    following = np.roll(corner, -1, axis=0) if around else corner[1:]
    here = corner if around else corner[:-1]
    right, beyond = np.roll(here, -1, axis=1), np.roll(following, -1, axis=1)
    faces = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((here, right, beyond), (here, beyond, following))]
    corners = rings.reshape(-1, 3)
    if not around:
        ends = corners.shape[0], corners.shape[0] + 1
        first, last = corner[0], corner[-1]
        faces.append(np.stack([np.full(spokes, ends[0]), np.roll(first, -1), first], axis=-1))
        faces.append(np.stack([np.full(spokes, ends[1]), last, np.roll(last, -1)], axis=-1))
        corners = np.concatenate([corners, rings[:1].mean(axis=1), rings[-1:].mean(axis=1)])
    return make_body(corners, np.concatenate(faces))


def halve(body: Body, axis: Array, side: str) -> Body:
    """The "right" half of a body, where ``axis`` (3,) points, or the "left": the surface on that side of the middle."""
    corners, normals, triangles = body.corners, body.normals, body.triangles
    along = corners @ axis
    height = (along - 0.5 * (along.min() + along.max())) * (1.0 if side == "right" else -1.0)
    count = (height[triangles] > 0.0).sum(axis=1)
    kept = [triangles[count == 3]]
    for inside, lone in ((1, True), (2, False)):  # corners on this side; the one by itself comes first
        cut = triangles[count == inside]
        first = np.argmax((height[cut] > 0.0) == lone, axis=1)
        a, b, c = (np.take_along_axis(cut, ((first + step) % 3)[:, None], axis=1)[:, 0] for step in range(3))
        ends = len(corners) + np.arange(2 * len(cut)).reshape(2, -1)  # where the edges from a to b and to c are cut
        for other in (b, c):
            part = (height[a] / (height[a] - height[other]))[:, None]
            corners = np.concatenate([corners, (1.0 - part) * corners[a] + part * corners[other]])
            normals = np.concatenate([normals, normalize((1.0 - part) * normals[a] + part * normals[other])])
        pieces = [(a, *ends)] if lone else [(ends[0], b, c), (ends[0], c, ends[1])]
        kept += [np.stack(piece, axis=1) for piece in pieces]
    used, renumbered = np.unique(np.concatenate(kept), return_inverse=True)
    return Body(corners[used], normals[used], renumbered.reshape(-1, 3))


def _make_turn(count: int) -> Array:
    """``count`` equal steps of one turn [rad]."""
    return np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)


def make_ball(rings: int = 96) -> Body:
    """A ball: so many rings between its poles."""
    polar, around = np.linspace(np.pi, 0.0, rings + 2)[1:-1, None], _make_turn(2 * rings)
    level = np.broadcast_to(np.cos(polar), (polar.size, around.size))
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), level], axis=-1)
    found = join_rings(points, around=False)
    return Body(found.corners, normalize(found.corners), found.triangles)


# radius and height of the vase's outside from the foot to the lip, and of its inside from there down
VASE_RADII = """
    0.02 0.17 0.195 0.17 0.22 0.33 0.375 0.33   0.20 0.145 0.15 0.205 0.215 0.205
    0.135 0.13 0.19 0.30 0.33 0.29 0.15 0.02"""
VASE_HEIGHTS = """
    0.0 0.0 0.015 0.05 0.14 0.32 0.50 0.68   0.82 0.90 0.95 0.993 1.0 0.998
    0.95 0.90 0.80 0.66 0.50 0.32 0.14 0.12"""
LIP = 12  # of these points
FLUTES, FLUTE_DEPTH, TWIST = 22, 0.045, 1.1  # around the vase, of its radius, and radians from foot to neck


def make_vase(detail: int = 1) -> Body:
    """A hollow vase: a surface of revolution, fluted along lines that wind about it."""
    from scipy.interpolate import PchipInterpolator

    profile = np.array([VASE_RADII.split(), VASE_HEIGHTS.split()], float).T
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    lip = way[LIP]
    steps = np.concatenate([np.linspace(0.0, lip, 150 * detail), np.linspace(lip, way[-1], 50 * detail)[1:]])
    radius, height = PchipInterpolator(way, profile)(steps).T
    fluted = np.clip((height - 0.06) / 0.12, 0.0, 1.0) * np.clip((0.86 - height) / 0.2, 0.0, 1.0) * (steps < lip)
    depth = FLUTE_DEPTH * fluted**2 * (3.0 - 2.0 * fluted)
    around = _make_turn(8 * FLUTES * detail)
    wave = np.cos(FLUTES * (around + TWIST * height[:, None]))
    wide = radius[:, None] * (1.0 + depth[:, None] * wave)
    level = np.broadcast_to(height[:, None], wide.shape)
    return join_rings(np.stack([wide * np.cos(around), wide * np.sin(around), level], axis=-1), around=False)


WHORLS, GROWTH = 8.0, 1.36  # turns of the shell, and how much it grows with each
RIBS, RIB_HEIGHT = 13, 0.07  # in a whorl, of the tube's radius
CORDS, CORD_HEIGHT = 9, 0.015  # around the tube


def make_shell(detail: int = 1) -> Body:
    """A sea snail's shell: a tube with ribs that winds about an axis and grows by the same factor with each turn."""
    turn = np.linspace(0.0, 2.0 * np.pi * WHORLS, 800 * detail)
    back = np.linspace(turn[-1], turn[-1] - 1.2 * np.pi, 60 * detail)[1:]  # the inside, seen through the mouth
    angle = np.concatenate([turn, back])
    inner = np.concatenate([np.zeros(turn.size), np.ones(back.size)])[:, None]
    size = GROWTH ** (angle / (2.0 * np.pi) - WHORLS)[:, None]
    around = _make_turn(64 * detail)
    ribs = np.cos(0.5 * RIBS * angle)[:, None] ** 4
    wave = RIB_HEIGHT * ribs + CORD_HEIGHT * np.cos(CORDS * around)
    radius = size * np.where(inner > 0.0, 0.9, 1.0 + wave)
    outward = 1.02 * size + radius * np.cos(around)
    height = -4.3 * size + 1.2 * radius * np.sin(around)
    rings = np.stack([outward * np.cos(angle)[:, None], outward * np.sin(angle)[:, None], height], axis=-1)
    found = join_rings(rings[:, ::-1], around=False)
    tilt = np.radians(20.0)  # it leans to one side
    turned = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(tilt), np.sin(tilt)], [0.0, -np.sin(tilt), np.cos(tilt)]])
    return Body(found.corners @ turned, found.normals @ turned, found.triangles).place(240.0)  # its mouth in front


def make_knot(detail: int = 1) -> Body:
    """A trefoil: a tube along the torus knot that winds three times around and twice through, standing upright."""
    t, around = _make_turn(420 * detail), _make_turn(48 * detail)
    circle = np.stack([np.cos(2.0 * t), np.sin(2.0 * t), 0.0 * t], axis=-1)
    middle = (2.0 + np.cos(3.0 * t))[:, None] * circle + np.sin(3.0 * t)[:, None] * np.array([0.0, 0.0, 1.0])
    ahead = normalize(np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0))
    first = middle - 2.0 * circle  # from the torus' middle line to its surface
    first = normalize(first - (first * ahead).sum(axis=1, keepdims=True) * ahead)
    second = np.cross(ahead, first)
    offsets = np.cos(around)[:, None] * first[:, None] + np.sin(around)[:, None] * second[:, None]
    rings = middle[:, None] + 0.52 * offsets
    return join_rings(rings[..., [0, 2, 1]] * [1.0, -1.0, 1.0], around=True)


SHAPES: dict[str, Callable[[int], Body]] = {
    "ball": lambda detail: make_ball(96 * detail),
    "vase": make_vase,
    "shell": make_shell,
    "knot": make_knot,
}


def load_mesh(path: Path) -> Body:
    """The mesh of a file, one unit large, the z axis up; edges sharper than 30 degrees stay edges. Warns of triangles
    without an area, which are left out. Raises SceneError, OSError, MissingExtraError."""
    trimesh = import_extra("trimesh", *NEEDED)
    try:
        corners, triangles = read_triangles(path, trimesh)
    except SceneError as error:
        raise error.behind(path) from error
    whole = trimesh.Trimesh(corners, triangles)  # corners at one place become one
    kept = whole.nondegenerate_faces()
    if not kept.any():
        raise SceneError(f"{path}: none of its {len(triangles)} triangles has an area")
    if not kept.all():
        lost = np.count_nonzero(~kept)
        warnings.warn(f"{path}: {lost} of its {kept.size} triangles have no area and are left out", stacklevel=2)
        whole.update_faces(kept)
    if whole.is_watertight and whole.volume < 0.0:  # triangles that are clockwise seen from outside: it would be black
        whole.invert()
    smooth = trimesh.graph.smooth_shade(whole, angle=CREASE, facet_minarea=None)
    return divide_long_edges(make_body(np.array(smooth.vertices), np.array(smooth.faces)), LONGEST_EDGE)


def read_triangles(path: Path, trimesh: Any) -> tuple[Array, Any]:
    """Corners (n, 3) of a file's mesh, one unit large about 0, and its triangles (m, 3). Raises SceneError, OSError."""
    with open(check_file(path), "rb") as file:
        content = file.read()
    kind = path.suffix[1:].lower()
    if kind == "obj" and (wrong := INDEX_0.search(content)):
        line = content.count(b"\n", 0, wrong.start()) + 1
        raise SceneError(f"line {line}: a face has the corner 0; corners are counted from 1, or from the last one, -1")
    try:
        loaded = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
    except (ValueError, KeyError, IndexError, TypeError, NotImplementedError) as error:
        raise SceneError(f"not a mesh that can be read: {str(error)[:120] or type(error).__name__}") from error
    triangles, corners = np.asarray(getattr(loaded, "faces", ())), np.asarray(getattr(loaded, "vertices", ()), float)
    if not 0 < len(triangles) <= MOST_TRIANGLES:
        raise SceneError(f"must be a mesh of 1 to {MOST_TRIANGLES} triangles, not of {len(triangles)}")
    if triangles.min() < 0 or triangles.max() >= len(corners):
        raise SceneError(f"a triangle has a corner that is none of its {len(corners)}")
    (wild,) = np.nonzero(~np.isfinite(corners).all(axis=1))
    if wild.size:
        raise SceneError(f"corner {wild[0] + 1} is at {corners[wild[0]].tolist()}: all must be at finite places")
    corners = corners / max(np.abs(corners).max(), np.finfo(float).tiny)
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not (high > low).any():
        raise SceneError("must be a mesh that has a size")
    return (corners - 0.5 * (low + high)) / (high - low).max(), triangles


def divide_long_edges(body: Body, longest: float) -> Body:
    """The same surface with triangles whose edges are no longer than that; normals are interpolated."""
    subdivide = import_extra("trimesh.remesh", *NEEDED).subdivide
    corners, normals, triangles = body.corners, body.normals, body.triangles
    while len(triangles) <= MOST_TRIANGLES:
        sides = corners[triangles] - corners[np.roll(triangles, -1, axis=1)]
        (long,) = np.nonzero(np.linalg.norm(sides, axis=2).max(axis=1) > longest)
        if not long.size:
            break
        corners, triangles, more = subdivide(
            corners, triangles, face_index=long, vertex_attributes={"normals": normals}
        )
        normals = more["normals"]
    return Body(corners, normalize(normals), triangles)


def find_shape(name: str, up: str = "z", detail: int = 1) -> Body:
    """The shape of this name, with ``detail`` times the corners along each line, or the mesh of this file, whose axis
    ``up`` points up. Raises SceneError, OSError, MissingExtraError."""
    if name in SHAPES:
        return SHAPES[name](detail)
    found = load_mesh(Path(name))
    upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]) if up == "y" else np.eye(3)
    return Body(found.corners @ upright, found.normals @ upright, found.triangles)


class Rays:
    """Bodies among which rays are followed. Raises MissingExtraError without Embree."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        meshes = import_extra("embreex.mesh_construction", *NEEDED)
        self._scene = import_extra("embreex.rtcore_scene", *NEEDED).EmbreeScene()
        self._meshes = [  # the scene keeps no hold on them itself
            meshes.TriangleMesh(self._scene, body.corners.astype(np.float32), body.triangles.astype(np.int32))
            for body in bodies
        ]

    def find_hits(self, start: Array, heading: Array) -> tuple[Any, Any, Array]:
        """What rays (n, 3) meet first: body and triangle (n,), body -1 for nothing, and where in it (n, 2)."""
        found = self._scene.run(start.astype(np.float32), heading.astype(np.float32), output=True)
        body = np.where(found["geomID"] < 0, -1, found["geomID"])
        return body, found["primID"], np.stack([found["u"], found["v"]], axis=-1)

    def find_blocked(self, start: Array, heading: Array) -> Any:
        """Whether rays meet anything (n,)."""
        single = (np.ascontiguousarray(part, dtype=np.float32) for part in (start, heading))
        return self._scene.run(*single, query="OCCLUDED") == 0
