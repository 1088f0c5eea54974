"""Files that come into the viewer and go out.

Tables that a scene names are those it began with, and those that somebody puts into the page: they get a name of plain
letters, and a folder that goes with their tab. Files that are handed out are made in a folder that goes again.
"""

import io
import re
import shutil
import tempfile
import weakref
import zipfile
from collections.abc import Callable, Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vrte.app.form.content import Content, list_page_wavelengths
from vrte.app.form.files import write_content
from vrte.app.solving.worker import Outcome
from vrte.basics.errors import SceneError
from vrte.formats import save
from vrte.formats.measured_polarized import check_wavelengths
from vrte.formats.scene_file import find_named_tables
from vrte.formats.toml_table import show_toml
from vrte.results.spectrum import Spectrum

Found = TypeVar("Found")
LARGEST_TABLE = 60_000_000  # bytes of a file from which a phase matrix or a base is made, in a process of its own
LARGEST_LIST = 500_000  # of one that every check of the form reads: n and k, sizes
MOST_TABLES, LARGEST_UPLOADS = 20, 150_000_000  # files that a tab may put in, and bytes of all of them
LONGEST_STEM = 40  # characters of a name before its suffix
TENSOR_UM = 0.45, 0.5, 0.55, 0.6, 0.65


class Uploads:
    """The ``names`` of tables that a tab's scene may name, in ``folder``; ``own``: bytes of those put in."""

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
        check_size(given, len(data), most)
        self._make_room(len(data), named)
        self._move_in()
        for name in (f"{stem}{suffix}", *(f"{stem}-{k}{suffix}" for k in range(2, 10 * MOST_TABLES))):
            path = self.folder / name
            if name in self.own and path.read_bytes() == data:
                return name
            if not path.exists():  # a table never changes under its name: results name their scene by it
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
        """Those that no field names any more go where there is no room for another. Raises SceneError."""
        unnamed = [name for name in self.own if name not in named]
        while len(self.own) >= MOST_TABLES or sum(self.own.values()) + size > LARGEST_UPLOADS:
            if not unnamed:
                raise SceneError(f"a page takes at most {MOST_TABLES} files, {LARGEST_UPLOADS / 1e6:g} MB in all")
            name = unnamed.pop(0)
            (self.folder / name).unlink()
            self.names -= {name}
            del self.own[name]

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


def check_size(name: str, size: int, most: int) -> None:
    """Whether a file is small enough. Raises SceneError."""
    if size > most:
        raise SceneError(f"{show_toml(name)} has {size / 1e6:.3g} MB, and at most {most / 1e6:g} MB are taken here")


def split_name(given: str, suffixes: tuple[str, ...]) -> tuple[str, str]:
    """A file's name in letters, digits and dashes, and its suffix. Raises SceneError."""
    found = next((suffix for suffix in suffixes if given.lower().endswith(suffix)), "")
    if not found or re.search(r"[/\\\0]", given):
        raise SceneError(f"{show_toml(given)} is no plain name of a file that ends in {' or '.join(suffixes)}")
    stem = re.sub(r"[^A-Za-z0-9_]+", "-", given[: -len(found)]).strip("-")
    return stem[:LONGEST_STEM] or "table", found


def collect_bytes(name: str, write: Callable[[Path], Any]) -> bytes:
    """What a call writes to a file of that name."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def read_bytes(data: bytes, suffix: str, read: Callable[[Path], Found]) -> Found:
    """What a call reads from a file with these bytes. Raises SceneError, without where the file lies."""
    with tempfile.TemporaryDirectory(prefix="vrte-view-") as folder:
        path = Path(folder) / f"file{suffix}"
        path.write_bytes(data)
        try:
            return read(path)
        except SceneError as error:
            raise SceneError(str(error).replace(str(path), "the file")) from error


def make_result_download(kind: str, outcome: Outcome, suffix: str, which: int = 0) -> tuple[str, bytes]:
    """Name and bytes of the "brdf" at all wavelengths or the "field" at one. Raises SceneError without one."""
    found: Any = outcome.brdfs if kind == "brdf" else outcome.fields[which : which + 1]
    if not found and kind == "brdf":
        raise SceneError("there is no BRDF to download: solve a scene, or open a file that holds one")
    if not found:
        raise SceneError('there is no field to download: turn on "Inside the layers" and solve')
    found = Spectrum(np.array(outcome.wavelength_um), found) if len(found) > 1 else found[0]
    return f"{kind}{suffix}", collect_bytes(f"{kind}{suffix}", lambda path: save(found, path))


def make_scene_download(content: Content, uploads: Uploads) -> tuple[str, bytes]:
    """Name and bytes of the scene, in an archive with the files that it names. Raises SceneError, OSError."""
    scene = write_content(content)
    named = [name for name in find_named_tables(content).values() if not Path(name).is_absolute()]
    names = sorted({name for name in named if ".." not in Path(name).parts} & uploads.names)  # those beside it
    if not names:
        return "scene.toml", scene.encode()
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("scene.toml", scene)
        for name in names:
            archive.writestr(name, (uploads.folder / name).read_bytes())
    return "scene.zip", packed.getvalue()


def choose_tensor_wavelengths(content: Content) -> tuple[float, ...]:
    """The five wavelengths [um] of Mitsuba's tensor: the form's where these are five, else five from its first to its
    last, or those of the visible where it has one. Raises SceneError where they are none."""
    given = list_page_wavelengths(content)
    if len(given) < 2:
        return TENSOR_UM
    found = given if len(given) == len(TENSOR_UM) else np.linspace(given[0], given[-1], 5).round(3).tolist()
    try:
        check_wavelengths(found)
    except SceneError as error:
        raise SceneError(f"wavelength_um: {error}") from error
    return tuple(found)


def make_colours_download(live: Any, content: Content) -> tuple[str, bytes]:
    """Name and bytes of what the tab Appearance shows of the scene. Raises SceneError before it shows all."""
    from vrte.app.solving.appearance import Appeared
    from vrte.pictures.appearance import write_table

    if not isinstance(live.answer, Appeared) or live.waits or live.answered is None or live.answered.content != content:
        raise SceneError("there are no colours of this scene yet: open the tab Appearance, and wait for its answer")
    return "colours.csv", write_table(live.answer.readings).encode()
