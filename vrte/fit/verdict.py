"""Whether a fit fits: its p-value, the pattern of its residuals, and in words what may be wrong with the data."""

import math
from collections.abc import Iterator

import numpy as np

from vrte.basics.arrays import Array
from vrte.fit.measurement import COORDINATES, Measurement
from vrte.fit.quantities import LOOK, QUANTITIES

UNLIKELY = 0.01  # chance of residuals as large, or in as few runs, below which a model does not fit
FEW_RUNS = 0.1  # chance below which signs are said to change rarely
NEVER = 1e-16  # chance below which no number is said
NO_NOISE = 0.5, 1e-4  # root mean square of residuals below which their pattern is no matter: in sigmas, of the values
LEAST_PER_CENT, MOST_PER_CENT = 2.0, 150.0  # medians of factors that look like per cent
SERIES = ("quantity", "geometry", "wavelength_um", "theta_i_deg", "phi_deg", "theta_o_deg")  # rows in their order


def find_p_value(chi2: float, freedom: int) -> float:
    """The chance of a sum of squares as large as ``chi2``; NaN without degrees of freedom.

    >>> round(find_p_value(12.59, 6), 3)
    0.05
    """
    from scipy.special import gammaincc

    return float(gammaincc(0.5 * freedom, 0.5 * chi2)) if freedom else math.nan


def count_runs(signs: Array) -> tuple[int, float]:
    """Runs of equal signs in a row (n,) of +-1, and the chance of as few where their order is random.

    Wald and Wolfowitz, Ann. Math. Statist. 11, 147 (1940).

    >>> runs, chance = count_runs(np.array([1, 1, 1, -1, -1, -1]))
    >>> runs, round(chance, 3)
    (2, 0.1)
    """
    from scipy.special import gammaln

    runs, many = 1 + int((signs[1:] != signs[:-1]).sum()), [int((signs == one).sum()) for one in (1, -1)]
    if min(many) == 0:
        return runs, 1.0  # all of one sign: their sum says more of it than their order

    up, down = (float(one - 1) for one in many)
    whole = 0.5 * (gammaln(up + down + 3.0) - gammaln(up + 2.0) - gammaln(down + 2.0))  # log of the root of all orders

    def choose(n: float, k: Array) -> Array:
        log = gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0) - whole
        found: Array = np.where(k <= n, np.exp(np.where(k <= n, log, 0.0)), 0.0)
        return found

    even, odd = (np.arange(1.0, 1.0 + count) for count in (runs // 2, (runs - 1) // 2))  # pairs of runs
    chance = 2.0 * (choose(up, even - 1.0) * choose(down, even - 1.0)).sum()
    chance += (choose(up, odd) * choose(down, odd - 1.0) + choose(up, odd - 1.0) * choose(down, odd)).sum()
    return runs, float(chance)


def tell(chance: float) -> str:
    """A chance in words.

    >>> tell(0.0123), tell(0.0)
    ('0.012', 'less than 1e-16')
    """
    return f"{chance:.2g}" if chance >= NEVER else f"less than {NEVER:g}"


def describe_pattern(given: Measurement, residuals: Array) -> tuple[float, list[str]]:
    """The chance of as few runs of signs of residuals (rows,) along angles and wavelengths; in words, and the worst."""
    columns = [getattr(given, name) for name in SERIES]
    keys = [np.unique(one, return_inverse=True)[1] if one.dtype == object else np.nan_to_num(one) for one in columns]
    runs, chance = count_runs(np.where(residuals[np.lexsort(keys[::-1])] < 0.0, -1, 1))
    worst = int(np.argmax(np.abs(residuals)))
    where = [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name in COORDINATES
        if (value := getattr(given, name)[worst]) == value and value != ""
    ]
    count = f"{runs} run{'s'[: runs > 1]} of one sign in {residuals.size} rows"
    if runs == 1:
        words = f"all rows are {'above' if residuals[0] > 0.0 else 'below'} what the model shows"
    elif chance < FEW_RUNS:
        words = (
            f"residuals change sign rarely along angles and wavelengths ({count}, by chance in {tell(chance)} of fits)"
        )
    else:
        words = f"residuals change sign as chance has it ({count})"
    at = f"{given.quantity[worst]} at {', '.join(where)}" if where else given.quantity[worst]
    return chance, [words, f"row {worst + 1} is farthest off, by {residuals[worst]:+.3g} sigma: {at}"]


def guess_units(given: Measurement) -> Iterator[str]:
    """What looks as if it were in other units than those of its column, in words."""
    angles = np.abs(np.concatenate([given.theta_i_deg, given.theta_o_deg]))
    angles = angles[~np.isnan(angles)]
    if angles.size and 0.0 < angles.max() <= 0.5 * math.pi:
        cosines = angles.min() > 0.0 and angles.max() <= 1.0
        yield (
            f"theta_i_deg and theta_o_deg are {angles.min():g} to {angles.max():g}: these look like "
            f"{'cosines' if cosines else 'radians'}, and degrees are needed"
        )
    for name in given.names:
        known, values = QUANTITIES[name], given.value[given.quantity == name]
        is_factor = known.unit == "1" and known.bounds == (0.0, math.inf) and known.needs != LOOK
        if is_factor and np.median(values) > LEAST_PER_CENT and values.max() <= MOST_PER_CENT:
            yield (
                f"{name} is {values.min():g} to {values.max():g}: this looks like per cent, and the perfect white "
                "diffuser has 1"
            )
