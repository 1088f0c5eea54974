"""Mitsuba's BSDF ``measured_polarized``: Mueller matrices over Rusinkiewicz angles, at five wavelengths.

formats/measured_polarized.py tells its axes, and reads such files.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.basics.splines import MIRROR
from vrte.exports.lobes import Lobes, follow_mueller
from vrte.formats.atomic import PathName
from vrte.formats.measured_polarized import AXES, Axes, evaluate_table, make_pairs, turn, write_tensors
from vrte.optics.facets import RoughSurface
from vrte.results.brdf import Spectrum

WAVELENGTHS = 5  # in Mitsuba's code
USUAL_UM = (0.45, 0.5, 0.55, 0.6, 0.65)
NOTE = (
    "M is the BRDF in sr-1 without the cosine, axes (phi_d, theta_d, theta_h, wavelength, out, in); its Stokes axes "
    "are perpendicular to the plane of the light's and the view's directions, not meridian planes; description is UTF-8"
)
STEP = 2.5  # degrees between the file's theta_d and theta_h by default; phi_d has twice that
FINEST, COARSEST = 0.5, 15.0
FLOOR = 0.25  # of the step: smallest cosine in the table, for at the horizon f itself may have no bound
CHUNK = 1 << 17  # pairs of directions at a time


@dataclass(frozen=True, eq=False)
class PolarizedFile:
    """What a file holds: ``table`` M (phi_d, theta_d, theta_h, wavelength, 4, 4) [sr-1] over ``axes`` [rad]."""

    nanometres: NDArray[np.uint16]
    axes: Axes
    table: NDArray[np.float32]

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What Mitsuba makes of the file: (k, n, wavelength, 4, 4) [sr-1], in meridian planes."""
        found = evaluate_table(self.table, self.axes, *make_pairs(mu_i[:, None], mu_o, phi))
        return found.reshape(*mu_o.shape, *found.shape[1:])

    def write(self, path: PathName, text: str) -> None:
        """Writes the file, all or nothing. Raises OSError."""
        fields: dict[str, Any] = {name: self.axes[k][None].astype(np.float32) for k, name in enumerate(AXES)}
        fields |= {"wvls": self.nanometres, "M": self.table, "description": np.frombuffer(text.encode(), np.uint8)}
        write_tensors(fields, path)


def tabulate_polarized(
    spectrum: Spectrum, surfaces: Sequence[RoughSurface | None], step_deg: float | None = None
) -> PolarizedFile:
    """The file of a spectrum at `directions`, under these rough surfaces."""
    axes = make_axes(STEP if step_deg is None else step_deg)
    return PolarizedFile(check_wavelengths(spectrum.wavelength_um), axes, tabulate(spectrum, surfaces, axes))


def make_axes(step_deg: float) -> Axes:
    """Axes with that step in theta, or the next smaller one that divides 90 degrees."""
    step = check_number("step_deg", step_deg, FINEST, COARSEST, f"between {FINEST:g} and {COARSEST:g} degrees")
    count = math.ceil(90.0 / step - 1e-9)
    theta = np.linspace(0.0, 0.5 * np.pi, count + 1)
    return np.linspace(-np.pi, np.pi, 2 * count + 1), theta, theta


def choose_five(listed: Sequence[float]) -> Sequence[float]:
    """Five wavelengths [um]: those that are listed, or from the first to the last of them; else of the visible."""
    if len(listed) < 2:
        return USUAL_UM
    ends = listed[0], listed[-1]
    return listed if len(listed) == WAVELENGTHS else np.linspace(*ends, WAVELENGTHS).round(3).tolist()


def check_wavelengths(wavelengths_um: Sequence[float] | Array) -> NDArray[np.uint16]:
    """The wavelengths in nanometres, if they are five whole ones. Raises SceneError."""
    if len(wavelengths_um) != WAVELENGTHS:
        words = f"exactly {WAVELENGTHS} wavelengths, not {len(wavelengths_um)}"
        raise SceneError(f"Mitsuba's measured_polarized takes {words}")
    nanometres = 1e3 * np.asarray(wavelengths_um)
    if np.abs(nanometres - nanometres.round()).max() > 1e-6 or nanometres[-1] > np.iinfo(np.uint16).max:
        raise SceneError("Mitsuba's measured_polarized takes wavelengths of whole nanometres, up to 65535")
    return nanometres.round().astype(np.uint16)


def tabulate(spectrum: Spectrum, surfaces: Sequence[RoughSurface | None], axes: Axes) -> NDArray[np.float32]:
    """The field M (phi_d, theta_d, theta_h, wavelength, 4, 4) [sr-1]: mirror symmetry gives the half with phi_d < 0."""
    phi_d, theta_d, theta_h = axes
    half = phi_d.size // 2
    into, out, across = make_direction_pairs((phi_d[half:], theta_d, theta_h))
    lowest = FLOOR * math.sin(theta_h[1])
    found = np.empty((phi_d.size, theta_d.size, theta_h.size, len(spectrum), 4, 4), np.float32)
    for index, one in enumerate(spectrum):
        lobes = follow_mueller(one, surfaces[index])
        matrices = sample_in_scattering_plane(lobes, into, out, across, lowest)
        matrices = matrices.reshape(-1, theta_d.size, theta_h.size, 4, 4)
        found[half:, :, :, index] = matrices
        found[:half, :, :, index] = (matrices * MIRROR)[:0:-1]
    return found


def make_direction_pairs(axes: Axes) -> tuple[Array, Array, Array]:
    """Directions of light and view away from the surface, and the normal of their plane, each (pairs, 3), z upward: the
    half vector lies in y = 0; across is half vector x difference vector."""
    phi, spread, half = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    middle = np.stack([np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    tangent = np.stack([np.cos(half), 0.0 * half, -np.sin(half)], axis=1)
    aside = np.cos(phi)[:, None] * tangent + np.sin(phi)[:, None] * np.array([0.0, 1.0, 0.0])
    along, sideways = np.cos(spread)[:, None] * middle, np.sin(spread)[:, None] * aside
    return along + sideways, along - sideways, np.cross(middle, aside)


def sample_in_scattering_plane(lobes: Lobes, into: Array, out: Array, across: Array, lowest: float) -> Array:
    """The BRDF (pairs, 4, 4) in Mitsuba's axes: one is ``across``, perpendicular to the plane of both directions."""
    found = np.empty((len(into), 4, 4))
    for start in range(0, len(into), CHUNK):
        part = slice(start, start + CHUNK)
        from_light, to_view = turn(-into[part], across[part]), turn(out[part], across[part])
        found[part] = to_view @ lobes(into[part], out[part], lowest) @ from_light.swapaxes(1, 2)
    return found
