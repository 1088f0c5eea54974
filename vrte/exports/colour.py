"""Red, green and blue of a BRDF in daylight, for formats without wavelengths."""

import numpy as np

from vrte.appearance.colours import balance_for_screen, find_white, weigh_wavelengths
from vrte.basics.arrays import Array

LIGHT = "D65", 2


def weigh_channels(wavelength_um: Array) -> Array:
    """Weights (3, wavelength) of linear sRGB, the perfect white at 1, 1, 1. Raises SceneError, MissingExtraError."""
    return np.asarray(balance_for_screen(find_white(*LIGHT).tobytes()) @ weigh_wavelengths(wavelength_um, *LIGHT))
