"""Rough bases: a semi-infinite metal or dielectric of many small facets, and Cox and Munk's sea of them."""

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from vrte.basics.arrays import Array, BoolArray, check_cosines, check_number
from vrte.basics.errors import FittedRangeWarning, SceneError, warn_user
from vrte.optics.facet_energy import restore_lost, share_energy
from vrte.optics.facet_integrals import integrate_azimuths
from vrte.optics.facets import RoughSurface
from vrte.scene.boundary import Allowed, Boundary, Orders
from vrte.scene.interface import ROUGHNESS, Distribution, check_facets
from vrte.scene.mirror import check_complex_index

CALM, BY_WIND = 0.003, 0.00512  # mean square slope, and how it grows with the wind [s/m]
MEASURED, MOST_WIND = 14.0, 40.0  # wind [m/s]: up to which slopes were measured, and are extrapolated


@dataclass(frozen=True)
class Facets(Boundary):
    """A rough base of facets that reflect after Fresnel, once each: a brushed metal, a sea that no light leaves.

    Parameters
    ----------
    index : complex, float or (n, k)
        Its refractive index n + ik, k >= 0; light that gets in is lost.
    roughness : float
        alpha, the root mean square slope of facets times sqrt(2), 0.001 to 1.5; for a smooth base there is Mirror.
    distribution, shadowing
        As of `vrte.Interface`: of the facets' slopes, and whether facets hide each other.
    conserving : bool, optional
        Whether what bounces between facets is given back, by default where they hide each other, and only there;
        facets that reflect everything then lose nothing.

    References
    ----------
    Cox and Munk, J. Opt. Soc. Am. 44, 838 (1954); Walter et al., Microfacet models for refraction (2007).

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> sea = vrte.Facets(1.34, roughness=0.2, shadowing=False)
    >>> sea.reflect(np.array(0.5), np.array(0.5), np.array(0.0))[0, 0].round(4).item()
    0.4855
    """

    index: Annotated[complex, complex | Sequence[float]]
    roughness: float
    distribution: Distribution = "beckmann"
    shadowing: bool | None = None
    conserving: bool | None = None

    orders_reflected = math.inf
    mixes_stokes = True
    LIMITS: ClassVar = {"roughness": ROUGHNESS}
    medium = 1.0  # refractive index of what lies above

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", check_complex_index("base: index", self.index))
        check_facets("base", self)
        if self.roughness == 0.0:
            raise SceneError.of("base: roughness", "must be above 0: vrte.Mirror(index) is the smooth base")

    def put_in_medium(self, index: float) -> "Facets":
        if index == self.medium:
            return self
        found = copy.copy(self)
        object.__setattr__(found, "medium", index)
        return found

    @property
    def facets(self) -> RoughSurface:  # type: ignore[override]
        """What light meets: the slopes of facets between the medium and the base."""
        how = self.roughness, self.distribution, bool(self.shadowing), bool(self.conserving)
        return RoughSurface(self.medium, self.index, *how, closed=True)

    def reflectance(self, mu_i: Any) -> Array:
        """Reflectance for unpolarized light (n,) at positive cosines of incidence (n,)."""
        return share_energy(self.facets, check_cosines("mu_i", mu_i))[0]

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        return self.facets.reflect(mu_i, mu_o, phi_deg)

    def reflect_orders(self, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed) -> Orders:
        here, there = np.nonzero(pairs)
        found = np.zeros((n_order, mu_i.size, mu_o.size, 4, 4))
        orders = integrate_azimuths(self.facets, False, mu_i[here], mu_o[there], n_order, 1e-12)
        if self.conserving:
            more = 2.0 * np.pi * restore_lost(self.facets, mu_i[here], mu_o[there], False)
            orders[:, 0, [0, 1, 4, 5]] += more.reshape(-1, 4)
        found[:, here, there] = orders.reshape(-1, n_order, 4, 4).swapaxes(0, 1)
        return found, 0


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
