"""vrte.spectrum: the BRDF of a scene file at several wavelengths."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress
from vrte.calls.brdf import brdf_of
from vrte.calls.brdfs import brdfs
from vrte.calls.forecast import foretell_all
from vrte.calls.plan import request_of
from vrte.methods import run_of
from vrte.request.request import EXACT, Request
from vrte.results.spectrum import Spectrum, ascending, with_scene

if TYPE_CHECKING:
    from vrte.formats.scene_file import SceneFile
STEPS = 100  # of progress for the particles, and as many for the solution, at each wavelength
PLAIN: dict[str, Any] = {"method": EXACT, "settings": {}, "verify": False}  # what `vrte.brdfs` has no keywords for


def spectrum(
    scene: str | os.PathLike[str] | Mapping[str, Any],
    wavelengths_um: Any = None,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    **asked: Any,
) -> Spectrum:
    """The Mueller BRDFs of a scene file at several wavelengths, particles worked out anew at each.

    Parameters: ``scene``, a TOML file or its content, parsed; ``wavelengths_um``, ascending, in place of the file's,
    which lists them in ``wavelength_um`` where they are left out;
    ``progress``, called with (steps done, steps); ``folder``, where the tables of coefficients of a parsed content lie;
    all keywords of `vrte.brdf` but its scene, which win over the file's, ``mu_i``, ``mu_o`` and ``phi`` included. An
    optical ``thickness`` stays what it is at every wavelength, a ``thickness_um`` does not. With ``backend="opencl"``
    all wavelengths go to the device together. Raises SceneError, which names the wavelength, OSError, and what
    `vrte.brdf` raises.

    >>> layer = {"phase": "rayleigh", "albedo": 1.0, "thickness": 0.5}
    >>> content = {"nodes": 4, "layer": [layer], "brdf": {"mu_i": 0.5, "mu_o": 1.0}}
    >>> spectrum(content, [0.45, 0.65])
    Spectrum(2 wavelengths from 0.45 to 0.65 um, Brdf(1 mu_i, 1 mu_o, 1 phi) at each)
    """
    wavelengths = ascending(listed(scene) if wavelengths_um is None else wavelengths_um)
    total = 2 * STEPS * wavelengths.size
    made, told = foretold(scene, wavelengths, folder, asked)
    files = scenes_at(scene, wavelengths, folder, part_of(progress, 0, total), made)
    return solved_at(files, wavelengths, part_of(progress, total // 2, total), told, **asked)


def listed(scene: str | os.PathLike[str] | Mapping[str, Any]) -> list[float]:
    """The wavelengths that a scene file lists. Raises SceneError where it lists none."""
    from vrte.formats.scene_file import listed_wavelengths, read_content

    found = listed_wavelengths(dict(scene) if isinstance(scene, Mapping) else read_content(scene))
    if found is None:
        raise SceneError("wavelengths_um are missing: say which, or list them as wavelength_um in the scene")
    return found


def foretold(
    scene: str | os.PathLike[str] | Mapping[str, Any],
    wavelengths: Array,
    folder: str | os.PathLike[str],
    asked: Mapping[str, Any],
) -> tuple[dict[int, "SceneFile"], bool]:
    """The scenes at some places, made to say what all wavelengths take, particles included, and whether that is long.
    Raises SceneError beyond ``time_limit_s``."""
    made: dict[int, SceneFile] = {}

    def asked_at(place: int) -> tuple[Request, int, float]:
        begin = time.perf_counter()
        made[place] = scene_at(scene, float(wavelengths[place]), folder)
        seconds = time.perf_counter() - begin
        return *asked_of(made[place], asked), seconds

    return made, foretell_all(wavelengths.size, asked_at, f"{wavelengths.size} wavelengths")


def asked_of(file: "SceneFile", asked: Mapping[str, Any]) -> tuple[Request, int]:
    """The request of a scene file, and its threads."""
    request, threads = request_of("brdf", file.scene, (), file.keywords(dict(asked)))
    return request, run_of(request, threads).threads


def scene_at(
    scene: str | os.PathLike[str] | Mapping[str, Any], wavelength: float, folder: str | os.PathLike[str]
) -> "SceneFile":
    """The scene at one wavelength. Raises SceneError, which names it."""
    from vrte.formats.scene_file import read_scene, scene_of

    try:
        if isinstance(scene, Mapping):
            return scene_of({**scene, "wavelength_um": wavelength}, "brdf", Path(folder))
        return read_scene(scene, "brdf", wavelength)
    except SceneError as error:
        raise error.behind(f"at {wavelength:g} um") from error


def scenes_at(
    scene: str | os.PathLike[str] | Mapping[str, Any],
    wavelengths: Array,
    folder: str | os.PathLike[str] = ".",
    progress: Progress | None = None,
    made: Mapping[int, "SceneFile"] = MappingProxyType({}),
) -> list["SceneFile"]:
    """The scene at each wavelength, its particles worked out but where it is ``made``. ``progress`` counts in steps of
    a hundredth of one."""
    files = []
    for place, wavelength in enumerate(wavelengths.tolist()):
        files.append(made[place] if place in made else scene_at(scene, wavelength, folder))
        if progress is not None:
            progress(STEPS * (place + 1), STEPS * wavelengths.size)
    return files


def solved_at(
    files: Sequence["SceneFile"],
    wavelengths: Array,
    progress: Progress | None = None,
    told: bool | None = None,
    **asked: Any,
) -> Spectrum:
    """The spectrum of what `scenes_at` made; ``asked`` as for `spectrum`; ``told``: whether it was said that all takes
    long, None where nobody looked."""
    calls = [file.keywords(asked) for file in files]
    with files[0].located():
        asks_for_more = PLAIN | calls[0] != calls[0] | PLAIN
        if not asks_for_more and calls[0].get("backend") == "opencl":
            common = {name: value for name, value in calls[0].items() if name not in PLAIN}
            found = brdfs([file.scene for file in files], progress=progress, **common)
        else:
            if told is None:
                what = f"{len(files)} wavelengths"
                told = foretell_all(len(files), lambda place: (*asked_of(files[place], asked), 0.0), what)
            found = []
            for place, (file, call) in enumerate(zip(files, calls, strict=True)):
                request, threads = request_of("brdf", file.scene, (), call)
                there = hundredths(progress, place, len(files))
                found.append(brdf_of(request, threads, bool(call.get("transmission", False)), there, told))
    return Spectrum(wavelengths, tuple(with_scene(one, files[0].text) for one in found))


def hundredths(progress: Progress | None, place: int, count: int) -> Progress | None:
    """Progress at one of ``count`` wavelengths as a part of all of them, whatever it counts itself."""
    if progress is None:
        return None
    return lambda done, total: progress(STEPS * place + STEPS * done // max(total, 1), STEPS * count)


def part_of(progress: Progress | None, before: int, total: int) -> Progress | None:
    """Progress that goes on where ``before`` of ``total`` steps are done, for the one half of them."""
    if progress is None:
        return None
    return lambda done, steps: progress(before + done * (total // 2) // max(steps, 1), total)
