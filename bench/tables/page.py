"""tables.md, tables.csv, figure_1.png: Tables 1 to 3 of the GPU paper and its BRDF, its numbers beside ours."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.pages import list_run_facts, make_markdown_list, make_markdown_table, write_rows, write_text
from bench.tables import paper
from bench.tables.configurations import Configuration
from bench.tables.measuring import Measured
from bench.tables.paper import ASSEMBLY, BRDF, OTHER, OWN_STEPS, TABLE_2, TABLE_3
from bench.timing import Times
from vrte.pictures.figures import COLOURS, FAINT, require_pictures, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE, CSV, FIGURE = "tables.md", "tables.csv", "figure_1.png"
CSV_COLUMNS = (
    *("problem", "configuration", "kernels", "linear_algebra", "backend", "algorithm", "step"),
    *("median_s", "least_s", "greatest_s", "rounds", "paper_s", "paper_over_ours", "difference_from_default"),
)
MARK = "\\*"
COUNTED_FROM = Configuration.TWO  # what "relative" is relative to: the paper's sequential solver

CONFIGURATIONS_NOTE = """\
The same OpenBLAS twice: baseline SIMD is `OPENBLAS_CORETYPE=Prescott`, in a process of its own; the compiled kernels
are the same in both. "On the OpenCL device" are products and inverses of all orders at once. No eigensolver runs there,
so 3 and 6 solve without eigenvectors (`algorithm="auto"`: impedance doubling, or invariance where only the top of
something very thick is seen); 1, 2, 4, 5 and the OpenMP rows solve by `algorithm="modes"`, as the paper does.
`default` is a call that is told nothing but directions, nodes and threads: OpenMP, and the algorithm of its own rule.
"""
TABLE_NOTE = f"""\
Written by `python -m bench.tables`; docs/reference/tables.md says what is measured and how. Medians of the rounds;
in brackets the least and the greatest. The paper's times are those of an {paper.MACHINE}.
"""
BRDF_NOTE = """\
The paper: "close to two hours" against "15 minutes", a factor of about seven, for "a reasonable number of incident and
outgoing directions". It does not print that number: its times and ours are not of the same problem, only their
relative times can be set beside each other.
"""
MARK_NOTE = f"""\
{MARK} Without eigenvectors: reflection and transmission of the layer, found by doubling or by invariance with its beams
and outgoing directions, stand for the homogeneous and the particular solution and most of the reconstruction; joining
stands for the boundary conditions.
"""
STEPS_NOTE = f"""\
`{ASSEMBLY}` makes the phase matrices, which the paper counts to its own steps; `{OTHER}` is planning, transfers and
whatever no stage accounts for. Steps are medians of their own: they need not add up to the total's.
"""


Bars = dict[str, dict[str, float]]  # label of a bar: step: seconds


def write_page(
    found: Measured, folder: str | os.PathLike[str], settings: str, facts: Sequence[str], refused: Sequence[str]
) -> list[Path]:
    """Writes figure_1.png, tables.md and tables.csv into the folder, each all of it or nothing; returns their paths.

    ``facts``: what linear algebra and device were at work; ``refused``: what was not measured, and why. Raises OSError,
    MissingExtraError without matplotlib.
    """
    paths = [Path(folder) / name for name in (FIGURE, PAGE, CSV)]
    save(draw_step_costs(found), paths[0])
    write_text(paths[1], make_markdown(found, settings, facts, refused))
    write_rows(paths[2], CSV_COLUMNS, make_csv_rows(found))
    return paths


def make_csv_rows(found: Measured) -> Iterator[list[object]]:
    """A row for each step of each problem in each configuration, the total last."""
    for problem, each in ((problem.name, each) for problem in found.problems for each in found.configurations):
        for step in (*OWN_STEPS, paper.TOTAL):
            times, printed = found.times(problem, each, step), found.printed(problem, each, step)
            if times is None:
                continue
            ratio = "" if printed is None or times.median <= 0.0 else f"{printed / times.median:.4g}"
            yield [
                *(problem, each.label, each.kernels, each.linear_algebra, each.backend, each.algorithm, step),
                *(f"{seconds:.6f}" for seconds in (times.median, times.least, times.greatest)),
                *(times.rounds, "" if printed is None else printed, ratio, f"{found.checks[problem, each].gap:.1e}"),
            ]


def make_markdown(found: Measured, settings: str, facts: Sequence[str], refused: Sequence[str]) -> str:
    """The page of Tables 1 to 3: what was measured on what, then our times beside the paper's."""
    blocks = [
        "# Tables 1 to 3 and figure 1 of the GPU paper\n",
        make_markdown_list([*list_run_facts(settings), *facts, *(f"not measured: {reason}" for reason in refused)]),
        TABLE_NOTE,
        "## Table 1: the configurations\n",
        make_configuration_table(found.configurations),
        CONFIGURATIONS_NOTE,
    ]
    for problem in found.problems:
        if problem.name == TABLE_2:
            blocks += [f"## Table 2: {problem.title}\n", make_totals_table(found, TABLE_2)]
        elif problem.name == TABLE_3:
            blocks += [f"## Table 3: {problem.title}\n", *make_step_tables(found), f"![figure 1]({FIGURE})\n"]
        else:
            blocks += [f"## BRDF: {problem.title}\n", make_totals_table(found, BRDF), BRDF_NOTE]
    return "\n".join(blocks).rstrip() + "\n"


def make_configuration_table(configurations: Sequence[Configuration]) -> str:
    """A row a configuration."""
    rows = [[c.label, c.kernels, c.linear_algebra, f"`{c.backend}`", f"`{c.algorithm}`"] for c in configurations]
    return make_markdown_table(["configuration", "kernels", "linear algebra", "backend", "algorithm"], rows)


def make_totals_table(found: Measured, problem: str) -> str:
    """A row a configuration: our time, the paper's, each also relative to configuration 2, and the ratio of both."""
    ours, theirs = found.times(problem, COUNTED_FROM), found.printed(problem, COUNTED_FROM)
    rows = []
    for configuration in found.configurations:
        times, printed = found.times(problem, configuration), found.printed(problem, configuration)
        if times is None:
            continue
        check = found.checks[problem, configuration]
        rows.append(
            [
                *(configuration.label, say_time_spread(times), say_ratio(times.median, ours.median if ours else None)),
                *(say_seconds(printed), say_ratio(printed, theirs), say_ratio(printed, times.median)),
                f"{check.gap:.0e}" + ("" if check.published is None else f", {check.published:.0e}"),
                ", ".join(f"{count} by {name}" for name, count in check.orders_by.items()),
            ]
        )
    differs = "differs from default" + (", from Siewert's print" if problem == TABLE_2 else "")
    relative = f"relative to {COUNTED_FROM.label}"
    header = ["configuration", "time [ms]", relative, "the paper [s]", relative, "the paper / ours", differs]
    return make_markdown_table([*header, "Fourier orders solved"], rows)


def make_step_tables(found: Measured) -> list[str]:
    """Our times step by step, the paper's, and their ratios: a column a configuration."""
    shown = [c for c in found.configurations if found.times(TABLE_3, c) is not None]
    printed = [c for c in shown if c.label in paper.LABELS]
    steps = (*paper.STEPS, paper.TOTAL)
    marked = [c for c in shown if paper.has_no_eigenvectors(found.replies[TABLE_3, c][0].stages)]
    ours = [[step, *(say_step_time(found, c, step, c in marked) for c in shown)] for step in (*OWN_STEPS, paper.TOTAL)]
    theirs = [[step, *(say_seconds(found.printed(TABLE_3, c, step)) for c in printed)] for step in steps]
    ratios = [[step, *(say_step_ratio(found, c, step, c in marked) for c in printed)] for step in steps]
    blocks = ["Ours [ms]:\n", make_markdown_table(["step", *(c.label for c in shown)], ours)]
    if marked:
        blocks.append(MARK_NOTE)
    blocks.append(STEPS_NOTE)
    for caption, rows in (("The paper [s]:\n", theirs), ("The paper / ours:\n", ratios)):
        blocks += [caption, make_markdown_table(["step", *(c.label for c in printed)], rows)]
    return [*blocks, make_totals_table(found, TABLE_3)]


def say_step_time(found: Measured, configuration: Configuration, step: str, marked: bool) -> str:
    """Our time of a step [ms]."""
    times = found.times(TABLE_3, configuration, step)
    assert times is not None
    if step == paper.TOTAL:
        return say_time_spread(times)
    mark = f" {MARK}" if marked and step in paper.STEPS else ""
    return f"{1e3 * times.median:.2f}{mark}"


def say_step_ratio(found: Measured, configuration: Configuration, step: str, marked: bool) -> str:
    """The paper's time over ours; a dash for steps that are not the same."""
    times = found.times(TABLE_3, configuration, step)
    if times is None or (marked and step in paper.STEPS):
        return "-"
    return say_ratio(found.printed(TABLE_3, configuration, step), times.median)


def say_time_spread(times: Times) -> str:
    """Median time in milliseconds, in brackets the least and the greatest.

    >>> say_time_spread(Times(0.0123, 0.012, 0.02, 9))
    '12.3 (12.0 to 20.0)'
    """
    return f"{1e3 * times.median:.1f} ({1e3 * times.least:.1f} to {1e3 * times.greatest:.1f})"


def say_seconds(seconds: float | None) -> str:
    """As the paper prints them.

    >>> say_seconds(7200.0), say_seconds(None)
    ('7200', '-')
    """
    return "-" if seconds is None else f"{seconds:g}"


def say_ratio(one: float | None, other: float | None) -> str:
    """One time over another, to three digits.

    >>> say_ratio(2.0, 3.0), say_ratio(None, 3.0), say_ratio(72000.0, 0.5)
    ('0.667', '-', '144,000')
    """
    if one is None or other is None or other <= 0.0:
        return "-"
    value = one / other
    return f"{value:,.0f}" if value >= 100.0 else f"{value:#.3g}"


def describe_times(found: Measured) -> str:
    """For a terminal: a line a configuration, a column a problem."""
    names = [problem.name for problem in found.problems]
    lines = [f"  {'[ms]':18}" + "".join(f"{name:>28}" for name in names)]
    for configuration in found.configurations:
        cells = [found.times(name, configuration) for name in names]
        texts = ["-" if times is None else say_time_spread(times) for times in cells]
        lines.append(f"  {configuration.title:18}" + "".join(f"{text:>28}" for text in texts))
    return "\n".join(lines)


def draw_step_costs(found: Measured) -> "Figure":
    """Figure 1, the cost of each step in each configuration: the paper's panel in seconds and ours in milliseconds,
    each bar with its total and how often that of configuration 2 it is."""
    require_pictures()
    from matplotlib.figure import Figure

    theirs, ours = make_printed_bars(), make_measured_bars(found)
    figure = Figure(figsize=(4.6 + 0.85 * len(ours), 4.8), layout="constrained")
    widths = {"width_ratios": [len(theirs), max(3, len(ours))]}
    left, right = figure.subplots(1, 2, gridspec_kw=widths)
    title = "vrte, here" if found.problems[-1].is_the_papers else "vrte, here, a smaller scene"
    draw_stacked_bars(left, theirs, paper.SECONDS[TABLE_3, paper.TOTAL], 1.0, "seconds", f"The paper: {paper.MACHINE}")
    draw_stacked_bars(
        right, ours, {label: sum(steps.values()) for label, steps in ours.items()}, 1e3, "milliseconds", title
    )
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    return figure


def make_printed_bars() -> Bars:
    """Table 3 as the paper prints it."""
    return {label: {step: paper.SECONDS[TABLE_3, step][label] for step in paper.STEPS} for label in paper.LABELS}


def make_measured_bars(found: Measured) -> Bars:
    """Medians of each step."""
    bars: Bars = {}
    for configuration in found.configurations:
        times = {step: found.times(TABLE_3, configuration, step) for step in OWN_STEPS}
        if any(times.values()):
            bars[configuration.label] = {step: spent.median for step, spent in times.items() if spent is not None}
    return bars


def draw_stacked_bars(panel: Any, bars: Bars, totals: dict[str, float], scale: float, unit: str, title: str) -> None:
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
