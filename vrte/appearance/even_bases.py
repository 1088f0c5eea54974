"""A film over every Lambertian base at once: what comes back is known in closed form, from three solves."""

from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array, check_number


@dataclass(frozen=True, eq=False)
class OverEvenBases:
    """The reflectance factors (n,) of a film over an even base of any albedo A: f(A) = f(0) + u A/(1 - A r).

    Exact with polarization and surfaces, for a Lambertian base sends back the same light whatever arrives: ``u`` is the
    film's transmittance down times that up over the square of its index, ``r`` what it sends back down of even light
    from below, each (n,). Solves keep it to rounding, and under surfaces to what their nodes miss of even light.
    """

    bare: Array
    u: Array
    r: Array

    def reflect(self, albedo: float) -> Array:
        """The reflectance factor (n,) over a base of that albedo. Raises SceneError.

        >>> OverEvenBases(np.array([0.5]), np.array([0.25]), np.array([0.5])).reflect(0.8).round(12).tolist()
        [0.833333333333]
        """
        albedo = check_number("albedo", albedo, 0.0, 1.0, "between 0 and 1")
        found: Array = self.bare + albedo * self.u / (1.0 - albedo * self.r)
        return found


def fit_even_bases(black: Array, grey: Array, white: Array) -> OverEvenBases:
    """What a film sends back over any even base, from its reflectance factors over albedos 0, 1/2 and 1.

    >>> fit_even_bases(np.array([0.5]), np.array([2.0 / 3.0]), np.array([1.0])).r.round(12).tolist()
    [0.5]
    """
    half, whole = grey - black, white - black  # u/(2 - r) and u/(1 - r)
    seen = (half > 0.0) & (whole >= 2.0 * half)  # all else is rounding: the film hides its base, or is not there
    escapes = np.divide(half, whole - half, out=np.ones_like(half), where=seen)  # 1 - r
    return OverEvenBases(black, whole * escapes, 1.0 - escapes)
