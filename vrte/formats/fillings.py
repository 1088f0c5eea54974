"""What the layers of a scene file are made of, as numbers that change with a number of the file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.formats.keys import Reading
from vrte.formats.layers import LAYER_KEYS, FillingKeys, read_filling, read_layer
from vrte.formats.materials import expand_materials
from vrte.formats.particle_sources import check_particles, describe_value
from vrte.formats.toml_table import Table
from vrte.optics.crowding import INDEPENDENT
from vrte.optics.particles import Particles
from vrte.optics.spheres import Ball
from vrte.optics.vary_spheres import ParticleSlopes, SphereNumbers
from vrte.scene.layer import is_fraction_needed
from vrte.scene.vary_layer import Filling, vary_layer

Settled = list[tuple[int, int]]
ONE_SIZE = (1, 6)
UNCHANGED = ParticleSlopes(0.0, 0.0, 0.0, np.zeros((0, 6)))


@dataclass(eq=False)
class Recorder:
    """Stands in for what computes particles: keeps what each kind is made of, in the order in which they are made."""

    said: list[str] = field(default_factory=list)
    particles: list[Particles] = field(default_factory=list)

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        found = check_particles(source, given)
        self.said.append(repr((source, sorted((name, describe_value(value)) for name, value in given.items()))))
        self.particles.append(found)
        return found

    def find_numbers(self, kind: int, settled: Settled) -> SphereNumbers | None:
        """What a kind of particle depends on, averaged over so many radii; None where no derivatives are known."""
        balls = self.particles[kind].balls
        if len(balls) != 1 or not isinstance(balls[0][0], Ball):
            return None
        return SphereNumbers.of(balls[0][0], *(settled[0] if settled else ONE_SIZE))


class FilledLayer(NamedTuple):
    """A layer of particles: its place in the file, its keys, and its kinds of particles by number."""

    place: int
    keys: FillingKeys
    kinds: tuple[int, ...]

    @property
    def is_length(self) -> bool:
        """Whether it says how thick it is in micrometres."""
        return "thickness_um" in self.keys.how

    @property
    def amounts(self) -> Array:
        """Shares of its kinds, the part of its volume that they fill (0 where it does not matter), how thick it is."""
        shares = [*self.keys.shares.values()]
        fraction = sum(shares) if self.keys.by_volume else self.keys.how.get("volume_fraction", 0.0)
        extent = self.keys.how["thickness_um" if self.is_length else "thickness"]
        return np.array([*shares, fraction, extent])


def list_filled_layers(content: Mapping[str, Any], folder: Path) -> list[FilledLayer]:
    """The layers of particles of a scene file that is right; kinds are numbered as `make_scene_file` makes them."""
    content = expand_materials(content, folder)
    numbers: dict[tuple[str, str], int] = {}
    found = []
    for place, layer in enumerate(content.get("layer", ())):
        if "particles" in layer or "volume_fractions" in layer:
            table = Table(("layer", place), layer, LAYER_KEYS)
            keys = read_filling(*read_layer(table, Reading(Table((), content, tuple(content)), folder)))
            host = repr(layer.get("host_index"))
            kinds = tuple(numbers.setdefault((name, host), len(numbers)) for name in keys.shares)
            found.append(FilledLayer(place, keys, kinds))
    return found


def vary_filled_layer(
    layer: FilledLayer,
    amounts: Array,
    absorption: float,
    particles: list[Particles],
    slopes: Mapping[int, ParticleSlopes],
) -> tuple[float, float, Array]:
    """Derivatives of optical thickness, albedo and coefficients: by what its ``amounts`` and its host's ``absorption``
    change by, and by the ``slopes`` of those of its kinds that change."""
    kinds = [particles[kind] for kind in layer.kinds]
    changes = [slopes.get(kind, UNCHANGED) for kind in layer.kinds]
    terms = max(kind.phase_matrix.terms for kind in kinds)
    # the part of the volume counts, and how thick it is where that has an end
    counts = layer.is_length or is_fraction_needed(kinds[0], INDEPENDENT), math.isfinite(layer.amounts[-1])

    def fill(parts: Sequence[Any], tables: Sequence[Array], given: Array, absorbed: float) -> Filling:
        fraction, extent = (part if here else np.zeros(()) for part, here in zip(given[-2:], counts, strict=True))
        return Filling(
            shares=given[:-2],
            extinction=np.array([part.extinction_um2 for part in parts]),
            scattering=np.array([part.scattering_um2 for part in parts]),
            volume=np.array([part.volume_um3 for part in parts]),
            coefficients=np.array([np.pad(table, ((0, terms - len(table)), (0, 0))) for table in tables]),
            absorption=np.array(absorbed),
            fraction=fraction,
            extent=extent,
        )

    return vary_layer(
        fill(kinds, [kind.phase_matrix.coefficients for kind in kinds], layer.amounts, kinds[0].host_absorption),
        fill(changes, [change.coefficients for change in changes], amounts, absorption),
        layer.keys.by_volume,
        layer.is_length,
    )
