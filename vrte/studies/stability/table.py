"""The stability table: what the records of the cases come to, on a terminal, as Markdown and as CSV."""

import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vrte.formats.atomic import atomic_write
from vrte.studies.pages import made_with, markdown_list, markdown_table, write_rows
from vrte.studies.stability.phases import GROUPS
from vrte.studies.stability.run import Record
from vrte.studies.stability.scenes import BASES, CONDITIONS, LAYERINGS, NODES, ORDINARY

KINDS = ("oracle", "consistency", "energy")
COLUMNS = ("scenes", "", "cases", "oracle", "largest error", "c", "consistency", "energy", "seconds", "verdict")
CASE_COLUMNS = (
    *("name", "group", "conditions", "base", "layering", "nodes", "reason", "orders", "oracle"),
    *("error", "c", "consistency", "energy", "seconds", "verdict", "shortfalls", "known", "checks"),
)


@dataclass(frozen=True)
class Line:
    """A row of the table: whose cases, under which condition, and what they come to (None: nothing of that kind)."""

    scenes: str
    condition: str
    cases: int
    with_oracle: int
    largest: dict[str, float | None]
    c: float | None
    seconds: float
    short: int
    known: int

    @property
    def verdict(self) -> str:
        """In words."""
        known = f", {self.known} for a known reason" if self.known else ""
        return f"{self.short} fall short{known}" if self.short else f"holds{known}"

    @property
    def cells(self) -> list[str]:
        """As text, in the order of COLUMNS."""
        figures = [figure(self.largest["oracle"]), figure(self.c), *(figure(self.largest[kind]) for kind in KINDS[1:])]
        counts = [str(self.cases), str(self.with_oracle)]
        return [self.scenes, self.condition, *counts, *figures, f"{self.seconds:.1f}", self.verdict]


def line(scenes: str, condition: str, records: Sequence[Record]) -> Line:
    """What the records come to."""
    return Line(
        scenes=scenes,
        condition=condition,
        cases=len(records),
        with_oracle=sum(record.oracle == "yes" for record in records),
        largest={kind: largest(record.worst(kind) for record in records) for kind in KINDS},
        c=largest(record.c if record.oracle == "yes" else None for record in records),
        seconds=math.fsum(record.seconds for record in records),
        short=sum(bool(record.shortfalls) for record in records),
        known=sum(bool(record.reasons) for record in records),
    )


def lines_by_condition(records: Sequence[Record]) -> list[Line]:
    """A row for each group of phase matrices and condition, a case in every row that it belongs to."""
    return [
        line(group, condition, chosen)
        for group in GROUPS
        for condition in (*CONDITIONS, ORDINARY)
        if (chosen := [record for record in records if record.group == group and condition in record.conditions])
    ]


def lines_by_axis(records: Sequence[Record]) -> list[Line]:
    """A row for each base, layering and number of nodes, and one for everything."""
    ways: list[tuple[str, Iterable[object], Callable[[Record], object]]] = [
        ("base", BASES, lambda record: record.base),
        ("layering", LAYERINGS, lambda record: record.layering),
        ("nodes", NODES, lambda record: record.nodes),
    ]
    rows = [
        line(axis, str(value), chosen)
        for axis, values, of in ways
        for value in values
        if (chosen := [record for record in records if of(record) == value])
    ]
    return [*rows, line("all", "", records)]


def largest(values: Iterable[float | None]) -> float | None:
    """The largest that is there, NaN if one is NaN; None of nothing.

    >>> largest([None, 2.0, 1.0]), largest([None])
    (2.0, None)
    """
    found = [value for value in values if value is not None]
    return max(found, key=lambda value: (math.isnan(value), value)) if found else None


def figure(value: float | None) -> str:
    """Two digits, or a dash for nothing.

    >>> figure(3.14e-12), figure(0.0), figure(None)
    ('3.1e-12', '0', '-')
    """
    if value is None:
        return "-"
    return "0" if value == 0.0 else f"{value:.1e}"


def verdict(record: Record) -> str:
    """Of one case, in words."""
    return "falls short" if record.shortfalls else "known" if record.reasons else "holds"


def as_text(records: Sequence[Record]) -> str:
    """The table for a terminal, and what falls short."""
    rows = [list(COLUMNS), *(row.cells for row in [*lines_by_condition(records), *lines_by_axis(records)])]
    widths = [max(len(row[place]) for row in rows) for place in range(len(COLUMNS))]
    texts = [
        "  "
        + "  ".join(
            cell.ljust(width) if place < 2 or place == len(COLUMNS) - 1 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    short = [f"  {record.name}: {'; '.join(record.shortfalls)}" for record in records if record.shortfalls]
    known = [f"  {record.name}: {'; '.join(record.reasons)}" for record in records if record.reasons]
    parts = [*texts, *(["", "falls short:", *short] if short else []), *(["", "known:", *known] if known else [])]
    return "\n".join(parts)


def as_markdown(records: Sequence[Record], settings: str) -> str:
    """The whole table, the corners one by one, what falls short, and where and with what it was made."""
    corners = [record for record in records if record.reason]
    blocks = [
        "# Stability: the last run\n",
        made_with_records(records, settings),
        "## By what scatters and under which condition\n",
        "A case counts in every row that it belongs to.\n",
        markdown_table(COLUMNS, [row.cells for row in lines_by_condition(records)]),
        "## By base, layering and number of nodes\n",
        markdown_table(COLUMNS, [row.cells for row in lines_by_axis(records)]),
    ]
    if corners:
        blocks += ["## Corners\n", markdown_table(CORNER_COLUMNS, [corner_cells(record) for record in corners])]
    short = [record for record in records if record.shortfalls]
    blocks.append("## What falls short\n")
    blocks.append("\n".join(f"- {record.name}: {'; '.join(record.shortfalls)}" for record in short) or "Nothing.")
    known = [record for record in records if record.reasons]
    if known:
        blocks += ["\n## Out of reach, and why\n"]
        blocks.append("\n".join(f"- {record.name}: {'; '.join(record.reasons)}" for record in known))
    return "\n".join(blocks).rstrip() + "\n"


CORNER_COLUMNS = ("corner", "what makes it hard", "error", "c", "consistency", "energy", "seconds", "verdict")


def corner_cells(record: Record) -> list[str]:
    """One corner's row."""
    c = record.c if record.oracle == "yes" else None
    figures = [record.worst("oracle"), c, record.worst("consistency"), record.worst("energy")]
    return [record.name, record.reason, *map(figure, figures), f"{record.seconds:.1f}", verdict(record)]


def made_with_records(records: Sequence[Record], settings: str) -> str:
    """Date, machine, versions and what was run, as a Markdown list."""
    partial = sum(not record.whole for record in records)
    few = f", {partial} of them in Fourier orders 0 to 2 only" if partial else ""
    scenes = f"{len(records)} scenes{few}, {math.fsum(record.seconds for record in records):.0f} s"
    return markdown_list([*made_with(settings), scenes])


def write_tables(records: Sequence[Record], folder: str | os.PathLike[str], settings: str) -> list[Path]:
    """Writes stability.md, stability.csv (the table) and stability_cases.csv (a row a case) into the folder.

    Each all of it or nothing. Raises OSError. Returns their paths.

    >>> [path.name for path in write_tables([], ".", "an example")]
    ['stability.md', 'stability.csv', 'stability_cases.csv']
    """
    rows = [row.cells for row in [*lines_by_condition(records), *lines_by_axis(records)]]
    paths = [Path(folder) / name for name in ("stability.md", "stability.csv", "stability_cases.csv")]
    with atomic_write(paths[0]) as part:
        part.write_text(as_markdown(records, settings), encoding="utf-8")
    write_rows(paths[1], ["scenes", "condition", *COLUMNS[2:]], rows)
    write_rows(paths[2], CASE_COLUMNS, [case_cells(record) for record in records])
    return paths


def case_cells(record: Record) -> list[object]:
    """One case's row, in the order of CASE_COLUMNS; empty where there is no such figure."""
    error, consistency, energy = (record.worst(kind) for kind in KINDS)
    checks = "; ".join(f"{check.name} {check.value:.2e} (limit {check.limit:.0e})" for check in record.checks)
    return [
        record.name,
        record.group,
        "; ".join(record.conditions),
        record.base,
        record.layering,
        record.nodes,
        record.reason,
        "all" if record.whole else "0 to 2",
        record.oracle,
        error,
        record.c,
        consistency,
        energy,
        f"{record.seconds:.3f}",
        verdict(record),
        "; ".join(record.shortfalls),
        "; ".join(record.reasons),
        checks,
    ]
