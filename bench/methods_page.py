"""What the runs of `bench.methods` come to: what to take for how much, an HTML page that needs no network, pictures.

The Pareto front of a scene, and a sentence a scene; of vrte, other codes beside it; and how well method="auto" chose,
its runs against the quickest of all others that were good enough.
"""

import html
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from bench.methods import EXPONENTS, REFUSED, STOKES, Row, find_case, group_rows, make_file_stem
from bench.other_codes import PEERS, describe_peers
from bench.study import MARKERS, finish_panel, list_run_facts, make_markdown_table, show_two_digits, write_text
from vrte.basics.errors import import_extra
from vrte.pictures.figures import FAINT, require_pictures, save
from vrte.request.how import AUTO, METHOD_NAMES, METHODS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TARGETS = (1e-3, 1e-6, 1e-10)
HEADER = (
    "accuracy asked for",
    "scenes",
    "auto good enough",
    "auto took the quickest method",
    "time over that of the quickest run: median",
    "worst",
)


def make_html_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Of cells that are HTML.

    >>> make_html_table(["a"], [["1"]])
    '<table><tr><th>a</th></tr><tr><td>1</td></tr></table>'
    """
    lines = [f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table><tr>{''.join(f'<th>{name}</th>' for name in header)}</tr>{''.join(lines)}</table>"


def find_pareto_front(rows: Sequence[Row]) -> list[Row]:
    """The runs of vrte that no other one beats in both time and error, slowest last.

    >>> some = [Row("s", "c", "m", str(k), "measured", t, i_max=e, q_max=0.0, u_max=0.0, v_max=0.0)
    ...         for k, (t, e) in enumerate([(1.0, 1e-3), (2.0, 1e-6), (3.0, 1e-5)])]
    >>> [row.setting for row in find_pareto_front(some)]
    ['0', '1']
    """
    found: list[Row] = []
    for row in sorted(
        (row for row in rows if row.is_measured and not row.is_peer), key=lambda row: (row.seconds, row.worst)
    ):
        if row.worst < (found[-1].worst if found else math.inf):  # NaN is no better than anything
            found.append(row)
    return found


def find_quickest_candidate(rows: Sequence[Row], target: float) -> Row | None:
    """The run of vrte of least time whose error of every Stokes parameter is at most the target; None without one."""
    good = (row for row in rows if row.is_measured and not row.is_peer and row.worst <= target)
    return min(good, key=lambda row: row.seconds, default=None)


def find_reference_uncertainty(rows: Sequence[Row]) -> float:
    """What the reference of these rows is uncertain by; infinite where none was measured."""
    return max((row.reference_within for row in rows if row.is_measured), default=math.inf)


def advise_on_target(rows: Sequence[Row], target: float) -> str:
    """What to take for one target."""
    row, within = find_quickest_candidate(rows, target), find_reference_uncertainty(rows)
    if within > target:
        return f"for {target:.0e} nothing can be told (the reference is known to {within:.0e})"
    if row is None:
        return f"for {target:.0e} take none of these"
    return f"for {target:.0e} take {row.curve} with {row.setting} ({say_run_time(row.seconds)}, error {row.worst:.0e})"


def advise_on_scene(rows: Sequence[Row]) -> str:
    """Of a scene, for all targets."""
    text = ", ".join(advise_on_target(rows, target) for target in TARGETS)
    return text[0].upper() + text[1:] + "."


def compare_with_peers(rows: Sequence[Row], target: float) -> str:
    """How each peer that reaches the target stands to what would be advised; empty where none does."""
    ours, texts = find_quickest_candidate(rows, target), []
    for name, some in group_rows((row for row in rows if row.is_peer and row.is_measured), "curve").items():
        good = [row for row in some if row.worst <= target]
        found = min(good, key=lambda row: row.seconds, default=None)
        if found is not None and find_reference_uncertainty(rows) <= target:
            beside = f", {found.seconds / ours.seconds:.2g} times as long" if ours else ""
            texts.append(f"{name} with {found.setting} takes {say_run_time(found.seconds)}{beside}")
    return f"Beside vrte, for {target:.0e}: {'; '.join(texts)}." if texts else ""


def say_run_time(seconds: float) -> str:
    """With a unit that suits it.

    >>> say_run_time(0.00213)
    '2.1 ms'
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}" if seconds < 100.0 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds / 1e-6:.0f} us"


def judge_choices(rows: Sequence[Row], target: float) -> list[tuple[str, bool, bool, float]]:
    """Of each scene of which something can be said: its name, whether the run of auto was good enough, whether the
    quickest of the others that were is of the same method, and the run's time over that one's."""
    found, setting = [], f"accuracy {target:.0e}".replace("e-0", "e-")
    for scene, some in group_rows(rows).items():
        runs = [row for row in some if row.curve == AUTO and row.setting == setting and row.is_measured]
        best = find_quickest_candidate([row for row in some if row.curve != AUTO and row.method in METHODS], target)
        if runs and best is not None and find_reference_uncertainty(some) <= target:
            run = runs[0]
            found.append((scene, run.worst <= target, run.method == best.method, run.seconds / best.seconds))
    return found


def advise_overall(rows: Sequence[Row]) -> str:
    """What to take, in a sentence, whatever the scene; empty without runs of auto."""
    found = [each for target in TARGETS for each in judge_choices(rows, target)]
    if not found:
        return ""
    good, ratio = sum(each[1] for each in found), median(each[3] for each in found)
    return (
        f'Take method="auto" with the accuracy that is wanted: good enough in {good} of {len(found)} runs, in '
        f"{ratio:.2g} times (median) the time of the quickest run that was, whatever its method and setting."
    )


def make_score_rows(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """How well auto chose: a line of HEADER for each accuracy that it was asked for, nothing without any."""
    lines = list[tuple[str, ...]]()
    for exponent in EXPONENTS:
        found = judge_choices(rows, float(f"1e-{exponent}"))
        if found:
            good = [is_same for _, is_adequate, is_same, _ in found if is_adequate]
            scene, _, _, ratio = max(found, key=lambda each: each[3])
            counts = f"{len(found)}", f"{len(good)}", f"{sum(good)}", f"{median(each[3] for each in found):.2g}"
            lines.append((f"1e-{exponent}", *counts, f"{ratio:.2g} ({scene})"))
    return lines


PAGE = "methods.html"
SMALLEST = 1e-17  # where an error of 0 is drawn on a logarithmic axis
# a method, and method="auto", which the eye is to find first
COLOURS = dict(
    zip(
        METHOD_NAMES,
        (
            *(
                "#1f4e79",
                "#00a3e0",
                "#8d6e63",
                "#5c6b2f",
                "#7a4fa3",
                "#37474f",
                "#d98200",
                "#c2185b",
                "#2a8f5b",
                "#e68fb8",
            ),
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
    read_plotly_script()


def read_plotly_script() -> str:
    """Plotly's JavaScript. Raises MissingExtraError without Plotly."""
    return str(import_extra("plotly.offline", "the page of the report", "report").get_plotlyjs())


def write_page(rows: Sequence[Row], folder: Path, settings: str) -> list[Path]:
    """Writes methods.html and a picture a scene; their paths. Raises MissingExtraError, OSError."""
    page = folder / PAGE
    write_text(page, make_html(rows, [*list_run_facts(settings), describe_peers()]))
    pictures = []
    for name, some in group_rows(rows).items():
        pictures.append(folder / f"{make_file_stem(name)}.png")
        save(draw_scene_errors(name, some, assign_markers(rows)), pictures[-1])
    return [page, *pictures]


def group_by_curve(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Measured rows of each curve, in their order but for auto's, which come first."""
    found = group_rows((row for row in rows if row.is_measured), "curve")
    return dict(sorted(found.items(), key=lambda pair: pair[0] != AUTO))


def assign_markers(rows: Sequence[Row]) -> dict[str, int]:
    """The place of each curve's marker among those of its method, the same in every scene."""
    found: dict[str, dict[str, int]] = {}
    for row in rows:
        curves = found.setdefault(find_curve_method(row), {})
        curves.setdefault(row.curve, len(curves))
    return {name: index for curves in found.values() for name, index in curves.items()}


def find_curve_method(row: Row) -> str:
    """The method that a run's curve is of: auto, whatever it took, or its own."""
    return AUTO if row.curve == AUTO else row.method


def choose_colour(rows: Sequence[Row]) -> str:
    """Of a curve: its method's, throughout; peers are grey."""
    method = find_curve_method(rows[0])
    return PEER_COLOURS[list(PEERS).index(method)] if rows[0].is_peer else COLOURS[method]


def make_hover_text(row: Row) -> str:
    """What a point tells."""
    rms, energy = show_two_digits(row.i_rms), show_two_digits(row.energy)
    errors = ", ".join(f"{letter.upper()} {show_two_digits(getattr(row, f'{letter}_max'))}" for letter in STOKES)
    spread = f"{say_run_time(row.least)} to {say_run_time(row.greatest)}, {row.rounds} rounds"
    return (
        f"<b>{html.escape(row.curve)}</b><br>{html.escape(row.setting)}<br>{say_run_time(row.seconds)} ({spread})<br>"
        f"largest errors: {errors}<br>root mean square of I {rms}, energy {energy}"
    )


def make_scene_figure(rows: Sequence[Row], indices: dict[str, int]) -> dict[str, Any]:
    """The interactive figure of a scene: a trace a curve, the Pareto front first, a menu of what is measured."""
    best = find_pareto_front(rows)
    lines = [("Pareto front", best), *group_by_curve(rows).items()]
    data = [make_trace(name, some, indices.get(name)) for name, some in lines]
    buttons = [
        {
            "label": label,
            "method": "update",
            "args": [{"y": [list_heights(some, field) for _, some in lines]}, {"yaxis.title.text": label}],
        }
        for label, field in MEASURES
    ]
    layout = {
        "xaxis": {"type": "log", "title": {"text": "seconds on one thread"}, "exponentformat": "power", "dtick": "D2"},
        "yaxis": {"type": "log", "title": {"text": MEASURES[0][0]}, "exponentformat": "power"},
        "shapes": [make_reference_line(find_reference_uncertainty(rows))],
        "updatemenus": [{"buttons": buttons, "x": 0.0, "xanchor": "left", "y": 1.12, "yanchor": "top"}],
        "hovermode": "closest",
        "hoverlabel": {"bgcolor": "white", "font": {"color": "#222222"}},
        "legend": {"font": {"size": 11}},
        "margin": {"t": 50, "r": 20},
    }
    return {"data": data, "layout": layout}


def make_reference_line(within: float) -> dict[str, Any]:
    """Across the figure, where errors cannot be told from the reference's; none where that is not known."""
    line = {"color": "black", "width": 1, "dash": "dot"}
    index = max(within, SMALLEST) if math.isfinite(within) else 1.0
    ends = {"x0": 0.0, "x1": 1.0, "y0": index, "y1": index}
    return {"type": "line", "xref": "paper", "line": line, "visible": math.isfinite(within), **ends}


def list_heights(rows: Sequence[Row], field: str) -> list[float | None]:
    """Of one measure; None where it is not known."""
    values = [getattr(row, field) for row in rows]
    return [None if math.isnan(value) else max(value, SMALLEST) for value in values]


def make_trace(name: str, rows: Sequence[Row], index: int | None) -> dict[str, Any]:
    """Of one curve; ``index`` None: the front."""
    x = [row.seconds for row in rows]
    found: dict[str, Any] = {"name": name, "type": "scatter", "x": x, "y": list_heights(rows, "worst")}
    if index is None:
        line = {"color": FAINT, "width": 9, "shape": "hv"}
        return found | {"mode": "lines", "line": line, "hoverinfo": "skip"}
    colour, bold = choose_colour(rows), (BOLD if rows[0].curve == AUTO else 1.0)
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
        "marker": {"color": colour, "symbol": SYMBOLS[index % len(SYMBOLS)], "size": 7 * bold**0.5},
        "error_x": spread,
        "text": [make_hover_text(row) for row in rows],
        "hoverinfo": "text",
    }


def make_html(rows: Sequence[Row], circumstances: Sequence[str]) -> str:
    """The page: what was measured, what to take for how much, and a figure a scene."""
    scenes, indices, score = group_rows(rows), assign_markers(rows), make_score_rows(rows)
    figures = {make_file_stem(name): make_scene_figure(some, indices) for name, some in scenes.items()}
    data = json.dumps(figures).replace("</", "<\\/")
    facts = "".join(f"<li>{html.escape(fact)}</li>" for fact in circumstances)
    return "\n".join(
        [
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>vrte: error against run time</title>',
            f"<style>{STYLE}</style></head>\n<body><h1>Error against run time</h1>",
            f"<p><b>{html.escape(advise_overall(rows))}</b></p>",
            f'<h2>How well method="auto" chose</h2>\n{make_html_table(HEADER, score)}' if score else "",
            f"<h2>The quickest run of each scene</h2>\n{make_summary_table(scenes)}",
            f"<h2>How it was measured</h2>\n<ul>{facts}</ul>\n<p>{LEGEND}</p>",
            *(make_scene_section(name, some) for name, some in scenes.items()),
            f"<script>{read_plotly_script()}</script>\n<script>const FIGURES = {data};\n{SCRIPT}</script>\n"
            "</body></html>\n",
        ]
    )


def make_summary_table(scenes: dict[str, list[Row]]) -> str:
    """Scenes down, targets across: what to take."""
    lines = []
    for name, rows in scenes.items():
        within = find_reference_uncertainty(rows)
        lines.append([f'<a href="#s-{make_file_stem(name)}">{html.escape(name)}</a>', f"{within:.0e}"])
        for target in TARGETS:
            row = find_quickest_candidate(rows, target)
            text = "none" if row is None else f"{row.curve}: {row.setting}, {say_run_time(row.seconds)}"
            lines[-1].append("reference not known so well" if within > target else html.escape(text))
    return make_html_table(["scene", "reference within", *(f"{target:.0e}" for target in TARGETS)], lines)


def make_scene_section(name: str, rows: Sequence[Row]) -> str:
    """A scene: what it is, what to take, the figure, and which methods do not take it."""
    refused = "".join(
        f"<li>{html.escape(f'{curve}: {some[0].status}')}</li>"
        for curve, some in group_rows(rows, "curve").items()
        if all(row.status.startswith(REFUSED) for row in some)
    )
    more = f"<details><summary>Does not take it</summary><ul>{refused}</ul></details>" if refused else ""
    return (
        f'<h2 id="s-{make_file_stem(name)}">{html.escape(name)}</h2>\n<p>{html.escape(find_case(name).words)}; '
        f"reference known to "
        f"{find_reference_uncertainty(rows):.0e}.</p>\n<p><b>{html.escape(advise_on_scene(rows))}</b></p>\n"
        f"<p>{html.escape(' '.join(list_peer_comparisons(rows)))}</p>\n"
        f'<div class="plot" id="{make_file_stem(name)}"></div>\n{more}'
    )


def draw_scene_errors(name: str, rows: Sequence[Row], indices: dict[str, int]) -> "Figure":
    """Error against seconds, a line a curve."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panel: Any = figure.subplots()
    best = find_pareto_front(rows)
    x, y = [row.seconds for row in best], [max(row.worst, SMALLEST) for row in best]
    panel.step(x, y, where="post", color=FAINT, linewidth=7, label="Pareto front", alpha=0.7)
    # auto above the others, and first in the legend
    for curve, some in group_by_curve(rows).items():
        index, bold = indices[curve], BOLD if some[0].curve == AUTO else 1.0
        style: dict[str, Any] = {
            "color": choose_colour(some),
            "marker": MARKERS[index % len(MARKERS)],
            "zorder": 2 + bold,
        }
        style["linestyle"] = "--" if some[0].is_peer else "-"
        times = [row.seconds for row in some]
        spread = [[row.seconds - row.least for row in some], [row.greatest - row.seconds for row in some]]
        heights_ = [max(row.worst, SMALLEST) for row in some]
        style |= {"linewidth": 0.9 * bold, "markersize": 4 * bold**0.5, "elinewidth": 0.5}
        panel.errorbar(times, heights_, xerr=spread, label=curve, **style)
    within = find_reference_uncertainty(rows)
    panel.axhline(
        max(within, SMALLEST), color="black", linewidth=0.7, linestyle=":", label=f"reference within {within:.0e}"
    )
    beside = "largest error of I, Q, U, V over the largest I"
    finish_panel(panel, f"{name}: {find_case(name).words}", "seconds on one thread", beside)
    figure.legend(loc="outside right upper", fontsize=7, frameon=False)
    return figure


def describe_report(rows: Sequence[Row]) -> str:
    """A sentence a scene, for a terminal."""
    lines = [advise_overall(rows)]
    for name, some in group_rows(rows).items():
        lines.append(f"{name} (reference known to {find_reference_uncertainty(some):.0e})")
        lines += [f"  {advise_on_target(some, target)}" for target in TARGETS]
        lines += [f"  {text}" for text in list_peer_comparisons(some)]
    if score := make_score_rows(rows):
        lines += make_markdown_table(HEADER, score).splitlines()
    return "\n".join(f"  {line}" for line in [*lines, describe_peers()] if line)


def list_peer_comparisons(rows: Sequence[Row]) -> list[str]:
    """What peers take, for each target that any reaches."""
    return [text for text in (compare_with_peers(rows, target) for target in TARGETS) if text]
