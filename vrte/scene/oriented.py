"""Layers in which oriented flakes lie, alone or beside particles: what attenuates light depends on where it goes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.flakes import Flakes
from vrte.scene.layer import Layer


@dataclass(frozen=True, eq=False)
class Oriented:
    """What a layer with flakes has per unit of depth: optical thickness of ``particles``, and ``area`` of flakes."""

    flakes: Flakes
    particles: float
    area: float

    def attenuate(self, mu: Array) -> Array:
        """k, extinction per unit of depth along cosines mu, any shape."""
        return self.particles + self.area * self.flakes.project(mu)


def find_oriented(layer: Layer, thickness: float) -> Oriented | None:
    """The flakes of a layer whose particles have that optical thickness, which truncation may have lessened."""
    if layer.flakes is None or not layer.has_flakes:
        return None
    if np.isinf(layer.flake_area):
        return Oriented(layer.flakes, 0.0, 1.0)
    depth = thickness + layer.flake_area
    return Oriented(layer.flakes, thickness / depth, layer.flake_area / depth)


def find_slants(oriented: Sequence[Oriented | None], cosines: Array) -> Array:
    """mu/k of layers (layer,) along cosines (layer, n), path over depth; the cosine where no flakes lie."""
    found = cosines
    for k, one in enumerate(oriented):
        if one is not None:
            found = found.copy() if found is cosines else found
            found[k] = cosines[k] / one.attenuate(cosines[k])
    return found
