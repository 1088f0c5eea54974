"""The content of a scene file as TOML that reads back the same."""

import json
import math
import re
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.toml_table import show_toml

PLAIN_KEY = re.compile("[A-Za-z0-9_-]+")
LONGEST = 10_000  # bits of a whole number; Python writes and reads no more than 4300 digits
DEEPEST = 50  # tables in tables; the parser gives up not far beyond


def write_toml(content: dict[str, Any]) -> str:
    """``content``, what `vrte.formats.scene_file.read_content` gives, as TOML: values first, then the tables.

    Raises SceneError for a value that no scene file holds: dates, and what is no TOML at all.

    >>> print(write_toml({"nodes": 8, "layer": [{"phase": "rayleigh", "thickness": float("inf")}]}), end="")
    nodes = 8
    <BLANKLINE>
    [[layer]]
    phase = "rayleigh"
    thickness = inf
    """
    lines = [f"{write_key(key)} = {write_value(value)}" for key, value in content.items() if not _is_tables(value)]
    for key, value in content.items():
        if _is_tables(value):
            lines += _write_tables(write_key(key), value)
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_tables(value: Any) -> bool:
    """Whether a value of the file has headings of its own: a table, or a list of tables."""
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(x, dict) for x in value)
    )


def _write_tables(name: str, value: dict[str, Any] | list[dict[str, Any]]) -> list[str]:
    """The lines of [name] or [[name]]; of the particles, those of [particles.kind]."""
    if isinstance(value, list):
        return [line for table in value for line in _write_table(f"[[{name}]]", table)]
    if name == "particles" and value and all(isinstance(inner, dict) for inner in value.values()):
        return [line for key, inner in value.items() for line in _write_table(f"[{name}.{write_key(key)}]", inner)]
    return _write_table(f"[{name}]", value)


def _write_table(heading: str, table: dict[str, Any]) -> list[str]:
    return ["", heading, *(f"{write_key(key)} = {write_value(value)}" for key, value in table.items())]


def write_key(key: str) -> str:
    """A key, in quotes where it needs them.

    >>> print(write_key("gold"), write_key("fool's gold"))
    gold "fool's gold"
    """
    return key if PLAIN_KEY.fullmatch(key) else quote_string(key)


def quote_string(text: str) -> str:
    """A string between quotes. Raises SceneError for half a character, which no file in UTF-8 holds."""
    if any("\ud800" <= sign <= "\udfff" for sign in text):
        raise SceneError(f"{show_toml(text)} cannot be written: it has half a character, which no text in UTF-8 holds")
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def write_value(value: Any, depth: int = DEEPEST) -> str:
    """A value in one line, tables in braces. Raises SceneError for what no scene file holds.

    >>> print(write_value([1, 0.5, True, {"start": 0.0}]))
    [1, 0.5, true, { start = 0.0 }]
    """
    if not depth:
        raise SceneError("tables or lists nested too deeply to be written")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return quote_string(value)
    if isinstance(value, int):
        if value.bit_length() > LONGEST:
            raise SceneError(f"{show_toml(value)} cannot be written: too many digits")
        return str(value)
    if isinstance(value, float):
        return "nan" if math.isnan(value) else repr(value)
    if isinstance(value, list):
        return f"[{', '.join(write_value(item, depth - 1) for item in value)}]"
    if isinstance(value, dict):
        pairs = ", ".join(f"{write_key(key)} = {write_value(item, depth - 1)}" for key, item in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    raise SceneError(f"{show_toml(value)} cannot be written: no key of a scene has such a value")
