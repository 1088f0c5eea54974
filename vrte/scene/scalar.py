"""Bases known by their reflectance alone: light leaves them unpolarized, whatever its polarization was."""

import warnings
from typing import NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import FittedRangeWarning, SceneError
from vrte.scene.base_checks import check_energy
from vrte.scene.boundary import SampledBase

LOOKED_AT = np.concatenate([[0.01, 0.03], np.arange(0.06, 1.01, 0.04), [1.0]])  # cosines where f is looked at
AZIMUTHS = np.linspace(0.0, 180.0, 13)
STEEPEST = np.cos(np.radians(75.0))  # cosines above were measured, and formulas fitted to them


class Angles(NamedTuple):
    """Directions of light that comes and goes, on one shape: cosines and tangents of both zenith angles, cosine of the
    azimuth between them (0 ahead), the distance of both on a plane one unit above, and the phase angle [rad] from one
    to the other, 0 straight back."""

    mu_i: Array
    mu_o: Array
    tan_i: Array
    tan_o: Array
    cos_phi: Array
    distance: Array
    phase: Array


def find_angles(mu_i: Array, mu_o: Array, phi_deg: Array) -> Angles:
    """Sums of equal signs, so that the phase angle keeps its digits near 0 and pi.

    >>> find_angles(0.5, 0.5, 180.0).phase.item(), round(np.degrees(find_angles(1.0, 0.5, 0.0).phase).item(), 12)
    (0.0, 60.0)
    """
    half = 0.5 * np.radians(np.asarray(phi_deg, float))
    mu_i, mu_o, half = np.broadcast_arrays(np.asarray(mu_i, float), np.asarray(mu_o, float), half)
    sine_i, sine_o = (np.sqrt((1.0 - mu) * (1.0 + mu)) for mu in (mu_i, mu_o))
    cos_half, sin_half = np.where(half == 0.5 * np.pi, 0.0, np.cos(half)), np.sin(half)
    apart = (mu_i - mu_o) ** 2 + (sine_i - sine_o) ** 2 + 4.0 * sine_i * sine_o * cos_half**2
    together = (mu_i + mu_o) ** 2 + (sine_i - sine_o) ** 2 + 4.0 * sine_i * sine_o * sin_half**2
    phase = 2.0 * np.arctan2(np.sqrt(apart), np.sqrt(together))
    tan_i, tan_o = sine_i / mu_i, sine_o / mu_o
    distance = np.sqrt((tan_i - tan_o) ** 2 + 4.0 * tan_i * tan_o * cos_half**2)
    return Angles(mu_i, mu_o, tan_i, tan_o, cos_half**2 - sin_half**2, distance, phase)


class ScalarBase(SampledBase):
    """A base with a formula for f_00, which the others are dark beside; f that would be negative is 0.

    Made from this class, it has `compute_f`, and asks for `check_formula` as it is made.
    """

    def compute_f(self, angles: Angles) -> Array:
        """The formula [1/sr], on the shape of the angles."""
        raise NotImplementedError

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        found: Array = np.maximum(self.compute_f(find_angles(mu_i, mu_o, phi_deg)), 0.0)[..., None, None]
        return found

    def check_formula(self) -> None:
        """Raises SceneError where more light comes back than falls in, or f is negative where formulas were fitted;
        warns where it is elsewhere."""
        angles = find_angles(LOOKED_AT[:, None, None], LOOKED_AT[:, None], AZIMUTHS)
        f, lower = self.compute_f(angles), np.minimum(angles.mu_i, angles.mu_o)
        negative = f < 0.0
        if negative.any():
            fitted = negative & (lower >= STEEPEST)
            place = np.unravel_index(np.argmin(np.where(fitted if fitted.any() else negative, f, np.inf)), f.shape)
            where = (
                f"{f[place]:.3g} 1/sr from mu_i {angles.mu_i[place]:g} to mu_o {angles.mu_o[place]:g} at phi_deg "
                f"{AZIMUTHS[place[-1]]:g}"
            )
            if fitted.any():
                raise SceneError(f"base: f of {self.name} must be at least 0 for zenith angles up to 75, not {where}")
            words = (
                f"base: f of {self.name} is negative near the horizon, and taken as 0 there: below a cosine of about"
            )
            warnings.warn(FittedRangeWarning(f"{words} {lower[negative].max():.2g}, {where} at worst"), stacklevel=4)
        check_energy(self.reflectance)
