"""A base from a file: a result of vrte, or a pBRDF that was measured, as Mitsuba's tensor file holds it."""

import math
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_number, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.splines import MIRROR
from vrte.formats.atomic import PathName, check_file, check_file_name
from vrte.formats.measured_polarized import AXES, Axes, directions, evaluate_table
from vrte.formats.mitsuba_files import read_tensors
from vrte.formats.result_file import load
from vrte.results.brdf import Brdf
from vrte.results.spectrum import Spectrum
from vrte.scene.tabulated_base import TabulatedBase

TENSORS = (".bsdf", ".pbsdf")
KEPT = 2  # bases of files
END = 1e-3  # rad that an angle may be off
SAME_WAVELENGTH = 1e-6  # um
SINGLE = 1e-5  # of the largest element: what single precision leaves of mirror symmetry
ASIDE = 1e-3  # degrees from the azimuths at which both directions make no plane, or the half vector is the normal


def read_base(
    path: str | os.PathLike[str], wavelength_um: float | None = None, average_mirrored: bool = False
) -> TabulatedBase:
    """The base that a file holds: a BRDF, solved or measured.

    Parameters
    ----------
    path : path
        A result of `vrte.brdf` or `vrte.spectrum`, or a table of Mitsuba's BSDF ``measured_polarized``, whose name ends
        in .bsdf or .pbsdf: between its angles it is interpolated linearly, as Mitsuba does.
    wavelength_um : float, optional
        Which of the file's wavelengths [um]; where it holds one BRDF, that is taken for any.
    average_mirrored : bool, optional
        As for `vrte.TabulatedBase`: for measured ones that are not quite mirror-symmetric.

    Returns
    -------
    TabulatedBase
        In air, or in the medium that the result was found in.

    Raises
    ------
    SceneError
        For a file that holds none, a wavelength that it has not, and what is no surface.
    OSError
        Where the file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> import vrte
    >>> haze = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=1.0)])
    >>> mu = np.linspace(0.02, 1.0, 12)
    >>> vrte.brdf(haze, mu, mu, [0, 45, 90, 135, 180], nodes=4).save("haze.nc")
    >>> vrte.read_base("haze.nc")
    TabulatedBase(12 mu_i, 12 mu_o, 3 Fourier orders)
    """
    name = check_file_name(path)
    if Path(name).suffix.lower() in TENSORS:
        try:
            return read_measured(check_file(name), wavelength_um, average_mirrored)
        except SceneError as error:
            raise error if str(error).startswith(name) else error.behind(name) from error
    found = load(path)
    if isinstance(found, Spectrum):
        found = found[pick_wavelength(found.wavelength_um, wavelength_um)]
    if not isinstance(found, Brdf):
        raise SceneError(f"{name} holds a radiance field, and a base is a BRDF")
    return found.as_base(average_mirrored)


def read_base_once(path: Path, wavelength_um: float | None, average_mirrored: bool) -> TabulatedBase:
    """The same, from memory where the file is as it was: the scenes of a sweep have one base."""
    status = os.stat(path)
    return _read_as_it_was(path, status.st_mtime_ns, status.st_size, wavelength_um, average_mirrored)


@lru_cache(maxsize=KEPT)
def _read_as_it_was(path: Path, changed: int, size: int, *how: Any) -> TabulatedBase:
    return read_base(path, *how)


def pick_wavelength(own: Array, wanted: float | None) -> int:
    """Which of a file's wavelengths is wanted; None will do where there is one. Raises SceneError."""
    if wanted is None and own.size == 1:
        return 0
    listed = ", ".join(f"{one:g}" for one in own)
    allowed = f"one of the file's wavelengths, {put_in_one_line(listed, 200)}"
    if wanted is None:
        raise SceneError.of("wavelength_um", f"is needed: {allowed}")
    index = int(np.argmin(np.abs(own - check_number("wavelength_um", wanted, 0.0, math.inf, allowed))))
    if abs(own[index] - wanted) > SAME_WAVELENGTH:
        raise SceneError.of("wavelength_um", f"must be {allowed}, not {wanted:g}")
    return index


def read_measured(path: PathName, wavelength_um: float | None, average_mirrored: bool) -> TabulatedBase:
    """Of a tensor file, at the directions of vrte's own tables. Raises SceneError, OSError."""
    fields = read_tensors(path)
    for name in (*AXES, "wvls", "M"):
        if name not in fields:
            raise SceneError(f"it has no field {name}: measured_polarized has {', '.join((*AXES, 'wvls', 'M'))}")
        if fields[name].size == 0 or not np.isfinite(fields[name]).all():
            raise SceneError(f"its field {name} must have values, all of them finite")
    phi_d, theta_d, theta_h = axes = convert_axes(fields)
    nanometres = fields["wvls"].ravel().astype(np.float64)
    index = pick_wavelength(1e-3 * nanometres, wavelength_um)
    shape = phi_d.size, theta_d.size, theta_h.size, nanometres.size, 4, 4
    if fields["M"].shape != shape:
        raise SceneError(f"its field M must have the shape {shape} to fit its angles and wvls, not {fields['M'].shape}")
    table = average_images(fields["M"][:, :, :, index].astype(np.float64), phi_d, average_mirrored)
    mu_i, mu_o, azimuths = directions().values()
    aside = np.clip(azimuths, ASIDE, 180.0 - ASIDE)
    found = evaluate_table(table[:, :, :, None], axes, mu_i, mu_o, aside)
    mueller = found.reshape(mu_i.size, mu_o.size, azimuths.size, 4, 4)
    return TabulatedBase(mu_i, mu_o, azimuths, mueller, average_mirrored=True)  # which ASIDE is not, nearly


def convert_axes(fields: Mapping[str, NDArray[Any]]) -> Axes:
    """The angles (n,) [rad] of each axis, which ascend from one end to the other. Raises SceneError."""
    found = []
    for name in AXES:
        low, high = (-np.pi, np.pi) if name == "phi_d" else (0.0, 0.5 * np.pi)
        axis = fields[name].ravel().astype(np.float64)
        if axis.size < 2 or (np.diff(axis) <= 0.0).any() or max(abs(axis[0] - low), abs(axis[-1] - high)) > END:
            raise SceneError(f"its field {name} must ascend from {low:.4g} to {high:.4g} rad")
        axis[[0, -1]] = low, high
        found.append(axis)
    return found[0], found[1], found[2]


def average_images(table: Array, phi_d: Array, average_mirrored: bool) -> Array:
    """The mean of a table (phi_d, theta_d, theta_h, 4, 4) and its mirror image, phi_d turned over. Raises SceneError
    where they differ by more than single precision does, or phi_d is not its own mirror image."""
    if np.abs(phi_d + phi_d[::-1]).max() > END:
        raise SceneError("its field phi_d must have -phi_d for each of its angles")
    image = table[::-1] * MIRROR
    difference, largest = np.abs(table - image).max(), np.abs(table).max()
    if difference > SINGLE * largest and not average_mirrored:
        words = (
            f"differs from it by {difference:.3g}, and it is at most {largest:.3g} (average_mirrored takes the mean)"
        )
        raise SceneError(f"its mirror image, phi_d turned over, {words}")
    return np.asarray(0.5 * (table + image))
