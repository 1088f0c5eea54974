"""What a user asks for, checked before any work."""

from typing import Any

import numpy as np

from vrte.arrays import Array, flag, numbers, shown, vector, whole
from vrte.discrete_ordinates.choice import ALGORITHMS
from vrte.discrete_ordinates.solver import Options
from vrte.errors import SceneError
from vrte.optics.truncation import TRUNCATIONS
from vrte.scene import Scene

SMALLEST_COSINE = 1e-8
MOST_NODES = 4096
LARGEST_STOKES = 1e100  # sums over nodes and orders stay far below overflow


def check_scene(scene: Any) -> Scene:
    """The scene, or a SceneError that says what was given."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene must be a vrte.Scene, not {type(scene).__name__}")
    return scene


def cosines(name: str, values: Any, signed: bool = False) -> Array:
    """Cosines with 1e-8 <= |mu| <= 1, positive unless `signed`."""
    array = vector(name, values)
    size = np.abs(array) if signed else array
    bad = ~((size >= SMALLEST_COSINE) & (size <= 1.0))
    if bad.any():
        allowed = "1e-8 <= |mu| <= 1 (above 0: up, below 0: down)" if signed else "1e-8 <= mu <= 1"
        raise SceneError(f"{name} must satisfy {allowed}, not {array[bad][0]}")
    return array


def stokes_vector(values: Any) -> Array:
    """Four numbers of any sensible unit."""
    array = vector("stokes", values)
    if array.shape != (4,):
        raise SceneError(f"stokes must be four numbers I, Q, U, V, not {array.size}")
    largest = np.abs(array).max()
    if largest > LARGEST_STOKES:
        raise SceneError(f"stokes must be four numbers of at most {LARGEST_STOKES:g} in size, not {largest:g}")
    return array


def depths(values: Any, scene: Scene) -> Array:
    """Optical depths from 0 to the scene's total."""
    given = numbers("tau", values)
    if np.isinf(given).any():
        raise SceneError("tau must be finite, also inside a layer without end")
    array = vector("tau", given)
    total = scene.thickness
    bad = (array < 0.0) | (array > total)
    if bad.any():
        raise SceneError(f"tau must lie between 0 and the total optical thickness {total:g}, not at {array[bad][0]}")
    return array


def solver_options(nodes: Any, algorithm: Any, verify: Any, truncation: Any = "none") -> Options:
    """Nodes of a hemisphere, the algorithm's name, a yes or no, the truncation's name."""
    return Options(
        whole("nodes", nodes, 1, MOST_NODES),
        one_of("algorithm", algorithm, ALGORITHMS),
        flag("verify", verify),
        one_of("truncation", truncation, TRUNCATIONS),
    )


def one_of(name: str, value: Any, allowed: tuple[str, ...]) -> str:
    """One of the names allowed."""
    if not (isinstance(value, str) and value in allowed):
        raise SceneError(f"{name} must be {', '.join(map(repr, allowed))}, not {shown(value)}")
    return value
