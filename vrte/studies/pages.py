"""What every report writes alike: Markdown tables, CSV files, and with what and on what it was made."""

import csv
import platform
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import vrte
from vrte.basics.running import usable_cpus
from vrte.formats.atomic import atomic_write


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """With every row's cells between bars.

    >>> print(markdown_table(["a", "b"], [["1", "x|y"]]), end="")
    | a | b |
    |---|---|
    | 1 | x\\|y |
    """
    texts = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in [header, *rows]]
    return "\n".join([texts[0], "|" + "---|" * len(header), *texts[1:]]) + "\n"


def markdown_list(facts: Iterable[str]) -> str:
    """One item a line.

    >>> markdown_list(["two cores"])
    '- two cores\\n'
    """
    return "".join(f"- {fact}\n" for fact in facts)


def made_with(settings: str) -> list[str]:
    """Date and settings, machine, versions: a sentence each."""
    import numpy
    import scipy

    versions = f"vrte {vrte.__version__}, numpy {numpy.__version__}, scipy {scipy.__version__}"
    return [
        f"{datetime.now(UTC):%Y-%m-%d}, {settings}",
        f"{processor()}, {usable_cpus()} cores",
        f"{versions}, Python {platform.python_version()}, {platform.system()}",
    ]


def processor() -> str:
    """The processor's name, as the system tells it."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            names = [text.split(":", 1)[1].strip() for text in file if text.startswith("model name")]
    except OSError:
        names = []
    return names[0] if names else platform.processor() or platform.machine()


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """A CSV file, all of it or nothing."""
    with atomic_write(path) as part, open(part, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
