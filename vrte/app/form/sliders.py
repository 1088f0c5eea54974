"""Sliders over numbers of the form: how thick a film is, how much pigment it holds, how large the grains are."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from vrte.app.form.content import (
    HELD,
    Content,
    get_medium,
    get_size_mode,
    get_value,
    is_geometric,
    is_interface,
    list_size_places,
    name_layers,
)
from vrte.app.form.fields import find_field
from vrte.basics.errors import Place
from vrte.formats.toml_table import read_share

STEPS = 200  # of a slider, by equal factors from end to end
MOST_SLIDERS = 12  # that the page shows
LENGTHS_UM, FRACTIONS = (1.0, 300.0), (0.001, 0.6)
SIZES = 4.0  # so many times smaller or larger than the size that the form has
CHOOSE = "begin with a paint here, or with a material in the Gallery"


@dataclass(frozen=True)
class Slider:
    """A number > 0 at a place of the form, from ``low`` to ``high``, by equal factors.

    >>> slider = Slider(("layer", 0, "thickness_um"), "thickness [µm]", 1.0, 100.0)
    >>> slider.find_value(100), slider.find_step(10.0)
    (10.0, 100)
    """

    place: Place
    label: str
    low: float
    high: float

    def find_value(self, step: float) -> float:
        """The number at a step, to three digits."""
        share = min(max(step, 0.0), STEPS) / STEPS
        return float(f"{self.low * (self.high / self.low) ** share:.3g}")

    def find_step(self, value: float) -> int:
        """The step next to a number within the ends."""
        return round(STEPS * math.log(value / self.low) / math.log(self.high / self.low))

    def reaches(self, value: float) -> bool:
        """Whether a number lies between the ends, but for what rounding takes."""
        return 0.99 * self.low <= value <= 1.01 * self.high


def list_sliders(content: Content) -> list[Slider]:
    """Those of the layers that hold particles and have a geometrical thickness, and of these particles' sizes."""
    found = []
    for place, low, high in list_places(content):
        value = read_share(get_value(content, place))
        if value is not None and 0.0 < value < math.inf:
            low, high = min(low or value / SIZES, value), max(high or value * SIZES, value)
            found.append(Slider(place, name_slider(content, place), low, high))
    return found[:MOST_SLIDERS]


def list_places(content: Content) -> Iterator[tuple[Place, float, float]]:
    """Where the numbers are, and from where to where they go; 0: around what they are."""
    kinds = content.get("particles", {})
    sizes: dict[str, Place] = {}
    for place, layer in list_filled(content):
        if "thickness_um" in layer:
            yield ("layer", place, "thickness_um"), *LENGTHS_UM
        held = layer["volume_fractions" if "volume_fractions" in layer else "particles"]
        if "volume_fractions" in layer:
            for name in held:
                yield ("layer", place, "volume_fractions", name), *FRACTIONS
        elif "volume_fraction" in layer:
            yield ("layer", place, "volume_fraction"), *FRACTIONS
        for name in [held] if isinstance(held, str) else held:
            if name in kinds:
                sizes[name] = ("particles", name, *list_size_places(get_size_mode(kinds[name]))[0])
    for size in sizes.values():
        yield size, 0.0, 0.0


def list_filled(content: Content) -> Iterator[tuple[int, Content]]:
    """The layers that hold particles, with their places."""
    for place, layer in enumerate(content["layer"]):
        if not is_interface(layer) and get_medium(layer) in HELD:
            yield place, layer


def name_slider(content: Content, place: Place) -> str:
    """What is moved; of which layer, where there are several."""
    label = find_field(place, content).label.format(place[-1]).replace(": of the volume", ": volume fraction")
    if place[0] == "particles":
        return f"{place[1]}: {label}"
    several = sum(1 for _ in list_filled(content)) > 1
    return f"{name_layers(content['layer'])[int(place[1])]}: {label}" if several else label


def explain_missing(content: Content) -> str:
    """Why a scene has no appearance, and how it gets one; "" where it has."""
    filled = list(list_filled(content))
    if not filled:
        return f"No layer here holds particles, whose colour this would be: fill one with particles, or {CHOOSE}."
    names = name_layers(content["layer"])
    for place, layer in filled:
        if not is_geometric(layer) and layer.get("thickness") != math.inf:
            return (
                f"{names[place].capitalize()} has an optical thickness, which would be the same at every wavelength: "
                f'tick "thickness in µm" in the form and give its volume fraction, or {CHOOSE}.'
            )
    return ""
