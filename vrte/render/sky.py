"""The light: the sun, the Stokes vectors of the sky that it makes in an atmosphere of molecules, and their colours.

The sky is solved by this package, one Rayleigh layer over a Lambertian ground for each wavelength, for a sun of
irradiance 1 outside the atmosphere. The sun's own spectrum there (ASTM G173) joins the colour-matching functions of
CIE 1931, 1 nm by 1 nm, so that few wavelengths do; XYZ become sRGB as a camera sets it, balanced and exposed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.appearance.colours import (
    balance_for_screen,
    combine_with_observer,
    encode_srgb,
    import_colour_science,
    spread_weights,
)
from vrte.basics.arrays import Array
from vrte.basics.splines import compute_coefficients, make_spline_matrix
from vrte.calls.radiance import radiance
from vrte.optics.phase_matrix import rayleigh
from vrte.scene.boundary import Lambertian
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

KINDS = ("rayleigh", "uniform", "sun")
DEPOLARIZATION = 0.0279  # of air; Young, Applied Optics 19, 3427 (1980)
AZIMUTHS = 8  # molecules scatter into the orders 0, 1 and 2 alone: so many equal steps know them exactly
ANGLES = 64  # from the zenith to the horizon, closer there, where the sky brightens within a few degrees
STEEPEST = 1e-4  # cosine of what counts as the horizon
SKY_ACCURACY = 1e-5


@dataclass(frozen=True, eq=False)
class Sky:
    """Light that falls on an object, at each wavelength: ``sun`` (wavelength,) [W m-2], the irradiance of the
    unpolarized beam along ``beam`` (3,) at the ground; ``splines`` (wavelength, theta, 3, 4) of the sky's Fourier
    orders 0 to 2 in azimuth over ``theta`` [rad] from the zenith; ``ground`` (wavelength,), the radiance from below."""

    sun: Array
    beam: Array
    theta: Array
    splines: Array
    ground: Array

    def choose(self, which: Any) -> "Sky":
        """The light at these wavelengths alone."""
        return replace(self, sun=self.sun[which], splines=self.splines[which], ground=self.ground[which])

    def find(self, travel: Array) -> Array:
        """Stokes radiance (n, wavelength, 3), V being 0, of skylight along ``travel`` (n, 3), in the vertical's
        frame."""
        above = make_spline_matrix((self.theta,), (np.arccos(np.clip(-travel[:, 2], STEEPEST, 1.0)),))
        orders = above @ np.moveaxis(self.splines[..., :3], 0, 1).reshape(self.theta.size, -1)
        azimuth = np.arctan2(travel[:, 1], travel[:, 0]) - np.arctan2(self.beam[1], self.beam[0])
        angles = azimuth[:, None] * np.arange(3)
        even, odd = np.cos(angles), np.sin(angles)
        return np.einsum("nwms,nms->nws", orders.reshape(-1, self.sun.size, 3, 3), np.stack([even, even, odd], axis=-1))


def compute_optical_thickness(wavelength_um: Any) -> Array:
    """Optical thickness of the molecules above sea level, 1013.25 hPa, 45 degrees latitude, to 0.01 % from 0.25 to
    0.85 um: Bodhaine, Wood, Dutton and Slusser, J. Atmos. Oceanic Technol. 16, 1854 (1999), equation 30."""
    square = np.asarray(wavelength_um, dtype=float) ** 2
    return (
        0.0021520
        * (1.0455996 - 341.29061 / square - 0.90230850 * square)
        / (1.0 + 0.0027059889 / square - 85.968563 * square)
    )


def make_sky(kind: str, wavelengths_um: Sequence[float], elevation_deg: float, ground_albedo: float) -> Sky:
    """The light of ``kind``: "rayleigh", "sun" (no atmosphere, a black sky) or "uniform" (radiance 1 from all sides);
    the sun stands at this elevation, at azimuth 0. Raises whatever `vrte.radiance` does."""
    count = len(wavelengths_um)
    elevation = np.radians(elevation_deg)
    beam = -np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    theta = make_horizon_angles(ANGLES, STEEPEST)
    splines, ground, sun = np.zeros((count, theta.size, 3, 4)), np.zeros(count), np.zeros(count)
    if kind == "uniform":
        splines[:, :, 0, 0], ground[:] = 1.0, 1.0
    elif kind == "sun":
        sun[:] = 1.0
    else:
        for index, wavelength in enumerate(wavelengths_um):
            thickness = float(compute_optical_thickness(wavelength))
            parts = solve_rayleigh_sky(thickness, float(np.sin(elevation)), ground_albedo, theta)
            splines[index], ground[index], sun[index] = parts
    return Sky(sun, beam, theta, splines, ground)


def make_horizon_angles(count: int, steepest: float) -> Array:
    """Angles (count,) [rad] from 0 to arccos(steepest), closer to each other toward the horizon."""
    steps = np.linspace(0.0, 1.0, count)
    return np.arccos(steepest) * (0.33 * steps + 0.67 * np.sin(0.5 * np.pi * steps))


def solve_rayleigh_sky(thickness: float, mu0: float, albedo: float, theta: Array) -> tuple[Array, float, float]:
    """Spline coefficients (theta, order, 4) of the sky seen from the ground, the ground's radiance, the beam's."""
    scene = Scene([Layer(rayleigh(DEPOLARIZATION), 1.0, thickness)], Lambertian(albedo))
    steps = np.arange(AZIMUTHS) * (360.0 / AZIMUTHS)
    field = radiance(scene, mu0, mu=-np.cos(theta), phi=steps, tau=thickness, accuracy=SKY_ACCURACY)
    spectrum = np.fft.rfft(field.stokes[0], axis=1)[:, :3] * (2.0 / AZIMUTHS)
    spectrum[:, 0] *= 0.5
    orders = np.concatenate([spectrum[..., :2].real, -spectrum[..., 2:].imag], axis=-1)
    ground = albedo * float(field.flux_down[0] + field.direct[0]) / np.pi
    return compute_coefficients((theta,), orders), ground, float(np.exp(-thickness / mu0))


FEWEST, MOST = 9, 31  # wavelengths, where their number is given
FROM_UM, TO_UM = 0.40, 0.70
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB
NEEDED = "a picture in colour", "render"  # what for, and the extra that brings it


def choose_wavelengths(count: int, low: float = FROM_UM, high: float = TO_UM) -> Array:
    """``count`` wavelengths [um] in equal steps over what of 0.40 to 0.70 lies between ``low`` and ``high``."""
    low, high = max(low, FROM_UM), min(high, TO_UM)
    return np.linspace(low, high, count).round(6).clip(low, high)


def weigh_wavelengths(wavelengths_um: Array) -> Array:
    """(3, wavelength): weights of radiances in sunlight in X, Y, Z (2 degrees), Y = 1 of 1. Raises
    MissingExtraError."""
    import_colour_science(*NEEDED)
    return spread_weights(wavelengths_um, *combine_with_observer(load_sunlight_spectrum, observer=2))


def load_sunlight_spectrum(wavelengths_um: Array) -> Array:
    """Spectral irradiance of the sun outside the atmosphere [W m-2 nm-1], of ASTM G173."""
    import_colour_science(*NEEDED)
    from colour.plotting.datasets import SD_ASTMG173_ETR

    return np.interp(wavelengths_um * 1e3, SD_ASTMG173_ETR.wavelengths, SD_ASTMG173_ETR.values)


@dataclass(frozen=True, eq=False)
class Film:
    """``matrix`` (3, 3) takes XYZ to exposed linear sRGB, the light's white to the screen's."""

    matrix: Array

    def linear(self, xyz: Array) -> Array:
        """Linear sRGB (..., 3), where 1 is the brightest that a screen shows; not cut off."""
        return np.asarray(xyz @ self.matrix.T)

    def brightness(self, xyz: Array) -> Array:
        """The luminance (...) of linear sRGB, 1 for the screen's white."""
        return np.asarray(self.linear(xyz) @ LUMINANCE)

    def __call__(self, xyz: Array) -> Array:
        """sRGB (..., 3) from 0 to 1; what is out of reach is cut off."""
        return encode_srgb(self.linear(xyz))


def make_film(white_xyz: Array, stops: float = 0.0) -> Film:
    """Film for light of this white (3,): Y = 1 becomes the screen's brightest, each of ``stops`` doubles that."""
    import_colour_science(*NEEDED)
    return Film(2.0**stops * balance_for_screen((white_xyz / white_xyz[1]).tobytes()))
