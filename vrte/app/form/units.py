"""Units that are chosen beside the numbers of a paint: the form keeps one unit of each, and converts at its edge."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from vrte.app.form.content import Content
from vrte.app.form.fields import TYPED, get_value
from vrte.appearance.gloss import find_surface_gloss
from vrte.basics.errors import Place, SceneError
from vrte.fit.recipe import Film, find_densities, list_ingredients, read_film
from vrte.optics.refractive_index import refractive_index
from vrte.scene.interface import ROUGHNESS, Interface

DRY, WET, BY_VOLUME, BY_WEIGHT, MICRO, NANO, SLOPE, GLOSS = (
    "µm dry", "µm wet", "vol %", "wt %", "µm", "nm", "slope", "GU 60°",
)  # fmt: skip
UNITS = {  # of each kind of number; the first is what a page begins with
    "thickness": (DRY, WET),
    "load": (BY_VOLUME, BY_WEIGHT),
    "size": (MICRO, NANO),
    "roughness": (SLOPE, GLOSS),
}
DIGITS, SHOWN = 6, 4  # of what goes to the form, and of what a page shows
GLOSS_DEG, GREEN_UM = 60.0, 0.55
CLOSE = 1e-3  # to which the logarithm of a roughness is found


def find_kind(place: Place) -> str:
    """The kind of a number, of UNITS; "" where there is nothing to choose."""
    if place[-1] == "thickness_um":
        return "thickness"
    if place[-1] == "volume_fraction" or "volume_fractions" in place:
        return "load"
    if place[0] == "particles" and str(place[-1]).endswith("_um"):
        return "size"
    return "roughness" if place[-1] == "roughness" else ""


def list_units(content: Content, place: Place) -> tuple[str, ...]:
    """The units that a number may be shown in: weights are of films with a thickness and loads, gloss of what lies in
    air."""
    kind = find_kind(place)
    layer = get_value(content, place[:2])
    if kind == "load":
        held = layer.get("volume_fractions", layer.get("particles", "flakes"))
        whole = "thickness_um" in layer and ("volume_fractions" in layer or isinstance(held, str))
    else:
        whole = kind != "roughness" or (place[1] == 0 and layer["interface"].get("above") == 1.0)
    return UNITS.get(kind, ())[: None if whole else 1]


@dataclass(frozen=True)
class PaintUnits:
    """The units ``chosen`` by kind; volume ``solids``, the part of the wet film's volume that stays; ``densities``
    [kg/l] given by hand; ``below``, gloss units at 60 degrees that come from below the surface."""

    chosen: Mapping[str, str] = field(default_factory=lambda: {kind: names[0] for kind, names in UNITS.items()})
    solids: float | None = None
    densities: Mapping[str, float] = field(default_factory=dict)
    below: float = 0.0

    def get(self, content: Content, place: Place) -> str:
        """The unit of a number, "" where nothing is said of it."""
        names = list_units(content, place)
        return next((one for one in names if one == self.chosen[find_kind(place)]), names[0]) if names else ""

    def choose(self, place: Place, unit: str) -> "PaintUnits":
        """The same with another unit for all numbers of a kind."""
        return replace(self, chosen={**self.chosen, find_kind(place): unit})

    def write(self, content: Content, place: Place, value: float) -> tuple[str, str]:
        """A number's text in its unit, and what keeps it from being converted."""
        try:
            return f"{self.show(content, place, value):.{SHOWN}g}", ""
        except SceneError as error:
            return "", str(error)

    def convert_film(self, length_um: float) -> tuple[float, str]:
        """The thickness of a dry film [um] in the unit of thicknesses, dry without known solids, and that unit."""
        is_wet = self.chosen["thickness"] == WET and self.solids is not None
        return (length_um / self.find_solids(), WET) if is_wet else (length_um, DRY)

    def learn_gloss(self, content: Content, gloss: float) -> "PaintUnits":
        """The same with what a gloss [GU] at 60 degrees, read off this paint, says of the light from below."""
        place = ("layer", 0, "interface", "roughness")
        if self.get(content, place) != GLOSS:
            return self
        return replace(self, below=gloss - find_rough_gloss(content, place, get_value(content, place)))

    def show(self, content: Content, place: Place, value: float) -> float:
        """A number of the form in its unit. Raises SceneError where that needs more than is known."""
        unit = self.get(content, place)
        if unit == WET:
            return value / self.find_solids()
        if unit == BY_WEIGHT:
            film = read_film(content, int(place[1]), Path())
            return 100.0 * find_weight(film, self.find_densities(film), name_load(place, film))
        if unit == GLOSS:
            return find_rough_gloss(content, place, value) + self.below
        return value * {BY_VOLUME: 100.0, NANO: 1e3}.get(unit, 1.0)

    def read(self, content: Content, place: Place, text: str) -> float:
        """The number for the form, of a text in its unit, with a point or a comma. Raises SceneError."""
        unit = self.get(content, place)
        value = read_number(text, unit)
        if unit == WET:
            value *= self.find_solids()
        elif unit == BY_WEIGHT:
            film = read_film(content, int(place[1]), Path())
            value = find_volume(film, self.find_densities(film), name_load(place, film), value)
        elif unit == BY_VOLUME:
            value = check_per_cent(value, "the volume fraction")
        elif unit == GLOSS:
            value = find_roughness(partial(find_rough_gloss, content, place), value, self.below)
        elif unit == NANO:
            value /= 1e3
        return float(f"{value:.{DIGITS}g}")

    def find_solids(self) -> float:
        """Share of a wet film's volume that stays when it dries. Raises SceneError where it is not given."""
        if self.solids is None:
            raise SceneError("a wet film needs the volume solids: give them in per cent")
        return self.solids

    def list_given(self, film: Film) -> dict[str, float]:
        """The densities given by hand of what a film holds [kg/l]."""
        return {name: one for name, one in self.densities.items() if name in film.parts}

    def find_densities(self, film: Film) -> dict[str, float]:
        """Densities of all that a film holds [kg/l]. Raises SceneError where one is missing."""
        known = find_densities(film, self.list_given(film))
        for name in film.parts:
            if name not in known:
                raise SceneError(f"per cent by weight need the density of {name}: give it in kg/l")
        return known


def read_number(text: str, unit: str = "") -> float:
    """A number as it is typed, its unit behind it or not. Raises SceneError."""
    text = text.strip()
    found = TYPED.fullmatch(text.removesuffix(unit).strip() if unit else text)
    if found is None or (found[2] and found[2] != unit[-1:]):
        what = f"a number in {unit}" if unit else "a number"
        raise SceneError(f"give {what}, such as 12.5 or 12,5" + (f", not {text!r}" if text else ""))
    return float(found[1].replace(",", "."))


def check_per_cent(value: float, what: str) -> float:
    """Per cent as a fraction. Raises SceneError."""
    if not 0.0 <= value <= 100.0:
        raise SceneError(f"{what} must be from 0 to 100 %, not {value:g} %")
    return value / 100.0


def name_load(place: Place, film: Film) -> str:
    """The ingredient whose load stands at a place."""
    return str(place[-1]) if place[-1] in film.pigments else next(iter(film.pigments))


def find_weight(film: Film, densities: Mapping[str, float], name: str) -> float:
    """The part of the dry film's weight that an ingredient has."""
    found = {one.name: one.weight for one in list_ingredients(film, densities, None)}[name]
    assert found is not None  # all densities are known
    return found


def find_volume(film: Film, densities: Mapping[str, float], name: str, per_cent: float) -> float:
    """The volume fraction of a pigment that is so many per cent of the dry film's weight, in place of binder: the
    other pigments' volumes stay. Raises SceneError."""
    weight, own, binder = check_per_cent(per_cent, "the part of the weight"), densities[name], densities[film.binder]
    others = {one: part for one, part in film.pigments.items() if one != name}
    room = 1.0 - math.fsum(others.values())
    rest = math.fsum(part * densities[one] for one, part in others.items()) + room * binder
    volume = weight * rest / (own - weight * (own - binder))
    return volume


def find_rough_gloss(content: Content, place: Place, roughness: float) -> float:
    """Gloss [GU] at 60 degrees of the surface itself at a place, of another roughness."""
    table = get_value(content, place[:-1])
    facets = {key: table[key] for key in ("distribution", "shadowing") if key in table}
    given = table["below"]
    index = complex(*given) if isinstance(given, list) else given
    return compute_gloss(index, roughness, tuple(facets.items()))


@lru_cache(maxsize=1000)
def compute_gloss(index: Any, roughness: float, facets: tuple[tuple[str, Any], ...]) -> float:
    """The same over a medium: a substance or n + ik, of which n alone counts; without light that facets give back."""
    below = complex(refractive_index(index, GREEN_UM).value).real
    return find_surface_gloss(Interface(1.0, below, roughness=roughness, conserving=False, **dict(facets)), GLOSS_DEG)


def find_roughness(gloss: Any, wanted: float, below: float) -> float:
    """The roughness whose surface has a gloss [GU], of which ``below`` comes from below it. Raises SceneError."""
    from scipy.optimize import brentq

    low, high = ROUGHNESS
    most, least = (gloss(one) + below for one in (low, high))
    if not least <= wanted <= most:
        raise SceneError(f"the gloss must be from {least:.2g} to {most:.3g} GU here, not {wanted:g}")
    target = math.log(wanted - below)
    found = brentq(lambda log: math.log(gloss(math.exp(log))) - target, math.log(low), math.log(high), xtol=CLOSE)
    return math.exp(found)
