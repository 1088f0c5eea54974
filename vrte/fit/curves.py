"""The rows of a measurement as curves: which coordinate they run along, and which of them make one curve."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import QUANTITIES

COORDINATES = {  # in words, as a sign, and the unit
    "theta_o_deg": ("angle of exit", "θₒ", "°"),
    "wavelength_um": ("wavelength in vacuum", "λ", "µm"),
    "phi_deg": ("azimuth φ", "φ", "°"),
    "theta_i_deg": ("angle of incidence", "θᵢ", "°"),
}
LABELS = "geometry", "illuminant", "base"  # columns that part curves, too
NUMBERS, COLOURS = "single numbers", "colour coordinates"  # what is shown as bars
DIGITS = 9  # to which two angles or wavelengths are the same


@dataclass(frozen=True, eq=False)
class CurveRows:
    """Numbers that go together: their ``name``, rows of the measurement, and their ``x``."""

    name: str
    x: Array
    rows: Any


def name_bars(quantity: str) -> str:
    """Under what a single number is shown."""
    return COLOURS if QUANTITIES[quantity].is_over_visible else NUMBERS


def find_rows(measured: Measurement, shown: str) -> Any:
    """The rows of what is shown: of a quantity, or of all single numbers of a kind."""
    if shown not in (NUMBERS, COLOURS):
        return np.flatnonzero(measured.quantity == shown)
    names = [name for name in measured.names if name_bars(name) == shown and not find_axis(measured, name)]
    return np.flatnonzero(np.isin(measured.quantity.astype(str), names))


def find_axis(measured: Measurement, quantity: str) -> str:
    """The coordinate that has most values for a quantity; "" where none has two."""
    rows = find_rows(measured, quantity)
    columns = {name: getattr(measured, name)[rows] for name in COORDINATES}
    columns |= fold_planes(columns["theta_o_deg"], columns["phi_deg"])
    counts = {name: np.unique(one[np.isfinite(one)].round(DIGITS)).size for name, one in columns.items()}
    best = max(counts, key=lambda name: counts[name])
    return best if counts[best] > 1 else ""


def fold_planes(theta_o_deg: Array, phi_deg: Array) -> dict[str, Array]:
    """The same directions by planes φ from 0 to below 180, with angles of exit below 0 beyond the normal.

    >>> folded = fold_planes(np.array([20.0, -20.0]), np.array([180.0, 0.0]))
    >>> [column.tolist() for column in folded.values()]
    [[-20.0, -20.0], [0.0, 0.0]]
    """
    turned = (phi_deg + np.where(theta_o_deg < 0.0, 180.0, 0.0)) % 360.0
    far = turned >= 180.0
    signed = np.where(far, -1.0, 1.0) * np.abs(theta_o_deg)
    return {"theta_o_deg": signed, "phi_deg": np.where(far, turned - 180.0, turned)}


def split_curves(measured: Measurement, quantity: str) -> tuple[str, list[CurveRows]]:
    """The axis of a quantity that has one, and its numbers by all that is not along it, each curve from left to right;
    against the angle of exit the plane of φ and φ + 180 is one curve, its far side below 0."""
    axis, rows = find_axis(measured, quantity), find_rows(measured, quantity)
    columns: dict[str, Any] = {name: getattr(measured, name)[rows] for name in (*COORDINATES, *LABELS)}
    if axis == "theta_o_deg":
        columns |= fold_planes(columns[axis], columns["phi_deg"])
    x = columns.pop(axis)
    words = {name: [write_coordinate(name, one) for one in column] for name, column in columns.items()}
    differing = [name for name, column in words.items() if len(set(column)) > 1]
    names = np.array([", ".join(filter(None, parts)) for parts in zip(*words.values(), strict=True)])
    short = [
        ", ".join(filter(None, parts)) or quantity for parts in zip(*(words[one] for one in differing), strict=True)
    ]
    curves = []
    for name in dict.fromkeys(names.tolist()):
        own = np.flatnonzero(names == name)
        own = own[np.argsort(x[own], kind="stable")]
        curves.append(CurveRows(short[own[0]] if differing else quantity, x[own], rows[own]))
    return axis, curves


def write_coordinate(name: str, value: Any) -> str:
    """Where something was seen, in words; "" where the coordinate is NaN.

    >>> write_coordinate("theta_i_deg", 30.0), write_coordinate("wavelength_um", 0.55)
    ('θᵢ = 30°', 'λ = 0.55 µm')
    """
    if name in LABELS:
        return str(value) if name != "base" else "" if np.isnan(value) else f"base {value:.5g}"
    _, sign, unit = COORDINATES[name]
    return "" if np.isnan(value) else f"{sign} = {value:.5g}{'' if unit == '°' else ' '}{unit}"
