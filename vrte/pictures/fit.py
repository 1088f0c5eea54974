"""A fit and a measurement as figures, points over what the model shows with residuals below, and a fit's page."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.views import Figure
from vrte.fit.curves import (
    COLOURS,
    COORDINATES,
    LABELS,
    NUMBERS,
    CurveRows,
    find_axis,
    find_rows,
    split_curves,
    write_coordinate,
)
from vrte.fit.measurement import Measurement
from vrte.fit.quantities import QUANTITIES
from vrte.fit.result import Fit
from vrte.fit.verdict import Profile
from vrte.pictures.describe import BLUE, GREY, INK, ORANGE, PALETTE, Axis, Curve, Line, Picture, PlotPanel, spread
from vrte.pictures.figures import draw_picture
from vrte.pictures.interactive import draw_interactive
from vrte.pictures.page import make_body, make_image, make_items, make_page, make_section, make_table, save_page

MOST_PANELS = 4  # quantities with a panel of their own; those after them share the last one, by rows
MOST_CURVES = 8  # of the viewer's figure; of more, these are spread evenly over them
MOST_NAMED = 6  # curves of a fit's panel that a legend names
MOST_ROWS = 2000  # that a fit's page lists
COLOURED = (*PALETTE, INK, GREY)
SIDES = "; right: φ, left: φ + 180°"
SCENE = "the scene in the form"


def describe_curves(
    curves: Mapping[int, CurveRows], value: Array, sigma: Any, predicted: Any, smooth: Mapping[int, Any] = {}
) -> tuple[list[Any], list[Any]]:
    """Points with error bars, lines of a model, and residuals over sigma; ``smooth``: finer lines by curve."""
    upper: list[Any] = []
    lower: list[Any] = [Line(y=0.0)]
    for number, (index, one) in enumerate(curves.items()):
        colour = COLOURED[number % len(COLOURED)]
        own: dict[str, Any] = {"name": one.name, "colour": colour}
        error = None if sigma is None else sigma[one.rows]
        hover = "measured: %{y:.4g} at %{x:.4g}"
        upper.append(Curve(one.x, value[one.rows], **own, dash="", marker="o", sigma=error, hover=hover))
        if predicted is None:
            continue
        x, y = smooth.get(index, (one.x, predicted[one.rows]))
        upper.append(Curve(x, y, **own, listed=False, hover="vrte: %{y:.4g} at %{x:.4g}"))
        left = (value - predicted)[one.rows] / (1.0 if error is None else error)
        hover = "residual: %{y:.3g} at %{x:.4g}"
        lower.append(Curve(one.x, left, **own, dash="", marker="o", listed=False, hover=hover))
    return upper, lower


def describe_unit(quantity: str) -> str:
    """The name of a quantity with its unit."""
    unit = QUANTITIES[quantity].unit if quantity in QUANTITIES else "1"
    return quantity.replace("_", " ") + ("" if unit == "1" else f" [{unit.replace('sr-1', 'sr⁻¹')}]")


def measurement(
    measured: Measurement,
    shown: str,
    predicted: Array | None = None,
    fine: tuple[Measurement, Array] | None = None,
    source: str = SCENE,
) -> Any:
    """What is ``shown`` of a measurement with values ``predicted`` (n,) and ``fine`` of a ``source``; residuals."""
    sigma = measured.sigma if measured.has_sigma else None
    if shown in (NUMBERS, COLOURS):
        rows = find_rows(measured, shown)
        one = CurveRows("measured", np.arange(rows.size, dtype=float), rows)
        upper, lower = describe_curves({0: one}, measured.value, sigma, predicted)
        upper = [
            replace(upper[0], bar=-0.38, colour=PALETTE[0]),
            *(replace(line, name="vrte", colour=PALETTE[3], bar=0.0, listed=True) for line in upper[1:]),
        ]
        pairs = zip(measured.quantity[rows], measured.base[rows], strict=True)
        names = [f"{name} {write_coordinate('base', base)}".replace("_", " ").strip() for name, base in pairs]
        along = Axis("", -0.7, rows.size - 0.3, ticks=one.x, words=names)
        under = "measured" + ("" if predicted is None else f", and vrte's, {source}, beside")
    else:
        axis, curves = split_curves(measured, shown)
        taken = {index: curves[index] for index in spread(len(curves), MOST_CURVES)}
        smooth = {}
        if fine is not None and shown in fine[0].names:
            finer = split_curves(fine[0], shown)[1]
            smooth = {index: (one.x, fine[1][one.rows]) for index, one in enumerate(finer)}
        upper, lower = describe_curves(taken, measured.value, sigma, predicted, smooth)
        along = Axis("{0} [{2}]".format(*COORDINATES[axis]))
        some = "" if len(taken) == len(curves) else f"; {len(taken)} of {len(curves)} curves"
        folded = SIDES if axis == "theta_o_deg" and any((one.x < 0.0).any() for one in taken.values()) else ""
        under = f"points: measured{'' if predicted is None else f'; lines: vrte, {source}'}{folded}{some}"
    named = sum(bool(one.name) and one.listed for one in upper) > 1
    residual = "residual" if sigma is None else "residual / σ"
    panels = [PlotPanel(upper, along, Axis(describe_unit(shown))), PlotPanel(lower, along, Axis(residual))]
    title = f"Measured {shown.replace('_', ' ')}"
    return draw_interactive(panels, title, under, (0.7, 0.3), showlegend=named, barmode="overlay")


def draw_fit(fit: Fit) -> Figure:
    """A column of two panels for each quantity, and one panel with the spread of the residuals."""
    given = fit.measurement
    names = list(given.names)
    columns = [describe_quantity(fit, name) for name in names[:MOST_PANELS]]
    if len(names) > MOST_PANELS:
        rest = np.flatnonzero(~np.isin(given.quantity, names[: MOST_PANELS - 1]))
        columns[-1] = describe_quantity(fit, f"{len(names) - MOST_PANELS + 1} other quantities", rest)
    tops, bottoms = zip(*columns, strict=True)
    rows = [[*tops, describe_spread(fit.residuals)], [*bottoms, None]]
    widths = [1.0] * len(columns) + [0.6]
    return draw_picture(Picture(rows, 4.2 * (len(columns) + 0.7), 5.2, heights=(2.0, 1.0), widths=widths))


def describe_quantity(fit: Fit, name: str, rows: Any = None) -> tuple[PlotPanel, PlotPanel]:
    """Points with error bars, the fit and the residuals; of several quantities along the row."""
    given, mixed = fit.measurement, rows is not None
    axis = "" if mixed else find_axis(given, name)
    if axis:
        curves, along = split_curves(given, name)[1], "{0} [{2}]".format(*COORDINATES[axis])
    else:
        rows = rows if mixed else np.flatnonzero(given.quantity == name)
        curves, along = [CurveRows("", rows + 1.0, rows)], "row"
    upper, lower = describe_curves(dict(enumerate(curves)), fit.measured, fit.sigma, fit.predicted)
    crosses = [replace(one, dash="", marker="x") if not axis or len(one.x) < 2 else one for one in upper[1::2]]
    parts = [part for pair in zip(upper[::2], crosses, strict=True) for part in pair]
    bars = [replace(one, sigma=1.0) if isinstance(one, Curve) else one for one in lower]
    legend = "best" if 1 < len(curves) <= MOST_NAMED else ""
    top = PlotPanel(parts, title=describe_unit(name), legend=legend)
    return top, PlotPanel(bars, Axis(along), Axis("residual [sigma]"))


def describe_spread(residuals: Array) -> PlotPanel:
    """How residuals are spread, and how normal noise would be."""
    reach = max(3.5, 1.1 * float(np.abs(residuals).max(initial=0.0)))
    counts, edges = np.histogram(residuals, int(np.clip(2.0 * np.sqrt(residuals.size), 7, 41)), (-reach, reach))
    steps, fine = np.repeat(edges, 2), np.linspace(-reach, reach, 201)
    normal = residuals.size * (edges[1] - edges[0]) * np.exp(-0.5 * fine**2) / np.sqrt(2.0 * np.pi)
    bars = Curve(np.concatenate([[0.0], np.repeat(counts, 2), [0.0]]), steps, "", BLUE, filled=True, opacity=0.6)
    title = "residuals [sigma],\nand normal noise"
    return PlotPanel([bars, Curve(normal, fine, "", ORANGE)], Axis("rows", low=0.0), title=title)


# ---- the page


def save_fit_page(
    fit: Fit, path: str | os.PathLike[str], title: str = "A fit", profiles: Sequence[Profile] = ()
) -> None:
    """Writes the page of a fit, all of it or nothing. Raises SceneError (suffix), MissingExtraError, OSError."""
    sections = [make_section("Numbers", make_numbers(fit))]
    image = f"<figure>{make_image(draw_fit(fit), 'measured, fitted')}</figure>"
    sections.append(make_section("Measured and fitted", image))
    for profile in profiles:
        rise = Curve(profile.values, profile.chi2 - profile.chi2.min(), "", BLUE, "-", "o", width=1.0)
        panel = PlotPanel([rise, Line(y=1.0, colour=ORANGE)], title=f"chi2 above its least along\n{profile.name}")
        figure = draw_picture(Picture([[panel]], 5.0, 3.6))
        low, high = (f"{end:.6g}" if abs(end) < float("inf") else "beyond" for end in (profile.low, profile.high))
        words = f"{profile.name}: chi2 is 1 above its least at {low} and {high}, all other numbers fitted anew."
        sections.append(f"<figure style='max-width:32rem'>{make_image(figure, words)}</figure><p>{words}</p>")
    blind = fit.blind_spots or ("Nothing: every direction among the free numbers is known to a third or better.",)
    sections.append(make_section("What the data cannot tell", f"<ul>{make_items(blind)}</ul>"))
    pairs = zip(fit.names, fit.correlations.tolist(), strict=True)
    rows: list[Any] = [(name, *row) for name, row in pairs]
    sections.append(make_section("Correlations", make_table(("", *fit.names), rows, "+.3f")))
    if len(fit.starts) > 1:
        head = ("chi2", "ended", *(f"{name}, from" for name in fit.names), *(f"{name}, to" for name in fit.names))
        rows = [(one.chi2, one.ended, *one.values, *one.found) for one in fit.starts]
        sections.append(make_section("Starts", make_table(head, rows)))
    if fit.notes:
        sections.append(make_section("What to know of these numbers", f"<ul>{make_items(fit.notes)}</ul>"))
    sections.append(f"<details><summary>All rows</summary>{make_rows(fit)}</details>")
    save_page(make_page(title, make_body(title, describe_fit(fit), *sections)), path)


def describe_fit(fit: Fit) -> list[str]:
    """What was fitted, and how well, in lines."""
    from vrte import __version__

    lines = [
        f"{len(fit.names)} numbers from {len(fit.measurement)} rows: {', '.join(fit.measurement.names)}",
        f"chi2 {fit.chi2:.5g}, {fit.degrees_of_freedom} degrees of freedom"
        + (f", reduced {fit.reduced_chi2:.3g}" if fit.degrees_of_freedom else "")
        + (f", by chance as large in {fit.p_value:.2g} of fits" if fit.p_value == fit.p_value else ""),
        f"vrte {__version__}" + (f", {fit.nodes} nodes in each hemisphere" if fit.nodes else ""),
    ]
    return [*lines, "interrupted before it had converged"] if fit.interrupted else lines


def make_numbers(fit: Fit) -> str:
    """Values, errors, and singular values."""
    shares = [100.0 * error / abs(value) if value else "" for value, error in zip(fit.values, fit.errors, strict=True)]
    rows = zip(fit.names, fit.values.tolist(), fit.errors.tolist(), shares, strict=True)
    found = ", ".join(f"{one:.3g}" for one in fit.singular_values)
    words = f"Singular values of the derivatives, in sigmas by relative changes: {found}. One of s is known to 1/s."
    return f"{make_table(('number', 'value', 'standard deviation', '%'), rows, '.6g')}<p>{words}</p>"


def make_rows(fit: Fit) -> str:
    """Rows with what was measured, what the fit shows, and the residual."""
    given = fit.measurement
    head = ("row", "quantity", "where", "measured", "sigma", "fitted", "residual", "unit")
    rows = []
    for k in range(min(len(given), MOST_ROWS)):
        where = filter(None, (write_coordinate(name, getattr(given, name)[k]) for name in (*COORDINATES, *LABELS)))
        numbers = (fit.measured[k], fit.sigma[k], fit.predicted[k], fit.residuals[k])
        name = given.quantity[k]
        rows.append((str(k + 1), name, ", ".join(where), *map(float, numbers), QUANTITIES[name].unit))
    more = f"<p>and {len(given) - MOST_ROWS} more</p>" if len(given) > MOST_ROWS else ""
    return f"{make_table(head, rows)}{more}"
