"""How sure colour, hiding and gloss of a paint are: what they change by with what is known of it only roughly."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.hiding import Conditions
from vrte.appearance.panel import ACCURACY, Panel, make_panel
from vrte.appearance.quantities import read_panels
from vrte.basics.arrays import Array, make_readonly
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.formats.materials import expand_content
from vrte.formats.particle_sources import Compute, make_particles
from vrte.optics.crowding import EFFECTIVE_MEDIUM, PACKINGS, PackingWarning
from vrte.optics.particles import Particles
from vrte.optics.refractive_index import refractive_index
from vrte.optics.size_distribution import SizeDistribution
from vrte.scene.boundary import Lambertian

SIZE, INDEX = 0.1, 0.01  # parts by which sizes of grains and their refractive indices are known
FINER = 0.1  # of the accuracy: what a solve is compared with
FACTORS = {  # of lengths and of indices
    "size": ((1.0 - SIZE, 1.0), (1.0 + SIZE, 1.0)),
    "index": ((1.0, 1.0 - INDEX), (1.0, 1.0 + INDEX)),
}
LENGTHS = "radius_um", "shell_um", "core_radius_um"
SUBSTANCES = "index", "core", "shell"
SOURCES = {
    "crowding": "by other models of close grains that allow such ones, or else by the effective medium",
    "size": f"by grains {SIZE:.0%} smaller and larger",
    "index": f"by refractive indices of grains {INDEX:.0%} lower and higher",
    "accuracy": "by a solve ten times as accurate",
}


@dataclass(frozen=True, eq=False)
class Spread:
    """How far readings, ``quantities`` by their names in sweeps, (n,), may be off: the largest change by each source,
    (sources, n), either way, and ``notes`` on what was not varied. Colours are those over the black card."""

    quantities: tuple[str, ...]
    parts: Mapping[str, Array]
    notes: tuple[str, ...]

    @property
    def total(self) -> Array:
        """The root of the sum of squares of all parts, (n,)."""
        return np.sqrt(np.sum(np.square([*self.parts.values()]), axis=0))

    def describe(self, name: str) -> str:
        """The spread of a quantity and its parts in words."""
        index = self.quantities.index(name)
        parts = ", ".join(f"{source} {values[index]:.2g}" for source, values in self.parts.items())
        return f"± {self.total[index]:.2g} ({parts})"


@dataclass(frozen=True)
class Scaled:
    """A size distribution with all radii so many ``times`` as large."""

    distribution: SizeDistribution
    times: float

    def quadrature(self, count: int, moment: int = 6) -> tuple[Array, Array]:
        """Radii [um] and weights (count,), as of the distribution."""
        radii, weights = self.distribution.quadrature(count, moment)
        return self.times * radii, weights


def compute_varied(source: str, given: dict[str, Any], larger: float = 1.0, denser: float = 1.0) -> Particles:
    """Particles as `make_particles` makes them, with lengths and refractive indices (not k) so many times as large."""
    found = dict(given)
    for key in LENGTHS:
        if found.get(key) is not None:
            found[key] = larger * found[key]
    if found.get("size") is not None:
        found["size"] = Scaled(found["size"], larger)
    for key in SUBSTANCES:
        if denser != 1.0 and key in found:
            index = complex(refractive_index(found[key], found["wavelength_um"]).value)
            found[key] = complex(denser * index.real, index.imag)
    return make_particles(source, found)


def find_spread(
    content: Mapping[str, Any],
    panel: Panel,
    names: Sequence[str],
    conditions: Conditions,
    folder: Path = Path(),
    progress: Progress | None = None,
) -> Spread:
    """The spread of quantities, names of `vrte.appearance.quantities`, of the ``panel`` that a scene file's content
    makes; colours are read over the black card. Raises SceneError, AccuracyError."""
    expanded = expand_content(content, folder)
    asked = dict(panel.asked)

    def make(varied: Mapping[str, Any], compute: Compute = make_particles) -> Panel:
        return make_panel(varied, panel.wavelength_um, folder, None, panel.layer, compute, **asked)

    notes = ["The spread leaves loads, thickness, binder and surface as they are."]
    places = panel.scenes[0].places
    place = places[panel.film]
    assert place is not None
    groups: dict[str, list[Panel]] = {"crowding": make_packed(expanded, place, make, notes)}
    if "particles" in expanded:
        for source, factors in FACTORS.items():
            computes = [partial(compute_varied, larger=larger, denser=denser) for larger, denser in factors]
            groups[source] = [make(expanded, compute) for compute in computes]
    if panel.scenes[0].has_flakes:
        notes.append("The spread leaves flakes as they are.")
    panels = [panel, *(one for group in groups.values() for one in group)]
    black = Lambertian(conditions.black)
    rows = read_panels([one.put_over(black) for one in panels], names, conditions)
    if progress is not None:
        progress(1, 2)
    finer = {**asked, "accuracy": FINER * asked.get("accuracy", ACCURACY)}
    finer = {name: value for name, value in finer.items() if name != "nodes"}
    rows += read_panels([replace(panel, asked=finer).put_over(black)], names, conditions)
    read = np.array([[row[name] for name in names] for row in rows], float)
    if progress is not None:
        progress(2, 2)
    changes = iter(np.abs(read[1:] - read[0]))
    parts = {
        source: np.max([next(changes) for _ in group], axis=0)
        for source, group in {**groups, "accuracy": [panel]}.items()
        if group
    }
    return Spread(tuple(names), {source: make_readonly(values) for source, values in parts.items()}, tuple(notes))


def make_packed(content: Mapping[str, Any], place: int, make: Callable[..., Panel], notes: list[str]) -> list[Panel]:
    """The panels of a film under all other models of crowding that warn of nothing in it; where there is none, under
    the effective medium, which a note tells."""
    layer, found, beyond = content["layer"][place], [], []  # type: Any, list[Any], list[Any]
    for packing in PACKINGS if "packing" in layer else ():
        if packing == layer["packing"]:
            continue
        layers = [{**one, "packing": packing} if index == place else one for index, one in enumerate(content["layer"])]
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                panel = make({**content, "layer": layers})
            except SceneError:  # denser than the model takes
                continue
        is_beyond = any(issubclass(one.category, PackingWarning) for one in warned)
        (beyond if is_beyond else found).append((packing, panel))
    if not found and (beyond := [pair for pair in beyond if pair[0] == EFFECTIVE_MEDIUM]):
        words = "takes the effective medium for crowding, which is not meant for such grains: no other model is"
        notes.append(f"The spread {words}.")
    return [panel for _, panel in found or beyond]
