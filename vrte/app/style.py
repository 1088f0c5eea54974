"""What the viewer's figures have in common: Plotly itself, a plain layout, light by quantity, words."""

from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import MissingExtraError
from vrte.results.brdf import Brdf
from vrte.results.quantities import ANGLES, SIGNED, unit_of

UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
INCIDENT, INK, FAINT = "#d62728", "#222222", "#c9c9c9"
IN_THE_DARK = {  # colours of figures on a light page, and what they are on a dark one
    INK: "#e3e7ea",
    FAINT: "#46525d",
    INCIDENT: "#ff7b72",
    "white": "#14181c",
    "#dfe3e8": "#39434d",
    "#888888": "#9fb0bf",
    "#1f4e79": "#7fb5ea",
    "#2a8f5b": "#5fd199",
    "#7a4fa3": "#bd9be6",
    "#b3262e": "#ff9a94",
    "#d98200": "#f0a030",
}
FONT = {"family": "system-ui, sans-serif", "size": 13, "color": INK}


def plotly() -> Any:
    """The module of Plotly's graph objects. Raises MissingExtraError without Plotly."""
    try:
        import plotly.graph_objects as go
    except ImportError as error:
        raise MissingExtraError("an interactive figure", "app") from error
    return go


def plain(title: str, **more: Any) -> dict[str, Any]:
    """A light layout with a title; Plotly's own template would add 7 kB to each figure."""
    return {
        "template": None,
        "font": FONT,
        "title": {"text": title, "x": 0.02, "xanchor": "left", "y": 0.96, "yanchor": "top", "font": {"size": 16}},
        "margin": {"l": 40, "r": 40, "t": 84, "b": 40},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "hovermode": "closest",
    } | more


def span(values: Array, quantity: str) -> tuple[float, float]:
    """From where to where an axis or a colour scale goes: 0 to 180 for angles, as far below 0 as above where a quantity
    may be negative, else from 0.

    >>> span(np.array([-1.0, 0.5, np.nan]), "f01"), span(np.array([0.2, 0.5]), "f00")
    ((-1.0, 1.0), (0.0, 0.5))
    """
    if quantity in ANGLES:
        return 0.0, 180.0
    largest = float(np.abs(np.nan_to_num(values)).max()) or 1.0  # where nothing is, any scale will do
    return (-largest if quantity in SIGNED else 0.0), largest


def labelled(quantity: str) -> str:
    """With its unit.

    >>> labelled("f00"), labelled("reflectance factor")
    ('f00 [sr⁻¹]', 'reflectance factor')
    """
    unit = unit_of(quantity)
    return f"{quantity} [{unit}]" if unit else quantity


def incidence(brdf: Brdf, place: int) -> str:
    """Where the light comes from, in words."""
    mu = float(brdf.mu_i[place])
    return f"μ<sub>i</sub> = {mu:.4g}, {np.degrees(np.arccos(mu)):.0f}° from the normal"


def in_the_dark(part: Any) -> Any:
    """A figure's JSON, or a part of it, in the colours of a dark page.

    >>> in_the_dark({"line": {"color": "#222222"}, "y": [1, 2]})
    {'line': {'color': '#e3e7ea'}, 'y': [1, 2]}
    """
    if isinstance(part, dict):
        return {key: in_the_dark(value) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return [in_the_dark(value) for value in part]
    return IN_THE_DARK.get(part, part) if isinstance(part, str) else part


def axis(title: str) -> dict[str, Any]:
    return {
        "title": {"text": title, "standoff": 8},
        "automargin": True,
        "gridcolor": FAINT,
        "linecolor": FAINT,
        "zerolinecolor": FAINT,
    }
