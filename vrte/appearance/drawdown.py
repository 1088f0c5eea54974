"""A drawdown: a panel's film over a black and a white card, as thick as is asked, and the thickness that hides them.

Nodes are chosen once, so that the small errors of a film over both cards and at all thicknesses are the same: ratios
of readings are smoother, and nearer, than the readings themselves.
"""

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from vrte.appearance.colours import weigh_wavelengths
from vrte.appearance.geometries import Geometry, find_reflectance, read_geometry, solve_geometry
from vrte.appearance.panel import Panel
from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.request.how import EXACT
from vrte.scene.boundary import Lambertian

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


@dataclass(eq=False)
class Drawdown:
    """A panel over two cards, albedos ``cards``, read in a geometry; ``weights`` (wavelength,) of its luminance Y.

    ``found`` has Y over both cards by the thickness over the film's own; ``solves``, of the panel, are counted.
    """

    panel: Panel
    geometry: Geometry
    cards: tuple[float, float]
    weights: Array
    progress: Progress | None = None
    solves: int = 0
    expected: int = USUAL
    found: dict[float, tuple[float, float]] = field(default_factory=dict)

    def read(self, times: float, albedo: float) -> Array:
        """The reflectance factor (wavelength,) of a film so many times as thick over an even base."""
        film = self.panel.put_over(Lambertian(albedo))
        film = film if times == 1.0 else film.scale_film(times)
        known = self.solves < self.expected  # a guess; beyond it nothing is told until the end
        told = share_progress(self.progress, self.solves, self.expected) if known else None
        self.solves += 1
        return find_reflectance(solve_geometry(film, self.geometry, told), self.geometry, film.surface)

    def measure(self, times: float) -> tuple[float, float]:
        """Y over both cards, where the perfect white has 1; solved once a thickness, and not at all where a thinner
        film hides the cards."""
        hides = [
            thin for thin, (black, white) in self.found.items() if thin < times and abs(white - black) < HIDDEN * white
        ]
        if times not in self.found:
            black, white = (
                self.found[max(hides)]
                if hides
                else [float(self.weights @ self.read(times, card)) for card in self.cards]
            )
            self.found[times] = black, white
        return self.found[times]

    def find_contrast(self, times: float) -> float:
        """The contrast ratio at a thickness."""
        return float(divide_luminances(*self.measure(times)))

    def list_curve(self, hiding: float) -> list[float]:
        """Thicknesses for a curve around that of the film and the one that hides: those already solved for, and more
        where gaps are wide."""
        low, high = min(1.0, hiding) / THINNER, max(1.0, hiding) * THICKER
        known = sorted({low, high, *(times for times in self.found if low < times < high)})
        listed = known[:1]
        for thin, thick in itertools.pairwise(known):
            widest = WIDEST_GAP if thin < hiding else 2.0 * WIDEST_GAP
            steps = math.ceil(math.log(thick / thin) / widest)
            listed += [thin * (thick / thin) ** (step / steps) for step in range(1, steps)] + [thick]
        return listed


def prepare_drawdown(
    panel: Panel,
    black: Any,
    white: Any,
    geometry: Any,
    illuminant: str,
    observer: int,
    progress: Progress | None = None,
    expected: int = USUAL,
) -> Drawdown:
    """A drawdown whose input is checked and whose nodes are chosen. Raises SceneError."""
    dark, light = (
        check_number(name, albedo, 0.0, 1.0, "an albedo between 0 and 1")
        for name, albedo in (("black", black), ("white", white))
    )
    if dark >= light:
        raise SceneError.of("black", f"must be an albedo below that of white, {light:g}, not {dark:g}")
    weights = weigh_wavelengths(panel.wavelength_um, illuminant, observer)[1]
    known = read_geometry(geometry)
    return Drawdown(fix_nodes(panel, known, dark), known, (dark, light), weights, progress, expected=expected)


def fix_nodes(panel: Panel, geometry: Geometry, albedo: float) -> Panel:
    """The same with as many nodes at all wavelengths as the film over that albedo takes at the first, the middle and
    the last, and a few to spare. A panel whose nodes or method are said stays as it is."""
    if "nodes" in panel.asked or panel.asked.get("method", EXACT) != EXACT:
        return panel
    mu_i, mu_o, phi = geometry.directions
    found = panel.put_over(Lambertian(albedo)).choose_quadrature(mu_i, mu_o, phi)
    return replace(panel, asked={**panel.asked, **found, "nodes": found["nodes"] + SPARE_NODES})


def find_hiding_film(drawdown: Drawdown, target: float, limit: float) -> tuple[float | None, str]:
    """How many times as thick a film has the contrast ratio ``target``, to 1e-3 of itself, and why if there is none:
    ``limit`` is Y of one without end.

    Secants, in variables in which thin, absorbing and white films are all close to straight, kept between thicknesses
    known to be too thin and too thick. Raises SceneError where the film does not get there.
    """
    if limit < LEAST_RATIO:
        return None, "however thick, the film sends nothing back by itself, and over black it stays black"
    low, high, x = -math.inf, math.inf, 0.0
    way, slope, before = math.inf, 1.0, 0.0
    for _ in range(MOST_STEPS):
        off = float(stretch_contrast(drawdown.find_contrast(math.exp(x))) - stretch_contrast(target))
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
    """log(-log(1 - C)) of contrast ratios: over the logarithm of the thickness its slope is 1 to 2 where films
    are thin, about 1 where they absorb, and falls slowly where thick ones do not.

    >>> stretch_contrast([1.0 - np.exp(-1.0), 1.0 - np.exp(-2.0)]).round(12).tolist()
    [0.0, 0.69314718056]
    """
    found: Array = np.log(-np.log1p(-np.clip(contrast, LEAST_RATIO, 1.0 - LEAST_GAP)))
    return found


def divide_luminances(black: Any, white: Any) -> Array:
    """Y over black over Y over white; 0 where nothing comes back.

    >>> divide_luminances([0.4, 0.0], [0.8, 0.0]).tolist()
    [0.5, 0.0]
    """
    dark, light = np.asarray(black, float), np.asarray(white, float)
    return np.divide(dark, light, out=np.zeros_like(light), where=light > 0.0)
