"""What the viewer's figures have in common: Plotly itself, a plain layout, light by quantity, words."""

from typing import Any

import numpy as np

from vrte.arrays import Array, whole
from vrte.brdf import Brdf
from vrte.errors import MissingExtraError
from vrte.over_hemisphere import check_directions, stokes_over_hemisphere
from vrte.quantities import ANGLES, SIGNED, incident_for, of_light, unit_of

UNPOLARIZED = (1.0, 0.0, 0.0, 0.0)
INCIDENT, INK, FAINT = "#d62728", "#222222", "#c9c9c9"
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


def polar_angles(brdf: Brdf, place: int, count: int) -> Array:
    """So many angles [degrees] from the normal to the last mu_o. Raises SceneError for an unknown ``place`` or too few
    directions."""
    whole("place", place, 0, brdf.mu_i.size - 1)
    check_directions(brdf.mu_o, brdf.phi)
    return np.linspace(0.0, float(np.degrees(np.arccos(brdf.mu_o.min()))), count)


def seen(brdf: Brdf, place: int, theta: Array, phi: Array, quantity: str, stokes: Any) -> Array:
    """A quantity of `vrte.quantities.QUANTITIES` at theta, phi [degrees]: (theta, phi)."""
    light = stokes_over_hemisphere(brdf, place, theta, phi, incident_for(quantity, stokes))
    return of_light(light, quantity)


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
