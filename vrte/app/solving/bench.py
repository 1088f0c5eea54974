"""What the viewer keeps for each browser tab: its scene, its result, what it looks at; nobody sees another's."""

import copy
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vrte.app.form.checks import find_problems
from vrte.app.form.content import START, Content
from vrte.app.form.parts import Said, list_parts, name_part
from vrte.app.form.words import translate_message
from vrte.app.solving.job import Job, find_memory_share
from vrte.app.solving.live import COMPARER, Live
from vrte.app.solving.messages import Adopt, Fit, Fitted, Look, Outcome, Solve, Task, keep_step
from vrte.app.solving.shelf import Shelf
from vrte.basics.errors import Place
from vrte.formats.named import find_named_tables

MOST_TABS = 100
MOST_SAID = 100  # sentences about parts that are made from files
MOST_BYTES = 2e9  # of all results together; the tabs that were not used for longest lose theirs first


@dataclass
class Bench:
    """A tab's: the form's ``content``, which may name the tables of its ``shelf``, the ``job`` that runs, the last
    ``outcome`` and the job that it was ``taken`` of, ``view``, what it looks at, how many ``pages`` look, the first
    field that is ``wrong``: its message, and its place; and what has been ``said`` of parts that are made from files,
    of which ``looked`` is the one that a job ``looks`` at; ``adopts`` reads a stranger's scene; ``live`` answers what
    it looks like, ``beside`` what it shows beside a measurement, to which a job ``fits`` it; ``fitted`` is what that
    found."""

    content: Content
    shelf: Shelf = field(default_factory=Shelf)
    outcome: Outcome | None = None
    job: Job | None = None
    view: dict[str, Any] = field(default_factory=dict)
    pages: int = 0
    wrong: tuple[str, Place] | None = None
    taken: Job | None = None
    said: dict[str, Said] = field(default_factory=dict)
    looks: Job | None = None
    adopts: Job | None = None
    live: Live = field(default_factory=Live)
    beside: Live = field(default_factory=lambda: Live(COMPARER))
    fits: Job | None = None
    fitted: Fitted | None = None
    looked: tuple[str, Place] = ("", ())

    @property
    def busy(self) -> bool:
        """Whether something runs."""
        return self.job is not None and not self.job.ended

    def solve(self) -> None:
        """Starts to solve what the form says now."""
        self.start(Solve(copy.deepcopy(self.content), self.shelf.folder, find_memory_share()))

    def start(self, task: Task) -> None:
        """A task in place of the one that runs."""
        self.cancel()
        self.job = Job(task)

    def adopt(self, given: bytes | str) -> Job:
        """Starts to read a scene from a file's bytes or a link's text, in place of the one that is being read."""
        if self.adopts is not None:
            self.adopts.cancel()
        self.adopts = Job(Adopt(given, self.shelf.folder, self.shelf.names))
        return self.adopts

    def cancel(self) -> None:
        if self.job is not None:
            self.job.cancel()

    def start_fit(self, task: Fit) -> None:
        """A fit in place of the one that runs, beside whatever is solved."""
        self.end_fit()
        self.fits = Job(task)

    def end_fit(self) -> None:
        """Ends the fit, and forgets what it found."""
        if self.fits is not None:
            self.fits.cancel()
        self.fits = self.fitted = None

    def take_fit(self) -> None:
        """What a fit brought once it has ended: its last step where it died, nothing where it has made none."""
        job = self.fits
        if self.fitted is not None or job is None or not job.ended:
            return
        if isinstance(job.outcome, Fitted):
            self.fitted = job.outcome
        elif job.step is not None and isinstance(job.task, Fit):
            self.fitted = keep_step(job.task, job.step, job.message)

    def rest(self) -> None:
        """Ends what nobody waits for."""
        self.cancel()
        if self.adopts is not None:
            self.adopts.cancel()
        if self.fits is not None:
            self.fits.cancel()
        self.live.close()
        self.beside.close()

    def find_problems(self) -> dict[Place, str]:
        """What is wrong with the scene, by place. Parts that are made from files are looked at aside, one by one."""
        found = find_problems(self.content, self.shelf.folder, self.shelf.names, self.said)
        places = list_parts(self.content, self.shelf.names)
        unknown = next((place for place in places if name_part(self.content, place) not in self.said), None)
        if unknown is not None and self.looks is None:
            task = Look(copy.deepcopy(self.content), self.shelf.folder, find_memory_share(), unknown)
            self.looks, self.looked = Job(task), (name_part(self.content, unknown), unknown)
        return {place: translate_message(message, self.content) for place, message in found.items()}

    def has_looked(self) -> bool:
        """Whether there is something new to say of a part."""
        if self.looks is None or not self.looks.ended:
            return False
        name, place = self.looked
        found, message = self.looks.outcome, self.looks.message
        self.said[name] = found if isinstance(found, Said) else Said(message=message, place=place)
        self.looks = None
        while len(self.said) > MOST_SAID:
            del self.said[next(iter(self.said))]
        return True

    def close(self) -> None:
        """Ends whatever runs, and removes its files."""
        if self.looks is not None:
            self.looks.cancel()
        self.rest()
        self.shelf.close()


class Benches:
    """All tabs. ``content`` and ``outcome`` are what a new one begins with; tables lie in ``folder``."""

    def __init__(self, content: Content | None = None, folder: Path = Path(), outcome: Outcome | None = None) -> None:
        self._first = content or START
        self._folder, self._outcome = folder, outcome
        self._tables = frozenset(find_named_tables(self._first).values())
        self._benches: dict[str, Bench] = {}
        self._lock = threading.Lock()

    def of(self, tab: str) -> Bench:
        """The bench of a tab, a new one where there is none."""
        with self._lock:
            bench = self._benches.pop(tab, None) or Bench(
                copy.deepcopy(self._first), Shelf(self._folder, self._tables), self._outcome
            )
            self._benches[tab] = bench  # the last used is the last
            while len(self._benches) > 1 and (len(self._benches) > MOST_TABS or self._bytes() > MOST_BYTES):
                self._benches.pop(next(iter(self._benches))).close()
            return bench

    def _bytes(self) -> float:
        return sum(bench.outcome.size for bench in self._benches.values() if bench.outcome is not None)

    def close(self) -> None:
        """Ends whatever runs."""
        with self._lock:
            for bench in self._benches.values():
                bench.close()
