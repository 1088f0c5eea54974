"""Bases by the ``kind`` of a table [base], and from files: a result of vrte, or a measured pBRDF in Mitsuba's tensors.
A new kind is a class and a row (docs/how_to/extending.md)."""

import inspect
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_number, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.basics.splines import MIRROR
from vrte.formats.atomic import PathName, check_file, check_file_name
from vrte.formats.keys import (
    Choice,
    FilePath,
    Flag,
    Fraction,
    Index,
    Key,
    Number,
    Reading,
    Row,
    join_rows,
    make_of_keys,
    read_beside,
)
from vrte.formats.measured_polarized import AXES, Axes, directions, evaluate_table, make_pairs, read_tensors
from vrte.formats.result_file import load
from vrte.formats.toml_table import Table
from vrte.results.brdf import Brdf, Spectrum
from vrte.scene.boundary import Boundary, Lambertian
from vrte.scene.facets import MEASURED, MOST_WIND, Facets, cox_munk
from vrte.scene.interface import LEAST_ROUGHNESS, MOST_ROUGHNESS, ROUGHNESS_ALLOWED
from vrte.scene.mirror import Mirror
from vrte.scene.scalar import RPV, Hapke, RossLi
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
    """The base of a tensor file, at the directions of vrte's own tables. Raises SceneError, OSError."""
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
    pairs = make_pairs(mu_i[:, None, None], mu_o[:, None], aside)
    found = evaluate_table(table[:, :, :, None], axes, *pairs)
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
    """The mean of a table (phi_d, theta_d, theta_h, 4, 4) and its mirror image. Raises SceneError where they differ."""
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


ALBEDO = 'a number between 0 and 1, or per cent in quotes, "30 %"'
ROUGHNESS = 0.1  # that a rough surface begins with
SLOPES = {"beckmann": "Gaussian (Beckmann)", "ggx": "with long tails (GGX)"}
H_WORDS = {"2002": "Hapke 2002, within 1 %", "1981": "Hapke 1981, within 4 %"}
FACETS: dict[str, Key] = {  # how rough a surface is, of a base or an interface
    "roughness": Number(
        "roughness",
        ROUGHNESS,
        hint=f"slopes' rms times √2, {LEAST_ROUGHNESS:g} to {MOST_ROUGHNESS:g}",
        allowed=ROUGHNESS_ALLOWED,
    ),
    "distribution": Choice("slopes of facets", names=SLOPES, needed=False),
    "shadowing": Flag("facets hide each other (Smith)", needed=False, usual=lambda table: True),
    "conserving": Flag(
        "light lost between facets is given back", needed=False, usual=lambda table: table.get("shadowing", True)
    ),
}
AVERAGED = "average_mirrored"
SUBSTANCE = Index("substance", [1.5, 0.0])


class BaseFile(FilePath):
    """A file that holds a base, at the wavelength of the scene where it has one."""

    def read(self, table: Table, name: str, reading: Reading) -> Boundary:
        super().read(table, name, reading)
        wavelength = reading.wavelength if "wavelength_um" in reading.file else None
        averaged = AVERAGED in table and table.flag(AVERAGED)
        read = partial(read_base_once, wavelength_um=wavelength, average_mirrored=averaged)
        return read_beside(table, name, read, reading.folder)


def limit(make: type[Boundary], name: str, label: str, start: float | None = None, hint: str = "") -> Number:
    """The key of a number that a base limits, and may have a default for."""
    low, high = make.LIMITS[name]
    default = inspect.signature(make).parameters[name].default
    empty = f"{default:g}" if isinstance(default, float) and start is None else ""
    words = "; ".join(filter(None, (f"{low:g} to {high:g}", hint)))
    return Number(label, start, hint=words, empty=empty, needed=default is inspect.Parameter.empty)


BASES: dict[str, Row] = {
    "black": Row("black", lambda: None, {}),
    "lambertian": Row(
        "white or grey (Lambertian)", Lambertian, {"albedo": Fraction("albedo of the base", 0.5, allowed=ALBEDO)}
    ),
    "mirror": Row("smooth metal or glass (a mirror)", Mirror, {"index": SUBSTANCE}),
    "facets": Row("rough metal or glass (facets)", Facets, {"index": SUBSTANCE, **FACETS}),
    "cox-munk": Row(
        "rough sea, by the wind (Cox and Munk)",
        cox_munk,
        {
            "wind": Number("wind", 7.0, hint=f"m/s, 0 to {MOST_WIND:g}; measured up to {MEASURED:g}"),
            "index": Index("water", [1.34, 0.0], empty="1.34", needed=False),
            "shadowing": Flag("waves hide each other (Smith)", needed=False),
        },
    ),
    "rpv": Row(
        "vegetation, soil, snow (Rahman, Pinty, Verstraete)",
        RPV,
        {
            "rho_0": limit(RPV, "rho_0", "amplitude ρ0", 0.1),
            "k": limit(RPV, "k", "bowl or bell k", 0.7, "below 1 brighter to the horizon"),
            "asymmetry": limit(RPV, "asymmetry", "asymmetry Θ", -0.1, "below 0 sends light back"),
            "rho_c": replace(limit(RPV, "rho_c", "hot spot ρc", None, "1: none"), empty="as ρ0"),
        },
    ),
    "ross-li": Row(
        "land as MODIS has it (Ross-Li)",
        RossLi,
        {
            "f_iso": limit(RossLi, "f_iso", "even f_iso", 0.2),
            "f_vol": limit(RossLi, "f_vol", "leaves f_vol", 0.1),
            "f_geo": limit(RossLi, "f_geo", "crowns f_geo", 0.0, "above 0 negative f at the horizon is cut"),
            "crown_height": limit(RossLi, "crown_height", "crown height h/b"),
            "crown_shape": limit(RossLi, "crown_shape", "crown shape b/r"),
            "hot_spot": Flag("hot spot of leaves (Maignan)", needed=False),
        },
    ),
    "hapke": Row(
        "regolith, powder (Hapke)",
        Hapke,
        {
            "albedo": Fraction("albedo of a grain", 0.6, allowed=ALBEDO),
            "opposition": limit(Hapke, "opposition", "opposition effect B0"),
            "width": limit(Hapke, "width", "its width h"),
            "linear": limit(Hapke, "linear", "phase function: cos g"),
            "quadratic": limit(Hapke, "quadratic", "phase function: (3 cos² g - 1)/2"),
            "asymmetry": limit(Hapke, "asymmetry", "or its asymmetry", None, "below 0 sends light back"),
            "h_function": Choice("formula for H", names=H_WORDS, empty="2002", needed=False),
        },
    ),
    "table": Row(
        "a table of measured or solved Mueller matrices",
        lambda file, average_mirrored=False: file,  # it was averaged where it was read
        {
            "file": BaseFile("file", suffixes=(".nc", ".csv", *TENSORS)),
            AVERAGED: Flag("mirror images are averaged", needed=False),
        },
    ),
}


def read_base_table(reading: Reading) -> Boundary | None:
    """The base of a scene file; None where it is black. Raises SceneError."""
    if "base" not in reading.file:
        return None
    table = reading.file.table("base", ("kind", *join_rows(BASES)))
    row = BASES[table.choice("kind", tuple(BASES))]
    for key in table.content:
        if key != "kind" and key not in row.keys:
            owners = [f'"{owner}"' for owner, other in BASES.items() if key in other.keys]
            raise table.wrong(key, f"goes with kind = {' or '.join(owners)} only")
    return make_of_keys(row, table, reading)


INTERFACE: dict[str, Key] = {**FACETS, "roughness": replace(FACETS["roughness"], needed=False)}
