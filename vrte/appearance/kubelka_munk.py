"""Kubelka and Munk's two fluxes: reflectance of a film from K and S, K and S from reflectances, and the surface on top.

Light goes up and down evenly diffuse; over a length dx a share K dx of it is absorbed and a share S dx turned around, K
and S in 1/um where lengths are in um. All functions take arrays, one value a wavelength, say, and are exact in the
limits K = 0, S = 0, no film and semi-infinite film. All is inside the film's own medium: `add_surface` puts the surface
on top.

Sources: Kubelka and Munk, Zeitschrift fuer technische Physik 12, 593 (1931); Saunderson, J. Opt. Soc. Am. 32, 727
(1942); both from memory. All formulas are derived anew, from dI/dx = -(K + S) I + S J and its mirror image.
"""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array, BoolArray, check_numbers
from vrte.basics.errors import SceneError

ROUNDING = 1e-9  # by which a film may seem to give back more than it gets
MOST = 1e100  # of K and S: products stay far below overflow


def reflect_film(K: Any, S: Any, length: Any, base: Any = 0.0) -> Array:
    """The reflectance of a film of ``length`` over a base of reflectance ``base``, lit evenly from within."""
    alone, through = find_film(K, S, length)
    return put_film_over(alone, through, base)


def put_film_over(alone: Any, through: Any, base: Any) -> Array:
    """The reflectance r + t^2 R_g/(1 - r R_g) over a Lambertian base R_g of a film of reflectance r, ``alone``, and
    transmittance t, ``through``: exact for every homogeneous film, since light from below is even anew."""
    r, t, under = check_share("alone", alone), check_share("through", through), check_share("base", base)
    # the floor: a white base below a film that lets nothing through, 0/0
    return r + t**2 * under / np.maximum(1.0 - under * r, np.finfo(float).tiny)


def find_film(K: Any, S: Any, length: Any) -> tuple[Array, Array]:
    """Reflectance S/(1/h + K + S) and transmittance 1/(cosh(kappa X) (1 + (K + S) h)) of a film of thickness X without
    a base, kappa = sqrt(K (K + 2 S)) and h = tanh(kappa X)/kappa."""
    k, s, x = check_slope("K", K), check_slope("S", S), check_numbers("length", length)
    complain(~(x >= 0.0), "length", "must be 0 or above", x)
    k, s, x = np.broadcast_arrays(k, s, x)
    kappa = np.sqrt(k * (k + 2.0 * s))
    deep = np.multiply(kappa, x, out=np.zeros_like(kappa), where=kappa > 0.0)
    reach = np.divide(np.tanh(deep), kappa, out=x.copy(), where=kappa > 0.0)  # h: infinite where nothing ends the light
    steep = np.divide(1.0, reach, out=np.full_like(reach, np.inf), where=reach > 0.0)
    alone = np.divide(s, steep + k + s, out=np.zeros_like(reach), where=s > 0.0)
    turned = np.multiply(k + s, reach, out=np.zeros_like(reach), where=k + s > 0.0)
    decay = np.exp(-deep)
    through: Array = 2.0 * decay / (1.0 + decay**2) / (1.0 + turned)
    return alone, through


def find_coefficients(over_black: Any, over_base: Any, base: Any, length: Any) -> tuple[Array, Array]:
    """K and S [1/unit of ``length``] from reflectances over black and over a base, inside the medium. Raises SceneError
    where no film has them, and where it hides its base: `find_slab_coefficients` takes its transmittance."""
    dark, bright = check_share("over_black", over_black), check_share("over_base", over_base)
    under = check_share("base", base)
    complain(~(under > 0.0), "base", "must be above 0, black alone does not tell K and S apart", under)
    complain(
        ~(bright > dark), "over_base", "must be above over_black, a film that hides its base tells K/S alone", bright
    )
    through = np.sqrt((bright - dark) * (1.0 - under * dark) / under)
    bad = dark + through > 1.0 + ROUNDING
    complain(bad, "over_base", "must not be above what a film that keeps no light gives back over this base", bright)
    return find_slab_coefficients(dark, np.minimum(through, 1.0), length)


def find_slab_coefficients(alone: Any, through: Any, length: Any) -> tuple[Array, Array]:
    """K and S [1/unit of ``length``] from r and t without a base: with h = tanh(kappa X/2)/kappa, (1 - r - t)/(1 + r +
    t) = K h and (1 + r - t)/(1 - r + t) = (K + 2 S) h. Raises SceneError where no film has them."""
    r, t, x = check_share("alone", alone), check_share("through", through), check_numbers("length", length)
    complain(~((x > 0.0) & np.isfinite(x)), "length", "must be above 0 and finite", x)
    r, t, x = np.broadcast_arrays(r, t, x)
    complain(~(t > 0.0), "through", "must be above 0, a film that lets nothing through tells K/S alone", t)
    complain(r + t > 1.0 + ROUNDING, "alone", "and what comes through must be 1 together at most", r + t)
    both = (1.0 + r + t) * (1.0 - r + t)
    even, odd = np.maximum(1.0 - r - t, 0.0) / (1.0 + r + t), (1.0 + r - t) / (1.0 - r + t)
    half = np.sqrt(even * odd)  # tanh(kappa X/2)
    # artanh, for thick films by 1 - half^2 = 4 t/both, which keeps its digits
    angle = np.where(half < 0.5, np.arctanh(np.minimum(half, 0.5)), np.log1p(half) - 0.5 * np.log(4.0 * t / both))
    rate = 2.0 / x * np.divide(angle, half, out=np.ones_like(half), where=half > 0.0)
    absorption: Array = even * rate
    scattering: Array = 2.0 * r / both * rate
    return absorption, scattering


def add_surface(inside: Any, k1: Any, k2: Any) -> Array:
    """The reflectance k1 + (1 - k1)(1 - k2) R/(1 - k2 R) above a surface of R ``inside``; ``k1``: what the surface
    mirrors of the light that falls in, ``k2``: what it sends back of the light that comes up, below 1 (Saunderson)."""
    r, outer, inner = check_share("inside", inside), check_share("k1", k1), check_share("k2", k2)
    complain(~(inner < 1.0), "k2", "must be below 1: else no light gets out", inner)
    return outer + (1.0 - outer) * (1.0 - inner) * r / (1.0 - inner * r)


def remove_surface(measured: Any, k1: Any, k2: Any) -> Array:
    """The reflectance inside, of what is measured above a surface: the inverse of `add_surface`."""
    r, outer, inner = check_share("measured", measured), check_share("k1", k1), check_share("k2", k2)
    complain(~(inner < 1.0), "k2", "must be below 1: else no light gets out", inner)
    complain(r < outer - ROUNDING, "measured", "must not be below k1, which the surface alone mirrors", r)
    gain = np.maximum(r - outer, 0.0)
    return np.minimum(gain / ((1.0 - outer) * (1.0 - inner) + inner * gain), 1.0)


def check_slope(name: str, values: Any) -> Array:
    """Coefficients K or S, of any shape. Raises SceneError."""
    found = check_numbers(name, values)
    complain(~((found >= 0.0) & (found <= MOST)), name, f"must be from 0 to {MOST:g}", found)
    return found


def check_share(name: str, values: Any) -> Array:
    """Shares of light from 0 to 1, of any shape; rounding beyond is taken off. Raises SceneError."""
    found = check_numbers(name, values)
    complain(~((found >= -ROUNDING) & (found <= 1.0 + ROUNDING)), name, "must be a share of light, from 0 to 1", found)
    return np.clip(found, 0.0, 1.0)


def complain(wrong: Any, name: str, words: str, values: Any) -> None:
    """Raises SceneError with the first value that is wrong, if there is one, and where it stands among several."""
    found: BoolArray = np.asarray(wrong)
    if found.any():
        index = np.unravel_index(int(np.argmax(found)), found.shape)
        where = f" (at place {', '.join(str(one) for one in index)})" if index else ""
        raise SceneError.of(name, f"{words}, not {np.broadcast_to(values, found.shape)[index]:.6g}{where}")
