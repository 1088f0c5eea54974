"""What can be measured and fitted, each quantity a row of QUANTITIES.

Light comes as jets, arrays (1 + n, ...) of values and then of their derivatives by n numbers, so that one function
gives both. Angles are from the normal, azimuths as `vrte.brdf` counts them: 0 is forward, 180 turns back.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from vrte.appearance.gloss import RECEPTORS
from vrte.basics.arrays import Array

DIRECTIONS = ("theta_i_deg", "theta_o_deg", "phi_deg")
BEAM = ("theta_i_deg",)
INSTRUMENT = ("geometry",)
LOOK = ("geometry", "illuminant", "observer")
GLOSS: tuple[str, ...] = ()  # its name says all
KNEE = (6.0 / 29.0) ** 3  # where CIELAB's cube root becomes a straight line (ISO/CIE 11664-4)


class BeamShares(NamedTuple):
    """Jets (1 + n, rows) of shares of an unpolarized beam: scattered back and on, mirrored and passed as a beam."""

    reflected: Array
    transmitted: Array
    mirrored: Array
    passed: Array


@dataclass(frozen=True)
class MeasuredQuantity:
    """A quantity in words, its unit, the columns that it needs, and the function that reads jets (1 + n, rows): of
    Mueller matrices (1 + n, rows, 4, 4) where it needs directions, of `BeamShares` for a beam, (1 + n,) of an
    instrument's factor or gloss, or of X, Y, Z (1 + n, 3) and the white's (3,); ``through``: of transmitted light;
    ``bounds``: what it can be."""

    words: str
    unit: str
    needs: tuple[str, ...]
    read: Callable[..., Array]
    through: bool = False
    bounds: tuple[float, float] = (-np.inf, np.inf)

    @property
    def is_over_visible(self) -> bool:
        """Whether all wavelengths of the visible are summed, so that it has none of its own."""
        return self.needs in (LOOK, GLOSS)


def divide_jets(one: Array, other: Array) -> Array:
    """The quotient, by the quotient rule; 0 over 0 is NaN."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = one[:1] / other[:1]
        return np.concatenate([share, (one[1:] - share * other[1:]) / other[:1]])


def find_length(one: Array, other: Array) -> Array:
    """The root of the sum of squares; where that is 0, it has no derivative, and 0 stands for it."""
    length = np.hypot(one[:1], other[:1])
    slope = np.divide(one[:1] * one[1:] + other[:1] * other[1:], length, out=np.zeros_like(one[1:]), where=length > 0.0)
    return np.concatenate([length, slope])


def read_ratio(matrices: Array, row: int, column: int) -> Array:
    """An element of Mueller matrices over the first one."""
    return divide_jets(matrices[..., row, column], matrices[..., 0, 0])


def make_matrix_rows(letter: str, through: bool) -> dict[str, MeasuredQuantity]:
    """The quantities of Mueller matrices of one face."""
    what, before, light = ("BTDF", "transmitted_", "transmitted") if through else ("BRDF", "", "reflected")
    factor = "transmittance_factor" if through else "reflectance_factor"
    unpolarized = "light, unpolarized where it came in"
    elements = {f"{row}{column}": (..., row, column) for row, column in np.ndindex(4, 4)}
    ratios = {name: {"row": index[1], "column": index[2]} for name, index in elements.items() if name != "00"}
    rows: dict[str, tuple[str, str, Callable[[Array], Array], float, float]] = {
        **{
            f"{letter}{name}": (
                f"element {name} of the Mueller {what}", "sr-1", itemgetter(index),
                -np.inf if name > "00" else 0.0, np.inf,
            )
            for name, index in elements.items()
        },
        **{
            f"normalized_{letter}{name}": (
                f"element {name} of the Mueller {what} over element 00", "1", partial(read_ratio, **index), -1.0, 1.0
            )
            for name, index in ratios.items()
        },
        factor: (
            f"{factor.replace('_', ' ')}: pi times element 00", "1", lambda seen: np.pi * seen[..., 0, 0], 0.0, np.inf,
        ),
        f"{before}degree_of_linear_polarization": (
            f"degree of linear polarization of {light} {unpolarized}", "1",
            lambda seen: divide_jets(find_length(seen[..., 1, 0], seen[..., 2, 0]), seen[..., 0, 0]), 0.0, 1.0,
        ),
        f"{before}minus_q_over_i": (
            f"-Q/I of {light} {unpolarized}: above 0 where the field is perpendicular to the plane of its "
            "direction and the normal", "1", lambda seen: -read_ratio(seen, 1, 0), -1.0, 1.0,
        ),
    }  # fmt: skip
    return {
        name: MeasuredQuantity(words, unit, DIRECTIONS, read, through, (low, high))
        for name, (words, unit, read, low, high) in rows.items()
    }


def add_shares(shares: BeamShares, parts: tuple[str, ...]) -> Array:
    """The sum (1 + n, rows) of the shares of these names."""
    return sum(getattr(shares, name) for name in parts)


def read_lightness(light: Array, white: Array, weights: tuple[float, float, float], at_black: float = 0.0) -> Array:
    """A coordinate of CIELAB (1 + n,): a weighted sum of the cube roots, or lines, of X, Y, Z over the white's."""
    share = light / white
    value = share[0]
    root = np.cbrt(np.maximum(value, KNEE))
    low = value <= KNEE
    made = np.where(low, 841.0 / 108.0 * value + 4.0 / 29.0, root)
    slope = np.where(low, 841.0 / 108.0, 1.0 / (3.0 * root**2))
    found: Array = np.concatenate([made[None], slope * share[1:]]) @ np.asarray(weights)
    found[0] += at_black
    return found


SHARES = {  # of an unpolarized beam: words, the parts that add up
    "diffuse_reflectance": ("directional-hemispherical reflectance of scattered light", ("reflected",)),
    "total_reflectance": (
        "directional-hemispherical reflectance, with what smooth surfaces mirror", ("reflected", "mirrored"),
    ),
    "specular_reflectance": ("share that is mirrored as a beam", ("mirrored",)),
    "diffuse_transmittance": ("directional-hemispherical transmittance of scattered light", ("transmitted",)),
    "total_transmittance": (
        "directional-hemispherical transmittance, with the beam that gets through", ("transmitted", "passed"),
    ),
    "direct_transmittance": ("share that gets through as a beam", ("passed",)),
}  # fmt: skip
LIGHTNESSES = {  # coordinates of CIELAB: words, weights of the roots of X, Y, Z, and what is added
    "L": ("lightness L*", (0.0, 116.0, 0.0), -16.0),
    "a": ("a*, from green to red", (500.0, -500.0, 0.0), 0.0),
    "b": ("b*, from blue to yellow", (0.0, 200.0, -200.0), 0.0),
}
QUANTITIES: dict[str, MeasuredQuantity] = {
    **make_matrix_rows("f", False),
    **make_matrix_rows("t", True),
    **{
        name: MeasuredQuantity(
            f"{words}, of an unpolarized beam", "1", BEAM, partial(add_shares, parts=parts), "transmittance" in name,
            (0.0, 1.0),
        )
        for name, (words, parts) in SHARES.items()
    },
    "reflectance": MeasuredQuantity(
        "reflectance factor that an instrument reads in a geometry of CIE 15, such as 8:di of a sphere",
        "1", INSTRUMENT, lambda seen: seen, bounds=(0.0, np.inf),
    ),
    **{
        name: MeasuredQuantity(
            f"tristimulus value {name} (ISO/CIE 11664-3), Y of the perfect white is 100", "1", LOOK,
            lambda light, white, place=place: 100.0 * light[:, place], bounds=(0.0, np.inf),
        )
        for place, name in enumerate("XYZ")
    },
    **{
        name: MeasuredQuantity(
            f"CIELAB {words} (ISO/CIE 11664-4)", "1", LOOK, partial(read_lightness, weights=weights, at_black=at_black)
        )
        for name, (words, weights, at_black) in LIGHTNESSES.items()
    },
    **{
        f"gloss_{angle:g}": MeasuredQuantity(
            f"specular gloss at {angle:g} degrees (ISO 2813)", "GU", GLOSS, lambda seen: 100.0 * seen,
            bounds=(0.0, np.inf),
        )
        for angle in RECEPTORS
    },
}  # fmt: skip
