"""Figures 2 to 9 of the GPU paper: how the cost grows, with exponents, measured here: `python -m bench.cost`.

One axis is varied for each pair of figures, (1), section 4, and all else stays as it is. The layer is the paper's: gold
spheres of radius 0.6 um at 400 nm, optical thickness 100 over black, 40 nodes, 11 outgoing cosines and 19 azimuths. The
paper prints no values along its axes but the radii, 0.2 to 0.7 um, sorted by the orders of expansion of their phase
matrices; the values here are ours. No axis goes below the nodes that carry every term of the phase matrix (terms <=
2 N), so that the number of nodes does not change the number of Fourier orders.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import cases
from bench.study import (
    COLOURS,
    MARKERS,
    Study,
    add_study,
    carry_out,
    list_run_facts,
    make_command,
    make_markdown_list,
    make_markdown_table,
    run_command,
    write_rows,
    write_text,
)
from bench.tables import IN_RECONSTRUCTION, STEPS, TOTAL
from bench.tables import Configuration as Papers
from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.basics.running import find_blas_libraries
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.commands.common import make_option_reader
from vrte.pictures.describe import Axis, Curve, Picture, PlotPanel
from vrte.pictures.figures import FAINT, draw_picture, require_pictures, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MU0 = 0.6
PHI = np.arange(0.0, 181.0, 10.0)  # [degrees]
REST = "outside the steps"
BEFORE = "planning", "choice of nodes"  # stages that a solve's own seconds do not count
ROUNDS, ROUNDS_QUICK = (3, 15, 1.5), (3, 15, 0.1)  # fewest, most, seconds of all configurations and rounds of a point
PAPERS = (Papers.TWO, Papers.FIVE)  # that the paper's figures show; all by its own method, modes
FEWEST_POINTS = 3  # of a fit: two leave nothing to tell the uncertainty from
# Of each axis: title, figures (total time, time of each step), what of a point is varied, how far in full and where
# quick, and what the paper says of the total and of its steps (section 3): an exponent, in words, and the section. Of
# the nodes, 4.B.1 says quadratic or cubic, depending on the computation; which of the two is counted from section 3.
AXES = {
    "nodes": (
        *("quadrature nodes of a hemisphere", (2, 3), "nodes"),
        *((24, 32, 40, 48, 64, 80, 96, 128), (12, 16, 20, 24)),
        ("2 to 3 (4.B.1)", "3 (3.A)", "3 (3.B)", "2 or 3 (4.B.1)", "2 (3.D)"),
    ),
    "outgoing": (
        *("outgoing directions (zenith angles)", (4, 5), "outgoing"),
        *((1, 2, 4, 8, 16, 32, 64, 128, 256, 512), (1, 4, 16, 64)),
        ("at most 1, by the reconstruction (4.B.2)", *3 * ("0 (4.B.2)",), "1 (4.B.2)"),
    ),
    "orders": (
        *("orders of expansion of the phase matrix", (6, 7), "radius_um"),
        *(tuple(round(0.2 + 0.05 * step, 2) for step in range(11)), (0.2, 0.25, 0.3)),
        5 * ("1 (4.B.3)",),
    ),
    "incident": (
        *("incident directions", (8, 9), "incident"),
        *((1, 2, 4, 8, 16, 32, 64, 128, 256), (1, 4, 16)),
        ("at most 1, by all but the homogeneous (4.C)", "0 (4.C)", *3 * ("1 (4.C)",)),
    ),
}


@dataclass(frozen=True)
class Point:
    """One scene and request: what is solved. ``incident`` None is the radiance field of one beam along MU0."""

    radius_um: float = 0.6
    nodes: int = 40
    outgoing: int = 11
    incident: int | None = None
    axis: str = "nodes"

    @property
    def terms(self) -> int:
        """Orders of expansion of the phase matrix."""
        return cases.make_gold_scene(self.radius_um).layers[0].phase_matrix.terms

    @property
    def value(self) -> float:
        """What stands on the axis."""
        varied = AXES[self.axis][2]
        return float(self.terms if varied == "radius_um" else getattr(self, varied))

    def solve(self, options: dict[str, Any]) -> dict[str, Any]:
        """Diagnostics of its solve."""
        common: dict[str, Any] = {"phi": PHI, "nodes": self.nodes, **options}
        scene, out = cases.make_gold_scene(self.radius_um), make_cosines(self.outgoing)
        if self.incident is None:
            return radiance(scene, mu0=MU0, mu=out, **common).diagnostics
        return brdf(scene, mu_i=make_cosines(self.incident), mu_o=out, **common).diagnostics


def make_cosines(count: int) -> Array:
    """The middles of equal intervals from 0 to 1: (count,), never the normal, where most orders vanish.

    >>> make_cosines(2).tolist()
    [0.25, 0.75]
    """
    return (np.arange(count) + 0.5) / count


def list_points(quick: bool = False) -> list[Point]:
    """The points of the four axes, each axis in ascending order."""
    base, points = Point(radius_um=0.3, nodes=12) if quick else Point(), list[Point]()
    for name, (_, _, varied, full, small, _) in AXES.items():
        values: Sequence[float] = small if quick else full
        along = [replace(base, axis=name, **dict[str, Any]({varied: value})) for value in values]
        points += sorted(along, key=lambda point: point.value)
    return points


def list_configurations(threads: int = 2) -> dict[str, dict[str, Any]]:
    """By name what the solver is told: the paper's 2 and, where there is an OpenCL device, 5; OpenMP if more than one
    of its ``threads`` is asked for. Raises SceneError where the compiled core has no OpenMP but more threads are."""
    if threads > 1 and not _core.HAS_OPENMP:
        raise SceneError("the compiled core was built without OpenMP: only --threads 1 can be measured")
    found = {each.title: each.options(1) for each in PAPERS if each.refusal() is None}
    return found | ({f"OpenMP, {threads} threads": Papers.OPENMP_FULL.options(threads)} if threads > 1 else {})


@dataclass(frozen=True)
class Measurement:
    """One solve: wall ``seconds`` in total and of each stage of the solver, by the names in its diagnostics;
    ``orders_solved``: the Fourier orders with multiple scattering."""

    point: Point
    configuration: str
    round: int
    seconds: float
    orders_solved: int
    stages: dict[str, float] = field(default_factory=dict)

    @property
    def steps(self) -> dict[str, float]:
        """Seconds of the total, of each step (a stage that is no step of the paper's is one by its own name), and of
        what no stage accounts for.

        >>> Measurement(Point(), "", 0, 4.0, 1, {"fourier sum": 1.0, "reconstruction": 2.0}).steps
        {'total': 4.0, 'reconstruction': 3.0, 'outside the steps': 1.0}
        """
        found = {TOTAL: self.seconds}
        for stage, seconds in self.stages.items():
            step = IN_RECONSTRUCTION.get(stage, stage)
            found[step] = found.get(step, 0.0) + seconds
        return found | {REST: max(0.0, self.seconds - sum(self.stages.values()))}


def make_study(
    points: Sequence[Point], options: dict[str, dict[str, Any]], rounds: tuple[int, int, float], settings: str = ""
) -> Study[Point, str, Measurement]:
    """Every point in every configuration by turns, timed by the solver's own diagnostics."""

    def measure(point: Point, configuration: str, number: int) -> Measurement:
        made = point.solve(options[configuration])
        stages = {name: clock["wall_seconds"] for name, clock in made["stages"].items()}
        before = sum(stages.get(name, 0.0) for name in BEFORE)  # of a clock that starts with the orders
        return Measurement(point, configuration, number, made["wall_seconds"] + before, made["orders"], stages)

    return Study(
        cases=points,
        ways=lambda point: list(options),
        measure=measure,
        name=lambda point, configuration: f"{point.axis} {point.value:g}",
        page=write_page,
        describe=describe_exponents,
        rounds=rounds,
        settings=settings,
    )


@dataclass(frozen=True)
class Fit:
    """t = c x^p: ``exponent`` p with its standard error, that of the scatter about the straight line, so that it holds
    curvature as well as noise; ``factor`` c [s]."""

    exponent: float
    error: float
    factor: float

    def __str__(self) -> str:
        return f"{self.exponent:z.2f} ± {self.error:.2f}"


def fit_exponent(x: Array, seconds: Array) -> Fit | None:
    """Least squares of log t against log x, through the points with x > 0 and a time above 0; None of fewer than 3, or
    of one x alone.

    >>> str(fit_exponent(np.array([1.0, 2.0, 4.0]), np.array([0.5, 4.0, 32.0])))
    '3.00 ± 0.00'
    """
    there = (x > 0.0) & (seconds > 0.0)
    x, seconds = x[there], seconds[there]
    if x.size < FEWEST_POINTS or np.ptp(x) == 0.0:
        return None
    along = np.log(x)
    exponent, intercept = np.polyfit(along, np.log(seconds), 1)
    residual, from_mean = np.log(seconds) - (intercept + exponent * along), along - along.mean()
    error = math.sqrt(float(residual @ residual) / (x.size - 2) / float(from_mean @ from_mean))
    return Fit(float(exponent), error, math.exp(intercept))


def mark_upper_half(x: Array) -> Array:
    """Which points lie in the upper half of the axis, on a logarithmic scale: (points,) of bool. There a constant cost
    weighs least, so the exponent is nearest to that of the term that grows.

    >>> mark_upper_half(np.array([1.0, 4.0, 16.0])).tolist()
    [False, True, True]
    """
    return np.asarray(x >= math.sqrt(float(x.min()) * float(x.max())) * (1.0 - 1e-12))


@dataclass(frozen=True, eq=False)
class Series:
    """Of one step in one configuration, along an axis: x, and median, least and greatest seconds, (points,) each."""

    x: Array
    seconds: Array
    least: Array
    greatest: Array

    def exponent(self, part: Array | slice = slice(None)) -> str:
        """Of the points chosen, with its standard error; a dash where there is no fit."""
        return str(fit_exponent(self.x[part], self.seconds[part]) or "-")


Lines = dict[str, dict[str, Series]]  # configuration: step: line


def collect_series(rows: Sequence[Measurement], axis: str) -> Lines:
    """Of each configuration every step's, the total first, what is outside them last; 0 s where one did not run."""
    found: Lines = {}
    for configuration in dict.fromkeys(row.configuration for row in rows):
        by_value: dict[float, list[dict[str, float]]] = {}
        for row in rows:
            if (row.point.axis, row.configuration) == (axis, configuration):
                by_value.setdefault(row.point.value, []).append(row.steps)
        names = list(dict.fromkeys(name for solves in by_value.values() for solve in solves for name in solve))
        names.sort(key=lambda name: (name != TOTAL, name == REST))
        x, found[configuration] = np.array(sorted(by_value)), {}
        for name in names:
            times = [[solve.get(name, 0.0) for solve in by_value[value]] for value in x.tolist()]
            parts = (np.array([of(row) for row in times]) for of in (np.median, np.min, np.max))
            found[configuration][name] = Series(x, *parts)
    return found


PAGE, CSV = "figures.md", "measurements.csv"
CSV_COLUMNS = (
    *("axis", "value", "configuration", "round", "radius_um", "terms", "nodes", "outgoing", "incident"),
    *("orders_solved", "total_s"),
)
OTHERS = ("#666666", "#00a0a8", "#c05a8f", "#8a7a00", "#4a90e2", "#9b9b9b")  # steps of our own, in their order
CONFIGURATIONS = ("#1f4e79", "#d98200", "#2a8f5b", "#b3262e", "#7a4fa3")


def write_page(rows: Sequence[Measurement], folder: Path, settings: str) -> list[Path]:
    """The figures, figures.md and measurements.csv in the folder. Raises MissingExtraError without matplotlib."""
    paths, texts = list[Path](), list[str]()
    for axis in dict.fromkeys(row.point.axis for row in rows):
        found, (title, figures) = collect_series(rows, axis), AXES[axis][:2]
        for number, draw in zip(figures, (draw_total_times, draw_step_times), strict=True):
            paths.append(folder / f"figure_{number}.png")
            save(draw(axis, found), paths[-1])
        orders = {row.point.value: row.orders_solved for row in rows if row.point.axis == axis}
        totals = [
            [f"{value:g}", str(orders[value]), *(f"{1e3 * steps[TOTAL].seconds[k]:.1f}" for steps in found.values())]
            for k, value in enumerate(next(iter(found.values()))[TOTAL].x.tolist())
        ]
        texts += [
            f"## Figures {figures[0]} and {figures[1]}: {title}\n",
            f"![total time](figure_{figures[0]}.png)\n\n![time of each step](figure_{figures[1]}.png)\n",
            make_markdown_table(*make_exponent_table(axis, found)),
            make_markdown_table([axis, "orders solved", *(f"total [ms], {name}" for name in found)], totals),
        ]
    libraries = {f"{each.internal_api} {each.version}" for each in find_blas_libraries()}
    solves = f"{len(rows)} solves, {sum(row.seconds for row in rows):.0f} s"
    facts = [*list_run_facts(settings), f"linear algebra: {', '.join(sorted(libraries)) or 'unknown'}", solves]
    head = "# Cost growth: figures 2 to 9 of the GPU paper\n", make_markdown_list(facts)
    more = "Written by `python -m bench.cost`; docs/explanation/cost.md says what the columns mean.\n"
    write_text(folder / PAGE, "\n".join([*head, more, *texts]).rstrip() + "\n")
    stages = list(dict.fromkeys(name for row in rows for name in row.stages))
    header = [*CSV_COLUMNS, *(f"{name.replace(' ', '_')}_s" for name in stages)]
    write_rows(folder / CSV, header, [list_csv_cells(row, stages) for row in rows])
    return [*paths, folder / PAGE, folder / CSV]


def list_csv_cells(row: Measurement, stages: Sequence[str]) -> list[object]:
    """One solve's row: CSV_COLUMNS, then seconds of each stage, empty where it did not run."""
    point = row.point
    return [
        *(point.axis, f"{point.value:g}", row.configuration, row.round),
        *(point.radius_um, point.terms, point.nodes, point.outgoing, point.incident),
        *(row.orders_solved, f"{row.seconds:.6f}"),
        *(f"{row.stages[name]:.6f}" if name in row.stages else "" for name in stages),
    ]


def make_exponent_table(axis: str, found: Lines) -> tuple[list[str], list[list[str]]]:
    """Header, and a row a step: the paper's claim, and in each configuration the exponents of all points and of the
    upper half, and the step's share of the total at the last point."""
    values, claims = next(iter(found.values()))[TOTAL].x, find_claims(axis)
    ends = [f"{part[0]:g} to {part[-1]:g}" for part in (values, values[mark_upper_half(values)])]
    header, rows = ["step", "the paper"], list[list[str]]()
    for name in found:
        header += [f"{name}: all ({ends[0]})", f"upper half ({ends[1]})", f"share at {values[-1]:g}"]
    for step in dict.fromkeys(name for lines in found.values() for name in lines):
        rows.append([step, claims.get(step, "-")])
        for lines in found.values():
            line = lines.get(step)
            if line is None:
                rows[-1] += ["-", "-", "-"]
            else:
                fraction = line.seconds[-1] / lines[TOTAL].seconds[-1]
                rows[-1] += [line.exponent(), line.exponent(mark_upper_half(line.x)), f"{fraction:.1%}"]
    return header, rows


def find_claims(axis: str) -> dict[str, str]:
    """What the paper says of the total and of each of its steps."""
    return dict(zip((TOTAL, *STEPS), AXES[axis][5], strict=True))


def describe_exponents(rows: Sequence[Measurement]) -> str:
    """The exponents for a terminal: a block an axis, a line a step; and the configuration that was not measured."""
    texts = []
    for axis in dict.fromkeys(row.point.axis for row in rows):
        found = collect_series(rows, axis)
        texts.append(f"  {AXES[axis][0]}")
        texts.append(f"    {'exponent of':20}{'the paper':42}" + "".join(f"{name:>20}" for name in found))
        for step, stated, *cells in make_exponent_table(axis, found)[1]:
            texts.append(f"    {step:20}{stated:42}" + "".join(f"{cell:>20}" for cell in cells[::3]))
    refused = [reason for each in PAPERS if (reason := each.refusal()) is not None]
    return "\n".join([*texts, *(f"  not measured: {reason}" for reason in refused)])


def draw_total_times(axis: str, found: Lines) -> "Figure":
    """Total time, a line a configuration, each with its fit. Raises MissingExtraError."""
    parts = list[Curve]()
    for colour, (name, steps) in zip(CONFIGURATIONS, found.items(), strict=False):
        parts += describe_series(steps[TOTAL], colour, len(parts), f"{name}: exponent {steps[TOTAL].exponent()}")
    title = f"Total time. Exponent in the paper: {find_claims(axis)[TOTAL]}"
    return draw_picture(Picture([[describe_panel(axis, parts, title, legend="best", letters=9)]], 6.4, 4.2))


def draw_step_times(axis: str, found: Lines) -> "Figure":
    """Time of each step, a panel a configuration. Raises MissingExtraError."""
    claims, panels = find_claims(axis), []
    for name, lines in found.items():
        steps = {step: line for step, line in lines.items() if step != TOTAL and line.seconds.any()}
        parts, colours = list[Curve](), choose_colours(list(steps))
        for step, line in steps.items():
            stated = f" (paper: {claims[step]})" if step in claims else ""
            parts += describe_series(line, colours[step], len(parts), f"{step}: exponent {line.exponent()}{stated}")
        panels.append(describe_panel(axis, parts, name, legend="below", letters=8))
    return draw_picture(Picture([panels], 1.2 + 4.2 * len(found), 5.4, share_y=True))


def choose_colours(steps: Sequence[str]) -> dict[str, str]:
    """Of each step: the paper's have theirs everywhere."""
    ours = [step for step in steps if step not in COLOURS and step != REST]
    return COLOURS | {step: OTHERS[index % len(OTHERS)] for index, step in enumerate(ours)} | {REST: FAINT}


def describe_series(line: Series, colour: str, count: int, label: str) -> list[Curve]:
    """Medians with a bar from the least to the greatest, and the fitted power law dashed; ``count`` curves before it
    say which marker is the next."""
    ran = line.seconds > 0.0
    x, median = line.x[ran], line.seconds[ran]
    bars = np.array([median - line.least[ran], line.greatest[ran] - median])
    found = [Curve(x, median, label, colour, marker=MARKERS[count // 2 % len(MARKERS)], width=1.3, sigma=bars)]
    fit = fit_exponent(x, median)
    law = np.full(x.size, np.nan) if fit is None else fit.factor * x**fit.exponent
    return [*found, Curve(x, law, colour=colour, dash="--", width=0.9, opacity=0.7)]


def describe_panel(axis: str, parts: Sequence[Curve], title: str, **legend: Any) -> PlotPanel:
    """Seconds over what is varied, ticks at the points themselves."""
    values = sorted({float(x) for part in parts for x in part.x})
    along = Axis(str(AXES[axis][0]), log=10.0, ticks=values, words=[f"{value:g}" for value in values])
    return PlotPanel(parts, along, Axis("seconds", log=10.0), title, **legend)


def measure_costs(options: Any) -> None:
    """The study that the command line asks for."""
    reported = list_configurations(options.threads)
    require_pictures()
    points, settings = list_points(options.quick), f"{'quick, ' if options.quick else ''}{' against '.join(reported)}"
    for how in reported.values():
        points[0].solve(how)  # the first solve of a process loads modules
    carry_out(make_study(points, reported, ROUNDS_QUICK if options.quick else ROUNDS, settings), options.output)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the figures; returns the exit code."""
    command = make_command(
        "cost",
        "figures 2 to 9 of the GPU paper, how the cost grows, with exponents, measured on this machine",
        ("python -m bench.cost --quick", "few small scenes: seconds"),
        ("python -m bench.cost --threads 8", "OpenMP on 8 threads"),
    )
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    threads = make_option_reader("threads")
    command.add_argument("--threads", metavar="N", type=threads, default=2, help="of OpenMP; default: 2")
    return run_command(command, measure_costs, arguments)


if __name__ == "__main__":
    sys.exit(main())
