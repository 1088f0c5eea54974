"""Residuals of a model over a measurement, as least squares take them: coordinates in, numbers of sigmas out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.basics.errors import AccuracyError, SceneError
from vrte.fit.model import Model
from vrte.fit.parameters import Parameter

KEPT = 4  # points whose solves are remembered
LOSSES = ("linear", "soft_l1")
ENOUGH = 1e-7  # relative change of the sum, or of the coordinates, that ends a descent


@dataclass(frozen=True, eq=False)
class Point:
    """What is known at one set of values: what the model shows (rows,), and its derivatives (rows, n) or None."""

    values: Array
    predicted: Array
    slopes: Array | None


@dataclass(eq=False)
class Problem:
    """A measurement, a model, its free numbers, priors (n, 2), and the sigmas (rows,) that count.

    ``loss``: what is made least of residuals, one of LOSSES.
    """

    model: Model
    parameters: Sequence[Parameter]
    priors: Array
    sigma: Array
    loss: str = "linear"
    _kept: dict[bytes, Point] = field(default_factory=dict)

    @property
    def known(self) -> Array:
        """Which free numbers have a prior (n,)."""
        return ~np.isnan(self.priors[:, 0])

    def find_values(self, steps: Array) -> Array:
        """Numbers of the scene at coordinates."""
        pairs = zip(self.parameters, steps.tolist(), strict=True)
        return np.array([one.convert_to_value(step) for one, step in pairs])

    def find_steps(self, values: Array) -> Array:
        """Coordinates of numbers of the scene."""
        pairs = zip(self.parameters, values.tolist(), strict=True)
        return np.array([one.convert_to_step(value) for one, value in pairs])

    def find_point(self, values: Array, with_slopes: bool) -> Point:
        """What the model shows there, remembered. Raises SceneError, AccuracyError."""
        key = values.tobytes()
        found = self._kept.get(key)
        if found is None or (with_slopes and found.slopes is None):
            if with_slopes or self.model.slopes_come_along:
                found = Point(values, *self.model.linearize(values))
            else:
                found = Point(values, self.model.predict(values), None)
            self._kept.pop(key, None)
            self._kept[key] = found
            while len(self._kept) > KEPT:
                self._kept.pop(next(iter(self._kept)))
        return found

    def forget(self) -> None:
        """Drops what is remembered: the model has changed."""
        self._kept.clear()

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

    def find_residuals(self, steps: Array) -> Array:
        """At coordinates; NaN where the model takes no such values, so that steps become shorter."""
        try:
            return self.join(self.find_point(self.find_values(steps), False))
        except (SceneError, AccuracyError):
            return np.full(self.sigma.size + int(self.known.sum()), np.nan)

    def find_slopes(self, steps: Array) -> Array:
        """Derivatives of residuals by coordinates."""
        values = self.find_values(steps)
        scale = [one.find_slope(value) for one, value in zip(self.parameters, values.tolist(), strict=True)]
        return self.join_slopes(self.find_point(values, True)) * np.array(scale)


def fit_residuals(
    problem: Problem,
    begin: Array,
    free: BoolArray,
    most_steps: int,
    tell: Callable[[Point], None] | None = None,
) -> tuple[Array, float, bool]:
    """Least squares from coordinates (n,), of which some are ``free`` (n,).

    Values at the end (n,), the sum there, and whether it converged; ``tell``: called with each point that a step has
    come to. Raises SceneError where the model takes no such start.
    """
    from scipy.optimize import least_squares

    def complete(steps: Array) -> Array:
        whole = begin.copy()
        whole[free] = steps
        return whole

    def find_residuals(steps: Array) -> Array:
        return problem.find_residuals(complete(steps))

    def find_slopes(steps: Array) -> Array:
        slopes = problem.find_slopes(complete(steps))
        if tell is not None:
            tell(problem.find_point(problem.find_values(complete(steps)), True))
        return slopes[:, free]

    start = problem.find_point(problem.find_values(begin), bool(free.any()))  # its errors are not to be swallowed
    if not free.any():
        return start.values, problem.measure(problem.join(start)), True
    pairs = zip(problem.parameters, free, strict=True)
    ends = np.array([[one.convert_to_step(end) for end in (one.low, one.high)] for one, is_free in pairs if is_free])
    inside = np.clip(begin[free], np.nextafter(ends[:, 0], np.inf), np.nextafter(ends[:, 1], -np.inf))
    found = least_squares(
        find_residuals,
        inside,
        find_slopes,
        (ends[:, 0], ends[:, 1]),
        x_scale="jac",
        loss=problem.loss,  # type: ignore[arg-type]  # one of LOSSES
        ftol=ENOUGH,
        xtol=ENOUGH,
        gtol=ENOUGH,
        max_nfev=most_steps,
    )
    return problem.find_values(complete(found.x)), 2.0 * float(found.cost), found.status > 0


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
