"""Rough surfaces: what facets of random slopes reflect and let through, once each, as Mueller matrices.

``index`` is that of the medium behind over that of the medium that light comes from; ``roughness`` is alpha. Light
comes from above; from below it is the same surface in a horizontal mirror, D f D with D = diag(1, 1, -1, -1). With mu_n
the cosine of a facet's tilt, its normal h along k_o - k_i of what it reflects and along k_i - n k_o of what it lets
through, c its cosines with light on both sides and p the density of its slopes:

    f_r = p/(4 mu_n^4 mu_i mu_o) M(r_p, r_s),    f_t = n^2 c_i c_o p/(mu_n^4 mu_i mu_o (c_i - n c_o)^2) T M(t_p, t_s)

Source: Cox and Munk, J. Opt. Soc. Am. 44, 838 (1954); Walter et al., Microfacet models for refraction (2007), whose
shadowing is the product of Smith's factors of both directions; the lesser of them: Ashikhmin, Premoze and Shirley, A
microfacet-based BRDF generator (2000).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.fresnel import reflect_smooth, transmit_smooth


@dataclass(frozen=True)
class RoughSurface:
    """Facets as light from one medium meets them; ``index`` of what lies behind, complex where no light gets out again;
    ``conserving``: what single bounces lose is given back (`restore_lost`); ``closed``: light that gets in stays."""

    index_from: float
    index: complex
    roughness: float
    distribution: str = "beckmann"
    shadowing: bool = False
    conserving: bool = False
    closed: bool = False

    @property
    def turned(self) -> "RoughSurface":
        """The same as light from the other side meets it."""
        return replace(self, index_from=self.index.real, index=self.index_from)

    @property
    def ratio(self) -> complex:
        """The index behind over that before."""
        return self.index / self.index_from

    @property
    def is_clear(self) -> bool:
        """Whether light gets out again from what lies behind."""
        return complex(self.index).imag == 0.0 and not self.closed

    @property
    def reflects_totally(self) -> bool:
        """Whether facets do, beyond their critical angle."""
        return complex(self.index).imag == 0.0 and self.ratio.real < 1.0

    def shadows(self, transmitted: bool) -> int:
        """Which shadowing: 0 none, 1 Smith's factors of both directions, 2 the lesser of them."""
        return 2 if self.conserving and transmitted else int(self.shadowing)

    def reflect(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Array:
        """Mueller matrices f_r [1/sr] of reflection, radiance out over irradiance in, (..., 4, 4)."""
        way = FacetGeometry(mu_i, mu_o, phi_deg, upward=True)
        across, along = way.measure_gap(1.0)
        cosine = 0.5 * np.sqrt(across + along)
        strength = self.find_density(across / along) * (1.0 + across / along) ** 2
        strength = strength / (4.0 * way.mu_i * way.mu_o) * self.shade(way, False)
        f = way.turn(strength[..., None, None] * reflect_smooth(self.ratio, cosine))
        return self.add_lost(f, mu_i, mu_o, False)

    def transmit(self, mu_i: Any, mu_o: Any, phi_deg: Any) -> Array:
        """Mueller matrices f_t [1/sr], radiance out over irradiance in, (..., 4, 4); ``mu_o`` is the cosine behind."""
        index, way = self.ratio.real, FacetGeometry(mu_i, mu_o, phi_deg, upward=False)
        across, along = way.measure_gap(index)
        size = np.sqrt(across + along)
        less = 0.5 * sum(way.measure_gap(1.0))  # 1 - k_i k_o
        sign = np.sign(index - 1.0)
        cosine_i, cosine_o = sign * ((index - 1.0) - index * less) / size, sign * ((index - 1.0) + less) / size
        lit = (cosine_i > 0.0) & (cosine_o > 0.0) & (sign * (index * way.mu_o - way.mu_i) > 0.0)
        cosine_i, cosine_o = np.where(lit, cosine_i, 1.0), np.where(lit, cosine_o, 1.0)
        tilt = across / np.where(lit, along, 1.0)
        strength = self.find_density(tilt) * (1.0 + tilt) ** 2 * cosine_i * cosine_o / size**2
        strength = strength * index**2 / (way.mu_i * way.mu_o) * self.shade(way, True)
        f = way.turn(np.where(lit, strength, 0.0)[..., None, None] * transmit_smooth(index, cosine_i))
        return self.add_lost(f, mu_i, mu_o, True)

    def find_density(self, square: Any) -> Array:
        """Density of facets by the square of their slope (...), per unit of both its components: (...)."""
        ratio = np.asarray(square) / self.roughness**2
        shape: Array = np.exp(-ratio) if self.distribution == "beckmann" else (1.0 + ratio) ** -2
        return shape / (np.pi * self.roughness**2)

    def shade(self, way: "FacetGeometry", transmitted: bool) -> Any:
        """Smith's factors of both directions, or the lesser of them, as `shadows` says."""
        shadowing = self.shadows(transmitted)
        if not shadowing:
            return 1.0
        both = [shade_facets(self.roughness, self.distribution, mu) for mu in (way.mu_i, way.mu_o)]
        return both[0] * both[1] if shadowing == 1 else np.minimum(*both)

    def add_lost(self, f: Array, mu_i: Any, mu_o: Any, transmitted: bool) -> Array:
        """f (..., 4, 4) with what single bounces lose, where that is asked for."""
        if self.conserving:
            from vrte.optics.facet_energy import restore_lost  # which integrates what is here

            f[..., :2, :2] += restore_lost(self, np.asarray(mu_i, float), np.asarray(mu_o, float), transmitted)
        return f


def shade_facets(roughness: float, distribution: str, mu: Any) -> Array:
    """The share of facets that turn towards a direction which others do not hide, after Smith: (...)."""
    from scipy.special import erfc

    mu = np.asarray(mu, float)
    sine = np.maximum(np.sqrt((1.0 - mu) * (1.0 + mu)), 1e-20)
    slope = np.minimum(mu / (roughness * sine), 30.0 if distribution == "beckmann" else 1e20)  # of sight, over alpha
    if distribution == "beckmann":
        hidden = 0.5 * (np.exp(-(slope**2)) / (slope * np.sqrt(np.pi)) - erfc(slope))
    else:
        hidden = 0.5 / (slope**2 * (1.0 + np.sqrt(1.0 + slope**-2)))
    return 1.0 / (1.0 + hidden)


class FacetGeometry:
    """Directions of incidence and exit: cosines, sines and half the azimuth between, on one shape."""

    def __init__(self, mu_i: Any, mu_o: Any, phi_deg: Any, upward: bool) -> None:
        half = 0.5 * np.radians(np.asarray(phi_deg, float))
        mu_i, mu_o, half = np.broadcast_arrays(np.asarray(mu_i, float), np.asarray(mu_o, float), half)
        self.mu_i, self.mu_o, self.upward = mu_i, mu_o, upward
        self.sine_i, self.sine_o = (np.sqrt((1.0 - mu) * (1.0 + mu)) for mu in (mu_i, mu_o))
        self.sin_half, self.cos_half = np.sin(half), np.cos(half)

    def measure_gap(self, index: float) -> tuple[Array, Array]:
        """Squares of k_i - n k_o, its horizontal part and its vertical one."""
        across = (self.sine_i - index * self.sine_o) ** 2 + 4.0 * index * self.sine_i * self.sine_o * self.sin_half**2
        vertical = self.mu_i + index * self.mu_o if self.upward else self.mu_i - index * self.mu_o
        return across, vertical**2

    def turn(self, mueller: Array) -> Array:
        """Turns Stokes frames from the plane of incidence to meridian planes."""
        return self.rotations[1].swapaxes(-1, -2) @ mueller @ self.rotations[0]

    def turn_back(self, mueller: Array) -> Array:
        """Turns Stokes frames from meridian planes to the plane of incidence: the transpose of `turn`."""
        return self.rotations[1] @ mueller @ self.rotations[0].swapaxes(-1, -2)

    @cached_property
    def rotations(self) -> tuple[Array, Array]:
        """Rotations from the meridian planes of light in and out to the plane of incidence, (..., 4, 4) each: s is
        along k_i x k_o, a and b its parts along l and r of either direction, in sums of equal signs."""
        crossed = self.sine_i * self.mu_o + self.mu_i * self.sine_o
        between = (self.mu_o - self.mu_i) * (self.mu_o + self.mu_i) / np.where(crossed == 0.0, 1.0, crossed)
        full = 2.0 * self.sin_half * self.cos_half
        if self.upward:
            b_i = 2.0 * self.mu_i * self.sine_o * self.cos_half**2 + between
            b_o = 2.0 * self.mu_o * self.sine_i * self.cos_half**2 - between
        else:
            b_i = -2.0 * self.mu_i * self.sine_o * self.sin_half**2 - between
            b_o = 2.0 * self.mu_o * self.sine_i * self.sin_half**2 - between
        a_i, a_o = -self.sine_o * full, -self.sine_i * full
        parallel = (a_i**2 + b_i**2 == 0.0) | (a_o**2 + b_o**2 == 0.0)  # any s across will do: r of what comes
        up = 1.0 if self.upward else -1.0
        a_i, b_i = np.where(parallel, 0.0, a_i), np.where(parallel, 1.0, b_i)
        a_o = np.where(parallel, -up * self.mu_o * full, a_o)
        b_o = np.where(parallel, 1.0 - 2.0 * self.sin_half**2, b_o)
        return make_rotation(a_i, b_i), make_rotation(a_o, b_o)


def make_rotation(a: Array, b: Array) -> Array:
    """Into the frame with p, s for l, r, where s = (a, b)/sqrt(a^2 + b^2) in l and r: (..., 4, 4)."""
    found = np.zeros((*np.shape(a), 4, 4))
    found[..., 0, 0] = found[..., 3, 3] = 1.0
    found[..., 1, 1] = found[..., 2, 2] = (b - a) * (b + a) / (a * a + b * b)
    found[..., 1, 2] = -2.0 * a * b / (a * a + b * b)
    found[..., 2, 1] = -found[..., 1, 2]
    return found
