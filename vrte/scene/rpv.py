"""Rahman, Pinty and Verstraete's base: vegetation, soil and snow as satellites see them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vrte.basics.arrays import Array
from vrte.scene.scalar import Angles, ScalarBase


@dataclass(frozen=True)
class RPV(ScalarBase):
    """A base after Rahman, Pinty and Verstraete: bowl or bell shaped, with a hot spot; reciprocal and unpolarized.

    pi f = rho_0 (mu_i mu_o (mu_i + mu_o))^(k - 1) (1 - a^2)/(1 + a^2 + 2 a cos g)^(3/2) (1 + (1 - rho_c)/(1 + G)), with
    the asymmetry a, the phase angle g, and the distance G of both directions on a plane one unit above. Fitted to
    zenith angles up to about 75 degrees; for k < 1 it grows without bound at the horizon, where a FittedRangeWarning
    tells that more light is reflected than falls in.

    Parameters
    ----------
    rho_0 : float
        Its amplitude, 0 to 10.
    k : float
        Below 1 a bowl, brighter towards the horizon; above 1 a bell; 0 to 3.
    asymmetry : float, optional
        Of Henyey and Greenstein's function, between -1 and 1: below 0 it sends light back.
    rho_c : float or None, optional
        How weak the hot spot is, 0 to 2; as rho_0 (at most 2) where it is not given, 1 for none.

    Raises
    ------
    SceneError
        Naming the field, or where more light is reflected than falls in at zenith angles up to 75 degrees.

    References
    ----------
    Rahman, Pinty and Verstraete, J. Geophys. Res. 98, 20791 (1993).

    Examples
    --------
    >>> import vrte
    >>> vrte.RPV(0.1, 0.5, -0.5).reflect(0.8, 0.9, 180.0).shape
    (1, 1)
    """

    rho_0: float
    k: float
    asymmetry: float = 0.0
    rho_c: float | None = None

    LIMITS: ClassVar = {"rho_0": (0.0, 10.0), "k": (0.0, 3.0), "asymmetry": (-0.999, 0.999), "rho_c": (0.0, 2.0)}

    def compute_f(self, angles: Angles) -> Array:
        a, hot = self.asymmetry, min(self.rho_0, 2.0) if self.rho_c is None else self.rho_c
        bowl = (angles.mu_i * angles.mu_o * (angles.mu_i + angles.mu_o)) ** (self.k - 1.0)
        lobe = (1.0 - a * a) / (1.0 + a * a + 2.0 * a * np.cos(angles.phase)) ** 1.5
        return self.rho_0 / np.pi * bowl * lobe * (1.0 + (1.0 - hot) / (1.0 + angles.distance))
