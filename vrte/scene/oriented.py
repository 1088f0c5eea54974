"""Layers in which oriented flakes lie, alone or beside particles: what attenuates light depends on where it goes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.flakes import Flakes
from vrte.scene.layer import Layer

APART = 1e-5  # least difference of two rates over their mean: what is near degenerate is off by its square


@dataclass(frozen=True, eq=False)
class Oriented:
    """What a layer with flakes has per unit of depth: optical thickness of ``particles``, and ``area`` of flakes."""

    flakes: Flakes
    particles: float
    area: float

    @property
    def polarizes(self) -> bool:
        """Whether light gains polarization where it is attenuated: plates let through what they do not reflect."""
        return self.flakes.is_transparent

    def attenuate(self, mu: Array) -> Array:
        """k, extinction of unpolarized light per unit of depth along cosines mu, any shape."""
        return self.particles + self.area * self.flakes.extinguish(mu)[..., 0, 0]

    def extinguish(self, mu: Array) -> Array:
        """K, extinction matrix per unit of depth along cosines mu (...), (..., 4, 4), the same for light up and down in
        the flipped frame."""
        return self.particles * np.eye(4) + self.area * self.flakes.extinguish(mu)

    def find_rates(self, mu: Array) -> tuple[Array, Array]:
        """Rates (..., 4) and matrices P (..., 4, 4, 4), complex: e^(-K s) is the sum of e^(-rate s) P along cosines mu
        (...). K has two blocks, of (I, Q) and of (U, V), each m + D with D^2 = sigma^2, rates m -+ sigma."""
        K = self.extinguish(mu)
        rates, parts = np.zeros((*K.shape[:-1],), complex), np.zeros((*K.shape[:-1], 4, 4), complex)
        for first in (0, 2):
            own = slice(first, first + 2)
            block = K[..., own, own]
            mean = 0.5 * (block[..., 0, 0] + block[..., 1, 1])
            D = block - mean[..., None, None] * np.eye(2)
            square = D[..., 0, 0] ** 2 + D[..., 0, 1] * D[..., 1, 0] + 0j
            # what is nearly degenerate is taken a little apart: e^(-K s) changes by sigma^2 s^2
            sigma = np.where(np.abs(square) > (APART * mean) ** 2, np.sqrt(square), APART * mean)
            for k, sign in ((first, -1.0), (first + 1, 1.0)):
                rates[..., k] = mean + sign * sigma
                parts[..., k, own, own] = 0.5 * (np.eye(2) + sign * D / sigma[..., None, None])
        return rates, parts


def find_oriented(layer: Layer, thickness: float) -> Oriented | None:
    """The flakes of a layer whose particles have that optical thickness, which truncation may have lessened."""
    if layer.flakes is None or not layer.has_flakes:
        return None
    if np.isinf(layer.flake_area):
        return Oriented(layer.flakes, 0.0, 1.0)
    depth = thickness + layer.flake_area
    return Oriented(layer.flakes, thickness / depth, layer.flake_area / depth)


def polarizes_beams(oriented: Sequence[Oriented | None]) -> bool:
    """Whether plates polarize light on its way through any of the layers."""
    return any(one is not None and one.polarizes for one in oriented)


def find_slants(oriented: Sequence[Oriented | None], cosines: Array) -> Array:
    """mu/k of layers (layer,) along cosines (layer, n), path over depth; the cosine where no flakes lie."""
    found = cosines
    for k, one in enumerate(oriented):
        if one is not None:
            found = found.copy() if found is cosines else found
            found[k] = cosines[k] / one.attenuate(cosines[k])
    return found
