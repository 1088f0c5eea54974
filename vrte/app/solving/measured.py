"""A measurement as the page shows it: which of its numbers make one curve, and what there is to tell of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.fit.curves import COORDINATES, DIGITS, find_axis, find_rows, name_bars, split_curves
from vrte.fit.measurement import Measurement

HEADS = ("quantity", "points", "incidence", "exit", "azimuth", "wavelength", "sigma")
TOLD = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um")
FINE = 61  # points of a curve from its first to its last angle
MOST_FINE = 1500  # directions that are worth a finer curve


def list_shown(measured: Measurement) -> list[str]:
    """What there is to look at: each quantity along its axis; those of single numbers together."""
    along = [name for name in measured.names if find_axis(measured, name)]
    kinds = dict.fromkeys(name_bars(name) for name in measured.names if name not in along)
    return [*along, *kinds]


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
