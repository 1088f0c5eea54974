"""The numbers of a scene that a fit may change: where each starts, its bounds, and what is known of it beforehand."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, show_value
from vrte.basics.errors import SceneError
from vrte.formats.toml_table import is_number

KEYS = ("start", "low", "high", "spacing")
SPACINGS = ("linear", "log")
SHARES = ("albedo", "volume_fraction", "core_ratio", "share", "number_fraction")  # last words of keys from 0 to 1


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
            raise SceneError(
                f"free: {self.name} starts at {self.start:g}, outside its bounds {self.low:g} and {self.high:g}", "free"
            )
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


def read_parameters(
    free: Sequence[str] | Mapping[str, Any],
    bounds: Mapping[str, Any] | None,
    starts: Mapping[str, float],
    allowed: Mapping[str, tuple[float, float]],
) -> tuple[Parameter, ...]:
    """The free numbers; ``starts``: what the scene has, ``allowed``: what it takes. Raises SceneError."""
    given = dict(free) if isinstance(free, Mapping) else {name: {} for name in free}
    limits = dict(bounds or {})
    unknown = [name for name in limits if name not in given]
    if unknown:
        raise SceneError(f"bounds: {unknown[0]} is not free", "bounds")
    found = []
    for name, told in given.items():
        told = {} if told is None else {"start": told} if is_number(told) else told
        if not isinstance(told, Mapping) or any(key not in KEYS for key in told):
            raise SceneError(f"free: {name} takes a table of {', '.join(KEYS)}, not {show_value(told)}", "free")
        pair = limits.get(name, (told.get("low"), told.get("high")))
        if name in limits and ("low" in told or "high" in told):
            raise SceneError(f"free: {name} has bounds twice, in free and in bounds", "bounds")
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise SceneError(f"bounds: {name} needs two numbers, low and high, not {show_value(pair)}", "bounds")
        start = read_number(name, "start", told.get("start", starts[name]))
        usual = allowed.get(name) or find_usual_bounds(name, start)
        low, high = (
            usual[place] if one is None else read_number(name, KEYS[1 + place], one) for place, one in enumerate(pair)
        )
        spacing = told.get("spacing", "linear")
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
            raise SceneError(
                f"priors: {name} needs a finite mean and a standard deviation above 0, not {mean:g} and {sigma:g}",
                "priors",
            )
        found[list(names).index(name)] = mean, sigma
    return found
