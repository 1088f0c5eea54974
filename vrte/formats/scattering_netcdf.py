"""Scattering matrices over wavelength and angle from NetCDF: the layouts of libRadtran's Mie tables and of Eradiate.

A file may be anyone's: it is opened by a process of its own, with a limit of memory and time (`read_foreign`), and what
in it leads to another file is refused.
"""

import json
import os
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError, UnitsWarning, import_extra, warn_user
from vrte.formats.atomic import check_file
from vrte.formats.contents import explain_error
from vrte.formats.hdf5_file import check_size, check_storage, find_stored_name, has_array, open_dataset, read_arrays
from vrte.formats.netcdf import NETCDF, SIGNATURE, Stored, read_foreign

LARGEST_TABLE = 1e9  # bytes of values
CLASSIC = (b"CDF\x01", b"CDF\x02")  # what a file of NetCDF before HDF5 begins with
READER = "vrte.formats.scattering_netcdf:read_variables"
NAMES = ("wavelen", "theta", "ntheta", "phase", "reff", "hum", "ssa", "ext", "w", "mu", "nangles", "albedo", "sigma_t")
LABELS = "phamat"
LONGEST_LABELS = 10_000  # bytes
IN_A_UM = {"um": 1.0, "nm": 1e3}
UNITS = {  # of wavelengths, as files write them
    **dict.fromkeys(("um", "µm", "micron", "microns", "micrometer", "micrometers", "micrometre", "micrometres"), "um"),
    **dict.fromkeys(("nm", "nanometer", "nanometers", "nanometre", "nanometres"), "nm"),
}
ORDER = (0, 1, 3, 4, 2, 5)  # places in ELEMENTS of P11, P12, P33, P34, P22, P44, as libRadtran has them
COPIED = (
    "its F43 is +F34, and that of particles is -F34: Eradiate's converter makes such files of libRadtran's tables, by "
    'copying P34 to both places; F34 is taken in the convention "libradtran" (convention= says another)'
)
PLACES = {"11": 0, "12": 1, "22": 2, "33": 3, "34": 4, "44": 5}


class AngleTable(NamedTuple):
    """Angles [degrees], ascending, and six columns in the order of ELEMENTS, None where one is missing; whether it is
    known to be of spheres."""

    angle_deg: Array
    columns: tuple[Array | None, ...]
    spheres: bool = False


class Selection(NamedTuple):
    """What is asked of a table of many sizes or humidities; None: there is one of them."""

    effective_radius_um: float | None
    humidity_percent: float | None


class WavelengthTable(NamedTuple):
    """Tables over angle at ascending wavelengths [um], by their number; albedo and extinction (wavelengths,) where
    there.

    ``per_mass``: extinction is in 1/km per g/m3, else in whatever unit. ``radius_um``: the effective radius, where
    known. ``convention``: that of the file's elements; ``doubt``: why it may be another, in words.
    """

    wavelengths_um: Array
    find_table: Callable[[int], AngleTable]
    albedo: Array | None
    extinction: Array | None
    per_mass: bool
    radius_um: float | None
    convention: str = "vrte"
    doubt: str = ""

    def choose_convention(self, asked: str | None) -> str:
        """The convention that is asked for, else the file's, with a UnitsWarning where that is in doubt."""
        if asked is None and self.doubt:
            warn_user(self.doubt, UnitsWarning)
        return self.convention if asked is None else asked


def read_wavelength_table(path: str | os.PathLike[str], selection: Selection) -> WavelengthTable:
    """The tables of a NetCDF file. Raises SceneError, OSError, MissingExtraError without the extra "files"."""
    import_extra("h5py", NETCDF, "files")
    name = check_file(path)
    with open(name, "rb") as file:
        begins = file.read(len(SIGNATURE))
    if begins != SIGNATURE and begins[:4] not in CLASSIC:
        raise SceneError("it is not a NetCDF file: it does not begin as one")
    try:
        told, arrays = read_foreign(name, LARGEST_TABLE, READER)
    except SceneError as error:
        raise SceneError(f"the file {error}") from error
    arrays = {key: values.astype(np.float64) for key, values in arrays.items()}
    for names, layout in LAYOUTS:
        if names <= set(arrays):
            return layout(told, arrays, selection)
    known = " or ".join(", ".join(sorted(names)) for names, _ in LAYOUTS)
    raise SceneError(f"it must have the variables {known}; it has {', '.join(sorted(arrays)) or 'none that are known'}")


def read_variables(name: str, most_bytes: float) -> Stored:
    """The variables of NAMES in a NetCDF file, and their units; done by a process of its own."""
    try:
        with open(name, "rb") as file:
            classic = file.read(4) in CLASSIC
        return (read_classic if classic else read_modern)(name, most_bytes)
    except (SceneError, MemoryError):
        raise
    except Exception as error:  # whatever libraries below make of bytes that mean nothing
        raise SceneError(f"is not a NetCDF file: {explain_error(error)}") from error


def read_classic(name: str, most_bytes: float) -> Stored:
    """Of a file of NetCDF before HDF5, which holds all it has."""
    from scipy.io import netcdf_file

    check_size(float(os.path.getsize(name)), most_bytes)
    with netcdf_file(name, "r", mmap=False) as file:
        found = {key: file.variables[key] for key in NAMES if key in file.variables}
        for key, variable in found.items():
            if variable.data.dtype.kind not in "fiu":
                raise SceneError(f"is refused: its {key} must be an array of numbers")
        units = {key: getattr(variable, "units", b"") for key, variable in found.items()}
        told = {key: text.decode(errors="replace") for key, text in units.items() if isinstance(text, bytes)}
        native = {key: np.array(variable.data, dtype=np.float64) for key, variable in found.items()}
    return {"units": json.dumps(told)}, native


def read_modern(name: str, most_bytes: float) -> Stored:
    """Of one in HDF5, every variable checked before a value is read."""
    import h5py

    try:
        with h5py.File(name, "r") as file:
            names = [key for key in NAMES if has_array(file, find_stored_name(file, key))]
            arrays = read_arrays(file, names, most_bytes)
            units = {key: read_units(open_dataset(file, find_stored_name(file, key))) for key in names}
            labels = read_labels(file) if has_array(file, LABELS) else None
    except SceneError as error:
        raise SceneError(f"is refused: {error}") from error
    return {"units": json.dumps(units), "labels": json.dumps(labels)}, arrays


def read_units(dataset: Any) -> str:
    """The attribute ``units`` of an open dataset, "" where it has none, or something else."""
    import h5py

    if not h5py.h5a.exists(dataset.id, b"units"):
        return ""
    found = h5py.h5a.open(dataset.id, b"units")
    if not isinstance(found.get_type(), h5py.h5t.TypeStringID) or found.get_storage_size() > LONGEST_LABELS:
        return ""
    text = dataset.attrs["units"]
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


def read_labels(file: Any) -> list[str]:
    """The names of a dimension, which are text."""
    import h5py

    dataset = open_dataset(file, LABELS)
    check_storage(dataset, LABELS)
    if h5py.check_string_dtype(dataset.dtype) is None or dataset.ndim != 1 or not 1 <= dataset.size <= 16:
        raise SceneError(f"its {LABELS} must be a list of 1 to 16 names")
    return [put_in_one_line(text.decode(errors="replace"), 20) for text in dataset[()]]


def arrange_libradtran(told: dict[str, str], arrays: dict[str, Array], selection: Selection) -> WavelengthTable:
    """wavelen (nlam), theta, phase (nlam, nreff or nhum, nphamat, nthetamax), and ntheta (nlam, nreff, nphamat).

    The order of nphamat is P11, P12, P33, P34 of spheres, and P22, P44; NaN or ntheta ends an element's angles.
    """
    phase, theta = arrays["phase"], arrays["theta"]
    if phase.ndim != 4 or phase.shape != theta.shape or phase.shape[2] not in (1, 4, 6):
        raise SceneError(
            "its phase and theta must be of one shape (wavelengths, sizes, 1, 4 or 6 elements, angles), not "
            f"{phase.shape} and {theta.shape}"
        )
    wavelengths = find_wavelengths(arrays["wavelen"], told, "wavelen", "um", phase.shape[0])
    place, radius = select_size(arrays, selection, phase.shape[1])
    counts = arrays.get("ntheta")
    if counts is not None and counts.shape != phase.shape[:3]:
        raise SceneError(f"its ntheta must be of shape {phase.shape[:3]}, not {counts.shape}")

    def find_table(number: int) -> AngleTable:
        each: list[tuple[Array, Array]] = []
        for element in range(phase.shape[2]):
            many = phase.shape[3] if counts is None else int(np.clip(counts[number, place, element], 0, phase.shape[3]))
            values, angles = phase[number, place, element, :many], theta[number, place, element, :many]
            each.append((angles[np.isfinite(angles)], values[np.isfinite(angles)]))
        return arrange_elements(each, list(ORDER[: phase.shape[2]]))

    of_size = {key: arrays[key] for key in ("ssa", "ext") if key in arrays}
    for key, values in of_size.items():
        if values.shape != phase.shape[:2]:
            raise SceneError(f"its {key} must be of shape {phase.shape[:2]}, not {values.shape}")
        of_size[key] = values[:, place]
    of = of_size.get("ssa"), of_size.get("ext")
    return WavelengthTable(wavelengths, find_table, *of, True, radius, "libradtran")


def arrange_eradiate(told: dict[str, str], arrays: dict[str, Array], selection: Selection) -> WavelengthTable:
    """w (w) [nm], mu, and phase (w, mu, i, j); or phase (phamat, w, iangle) with mu (w, iangle) and nangles (w)."""
    check_no_selection(selection)
    phase, mu = arrays["phase"], arrays["mu"]
    convention, doubt = "vrte", ""
    if phase.ndim == 4 and mu.ndim == 1 and phase.shape[1:] == (mu.size, 4, 4):
        wavelengths = find_wavelengths(arrays["w"], told, "w", "nm", phase.shape[0])
        pairs = [(0, 0), (0, 1), (1, 1), (2, 2), (2, 3), (3, 3)]
        if phase[..., 2, 3].any() and np.array_equal(phase[..., 2, 3], phase[..., 3, 2]):
            convention, doubt = "libradtran", COPIED

        def find_table(number: int) -> AngleTable:
            angles = find_angles(mu)
            columns = [phase[number, :, row, column] for row, column in pairs]
            scalar = not any(column.any() for column in columns[1:])
            return arrange_elements([(angles, column) for column in columns[: 1 if scalar else 6]], list(range(6)))

    elif phase.ndim == 3 and mu.shape == phase.shape[1:] and (labels := json.loads(told.get("labels", "null"))):
        wavelengths = find_wavelengths(arrays["w"], told, "w", "nm", phase.shape[1])
        if len(labels) != phase.shape[0] or not set(labels) <= set(PLACES):
            raise SceneError(f"its {LABELS} must be of {', '.join(PLACES)}, not {', '.join(labels)}")
        counts = arrays.get("nangles", np.full(phase.shape[1], phase.shape[2]))

        def find_table(number: int) -> AngleTable:
            here = np.isfinite(mu[number])
            here[int(np.clip(counts.ravel()[number], 0, here.size)) :] = False
            angles = find_angles(mu[number, here])
            return arrange_elements([(angles, row[number, here]) for row in phase], [PLACES[label] for label in labels])

    else:
        raise SceneError(
            "its phase must be of shape (w, mu, 4, 4), or (phamat, w, iangle) with mu (w, iangle) and names phamat; "
            f"not {phase.shape} with mu {mu.shape}"
        )
    found = {
        to: arrays[key].ravel()
        for key, to in (("albedo", "a"), ("ssa", "a"), ("sigma_t", "e"), ("ext", "e"))
        if key in arrays
    }
    for values in found.values():
        if values.size != wavelengths.size:
            raise SceneError("its albedo and extinction must have a value for each wavelength")
    return WavelengthTable(wavelengths, find_table, found.get("a"), found.get("e"), False, None, convention, doubt)


def find_angles(mu: Array) -> Array:
    """Angles [degrees] of cosines. Raises SceneError for others."""
    if not np.isfinite(mu).all() or (np.abs(mu) > 1.0).any():
        raise SceneError("its mu must be cosines from -1 to 1")
    return np.degrees(np.arccos(mu))


def arrange_elements(each: list[tuple[Array, Array]], places: list[int]) -> AngleTable:
    """One table from elements at angles of their own, in either order: those of F11, between which cubic splines go."""
    from scipy.interpolate import CubicSpline

    sorted_each = [(angles[:: -1 if angles.size and angles[0] > angles[-1] else 1], values) for angles, values in each]
    columns: dict[int, Array] = {}
    first = sorted_each[0][0]
    for (angles, values), (given, _), place in zip(sorted_each, each, places, strict=False):
        turned = values[::-1] if given.size and given[0] > given[-1] else values
        if angles.size < 2 or (np.diff(angles) <= 0.0).any() or angles[0] < 0.0 or angles[-1] > 180.0:
            raise SceneError("its angles must be in one order from 0 to 180 degrees, each once")
        if not np.isfinite(turned).all():
            raise SceneError("its phase must be finite numbers at all its angles")
        same = np.array_equal(angles, first)
        columns[place] = turned if same else CubicSpline(angles, turned)(first)
    of_spheres = set(columns) == {0, 1, 3, 4}  # libRadtran's four, and Eradiate's from them
    return AngleTable(first, tuple(columns.get(place) for place in range(6)), of_spheres)


def find_wavelengths(values: Array, told: dict[str, str], name: str, usual: str, count: int) -> Array:
    """Wavelengths [um], ascending. Raises SceneError."""
    words = json.loads(told["units"]).get(name, "").strip()
    unit = UNITS.get(words.lower(), usual if not words else None)
    if unit is None:
        raise SceneError(f"its {name} must be in um or nm, not in {put_in_one_line(words, 20)}")
    found = values.ravel() / IN_A_UM[unit]
    if found.size != count or not np.isfinite(found).all() or (found <= 0.0).any() or (np.diff(found) <= 0.0).any():
        raise SceneError(f"its {name} must be {count} ascending wavelengths")
    return found


def select_size(arrays: dict[str, Array], selection: Selection, count: int) -> tuple[int, float | None]:
    """The place of the size or humidity that is asked for, and the effective radius where there is one."""
    axes = {"reff": selection.effective_radius_um, "hum": selection.humidity_percent}
    names = {"reff": "effective_radius_um", "hum": "humidity_percent"}
    place, radius = 0, None
    there = [key for key in axes if key in arrays and arrays[key].size == count]
    for key, wanted in axes.items():
        if key not in there:
            if wanted is not None:
                raise SceneError.of(names[key], "must not be given: the file has one table for all")
            continue
        values = arrays[key].ravel()
        if wanted is None and count > 1:
            listed = f"{values.min():g} to {values.max():g}, {count} of them"
            raise SceneError.of(names[key], f"is missing: the file has {listed}")
        if wanted is not None:
            place = int(np.argmin(np.abs(values - wanted)))
            if abs(values[place] - wanted) > 1e-6 * abs(wanted):
                raise SceneError.of(
                    names[key], f"must be one of the file's, {values[place]:g} is nearest, not {wanted:g}"
                )
        radius = float(values[place]) if key == "reff" else radius
    if not there and count > 1:
        raise SceneError(f"its phase is for {count} sizes, and no reff or hum says which")
    return place, radius


def check_no_selection(selection: Selection) -> None:
    """Raises SceneError where a size is asked for of a file that has none."""
    for name, value in selection._asdict().items():
        if value is not None:
            raise SceneError.of(name, "must not be given: the file has one table for all")


LAYOUTS: tuple[tuple[set[str], Callable[..., WavelengthTable]], ...] = (
    ({"wavelen", "theta", "phase"}, arrange_libradtran),
    ({"w", "mu", "phase"}, arrange_eradiate),
)
