"""Wall times of solves, in total and step by step, the configurations taking turns; exponents of their growth."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.cost.axes import MU0, PHI, Axis, Point, make_cosines
from bench.tables.configurations import Configuration as Papers
from bench.tables.paper import IN_RECONSTRUCTION, TOTAL
from bench.timing import Tick, count_fitting_rounds
from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance

REST = "outside the steps"
BEFORE = "planning", "choice of nodes"  # stages that a solve's own seconds do not count
FEWEST_ROUNDS, MOST_ROUNDS = 3, 15
SECONDS_A_POINT = 1.5  # of all configurations and rounds together, where 3 rounds fit in
SECONDS_A_POINT_QUICK = 0.1
PAPERS = (Papers.TWO, Papers.FIVE)  # that the paper's figures show; all by its own method, modes
FEWEST_POINTS = 3  # of a fit: two leave nothing to tell the uncertainty from


@dataclass(frozen=True)
class Configuration:
    """A way to run the solver: its name, and what `radiance` and `brdf` are told."""

    name: str
    options: dict[str, Any]


@dataclass(frozen=True)
class Measurement:
    """One solve: wall ``seconds`` in total and of each stage of the solver, by the names in its diagnostics.

    ``orders_solved`` counts the Fourier orders with multiple scattering.
    """

    axis: str
    value: float
    point: Point
    configuration: str
    round: int
    seconds: float
    orders_solved: int
    stages: dict[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> dict[str, float]:
        """Seconds of the total, of each step (a stage that is no step of the paper's is one by its own name), and of
        what no stage accounts for.

        >>> Measurement("nodes", 8.0, Point(), "", 0, 4.0, 1, {"fourier sum": 1.0, "reconstruction": 2.0}).steps
        {'total': 4.0, 'reconstruction': 3.0, 'outside the steps': 1.0}
        """
        found = {TOTAL: self.seconds}
        for stage, seconds in self.stages.items():
            step = IN_RECONSTRUCTION.get(stage, stage)
            found[step] = found.get(step, 0.0) + seconds
        return found | {REST: max(0.0, self.seconds - sum(self.stages.values()))}


def list_configurations(threads: int = 2) -> tuple[Configuration, ...]:
    """The paper's 2 and, where there is an OpenCL device, 5; OpenMP if more than one of its ``threads`` is asked for.

    Raises SceneError where the compiled core has no OpenMP but more threads are asked for.

    >>> [configuration.name for configuration in list_configurations(1)][:1]
    ['configuration 2']
    """
    if threads > 1 and not _core.HAS_OPENMP:
        raise SceneError("the compiled core was built without OpenMP: only --threads 1 can be measured")
    found = [Configuration(each.title, each.options(1)) for each in PAPERS if each.refusal() is None]
    if threads > 1:
        found.append(Configuration(f"OpenMP, {threads} threads", Papers.OPENMP_FULL.options(threads)))
    return tuple(found)


def explain_missing_configurations() -> list[str]:
    """Why one of the paper's is not among them."""
    return [reason for each in PAPERS if (reason := each.refusal()) is not None]


def solve(point: Point, configuration: Configuration) -> dict[str, Any]:
    """Solves and returns the diagnostics. The one call of the solver."""
    common: dict[str, Any] = {"phi": PHI, "nodes": point.nodes, **configuration.options}
    out = make_cosines(point.outgoing)
    if point.incident is None:
        return radiance(point.scene, mu0=MU0, mu=out, **common).diagnostics
    return brdf(point.scene, mu_i=make_cosines(point.incident), mu_o=out, **common).diagnostics


def measure(
    axes: Sequence[Axis],
    configurations: Sequence[Configuration],
    seconds_a_point: float = SECONDS_A_POINT,
    tick: Tick = lambda done, total, name: None,
) -> list[Measurement]:
    """Every point of every axis in one round after another, the configurations in turn: 3 rounds, and up to 15 of
    points that take less than ``seconds_a_point`` in all.

    Whole rounds, so that a disturbance meets a round of many points and not all rounds of one. ``tick(done, total,
    name)`` before each point. One solve of each configuration beforehand is not counted.
    """
    places = [(axis, point) for axis in axes for point in axis.points]
    for configuration in configurations:
        solve(places[0][1], configuration)
    wanted = [FEWEST_ROUNDS] * len(places)
    found: list[Measurement] = []
    done = 0
    for number in range(MOST_ROUNDS):
        for place, (axis, point) in enumerate(places):
            if number >= wanted[place]:
                continue
            tick(done, sum(wanted), f"{axis.name} {axis.value(point):g}")
            start = time.perf_counter()
            found += [measure_point(axis, point, configuration, number) for configuration in configurations]
            if number == 0:
                first = time.perf_counter() - start
                wanted[place] = count_fitting_rounds(first, seconds_a_point, FEWEST_ROUNDS, MOST_ROUNDS)
            done += 1
    tick(done, done, "")
    return found


def measure_point(axis: Axis, point: Point, configuration: Configuration, number: int) -> Measurement:
    """One solve, timed by its own diagnostics."""
    made = solve(point, configuration)
    stages = {name: clock["wall_seconds"] for name, clock in made["stages"].items()}
    before = sum(stages.get(name, 0.0) for name in BEFORE)  # of a clock that starts with the orders
    told = made["wall_seconds"] + before, made["orders"], stages
    return Measurement(axis.name, axis.value(point), point, configuration.name, number, *told)


@dataclass(frozen=True)
class Fit:
    """t = c x^p: ``exponent`` p with its standard error, ``factor`` c [s], and the range of x it is from.

    The error is that of the scatter about the straight line, so it holds curvature as well as noise.
    """

    exponent: float
    error: float
    factor: float
    lowest: float
    highest: float
    points: int

    def __str__(self) -> str:
        return f"{self.exponent:z.2f} ± {self.error:.2f}"

    def at(self, x: Any) -> Any:
        """Seconds on the fitted line."""
        return self.factor * np.asarray(x, dtype=np.float64) ** self.exponent


def fit_exponent(x: Any, seconds: Any) -> Fit | None:
    """Least squares of log t against log x, through the points with x > 0 and a time above 0; None of fewer than 3, or
    of one x alone.

    >>> str(fit_exponent([1, 2, 4], [0.5, 4.0, 32.0]))
    '3.00 ± 0.00'
    """
    x, seconds = np.asarray(x, dtype=np.float64), np.asarray(seconds, dtype=np.float64)
    there = (x > 0.0) & (seconds > 0.0)
    x, seconds = x[there], seconds[there]
    if x.size < FEWEST_POINTS or np.ptp(x) == 0.0:
        return None
    along, up = np.log(x), np.log(seconds)
    from_mean = along - along.mean()
    spread = float(from_mean @ from_mean)
    exponent = float(from_mean @ up) / spread
    intercept = float(up.mean() - exponent * along.mean())
    residual = up - (intercept + exponent * along)
    error = math.sqrt(float(residual @ residual) / (x.size - 2) / spread)
    return Fit(exponent, error, math.exp(intercept), float(x.min()), float(x.max()), int(x.size))


def mark_upper_half(x: Array) -> Array:
    """Which points lie in the upper half of the axis, on a logarithmic scale: (points,) of bool.

    There a constant cost weighs least, so the exponent is nearest to that of the term that grows.

    >>> mark_upper_half(np.array([1.0, 4.0, 16.0])).tolist()
    [False, True, True]
    """
    return np.asarray(x >= math.sqrt(float(x.min()) * float(x.max())) * (1.0 - 1e-12))


@dataclass(frozen=True, eq=False)
class Series:
    """Of one step in one configuration, along an axis: x, and median, least and greatest seconds, (points,) each."""

    x: Array
    seconds: Array
    least: Array
    greatest: Array

    def exponent(self, part: Array | slice = slice(None)) -> str:
        """Of the points chosen, with its standard error; a dash where there is no fit."""
        return str(fit_exponent(self.x[part], self.seconds[part]) or "-")


def collect_series(measurements: Sequence[Measurement], axis: str, configuration: str) -> dict[str, Series]:
    """Every step's, the total first, what is outside the steps last; 0 seconds where a step did not run."""
    by_value: dict[float, list[dict[str, float]]] = {}
    for found in measurements:
        if (found.axis, found.configuration) == (axis, configuration):
            by_value.setdefault(found.value, []).append(found.steps)
    names = list(dict.fromkeys(name for solves in by_value.values() for solve in solves for name in solve))
    names.sort(key=lambda name: (name != TOTAL, name == REST))
    x = np.array(sorted(by_value))
    result = {}
    for name in names:
        times = [[solve.get(name, 0.0) for solve in by_value[value]] for value in x.tolist()]
        result[name] = Series(x, *(np.array([of(row) for row in times]) for of in (np.median, np.min, np.max)))
    return result
