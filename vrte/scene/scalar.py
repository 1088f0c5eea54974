"""Bases known by their reflectance alone: light leaves them unpolarized, whatever its polarization was.

Rahman, Pinty and Verstraete's: vegetation, soil and snow as satellites see them. Ross-Li: land as MODIS reports it, a
sum of three kernels. Hapke's: a regolith, a semi-infinite powder whose grains hide their shadows.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, check_choice
from vrte.basics.errors import FittedRangeWarning, SceneError, warn_user
from vrte.scene.boundary import CHECKED_COSINES, COARSE, ENERGY_ALLOWED, GRAZING, SampledBase

FORMULA_COSINES = np.concatenate([[0.01, 0.03], np.arange(0.06, 1.01, 0.04), [1.0]])  # of both directions, in checks
AZIMUTHS = np.linspace(0.0, 180.0, 13)
STEEPEST = np.cos(np.radians(75.0))  # cosines above were measured, and formulas fitted to them


class Angles(NamedTuple):
    """Directions of light that comes and goes: cosines and tangents of zenith angles, cosine of the azimuth between (0
    ahead), distance on a plane one unit above, phase angle [rad], 0 straight back."""

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
        """The phase function P of a grain, mean 1, at the cosine of the phase angle (...), 1 straight back."""
        a = self.asymmetry
        legendre = 1.0 + self.linear * cosine + self.quadratic * 0.5 * (3.0 * cosine**2 - 1.0)
        return legendre * (1.0 - a * a) / (1.0 + a * a + 2.0 * a * cosine) ** 1.5

    def compute_f(self, angles: Angles) -> Array:
        many_i, many_o = (H_FUNCTIONS[self.h_function](self.albedo, mu) for mu in (angles.mu_i, angles.mu_o))
        opposition = self.opposition * self.width / (self.width + np.tan(0.5 * angles.phase))
        once = (1.0 + opposition) * self.compute_phase_function(np.cos(angles.phase))
        return self.albedo / (4.0 * np.pi) / (angles.mu_i + angles.mu_o) * (once + many_i * many_o - 1.0)
