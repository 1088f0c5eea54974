"""The Ross-Li base: land as MODIS reports it, a sum of three kernels."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vrte.basics.arrays import Array
from vrte.scene.scalar import Angles, ScalarBase

HOT_SPOT = np.radians(1.5)  # phase angle within which leaves hide their shadows, after Maignan et al.


@dataclass(frozen=True)
class RossLi(ScalarBase):
    """A base of three kernels, pi f = f_iso + f_vol K_vol + f_geo K_geo; reciprocal and unpolarized.

    K_vol is Ross's of a thick canopy, K_geo Li's of sparse crowns, reciprocal. Fitted to zenith angles up to about 75
    degrees: beyond, K_geo makes f negative, which is then taken as 0, with a FittedRangeWarning.

    Parameters
    ----------
    f_iso, f_vol, f_geo : float
        Weights of the kernels, 0 to 10, as MCD43 has them; f_vol and f_geo may be down to -10.
    crown_height : float, optional
        Of the middle of the crowns over their vertical radius, h/b, 0 to 10.
    crown_shape : float, optional
        Their vertical radius over the horizontal one, b/r, 0.1 to 10.
    hot_spot : bool, optional
        Whether K_vol has the hot spot of Maignan et al., 4/(3 pi) times the other but for constants.

    Raises
    ------
    SceneError
        Naming the field, or where f is negative, or more light is reflected than falls in, at zenith angles up to 75
        degrees.

    References
    ----------
    Lucht, Schaaf and Strahler, IEEE Trans. Geosci. Remote Sens. 38, 977 (2000), (38), (39); Maignan, Breon
    and Lacaze, Remote Sens. Environ. 90, 210 (2004).

    Examples
    --------
    >>> import vrte
    >>> vrte.RossLi(0.2, 0.1, 0.0).reflectance([0.5, 1.0]).round(4)
    array([0.227 , 0.1979])
    """

    f_iso: float
    f_vol: float
    f_geo: float
    crown_height: float = 2.0
    crown_shape: float = 1.0
    hot_spot: bool = False

    LIMITS: ClassVar = {
        "f_iso": (0.0, 10.0),
        "f_vol": (-10.0, 10.0),
        "f_geo": (-10.0, 10.0),
        "crown_height": (0.0, 10.0),
        "crown_shape": (0.1, 10.0),
    }

    def compute_f(self, angles: Angles) -> Array:
        volume = compute_ross_thick(angles, self.hot_spot)
        crowns = compute_li_sparse(angles, self.crown_height, self.crown_shape)
        return (self.f_iso + self.f_vol * volume + self.f_geo * crowns) / np.pi


def compute_ross_thick(angles: Angles, hot_spot: bool) -> Array:
    """Light scattered once by randomly turned leaves, above that of a black canopy at the zenith."""
    phase, both = angles.phase, angles.mu_i + angles.mu_o
    found: Array = ((0.5 * np.pi - phase) * np.cos(phase) + np.sin(phase)) / both
    if hot_spot:
        return 4.0 / (3.0 * np.pi) * found * (1.0 + 1.0 / (1.0 + phase / HOT_SPOT)) - 1.0 / 3.0
    return found - 0.25 * np.pi


def compute_li_sparse(angles: Angles, crown_height: float, crown_shape: float) -> Array:
    """Sunlit crowns and ground that are seen, of spheroids that hardly shadow each other, made reciprocal; crowns as
    spheres, which stretch the tangents of zenith angles by their shape."""
    tan_i, tan_o = crown_shape * angles.tan_i, crown_shape * angles.tan_o
    sec_i, sec_o = np.sqrt(1.0 + tan_i**2), np.sqrt(1.0 + tan_o**2)
    across = crown_shape * angles.distance, tan_i * tan_o * np.sqrt(np.maximum(1.0 - angles.cos_phi**2, 0.0))
    t = np.arccos(np.minimum(crown_height * np.hypot(*across) / (sec_i + sec_o), 1.0))
    overlap = (t - np.sin(t) * np.cos(t)) / np.pi * (sec_i + sec_o)
    lit = 0.5 * (sec_i * sec_o + 1.0 - tan_i * tan_o * angles.cos_phi)  # (1 + cos g) sec_i sec_o/2 of the spheres
    return overlap - sec_i - sec_o + lit
