"""What a film is made of, by volume and by weight, dry and wet, and what it costs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from vrte.basics.errors import SceneError
from vrte.formats.materials import expand_content
from vrte.formats.toml_table import read_fraction, suggest_nearest

# kg/l, typical values; docs/how_to/appearance.md has which were looked up
DENSITIES = {
    "rutile": 4.23, "anatase": 3.9, "hematite": 5.25, "zinc oxide": 5.6, "calcite": 2.71, "chalk": 2.71,
    "alumina": 3.97, "silica": 2.2, "carbon": 1.8, "gold": 19.3, "aluminium": 2.7, "mica": 2.8, "water": 1.0,
    "alkyd": 1.05, "acrylic": 1.18, "epoxy": 1.2, "polystyrene": 1.05,
}  # fmt: skip
VOLATILE = "volatile"  # water or solvent, which leaves the wet film
BINDER = "binder"


class Ingredient(NamedTuple):
    """A part of a film: its density [kg/l], None where it is not known; its parts of the volume and of the weight of
    the dry film and of the wet one, None where they are not known."""

    name: str
    density: float | None
    volume: float
    weight: float | None
    wet_volume: float | None
    wet_weight: float | None


@dataclass(frozen=True)
class Film:
    """Volume fractions of pigments by name, the binder by its name, and the thickness [um] of a dry film."""

    pigments: Mapping[str, float]
    binder: str
    thickness_um: float

    @property
    def parts(self) -> dict[str, float]:
        """Volume fractions of all that the dry film holds."""
        return {**self.pigments, self.binder: 1.0 - math.fsum(self.pigments.values())}

    @property
    def litres(self) -> float:
        """Litres of dry film: on 1 m2, or where it has no end 1."""
        return 1e-3 * self.thickness_um if math.isfinite(self.thickness_um) else 1.0


def read_film(content: Mapping[str, Any], place: int, folder: Path) -> Film:
    """The film in the layer at a place, from 0, of a scene file's content. Raises SceneError."""
    expanded = expand_content(content, folder)
    layer = expanded["layer"][place]
    fractions = layer.get("volume_fractions")
    if fractions is None and "volume_fraction" in layer:
        kinds = layer.get("particles", "flakes")
        fractions = {kinds: layer["volume_fraction"]} if isinstance(kinds, str) else None
    thickness = layer.get("thickness_um")
    if not isinstance(fractions, Mapping) or thickness is None:
        words = "must say volume fractions and thickness_um, of which a recipe is made"
        raise SceneError(f"layer[{place + 1}] {words}", "layer", place)
    host = layer.get("host_index", expanded.get("host_index", 1.0))
    pigments = {name: float(read_fraction(one) or 0.0) for name, one in fractions.items()}
    return Film(pigments, host if isinstance(host, str) else BINDER, float(thickness))


def find_densities(film: Film, given: Mapping[str, float] | None) -> dict[str, float]:
    """Densities [kg/l] by ingredient, those ``given`` first. Raises SceneError for names that the film does not have,
    and for what is no density."""
    known = {name: DENSITIES[name.rpartition(": ")[2]] for name in film.parts if name.rpartition(": ")[2] in DENSITIES}
    for name, density in (given or {}).items():
        check_ingredient("densities", name, [*film.parts, VOLATILE])
        if not 0.0 < density < math.inf:
            raise SceneError.of("densities", f"of {name} must be above 0 kg/l, not {density:g}")
        known[name] = float(density)
    return known


def check_ingredient(argument: str, name: str, known: Sequence[str]) -> None:
    """Raises SceneError for a name that is no ingredient."""
    if name not in known:
        words = f"names {name!r}, and the film is made of {', '.join(known)}"
        raise SceneError.of(argument, words + suggest_nearest(name, known))


@dataclass(frozen=True)
class Prices:
    """Prices of a kg by ingredient, where there are some, and the densities [kg/l] of all that have one. Without prices
    the volume of pigments is what is paid."""

    per_kg: Mapping[str, float] | None
    densities: Mapping[str, float]

    def check(self, film: Film) -> None:
        """Whether all that has a price is in the film and has a density. Raises SceneError."""
        for name, price in (self.per_kg or {}).items():
            check_ingredient("cost", name, [*film.parts])
            if not 0.0 <= price < math.inf:
                raise SceneError.of("cost", f"of {name} must be a price of a kg, at least 0, not {price:g}")
            if name not in self.densities:
                raise SceneError.of("cost", f"of {name} needs its density: densities={{{name!r}: ...}} [kg/l]")

    def find(self, film: Film) -> float:
        """What a square metre of film costs, or a litre of a semi-infinite one: money, or cm3 of pigment."""
        if self.per_kg is None:
            return 1e3 * film.litres * math.fsum(film.pigments.values())
        parts = film.parts
        return film.litres * math.fsum(parts[one] * self.densities[one] * each for one, each in self.per_kg.items())

    def describe(self, film: Film) -> str:
        """What the cost is counted in, in words."""
        what = "cm³ of pigment" if self.per_kg is None else "money"
        return f"{what} a {'m²' if math.isfinite(film.thickness_um) else 'litre of dry film'}"


def list_ingredients(film: Film, densities: Mapping[str, float], volume_solids: float | None) -> tuple[Ingredient, ...]:
    """The recipe of a film; ``volume_solids``: the part of the wet film's volume that stays. Weights are known where
    the densities of all are."""
    wet = {} if volume_solids is None else {name: part * volume_solids for name, part in film.parts.items()}
    if volume_solids is not None and volume_solids < 1.0:
        wet[VOLATILE] = 1.0 - volume_solids

    def weigh(parts: Mapping[str, float]) -> dict[str, float]:
        if not parts or not {*parts} <= {*densities}:
            return {}
        whole = math.fsum(part * densities[name] for name, part in parts.items())
        return {name: part * densities[name] / whole for name, part in parts.items()}

    weights, wet_weights = weigh(film.parts), weigh(wet)
    return tuple(
        Ingredient(
            name,
            densities.get(name),
            film.parts.get(name, 0.0),
            weights.get(name, 0.0 if weights and name == VOLATILE else None),
            wet.get(name),
            wet_weights.get(name),
        )
        for name in dict.fromkeys((*film.parts, *wet))
    )
