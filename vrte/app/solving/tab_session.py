"""What the viewer keeps for each browser tab: its scene, its result, what it looks at; nobody sees another's."""

import copy
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vrte.app.form.checks import PartRead, find_problems, list_parts, name_part
from vrte.app.form.content import START, Content
from vrte.app.form.fields import translate_message
from vrte.app.solving.page_files import Uploads
from vrte.app.solving.worker import EMPTY, Fitted, Outcome, Query, Refused, Task
from vrte.basics.errors import Place
from vrte.formats.scene_file import find_named_tables

MOST_TABS = 100
MOST_SAID = 100  # sentences about parts that are made from files
MOST_BYTES = 2e9  # of all results together; the tabs that were not used for longest lose theirs first


@dataclass
class TabSession:
    """A tab's: the form's ``content``, which may name the tables of its ``uploads``; the last ``outcome``; ``view``,
    what it looks at, and how many ``pages`` look; the first field that is ``wrong``: its message, and its place;
    ``parts_read``, which describes parts that are made from files.

    It asks worker processes for ``solves``; for what the scene looks like, ``live``, and shows ``beside`` a
    measurement; for ``fits`` to that, of which ``fitted`` is what the last one found; and for ``looks`` at a part."""

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
    live: Query = field(default_factory=lambda: Query(stays=True))
    beside: Query = field(default_factory=lambda: Query(stays=True))
    fitted: Fitted | None = None

    def make_task(self, call: str, content: Any = None, **more: Any) -> Task:
        """A task about the form's content, or another's."""
        return Task(call, self.content if content is None else content, self.uploads.folder, more)

    def start(self, task: Task | None = None) -> None:
        """A task, or to solve what the form says now, in place of the one that runs."""
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
        """A page has gone for good: nobody waits for what it solves, unless the tab has another."""
        self.pages -= 1
        if self.pages == 0:
            self.rest()

    def rest(self) -> None:
        """Ends what nobody waits for."""
        for query in (self.solves, self.fits, self.live, self.beside):
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
        """Whether there is something new to say of a part."""
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
