"""What a paint looks like over black and over white, worked out again and again as somebody moves its sliders; and once
they rest, its gloss and how thick it has to be to hide what is below."""

import pickle
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vrte.app.solving.messages import Message
from vrte.app.solving.worker import MOST_NOTES, Exchange
from vrte.appearance.appearance import InstrumentReading
from vrte.appearance.colours import Colour, find_colour, find_difference, import_colour_science
from vrte.appearance.geometries import find_reflectance, read_geometry
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


@dataclass(frozen=True)
class Viewing:
    """In which light a paint is seen, by whom, in which geometry, and over a card of which white."""

    illuminant: str = "D65"
    observer: int = 10
    geometry: str = "45:0"
    white: float = 0.8


@dataclass(frozen=True, eq=False)
class CardSpectra:
    """Reflectance factors over black and over white (wavelength,) at wavelengths [um]."""

    wavelength_um: Array
    over_black: Array
    over_white: Array


@dataclass(frozen=True)
class Question:
    """What a scene looks like: the form's content, where its tables lie, how it is looked at, and the spectra that it
    is compared with."""

    content: dict[str, Any]
    folder: Path
    viewing: Viewing = Viewing()
    before: CardSpectra | None = None


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
        numbers = {name: float(getattr(colour, name)) for name in ("X", "Y", "Z", "L", "a", "b", "C", "h")}
        return cls(colour.hex, colour.gamut_gap, numbers, colour.extrapolation)


@dataclass(frozen=True)
class Appeared(Message):
    """The answer: colours over black and over white, and their ``contrast``, Y over black / Y over white; ``apart``,
    CIEDE2000 between the two, and ``changed``, those from the colours before; ``readings``, of gloss and hiding, and
    ``why_none`` of those that there are not. ``coarse``: of few wavelengths; ``follows``: a better answer does."""

    viewing: Viewing
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


class AppearanceAnswerer:
    """Answers questions about scenes that change a little: particles and spectra of the last ones are remembered."""

    def __init__(self) -> None:
        self.kinds: dict[bytes, Particles] = {}
        self.warned: dict[bytes, tuple[str, ...]] = {}  # of kinds of particles, as they were made
        self.found: dict[bytes, dict[str, CardSpectra]] = {}  # by geometry
        self.read: dict[
            bytes, tuple[tuple[InstrumentReading, ...], tuple[str, ...]]
        ] = {}  # gloss and hiding, and why not
        self.nodes: dict[str, Any] = {}
        self.pace = 0.0  # of the last scene, and its seconds for each wavelength but for particles

    def answer(self, question: Question, exchange: Exchange) -> Appeared:
        """Colours, gloss and hiding; colours alone are reported first, before them coarse ones where they take long."""
        begin = time.perf_counter()
        import_colour_science()
        content = {key: value for key, value in question.content.items() if key not in LEFT_OUT}
        key = pickle.dumps((content, question.folder, question.viewing.white))

        def describe(found: dict[str, CardSpectra], **more: Any) -> Appeared:
            notes = self._collect_notes(content, exchange.notes(LongSolveWarning))
            seconds = time.perf_counter() - begin
            return describe_spectra(question, found[question.viewing.geometry], seconds=seconds, notes=notes, **more)

        both = self.found.pop(key, None)
        is_new = both is None
        if both is None:
            at = np.asarray(choose_wavelengths(content, question.folder))
            some = at[np.linspace(0, at.size - 1, COARSE).round().astype(int)]
            panel = self._make(content, question.folder, some)
            made = time.perf_counter() - begin
            if made * at.size / COARSE + self.pace * at.size > PATIENCE:
                nodes = self.nodes or panel.put_over(None).choose_quadrature(MU_I)
                few = self._solve(panel, question.viewing.white, nodes)
                few = {name: spread_over(one, at) for name, one in few.items()}
                exchange.report(describe(few, coarse=True, follows=True))
            panel = self._make(content, question.folder, at, exchange.check)
            begun = time.perf_counter()
            self.nodes = panel.put_over(None).choose_quadrature(MU_I)
            both = self._solve(panel, question.viewing.white, self.nodes, exchange.check)
            self.pace = (time.perf_counter() - begun) / at.size
        self.found[key] = both
        forget_oldest(self.found, MOST_SPECTRA)
        forget_oldest(self.kinds, MOST_KINDS)
        seen = pickle.dumps((content, question.folder, question.viewing))
        if seen not in self.read:
            exchange.report(describe(both, follows=True))
            panel = self._make(content, question.folder, both["45:0"].wavelength_um, exchange.check)
            nodes = self.nodes if is_new else panel.put_over(None).choose_quadrature(MU_I)
            self.read[seen] = read_off(make_panel(panel, **nodes), question.viewing, exchange.check)
            forget_oldest(self.read, MOST_SPECTRA)
        readings, why_none = self.read[seen]
        return describe(both, readings=readings, why_none=why_none)

    def _make(self, content: dict[str, Any], folder: Path, at: Array, progress: Progress | None = None) -> Panel:
        """The scene at wavelengths (n,), of particles that are known as far as they are."""
        return make_panel(content, at, folder, progress, compute=self._compute, accuracy=ACCURACY)

    def _compute(self, source: str, given: dict[str, Any]) -> Particles:
        """Particles as `make_particles` makes them, or as they were made before."""
        key = pickle.dumps((source, given))
        found = self.kinds.pop(key, None) or make_particles(source, given)
        self.kinds[key] = found  # the last used is the last
        return found

    def _solve(
        self, panel: Panel, white: float, nodes: dict[str, Any], progress: Progress | None = None
    ) -> dict[str, CardSpectra]:
        """Reflectance factors over black and over white, by geometry."""
        bare = make_panel(panel, **nodes).put_over(None)
        solved = [bare.solve(MU_I, progress=progress)] * 2
        if all(scene.base_is_reached for scene in bare.scenes):
            solved[1] = bare.put_over(Lambertian(white)).solve(MU_I, progress=progress)
        at = panel.wavelength_um
        return {name: CardSpectra(at, *(find_reflectance(one, name) for one in solved)) for name in GEOMETRIES}

    def _collect_notes(self, content: dict[str, Any], warned: tuple[str, ...]) -> tuple[str, ...]:
        """What the library warns of: of layers now, of particles as they were made."""
        key = pickle.dumps(content.get("particles"))
        of_particles = [text for text in warned if not text.startswith("layer")]
        self.warned[key] = tuple(dict.fromkeys((*self.warned.pop(key, ()), *of_particles)))
        forget_oldest(self.warned, MOST_SPECTRA)
        return tuple(dict.fromkeys((*warned, *self.warned[key])))[:MOST_NOTES]


def read_off(
    panel: Panel, viewing: Viewing, progress: Progress
) -> tuple[tuple[InstrumentReading, ...], tuple[str, ...]]:
    """Gloss over black, the thickness that hides the cards, and how far a litre of it goes; and why not."""
    found: list[InstrumentReading] = []
    why_none: list[str] = []
    bare = panel.put_over(None)

    def read_gloss() -> None:
        for angle, value in find_glosses(bare, progress=progress).items():
            words = "specular gloss, 100 of polished black glass of index 1.567"
            found.append(
                InstrumentReading("gloss", f"{angle:g}:{angle:g}", None, value, "GU", words, "ISO 2813; ASTM D523")
            )

    def read_hiding() -> None:
        length = panel.length_um
        if length is None or not np.isfinite(length):
            raise SceneError("the film has no thickness to begin with")
        seen = Conditions(viewing.geometry, viewing.illuminant, viewing.observer, white=viewing.white)
        times, reason = Drawdown(panel, seen, progress).find_hiding_times()
        if not times:
            raise SceneError(reason)
        words = f"dry film whose contrast ratio is {TARGET:g} over black and a card of albedo {viewing.white:g}"
        rows = ("hiding thickness", times * length, "um"), ("spreading rate", 1e3 / (times * length), "m2/l")
        for name, value, unit in rows:
            found.append(InstrumentReading(name, viewing.geometry, None, value, unit, words, "ISO 6504-1; ASTM D2805"))

    for name, read in (("gloss", read_gloss), ("hiding thickness", read_hiding)):
        try:
            read()
        except SceneError as error:
            why_none.append(f"no {name}: {error}")
    return tuple(found), tuple(why_none)


def list_readings(answer: Appeared) -> Iterator[InstrumentReading]:
    """All numbers of an answer, one a row."""
    viewing, spectra = answer.viewing, answer.spectra
    light, seen = f"{viewing.illuminant}, {viewing.observer} degree observer", viewing.geometry
    cards = f"over a card of albedo 0 and one of {viewing.white:g}"
    sides = ("black", spectra.over_black, answer.black), ("white", spectra.over_white, answer.white)
    for side, values, shade in sides:
        over = f"of the film over {side}, {cards}, where the perfect white diffuser has 1"
        for wavelength, value in zip(spectra.wavelength_um.tolist(), values.tolist(), strict=True):
            yield InstrumentReading(f"reflectance factor over {side}", seen, wavelength, value, "1", over, "CIE 15")
        for name, value in shade.numbers.items():
            unit, standard = "degree" if name == "h" else "1", "ISO/CIE 11664-3" if name in "XYZ" else "ISO/CIE 11664-4"
            yield InstrumentReading(f"{name} over {side}", seen, None, value, unit, light, standard)
    words = f"Y over black over Y over white, {cards}"
    yield InstrumentReading(
        "contrast ratio", seen, None, answer.contrast, "1", f"{words}; {light}", "ISO 6504-3; ASTM D2805"
    )
    words = f"CIEDE2000; {light}"
    yield InstrumentReading("colour difference between both", seen, None, answer.apart, "1", words, "ISO/CIE 11664-6")
    yield from answer.readings


def describe_spectra(question: Question, spectra: CardSpectra, **more: Any) -> Appeared:
    """The colours of spectra, and what they differ by."""
    viewing = question.viewing
    black, white = find_colours(spectra, viewing)
    if question.before is not None:
        then = find_colours(question.before, viewing)
        more["before"] = Shade.of(then[0]), Shade.of(then[1])
        more["changed"] = find_difference(black, then[0]), find_difference(white, then[1])
    contrast = black.Y / white.Y if white.Y > 0.0 else 1.0
    apart = find_difference(black, white)
    return Appeared(viewing, spectra, Shade.of(black), Shade.of(white), contrast, apart, **more)


def find_colours(spectra: CardSpectra, viewing: Viewing) -> tuple[Colour, Colour]:
    """The colours over black and over white."""
    how = viewing.illuminant, viewing.observer
    over_black, over_white = (np.clip(one, 0.0, None) for one in (spectra.over_black, spectra.over_white))
    return find_colour(spectra.wavelength_um, over_black, *how), find_colour(spectra.wavelength_um, over_white, *how)


def spread_over(few: CardSpectra, wavelength_um: Array) -> CardSpectra:
    """Spectra at more wavelengths than they are known at, (n,) [um]: cubic splines.

    >>> few = CardSpectra(np.linspace(0.4, 0.7, 6), np.linspace(0.1, 0.6, 6), np.ones(6))
    >>> spread_over(few, np.array([0.43])).over_black.round(6).tolist()
    [0.15]
    """
    from scipy.interpolate import make_interp_spline

    curves = (few.over_black, few.over_white)
    return CardSpectra(wavelength_um, *(make_interp_spline(few.wavelength_um, one)(wavelength_um) for one in curves))


def forget_oldest(kept: dict[bytes, Any], most: int) -> None:
    """Leaves the ``most`` that were put in last."""
    while len(kept) > most:
        del kept[next(iter(kept))]
