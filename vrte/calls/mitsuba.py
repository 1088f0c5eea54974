"""vrte.to_mitsuba: a scene solved at the wavelengths and directions of Mitsuba's measured BSDF, and written."""

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.running import Progress, share_progress
from vrte.calls.spectrum import Source, prepare_scenes, solve_spectrum
from vrte.formats.between_directions import AZIMUTHS, COSINES, directions
from vrte.formats.measured_polarized import (
    CHECKED,
    CHECKED_FROM,
    MOST_AZIMUTHS,
    MOST_COSINES,
    STEP,
    Errors,
    check_wavelengths,
    make_angles,
    write_mitsuba,
)
from vrte.request.how import EXACT
from vrte.results.spectrum import Spectrum, check_ascending

if TYPE_CHECKING:
    from vrte.formats.scene_file import SceneFile


def to_mitsuba(
    scene: Source,
    wavelengths_um: Any,
    path: str | os.PathLike[str],
    step_deg: float = STEP,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    **asked: Any,
) -> Errors:
    """Solves a scene file at five wavelengths and writes a table for Mitsuba 3's BSDF ``measured_polarized``.

    Parameters
    ----------
    scene : path or mapping
        As for `vrte.spectrum`.
    wavelengths_um : array_like (5,)
        Of whole nanometres [um], ascending.
    path : path
        The file to write.
    step_deg : float
        Of its angles theta_d and theta_h [degrees], of which phi_d has twice that.
    progress : callable, optional
        Called with (steps done, steps).
    folder : path
        Where the tables of a parsed content lie.
    asked
        Keywords of `vrte.brdf` but for the directions, which are the table's own.

    Returns
    -------
    Errors
        How far the table is off between its angles.

    Raises
    ------
    SceneError, OSError
        And what else `vrte.spectrum` raises.

    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> content = {"nodes": 8, "layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
    >>> to_mitsuba(content, [0.45, 0.5, 0.55, 0.6, 0.65], "rayleigh.bsdf", step_deg=15).median < 0.1
    True
    """
    wavelengths = check_ascending(wavelengths_um)
    check_wavelengths(wavelengths)
    make_angles(step_deg)
    first, second = (share_progress(progress, half, 2, 100 * wavelengths.size) for half in (0, 1))
    files, _ = prepare_scenes(scene, wavelengths, folder, first)
    table, exact = solve_for_table(files, wavelengths, second, **asked)
    errors = write_mitsuba(table, path, step_deg, exact)
    assert errors is not None
    return errors


def solve_for_table(
    files: Sequence["SceneFile"], wavelengths: Array, progress: Progress | None = None, **asked: Any
) -> tuple[Spectrum, Spectrum]:
    """The spectrum that a table is made of, and one at other directions to check it with: as many cosines and azimuths
    as the scene's BRDF wants. Parameters and errors as for `vrte.spectrum`."""
    asked |= {"transmission": False}
    sample = np.random.default_rng(0).uniform(size=(3, CHECKED))
    pairs = CHECKED_FROM + (1.0 - CHECKED_FROM) * sample[:2]
    exact = solve_spectrum(files, wavelengths, None, **asked, mu_i=pairs[0], mu_o=pairs[1], phi=360.0 * sample[2])
    orders = max(one.diagnostics.get("orders", 0) for one in exact)
    nodes = max(one.diagnostics["nodes"] for one in exact)
    if files[0].keywords(asked).get("method", EXACT) == EXACT:
        asked["nodes"] = nodes  # left to itself, a solve for cosines of 1e-4 would choose a great many for their sake
    cosines = int(np.clip(nodes, COSINES, MOST_COSINES))
    wanted: dict[str, Any] = directions(cosines, int(np.clip(2 * orders + 1, AZIMUTHS, MOST_AZIMUTHS)))
    return solve_spectrum(files, wavelengths, progress, **asked, **wanted), exact
