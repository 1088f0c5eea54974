"""Keys of a table in a scene file: how each is read, and what the viewer's form shows of it.

A kind of something (a base, a source of particles, a phase function) has a row in a registry, with its keys; scene
files, sweeps and the form read the registries.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from vrte.formats.media import check_material, find_index, read_beside, read_material
from vrte.formats.toml_table import NUMBERS, Table

SUBSTANCE_HINT = "a name, a database path, or n, k"


class Reading(NamedTuple):
    """Where a table is read: the file that it stands in, whose wavelength holds, and the folder of files it names."""

    file: Table
    folder: Path


@dataclass(frozen=True)
class Key:
    """One key: ``label`` and ``hint`` in the form, or within its field what is taken where it is ``empty``; what the
    form begins with (``start``; None: it is left out), and whether a file must have it."""

    label: str = ""
    start: Any = None
    hint: str = field(default="", kw_only=True)
    empty: str = field(default="", kw_only=True)
    needed: bool = field(default=True, kw_only=True)

    def check(self, table: Table, name: str) -> None:
        """All that can be said without a wavelength or another file. Raises SceneError."""
        self.read(table, name, Reading(table, Path()))

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        """The value at a key. Raises SceneError."""
        raise NotImplementedError


@dataclass(frozen=True)
class Number(Key):
    """A real number, ``allowed`` in words."""

    allowed: str = field(default="a number", kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> float:
        return table.number(name, self.allowed)


@dataclass(frozen=True)
class Share(Number):
    """A number, or per cent in quotes."""

    def read(self, table: Table, name: str, reading: Reading) -> float:
        return table.share(name, self.allowed)


@dataclass(frozen=True)
class Whole(Key):
    """A whole number within ``limits``."""

    limits: tuple[int, int] = field(default=(1, 1_000_000), kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> int:
        return table.whole(name, *self.limits)


@dataclass(frozen=True)
class Flag(Key):
    """True or false; ``usual``: what it is where a table leaves it out."""

    usual: Callable[[Mapping[str, Any]], bool] = field(default=lambda table: False, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> bool:
        return table.flag(name)


@dataclass(frozen=True)
class Choice(Key):
    """One of several words, by ``names``: what each means."""

    names: Mapping[str, str] = field(default_factory=dict, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> str:
        return table.choice(name, tuple(self.names))


@dataclass(frozen=True)
class Numbers(Key):
    """A number, a list of numbers, or a range."""

    allowed: str = field(default=NUMBERS, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> list[float]:
        return table.numbers(name)


@dataclass(frozen=True)
class Substance(Key):
    """What something consists of, as `vrte.refractive_index` takes it: a name, a database path, a table, n and k."""

    def check(self, table: Table, name: str) -> None:
        check_material(table, name)

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        return read_material(table, name, reading.folder)


@dataclass(frozen=True)
class Index(Substance):
    """The same, as its index n + ik at the file's wavelength."""

    def read(self, table: Table, name: str, reading: Reading) -> complex:
        return find_index(reading.file, table, name, reading.folder)


@dataclass(frozen=True)
class FilePath(Key):
    """A file beside the scene file, with one of the ``suffixes``; ``open`` makes of its path what the key means."""

    suffixes: tuple[str, ...] = field(default=(".csv",), kw_only=True)
    open: Callable[[Path], Any] = field(default=Path, kw_only=True)

    def check(self, table: Table, name: str) -> None:
        words = f"the path of a {' or '.join(self.suffixes)} file beside the scene file"
        table.right(name, words, lambda value: isinstance(value, str) and value.endswith(self.suffixes))

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        self.check(table, name)
        return read_beside(table, name, self.open, reading.folder)


def make_start(keys: Mapping[str, Key]) -> dict[str, Any]:
    """What a form begins with; a file that is needed is still to be chosen.

    >>> make_start({"albedo": Number(start=0.5), "phi_deg": Number(needed=False), "file": FilePath()})
    {'albedo': 0.5, 'file': ''}
    """
    begun = {name: "" if key.needed and isinstance(key, FilePath) else key.start for name, key in keys.items()}
    return {name: copy.deepcopy(start) for name, start in begun.items() if start is not None}


def check_keys(keys: Mapping[str, Key], table: Table) -> None:
    """Whether a table has the keys that are needed, and those that it has are right. Raises SceneError."""
    for name, key in keys.items():
        if key.needed or name in table:
            key.check(table, name)


def read_keys(keys: Mapping[str, Key], table: Table, reading: Reading) -> dict[str, Any]:
    """The values of a table, as far as it has them. Raises SceneError."""
    return {name: key.read(table, name, reading) for name, key in keys.items() if key.needed or name in table}
