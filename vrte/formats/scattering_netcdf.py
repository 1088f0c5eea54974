"""Scattering matrices over wavelength and angle from NetCDF: the layouts of libRadtran's Mie tables and of Eradiate."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.atomic import PathName
from vrte.formats.netcdf import Stored, read_netcdf

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
    """Angles [degrees], ascending, and six columns in the order of ELEMENTS, None where one is missing; whether it is
    known to be of spheres."""

    angle_deg: Array
    columns: tuple[Array | None, ...]
    spheres: bool = False


class WavelengthTable(NamedTuple):
    """Scattering matrices at ascending wavelengths [um]; albedo and extinction (wavelengths,) where they are there.

    ``values`` and ``angle_deg`` (wavelengths, elements, angles): each element at angles of its own, NaN where it has
    none; ``places`` of the elements in ELEMENTS. ``per_mass``: extinction is in 1/km per g/m3, else in whatever unit.
    ``radius_um``: the effective radius, where known. ``convention`` of the elements; ``doubt``: why it may be another.
    """

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
    """The tables of a NetCDF file, of the size or humidity that ``selection`` asks for by SIZES, None where the file
    has one. Raises SceneError, OSError, MissingExtraError without the extra "files"."""
    stored = read_netcdf(path, (*NAMES, LABELS), LARGEST_TABLE)
    stored.arrays.update({key: stored.arrays[key].astype(np.float64) for key in stored.arrays if key != LABELS})
    for names, layout in LAYOUTS:
        if names <= set(stored.arrays):
            return layout(stored, selection)
    known = " or ".join(", ".join(sorted(names)) for names, _ in LAYOUTS)
    found = ", ".join(sorted(stored.arrays)) or "none that are known"
    raise SceneError(f"it must have the variables {known}; it has {found}")


def arrange_libradtran(stored: Stored, selection: dict[str, float | None]) -> WavelengthTable:
    """wavelen (nlam), theta, phase (nlam, nreff or nhum, nphamat, nthetamax), and ntheta (nlam, nreff, nphamat).

    The order of nphamat is P11, P12, P33, P34 of spheres, and P22, P44; NaN or ntheta ends an element's angles.
    """
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
