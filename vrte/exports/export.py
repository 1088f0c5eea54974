"""vrte.export: a scene solved for the directions of a renderer's file, written, and how far the file is from it."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from vrte.appearance.panel import choose_wavelengths, read_source
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, share_progress
from vrte.calls.spectrum import Source, prepare_scenes, solve_spectrum
from vrte.exports import fitted, half_vectors, measured, merl, polarized
from vrte.exports.colour import weigh_channels
from vrte.formats.atomic import read_text, write_text
from vrte.formats.contents import describe_result
from vrte.formats.measured_polarized import AZIMUTHS, COSINES, directions, make_unit_vectors
from vrte.formats.scene_file import SceneFile, read_listed_wavelengths
from vrte.formats.toml_table import LARGEST_FILE
from vrte.optics.fresnel import reflect_smooth
from vrte.request.how import EXACT, complete_docstring
from vrte.results.brdf import Spectrum, check_ascending
from vrte.results.result import find_finest_nodes

MOST_COSINES, MOST_AZIMUTHS = 128, 361  # to solve for, where nodes and Fourier orders are many
CHECKED, CHECKED_FROM = 8, 0.1  # cosines and azimuths that a file is compared at; the smallest of those cosines
ENERGY = 128, 64  # points of integrals over the hemisphere: half vectors and their azimuths, half a turn
NO_BEAM = 1e-6  # fraction of light that is mirrored as a beam: below, nothing is missing without it
ACCURACY = 1e-5  # of the solve, where nothing else is asked: far below the error of any file
GAP = 5e-4  # of two spheres of radius 1: rays start 1.8e-4 off what they leave; angles change by its square root
NOT_HELD = {  # keywords of vrte.brdf
    **dict.fromkeys(("mu_i", "mu_o", "phi"), "is not asked for here: a file has directions of its own"),
    "transmission": "has no place in a file of reflected light: vrte.brdf(..., transmission=True).save keeps both",
    "coherent": "has no place in a file for a renderer: vrte.brdf(..., coherent=True).save keeps it",
    "derivatives": "has no place in a file for a renderer: vrte.spectrum(..., derivatives=...).save keeps them",
}


class File(Protocol):
    """What a format makes of a BRDF."""

    def evaluate(self, mu_i: Array, mu_o: Array, phi: Array) -> Array:
        """What a renderer makes of the file: (k, n, channel, ..., ...) [sr-1], for mu_i (k,) and mu_o, phi [degrees],
        (k, n)."""

    def write(self, path: Path, text: str) -> None:
        """Writes the file with a description, all or nothing."""


class Format(NamedTuple):
    """A kind of file: ``make`` takes a spectrum at `directions` and the rough surface on top at each wavelength."""

    make: Callable[..., File]
    note: str
    plugin: str = ""  # Mitsuba's BSDF that reads it, where it can lie below a dielectric
    colours: bool = False  # in place of wavelengths
    fits: bool = False  # a model, which has a mirror's lobe for a smooth surface on top
    holds_beams: bool = False  # mirrored ones
    beside: str = ""  # suffix of a text with the description, where the file has no place for one


FORMATS = {
    ".nc": Format(half_vectors.ResultFile.make, half_vectors.NOTE, holds_beams=True),
    ".pbsdf": Format(polarized.tabulate_polarized, polarized.NOTE, "measured_polarized"),
    ".bsdf": Format(measured.tabulate_measured, measured.NOTE, "measured"),
    ".binary": Format(merl.tabulate_merl, merl.NOTE, colours=True, beside=".txt"),
    ".json": Format(partial(fitted.fit_model, fitted.PRINCIPLED), fitted.NOTE, colours=True, fits=True),
    ".mtlx": Format(partial(fitted.fit_model, fitted.OPENPBR), fitted.NOTE, colours=True, fits=True),
}


@dataclass(frozen=True)
class Exported:
    """A file for a renderer, and how far it is from the BRDF that it was made of.

    Attributes
    ----------
    paths
        The files that were written, the renderer's first.
    wavelengths_um
        At which the BRDF was solved [um].
    median, most
        The difference over f00, and of Mueller matrices the largest of an element, that half of the pairs of
        directions stay below, and 95 of 100.
    pairs
        How many pairs of directions were compared, all cosines above 0.1.
    energy
        The largest difference of directional-hemispherical reflectance.
    reciprocity
        The difference between f00 and that of swapped directions, over their mean: what 95 of 100 pairs stay below.
    notes
        What else there is to say, a sentence each.
    """

    paths: tuple[Path, ...]
    wavelengths_um: tuple[float, ...]
    median: float
    most: float
    pairs: int
    energy: float
    reciprocity: float
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return (
            f"off by {self.median:.1e} of I in the median, by less than {self.most:.1e} for 95% of {self.pairs} pairs "
            f"of directions with both cosines above {CHECKED_FROM:g}; reflectance off by {self.energy:.1e} at most; "
            f"reciprocal to {self.reciprocity:.1e} for 95%"
        )


@complete_docstring
def export(
    scene: Source,
    path: str | os.PathLike[str],
    wavelengths_um: Any = None,
    step_deg: float | None = None,
    nested: bool = False,
    diffuse: bool = False,
    progress: Progress | None = None,
    folder: str | os.PathLike[str] = ".",
    **asked: Any,
) -> Exported:
    """Solves a scene and writes its BRDF as a renderer reads it, by suffix (docs/how_to/exports.md).

    ``.nc``: Mueller matrices and mirrored beams for Mitsuba's BSDF ``vrte`` (``import vrte.mitsuba``), sampled after
    the BRDF; ``.pbsdf``: Mueller matrices for Mitsuba's ``measured_polarized``; ``.bsdf``: spectra for Mitsuba's
    ``measured`` and pbrt-v4, sampled after the BRDF; ``.binary``: colours in MERL's format; ``.json`` and ``.mtlx``:
    numbers of Mitsuba's ``principled`` and of a surface of OpenPBR in MaterialX, fitted to the BRDF.

    Parameters
    ----------
    {source}
    path : path
        The file to write.
    {wavelengths_um}
        A .pbsdf takes five of whole nanometres, by default 0.45 to 0.65.
    step_deg : float, optional
        Of a .pbsdf's angles theta_d and theta_h [degrees], 2.5 by default; phi_d has twice that.
    nested : bool
        For scenes with a smooth surface on top, whose mirrored beam no table holds: the file is that of what lies below
        the surface, and beside it a scene for Mitsuba, of the same name but for .xml, has Mitsuba's own dielectric
        above it.
    diffuse : bool
        Leaves out the beam that smooth surfaces mirror, and says how much it is.
    {progress, folder}
    **asked
        Keywords of `vrte.brdf` on how to solve, in place of the file's; the accuracy is 1e-5 by default.

    Returns
    -------
    Exported
        What was written, and how far it is off.

    Raises
    ------
    {SceneError, OSError, AccuracyError, MissingExtraError}

    Examples
    --------
    >>> import vrte
    >>> layer = {"phase": "isotropic", "albedo": 1.0, "thickness": 0.5}
    >>> vrte.export({"layer": [layer]}, "isotropic.bsdf", [0.45, 0.65], nodes=4).median < 0.01
    True
    """
    path = Path(path)
    kind = check_export(path, step_deg, nested, diffuse, asked)
    content, folder = read_source(scene, folder)
    at = check_ascending(choose(content, folder, path) if wavelengths_um is None else wavelengths_um)
    check_wavelengths(kind, at)
    first, second = (share_progress(progress, half, 2, 100 * at.size) for half in (0, 1))
    others = {key: value for key, value in content.items() if key not in ("brdf", "field")}
    files, _ = prepare_scenes(others | {"brdf": {"mu_i": 1.0, "mu_o": 1.0}}, at, folder, first)
    if not isinstance(scene, Mapping):
        files = [replace(file, text=read_text(scene, LARGEST_FILE)) for file in files]
    if not {"nodes", "accuracy", "method"} & {*files[0].options, *asked}:
        asked = asked | {"accuracy": ACCURACY}
    surface = None
    if nested:
        if files[0].keywords(asked).get("illuminate", "top") != "top":
            raise SceneError("nested is for the surface on top: illuminate must be 'top'", "illuminate")
        surface, files = take_off_surface(files)
    exact = solve_to_compare(files, at, asked)
    smooth = find_smooth_surface(files, exact) if kind.fits and not diffuse else None
    held = kind.holds_beams or smooth is not None
    notes = [] if held else list_beams(exact, kind, path, nested, diffuse)
    spectrum = solve_for_file(files, at, exact, asked, second)
    more = {"smooth": smooth} if kind.fits else {"step_deg": step_deg} if kind is FORMATS[".pbsdf"] else {}
    made = kind.make(spectrum, [file.scene.facets_on_top for file in files], **more)
    notes += [made.note] if isinstance(made, fitted.FittedFile) else []
    paths = (
        path,
        *([path.with_suffix(".xml")] if nested else []),
        *([path.with_suffix(kind.beside)] * bool(kind.beside)),
    )
    found = compare(made, exact, weigh_channels(at) if kind.colours else None, mirrored=smooth is not None)
    done = Exported(paths, tuple(at.tolist()), *found, tuple(notes))
    described: dict[str, Any] = {**describe_result(spectrum)}
    for name in ("comment", "diagnostics") if kind.colours or kind.holds_beams else ():  # long; a result has them
        described.pop(name)
    described |= {"wavelengths_um": done.wavelengths_um, "note": kind.note, "error": done}
    text = "\n".join([*(f"{name}: {value}" for name, value in described.items()), *notes])
    made.write(path, text)
    if kind.beside:
        write_text(text + "\n", path.with_suffix(kind.beside))
    if surface:
        write_nested_scene(path.with_suffix(".xml"), path, *surface, kind.plugin)
    return done


def check_export(path: Path, step_deg: float | None, nested: bool, diffuse: bool, asked: Mapping[str, Any]) -> Format:
    """The format of a file, before any work. Raises SceneError for another suffix, or what the format does not take."""
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise SceneError.of("path", f"must end in {', '.join(FORMATS)}, not as {path.name!r} does")
    for name, words in NOT_HELD.items():
        if asked.get(name) not in (None, False):
            raise SceneError.of(name, words)
    if step_deg is not None:
        if kind is not FORMATS[".pbsdf"]:
            raise SceneError.of("step_deg", f"is of a .pbsdf alone: leave it out for a {path.suffix}")
        polarized.make_axes(step_deg)
    if diffuse and kind.holds_beams:
        raise SceneError.of("diffuse", f"leaves out a beam that a {path.suffix} holds: leave it out")
    if nested and diffuse:
        raise SceneError.of("diffuse", "leaves out the beam that nested keeps: ask for one of them")
    if nested and not kind.plugin:
        able = ", ".join(name for name, one in FORMATS.items() if one.plugin)
        raise SceneError.of("nested", f"is for what Mitsuba reads ({able}), not for a {path.suffix}")
    return kind


def choose(content: dict[str, Any], folder: Path, path: Path) -> Sequence[float] | Array:
    """The wavelengths [um] of a file, where none are given. Raises SceneError."""
    if path.suffix.lower() == ".pbsdf":
        return polarized.choose_five(read_listed_wavelengths(content) or ())
    return choose_wavelengths(content, folder)


def check_wavelengths(kind: Format, wavelengths_um: Array) -> None:
    """Whether a format takes these wavelengths. Raises SceneError, MissingExtraError."""
    if kind is FORMATS[".pbsdf"]:
        polarized.check_wavelengths(wavelengths_um)
    if kind.colours:
        weigh_channels(wavelengths_um)


def take_off_surface(files: Sequence[SceneFile]) -> tuple[tuple[float, float], list[SceneFile]]:
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
        words = "a smooth surface: a rough one is in the table itself, without nested"
    elif len(indices) > 1:
        listed = ", ".join(f"{above:g}/{below:g}" for above, below in indices)
        words = f"a surface of one index, Mitsuba's dielectric has no others: not {listed}"
    if words:
        raise SceneError(f"nested is for {words}")
    return indices[0], [replace(file, scene=file.scene.without_surface()) for file in files]


def find_smooth_surface(files: Sequence[SceneFile], exact: Spectrum) -> float | None:
    """The index below over that above a smooth surface on top, at the middle wavelength, where it is what mirrors
    beams; None where it is not, or where there is none."""
    surfaces = [surface for file in files if (surface := file.scene.interfaces[0]) and surface.is_smooth]
    if exact.specular_reflectance is None or len(surfaces) < len(files):
        return None
    ratios = [surface.index_below / surface.index_above for surface in surfaces]
    alone = np.stack([reflect_smooth(ratio, exact.mu_i)[:, 0, 0] for ratio in ratios])
    return ratios[len(ratios) // 2] if np.abs(exact.specular_reflectance - alone).max() <= NO_BEAM else None


def list_beams(exact: Spectrum, kind: Format, path: Path, nested: bool, diffuse: bool) -> list[str]:
    """Notes on mirrored beams. Raises SceneError where one is missing in the file and that is not asked for."""
    shares = exact.specular_reflectance
    below = ["of what lies below the surface, which Mitsuba's own dielectric is"] if nested else []
    if shares is None or shares.max() <= NO_BEAM:
        return ["diffuse leaves nothing out: no beam is mirrored"] if diffuse else below
    if nested:
        raise SceneError(
            f"nested is for surfaces below which light is scattered: up to {shares.max():.2g} of it comes back as a "
            "beam from below, mirrored by other interfaces or the base, which neither the table nor the surface has"
        )
    steep = int(np.argmax(exact.mu_i))
    low, high = (f"{share:.3g}" for share in (shares[:, steep].min(), shares[:, steep].max()))
    where = f"{low if low == high else f'{low} to {high}'} of the light at mu_i {exact.mu_i[steep]:.3g}"
    if not diffuse:
        able = ""
        if kind.plugin:
            able = " nested=True (--nested) puts Mitsuba's own dielectric above a table of what lies below;"
        elif kind.fits:
            able = " its model has one smooth surface, on top;"
        words = f"a {path.suffix} cannot hold the beam that is mirrored, {where}"
        raise SceneError(f"{words}:{able} diffuse=True (--diffuse) leaves it out")
    return [f"left out is the mirrored beam, {where}: no table holds what goes into one direction"]


def solve_to_compare(files: Sequence[SceneFile], wavelengths: Array, asked: Mapping[str, Any]) -> Spectrum:
    """The spectrum at some pairs of directions, which a file is compared with."""
    sample = np.random.default_rng(0).uniform(size=(3, CHECKED))
    pairs = CHECKED_FROM + (1.0 - CHECKED_FROM) * sample[:2]
    given = {"mu_i": pairs[0], "mu_o": pairs[1], "phi": 360.0 * sample[2]}
    return solve_spectrum(files, wavelengths, None, **{**asked, **given})


def solve_for_file(
    files: Sequence[SceneFile], wavelengths: Array, exact: Spectrum, asked: Mapping[str, Any], progress: Progress | None
) -> Spectrum:
    """The spectrum that a file is made of: as many cosines and azimuths as the scene's BRDF wants."""
    orders = max(one.diagnostics.get("orders", 0) for one in exact)
    finest = find_finest_nodes(exact)
    given = dict(asked)
    if files[0].keywords(asked).get("method", EXACT) == EXACT:
        given |= finest  # left to itself, a solve for cosines of 1e-4 would choose a great many for their sake
    cosines = int(np.clip(finest.get("nodes", 0), COSINES, MOST_COSINES))
    given |= directions(cosines, int(np.clip(2 * orders + 1, AZIMUTHS, MOST_AZIMUTHS)))
    return solve_spectrum(files, wavelengths, progress, **given)


def compare(
    made: File, exact: Spectrum, weights: Array | None = None, mirrored: bool = False
) -> tuple[float, float, int, float, float]:
    """Median and 95 % of the difference over f00, pairs, difference of reflectances, and 95 % of that of swapped
    directions; ``weights`` (channel, wavelength) where a file has other channels than wavelengths; ``mirrored``: the
    file has a lobe for the mirrored beam."""
    wanted, reflected = np.moveaxis(exact.mueller, 0, 3), (exact.total_reflectance if mirrored else exact.reflectance).T
    mu_i, mu_o, phi = (part.ravel() for part in np.meshgrid(exact.mu_i, exact.mu_o, exact.phi, indexing="ij"))
    found = made.evaluate(exact.mu_i, *(part.reshape(exact.mu_i.size, -1) for part in (mu_o, phi)))
    swapped = made.evaluate(mu_o, mu_i[:, None], phi[:, None])
    wanted = wanted.reshape(mu_i.size, -1, 4, 4)[..., : found.shape[-2], : found.shape[-1]]
    if weights is not None:
        wanted, reflected = np.einsum("cw,nwst->ncst", weights, wanted), reflected @ weights.T
    found, swapped = found.reshape(wanted.shape), swapped.reshape(wanted.shape)
    off = np.abs(found - wanted).max(axis=(2, 3)) / wanted[..., 0, 0]
    apart = np.abs(found - swapped)[..., 0, 0] / (0.5 * np.abs(found + swapped)[..., 0, 0])
    energy = np.abs(integrate_over_hemisphere(made, exact.mu_i) - reflected).max()
    return (
        float(np.median(off)),
        float(np.quantile(off, 0.95)),
        mu_i.size,
        float(energy),
        float(np.quantile(apart, 0.95)),
    )


def integrate_over_hemisphere(made: File, mu_i: Array) -> Array:
    """Directional-hemispherical reflectances (mu_i, channel) of a file, by points that crowd where lobes of facets are:
    half vectors of even u = sqrt(2 theta_m / pi), as measured.py has them, and azimuth."""
    u, azimuth = np.meshgrid(*((np.arange(count) + 0.5) / count for count in ENERGY), indexing="ij")
    half = make_unit_vectors(np.cos(0.5 * np.pi * u.ravel() ** 2), np.pi * azimuth.ravel())
    into = make_unit_vectors(mu_i, np.zeros(mu_i.size))
    cosine = into @ half.T
    out = 2.0 * cosine[..., None] * half - into[:, None]
    phi = np.degrees(np.arctan2(out[..., 1], out[..., 0])) + 180.0
    found = made.evaluate(mu_i, np.clip(out[..., 2], 1e-6, 1.0), phi)[..., 0, 0]
    area = 4.0 * cosine * (2.0 * np.pi**2 * u * np.sin(0.5 * np.pi * u**2)).ravel() / half.shape[0]
    return np.einsum("kn,knc->kc", area * np.maximum(out[..., 2], 0.0), found)


def write_nested_scene(
    path: Path, table: Path, index_above: float, index_below: float, plugin: str = "measured_polarized"
) -> None:
    """Writes a scene file (XML): a sphere of the table ``table``, which must lie beside ``path``, in one of a smooth
    dielectric. Mitsuba has no sum of BSDFs (blendbsdf mixes up beams and other light), so the surface is a shape of its
    own: Mitsuba follows the light through it, and up and down between the two as often as it goes. Raises OSError."""
    name = f'"{escape(Path(table).name)}"'
    more = '\n        <float name="alpha_sample" value="1.0"/>' if plugin == "measured_polarized" else ""
    template = Path(__file__).with_name("nested_dielectric.xml").read_text("utf-8")
    write_text(
        template.format(above=index_above, below=index_below, table=name, inside=1.0 - GAP, plugin=plugin, more=more),
        path,
    )
