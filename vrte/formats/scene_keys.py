"""Dotted keys of numbers in a scene file's content, such as layer[1].thickness: read, found and set."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from vrte.basics.errors import Place, SceneError
from vrte.formats.toml_table import is_number, show_toml

STEP = re.compile(r"""([A-Za-z0-9_-]+|"[^"]*"|'[^']*')(?:\[(\d+)\])?""")  # a key, and a place in its list


def convert_to_plain_content(value: Any) -> Any:
    """Content as a file would give it: arrays and tuples are lists there."""
    if isinstance(value, Mapping):
        return {str(key): convert_to_plain_content(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [convert_to_plain_content(item) for item in value] if isinstance(value, (list, tuple)) else value


def convert_to_plain_number(value: float) -> float | int:
    """A number as a file would give it: what counts something is a whole one."""
    return int(value) if float(value).is_integer() else float(value)


def split_key(key: str) -> Place:
    """A dotted key as keys of tables (text) and places in lists (numbers from 0)."""
    places: list[str | int] = []
    position = 0
    while match := STEP.match(key, position):
        places.append(match[1].strip("\"'"))
        if match[2] is not None:
            places.append(int(match[2]) - 1)
        position = match.end()
        if key[position : position + 1] != ".":
            break
        position += 1
    if position != len(key) or not places or -1 in places:
        words = "is no key of a scene, such as layer[1].thickness or particles.gold.radius_um"
        raise SceneError(f"{show_toml(key)} {words}")
    return tuple(places)


def find_parent(content: Any, places: Place) -> Any:
    """The table or list that holds the last place; KeyError, IndexError or TypeError where there is none."""
    for place in places[:-1]:
        content = content[place]
    return content


def put(content: dict[str, Any], places: Place, value: float | int) -> None:
    """Sets one number."""
    find_parent(content, places)[places[-1]] = value


def find_number(content: Mapping[str, Any], places: Place, key: str, default: float | None = None) -> float:
    """The number at a place, or ``default`` where its table has no such key yet. Raises SceneError, naming ``key``."""
    try:
        parent = find_parent(content, places)
        missing = default is not None and isinstance(parent, dict)
        there = parent.get(places[-1], default) if missing else parent[places[-1]]
    except (LookupError, TypeError):
        raise SceneError(f"the scene has no {key}") from None
    if not is_number(there):
        raise SceneError(f"{key} is {show_toml(there)}, and only a number can be changed")
    return float(there)
