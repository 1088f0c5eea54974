"""Bases known by their reflectance alone: light leaves them unpolarized, whatever its polarization was."""

from typing import NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import FittedRangeWarning, SceneError, warn_user
from vrte.scene.boundary import CHECKED_COSINES, COARSE, ENERGY_ALLOWED, GRAZING, SampledBase

FORMULA_COSINES = np.concatenate([[0.01, 0.03], np.arange(0.06, 1.01, 0.04), [1.0]])  # of both directions, in checks
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
    """Sums of equal signs, so that the phase angle keeps its digits near 0 and pi."""
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
    """A base with a formula for f_00, `compute_f`, and LIMITS of its numbers; f that would be negative is 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_formula()

    def compute_f(self, angles: Angles) -> Array:
        """f_00 [1/sr] of pairs of directions, on their shape."""
        raise NotImplementedError

    def reflect(self, mu_i: Array, mu_o: Array, phi_deg: Array) -> Array:
        return np.maximum(self.compute_f(find_angles(mu_i, mu_o, phi_deg)), 0.0)[..., None, None]

    def check_formula(self) -> None:
        """Whether a surface can reflect so at zenith angles up to 75 degrees: f >= 0, and no more light than falls in.
        Raises SceneError; beyond 75 degrees it warns, of more than 0.05/mu_i times as much light below mu_i = 0.05."""
        angles = find_angles(FORMULA_COSINES[:, None, None], FORMULA_COSINES[:, None], AZIMUTHS)
        f, lower = self.compute_f(angles), np.minimum(angles.mu_i, angles.mu_o)
        within, beyond = (np.where(there, f, 0.0) for there in (lower >= STEEPEST, lower < STEEPEST))

        def name_lowest(values: Array) -> str:
            index = np.unravel_index(np.argmin(values), f.shape)
            ways = f"from mu_i {angles.mu_i[index]:g} to mu_o {angles.mu_o[index]:g} at phi_deg"
            return f"{f[index]:.3g} 1/sr {ways} {AZIMUTHS[index[-1]]:g}"

        if within.min() < 0.0:
            raise SceneError(f"base: f must be at least 0 for zenith angles up to 75, not {name_lowest(within)}")
        if beyond.min() < 0.0:
            words = f"f is negative, and taken as 0, below a cosine of about {lower[f < 0.0].max():.2g}"
            self.warn_beyond(f"{words}: {name_lowest(beyond)}")
        shares = self.reflectance(CHECKED_COSINES, COARSE) / np.maximum(1.0, GRAZING / CHECKED_COSINES)
        worst = int(np.argmax(np.where(CHECKED_COSINES >= STEEPEST, shares, 0.0)))
        if shares[worst] > 1.0 + ENERGY_ALLOWED:
            words = f"{shares[worst]:.4g} of the light along mu_i = {CHECKED_COSINES[worst]:g}"
            raise SceneError(f"base: it gives back {words}, and at most 1 is allowed for zenith angles up to 75")
        most = int(np.argmax(shares))
        if shares[most] > 1.0 + ENERGY_ALLOWED:
            share = self.reflectance(CHECKED_COSINES[most]).item()
            self.warn_beyond(f"{share:.3g} of the light along mu_i = {CHECKED_COSINES[most]:g} is reflected")

    def warn_beyond(self, words: str) -> None:
        """Warns of what the formula does beyond the zenith angles that it was fitted to."""
        where = f"base: {self.name} was fitted to zenith angles up to about 75; beyond, {words}"
        warn_user(where, FittedRangeWarning)
