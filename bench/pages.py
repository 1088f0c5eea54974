"""What every study writes alike: Markdown tables, CSV files, logarithmic panels, with what and on what it was made."""

import csv
import math
import os
import platform
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any

import vrte
from vrte.basics.running import count_usable_cpus
from vrte.commands.reference import make_markdown_table as make_markdown_table
from vrte.formats.atomic import write_atomically
from vrte.pictures.figures import FAINT

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")  # of lines, in turn


def make_html_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Of cells that are HTML.

    >>> make_html_table(["a"], [["1"]])
    '<table><tr><th>a</th></tr><tr><td>1</td></tr></table>'
    """
    lines = [f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table><tr>{''.join(f'<th>{name}</th>' for name in header)}</tr>{''.join(lines)}</table>"


def make_markdown_list(facts: Iterable[str]) -> str:
    """One item a line.

    >>> make_markdown_list(["two cores"])
    '- two cores\\n'
    """
    return "".join(f"- {fact}\n" for fact in facts)


def list_run_facts(settings: str) -> list[str]:
    """Date and settings, machine, versions: a sentence each."""
    import numpy
    import scipy

    versions = f"vrte {vrte.__version__}, numpy {numpy.__version__}, scipy {scipy.__version__}"
    return [
        f"{datetime.now(UTC):%Y-%m-%d}, {settings}",
        f"{find_processor_name()}, {count_usable_cpus()} cores",
        f"{versions}, Python {platform.python_version()}, {platform.system()}",
    ]


def find_processor_name() -> str:
    """The processor's name, as the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [text.split(":", 1)[1].strip() for text in file if text.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()


def show_two_digits(value: float | None) -> str:
    """Two digits, or a dash for what is not there or not a number.

    >>> show_two_digits(3.14e-12), show_two_digits(0.0), show_two_digits(None), show_two_digits(math.nan)
    ('3.1e-12', '0', '-', '-')
    """
    if value is None or math.isnan(value):
        return "-"
    return "0" if value == 0.0 else f"{value:.1e}"


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """A text file, all of it or nothing. Raises OSError."""
    with write_atomically(path) as part:
        part.write_text(text, encoding="utf-8")


def write_rows(path: str | os.PathLike[str], header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A CSV file, all of it or nothing. Raises OSError."""
    with write_atomically(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def finish_panel(panel: Any, title: str, below: str, beside: str = "") -> None:
    """Logarithmic axes with their names, a title and a grid."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_xlabel(below)
    if beside:
        panel.set_ylabel(beside)
    panel.set_title(title, fontsize=10)
    panel.grid(color=FAINT, linewidth=0.5, alpha=0.7)
