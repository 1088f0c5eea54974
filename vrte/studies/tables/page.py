"""tables.md and tables.csv: Tables 1 to 3 of the GPU paper and its BRDF, the paper's numbers beside ours."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from vrte.formats.atomic import atomic_write
from vrte.studies.pages import made_with, markdown_list, markdown_table, write_rows
from vrte.studies.tables import paper
from vrte.studies.tables.configurations import Configuration
from vrte.studies.tables.figure import FIGURE
from vrte.studies.tables.measuring import Measured, Times
from vrte.studies.tables.problems import BRDF, TABLE_2, TABLE_3
from vrte.studies.tables.steps import ASSEMBLY, OTHER, OWN_STEPS, has_no_eigenvectors

PAGE, CSV = "tables.md", "tables.csv"
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
Written by `vrte tables`; docs/tables.md says what is measured and how. Medians of the rounds; in brackets the least and
the greatest. The paper's times are those of an {paper.MACHINE}.
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


def write_page(
    found: Measured, folder: str | os.PathLike[str], settings: str, facts: Sequence[str], refused: Sequence[str]
) -> list[Path]:
    """Writes tables.md and tables.csv into the folder, each all of it or nothing; returns their paths. Raises OSError.

    ``facts``: what linear algebra and device were at work; ``refused``: what was not measured, and why.
    """
    page, table = Path(folder) / PAGE, Path(folder) / CSV
    with atomic_write(page) as part:
        part.write_text(as_markdown(found, settings, facts, refused), encoding="utf-8")
    write_rows(table, CSV_COLUMNS, csv_rows(found))
    return [page, table]


def csv_rows(found: Measured) -> Iterator[list[object]]:
    """A row for each step of each problem in each configuration, the total last."""
    for problem in found.problems:
        for configuration in found.configurations:
            for step in (*OWN_STEPS, paper.TOTAL):
                times = found.times(problem.name, configuration, step)
                if times is None:
                    continue
                printed = found.printed(problem.name, configuration, step)
                yield [
                    *(problem.name, configuration.label, configuration.kernels, configuration.linear_algebra),
                    *(configuration.backend, configuration.algorithm, step),
                    *(f"{value:.6f}" for value in (times.median, times.least, times.greatest)),
                    times.rounds,
                    "" if printed is None else printed,
                    "" if printed is None or times.median <= 0.0 else f"{printed / times.median:.4g}",
                    f"{found.checks[problem.name, configuration].gap:.1e}",
                ]


def as_markdown(found: Measured, settings: str, facts: Sequence[str], refused: Sequence[str]) -> str:
    """The page."""
    blocks = [
        "# Tables 1 to 3 and figure 1 of the GPU paper\n",
        markdown_list([*made_with(settings), *facts, *(f"not measured: {reason}" for reason in refused)]),
        TABLE_NOTE,
        "## Table 1: the configurations\n",
        table_1(found.configurations),
        CONFIGURATIONS_NOTE,
    ]
    for problem in found.problems:
        if problem.name == TABLE_2:
            blocks += [f"## Table 2: {problem.title}\n", totals(found, TABLE_2)]
        elif problem.name == TABLE_3:
            blocks += [f"## Table 3: {problem.title}\n", *table_3(found), f"![figure 1]({FIGURE})\n"]
        else:
            blocks += [f"## BRDF: {problem.title}\n", totals(found, BRDF), BRDF_NOTE]
    return "\n".join(blocks).rstrip() + "\n"


def table_1(configurations: Sequence[Configuration]) -> str:
    """A row a configuration."""
    rows = [[c.label, c.kernels, c.linear_algebra, f"`{c.backend}`", f"`{c.algorithm}`"] for c in configurations]
    return markdown_table(["configuration", "kernels", "linear algebra", "backend", "algorithm"], rows)


def totals(found: Measured, problem: str) -> str:
    """A row a configuration: our time, the paper's, each also relative to configuration 2, and the ratio of both."""
    ours = found.times(problem, COUNTED_FROM)
    theirs = found.printed(problem, COUNTED_FROM)
    rows = []
    for configuration in found.configurations:
        times = found.times(problem, configuration)
        if times is None:
            continue
        printed = found.printed(problem, configuration)
        check = found.checks[problem, configuration]
        rows.append(
            [
                configuration.label,
                spread_text(times),
                ratio_text(times.median, None if ours is None else ours.median),
                seconds_text(printed),
                ratio_text(printed, theirs),
                ratio_text(printed, times.median),
                f"{check.gap:.0e}" + ("" if check.published is None else f", {check.published:.0e}"),
                ", ".join(f"{count} by {name}" for name, count in check.orders_by.items()),
            ]
        )
    differs = "differs from default" + (", from Siewert's print" if problem == TABLE_2 else "")
    relative = f"relative to {COUNTED_FROM.label}"
    header = ["configuration", "time [ms]", relative, "the paper [s]", relative, "the paper / ours", differs]
    return markdown_table([*header, "Fourier orders solved"], rows)


def table_3(found: Measured) -> list[str]:
    """Our times step by step, the paper's, and their ratios: a column a configuration."""
    shown = [c for c in found.configurations if found.times(TABLE_3, c) is not None]
    printed = [c for c in shown if c.label in paper.LABELS]
    steps = (*paper.STEPS, paper.TOTAL)
    marked = [c for c in shown if has_no_eigenvectors(found.replies[TABLE_3, c][0].stages)]
    ours = [[step, *(step_text(found, c, step, c in marked) for c in shown)] for step in (*OWN_STEPS, paper.TOTAL)]
    theirs = [[step, *(seconds_text(found.printed(TABLE_3, c, step)) for c in printed)] for step in steps]
    ratios = [[step, *(ratio_cell(found, c, step, c in marked) for c in printed)] for step in steps]
    blocks = ["Ours [ms]:\n", markdown_table(["step", *(c.label for c in shown)], ours)]
    if marked:
        blocks.append(MARK_NOTE)
    blocks.append(STEPS_NOTE)
    for caption, rows in (("The paper [s]:\n", theirs), ("The paper / ours:\n", ratios)):
        blocks += [caption, markdown_table(["step", *(c.label for c in printed)], rows)]
    return [*blocks, totals(found, TABLE_3)]


def step_text(found: Measured, configuration: Configuration, step: str, marked: bool) -> str:
    """Our time of a step [ms]."""
    times = found.times(TABLE_3, configuration, step)
    assert times is not None
    if step == paper.TOTAL:
        return spread_text(times)
    mark = f" {MARK}" if marked and step in paper.STEPS else ""
    return f"{1e3 * times.median:.2f}{mark}"


def ratio_cell(found: Measured, configuration: Configuration, step: str, marked: bool) -> str:
    """The paper's time over ours; a dash for steps that are not the same."""
    times = found.times(TABLE_3, configuration, step)
    if times is None or (marked and step in paper.STEPS):
        return "-"
    return ratio_text(found.printed(TABLE_3, configuration, step), times.median)


def spread_text(times: Times) -> str:
    """Milliseconds.

    >>> spread_text(Times(0.0123, 0.012, 0.02, 9))
    '12.3 (12.0 to 20.0)'
    """
    return f"{1e3 * times.median:.1f} ({1e3 * times.least:.1f} to {1e3 * times.greatest:.1f})"


def seconds_text(seconds: float | None) -> str:
    """As the paper prints them.

    >>> seconds_text(7200.0), seconds_text(None)
    ('7200', '-')
    """
    return "-" if seconds is None else f"{seconds:g}"


def ratio_text(one: float | None, other: float | None) -> str:
    """Three digits.

    >>> ratio_text(2.0, 3.0), ratio_text(None, 3.0), ratio_text(72000.0, 0.5)
    ('0.667', '-', '144,000')
    """
    if one is None or other is None or other <= 0.0:
        return "-"
    value = one / other
    return f"{value:,.0f}" if value >= 100.0 else f"{value:#.3g}"


def as_text(found: Measured) -> str:
    """For a terminal: a line a configuration, a column a problem."""
    names = [problem.name for problem in found.problems]
    lines = [f"  {'[ms]':18}" + "".join(f"{name:>28}" for name in names)]
    for configuration in found.configurations:
        cells = [found.times(name, configuration) for name in names]
        texts = ["-" if times is None else spread_text(times) for times in cells]
        lines.append(f"  {configuration.title:18}" + "".join(f"{text:>28}" for text in texts))
    return "\n".join(lines)
