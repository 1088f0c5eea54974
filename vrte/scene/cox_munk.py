"""Cox and Munk's sea: facets whose slopes follow from the wind."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

from vrte.basics.arrays import check_number
from vrte.basics.errors import FittedRangeWarning, warn_user
from vrte.scene.facets import Facets

CALM, BY_WIND = 0.003, 0.00512  # mean square slope, and how it grows with the wind [s/m]
MEASURED, MOST_WIND = 14.0, 40.0  # wind [m/s]: up to which slopes were measured, and are extrapolated


def cox_munk(wind: float, index: Annotated[Any, complex | Sequence[float]] = 1.34, shadowing: bool = False) -> Facets:
    """A rough sea by the speed of the wind, with Fresnel's reflection off every wave; reciprocal and polarizing.

    The mean square slope is 0.003 + 0.00512 wind, the same in all directions. What the water itself sends back, and
    foam, are not in it.

    Parameters
    ----------
    wind : float
        Its speed 12.5 m above the sea [m/s], 0 to 40; measured up to 14, a FittedRangeWarning above.
    index : float, complex or (n, k), optional
        Refractive index of water, n + ik.
    shadowing : bool, optional
        Whether waves hide each other; without, as published, they make light near the horizon.

    Returns
    -------
    Facets
        The base, with the roughness alpha = sqrt(0.003 + 0.00512 wind).

    Raises
    ------
    SceneError
        Naming the argument.

    References
    ----------
    Cox and Munk, J. Opt. Soc. Am. 44, 838 (1954).

    Examples
    --------
    >>> import vrte
    >>> round(vrte.cox_munk(7.0).roughness ** 2, 12)
    0.03884
    """
    wind = check_number("base: wind", wind, 0.0, MOST_WIND, f"a speed in m/s from 0 to {MOST_WIND:g}")
    if wind > MEASURED:
        words = f"base: slopes of the sea were measured up to a wind of {MEASURED:g} m/s, and are extrapolated to"
        warn_user(f"{words} {wind:g} m/s", FittedRangeWarning)
    return Facets(index, math.sqrt(CALM + BY_WIND * wind), shadowing=shadowing, conserving=False)
