"""Hiding power: how well a film hides what it lies on, from exact solves over a black and a white card.

The contrast ratio Y_black/Y_white is that of ISO 6504-3, the thickness at which it reaches 0.98 that of ISO 6504-1, and
both those of ASTM D2805; opacity is that of ISO 2471 and TAPPI T 425 (ISO 2471 and D2805 from memory). Cards are
Lambertian and lie under the binder, without a surface of their own; they take the place of the scene's base. Nodes are
chosen once, so that the errors of a film over both cards and at all thicknesses are alike: ratios are nearer than
readings.
"""

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.appearance.colours import weigh_wavelengths
from vrte.appearance.geometries import choose_way, measure_panel, read_geometry
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number, check_vector
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.basics.views import Figure, view
from vrte.request.how import EXACT
from vrte.scene.boundary import Lambertian

PAPER_WHITE = 0.89  # the even white backing of TAPPI's contrast ratio
SPARE_NODES = 2  # beyond those that the film itself needs: for thinner and thicker ones
LEAST_GAP, LEAST_RATIO = 1e-12, 1e-15  # what the contrast ratio lacks of 1, and is itself, at least: less is rounding
HIDDEN = 1e-9  # what it lacks of 1 where thicker films look the same
CLOSE = 1e-3  # relative, of the thickness that hides: twice what the last step of the search leaves, a secant's
LAST_STEP = 0.05  # and it is no longer than that
BARE = math.log(1e-6)  # of the thickness over the film's own: thinner ones show no more than the cards do
WIDEST_STEP = math.log(1e3)  # of the search, in the logarithm of the thickness
SLOPES = 0.1, 3.0  # of the straightened contrast ratio over that logarithm, as far as they are believed
MOST_STEPS = 60
WIDEST_GAP = 0.6  # between thicknesses of a curve, in their logarithm; twice that beyond the one that hides
THINNER, THICKER = 5.0, 2.0  # how far a curve goes beyond the film itself and the one that hides
USUAL = 30  # solves of a panel: what progress begins with


@dataclass(frozen=True, eq=False)
class OverLambertian:
    """Reflectance factors (n,) of a film over a Lambertian base of albedo A, f(A) = f(0) + u A/(1 - A r), exact. ``u``:
    transmittance down times that up over n^2; ``r``: reflectance of even light from below."""

    bare: Array
    u: Array
    r: Array

    def reflect(self, albedo: float) -> Array:
        """The reflectance factor (n,) over a base of that albedo. Raises SceneError."""
        albedo = check_number("albedo", albedo, 0.0, 1.0, "between 0 and 1")
        return self.bare + albedo * self.u / (1.0 - albedo * self.r)


def fit_lambertian_bases(black: Array, grey: Array, white: Array) -> OverLambertian:
    """What a film sends back over any Lambertian base, from its reflectance factors over albedos 0, 1/2 and 1."""
    half, whole = grey - black, white - black  # u/(2 - r) and u/(1 - r)
    seen = (half > 0.0) & (whole >= 2.0 * half)  # all else is rounding: the film hides its base, or is not there
    escapes = np.divide(half, whole - half, out=np.ones_like(half), where=seen)  # 1 - r
    return OverLambertian(black, whole * escapes, 1.0 - escapes)


@dataclass(frozen=True)
class Conditions:
    """How a panel is looked at: the geometry by its CIE name, the light, the observer [degrees], the albedos of the
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
        object.__setattr__(self, "geometry", read_geometry(self.geometry).name)
        for name in ("black", "white"):
            check_number(name, getattr(self, name), 0.0, 1.0, "an albedo from 0 to 1")
        check_number("target", self.target, 1e-6, 1.0 - 1e-6, "a contrast ratio above 0 and below 1")
        if not self.black < self.white:
            raise SceneError.of("black", f"must be darker than the white, not {self.black:g} beside {self.white:g}")

    @property
    def words(self) -> str:
        """All conditions in one line, for tables."""
        return (
            f"geometry {self.geometry}, illuminant {self.illuminant}, observer {self.observer} degrees, "
            f"black of albedo {self.black:g}, white of albedo {self.white:g}, contrast ratio {self.target:g} hides"
        )

    def weigh(self, wavelength_um: Array) -> Array:
        """Weights (n,) whose sum with a reflectance factor is Y, 1 for the perfect white. Raises SceneError."""
        return weigh_wavelengths(wavelength_um, self.illuminant, self.observer)[1]


@dataclass(eq=False)
class Drawdown:
    """The film of a panel over cards at thicknesses over its own, on nodes chosen at first."""

    panel: Panel
    conditions: Conditions
    progress: Progress | None = None
    expected: int = USUAL
    spectra: dict[tuple[float, float], Array] = field(default_factory=dict)  # by thickness and albedo below
    luminances: dict[float, tuple[float, float]] = field(default_factory=dict)  # over black and white, by thickness

    def __post_init__(self) -> None:
        self.weights = self.conditions.weigh(self.panel.wavelength_um)  # what is refused is refused before the work
        asked = self.panel.asked
        if "nodes" not in asked and asked.get("method", EXACT) == EXACT:  # as many as the film takes over black
            over_black = self.panel.put_over(Lambertian(self.conditions.black))
            found = over_black.choose_quadrature(*choose_way(self.conditions.geometry).lights)
            self.panel = replace(self.panel, asked={**asked, **found, "nodes": found["nodes"] + SPARE_NODES})

    def read(self, times: float, albedo: float) -> Array:
        """The reflectance factor (wavelength,) of a film so many times as thick over a Lambertian base."""
        self.solve([(times, albedo)])
        return self.spectra[times, albedo]

    def solve(self, pairs: Iterable[tuple[float, float]]) -> None:
        """Films of other thicknesses and albedos below, (times, albedo) each, in one call."""
        if new := [pair for pair in dict.fromkeys(pairs) if pair not in self.spectra]:
            films = [self.panel.put_over(Lambertian(albedo)) for _, albedo in new]
            films = [
                film if pair[0] == 1.0 else film.scale_film(pair[0]) for pair, film in zip(new, films, strict=True)
            ]
            known = len(self.spectra) < self.expected  # a guess; beyond it nothing is reported until the end
            part = share_progress(self.progress, len(self.spectra), self.expected) if known else None
            found = measure_panel(films[0].join(films[1:]), self.conditions.geometry, part)
            self.spectra.update(zip(new, found.reshape(len(new), -1), strict=True))

    def find_luminance(self, times: float, albedo: float) -> float:
        """Y of such a film, where the perfect white has 1."""
        return float(self.weights @ self.read(times, albedo))

    def measure(self, times: float) -> tuple[float, float]:
        """Y over both cards; where a thinner film hides the cards, that of the thickest such film, without a solve."""
        self.measure_all([times])
        return self.luminances[times]

    def measure_all(self, times: Iterable[float]) -> list[tuple[float, float]]:
        """The same of several, those that have to be solved for in one call."""
        wanted = [*times]
        new = [each for each in wanted if each not in self.luminances and self._find_hiding_below(each) is None]
        cards = self.conditions.black, self.conditions.white
        self.solve(itertools.product(new, cards))
        for each in sorted(set(wanted) - set(self.luminances)):
            hides = self._find_hiding_below(each)
            black, white = hides or (self.find_luminance(each, card) for card in cards)
            self.luminances[each] = black, white
        return [self.luminances[each] for each in wanted]

    def _find_hiding_below(self, times: float) -> tuple[float, float] | None:
        """Y over both cards of the thickest thinner film that hides them, None where none is known."""
        thinner = {thin: pair for thin, pair in self.luminances.items() if thin < times}
        hides = [thin for thin, (black, white) in thinner.items() if abs(white - black) < HIDDEN * white]
        return thinner[max(hides)] if hides else None

    def find_contrast(self, times: float) -> float:
        """The contrast ratio at a thickness."""
        return float(divide_luminances(*self.measure(times)))

    def find_hiding_times(self) -> tuple[float | None, str]:
        """The thickness of contrast ratio ``target`` over the film's own, or None and why there is none."""
        return find_hiding_times(self.find_contrast, self.conditions.target, self.find_luminance(math.inf, 0.0))

    def list_curve(self, hiding: float) -> list[float]:
        """Thicknesses for a curve around the film's and the one that hides: those solved, and more in wide gaps."""
        low, high = min(1.0, hiding) / THINNER, max(1.0, hiding) * THICKER
        known = sorted({low, high, *(times for times in self.luminances if low < times < high)})
        listed = known[:1]
        for thin, thick in itertools.pairwise(known):
            widest = WIDEST_GAP if thin < hiding else 2.0 * WIDEST_GAP
            steps = math.ceil(math.log(thick / thin) / widest)
            listed += [thin * (thick / thin) ** (step / steps) for step in range(1, steps)] + [thick]
        return listed


def find_hiding_times(contrast: Callable[[float], float], target: float, limit: float) -> tuple[float | None, str]:
    """The thickness at which ``contrast`` is the target, to 1e-3 of itself, or None and why: ``limit`` is Y of the
    semi-infinite film. Secants in the variable of `stretch_contrast`, kept between thicknesses known to be too thin and
    too thick. Raises SceneError where the film does not get there."""
    if limit < LEAST_RATIO:
        return None, "however thick, the film sends nothing back by itself, and over black it stays black"
    low, high, x = -math.inf, math.inf, 0.0
    way, slope, before = math.inf, 1.0, 0.0
    for _ in range(MOST_STEPS):
        off = float(stretch_contrast(contrast(math.exp(x))) - stretch_contrast(target))
        if x < BARE and off >= 0.0:
            return 0.0, "the bare cards are as much alike"
        low, high = (x, high) if off < 0.0 else (low, x)
        if math.isfinite(way):
            slope = min(max((off - before) / way, SLOPES[0]), SLOPES[1])
        step = min(max(-off / slope, -WIDEST_STEP), WIDEST_STEP)
        if abs(step) < min(LAST_STEP, abs(way), CLOSE / abs(way)):
            return math.exp(x + step), ""
        turned = x + step if low < x + step < high else 0.5 * (low + high)
        way, before, x = turned - x, off, turned
    raise SceneError(f"hiding: no thickness with a contrast ratio of {target:g} was found in {MOST_STEPS} steps")


def stretch_contrast(contrast: Any) -> Array:
    """log(-log(1 - C)) of contrast ratios, which over the logarithm of the thickness is nearly straight."""
    return np.log(-np.log1p(-np.clip(contrast, LEAST_RATIO, 1.0 - LEAST_GAP)))


def divide_luminances(black: Any, white: Any) -> Array:
    """Y over black over Y over white; 0 where nothing is reflected."""
    dark, light = np.asarray(black, float), np.asarray(white, float)
    return np.divide(dark, light, out=np.zeros_like(light), where=light > 0.0)


@dataclass(frozen=True, eq=False)
class Hiding:
    """How a panel's film hides cards: reflectance factors (n,) ``over_lambertian`` bases and ``semi_infinite``;
    Y ``over_black`` and ``over_white`` (m,) exact at thicknesses ``times`` (m,) over the film's own; ``hiding_times``
    that hides, or None and the ``reason``; ``length_um``, None where the film is given optically."""

    conditions: Conditions
    wavelength_um: Array
    over_lambertian: OverLambertian
    semi_infinite: Array
    times: Array
    over_black: Array
    over_white: Array
    hiding_times: float | None
    reason: str
    length_um: float | None

    def __repr__(self) -> str:
        return f"Hiding({self})"

    def __str__(self) -> str:
        film = "" if self.length_um is None else f" at {self.length_um:.4g} um"
        read = f"contrast ratio {self.contrast_ratio:.4f}{film}, {self.conditions.target:g} at"
        if self.hiding_times is None:
            return f"{read} no thickness: {self.reason}"
        hides = f"{self.hiding_times:.4g} times the film"
        if self.length_um is not None:
            hides = f"{self.hiding_length_um:.4g} um, {self.spreading_rate:.4g} m2 of dry film a litre"
        return f"{read} {hides}"

    @property
    def reflectance_over_black(self) -> Array:
        """The film's reflectance factor (n,) over the black card."""
        return self.over_lambertian.reflect(self.conditions.black)

    @property
    def reflectance_over_white(self) -> Array:
        """The film's reflectance factor (n,) over the white card."""
        return self.over_lambertian.reflect(self.conditions.white)

    @property
    def reflectances(self) -> dict[str, Array]:
        """Reflectance factors (n,) over black, over white and of the semi-infinite film, "semi-infinite"."""
        over = {"over black": self.reflectance_over_black, "over white": self.reflectance_over_white}
        return {**over, "semi-infinite": self.semi_infinite}

    @property
    def contrast_ratio(self) -> float:
        """Y over black over Y over white, of the film itself: ISO 6504-3; ASTM D2805 over white of 0.80."""
        return self.compare_cards(self.conditions.black, self.conditions.white)

    @property
    def luminance_semi_infinite(self) -> float:
        """Y of the semi-infinite film, where the perfect white has 1."""
        return self.find_luminance(self.semi_infinite)

    @property
    def opacity(self) -> float:
        """Y over a black base over Y of a semi-infinite film: ISO 2471, where the geometry is diffuse."""
        return float(divide_luminances(self.find_luminance(self.over_lambertian.bare), self.luminance_semi_infinite))

    @property
    def paper_opacity(self) -> float:
        """Y over a black base over Y over one of 0.89: TAPPI T 425's contrast ratio, there 15:di, A, 2 degrees."""
        return self.compare_cards(0.0, PAPER_WHITE)

    @property
    def contrast_ratios(self) -> Array:
        """Contrast ratios of the curve, (m,)."""
        return divide_luminances(self.over_black, self.over_white)

    @property
    def hiding_length_um(self) -> float | None:
        """Hiding thickness [um], at which the contrast ratio reaches its target; None where no length has it."""
        return None if self.length_um is None or self.hiding_times is None else self.hiding_times * self.length_um

    @property
    def spreading_rate(self) -> float | None:
        """Area that a volume of dry film hides at that thickness [m2/l]; None where that is."""
        length = self.hiding_length_um
        return None if length is None else 1000.0 / length if length > 0.0 else math.inf

    def find_luminance(self, reflectance: Array) -> float:
        """Y of a reflectance factor (n,) at ``wavelength_um`` in this light, where the perfect white has 1."""
        return float(self.conditions.weigh(self.wavelength_um) @ reflectance)

    def compare_cards(self, black: float, white: float) -> float:
        """The contrast ratio of the film itself over Lambertian cards of any two albedos, from the closed form."""
        dark, light = (self.find_luminance(self.over_lambertian.reflect(albedo)) for albedo in (black, white))
        return float(divide_luminances(dark, light))

    def interpolate(self, times: Any) -> tuple[Array, Array]:
        """Contrast ratio and Y over white (k,) at thicknesses (k,) over the film's own, by splines over their
        logarithm, good to 3e-3. Raises SceneError for a thickness beyond the curve."""
        from scipy.interpolate import CubicSpline

        at = check_vector("times", times)
        if not ((at >= self.times[0]) & (at <= self.times[-1])).all():
            raise SceneError.of("times", f"must be from {self.times[0]:g} to {self.times[-1]:g}, where the curve ends")
        known = np.log(self.times)
        contrast = -np.expm1(-np.exp(CubicSpline(known, stretch_contrast(self.contrast_ratios))(np.log(at))))
        return contrast, CubicSpline(known, self.over_white)(np.log(at))

    def plot(self) -> Figure:
        """A figure of the hiding curve, and of Y over both cards."""
        return view(self, "plot")


def find_contrast(panel: Panel, conditions: Conditions | None = None, progress: Progress | None = None) -> float:
    """The contrast ratio Y_black/Y_white of a panel's film over cards, which take the place of its base."""
    return Drawdown(panel, conditions or Conditions(), progress, expected=2).find_contrast(1.0)


def find_hiding(panel: Panel, conditions: Conditions | None = None, progress: Progress | None = None) -> Hiding:
    """How well a panel's film hides cards, and the thickness, to 1e-3, of the contrast ratio that counts as hidden."""
    thickness = max(scene.layers[panel.film].extent for scene in panel.scenes)
    if not 0.0 < thickness < math.inf:
        how = "semi-infinite, and hides everything" if thickness > 0.0 else "without thickness"
        raise SceneError(f"hiding: the film is {how}: give it a thickness to begin with, above 0 and not inf", "layer")
    drawdown = Drawdown(panel, conditions or Conditions(), progress)
    drawdown.solve([(math.inf, 0.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0)])
    semi_infinite = drawdown.read(math.inf, 0.0)
    even = fit_lambertian_bases(*(drawdown.read(1.0, albedo) for albedo in (0.0, 0.5, 1.0)))
    seen, weights = drawdown.conditions, drawdown.weights
    dark, light = (float(weights @ even.reflect(albedo)) for albedo in (seen.black, seen.white))
    drawdown.luminances[1.0] = dark, light
    hiding, reason = drawdown.find_hiding_times()
    times = drawdown.list_curve(hiding or 1.0)
    curve = np.array(drawdown.measure_all(times))
    if progress is not None:
        progress(len(drawdown.spectra), len(drawdown.spectra))
    known = seen, panel.wavelength_um, even, semi_infinite
    return Hiding(*known, np.array(times), curve[:, 0], curve[:, 1], hiding, reason, panel.length_um)
