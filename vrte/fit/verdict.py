"""Whether a fit fits, what may be wrong with the data, which numbers the data cannot tell, and how well others are
known: the profile of chi2 along a number, the others fitted anew."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, check_vector, check_whole, make_readonly
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.fit.measurement import COORDINATES, Measurement
from vrte.fit.problem import FitProblem, convert_to_steps, fit_residuals
from vrte.fit.quantities import QUANTITIES

if TYPE_CHECKING:
    from vrte.fit.result import Fit

UNLIKELY = 0.01  # chance of residuals as large, or in as few runs, below which a model does not fit
FEW_RUNS = 0.1  # chance below which signs are said to change rarely
NEVER = 1e-16  # chance below which no number is said
NO_NOISE = 0.5, 1e-4  # root mean square of residuals below which their pattern is no matter: in sigmas, of the values
LEAST_PER_CENT, MOST_PER_CENT = 2.0, 150.0  # medians of factors that look like per cent
# coordinates in whose order rows are looked through
SERIES = ("quantity", "geometry", "base", "wavelength_um", "theta_i_deg", "phi_deg", "theta_o_deg")
ALIKE = 0.99  # of a correlation: beyond, two numbers cannot be told apart
LEAST = 3.0  # of a singular value: below, a third of a number's value is less than one sigma of all data together
NOTICED = 0.1  # sigma of any one row
NAMED = 0.1  # of the largest part of a direction
REACH = 3.0  # standard deviations of a profile to either side
MOST_STEPS = 50  # trials at each value of a profile


def find_p_value(chi2: float, freedom: int) -> float:
    """The chance of a sum of squares as large as ``chi2``; NaN without degrees of freedom."""
    from scipy.special import gammaincc

    return float(gammaincc(0.5 * freedom, 0.5 * chi2)) if freedom else math.nan


def count_runs(signs: Array) -> tuple[int, float]:
    """Runs of equal signs in a row (n,) of +-1, and the chance of as few where their order is random.

    Wald and Wolfowitz, Ann. Math. Statist. 11, 147 (1940).
    """
    from scipy.special import gammaln  # scipy.stats would take a second to load

    def choose(n: int, k: Any) -> Any:
        """Logarithms of binomial coefficients."""
        return gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)

    runs, (up, down) = 1 + int((signs[1:] != signs[:-1]).sum()), [int((signs == one).sum()) for one in (1, -1)]
    if min(up, down) == 0 or signs.size == 2:
        return runs, 1.0  # all of one sign: their sum says more of it than their order
    pairs, odd = np.divmod(np.arange(2, runs + 1), 2)  # of runs, and one more where both ends are of one sign
    ways = [choose(one - 1, pairs - 1 + odd) + choose(other - 1, pairs - 1) for one, other in ((up, down), (down, up))]
    return runs, float(np.exp(np.array(ways) - choose(signs.size, up)).sum())


def write_chance(chance: float) -> str:
    """A chance in words.

    >>> write_chance(0.0123), write_chance(0.0)
    ('0.012', 'less than 1e-16')
    """
    return f"{chance:.2g}" if chance >= NEVER else f"less than {NEVER:g}"


def describe_pattern(given: Measurement, residuals: Array) -> tuple[float, list[str]]:
    """The chance of as few runs of signs of residuals (rows,) along angles and wavelengths; in words, and the worst."""
    columns = [getattr(given, name) for name in SERIES]
    keys = [np.unique(one, return_inverse=True)[1] if one.dtype == object else np.nan_to_num(one) for one in columns]
    runs, chance = count_runs(np.where(residuals[np.lexsort(keys[::-1])] < 0.0, -1, 1))
    worst = int(np.argmax(np.abs(residuals)))
    there = {name: getattr(given, name)[worst] for name in COORDINATES}
    known = {name: value for name, value in there.items() if value == value and value != ""}
    where = [f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}" for name, value in known.items()]
    count = f"{runs} run{'s'[: runs > 1]} of one sign in {residuals.size} rows"
    if runs == 1:
        words = f"all rows are {'above' if residuals[0] > 0.0 else 'below'} what the model shows"
    elif chance < FEW_RUNS:
        rare = f"{count}, by chance in {write_chance(chance)} of fits"
        words = f"residuals change sign rarely along angles and wavelengths ({rare})"
    else:
        words = f"residuals change sign as chance has it ({count})"
    at = f"{given.quantity[worst]} at {', '.join(where)}" if where else given.quantity[worst]
    return chance, [words, f"row {worst + 1} is farthest off, by {residuals[worst]:+.3g} sigma: {at}"]


def guess_units(given: Measurement) -> Iterator[str]:
    """What looks as if it were in other units than those of its column, in words."""
    angles = np.abs(np.concatenate([given.theta_i_deg, given.theta_o_deg]))
    angles = angles[~np.isnan(angles)]
    if angles.size and 0.0 < angles.max() <= 0.5 * math.pi:
        between, cosines = f"{angles.min():g} to {angles.max():g}", angles.min() > 0.0 and angles.max() <= 1.0
        kind = "cosines" if cosines else "radians"
        yield f"theta_i_deg and theta_o_deg are {between}: these look like {kind}, and degrees are needed"
    for name in given.names:
        known, values = QUANTITIES[name], given.value[given.quantity == name]
        is_factor = known.unit == "1" and known.bounds == (0.0, math.inf) and not known.is_over_visible
        if is_factor and np.median(values) > LEAST_PER_CENT and values.max() <= MOST_PER_CENT:
            between = f"{values.min():g} to {values.max():g}"
            yield f"{name} is {between}: this looks like per cent, and the perfect white diffuser has 1"


def find_scales(values: Array, ranges: Array) -> Array:
    """What changes of each number are counted in: its value, or its range where that is 0."""
    ranges = np.where(np.isfinite(ranges), ranges, 1.0)
    return np.where(values == 0.0, ranges, np.abs(values))


def find_covariance(slopes: Array, scales: Array) -> Array:
    """(n, n) from the derivatives (residuals, n) in sigmas; inf along what they do not tell at all."""
    _, singular, ways = np.linalg.svd(slopes * scales, full_matrices=False)
    determined = singular > singular.max(initial=0.0) * slopes.shape[1] * np.finfo(float).eps
    spread = (ways[determined].T / singular[determined] ** 2) @ ways[determined]
    lost = (np.abs(ways[~determined]) > 1e-8).any(axis=0)
    if ways.shape[0] < scales.size:
        lost[:] = True
    spread[lost, lost] = np.inf
    return spread * np.outer(scales, scales)


def find_correlations(covariance: Array) -> Array:
    """(n, n), 1 on the diagonal; NaN where an error is not finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        errors = np.sqrt(np.diag(covariance))
        found = covariance / np.outer(errors, errors)
    found[~np.isfinite(found)] = np.nan
    np.fill_diagonal(found, 1.0)
    return found


def list_alike(names: Sequence[str], correlations: Array) -> list[tuple[str, str, float]]:
    """Pairs of numbers that cannot be told apart, and their correlations."""
    pairs = np.argwhere(np.triu(np.ones(correlations.shape), 1)).tolist()
    return [(names[i], names[j], float(correlations[i, j])) for i, j in pairs if abs(correlations[i, j]) > ALIKE]


def find_blind_spots(names: Sequence[str], slopes: Array, values: Array, scales: Array) -> tuple[Array, list[str]]:
    """Singular values (n,) of the derivatives in sigmas by relative changes, and what they cannot tell in words."""
    scaled = slopes * scales
    _, singular, ways = np.linalg.svd(scaled, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(len(names) - singular.size)])
    found = []
    for size, way in zip(singular.tolist(), ways, strict=True):
        if size >= LEAST:
            continue
        strongest = float(np.abs(scaled @ way).max())
        length = min(NOTICED / strongest, 1.0) if strongest > 0.0 else 1.0
        found.append(describe_way(names, way * length, values, scales))
    return singular, found


def describe_way(names: Sequence[str], way: Array, values: Array, scales: Array) -> str:
    """A direction that the data do not see, in words."""
    parts = []
    first = int(np.flatnonzero(np.abs(way) >= NAMED * np.abs(way).max())[0])
    sign = 1.0 if way[first] > 0.0 else -1.0
    for name, part, value, scale in zip(names, sign * way, values, scales, strict=True):
        if abs(part) < NAMED * np.abs(way).max():
            continue
        much = f"{100.0 * abs(part):.2g} %" if value != 0.0 else f"by {abs(part) * scale:.2g}"
        parts.append(f"{name} {'up' if part > 0.0 else 'down'} {much}")
    return f"{' with '.join(parts)} changes no row by more than {NOTICED:g} sigma"


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
    index = fit.names.index(name)
    grid = choose_values(problem, fit, index, check_whole("points", points, 3, 1000)) if values is None else values
    grid = np.unique(check_vector("values", grid))
    one = problem.parameters[index]
    if grid[0] < one.low or grid[-1] > one.high:
        raise SceneError.of("values", f"must lie within the bounds {one.low:g} and {one.high:g} of {name}")
    others = np.arange(len(fit.names)) != index
    chi2, found = np.empty(grid.size), np.empty((grid.size, int(others.sum())))
    scale = float((problem.sigma[0] / (fit.sigma[0] * fit.error_scale)) ** 2)
    order = np.argsort(np.abs(grid - fit.values[index]))
    for done, k in enumerate(order.tolist()):  # outward from the best, each from its nearest that is known
        known = order[:done]
        near = known[np.argmin(np.abs(grid[known] - grid[k]))] if done else None
        begin = fit.values.copy()
        begin[index] = grid[k]
        if near is not None:
            begin[others] = found[near]
        point, cost, _ = fit_residuals(problem, convert_to_steps(problem.parameters, begin), others, MOST_STEPS)
        found[k], chi2[k] = point.values[others], cost * scale
        if progress is not None:
            progress(done + 1, grid.size)
    low, high = find_interval(grid, chi2, float(fit.values[index]), fit.chi2 * scale)
    return Profile(name, make_readonly(grid), make_readonly(chi2), make_readonly(found), low, high)


def choose_values(problem: FitProblem, fit: "Fit", index: int, points: int) -> Array:
    """Values to three standard deviations on either side, within the bounds. Raises SceneError."""
    one, value, error = problem.parameters[index], float(fit.values[index]), float(fit.errors[index])
    if not np.isfinite(error) or error == 0.0:
        raise SceneError(f"{one.name} has no finite error: say the values of its profile", "values")
    low, high = max(value - REACH * error, one.low), min(value + REACH * error, one.high)
    if one.is_log:
        reach = REACH * error / value
        low, high = max(value * np.exp(-reach), one.low), min(value * np.exp(reach), one.high)
        return np.geomspace(low, high, points)
    return np.linspace(low, high, points)


def find_interval(values: Array, chi2: Array, best: float, least: float) -> tuple[float, float]:
    """Where chi2 is 1 above the least, on either side of the best; its root is all but linear there."""
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
