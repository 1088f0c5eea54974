"""A measurement as the page shows it: which of its numbers make one curve, and what there is to tell of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import LOOK, QUANTITIES

COORDINATES = {  # in words, as a sign, and the unit
    "theta_o_deg": ("angle of exit", "θₒ", "°"),
    "wavelength_um": ("wavelength in vacuum", "λ", "µm"),
    "phi_deg": ("azimuth φ", "φ", "°"),
    "theta_i_deg": ("angle of incidence", "θᵢ", "°"),
}
LABELS = "geometry", "illuminant"  # columns of words that part curves, too
NUMBERS, COLOURS = "single numbers", "colour coordinates"  # what is shown as bars
HEADS = ("quantity", "points", "incidence", "exit", "azimuth", "wavelength", "sigma")
TOLD = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um")
DIGITS = 9  # to which two angles or wavelengths are the same
FINE = 61  # points of a curve from its first to its last angle
MOST_FINE = 1500  # directions that are worth a finer curve


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers that go together: their ``name``, rows of the measurement, and their ``x``."""

    name: str
    x: Array
    rows: Any


def list_shown(measured: Measurement) -> list[str]:
    """What there is to look at: each quantity along its axis; those of single numbers together."""
    along = [name for name in measured.names if find_axis(measured, name)]
    kinds = dict.fromkeys(name_bars(name) for name in measured.names if name not in along)
    return [*along, *kinds]


def name_bars(quantity: str) -> str:
    """Under what a single number is shown."""
    return COLOURS if QUANTITIES[quantity].needs == LOOK else NUMBERS


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
    counts = {name: count_values(column) for name, column in columns.items()}
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


def count_values(column: Array) -> int:
    """How many different numbers there are."""
    return int(np.unique(column[np.isfinite(column)].round(DIGITS)).size)


def split_curves(measured: Measurement, quantity: str) -> tuple[str, list[Curve]]:
    """The axis of a quantity that has one, and its numbers by all that is not along it, each curve from left to right.

    Against the angle of exit the plane of φ and φ + 180 is one curve, its far side at angles below 0, as in a cut.

    >>> seen = Measurement("f00", [0.1, 0.2], theta_i_deg=30.0, theta_o_deg=[10.0, 20.0], phi_deg=[0.0, 180.0])
    >>> axis, (curve,) = split_curves(seen, "f00")
    >>> axis, curve.x.tolist(), curve.rows.tolist()
    ('theta_o_deg', [-20.0, 10.0], [1, 0])
    """
    axis, rows = find_axis(measured, quantity), find_rows(measured, quantity)
    columns: dict[str, Any] = {name: getattr(measured, name)[rows] for name in (*COORDINATES, *LABELS)}
    if axis == "theta_o_deg":
        columns |= fold_planes(columns[axis], columns["phi_deg"])
    x = columns.pop(axis)
    words = {name: [write_coordinate(name, one) for one in column] for name, column in columns.items()}
    told = [name for name, column in words.items() if len(set(column)) > 1]
    names = np.array([", ".join(filter(None, parts)) for parts in zip(*words.values(), strict=True)])
    short = [", ".join(filter(None, parts)) or quantity for parts in zip(*(words[one] for one in told), strict=True)]
    curves = []
    for name in dict.fromkeys(names.tolist()):
        own = np.flatnonzero(names == name)
        own = own[np.argsort(x[own], kind="stable")]
        curves.append(Curve(short[own[0]] if told else quantity, x[own], rows[own]))
    return axis, curves


def write_coordinate(name: str, value: Any) -> str:
    """Where something was seen, in words; "" where nothing is said.

    >>> write_coordinate("theta_i_deg", 30.0), write_coordinate("wavelength_um", 0.55)
    ('θᵢ = 30°', 'λ = 0.55 µm')
    """
    if name in LABELS:
        return str(value)
    _, sign, unit = COORDINATES[name]
    return "" if np.isnan(value) else f"{sign} = {value:.5g}{'' if unit == '°' else ' '}{unit}"


def refine_curves(measured: Measurement) -> Measurement | None:
    """The same quantities at more angles of exit, for smooth curves; None where none runs along one, or many do.

    Other axes stay as they are: more wavelengths or angles of incidence would take more solves.
    """
    parts: list[dict[str, Any]] = []
    for quantity in measured.names:
        if find_axis(measured, quantity) != "theta_o_deg":
            continue
        for curve in split_curves(measured, quantity)[1]:
            x = np.union1d(np.linspace(curve.x[0], curve.x[-1], FINE).round(DIGITS), curve.x.round(DIGITS))
            first = curve.rows[0]
            phi = float(measured.phi_deg[first]) + (180.0 if measured.theta_o_deg[first] < 0.0 else 0.0)
            parts += [
                {
                    "quantity": quantity,
                    "theta_i_deg": measured.theta_i_deg[first],
                    "theta_o_deg": abs(angle),
                    "phi_deg": phi % 180.0 + (180.0 if angle < 0.0 else 0.0),
                    "wavelength_um": measured.wavelength_um[first],
                }
                for angle in x.tolist()
            ]
    if not 0 < len(parts) <= MOST_FINE:
        return None
    columns = {name: [part[name] for part in parts] for name in parts[0]}
    return Measurement(value=0.0, **columns)


def describe_measured(measured: Measurement) -> Iterator[tuple[str, ...]]:
    """Rows of a table: quantity, number of points, angles, wavelengths, and whether their errors are known."""
    for quantity in measured.names:
        rows = find_rows(measured, quantity)
        ranges = [write_range(getattr(measured, name)[rows], COORDINATES[name][2]) for name in TOLD]
        yield quantity, str(rows.size), *ranges, "yes" if measured.has_sigma else "no"


def write_range(column: Array, unit: str) -> str:
    """From where to where a column goes, and how many values it has.

    >>> write_range(np.array([0.4, 0.5, 0.5]), "µm"), write_range(np.array([np.nan]), "°")
    ('0.4 to 0.5 µm (2)', '–')
    """
    values = np.unique(column[np.isfinite(column)].round(DIGITS))
    space = "" if unit == "°" else " "
    if values.size == 0:
        return "–"
    if values.size == 1:
        return f"{values[0]:.4g}{space}{unit}"
    return f"{values[0]:.4g} to {values[-1]:.4g}{space}{unit} ({values.size})"
