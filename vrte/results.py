"""What the two results share: checked, read-only arrays on frozen dataclasses that pickle."""

from dataclasses import fields
from typing import Any

import numpy as np

from vrte.arrays import Array, frozen


def set_read_only(owner: Any, name: str, shape: tuple[int, ...]) -> None:
    """Replaces an attribute of a frozen dataclass by a read-only float64 array of the given shape.

    A writable array is copied; one that is read-only already is shared, because a result can be large.
    Raises ValueError where the shape differs.
    """
    given = getattr(owner, name)
    shared = isinstance(given, np.ndarray) and given.dtype == np.float64 and not given.flags.writeable
    array: Array = given if shared else frozen(given)
    if array.shape != shape:
        raise ValueError(f"{type(owner).__name__}.{name} has shape {array.shape}, expected {shape}")
    object.__setattr__(owner, name, array)


class Rebuilt:
    """Pickles through the constructor: NumPy forgets on the way that an array was read-only."""

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, item.name) for item in fields(self))  # type: ignore[arg-type]
