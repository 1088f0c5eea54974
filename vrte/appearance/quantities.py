"""What a laboratory reads off a panel, each quantity by the name it has in tables: unit, definition, how it is found.

A quantity is a function of `Readings`, which solve the panel when something first asks, over each base once. One more
is a row of QUANTITIES.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import attrgetter

import numpy as np

from vrte.appearance.colours import Colour, find_colour, weigh_wavelengths
from vrte.appearance.geometries import find_reflectance, read_geometry, solve_geometry
from vrte.appearance.gloss import RECEPTORS, find_glosses
from vrte.appearance.hiding import Drawdown, divide_luminances, find_hiding_film, fix_nodes
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.scene.boundary import Lambertian


@dataclass(frozen=True)
class Conditions:
    """How a panel is looked at: the geometry by its CIE name, the light, the observer [degrees], and the albedos of the
    black and the white card that films are put over, and the contrast ratio that counts as hidden. Raises SceneError.

    >>> print(Conditions(observer=2).words)
    geometry 45:0, illuminant D65, observer 2 degrees, black of albedo 0, white of albedo 0.8, contrast ratio 0.98 hides
    """

    geometry: str = "45:0"
    illuminant: str = "D65"
    observer: int = 10
    black: float = 0.0
    white: float = 0.8
    target: float = 0.98

    def __post_init__(self) -> None:
        read_geometry(self.geometry)
        for name in ("black", "white"):
            check_number(name, getattr(self, name), 0.0, 1.0, "an albedo from 0 to 1")
        check_number("target", self.target, 1e-6, 1.0 - 1e-6, "a contrast ratio above 0 and below 1")
        if not self.black < self.white:
            raise SceneError.of("black", f"must be darker than the white, not {self.black:g} beside {self.white:g}")

    @property
    def words(self) -> str:
        """All of the conditions in one line, for tables."""
        geometry = read_geometry(self.geometry).name
        return (
            f"geometry {geometry}, illuminant {self.illuminant}, observer {self.observer} degrees, "
            f"black of albedo {self.black:g}, white of albedo {self.white:g}, contrast ratio {self.target:g} hides"
        )


@dataclass(eq=False)
class Readings:
    """What is read off a panel under some conditions, each part found when it is first asked for, and kept; ``names``
    of all quantities that will be."""

    panel: Panel
    conditions: Conditions = field(default_factory=Conditions)
    names: Sequence[str] = ()
    measured: dict[float, Array] = field(default_factory=dict, init=False)  # over bases, by their albedos

    def measure(self, panel: Panel) -> Array:
        """Reflectance factors of a panel (wavelength,)."""
        spectrum = solve_geometry(panel, self.conditions.geometry)
        return find_reflectance(spectrum, self.conditions.geometry, panel.surface)

    def find_luminance(self, reflectance: Array) -> float:
        """Y of reflectance factors (wavelength,), 1 for the perfect white."""
        return float(self.weights @ reflectance)

    @cached_property
    def weights(self) -> Array:
        """What Y takes of the reflectance at each wavelength (wavelength,)."""
        return weigh_wavelengths(self.panel.wavelength_um, self.conditions.illuminant, self.conditions.observer)[1]

    @cached_property
    def reflectance(self) -> Array:
        """Reflectance factors of the panel over its own base (wavelength,)."""
        return self.measure(self.panel)

    @cached_property
    def colour(self) -> Colour:
        """The colour of the panel over its own base."""
        light = self.conditions.illuminant, self.conditions.observer
        return find_colour(self.panel.wavelength_um, self.reflectance, *light)

    @cached_property
    def film(self) -> Panel:
        """The panel with the nodes that its film takes over both cards."""
        return fix_nodes(self.panel, read_geometry(self.conditions.geometry), self.conditions.black)

    def measure_over(self, albedo: float) -> Array:
        """Reflectance factors of the film over a Lambertian base (wavelength,)."""
        if albedo not in self.measured:
            self.measured[albedo] = self.measure(self.film.put_over(Lambertian(albedo)))
        return self.measured[albedo]

    @cached_property
    def without_end(self) -> Array:
        """Reflectance factors of the semi-infinite film (wavelength,)."""
        return self.measure(self.film.scale_film(np.inf))

    @cached_property
    def luminances(self) -> tuple[float, float]:
        """Y over the black and the white card."""
        black, white = (self.measure_over(one) for one in (self.conditions.black, self.conditions.white))
        return self.find_luminance(black), self.find_luminance(white)

    @cached_property
    def hiding_length_um(self) -> float:
        """The thickness [um] of a film whose contrast ratio is ``target``; inf where none has it. Raises SceneError."""
        known = self.panel.length_um
        if known is None or not 0.0 < known < np.inf:
            words = "is given optically" if known is None else f"is {known:g} um thick"
            raise SceneError(
                f"how thick a film hides is asked for in um, and it {words}: give it a thickness_um above 0"
            )
        seen = self.conditions
        drawdown = Drawdown(self.film, read_geometry(seen.geometry), (seen.black, seen.white), self.weights)
        drawdown.found[1.0] = self.luminances
        times, _ = find_hiding_film(drawdown, seen.target, self.find_luminance(self.without_end))
        return float("inf") if times is None else times * known

    @cached_property
    def glosses(self) -> dict[float, float]:
        """Gloss by the angle, of all angles asked for, which one solve is for."""
        return find_glosses(self.panel, [angle for angle in RECEPTORS if f"gloss_{angle:g}" in self.names])


@dataclass(frozen=True)
class PanelQuantity:
    """A quantity: its definition with the standard's number, how it is found, its unit as UDUNITS writes it.

    ``uses``: the conditions it depends on; ``takes``: which of `PARTS` are solved for it; ``dims``: none, or the
    wavelengths.
    """

    long_name: str
    find: Callable[[Readings], float | Array]
    uses: tuple[str, ...]
    takes: tuple[str, ...]
    units: str = "1"
    dims: tuple[str, ...] = ()


# panels solved for each part of a reading
PARTS = {"panel": 1, "nodes": 1, "bare": 1, "black": 1, "white": 1, "without_end": 1, "search": 10, "gloss": 4}
LOOK = ("geometry",)
SEEN = (*LOOK, "illuminant", "observer")
CARDS = ("black", "white")
FILM = ("layer",)  # which of several is meant
HIDES = ("nodes", *CARDS, "without_end", "search")
SPECTRUM = ("wavelength_um",)


COLOURS = {
    **{name: f"tristimulus value {name} (ISO/CIE 11664-3), Y of the perfect white is 100" for name in "XYZ"},
    "L": "CIELAB lightness L* (ISO/CIE 11664-4)",
    "a": "CIELAB a*, from green to red (ISO/CIE 11664-4)",
    "b": "CIELAB b*, from blue to yellow (ISO/CIE 11664-4)",
    "C": "CIELAB chroma C*ab (ISO/CIE 11664-4)",
    "h": "CIELAB hue angle h_ab (ISO/CIE 11664-4)",
}
SPECTRA: dict[str, tuple[Callable[[Readings], Array], str, tuple[str, ...], tuple[str, ...]]] = {
    # how each is found, words, conditions and parts
    "reflectance": (lambda seen: seen.reflectance, "reflectance factor", (), ("panel",)),
    "reflectance_over_black": (
        lambda seen: seen.measure_over(seen.conditions.black),
        "reflectance factor of the film over the black card", ("black",), ("nodes", "black"),
    ),
    "reflectance_over_white": (
        lambda seen: seen.measure_over(seen.conditions.white),
        "reflectance factor of the film over the white card", ("white",), ("nodes", "white"),
    ),
    "reflectance_without_end": (
        lambda seen: seen.without_end, "reflectance factor of the semi-infinite film", FILM, ("nodes", "without_end"),
    ),
}  # fmt: skip
QUANTITIES: dict[str, PanelQuantity] = {
    **{
        name: PanelQuantity(words, attrgetter(f"colour.{name}"), SEEN, ("panel",), "degree" if name == "h" else "1")
        for name, words in COLOURS.items()
    },
    **{
        name: PanelQuantity(words, find, (*LOOK, *more), parts, dims=SPECTRUM)
        for name, (find, words, more, parts) in SPECTRA.items()
    },
    "contrast_ratio": PanelQuantity(
        "contrast ratio, Y over black over Y over white (ISO 6504-3)",
        lambda seen: float(divide_luminances(*seen.luminances)),
        (*SEEN, *CARDS),
        ("nodes", *CARDS),
    ),
    "opacity": PanelQuantity(
        "opacity, Y over a black base over Y of the semi-infinite film (ISO 2471)",
        lambda seen: float(divide_luminances(*map(seen.find_luminance, (seen.measure_over(0.0), seen.without_end)))),
        (*SEEN, *FILM),
        ("nodes", "bare", "without_end"),
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
    """Whether what the quantities depend on is known: the light, the observer, and wavelengths enough. Raises
    SceneError."""
    if any("illuminant" in QUANTITIES[name].uses for name in names):
        weigh_wavelengths(wavelengths_um, conditions.illuminant, conditions.observer)
    if any("gloss" in QUANTITIES[name].takes for name in names):
        weigh_wavelengths(wavelengths_um, "C", 2)


def read_quantities(panel: Panel, names: Sequence[str], conditions: Conditions) -> dict[str, float | Array]:
    """The quantities of a panel by name. Raises SceneError, AccuracyError.

    >>> from vrte.appearance.panel import make_panel
    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 2.0}
    >>> panel = make_panel({"layer": [layer]}, [0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68])
    >>> found = read_quantities(panel, ["L", "contrast_ratio"], Conditions(white=1.0))
    >>> 0.0 < found["contrast_ratio"] < 1.0
    True
    """
    readings = Readings(panel, conditions, names)
    return {name: QUANTITIES[name].find(readings) for name in names}
