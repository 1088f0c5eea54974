"""Hapke's base: a regolith, a semi-infinite powder whose grains hide their shadows."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vrte.basics.arrays import Array, check_choice
from vrte.basics.errors import SceneError
from vrte.scene.scalar import Angles, ScalarBase


def find_h_1981(albedo: float, mu: Array) -> Array:
    """Chandrasekhar's H of isotropic scattering, up to 4 per cent too small (Hapke 1981)."""
    return (1.0 + 2.0 * mu) / (1.0 + 2.0 * mu * np.sqrt(1.0 - albedo))


def find_h_2002(albedo: float, mu: Array) -> Array:
    """The same, up to 1 per cent too small (Hapke 2002)."""
    gamma = np.sqrt(1.0 - albedo)
    r_0 = (1.0 - gamma) / (1.0 + gamma)
    return 1.0 / (1.0 - albedo * mu * (r_0 + (0.5 - r_0 * mu) * np.log1p(1.0 / mu)))


H_FUNCTIONS = {"2002": find_h_2002, "1981": find_h_1981}


@dataclass(frozen=True)
class Hapke(ScalarBase):
    """A smooth regolith after Hapke: a base of closely packed grains, reciprocal and unpolarized.

    f = w/(4 pi (mu_i + mu_o)) ((1 + B) P + H(mu_i) H(mu_o) - 1).
    B = B_0/(1 + tan(g/2)/h) is the opposition effect at a phase angle g, P the phase function of a grain, either 1 +
    linear cos g + quadratic (3 cos^2 g - 1)/2 or Henyey and Greenstein's; H is that of grains that scatter evenly, by
    a formula. White powder gives back more than falls in, since B adds light, and is refused.

    Parameters
    ----------
    albedo : float
        Of a grain, w, 0 to 1.
    opposition : float, optional
        Strength of the opposition effect, B_0, 0 to 3; grains that do not let light through have 1.
    width : float, optional
        Its width, h, 0.001 to 10.
    linear, quadratic : float, optional
        Of the phase function in cos g, which must not be negative: above 0, ``linear`` sends light back.
    asymmetry : float, optional
        Of Henyey and Greenstein's, between -1 and 1, instead: below 0 it sends light back.
    h_function : {'2002', '1981'}, optional
        The formula for H: 1/(1 - w mu (r_0 + (1/2 - r_0 mu) ln((1 + mu)/mu))) with r_0 = (1 - gamma)/(1 + gamma), gamma
        = sqrt(1 - w), within 1 per cent; or (1 + 2 mu)/(1 + 2 mu gamma), within 4 per cent, as DISORT and VLIDORT have.

    Raises
    ------
    SceneError
        Naming the field, or where more light is reflected than falls in.

    References
    ----------
    Hapke, Theory of Reflectance and Emittance Spectroscopy (1993), (8.89), without roughness; for H Hapke, Icarus 157,
    523 (2002), and J. Geophys. Res. 86, 3039 (1981).

    Examples
    --------
    >>> import vrte
    >>> vrte.Hapke(0.6, linear=0.5).reflectance([0.5, 1.0]).round(4)
    array([0.2506, 0.2021])
    """

    albedo: float
    opposition: float = 1.0
    width: float = 0.06
    linear: float = 0.0
    quadratic: float = 0.0
    asymmetry: float = 0.0
    h_function: str = "2002"

    LIMITS: ClassVar = {
        "albedo": (0.0, 1.0),
        "opposition": (0.0, 3.0),
        "width": (1e-3, 10.0),
        "linear": (-2.0, 2.0),
        "quadratic": (-1.0, 2.0),
        "asymmetry": (-0.999, 0.999),
    }

    def check_formula(self) -> None:
        check_choice("base: h_function", self.h_function, H_FUNCTIONS)
        if self.asymmetry and (self.linear or self.quadratic):
            raise SceneError.of("base: asymmetry", "is instead of linear and quadratic: give one of both")
        lowest = self.compute_phase_function(np.linspace(-1.0, 1.0, 2001)).min()
        if lowest < 0.0:
            words = f"must give a phase function of at least 0 together with quadratic, not {lowest:.3g}"
            raise SceneError.of("base: linear", words)
        super().check_formula()

    def compute_phase_function(self, cosine: Array) -> Array:
        """The phase function P of a grain, its mean over the sphere 1, at the cosine of the phase angle (...), 1
        straight back."""
        a = self.asymmetry
        legendre = 1.0 + self.linear * cosine + self.quadratic * 0.5 * (3.0 * cosine**2 - 1.0)
        return legendre * (1.0 - a * a) / (1.0 + a * a + 2.0 * a * cosine) ** 1.5

    def compute_f(self, angles: Angles) -> Array:
        many_i, many_o = (H_FUNCTIONS[self.h_function](self.albedo, mu) for mu in (angles.mu_i, angles.mu_o))
        opposition = self.opposition * self.width / (self.width + np.tan(0.5 * angles.phase))
        once = (1.0 + opposition) * self.compute_phase_function(np.cos(angles.phase))
        return self.albedo / (4.0 * np.pi) / (angles.mu_i + angles.mu_o) * (once + many_i * many_o - 1.0)
