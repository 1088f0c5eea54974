"""The stability table: what the records of the cases come to, on a terminal, as Markdown and as CSV."""

import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from bench.stability.cases import AXES, CONDITIONS, GROUPS, ORDINARY, SURFACE_CONDITIONS
from bench.stability.run import Record
from bench.study import (
    list_run_facts,
    make_markdown_list,
    make_markdown_table,
    show_two_digits,
    write_rows,
    write_text,
)

KINDS = ("oracle", "consistency", "energy")
COLUMNS = ("scenes", "", "cases", "oracle", "largest error", "c", "consistency", "energy", "seconds", "verdict")
CORNER_COLUMNS = ("corner", "what makes it hard", "error", "c", "consistency", "energy", "seconds", "verdict")
CASE_COLUMNS = (
    *("name", "group", "conditions", "base", "layering", "nodes", "reason", "orders", "oracle"),
    *("error", "c", "consistency", "energy", "seconds", "verdict", "shortfalls", "known", "checks"),
)


def make_table_row(scenes: str, condition: str, records: Sequence[Record]) -> list[str]:
    """A row of the table, in the order of COLUMNS: whose cases, under which condition, and what they come to."""
    error, consistency, energy = (find_largest_given(record.worst(kind) for record in records) for kind in KINDS)
    c = find_largest_given(record.c if record.oracle == "yes" else None for record in records)
    known, short = (sum(bool(each) for each in found) for found in zip(*map(find_shortfalls, records), strict=True))
    words = [f"{short} fall short"] * bool(short) + [f"{known} for a known reason"] * bool(known)
    return [
        *(scenes, condition, str(len(records)), str(sum(record.oracle == "yes" for record in records))),
        *map(show_number, (error, c, consistency, energy)),
        f"{math.fsum(record.seconds for record in records):.1f}",
        ", ".join(words if short else ["holds", *words]),
    ]


def find_shortfalls(record: Record) -> tuple[list[str], list[str]]:
    """What falls short for a known reason, and otherwise."""
    return record.reasons, record.shortfalls


def make_rows_by_condition(records: Sequence[Record]) -> list[list[str]]:
    """A row for each group of phase matrices and condition, a case in every row that it belongs to."""
    return [
        make_table_row(group, condition, chosen)
        for group in GROUPS
        for condition in (*CONDITIONS, ORDINARY)
        if (chosen := [record for record in records if record.group == group and condition in record.conditions])
    ]


def make_rows_by_axis(records: Sequence[Record]) -> list[list[str]]:
    """A row for each base, layering and number of nodes, and one for everything."""
    rows = [
        make_table_row(axis, str(value), chosen)
        for axis in ("base", "layering", "nodes")
        for value in AXES[axis]
        if (chosen := [record for record in records if getattr(record, axis) == value])
    ]
    return [*rows, *([make_table_row("all", "", records)] if records else [])]


def make_rows_by_surface(records: Sequence[Record]) -> list[list[str]]:
    """A row for each condition, pile, refractive index and number of nodes under surfaces, and one for all of them."""
    rows = [
        make_table_row("surfaces", condition, chosen)
        for condition in (*SURFACE_CONDITIONS, ORDINARY)
        if (chosen := [record for record in records if condition in record.conditions])
    ]
    rows += [
        make_table_row(axis, f"{value:.5g}" if isinstance(value, float) else str(value), chosen)
        for axis in ("pile", "index", "base", "nodes")
        for value in dict.fromkeys(sorted(getattr(record, axis) for record in records))
        if (chosen := [record for record in records if getattr(record, axis) == value])
    ]
    return [*rows, *([make_table_row("all under surfaces", "", records)] if records else [])]


def split_records(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Those where nothing is refracted, and those under surfaces."""
    return [record for record in records if not record.pile], [record for record in records if record.pile]


def find_largest_given(values: Iterable[float | None]) -> float | None:
    """The largest that is there, NaN if one is NaN; None of nothing.

    >>> find_largest_given([None, 2.0, 1.0]), find_largest_given([None])
    (2.0, None)
    """
    found = [value for value in values if value is not None]
    return max(found, key=lambda value: (math.isnan(value), value)) if found else None


def show_number(value: float | None) -> str:
    """Two digits, or a dash for nothing; NaN, which a check may have found, by its name.

    >>> show_number(3.14e-12), show_number(math.nan)
    ('3.1e-12', 'nan')
    """
    return "nan" if value is not None and math.isnan(value) else show_two_digits(value)


def make_all_rows(records: Sequence[Record]) -> list[list[str]]:
    """All rows of the table."""
    plain, under = split_records(records)
    return [*make_rows_by_condition(plain), *make_rows_by_axis(plain), *make_rows_by_surface(under)]


def describe_records(records: Sequence[Record]) -> str:
    """The table for a terminal, and what falls short."""
    rows = [list(COLUMNS), *make_all_rows(records)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    texts = [
        "  "
        + "  ".join(
            cell.ljust(width) if place < 2 or place == len(COLUMNS) - 1 else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    for title, place in (("falls short:", 1), ("known:", 0)):
        told = [
            f"  {record.name}: {'; '.join(find_shortfalls(record)[place])}"
            for record in records
            if find_shortfalls(record)[place]
        ]
        texts += ["", title, *told] if told else []
    return "\n".join(texts)


def make_markdown(records: Sequence[Record], settings: str) -> str:
    """The whole table, the corners one by one, what falls short, and where and with what it was made."""
    plain, under = split_records(records)
    corners = [list_corner_cells(record) for record in records if record.reason]
    short, known = (
        make_markdown_list(
            f"{record.name}: {'; '.join(texts)}" for record in records if (texts := find_shortfalls(record)[place])
        )
        for place in (1, 0)
    )
    blocks = [
        "# Stability: the last run\n",
        describe_run(records, settings),
        "## By what scatters and under which condition\n",
        "A case counts in every row that it belongs to.\n",
        make_markdown_table(COLUMNS, make_rows_by_condition(plain)),
        "## By base, layering and number of nodes\n",
        make_markdown_table(COLUMNS, make_rows_by_axis(plain)),
        *(["## Under surfaces\n", make_markdown_table(COLUMNS, make_rows_by_surface(under))] if under else []),
        *(["## Corners\n", make_markdown_table(CORNER_COLUMNS, corners)] if corners else []),
        "## What falls short\n",
        short or "Nothing.\n",
        *(["## Out of reach, and why\n", known] if known else []),
    ]
    return "\n".join(blocks).rstrip() + "\n"


def list_corner_cells(record: Record) -> list[str]:
    """One corner's row."""
    c = record.c if record.oracle == "yes" else None
    figures = [record.worst("oracle"), c, record.worst("consistency"), record.worst("energy")]
    return [record.name, record.reason, *map(show_number, figures), f"{record.seconds:.1f}", record.verdict]


def describe_run(records: Sequence[Record], settings: str) -> str:
    """Date, machine, versions and what was run, as a Markdown list."""
    partial = sum(not record.whole for record in records)
    few = f", {partial} of them in Fourier orders 0 to 2 only" if partial else ""
    scenes = f"{len(records)} scenes{few}, {math.fsum(record.seconds for record in records):.0f} s"
    return make_markdown_list([*list_run_facts(settings), scenes])


def write_tables(records: Sequence[Record], folder: str | os.PathLike[str], settings: str) -> list[Path]:
    """Writes stability.md, stability.csv (the table) and stability_cases.csv (a row a case) into the folder.

    Each all of it or nothing. Raises OSError. Returns their paths.

    >>> [path.name for path in write_tables([], ".", "an example")]
    ['stability.md', 'stability.csv', 'stability_cases.csv']
    """
    paths = [Path(folder) / name for name in ("stability.md", "stability.csv", "stability_cases.csv")]
    write_text(paths[0], make_markdown(records, settings))
    rows = make_all_rows(records)
    write_rows(paths[1], ["scenes", "condition", *COLUMNS[2:]], rows)
    write_rows(paths[2], CASE_COLUMNS, [list_case_cells(record) for record in records])
    return paths


def list_case_cells(record: Record) -> list[object]:
    """One case's row, in the order of CASE_COLUMNS; empty where there is no such figure."""
    error, consistency, energy = (record.worst(kind) for kind in KINDS)
    checks = "; ".join(f"{check.name} {check.value:.2e} (limit {check.limit:.0e})" for check in record.checks)
    return [
        *(record.name, record.group, "; ".join(record.conditions), record.base, record.layering, record.nodes),
        *(record.reason, "all" if record.whole else "0 to 2", record.oracle),
        *(error, record.c, consistency, energy, f"{record.seconds:.3f}", record.verdict),
        *("; ".join(record.shortfalls), "; ".join(record.reasons), checks),
    ]
