"""Keys of a table in a scene file, each declared once: how it is read, and what forms and the reference show of it.

A kind of something (a base, a source of particles, a size, a phase function) is a row of a registry, with its keys.
"""

import copy
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, TypeVar

from vrte.basics.errors import SceneError
from vrte.formats.columns import read_index
from vrte.formats.toml_table import GivenAs, Table, is_number, locate_errors
from vrte.optics.particles import find_host_index
from vrte.optics.refractive_index import refractive_index

Read = TypeVar("Read")
SUBSTANCE_HINT = "a name, a database path, or n, k"
TABLE = ".csv"  # the suffix of tables of one's own
WAVE_KEYS = ("wavelength_um", "host_index")  # of the light, for all particles
ONE_WAVELENGTH = "the wavelength in micrometres; a list is for spectra: `vrte brdf`, `vrte view`, `vrte.spectrum`"
INDEX = (
    'the name of a material, a path in the database such as "main/Au/Johnson", the path of a .csv with the columns '
    "wavelength_um (or wavelength_nm), n, k, or [n, k]"
)


class Reading(NamedTuple):
    """Where a table is read: the file that it stands in, and the folder of the files it names."""

    file: Table
    folder: Path

    @property
    def wavelength(self) -> float:
        """The file's wavelength [um]. Raises SceneError where it is missing, or several."""
        return self.file.number("wavelength_um", ONE_WAVELENGTH)


class Other(NamedTuple):
    """Another key in place of one, such as a diameter: name, how its value converts, words before a complaint."""

    name: str
    convert: Callable[[Any], Any]
    words: str = ""
    allowed: str = ""


@dataclass(frozen=True)
class Key:
    """One key: ``label`` and ``hint`` in the form, what is taken where it is ``empty``, its ``start`` there (None: left
    out); whether it is ``needed``, what is ``allowed`` in words, the ``argument`` that it gives, an ``other`` key in
    its place."""

    label: str = ""
    start: Any = None
    _: KW_ONLY
    hint: str = ""
    empty: str = ""
    needed: bool = True
    allowed: str = ""
    argument: str = ""
    other: Other | None = None

    takes: ClassVar[tuple[Any, ...]] = ()  # what reads it from a table, and the names of its further arguments

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        """The value at a key. Raises SceneError."""
        read, *arguments = self.takes
        return read(table, name, *(getattr(self, argument) for argument in arguments))

    @property
    def inside(self) -> Mapping[str, "Key"]:
        """The keys of the table that may stand there."""
        return {}


class Number(Key):
    """A key whose value is a real number within ``allowed``."""

    takes = (Table.number, "allowed")


class Fraction(Key):
    """A number, or per cent in quotes."""

    takes = (Table.fraction, "allowed")


@dataclass(frozen=True)
class Numbers(Key):
    """A number, a list or a range; ``count`` of them; ``may_be_empty``; ``single``: one number stays one."""

    count: int | None = field(default=None, kw_only=True)
    may_be_empty: bool = field(default=False, kw_only=True)
    single: bool = field(default=False, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        if self.may_be_empty and table.content.get(name) == []:
            return []
        if self.single and not isinstance(table.content.get(name), (list, dict)):
            return table.number(name, self.allowed)
        found = table.numbers(name)
        if self.count not in (None, len(found)):
            raise table.wrong(name, f"must be {self.allowed}")
        return found


@dataclass(frozen=True)
class Whole(Key):
    """A whole number within ``limits``."""

    limits: tuple[int, int] = field(kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> int:
        return table.whole(name, *self.limits)


@dataclass(frozen=True)
class Flag(Key):
    """True or false; ``usual``: what it is where a table leaves it out."""

    usual: Callable[[Mapping[str, Any]], bool] = field(default=lambda table: False, kw_only=True)
    takes = (Table.flag,)


@dataclass(frozen=True)
class Choice(Key):
    """One of several words, by ``names``: what each means."""

    names: Mapping[str, str] = field(kw_only=True)
    takes = (Table.choice, "names")


@dataclass(frozen=True)
class Substance(Key):
    """What something consists of, as `vrte.refractive_index` takes it: a name, a database path, a table, n and k."""

    hint: str = field(default=SUBSTANCE_HINT, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        value = table.required(name, INDEX)
        if isinstance(value, str):
            return read_beside(table, name, read_index, reading.folder) if value.endswith(TABLE) else value
        parts = value if isinstance(value, list) else [value, 0.0]
        if len(parts) != 2 or not all(is_number(part) for part in parts):
            raise table.wrong(name, f"must be {INDEX}")
        return float(parts[0]), float(parts[1])


class Index(Substance):
    """The same, as its index n + ik at the file's wavelength, which numbers do without."""

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        material = super().read(table, name, reading)
        if isinstance(material, tuple):
            return complex(*material)
        wavelength = reading.wavelength
        with locate_errors(table.place, table.allowed, WAVE_KEYS, {"index": (name, None)}):
            return refractive_index(material, wavelength).value


class Medium(Index):
    """The same, of a medium that light goes through: it may absorb a little, and refraction takes its index as real."""

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        index = super().read(table, name, reading)
        with locate_errors(table.place, table.allowed, given_as={"host_index": (name, None)}):
            return find_host_index(index, 1.0).value  # a number, whatever the wavelength


@dataclass(frozen=True)
class FilePath(Key):
    """A file beside the scene file, with one of the ``suffixes``; ``open`` makes of its path what the key means."""

    suffixes: tuple[str, ...] = field(default=(TABLE,), kw_only=True)
    open: Callable[[Path], Any] = field(default=Path, kw_only=True)

    def read(self, table: Table, name: str, reading: Reading) -> Any:
        words = f"the path of a {' or '.join(self.suffixes)} file beside the scene file"
        table.right(name, words, lambda value: isinstance(value, str) and value.endswith(self.suffixes))
        return read_beside(table, name, self.open, reading.folder)


def read_beside(table: Table, key: str, read: Callable[[Path], Read], folder: Path) -> Read:
    """What is in the file that a key names, beside the scene file."""
    try:
        return read(folder / table.content[key])
    except SceneError as error:
        raise table.wrong(key, str(error)) from error
    except OSError as error:
        raise table.wrong(key, f"the file cannot be read: {error.strerror}") from error


class Row(NamedTuple):
    """A kind of something: ``words``, what makes it of its ``keys``; of particles a ``check``, and ``sized``."""

    words: str
    make: Callable[..., Any]
    keys: dict[str, Key]
    check: Callable[..., Any] | None = None
    sized: bool = False


def join_rows(registry: Mapping[str, Row]) -> dict[str, Key]:
    """The keys of all rows of a registry."""
    return {name: key for row in registry.values() for name, key in row.keys.items()}


def make_start(keys: Mapping[str, Key]) -> dict[str, Any]:
    """What a form begins with; a file that is needed is still to be chosen."""
    begun = {name: "" if key.needed and isinstance(key, FilePath) else key.start for name, key in keys.items()}
    return {name: copy.deepcopy(start) for name, start in begun.items() if start is not None}


def list_names(keys: Mapping[str, Key]) -> tuple[str, ...]:
    """The names of keys, and of the others that may stand in their places."""
    return tuple(one for name, key in keys.items() for one in ((name, key.other.name) if key.other else (name,)))


def read_keys(keys: Mapping[str, Key], table: Table, reading: Reading) -> dict[str, Any]:
    """The values of a table by the arguments that they are, as far as it has them. Raises SceneError."""
    found = {}
    for name, key in keys.items():
        if key.other is not None and key.other.name in table:
            table.exactly_one(name, key.other.name)
            own = replace(key, allowed=key.other.allowed or key.allowed)
            value = key.other.convert(own.read(table, key.other.name, reading))
            if value is None:
                raise table.wrong(key.other.name, f"must be {key.other.allowed}")
            found[key.argument or name] = value
        elif key.needed or name in table:
            found[key.argument or name] = key.read(table, name, reading)
    return found


def find_given_as(keys: Mapping[str, Key], table: Table) -> GivenAs:
    """The keys of a table that give arguments of other names, for sentences about these."""
    found: dict[str, tuple[str, str | None]] = {}
    for name, key in keys.items():
        if key.argument:
            found[key.argument] = name, None
        if key.other and key.other.name in table:
            found[name] = key.other.name, key.other.words
    return found


def make_of_keys(row: Row, table: Table, reading: Reading) -> Any:
    """What a row makes of a table. Raises SceneError, with the table's place."""
    values = read_keys(row.keys, table, reading)
    with locate_errors(table.place, table.allowed, given_as=find_given_as(row.keys, table)):
        return row.make(**values)
