"""Small checks shared by everything that takes numbers from a user."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.errors import SceneError

Array = NDArray[np.float64]


def frozen(values: Any) -> Array:
    """A read-only float64 copy, contiguous."""
    array = np.array(values, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


def vector(name: str, values: Any) -> Array:
    """A read-only, finite 1-D array; a scalar becomes one of length 1."""
    try:
        array = frozen(np.atleast_1d(np.asarray(values, dtype=np.float64)))
    except Exception:  # whatever a foreign object raises when it is asked for numbers
        raise SceneError(f"{name} must be real numbers, not {shown(values)}") from None
    if array.ndim != 1 or array.size == 0:
        raise SceneError(f"{name} must be a number or a non-empty 1-D list, not of shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise SceneError(f"{name} must be finite numbers, not {array[~np.isfinite(array)][0]}")
    return array


def number(name: str, value: Any, low: float, high: float, allowed: str) -> float:
    """A float within [low, high]; `allowed` says in words what the range is."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        result = float(value)
    except Exception:  # whatever a foreign object raises when it is asked for a number
        raise SceneError(f"{name} must be a number ({allowed}), not {shown(value)}") from None
    if not low <= result <= high:  # also refuses NaN
        raise SceneError(f"{name} must be {allowed}, not {shown(value)}")
    return result


def whole(name: str, value: Any, low: int, high: int) -> int:
    """An integer within [low, high]."""
    try:
        result = int(value)
        exact = bool(result == value) and not isinstance(value, (bool, str, bytes))
    except Exception:
        exact = False
    if not exact or not low <= result <= high:
        raise SceneError(f"{name} must be a whole number from {low} to {high}, not {shown(value)}")
    return result


def flag(name: str, value: Any) -> bool:
    """True or False, and nothing that merely counts as such."""
    if not isinstance(value, (bool, np.bool_)):
        raise SceneError(f"{name} must be True or False, not {shown(value)}")
    return bool(value)


def shown(value: Any) -> str:
    """A value in an error message: one line, not too long, whatever it is."""
    try:
        return " ".join(repr(value).split())[:80]
    except Exception:
        return f"a {type(value).__name__}"
