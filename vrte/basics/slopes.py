"""Slopes of functions that are only known by their values: differences at ever smaller steps, extrapolated to none."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError

Arrays = Sequence[Array]
LEVELS = 9  # times that a step is halved at most
SETTLED = 2e-13  # of an array's largest slope: from there on a smaller step brings rounding alone
SHRINKS = 4  # times that a step is quartered where neither side is allowed


@dataclass(eq=False)
class _Tableau:
    """Extrapolations of one array's slopes, and the best one found so far with what it may be off."""

    both_sides: bool
    row: list[Array]
    best: Array
    error: float = np.inf

    def add(self, slope: Array) -> None:
        """One more step, half of the last one: errors go with the square of the step, or with the step on one side."""
        row = [slope]
        for column, coarse in enumerate(self.row, 1):
            gain = (4.0 if self.both_sides else 2.0) ** column - 1.0
            row.append(row[-1] + (row[-1] - coarse) / gain)
            error = float(max(np.abs(row[-1] - row[-2]).max(initial=0.0), np.abs(row[-1] - coarse).max(initial=0.0)))
            if error < self.error:
                self.best, self.error = row[-1], error
        self.row = row

    @property
    def is_settled(self) -> bool:
        return self.error <= SETTLED * float(np.abs(self.best).max(initial=0.0))


def find_slopes(at: Callable[[float], Arrays], value: float, step: float, here: Arrays | None = None) -> list[Array]:
    """Slopes of several arrays over a number at its ``value``; ``at`` gives the arrays there, and ``here`` is what it
    gives at the value itself.

    Central differences, or one-sided ones where ``at`` raises a SceneError on the other side, at steps that are halved
    from ``step`` on until no array's slopes change any more; extrapolated to no step. Each array takes the step that
    fits it best. An array that is the same on both sides, infinity included, has the slope 0. Raises the SceneError of
    ``at`` where neither side is allowed. Source: C. J. F. Ridders, Adv. Eng. Softw. 4, 75 (1982).
    """
    step = 2.0 ** round(np.log2(step))
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
    both_sides = len(first) == 2
    if not both_sides:
        first[0] = at(value) if here is None else here
    upper, lower = max(first), min(first)
    tableaus: list[_Tableau] = []
    for level in range(LEVELS):
        size = step / 2.0**level
        up, down = first[upper], first[lower]
        if level:
            up = at(value + upper * size) if upper else up
            down = at(value + lower * size) if lower else down
        run = (value + upper * size) - (value + lower * size)
        slopes = [_divide(a, b, run) for a, b in zip(up, down, strict=True)]
        if not level:
            tableaus = [_Tableau(both_sides, [slope], slope) for slope in slopes]
            continue
        for tableau, slope in zip(tableaus, slopes, strict=True):
            tableau.add(slope)
        if all(tableau.is_settled for tableau in tableaus):
            break
    return [tableau.best for tableau in tableaus]


def _divide(up: Array, down: Array, run: float) -> Array:
    """The slope between two values, 0 where they are the same."""
    same = up == down
    return np.where(same, 0.0, np.where(same, 0.0, up) - np.where(same, 0.0, down)) / run
