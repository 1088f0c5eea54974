"""The Markdown page of exponents beside the paper's claims, and the CSV file of all measurements."""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from vrte.formats.atomic import atomic_write
from vrte.studies.cost.claims import TOTAL, claim
from vrte.studies.cost.figures import figure_name
from vrte.studies.cost.fitting import Fit, fit_exponent, upper_half
from vrte.studies.cost.measuring import Measurement, Series, series
from vrte.studies.cost.sweeps import Axis
from vrte.studies.pages import made_with, markdown_list, markdown_table, write_rows

PAGE, CSV = "figures.md", "measurements.csv"
CSV_COLUMNS = (
    *("axis", "value", "configuration", "round", "radius_um", "terms", "nodes", "outgoing", "incident"),
    *("orders_solved", "total_s"),
)


def write_page(
    measurements: Sequence[Measurement],
    axes: Sequence[Axis],
    configurations: Sequence[str],
    folder: str | os.PathLike[str],
    settings: str,
) -> list[Path]:
    """Writes figures.md and measurements.csv into the folder, each all of it or nothing; returns their paths.

    Raises OSError.
    """
    page, table = Path(folder) / PAGE, Path(folder) / CSV
    with atomic_write(page) as part:
        part.write_text(as_markdown(measurements, axes, configurations, settings), encoding="utf-8")
    stages = stage_names(measurements)
    header = [*CSV_COLUMNS, *(f"{name.replace(' ', '_')}_s" for name in stages)]
    write_rows(table, header, [csv_cells(found, stages) for found in measurements])
    return [page, table]


def stage_names(measurements: Iterable[Measurement]) -> list[str]:
    """Every stage that any solve had, in the order in which they first occur."""
    return list(dict.fromkeys(name for found in measurements for name in found.stages))


def csv_cells(found: Measurement, stages: Sequence[str]) -> list[object]:
    """One solve's row: CSV_COLUMNS, then seconds of each stage, empty where it did not run."""
    point = found.point
    request = [point.radius_um, point.terms, point.nodes, point.outgoing, point.incident]
    times = [f"{found.stages[name]:.6f}" if name in found.stages else "" for name in stages]
    place = [found.axis, f"{found.value:g}", found.configuration, found.round]
    return [*place, *request, found.orders_solved, f"{found.seconds:.6f}", *times]


def as_markdown(
    measurements: Sequence[Measurement], axes: Sequence[Axis], configurations: Sequence[str], settings: str
) -> str:
    """The page: what was measured on what, then axis by axis the figures, the exponents and the total times."""
    solves = f"{len(measurements)} solves, {sum(found.seconds for found in measurements):.0f} s"
    blocks = [
        "# Cost growth: figures 2 to 9 of the GPU paper\n",
        markdown_list([*made_with(settings), linear_algebra(), solves]),
        "Written by `vrte tables --figures`; docs/cost.md says what the columns mean.\n",
    ]
    for axis in axes:
        found = {name: series(measurements, axis.name, name) for name in configurations}
        first, second = axis.figures
        blocks += [
            f"## Figures {first} and {second}: {axis.title}\n",
            f"![total time]({figure_name(first)})\n\n![time of each step]({figure_name(second)})\n",
            markdown_table(exponent_header(axis, configurations), exponent_rows(axis, found)),
            markdown_table(
                [axis.name, "orders solved", *(f"total [ms], {name}" for name in configurations)],
                total_rows(measurements, axis, found),
            ),
        ]
    return "\n".join(blocks).rstrip() + "\n"


def exponent_header(axis: Axis, configurations: Sequence[str]) -> list[str]:
    """Of the table of exponents: the range of each fit is in it."""
    values = axis.values
    upper = values[upper_half(values)]
    columns = ["step", "the paper"]
    for name in configurations:
        columns += [f"{name}: all ({span(values)})", f"upper half ({span(upper)})", f"share at {values[-1]:g}"]
    return columns


def span(values: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> str:
    """First and last.

    >>> span(np.array([1.0, 2.0, 8.0]))
    '1 to 8'
    """
    return f"{values[0]:g} to {values[-1]:g}"


def exponent_rows(axis: Axis, found: dict[str, dict[str, Series]]) -> list[list[str]]:
    """A row a step: claim, and in each configuration both fits and the step's share of the total at the last point."""
    steps = list(dict.fromkeys(name for lines in found.values() for name in lines))
    rows = []
    for step in steps:
        stated = claim(axis.name, step)
        row = [step, "-" if stated is None else str(stated)]
        for lines in found.values():
            row += exponent_cells(lines.get(step), lines[TOTAL])
        rows.append(row)
    return rows


def exponent_cells(line: Series | None, total: Series) -> list[str]:
    """Both exponents and the share of the total at the last point."""
    if line is None:
        return ["-", "-", "-"]
    upper = upper_half(line.x)
    fits = [fit_exponent(line.x, line.seconds), fit_exponent(line.x[upper], line.seconds[upper])]
    return [*map(exponent_text, fits), f"{line.seconds[-1] / total.seconds[-1]:.1%}"]


def exponent_text(fit: Fit | None) -> str:
    """With its standard error, or a dash where there is no fit."""
    return "-" if fit is None else str(fit)


def total_rows(measurements: Sequence[Measurement], axis: Axis, found: dict[str, dict[str, Series]]) -> list[list[str]]:
    """A row a point: Fourier orders solved, and the median total of each configuration [ms]."""
    orders = {found.value: found.orders_solved for found in measurements if found.axis == axis.name}
    rows = []
    for place, value in enumerate(axis.values.tolist()):
        totals = [f"{1e3 * lines[TOTAL].seconds[place]:.1f}" for lines in found.values()]
        rows.append([f"{value:g}", str(orders[value]), *totals])
    return rows


def as_text(measurements: Sequence[Measurement], axes: Sequence[Axis], configurations: Sequence[str]) -> str:
    """The exponents for a terminal: a block an axis, a line a step."""
    texts = []
    for axis in axes:
        texts.append(f"  {axis.title}, {span(axis.values)}")
        texts.append(f"    {'exponent of':20}{'the paper':42}" + "".join(f"{name:>20}" for name in configurations))
        found = {name: series(measurements, axis.name, name) for name in configurations}
        for step, stated, *cells in exponent_rows(axis, found):
            texts.append(f"    {step:20}{stated:42}" + "".join(f"{cell:>20}" for cell in cells[::3]))
        texts.append("")
    return "\n".join(texts[:-1])


def linear_algebra() -> str:
    """The libraries behind it, and for which processor they chose their kernels."""
    from threadpoolctl import threadpool_info

    found = {
        " ".join(str(library[key]) for key in ("internal_api", "version", "architecture") if library.get(key))
        for library in threadpool_info()
        if library["user_api"] == "blas"
    }
    return f"linear algebra: {', '.join(sorted(found)) or 'unknown'}"
