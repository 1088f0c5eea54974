"""What a paint has to meet, a colour, a contrast ratio and glosses with their tolerances, and how far it misses them.

Hiding is read as log(-log(1 - C)) of the contrast ratio C, which is nearly straight over the logarithm of the
thickness; gloss by its logarithm.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vrte.appearance.colours import import_colour_science
from vrte.appearance.hiding import Conditions, stretch_contrast
from vrte.basics.arrays import Array, check_number, show_value
from vrte.basics.errors import SceneError

HIDING_SCALE = 0.02  # of log(-log(1 - C)): misses count in tolerances, that of hiding is 2 % of the thickness
MET = 2e-3  # tolerances by which a target that is met may be missed
DARKEST_GLOSS = 1e-3  # [gloss units]: less has no logarithm to speak of
SIDES = {"L": ("dark", "light"), "a": ("green", "red"), "b": ("blue", "yellow")}
CARDS = {"black": Conditions.black, "white": Conditions.white}
OWN_BASE = "base"
GLOSSES = "gloss_20", "gloss_60", "gloss_85"


def bend_reading(name: str, value: float) -> float:
    """A reading by the name of its quantity, as it is nearly linear in the free numbers."""
    if name == "contrast_ratio":
        return float(stretch_contrast(value))
    return math.log(max(value, DARKEST_GLOSS)) if name in GLOSSES else value


@dataclass(frozen=True)
class Target:
    """What is wanted: quantities by name, L, a, b, contrast_ratio and gloss_60; the colour difference CIEDE2000 and the
    gloss units that are allowed. Contrast ratios may be larger."""

    wanted: Mapping[str, float]
    tolerance: float
    gloss_tolerance: float

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities, in the order of all arrays (rows,)."""
        return tuple(self.wanted)

    def bend(self, readings: Iterable[float]) -> Array:
        """Readings (rows,) as they are nearly linear in the free numbers."""
        return np.array([bend_reading(name, float(one)) for name, one in zip(self.names, readings, strict=True)])

    @cached_property
    def goal(self) -> Array:
        """What is wanted (rows,), bent like readings."""
        return self.bend(self.wanted.values())

    def find_difference(self, bent: Array) -> float:
        """CIEDE2000 from the colour; 0 where none is wanted."""
        if "L" not in self.wanted:
            return 0.0
        return float(import_colour_science().delta_E(self.goal[:3], bent[:3], method="CIE 2000"))

    def find_misses(self, bent: Array) -> dict[str, float]:
        """By how many tolerances each of colour, hiding and gloss is missed; below 0 where it is met."""
        found = {"colour": self.find_difference(bent) / self.tolerance - 1.0} if "L" in self.wanted else {}
        for name, value, goal in zip(self.names, bent.tolist(), self.goal.tolist(), strict=True):
            if name == "contrast_ratio":
                found[name] = (goal - value) / HIDING_SCALE
            elif name in GLOSSES:
                found[name] = abs(math.exp(value) - math.exp(goal)) / self.gloss_tolerance - 1.0
        return found

    def find_missed(self, bent: Array) -> float:
        """The root of the sum of squares of what is missed, in tolerances."""
        return math.hypot(*(max(one, 0.0) for one in self.find_misses(bent).values()))

    def describe_misses(self, bent: Array) -> list[str]:
        """What is missed, in words."""
        found = []
        for name in [name for name, miss in self.find_misses(bent).items() if miss > MET]:
            if name == "colour":
                off = bent[:3] - self.goal[:3]
                most = int(np.abs(off).argmax())
                side = f"{'Lab'[most]}* is {abs(off[most]):.2g} too {SIDES['Lab'[most]][int(off[most] > 0.0)]}"
                found.append(f"the colour is {self.find_difference(bent):.2g} CIEDE2000 off: {side}")
            else:
                row = self.names.index(name)
                found.append(f"{name} is too {'low' if bent[row] < self.goal[row] else 'high'}")
        return found


def make_target(
    lab: Sequence[float] | None,
    contrast_ratio: float | None,
    glosses: Sequence[float | None],
    tolerance: float,
    gloss_tolerance: float,
) -> Target:
    """What is wanted. Raises SceneError for nothing, and for what no paint has."""
    wanted: dict[str, float] = {}
    if lab is not None:
        if len(lab) != 3 or not all(isinstance(one, int | float) and math.isfinite(one) for one in lab):
            raise SceneError.of("lab", f"must be L*, a*, b*, three finite numbers, not {show_value(lab)}")
        check_number("lab", lab[0], 0.0, 120.0, "with L* from 0 to 120")
        wanted = dict(zip("Lab", map(float, lab), strict=True))
    if contrast_ratio is not None:
        allowed = "above 0 and below 1"
        wanted["contrast_ratio"] = check_number("contrast_ratio", contrast_ratio, 1e-6, 1.0 - 1e-6, allowed)
    for name, one in zip(GLOSSES, glosses, strict=True):
        if one is not None:
            wanted[name] = check_number(name, one, DARKEST_GLOSS, 2000.0, "gloss units, from 0.001 to 2000")
    if not wanted:
        raise SceneError("match needs a target: lab, contrast_ratio, gloss_20, gloss_60 or gloss_85")
    check_number("tolerance", tolerance, 1e-3, 100.0, "CIEDE2000 from 0.001 to 100")
    check_number("gloss_tolerance", gloss_tolerance, 1e-2, 1000.0, "gloss units from 0.01 to 1000")
    return Target(wanted, float(tolerance), float(gloss_tolerance))


def read_over(over: str | float | None, content: Mapping[str, Any]) -> float | None:
    """The albedo that a colour is read over, None for the own base. Raises SceneError."""
    paint = content.get("paint")
    has_base = "base" in content or (isinstance(paint, Mapping) and "substrate" in paint)
    if over == OWN_BASE and not has_base:
        words = "and the paint has none: over='black', 'white' or an albedo says what the colour is read over"
        raise SceneError.of("over", f"is 'base', {words}")
    if over is None or over == OWN_BASE:
        return None
    if isinstance(over, str):
        if over not in CARDS:
            raise SceneError.of("over", f"must be 'base', 'black', 'white' or an albedo, not {show_value(over)}")
        return CARDS[over]
    return check_number("over", over, 0.0, 1.0, "an albedo from 0 to 1")
