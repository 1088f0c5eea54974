"""A BRDF at any pair of directions: what files for renderers are made of.

Splines run through the `directions` that were solved for, in meridian planes, over s, theta = 90 degrees sin(pi s/2),
and over the azimuth. They go on beyond the pole, where meridian planes go on into their other half, f(-theta_i,
theta_o, phi) = f(theta_i, theta_o, phi + 180), and beyond the horizon, where f (mu_i + mu_o) is an even function of 1 -
s. What facets of a rough surface on top reflect is not in the splines: it is added in closed form.
"""

from collections.abc import Callable, Sequence

import numpy as np

from vrte.basics.arrays import SMALLEST_COSINE, Array
from vrte.basics.splines import (
    MIRROR,
    compute_coefficients,
    extend_azimuths,
    extend_over_horizon,
    extend_over_pole,
    make_spline_matrix,
    stretch_cosines,
)
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Brdf
from vrte.results.facets import find_facets, leave_out_facets

MARGIN = 8  # points beyond each end: the ends' own error, which is small on such fine grids, has faded to 3e-5 there
EVEN = np.ones((1, 1))
Lobes = Callable[..., Array]  # of directions (pairs, 3) away from the surface, twice, and a smallest cosine


class Splines:
    """A BRDF at any pair of directions, from matrices (mu_i, mu_o, phi, ..., ...) at `directions` of ``mu`` and
    ``phi``; with phi turned over they are ``mirror`` times as large."""

    def __init__(self, mu: Array, phi: Array, matrices: Array, mirror: Array = MIRROR) -> None:
        s, weighted = stretch_cosines(mu), matrices * (mu[:, None] + mu)[:, :, None, None, None]
        for axis in (0, 1):
            polar, weighted = extend_over_pole(s, weighted, np.flip(weighted, 2) * mirror, axis, MARGIN)
            polar, weighted = extend_over_horizon(polar, weighted, axis, MARGIN)
        azimuths, weighted = extend_azimuths(phi, weighted, 0.0, 180.0, MARGIN, mirror)
        self.grids, self.mirror = (polar, polar, azimuths), mirror
        self.there = weighted.any(axis=(0, 1, 2))  # elements that are not zero throughout
        # one after another: all at once would take five times the memory
        each = (
            compute_coefficients(self.grids, weighted[..., *element]).ravel() for element in np.argwhere(self.there)
        )
        self.coefficients = np.column_stack([np.empty((weighted[..., 0, 0].size, 0)), *each])

    def __call__(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """The matrices (pairs, ..., ...) [sr-1] in meridian planes, at cosines and azimuths [degrees] (pairs,)."""
        phi = (phi + 180.0) % 360.0 - 180.0
        matrices = np.zeros((mu_i.size, *self.there.shape))
        matrices[:, self.there] = (
            make_spline_matrix(self.grids, (stretch_cosines(mu_i), stretch_cosines(mu_o), np.abs(phi)))
            @ self.coefficients
        )
        matrices /= (mu_i + mu_o)[:, None, None]
        matrices[phi < 0.0] *= self.mirror
        return matrices


def find_angles(into: Array, out: Array, lowest: float) -> tuple[Array, Array, Array]:
    """Cosines and azimuths [degrees] (pairs,) of directions (pairs, 3) away from the surface; cosines below ``lowest``,
    those below the horizon too, are taken for it."""
    mu_i, mu_o = np.clip(into[:, 2], lowest, 1.0), np.clip(out[:, 2], lowest, 1.0)
    # the light travels against ``into``
    turned = np.arctan2(out[:, 1], out[:, 0]) - np.arctan2(into[:, 1], into[:, 0]) - np.pi
    return mu_i, mu_o, np.degrees(turned)


def follow_mueller(one: Brdf, surface: RoughSurface | None) -> Lobes:
    """The Mueller matrices (pairs, 4, 4) [sr-1] in meridian planes, of a BRDF at `directions` under a rough surface."""
    facets = find_facets(one, surface)
    splines = Splines(one.mu_o, one.phi, leave_out_facets(one, facets))

    def evaluate(into: Array, out: Array, lowest: float = SMALLEST_COSINE) -> Array:
        angles = find_angles(into, out, lowest)
        return splines(*angles) + (0.0 if facets is None else facets.reflect(*angles))

    return evaluate


def follow_intensities(brdfs: Sequence[Brdf], surfaces: Sequence[RoughSurface | None]) -> Lobes:
    """f00 (pairs, wavelength) [sr-1] of BRDFs at `directions`, each under its rough surface, if there is one."""
    facets = [find_facets(one, surface) for one, surface in zip(brdfs, surfaces, strict=True)]
    rest = [leave_out_facets(one, each)[..., 0, 0] for one, each in zip(brdfs, facets, strict=True)]
    splines = Splines(brdfs[0].mu_o, brdfs[0].phi, np.stack(rest, axis=-1)[..., None], EVEN)
    different = {each for each in facets if each is not None}

    def evaluate(into: Array, out: Array, lowest: float = SMALLEST_COSINE) -> Array:
        angles = find_angles(into, out, lowest)
        found = splines(*angles)[:, :, 0]
        for each in different:
            found[:, [one == each for one in facets]] += each.reflect(*angles)[:, :1, 0]
        return found

    return evaluate
