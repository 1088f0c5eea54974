"""How other codes and databases write a scattering matrix over angle: a row each, by name.

vrte's own elements are F11, F12, F22, F33, F34, F44 in the signs of docs/reference/conventions.md, the mean of F11
over the sphere 1. A row says what the columns of a table mean, where that is known from, and how F11 is scaled. Where
a row's source was not read it says so: docs/how_to/importing.md has a sphere by which to recognise a code's convention.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError

ELEMENTS = ("F11", "F12", "F22", "F33", "F34", "F44")
SCALES = {  # the scale of F11 in words; the mean of F11 over the sphere where that fixes it
    "mean": ("the mean of F11 over all directions is 1", 1.0),
    "solid-angle": ("the integral of F11 over the solid angle is 1", 0.25 / np.pi),
    "amplitudes": ("F11 is (S1 S1* + S2 S2*)/2 of dimensionless amplitudes", None),
    "forward": ("F11 is 1 at 0 degrees", None),
    "30-degrees": ("F11 is 1 at 30 degrees", None),
    "cross-section": ("F11 is the differential scattering cross section [um2/sr]", None),
}


@dataclass(frozen=True)
class Convention:
    """One way of writing a scattering matrix: ``words``, ``source``, ``columns`` in the order of ELEMENTS (Pll and Prr
    along and across the scattering plane, Plr between), ``scale`` by name, ``circular``: the sign of F34."""

    words: str
    source: str
    scale: str = "mean"
    columns: tuple[str, ...] = ELEMENTS
    circular: int = 1

    @property
    def mean(self) -> float | None:
        """The mean of F11 over the sphere; None where the convention leaves it open."""
        return SCALES[self.scale][1]

    @property
    def in_words(self) -> str:
        """Its columns, scale and signs."""
        columns = [f"-{name}" if name.startswith("F34") and self.circular < 0 else name for name in self.columns]
        return f"{', '.join(columns)}; {SCALES[self.scale][0]}"

    def read(self, columns: Array) -> Array:
        """vrte's six elements, but for the scale, from what six columns (6, angles) hold."""
        found = columns.copy()
        if self.columns[0] == "Pll":
            along, exchanged, across = columns[:3]
            both, twice = along + across, 2.0 * exchanged
            found[:3] = 0.5 * np.stack([both + twice, along - across, both - twice])
        for index, name in enumerate(self.columns):
            found[index] *= -1.0 if name.startswith("-") else 1.0
            found[index] *= found[0] if name.endswith("/F11") else 1.0
        found[4] *= self.circular
        return found

    def write(self, elements: Array) -> Array:
        """What the six columns hold, from vrte's six elements (6, angles) in the convention's scale."""
        found = elements.copy()
        found[4] *= self.circular
        for index, name in enumerate(self.columns):
            found[index] *= -1.0 if name.startswith("-") else 1.0
            found[index] /= elements[0] if name.endswith("/F11") else 1.0
        if self.columns[0] == "Pll":
            f11, f12, f22 = elements[:3]
            found[:3] = 0.5 * np.stack([f11 + f22 + 2.0 * f12, f11 - f22, f11 + f22 - 2.0 * f12])
        return found

    def fill_in_spheres(self, columns: Sequence[Array | None]) -> list[Array | None]:
        """The columns with what spheres leave out: F22 = F11 and F44 = F33, or Plr = 0 and F44 = F33."""
        f11, f12, f22, f33, f34, f44 = columns
        if self.columns[0] == "Pll" and f12 is None and f11 is not None:
            f12 = np.zeros_like(f11)
        elif f22 is None and f11 is not None:
            f22 = np.ones_like(f11) if self.columns[2].endswith("/F11") else f11
        return [f11, f12, f22, f33, f34, f33 if f44 is None else f44]


CONVENTIONS = {
    name: Convention(**row | {"columns": tuple(row.get("columns", ELEMENTS))})
    for name, row in tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8")).items()
}


def find_convention(name: object) -> Convention:
    """The row of a name. Raises SceneError with all names."""
    if not isinstance(name, str) or name not in CONVENTIONS:
        raise SceneError.of("convention", f"must be one of {', '.join(CONVENTIONS)}, not {show_value(name)}")
    return CONVENTIONS[name]
