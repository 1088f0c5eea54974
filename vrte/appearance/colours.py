"""Colours from reflectance spectra: CIE XYZ, CIELAB, sRGB for a screen, and the difference between two (CIEDE2000).

ISO/CIE 11664-1 to -3 (observers, illuminants, XYZ), 11664-4 (L*, a*, b*), 11664-6 (CIEDE2000) and IEC 61966-2-1 (sRGB),
formulas and tables as the package colour-science has them. Light and observer are taken 1 nm by 1 nm, the reflectance
as a spline between its wavelengths; docs/how_to/appearance.md has the domain, the errors, and how limits were measured.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_vector, check_whole, make_readonly, show_value
from vrte.basics.errors import SceneError, import_extra
from vrte.formats.toml_table import suggest_nearest

OBSERVERS = {2: "CIE 1931 2 Degree Standard Observer", 10: "CIE 1964 10 Degree Standard Observer"}
LIGHT_KNOWN_TO_NM = 690.0  # a table of an illuminant that ends before is none of the visible
# each lets pass errors of about 1.2 CIEDE2000 in daylight, for 95 % of 102 measured spectra
MOST_BEYOND = (0.05, 0.05, 0.20)  # of X, Y, Z of the perfect white, below the first wavelength or above the last
WIDEST_STEP_UM, STEPS_FROM_UM, STEPS_TO_UM = 0.04, 0.40, 0.70
LEAST_REPORTED = 0.01  # share beyond the wavelengths from which on it is reported


def import_colour_science(purpose: str = "a colour", extra: str = "appearance") -> Any:
    """The package colour-science. Raises MissingExtraError, which names the purpose and the extra."""
    with np.printoptions():  # its import changes how all arrays are printed
        return import_extra("colour", purpose, extra)


def list_illuminants() -> list[str]:
    """The lights that a colour can be seen in: CIE illuminants, and photographers' of ISO 7589."""
    known = import_colour_science().SDS_ILLUMINANTS
    return [name for name, spectrum in known.items() if spectrum.shape.end >= LIGHT_KNOWN_TO_NM]


def combine_with_observer(find_light: Callable[[Array], Array], observer: int) -> tuple[Array, Array]:
    """Wavelengths [um] (m,), 1 nm apart, and colour-matching functions (m, 3) times the light of ``find_light``."""
    matching = import_colour_science().MSDS_CMFS[OBSERVERS[observer]]
    fine = matching.wavelengths * 1e-3
    return fine, matching.values * find_light(fine)[:, None]


def spread_weights(wavelengths_um: Array, fine_um: Array, combined: Array) -> Array:
    """Weights (3, wavelength) of X, Y, Z from `combine_with_observer`, Y of 1 everywhere being 1: the reflectance is a
    cubic spline between the wavelengths (straight lines through fewer than four), and constant beyond them."""
    from scipy.interpolate import make_interp_spline

    order = 3 if wavelengths_um.size > 3 else min(1, wavelengths_um.size - 1)
    within = np.clip(fine_um, wavelengths_um[0], wavelengths_um[-1])
    cardinal = make_interp_spline(wavelengths_um, np.eye(wavelengths_um.size), k=order)(within)
    return combined.T @ cardinal / combined[:, 1].sum()


def weigh_wavelengths(wavelengths_um: Any, illuminant: str = "D65", observer: int = 10) -> Array:
    """Weights (3, n), read-only, of reflectances (n,) in X, Y, Z, Y of white being 1, at ascending wavelengths [um], 40
    nm apart at most. Raises SceneError where they do not cover the visible, and for unknown names."""
    illuminant, observer = check_light(illuminant, observer)
    return _weigh(check_vector("wavelengths_um", wavelengths_um).tobytes(), illuminant, observer)


def check_light(illuminant: Any, observer: Any) -> tuple[str, int]:
    """Illuminant and observer as they are known here. Raises SceneError, MissingExtraError."""
    degrees = check_whole("observer", observer, 2, 10)
    if degrees not in OBSERVERS:
        raise SceneError(f"observer must be 2 or 10 (degrees), not {degrees}", "observer")
    if not isinstance(illuminant, str):
        raise SceneError(f"illuminant must be a name, 'D65', not {show_value(illuminant)}", "illuminant")
    combine_illuminant(illuminant, degrees)
    return illuminant, degrees


@lru_cache(maxsize=256)
def combine_illuminant(illuminant: str, observer: int) -> tuple[Array, Array]:
    """`combine_with_observer` of an illuminant by its name. Raises SceneError."""
    known = list_illuminants()
    if illuminant not in known:
        words = f"illuminant must be one of {', '.join(known)}, not {show_value(illuminant)}"
        raise SceneError(words + suggest_nearest(illuminant, known), "illuminant")
    table = import_colour_science().SDS_ILLUMINANTS[illuminant]
    fine, combined = combine_with_observer(lambda um: np.interp(um * 1e3, table.wavelengths, table.values), observer)
    return make_readonly(fine), make_readonly(combined)


@lru_cache(maxsize=256)
def find_white(illuminant: str, observer: int) -> Array:
    """X, Y, Z of the perfect white (3,), Y = 1."""
    _, combined = combine_illuminant(illuminant, observer)
    return make_readonly(combined.sum(axis=0) / combined[:, 1].sum())


@lru_cache(maxsize=256)
def find_shares_beyond(first_um: float, last_um: float, illuminant: str, observer: int) -> Array:
    """(2, 3): shares of X, Y, Z of the perfect white that lie below the first wavelength, and above the last."""
    fine, combined = combine_illuminant(illuminant, observer)
    outside = fine < first_um - 1e-9, fine > last_um + 1e-9
    return make_readonly(np.array([combined[where].sum(axis=0) for where in outside]) / combined.sum(axis=0))


@lru_cache(maxsize=256)
def _weigh(wavelengths: bytes, illuminant: str, observer: int) -> Array:
    """Weights (3, n) for wavelengths as bytes, checked."""
    wavelengths_um = np.frombuffer(wavelengths)
    steps = np.diff(wavelengths_um)
    if np.any(steps <= 0.0):
        raise SceneError("wavelengths_um must rise from each to the next", "wavelengths_um")
    _check_ends(float(wavelengths_um[0]), float(wavelengths_um[-1]), illuminant, observer)
    seen = (wavelengths_um[1:] > STEPS_FROM_UM) & (wavelengths_um[:-1] < STEPS_TO_UM)
    index = int(np.where(seen, steps, 0.0).argmax())
    if seen[index] and steps[index] > WIDEST_STEP_UM + 1e-9:
        raise SceneError(
            f"wavelengths_um must be at most {WIDEST_STEP_UM:g} µm apart from {STEPS_FROM_UM:g} to {STEPS_TO_UM:g} µm, "
            f"not {steps[index]:.3g} as between {wavelengths_um[index]:g} and {wavelengths_um[index + 1]:g}",
            "wavelengths_um",
        )
    return make_readonly(spread_weights(wavelengths_um, *combine_illuminant(illuminant, observer)))


def _check_ends(first_um: float, last_um: float, illuminant: str, observer: int) -> None:
    """Raises SceneError where too much of the visible lies below the first wavelength or above the last."""
    fine, combined = combine_illuminant(illuminant, observer)
    beyond = find_shares_beyond(first_um, last_um, illuminant, observer)
    for shares, end_um, words, step in zip(beyond, (first_um, last_um), ("below", "above"), (1, -1), strict=True):
        worst = int(np.argmax(shares / MOST_BEYOND))
        if shares[worst] > MOST_BEYOND[worst]:
            summed = combined[::step].cumsum(axis=0) / combined.sum(axis=0)
            enough_um = fine[::step][(summed > MOST_BEYOND).argmax(axis=0).min()]
            raise SceneError(
                f"wavelengths_um must cover the visible: {100 * shares[worst]:.0f} % of {'XYZ'[worst]} of the perfect "
                f"white ({illuminant}, {observer} degrees) lies {words} {end_um:g} µm, where at most "
                f"{100 * MOST_BEYOND[worst]:.0f} % may; "
                + (f"begin at {enough_um:g} µm or less" if step == 1 else f"end at {enough_um:g} µm or more"),
                "wavelengths_um",
            )


@dataclass(frozen=True)
class Colour:
    """X, Y, Z (Y of the perfect white is 100), L*, a*, b* in a light for an observer; ``known_um``: ends [um] of the
    reflectance, constant beyond; ``beyond``: fractions of the white's X, Y, Z below the first and above the last."""

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
    def extrapolation(self) -> str:
        """What lies beyond the wavelengths, in words; "" where that is less than 1 % of each."""
        found = []
        for shares, end_um, side in zip(self.beyond, self.known_um, ("below", "above"), strict=True):
            named = zip("XYZ", shares, strict=True)
            large = [f"{name} {100 * share:.0f} %" for name, share in named if share > LEAST_REPORTED]
            if large:
                found.append(f"{', '.join(large)} {side} {end_um:g} µm, taken as at {end_um:g}")
        return "; ".join(found)

    @cached_property
    def linear_srgb(self) -> Array:
        """Linear sRGB (3,), the perfect white of the illuminant at 1, 1, 1; not cut off."""
        to_screen = balance_for_screen(find_white(self.illuminant, self.observer).tobytes())
        return make_readonly(to_screen @ (self.X, self.Y, self.Z) / 100.0)

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
        to_screen = balance_for_screen(find_white(self.illuminant, self.observer).tobytes())
        shown = np.linalg.solve(to_screen, np.clip(self.linear_srgb, 0.0, 1.0))
        return find_difference(self, _make_colour(shown, self.illuminant, self.observer, self.known_um, self.beyond))

    def __str__(self) -> str:
        seen = f"L* {self.L:.2f}, a* {self.a:.2f}, b* {self.b:.2f} in {self.illuminant}, {self.observer} degrees"
        cut = "" if self.is_in_gamut else f"cut off for the screen by {self.gamut_gap:.1f} CIEDE2000"
        return "; ".join(filter(None, (seen, self.hex, cut, self.extrapolation)))


def find_colour(wavelengths_um: Any, reflectance: Any, illuminant: str = "D65", observer: int = 10) -> Colour:
    """The colour of a reflectance factor (n,), 1 for the perfect white diffuser, at wavelengths [um] (n,) as
    `weigh_wavelengths` takes them. Raises SceneError, MissingExtraError without the extra "appearance"."""
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


def find_colour_of_lab(lab: Sequence[float], illuminant: str = "D65", observer: int = 10) -> Colour:
    """The colour of L*, a*, b*, with no reflectance behind it."""
    white = find_white(*check_light(illuminant, observer))
    xyz = import_colour_science().Lab_to_XYZ(lab, white[:2] / white.sum())
    return _make_colour(xyz, illuminant, observer, (0.0, math.inf), ((0.0,) * 3,) * 2)


def estimate_error(wavelengths_um: Any, reflectance: Any, illuminant: str = "D65", observer: int = 10) -> float:
    """CIEDE2000 from a colour to that of every second wavelength: whether the steps are narrow enough."""
    colour = find_colour(wavelengths_um, reflectance, illuminant, observer)
    count = np.size(reflectance)
    half = np.unique([*range(0, count, 2), count - 1])
    wavelengths, factors = np.asarray(wavelengths_um, dtype=float)[half], np.asarray(reflectance, dtype=float)[half]
    weights = spread_weights(wavelengths, *combine_illuminant(illuminant, observer))  # in wider steps than allowed
    coarse = _make_colour(weights @ factors, illuminant, observer, colour.known_um, colour.beyond)
    return find_difference(colour, coarse)


def find_difference(one: Colour, other: Colour) -> float:
    """CIEDE2000 (ISO/CIE 11664-6, kL = kC = kH = 1) of colours in one light. Raises SceneError in two."""
    if (one.illuminant, one.observer) != (other.illuminant, other.observer):
        lights = " and ".join(f"{each.illuminant}, {each.observer} degrees" for each in (one, other))
        raise SceneError(f"colours can be compared in the same light and by the same observer alone, not {lights}")
    colour = import_colour_science()
    return float(colour.delta_E((one.L, one.a, one.b), (other.L, other.a, other.b), method="CIE 2000"))


def find_flop_index(near: float, face: float, far: float) -> float:
    """The flop index by L* at 15, 45, 110 degrees off the mirrored beam (Alman 1987); 0 where nothing falls."""
    fall = near - far
    return 2.69 * fall**1.11 / face**0.86 if fall > 0.0 else 0.0


def encode_srgb(linear: Array) -> Array:
    """sRGB (..., 3) from linear values, cut to 0 .. 1."""
    return import_colour_science().RGB_COLOURSPACES["sRGB"].cctf_encoding(np.clip(linear, 0.0, 1.0))


def convert_to_hex(srgb: Array) -> str:
    """sRGB from 0 to 1 as a browser takes it."""
    return "#" + "".join(f"{round(255.0 * value):02x}" for value in np.clip(srgb, 0.0, 1.0).tolist())


def _make_colour(xyz: Any, illuminant: str, observer: int, known_um: Any, beyond: Any) -> Colour:
    """The colour of XYZ (3,) where Y of the perfect white is 1."""
    white = find_white(illuminant, observer)
    lab = import_colour_science().XYZ_to_Lab(xyz, white[:2] / white.sum())
    (X, Y, Z), (L, a, b) = (100.0 * xyz).tolist(), lab.tolist()
    return Colour(X, Y, Z, L, a, b, illuminant, observer, known_um, beyond)


@lru_cache(maxsize=256)
def balance_for_screen(white: bytes) -> Array:
    """(3, 3): XYZ in a light whose white is (X, 1, Z) to linear sRGB, its white at the screen's (CAT02)."""
    colour = import_colour_science()
    from colour.adaptation import matrix_chromatic_adaptation_VonKries

    to_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    balance = matrix_chromatic_adaptation_VonKries(np.frombuffer(white), to_xyz.sum(axis=1), transform="CAT02")
    return make_readonly(np.linalg.solve(to_xyz, balance))
