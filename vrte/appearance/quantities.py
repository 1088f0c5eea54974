"""What a laboratory reads off a panel, each quantity a row of QUANTITIES: unit, definition, how it is found."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import attrgetter

import numpy as np

from vrte.appearance.colours import Colour, find_colour, find_flop_index, weigh_wavelengths
from vrte.appearance.geometries import METAL_FLAKE, measure_panel, solve_geometries
from vrte.appearance.gloss import RECEPTORS, find_glosses_of
from vrte.appearance.hiding import Conditions, Drawdown, divide_luminances
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.scene.boundary import Lambertian


@dataclass(eq=False)
class Readings:
    """What is read off a panel under some conditions, found when asked for; ``names`` of all that will be."""

    panel: Panel
    conditions: Conditions
    names: Sequence[str] = ()

    @cached_property
    def reflectance(self) -> Array:
        """Reflectance factors of the panel over its own base (wavelength,)."""
        return measure_panel(self.panel, self.conditions.geometry)

    @cached_property
    def colour(self) -> Colour:
        """The colour of the panel over its own base."""
        light = self.conditions.illuminant, self.conditions.observer
        return find_colour(self.panel.wavelength_um, self.reflectance, *light)

    @property
    def flop_index(self) -> float:
        """By the panel's L* at 15, 45 and 110 degrees off the mirrored beam."""
        at, light = self.panel.wavelength_um, (self.conditions.illuminant, self.conditions.observer)
        read = solve_geometries(self.panel, METAL_FLAKE)[0]
        return find_flop_index(*(find_colour(at, read[name], *light).L for name in METAL_FLAKE))

    @cached_property
    def drawdown(self) -> Drawdown:
        """The film over both cards."""
        return Drawdown(self.panel, self.conditions)

    @cached_property
    def hiding_length_um(self) -> float:
        """The thickness [um] of a film whose contrast ratio is ``target``; inf where none has it. Raises SceneError."""
        known = self.panel.length_um
        if known is None or not 0.0 < known < np.inf:
            film = "it is given optically" if known is None else f"it is {known:g} um thick"
            raise SceneError(f"how thick a film hides is asked for in um, and {film}: give it a thickness_um above 0")
        times, _ = self.drawdown.find_hiding_times()
        return float("inf") if times is None else times * known

    @cached_property
    def glosses(self) -> dict[float, float]:
        """Gloss by the angle, of all angles asked for, which one solve is for."""
        return find_glosses_of([self.panel], list_gloss_angles(self.names))[0]


@dataclass(frozen=True)
class PanelQuantity:
    """A definition with its standard, how the quantity is found, the conditions it ``uses``, which PARTS it ``takes``,
    its unit as UDUNITS writes it, and its dimensions: none, or the wavelengths."""

    long_name: str
    find: Callable[[Readings], float | Array]
    uses: tuple[str, ...]
    takes: tuple[str, ...]
    units: str = "1"
    dims: tuple[str, ...] = ()


# panels solved for each part of a reading
PARTS = {"panel": 1, "nodes": 1, "bare": 1, "black": 1, "white": 1, "semi_infinite": 1, "search": 10, "gloss": 4}
LOOK = ("geometry",)
SEEN = (*LOOK, "illuminant", "observer")
CARDS = ("black", "white")
FILM = ("layer",)  # which of several is meant
HIDES = ("nodes", *CARDS, "semi_infinite", "search")
SPECTRUM = ("wavelength_um",)
COLOURS = {
    **{name: f"tristimulus value {name} (ISO/CIE 11664-3), Y of the perfect white is 100" for name in "XYZ"},
    "L": "CIELAB lightness L* (ISO/CIE 11664-4)",
    "a": "CIELAB a*, from green to red (ISO/CIE 11664-4)",
    "b": "CIELAB b*, from blue to yellow (ISO/CIE 11664-4)",
    "C": "CIELAB chroma C*ab (ISO/CIE 11664-4)",
    "h": "CIELAB hue angle h_ab (ISO/CIE 11664-4)",
}
QUANTITIES: dict[str, PanelQuantity] = {
    **{
        name: PanelQuantity(words, attrgetter(f"colour.{name}"), SEEN, ("panel",), "degree" if name == "h" else "1")
        for name, words in COLOURS.items()
    },
    "flop_index": PanelQuantity(
        "flop index of L* at 15, 45 and 110 degrees off the mirrored beam (Alman 1987)",
        attrgetter("flop_index"),
        ("illuminant", "observer"),
        ("panel",),
    ),
    "reflectance": PanelQuantity("reflectance factor", attrgetter("reflectance"), LOOK, ("panel",), dims=SPECTRUM),
    **{
        f"reflectance_over_{card}": PanelQuantity(
            f"reflectance factor of the film over the {card} card",
            partial(lambda card, seen: seen.drawdown.read(1.0, getattr(seen.conditions, card)), card),
            (*LOOK, card),
            ("nodes", card),
            dims=SPECTRUM,
        )
        for card in CARDS
    },
    "reflectance_semi_infinite": PanelQuantity(
        "reflectance factor of the semi-infinite film",
        lambda seen: seen.drawdown.read(np.inf, 0.0),
        (*LOOK, *FILM),
        ("nodes", "semi_infinite"),
        dims=SPECTRUM,
    ),
    "contrast_ratio": PanelQuantity(
        "contrast ratio, Y over black over Y over white (ISO 6504-3)",
        lambda seen: seen.drawdown.find_contrast(1.0),
        (*SEEN, *CARDS),
        ("nodes", *CARDS),
    ),
    "opacity": PanelQuantity(
        "opacity, Y over a black base over Y of the semi-infinite film (ISO 2471)",
        lambda seen: float(divide_luminances(*(seen.drawdown.find_luminance(times, 0.0) for times in (1.0, np.inf)))),
        (*SEEN, *FILM),
        ("nodes", "bare", "semi_infinite"),
    ),
    "hiding_thickness_um": PanelQuantity(
        "thickness at which the contrast ratio is the target (ISO 6504-1); inf where none has it",
        lambda seen: seen.hiding_length_um,
        (*SEEN, *CARDS, "target", *FILM),
        HIDES,
        "um",
    ),
    "spreading_rate": PanelQuantity(
        "area that a litre of dry film hides at that thickness (ISO 6504-1)",
        lambda seen: 1000.0 / seen.hiding_length_um if seen.hiding_length_um > 0.0 else np.inf,
        (*SEEN, *CARDS, "target", *FILM),
        HIDES,
        "m2 l-1",
    ),
    **{
        f"gloss_{angle:g}": PanelQuantity(
            f"specular gloss at {angle:g} degrees, gloss units (ISO 2813)",
            partial(lambda angle, seen: seen.glosses[angle], angle),
            (),
            ("gloss",),
        )
        for angle in RECEPTORS
    },
}


def check_conditions(names: Sequence[str], conditions: Conditions, wavelengths_um: Array) -> None:
    """Whether what the quantities depend on is known: the light, the observer, enough wavelengths."""
    if any("illuminant" in QUANTITIES[name].uses for name in names):
        conditions.weigh(wavelengths_um)
    if any("gloss" in QUANTITIES[name].takes for name in names):
        weigh_wavelengths(wavelengths_um, "C", 2)


def list_gloss_angles(names: Sequence[str]) -> list[float]:
    """The angles [degrees] of the glosses among the names of quantities."""
    return [angle for angle in RECEPTORS if f"gloss_{angle:g}" in names]


def read_quantities(panel: Panel, names: Sequence[str], conditions: Conditions) -> dict[str, float | Array]:
    """The quantities of a panel by name. Raises SceneError, AccuracyError."""
    readings = Readings(panel, conditions, names)
    return {name: QUANTITIES[name].find(readings) for name in names}


def read_panels(
    panels: Sequence[Panel], names: Sequence[str], conditions: Conditions
) -> list[dict[str, float | Array]]:
    """The same of several panels, with the nodes of the first: one call solves all as they lie and over both cards,
    another finds their gloss."""
    asked = Drawdown(panels[0], conditions).panel.asked
    readings = [Readings(replace(panel, asked=asked), conditions, names) for panel in panels]
    used = {one for name in names for one in QUANTITIES[name].takes}
    cards = [(1.0, getattr(conditions, card)) for card in CARDS if card in used]
    own = any(QUANTITIES[name].takes == ("panel",) and "geometry" in QUANTITIES[name].uses for name in names)
    films = [one.panel for one in readings if own]
    films += [one.panel.put_over(Lambertian(albedo)) for one in readings for _, albedo in cards]
    if films:
        found = iter(np.split(measure_panel(films[0].join(films[1:]), conditions.geometry), len(films)))
        for one in readings if own else ():
            one.reflectance = next(found)
        for one in readings if cards else ():
            one.drawdown.spectra.update({card: next(found) for card in cards})
    if angles := list_gloss_angles(names):
        for one, glosses in zip(readings, find_glosses_of([each.panel for each in readings], angles), strict=True):
            one.glosses = glosses
    return [{name: QUANTITIES[name].find(one) for name in names} for one in readings]
