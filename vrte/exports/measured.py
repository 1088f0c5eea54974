"""The measured material of the RGL (Dupuy and Jakob 2018), which Mitsuba's ``measured`` and pbrt-v4 read and sample.

Light comes along i and is seen along o; both lie in the upper hemisphere, and m halves the angle between them. m has
the coordinates u = sqrt(2 theta_m / pi) and azimuth about i's, each from 0 to 1. The field ``vndf`` is a density over
them, for each angle of incidence, whose cumulative integrals take m to a unit square: first the azimuth, then u in its
row. ``spectra`` is the BRDF times the cosine of o, over that square, and ``luminance`` the density with which a
renderer chooses points of it. Here ``vndf`` is even over all m that send light above the horizon, so that one edge of
the square is the horizon, where spectra and luminance are 0; luminance follows the BRDF, cosine included, and so does
sampling. ``ndf`` is 1 and ``sigma`` 1/4: the factor ndf/(4 sigma) of the format is 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.exports.lobes import Lobes, follow_intensities
from vrte.formats.atomic import PathName
from vrte.formats.measured_polarized import make_unit_vectors, write_tensors
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Spectrum

INCIDENT, SIDE = 32, 48  # angles of incidence; points along a side of the unit square
ROWS, COLUMNS = 33, 65  # of vndf: azimuths and u
STEEPEST = 89.0  # degrees, of the angles of incidence
LEAST = 1e-3  # of the density where no light leaves: what a renderer inverts must be above 0
NOTE = (
    "spectra is the BRDF in sr-1 of unpolarized light times the cosine of exit, over (phi_i, theta_i, wavelength, "
    "azimuth, u) of the unit square to which vndf takes half vectors; angles in rad, wavelengths in nm; ndf/(4 sigma) "
    "is 1; description is UTF-8"
)


@dataclass(frozen=True, eq=False)
class MeasuredFile:
    """What a file holds: arrays by the names of its fields."""

    fields: dict[str, NDArray[Any]]

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What a renderer makes of the file: (k, n, wavelength, 1, 1) [sr-1]."""
        found = []
        for angle, seen, azimuth in zip(np.arccos(mu_i).tolist(), mu_o, np.radians(phi) + np.pi, strict=True):
            half = make_unit_vectors(seen, azimuth) + np.array([np.sin(angle), 0.0, np.cos(angle)])
            theta_m = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2])
            turned = np.arctan2(half[:, 1], half[:, 0]) / (2.0 * np.pi) + 0.5
            density, spectra = (self.interpolate_incident(name, angle) for name in ("vndf", "spectra"))
            square = map_to_square(density, np.sqrt(2.0 / np.pi * theta_m), turned)
            found.append(interpolate(np.moveaxis(spectra, 0, -1), *square) / seen[:, None])
        return np.stack(found)[..., None, None]

    def interpolate_incident(self, name: str, angle: float) -> Array:
        """A field at an angle of incidence [rad], on straight lines between its own."""
        own = self.fields["theta_i"].astype(float)
        place = float(np.interp(angle, own, np.arange(own.size)))
        return interpolate_rows(self.fields[name][0].astype(float), np.array([place / (own.size - 1)]))[0]

    def write(self, path: PathName, text: str) -> None:
        """Writes the file, all or nothing. Raises OSError."""
        write_tensors(self.fields | {"description": np.frombuffer(text.encode(), np.uint8)}, path)


def tabulate_measured(spectrum: Spectrum, surfaces: Sequence[RoughSurface | None]) -> MeasuredFile:
    """The file of a spectrum at `directions`, under these rough surfaces."""
    return MeasuredFile(tabulate(follow_intensities(spectrum.brdfs, surfaces), spectrum.wavelength_um))


def tabulate(lobes: Lobes, wavelength_um: Array) -> dict[str, NDArray[Any]]:
    """The fields of a file, but ``description``, of intensities (pairs, wavelength) [sr-1]."""
    theta_i = np.radians(STEEPEST) * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, INCIDENT))
    even = np.linspace(0.0, 1.0, SIDE)
    vndf = np.stack([spread_evenly(angle) for angle in theta_i])
    spectra = np.empty((INCIDENT, wavelength_um.size, SIDE, SIDE))
    luminance = np.empty((INCIDENT, SIDE, SIDE))
    for place, (angle, density) in enumerate(zip(theta_i, vndf, strict=True)):
        u, azimuth = map_from_square(density, even, even)
        half = make_unit_vectors(np.cos(0.5 * np.pi * u**2).ravel(), (np.pi * (2.0 * azimuth - 1.0)).ravel())
        into = np.broadcast_to([np.sin(angle), 0.0, np.cos(angle)], half.shape)
        cosine = (into * half).sum(axis=1)
        out = 2.0 * cosine[:, None] * half - into
        found = lobes(into, out) * np.maximum(out[:, 2], 0.0)[:, None]
        spectra[place] = found.T.reshape(-1, SIDE, SIDE)
        # density over the square from one over directions o, whose solid angle is 4 cosine times that of m
        area = (u * np.sin(0.5 * np.pi * u**2)).ravel() * cosine
        there = interpolate(density, u, azimuth).ravel()
        luminance[place] = (found.mean(axis=1) * area / there).reshape(SIDE, SIDE)
    tables = {"theta_i": theta_i, "phi_i": np.zeros(1), "ndf": np.ones((2, 2)), "sigma": np.full((2, 2), 0.25)}
    tables |= {"vndf": vndf[None], "luminance": luminance[None], "spectra": spectra[None]}
    tables |= {"wavelengths": 1e3 * wavelength_um}
    return {name: values.astype(np.float32) for name, values in tables.items()} | {"jacobian": np.ones(1, np.uint8)}


def spread_evenly(theta_i: float) -> Array:
    """The density (azimuth, u): 1 for half vectors that send light from ``theta_i`` [rad] above the horizon."""
    azimuth = np.linspace(-np.pi, np.pi, ROWS)[:, None]
    last = 0.25 * np.pi + 0.5 * np.arctan2(np.sin(theta_i) * np.cos(azimuth), np.cos(theta_i))
    u = np.linspace(0.0, 1.0, COLUMNS)
    within = (np.sqrt(2.0 / np.pi * np.maximum(last, 0.0)) - u) * (COLUMNS - 1) + 0.5  # cells that the horizon cuts
    return np.clip(within, LEAST, 1.0)


def integrate(density: Array, at: Array) -> Array:
    """Integrals (..., n) from 0 to ``at`` (n,) of straight lines through a density (..., m) at even points up to 1."""
    steps = density.shape[-1] - 1
    sums = 0.5 * (density[..., 1:] + density[..., :-1])
    sums = np.concatenate([np.zeros((*density.shape[:-1], 1)), sums.cumsum(axis=-1)], axis=-1)
    cell = np.minimum((at * steps).astype(int), steps - 1)
    part = at * steps - cell
    first, second = density[..., cell], density[..., cell + 1]
    return np.asarray((sums[..., cell] + part * (first + 0.5 * part * (second - first))) / steps)


def find_fractiles(density: Array, fractions: Array) -> Array:
    """Where the integral of straight lines through a density (m,) reaches ``fractions`` (n,) of all of it."""
    steps = density.size - 1
    sums = np.append(0.0, 0.5 * (density[1:] + density[:-1])).cumsum()
    wanted = fractions * sums[-1]
    cell = np.clip(np.searchsorted(sums, wanted, "right") - 1, 0, steps - 1)
    rest, first = wanted - sums[cell], density[cell]
    root = np.sqrt(np.maximum(first**2 + 2.0 * (density[cell + 1] - first) * rest, 0.0))
    return np.asarray(np.clip((cell + 2.0 * rest / np.maximum(first + root, 1e-300)) / steps, 0.0, 1.0))


def map_from_square(density: Array, across: Array, along: Array) -> tuple[Array, Array]:
    """u and azimuth (along, across) of the points of the square, by a density (azimuth, u)."""
    azimuth = find_fractiles(integrate(density, np.ones(1))[:, 0], along)
    rows = interpolate_rows(density, azimuth)
    return np.stack([find_fractiles(row, across) for row in rows]), np.repeat(azimuth[:, None], across.size, axis=1)


def map_to_square(density: Array, u: Array, azimuth: Array) -> tuple[Array, Array]:
    """Points (n,), (n,) of the square, across and along, of u and azimuth (n,)."""
    rows = integrate(density, np.ones(1))[:, 0]
    along = integrate(rows, azimuth) / integrate(rows, np.ones(1))
    last, integrals = len(rows) - 1, integrate(density, np.append(u, 1.0))
    cell = np.minimum((azimuth * last).astype(int), last - 1)
    part = azimuth * last - cell  # of each point's own column alone
    own, whole = ((1.0 - part) * integrals[cell, k] + part * integrals[cell + 1, k] for k in (np.arange(u.size), -1))
    return own / whole, along


def interpolate_rows(values: Array, at: Array) -> Array:
    """Values (n, ...) on straight lines between rows (m, ...) at even points of 0 to 1."""
    cell = np.minimum((at * (len(values) - 1)).astype(int), len(values) - 2)
    part = (at * (len(values) - 1) - cell).reshape(-1, *(1 for _ in values.shape[1:]))
    return np.asarray((1.0 - part) * values[cell] + part * values[cell + 1])


def interpolate(values: Array, across: Array, along: Array) -> Array:
    """Values at points (...) of the square, bilinear between those (m, n, ...) at even points along and across."""
    rows = interpolate_rows(values, along.ravel())
    cell = np.minimum((across.ravel() * (values.shape[1] - 1)).astype(int), values.shape[1] - 2)
    part = (across.ravel() * (values.shape[1] - 1) - cell).reshape(-1, *(1 for _ in values.shape[2:]))
    nth = np.arange(len(rows))
    found = (1.0 - part) * rows[nth, cell] + part * rows[nth, cell + 1]
    return np.asarray(found.reshape(*across.shape, *values.shape[2:]))
