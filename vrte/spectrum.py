"""The BRDF of a scene at several wavelengths."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from vrte.arrays import Array, in_one_line, settled, vector
from vrte.batch import brdfs
from vrte.brdf import Brdf, brdf_of
from vrte.discrete_ordinates.problem import Progress
from vrte.errors import SceneError
from vrte.field import Field
from vrte.forecast import foretell_all
from vrte.plan_call import request_of
from vrte.request import EXACT, Request
from vrte.solving import run_of

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

    from vrte.formats.scene_file import SceneFile

MOST_WAVELENGTHS = 10_000
STEPS = 100  # of progress for the particles, and as many for the solution, at each wavelength
SCENE = "scene_toml"  # in diagnostics: the text of the scene file
Found = TypeVar("Found", bound=Brdf | Field)
PLAIN: dict[str, Any] = {"method": EXACT, "settings": {}, "verify": False}  # what `vrte.brdfs` has no keywords for


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum:
    """BRDFs at ascending wavelengths, all for the same directions.

    ``wavelength_um`` (n,) in vacuum; ``brdfs``, n of them, with or without transmission all alike. An item of the
    spectrum is the BRDF at that place. Raises SceneError where they do not fit together.

    >>> import numpy as np
    >>> white = Brdf(np.zeros((1, 1, 1, 4, 4)), [0.0], [0.6], [0.5], [0.0], {})
    >>> Spectrum([0.45, 0.65], [white, white]).mueller.shape
    (2, 1, 1, 1, 4, 4)
    """

    wavelength_um: Array
    brdfs: tuple[Brdf, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavelength_um", ascending(self.wavelength_um))
        object.__setattr__(self, "brdfs", tuple(self.brdfs))
        if not all(isinstance(one, Brdf) for one in self.brdfs):
            raise SceneError("brdfs must be vrte.Brdf")
        if len(self.brdfs) != self.wavelength_um.size:
            raise SceneError(f"brdfs must be one a wavelength, {self.wavelength_um.size}, not {len(self.brdfs)}")
        for one in self.brdfs[1:]:
            check_alike(self.brdfs[0], one)

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor: an unpickled array would otherwise be writable
        return type(self), (self.wavelength_um, self.brdfs)

    def __len__(self) -> int:
        return len(self.brdfs)

    def __getitem__(self, place: int) -> Brdf:
        return self.brdfs[place]

    def __iter__(self) -> Iterator[Brdf]:
        return iter(self.brdfs)

    def __repr__(self) -> str:
        first, last = self.wavelength_um[[0, -1]]
        return f"Spectrum({len(self)} wavelengths from {first:g} to {last:g} um, {self.brdfs[0]!r} at each)"

    @property
    def mu_i(self) -> Array:
        """Cosines of incidence (mu_i,)."""
        return self.brdfs[0].mu_i

    @property
    def mu_o(self) -> Array:
        """Cosines of exit (mu_o,)."""
        return self.brdfs[0].mu_o

    @property
    def phi(self) -> Array:
        """Azimuths (phi,) [deg]."""
        return self.brdfs[0].phi

    @property
    def mueller(self) -> Array:
        """The BRDFs (wavelength, mu_i, mu_o, phi, 4, 4) [sr-1], a new read-only array."""
        return settled(np.stack([one.mueller for one in self.brdfs]))

    @property
    def reflectance(self) -> Array:
        """Directional-hemispherical reflectances (wavelength, mu_i)."""
        return settled(np.stack([one.reflectance for one in self.brdfs]))

    @property
    def transmission(self) -> Array | None:
        """The BTDFs, of the same shape as ``mueller``, or None."""
        return stacked([one.transmission for one in self.brdfs])

    @property
    def direct_transmittance(self) -> Array | None:
        """The share of the beam that gets through unscattered (wavelength, mu_i), or None."""
        return stacked([one.direct_transmittance for one in self.brdfs])

    def to_xarray(self) -> "xarray.Dataset":
        """An xarray.Dataset: ``mueller`` with dims (wavelength_um, mu_i, mu_o, phi_deg, stokes_out, stokes_in).

        Raises MissingExtraError without xarray.
        """
        from vrte.formats.netcdf import to_xarray

        return to_xarray(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes NetCDF, CSV or Zarr as the name ends in .nc, .csv or .zarr, all or nothing; `vrte.load` reads it back.

        Raises SceneError for another ending, OSError, but for CSV MissingExtraError without the extra "files".
        """
        from vrte.formats import save

        save(self, path)

    def _repr_html_(self) -> str:
        from vrte.report.notebook import spectrum_html

        return spectrum_html(self)

    def plot(self) -> "Figure":
        """Reflectance against wavelength, and f00 in the plane of incidence where there are enough directions.

        Raises MissingExtraError without the extra "plot"."""
        from vrte.report.lobes import spectrum_figure

        return spectrum_figure(self)

    def at(self, wavelengths_um: Any) -> "Spectrum":
        """The spectrum at some of its own wavelengths, to 1e-9 um. Raises SceneError for one that it has not."""
        wanted = ascending(wavelengths_um)
        places = [int(np.argmin(np.abs(self.wavelength_um - one))) for one in wanted]
        for one, place in zip(wanted, places, strict=True):
            if abs(self.wavelength_um[place] - one) > 1e-9:
                raise SceneError(
                    f"wavelength {one:g} um is none of the spectrum's: the next is at {self.wavelength_um[place]:g} um"
                )
        return Spectrum(self.wavelength_um[places], tuple(self.brdfs[place] for place in places))


def ascending(wavelengths_um: Any) -> Array:
    """Wavelengths above 0, each above the one before."""
    found = vector("wavelength_um", wavelengths_um)
    if found.size > MOST_WAVELENGTHS:
        raise SceneError(f"wavelength_um must be at most {MOST_WAVELENGTHS} wavelengths, not {found.size}")
    if found[0] <= 0.0 or np.any(np.diff(found) <= 0.0):
        raise SceneError(f"wavelength_um must be positive and ascending, not {in_one_line(str(found.tolist()))}")
    return found


def check_alike(first: Brdf, other: Brdf) -> None:
    """Whether two BRDFs are for the same directions, lit from the same side, and hold the same."""
    for name in ("mu_i", "mu_o", "phi"):
        if not np.array_equal(getattr(first, name), getattr(other, name)):
            raise SceneError(f"brdfs must be for the same directions: {name} differs")
    for name in ("transmission", "direct_transmittance"):
        if (getattr(first, name) is None) != (getattr(other, name) is None):
            raise SceneError(f"brdfs must all have {name}, or none of them")
    if first.diagnostics.get("illuminate") != other.diagnostics.get("illuminate"):
        raise SceneError("brdfs must all be lit from the same side")


def stacked(arrays: Sequence[Array | None]) -> Array | None:
    """Arrays as one, read-only; None where there are none."""
    there = [array for array in arrays if array is not None]
    return settled(np.stack(there)) if there else None


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
        raise SceneError(f"at {wavelength:g} um: {error}") from error


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
    try:
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
    except SceneError as error:
        raise SceneError(files[0].located(str(error))) from error
    return Spectrum(wavelengths, tuple(with_scene(one, files[0].text) for one in found))


def with_scene(found: Found, text: str) -> Found:
    """The same with the text of its scene file in its diagnostics, where there is one."""
    return replace(found, diagnostics=found.diagnostics | {SCENE: text}) if text else found


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
