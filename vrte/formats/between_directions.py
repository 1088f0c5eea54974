"""A BRDF between the directions that were solved for, in meridian planes.

The spline runs over s, theta = 90 degrees sin(pi s/2), and over the azimuth. It goes on beyond the pole, where
meridian planes go on into their other half, f(-theta_i, theta_o, phi) = f(theta_i, theta_o, phi + 180), and beyond the
horizon, where f (mu_i + mu_o) is an even function of 1 - s.
"""

from typing import Any

import numpy as np

from vrte.basics.arrays import SMALLEST_COSINE, Array, check_whole
from vrte.basics.splines import (
    MIRROR,
    compute_coefficients,
    extend_azimuths,
    extend_over_horizon,
    extend_over_pole,
    make_cosines,
    make_spline_matrix,
    stretch_cosines,
)
from vrte.results.brdf import Brdf

COSINES, AZIMUTHS = 48, 73  # to solve for, by default
FEWEST, MOST = 8, 1024
MARGIN = 8  # points beyond each end: the ends' own error, which is small on such fine grids, has faded to 3e-5 there


def directions(cosines: int = COSINES, azimuths: int = AZIMUTHS) -> dict[str, Any]:
    """What a spectrum must be solved for to be written as a table: ``mu_i``, ``mu_o`` and ``phi`` for `vrte.spectrum`.

    ``cosines`` of incidence and of exit each, ``azimuths`` from 0 to 180 degrees, the other half is their mirror image.
    The scene's own features must be resolved by both: twice as many azimuths as its BRDF has Fourier orders, and
    as many cosines as there are nodes, are plenty. Raises SceneError.

    >>> {name: values.size for name, values in directions().items()}
    {'mu_i': 48, 'mu_o': 48, 'phi': 73}
    """
    mu = make_cosines(check_whole("cosines", cosines, FEWEST, MOST))
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 180.0, check_whole("azimuths", azimuths, FEWEST, MOST))}


class Splines:
    """A BRDF at any pair of directions, from one at `directions`."""

    def __init__(self, one: Brdf) -> None:
        s, weighted = stretch_cosines(one.mu_o), one.mueller * (one.mu_i[:, None] + one.mu_o)[:, :, None, None, None]
        for axis in (0, 1):
            polar, weighted = extend_over_pole(s, weighted, np.flip(weighted, 2) * MIRROR, axis, MARGIN)
            polar, weighted = extend_over_horizon(polar, weighted, axis, MARGIN)
        azimuths, weighted = extend_azimuths(one.phi, weighted, 0.0, 180.0, MARGIN)
        self.grids = polar, polar, azimuths
        self.there = weighted.any(axis=(0, 1, 2))  # elements that are not zero throughout
        # one after another: all at once would take five times the memory
        each = (
            compute_coefficients(self.grids, weighted[..., *element]).ravel() for element in np.argwhere(self.there)
        )
        self.coefficients = np.stack(list(each), axis=1)

    def __call__(self, into: Array, out: Array, lowest: float = SMALLEST_COSINE) -> Array:
        """The BRDF (pairs, 4, 4) in meridian planes [sr-1], directions (pairs, 3) away from the surface; cosines
        below ``lowest``, those below the horizon too, are taken for it."""
        mu_i, mu_o = np.clip(into[:, 2], lowest, 1.0), np.clip(out[:, 2], lowest, 1.0)
        # the light travels against ``into``
        turned = np.arctan2(out[:, 1], out[:, 0]) - np.arctan2(into[:, 1], into[:, 0]) - np.pi
        phi = (np.degrees(turned) + 180.0) % 360.0 - 180.0
        matrices = np.zeros((len(into), 4, 4))
        matrices[:, self.there] = (
            make_spline_matrix(self.grids, (stretch_cosines(mu_i), stretch_cosines(mu_o), np.abs(phi)))
            @ self.coefficients
        )
        matrices /= (mu_i + mu_o)[:, None, None]
        matrices[phi < 0.0] *= MIRROR
        return matrices
