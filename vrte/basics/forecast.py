"""What will take long is said before it starts, and refused beyond a limit."""

import math
import warnings

from vrte.basics.errors import LongSolveWarning, SceneError

LONG = 20.0  # seconds that are told


def foretell(seconds: float, limit: float, why: str, change: str, told: bool = False) -> None:
    """Says what will take long, unless that was ``told``. Raises SceneError beyond the limit in seconds."""
    if seconds <= min(LONG, limit):
        return
    said = f"this will take about {in_words(seconds)}{why}; {change}"
    if seconds > limit:
        raise SceneError(f"{said}, or go on with time_limit_s above its {in_words(limit)} (math.inf for no limit)")
    if not told:
        warnings.warn(said, LongSolveWarning, stacklevel=2)


def in_words(seconds: float) -> str:
    """A time that is only roughly known.

    >>> in_words(24.0), in_words(200.0), in_words(7200.0), in_words(1e6)
    ('24 s', '3 min', '2.0 h', '11.6 days')
    """
    if seconds < 100.0 or not math.isfinite(seconds):
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.3g} days"
