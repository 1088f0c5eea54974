"""A sum of bases, each with a weight of either sign: a base on its way to another one."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.scene.boundary import Allowed, Boundary


@dataclass(frozen=True, eq=False)
class WeightedBase(Boundary):
    """What several boundaries reflect, weighted and added up; nobody asks whether that is physical."""

    parts: tuple[tuple[float, Boundary], ...]

    @property
    def orders_reflected(self) -> float:  # type: ignore[override]
        return max(part.orders_reflected for _, part in self.parts)

    @property
    def mixes_stokes(self) -> bool:  # type: ignore[override]
        return any(part.mixes_stokes for _, part in self.parts)

    @property
    def keeps_beams(self) -> bool:  # type: ignore[override]
        return any(part.keeps_beams for _, part in self.parts)

    @property
    def index_above(self) -> float | None:  # type: ignore[override]
        return next((part.index_above for _, part in self.parts if part.index_above is not None), None)

    @property
    def even_albedo(self) -> float:
        return float(sum(weight * part.even_albedo for weight, part in self.parts))

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        found = [weight * part.reflect(mu_i, mu_o, phi_deg) for weight, part in self.parts]
        shape = np.broadcast_shapes(*(one.shape[:-2] for one in found))
        seen = max(one.shape[-1] for one in found)
        total = np.zeros((*shape, seen, seen))
        for one in found:
            total[..., : one.shape[-1], : one.shape[-1]] += one
        return total

    def reflect_orders(
        self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed
    ) -> tuple[Array, int]:
        found = [part.reflect_orders(mu_i, mu_o, pairs, n_order, allowed) for _, part in self.parts]
        total = np.zeros((max(len(orders) for orders, _ in found), mu_i.size, mu_o.size, 4, 4))
        for (weight, _), (orders, _) in zip(self.parts, found, strict=True):
            total[: len(orders)] += weight * orders
        return total, max(azimuths for _, azimuths in found)

    def put_in_medium(self, index: float) -> "WeightedBase":
        return WeightedBase(tuple((weight, part.put_in_medium(index)) for weight, part in self.parts))

    def reflect_beam(self, index: float, mu: Array) -> Array:
        found: Array = sum((weight * part.reflect_beam(index, mu) for weight, part in self.parts), np.zeros((1, 4, 4)))
        return found
