"""A phase matrix against the scattering angle."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.pictures.figures import FAINT, make_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vrte.optics.angle_tables import ScatteringTable

ANGLES_DEG = np.linspace(0.0, 180.0, 361)
COLOURS = ("#1f4e79", "#2a8f5b", "#7a4fa3", "#d98200", "#b3262e")
RATIOS = (  # an element of F, its sign, over F11
    ("F22/F11", (1, 1), 1.0),
    ("F33/F11", (2, 2), 1.0),
    ("F44/F11", (3, 3), 1.0),
    ("−F12/F11", (0, 1), -1.0),
    ("F34/F11", (2, 3), 1.0),
)


def compute_f11_and_ratios(phase_matrix: PhaseMatrix) -> tuple[Array, dict[str, Array]]:
    """F11 and the ratios of RATIOS at ANGLES_DEG, NaN where F11 is not above 0, as rounded tables have it.

    >>> f11, ratios = compute_f11_and_ratios(PhaseMatrix([1.0]))
    >>> float(f11[0]), ratios["F22/F11"].any().item()
    (1.0, False)
    """
    matrix = phase_matrix.scattering_matrix(ANGLES_DEG)
    f11 = np.where(matrix[:, 0, 0] > 0.0, matrix[:, 0, 0], np.nan)
    return f11, {name: sign * matrix[:, row, column] / f11 for name, (row, column), sign in RATIOS}


def draw_phase_matrix(phase_matrix: PhaseMatrix, width: float = 9.6, height: float = 4.0) -> "Figure":
    """F11 on a logarithmic scale, and the other elements over it; of an expansion over its table, the error below.

    Raises MissingExtraError without matplotlib.
    """
    f11, ratios = compute_f11_and_ratios(phase_matrix)
    told = phase_matrix.expansion
    figure = make_figure(width, height if told is None else 1.4 * height)
    grid = figure.add_gridspec(1 if told is None else 2, 2, height_ratios=[1.0] if told is None else [3.0, 1.0])
    panels: list[Any] = [figure.add_subplot(grid[0, column]) for column in range(2)]
    panels[0].semilogy(ANGLES_DEG, f11, color="#222222", linewidth=1.7)
    panels[0].set_title(f"F11, asymmetry {phase_matrix.asymmetry:.4g}", fontsize=10)
    for (name, values), colour in zip(ratios.items(), COLOURS, strict=True):
        panels[1].plot(ANGLES_DEG, values, label=name, color=colour, linewidth=1.5)
    panels[1].set_ylim(-1.05, 1.05)
    panels[1].set_title("ratios to F11", fontsize=10)
    panels[1].legend(fontsize=7, frameon=False, ncols=2)
    if told is not None:
        draw_table(told.table, panels)
        panels.append(figure.add_subplot(grid[1, :]))
        panels[2].semilogy(told.table.angle_deg, np.maximum(told.error, 1e-16), color="#b3262e", linewidth=1.2)
        panels[2].set_ylabel("error/F11", fontsize=9)
    for panel in panels:
        panel.set_xticks(range(0, 181, 30))
        panel.set_xlim(0.0, 180.0)
        panel.tick_params(labelsize=8)
        panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
    for panel in panels[-1:] if told is not None else panels:
        panel.set_xlabel("scattering angle [°]", fontsize=9)
    bottom = 0.17 if told is None else 0.1
    figure.subplots_adjust(left=0.08, right=0.98, bottom=bottom, top=0.9 if told is None else 0.94, wspace=0.18)
    return figure


def draw_table(table: "ScatteringTable", panels: list[Any]) -> None:
    """The points of a table over angle, into the panels of F11 and of the ratios."""
    style = {"linestyle": "none", "marker": "o", "markersize": 2.5, "markeredgewidth": 0.0}
    places = {(1, 1): table.F22, (2, 2): table.F33, (3, 3): table.F44, (0, 1): table.F12, (2, 3): table.F34}
    above = table.F11 > 0.0
    panels[0].plot(table.angle_deg[above], table.F11[above], color="#d98200", zorder=3, **style)
    for (_, place, sign), colour in zip(RATIOS, COLOURS, strict=True):
        panels[1].plot(table.angle_deg[above], sign * (places[place] / table.F11)[above], color=colour, **style)
