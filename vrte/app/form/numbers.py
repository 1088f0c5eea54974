"""The numbers of the form that a fit may change, and those under sliders: their keys as in sweeps, words and limits."""

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from vrte.app.form import content as form
from vrte.app.form.content import Content
from vrte.app.form.fields import find_field, get_value
from vrte.basics.errors import Place, SceneError
from vrte.formats.keys import Substance, Whole
from vrte.formats.toml_table import read_fraction, show_place
from vrte.scene.interface import ROUGHNESS

PARTS = ("layer", "particles", "host_index", "base")  # of a scene; all else is about how it is seen
LEFT_OUT = ("accuracy", "effective_radius_um", "humidity_percent", "tolerance")  # of a table or its expansion
SHARES = ("albedo", "particles", "rayleigh", "core_ratio")
DENSEST = 0.6  # of the volume, that particles may take
LIMITS = {"henyey_greenstein": (-0.98, 0.98), "roughness": ROUGHNESS, "sigma": (1.02, 3.0)}
TIMES = {"index": 1.5, "host_index": 1.5, "above": 1.5, "below": 1.5, "thickness": 10.0, "thickness_um": 10.0}
SIZES = 4.0  # so many times smaller or larger any other number may get
LEAST_ABSORPTION = 0.1  # up to which k may go, however small it is
SUBSTANCE = "substance"  # the label of an index's field
DIGITS = 6  # of a value that goes to the form
STEPS = 200  # of a slider, by equal factors from end to end
MOST_SLIDERS = 12  # that the page shows
LENGTHS_UM, FRACTIONS = (1.0, 300.0), (0.001, 0.6)
ROUGHEST = 0.6  # of a slider
TILTS = 2.0, 30.0  # [degrees] of a slider
CHOOSE = "begin with a paint here, or with a material in the Gallery"


@dataclass(frozen=True)
class FormNumber:
    """A number of the form: place, ``label``, value at the ``start``, and ends; a slider goes by equal factors."""

    place: Place
    label: str
    start: float
    low: float
    high: float

    @property
    def key(self) -> str:
        """The key, as sweeps and fits name it."""
        return show_place(self.place, None)

    def find_value(self, step: float) -> float:
        """The number at a step of a slider, to three digits."""
        fraction = min(max(step, 0.0), STEPS) / STEPS
        return float(f"{self.low * (self.high / self.low) ** fraction:.3g}")

    def find_step(self, value: float) -> int:
        """The slider step nearest to a number within the limits."""
        return round(STEPS * math.log(value / self.low) / math.log(self.high / self.low))

    def reaches(self, value: float) -> bool:
        """Whether a number lies within the limits, with 1 % to spare."""
        return 0.99 * self.low <= value <= 1.01 * self.high


def list_free_numbers(content: Content) -> list[FormNumber]:
    """The numbers that a fit may change, of layers, particles, media and base, in this order."""
    return [
        FormNumber(place, name_number(content, place), value, *suggest_limits(place, value))
        for part in PARTS
        for place, value in list_numbers(content, get_value(content, (part,)), (part,))
    ]


def list_numbers(content: Content, value: Any, place: Place) -> Iterator[tuple[Place, float]]:
    """The finite numbers below a place that have a field, an index's n and k each by itself."""
    if isinstance(value, dict):
        for name, below in value.items():
            yield from list_numbers(content, below, (*place, name))
    elif isinstance(value, list):
        is_index = isinstance(find_field(place, content), Substance) and len(value) == 2
        for which, below in enumerate(value):
            if is_index or isinstance(below, dict):
                yield from list_numbers(content, below, (*place, which))
    else:
        found, field = read_fraction(value), find_field(drop_part(place), content)
        fits = str(place[-1]) not in LEFT_OUT and not isinstance(field, Whole) and field.label
        if fits and found is not None and math.isfinite(found):
            yield place, found


def drop_part(place: Place) -> Place:
    """The place of the field that holds a number: that of the index, of its n or k."""
    return place[:-1] if isinstance(place[-1], int) else place


def name_number(content: Content, place: Place, with_layer: bool = True) -> str:
    """The name of a number: its layer or kind of particles, and its field."""
    field = drop_part(place)
    label = find_field(field, content).label.format(field[-1])
    label = "refractive index" if label == SUBSTANCE else label
    if field != place:
        label = f"{label}, {'nk'[int(place[-1])]}"
    if place[0] == "layer":
        on = f"{form.name_layers(content['layer'])[int(place[1])]}: " if with_layer else ""
        return on + label.replace(": of the volume", ": volume fraction")
    return f"{place[1]}: {label}" if place[0] == "particles" else label


def suggest_limits(place: Place, value: float) -> tuple[float, float]:
    """The default limits of a number in a fit; its start lies between them."""
    names = [step for step in place if isinstance(step, str)]
    if place[-1] == 1:  # k of an index
        return 0.0, max(LEAST_ABSORPTION, 10.0 * value)
    if names[-1] in LIMITS:
        low, high = LIMITS[names[-1]]
    elif set(names[1:]) & {"volume_fraction", "volume_fractions"}:
        low, high = 0.0, DENSEST
    elif set(names[1:]) & set(SHARES):
        low, high = 0.0, 1.0
    elif value > 0.0:
        times = TIMES.get(names[-1], SIZES)
        low, high = float(f"{value / times:.3g}"), float(f"{value * times:.3g}")
    else:
        low, high = value - 1.0, value + 1.0
    return min(low, value), max(high, value)


def put_values(content: Content, values: Mapping[Place, float]) -> Content:
    """The content with these numbers, each to some digits. Raises SceneError where it has no such number any more."""
    found = copy.deepcopy(content)
    for place, value in values.items():
        if read_fraction(get_value(found, place)) is None:
            raise SceneError(f"the form has no number {show_place(place)} any more: it has changed since the fit")
        form.put(found, place, float(f"{value:.{DIGITS}g}"))
    return found


def list_sliders(content: Content) -> list[FormNumber]:
    """Sliders of the layers of particles with a geometrical thickness, their sizes, tilts of flakes, and roughness."""
    filled = [place for place, _ in list_filled(content)]
    ends: dict[Place, tuple[float, float]] = {}  # 0: around what it is
    sizes: dict[Place, tuple[float, float]] = {}
    for number, layer in list_filled(content):
        ends["layer", number, "thickness_um"] = LENGTHS_UM
        ends["layer", number, "volume_fraction"] = FRACTIONS
        ends["layer", number, "flakes", "tilt_deg"] = TILTS
        held: Any = layer.get("volume_fractions", layer.get("particles", ()))
        for name in [held] if isinstance(held, str) else held:
            ends["layer", number, "volume_fractions", name] = FRACTIONS
            if name in content.get("particles", {}):
                (below, *_) = form.list_size_places(form.get_size_mode(content["particles"][name]))
                sizes["particles", name, *below] = 0.0, 0.0
    for number, layer in enumerate(content["layer"]):
        if form.is_interface(layer):
            ends["layer", number, "interface", "roughness"] = ROUGHNESS[0], ROUGHEST
    found = []
    for place, (low, high) in (ends | sizes).items():
        value = read_fraction(get_value(content, place))
        if value is not None and 0.0 < value < math.inf:
            low, high = min(low or value / SIZES, value), max(high or value * SIZES, value)
            found.append(FormNumber(place, name_number(content, place, len(filled) > 1), value, low, high))
    return found[:MOST_SLIDERS]


def list_filled(content: Content) -> Iterator[tuple[int, Content]]:
    """The layers that hold particles or flakes, with their places."""
    for place, layer in enumerate(content["layer"]):
        if not form.is_interface(layer) and form.get_medium(layer) in (*form.HELD, "flakes"):
            yield place, layer


def explain_missing(content: Content) -> str:
    """Why a scene has no appearance, and how it gets one; "" where it has."""
    filled = list(list_filled(content))
    if not filled:
        words = "No layer here holds particles or flakes, whose colour this would be"
        return f"{words}: fill one with particles, or {CHOOSE}."
    names = form.name_layers(content["layer"])
    for place, layer in filled:
        if "thickness" in layer and layer["thickness"] != math.inf:
            return (
                f"{names[place].capitalize()} has an optical thickness, which would be the same at every wavelength: "
                f'tick "thickness in µm" in the form and give its volume fraction, or {CHOOSE}.'
            )
    return ""
