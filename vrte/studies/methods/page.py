"""The rows as an HTML page that needs no network, and as pictures."""

import html
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte.basics.errors import MissingExtraError
from vrte.pictures.figures import FAINT, require_pictures, save
from vrte.request.how import AUTO, METHOD_NAMES
from vrte.studies.methods import peers
from vrte.studies.methods.advice import (
    TARGETS,
    advice,
    answer,
    beside_exact,
    beside_peers,
    front,
    quickest,
    refusals,
    score_html,
    score_text,
    sentence,
    time_text,
    within_of,
)
from vrte.studies.methods.reference import slug
from vrte.studies.methods.rows import STOKES, Row, grouped
from vrte.studies.methods.scenes import case
from vrte.studies.pages import MARKERS, finish_panel, html_table, made_with, two_digits, write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = "methods.html"
SMALLEST = 1e-17  # where an error of 0 is drawn on a logarithmic axis
# a method, and method="auto", which the eye is to find first
COLOURS = dict(
    zip(
        METHOD_NAMES,
        (
            *("#1f4e79", "#00a3e0", "#8d6e63", "#5c6b2f", "#7a4fa3", "#d98200", "#c2185b", "#2a8f5b", "#e68fb8"),
            *("#9e9d24", "#e4002b"),
        ),
        strict=True,
    )
)
BOLD = 2.0  # auto's lines and markers, over those of others
SYMBOLS = (
    *("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x", "triangle-left", "triangle-right"),
    "star",
)  # Plotly's, of MARKERS
MEASURES = (
    ("largest error of I, Q, U, V", "worst"),
    ("largest error of I", "i_max"),
    ("root mean square of I", "i_rms"),
    ("largest error of Q", "q_max"),
    ("largest error of U", "u_max"),
    ("largest error of V", "v_max"),
    ("error of energy", "energy"),
)
LEGEND = (
    "Errors: largest over directions, relative to the largest I at each depth. Energy: what a conservative scene "
    "loses, else the error of reflected and transmitted flux, both relative to the incident flux. The grey band is the "
    "Pareto front of the largest error: no run of vrte is both quicker and closer; the dotted line is what the "
    "reference is known to. Broken grey lines are other codes on one thread, each over its streams: a call with all "
    "that another scene needs anew; errors are of what the code finds."
)
PEER_COLOURS = ("#222222", "#6a6a6a", "#9a9a9a")
STYLE = """body{font:16px/1.5 sans-serif;max-width:72em;margin:1em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:14px}td,th{border:1px solid #bbb;padding:.2em .5em;text-align:left}
.plot{height:40em}details{font-size:14px}"""
SCRIPT = """for (const [id, figure] of Object.entries(FIGURES))
  Plotly.newPlot(id, figure.data, figure.layout, {responsive: true, displaylogo: false});"""


def require_page() -> None:
    """Raises MissingExtraError without matplotlib or Plotly."""
    require_pictures()
    plotly_script()


def plotly_script() -> str:
    """Plotly's JavaScript. Raises MissingExtraError without Plotly."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise MissingExtraError("the page of the report", "report") from error
    return str(get_plotlyjs())


def write_page(rows: Sequence[Row], folder: str | os.PathLike[str], settings: str) -> list[Path]:
    """Writes methods.html and a picture a scene; their paths. Raises MissingExtraError, OSError."""
    page = Path(folder) / PAGE
    write_text(page, as_html(rows, settings))
    pictures = []
    for name, some in grouped(rows).items():
        pictures.append(Path(folder) / f"{slug(name)}.png")
        save(as_figure(name, some, styles(rows)), pictures[-1])
    return [page, *pictures]


def by_curve(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Measured rows of each curve, in their order but for auto's, which come first."""
    found = grouped((row for row in rows if row.is_measured), "curve")
    return dict(sorted(found.items(), key=lambda pair: pair[0] != AUTO))


def styles(rows: Sequence[Row]) -> dict[str, int]:
    """The place of each curve's marker among those of its method, the same in every scene."""
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        curves = found.setdefault(method_of_curve(row), {})
        curves.setdefault(row.curve, len(curves))
    return {name: place for curves in found.values() for name, place in curves.items()}


def method_of_curve(row: Row) -> str:
    """The method that a run's curve is of: auto, whatever it took, or its own."""
    return AUTO if row.curve == AUTO else row.method


def colour_of(rows: Sequence[Row]) -> str:
    """Of a curve: its method's, throughout; peers are grey."""
    method = method_of_curve(rows[0])
    return PEER_COLOURS[list(peers.PEERS).index(method)] if rows[0].is_peer else COLOURS[method]


def boldness(rows: Sequence[Row]) -> float:
    """Of a curve's lines and markers."""
    return BOLD if method_of_curve(rows[0]) == AUTO else 1.0


def shown(error: float) -> float:
    """Where an error is drawn."""
    return max(error, SMALLEST)


def hover(row: Row) -> str:
    """What a point tells."""
    rms, energy = two_digits(row.i_rms), two_digits(row.energy)
    errors = ", ".join(f"{letter.upper()} {two_digits(getattr(row, f'{letter}_max'))}" for letter in STOKES)
    spread = f"{time_text(row.least)} to {time_text(row.greatest)}, {row.rounds} rounds"
    return (
        f"<b>{html.escape(row.curve)}</b><br>{html.escape(row.setting)}<br>{time_text(row.seconds)} ({spread})<br>"
        f"largest errors: {errors}<br>root mean square of I {rms}, energy {energy}<br>"
        f"operations: {two_digits(row.operations)}"
    )


def as_plotly(rows: Sequence[Row], places: dict[str, int]) -> dict[str, Any]:
    """The interactive figure of a scene: a trace a curve, the Pareto front first, a menu of what is measured."""
    best = front(rows)
    lines = [("Pareto front", best), *by_curve(rows).items()]
    data = [trace(name, some, places.get(name)) for name, some in lines]
    buttons = [
        {
            "label": label,
            "method": "update",
            "args": [{"y": [heights(some, field) for _, some in lines]}, {"yaxis.title.text": label}],
        }
        for label, field in MEASURES
    ]
    layout = {
        "xaxis": {"type": "log", "title": {"text": "seconds on one thread"}, "exponentformat": "power", "dtick": "D2"},
        "yaxis": {"type": "log", "title": {"text": MEASURES[0][0]}, "exponentformat": "power"},
        "shapes": [reference_line(within_of(rows))],
        "updatemenus": [{"buttons": buttons, "x": 0.0, "xanchor": "left", "y": 1.12, "yanchor": "top"}],
        "hovermode": "closest",
        "hoverlabel": {"bgcolor": "white", "font": {"color": "#222222"}},
        "legend": {"font": {"size": 11}},
        "margin": {"t": 50, "r": 20},
    }
    return {"data": data, "layout": layout}


def reference_line(within: float) -> dict[str, Any]:
    """Across the figure, where errors cannot be told from the reference's; none where that is not known."""
    line = {"color": "black", "width": 1, "dash": "dot"}
    place = shown(within) if math.isfinite(within) else 1.0
    ends = {"x0": 0.0, "x1": 1.0, "y0": place, "y1": place}
    return {"type": "line", "xref": "paper", "line": line, "visible": math.isfinite(within), **ends}


def heights(rows: Sequence[Row], field: str) -> list[float | None]:
    """Of one measure; None where it is not known."""
    values = [getattr(row, field) for row in rows]
    return [None if math.isnan(value) else shown(value) for value in values]


def trace(name: str, rows: Sequence[Row], place: int | None) -> dict[str, Any]:
    """Of one curve; ``place`` None: the front."""
    x = [row.seconds for row in rows]
    found: dict[str, Any] = {"name": name, "type": "scatter", "x": x, "y": heights(rows, "worst")}
    if place is None:
        line = {"color": FAINT, "width": 9, "shape": "hv"}
        return found | {"mode": "lines", "line": line, "hoverinfo": "skip"}
    colour, bold = colour_of(rows), boldness(rows)
    spread = {
        "type": "data",
        "symmetric": False,
        "array": [row.greatest - row.seconds for row in rows],
        "arrayminus": [row.seconds - row.least for row in rows],
        "thickness": 0.7,
        "width": 0,
    }
    return found | {
        "mode": "lines+markers",
        "line": {"color": colour, "width": 1.2 * bold, "dash": "dash" if rows[0].is_peer else "solid"},
        "marker": {"color": colour, "symbol": SYMBOLS[place % len(SYMBOLS)], "size": 7 * bold**0.5},
        "error_x": spread,
        "text": [hover(row) for row in rows],
        "hoverinfo": "text",
    }


def as_html(rows: Sequence[Row], settings: str) -> str:
    """The page: what was measured, what to take for how much, and a figure a scene."""
    scenes, places = grouped(rows), styles(rows)
    figures = {slug(name): as_plotly(some, places) for name, some in scenes.items()}
    data = json.dumps(figures).replace("</", "<\\/")
    facts = "".join(f"<li>{html.escape(fact)}</li>" for fact in [*made_with(settings), peers.statement()])
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>vrte: error against run time</title>',
            f"<style>{STYLE}</style></head>\n<body><h1>Error against run time</h1>",
            f"<p><b>{html.escape(answer(rows))}</b></p>",
            score_html(rows),
            f"<h2>The quickest run of each scene</h2>\n{summary(scenes)}",
            f"<h2>How it was measured</h2>\n<ul>{facts}</ul>\n<p>{LEGEND}</p>",
            *(section(name, some) for name, some in scenes.items()),
            f"<script>{plotly_script()}</script>\n<script>const FIGURES = {data};\n{SCRIPT}</script>\n</body></html>\n",
        ]
    )


def summary(scenes: dict[str, list[Row]]) -> str:
    """Scenes down, targets across."""
    lines = [
        [f'<a href="#s-{slug(name)}">{html.escape(name)}</a>', f"{within_of(rows):.0e}"]
        + [html.escape(short(rows, target)) for target in TARGETS]
        for name, rows in scenes.items()
    ]
    return html_table(["scene", "reference within", *(f"{target:.0e}" for target in TARGETS)], lines)


def short(rows: Sequence[Row], target: float) -> str:
    """What to take, for a cell."""
    row = quickest(rows, target)
    if within_of(rows) > target:
        return "reference not known so well"
    return "none" if row is None else f"{row.curve}: {row.setting}, {time_text(row.seconds)}"


def section(name: str, rows: Sequence[Row]) -> str:
    """A scene: what it is, what to take, the figure, and which methods do not take it."""
    refused = "".join(f"<li>{html.escape(f'{curve}: {why}')}</li>" for curve, why in refusals(rows).items())
    more = f"<details><summary>Does not take it</summary><ul>{refused}</ul></details>" if refused else ""
    return (
        f'<h2 id="s-{slug(name)}">{html.escape(name)}</h2>\n<p>{html.escape(case(name).words)}; reference known to '
        f"{within_of(rows):.0e}.</p>\n<p><b>{html.escape(sentence(rows))}</b></p>\n"
        f"<p>{html.escape(' '.join(beside(rows)))}</p>\n"
        f'<div class="plot" id="{slug(name)}"></div>\n{more}'
    )


def as_figure(name: str, rows: Sequence[Row], places: dict[str, int]) -> "Figure":
    """Error against seconds, a line a curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panel: Any = figure.subplots()
    best = front(rows)
    x, y = [row.seconds for row in best], [shown(row.worst) for row in best]
    panel.step(x, y, where="post", color=FAINT, linewidth=7, label="Pareto front", alpha=0.7)
    # auto above the others, and first in the legend
    for curve, some in by_curve(rows).items():
        place, bold = places[curve], boldness(some)
        style: dict[str, Any] = {"color": colour_of(some), "marker": MARKERS[place % len(MARKERS)], "zorder": 2 + bold}
        style["linestyle"] = "--" if some[0].is_peer else "-"
        times = [row.seconds for row in some]
        spread = [[row.seconds - row.least for row in some], [row.greatest - row.seconds for row in some]]
        heights_ = [shown(row.worst) for row in some]
        style |= {"linewidth": 0.9 * bold, "markersize": 4 * bold**0.5, "elinewidth": 0.5}
        panel.errorbar(times, heights_, xerr=spread, label=curve, **style)
    within = within_of(rows)
    panel.axhline(shown(within), color="black", linewidth=0.7, linestyle=":", label=f"reference within {within:.0e}")
    beside = "largest error of I, Q, U, V over the largest I"
    finish_panel(panel, f"{name}: {case(name).words}", "seconds on one thread", beside)
    figure.legend(loc="outside right upper", fontsize=7, frameon=False)
    return figure


def as_text(rows: Sequence[Row]) -> str:
    """A sentence a scene, for a terminal."""
    lines = []
    for name, some in grouped(rows).items():
        lines.append(f"  {name} (reference known to {within_of(some):.0e})")
        told = [advice(some, target) for target in TARGETS] + [beside_exact(some), *beside(some)]
        lines += [f"    {text}" for text in told]
    return "\n".join(
        filter(None, [f"  {answer(rows)}" if answer(rows) else "", *lines, score_text(rows), f"  {peers.statement()}"])
    )


def beside(rows: Sequence[Row]) -> list[str]:
    """What peers take, for each target that any reaches."""
    return [text for text in (beside_peers(rows, target) for target in TARGETS) if text]
