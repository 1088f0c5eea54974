"""`vrte.read_scattering`: a phase matrix, or particles, from a file with scattering matrices over angle."""

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from vrte.basics.arrays import check_number
from vrte.basics.errors import SceneError
from vrte.formats.scattering_netcdf import Selection, WavelengthTable, read_wavelength_table
from vrte.formats.scattering_table import AngleTable, read_angle_table
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import PhaseMatrix

CSV, NETCDF_SUFFIXES = ".csv", (".nc", ".nc4", ".cdf")
SAME = 1e-9  # relative: wavelengths as near are one
PER_MASS = 1e-3  # 1/um of a substance of 1 g/cm3, from 1/km per g/m3


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
    name = os.fspath(path)
    expand = partial(
        expand_columns,
        normalise=normalise,
        ends=ends,
        accuracy=accuracy,
        tolerance=tolerance,
    )
    options = {
        "wavelength_um": wavelength_um,
        "effective_radius_um": effective_radius_um,
        "humidity_percent": humidity_percent,
        "density_g_cm3": density_g_cm3,
    }
    for key, value in options.items():
        if value is not None:
            options[key] = check_number(key, value, 1e-9 if key != "humidity_percent" else 0.0, 1e9, "a number above 0")
    suffix = Path(str(name)).suffix.lower()
    if suffix == CSV:
        for key, value in options.items():
            if value is not None:
                raise SceneError.of(key, "must not be given with a .csv, which holds one table")
        return expand(read_angle_table(path, convention or "vrte"), spheres=spheres, convention=convention or "vrte")
    if suffix not in NETCDF_SUFFIXES:
        raise SceneError(f"the file must end in {', '.join((CSV, *NETCDF_SUFFIXES))}, not in {suffix or 'nothing'!r}")
    selection = Selection(options["effective_radius_um"], options["humidity_percent"])
    data = read_wavelength_table(path, selection)
    expand = partial(expand, spheres=spheres, convention=data.choose_convention(convention))
    return take_wavelength(data, options["wavelength_um"], options["density_g_cm3"], expand)


def expand_columns(table: AngleTable, *, spheres: bool, **options: object) -> PhaseMatrix:
    """The phase matrix of a table over angle."""
    return PhaseMatrix.from_angles(table.angle_deg, *table.columns, spheres=spheres or table.spheres, **options)  # type: ignore[arg-type]


def take_wavelength(
    data: WavelengthTable,
    wavelength_um: float | None,
    density: float | None,
    expand: Callable[[AngleTable], PhaseMatrix],
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
    shares = {number: float(np.interp(at, known, row)) for number, row in enumerate(np.eye(known.size))}
    shares = {number: share for number, share in shares.items() if share > SAME}
    albedo, extinction = data.albedo, data.extinction
    for name, values in (("albedo", albedo), ("extinction", extinction)):
        if values is not None and not (np.isfinite(values).all() and (values >= 0.0).all()):
            raise SceneError(f"its {name} must be numbers >= 0 at all wavelengths")
    ones = np.ones(known.size)
    extinguished = sum(share * (ones if extinction is None else extinction)[number] for number, share in shares.items())
    weights = ones if albedo is None or extinction is None else albedo * extinction
    scattered = sum(share * weights[number] for number, share in shares.items())
    if not scattered > 0.0:
        raise SceneError(f"nothing is scattered at {wavelength:g} um")
    matrices = {number: expand(data.find_table(number)) for number in shares}
    coefficients = np.zeros((max(matrix.terms for matrix in matrices.values()), 6))
    for number, matrix in matrices.items():
        coefficients[: matrix.terms] += shares[number] * weights[number] / scattered * matrix.coefficients
    coefficients[0, 0] = 1.0
    single = None if albedo is None else float(sum(share * albedo[number] for number, share in shares.items()))
    if albedo is not None and extinction is not None:
        single = float(scattered / extinguished)
    worst = max(matrices.values(), key=lambda matrix: matrix.expansion.largest_error if matrix.expansion else 0.0)
    told = worst.expansion
    if told is not None:
        between = " and ".join(f"{known[number]:g}" for number in shares)
        told = replace(told, way=f"{told.way}, of {between} um", albedo=single)
    matrix = PhaseMatrix(*coefficients.T, tolerance=worst.tolerance, expansion=told)
    if density is None:
        return matrix
    if not data.per_mass or single is None or extinction is None:
        raise SceneError.of("density_g_cm3", "needs an albedo and an extinction per mass, which the file does not have")
    radius = 1.0 if data.radius_um is None else data.radius_um
    volume = 4.0 / 3.0 * np.pi * radius**3
    area = float(PER_MASS * density * extinguished * volume)
    return Particles(
        phase_matrix=matrix,
        albedo=single,
        asymmetry=matrix.asymmetry,
        extinction_um2=area,
        scattering_um2=single * area,
        volume_um3=volume,
        description=f"from a table at {wavelength:g} um, of a substance of {density:g} g/cm3",
    )
