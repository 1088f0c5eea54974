"""From spectra to colours: CIE 1931 XYZ, then sRGB as a camera would set it, balanced to the light and exposed.

Radiances are per unit of sunlight outside the atmosphere at each wavelength; the sun's own spectrum (ASTM G173,
outside the atmosphere) joins the colour-matching functions, 1 nm by 1 nm, so that few wavelengths do.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError

FEWEST, MOST = 9, 31  # wavelengths, where their number is given
FROM_UM, TO_UM = 0.40, 0.70
OBSERVER = "CIE 1931 2 Degree Standard Observer"


def choose_wavelengths(count: int, low: float = FROM_UM, high: float = TO_UM) -> Array:
    """``count`` wavelengths [um] in equal steps over what of 0.40 to 0.70 lies between ``low`` and ``high``.

    >>> choose_wavelengths(31)[:3].round(4).tolist(), choose_wavelengths(10, low=0.43)[:3].round(4).tolist()
    ([0.4, 0.41, 0.42], [0.43, 0.46, 0.49])
    """
    low, high = max(low, FROM_UM), min(high, TO_UM)
    return np.linspace(low, high, count).round(6).clip(low, high)


def import_colour_science() -> Any:
    """The package colour-science. Raises MissingExtraError."""
    try:
        with np.printoptions():  # its import changes how all arrays are printed
            import colour
    except ImportError as error:
        raise MissingExtraError("a picture in colour", "render") from error
    return colour


def weigh_wavelengths(wavelengths_um: Array) -> Array:
    """(3, wavelength): what X, Y and Z take of each wavelength's radiance; Y of 1 at all wavelengths is 1.

    Between wavelengths the spectrum is a cubic spline (straight lines through fewer than four); beyond the first and
    the last it stays as it is there. Raises MissingExtraError.
    """
    from scipy.interpolate import make_interp_spline

    colour = import_colour_science()
    observer = colour.MSDS_CMFS[OBSERVER]
    fine = observer.wavelengths * 1e-3
    weighed = observer.values * load_sunlight_spectrum(fine)[:, None]
    order = 3 if wavelengths_um.size > 3 else min(1, wavelengths_um.size - 1)
    within = np.clip(fine, wavelengths_um[0], wavelengths_um[-1])
    cardinal = make_interp_spline(wavelengths_um, np.eye(wavelengths_um.size), k=order)(within)
    found: Array = weighed.T @ cardinal / weighed[:, 1].sum()
    return found


def load_sunlight_spectrum(wavelengths_um: Array) -> Array:
    """Spectral irradiance of the sun outside the atmosphere [W m-2 nm-1], of ASTM G173."""
    import_colour_science()
    from colour.plotting.datasets import SD_ASTMG173_ETR

    return np.interp(wavelengths_um * 1e3, SD_ASTMG173_ETR.wavelengths, SD_ASTMG173_ETR.values)


@dataclass(frozen=True, eq=False)
class Film:
    """What makes XYZ an exposed picture: ``balance`` (3, 3) takes XYZ to XYZ with the light's white at that of sRGB,
    ``gain`` is what they are multiplied by."""

    balance: Array
    gain: float

    def linear(self, xyz: Array) -> Array:
        """Linear sRGB (..., 3), where 1 is the brightest that a screen shows; not cut off."""
        found: Array = (
            xyz @ (self.gain * import_colour_science().RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB @ self.balance).T
        )
        return found

    def __call__(self, xyz: Array) -> Array:
        """sRGB (..., 3) from 0 to 1; what is out of reach is cut off."""
        return encode_srgb(self.linear(xyz))


def encode_srgb(linear: Array) -> Array:
    """sRGB (..., 3) from linear values, cut to 0 .. 1."""
    found: Array = import_colour_science().RGB_COLOURSPACES["sRGB"].cctf_encoding(np.clip(linear, 0.0, 1.0))
    return found


def make_film(white_xyz: Array, stops: float = 0.0) -> Film:
    """Film for light whose white is ``white_xyz`` (3,): Y = 1 becomes the largest that a screen shows, each of
    ``stops`` doubles that."""
    colour = import_colour_science()
    from colour.adaptation import matrix_chromatic_adaptation_VonKries

    target = colour.xy_to_XYZ(colour.RGB_COLOURSPACES["sRGB"].whitepoint)
    balance = matrix_chromatic_adaptation_VonKries(white_xyz / white_xyz[1], target, transform="CAT02")
    return Film(np.asarray(balance, dtype=float), 2.0**stops)
