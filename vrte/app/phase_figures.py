"""A phase matrix: its expansion coefficients, and its elements against the scattering angle."""

from typing import TYPE_CHECKING

import numpy as np

from vrte.app.style import axis, plain, plotly
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.pictures.phase_pictures import ANGLES_DEG, f11_and_ratios

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_DEGREES = 2000  # beyond, a line on the screen is a smear
COLOURS = ("#222222", "#1f4e79", "#2a8f5b", "#7a4fa3", "#d98200", "#b3262e")


def coefficients(phase_matrix: PhaseMatrix) -> "Figure":
    """The six expansion sequences against their degree l; one that vanishes is named so, and not drawn.

    Raises MissingExtraError without Plotly.
    """
    go = plotly()
    shown = min(phase_matrix.terms, MOST_DEGREES)
    degrees = np.arange(shown, dtype=np.int32)
    figure = go.Figure()
    for name, values, colour in zip(SEQUENCES, phase_matrix.coefficients[:shown].T, COLOURS, strict=True):
        there = bool(values.any())
        figure.add_trace(
            go.Scatter(
                x=degrees,
                y=values.astype(np.float32),
                mode="lines+markers" if shown <= 100 else "lines",
                line={"color": colour, "width": 1.5},
                marker={"size": 5},
                name=name if there else f"{name} = 0",
                visible=True if there else "legendonly",
                hovertemplate=f"{name}, l = %{{x}}: %{{y:.5g}}<extra></extra>",
            )
        )
    some = "" if shown == phase_matrix.terms else f", the first {shown} of {phase_matrix.terms} degrees"
    under = f"g = {phase_matrix.asymmetry:.4g}, {phase_matrix.terms} terms{some}"
    figure.update_layout(
        **plain(f"Expansion coefficients<br><sup>{under}</sup>"),
        xaxis=axis("degree l"),
        yaxis=axis("coefficient") | {"zerolinecolor": "#888888"},
    )
    return figure


def scattering_matrix(phase_matrix: PhaseMatrix) -> "Figure":
    """F11 on a logarithmic scale, and the ratios of the other elements to it, against the scattering angle.

    Where F11 is not above 0, as rounded tables have it, there is a gap. Raises MissingExtraError without Plotly.
    """
    go = plotly()
    f11, ratios = f11_and_ratios(phase_matrix)
    curves = {
        "F11": (f11, "#222222", "y"),
        **{n: (v, c, "y2") for (n, v), c in zip(ratios.items(), COLOURS[1:], strict=True)},
    }
    figure = go.Figure()
    for name, (values, colour, where) in curves.items():
        figure.add_trace(
            go.Scatter(
                x=ANGLES_DEG.astype(np.float32),
                y=values.astype(np.float32),
                yaxis=where,
                mode="lines",
                line={"color": colour, "width": 2},
                name=name,
                hovertemplate=f"{name} at %{{x:.1f}}°: %{{y:.4g}}<extra></extra>",
            )
        )
    figure.update_layout(
        **plain(
            "Scattering matrix<br><sup>mean of F11 over the sphere 1; −F12/F11: polarization of unpolarized light</sup>"
        ),
        xaxis=axis("scattering angle [°]") | {"tickvals": list(range(0, 181, 30)), "anchor": "y2"},
        yaxis=axis("F11") | {"type": "log", "domain": [0.54, 1.0], "exponentformat": "power"},
        yaxis2=axis("ratio to F11") | {"domain": [0.0, 0.46], "range": [-1.05, 1.05], "zerolinecolor": "#888888"},
    )
    return figure
