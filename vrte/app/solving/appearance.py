"""The appearance of a paint over black and over white, computed again at every move of its sliders; and once
they rest, its gloss and how thick it has to be to hide what is below."""

import pickle
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.form.content import Content
from vrte.app.solving.worker import MOST_NOTES, Exchange, Message
from vrte.appearance.appearance import (
    COLOURS,
    InstrumentReading,
    list_colour_readings,
    list_gloss_readings,
    list_spectrum,
)
from vrte.appearance.colours import Colour, find_colour, find_difference, import_colour_science
from vrte.appearance.geometries import find_reflectance, read_geometry, see_fields
from vrte.appearance.gloss import find_glosses
from vrte.appearance.hiding import Conditions, Drawdown
from vrte.appearance.panel import Panel, choose_wavelengths, make_panel
from vrte.basics.arrays import Array
from vrte.basics.errors import LongSolveWarning, SceneError
from vrte.basics.running import Progress
from vrte.formats.particle_sources import make_particles
from vrte.optics.particles import Particles
from vrte.scene.boundary import Lambertian

ACCURACY = 1e-3  # of a reflectance: 0.1 % of the white, below what is seen
COARSE = 6  # wavelengths of the first answer
PATIENCE = 0.3  # seconds: where all wavelengths take longer, a coarse answer comes first
MOST_KINDS, MOST_SPECTRA = 1000, 8  # particles at one wavelength, and spectra, that are remembered
TARGET = Conditions.target  # contrast ratio that counts as hidden
LEFT_OUT = ("accuracy", "base", "brdf", "field", "method", "nodes", "render", "settings", "wavelength_um")
GEOMETRIES = {"45:0": "45/0, without gloss", "8:di": "d/8 SCI, with what is mirrored"}
ILLUMINANTS = {"D65": "D65, daylight", "A": "A, light bulb", "FL11": "FL11, fluorescent tube"}
MU_I = [read_geometry(name).directions[0][0] for name in GEOMETRIES]  # one more direction costs next to nothing
OBSERVERS = {10: "10°", 2: "2°"}
CARDS = {  # albedos of the black and of the white one
    "drawdown chart: 0 and 0.8": (0.0, 0.8),
    "chart with a grey black: 0.01 and 0.8": (0.01, 0.8),
    "paper: 0 and 0.89": (0.0, 0.89),
    "perfect: 0 and 1": (0.0, 1.0),
}
OVER_BASE, OTHER_CARDS = "black, and the form's base", "others"


@dataclass(frozen=True, eq=False)
class CardSpectra:
    """Reflectance factors over black and over white (wavelength,) at wavelengths [um]."""

    wavelength_um: Array
    over_black: Array
    over_white: Array


@dataclass(frozen=True)
class Shade:
    """A colour as numbers, and as a screen shows it, which may be ``gamut_gap`` CIEDE2000 from it."""

    hex: str
    gamut_gap: float
    numbers: dict[str, float]
    extrapolation: str

    @classmethod
    def of(cls, colour: Colour) -> "Shade":
        """What the page shows of a colour."""
        numbers = {name: float(getattr(colour, name)) for name in COLOURS}
        return cls(colour.hex, colour.gamut_gap, numbers, colour.extrapolation)


@dataclass(frozen=True)
class Appeared(Message):
    """The answer: colours over black and over white, and their ``contrast``, Y over black / Y over white; ``apart``,
    CIEDE2000 between the two, and ``changed``, those from the colours before; ``readings``, of gloss and hiding, and
    ``why_none`` of those that there are not. ``coarse``: of few wavelengths; ``follows``: a better answer does."""

    viewing: Conditions
    spectra: CardSpectra
    black: Shade
    white: Shade
    contrast: float
    apart: float
    coarse: bool = False
    follows: bool = False
    before: tuple[Shade, Shade] | None = None
    changed: tuple[float, float] | None = None
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    readings: tuple[InstrumentReading, ...] = ()
    why_none: tuple[str, ...] = ()
    sides: tuple[str, str] = ("over black", "over white")


class Kept(dict[bytes, Any]):
    """Values by keys that are pickled: the ``most`` that were used last."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def find(self, key: Any, make: Callable[[], Any]) -> Any:
        """The value of a key, made where it is not known."""
        text = pickle.dumps(key)
        found = self.pop(text) if text in self else make()
        self[text] = found
        while len(self) > self.most:
            del self[next(iter(self))]
        return found


class AppearanceAnswerer:
    """Answers questions about scenes that change a little: particles and spectra of the last ones are remembered."""

    def __init__(self) -> None:
        self.kinds = Kept(MOST_KINDS)  # particles, by source and keywords
        self.warned = Kept(MOST_SPECTRA)  # sentences about particles, as they were made
        self.found = Kept(MOST_SPECTRA)  # spectra by geometry, of each scene over each white
        self.read = Kept(MOST_SPECTRA)  # readings of gloss and hiding, and why there are none, of each scene
        self.nodes: dict[str, Any] = {}
        self.pace = 0.0  # of the last scene, and its seconds for each wavelength but for particles

    def answer(
        self,
        exchange: Exchange,
        content: Content,
        folder: Path,
        viewing: Conditions,
        before: CardSpectra | None,
        over_base: bool = False,
    ) -> Appeared:
        """Colours, gloss and hiding of a scene, ``over_base``: its own in place of the white card; colours alone are
        reported first, coarse ones before them if slow."""
        begin = time.perf_counter()
        import_colour_science()
        kept = ("base",) if over_base else ()
        content = {key: value for key, value in content.items() if key in kept or key not in LEFT_OUT}
        cards = (viewing.black, None if over_base else viewing.white)
        sides = ("over black", "over the base" if over_base else "over white")
        is_new = False

        def describe(found: dict[str, CardSpectra], **more: Any) -> Appeared:
            notes = self._collect_notes(content, exchange.notes(LongSolveWarning))
            seconds = time.perf_counter() - begin
            return describe_spectra(
                found[viewing.geometry], viewing, before, seconds=seconds, notes=notes, sides=sides, **more
            )

        def make(at: Array, progress: Progress | None = None) -> Panel:
            return make_panel(content, at, folder, progress, compute=self._compute, accuracy=ACCURACY)

        def solve() -> dict[str, CardSpectra]:
            nonlocal is_new
            is_new = True
            at = np.asarray(choose_wavelengths(content, folder))
            panel = make(at[np.linspace(0, at.size - 1, COARSE).round().astype(int)])
            made = time.perf_counter() - begin
            if made * at.size / COARSE + self.pace * at.size > PATIENCE:
                few = self._solve(panel, cards, self.nodes or find_nodes(panel))
                few = {name: spread_over(one, at) for name, one in few.items()}
                exchange.report(describe(few, coarse=True, follows=True))
            panel = make(at, exchange.check)
            begun = time.perf_counter()
            self.nodes = find_nodes(panel)
            both = self._solve(panel, cards, self.nodes, exchange.check)
            self.pace = (time.perf_counter() - begun) / at.size
            return both

        both = self.found.find((content, folder, cards), solve)

        def read() -> tuple[tuple[InstrumentReading, ...], tuple[str, ...]]:
            exchange.report(describe(both, follows=True))
            panel = make(both["45:0"].wavelength_um, exchange.check)
            nodes = self.nodes if is_new else find_nodes(panel)
            return read_off(make_panel(panel, **nodes), viewing, exchange.check)

        readings, why_none = self.read.find((content, folder, viewing), read)
        final = describe(both, why_none=why_none)
        return replace(final, readings=(*list_readings(final), *readings))

    def _compute(self, source: str, given: dict[str, Any]) -> Particles:
        """Particles as `make_particles` makes them, or as they were made before."""
        return self.kinds.find((source, given), lambda: make_particles(source, given))

    def _solve(
        self,
        panel: Panel,
        cards: tuple[float, float | None],
        nodes: dict[str, Any],
        progress: Progress | None = None,
    ) -> dict[str, CardSpectra]:
        """Reflectance factors over two albedos, None being the panel's own base, by geometry."""
        panel = make_panel(panel, **nodes)
        over = [panel if albedo is None else panel.put_over(Lambertian(albedo) if albedo else None) for albedo in cards]
        solved = [see_fields(over[0].light(MU_I, 1.0, progress=progress))] * 2
        if all(scene.base_is_reached for scene in panel.put_over(None).scenes):
            solved[1] = see_fields(over[1].light(MU_I, 1.0, progress=progress))
        at = panel.wavelength_um
        return {name: CardSpectra(at, *(find_reflectance(one, name) for one in solved)) for name in GEOMETRIES}

    def _collect_notes(self, content: Content, warned: tuple[str, ...]) -> tuple[str, ...]:
        """What the library warns of: of layers now, of particles as they were made."""
        of_particles: dict[str, None] = self.warned.find(content.get("particles"), dict)
        of_particles.update(dict.fromkeys(text for text in warned if not text.startswith("layer")))
        return tuple(dict.fromkeys((*warned, *of_particles)))[:MOST_NOTES]


def find_nodes(panel: Panel) -> dict[str, Any]:
    """The quadrature of a panel over black, seen in the geometries."""
    return panel.put_over(None).choose_quadrature(MU_I)


def read_off(
    panel: Panel, viewing: Conditions, progress: Progress
) -> tuple[tuple[InstrumentReading, ...], tuple[str, ...]]:
    """Gloss over black, the thickness that hides the cards, and how far a litre of it goes; and why not."""
    bare = panel.put_over(None)

    def read_gloss() -> Iterator[InstrumentReading]:
        return list_gloss_readings(find_glosses(bare, progress=progress))

    def read_hiding() -> Iterator[InstrumentReading]:
        length = panel.length_um
        if length is None or not np.isfinite(length):
            raise SceneError("the film has no thickness to begin with")
        times, reason = Drawdown(panel, viewing, progress).find_hiding_times()
        if not times:
            raise SceneError(reason)
        cards = f"cards of albedo {viewing.black:g} and {viewing.white:g}"
        words = f"dry film whose contrast ratio is {TARGET:g} over {cards}"
        rows = ("hiding thickness", times * length, "um"), ("spreading rate", 1e3 / (times * length), "m2/l")
        for name, value, unit in rows:
            yield InstrumentReading(name, viewing.geometry, None, value, unit, words, "ISO 6504-1; ASTM D2805")

    found: list[InstrumentReading] = []
    why_none: list[str] = []
    for name, read in (("gloss", read_gloss), ("hiding thickness", read_hiding)):
        try:
            found += read()
        except SceneError as error:
            why_none.append(f"no {name}: {error}")
    return tuple(found), tuple(why_none)


def list_readings(answer: Appeared) -> Iterator[InstrumentReading]:
    """Spectra, colours and contrast of an answer, one number a row."""
    viewing, spectra = answer.viewing, answer.spectra
    light, seen = f"{viewing.illuminant}, {viewing.observer} degree observer", viewing.geometry
    white = "the base of the scene" if answer.sides[1].endswith("base") else f"one of {viewing.white:g}"
    cards = f"over a card of albedo {viewing.black:g} and {white}"
    sides = answer.sides, (spectra.over_black, spectra.over_white), find_colours(spectra, viewing)
    for side, values, colour in zip(*sides, strict=True):
        words = f"of the film {side}, {cards}, where the perfect white diffuser has 1"
        name = f"reflectance factor {side}"
        yield from list_spectrum(name, seen, spectra.wavelength_um, values, "1", words, "CIE 15")
        yield from list_colour_readings(colour, seen, f" {side}")
    words, difference = f"Y {sides[0][0]} over Y {sides[0][1]}, {cards}; {light}", f"CIEDE2000; {light}"
    ratio, apart = "contrast ratio", "colour difference between both"
    yield InstrumentReading(ratio, seen, None, answer.contrast, "1", words, "ISO 6504-3; ASTM D2805")
    yield InstrumentReading(apart, seen, None, answer.apart, "1", difference, "ISO/CIE 11664-6")


def find_colours(spectra: CardSpectra, viewing: Conditions) -> list[Colour]:
    """The colours over black and over white."""
    curves = (np.clip(one, 0.0, None) for one in (spectra.over_black, spectra.over_white))
    return [find_colour(spectra.wavelength_um, curve, viewing.illuminant, viewing.observer) for curve in curves]


def describe_spectra(spectra: CardSpectra, viewing: Conditions, before: CardSpectra | None, **more: Any) -> Appeared:
    """The colours of spectra, their difference, and their differences from those of ``before``."""
    black, white = now = find_colours(spectra, viewing)
    if before is not None:
        then = find_colours(before, viewing)
        more["before"] = tuple(map(Shade.of, then))
        more["changed"] = tuple(find_difference(*pair) for pair in zip(now, then, strict=True))
    contrast = black.Y / white.Y if white.Y > 0.0 else 1.0
    apart = find_difference(black, white)
    return Appeared(viewing, spectra, Shade.of(black), Shade.of(white), contrast, apart, **more)


def spread_over(few: CardSpectra, wavelength_um: Array) -> CardSpectra:
    """Spectra at more wavelengths (n,) [um] than they are known at: cubic splines."""
    from scipy.interpolate import make_interp_spline

    curves = (few.over_black, few.over_white)
    return CardSpectra(wavelength_um, *(make_interp_spline(few.wavelength_um, one)(wavelength_um) for one in curves))
