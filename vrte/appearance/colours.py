"""Colours from reflectance spectra: CIE XYZ, CIELAB, sRGB for a screen, and the difference between two (CIEDE2000).

ISO/CIE 11664-3 (XYZ), 11664-4 (L*, a*, b*), 11664-6 (CIEDE2000) and IEC 61966-2-1 (sRGB), their formulas as the
package colour-science has them; docs/how_to/appearance.md has the domain and the errors.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from vrte.appearance.lights import (
    check_light,
    combine_illuminant,
    find_shares_beyond,
    find_white,
    import_colour_science,
    spread_weights,
    weigh_wavelengths,
)
from vrte.basics.arrays import Array, check_vector, settle_array
from vrte.basics.errors import SceneError

TOLD = 0.01  # share beyond the wavelengths from which on it is told


@dataclass(frozen=True)
class Colour:
    """A colour in a light, for an observer: X, Y, Z, where Y of the perfect white is 100, and L*, a*, b* of CIELAB.

    ``known_um``: first and last wavelength [um] of the reflectance, which is taken as constant beyond; ``beyond``:
    shares of the white's X, Y, Z below the first and above the last.
    """

    X: float
    Y: float
    Z: float
    L: float
    a: float
    b: float
    illuminant: str
    observer: int
    known_um: tuple[float, float]
    beyond: tuple[tuple[float, ...], tuple[float, ...]]

    @property
    def C(self) -> float:
        """Chroma C*ab, the distance from grey."""
        return float(np.hypot(self.a, self.b))

    @property
    def h(self) -> float:
        """Hue angle h_ab [degrees]: 0 is red, 90 yellow, 180 green, 270 blue."""
        return float(np.degrees(np.arctan2(self.b, self.a)) % 360.0)

    @property
    def extrapolated(self) -> float:
        """The largest share of X, Y or Z of the perfect white that lies beyond the wavelengths, of one side."""
        return max(map(max, self.beyond))

    @property
    def extrapolation(self) -> str:
        """What lies beyond the wavelengths, in words; "" where that is less than 1 % of each."""
        found = []
        for shares, end_um, side in zip(self.beyond, self.known_um, ("below", "above"), strict=True):
            if large := [
                f"{name} {100 * share:.0f} %" for name, share in zip("XYZ", shares, strict=True) if share > TOLD
            ]:
                found.append(f"{', '.join(large)} {side} {end_um:g} µm, taken as at {end_um:g}")
        return "; ".join(found)

    @cached_property
    def linear_srgb(self) -> Array:
        """Linear sRGB (3,), the perfect white of the illuminant at 1, 1, 1; not cut off."""
        return settle_array(_balance_for_screen(self.illuminant, self.observer) @ (self.X, self.Y, self.Z) / 100.0)

    @property
    def srgb(self) -> Array:
        """sRGB (3,) from 0 to 1 for a screen; what it cannot show is cut off (`is_in_gamut`, `gamut_gap`)."""
        return encode_srgb(self.linear_srgb)

    @property
    def hex(self) -> str:
        """The colour for a screen as "#rrggbb"."""
        return convert_to_hex(self.srgb)

    @property
    def is_in_gamut(self) -> bool:
        """Whether a screen of sRGB can show it."""
        return bool(np.all(np.abs(self.linear_srgb - 0.5) <= 0.5 + 1e-9))

    @property
    def gamut_gap(self) -> float:
        """CIEDE2000 from the colour to what `srgb` shows in its place; 0 where that is the colour."""
        if self.is_in_gamut:
            return 0.0
        shown = np.linalg.solve(
            _balance_for_screen(self.illuminant, self.observer), np.clip(self.linear_srgb, 0.0, 1.0)
        )
        return find_difference(self, _make_colour(shown, self.illuminant, self.observer, self.known_um, self.beyond))

    def __str__(self) -> str:
        words = [
            f"L* {self.L:.2f}, a* {self.a:.2f}, b* {self.b:.2f} in {self.illuminant}, {self.observer} degrees",
            self.hex,
        ]
        if not self.is_in_gamut:
            words.append(f"cut off for the screen by {self.gamut_gap:.1f} CIEDE2000")
        return "; ".join([*words, self.extrapolation] if self.extrapolation else words)


def find_colour(wavelengths_um: Any, reflectance: Any, illuminant: str = "D65", observer: int = 10) -> Colour:
    """The colour of a surface by its reflectance factor (n,), 1 for the perfect white diffuser, at wavelengths [um]
    (n,) as `weigh_wavelengths` takes them. Raises SceneError, MissingExtraError without the extra "appearance".

    >>> wavelengths_um = np.linspace(0.40, 0.70, 16)
    >>> print(find_colour(wavelengths_um, 0.05 + 0.6 / (1.0 + np.exp((0.6 - wavelengths_um) / 0.01))))
    L* 45.10, a* 50.21, b* 31.66 in D65, 10 degrees; #bd3f39
    """
    wavelengths, factors = check_vector("wavelengths_um", wavelengths_um), check_vector("reflectance", reflectance)
    if factors.shape != wavelengths.shape:
        words = f"reflectance must have one number a wavelength, {wavelengths.size}, not {factors.size}"
        raise SceneError(words, "reflectance")
    if factors.min() < -1e-9:  # less is what rounding leaves of black
        raise SceneError(f"reflectance must be numbers >= 0, not {factors.min():g}", "reflectance")
    weights = weigh_wavelengths(wavelengths, illuminant, observer)
    illuminant, observer = check_light(illuminant, observer)
    known_um = float(wavelengths[0]), float(wavelengths[-1])
    below, above = find_shares_beyond(*known_um, illuminant, observer).tolist()
    return _make_colour(weights @ factors, illuminant, observer, known_um, (tuple(below), tuple(above)))


def estimate_error(wavelengths_um: Any, reflectance: Any, illuminant: str = "D65", observer: int = 10) -> float:
    """CIEDE2000 from a colour to that of every second wavelength (and the last): whether the steps are narrow enough.

    For smooth spectra several times the error of all wavelengths. Above 1 there are ripples, as spheres of one size
    have them, and the error may be as large; a ripple of the steps' own period stays unseen.

    >>> wavelengths_um = np.linspace(0.40, 0.70, 16)
    >>> [round(estimate_error(wavelengths_um, 0.5 + 0.2 * np.sin(wavelengths_um / one)), 2) for one in (0.03, 0.01)]
    [0.05, 9.28]
    """
    colour = find_colour(wavelengths_um, reflectance, illuminant, observer)
    count = np.size(reflectance)
    half = np.unique([*range(0, count, 2), count - 1])
    wavelengths, factors = np.asarray(wavelengths_um, dtype=float)[half], np.asarray(reflectance, dtype=float)[half]
    weights = spread_weights(
        wavelengths, *combine_illuminant(illuminant, observer)
    )  # wider steps than colours may have
    return find_difference(
        colour, _make_colour(weights @ factors, illuminant, observer, colour.known_um, colour.beyond)
    )


def find_difference(one: Colour, other: Colour) -> float:
    """CIEDE2000 (ISO/CIE 11664-6, kL = kC = kH = 1) of two colours in one light, about 1 where the difference is just
    seen side by side. Raises SceneError where illuminant or observer differ."""
    if (one.illuminant, one.observer) != (other.illuminant, other.observer):
        raise SceneError(
            "colours can be compared in the same light and by the same observer alone, not "
            + " and ".join(f"{each.illuminant}, {each.observer} degrees" for each in (one, other))
        )
    colour = import_colour_science()
    return float(colour.delta_E((one.L, one.a, one.b), (other.L, other.a, other.b), method="CIE 2000"))


def encode_srgb(linear: Array) -> Array:
    """sRGB (..., 3) from linear values, cut to 0 .. 1."""
    found: Array = import_colour_science().RGB_COLOURSPACES["sRGB"].cctf_encoding(np.clip(linear, 0.0, 1.0))
    return found


def convert_to_hex(srgb: Array) -> str:
    """sRGB from 0 to 1 as a browser takes it.

    >>> convert_to_hex(np.array([1.0, 0.5, 0.0]))
    '#ff8000'
    """
    return "#" + "".join(f"{round(255.0 * value):02x}" for value in np.clip(srgb, 0.0, 1.0).tolist())


def _make_colour(xyz: Any, illuminant: str, observer: int, known_um: Any, beyond: Any) -> Colour:
    """The colour of XYZ (3,) where Y of the perfect white is 1."""
    white = find_white(illuminant, observer)
    lab = import_colour_science().XYZ_to_Lab(xyz, white[:2] / white.sum())
    (X, Y, Z), (L, a, b) = (100.0 * xyz).tolist(), lab.tolist()
    return Colour(X, Y, Z, L, a, b, illuminant, observer, known_um, beyond)


@lru_cache(maxsize=256)
def _balance_for_screen(illuminant: str, observer: int) -> Array:
    """(3, 3): XYZ in a light to linear sRGB, with the light's white at the screen's (von Kries' way, CAT02)."""
    colour = import_colour_science()
    from colour.adaptation import matrix_chromatic_adaptation_VonKries

    to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    balance = matrix_chromatic_adaptation_VonKries(
        find_white(illuminant, observer), to_xyz.sum(axis=1), transform="CAT02"
    )
    return settle_array(np.linalg.solve(to_xyz, balance))
