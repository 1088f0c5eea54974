"""The picture of a fit: what was measured and what the scene shows, and the residuals in sigmas."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import QUANTITIES
from vrte.fit.result import Fit
from vrte.pictures.figures import FAINT, limit_ticks, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PANELS = 4  # quantities with a panel of their own; those after them share the last one, by rows
COLOURS = "#1f4e79", "#d98200", "#2a8f5b", "#b3262e", "#7a4fa3", "#666666"
AXES = {
    "wavelength_um": "wavelength [µm]",
    "theta_o_deg": "angle of exit [degrees]",
    "phi_deg": "azimuth [degrees]",
    "theta_i_deg": "angle of incidence [degrees]",
}
SERIES = ("theta_i_deg", "theta_o_deg", "phi_deg", "wavelength_um", "geometry")
WIDTH, HEIGHT = 4.2, 5.2  # [inches] of a column


def draw_fit(fit: Fit) -> "Figure":
    """A column of two panels for each quantity, and one panel with the spread of the residuals."""
    given = fit.measurement
    names = list(given.names)
    shown: list[tuple[str, Any]] = [(name, np.flatnonzero(given.quantity == name)) for name in names[:MOST_PANELS]]
    if len(names) > MOST_PANELS:
        rest = np.flatnonzero(~np.isin(given.quantity, names[: MOST_PANELS - 1]))
        shown[-1] = f"{len(names) - MOST_PANELS + 1} other quantities", rest
    figure = make_figure(WIDTH * (len(shown) + 0.7), HEIGHT)
    widths = [1.0] * len(shown) + [0.6]
    grid = figure.add_gridspec(2, len(shown) + 1, width_ratios=widths, height_ratios=[2.0, 1.0])
    for place, (name, rows) in enumerate(shown):
        top = figure.add_subplot(grid[0, place])
        below = figure.add_subplot(grid[1, place], sharex=top)
        draw_quantity(top, below, fit, name, rows)
    draw_spread(figure.add_subplot(grid[:, -1]), fit.residuals)
    figure.set_layout_engine("constrained")
    return figure


def find_abscissa(given: Measurement, rows: Any) -> tuple[str, Array]:
    """Along what most of the rows differ, in words and numbers: the side of the light is below 0 in the plane of
    incidence; the row where nothing differs."""
    angle = np.where(np.cos(np.radians(given.phi_deg)) < -1e-9, -given.theta_o_deg, given.theta_o_deg)
    columns = {name: angle if name == "theta_o_deg" else getattr(given, name) for name in AXES}
    counts = {name: np.unique(values[rows][~np.isnan(values[rows])]).size for name, values in columns.items()}
    best = max(counts, key=lambda name: counts[name])
    if counts[best] < 2:
        return "row", rows + 1.0
    return AXES[best], columns[best][rows]


def draw_quantity(top: Any, below: Any, fit: Fit, name: str, rows: Any) -> None:
    """Points with error bars and what the fit shows, and below them the residuals."""
    given = fit.measurement
    words, at = find_abscissa(given, rows)
    along = next((key for key, said in AXES.items() if said == words), "row")
    mixed = name not in QUANTITIES
    keys = [key for key in SERIES if key not in (along, *(("phi_deg",) if along == "theta_o_deg" else ()))]
    series: dict[tuple[str, ...], list[int]] = {}
    for k, row in enumerate(rows.tolist()):
        series.setdefault(tuple(str(getattr(given, key)[row]) for key in keys) if not mixed else (), []).append(k)
    for k, some in enumerate(series.values()):
        order = np.array(some)[np.argsort(at[some])]
        there, colour = rows[order], COLOURS[k % len(COLOURS)]
        value, sigma = fit.measured[there], fit.sigma[there]
        style: dict[str, Any] = {"color": colour, "markersize": 4.0, "linewidth": 1.0}
        top.errorbar(at[order], value, sigma, fmt="o", elinewidth=0.8, **style)
        top.plot(at[order], fit.predicted[there], "-" if order.size > 1 and not mixed else "x", **style)
        below.errorbar(at[order], fit.residuals[there], 1.0, fmt="o", elinewidth=0.8, **style)
    below.axhline(0.0, color=FAINT, linewidth=1.0, zorder=0)
    unit = "" if mixed or QUANTITIES[name].unit == "1" else f" [{QUANTITIES[name].unit}]"
    top.set_title(f"{name.replace('_', ' ')}{unit}", fontsize=10)
    below.set_xlabel(words, fontsize=9)
    below.set_ylabel("residual [sigma]", fontsize=9)
    below.yaxis.set_major_locator(limit_ticks())
    for axes in (top, below):
        axes.tick_params(labelsize=8)
        axes.grid(color=FAINT, linewidth=0.5, alpha=0.7)


def draw_spread(axes: Any, residuals: Array) -> None:
    """How residuals are spread, and how normal noise would be."""
    reach = max(3.5, 1.1 * float(np.abs(residuals).max(initial=0.0)))
    count = int(np.clip(2.0 * np.sqrt(residuals.size), 7, 41))
    edges = np.linspace(-reach, reach, count + 1)
    axes.hist(residuals, edges, orientation="horizontal", color=COLOURS[0], alpha=0.6)
    fine = np.linspace(-reach, reach, 201)
    normal = residuals.size * (edges[1] - edges[0]) * np.exp(-0.5 * fine**2) / np.sqrt(2.0 * np.pi)
    axes.plot(normal, fine, color=COLOURS[1], linewidth=1.5)
    axes.set_title("residuals [sigma],\nand normal noise", fontsize=10)
    axes.set_xlabel("rows", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(color=FAINT, linewidth=0.5, alpha=0.7)


def draw_profile(axes: Any, profile: Any, least: float) -> None:
    """How chi2 rises along one number."""
    axes.plot(profile.values, profile.chi2 - least, "o-", color=COLOURS[0], markersize=4.0, linewidth=1.0)
    axes.axhline(1.0, color=COLOURS[1], linewidth=1.0)
    axes.set_title(f"chi2 above its least along\n{profile.name}", fontsize=10)
    axes.tick_params(labelsize=8)
    axes.grid(color=FAINT, linewidth=0.5, alpha=0.7)
