"""`vrte.read_scattering`: a phase matrix, or particles, from a file with scattering matrices over angle: CSV, or NetCDF
in the layouts of libRadtran's Mie tables and of Eradiate."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, check_number, put_in_one_line
from vrte.basics.errors import SceneError, UnitsWarning, warn_user
from vrte.formats.atomic import PathName
from vrte.formats.columns import Columns
from vrte.formats.netcdf import Stored, read_netcdf
from vrte.optics.angle_tables import MOST_ANGLES
from vrte.optics.conventions import ELEMENTS, Convention, find_convention
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import PhaseMatrix, mix

LARGEST_TABLE = 1e9  # bytes of values
LABELS = "phamat"
NAMES = ("wavelen", "theta", "ntheta", "phase", "reff", "hum", "ssa", "ext", "w", "mu", "nangles", "albedo", "sigma_t")
SIZES = {"reff": "effective_radius_um", "hum": "humidity_percent"}  # axes of sizes, and the arguments that choose one
UNITS = {  # a micrometre in the units of wavelengths, as files write them
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"), 1.0),
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), 1e3),
}
ORDER = (0, 1, 3, 4, 2, 5)  # places in ELEMENTS of P11, P12, P33, P34, P22, P44, as libRadtran has them
COPIED = (
    "its F43 is +F34, and that of particles is -F34: Eradiate's converter makes such files of libRadtran's tables, by "
    'copying P34 to both places; F34 is taken in the convention "libradtran" (convention= says another)'
)
PLACES = {"11": 0, "12": 1, "22": 2, "33": 3, "34": 4, "44": 5}


class AngleTable(NamedTuple):
    """Ascending angles [degrees] and six columns in the order of ELEMENTS, or None; whether known to be of spheres."""

    angle_deg: Array
    columns: tuple[Array | None, ...]
    spheres: bool = False


class WavelengthTable(NamedTuple):
    """Scattering matrices at ascending wavelengths [um]: ``values`` and ``angle_deg`` (wavelengths, elements, angles),
    NaN beyond an element's own angles, and albedo and extinction (wavelengths,), 1/km per g/m3 if ``per_mass``."""

    wavelengths_um: Array
    values: Array
    angle_deg: Array
    places: tuple[int, ...]
    albedo: Array | None
    extinction: Array | None
    per_mass: bool = False
    radius_um: float | None = None
    convention: str = "vrte"
    doubt: str = ""

    def find_table(self, k: int) -> AngleTable:
        """The table at wavelength ``k``, all elements at the angles of F11, between which cubic splines go."""
        from scipy.interpolate import CubicSpline

        columns: dict[int, Array] = {}
        first = None
        for index, angles, values in zip(self.places, self.angle_deg[k], self.values[k], strict=True):
            there = np.flatnonzero(np.isfinite(angles))
            there = there[::-1] if there.size and angles[there[0]] > angles[there[-1]] else there
            angles, values = angles[there], values[there]
            if angles.size < 2 or (np.diff(angles) <= 0.0).any() or angles[0] < 0.0 or angles[-1] > 180.0:
                raise SceneError("its angles must be in one order from 0 to 180 degrees, each once")
            if not np.isfinite(values).all():
                raise SceneError("its phase must be finite numbers at all its angles")
            first = angles if first is None else first
            columns[index] = values if np.array_equal(angles, first) else CubicSpline(angles, values)(first)
        of_spheres = set(columns) == {0, 1, 3, 4}  # libRadtran's four, and Eradiate's from them
        assert first is not None
        return AngleTable(first, tuple(columns.get(index) for index in range(6)), of_spheres)


def read_wavelength_table(path: PathName, selection: dict[str, float | None]) -> WavelengthTable:
    """The tables of a NetCDF file, of the size or humidity of a ``selection``. Raises as `read_scattering`."""
    stored = read_netcdf(path, (*NAMES, LABELS), LARGEST_TABLE)
    stored.arrays.update({key: stored.arrays[key].astype(np.float64) for key in stored.arrays if key != LABELS})
    for names, layout in LAYOUTS:
        if names <= set(stored.arrays):
            return layout(stored, selection)
    known = " or ".join(", ".join(sorted(names)) for names, _ in LAYOUTS)
    found = ", ".join(sorted(stored.arrays)) or "none that are known"
    raise SceneError(f"it must have the variables {known}; it has {found}")


def arrange_libradtran(stored: Stored, selection: dict[str, float | None]) -> WavelengthTable:
    """wavelen (nlam), theta, phase (nlam, nreff or nhum, nphamat, nthetamax), angles cut by NaN or ntheta."""
    phase, theta = stored.arrays["phase"], stored.arrays["theta"]
    if phase.ndim != 4 or phase.shape != theta.shape or phase.shape[2] not in (1, 4, 6):
        raise SceneError(
            "its phase and theta must be of one shape (wavelengths, sizes, 1, 4 or 6 elements, angles), not "
            f"{phase.shape} and {theta.shape}"
        )
    wavelengths = find_wavelengths(stored, "wavelen", "um", phase.shape[0])
    index, radius = select_size(stored, selection, phase.shape[1])
    for key, shape in {"ntheta": phase.shape[:3], "ssa": phase.shape[:2], "ext": phase.shape[:2]}.items():
        if key in stored.arrays and stored.arrays[key].shape != shape:
            raise SceneError(f"its {key} must be of shape {shape}, not {stored.arrays[key].shape}")
    of = {key: stored.arrays[key][:, index] for key in ("ntheta", "ssa", "ext") if key in stored.arrays}
    angles = cut_angles(theta[:, index], of.get("ntheta"))
    indices, values = ORDER[: phase.shape[2]], phase[:, index]
    return WavelengthTable(
        wavelengths, values, angles, indices, of.get("ssa"), of.get("ext"), True, radius, "libradtran"
    )


def arrange_eradiate(stored: Stored, selection: dict[str, float | None]) -> WavelengthTable:
    """w (w) [nm], mu, and phase (w, mu, i, j); or phase (phamat, w, iangle) with mu (w, iangle) and nangles (w)."""
    select_size(stored, selection, 1)
    phase, mu, labels = stored.arrays["phase"], stored.arrays["mu"], stored.arrays.get(LABELS)
    convention, doubt = "vrte", ""
    indices: tuple[int, ...] = tuple(PLACES.values())
    if phase.ndim == 4 and mu.ndim == 1 and phase.shape[1:] == (mu.size, 4, 4):
        if phase[..., 2, 3].any() and np.array_equal(phase[..., 2, 3], phase[..., 3, 2]):
            convention, doubt = "libradtran", COPIED
        values = np.stack([phase[..., int(name[0]) - 1, int(name[1]) - 1] for name in PLACES], axis=1)
        if not values[:, 1:].any():  # a scalar one
            values, indices = values[:, :1], indices[:1]
        mu = np.tile(mu, (phase.shape[0], 1))
        whole = np.isfinite(mu).all()
    elif phase.ndim == 3 and mu.shape == phase.shape[1:] and labels is not None:
        if len(labels) != phase.shape[0] or not {*labels} <= {*PLACES}:
            shown = put_in_one_line(", ".join(labels.ravel().tolist()), 60)
            raise SceneError(f"its {LABELS} must be of {', '.join(PLACES)}, not {shown}")
        values, indices = phase.swapaxes(0, 1), tuple(PLACES[label] for label in labels)
        mu, whole = cut_angles(mu, stored.arrays.get("nangles")), True
    else:
        raise SceneError(
            "its phase must be of shape (w, mu, 4, 4), or (phamat, w, iangle) with mu (w, iangle) and names phamat; "
            f"not {phase.shape} with mu {mu.shape}"
        )
    if not whole or (np.abs(mu) > 1.0).any():
        raise SceneError("its mu must be cosines from -1 to 1")
    wavelengths = find_wavelengths(stored, "w", "nm", len(values))
    of = {key: stored.arrays[key].ravel() for key in ("albedo", "ssa", "sigma_t", "ext") if key in stored.arrays}
    if any(values.size != wavelengths.size for values in of.values()):
        raise SceneError("its albedo and extinction must have a value for each wavelength")
    angles = np.broadcast_to(np.degrees(np.arccos(mu))[:, None], values.shape)
    albedo, extinction = of.get("ssa", of.get("albedo")), of.get("ext", of.get("sigma_t"))
    return WavelengthTable(wavelengths, values, angles, indices, albedo, extinction, convention=convention, doubt=doubt)


def cut_angles(angles: Array, counts: Array | None) -> Array:
    """Angles or cosines (..., angles) of which the first ``counts`` (...) are there: NaN in place of the others."""
    if counts is None:
        return angles
    return np.where(np.arange(angles.shape[-1]) < counts.reshape(*angles.shape[:-1], 1), angles, np.nan)


def find_wavelengths(stored: Stored, name: str, usual: str, count: int) -> Array:
    """Wavelengths [um], ascending. Raises SceneError."""
    unit = stored.units.get(name, "").strip() or usual
    if unit.lower() not in UNITS:
        raise SceneError(f"its {name} must be in um or nm, not in {put_in_one_line(unit, 20)}")
    found = stored.arrays[name].ravel() / UNITS[unit.lower()]
    if found.size != count or not np.isfinite(found).all() or (found <= 0.0).any() or (np.diff(found) <= 0.0).any():
        raise SceneError(f"its {name} must be {count} ascending wavelengths")
    return found


def select_size(stored: Stored, selection: dict[str, float | None], count: int) -> tuple[int, float | None]:
    """The place of the size or humidity that is asked for, and the effective radius where there is one."""
    index, radius = 0, None
    axes = {
        key: stored.arrays[key].ravel() for key in SIZES if key in stored.arrays and stored.arrays[key].size == count
    }
    for key, name in SIZES.items():
        wanted, values = selection[name], axes.get(key)
        if values is None:
            if wanted is not None:
                raise SceneError.of(name, "must not be given: the file has one table for all")
            continue
        if wanted is None and count > 1:
            words = f"is missing: the file has {values.min():g} to {values.max():g}, {count} of them"
            raise SceneError.of(name, words)
        if wanted is not None:
            index = int(np.argmin(np.abs(values - wanted)))
            if abs(values[index] - wanted) > 1e-6 * abs(wanted):
                raise SceneError.of(name, f"must be one of the file's, {values[index]:g} is nearest, not {wanted:g}")
        radius = float(values[index]) if key == "reff" else radius
    if not axes and count > 1:
        raise SceneError(f"its phase is for {count} sizes, and no reff or hum says which")
    return index, radius


LAYOUTS: tuple[tuple[set[str], Callable[..., WavelengthTable]], ...] = (
    ({"wavelen", "theta", "phase"}, arrange_libradtran),
    ({"w", "mu", "phase"}, arrange_eradiate),
)


CSV, NETCDF_SUFFIXES = ".csv", (".nc", ".nc4", ".cdf")
SAME = 1e-9  # relative difference of wavelengths that count as one
PER_MASS = 1e-3  # extinction [1/um] of a substance of 1 g/cm3, from 1/km per g/m3
LARGEST_FILE = 100_000_000  # bytes
ANGLE, COSINE = "angle_deg", "cosine"
OF_EXPANSIONS = {"a1": 0, "b1": 1, "a2": 2, "a3": 3, "b2": 4, "a4": 5}  # the same elements, by Hovenier's letters
PLACE_OF = {"11": 0, "12": 1, "21": 1, "22": 2, "33": 3, "34": 4, "43": 4, "44": 5}
ELEMENT = re.compile(r"(-?)([FPSM])(\d\d)(/\2?11)?")  # F12, P43/P11, -F12/F11, S34
RATIO = "/F11"


def read_angle_table(path: str | os.PathLike[str], convention: str = "vrte") -> AngleTable:
    """The table over angle_deg or cosine in a CSV file, in a convention. Raises SceneError naming the line, OSError."""
    about = find_convention(convention)
    columns = Columns.read(path, LARGEST_FILE, MOST_ANGLES)
    indices = find_columns(columns.names, about, convention)
    columns.check()
    if COSINE in columns.names:
        cosines = columns.numbers(COSINE, -1.0, 1.0)
        steps = np.diff(cosines)
        for row in np.flatnonzero(steps * np.sign(steps[:1]) <= 0.0)[:1] + 1:
            raise columns.fault(row, f"{COSINE} must be in one order, each once; {cosines[row]:g} is not")
        turn = slice(None, None, -1 if (steps > 0.0).any() else 1)
        angles = np.degrees(np.arccos(cosines))[turn]
    else:
        turn, angles = slice(None), columns.numbers(ANGLE, 0.0, 180.0, ascending=True)
    found = {
        index: columns.numbers(name, *(0.0,) * (index == 0))[turn]
        for name, index in zip(columns.names, indices, strict=True)
        if index is not None
    }
    return AngleTable(angles, tuple(found.get(index) for index in range(len(ELEMENTS))))


def find_columns(header: list[str], about: Convention, convention: str) -> list[int | None]:
    """The place in ELEMENTS of each column, None for the angle. Raises SceneError for names that do not go together."""
    indices = [None if name in (ANGLE, COSINE) else find_element(name, about, convention) for name in header]
    if indices.count(None) != 1:
        raise SceneError(f"the first line must name the columns, one of them {ANGLE} or {COSINE}")
    for index in indices:
        if index is not None and indices.count(index) > 1:
            raise SceneError(f"the column {about.columns[index]} must be there once, not {indices.count(index)} times")
    if 0 not in indices:
        raise SceneError(f"the column {about.columns[0]} is missing: it is {', '.join(header)}")
    return indices


def find_element(name: str, about: Convention, convention: str) -> int:
    """The place in ELEMENTS of a column's name. Raises SceneError where the convention has it in another way."""
    if name in about.columns:
        return about.columns.index(name)
    if name in OF_EXPANSIONS:
        return OF_EXPANSIONS[name]
    found = ELEMENT.fullmatch(name)
    if not found or found[3] not in PLACE_OF or "Pll" in about.columns:
        raise SceneError(
            f"the column {put_in_one_line(repr(name), 40)} is not known: there may be {ANGLE} or {COSINE}, and "
            f'{", ".join(about.columns)} (P, S or M in place of F) in the convention "{convention}"'
        )
    index = PLACE_OF[found[3]]
    meant = about.columns[index]
    other_sign = (found[1] == "-" and not meant.startswith("-")) or (found[3] == "43" and about.circular > 0)
    if other_sign or (found[4] and not meant.endswith(RATIO)):
        words = f'is {meant} in the convention "{convention}": give the one that the table is in, convention=...'
        raise SceneError(f"the column {name} {words}")
    return index


def read_scattering(
    path: str | os.PathLike[str],
    *,
    convention: str | None = None,
    wavelength_um: float | None = None,
    effective_radius_um: float | None = None,
    humidity_percent: float | None = None,
    density_g_cm3: float | None = None,
    normalise: bool = False,
    spheres: bool = False,
    ends: str | None = None,
    accuracy: float | None = None,
    tolerance: float = 0.0,
) -> PhaseMatrix | Particles:
    """The phase matrix in a file of scattering matrices over angle, made by another code or measured.

    Parameters
    ----------
    path : path
        A .csv whose first line names its columns: angle_deg or cosine, and F11 to F44 (P, S or M in place of F, or a1
        to b2, or what the convention calls them); lines that start with # are comments. Or NetCDF (.nc, .cdf) with the
        variables of libRadtran's Mie tables (wavelen, theta, phase; elements P11, P12, P33, P34, P22, P44) or of
        Eradiate (w, mu, phase).
    convention : str, optional
        As of `PhaseMatrix.from_angles`; where left out "libradtran" for NetCDF of libRadtran and "vrte" for all else.
    normalise, spheres, ends, accuracy, tolerance
        As of `PhaseMatrix.from_angles`; four elements in libRadtran's order are of spheres.
    wavelength_um : float, optional
        Of a NetCDF file with several; between two of them phase matrices are mixed by what each scatters.
    effective_radius_um, humidity_percent : float, optional
        One of a NetCDF file's own, where it has several.
    density_g_cm3 : float, optional
        Of the particles' substance: with a libRadtran file, whose extinction is per mass, makes Particles.

    Returns
    -------
    PhaseMatrix or Particles
        Particles where ``density_g_cm3`` is given. ``expansion`` of the phase matrix tells what was found.

    Raises
    ------
    SceneError
        Naming the line of a table or the variable; for a wavelength outside the data.
    OSError
        Where the file cannot be read.
    MissingExtraError
        Of NetCDF, without the extra "files".

    Warns
    -----
    UnitsWarning
        Where Eradiate's F43 is +F34, which betrays a table of libRadtran, and no convention is given.

    Examples
    --------
    >>> import vrte
    >>> with open("dust.csv", "w") as file:
    ...     _ = file.write("# a line\\nangle_deg,F11\\n0,1.5\\n45,1.125\\n90,0.75\\n135,1.125\\n180,1.5\\n")
    >>> vrte.read_scattering("dust.csv").is_scalar
    True
    """
    sizes = {
        "wavelength_um": wavelength_um,
        "effective_radius_um": effective_radius_um,
        "humidity_percent": humidity_percent,
        "density_g_cm3": density_g_cm3,
    }
    for key, value in sizes.items():
        if value is not None:
            sizes[key] = check_number(key, value, 1e-9 if key != "humidity_percent" else 0.0, 1e9, "a number above 0")

    def expand(table: AngleTable, convention: str) -> PhaseMatrix:
        how: dict[str, Any] = {"normalise": normalise, "ends": ends, "accuracy": accuracy, "tolerance": tolerance}
        of_spheres = spheres or table.spheres
        return PhaseMatrix.from_angles(
            table.angle_deg, *table.columns, spheres=of_spheres, convention=convention, **how
        )

    suffix = Path(os.fspath(path)).suffix.lower()
    if suffix == CSV:
        for key, value in sizes.items():
            if value is not None:
                raise SceneError.of(key, "must not be given with a .csv, which holds one table")
        return expand(read_angle_table(path, convention or "vrte"), convention or "vrte")
    if suffix not in NETCDF_SUFFIXES:
        raise SceneError(f"the file must end in {', '.join((CSV, *NETCDF_SUFFIXES))}, not in {suffix or 'nothing'!r}")
    data = read_wavelength_table(path, sizes)
    if convention is None and data.doubt:
        warn_user(data.doubt, UnitsWarning)
    of_file = partial(expand, convention=convention or data.convention)
    return take_wavelength(data, sizes["wavelength_um"], sizes["density_g_cm3"], of_file)


def take_wavelength(
    data: WavelengthTable, wavelength_um: float | None, density: float | None, expand: Callable[..., PhaseMatrix]
) -> PhaseMatrix | Particles:
    """What the data say at a wavelength, linear between the two nearest."""
    known = data.wavelengths_um
    if wavelength_um is None and known.size > 1:
        raise SceneError.of("wavelength_um", f"is missing: the file has {known.size}, {known[0]:g} to {known[-1]:g} um")
    wavelength = float(known[0]) if wavelength_um is None else wavelength_um
    at = float(np.clip(wavelength, known[0], known[-1]))
    if abs(at - wavelength) > SAME * wavelength:
        reach = f"from {known[0]:g} to {known[-1]:g} um" if known.size > 1 else f"{known[0]:g} um"
        raise SceneError.of("wavelength_um", f"must be {reach}, which the data are for, not {wavelength:g}")
    each = np.array([np.interp(at, known, row) for row in np.eye(known.size)])
    near = np.flatnonzero(each > SAME).tolist()
    shares, albedo, extinction = each[near], data.albedo, data.extinction
    for name, values in (("albedo", albedo), ("extinction", extinction)):
        if values is not None and not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise SceneError(f"its {name} must be numbers >= 0 at all wavelengths")
    extinguished = shares if extinction is None else shares * extinction[near]
    weights = shares if albedo is None or extinction is None else extinguished * albedo[near]
    if not weights.sum() > 0.0:
        raise SceneError(f"nothing is scattered at {wavelength:g} um")
    matrices = [expand(data.find_table(k)) for k in near]
    mean = weights.sum() / extinguished.sum()
    single = None if albedo is None else float(shares @ albedo[near] if extinction is None else mean)
    worst = max(matrices, key=lambda matrix: matrix.expansion.largest_error if matrix.expansion else 0.0)
    expansion = worst.expansion
    if expansion is not None:
        between = " and ".join(f"{known[k]:g}" for k in near)
        expansion = replace(expansion, way=f"{expansion.way}, of {between} um", albedo=single)
    mixed = mix(list(zip(matrices, weights.tolist(), strict=True)))
    matrix = PhaseMatrix(*mixed.coefficients.T, tolerance=worst.tolerance, expansion=expansion)
    if density is None:
        return matrix
    if not data.per_mass or single is None or extinction is None:
        raise SceneError.of("density_g_cm3", "needs an albedo and an extinction per mass, which the file does not have")
    volume = 4.0 / 3.0 * np.pi * (1.0 if data.radius_um is None else data.radius_um) ** 3
    area = float(PER_MASS * density * extinguished.sum() * volume)
    return Particles(
        phase_matrix=matrix,
        albedo=single,
        asymmetry=matrix.asymmetry,
        extinction_um2=area,
        scattering_um2=single * area,
        volume_um3=volume,
        description=f"from a table at {wavelength:g} um, of a substance of {density:g} g/cm3",
    )
