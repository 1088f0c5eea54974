"""From spectra to colours: CIE 1931 XYZ, then sRGB as a camera would set it, balanced to the light and exposed.

Radiances are per unit of sunlight outside the atmosphere at each wavelength; the sun's own spectrum (ASTM G173,
outside the atmosphere) joins the colour-matching functions, 1 nm by 1 nm, so that few wavelengths do.
"""

from dataclasses import dataclass

import numpy as np

from vrte.appearance.colours import (
    balance_for_screen,
    combine_with_observer,
    encode_srgb,
    import_colour_science,
    spread_weights,
)
from vrte.basics.arrays import Array

FEWEST, MOST = 9, 31  # wavelengths, where their number is given
FROM_UM, TO_UM = 0.40, 0.70
NEEDED = "a picture in colour", "render"  # what for, and the extra that brings it


def choose_wavelengths(count: int, low: float = FROM_UM, high: float = TO_UM) -> Array:
    """``count`` wavelengths [um] in equal steps over what of 0.40 to 0.70 lies between ``low`` and ``high``."""
    low, high = max(low, FROM_UM), min(high, TO_UM)
    return np.linspace(low, high, count).round(6).clip(low, high)


def weigh_wavelengths(wavelengths_um: Array) -> Array:
    """(3, wavelength): weights of radiances in sunlight in X, Y and Z for the observer of 2 degrees; radiances of 1
    make Y = 1. Raises MissingExtraError."""
    import_colour_science(*NEEDED)
    return spread_weights(wavelengths_um, *combine_with_observer(load_sunlight_spectrum, observer=2))


def load_sunlight_spectrum(wavelengths_um: Array) -> Array:
    """Spectral irradiance of the sun outside the atmosphere [W m-2 nm-1], of ASTM G173."""
    import_colour_science(*NEEDED)
    from colour.plotting.datasets import SD_ASTMG173_ETR

    return np.interp(wavelengths_um * 1e3, SD_ASTMG173_ETR.wavelengths, SD_ASTMG173_ETR.values)


@dataclass(frozen=True, eq=False)
class Film:
    """``matrix`` (3, 3) takes XYZ to exposed linear sRGB, the light's white to the screen's."""

    matrix: Array

    def linear(self, xyz: Array) -> Array:
        """Linear sRGB (..., 3), where 1 is the brightest that a screen shows; not cut off."""
        return np.asarray(xyz @ self.matrix.T)

    def __call__(self, xyz: Array) -> Array:
        """sRGB (..., 3) from 0 to 1; what is out of reach is cut off."""
        return encode_srgb(self.linear(xyz))


def make_film(white_xyz: Array, stops: float = 0.0) -> Film:
    """Film for light of this white (3,): Y = 1 becomes the screen's brightest, each of ``stops`` doubles that."""
    import_colour_science(*NEEDED)
    return Film(2.0**stops * balance_for_screen((white_xyz / white_xyz[1]).tobytes()))
