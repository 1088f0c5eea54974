"""Mueller matrices over half vectors, as the Mitsuba plugin `vrte.mitsuba` interpolates and samples them.

For a view at the angle theta from the normal, half vectors m have the angle theta_m = last sin^2(90 degrees s) and the
azimuth 180 degrees t from the view's; last is where the light's direction 2 (v m) m - v meets the horizon. Lobes of
facets lie at s = 0 for each view, and the horizon at s = 1. Stokes axes are perpendicular to the plane of light and
view and in it, as in a .pbsdf. The matrices are tabulated times mu_i + mu_o, which is even where light grazes.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.splines import MIRROR, compute_coefficients, make_spline_matrix, stretch_cosines
from vrte.exports.lobes import follow_intensities, follow_mueller
from vrte.exports.polarized import sample_in_scattering_plane
from vrte.formats.atomic import PathName
from vrte.formats.measured_polarized import make_pairs, make_unit_vectors, normalise, turn
from vrte.formats.result_file import save
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Brdf, Spectrum

VIEWS, AZIMUTHS, SPREADS = 48, 37, 56  # angles of view, t from 0 to 1, s from 0 to 1
BEAMS = 256  # angles of a mirrored beam
STEEPEST = np.radians(89.0)  # of the angles of view: beyond, BRDFs are those of this angle
LOWEST = 1e-3  # smallest cosine of the light: nearer to the horizon, BRDFs are those of this cosine
FEWEST = 8  # cosines and azimuths of a result that is interpolated
FACETS, EXPORT = "facets_on_top", "export"  # in diagnostics: the rough surface that light meets first; what was said
NOTE = "a result as vrte.load reads it, for the BSDF vrte that import vrte.mitsuba registers"


@dataclass(frozen=True, eq=False)
class HalfVectorTable:
    """``values`` (theta, t, s, wavelength, 4, 4), or (..., 1, 1) of unpolarized light: BRDF [sr-1] times mu_i + mu_o;
    ``beam`` (theta, wavelength, 4, 4) or (..., 1, 1): the fraction that is mirrored as a beam, None without one."""

    wavelength_um: Array
    values: NDArray[np.float32]
    beam: NDArray[np.float32] | None

    @cached_property
    def density(self) -> Array:
        """What directions are sampled by, (theta, t, s): BRDF times the cosine of the light, mean over wavelengths, per
        ds dt; its sum over the unit square is the reflectance."""
        theta, t, s = (axis.ravel() for axis in np.meshgrid(*make_axes(), indexing="ij"))
        light, view, area = place_light(theta, t, s)
        mean = self.values[..., 0, 0].mean(axis=-1).ravel()
        cosine = np.maximum(light[:, 2], 0.0)
        return np.asarray((mean * cosine * area / (cosine + view[:, 2])).reshape(self.values.shape[:3]))

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What the plugin makes of the table: (k, n, wavelength, 4, 4) [sr-1], in meridian planes."""
        from scipy.interpolate import RegularGridInterpolator

        light, view = make_pairs(mu_i[:, None], mu_o, phi)
        x, t, s, side = find_place(light, view)
        grids = [np.linspace(0.0, 1.0, count) for count in self.values.shape[:3]]
        found = RegularGridInterpolator(grids, self.values)(np.stack([x, t, s], axis=1))
        found[side < 0.0] *= MIRROR
        found /= (np.maximum(light[:, 2], LOWEST) + view[:, 2])[:, None, None, None]
        across = find_across(light, view)
        from_light, to_view = turn(-light, across)[:, None], turn(view, across)[:, None]
        found = to_view.swapaxes(2, 3) @ found @ from_light
        return found.reshape(*mu_o.shape, *found.shape[1:])


@dataclass(frozen=True, eq=False)
class ResultFile:
    """A result, which notes the rough surface on top in its diagnostics, and the table that is made of it."""

    spectrum: Spectrum
    table: HalfVectorTable

    @classmethod
    def make(cls, spectrum: Spectrum, surfaces: Sequence[RoughSurface | None]) -> "ResultFile":
        """The file of a spectrum at `directions`, under these rough surfaces."""
        noted = [
            surface and asdict(surface) | {"index": [complex(surface.index).real, complex(surface.index).imag]}
            for surface in surfaces
        ]
        brdfs = tuple(add_notes(one, {FACETS: surface}) for one, surface in zip(spectrum, noted, strict=True))
        return cls(Spectrum(spectrum.wavelength_um, brdfs), tabulate_half_vectors(spectrum, surfaces))

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What the plugin makes of the file: (k, n, wavelength, 4, 4) [sr-1], in meridian planes."""
        return self.table.evaluate(mu_i, mu_o, phi)

    def write(self, path: PathName, text: str) -> None:
        """Writes the file, all or nothing. Raises OSError, MissingExtraError."""
        first, *others = self.spectrum.brdfs
        save(Spectrum(self.spectrum.wavelength_um, (add_notes(first, {EXPORT: text}), *others)), path)


def add_notes(one: Brdf, noted: dict[str, Any]) -> Brdf:
    """The same BRDF with more in its diagnostics."""
    return replace(one, diagnostics=one.diagnostics | noted)


def make_axes() -> tuple[Array, Array, Array]:
    """Angles of view [rad], t and s of a table."""
    x, t, s = (np.linspace(0.0, 1.0, count) for count in (VIEWS, AZIMUTHS, SPREADS))
    return STEEPEST * np.sin(0.5 * np.pi * x), t, s


def find_last(theta: Array, cos_azimuth: Array) -> Array:
    """The angle [rad] of half vectors that send light from the horizon to a view at ``theta`` [rad]."""
    return np.asarray(0.25 * np.pi + 0.5 * np.arctan2(np.sin(theta) * cos_azimuth, np.cos(theta)))


def place_light(theta: Array, t: Array, s: Array) -> tuple[Array, Array, Array]:
    """Directions of light and view (n, 3), and the solid angle of light per ds dt, both halves together."""
    last = find_last(theta, np.cos(np.pi * t))
    theta_m, slope = last * np.sin(0.5 * np.pi * s) ** 2, 0.5 * np.pi * last * np.sin(np.pi * s)
    half = make_unit_vectors(np.cos(theta_m), np.pi * t)
    view = make_unit_vectors(np.cos(theta), 0.0 * theta)
    cosine = (view * half).sum(axis=1)
    area = 2.0 * np.sin(theta_m) * slope * np.pi * 4.0 * cosine
    return 2.0 * cosine[:, None] * half - view, view, area


def find_place(light: Array, view: Array) -> tuple[Array, Array, Array, Array]:
    """x of the angle of view, t and s (n,) from 0 to 1, and on which side of the view the half vector is."""
    half = light + view
    theta = np.minimum(np.arccos(view[:, 2]), STEEPEST)
    beside = view[:, 0] * half[:, 1] - view[:, 1] * half[:, 0]
    azimuth = np.arctan2(beside, (view[:, :2] * half[:, :2]).sum(axis=1))
    last = find_last(theta, np.cos(azimuth))
    part = np.arctan2(np.hypot(half[:, 0], half[:, 1]), half[:, 2]) / last
    x, s = (np.arcsin(np.minimum(sine, 1.0)) / (0.5 * np.pi) for sine in (theta / STEEPEST, np.sqrt(part)))
    return x, np.abs(azimuth) / np.pi, s, np.where(azimuth < 0.0, -1.0, 1.0)


def find_across(light: Array, view: Array) -> Array:
    """Normals (n, 3) of the planes of light and view; where both are one direction, of that with the normal."""
    across = np.cross(light, view)
    same = np.linalg.norm(across, axis=1) < 1e-7
    across[same] = np.cross([1e-9, 0.0, 1.0], view[same])
    return normalise(across)


def tabulate_half_vectors(
    spectrum: Spectrum, surfaces: Sequence[RoughSurface | None], polarized: bool = True
) -> HalfVectorTable:
    """The table of a spectrum at `directions`, under these rough surfaces."""
    axes = make_axes()
    light, view, _ = place_light(*(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")))
    across = find_across(light, view)
    weight = (np.maximum(light[:, 2], LOWEST) + view[:, 2])[:, None, None]
    values = np.empty((len(light), len(spectrum), *((4, 4) if polarized else (1, 1))), np.float32)
    if polarized:
        for index, (one, surface) in enumerate(zip(spectrum, surfaces, strict=True)):
            lobes = follow_mueller(one, surface)
            values[:, index] = weight * sample_in_scattering_plane(lobes, light, view, across, LOWEST)
    else:
        values[..., 0, 0] = weight[:, 0] * follow_intensities(spectrum.brdfs, surfaces)(light, view, LOWEST)
    values = values.reshape(*(axis.size for axis in axes), *values.shape[1:])
    return HalfVectorTable(spectrum.wavelength_um, values, tabulate_beam(spectrum, polarized))


def tabulate_beam(spectrum: Spectrum, polarized: bool) -> NDArray[np.float32] | None:
    """The mirrored fraction (theta, wavelength, 4, 4) or (..., 1, 1) of a spectrum, in the plane of incidence."""
    beams = spectrum.specular
    if beams is None or not beams.any():
        return None
    theta = STEEPEST * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, BEAMS))
    grid = stretch_cosines(spectrum.mu_i)
    splines = compute_coefficients((grid,), np.moveaxis(beams, 1, 0).reshape(grid.size, -1))
    found = make_spline_matrix((grid,), (stretch_cosines(np.cos(theta)),)) @ splines
    found = found.reshape(BEAMS, -1, 4, 4)
    if not polarized:
        return found[..., :1, :1].astype(np.float32)
    view = make_unit_vectors(np.cos(theta), 0.0 * theta)
    across = np.broadcast_to([0.0, 1.0, 0.0], view.shape)
    light = view * [-1.0, -1.0, 1.0]
    turned = turn(view, across)[:, None] @ found @ turn(-light, across)[:, None].swapaxes(2, 3)
    return np.asarray(turned, np.float32)


def check_directions(one: Brdf) -> None:
    """Whether a BRDF is known all over the hemisphere. Raises SceneError."""
    words = "cover the hemisphere, as `vrte export SCENE.toml -o RESULT.nc` asks for them"
    if one.diagnostics.get("illuminate", "top") != "top":
        raise SceneError("a renderer's surface is lit from the top: the result's illuminate must be 'top'")
    if not np.array_equal(one.mu_i, one.mu_o) or np.any(np.diff(one.mu_i) >= 0.0):
        raise SceneError(f"mu_i and mu_o must be the same descending cosines and {words}")
    if one.mu_i.size < FEWEST or one.mu_i[0] < 0.99 or one.mu_i[-1] > 0.05:
        raise SceneError(f"mu_i must be {FEWEST} or more, from above 0.99 to below 0.05, and {words}")
    if one.phi.size < FEWEST or one.phi[0] != 0.0 or one.phi[-1] != 180.0 or np.any(np.diff(one.phi) <= 0.0):
        raise SceneError(f"phi must be {FEWEST} or more azimuths, ascending from 0 to 180 degrees, and {words}")
