"""MERL's BRDF files (Matusik and others 2003): red, green and blue over Rusinkiewicz angles, which are looked up.

The file is three whole numbers (90, 90, 180), then numbers in double precision by channel, theta_h, theta_d and phi_d,
each [1/sr] over its channel's scale. Bins are even in the root of theta_h, in theta_d and in phi_d; a program takes the
value of the bin that a pair of directions falls into. phi_d ends at 180 degrees: a BRDF that is reciprocal is the same
half a turn on.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.exports.colour import weigh_channels
from vrte.exports.lobes import follow_intensities
from vrte.exports.polarized import CHUNK, make_direction_pairs
from vrte.formats.atomic import PathName, write_atomically
from vrte.formats.measured_polarized import find_half_angles, make_pairs
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Spectrum

SHAPE = 90, 90, 180  # theta_h, theta_d, phi_d
SCALES = np.array([1.0, 1.15, 1.66]) / 1500.0  # sr-1, of red, green and blue
LOWEST = 0.01  # cosine of what is nearer to the horizon, or below it
NOTE = (
    "linear sRGB of the BRDF in sr-1, the perfect white in D65 at 1/pi (2 degrees observer), by MERL's scales; "
    "theta_h, theta_d, phi_d at the middle of each bin; values go on below the horizon; colours are cut off at 0"
)


@dataclass(frozen=True, eq=False)
class MerlFile:
    """What a file holds: values (3, theta_h, theta_d, phi_d) [sr-1]."""

    values: Array

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What a program looks up in the file: (k, n, 3, 1, 1) [sr-1]."""
        phi_d, theta_d, theta_h = find_half_angles(*make_pairs(mu_i[:, None], mu_o, phi)).T
        fractions = np.sqrt(2.0 / np.pi * theta_h), 2.0 / np.pi * theta_d, phi_d % np.pi / np.pi
        bins = (np.minimum((part * count).astype(int), count - 1) for part, count in zip(fractions, SHAPE, strict=True))
        return self.values[:, *bins].T.reshape(*mu_o.shape, 3, 1, 1)

    def write(self, path: PathName, text: str) -> None:
        """Writes the file, all or nothing. Raises OSError."""
        with write_atomically(path) as part, open(part, "wb") as file:
            file.write(np.array(SHAPE, "<i4").tobytes())
            file.write((self.values / SCALES[:, None, None, None]).astype("<f8").tobytes())


def tabulate_merl(spectrum: Spectrum, surfaces: Sequence[RoughSurface | None]) -> MerlFile:
    """The file of a spectrum at `directions`, under these rough surfaces."""
    lobes, weights = follow_intensities(spectrum.brdfs, surfaces), weigh_channels(spectrum.wavelength_um)
    middles = [(np.arange(count) + 0.5) / count for count in SHAPE]
    axes = np.pi * middles[2], 0.5 * np.pi * middles[1], 0.5 * np.pi * middles[0] ** 2
    into, out, _ = make_direction_pairs(axes)
    parts = (slice(start, start + CHUNK) for start in range(0, len(into), CHUNK))
    found = np.concatenate([lobes(into[part], out[part], LOWEST) @ weights.T for part in parts])
    values = found.T.reshape(3, *SHAPE[::-1]).transpose(0, 3, 2, 1)
    return MerlFile(np.maximum(values, 0.0))
