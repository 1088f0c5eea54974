"""A BRDF between the directions that were solved for, in meridian planes.

Cubic splines run over s, theta = 90 degrees sin(pi s/2), and over the azimuth. They go on beyond the pole, where
meridian planes go on into their other half, f(-theta_i, theta_o, phi) = f(theta_i, theta_o, phi + 180), and beyond the
horizon, where f (mu_i + mu_o) is an even function of 1 - s.
"""

import itertools
from typing import Literal

import numpy as np

from vrte.basics.arrays import Array, whole
from vrte.basics.polarization import FLIP
from vrte.request.request import SMALLEST_COSINE
from vrte.results.brdf import Brdf

COSINES, AZIMUTHS = 48, 73  # to solve for, by default
FEWEST, MOST = 8, 1024
ORDER: Literal[3] = 3  # of the splines
MARGIN = 8  # samples beyond each end, where splines no longer notice that they end
MIRROR = np.outer(FLIP, FLIP)  # f(-phi) = f(phi) times this


def directions(cosines: int = COSINES, azimuths: int = AZIMUTHS) -> dict[str, Array]:
    """What a spectrum must be solved for to be written as a table: ``mu_i``, ``mu_o`` and ``phi`` for `vrte.spectrum`.

    ``cosines`` of incidence and of exit each, ``azimuths`` from 0 to 180 degrees, the other half is their mirror image.
    The scene's own features must be resolved by both: twice as many azimuths as its BRDF has Fourier orders, and
    as many cosines as there are nodes, are plenty. Raises SceneError.

    >>> {name: values.size for name, values in directions().items()}
    {'mu_i': 48, 'mu_o': 48, 'phi': 73}
    """
    middles = (np.arange(whole("cosines", cosines, FEWEST, MOST)) + 0.5) / cosines
    mu = np.cos(0.5 * np.pi * np.sin(0.5 * np.pi * middles))
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 180.0, whole("azimuths", azimuths, FEWEST, MOST))}


class Splines:
    """A BRDF at any pair of directions, from one at `directions`."""

    def __init__(self, one: Brdf) -> None:
        from scipy.ndimage import spline_filter

        weighted = one.mueller * (one.mu_i[:, None] + one.mu_o)[:, :, None, None, None]
        margins = tuple(min(MARGIN, count - 1) for count in weighted.shape[:3])
        beyond = around(over_pole(over_pole(weighted, 0, margins[0]), 1, margins[1]), margins[2])
        self.counts, self.margins = weighted.shape[:3], margins
        # one (mu_i, mu_o, phi) an element, but for those that are zero throughout
        self.coefficients = {
            element: spline_filter(beyond[..., *element], ORDER)
            for element in itertools.product(range(4), range(4))
            if weighted[..., *element].any()
        }

    def __call__(self, into: Array, out: Array, lowest: float = SMALLEST_COSINE) -> Array:
        """The BRDF (pairs, 4, 4) in meridian planes [sr-1], directions (pairs, 3) away from the surface; cosines
        below ``lowest``, those below the horizon too, are taken for it."""
        from scipy.ndimage import map_coordinates

        mu_i, mu_o = np.clip(into[:, 2], lowest, 1.0), np.clip(out[:, 2], lowest, 1.0)
        # the light travels against ``into``
        turned = np.arctan2(out[:, 1], out[:, 0]) - np.arctan2(into[:, 1], into[:, 0]) - np.pi
        phi = (turned + np.pi) % (2.0 * np.pi) - np.pi
        cosines, azimuths = self.counts[0], self.counts[2]
        places = np.stack(
            [
                cosines * stretched(mu_i) - 0.5 + self.margins[0],
                cosines * stretched(mu_o) - 0.5 + self.margins[1],
                np.abs(phi) / np.pi * (azimuths - 1) + self.margins[2],
            ]
        )
        found = np.zeros((len(into), 4, 4))
        for element, coefficients in self.coefficients.items():
            found[:, *element] = map_coordinates(coefficients, places, order=ORDER, prefilter=False)
        found[phi < 0.0] *= MIRROR
        return found / (mu_i + mu_o)[:, None, None]


def stretched(mu: Array) -> Array:
    """s from 0 at the pole to 1 at the horizon."""
    found: Array = np.arcsin(np.minimum(np.arccos(mu) / (0.5 * np.pi), 1.0)) / (0.5 * np.pi)
    return found


def over_pole(values: Array, axis: int, margin: int) -> Array:
    """Values (mu_i, mu_o, phi, 4, 4) beyond both ends of an axis of cosines, the pole at its start, the horizon at its
    end."""
    near, far = np.split(values, [margin], axis)[0], np.split(values, [values.shape[axis] - margin], axis)[1]
    pole = np.flip(near, (axis, 2)) * MIRROR
    return np.concatenate([pole, values, np.flip(far, axis)], axis)


def around(values: Array, margin: int) -> Array:
    """Values (mu_i, mu_o, phi, 4, 4) beyond 0 and 180 degrees, their mirror images."""
    before, after = values[:, :, margin:0:-1], values[:, :, -2 : -margin - 2 : -1]
    return np.concatenate([before * MIRROR, values, after * MIRROR], 2)
