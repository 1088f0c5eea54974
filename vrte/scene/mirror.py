"""A smooth base: a semi-infinite metal or dielectric."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError
from vrte.optics.fresnel import reflect_smooth
from vrte.scene.boundary import Boundary

SMALLEST, LARGEST = 1e-3, 1e3
ALLOWED = f"n or n + ik, n from {SMALLEST:g} to {LARGEST:g} and k from 0 to {LARGEST:g}"


def check_complex_index(name: str, index: Any) -> complex:
    """n + ik with n > 0 and k >= 0, of a number or a pair (n, k). Raises SceneError."""
    try:
        value = complex(*index) if isinstance(index, (tuple, list)) else complex(index)
    except (TypeError, ValueError):
        raise SceneError.of(name, f"must be {ALLOWED}, not {show_value(index)}") from None
    if not (SMALLEST <= value.real <= LARGEST and 0.0 <= value.imag <= LARGEST):
        other = "; n - ik of the other convention is n + ik here" if value.imag < 0.0 else ""
        raise SceneError.of(name, f"must be {ALLOWED}, not {show_value(index)}{other}")
    return value


@dataclass(frozen=True)
class Mirror(Boundary):
    """A smooth base that reflects beams as beams, after Fresnel: polished metal, deep glass or water.

    Parameters
    ----------
    index : complex, float or (n, k)
        Its refractive index n + ik, k >= 0; light that gets in is lost. SceneError for another.

    References
    ----------
    Born and Wolf, Principles of Optics, sections 1.5 and 14.2.

    Examples
    --------
    >>> import vrte
    >>> import numpy as np
    >>> vrte.Mirror(1.5).reflect_beam(1.0, np.array([1.0]))[0, 0, 0].round(12).item()
    0.04
    """

    index: Annotated[complex, complex | Sequence[float]]

    keeps_beams = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", check_complex_index("base: index", self.index))

    def reflect_beam(self, index: float, mu: Array) -> Array:
        return reflect_smooth(self.index / index, mu)
