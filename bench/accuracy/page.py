"""The sweep as a CSV file, a Markdown page and a picture."""

import os
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.accuracy.fewest import TABLE, Errors, make_ratio_table, read_errors
from bench.accuracy.sweep import Outcome, compute_median_slack
from bench.cost import CONFIGURATIONS, OTHERS
from bench.study import (
    MARKERS,
    finish_panel,
    list_run_facts,
    make_markdown_list,
    make_markdown_table,
    write_rows,
    write_text,
)
from vrte.pictures.figures import COLOURS, FAINT, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = ((True, "nodes given: the discrete problem"), (False, "nodes chosen: the continuous problem"))
LINES = tuple(dict.fromkeys([*CONFIGURATIONS, *COLOURS.values(), *OTHERS]))


def describe_outcome(outcome: Outcome) -> str:
    """One request and what was achieved, in one line.

    >>> describe_outcome(Outcome("a scene", True, 1e-3, 2e-5, 1e-14, 8, 3, 96, 0.1, True, True))
    'a scene, 8 nodes given: requested 1e-03, achieved 2e-05, 3 orders'
    """
    how = "given" if outcome.given else "chosen"
    kept = "" if outcome.kept else ", NOT KEPT"
    return (
        f"{outcome.scene}, {outcome.nodes} nodes {how}: requested {outcome.requested:.0e}, "
        f"achieved {outcome.achieved:.0e}, {outcome.orders} orders{kept}"
    )


def write_pages(outcomes: Sequence[Outcome], folder: str | os.PathLike[str]) -> list[Path]:
    """Writes accuracy.csv, accuracy.md and accuracy.png into the folder; their paths.

    Raises MissingExtraError without matplotlib, OSError.
    """
    table, page, picture = (Path(folder) / f"accuracy.{ending}" for ending in ("csv", "md", "png"))
    write_rows(table, [item.name for item in fields(Outcome)], [list_csv_cells(outcome) for outcome in outcomes])
    write_text(page, make_markdown(outcomes, read_errors(Path(folder) / TABLE)))
    save(draw_figure(outcomes), picture)
    return [table, page, picture]


def list_csv_cells(outcome: Outcome) -> list[object]:
    """Numbers with as many digits as they have."""
    return [f"{value:.3g}" if isinstance(value, float) else value for value in asdict(outcome).values()]


def make_markdown(outcomes: Sequence[Outcome], errors: dict[str, Errors]) -> str:
    """A table for each kind of request: achieved, and the nodes and orders that did; and the nodes chosen over the
    fewest that hold, where ``errors`` of scenes and nodes are known."""
    text = "# Requested and achieved accuracy\n\n" + make_markdown_list(list_run_facts("the sweep of bench.accuracy"))
    for given, title in KINDS:
        part = [outcome for outcome in outcomes if outcome.given == given]
        if part:
            text += f"\n## {title.capitalize()}\n\n{describe_sweep(part)}\n\n" + make_outcome_table(part)
    fewest = make_ratio_table(errors, outcomes)
    return text + (f"\n## Nodes chosen over the fewest that hold\n\n{fewest}" if fewest else "")


def describe_sweep(outcomes: Sequence[Outcome]) -> str:
    """What the sweep showed, in a sentence or two."""
    broken = sum(not outcome.kept for outcome in outcomes)
    closest = min(outcome.slack for outcome in outcomes)
    saved = [outcome for outcome in outcomes if outcome.saved]
    return (
        f"{len(outcomes)} requests, {broken} not kept; requested over achieved: at least {closest:.2g}, median "
        f"{compute_median_slack(outcomes):.2g} over the {len(saved)} that did with fewer nodes or orders than the "
        "finest."
    )


def make_outcome_table(outcomes: Sequence[Outcome]) -> str:
    """Scenes down, requests across."""
    requests = sorted({outcome.requested for outcome in outcomes}, reverse=True)
    header = ["scene", "reference within", *(f"{requested:.0e}" for requested in requests)]
    rows: dict[str, list[str]] = {}
    for outcome in outcomes:
        row = rows.setdefault(outcome.scene, [outcome.scene, f"{outcome.uncertain:.0e}"])
        doubt = "" if outcome.promised or outcome.given else " ?"
        row.append(f"{outcome.achieved:.0e} ({outcome.nodes}, {outcome.orders}){doubt}")
    note = "\nAchieved (nodes, orders); ? where it is not promised, which it never is with nodes given.\n"
    return make_markdown_table(header, rows.values()) + note


def draw_figure(outcomes: Sequence[Outcome]) -> "Figure":
    """Achieved over requested, a panel for each kind of request, a line a scene."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    panels: Any = figure.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(outcome.scene for outcome in outcomes))
    for panel, (given, title) in zip(panels, KINDS, strict=True):
        for place, name in enumerate(names):
            line = [outcome for outcome in outcomes if outcome.given == given and outcome.scene == name]
            x, y = [outcome.requested for outcome in line], [max(outcome.achieved, 1e-16) for outcome in line]
            style = {"color": LINES[place % len(LINES)], "marker": MARKERS[place % len(MARKERS)]}
            panel.plot(x, y, markersize=3.5, linewidth=0.8, label=name, **style)
        requests = [outcome.requested for outcome in outcomes if outcome.given == given]
        ends = [min(requests, default=1e-9), max(requests, default=1e-3)]
        panel.plot(ends, ends, color="black", linewidth=1.2)  # the line that no point may lie above
        panel.fill_between(ends, ends, [10.0 * end for end in ends], color=FAINT, alpha=0.5, linewidth=0)
        finish_panel(panel, title, "requested")
    panels[0].set_ylabel("achieved, relative to the largest I")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure
