"""How well method="auto" chose: its runs against the quickest of all others that were good enough."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from vrte.request.request import AUTO, METHODS
from vrte.studies.methods.advice import quickest, within_of
from vrte.studies.methods.records import Row
from vrte.studies.pages import markdown_table

EXPONENTS, EXPONENTS_QUICK = (1, 2, 3, 4, 6, 8, 10), (2, 3, 6)  # of the accuracies that auto is asked for
HEADER = (
    "accuracy asked for",
    "scenes",
    "auto good enough",
    "auto took the quickest method",
    "time over that of the quickest run: median",
    "worst",
)


@dataclass(frozen=True)
class Choice:
    """Of one scene: whether the run of auto was good enough, whether the quickest of the others that were is of the
    same method, and the run's time over that one's."""

    scene: str
    is_adequate: bool
    is_quickest_method: bool
    ratio: float


def accuracy_label(target: float) -> str:
    """What a run's setting is called.

    >>> accuracy_label(1e-3)
    'accuracy 1e-3'
    """
    return f"accuracy {target:.0e}".replace("e-0", "e-")


def choice(rows: Sequence[Row], target: float) -> Choice | None:
    """Of a scene's rows; None where auto was not run, the reference is not known so well, or no other run will do."""
    runs = [row for row in rows if row.curve == AUTO and row.setting == accuracy_label(target) and row.is_measured]
    best = quickest([row for row in rows if row.curve != AUTO and row.method in METHODS], target)
    if not runs or best is None or within_of(rows) > target:
        return None
    (run,) = runs
    return Choice(run.scene, run.worst <= target, run.method == best.method, run.seconds / best.seconds)


def choices(rows: Sequence[Row], target: float) -> list[Choice]:
    """Of all scenes of which something can be said."""
    names = dict.fromkeys(row.scene for row in rows)
    found = (choice([row for row in rows if row.scene == name], target) for name in names)
    return [each for each in found if each is not None]


def score_rows(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """A line of the table for each accuracy that auto was asked for, nothing without any."""
    lines = list[tuple[str, ...]]()
    for exponent in EXPONENTS:
        found = choices(rows, float(f"1e-{exponent}"))
        if found:
            worst = max(found, key=lambda each: each.ratio)
            lines.append(
                (
                    f"1e-{exponent}",
                    str(len(found)),
                    str(sum(each.is_adequate for each in found)),
                    str(sum(each.is_adequate and each.is_quickest_method for each in found)),
                    f"{median(each.ratio for each in found):.2g}",
                    f"{worst.ratio:.2g} ({worst.scene})",
                )
            )
    return lines


def score_markdown(rows: Sequence[Row]) -> str:
    """The table for docs/methods.md."""
    return markdown_table(HEADER, score_rows(rows))


def score_html(rows: Sequence[Row]) -> str:
    """The section of the page, empty without runs of auto."""
    lines = score_rows(rows)
    if not lines:
        return ""
    head = "".join(f"<th>{name}</th>" for name in HEADER)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in line)}</tr>" for line in lines)
    return f'<h2>How well method="auto" chose</h2>\n<table><tr>{head}</tr>{body}</table>'


def score_text(rows: Sequence[Row]) -> str:
    """The same for a terminal, a line an accuracy."""
    lines = [
        f"  auto at {target}: good enough in {adequate} of {count} scenes, the quickest method in {same}, "
        f"time over the quickest {middle} (median), {worst}"
        for target, count, adequate, same, middle, worst in score_rows(rows)
    ]
    return "\n".join(lines)
