"""Derivatives by five points: central where there is room on both sides, one-sided beside a bound."""

import math
from collections.abc import Callable
from typing import TypeVar

from vrte.basics.errors import SceneError

STEP = 2.0**-10  # of the scale on which something changes: rounding and its fourth power are then about as small
# weights over the step, all of fourth order: at both sides, above alone, below alone
STENCILS = (
    ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12)),
    ((0, -25 / 12), (1, 48 / 12), (2, -36 / 12), (3, 16 / 12), (4, -3 / 12)),
    ((0, 25 / 12), (-1, -48 / 12), (-2, 36 / 12), (-3, -16 / 12), (-4, 3 / 12)),
)
FARTHEST = 4  # steps away
Item = TypeVar("Item")


def sample_around(make: Callable[[float], Item], value: float, step: float) -> list[tuple[float, Item]]:
    """Weights and what ``make`` makes of numbers around ``value``: the weighted sum is the derivative, to the fourth
    order of the step, which is rounded to a power of 2. Raises the first SceneError where neither side has room."""
    step = 2.0 ** round(math.log2(step))  # so that points near a bound, such as 1, are met exactly
    refused: SceneError | None = None
    for stencil in STENCILS:
        try:
            return [(weight / step, make(value + place * step)) for place, weight in stencil]
        except SceneError as error:
            refused = refused or error
    assert refused is not None
    raise refused
