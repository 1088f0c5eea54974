"""Figures 2 to 9 of the GPU paper as PNGs: total time, and the time of each step, along each axis."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrte.basics.arrays import Array
from vrte.pictures.figures import COLOURS, FAINT, require_pictures, save
from vrte.studies.cost.claims import TOTAL, claim
from vrte.studies.cost.fitting import fit_exponent
from vrte.studies.cost.measuring import REST, Measurement, Series, series
from vrte.studies.cost.sweeps import Axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OTHERS = ("#666666", "#00a0a8", "#c05a8f", "#8a7a00", "#4a90e2", "#9b9b9b")  # steps of our own, in their order
CONFIGURATIONS = ("#1f4e79", "#d98200", "#2a8f5b", "#b3262e", "#7a4fa3")
MARKERS = "osD^vP"


def write_figures(
    measurements: Sequence[Measurement],
    axes: Sequence[Axis],
    configurations: Sequence[str],
    folder: str | os.PathLike[str],
) -> list[Path]:
    """Writes figure_2.png, ... into the folder, each all of it or nothing; returns their paths.

    Raises MissingExtraError without matplotlib, OSError.
    """
    paths = []
    for axis in axes:
        found = {name: series(measurements, axis.name, name) for name in configurations}
        for number, figure in zip(axis.figures, (total_figure(axis, found), steps_figure(axis, found)), strict=True):
            paths.append(Path(folder) / figure_name(number))
            save(figure, paths[-1])
    return paths


def figure_name(number: int) -> str:
    """Of the file.

    >>> figure_name(2)
    'figure_2.png'
    """
    return f"figure_{number}.png"


def total_figure(axis: Axis, found: dict[str, dict[str, Series]]) -> "Figure":
    """Total time, a line a configuration, each with its fit. Raises MissingExtraError."""
    figure = _figure(6.4, 4.2)
    panel = figure.subplots()
    for place, (name, steps) in enumerate(found.items()):
        colour, marker = CONFIGURATIONS[place % len(CONFIGURATIONS)], MARKERS[place % len(MARKERS)]
        _draw(panel, steps[TOTAL], colour, marker, f"{name}: exponent {_exponent(steps[TOTAL])}")
    _finish(panel, axis)
    panel.set_ylabel("seconds")
    stated = claim(axis.name, TOTAL)
    panel.set_title(f"Total time. Exponent in the paper: {'-' if stated is None else stated.text}", fontsize=10)
    panel.legend(fontsize=9, frameon=False)
    return figure


def steps_figure(axis: Axis, found: dict[str, dict[str, Series]]) -> "Figure":
    """Time of each step, a panel a configuration. Raises MissingExtraError."""
    figure = _figure(1.2 + 4.2 * len(found), 5.4)
    panels: Any = figure.subplots(1, len(found), sharey=True, squeeze=False)
    for panel, (name, steps) in zip(panels[0], found.items(), strict=True):
        for place, (step, line) in enumerate(_steps(steps).items()):
            _draw(
                panel, line, _colour(step, list(_steps(steps))), MARKERS[place % len(MARKERS)], _label(axis, step, line)
            )
        _finish(panel, axis)
        panel.set_title(name, fontsize=10)
        panel.legend(
            fontsize=8,
            frameon=False,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.15),
            title="step: exponent",
            title_fontsize=8,
        )
    panels[0, 0].set_ylabel("seconds")
    return figure


def _steps(steps: dict[str, Series]) -> dict[str, Series]:
    """Those that take time anywhere, without the total."""
    return {name: line for name, line in steps.items() if name != TOTAL and line.seconds.any()}


def _label(axis: Axis, step: str, line: Series) -> str:
    stated = claim(axis.name, step)
    return f"{step}: {_exponent(line)}{'' if stated is None else f' (paper: {stated.text})'}"


def _exponent(line: Series) -> str:
    fit = fit_exponent(line.x, line.seconds)
    return "-" if fit is None else str(fit)


def _colour(step: str, steps: list[str]) -> str:
    ours = [name for name in steps if name not in COLOURS and name != REST]
    return COLOURS.get(step) or (FAINT if step == REST else OTHERS[ours.index(step) % len(OTHERS)])


def _draw(panel: Any, line: Series, colour: str, marker: str, label: str) -> None:
    """Medians with a bar from the least to the greatest, and the fitted power law dashed."""
    ran = line.seconds > 0.0
    x, median = line.x[ran], line.seconds[ran]
    spread = [median - line.least[ran], line.greatest[ran] - median]
    style = {"color": colour, "marker": marker, "markersize": 4, "linewidth": 1.3, "elinewidth": 0.8, "capsize": 2}
    panel.errorbar(x, median, yerr=spread, label=label, **style)
    fit = fit_exponent(x, median)
    if fit is not None:
        panel.plot(x, fit.at(x), color=colour, linewidth=0.9, linestyle="--", alpha=0.7)


def _finish(panel: Any, axis: Axis) -> None:
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel(axis.title)
    _name_points(panel, axis.values)
    panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)


def _name_points(panel: Any, values: Array) -> None:
    """Ticks at the points themselves, where there is room for their names."""
    from matplotlib.ticker import FixedLocator, NullLocator

    panel.xaxis.set_major_locator(FixedLocator(values.tolist()))
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.tick_params(labelsize=8)


def _figure(width: float, height: float) -> Any:
    require_pictures()
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
