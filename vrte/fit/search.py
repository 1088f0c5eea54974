"""The search for the cheapest paint that meets a target.

Readings are taken to be quadratic in the free numbers, most of them in logarithms, within a step that shrinks where
they are not: slopes are differences, curvatures are what slopes changed from step to step (symmetric rank one). What is
made least and the limits on colour difference, hiding and gloss are exact in the readings.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.hiding import Conditions, Drawdown
from vrte.appearance.panel import Panel, make_panel
from vrte.appearance.quantities import read_panels
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import Progress
from vrte.fit.problem import Parameter, convert_to_steps, convert_to_values, list_ends
from vrte.fit.recipe import Film, Prices, read_film
from vrte.fit.target import MET, Target
from vrte.formats.scene_family import Optics, SceneFamily
from vrte.scene.boundary import Lambertian

STEP = 0.01  # of a number, by which slopes are found and sensitivities told; of its range where it is 0
FIRST_STEP, LONGEST_STEP, LAST_STEP = 0.25, 0.5, 1e-3  # of the ranges of the free numbers
MOST_STEPS = 20  # of each start
LEAST_TURN = 1e-3  # cosine of a step and of what bends slopes along it: less tells no curvature


@dataclass(eq=False)
class PaintReader:
    """Reads paints of a family off panels at wavelengths (n,), each kind of particle made once; ``over``: the albedo
    that colours are read over, None for the paint's own base; ``asked``: keywords of `vrte.brdf`."""

    family: SceneFamily
    wavelength_um: Array
    quantities: Sequence[str]
    conditions: Conditions
    over: float | None
    layer: int | None
    asked: dict[str, Any]
    optics: Optics = field(default_factory=Optics)

    @property
    def folder(self) -> Path:
        """Where tables lie that the scene names."""
        return self.family.folder or Path()

    def make(self, values: Array) -> Panel:
        """The panel of a paint. Raises SceneError."""
        content = self.family.content_at(values)
        return make_panel(content, self.wavelength_um, self.folder, None, self.layer, self.optics, **self.asked)

    def read(self, points: Sequence[Array]) -> list[Array]:
        """Readings (rows,) of some paints. Raises SceneError, AccuracyError."""
        panels = [self.make(values) for values in points]
        if self.over is not None:
            panels = [panel.put_over(Lambertian(self.over)) for panel in panels]
        found = read_panels(panels, self.quantities, self.conditions)
        return [np.array([one[name] for name in self.quantities], float) for one in found]

    @cached_property
    def place(self) -> int:
        """The index, from 0, of the film among the layers of the file."""
        panel = self.make(self.family.values)
        place = panel.scenes[0].places[panel.film]
        assert place is not None
        return place

    def find_film(self, values: Array) -> Film:
        """The volumes of pigments and binder of the film that has these values (n,)."""
        return read_film(self.family.content_at(values), self.place, self.folder)

    def fix_nodes(self, values: Array) -> None:
        """As many nodes as this paint takes, where the accuracy chooses them: alike for all, so that readings are
        smooth."""
        chosen = Drawdown(self.make(values), self.conditions).panel.asked
        self.asked |= {key: chosen[key] for key in ("nodes", "grading") if key in chosen}


@dataclass(frozen=True, eq=False)
class Trial:
    """A paint that was looked at: coordinates (n,) from 0 to 1 within the bounds, bent readings (rows,), what is to be
    made least, and how much is missed, in tolerances."""

    place: Array
    bent: Array
    objective: float
    missed: float

    @property
    def is_met(self) -> bool:
        """Whether the target is met."""
        return self.missed <= MET

    @property
    def rank(self) -> tuple[bool, float]:
        """What is less of a better one."""
        return (False, self.objective) if self.is_met else (True, self.missed)


class RecipeSearch:
    """Walks from starts to the least cost that meets the target, or the least miss; ``best``: the best paint so far."""

    def __init__(self, reader: PaintReader, prices: Prices, target: Target, parameters: Sequence[Parameter]) -> None:
        self.reader, self.prices, self.target, self.parameters = reader, prices, target, parameters
        self.low, high = list_ends(parameters).T
        self.range = high - self.low
        self.best: Trial | None = None
        corners = np.vstack([np.zeros(len(parameters)), np.eye(len(parameters))])
        self.costs = len({round(self.find_cost(self.find_values(one)), 12) for one in corners}) > 1  # a number does

    def find_values(self, place: Array) -> Array:
        """Numbers of the scene at coordinates from 0 to 1."""
        return convert_to_values(self.parameters, self.low + self.range * place)

    def find_place(self, values: Iterable[float]) -> Array:
        """Coordinates of numbers of the scene."""
        return (convert_to_steps(self.parameters, values) - self.low) / self.range

    def find_cost(self, values: Array) -> float:
        """The cost of the film that has these values (n,)."""
        return self.prices.find(self.reader.find_film(values))

    def find_objective(self, place: Array, bent: Array) -> float:
        """The logarithm of the cost; where no free number changes it, the squares of what is off, in tolerances."""
        if self.costs:
            return math.log(max(self.find_cost(self.find_values(place)), 1e-12))
        misses = self.target.find_misses(bent)
        return math.fsum((miss + 1.0) ** 2 for name, miss in misses.items() if name != "contrast_ratio")

    def judge(self, place: Array, readings: Array) -> Trial:
        """A paint with its readings (rows,)."""
        bent = self.target.bend(readings)
        found = Trial(place, bent, self.find_objective(place, bent), self.target.find_missed(bent))
        if self.best is None or found.rank < self.best.rank:
            self.best = found
        return found

    def try_at(self, place: Array) -> Trial:
        """A paint, read. Raises SceneError, AccuracyError."""
        return self.judge(place, *self.reader.read([self.find_values(place)]))

    def find_neighbours(self, values: Array) -> list[Array]:
        """Numbers of the scene (n,) with 1 % more of each, or where a bound forbids it less."""
        found = []
        for index, one in enumerate(self.parameters):
            step = STEP * (abs(values[index]) or one.high - one.low)
            step = step if values[index] + step <= one.high else -step
            found.append(np.where(np.arange(values.size) == index, values[index] + step, values))
        return found

    def find_slopes(self, trial: Trial, near: Sequence[Array], read: Sequence[Array]) -> Array:
        """Derivatives (rows, n) of bent readings by coordinates, from those ``read`` of neighbours."""
        steps = [(self.find_place(values) - trial.place)[index] for index, values in enumerate(near)]
        pairs = zip(steps, read, strict=True)
        return np.array([(self.target.bend(found) - trial.bent) / step for step, found in pairs]).T

    def look_around(self, trial: Trial) -> Array:
        """The same, with neighbours read. Raises SceneError, AccuracyError."""
        near = self.find_neighbours(self.find_values(trial.place))
        return self.find_slopes(trial, near, self.reader.read(near))

    def descend(self, begin: Array, progress: Progress | None) -> Trial:
        """The end of the walk. Raises SceneError where the start is no paint."""
        here, reach = self.try_at(begin), FIRST_STEP
        best, slopes = here, self.look_around(here)
        curves = np.zeros((*slopes.shape, begin.size))
        for step in range(MOST_STEPS):
            if progress is not None:
                progress(step, MOST_STEPS)
            place, weight = self.find_next(here, slopes, curves, reach)
            if max(np.abs(place - here.place).max(), reach) < LAST_STEP:
                break
            try:
                there = self.try_at(place)
            except (SceneError, AccuracyError):  # no such paint: nearer
                reach *= 0.25
                continue
            gain = weight * (here.objective - there.objective) + here.missed - there.missed
            if gain > 0.0 or there.missed < 0.5 * here.missed:
                before, way, here = slopes, place - here.place, there
                best = min(best, here, key=lambda one: one.rank)
                if np.abs(way).max() < LAST_STEP:
                    break
                slopes, reach = self.look_around(here), min(2.0 * reach, LONGEST_STEP)
                bend_curves(curves, way, slopes - before)
            else:
                reach = 0.3 * min(reach, float(np.abs(place - here.place).max()))
        if progress is not None:
            progress(MOST_STEPS, MOST_STEPS)
        return best

    def find_next(self, here: Trial, slopes: Array, curves: Array, reach: float) -> tuple[Array, float]:
        """The best place within ``reach`` by quadratic readings, and whether the objective counts there (1) or the
        target cannot be met (0)."""
        from scipy.optimize import minimize

        def predict(place: Array) -> Array:
            way = place - here.place
            return here.bent + (slopes + 0.5 * curves @ way) @ way

        def find_room(place: Array) -> Array:
            return -np.array([*self.target.find_misses(predict(place)).values()])

        def find_missed(place: Array) -> float:
            return float((np.minimum(find_room(place), 0.0) ** 2).sum())

        def find_objective(place: Array) -> float:
            return self.find_objective(place, predict(place))

        bounds = [(max(one - reach, 0.0), min(one + reach, 1.0)) for one in here.place.tolist()]
        how: dict[str, Any] = {"method": "SLSQP", "bounds": bounds, "options": {"ftol": 1e-9, "maxiter": 100}}

        def clip(place: Array) -> Array:
            return np.clip(place, *np.transpose(bounds))

        nearest = clip(minimize(find_missed, here.place, **how).x)
        if find_missed(nearest) > MET**2:
            return nearest, 0.0
        limits: Any = {"type": "ineq", "fun": find_room}
        cheapest = clip(minimize(find_objective, nearest, constraints=limits, **how).x)
        return (cheapest if find_missed(cheapest) <= MET**2 else nearest), 1.0


def bend_curves(curves: Array, way: Array, turned: Array) -> None:
    """Updates second derivatives (rows, n, n) by how slopes (rows, n) ``turned`` along a way (n,): symmetric, of rank
    one."""
    for curve, change in zip(curves, turned, strict=True):
        rest = change - curve @ way
        along = float(rest @ way)
        if abs(along) > LEAST_TURN * np.linalg.norm(rest) * np.linalg.norm(way):
            curve += np.outer(rest, rest) / along
