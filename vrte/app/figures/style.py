"""What the viewer's figures have in common: Plotly itself, how a figure, an axis and a curve are made, words."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import import_extra
from vrte.pictures.lobes import INCIDENT, INK
from vrte.results.brdf import Brdf
from vrte.results.quantities import ANGLES, SIGNED, unit_of

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
FAINT, ZERO = "#c9c9c9", "#888888"
IN_THE_DARK = {  # colours of figures on a light page, and what they are on a dark one
    INK: "#e3e7ea",
    FAINT: "#46525d",
    INCIDENT: "#ff7b72",
    "white": "#14181c",
    "#dfe3e8": "#39434d",
    ZERO: "#9fb0bf",
    "#1f4e79": "#7fb5ea",
    "#2a8f5b": "#5fd199",
    "#7a4fa3": "#bd9be6",
    "#b3262e": "#ff9a94",
    "#d98200": "#f0a030",
}
LIGHT_LAYOUT = {  # Plotly's own template would add 7 kB to each figure
    "template": None,
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
    "margin": {"l": 40, "r": 40, "t": 84, "b": 40},
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "hovermode": "closest",
}
TITLE = {"x": 0.02, "xanchor": "left", "y": 0.96, "yanchor": "top", "font": {"size": 16}}
GRID = {"gridcolor": FAINT, "linecolor": FAINT}


def import_plotly() -> Any:
    """Plotly with its colours. Raises MissingExtraError."""
    for name in ("colors", "graph_objects"):
        import_extra(f"plotly.{name}", "an interactive figure", "app")
    return import_extra("plotly", "an interactive figure", "app")


def make_plotly_figure(traces: list[dict[str, Any]], title: str, under: str, **layout: Any) -> "Figure":
    """A light figure of these traces, with a title and a smaller line below it. Raises MissingExtraError."""
    text = {"text": f"{title}<br><sup>{under}</sup>", **TITLE}
    return import_plotly().graph_objects.Figure(traces, {**LIGHT_LAYOUT, "title": text, **layout})


def make_axis(title: str, **more: Any) -> dict[str, Any]:
    """A straight axis."""
    return {"title": {"text": title, "standoff": 8}, "automargin": True, "zerolinecolor": FAINT} | GRID | more


def make_curve(x: Any, y: Any, name: str, colour: str, hover: str, polar: bool = False, **more: Any) -> dict[str, Any]:
    """A line through points, or in a polar diagram through the radii ``y`` at the angles ``x``; ``hover`` is what a
    point tells. Short numbers: less to send."""
    kind, along, up = ("scatterpolar", "theta", "r") if polar else ("scatter", "x", "y")
    return {
        "type": kind,
        along: np.asarray(x, np.float32),
        up: np.asarray(y, np.float32),
        "mode": "lines",
        "line": {"color": colour, "width": 2, "dash": more.pop("dash", "solid")},
        "name": name,
        "hovertemplate": f"{hover}<extra></extra>",
    } | more


def choose_range(values: Array, quantity: str) -> tuple[float, float]:
    """From where to where an axis or a colour scale goes: 0 to 180 for angles, as far below 0 as above where a quantity
    may be negative, else from 0.

    >>> choose_range(np.array([-1.0, 0.5, np.nan]), "f01"), choose_range(np.array([0.2, 0.5]), "f00")
    ((-1.0, 1.0), (0.0, 0.5))
    """
    if quantity in ANGLES:
        return 0.0, 180.0
    largest = float(np.abs(np.nan_to_num(values)).max()) or 1.0  # where nothing is, any scale will do
    return (-largest if quantity in SIGNED else 0.0), largest


def label_quantity(quantity: str) -> str:
    """With its unit.

    >>> label_quantity("f00"), label_quantity("reflectance factor")
    ('f00 [sr⁻¹]', 'reflectance factor')
    """
    unit = unit_of(quantity)
    return f"{quantity} [{unit}]" if unit else quantity


def describe_incidence(brdf: Brdf, place: int) -> str:
    """Where the light comes from, in words."""
    mu = float(brdf.mu_i[place])
    return f"μ<sub>i</sub> = {mu:.4g}, {np.degrees(np.arccos(mu)):.0f}° from the normal"


def convert_to_dark(part: Any) -> Any:
    """A figure's JSON, or a part of it, in the colours of a dark page.

    >>> convert_to_dark({"line": {"color": "#222222"}, "y": [1, 2]})
    {'line': {'color': '#e3e7ea'}, 'y': [1, 2]}
    """
    if isinstance(part, dict):
        return {key: convert_to_dark(value) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return [convert_to_dark(value) for value in part]
    return IN_THE_DARK.get(part, part) if isinstance(part, str) else part
