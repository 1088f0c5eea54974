"""vrte.spectrum: the BRDF of a scene file at several wavelengths; and vrte.material: the layer of a ready one."""

import math
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vrte.basics.arrays import Array, check_number
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.calls.brdfs import solve_brdfs
from vrte.calls.plan import make_request, warn_runtime_of_all
from vrte.formats.scene_family import SceneFamily
from vrte.formats.scene_file import SceneFile, make_scene_file, read_content, read_listed_wavelengths, read_scene
from vrte.request.how import complete_docstring
from vrte.request.request import Request
from vrte.results.brdf import Spectrum, add_scene_text, check_ascending
from vrte.scene.layer import Layer
from vrte.scene.vary import Variation

Source = str | os.PathLike[str] | Mapping[str, Any]  # a scene file, or its content


@complete_docstring
def spectrum(
    scene: Source,
    wavelengths_um: Any = None,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    derivatives: str | Sequence[str] | None = None,
    **asked: Any,
) -> Spectrum:
    """The Mueller BRDFs of a scene file at several wavelengths, particles worked out anew at each.

    An optical ``thickness`` stays what it is at every wavelength, a ``thickness_um`` does not. With
    ``backend="opencl"`` all wavelengths go to the device together.

    Parameters
    ----------
    {source}
    wavelengths_um : sequence of float, optional
        Ascending [um], in place of those that the file lists as ``wavelength_um``.
    {progress, folder}
    derivatives : sequence of str, optional
        Numbers of the file, as keys of sweeps name them, "particles.gold.radius_um" (docs/how_to/derivatives.md): how
        the BRDF at each wavelength changes with them is then in ``jacobian`` and its like.
    **asked
        All keywords of `vrte.brdf` but its scene; they win over the file's, ``mu_i``, ``mu_o`` and ``phi`` included.

    Returns
    -------
    Spectrum
        A Brdf a wavelength.

    Raises
    ------
    {SceneError, OSError, AccuracyError, DeviceError}

    Examples
    --------
    >>> import vrte
    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> content = {"nodes": 4, "layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
    >>> vrte.spectrum(content, [0.45, 0.65])
    Spectrum(2 wavelengths from 0.45 to 0.65 um, Brdf(1 mu_i, 1 mu_o, 1 phi) at each)
    """
    if wavelengths_um is None:
        wavelengths_um = read_listed_wavelengths(read_source(scene)[0])
    if wavelengths_um is None:
        raise SceneError("wavelengths_um are missing: say which, or list them as wavelength_um in the scene")
    wavelengths = check_ascending(wavelengths_um)
    first, second = (share_progress(progress, half, 2, 100 * wavelengths.size) for half in (0, 1))
    files, warned = prepare_scenes(scene, wavelengths, folder, first, asked)
    variations = vary_files(scene, wavelengths, derivatives, folder)
    return solve_spectrum(files, wavelengths, second, warned, variations, **asked)


def read_source(scene: Source, folder: str | os.PathLike[str] = ".") -> tuple[dict[str, Any], Path]:
    """The content of a scene file, and where its tables lie. Raises SceneError, OSError."""
    return (dict(scene), Path(folder)) if isinstance(scene, Mapping) else (read_content(scene), Path(scene).parent)


def prepare_scenes(
    scene: Source,
    wavelengths: Array,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
    asked: Mapping[str, Any] | None = None,
) -> tuple[list[SceneFile], bool | None]:
    """The scenes at wavelengths, and whether the user was warned of their time. Raises SceneError beyond the limit."""
    made: dict[int, SceneFile] = {}

    def prepare(index: int) -> SceneFile:
        with name_wavelength(wavelength := float(wavelengths[index])):
            if isinstance(scene, Mapping):
                return make_scene_file({**scene, "wavelength_um": wavelength}, "brdf", Path(folder))
            return read_scene(scene, "brdf", wavelength)

    def asked_at(index: int) -> tuple[Request, float]:
        begin = time.perf_counter()
        made[index] = prepare(index)
        seconds = time.perf_counter() - begin
        return make_request("brdf", made[index].scene, **made[index].keywords(asked or {})), seconds

    count = wavelengths.size
    warned = None if asked is None else warn_runtime_of_all(count, asked_at, f"{count} wavelengths")
    for index in range(count):
        made[index] = made.get(index) or prepare(index)
        if progress is not None:
            progress(index + 1, count)
    return [made[index] for index in range(count)], warned


def vary_files(
    scene: Source, wavelengths: Array, derivatives: str | Sequence[str] | None, folder: str | os.PathLike[str] = "."
) -> list[list[Variation]]:
    """Variations of a file's scene with these numbers at each wavelength, if any. Raises SceneError."""
    if derivatives is None:
        return []
    content, folder = read_source(scene, folder)
    found = []
    for wavelength in wavelengths.tolist():
        try:
            found.append(SceneFamily({**content, "wavelength_um": wavelength}, derivatives, folder).variations())
        except SceneError as error:
            raise SceneError(f"derivatives at {wavelength:g} um: {error}", "derivatives") from error
    return found


@contextmanager
def name_wavelength(wavelength_um: float | None) -> Iterator[None]:
    """Puts a wavelength, where one is known, in front of complaints."""
    try:
        yield
    except SceneError as error:
        if wavelength_um is None:
            raise
        raise error.behind(f"at {wavelength_um:g} um") from error


def solve_spectrum(
    files: Sequence[SceneFile],
    wavelengths: Array,
    progress: Progress | None = None,
    warned: bool | None = None,
    variations: Sequence[Sequence[Variation]] = (),
    **asked: Any,
) -> Spectrum:
    """The spectrum of what `prepare_scenes` made, differentiated by ``variations`` of each; ``warned`` of its time."""
    with files[0].located():
        requests = [make_request("brdf", file.scene, **file.keywords(asked)) for file in files]
        found = solve_brdfs(requests, progress, "wavelengths", warned, variations)
    return Spectrum(wavelengths, tuple(add_scene_text(one, files[0].text) for one in found))


def material(
    name: str,
    wavelength_um: float,
    *,
    thickness: float | None = None,
    thickness_um: float | None = None,
    volume_fraction: float | None = None,
    packing: str | None = None,
) -> Layer:
    """A layer of a ready material, as thick and as dense as it is typically, where nothing else is said.

    Parameters
    ----------
    name : str
        One of `vrte.materials()`, or the path of a file of one's own, "my_paint.toml" (docs/how_to/materials.md).
    wavelength_um : float
        In vacuum [um].
    thickness, thickness_um : float, optional
        Optical, or geometrical [um], in place of the typical one; powders and snow need volume_fraction with the
        latter.
    volume_fraction : float, optional
        Of all its particles together.
    packing : str, optional
        One of those of `Layer.of`, which docs/how_to/particles.md describes.

    Returns
    -------
    Layer
        In its host medium: above a resin belongs a `vrte.Interface` (docs/how_to/interfaces.md).

    Raises
    ------
    SceneError
        For an unknown name, a wavelength outside the tables of what it consists of, and what `Layer.of` refuses.

    Examples
    --------
    >>> import vrte
    >>> vrte.material("rutile in alkyd", 0.55).host_index
    1.52
    """
    given: dict[str, Any] = {"thickness": thickness, "thickness_um": thickness_um, "volume_fraction": volume_fraction}
    layer: dict[str, Any] = {"material": name} | ({} if packing is None else {"packing": packing})
    for key, value in given.items():
        if value is not None:
            layer[key] = check_number(key, value, 0.0, math.inf, "a number >= 0")
    wavelength = check_number("wavelength_um", wavelength_um, 0.0, math.inf, "a length")
    content = {"wavelength_um": wavelength, "layer": [layer], "brdf": {"mu_i": 1.0, "mu_o": 1.0}}
    try:
        return make_scene_file(content).scene.layers[0]
    except SceneError as error:
        raise SceneError(str(error).removeprefix("layer[1]."), *error.place[2:]) from error
