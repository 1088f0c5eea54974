"""One row a run, in a CSV file that grows as runs finish and is read back when the report is taken up again."""

import csv
import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import vrte
from vrte.studies.methods.peers import PEERS
from vrte.studies.pages import processor, write_rows

MEASURED, REFUSED, FAILED, LEFT_OUT = "measured", "does not take", "failed", "left out"
STOKES = "iquv"


@dataclass(frozen=True)
class Row:
    """A run: median, least and greatest seconds of its rounds; errors of I, Q, U, V, largest and root mean square over
    directions, relative to the largest I at each depth, and of energy, relative to the incident flux; what the
    reference is uncertain by; floating-point operations as far as they can be counted. NaN where there is nothing to
    tell; ``status`` says why."""

    scene: str
    curve: str
    method: str
    setting: str
    status: str
    seconds: float = np.nan
    least: float = np.nan
    greatest: float = np.nan
    rounds: int = 0
    i_max: float = np.nan
    i_rms: float = np.nan
    q_max: float = np.nan
    q_rms: float = np.nan
    u_max: float = np.nan
    u_rms: float = np.nan
    v_max: float = np.nan
    v_rms: float = np.nan
    energy: float = np.nan
    reference_within: float = np.nan
    nodes: int = 0
    orders: int = 0
    operations: float = np.nan
    fingerprint: str = ""

    @property
    def is_measured(self) -> bool:
        """Whether there are figures."""
        return self.status == MEASURED

    @property
    def is_peer(self) -> bool:
        """Whether this is another code, not a method of vrte."""
        return self.method in PEERS

    @property
    def worst(self) -> float:
        """The largest error of any Stokes parameter; of a peer, of those that it finds."""
        each = [self.i_max, self.q_max, self.u_max, self.v_max]
        return float(np.nanmax(each)) if self.is_peer and self.is_measured else float(np.max(each))


NAMES = tuple(item.name for item in fields(Row))
READERS: Mapping[str, Any] = {item.name: item.type for item in fields(Row)}  # str, int or float


def cells(row: Row) -> list[object]:
    """As in the file: every digit of a number, so that it comes back as it was."""
    return [repr(value) if isinstance(value, float) else value for value in asdict(row).values()]


def append(row: Row, path: Path) -> None:
    """Adds a row, under a header if the file is new. Raises OSError."""
    is_new = not path.exists()
    with open(path, "a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([NAMES, cells(row)] if is_new else [cells(row)])


def write(rows: Iterable[Row], path: Path) -> None:
    """All rows, the file as a whole or not at all. Raises OSError."""
    write_rows(path, NAMES, [cells(row) for row in rows])


def read(path: Path) -> dict[str, Row]:
    """Rows by fingerprint; a line that an interrupted run left torn, or that another version wrote, is passed over."""
    if not path.exists():
        return {}
    found = {}
    with open(path, encoding="utf-8", newline="") as file:
        for texts in list(csv.reader(file))[1:]:
            row = row_of(texts)
            if row is not None:
                found[row.fingerprint] = row
    return found


def row_of(texts: list[str]) -> Row | None:
    """A row of its cells, None where they are no row."""
    if len(texts) != len(NAMES) or len(texts[-1]) != len(fingerprint("")):
        return None
    try:
        return Row(**{name: READERS[name](text) for name, text in zip(NAMES, texts, strict=True)})
    except ValueError:
        return None


def fingerprint(*parts: str) -> str:
    """Of what was solved, and with what: another version, source file or machine gives another.

    >>> fingerprint("a") == fingerprint("b")
    False
    """
    return hashlib.sha256("\n".join([*parts, made_by()]).encode()).hexdigest()[:16]


@cache
def made_by() -> str:
    """The package's version and sources (the reports aside), NumPy's and SciPy's versions, the processor."""
    folder = Path(os.path.dirname(vrte.__file__))
    found = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.suffix in {".py", ".pyx", ".pxi", ".h", ".cl"}):
        if folder / "report" not in path.parents:
            found.update(path.read_bytes())
    return f"{vrte.__version__} {found.hexdigest()} {np.__version__} {scipy.__version__} {processor()}"
