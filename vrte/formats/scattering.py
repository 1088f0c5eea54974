"""`vrte.read_scattering`: a phase matrix, or particles, from a file with scattering matrices over angle."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import check_number, put_in_one_line
from vrte.basics.errors import SceneError, UnitsWarning, warn_user
from vrte.formats.columns import Columns
from vrte.formats.scattering_netcdf import AngleTable, WavelengthTable, read_wavelength_table
from vrte.optics.angle_tables import MOST_ANGLES
from vrte.optics.conventions import ELEMENTS, Convention, find_convention
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import PhaseMatrix, mix

CSV, NETCDF_SUFFIXES = ".csv", (".nc", ".nc4", ".cdf")
SAME = 1e-9  # relative difference of wavelengths that count as one
PER_MASS = 1e-3  # extinction [1/um] of a substance of 1 g/cm3, from 1/km per g/m3
LARGEST_FILE = 100_000_000  # bytes
ANGLE, COSINE = "angle_deg", "cosine"
OF_EXPANSIONS = {"a1": 0, "b1": 1, "a2": 2, "a3": 3, "b2": 4, "a4": 5}  # the same elements, by Hovenier's letters
PLACES = {"11": 0, "12": 1, "21": 1, "22": 2, "33": 3, "34": 4, "43": 4, "44": 5}
ELEMENT = re.compile(r"(-?)([FPSM])(\d\d)(/\2?11)?")  # F12, P43/P11, -F12/F11, S34
RATIO = "/F11"


def read_angle_table(path: str | os.PathLike[str], convention: str = "vrte") -> AngleTable:
    """The table over angle in a CSV file. One column is angle_deg, ascending from 0 to 180, or cosine, in either order;
    the others are elements, F11, P11, S11 or M11 to F44, a1 to b2, or what the convention calls them, such as -F12/F11.
    Raises SceneError naming the line, OSError.

    >>> with open("fog.csv", "w") as file:
    ...     _ = file.write("cosine,F11\\n-1,0.5\\n0,1\\n1,1.5\\n")
    >>> read_angle_table("fog.csv").angle_deg.tolist()
    [0.0, 90.0, 180.0]
    """
    about = find_convention(convention)
    columns = Columns(path, LARGEST_FILE, MOST_ANGLES)
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
    if not found or found[3] not in PLACES or "Pll" in about.columns:
        raise SceneError(
            f"the column {put_in_one_line(repr(name), 40)} is not known: there may be {ANGLE} or {COSINE}, and "
            f'{", ".join(about.columns)} (P, S or M in place of F) in the convention "{convention}"'
        )
    index = PLACES[found[3]]
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
