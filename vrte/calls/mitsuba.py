"""vrte.to_mitsuba: a scene solved at the wavelengths and directions of Mitsuba's measured BSDF, and written."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.calls.spectrum import Source, prepare_scenes, solve_spectrum
from vrte.formats.measured_polarized import (
    AZIMUTHS,
    CHECKED,
    CHECKED_FROM,
    COSINES,
    MOST_AZIMUTHS,
    MOST_COSINES,
    STEP,
    Errors,
    check_wavelengths,
    describe_beam,
    directions,
    make_axes,
    write_mitsuba,
    write_nested_scene,
)
from vrte.request.how import EXACT, complete_docstring
from vrte.results.brdf import Spectrum, check_ascending
from vrte.results.result import find_finest_nodes
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from vrte.formats.scene_file import SceneFile

NO_BEAM = 1e-6  # share of light that comes back as a beam: below, nothing is missing without it


@complete_docstring
def to_mitsuba(
    scene: Source,
    wavelengths_um: Any,
    path: str | os.PathLike[str],
    step_deg: float = STEP,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    nested: bool = False,
    **asked: Any,
) -> Errors:
    """Solves a scene file at five wavelengths and writes a table for Mitsuba 3's BSDF ``measured_polarized``.

    Parameters
    ----------
    {source}
    wavelengths_um : array_like (5,)
        Of whole nanometres [um], ascending.
    path : path
        The file to write.
    step_deg : float
        Of its angles theta_d and theta_h [degrees], of which phi_d has twice that.
    {progress, folder}
    nested : bool
        For scenes with a smooth surface on top, whose mirrored beam no table can hold: the table is that of what lies
        below the surface, and beside it a scene file for Mitsuba, of the same name but for .xml, has Mitsuba's own
        dielectric above it (docs/how_to/exports.md).
    **asked
        Keywords of `vrte.brdf` but for the directions, which are the table's own.

    Returns
    -------
    Errors
        How far the table is off between its angles.

    Raises
    ------
    {SceneError, OSError, AccuracyError}

    Examples
    --------
    >>> import vrte
    >>> layer = {"phase": "isotropic", "albedo": 1.0, "thickness": 0.5}
    >>> content = {"nodes": 4, "layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
    >>> vrte.to_mitsuba(content, [0.45, 0.5, 0.55, 0.6, 0.65], "isotropic.bsdf", step_deg=15).median < 0.1
    True
    """
    wavelengths = check_ascending(wavelengths_um)
    check_wavelengths(wavelengths)
    make_axes(step_deg)
    if nested:
        check_nested(path, asked)
    first, second = (share_progress(progress, half, 2, 100 * wavelengths.size) for half in (0, 1))
    files, _ = prepare_scenes(scene, wavelengths, folder, first)
    return write_table(files, wavelengths, path, step_deg, nested, second, **asked)[0]


def write_table(
    files: Sequence["SceneFile"],
    wavelengths: Array,
    path: str | os.PathLike[str],
    step_deg: float,
    nested: bool,
    progress: Progress | None = None,
    **asked: Any,
) -> tuple[Errors, list[str]]:
    """Solves scenes for a table and writes it, ``nested`` with a scene file; its errors, and notes on them."""
    surface = None
    if nested:
        surface, files = take_off_surface(files)
    table, exact = solve_for_table(files, wavelengths, progress, **asked)
    if surface:
        check_below_surface(table)
    errors = write_mitsuba(table, path, step_deg, exact)
    assert errors is not None
    notes = [str(errors)] + ([] if table.specular is None else [describe_beam(table)])
    if surface:
        write_nested_scene(Path(path).with_suffix(".xml"), path, *surface)
        notes.append("of what lies below the surface, which Mitsuba's own dielectric is")
    return errors, notes


def check_nested(path: str | os.PathLike[str], asked: dict[str, Any]) -> None:
    """Whether a scene file can lie beside a table, and light comes from above. Raises SceneError."""
    if Path(path).suffix == ".xml":
        raise SceneError(f"the table {Path(path).name} needs another ending: the scene file beside it ends in .xml")
    if asked.get("illuminate", "top") != "top":
        raise SceneError("nested is for the surface on top: illuminate must be 'top'", "illuminate")


def take_off_surface(files: Sequence["SceneFile"]) -> tuple[tuple[float, float], list["SceneFile"]]:
    """The refractive indices above and below the surface on top, and the scenes without it, in the medium below it.

    Raises SceneError where there is none or a rough one, or where the indices are others at other wavelengths, of which
    Mitsuba's dielectric knows nothing.
    """
    surfaces = [surface for file in files if (surface := file.scene.interfaces[0])]
    indices = sorted({(surface.index_above, surface.index_below) for surface in surfaces})
    words = ""
    if len(surfaces) < len(files):
        words = "scenes with an interface on top, and here is none"
    elif not all(surface.is_smooth for surface in surfaces):
        words = "a smooth surface: Mitsuba's rough dielectric knows no polarization"
    elif len(indices) > 1:
        listed = ", ".join(f"{above:g}/{below:g}" for above, below in indices)
        words = f"a surface of one index, Mitsuba's dielectric has no others: not {listed}"
    if words:
        raise SceneError(f"nested is for {words}")
    return indices[0], [replace(file, scene=take_off(file.scene)) for file in files]


def take_off(scene: Scene) -> Scene:
    """A scene without the interface on top, seen from the medium below it."""
    first = replace(scene.layers[0], host_index=scene.indices[0])
    return Scene((first, *scene.layers[1:]), scene.base, (None, *scene.interfaces[1:]))


def check_below_surface(table: Spectrum) -> None:
    """Raises SceneError where a beam comes back from below the surface: a table has no place for it."""
    share = 0.0 if table.specular_reflectance is None else table.specular_reflectance.max()
    if share > NO_BEAM:
        raise SceneError(
            f"nested is for surfaces below which light is scattered: up to {share:.2g} of it comes back as a beam from "
            "below, mirrored by other interfaces or the base, which neither the table nor the surface has"
        )


def solve_for_table(
    files: Sequence["SceneFile"], wavelengths: Array, progress: Progress | None = None, **asked: Any
) -> tuple[Spectrum, Spectrum]:
    """The spectrum that a table is made of, and one at other directions to check it with: as many cosines and azimuths
    as the scene's BRDF wants. Parameters and errors as for `vrte.spectrum`."""
    asked |= {"transmission": False, "coherent": False}
    sample = np.random.default_rng(0).uniform(size=(3, CHECKED))
    pairs = CHECKED_FROM + (1.0 - CHECKED_FROM) * sample[:2]
    exact = solve_spectrum(files, wavelengths, None, **asked, mu_i=pairs[0], mu_o=pairs[1], phi=360.0 * sample[2])
    orders = max(one.diagnostics.get("orders", 0) for one in exact)
    finest = find_finest_nodes(exact)
    if files[0].keywords(asked).get("method", EXACT) == EXACT:
        asked |= finest  # left to itself, a solve for cosines of 1e-4 would choose a great many for their sake
    cosines = int(np.clip(finest["nodes"], COSINES, MOST_COSINES))
    wanted: dict[str, Any] = directions(cosines, int(np.clip(2 * orders + 1, AZIMUTHS, MOST_AZIMUTHS)))
    return solve_spectrum(files, wavelengths, progress, **asked, **wanted), exact
