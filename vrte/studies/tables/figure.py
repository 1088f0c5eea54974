"""Figure 1 of the GPU paper: the cost of each step in each configuration, the paper's bars beside ours."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte.pictures.figures import COLOURS, FAINT, require_pictures, save
from vrte.studies.tables import paper
from vrte.studies.tables.configurations import Configuration
from vrte.studies.tables.measuring import Measured
from vrte.studies.tables.problems import TABLE_3
from vrte.studies.tables.steps import OTHER, OWN_STEPS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURE = "figure_1.png"
Bars = dict[str, dict[str, float]]  # label of a bar: step: seconds


def write_figure(found: Measured, folder: str | os.PathLike[str]) -> Path:
    """Writes figure_1.png, all of it or nothing. Raises MissingExtraError without matplotlib, OSError."""
    path = Path(folder) / FIGURE
    save(drawn(found), path)
    return path


def drawn(found: Measured) -> "Figure":
    """The paper's panel in seconds and ours in milliseconds, each bar with its total and how often that of 2 it is."""
    require_pictures()
    from matplotlib.figure import Figure

    theirs, ours = printed_bars(), measured_bars(found)
    figure = Figure(figsize=(4.6 + 0.85 * len(ours), 4.8), layout="constrained")
    widths = {"width_ratios": [len(theirs), max(3, len(ours))]}
    left, right = figure.subplots(1, 2, gridspec_kw=widths)
    title = "vrte, here" if found.problems[-1].is_the_papers else "vrte, here, a smaller scene"
    stack(left, theirs, paper.SECONDS[TABLE_3, paper.TOTAL], 1.0, "seconds", f"The paper: {paper.MACHINE}")
    stack(right, ours, {label: sum(steps.values()) for label, steps in ours.items()}, 1e3, "milliseconds", title)
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    return figure


def printed_bars() -> Bars:
    """Table 3 as the paper prints it."""
    return {label: {step: paper.SECONDS[TABLE_3, step][label] for step in paper.STEPS} for label in paper.LABELS}


def measured_bars(found: Measured) -> Bars:
    """Medians of each step."""
    bars: Bars = {}
    for configuration in found.configurations:
        times = {step: found.times(TABLE_3, configuration, step) for step in OWN_STEPS}
        if any(times.values()):
            bars[configuration.label] = {step: spent.median for step, spent in times.items() if spent is not None}
    return bars


def stack(panel: Any, bars: Bars, totals: dict[str, float], scale: float, unit: str, title: str) -> None:
    """One bar a configuration, the steps on top of each other; configuration 2 counts as 1."""
    low = dict.fromkeys(bars, 0.0)
    for step in next(iter(bars.values()), {}):
        heights = [scale * steps[step] for steps in bars.values()]
        colour = FAINT if step == OTHER else COLOURS[step]
        panel.bar(range(len(bars)), heights, 0.7, list(low.values()), color=colour, label=step)
        low = {label: below + height for (label, below), height in zip(low.items(), heights, strict=True)}
    whole = totals.get(Configuration.TWO.label)
    for place, (label, top) in enumerate(low.items()):
        relative = "" if whole is None else f"\n{totals[label] / whole:.2f} x"
        text = f"{scale * totals[label]:.3g}{relative}"
        panel.annotate(text, (place, top), (0, 2), textcoords="offset points", ha="center", fontsize=8)
    panel.set_xticks(range(len(bars)), [label.replace(" ", "\n") for label in bars], fontsize=8)
    panel.set_ylim(0.0, 1.18 * max(low.values(), default=1.0))
    panel.set_ylabel(unit)
    panel.set_title(title, fontsize=10)
    panel.grid(axis="y", color=FAINT, linewidth=0.5, alpha=0.7)
    panel.set_axisbelow(True)
