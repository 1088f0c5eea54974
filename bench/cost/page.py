"""figures.md, exponents beside the paper's claims, measurements.csv, and figures 2 to 9 of the GPU paper as PNGs: total
time, and the time of each step, along each axis."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cost.axes import Axis
from bench.cost.measuring import REST, Measurement, Series, collect_series, fit_exponent, mark_upper_half
from bench.pages import (
    finish_panel,
    list_run_facts,
    make_markdown_list,
    make_markdown_table,
    write_rows,
    write_text,
)
from bench.tables.paper import TOTAL
from vrte.pictures.figures import COLOURS, FAINT, require_pictures, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, CSV = "figures.md", "measurements.csv"
CSV_COLUMNS = (
    *("axis", "value", "configuration", "round", "radius_um", "terms", "nodes", "outgoing", "incident"),
    *("orders_solved", "total_s"),
)
OTHERS = ("#666666", "#00a0a8", "#c05a8f", "#8a7a00", "#4a90e2", "#9b9b9b")  # steps of our own, in their order
CONFIGURATIONS = ("#1f4e79", "#d98200", "#2a8f5b", "#b3262e", "#7a4fa3")
MARKERS = "osD^vP"
Lines = dict[str, dict[str, Series]]  # configuration: step: line


def write_page(
    measurements: Sequence[Measurement],
    axes: Sequence[Axis],
    configurations: Sequence[str],
    folder: str | os.PathLike[str],
    settings: str,
) -> list[Path]:
    """Writes the figures, figures.md and measurements.csv into the folder, each all of it or nothing; their paths.

    Raises MissingExtraError without matplotlib, OSError.
    """
    lines = {
        axis.name: {name: collect_series(measurements, axis.name, name) for name in configurations} for axis in axes
    }
    paths = []
    for axis in axes:
        for number, draw in zip(axis.figures, (draw_total_times, draw_step_times), strict=True):
            paths.append(Path(folder) / f"figure_{number}.png")
            save(draw(axis, lines[axis.name]), paths[-1])
    page, table = Path(folder) / PAGE, Path(folder) / CSV
    write_text(page, make_markdown(measurements, axes, lines, settings))
    stages = list(dict.fromkeys(name for found in measurements for name in found.stages))
    header = [*CSV_COLUMNS, *(f"{name.replace(' ', '_')}_s" for name in stages)]
    write_rows(table, header, [list_csv_cells(found, stages) for found in measurements])
    return [*paths, page, table]


def list_csv_cells(found: Measurement, stages: Sequence[str]) -> list[object]:
    """One solve's row: CSV_COLUMNS, then seconds of each stage, empty where it did not run."""
    point = found.point
    request = [point.radius_um, point.terms, point.nodes, point.outgoing, point.incident]
    times = [f"{found.stages[name]:.6f}" if name in found.stages else "" for name in stages]
    place = [found.axis, f"{found.value:g}", found.configuration, found.round]
    return [*place, *request, found.orders_solved, f"{found.seconds:.6f}", *times]


def make_markdown(
    measurements: Sequence[Measurement], axes: Sequence[Axis], lines: dict[str, Lines], settings: str
) -> str:
    """The page: what was measured on what, then axis by axis the figures, the exponents and the total times."""
    solves = f"{len(measurements)} solves, {sum(found.seconds for found in measurements):.0f} s"
    blocks = [
        "# Cost growth: figures 2 to 9 of the GPU paper\n",
        make_markdown_list([*list_run_facts(settings), describe_linear_algebra(), solves]),
        "Written by `python -m bench.cost`; docs/explanation/cost.md says what the columns mean.\n",
    ]
    for axis in axes:
        found, (first, second) = lines[axis.name], axis.figures
        orders = {each.value: each.orders_solved for each in measurements if each.axis == axis.name}
        totals = [
            [f"{value:g}", str(orders[value]), *(f"{1e3 * steps[TOTAL].seconds[k]:.1f}" for steps in found.values())]
            for k, value in enumerate(axis.values.tolist())
        ]
        blocks += [
            f"## Figures {first} and {second}: {axis.title}\n",
            f"![total time](figure_{first}.png)\n\n![time of each step](figure_{second}.png)\n",
            make_markdown_table(make_exponent_header(axis, list(found)), make_exponent_rows(axis, found)),
            make_markdown_table([axis.name, "orders solved", *(f"total [ms], {name}" for name in found)], totals),
        ]
    return "\n".join(blocks).rstrip() + "\n"


def make_exponent_header(axis: Axis, configurations: Sequence[str]) -> list[str]:
    """Of the table of exponents: the range of each fit is in it."""
    values = axis.values
    upper = values[mark_upper_half(values)]
    columns = ["step", "the paper"]
    for name in configurations:
        columns += [
            f"{name}: all ({say_range(values)})",
            f"upper half ({say_range(upper)})",
            f"share at {values[-1]:g}",
        ]
    return columns


def say_range(values: Any) -> str:
    """First and last.

    >>> say_range([1.0, 2.0, 8.0])
    '1 to 8'
    """
    return f"{values[0]:g} to {values[-1]:g}"


def make_exponent_rows(axis: Axis, found: Lines) -> list[list[str]]:
    """A row a step: claim, and in each configuration both fits and the step's share of the total at the last point."""
    rows = []
    for step in dict.fromkeys(name for lines in found.values() for name in lines):
        row = [step, str(axis.claims.get(step, "-"))]
        for lines in found.values():
            line = lines.get(step)
            if line is None:
                row += ["-", "-", "-"]
                continue
            share = line.seconds[-1] / lines[TOTAL].seconds[-1]
            row += [line.exponent(), line.exponent(mark_upper_half(line.x)), f"{share:.1%}"]
        rows.append(row)
    return rows


def describe_exponents(measurements: Sequence[Measurement], axes: Sequence[Axis], configurations: Sequence[str]) -> str:
    """The exponents for a terminal: a block an axis, a line a step."""
    texts = []
    for axis in axes:
        texts.append(f"  {axis.title}, {say_range(axis.values)}")
        texts.append(f"    {'exponent of':20}{'the paper':42}" + "".join(f"{name:>20}" for name in configurations))
        found = {name: collect_series(measurements, axis.name, name) for name in configurations}
        for step, stated, *cells in make_exponent_rows(axis, found):
            texts.append(f"    {step:20}{stated:42}" + "".join(f"{cell:>20}" for cell in cells[::3]))
        texts.append("")
    return "\n".join(texts[:-1])


def describe_linear_algebra() -> str:
    """The libraries behind it, and for which processor they chose their kernels."""
    from threadpoolctl import threadpool_info

    found = {
        " ".join(str(library[key]) for key in ("internal_api", "version", "architecture") if library.get(key))
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }
    return f"linear algebra: {', '.join(sorted(found)) or 'unknown'}"


def draw_total_times(axis: Axis, found: Lines) -> "Figure":
    """Total time, a line a configuration, each with its fit. Raises MissingExtraError."""
    figure = make_figure(6.4, 4.2)
    panel = figure.subplots()
    for place, (name, steps) in enumerate(found.items()):
        draw_series(panel, steps[TOTAL], CONFIGURATIONS[place], place, f"{name}: exponent {steps[TOTAL].exponent()}")
    name_axes(panel, axis, f"Total time. Exponent in the paper: {axis.claims[TOTAL].text}")
    panel.set_ylabel("seconds")
    panel.legend(fontsize=9, frameon=False)
    return figure


def draw_step_times(axis: Axis, found: Lines) -> "Figure":
    """Time of each step, a panel a configuration. Raises MissingExtraError."""
    figure = make_figure(1.2 + 4.2 * len(found), 5.4)
    panels: Any = figure.subplots(1, len(found), sharey=True, squeeze=False)
    for panel, (name, lines) in zip(panels[0], found.items(), strict=True):
        steps = {step: line for step, line in lines.items() if step != TOTAL and line.seconds.any()}
        colours = choose_colours(list(steps))
        for place, (step, line) in enumerate(steps.items()):
            stated = f" (paper: {axis.claims[step].text})" if step in axis.claims else ""
            draw_series(panel, line, colours[step], place, f"{step}: {line.exponent()}{stated}")
        name_axes(panel, axis, name)
        below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15)}
        panel.legend(fontsize=8, frameon=False, title="step: exponent", title_fontsize=8, **below)
    panels[0, 0].set_ylabel("seconds")
    return figure


def choose_colours(steps: Sequence[str]) -> dict[str, str]:
    """Of each step: the paper's have theirs everywhere."""
    ours = [step for step in steps if step not in COLOURS and step != REST]
    return COLOURS | {step: OTHERS[place % len(OTHERS)] for place, step in enumerate(ours)} | {REST: FAINT}


def draw_series(panel: Any, line: Series, colour: str, place: int, label: str) -> None:
    """Medians with a bar from the least to the greatest, and the fitted power law dashed."""
    ran = line.seconds > 0.0
    x, median = line.x[ran], line.seconds[ran]
    spread = [median - line.least[ran], line.greatest[ran] - median]
    style = {"color": colour, "marker": MARKERS[place % len(MARKERS)], "markersize": 4}
    panel.errorbar(x, median, yerr=spread, label=label, linewidth=1.3, elinewidth=0.8, capsize=2, **style)
    fit = fit_exponent(x, median)
    if fit is not None:
        panel.plot(x, fit.at(x), color=colour, linewidth=0.9, linestyle="--", alpha=0.7)


def name_axes(panel: Any, axis: Axis, title: str) -> None:
    """With ticks at the points themselves, where there is room for their names."""
    from matplotlib.ticker import FixedLocator, NullLocator

    finish_panel(panel, title, axis.title)
    panel.xaxis.set_major_locator(FixedLocator(axis.values.tolist()))
    panel.xaxis.set_minor_locator(NullLocator())
    panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.tick_params(labelsize=8)


def make_figure(width: float, height: float) -> Any:
    """An empty figure [inches]. Raises MissingExtraError without matplotlib."""
    require_pictures()
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
