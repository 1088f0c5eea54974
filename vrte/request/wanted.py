"""Which depths and directions of a solution become which arrays of the result."""

from collections.abc import Sequence
from dataclasses import dataclass

from vrte.basics.arrays import Array, IntArray


@dataclass(frozen=True, eq=False)
class Wanted:
    """What becomes of a solution.

    parts: one array of the result each, indices of its depths (n_level,) and directions (n_mu,); place (n_col,): where
    a column goes in the result's last axis, shared ones add up; scale (n_in,): factor of each incident direction.
    """

    parts: Sequence[tuple[IntArray, IntArray]]
    place: IntArray
    scale: Array

    def doubles(self, n_phi: int) -> float:
        """How many doubles the result takes."""
        pairs = sum(float(levels.size) * directions.size for levels, directions in self.parts)
        return 4.0 * (int(self.place.max()) + 1) * self.scale.size * n_phi * pairs
