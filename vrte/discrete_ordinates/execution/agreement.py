"""What verification sees: blocks once more by another algorithm, and what the two differ by."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.engines.engine import Answer, Engine, Piece
from vrte.discrete_ordinates.execution.sums import Target
from vrte.results.result import NO_LIGHT


@dataclass(eq=False)
class Agreement:
    """by: the other algorithms; compared: how many orders both verify; gap (n_tau,): the largest difference of the
    radiance, added up over them; flux_gap (n_tau,): of the fluxes; None where nothing could be compared."""

    by: set[str] = field(default_factory=set)
    compared: int = 0
    gap: Array | None = None
    flux_gap: Array | None = None

    def compare(self, engine: Engine, piece: Piece, answer: Answer, run: Run) -> None:
        """Solves the orders of an answer, whose light is in memory of the host, by the other algorithm."""
        light = answer.light
        again = replace(piece, orders=light.orders, name=engine.others[piece.name])
        self.by.add(again.name)
        (other,) = engine.solve([again], run, lambda done: None) if light.orders.size else (answer,)
        both = np.isin(light.orders, other.light.orders)
        self.compared += int(both.sum())
        if not both.any():
            return
        twice = np.where(light.orders[both] == 0, 1.0, 2.0)
        difference = twice @ np.abs(other.light.kernels - light.kernels[both]).max(axis=(2, 3, 4, 5))
        self.gap = difference if self.gap is None else self.gap + difference
        if both[0] and light.orders[0] == 0 and piece.block.stokes[0] == 0:
            self.flux_gap = np.abs(other.flux - answer.flux).max(axis=(0, 2, 3))

    def statement(self, target: Target, parts: list[Array], flux: Array) -> dict[str, Any]:
        """The largest difference of the field and of the fluxes (2, n_tau, n_in, n_col), relative, depth by depth, to
        the largest there."""
        found: dict[str, Any] = {"with": " and ".join(sorted(self.by)), "orders_compared": self.compared}
        brightest = find_largest_intensity(target, parts, flux.shape[1])
        for name, difference, size in (
            ("radiance", self.gap, brightest),
            ("flux", self.flux_gap, np.abs(flux).max(axis=(0, 2, 3))),
        ):
            found[name] = None if difference is None else float((difference / np.maximum(size, NO_LIGHT)).max())
        return found


def find_largest_intensity(target: Target, parts: list[Array], n_tau: int) -> Array:
    """The largest intensity at each depth for a unit beam, (n_tau,); 0 where none was wanted."""
    size = np.zeros(n_tau)
    for values, (levels, _) in zip(parts, target.wanted.parts, strict=True):
        for i, scale in enumerate(target.wanted.scale):
            found = np.abs(values[:, i, :, :, 0]).max(axis=(1, 2, 3), initial=0.0) / scale
            size[levels] = np.maximum(size[levels], found)
    return size
