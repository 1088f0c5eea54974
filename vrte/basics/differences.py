"""Differences: divided ones of exp, derivatives by five or seven points, and slopes extrapolated to no step.

The core's divided differences are in core/complex.pxi, those of OpenCL in cl/complexes.cl.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError

SMALL = 1e-5  # |a - b| below which exp[a, b] is taken from its series
STEP = 2.0**-10  # of the scale on which something changes: rounding and its fourth power are then about as small
# weights over the step by places in steps: central, and for the side above alone, which is mirrored for the one below
FIVE_POINTS = (
    {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12},
    {0: -25 / 12, 1: 48 / 12, 2: -36 / 12, 3: 16 / 12, 4: -3 / 12},
)
SEVEN_POINTS = (
    {3: 1 / 60, 2: -3 / 20, 1: 3 / 4, -1: -3 / 4, -2: 3 / 20, -3: -1 / 60},
    {0: -49 / 20, 1: 6.0, 2: -15 / 2, 3: 20 / 3, 4: -15 / 4, 5: 6 / 5, 6: -1 / 6},
)
FARTHEST = 4  # steps that a point of FIVE_POINTS is away at most
Item = TypeVar("Item")
Arrays = Sequence[Array]
LEVELS = 9  # times that a step is halved at most
ROUNDING = 2e-13  # of an array's largest slope: from there on a smaller step brings rounding alone
SHRINKS = 4  # times that a step is quartered where neither side is allowed


def divide_exp_once(a: Any, b: Any) -> Any:
    """exp[a, b] = (e^a - e^b)/(a - b) for complex a, e^b where they meet, of any shapes; real parts <= 0."""
    difference = a - b
    small = np.abs(difference) < SMALL
    # the larger one in front: expm1 of what does not grow
    ahead = np.where(difference.real > 0.0, a, b)
    turned = np.where(difference.real > 0.0, -difference, difference)
    slope = np.where(small, 1.0 + turned / 2.0 + turned**2 / 6.0, np.expm1(turned) / np.where(small, 1.0, turned))
    return np.exp(ahead) * slope


def sample_around(
    make: Callable[[float], Item],
    value: float,
    step: float,
    stencils: tuple[Mapping[int, float], Mapping[int, float]] = FIVE_POINTS,
) -> list[tuple[float, Item]]:
    """Weights and items of ``make`` around ``value`` that add up to its derivative. Raises the first SceneError."""
    central, one_sided = stencils
    step = round_step(step) if stencils is FIVE_POINTS else step
    refused: SceneError | None = None
    for side, stencil in ((1.0, central), (1.0, one_sided), (-1.0, one_sided)):
        try:
            return [(side * weight / step, make(value + side * index * step)) for index, weight in stencil.items()]
        except SceneError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def round_step(step: float) -> float:
    """The nearest power of 2, so that points near a bound, such as 1, are met exactly."""
    return 2.0 ** round(math.log2(step))


@dataclass(eq=False)
class _Tableau:
    """Extrapolations of one array's slopes, and the best one found so far with what it may be off."""

    gain: float  # by which half a step lessens an error: 4 on both sides, 2 on one
    row: list[Array]
    best: Array
    error: float = np.inf

    def add(self, slope: Array, accuracy: float) -> bool:
        """One more step, half of the last one; whether the best slope has converged to an accuracy."""
        row = [slope]
        for column, coarse in enumerate(self.row, 1):
            row.append(row[-1] + (row[-1] - coarse) / (self.gain**column - 1.0))
            error = float(max(np.abs(row[-1] - row[-2]).max(initial=0.0), np.abs(row[-1] - coarse).max(initial=0.0)))
            if error < self.error:
                self.best, self.error = row[-1], error
        self.row = row
        return self.error <= accuracy * float(np.abs(self.best).max(initial=0.0))


def find_slopes(
    at: Callable[[float], Arrays],
    value: float,
    step: float,
    here: Arrays | None = None,
    accuracy: float = ROUNDING,
) -> list[Array]:
    """Slopes of arrays over a number at its ``value``, central or one-sided where ``at`` raises on one side, at steps
    halved down to an ``accuracy`` of the largest slope, extrapolated (Ridders, Adv. Eng. Softw. 4, 75 (1982)). Raises
    SceneError where no side is allowed."""
    step = round_step(step)
    first: dict[int, Arrays] = {}
    for _ in range(SHRINKS + 1):
        refused: SceneError | None = None
        for side in (1, -1):
            try:
                first[side] = at(value + side * step)
            except SceneError as error:
                refused = error
        if first:
            break
        step /= 4.0
    else:
        raise refused if refused is not None else AssertionError
    gain = 4.0 if len(first) == 2 else 2.0
    if len(first) == 1:
        first[0] = at(value) if here is None else here
    upper, lower = max(first), min(first)

    def divide(up: Arrays, down: Arrays, size: float) -> list[Array]:
        run, slopes = (value + upper * size) - (value + lower * size), []
        for a, b in zip(up, down, strict=True):
            same = a == b
            slopes.append(np.where(same, 0.0, np.where(same, 0.0, a) - np.where(same, 0.0, b)) / run)
        return slopes

    tableaus = [_Tableau(gain, [slope], slope) for slope in divide(first[upper], first[lower], step)]
    for level in range(1, LEVELS):
        size = step / 2.0**level
        up, down = (at(value + side * size) if side else first[0] for side in (upper, lower))
        if all([one.add(slope, accuracy) for one, slope in zip(tableaus, divide(up, down, size), strict=True)]):
            break
    return [tableau.best for tableau in tableaus]
