"""A table of a TOML file with its own dotted key, which every error names; values and keys as TOML."""

import difflib
import itertools
import json
import math
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from types import MappingProxyType
from typing import Any, cast

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import Place, SceneError

LARGEST_FILE = 10_000_000  # bytes
DEEPEST = 30  # keys, tables and lists inside each other, in a header and again below it: a scene has 8
# texts and comments, whole, to their end where nothing closes them; and what makes a place deeper or less deep
STEPS = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5})?|' + r"'''(?:[^']|'(?!''))*+(?:'{3,5})?|"
    r'"(?:[^"\\\n]|\\.)*+"?|' + r"'[^'\n]*+'?|#[^\n]*|[\[\]{}.,\n]",
    re.DOTALL,
)
STEP = re.compile(r"""([A-Za-z0-9_-]+|"[^"]*"|'[^']*')((?:\[\d+\])*)""")  # a key, and places in its lists
LARGEST_COUNT = 1_000_000
RANGE_KEYS = ("start", "stop", "count")
SHOWN, SHOWN_KEY, SHOWN_DEPTH = 80, 60, 8  # characters of a value and of a key in a complaint, tables in tables
PLAIN_KEY = re.compile("[A-Za-z0-9_-]+")
LONGEST = 10_000  # bits of a whole number; Python writes and reads no more than 4300 digits
DEEPEST_WRITTEN = 50  # tables in tables; the parser gives up not far beyond
PER_CENT = re.compile(r"\s*([0-9]{1,12}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})\s*%\s*")
NUMBERS = "a number, a list of numbers or { start, stop, count }"
GivenAs = Mapping[str, tuple[str, str | None]]  # an argument's key, and the words between them; None: the key alone


def parse_toml(text: str) -> dict[str, Any]:
    """TOML, parsed; what would keep the parser busy for minutes is refused first. Raises SceneError."""
    check_depth(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"not valid TOML: {put_in_one_line(str(error), 200)}") from error
    except ValueError as error:
        raise SceneError("not valid TOML: a whole number of more than 4000 digits") from error


def check_depth(text: str) -> None:
    """Raises SceneError where TOML leads deeper than DEEPEST, before it is parsed: that would take time and stack."""
    around, depth = [0], 0  # how deep the tables and lists around are, and the place itself
    for found in STEPS.finditer(text):
        sign = found[0]
        if sign in "[{.":
            depth += 1
            if depth > DEEPEST:
                line = text.count("\n", 0, found.start()) + 1
                raise SceneError(f"not a scene: line {line} leads through more than {DEEPEST} keys, tables or lists")
            if sign != ".":
                around.append(depth)
        elif sign in "]}" and len(around) > 1:
            around.pop()
            depth = around[-1]
        elif sign in ",\n":
            depth = around[-1]


def suggest_nearest(word: Any, choices: Iterable[str]) -> str:
    """A question that offers the choice spelled most like a word, or nothing."""
    found = difflib.get_close_matches(word[:SHOWN], list(choices), n=1) if isinstance(word, str) else ()
    return f"; did you mean {shorten_text(found[0], SHOWN)!r}?" if found else ""


def shorten_text(text: str, most: int) -> str:
    """The text, or its beginning and three dots."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def write_value(value: Any, depth: int = DEEPEST_WRITTEN, most: int | None = None) -> str:
    """A value as TOML in one line; ``most``: what a complaint shows of it. Raises SceneError for no TOML."""
    if isinstance(value, (dict, list)) and not depth:
        if most is None:
            raise SceneError("tables or lists nested too deeply to be written")
        return "..."
    if isinstance(value, dict):
        items = itertools.islice(value.items(), most)
        pairs = ", ".join(f"{write_key(key, most)} = {write_value(item, depth - 1, most)}" for key, item in items)
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, list):
        return f"[{', '.join(write_value(item, depth - 1, most) for item in value[:most])}]"
    if isinstance(value, str):
        return _quote(value, most)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and value.bit_length() > LONGEST:
        if most is None:
            raise SceneError(f"{show_toml(value)} cannot be written: too many digits")
        return hex(value)  # Python refuses to write thousands of decimals
    if most is None and not isinstance(value, (int, float)):
        raise SceneError(f"{show_toml(value)} cannot be written: no key of a scene has such a value")
    return f"{value}"


def write_key(key: str, most: int | None = None) -> str:
    """A key as TOML writes it, in quotes where it needs them; ``most``: what a complaint shows of it."""
    text = key if PLAIN_KEY.fullmatch(key) else _quote(key, most)
    return text if most is None else shorten_text(text, SHOWN_KEY)


def _quote(text: str, most: int | None) -> str:
    """A string between quotes, or its beginning, control characters escaped. Raises SceneError for half a character."""
    if most is None and any("\ud800" <= sign <= "\udfff" for sign in text):
        raise SceneError(f"{show_toml(text)} cannot be written: it has half a character, which no text in UTF-8 holds")
    signs = json.dumps(text if most is None else text[: most + 1], ensure_ascii=False)
    return "".join(sign if sign.isprintable() else f"\\U{ord(sign):08x}" for sign in signs)


def show_toml(value: Any) -> str:
    """A value of the file as TOML writes it, in one short piece."""
    return shorten_text(write_value(value, SHOWN_DEPTH, SHOWN), SHOWN)


def show_key(key: str) -> str:
    """A key as TOML writes it, in one short piece."""
    return write_key(key, SHOWN)


def write_toml(content: dict[str, Any]) -> str:
    """A scene file's content as TOML, values before tables. Raises SceneError for what no scene file holds."""
    headed = {key: value for key, value in content.items() if are_tables(value if isinstance(value, list) else [value])}
    lines = write_lines({key: value for key, value in content.items() if key not in headed})
    for key, value in headed.items():
        name = write_key(key)
        if isinstance(value, list):
            tables = [(f"[[{name}]]", table) for table in value]
        elif key == "particles" and are_tables([*value.values()]):
            tables = [(f"[{name}.{write_key(kind)}]", table) for kind, table in value.items()]
        else:
            tables = [(f"[{name}]", value)]
        for heading, table in tables:
            lines += ["", heading, *write_lines(table)]
    return "\n".join(lines).lstrip("\n") + "\n"


def write_lines(table: dict[str, Any]) -> list[str]:
    """The lines of a table below its heading."""
    return [f"{write_key(key)} = {write_value(value)}" for key, value in table.items()]


def are_tables(values: list[Any]) -> bool:
    """Whether values of the file are tables, at least one."""
    return bool(values) and all(isinstance(value, dict) for value in values)


def read_fraction(value: Any) -> float | None:
    """A number, also one in per cent as a text, "5 %", or None."""
    if isinstance(value, str) and (found := PER_CENT.fullmatch(value)):
        return float(found[1]) / 100.0
    return float(value) if is_number(value) else None


@dataclass(frozen=True, eq=False)
class Table:
    """The ``content`` of a table at a ``place`` (() for the file). Raises SceneError for a key not ``allowed``."""

    place: Place
    content: dict[str, Any]
    allowed: tuple[str, ...]

    def __post_init__(self) -> None:
        for key in self.content:
            if key not in self.allowed:
                hint = suggest_nearest(key, self.allowed) or "."
                raise self.wrong(key, f"unknown key{hint} Allowed: {', '.join(self.allowed)}")

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def wrong(self, key: str, complaint: str) -> SceneError:
        """The error to raise: dotted key, value given, complaint."""
        place = (*self.place, key)
        given = f" = {show_toml(self.content[key])}" if key in self.content else ""
        return SceneError(f"{show_place(place)}{given}: {complaint}", *place)

    def unfit(self, complaint: str) -> SceneError:
        """The error to raise about the table: its keys do not go together."""
        return SceneError(f"{show_place(self.place)}: {complaint}", *self.place)

    def required(self, key: str, allowed: str) -> Any:
        """The value of a key that must be there; ``allowed`` says in words what it may be."""
        if key not in self.content:
            raise self.wrong(key, f"is missing; it must be {allowed}")
        return self.content[key]

    def table(self, key: str, allowed: tuple[str, ...]) -> "Table":
        """The table below ``key``."""
        value = self.content[key]
        if not isinstance(value, dict):
            raise self.wrong(key, f"must be a table with the keys {', '.join(allowed)}")
        return Table((*self.place, key), value, allowed)

    def exactly_one(self, *keys: str) -> None:
        """Refuses a table with none of the keys, or with several."""
        if sum(key in self for key in keys) != 1:
            raise self.unfit(f"exactly one of {', '.join(keys[:-1])} and {keys[-1]} is needed")

    def right(self, key: str, allowed: str, is_right: Callable[[Any], bool]) -> Any:
        """The value at ``key`` if it is right; ``allowed`` says in words what would be."""
        value = self.required(key, allowed)
        if not is_right(value):
            raise self.wrong(key, f"must be {allowed}")
        return value

    def number(self, key: str, allowed: str = "") -> float:
        """The real number at ``key``; inf passes, NaN does not."""
        return float(self.right(key, allowed or "a number", lambda value: is_number(value) and not math.isnan(value)))

    def fraction(self, key: str, allowed: str = "") -> float:
        """The number at ``key``, or per cent as a text: "5 %" is 0.05."""
        found = read_fraction(self.content.get(key))
        return self.number(key, allowed) if found is None or math.isnan(found) else found

    def whole(self, key: str, low: int, high: int) -> int:
        """The whole number at ``key``, within [low, high]."""
        allowed = f"a whole number from {low} to {high}"
        return int(self.right(key, allowed, lambda value: type(value) is int and low <= value <= high))

    def flag(self, key: str) -> bool:
        """The truth value at ``key``."""
        return bool(self.right(key, "true or false", lambda value: isinstance(value, bool)))

    def choice(self, key: str, choices: Collection[str]) -> str:
        """The word at ``key``, one of ``choices``."""
        given = self.content.get(key)
        allowed = " or ".join(f'"{word}"' for word in choices) + (
            "" if given in choices else suggest_nearest(given, choices)
        )
        return str(self.right(key, allowed, lambda value: isinstance(value, str) and value in choices))

    def numbers(self, key: str) -> list[float]:
        """The numbers at ``key``: one, a list, or a range { start, stop, count } with both ends."""
        value = self.required(key, NUMBERS)
        if not isinstance(value, dict):
            values = value if isinstance(value, list) else [value]
            if not values or not all(is_number(item) and math.isfinite(item) for item in values):
                raise self.wrong(key, f"must be {NUMBERS}, all finite")
            return [float(item) for item in values]
        part = self.table(key, RANGE_KEYS)
        start, stop = (part.number(end, "a finite number") for end in RANGE_KEYS[:2])
        count = part.whole("count", 1, LARGEST_COUNT)
        if not math.isfinite(stop - start):
            raise self.wrong(key, "start and stop must be finite numbers, and so must be their difference")
        if count == 1 and start != stop:
            raise part.wrong("count", "one value needs start = stop")
        return np.linspace(start, stop, count).tolist()


def show_place(place: Place, most: int | None = SHOWN) -> str:
    """A place as complaints name it, layers counted from 1; without ``most``, as a dotted key with nothing left out."""
    steps = (f"[{step + 1}]" if isinstance(step, int) else f".{write_key(step, most)}" for step in place)
    return "".join(steps).removeprefix(".")


def convert_to_plain_content(value: Any) -> Any:
    """Content as a file would give it: arrays and tuples are lists there."""
    if isinstance(value, Mapping):
        return {str(key): convert_to_plain_content(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [convert_to_plain_content(item) for item in value] if isinstance(value, (list, tuple)) else value


def split_key(key: str) -> Place:
    """A dotted key as keys of tables (text) and places in lists (numbers from 0)."""
    places: list[str | int] = []
    position = 0
    while match := STEP.match(key, position):
        places.append(match[1].strip("\"'"))
        places += [int(place) - 1 for place in re.findall(r"\d+", match[2])]
        position = match.end()
        if key[position : position + 1] != ".":
            break
        position += 1
    if position != len(key) or not places or -1 in places:
        words = "is no key of a scene, such as layer[1].thickness or particles.gold.radius_um"
        raise SceneError(f"{show_toml(key)} {words}")
    return tuple(places)


def put(content: dict[str, Any], places: Place, value: float | int) -> None:
    """Sets the number at a place, a path of keys and indices, in the content of a file."""
    reduce(getitem, places[:-1], cast(Any, content))[places[-1]] = value


def find_number(content: Mapping[str, Any], places: Place, key: str, default: float | None = None) -> float:
    """The number at a place, also one in per cent as a text, or ``default`` where its table has no such key yet. Raises
    SceneError, naming ``key``."""
    try:
        parent: Any = reduce(getitem, places[:-1], cast(Any, content))
        missing = default is not None and isinstance(parent, dict)
        there = parent.get(places[-1], default) if missing else parent[places[-1]]
    except (LookupError, TypeError):
        raise SceneError(f"the scene has no {put_in_one_line(key)}") from None
    if (number := read_fraction(there)) is None:
        raise SceneError(f"{key} is {show_toml(there)}, and only a number can be changed")
    return number


@contextmanager
def locate_errors(
    place: Place,
    keys: Iterable[str] = (),
    outside: Iterable[str] = (),
    given_as: GivenAs = MappingProxyType({}),
    keys_only: bool = False,
) -> Iterator[None]:
    """Puts the dotted key of a table, or of that of its ``keys`` (``given_as``: by argument) that a SceneError is
    about, in front of it; names ``outside`` stay its place; ``keys_only``: an error of no key stays as it is."""
    try:
        yield
    except SceneError as error:
        name = str(error.place[0]) if error.place else ""
        key, words = given_as.get(name, (name, None))
        owner = next((step for step in reversed(place) if isinstance(step, str)), "")
        sentence = str(error).removeprefix(f"{owner}: ")  # whose argument it is, where the place says so
        if key in {*keys}:
            sentence = sentence.removeprefix(name) if words is None else f": {words}{sentence}"
            raise SceneError(f"{show_place((*place, key))}{sentence}", *place, key) from error
        if keys_only:
            raise
        elsewhere = error.place if error.place[:1] in {(name,) for name in outside} else place
        raise SceneError(f"{show_place(place)}: {sentence}", *elsewhere) from error


def is_number(value: Any) -> bool:
    """Whether a TOML value is a number that a float can hold; true and false are none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True
