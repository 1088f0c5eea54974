"""The free numbers of a scene, with bounds and priors, and the residuals of a model as least squares take them."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray, put_in_one_line, show_value
from vrte.basics.errors import AccuracyError, SceneError
from vrte.fit.model import Model
from vrte.formats.toml_table import is_number

KEYS = ("start", "low", "high", "spacing")
SPACINGS = ("linear", "log")
SHARES = ("albedo", "volume_fraction", "core_ratio", "share", "number_fraction")  # last words of keys from 0 to 1
KEPT = 4  # points whose solves are remembered
LOSSES = ("linear", "soft_l1")
JACOBIANS = ("exact", "differences")
MOST_STARTS = 1000
NEAR_A_BOUND = 1e-4  # of the range, or of the start
SURPRISE = 1.5  # change of residuals that derivatives did not predict over what they did: beyond, they are found anew
ENOUGH = 1e-7  # relative change of the sum, or of the coordinates, that ends a descent


@dataclass(frozen=True)
class Parameter:
    """A free number: ``low`` and ``high`` bound it, inf where nothing does; ``is_log``: steps are in its logarithm."""

    name: str
    start: float
    low: float
    high: float
    is_log: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise SceneError(f"free: {self.name} needs low below high, not {self.low:g} and {self.high:g}", "free")
        if not self.low <= self.start <= self.high:
            bounds = f"outside its bounds {self.low:g} and {self.high:g}"
            raise SceneError(f"free: {self.name} starts at {self.start:g}, {bounds}", "free")
        if self.is_log and not (self.low >= 0.0 and self.start > 0.0):
            raise SceneError(f"free: {self.name} with spacing 'log' needs a start above 0 and no low below 0", "free")

    def convert_to_step(self, value: float) -> float:
        """The coordinate in which steps are made."""
        return (math.log(value) if value > 0.0 else -math.inf) if self.is_log else value

    def convert_to_value(self, step: float) -> float:
        """The number of the scene at a coordinate; never beyond the bounds by rounding."""
        return min(max(math.exp(step), self.low), self.high) if self.is_log else step

    def find_slope(self, value: float) -> float:
        """How the number changes with its coordinate."""
        return value if self.is_log else 1.0

    def find_side(self, value: float) -> tuple[float, str]:
        """1 and words at the upper bound, -1 and words at the lower one, 0 and "" between."""
        span = self.high - self.low
        near = NEAR_A_BOUND * (span if math.isfinite(span) else abs(self.start))
        for side, words, end in ((1.0, "upper", self.high), (-1.0, "lower", self.low)):
            if abs(value - end) <= near:
                return side, f"its {words} bound {end:.4g}"
        return 0.0, ""


def convert_to_steps(parameters: Sequence[Parameter], values: Iterable[float]) -> Array:
    """Coordinates (n,) of numbers of the scene."""
    return np.array([one.convert_to_step(float(value)) for one, value in zip(parameters, values, strict=True)])


def convert_to_values(parameters: Sequence[Parameter], steps: Iterable[float]) -> Array:
    """Numbers of the scene (n,) at coordinates."""
    return np.array([one.convert_to_value(float(step)) for one, step in zip(parameters, steps, strict=True)])


def list_ends(parameters: Sequence[Parameter]) -> Array:
    """The bounds in coordinates, (n, 2)."""
    return np.array([[one.convert_to_step(end) for end in (one.low, one.high)] for one in parameters])


def read_parameters(
    free: Sequence[str] | Mapping[str, Any],
    bounds: Mapping[str, Any] | None,
    starts: Mapping[str, float],
    allowed: Mapping[str, tuple[float, float]],
    is_search: bool = False,
) -> tuple[Parameter, ...]:
    """The free numbers; ``starts``: what the scene has, ``allowed``: what it takes. ``is_search``: what the scene has
    is moved to the bounds, and steps are in logarithms where the lower one is above 0. Raises SceneError."""
    given = dict(free) if isinstance(free, Mapping) else {name: {} for name in free}
    limits = dict(bounds or {})
    unknown = [name for name in limits if name not in given]
    if unknown:
        raise SceneError(f"bounds: {unknown[0]} is not free", "bounds")
    found = []
    for name, entry in given.items():
        entry = {} if entry is None else {"start": entry} if is_number(entry) and not is_search else entry
        if isinstance(entry, Sequence) and not isinstance(entry, str) and len(entry) == 2:
            entry = dict(zip(("low", "high"), entry, strict=True))
        if not isinstance(entry, Mapping) or any(key not in KEYS for key in entry):
            words = f"takes its bounds, [low, high], or a table of {', '.join(KEYS)}, not {show_value(entry)}"
            raise SceneError(f"free: {put_in_one_line(name)} {words}", "free")
        pair = limits.get(name, (entry.get("low"), entry.get("high")))
        if name in limits and ("low" in entry or "high" in entry):
            raise SceneError(f"free: {name} has bounds twice, in free and in bounds", "bounds")
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise SceneError(f"bounds: {name} needs two numbers, low and high, not {show_value(pair)}", "bounds")
        start = read_number(name, "start", entry.get("start", starts[name]))
        usual = allowed.get(name) or find_usual_bounds(name, start)
        low, high = (
            usual[index] if one is None else read_number(name, KEYS[1 + index], one) for index, one in enumerate(pair)
        )
        if is_search and "start" not in entry and low < high:
            start = min(max(start, low), high)
        spacing = entry.get("spacing", "log" if is_search and low > 0.0 else "linear")
        if spacing not in SPACINGS:
            raise SceneError(f"free: {name} has spacing 'linear' or 'log', not {show_value(spacing)}", "free")
        found.append(Parameter(name, start, low, high, spacing == "log"))
    return tuple(found)


def read_number(name: str, key: str, value: Any) -> float:
    """A number of a free one's table; inf passes as a bound. Raises SceneError."""
    number = float(value) if isinstance(value, np.generic) or is_number(value) else math.nan
    if math.isnan(number) or (key == "start" and math.isinf(number)):
        raise SceneError(f"free: {name} needs a number as {key}, not {show_value(value)}", "free")
    return number


def find_usual_bounds(name: str, start: float) -> tuple[float, float]:
    """Bounds where none are given: shares lie between 0 and 1, what starts above 0 stays there.

    >>> find_usual_bounds("layer[1].albedo", 0.9), find_usual_bounds("layer[1].thickness", 2.0)
    ((0.0, 1.0), (0.0, inf))
    """
    if name.rpartition(".")[2].partition("[")[0] in SHARES or ".particles." in name:
        return 0.0, 1.0
    return (0.0, math.inf) if start >= 0.0 else (-math.inf, math.inf)


def read_priors(priors: Mapping[str, Any] | None, names: Sequence[str]) -> Array:
    """Means and standard deviations (n, 2) known beforehand, NaN where nothing is. Raises SceneError."""
    found = np.full((len(names), 2), np.nan)
    for name, pair in (priors or {}).items():
        if name not in names:
            raise SceneError(f"priors: {name} is not free", "priors")
        right = isinstance(pair, Sequence | np.ndarray) and len(pair) == 2
        if not right or not all(isinstance(one, np.generic) or is_number(one) for one in pair):
            raise SceneError(f"priors: {name} needs a mean and a standard deviation, not {show_value(pair)}", "priors")
        mean, sigma = (float(one) for one in pair)
        if not math.isfinite(mean) or not 0.0 < sigma < math.inf:
            words = f"needs a finite mean and a standard deviation above 0, not {mean:g} and {sigma:g}"
            raise SceneError(f"priors: {name} {words}", "priors")
        found[list(names).index(name)] = mean, sigma
    return found


@dataclass(frozen=True, eq=False)
class Point:
    """What is known at one set of values: what the model shows (rows,), and its derivatives (rows, n) or None."""

    values: Array
    predicted: Array
    slopes: Array | None


@dataclass(eq=False)
class FitProblem:
    """A measurement and its model, the free numbers, priors (n, 2), the sigmas (rows,) that count, and which of LOSSES
    is minimized."""

    model: Model
    parameters: Sequence[Parameter]
    priors: Array
    sigma: Array
    loss: str = "linear"
    kept: dict[bytes, Point] = field(default_factory=dict)

    @property
    def known(self) -> Array:
        """Which free numbers have a prior (n,)."""
        return ~np.isnan(self.priors[:, 0])

    def find_point(self, values: Array, with_slopes: bool) -> Point:
        """What the model shows there, remembered. Raises SceneError, AccuracyError."""
        key = values.tobytes()
        found = self.kept.get(key)
        if found is None or (with_slopes and found.slopes is None):
            if with_slopes:
                found = Point(values, *self.model.linearize(values))
            else:
                found = Point(values, self.model.predict(values), None)
            self.kept.pop(key, None)
            self.kept[key] = found
            while len(self.kept) > KEPT:
                self.kept.pop(next(iter(self.kept)))
        return found

    def join(self, point: Point) -> Array:
        """Residuals in sigmas of rows and of priors."""
        mean, sigma = self.priors[self.known].T
        rows = (point.predicted - self.model.measurement.value) / self.sigma
        return np.concatenate([rows, (point.values[self.known] - mean) / sigma])

    def join_slopes(self, point: Point) -> Array:
        """Their derivatives by the numbers of the scene."""
        assert point.slopes is not None
        priors = np.diag(1.0 / np.where(self.known, self.priors[:, 1], 1.0))[self.known]
        return np.concatenate([point.slopes / self.sigma[:, None], priors])

    def measure(self, residuals: Array) -> float:
        """The sum that is made least."""
        square = residuals**2
        return float(square.sum() if self.loss == "linear" else (2.0 * (np.sqrt(1.0 + square) - 1.0)).sum())

    def find_residuals(self, values: Array) -> Array:
        """At numbers of the scene; NaN where the model takes no such values, so that steps become shorter."""
        try:
            return self.join(self.find_point(values, False))
        except (SceneError, AccuracyError):
            return np.full(self.sigma.size + int(self.known.sum()), np.nan)

    def find_slopes(self, point: Point) -> Array:
        """Derivatives of residuals by coordinates."""
        pairs = zip(self.parameters, point.values.tolist(), strict=True)
        return self.join_slopes(point) * np.array([one.find_slope(value) for one, value in pairs])


class StaleSlopesError(Exception):
    """A trial did not lower the sum, by slopes that are updates."""


class Descent:
    """A walk to the least sum over the ``free`` coordinates, the others as in ``begin``, from ``x``. Derivatives are
    those of the model there, then updated from step to step by what residuals changed (Broyden) where they had nearly
    foreseen it: a trial is a solve without derivatives. ``x`` and ``point`` become the last step's; ``report`` gets the
    point of each."""

    def __init__(
        self, problem: FitProblem, begin: Array, free: BoolArray, x: Array, report: Callable[[Point], None] | None
    ) -> None:
        self.problem, self.begin, self.free, self.x, self.report = problem, begin, free, x, report
        self.trials, self.updates = 0, 0
        self.point = problem.find_point(self.find_values(x), True)
        self.slopes, self.residuals = problem.find_slopes(self.point)[:, free], problem.join(self.point)
        self.cost = problem.measure(self.residuals)

    def find_values(self, x: Array) -> Array:
        """Numbers of the scene at coordinates."""
        steps = self.begin.copy()
        steps[self.free] = x
        return convert_to_values(self.problem.parameters, steps)

    def find_residuals(self, x: Array) -> Array:
        """Of a trial. Raises StaleSlopesError."""
        self.trials += 1
        found = self.problem.find_residuals(self.find_values(x))
        if self.updates and not self.problem.measure(found) <= self.cost:
            raise StaleSlopesError
        return found

    def find_slopes(self, x: Array) -> Array:
        """Where a step has led: the least change of derivatives, each by its own size, that explains the residuals."""
        step = x - self.x
        if step.any():
            values = self.find_values(x)
            self.point = self.problem.find_point(values, False)
            residuals, predicted = self.problem.join(self.point), self.slopes @ step
            surprise = residuals - self.residuals - predicted
            weights = (self.slopes**2).sum(axis=0) * step
            if np.linalg.norm(surprise) > SURPRISE * np.linalg.norm(predicted):
                self.point, self.updates = self.problem.find_point(values, True), 0
                self.slopes = self.problem.find_slopes(self.point)[:, self.free]
            elif weights @ step > 0.0:
                self.slopes, self.updates = (
                    self.slopes + np.outer(surprise, weights / (weights @ step)),
                    self.updates + 1,
                )
            self.x, self.residuals, self.cost = x.copy(), residuals, self.problem.measure(residuals)
            if self.report is not None:
                self.report(self.point)
        return self.slopes.copy()  # a robust loss scales them in place


def fit_residuals(
    problem: FitProblem, begin: Array, free: BoolArray, most_steps: int, report: Callable[[Point], None] | None = None
) -> tuple[Point, float, bool]:
    """The point of least squares from coordinates ``begin`` (n,), of which some are ``free`` (n,), the sum there, and
    whether it converged: a descent by the model's own derivatives there finds nothing less. Where it did, the point has
    these; ``report`` gets each point of a step."""
    from scipy.optimize import least_squares

    values = convert_to_values(problem.parameters, begin)
    start = problem.find_point(values, bool(free.any()))  # its errors are not to be swallowed
    if not free.any():
        return start, problem.measure(problem.join(start)), True
    if report is not None:
        report(start)
    ends = list_ends(problem.parameters)[free]
    x = np.clip(begin[free], np.nextafter(ends[:, 0], np.inf), np.nextafter(ends[:, 1], -np.inf))
    how: dict[str, Any] = {"x_scale": "jac", "loss": problem.loss}
    how |= dict.fromkeys(("ftol", "xtol", "gtol"), ENOUGH)
    while True:
        descent = Descent(problem, begin, free, x, report)
        first, before, ended = descent.point, descent.cost, False
        how["max_nfev"] = most_steps
        with suppress(StaleSlopesError):
            found = least_squares(descent.find_residuals, x, descent.find_slopes, (ends[:, 0], ends[:, 1]), **how)
            ended = found.status > 0
        x, most_steps = descent.x, most_steps - descent.trials
        if ended and before - descent.cost <= ENOUGH * before:
            return first, before, True
        if most_steps < 1:
            return descent.point, descent.cost, False


def choose_sigma(model: Model) -> Array:
    """The sigmas of a measurement; where it has none, the root mean square of each quantity's values."""
    given = model.measurement
    if given.has_sigma:
        return np.asarray(given.sigma)
    found = np.empty(len(given))
    for name in given.names:
        rows = given.quantity == name
        found[rows] = np.sqrt(np.mean(given.value[rows] ** 2)) or 1.0
    return found
