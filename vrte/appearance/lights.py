"""What X, Y, Z take of a reflectance at some wavelengths: light and observer 1 nm by 1 nm, a spline between.

ISO/CIE 11664-1 to -3, with the tables of the package colour-science. What few wavelengths cost, and how the limits
below were measured, is in docs/how_to/appearance.md.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, check_vector, check_whole, settle_array, show_value
from vrte.basics.errors import SceneError, import_extra
from vrte.formats.toml_table import suggest_nearest

OBSERVERS = {2: "CIE 1931 2 Degree Standard Observer", 10: "CIE 1964 10 Degree Standard Observer"}
LIGHT_KNOWN_TO_NM = 690.0  # a table of an illuminant that ends before is none of the visible
# each lets pass errors of about 1.2 CIEDE2000 in daylight, for 95 % of 102 measured spectra
MOST_BEYOND = (0.05, 0.05, 0.20)  # of X, Y, Z of the perfect white, below the first wavelength or above the last
WIDEST_STEP_UM, STEPS_FROM_UM, STEPS_TO_UM = 0.04, 0.40, 0.70


def import_colour_science(purpose: str = "a colour", extra: str = "appearance") -> Any:
    """The package colour-science. Raises MissingExtraError, which names the purpose and the extra."""
    with np.printoptions():  # its import changes how all arrays are printed
        return import_extra("colour", purpose, extra)


def list_illuminants() -> list[str]:
    """The lights that a colour can be seen in: CIE illuminants, and photographers' of ISO 7589.

    >>> [name for name in list_illuminants() if name in ("A", "D50", "D65", "FL11", "LED-B1")]
    ['A', 'D50', 'D65', 'FL11', 'LED-B1']
    """
    known = import_colour_science().SDS_ILLUMINANTS
    return [name for name, spectrum in known.items() if spectrum.shape.end >= LIGHT_KNOWN_TO_NM]


def combine_with_observer(find_light: Callable[[Array], Array], observer: int) -> tuple[Array, Array]:
    """Wavelengths [um] from 0.36 to 0.83, 1 nm apart (m,), and (m, 3) colour-matching functions times a light, of any
    unit, whose spectrum at wavelengths [um] ``find_light`` is."""
    matching = import_colour_science().MSDS_CMFS[OBSERVERS[observer]]
    fine = matching.wavelengths * 1e-3
    return fine, matching.values * find_light(fine)[:, None]


def spread_weights(wavelengths_um: Array, fine_um: Array, combined: Array) -> Array:
    """(3, wavelength): what X, Y and Z take of a reflectance at each wavelength; Y of 1 at all of them is 1.

    ``fine_um`` and ``combined`` are `combine_with_observer`'s, and their sum is the integral, as ISO/CIE 11664-3 has
    it. Between the wavelengths the reflectance is a cubic spline (straight lines through fewer than four); beyond the
    first and the last it stays as it is there.
    """
    from scipy.interpolate import make_interp_spline

    order = 3 if wavelengths_um.size > 3 else min(1, wavelengths_um.size - 1)
    within = np.clip(fine_um, wavelengths_um[0], wavelengths_um[-1])
    cardinal = make_interp_spline(wavelengths_um, np.eye(wavelengths_um.size), k=order)(within)
    found: Array = combined.T @ cardinal / combined[:, 1].sum()
    return found


def weigh_wavelengths(wavelengths_um: Any, illuminant: str = "D65", observer: int = 10) -> Array:
    """Weights (3, n), read-only, whose product with a reflectance (n,) is X, Y, Z, where Y of the perfect white is 1.

    Wavelengths [um] (n,) rise, at most 40 nm apart from 0.40 to 0.70 um. At most 5 % of X and of Y, and 20 % of Z, of
    the perfect white may lie below the first or above the last: 0.43 to 0.66 um are enough in daylight. Raises
    SceneError where they do not cover the visible, and for an unknown illuminant or observer.

    >>> weights = weigh_wavelengths([0.43, 0.46, 0.49, 0.52, 0.55, 0.58, 0.61, 0.64, 0.67, 0.70])
    >>> (weights @ np.ones(10)).round(4).tolist()  # the white of D65 and 10 degrees
    [0.9481, 1.0, 1.073]
    """
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
    return settle_array(fine), settle_array(combined)


@lru_cache(maxsize=256)
def find_white(illuminant: str, observer: int) -> Array:
    """X, Y, Z of the perfect white (3,), Y = 1."""
    _, combined = combine_illuminant(illuminant, observer)
    return settle_array(combined.sum(axis=0) / combined[:, 1].sum())


@lru_cache(maxsize=256)
def find_shares_beyond(first_um: float, last_um: float, illuminant: str, observer: int) -> Array:
    """(2, 3): shares of X, Y, Z of the perfect white that lie below the first wavelength, and above the last."""
    fine, combined = combine_illuminant(illuminant, observer)
    outside = fine < first_um - 1e-9, fine > last_um + 1e-9
    return settle_array(np.array([combined[where].sum(axis=0) for where in outside]) / combined.sum(axis=0))


@lru_cache(maxsize=256)
def _weigh(wavelengths: bytes, illuminant: str, observer: int) -> Array:
    """Weights (3, n) for wavelengths as bytes, checked."""
    wavelengths_um = np.frombuffer(wavelengths)
    steps = np.diff(wavelengths_um)
    if np.any(steps <= 0.0):
        raise SceneError("wavelengths_um must rise from each to the next", "wavelengths_um")
    _check_ends(float(wavelengths_um[0]), float(wavelengths_um[-1]), illuminant, observer)
    seen = (wavelengths_um[1:] > STEPS_FROM_UM) & (wavelengths_um[:-1] < STEPS_TO_UM)
    place = int(np.where(seen, steps, 0.0).argmax())
    if seen[place] and steps[place] > WIDEST_STEP_UM + 1e-9:
        raise SceneError(
            f"wavelengths_um must be at most {WIDEST_STEP_UM:g} µm apart from {STEPS_FROM_UM:g} to {STEPS_TO_UM:g} µm, "
            f"not {steps[place]:.3g} as between {wavelengths_um[place]:g} and {wavelengths_um[place + 1]:g}",
            "wavelengths_um",
        )
    return settle_array(spread_weights(wavelengths_um, *combine_illuminant(illuminant, observer)))


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
