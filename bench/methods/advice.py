"""What to take for how much: the Pareto front of a scene, and a sentence a scene; of vrte, its peers beside it; and how
well method="auto" chose, its runs against the quickest of all others that were good enough."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from bench.methods.rows import REFUSED, Row, group_rows
from bench.study import make_markdown_table
from vrte.request.how import AUTO, EXACT, METHODS

TARGETS = (1e-3, 1e-6, 1e-10)
COARSE = 1e-2  # what synthetic iteration is held to
EXPONENTS, EXPONENTS_QUICK = (1, 2, 3, 4, 6, 8, 10), (2, 3, 6)  # of the accuracies that auto is asked for
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
    for row in sorted(list_candidates(rows), key=lambda row: (row.seconds, row.worst)):
        if row.worst < (found[-1].worst if found else math.inf):  # NaN is no better than anything
            found.append(row)
    return found


def list_candidates(rows: Sequence[Row]) -> list[Row]:
    """What can be advised: runs of vrte that were measured."""
    return [row for row in rows if row.is_measured and not row.is_peer]


def find_quickest_candidate(rows: Sequence[Row], target: float) -> Row | None:
    """The run of vrte of least time whose error of every Stokes parameter is at most the target; None without one."""
    return find_quickest(list_candidates(rows), target)


def find_quickest(rows: Sequence[Row], target: float) -> Row | None:
    """The one of least time that reaches the target."""
    return min((row for row in rows if row.worst <= target), key=lambda row: row.seconds, default=None)


def find_reference_uncertainty(rows: Sequence[Row]) -> float:
    """What the reference of these rows is uncertain by; infinite where none was measured."""
    return max((row.reference_within for row in rows if row.is_measured), default=math.inf)


def advise_on_target(rows: Sequence[Row], target: float) -> str:
    """What to take for one target."""
    if find_reference_uncertainty(rows) > target:
        return (
            f"for {target:.0e} nothing can be told (the reference is known to {find_reference_uncertainty(rows):.0e})"
        )
    row = find_quickest_candidate(rows, target)
    if row is None:
        return f"for {target:.0e} take none of these"
    return f"for {target:.0e} take {row.curve} with {row.setting} ({say_run_time(row.seconds)}, error {row.worst:.0e})"


def advise_on_scene(rows: Sequence[Row]) -> str:
    """Of a scene, for all targets."""
    text = ", ".join(advise_on_target(rows, target) for target in TARGETS)
    return text[0].upper() + text[1:] + "."


def compare_with_exact(rows: Sequence[Row], method: str = "synthetic-iteration", target: float = COARSE) -> str:
    """How a method stands to the exact one where both are good enough."""
    exact, other = (
        find_quickest_candidate([row for row in rows if row.method == name], target) for name in (EXACT, method)
    )
    if exact is None:
        return f"At {target:.0e}: {EXACT} was not run."
    if other is None:
        best = min((row.worst for row in rows if row.is_measured and row.method == method), default=None)
        why = "it was not measured" if best is None else f"its least error is {best:.1e}"
        return f"{method} does not reach {target:.0e}: {why}."
    return (
        f"At {target:.0e} {method} ({other.curve}, {other.setting}) takes {say_run_time(other.seconds)}, {EXACT} "
        f"({exact.curve}, {exact.setting}) {say_run_time(exact.seconds)}, "
        f"{exact.seconds / other.seconds:.2g} times as much."
    )


def compare_with_peers(rows: Sequence[Row], target: float) -> str:
    """How each peer that reaches the target stands to what would be advised; empty where none does."""
    ours, texts = find_quickest_candidate(rows, target), []
    for name, some in group_rows((row for row in rows if row.is_peer and row.is_measured), "curve").items():
        found = find_quickest(some, target)
        if found is not None and find_reference_uncertainty(rows) <= target:
            beside = f", {found.seconds / ours.seconds:.2g} times as long" if ours else ""
            texts.append(f"{name} with {found.setting} takes {say_run_time(found.seconds)}{beside}")
    return f"Beside vrte, for {target:.0e}: {'; '.join(texts)}." if texts else ""


def find_refusals(rows: Sequence[Row]) -> dict[str, str]:
    """Why each curve that was refused throughout was, by its name."""
    curves = group_rows(rows, "curve").items()
    return {name: some[0].status for name, some in curves if all(row.status.startswith(REFUSED) for row in some)}


def say_run_time(seconds: float) -> str:
    """With a unit that suits it.

    >>> say_run_time(0.00213)
    '2.1 ms'
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}" if seconds < 100.0 * size else f"{seconds / size:.0f} {unit}"
    return f"{seconds / 1e-6:.0f} us"


@dataclass(frozen=True)
class Choice:
    """Of one scene: whether the run of auto was good enough, whether the quickest of the others that were is of the
    same method, and the run's time over that one's."""

    scene: str
    is_adequate: bool
    is_quickest_method: bool
    ratio: float


def judge_choice(rows: Sequence[Row], target: float) -> Choice | None:
    """Of a scene's rows; None where auto was not run, the reference is not known so well, or no other run will do."""
    setting = f"accuracy {target:.0e}".replace("e-0", "e-")
    runs = [row for row in rows if row.curve == AUTO and row.setting == setting and row.is_measured]
    best = find_quickest_candidate([row for row in rows if row.curve != AUTO and row.method in METHODS], target)
    if not runs or best is None or find_reference_uncertainty(rows) > target:
        return None
    (run,) = runs
    return Choice(run.scene, run.worst <= target, run.method == best.method, run.seconds / best.seconds)


def judge_choices(rows: Sequence[Row], target: float) -> list[Choice]:
    """Of all scenes of which something can be said."""
    return [each for some in group_rows(rows).values() if (each := judge_choice(some, target)) is not None]


def advise_overall(rows: Sequence[Row]) -> str:
    """What to take, in a sentence, whatever the scene; empty without runs of auto."""
    found = [each for target in TARGETS for each in judge_choices(rows, target)]
    if not found:
        return ""
    good, ratio = sum(each.is_adequate for each in found), median(each.ratio for each in found)
    return (
        f'Take method="auto" with the accuracy that is wanted: good enough in {good} of {len(found)} runs, in '
        f"{ratio:.2g} times (median) the time of the quickest run that was, whatever its method and setting."
    )


def make_score_rows(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """A line of the table for each accuracy that auto was asked for, nothing without any."""
    lines = list[tuple[str, ...]]()
    for exponent in EXPONENTS:
        found = judge_choices(rows, float(f"1e-{exponent}"))
        if found:
            worst = max(found, key=lambda each: each.ratio)
            counts = (
                len(found),
                sum(e.is_adequate for e in found),
                sum(e.is_adequate and e.is_quickest_method for e in found),
            )
            ratios = f"{median(each.ratio for each in found):.2g}", f"{worst.ratio:.2g} ({worst.scene})"
            lines.append((f"1e-{exponent}", *map(str, counts), *ratios))
    return lines


def make_score_markdown(rows: Sequence[Row]) -> str:
    """The table for docs/explanation/methods.md."""
    return make_markdown_table(HEADER, make_score_rows(rows))


def make_score_html(rows: Sequence[Row]) -> str:
    """The section of the page, empty without runs of auto."""
    lines = make_score_rows(rows)
    return f'<h2>How well method="auto" chose</h2>\n{make_html_table(HEADER, lines)}' if lines else ""


def describe_score(rows: Sequence[Row]) -> str:
    """The same for a terminal, a line an accuracy."""
    lines = [
        f"  auto at {target}: good enough in {adequate} of {count} scenes, the quickest method in {same}, "
        f"time over the quickest {middle} (median), {worst}"
        for target, count, adequate, same, middle, worst in make_score_rows(rows)
    ]
    return "\n".join(lines)
