"""What the viewer keeps for each tab: its scene, its result, what it looks at, its files; no tab sees another's.

Tables that a scene names are those it began with, and those put into the page: they get a name of plain
letters, and a folder that goes with their tab. Files that are handed out are made in a folder that goes again.
"""

import copy
import io
import re
import shutil
import tempfile
import threading
import weakref
import zipfile
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vrte.app.form.checks import PartRead, find_problems, list_parts, name_part, write_content
from vrte.app.form.content import START, Content, list_page_wavelengths
from vrte.app.form.fields import translate_message
from vrte.app.solving.worker import EMPTY, Fitted, Outcome, Query, Refused, Task
from vrte.basics.errors import Place, SceneError
from vrte.exports.polarized import check_wavelengths, choose_five
from vrte.formats import save
from vrte.formats.scene_file import find_named_tables
from vrte.formats.toml_table import show_toml
from vrte.results.brdf import Spectrum

Found = TypeVar("Found")
LARGEST_TABLE = 60_000_000  # bytes of a file from which a phase matrix or a base is made, in a process of its own
LARGEST_LIST = 500_000  # of one that every check of the form reads: n and k, sizes
MOST_TABLES, LARGEST_UPLOADS = 20, 150_000_000  # files that a tab may put in, and bytes of all of them
LONGEST_STEM = 40  # characters of a name before its suffix


class Uploads:
    """The ``names`` of tables that a tab's scene may name, in ``folder``; ``own``: bytes of those put in."""

    def __init__(self, folder: Path = Path(), names: Collection[str] = ()) -> None:
        self.folder, self.names = folder, frozenset(names)
        self.own: dict[str, int] = {}
        self._remove: Callable[[], Any] | None = None  # the folder of those put in; by itself once nothing refers to it

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
        """Removes files that no field names any more where there is no room for another. Raises SceneError."""
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
                with suppress(OSError):  # gone: the reader reports it
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
    found = choose_five(list_page_wavelengths(content))
    try:
        check_wavelengths(found)
    except SceneError as error:
        raise SceneError(f"wavelength_um: {error}") from error
    return tuple(found)


def make_colours_download(live: Any, content: Content, with_comma: bool = False) -> tuple[str, bytes]:
    """Name and bytes of what the tab Appearance shows of the scene, as a table for spreadsheets: with decimal commas
    and semicolons where they write those. Raises SceneError before it shows all."""
    from vrte.app.solving.appearance import Appeared
    from vrte.pictures.appearance import write_table

    if not isinstance(live.answer, Appeared) or live.waits or live.answered is None or live.answered.content != content:
        raise SceneError("there are no colours of this scene yet: open the tab Appearance, and wait for its answer")
    return "colours.csv", write_table(live.answer.readings, with_comma).encode("utf-8-sig")


MOST_TABS = 100
MOST_SAID = 100  # sentences about parts that are made from files
MOST_BYTES = 2e9  # of all results together; the tabs that were not used for longest lose theirs first


@dataclass
class TabSession:
    """A tab's: the form's ``content``, which may name the tables of its ``uploads``; the last ``outcome``; ``view``,
    what it looks at, and how many ``pages`` look; the first field that is ``wrong``: its message, and its place;
    ``parts_read``, which describes parts that are made from files.

    It asks worker processes for ``solves``; for the appearance, ``live``, and shows ``beside`` a
    measurement; for ``fits`` to that, of which ``fitted`` is what the last one found; for ``matches`` to a target; and
    for ``looks`` at a part."""

    content: Content
    uploads: Uploads = field(default_factory=Uploads)
    outcome: Outcome = EMPTY
    view: dict[str, Any] = field(default_factory=dict)
    pages: int = 0
    wrong: tuple[str, Place] | None = None
    parts_read: dict[str, PartRead] = field(default_factory=dict)
    solves: Query = field(default_factory=Query)
    looks: Query = field(default_factory=Query)
    fits: Query = field(default_factory=Query)
    matches: Query = field(default_factory=Query)
    live: Query = field(default_factory=lambda: Query(stays=True))
    beside: Query = field(default_factory=lambda: Query(stays=True))
    fitted: Fitted | None = None

    def make_task(self, call: str, content: Any = None, **more: Any) -> Task:
        """A task about the form's content, or another's."""
        return Task(call, self.content if content is None else content, self.uploads.folder, more)

    def start(self, task: Task | None = None) -> None:
        """Starts a task, by default a solve of the form's scene, in place of the running one."""
        self.solves.ask(task or self.make_task("solve.solve"))

    def start_adopting(self, given: bytes | str) -> None:
        """Starts to read a scene from a file's bytes or a link's text, in place of the job that runs."""
        self.start(self.make_task("solve.adopt", given, names=self.uploads.names))

    def start_fit(self, task: Task) -> None:
        """A fit in place of the one that runs, beside whatever is solved."""
        self.end_fit()
        self.fits.ask(task)

    def end_fit(self) -> None:
        """Ends the fit, and forgets what it found."""
        self.fits.forget()
        self.fitted = None

    def take_fit(self) -> None:
        """What a fit brought once it has ended: its last step where it died, nothing where it has made none."""
        answer, task, step = self.fits.answer, self.fits.task, self.fits.step
        if self.fitted is None and isinstance(answer, Fitted):
            self.fitted = answer
        elif self.fitted is None and isinstance(answer, Refused) and task is not None and step is not None:
            self.fitted = Fitted.of_step(task, step, answer.message)

    def leave(self) -> None:
        """Ends the solves of a page that was closed, unless its tab has another page."""
        self.pages -= 1
        if self.pages == 0:
            self.rest()

    def rest(self) -> None:
        """Ends the solves whose pages are closed."""
        for query in (self.solves, self.fits, self.matches, self.live, self.beside):
            query.close()

    def find_problems(self) -> dict[Place, str]:
        """What is wrong with the scene, by place. Parts that are made from files are looked at aside, one by one."""
        found = find_problems(self.content, self.uploads.folder, self.uploads.names, self.parts_read)
        places = list_parts(self.content, self.uploads.names)
        unknown = next((place for place in places if name_part(self.content, place) not in self.parts_read), None)
        if unknown is not None and self.looks.task is None:
            self.looks.ask(self.make_task("solve.look_at_part", place=unknown))
        return {place: translate_message(message, self.content) for place, message in found.items()}

    def has_looked(self) -> bool:
        """Whether a check of one of the scene's files has ended; its result is kept."""
        task, found = self.looks.task, self.looks.take()
        if task is None or found is None:
            return False
        place = task.more["place"]
        self.looks.forget()
        read = found if isinstance(found, PartRead) else PartRead(message=found.message, place=place)
        self.parts_read[name_part(task.content, place)] = read
        while len(self.parts_read) > MOST_SAID:
            del self.parts_read[next(iter(self.parts_read))]
        return True

    def close(self) -> None:
        """Ends whatever runs, and removes its files."""
        self.looks.close()
        self.rest()
        self.uploads.close()


class TabSessions:
    """All tabs. ``content`` and ``outcome`` are what a new one begins with; tables lie in ``folder``."""

    def __init__(self, content: Content | None = None, folder: Path = Path(), outcome: Outcome = EMPTY) -> None:
        self._first = content or START
        self._folder, self._outcome = folder, outcome
        self._tables = frozenset(find_named_tables(self._first).values())
        self._sessions: dict[str, TabSession] = {}
        self._lock = threading.Lock()

    def of(self, tab: str) -> TabSession:
        """The session of a tab, a new one where there is none."""
        with self._lock:
            session = self._sessions.pop(tab, None) or TabSession(
                copy.deepcopy(self._first), Uploads(self._folder, self._tables), self._outcome
            )
            self._sessions[tab] = session  # the last used is the last
            sizes = {name: one.outcome.size for name, one in self._sessions.items()}
            while len(self._sessions) > 1 and (len(self._sessions) > MOST_TABS or sum(sizes.values()) > MOST_BYTES):
                oldest = next(iter(self._sessions))
                self._sessions.pop(oldest).close()
                sizes.pop(oldest, None)
            return session

    def close(self) -> None:
        """Ends whatever runs."""
        with self._lock:
            for session in self._sessions.values():
                session.close()
