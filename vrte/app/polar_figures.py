"""Polar diagrams: cuts through a BRDF, and the radiance field in the plane of incidence, a curve a depth."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.style import (
    FAINT,
    INCIDENT,
    UNPOLARIZED,
    incidence,
    labelled,
    plain,
    plotly,
    polar_angles,
    seen,
    span,
)
from vrte.arrays import Array
from vrte.brdf import Brdf
from vrte.errors import SceneError
from vrte.field import Field, one_beam
from vrte.quantities import ANGLES, FIELD_QUANTITIES, check_name, of_stokes, unit_of
from vrte.report.lobes import spread

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

CUT_ANGLES = 91  # from the normal to the horizon
CUTS = (("in the plane of incidence", "#1f4e79", "solid"), ("across it", "#d98200", "dash"))
MOST_DEPTHS = 12  # of more depths, these are spread evenly over them
DEPTH_COLOURS = "Viridis"
LEGEND = {"orientation": "h", "x": 0.5, "xanchor": "center", "y": -0.06, "yanchor": "top"}
SIDES = "right: φ = 0°, forward; left: φ = 180°, back"


def cuts(brdf: Brdf, place: int, quantity: str = "f00", stokes: Any = UNPOLARIZED) -> "Figure":
    """A quantity of the light that leaves against its angle from the normal, in and across the plane of incidence.

    ``quantity`` is one of `vrte.quantities.QUANTITIES`, ``stokes`` the incident light at ``mu_i[place]``. Where the
    quantity may be negative, the centre is as far below 0 as the rim is above, and 0 is drawn as a half circle. Raises
    SceneError for an unknown quantity or place, or too few directions, MissingExtraError without Plotly.
    """
    go = plotly()
    theta = polar_angles(brdf, place, CUT_ANGLES)
    four = seen(brdf, place, theta, np.array([0.0, 90.0, 180.0, 270.0]), quantity, stokes)
    low, high = span(four, quantity)
    beam = -float(np.degrees(np.arccos(brdf.mu_i[place])))
    figure = go.Figure([zero_line(go, -90.0, 90.0)] if low < 0.0 else [])
    for forward, (name, line, dash) in enumerate(CUTS):
        angle, value = (
            np.concatenate([-theta[::-1], theta]),
            np.concatenate([four[::-1, forward + 2], four[:, forward]]),
        )
        figure.add_trace(curve(go, angle, value, quantity, name, {"color": line, "dash": dash}))
    figure.add_trace(arrow(go, [beam, beam], [high, low], "incident light"))
    title = f"Subsurface BRDF: {labelled(quantity)}<br><sup>{incidence(brdf, place)}; {SIDES}</sup>"
    figure.update_layout(**plain(title, polar=axes(low, high, [0.0, 180.0]), legend=LEGEND))
    return figure


def field_polar(field: Field, quantity: str = "I") -> "Figure":
    """The radiance field in the plane of incidence as polar diagrams, one curve a depth: light going up is above.

    ``quantity`` is one of `vrte.quantities.FIELD_QUANTITIES`. The plane is where ``field.phi`` is 0 and 180; one of
    them gives half of it. Raises SceneError for an unknown quantity, or where both are missing or there are no
    directions, MissingExtraError without Plotly.
    """
    go = plotly()
    check_name(quantity, FIELD_QUANTITIES)
    mu0 = one_beam(field)
    angle, values = in_the_plane(field, quantity)
    depths = spread(field.tau.size, MOST_DEPTHS)
    low, high = span(values[depths], quantity)
    figure = go.Figure([zero_line(go, -180.0, 180.0)] if low < 0.0 else [])
    for place, colour in zip(depths, depth_colours(len(depths)), strict=True):
        name = f"τ = {field.tau[place]:.4g}"
        figure.add_trace(curve(go, angle, values[place], quantity, name, {"color": colour}))
    figure.add_trace(arrow(go, [beam_angle(field)] * 2, [low, high], "where the beam goes"))
    shown = "" if len(depths) == field.tau.size else f"; {len(depths)} of {field.tau.size} depths"
    title = f"Subsurface radiance, diffuse light: {labelled(quantity)}"
    under = f"μ<sub>0</sub> = {mu0:.4g}; above: going up; {SIDES}{shown}"
    figure.update_layout(**plain(f"{title}<br><sup>{under}</sup>", polar=axes(low, high), legend=LEGEND))
    if quantity == "I":
        figure.update_layout(updatemenus=[scales(figure, high)])
    return figure


def in_the_plane(field: Field, quantity: str) -> tuple[Array, Array]:
    """Angles (n,) [degrees] of travel from straight up, clockwise, and the quantity there (tau, n).

    NaN parts light that goes up from light that goes down: it may jump at the horizon.
    """
    sides = {sign: np.flatnonzero(np.abs(field.phi % 360.0 - phi) < 1e-9) for sign, phi in ((1.0, 0.0), (-1.0, 180.0))}
    known = [(sign, found[0]) for sign, found in sides.items() if found.size]
    if not known or not field.mu.size:
        raise SceneError("polar diagrams of a field need directions mu, at phi_deg 0 or 180: the plane of incidence")
    theta = np.degrees(np.arccos(field.mu))
    angle = np.concatenate([sign * theta for sign, _ in known])
    value = np.concatenate([of_stokes(field.stokes[:, :, place], quantity) for _, place in known], axis=1)
    goes_up = np.abs(angle) < 90.0
    angles: list[Any] = []
    values: list[Any] = []
    for half, turned in ((goes_up, angle), (~goes_up, angle % 360.0)):
        order = np.flatnonzero(half)[np.argsort(turned[half], kind="stable")]
        angles += [turned[order], [np.nan]]
        values += [value[:, order], np.full((field.tau.size, 1), np.nan)]
    return np.concatenate(angles), np.concatenate(values, axis=1)


def scales(figure: Any, high: float) -> dict[str, Any]:
    """Two buttons: all curves on one scale, or each over its largest value, since light fades with depth."""
    radii = [np.asarray(trace.r, float) for trace in figure.data]
    shares = [values / (float(np.nanmax(np.abs(values))) or 1.0) for values in radii]
    choices = (("one scale", radii, high), ("each over its largest", shares, 1.0))
    buttons = [
        {
            "label": label,
            "method": "update",
            "args": [{"r": [in_json(values) for values in some]}, {"polar.radialaxis.range": [0.0, 1.05 * top]}],
        }
        for label, some, top in choices
    ]
    return {"type": "buttons", "buttons": buttons, "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "top"}


def in_json(values: Array) -> list[float | None]:
    """Five digits of each, None for a gap: a button cannot send an array.

    >>> in_json(np.array([0.123456789, np.nan]))
    [0.12346, None]
    """
    return [None if np.isnan(value) else float(f"{value:.5g}") for value in values.tolist()]


def beam_angle(field: Field) -> float:
    """Where the beam goes, in the same angles."""
    theta = float(np.degrees(np.arccos(one_beam(field))))
    return theta if field.diagnostics.get("illuminate") == "bottom" else 180.0 - theta


def curve(go: Any, angle: Array, value: Array, quantity: str, name: str, line: dict[str, Any]) -> Any:
    """A line in a polar diagram; of an angle, it is parted where that passes from 180 to 0."""
    if quantity in ANGLES:
        jumps = 1 + np.flatnonzero(np.abs(np.diff(value)) > 90.0)
        angle, value = np.insert(angle, jumps, np.nan), np.insert(value, jumps, np.nan)
    return go.Scatterpolar(
        theta=angle.astype(np.float32),
        r=value.astype(np.float32),
        mode="lines",
        line=line | {"width": 2},
        name=name,
        hovertemplate=f"{name}<br>%{{theta:.1f}}° from the upward normal<br>{quantity} = %{{r:.4g}} {unit_of(quantity)}"
        "<extra></extra>",
    )


def zero_line(go: Any, first: float, last: float) -> Any:
    """Where a quantity that may be negative is 0."""
    angle = np.linspace(first, last, 91)
    line = {"color": "#888888", "width": 1, "dash": "dot"}
    return go.Scatterpolar(theta=angle, r=0.0 * angle, mode="lines", line=line, name="0", hoverinfo="skip")


def arrow(go: Any, angle: Sequence[float], distance: Sequence[float], name: str) -> Any:
    """A straight arrow, from the first point to the second."""
    return go.Scatterpolar(
        theta=angle,
        r=distance,
        mode="lines+markers",
        line={"color": INCIDENT, "width": 2},
        marker={"symbol": "arrow", "size": [0, 15], "angleref": "previous", "color": INCIDENT, "opacity": 1},
        name=name,
        hoverinfo="name",
    )


def axes(low: float, high: float, sector: Sequence[float] = (0.0, 360.0)) -> dict[str, Any]:
    """Angles clockwise from straight up; the sector is Plotly's, counter-clockwise from the right."""
    marked = range(-90, 91, 30) if sector[1] == 180.0 else range(0, 360, 30)
    return {
        "sector": list(sector),
        "bgcolor": "white",
        "angularaxis": {
            "rotation": 90,
            "direction": "clockwise",
            "tickvals": list(marked),
            "ticktext": [f"{min(abs(angle), 360 - angle)}°" for angle in marked],
            "gridcolor": FAINT,
            "linecolor": FAINT,
        },
        "radialaxis": {
            "range": [low, low + 1.05 * (high - low)],
            "angle": 0,
            "tickangle": 0,
            "nticks": 5,
            "gridcolor": FAINT,
            "linecolor": FAINT,
            "tickfont": {"size": 11},
            "exponentformat": "power",
        },
    }


def depth_colours(count: int) -> list[str]:
    """Colours from the top to the bottom."""
    from plotly.colors import sample_colorscale

    return [str(colour) for colour in sample_colorscale(DEPTH_COLOURS, np.linspace(0.0, 0.9, count).tolist())]
