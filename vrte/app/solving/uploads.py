"""Tables that a scene in the viewer names: those it began with, and those that somebody puts into the page.

What comes from a page is a stranger's: it gets a name of plain letters, and a folder that goes with its tab.
"""

import re
import shutil
import tempfile
import weakref
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any

from vrte.basics.errors import SceneError
from vrte.formats.toml_table import show_toml

LARGEST_TABLE = 60_000_000  # bytes of a file from which a phase matrix or a base is made, in a process of its own
LARGEST_LIST = 500_000  # of one that every check of the form reads: n and k, sizes
MOST_TABLES, LARGEST_UPLOADS = 20, 150_000_000  # files that a tab may put in, and bytes of all of them
LONGEST_STEM = 40  # characters of a name before its suffix


class Uploads:
    """The ``names`` of the tables that a tab's scene may name, in ``folder``; those put in are in ``own``, with their
    bytes' number."""

    def __init__(self, folder: Path = Path(), names: Collection[str] = ()) -> None:
        self.folder, self.names = folder, frozenset(names)
        self.own: dict[str, int] = {}
        self._remove: Callable[[], Any] | None = None  # the folder of those put in; by itself when nobody has it

    def add(self, given: str, data: bytes, suffixes: tuple[str, ...], most: int, named: Collection[str] = ()) -> str:
        """Takes a file in; the name that a scene has it by. Those not ``named`` by the scene may have to go.

        Raises SceneError for a name, a size or a number of files that is not allowed.
        """
        stem, suffix = split_name(given, suffixes)
        if not data:
            raise SceneError(f"{show_toml(given)} is empty")
        if len(data) > most:
            raise SceneError(
                f"{show_toml(given)} has {len(data) / 1e6:.3g} MB, and at most {most / 1e6:g} MB are taken here"
            )
        self._make_room(len(data), named)
        self._move_in()
        for name in (f"{stem}{suffix}", *(f"{stem}-{k}{suffix}" for k in range(2, 10 * MOST_TABLES))):
            path = self.folder / name
            if name in self.own and path.read_bytes() == data:
                return name
            if not path.exists():  # a table never changes under its name: results tell what they are of by it
                break
        path.write_bytes(data)
        self.own[name] = len(data)
        self.names |= {name}
        return name

    def close(self) -> None:
        """Removes what has been put in."""
        if self._remove is not None:
            self._remove()
            self._remove, self.own = None, {}

    def _make_room(self, size: int, named: Collection[str]) -> None:
        """Those that no field names any more go where there is no room for another."""
        for name in [name for name in self.own if name not in named]:
            if self._has_room(size):
                break
            (self.folder / name).unlink()
            self.names -= {name}
            del self.own[name]
        if not self._has_room(size):
            raise SceneError(f"a page takes at most {MOST_TABLES} files, {LARGEST_UPLOADS / 1e6:g} MB in all")

    def _has_room(self, size: int) -> bool:
        return len(self.own) < MOST_TABLES and sum(self.own.values()) + size <= LARGEST_UPLOADS

    def _move_in(self) -> None:
        """A folder of its own, once, with the tables that there have been: by the same names, which may lead upward."""
        if self._remove is not None:
            return
        made = tempfile.mkdtemp(prefix="vrte-view-")
        self._remove = weakref.finalize(self, shutil.rmtree, made, ignore_errors=True)
        upward = max((name.count("..") for name in self.names), default=0)
        folder = Path(made).joinpath(*["beside"] * upward)
        folder.mkdir(parents=True, exist_ok=True)
        for name in self.names:
            target = folder / name
            if not Path(name).is_absolute():
                target.parent.mkdir(parents=True, exist_ok=True)
                with suppress(OSError):  # gone: whoever reads it says so
                    shutil.copyfile(self.folder / name, target)
        self.folder = folder


def split_name(given: str, suffixes: tuple[str, ...]) -> tuple[str, str]:
    """A file's name in letters, digits and dashes, and its suffix. Raises SceneError."""
    found = next((suffix for suffix in suffixes if given.lower().endswith(suffix)), "")
    if not found or re.search(r"[/\\\0]", given):
        raise SceneError(f"{show_toml(given)} is no plain name of a file that ends in {' or '.join(suffixes)}")
    stem = re.sub(r"[^A-Za-z0-9_]+", "-", given[: -len(found)]).strip("-")
    return stem[:LONGEST_STEM] or "table", found
