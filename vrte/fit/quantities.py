"""What can be measured and fitted, each quantity by the name it has in tables: one row a quantity.

A row says what the quantity is, its unit, which columns say where it was measured, and how it is read off the light
that a solve finds. Light comes as jets, arrays (1 + n, ...) of values and then of their derivatives by n numbers, so
that one function gives both. Angles are from the normal, azimuths as `vrte.brdf` counts them: 0 is forward, 180 turns
back.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vrte.appearance.colours import find_white, weigh_wavelengths
from vrte.basics.arrays import Array
from vrte.results.quantities import MUELLER

DIRECTIONS = ("theta_i_deg", "theta_o_deg", "phi_deg")
BEAM = ("theta_i_deg",)
INSTRUMENT = ("geometry",)
LOOK = ("geometry", "illuminant", "observer")
KNEE = (6.0 / 29.0) ** 3  # where CIELAB's cube root becomes a straight line (ISO/CIE 11664-4)


class Shares(NamedTuple):
    """Jets (1 + n, rows) of shares of an unpolarized beam's power: scattered back and on, mirrored and passed as a
    beam."""

    reflected: Array
    transmitted: Array
    mirrored: Array
    passed: Array


@dataclass(frozen=True)
class Quantity:
    """A quantity: in words, with its unit, the columns that it needs, and how it is read.

    ``read`` takes Mueller matrices (1 + n, rows, 4, 4) where it needs directions, `Shares` where it needs a beam alone,
    a reflectance factor (1 + n, rows) of a geometry, or X, Y, Z and those of the white, (1 + n, 3) and (3,), of a
    colour; it gives (1 + n, rows), of a colour (1 + n,). ``through``: of light that leaves the other face; ``bounds``:
    what it can be at all.
    """

    words: str
    unit: str
    needs: tuple[str, ...]
    read: Callable[..., Array]
    through: bool = False
    bounds: tuple[float, float] = (-np.inf, np.inf)


def multiply_jets(one: Array, other: Array) -> Array:
    """The product, by the product rule.

    >>> multiply_jets(np.array([2.0, 1.0]), np.array([3.0, 0.0])).tolist()
    [6.0, 3.0]
    """
    return np.concatenate([one[:1] * other[:1], one[1:] * other[:1] + one[:1] * other[1:]])


def divide_jets(one: Array, other: Array) -> Array:
    """The quotient, by the quotient rule; 0 over 0 is NaN.

    >>> divide_jets(np.array([1.0, 0.0]), np.array([2.0, 1.0])).tolist()
    [0.5, -0.25]
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = one[:1] / other[:1]
        return np.concatenate([share, (one[1:] - share * other[1:]) / other[:1]])


def find_length(one: Array, other: Array) -> Array:
    """The root of the sum of squares; where that is 0, it has no derivative, and 0 stands for it.

    >>> find_length(np.array([3.0, 1.0]), np.array([4.0, 0.0])).tolist()
    [5.0, 0.6]
    """
    length = np.hypot(one[:1], other[:1])
    slope = np.divide(one[:1] * one[1:] + other[:1] * other[1:], length, out=np.zeros_like(one[1:]), where=length > 0.0)
    return np.concatenate([length, slope])


def follow_chain(jet: Array, value: Array, slope: Array) -> Array:
    """A function of a jet, of which its value and its slope there are known, by the chain rule."""
    return np.concatenate([value[None], slope * jet[1:]])


def pick_element(row: int, column: int) -> Callable[[Array], Array]:
    """An element of Mueller matrices."""
    return lambda matrices: matrices[..., row, column]


def pick_share_of_first(row: int, column: int) -> Callable[[Array], Array]:
    """An element over the first one."""
    return lambda matrices: divide_jets(matrices[..., row, column], matrices[..., 0, 0])


def find_degree(matrices: Array) -> Array:
    """Degree of linear polarization of light that came in unpolarized."""
    return divide_jets(find_length(matrices[..., 1, 0], matrices[..., 2, 0]), matrices[..., 0, 0])


def make_rows(letter: str, through: bool) -> dict[str, Quantity]:
    """The quantities of Mueller matrices of one face."""
    what, before = ("BTDF", "transmitted_") if through else ("BRDF", "")
    light = "transmitted" if through else "reflected"
    one = (-1.0, 1.0)
    rows = {
        name.replace("f", letter): Quantity(
            f"element {name[1:]} of the Mueller {what}",
            "sr-1",
            DIRECTIONS,
            pick_element(int(name[1]), int(name[2])),
            through,
            (0.0, np.inf) if name == "f00" else (-np.inf, np.inf),
        )
        for name in MUELLER
    }
    rows |= {
        name.replace("f", f"normalized_{letter}"): Quantity(
            f"element {name[1:]} of the Mueller {what} over element 00",
            "1",
            DIRECTIONS,
            pick_share_of_first(int(name[1]), int(name[2])),
            through,
            one,
        )
        for name in MUELLER[1:]
    }
    factor = "transmittance_factor" if through else "reflectance_factor"
    return rows | {
        factor: Quantity(
            f"{factor.replace('_', ' ')}: pi times element 00", "1", DIRECTIONS, lambda seen: np.pi * seen[..., 0, 0],
            through, (0.0, np.inf),
        ),
        f"{before}degree_of_linear_polarization": Quantity(
            f"degree of linear polarization of {light} light, unpolarized where it came in", "1", DIRECTIONS,
            find_degree, through, (0.0, 1.0),
        ),
        f"{before}minus_q_over_i": Quantity(
            f"-Q/I of {light} light, unpolarized where it came in: above 0 where it swings perpendicular to the plane "
            "of its direction and the normal", "1", DIRECTIONS,
            lambda seen: -divide_jets(seen[..., 1, 0], seen[..., 0, 0]), through, one,
        ),
    }  # fmt: skip


def make_share_row(words: str, read: Callable[[Shares], Array], through: bool = False) -> Quantity:
    """A quantity of an unpolarized beam."""
    return Quantity(f"{words}, of an unpolarized beam", "1", BEAM, read, through, (0.0, 1.0))


def find_lightness(light: Array, white: Array) -> tuple[Array, ...]:
    """Jets of the cube roots, or lines, of X, Y, Z over the white's that CIELAB is made of."""
    found = []
    for part, most in zip(np.moveaxis(light, -1, 0), white, strict=True):
        share = part / most
        value = share[0]
        low = value <= KNEE
        root = np.cbrt(max(float(value), KNEE))
        made, slope = (841.0 / 108.0 * value + 4.0 / 29.0, 841.0 / 108.0) if low else (root, 1.0 / (3.0 * root**2))
        found.append(follow_chain(share, np.asarray(made), np.asarray(slope)))
    return tuple(found)


def make_colour_row(words: str, weights: tuple[float, float, float], at_black: float = 0.0) -> Quantity:
    """A coordinate of CIELAB: a weighted sum of the three roots."""

    def read(light: Array, white: Array) -> Array:
        found = np.asarray(weights) @ np.stack(find_lightness(light, white))
        found[0] += at_black
        return found

    return Quantity(f"CIELAB {words} (ISO/CIE 11664-4)", "1", LOOK, read)


def make_tristimulus_row(place: int) -> Quantity:
    """X, Y or Z, where Y of the perfect white is 100."""
    words = f"tristimulus value {'XYZ'[place]} (ISO/CIE 11664-3), Y of the perfect white is 100"
    return Quantity(words, "1", LOOK, lambda light, white: 100.0 * light[:, place], bounds=(0.0, np.inf))


QUANTITIES: dict[str, Quantity] = {
    **make_rows("f", False),
    **make_rows("t", True),
    "diffuse_reflectance": make_share_row(
        "directional-hemispherical reflectance of scattered light", lambda seen: seen.reflected
    ),
    "total_reflectance": make_share_row(
        "directional-hemispherical reflectance, with what smooth surfaces mirror",
        lambda seen: seen.reflected + seen.mirrored,
    ),
    "specular_reflectance": make_share_row("share that is mirrored as a beam", lambda seen: seen.mirrored),
    "diffuse_transmittance": make_share_row(
        "directional-hemispherical transmittance of scattered light", lambda seen: seen.transmitted, True
    ),
    "total_transmittance": make_share_row(
        "directional-hemispherical transmittance, with the beam that gets through",
        lambda seen: seen.transmitted + seen.passed,
        True,
    ),
    "direct_transmittance": make_share_row("share that gets through as a beam", lambda seen: seen.passed, True),
    "reflectance": Quantity(
        "reflectance factor that an instrument reads in a geometry of CIE 15, such as 8:di of a sphere",
        "1", INSTRUMENT, lambda seen: seen, bounds=(0.0, np.inf),
    ),
    "X": make_tristimulus_row(0),
    "Y": make_tristimulus_row(1),
    "Z": make_tristimulus_row(2),
    "L": make_colour_row("lightness L*", (0.0, 116.0, 0.0), -16.0),
    "a": make_colour_row("a*, from green to red", (500.0, -500.0, 0.0)),
    "b": make_colour_row("b*, from blue to yellow", (0.0, 200.0, -200.0)),
}  # fmt: skip


def find_tristimulus(wavelengths_um: Array, reflectance: Array, illuminant: str, observer: int) -> tuple[Array, Array]:
    """X, Y, Z of a spectrum's jets (1 + n, wavelengths), Y of the perfect white being 1, as jets (1 + n, 3); and those
    of the white (3,). Raises SceneError where the wavelengths do not cover the visible."""
    weights = weigh_wavelengths(wavelengths_um, illuminant, observer)
    return reflectance @ weights.T, find_white(illuminant, observer)
