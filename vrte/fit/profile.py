"""How well a number is known whatever the others are: the profile of chi2 along it, the others fitted anew."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, check_vector, check_whole, settle_array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.fit.problem import Problem, fit_residuals

if TYPE_CHECKING:
    from vrte.fit.result import Fit

REACH = 3.0  # standard deviations to either side
MOST_STEPS = 50  # trials at each value


@dataclass(frozen=True, eq=False, repr=False)
class Profile:
    """The least chi2 at given ``values`` (n,) of one number, all others (n, m) fitted anew; ``low`` and ``high``: where
    chi2 is the least plus 1, infinite where that is not within the values."""

    name: str
    values: Array
    chi2: Array
    others: Array
    low: float
    high: float

    def __repr__(self) -> str:
        return f"Profile({self.name} from {self.low:.6g} to {self.high:.6g} at chi2 + 1, {self.values.size} values)"


def find_profile(fit: "Fit", name: str, values: Any, points: int, progress: Progress | None) -> Profile:
    """The profile of a fit's number. Raises SceneError."""
    problem = fit.find_problem()
    if name not in fit.names:
        raise SceneError.of("name", f"must be one of {', '.join(fit.names)}, not {name!r}")
    place = fit.names.index(name)
    grid = choose_values(problem, fit, place, check_whole("points", points, 3, 1000)) if values is None else values
    grid = np.unique(check_vector("values", grid))
    one = problem.parameters[place]
    if grid[0] < one.low or grid[-1] > one.high:
        raise SceneError.of("values", f"must lie within the bounds {one.low:g} and {one.high:g} of {name}")
    others = np.arange(len(fit.names)) != place
    chi2, found = np.empty(grid.size), np.empty((grid.size, int(others.sum())))
    scale = float((problem.sigma[0] / (fit.sigma[0] * fit.error_scale)) ** 2)
    order = np.argsort(np.abs(grid - fit.values[place]))
    for done, k in enumerate(order.tolist()):  # outward from the best, each from its nearest that is known
        known = order[:done]
        near = known[np.argmin(np.abs(grid[known] - grid[k]))] if done else None
        begin = fit.values.copy()
        begin[place] = grid[k]
        if near is not None:
            begin[others] = found[near]
        point, cost, _ = fit_residuals(problem, problem.find_steps(begin), others, MOST_STEPS)
        found[k], chi2[k] = point[others], cost * scale
        if progress is not None:
            progress(done + 1, grid.size)
    low, high = find_interval(grid, chi2, float(fit.values[place]), fit.chi2 * scale)
    return Profile(name, settle_array(grid), settle_array(chi2), settle_array(found), low, high)


def choose_values(problem: Problem, fit: "Fit", place: int, points: int) -> Array:
    """Values to three standard deviations on either side, within the bounds. Raises SceneError."""
    one, value, error = problem.parameters[place], float(fit.values[place]), float(fit.errors[place])
    if not np.isfinite(error) or error == 0.0:
        raise SceneError(f"{one.name} has no finite error: say the values of its profile", "values")
    low, high = max(value - REACH * error, one.low), min(value + REACH * error, one.high)
    if one.is_log:
        reach = REACH * error / value
        low, high = max(value * np.exp(-reach), one.low), min(value * np.exp(reach), one.high)
        return np.geomspace(low, high, points)
    return np.linspace(low, high, points)


def find_interval(values: Array, chi2: Array, best: float, least: float) -> tuple[float, float]:
    """Where chi2 is 1 above the least, on either side of the best; its root is all but linear there.

    >>> at = np.linspace(-2.0, 2.0, 9)
    >>> find_interval(at, at**2, 0.0, 0.0)
    (-1.0, 1.0)
    """
    rise = np.sqrt(np.maximum(chi2 - min(least, float(chi2.min())), 0.0))
    ends = []
    for side in (-1.0, 1.0):
        there = (values - best) * side > 0.0
        order = np.argsort(np.abs(values[there] - best))
        at, up = np.concatenate([[best], values[there][order]]), np.concatenate([[0.0], rise[there][order]])
        over = np.flatnonzero(up >= 1.0)
        if not over.size:
            ends.append(side * np.inf)
            continue
        k = int(over[0])
        ends.append(float(np.interp(1.0, up[k - 1 : k + 1], at[k - 1 : k + 1])))
    return ends[0], ends[1]
