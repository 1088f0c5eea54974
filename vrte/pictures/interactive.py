"""Pictures drawn by Plotly from their descriptions, each small enough to be sent to a page at every click."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.errors import import_extra
from vrte.pictures.describe import INCIDENT, INK, ZERO, Axis, Curve, PlotPanel

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

FAINT = "#c9c9c9"
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
LEGEND = {"orientation": "h", "x": 0.5, "xanchor": "center", "y": -0.06, "yanchor": "top"}  # below polar panels
GRID = {"gridcolor": FAINT, "linecolor": FAINT}
RADIAL = {"angle": 0, "tickangle": 0, "nticks": 5, "tickfont": {"size": 11}, "exponentformat": "power"}
DASHES = {"-": "solid", "--": "dash", "-.": "dashdot", ":": "dot"}
GAP = 0.1  # between panels, in shares of the height


def import_plotly() -> Any:
    """Plotly with its colours. Raises MissingExtraError."""
    for name in ("colors", "graph_objects"):
        import_extra(f"plotly.{name}", "an interactive figure", "app")
    return import_extra("plotly", "an interactive figure", "app")


def make_plotly_figure(traces: list[dict[str, Any]], title: str, under: str, **layout: Any) -> "Figure":
    """A light figure of these traces, with a title and a smaller line below it. Raises MissingExtraError."""
    text = {"text": f"{title}<br><sup>{under}</sup>", **TITLE}
    return import_plotly().graph_objects.Figure(traces, {**LIGHT_LAYOUT, "title": text, **layout})


def draw_interactive(
    panels: Sequence[PlotPanel], title: str, under: str, heights: Sequence[float] = (), **layout: Any
) -> "Figure":
    """The figure of one polar panel, or of panels one above the other along the x of the last, ``heights`` high."""
    if panels[0].polar:
        layout |= {"polar": make_polar_axes(panels[0]), "legend": LEGEND}
    else:
        high = np.array(heights or [1.0] * len(panels))
        ends = 1.0 - np.cumsum(high / high.sum() * (1.0 - GAP * (high.size - 1)) + GAP) + GAP
        for k, (panel, end) in enumerate(zip(panels, ends.round(6).tolist(), strict=True)):
            domain = [max(end, 0.0), float(ends[k - 1].round(6)) - GAP if k else 1.0]
            layout[f"yaxis{k + 1 if k else ''}"] = make_axis(panel.y, domain=domain, zerolinecolor=ZERO)
        layout["xaxis"] = make_axis(panels[-1].x, anchor=f"y{high.size if high.size > 1 else ''}")
    parts = [(k, one) for k, panel in enumerate(panels, 1) for one in panel.parts if isinstance(one, Curve)]
    return make_plotly_figure([make_trace(one, k, bool(panels[0].polar)) for k, one in parts], title, under, **layout)


def make_trace(curve: Curve, panel: int, polar: bool) -> dict[str, Any]:
    """A curve of the panel with this number, from 1, as Plotly takes it; in short numbers: less to send."""
    kind, along, up = ("scatterpolar", "theta", "r") if polar else ("scatter", "x", "y")
    arrow = {"symbol": "arrow", "size": [0, 15], "angleref": "previous", "opacity": 1} if curve.arrow else {}
    marker: dict[str, Any] = {"color": curve.colour, "size": 1.5 * curve.size} | arrow
    trace: dict[str, Any] = {
        "type": kind,
        along: np.asarray(curve.x, np.float32),
        up: np.asarray(curve.y, np.float32),
        "mode": "+".join(["lines"] * bool(curve.dash) + ["markers"] * bool(curve.marker or curve.arrow)),
        "name": curve.name,
        "hovertemplate": f"{curve.hover}<extra></extra>" if curve.hover else None,
        "hoverinfo": None if curve.hover else "skip",
        "showlegend": bool(curve.name) and curve.listed,
        "opacity": None if curve.opacity == 1.0 else curve.opacity,
        "visible": None if curve.shown else "legendonly",
        "line": {"color": curve.colour, "width": round(1.33 * curve.width, 1), "dash": DASHES.get(curve.dash, "solid")},
        "marker": marker if curve.marker or curve.arrow else None,
        "yaxis": f"y{panel}" if panel > 1 else None,
    }
    if curve.sigma is not None:
        sigma = np.asarray(curve.sigma, np.float32)
        trace["error_y"] = {"type": "data", "array": sigma, "color": curve.colour, "thickness": 1.2}
    if curve.bar is not None:
        trace = {key: value for key, value in trace.items() if key not in ("mode", "line", "marker")}
        trace |= {"type": "bar", "width": 0.36, "offset": curve.bar, "marker": {"color": curve.colour}}
    return {key: value for key, value in trace.items() if value is not None}


def make_axis(axis: Axis, **more: Any) -> dict[str, Any]:
    """A straight axis as Plotly takes it."""
    made: dict[str, Any] = {"title": {"text": axis.label, "standoff": 8}, "automargin": True, "zerolinecolor": FAINT}
    if axis.log:
        made |= {"type": "log", "exponentformat": "power"}
    if axis.high is not None:
        made["range"] = [axis.low, axis.high]
    elif axis.low == 0.0:
        made["rangemode"] = "tozero"
    if axis.ticks is not None:
        made |= {"tickvals": list(axis.ticks)} | ({"ticktext": list(axis.words)} if axis.words else {})
    return made | GRID | more


def make_polar_axes(panel: PlotPanel) -> dict[str, Any]:
    """Angles clockwise from straight up; the sector is Plotly's, counter-clockwise from the right."""
    half = panel.polar == "half"
    marked = range(-90, 91, 30) if half else range(0, 360, 30)
    words = [f"{min(abs(angle), 360 - angle)}°" for angle in marked]
    return {
        "sector": [0.0, 180.0 if half else 360.0],
        "bgcolor": "white",
        "angularaxis": {"rotation": 90, "direction": "clockwise", "tickvals": list(marked), "ticktext": words, **GRID},
        "radialaxis": {"range": [panel.y.low, panel.y.high], **RADIAL, **GRID},
    }


def convert_to_dark(part: Any) -> Any:
    """A figure's JSON, or a part of it, in the colours of a dark page."""
    if isinstance(part, dict):
        return {key: convert_to_dark(value) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return [convert_to_dark(value) for value in part]
    return IN_THE_DARK.get(part, part) if isinstance(part, str) else part
