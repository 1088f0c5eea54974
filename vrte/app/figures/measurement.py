"""A measurement over what vrte has for the same light: points with error bars, curves, and residuals below."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.app.figures.style import ZERO, make_axis, make_curve, make_plotly_figure
from vrte.app.solving.measured import COLOURS, COORDINATES, NUMBERS, Curve, find_rows, split_curves
from vrte.basics.arrays import Array
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import QUANTITIES
from vrte.pictures.lobes import INK, spread
from vrte.pictures.phase_pictures import COLOURS as PALETTE

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST_CURVES = 8  # of more, these are spread evenly over them
COLOURED = (*PALETTE, INK)
UPPER, LOWER = [0.36, 1.0], [0.0, 0.25]  # shares of the height
SIDES = "; right: φ, left: φ + 180°"
SCENE = "the scene in the form"


def measurement(
    measured: Measurement,
    shown: str,
    predicted: Array | None = None,
    fine: tuple[Measurement, Array] | None = None,
    source: str = SCENE,
) -> "Figure":
    """What is ``shown`` of a measurement, and what vrte has for it, ``predicted`` (n,); residuals below.

    ``shown`` is one of `vrte.app.solving.measured.list_shown`; ``fine`` has vrte's values at more places, ``source`` is
    what they are of. Residuals are over sigma where that is known. Raises MissingExtraError without Plotly.
    """
    if shown in (NUMBERS, COLOURS):
        return draw_bars(measured, shown, predicted, source)
    axis, curves = split_curves(measured, shown)
    smooth = {}
    if fine is not None and shown in fine[0].names:
        smooth = {place: (one.x, fine[1][one.rows]) for place, one in enumerate(split_curves(fine[0], shown)[1])}
    taken = spread(len(curves), MOST_CURVES)
    traces: list[dict[str, Any]] = []
    for number, place in enumerate(taken):
        one, colour = curves[place], COLOURED[number % len(COLOURED)]
        traces.append(make_points(measured, one, colour))
        if predicted is not None:
            x, y = smooth.get(place, (one.x, predicted[one.rows]))
            traces.append(make_curve(x, y, one.name, colour, "vrte: %{y:.4g} at %{x:.4g}", showlegend=False))
            traces.append(make_residuals(measured, one, predicted, colour))
    words, _, unit = COORDINATES[axis]
    some = "" if len(taken) == len(curves) else f"; {len(taken)} of {len(curves)} curves"
    folded = SIDES if axis == "theta_o_deg" and any((curves[place].x < 0.0).any() for place in taken) else ""
    lines = "" if predicted is None else f"; lines: vrte, {source}"
    under = f"points: measured{lines}{folded}{some}"
    return finish_figure(measured, traces, shown, under, make_axis(f"{words} [{unit}]", anchor="y2"))


def draw_bars(measured: Measurement, shown: str, predicted: Array | None, source: str) -> "Figure":
    """Numbers without an axis, as bars, and what vrte has for them beside."""
    rows = find_rows(measured, shown)
    one = Curve("measured", np.arange(rows.size, dtype=float), rows)
    traces = [make_bar(make_points(measured, one, PALETTE[0]), -0.38)]
    if predicted is not None:
        traces.append(make_bar(make_curve(one.x, predicted[rows], "vrte", PALETTE[3], "vrte: %{y:.4g}"), 0.0))
        traces.append(make_residuals(measured, one, predicted, PALETTE[0]))
    names = [str(name).replace("_", " ") for name in measured.quantity[rows]]
    ticks = {"tickvals": one.x.tolist(), "ticktext": names, "range": [-0.7, rows.size - 0.3]}
    beside = "" if predicted is None else f", and vrte's, {source}, beside"
    return finish_figure(measured, traces, shown, f"measured{beside}", make_axis("", anchor="y2", **ticks))


def make_bar(curve: dict[str, Any], offset: float) -> dict[str, Any]:
    """A curve's points as bars."""
    kept = {key: value for key, value in curve.items() if key not in ("mode", "line", "marker")}
    return kept | {"type": "bar", "width": 0.36, "offset": offset, "marker": {"color": curve["line"]["color"]}}


def make_points(measured: Measurement, one: Curve, colour: str) -> dict[str, Any]:
    """Measured points, with error bars where they are known."""
    bars: dict[str, Any] = {
        "type": "data",
        "array": measured.sigma[one.rows].astype(np.float32),
        "color": colour,
        "thickness": 1.2,
    }
    return make_curve(
        one.x,
        measured.value[one.rows],
        one.name,
        colour,
        "measured: %{y:.4g} at %{x:.4g}",
        mode="markers",
        marker={"size": 6, "color": colour},
    ) | ({"error_y": bars} if measured.has_sigma else {})


def make_residuals(measured: Measurement, one: Curve, predicted: Array, colour: str) -> dict[str, Any]:
    """What is measured beyond vrte's, in the lower part."""
    left = (measured.value - predicted)[one.rows] / (measured.sigma[one.rows] if measured.has_sigma else 1.0)
    how: dict[str, Any] = {
        "mode": "markers",
        "marker": {"size": 5, "color": colour},
        "yaxis": "y2",
        "showlegend": False,
    }
    return make_curve(one.x, left, one.name, colour, "residual: %{y:.3g} at %{x:.4g}", **how)


def finish_figure(measured: Measurement, traces: list[dict[str, Any]], shown: str, under: str, axis: Any) -> "Figure":
    """Both parts, the lower one around 0."""
    unit = QUANTITIES[shown].unit if shown in QUANTITIES else ""
    name = shown.replace("_", " ")
    label = name if unit in ("", "1") else f"{name} [{unit.replace('sr-1', 'sr⁻¹')}]"
    residual = "residual / σ" if measured.has_sigma else "residual"
    return make_plotly_figure(
        traces,
        f"Measured {name}",
        under,
        xaxis=axis,
        yaxis=make_axis(label, domain=UPPER),
        yaxis2=make_axis(residual, domain=LOWER, zerolinecolor=ZERO),
        showlegend=sum(trace.get("showlegend", True) for trace in traces) > 1,
        barmode="overlay",
    )
