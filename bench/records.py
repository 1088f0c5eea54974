"""One row a run, in a CSV file that grows as runs finish and is read back when a study is taken up again."""

import csv
import hashlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import scipy

import vrte
from bench.pages import find_processor_name, write_rows

Row = TypeVar("Row")
PLAIN = {str: str, int: int, float: float}  # what is written as it is; all else is JSON
SOURCES = {".py", ".pyx", ".pxi", ".h", ".cl", ".so", ".pyd"}


class Records(Generic[Row]):
    """The rows of a study in a file: instances of a dataclass whose last field is their ``fingerprint``."""

    def __init__(self, kind: type[Row], path: Path) -> None:
        self.kind, self.path = kind, path
        self.readers = {item.name: PLAIN.get(item.type, json.loads) for item in fields(kind)}  # type: ignore

    def read(self) -> dict[str, Row]:
        """Rows by fingerprint; a line that an interrupted run left torn, or that another version wrote, is passed over.
        Raises OSError."""
        if not self.path.exists():
            return {}
        with open(self.path, encoding="utf-8", newline="") as file:
            rows = [self.row_of(texts) for texts in list(csv.reader(file))[1:]]
        return {row.fingerprint: row for row in rows if row is not None}  # type: ignore[attr-defined]

    def row_of(self, texts: list[str]) -> Row | None:
        """A row of its cells, None where they are no row."""
        if len(texts) != len(self.readers) or len(texts[-1]) != len(make_fingerprint("")):
            return None
        try:
            return self.kind(
                **{name: read(text) for (name, read), text in zip(self.readers.items(), texts, strict=True)}
            )
        except (ValueError, TypeError):
            return None

    def cells(self, row: Row) -> list[object]:
        """As in the file: every digit of a number, so that it comes back as it was."""
        values: dict[str, Any] = asdict(row)  # type: ignore[call-overload]
        return [
            (repr(value) if isinstance(value, float) else value) if reader in PLAIN.values() else json.dumps(value)
            for value, reader in zip(values.values(), self.readers.values(), strict=True)
        ]

    def append(self, row: Row) -> None:
        """Adds a row, on disk before anything else happens, under a header if the file is new. Raises OSError."""
        is_new = not self.path.exists()
        with open(self.path, "a", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([list(self.readers)] * is_new + [self.cells(row)])
            file.flush()
            os.fsync(file.fileno())

    def write(self, rows: Iterable[Row]) -> None:
        """All rows, the file as a whole or not at all. Raises OSError."""
        write_rows(self.path, list(self.readers), [self.cells(row) for row in rows])


def make_fingerprint(*parts: str) -> str:
    """Of what was solved, and with what: another version, source file or machine gives another.

    >>> make_fingerprint("a") == make_fingerprint("b")
    False
    """
    return hashlib.sha256("\n".join([*parts, identify_setup()]).encode()).hexdigest()[:16]


@cache
def identify_setup() -> str:
    """The package's version and sources, NumPy's and SciPy's versions, the processor."""
    folder = Path(vrte.__file__).parent
    paths = [path for path in folder.rglob("*") if path.suffix in SOURCES]
    return f"{vrte.__version__} {hash_files(paths)} {np.__version__} {scipy.__version__} {find_processor_name()}"


def hash_files(paths: Iterable[Path]) -> str:
    """Of the bytes of some files."""
    found = hashlib.sha256()
    for path in sorted(paths):
        found.update(path.read_bytes())
    return found.hexdigest()
