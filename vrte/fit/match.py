"""vrte.match: the numbers of a paint that meet a target of colour, hiding and gloss for the least pigment or money.

Readings are taken to be quadratic in the free numbers, most of them in logarithms, within a step that shrinks where
they are not: slopes are differences, curvatures are what slopes changed from step to step (symmetric rank one). What is
made least and the limits on colour difference, hiding and gloss are exact in the readings. Hiding is read as
log(-log(1 - C)) of the contrast ratio C, which is nearly straight over the logarithm of the thickness.
"""

import copy
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vrte.appearance.colours import import_colour_science
from vrte.appearance.hiding import Conditions, stretch_contrast
from vrte.appearance.paint import Paint, note_warnings
from vrte.appearance.paint import paint as make_paint
from vrte.appearance.panel import Panel, find_wavelengths, make_panel, read_source
from vrte.appearance.quantities import read_panels
from vrte.basics.arguments import check_arguments
from vrte.basics.arrays import Array, check_number, check_whole, make_readonly, put_in_one_line, show_value
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.running import Progress, share_progress
from vrte.basics.views import view
from vrte.calls.spectrum import Source
from vrte.fit.model import make_family
from vrte.fit.problem import MOST_STARTS, Parameter, read_parameters
from vrte.fit.recipe import Film, Ingredient, Prices, find_densities, list_ingredients, read_film
from vrte.fit.run import spread_starts
from vrte.formats.atomic import read_text, write_text
from vrte.formats.materials import PAINT_KEYS, list_paints
from vrte.formats.particle_sources import describe_particles, make_particles
from vrte.formats.scene_family import SceneFamily
from vrte.formats.toml_table import (
    LARGEST_FILE,
    Table,
    parse_toml,
    put,
    read_fraction,
    split_key,
    suggest_nearest,
    write_key,
    write_toml,
)
from vrte.optics.crowding import CROWDED_UP_TO
from vrte.request.how import complete_docstring
from vrte.scene.boundary import Lambertian

STEP = 0.01  # of a number, by which slopes are found and sensitivities told; of its range where it is 0
FIRST_STEP, LONGEST_STEP, LAST_STEP = 0.25, 0.5, 1e-3  # of the ranges of the free numbers
MOST_STEPS = 20  # of each start
HIDING_SCALE = 0.02  # of log(-log(1 - C)): misses count in tolerances, that of hiding is 2 % of the thickness
MISSES_COUNT = 1.0  # per tolerance, beside the logarithm of the cost
LEAST_TURN = 1e-3  # cosine of a step and of what bends slopes along it: less tells no curvature
MET = 2e-3  # tolerances by which a target that is met may be missed
DIGITS = 6  # of the numbers of a recipe
AT_BOUND = 1e-4  # of the range
DARKEST_GLOSS = 1e-3  # [gloss units]: less has no logarithm to speak of
USUAL_BOUNDS = {"fraction": 10.0, "thickness_um": 5.0}  # factors to either side of the start
OTHER_BOUNDS, ROUGHNESSES = 2.0, (0.001, 0.6)
SIDES = {"L": ("dark", "light"), "a": ("green", "red"), "b": ("blue", "yellow")}
CARDS = {"black": 0.0, "white": 0.8}
OWN_BASE = "base"
GLOSSES = "gloss_20", "gloss_60", "gloss_85"
FILE_KEYS = (
    "paint", "free", "lab", "contrast_ratio", *GLOSSES, "cost", "tolerance", "gloss_tolerance", "over", "geometry",
    *("illuminant", "observer", "starts", "seed", "densities", "volume_solids", "wavelengths_um", "layer"),
)  # fmt: skip


def bend_reading(name: str, value: float) -> float:
    """A reading by the name of its quantity, as it is nearly linear in the free numbers."""
    if name == "contrast_ratio":
        return float(stretch_contrast(value))
    return math.log(max(value, DARKEST_GLOSS)) if name in GLOSSES else value


@dataclass(frozen=True)
class Target:
    """What is wanted: quantities by name, L, a, b, contrast_ratio and gloss_60; the colour difference CIEDE2000 and the
    gloss units that are allowed; the light of colours. Contrast ratios may be larger."""

    wanted: Mapping[str, float]
    tolerance: float
    gloss_tolerance: float

    @property
    def names(self) -> tuple[str, ...]:
        """The quantities, in the order of all arrays (rows,)."""
        return tuple(self.wanted)

    def bend(self, readings: Iterable[float]) -> Array:
        """Readings (rows,) as they are nearly linear in the free numbers."""
        return np.array([bend_reading(name, float(one)) for name, one in zip(self.names, readings, strict=True)])

    @cached_property
    def lab(self) -> tuple[float, ...]:
        """L*, a*, b*; none where no colour is wanted."""
        return tuple(self.wanted[name] for name in "Lab" if name in self.wanted)

    def find_difference(self, bent: Array) -> float:
        """CIEDE2000 from the colour; 0 where none is wanted."""
        return float(import_colour_science().delta_E(self.lab, bent[:3], method="CIE 2000")) if self.lab else 0.0

    def find_misses(self, bent: Array) -> dict[str, float]:
        """By how many tolerances each of colour, hiding and gloss is missed; below 0 where it is met."""
        found = {"colour": self.find_difference(bent) / self.tolerance - 1.0} if self.lab else {}
        for name, value, goal in zip(
            self.names, bent.tolist(), self.bend([*self.wanted.values()]).tolist(), strict=True
        ):
            if name == "contrast_ratio":
                found[name] = (goal - value) / HIDING_SCALE
            elif name in GLOSSES:
                found[name] = abs(math.exp(value) - math.exp(goal)) / self.gloss_tolerance - 1.0
        return found


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


@dataclass(eq=False)
class Workshop:
    """Reads paints of a family off panels at wavelengths (n,), each kind of particle made once; ``over``: the albedo
    that colours are read over, None for the paint's own base; ``asked``: keywords of `vrte.brdf`."""

    family: SceneFamily
    wavelength_um: Array
    target: Target
    conditions: Conditions
    over: float | None
    prices: Prices
    layer: int | None
    asked: dict[str, Any]
    particles: dict[str, Any] = field(default_factory=dict)

    def compute(self, source: str, given: dict[str, Any]) -> Any:
        """Makes particles, or remembers them."""
        key = describe_particles(source, given)
        found = self.particles.get(key)
        if found is None:
            found = self.particles[key] = make_particles(source, given)
        return found

    def make(self, values: Array) -> Panel:
        """The panel of a paint. Raises SceneError."""
        content, folder = self.family.content_at(values), self.family.folder
        return make_panel(content, self.wavelength_um, folder or Path(), None, self.layer, self.compute, **self.asked)

    def read(self, points: Sequence[Array]) -> list[Array]:
        """Readings (rows,) of some paints. Raises SceneError, AccuracyError."""
        panels = [self.make(values) for values in points]
        if self.over is not None:
            panels = [panel.put_over(Lambertian(self.over)) for panel in panels]
        found = read_panels(panels, self.target.names, self.conditions)
        return [np.array([one[name] for name in self.target.names], float) for one in found]

    @cached_property
    def place(self) -> int:
        """The index, from 0, of the film among the layers of the file."""
        panel = self.make(self.family.values)
        place = panel.scenes[0].places[panel.film]
        assert place is not None
        return place

    def find_film(self, values: Array) -> Film:
        """The volumes of pigments and binder of the film that has these values (n,)."""
        return read_film(self.family.content_at(values), self.place, self.family.folder or Path())

    def find_cost(self, values: Array) -> float:
        """The cost of the film that has these values (n,)."""
        return self.prices.find(self.find_film(values))

    def fix_nodes(self, values: Array) -> None:
        """As many nodes as this paint takes, where the accuracy chooses them: alike for all, so that readings are
        smooth."""
        if "nodes" not in self.asked and "method" not in self.asked:
            panel = self.make(values)
            mu_i, mu_o = 1.0, np.cos(np.radians([45.0, 60.0]))
            found = panel.choose_quadrature(mu_i, mu_o)
            self.asked = {**self.asked, **found}


class Descent:
    """A walk from one start to the least cost that meets the target, or the least miss."""

    def __init__(self, workshop: Workshop, parameters: Sequence[Parameter]) -> None:
        self.workshop, self.parameters = workshop, parameters
        ends = [(one.convert_to_step(one.low), one.convert_to_step(one.high)) for one in parameters]
        self.low, self.range = np.array([low for low, _ in ends]), np.array([high - low for low, high in ends])
        self.best: Trial | None = None
        first = workshop.family.values
        costs = {
            workshop.find_cost(np.where(np.arange(first.size) == k, one.high, first))
            for k, one in enumerate(parameters)
        }
        self.costs = len({round(one, 12) for one in (*costs, workshop.find_cost(first))}) > 1  # a number changes them

    def find_values(self, place: Array) -> Array:
        """Numbers of the scene at coordinates from 0 to 1."""
        steps = self.low + self.range * place
        return np.array([one.convert_to_value(step) for one, step in zip(self.parameters, steps.tolist(), strict=True)])

    def find_place(self, values: Iterable[float]) -> Array:
        """Coordinates of numbers of the scene."""
        steps = [one.convert_to_step(value) for one, value in zip(self.parameters, values, strict=True)]
        return (np.array(steps) - self.low) / self.range

    def find_objective(self, place: Array, bent: Array) -> float:
        """The logarithm of the cost; where no free number changes it, the squares of what is off, in tolerances."""
        if self.costs:
            return math.log(max(self.workshop.find_cost(self.find_values(place)), 1e-12))
        return math.fsum(
            (miss + 1.0) ** 2 for name, miss in self.target.find_misses(bent).items() if name != "contrast_ratio"
        )

    @property
    def target(self) -> Target:
        """The readings that are wanted, with their tolerances."""
        return self.workshop.target

    def judge(self, place: Array, bent: Array) -> Trial:
        """A paint with its readings."""
        misses = [*self.target.find_misses(bent).values()]
        found = Trial(place, bent, self.find_objective(place, bent), math.hypot(*(max(one, 0.0) for one in misses)))
        if self.best is None or found.rank < self.best.rank:
            self.best = found
        return found

    def try_at(self, place: Array) -> Trial:
        """A paint, read. Raises SceneError, AccuracyError."""
        (found,) = self.workshop.read([self.find_values(place)])
        return self.judge(place, self.target.bend(found))

    def find_neighbours(self, place: Array) -> list[Array]:
        """Numbers of the scene (n,) with 1 % more of each, or where a bound forbids it less."""
        values = self.find_values(place)
        found = []
        for index, one in enumerate(self.parameters):
            step = STEP * (abs(values[index]) or one.high - one.low)
            step = step if values[index] + step <= one.high else -step
            found.append(np.where(np.arange(values.size) == index, values[index] + step, values))
        return found

    def find_slopes(self, trial: Trial) -> Array:
        """Derivatives (rows, n) of bent readings by coordinates. Raises SceneError, AccuracyError."""
        near = self.find_neighbours(trial.place)
        read = self.workshop.read(near)
        columns = []
        for index, (values, found) in enumerate(zip(near, read, strict=True)):
            step = self.find_place(values)[index] - trial.place[index]
            columns.append((self.target.bend(found) - trial.bent) / step)
        return np.array(columns).T

    def descend(self, begin: Array, progress: Progress | None) -> Trial:
        """The end of the walk. Raises SceneError where the start is no paint."""
        here, reach = self.try_at(begin), FIRST_STEP
        best, slopes = here, self.find_slopes(here)
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
            if self.measure(there, weight) < self.measure(here, weight) or there.missed < 0.5 * here.missed:
                before, way, here = slopes, place - here.place, there
                best = min(best, here, key=lambda one: one.rank)
                if np.abs(way).max() < LAST_STEP:
                    break
                slopes, reach = self.find_slopes(here), min(2.0 * reach, LONGEST_STEP)
                bend_curves(curves, way, slopes - before)
            else:
                reach = 0.3 * min(reach, float(np.abs(place - here.place).max()))
        if progress is not None:
            progress(MOST_STEPS, MOST_STEPS)
        return best

    @staticmethod
    def measure(trial: Trial, weight: float) -> float:
        """What a step has to lower: the objective, ``weight`` times, and the misses."""
        return weight * trial.objective + MISSES_COUNT * trial.missed

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


def find_ready_paint(source: Any) -> Any:
    """The content of a ready paint by its name; anything else as it is. Raises SceneError for no such paint."""
    if not isinstance(source, str) or source.endswith(".toml"):
        return source
    name, known = " ".join(source.lower().replace("_", " ").replace("-", " ").split()), list_paints()
    if name not in known:
        words = f"must be a scene file (.toml), its content or a ready paint, {', '.join(known)}"
        raise SceneError.of("paint", f"{words}, not {show_value(source)}{suggest_nearest(name, known)}")
    return known[name].content


def name_numbers(content: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """The names of numbers as sweeps have them; of a paint a pigment's own name is its load, and keys of [paint] and
    the roughness of its surface may stand alone.

    >>> name_numbers({"paint": {"pigment": {"rutile": 0.1}}}, ["rutile", "thickness_um", "layer[1].albedo"])
    ['paint.pigment.rutile', 'paint.thickness_um', 'layer[1].albedo']
    """
    paint = content.get("paint")
    if not isinstance(paint, Mapping):
        return [*names]
    pigment = paint.get("pigment")
    loads = {pigment: "paint.volume_fraction"} if isinstance(pigment, str) else {}
    if isinstance(pigment, Mapping):
        loads = {name: f"paint.pigment.{write_key(name)}" for name in pigment}
    short = {key: f"paint.{key}" for key in PAINT_KEYS} | {"roughness": "paint.surface.roughness"} | loads
    return [short.get(name, name) for name in names]


def put_fractions(content: dict[str, Any]) -> dict[str, Any]:
    """The content with the loads of a paint as numbers, where they are per cent in quotes."""
    paint = content.get("paint")
    if not isinstance(paint, Mapping):
        return content

    def convert(given: Any) -> Any:
        return given if (found := read_fraction(given)) is None else found

    changed = {key: convert(paint[key]) for key in ("volume_fraction",) if key in paint}
    if isinstance(paint.get("pigment"), Mapping):
        changed["pigment"] = {name: convert(one) for name, one in paint["pigment"].items()}
    return {**content, "paint": {**paint, **changed}}


def read_free(free: Sequence[str] | Mapping[str, Any], names: Sequence[str], starts: Array) -> tuple[Parameter, ...]:
    """The free numbers, in logarithms where their lower bound is above 0; a start beyond its bounds is moved to them.
    Raises SceneError."""
    given = dict(free) if isinstance(free, Mapping) else {name: {} for name in free}
    entries: dict[str, dict[str, Any]] = {}
    for (typed, entry), name in zip(given.items(), names, strict=True):
        is_pair = isinstance(entry, Sequence) and not isinstance(entry, str) and len(entry) == 2
        entry = {"low": entry[0], "high": entry[1]} if is_pair else dict(entry) if isinstance(entry, Mapping) else entry
        if not isinstance(entry, dict):
            words = "takes its bounds, [low, high], or a table of start, low, high and spacing"
            raise SceneError(f"free: {put_in_one_line(typed)} {words}, not {show_value(entry)}", "free")
        entries[name] = entry
    usual = {name: find_bounds(name, value) for name, value in zip(names, starts.tolist(), strict=True)}
    begun = dict(zip(names, starts.tolist(), strict=True))
    for name, entry in entries.items():
        low, high = (entry.get(key, end) for key, end in zip(("low", "high"), usual[name], strict=True))
        if all(isinstance(one, int | float) for one in (low, high)) and low < high and "start" not in entry:
            begun[name] = min(max(begun[name], low), high)
        entry.setdefault("spacing", "log" if isinstance(low, int | float) and low > 0.0 else "linear")
    found = read_parameters(entries, None, begun, usual)
    for one in found:
        if not all(map(math.isfinite, (one.convert_to_step(one.low), one.convert_to_step(one.high)))):
            words = "needs finite bounds" + ", above 0 for steps in its logarithm" * one.is_log
            raise SceneError(f"free: {one.name} {words}: it has {one.low:g} and {one.high:g}", "free")
    return found


def find_bounds(name: str, start: float) -> tuple[float, float]:
    """Bounds of a number where none are given.

    >>> find_bounds("paint.thickness_um", 60.0), find_bounds("paint.volume_fraction", 0.15)
    ((12.0, 300.0), (0.015, 0.3))
    """
    last = name.rpartition(".")[2]
    if last == "roughness":
        return ROUGHNESSES
    is_load = last == "volume_fraction" or ".pigment." in name or ".volume_fractions." in name
    factor = USUAL_BOUNDS.get("fraction" if is_load else last, OTHER_BOUNDS)
    if not 0.0 < start < math.inf:
        raise SceneError(f"free: {name} is {start:g}: say its bounds, as {{{name!r}: [low, high]}}", "free")
    high = min(start * factor, max(CROWDED_UP_TO, start)) if is_load else start * factor
    return start / factor, high


@dataclass(frozen=True, eq=False, repr=False)
class Match:
    """The recipe that `vrte.match` found, and how near it comes. ``matched`` in the example is one of a white paint.

    Attributes
    ----------
    recipe
        What the film is made of: of each ingredient its name, density [kg/l], and its parts of the volume and of the
        weight of the dry and of the wet film; None where that takes a density or volume_solids.
    difference
        CIEDE2000 from the colour that is wanted; 0 where none is.
    why
        What held the recipe back from the target; "" where it is met.
    names
        The free numbers, n.
    values
        Their values, (n,).
    bounds
        From and to, (n, 2).
    reached
        What is wanted and what was found of each quantity, by its name.
    cost
        What a square metre of dry film costs, in cost_unit; of a semi-infinite film a litre.
    cost_unit
        cm3 of pigment, or the money of the prices.
    sensitivities
        What 1 % more of each free number does to each quantity of reached, to the colour difference and to the cost,
        (n, quantities + 2).
    thickness_um
        Of the dry film [um].
    wet_thickness_um
        Of the wet film [um]; None without volume_solids.
    starts
        Where walks began and ended, (starts, 2, n), the best first.
    notes
        What was warned of, and what else is to be known.
    content
        The content of the scene file of the recipe.
    folder
        Where tables that it names lie.

    Examples
    --------
    >>> matched.why
    ''
    """

    recipe: tuple[Ingredient, ...]
    difference: float
    why: str
    names: tuple[str, ...]
    values: Array
    bounds: Array
    reached: Mapping[str, tuple[float, float]]
    cost: float
    cost_unit: str
    sensitivities: Array
    thickness_um: float
    wet_thickness_um: float | None
    starts: Array
    notes: tuple[str, ...]
    content: Mapping[str, Any]
    folder: Path

    def __repr__(self) -> str:
        missed = "" if not self.why else f", {self.why}"
        return f"Match({self.cost:.4g} {self.cost_unit}, CIEDE2000 {self.difference:.2f}{missed})"

    def __str__(self) -> str:
        """Recipe, target, free numbers and what each does, as tables."""
        return "\n".join(self._list_lines())

    def _repr_html_(self) -> str:
        return str(view(self, "_repr_html_"))

    def _list_lines(self) -> Iterator[str]:
        """The lines of the tables."""
        yield f"target {'not met: ' + self.why if self.why else 'met'}"
        wet = "" if self.wet_thickness_um is None else f", wet film {self.wet_thickness_um:.4g} µm"
        yield f"dry film {self.thickness_um:.4g} µm{wet}; {self.cost:.4g} {self.cost_unit}"
        heads = ["recipe [%]", "volume", "weight", *(["wet volume", "wet weight"] if wet else [])]
        yield from align([heads, *(write_ingredient(one, bool(wet)) for one in self.recipe)])
        rows = [[name, f"{wanted:.5g}", f"{found:.5g}"] for name, (wanted, found) in self.reached.items()]
        rows += [["CIEDE2000", "", f"{self.difference:.3g}"]] if "L" in self.reached else []
        yield from align([["target", "wanted", "found"], *rows])
        quantities = [*self.reached, "CIEDE2000", "cost"]
        rows = [
            [name, f"{value:.5g}", f"{low:.4g} to {high:.4g}", *(f"{one:+.2g}" for one in row)]
            for name, value, (low, high), row in zip(
                self.names, self.values.tolist(), self.bounds.tolist(), self.sensitivities.tolist(), strict=True
            )
        ]
        yield from align([["1 % more of", "value", "bounds", *quantities], *rows])
        yield from self.notes

    def paint(self, **asked: Any) -> Paint:
        """All that a laboratory reads off it: the page of `vrte.paint`, whose keywords it takes."""
        return make_paint(dict(self.content), folder=self.folder, **asked)

    def write_scene(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene file (.toml) of the recipe."""
        if not os.fspath(path).lower().endswith(".toml"):
            raise SceneError(f"the scene file {put_in_one_line(os.fspath(path))} must end in .toml")
        write_text(write_toml(dict(self.content)), path)


def write_ingredient(one: Ingredient, wet: bool) -> list[str]:
    """A row of the recipe, in per cent."""
    parts = (one.volume, one.weight, *((one.wet_volume, one.wet_weight) if wet else ()))
    return [one.name, *("?" if part is None else f"{100.0 * part:.3f}" for part in parts)]


def align(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows as lines, columns below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return [f"  {line.rstrip()}" for line in lines]


def explain(descent: Descent, trial: Trial, slopes: Array) -> str:
    """Why a target is not met: what misses by how much, and which number at a bound would bring it nearer."""
    target = descent.target
    found = []
    for name, miss in target.find_misses(trial.bent).items():
        goal, value = (target.bend([*target.wanted.values()]), trial.bent)
        if miss <= MET:
            continue
        if name == "colour":
            offs = [
                (abs(there - here), name, there > here) for name, here, there in zip("Lab", goal, value, strict=False)
            ]
            off, which, side = max(offs)
            words = f"{which}* is {off:.2g} too {SIDES[which][int(side)]}"
            found.append(f"the colour is {target.find_difference(value):.2g} CIEDE2000 off: {words}")
            continue
        index = target.names.index(name)
        off = "low" if value[index] < goal[index] else "high"
        found.append(f"{name} is too {off}")
    held = []
    for index, one in enumerate(descent.parameters):
        side = 1.0 if trial.place[index] > 1.0 - AT_BOUND else -1.0 if trial.place[index] < AT_BOUND else 0.0
        further = target.find_misses(trial.bent + side * STEP * slopes[:, index])
        if side and math.hypot(*(max(miss, 0.0) for miss in further.values())) < (1.0 - 1e-4) * trial.missed:
            end, bound = ("upper", one.high) if side > 0.0 else ("lower", one.low)
            held.append(f"{one.name} is held at its {end} bound {bound:.4g}")
    return ", ".join(found) + f"; {', '.join(held) if held else 'no free number brings it nearer: free another'}"


@complete_docstring
def match(
    paint: Source | SceneFamily,
    free: Sequence[str] | Mapping[str, Any],
    lab: Sequence[float] | None = None,
    contrast_ratio: float | None = None,
    gloss_20: float | None = None,
    gloss_60: float | None = None,
    gloss_85: float | None = None,
    cost: Mapping[str, float] | None = None,
    tolerance: float = 1.0,
    gloss_tolerance: float = 3.0,
    over: str | float | None = None,
    geometry: str = Conditions.geometry,
    illuminant: str = "D65",
    observer: int = 10,
    starts: int = 3,
    seed: int = 0,
    densities: Mapping[str, float] | None = None,
    volume_solids: float | None = None,
    wavelengths_um: Any = None,
    layer: int | None = None,
    accuracy: float | None = None,
    nodes: int | None = None,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
) -> Match:
    """The loads, thickness, sizes and roughness with which a paint meets a target of colour, hiding and gloss.

    Of all that meet the target the one of the least cost, pigment or money; where none does, the one that misses least.

    Parameters
    ----------
    paint : path, mapping, str or SceneFamily
        A scene file with a table [paint] or any other whose film lies in one layer, its content, or the name of a ready
        paint, "white gloss". Its numbers are the first start.
    free : sequence of str, or mapping
        The numbers that change: names of pigments, "thickness_um", "roughness", or any as in sweeps; or by each name
        its bounds, [low, high], or a table of ``start``, ``low``, ``high`` and ``spacing``. Without bounds a load goes
        from a tenth to ten times what it is, at most 0.3 of the volume; a thickness from a fifth to five times,
        roughness from 0.001 to 0.6, anything else from half to twice.
    lab : sequence of float, optional
        L*, a*, b* that are wanted.
    contrast_ratio : float, optional
        Y over black over Y over white (0.8) that the film has at least.
    gloss_20, gloss_60, gloss_85 : float, optional
        Gloss units that are wanted.
    cost : mapping, optional
        Prices of a kg by ingredient, pigments and binder, {"rutile": 3.0, "alkyd": 2.0}; what is not named costs
        nothing. Without it the volume of pigments on a square metre is made least.
    tolerance : float, optional
        CIEDE2000 that the colour may be off.
    gloss_tolerance : float, optional
        Gloss units that gloss may be off.
    over : {'base', 'black', 'white'} or float, optional
        What the colour is read over: the paint's own base, a card (albedo 0 or 0.8), or any albedo; by default the own
        base, or black where the paint has none.
    geometry : str, optional
        Of the colour and of the contrast ratio, as for `vrte.appearance`.
    {illuminant, observer}
    starts : int, optional
        How many starts: the paint's own numbers, and others spread over the bounds.
    seed : int, optional
        Of these.
    densities : mapping, optional
        kg/l by ingredient, in place of known ones; "volatile" is what leaves the wet film. Weights are told where
        all are known.
    volume_solids : float, optional
        The part of the wet film's volume that stays, for wet thickness and wet recipe.
    {wavelengths_um, layer, accuracy, nodes, folder, progress}

    Returns
    -------
    Match
        Recipe, values, what was reached, what 1 % more of each does, and why the target is not met, if so.

    Raises
    ------
    SceneError
        For bad input: no target, unknown numbers, bounds the wrong way, prices without densities.
    {MissingExtraError, OSError}

    References
    ----------
    Kraft, DFVLR-FB 88-28 (1988), by `scipy.optimize.minimize` (SLSQP), within a trust region.

    Examples
    --------
    >>> import vrte
    >>> film = {"host_index": 1.5, "particles": "grain", "volume_fraction": 0.05, "thickness_um": 20.0}
    >>> grain = {"index": 2.5, "radius_um": 0.1}
    >>> white = {"particles": {"grain": grain}, "layer": [{"interface": {"above": 1.0, "below": 1.5}}, film]}
    >>> at = [0.42, 0.46, 0.50, 0.54, 0.58, 0.62, 0.66, 0.70]
    >>> found = vrte.match(white, ["layer[2].thickness_um"], contrast_ratio=0.9, wavelengths_um=at, nodes=4, starts=1)
    >>> f"{found.reached['contrast_ratio'][1]:.3f}", found.why
    ('0.900', '')
    """
    target = make_target(lab, contrast_ratio, (gloss_20, gloss_60, gloss_85), tolerance, gloss_tolerance)
    count = check_whole("starts", starts, 1, MOST_STARTS)
    check_whole("seed", seed, 0, 2**64)
    solids = None if volume_solids is None else check_number("volume_solids", volume_solids, 1e-3, 1.0, "0.001 to 1")
    folder = Path(folder)
    if isinstance(paint, SceneFamily):
        paint, folder = paint.source, paint.folder or folder  # type: ignore[assignment]
    if not isinstance(paint := find_ready_paint(paint), str | os.PathLike | Mapping):
        raise SceneError.of("paint", "must be a scene file, its content or a ready paint: a vrte.Scene has no pigments")
    content, folder = read_source(paint, folder)
    content = put_fractions(content)
    typed = list(free)
    if not typed:
        raise SceneError.of("free", "must name one or more numbers of the paint")
    names = name_numbers(content, typed)
    try:
        family = make_family(content, names, folder)
    except SceneError as error:
        known = ", ".join(list_short_names(content))
        raise SceneError(f"{error}; short names here: {known}" if known else str(error), *error.place) from error
    parameters = read_free(free, names, family.values)
    conditions = Conditions(geometry, illuminant, observer, *CARDS.values())
    at = find_wavelengths(content, wavelengths_um, folder)
    conditions.weigh(at)  # what is refused is refused before the work
    asked = {name: one for name, one in {"accuracy": accuracy, "nodes": nodes}.items() if one is not None}
    albedo = read_over(over, content)
    notes: list[str] = []
    with note_warnings(notes):
        shop = Workshop(family, at, target, conditions, albedo, Prices(cost, {}), layer, asked)
        film = shop.find_film(family.values)
        weighed = find_densities(film, densities)
        shop.prices = Prices(cost, weighed)
        shop.prices.check(film)
        descent = Descent(shop, parameters)
        shop.fix_nodes(np.array([one.start for one in parameters]))
        begins = [descent.find_place([one.start for one in parameters])]
        begins += [(one - descent.low) / descent.range for one in spread_starts(parameters, count, seed)[1:]]
        ends = [
            descend_from(descent, begin, share_progress(progress, index, count), needed=index == 0)
            for index, begin in enumerate(begins)
        ]
        best = min((one for one in ends if one is not None), key=lambda one: one.rank)
        found = make_match(descent, best, begins, ends, weighed, solids)
    return replace(found, notes=(*dict.fromkeys(notes), *note_densities(found.recipe)))


def note_densities(recipe: Sequence[Ingredient]) -> list[str]:
    """Which densities weights lack, in words."""
    names = [one.name for one in recipe if one.density is None]
    needed = f"Weights need densities={{{', '.join(f'{name!r}: ...' for name in names)}}} [kg/l]."
    return [needed] if names else []


def descend_from(descent: Descent, begin: Array, progress: Progress | None, needed: bool) -> Trial | None:
    """The end of a walk; None where a start that was drawn is no paint."""
    try:
        return descent.descend(begin, progress)
    except (SceneError, AccuracyError):
        if needed:
            raise
        return None


def make_match(
    descent: Descent,
    best: Trial,
    begins: Sequence[Array],
    ends: Sequence[Trial | None],
    densities: Mapping[str, float],
    solids: float | None,
) -> Match:
    """The result: the best paint, read once more with all that is around it."""
    shop, target = descent.workshop, descent.target
    values = np.array([float(f"{value:.{DIGITS}g}") for value in descent.find_values(best.place)])
    values = np.clip(values, *np.transpose([(one.low, one.high) for one in descent.parameters]))
    place = descent.find_place(values)
    near = descent.find_neighbours(place)
    here, *around = shop.read([values, *near])
    film, cost = shop.find_film(values), shop.find_cost(values)
    bent = target.bend(here)
    trial = descent.judge(place, bent)
    difference = target.find_difference(bent)
    rows, columns = [], []
    for index, (point, found) in enumerate(zip(near, around, strict=True)):
        changes = [
            *(found - here),
            target.find_difference(target.bend(found)) - difference,
            shop.find_cost(point) - cost,
        ]
        more = (point[index] - values[index]) / (STEP * (abs(values[index]) or 1.0))
        rows.append(np.array(changes) / more)
        columns.append((target.bend(found) - bent) / (descent.find_place(point)[index] - place[index]))
    walks = [
        (one.rank, descent.find_values(begin), descent.find_values(one.place))
        for begin, one in zip(begins, ends, strict=True)
        if one is not None
    ]
    return Match(
        recipe=list_ingredients(film, densities, solids),
        difference=difference,
        why="" if trial.is_met else explain(descent, trial, np.array(columns).T),
        names=tuple(shop.family.names),
        values=make_readonly(values),
        bounds=make_readonly(np.array([(one.low, one.high) for one in descent.parameters])),
        reached={name: (target.wanted[name], float(one)) for name, one in zip(target.names, here, strict=True)},
        cost=cost,
        cost_unit=shop.prices.describe(film),
        sensitivities=make_readonly(np.array(rows)),
        thickness_um=film.thickness_um,
        wet_thickness_um=None if solids is None else film.thickness_um / solids,
        starts=make_readonly(np.array([pair for _, *pair in sorted(walks, key=lambda one: one[0])])),
        notes=(),
        content=fill_in(shop.family, values),
        folder=shop.family.folder or Path(),
    )


def fill_in(family: SceneFamily, values: Array) -> dict[str, Any]:
    """The content of a file with other numbers: a paint stays one where all of them are its own."""
    if not all(name.startswith("paint.") for name in family.names):
        return family.content_at(values)
    assert isinstance(family.source, Mapping)
    found = copy.deepcopy(dict(family.source))
    for name, value in zip(family.names, values.tolist(), strict=True):
        put(found, split_key(name), value)
    return found


def list_short_names(content: Mapping[str, Any]) -> list[str]:
    """Names of numbers that may stand alone, of a paint."""
    paint = content.get("paint")
    if not isinstance(paint, Mapping):
        return []
    pigment = paint.get("pigment", {})
    rough = ["roughness"] if isinstance(paint.get("surface"), Mapping) else []
    return [*([pigment] if isinstance(pigment, str) else pigment), "thickness_um", *rough]


def make_target(
    lab: Sequence[float] | None,
    contrast_ratio: float | None,
    glosses: Sequence[float | None],
    tolerance: float,
    gloss_tolerance: float,
) -> Target:
    """What is wanted. Raises SceneError for nothing, and for what no paint has."""
    wanted: dict[str, float] = {}
    if lab is not None:
        if len(lab) != 3 or not all(isinstance(one, int | float) and math.isfinite(one) for one in lab):
            raise SceneError.of("lab", f"must be L*, a*, b*, three finite numbers, not {show_value(lab)}")
        check_number("lab", lab[0], 0.0, 120.0, "with L* from 0 to 120")
        wanted = dict(zip("Lab", map(float, lab), strict=True))
    if contrast_ratio is not None:
        allowed = "above 0 and below 1"
        wanted["contrast_ratio"] = check_number("contrast_ratio", contrast_ratio, 1e-6, 1.0 - 1e-6, allowed)
    for name, one in zip(GLOSSES, glosses, strict=True):
        if one is not None:
            wanted[name] = check_number(name, one, DARKEST_GLOSS, 2000.0, "gloss units, from 0.001 to 2000")
    if not wanted:
        raise SceneError("match needs a target: lab, contrast_ratio, gloss_20, gloss_60 or gloss_85")
    check_number("tolerance", tolerance, 1e-3, 100.0, "CIEDE2000 from 0.001 to 100")
    check_number("gloss_tolerance", gloss_tolerance, 1e-2, 1000.0, "gloss units from 0.01 to 1000")
    return Target(wanted, float(tolerance), float(gloss_tolerance))


def read_over(over: str | float | None, content: Mapping[str, Any]) -> float | None:
    """The albedo that a colour is read over, None for the own base. Raises SceneError."""
    paint = content.get("paint")
    has_base = "base" in content or (isinstance(paint, Mapping) and "substrate" in paint)
    if over == OWN_BASE and not has_base:
        words = "and the paint has none: over='black', 'white' or an albedo says what the colour is read over"
        raise SceneError.of("over", f"is 'base', {words}")
    if over is None or over == OWN_BASE:
        return None
    if isinstance(over, str):
        if over not in CARDS:
            raise SceneError.of("over", f"must be 'base', 'black', 'white' or an albedo, not {show_value(over)}")
        return CARDS[over]
    return check_number("over", over, 0.0, 1.0, "an albedo from 0 to 1")


def match_file(
    path: str | os.PathLike[str], scene: str | os.PathLike[str] | None = None, progress: Progress | None = None
) -> Match:
    """The match of a target file (.toml), whose keys are keywords of `vrte.match`; ``scene``: the file of the paint,
    where the target does not name it. Raises SceneError, OSError."""
    table = Table((), parse_toml(read_text(Path(path), LARGEST_FILE)), FILE_KEYS)
    asked = dict(table.content)
    named, folder = asked.pop("paint", None), Path(path).parent
    if (named is None) == (scene is None):
        words = "is named twice, here and as a scene file" if named else "is missing: a scene file or a ready paint"
        raise SceneError.of("paint", words)
    if isinstance(named, str) and named.endswith(".toml"):
        named = folder / named
    table.required("free", "a list of names, or a table of bounds by names")
    return check_arguments(match)(named if scene is None else scene, folder=folder, progress=progress, **asked)
