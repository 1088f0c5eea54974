"""What the viewer keeps for each browser tab: its scene, its result, what it looks at; nobody sees another's."""

import copy
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vrte.app.form.checks import PartRead, find_problems, list_parts, name_part
from vrte.app.form.content import START, Content
from vrte.app.form.fields import translate_message
from vrte.app.solving.messages import Adopt, Fit, Fitted, Look, Outcome, Solve, Task
from vrte.app.solving.page_files import Uploads
from vrte.app.solving.worker_process import Job, LiveQuery
from vrte.basics.errors import Place
from vrte.formats.named import find_named_tables

MOST_TABS = 100
MOST_SAID = 100  # sentences about parts that are made from files
MOST_BYTES = 2e9  # of all results together; the tabs that were not used for longest lose theirs first


@dataclass
class TabSession:
    """A tab's: the form's ``content``, which may name the tables of its ``uploads``; the ``job`` that runs, the last
    ``outcome`` and the job that it was ``taken`` of; ``view``, what it looks at, and how many ``pages`` look; the first
    field that is ``wrong``: its message, and its place.

    ``parts_read`` describes parts that are made from files, of which ``looked`` is the one that a job ``looks`` at;
    ``live`` answers what the scene looks like, ``beside`` what it shows beside a measurement, to which a job ``fits``
    it; ``fitted`` is what that found."""

    content: Content
    uploads: Uploads = field(default_factory=Uploads)
    outcome: Outcome | None = None
    job: Job | None = None
    view: dict[str, Any] = field(default_factory=dict)
    pages: int = 0
    wrong: tuple[str, Place] | None = None
    taken: Job | None = None
    parts_read: dict[str, PartRead] = field(default_factory=dict)
    looks: Job | None = None
    live: LiveQuery = field(default_factory=LiveQuery)
    beside: LiveQuery = field(default_factory=LiveQuery)
    fits: Job | None = None
    fitted: Fitted | None = None
    looked: tuple[str, Place] = ("", ())

    @property
    def busy(self) -> bool:
        """Whether something runs."""
        return self.job is not None and not self.job.ended

    def start(self, task: Task | None = None) -> None:
        """A task, or to solve what the form says now, in place of the one that runs."""
        self.cancel()
        self.job = Job(task or Solve(copy.deepcopy(self.content), self.uploads.folder))

    def start_adopting(self, given: bytes | str) -> None:
        """Starts to read a scene from a file's bytes or a link's text, in place of the job that runs."""
        self.start(Adopt(given, self.uploads.folder, self.uploads.names))

    def cancel(self) -> None:
        """Ends the job that runs."""
        end(self.job)

    def start_fit(self, task: Fit) -> None:
        """A fit in place of the one that runs, beside whatever is solved."""
        self.end_fit()
        self.fits = Job(task)

    def end_fit(self) -> None:
        """Ends the fit, and forgets what it found."""
        end(self.fits)
        self.fits = self.fitted = None

    def take_fit(self) -> None:
        """What a fit brought once it has ended: its last step where it died, nothing where it has made none."""
        job = self.fits
        if self.fitted is not None or job is None or not job.ended:
            return
        if isinstance(job.outcome, Fitted):
            self.fitted = job.outcome
        elif job.step is not None and isinstance(job.task, Fit):
            self.fitted = Fitted.of_step(job.task, job.step, job.message)

    def leave(self) -> None:
        """A page has gone for good: nobody waits for what it solves, unless the tab has another."""
        self.pages -= 1
        if self.pages == 0:
            self.rest()

    def rest(self) -> None:
        """Ends what nobody waits for."""
        end(self.job)
        end(self.fits)
        self.live.close()
        self.beside.close()

    def find_problems(self) -> dict[Place, str]:
        """What is wrong with the scene, by place. Parts that are made from files are looked at aside, one by one."""
        found = find_problems(self.content, self.uploads.folder, self.uploads.names, self.parts_read)
        places = list_parts(self.content, self.uploads.names)
        unknown = next((place for place in places if name_part(self.content, place) not in self.parts_read), None)
        if unknown is not None and self.looks is None:
            self.looks = Job(Look(copy.deepcopy(self.content), self.uploads.folder, unknown))
            self.looked = name_part(self.content, unknown), unknown
        return {place: translate_message(message, self.content) for place, message in found.items()}

    def has_looked(self) -> bool:
        """Whether there is something new to say of a part."""
        if self.looks is None or not self.looks.ended:
            return False
        name, place = self.looked
        found, message = self.looks.outcome, self.looks.message
        self.parts_read[name] = found if isinstance(found, PartRead) else PartRead(message=message, place=place)
        self.looks = None
        while len(self.parts_read) > MOST_SAID:
            del self.parts_read[next(iter(self.parts_read))]
        return True

    def close(self) -> None:
        """Ends whatever runs, and removes its files."""
        end(self.looks)
        self.rest()
        self.uploads.close()


def end(job: Job | None) -> None:
    """Ends a job, where there is one."""
    if job is not None:
        job.cancel()


class TabSessions:
    """All tabs. ``content`` and ``outcome`` are what a new one begins with; tables lie in ``folder``."""

    def __init__(self, content: Content | None = None, folder: Path = Path(), outcome: Outcome | None = None) -> None:
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
            sizes = {name: one.outcome.size for name, one in self._sessions.items() if one.outcome is not None}
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
