"""Tables 1 to 3 and figure 1 of the GPU paper, measured in its six configurations: `python -m bench.tables`.

Table 1 pairs the paper's kernels, sequential or parallel (OpenCL), with EIGEN on one thread, without and with vector
instructions, or with MAGMA on the graphics card. Here EIGEN is LAPACK from OpenBLAS, on the least instructions that it
has code for or on all of the processor's, and MAGMA is the package's own products and inverses on the OpenCL device.
No eigensolver runs there, so configurations 3 and 6 solve without eigenvectors: by impedance doubling, or by the
invariance equation where only the top of something very thick is seen. All others solve by modes, as the paper does.

Table 2: the benchmark of Wauben and Hovenier, as in Siewert, JQSRT 64, 227 (2000), problem IIA. Table 3: gold spheres
of radius 0.6 um at 400 nm, optical thickness 100 over black, one beam at mu0 = 0.6, 11 zenith and 19 azimuth angles.
The BRDF is of the same layer; the paper prints neither its incident nor its outgoing directions, so those are ours.
"""

import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench import cases
from bench.study import (
    COLOURS,
    Study,
    Times,
    add_study,
    carry_out,
    list_run_facts,
    make_command,
    make_markdown_list,
    make_markdown_table,
    run_command,
    write_text,
)
from vrte.basics.arrays import Array
from vrte.basics.errors import AccuracyError, DeviceError, MissingExtraError, SceneError
from vrte.calls.brdf import brdf
from vrte.calls.radiance import radiance
from vrte.commands.common import make_option_reader
from vrte.pictures.figures import FAINT, require_pictures, save
from vrte.results.brdf import Brdf
from vrte.results.field import Field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bench.processes import Child, Reply

SEQUENTIAL, OPENCL, OPENMP = "sequential", "OpenCL", "OpenMP"
BASELINE, FULL, DEVICE = "LAPACK, baseline SIMD", "LAPACK, full SIMD", "on the OpenCL device"
X86 = ("x86_64", "amd64", "i686", "i386", "x86")  # what platform.machine() says, in small letters


class Configuration(Enum):
    """kernels, linear_algebra: as in Table 1; backend, algorithm: what `radiance` and `brdf` are told."""

    ONE = "1", SEQUENTIAL, BASELINE, "sequential", "modes"
    TWO = "2", SEQUENTIAL, FULL, "sequential", "modes"
    THREE = "3", SEQUENTIAL, DEVICE, "sequential+device", "auto"
    FOUR = "4", OPENCL, BASELINE, "opencl+lapack", "modes"
    FIVE = "5", OPENCL, FULL, "opencl+lapack", "modes"
    SIX = "6", OPENCL, DEVICE, "opencl", "auto"
    OPENMP_BASELINE = "OpenMP baseline", OPENMP, BASELINE, "openmp", "modes"
    OPENMP_FULL = "OpenMP full", OPENMP, FULL, "openmp", "modes"
    DEFAULT = "default", OPENMP, FULL, "openmp", "auto"

    def __init__(self, label: str, kernels: str, linear_algebra: str, backend: str, algorithm: str) -> None:
        self.label, self.kernels, self.linear_algebra = label, kernels, linear_algebra
        self.backend, self.algorithm = backend, algorithm
        self.simd = "baseline" if linear_algebra == BASELINE else "full"  # which of the two processes it runs in
        self.needs_device = kernels == OPENCL or linear_algebra == DEVICE
        self.title = f"configuration {label}" if label.isdecimal() else label  # of a row or a column

    def options(self, threads: int) -> dict[str, Any]:
        """What `radiance` and `brdf` are told; ``threads`` are those of OpenMP. LAPACK beside OpenCL has one, as in the
        paper.

        >>> Configuration.TWO.options(8)
        {'algorithm': 'modes', 'backend': 'sequential', 'threads': 1}
        """
        count = threads if self.kernels == OPENMP else 1
        return {"algorithm": self.algorithm, "backend": self.backend, "threads": count}

    def refusal(self) -> str | None:
        """Why this machine cannot run it, None where it can."""
        if self.simd == "baseline" and platform.machine().lower() not in X86:
            return f"{self.title} needs the baseline SIMD of an x86 processor, and this is {platform.machine()}"
        if self.needs_device and (reason := explain_missing_device()) is not None:
            return f"{self.title} needs an OpenCL device: {reason}"
        return None


def explain_missing_device() -> str | None:
    """Why there is no OpenCL device to take, None where there is one."""
    from vrte.cl.device import find_chosen_device

    try:
        find_chosen_device()
    except (DeviceError, MissingExtraError) as error:
        return str(error)
    return None


def choose_configurations(labels: str | None = None) -> tuple[tuple[Configuration, ...], list[str]]:
    """The configurations named, or all that this machine can run; and of all, why the others cannot.

    Raises SceneError for a name that is none, and for one that this machine cannot run.

    >>> [configuration.label for configuration in choose_configurations("2, OpenMP full")[0]]
    ['2', 'OpenMP full']
    """
    known = {each.label: each for each in Configuration}
    names = list(known) if labels is None else [label.strip() for label in labels.split(",")]
    for name in names:
        if name not in known:
            raise SceneError(f"there is no configuration {name!r}; there are {', '.join(known)}")
    refusals = {known[name]: known[name].refusal() for name in names}
    refused = [reason for reason in refusals.values() if reason is not None]
    if labels is not None and refused:
        raise SceneError(refused[0])
    return tuple(each for each, reason in refusals.items() if reason is None), refused


# Siewert's tables, quoted, mu0 0.6, phi 90: I, Q, U, V at mu 0.5 up at the top, and at mu 0.2 down at tau 1
SIEWERT_UP = [1.24626e-1, 5.12123e-3, -8.04140e-3, 7.49254e-5]
SIEWERT_DOWN = [2.03778e-1, 8.17683e-3, -1.52561e-2, 1.02806e-4]
PUBLISHED_TO = 1e-5  # relative: six digits are printed
LEVELS = [0.0, 0.125, 0.25, 0.5, 0.75, 0.875, 1.0]  # optical depths of Siewert's tables
TABLE_2, TABLE_3, BRDF = "table 2", "table 3", "brdf"


@dataclass(frozen=True)
class Problem:
    """One scene and request. ``name`` is the key of the tables, ``title`` their caption; ``radius_um`` of the gold,
    None of Siewert's scene; ``directions`` of a BRDF: incident and outgoing cosines, azimuths."""

    name: str
    title: str
    nodes: int
    radius_um: float | None = None
    directions: tuple[int, int, int] | None = None
    is_the_papers: bool = True

    def solve(self, options: dict[str, Any]) -> Field | Brdf:
        """The field at (7, 20, 3) depths and directions of Table 2, at (1, 11, 19) of Table 3, or the BRDF."""
        how = {"nodes": self.nodes, **options}
        if self.radius_um is None:
            cosines, flux = np.linspace(0.1, 1.0, 10), (np.pi, 0.0, 0.0, 0.0)
            mu, phi = np.concatenate([cosines, -cosines]), [0.0, 90.0, 180.0]
            return radiance(cases.find_scene("spheroids"), mu0=0.6, stokes=flux, mu=mu, phi=phi, tau=LEVELS, **how)
        gold = cases.make_gold_scene(self.radius_um)
        if self.directions is None:
            mu, phi = np.linspace(0.05, 1.0, 11), np.arange(0.0, 181.0, 10.0).tolist()
            return radiance(gold, mu0=0.6, mu=mu, phi=phi, tau=0.0, **how)
        into, out, around = self.directions
        return brdf(gold, np.linspace(0.05, 1.0, into), np.linspace(0.05, 1.0, out), np.linspace(0, 360, around), **how)


FULL_SIZE = (
    Problem(TABLE_2, "Siewert's scene, 30 nodes, 12 orders, 7 depths, 20 x 3 directions", 30),
    Problem(TABLE_3, "gold, radius 0.6 um, 400 nm, thickness 100, 40 nodes, mu0 0.6, 11 x 19 directions", 40, 0.6),
    Problem(BRDF, "the Mueller BRDF of the gold layer, 40 nodes, 20 x 20 x 37 directions", 40, 0.6, (20, 20, 37)),
)
SMALL = (
    FULL_SIZE[0],
    replace(FULL_SIZE[1], title="gold, radius 0.2 um, 12 nodes", nodes=12, radius_um=0.2, is_the_papers=False),
    Problem(BRDF, "the same, 4 x 4 x 5 directions", 12, 0.2, (4, 4, 5), is_the_papers=False),
)
# The paper's seconds, of an Intel Core i7 and an Nvidia GTX 580 in a laptop. Table 3 is called Table 4 in the paper's
# text; the total of configuration 6 is as printed, its steps add up to 11.28.
MACHINE = "Intel Core i7 and Nvidia GTX 580"
STEPS = ("homogeneous", "particular", "boundary", "reconstruction")
TOTAL, ASSEMBLY, OTHER = "total", "assembly", "other"
OWN_STEPS = (*STEPS, ASSEMBLY, OTHER)
LABELS = ("1", "2", "3", "4", "5", "6")
SECONDS = {
    key: dict(zip(LABELS, printed, strict=True))
    for key, printed in {
        (TABLE_2, TOTAL): (2.79, 2.74, 2.94, 0.99, 0.97, 1.18),
        (TABLE_3, "homogeneous"): (6.50, 6.11, 9.18, 6.07, 5.75, 8.43),
        (TABLE_3, "particular"): (0.04, 0.04, 0.07, 0.04, 0.04, 0.07),
        (TABLE_3, "boundary"): (0.24, 0.24, 0.25, 0.24, 0.24, 0.25),
        (TABLE_3, "reconstruction"): (22.1, 22.0, 22.1, 2.52, 2.51, 2.53),
        (TABLE_3, TOTAL): (28.9, 28.4, 31.5, 8.88, 8.56, 11.18),
    }.items()
} | {(BRDF, TOTAL): {"2": 7200.0, "5": 900.0}}  # "close to two hours", "15 minutes"
# Stages of the solver that are part of a step of the paper. Where no eigenproblem is solved, the reflection and
# transmission of the layer, found with the beams in it, stand for the homogeneous and the particular solution together,
# and joining for the boundary conditions.
WITHOUT_EIGENVECTORS = ("doubling", "invariance")
IN_RECONSTRUCTION = {"fourier sum": "reconstruction", "single scattering": "reconstruction"}  # (1:12), Q of (1:38)
STEP_OF_STAGE = {
    **{name: name for name in (*STEPS, ASSEMBLY)},
    **IN_RECONSTRUCTION,
    "joining": "boundary",
    **dict.fromkeys(WITHOUT_EIGENVECTORS, "homogeneous"),
}


def split_into_steps(seconds: float, stages: Mapping[str, float]) -> dict[str, float]:
    """Seconds of OWN_STEPS; what no step accounts for, planning and transfers among it, is OTHER.

    >>> split_into_steps(10.0, {"doubling": 4.0, "joining": 1.0, "fourier sum": 2.0, "planning": 1.0})["other"]
    3.0
    """
    found = dict.fromkeys(OWN_STEPS, 0.0)
    for stage, spent in stages.items():
        found[STEP_OF_STAGE.get(stage, OTHER)] += spent
    found[OTHER] += max(0.0, seconds - sum(stages.values()))
    return found


ROUNDS, ROUNDS_QUICK = 9, 2  # after a first one, which is checked and not timed
AGREE_TO = 1e-9  # relative to the largest: every configuration with the default one


@dataclass(frozen=True)
class Check:
    """Of one answer: ``gap`` to the default's, relative to the largest; ``published``: the largest relative error of
    Siewert's quoted values, None of other problems; ``orders_by``: Fourier orders by algorithm."""

    gap: float
    published: float | None
    orders_by: dict[str, int]

    @property
    def passed(self) -> bool:
        """Whether the answer counts."""
        return self.gap <= AGREE_TO and (self.published is None or self.published <= PUBLISHED_TO)


@dataclass(frozen=True, eq=False)
class Solved:
    """A problem in a configuration, once; a ``check`` in the first round alone, which is not timed."""

    problem: Problem
    configuration: Configuration
    reply: "Reply"
    check: Check | None = None


@dataclass(frozen=True)
class Measured:
    """All solves, and what they come to."""

    rows: Sequence[Solved]

    @property
    def problems(self) -> list[Problem]:
        """That were solved, in order."""
        return list(dict.fromkeys(row.problem for row in self.rows))

    @property
    def configurations(self) -> list[Configuration]:
        """In which they were, in order."""
        return list(dict.fromkeys(row.configuration for row in self.rows))

    def select(self, problem: str, configuration: Configuration) -> list[Solved]:
        """Solves of a problem in a configuration; the first has a check."""
        return [row for row in self.rows if (row.problem.name, row.configuration) == (problem, configuration)]

    def check(self, problem: str, configuration: Configuration) -> Check:
        """What the answer was like."""
        found = self.select(problem, configuration)[0].check
        assert found is not None
        return found

    def times(self, problem: str, configuration: Configuration, step: str = TOTAL) -> Times | None:
        """Of the whole solve or of a step of it; None where it was not measured."""
        timed = [row.reply for row in self.select(problem, configuration) if row.check is None]
        steps = [{TOTAL: each.seconds, **split_into_steps(each.seconds, each.stages)} for each in timed]
        return Times.of([each[step] for each in steps]) if steps else None

    def printed(self, problem: str, configuration: Configuration, step: str = TOTAL) -> float | None:
        """Seconds in the paper; None where it has none, and of a scene that is not the paper's."""
        asked = next(each for each in self.problems if each.name == problem)
        return SECONDS.get((problem, step), {}).get(configuration.label) if asked.is_the_papers else None

    def is_otherwise(self, configuration: Configuration, step: str) -> bool:
        """Whether a step of Table 3 is none of the paper's there: orders were solved without eigenvectors."""
        stages = self.select(TABLE_3, configuration)[-1].reply.stages
        return step in STEPS and any(stages.get(name, 0.0) > 0.0 for name in WITHOUT_EIGENVECTORS)


def make_study(
    children: Mapping[str, "Child"],
    problems: Sequence[Problem],
    configurations: Sequence[Configuration],
    threads: int = 2,
    rounds: int = ROUNDS,
    refused: Sequence[str] = (),
    settings: str = "",
) -> Study[Problem, Configuration, Solved]:
    """Every problem in every configuration, in processes of two SIMD settings, one round after another."""
    from bench.processes import Task, describe_processes

    right: dict[str, Array] = {}

    def measure(problem: Problem, configuration: Configuration, number: int) -> Solved:
        if problem.name not in right:
            answer = children["full"].solve(Task(problem, {}, True)).answer
            assert answer is not None
            right[problem.name] = answer
        reply = children[configuration.simd].solve(Task(problem, configuration.options(threads), number == 0))
        check = check_answer(problem, reply, right[problem.name]) if number == 0 else None
        return Solved(problem, configuration, reply, check)

    def write(rows: list[Solved], folder: Path, said: str) -> list[Path]:
        facts = [*describe_processes(children, configurations), *(f"not measured: {reason}" for reason in refused)]
        return write_page(Measured(rows), folder, said, facts)

    return Study(
        cases=problems,
        ways=lambda problem: configurations,
        measure=measure,
        name=lambda problem, configuration: f"{problem.name}, {configuration.title}",
        page=write,
        describe=lambda rows: "\n".join(make_totals_table(Measured(rows), problem.name) for problem in problems),
        require=require_right_answers,
        rounds=(1 + rounds, 1 + rounds, 0.0),
        settings=settings,
    )


def measure_difference(answer: Array, reference: Array) -> float:
    """The largest, relative to the largest of the reference."""
    return float(np.abs(answer - reference).max() / np.abs(reference).max())


def check_answer(problem: Problem, reply: "Reply", reference: Array) -> Check:
    """An answer against the default's, and against Siewert's values where it has them."""
    answer, published = reply.answer, None
    assert answer is not None
    if problem.name == TABLE_2:  # mu 0.5 up at tau 0, mu 0.2 down at tau 1, phi 90
        quoted = np.concatenate([answer[0, 4, 1], answer[-1, 11, 1]]) / np.array(SIEWERT_UP + SIEWERT_DOWN)
        published = measure_difference(quoted, np.ones(8))
    return Check(measure_difference(answer, reference), published, reply.orders_by)


def require_right_answers(rows: Sequence[Solved]) -> None:
    """Raises AccuracyError where an answer does not count."""
    wrong = [
        f"{row.problem.name} in {row.configuration.title} (off by {row.check.gap:.1e}"
        + (")" if row.check.published is None else f", from Siewert's values by {row.check.published:.1e})")
        for row in rows
        if row.check is not None and not row.check.passed
    ]
    if wrong:
        raise AccuracyError(f"the answers differ by more than {AGREE_TO:g}: {', '.join(wrong)}")


PAGE, FIGURE = "tables.md", "figure_1.png"
MARK = "\\*"
COUNTED_FROM = Configuration.TWO  # what "relative" is relative to: the paper's sequential solver
CONFIGURATIONS_NOTE = """\
The same OpenBLAS twice: baseline SIMD is `OPENBLAS_CORETYPE=Prescott`, in a process of its own; the compiled kernels
are the same in both. "On the OpenCL device" are products and inverses of all orders at once. No eigensolver runs there,
so 3 and 6 solve without eigenvectors (`algorithm="auto"`: impedance doubling, or invariance where only the top of
something very thick is seen); 1, 2, 4, 5 and the OpenMP rows solve by `algorithm="modes"`, as the paper does.
`default` is a call with no options but directions, nodes and threads: OpenMP, and the algorithm of its own rule.
"""
TABLE_NOTE = f"""\
Written by `python -m bench.tables`; docs/reference/tables.md says what is measured and how. Medians of the rounds;
in brackets the least and the greatest. The paper's times are those of an {MACHINE}.
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


def write_page(found: Measured, folder: Path, settings: str, facts: Sequence[str]) -> list[Path]:
    """figure_1.png and tables.md in the folder; ``facts``: what linear algebra and device were at work, and
    what was not measured. Raises OSError, MissingExtraError without matplotlib."""
    paths = [folder / name for name in (FIGURE, PAGE)]
    save(draw_step_costs(found), paths[0])
    rows = [[c.label, c.kernels, c.linear_algebra, f"`{c.backend}`", f"`{c.algorithm}`"] for c in found.configurations]
    blocks = [
        "# Tables 1 to 3 and figure 1 of the GPU paper\n",
        make_markdown_list([*list_run_facts(settings), *facts]),
        TABLE_NOTE,
        "## Table 1: the configurations\n",
        make_markdown_table(["configuration", "kernels", "linear algebra", "backend", "algorithm"], rows),
        CONFIGURATIONS_NOTE,
    ]
    for problem in found.problems:
        title = f"## {problem.name.capitalize() if problem.name != BRDF else 'BRDF'}: {problem.title}\n"
        steps = [*make_step_tables(found), f"![figure 1]({FIGURE})\n"] if problem.name == TABLE_3 else []
        totals = [] if steps else [make_totals_table(found, problem.name)]
        blocks += [title, *steps, *totals, *([BRDF_NOTE] if problem.name == BRDF else [])]
    write_text(paths[1], "\n".join(blocks).rstrip() + "\n")
    return paths


def make_totals_table(found: Measured, problem: str) -> str:
    """A row a configuration: our time, the paper's, each also relative to configuration 2, and the ratio of both."""
    ours, theirs = found.times(problem, COUNTED_FROM), found.printed(problem, COUNTED_FROM)
    rows = []
    for configuration in found.configurations:
        times, printed = found.times(problem, configuration), found.printed(problem, configuration)
        if times is None:
            continue
        check = found.check(problem, configuration)
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
    """Our times of Table 3 step by step, the paper's, and their ratios: a column a configuration. Steps that are not
    the same have a mark, and no ratio."""
    times = {
        each: {step: spent for step in (*OWN_STEPS, TOTAL) if (spent := found.times(TABLE_3, each, step)) is not None}
        for each in found.configurations
    }
    shown = [each for each, steps in times.items() if steps]
    printed = [each for each in shown if each.label in LABELS]
    ours = [
        [step, *(f"{1e3 * times[c][step].median:.2f}" + f" {MARK}" * found.is_otherwise(c, step) for c in shown)]
        for step in OWN_STEPS
    ]
    ours.append([TOTAL, *(say_time_spread(times[each][TOTAL]) for each in shown)])
    theirs = [
        [step, *(say_seconds(found.printed(TABLE_3, each, step)) for each in printed)] for step in (*STEPS, TOTAL)
    ]

    def compare(each: Configuration, step: str) -> str:
        if found.is_otherwise(each, step):
            return "-"
        return say_ratio(found.printed(TABLE_3, each, step), times[each][step].median)

    ratios = [[step, *(compare(each, step) for each in printed)] for step in (*STEPS, TOTAL)]
    blocks = ["Ours [ms]:\n", make_markdown_table(["step", *(each.label for each in shown)], ours)]
    blocks += [MARK_NOTE, STEPS_NOTE] if any(found.is_otherwise(each, STEPS[0]) for each in shown) else [STEPS_NOTE]
    for caption, rows in (("The paper [s]:\n", theirs), ("The paper / ours:\n", ratios)):
        blocks += [caption, make_markdown_table(["step", *(each.label for each in printed)], rows)]
    return [*blocks, make_totals_table(found, TABLE_3)]


def say_time_spread(times: Times) -> str:
    """Median time in milliseconds, in brackets the least and the greatest.

    >>> say_time_spread(Times(0.0123, 0.012, 0.02, 9))
    '12.3 (12.0 to 20.0)'
    """
    return f"{1e3 * times.median:.1f} ({1e3 * times.least:.1f} to {1e3 * times.greatest:.1f})"


def say_seconds(seconds: float | None) -> str:
    """As the paper prints them; a dash for none."""
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


def draw_step_costs(found: Measured) -> "Figure":
    """Figure 1, the cost of each step in each configuration: the paper's panel in seconds and ours in milliseconds,
    each bar with its total and how often that of configuration 2 it is."""
    require_pictures()
    from matplotlib.figure import Figure

    theirs, ours = make_printed_bars(), make_measured_bars(found)
    figure = Figure(figsize=(4.6 + 0.85 * len(ours), 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [len(theirs), max(3, len(ours))]})
    title = "vrte, here" if found.problems[-1].is_the_papers else "vrte, here, a smaller scene"
    totals = {label: sum(steps.values()) for label, steps in ours.items()}
    draw_stacked_bars(left, theirs, SECONDS[TABLE_3, TOTAL], 1.0, "seconds", f"The paper: {MACHINE}")
    draw_stacked_bars(right, ours, totals, 1e3, "milliseconds", title)
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=8, frameon=False)
    return figure


def make_printed_bars() -> Bars:
    """Table 3 as the paper prints it."""
    return {label: {step: SECONDS[TABLE_3, step][label] for step in STEPS} for label in LABELS}


def make_measured_bars(found: Measured) -> Bars:
    """Medians of each step of Table 3."""
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
    for index, (label, top) in enumerate(low.items()):
        relative = "" if whole is None else f"\n{totals[label] / whole:.2f} x"
        text = f"{scale * totals[label]:.3g}{relative}"
        panel.annotate(text, (index, top), (0, 2), textcoords="offset points", ha="center", fontsize=8)
    panel.set_xticks(range(len(bars)), [label.replace(" ", "\n") for label in bars], fontsize=8)
    panel.set_ylim(0.0, 1.18 * max(low.values(), default=1.0))
    panel.set_ylabel(unit)
    panel.set_title(title, fontsize=10)
    panel.grid(axis="y", color=FAINT, linewidth=0.5, alpha=0.7)
    panel.set_axisbelow(True)


def measure_tables(options: Any) -> None:
    """The study that the command line asks for."""
    from bench.processes import start_processes

    chosen, refused = choose_configurations(options.configurations)
    require_pictures()
    rounds, problems = (ROUNDS_QUICK, SMALL) if options.quick else (ROUNDS, FULL_SIZE)
    settings = f"{'quick, ' if options.quick else ''}{rounds} rounds, OpenMP on {options.threads} threads"
    with start_processes(["full", *(each.simd for each in chosen)]) as children:
        carry_out(make_study(children, problems, chosen, options.threads, rounds, refused, settings), options.output)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures the tables; returns the exit code."""
    command = make_command(
        "tables",
        "the tables and figure 1 of the GPU paper, measured on this machine",
        ("python -m bench.tables --quick", "small scenes instead of the paper's: seconds"),
        ('python -m bench.tables --configurations "2,5"', "these alone: one that this machine cannot run is an error"),
    )
    add_study(command, "few small scenes instead of the paper's: seconds", fresh=False)
    command.add_argument(
        "--configurations", metavar="C,C,...", help='such as "1,2,5"; default: all that this machine can run'
    )
    threads = make_option_reader("threads")
    command.add_argument("--threads", metavar="N", type=threads, default=2, help="of OpenMP; default: 2")
    return run_command(command, measure_tables, arguments)


if __name__ == "__main__":
    from bench import tables  # whose classes the processes know

    sys.exit(tables.main())
