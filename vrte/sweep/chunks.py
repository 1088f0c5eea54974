"""What a worker does: the particles that scenes share, and chunk after chunk of scenes."""

import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import (
    AccuracyWarning,
    DeviceError,
    LongSolveWarning,
    MissingExtraError,
    SceneError,
    SweepError,
    warn_user,
)
from vrte.basics.running import Run, keep_to_one_thread, run_interruptible
from vrte.calls.brdfs import Share, make_alike_request, share_cores, solve_batches, solve_together, sort_into_batches
from vrte.calls.energy import ENERGY
from vrte.formats.scene_file import make_scene_file
from vrte.methods import make_run, solve_request
from vrte.request.request import Request
from vrte.results.brdf import Brdf
from vrte.results.field import Field
from vrte.sweep.results import TABLE, Sample, make_result, make_scene_request
from vrte.sweep.store import Work, read_work
from vrte.sweep.template import make_scene_at

FATAL = (DeviceError, MissingExtraError, OSError, SweepError)  # not one scene's fault: the sweep ends
LONGEST_MESSAGE = 500

Question = Request | Sample
Outcome = Brdf | Field | Mapping[str, Any] | Exception
Found = TypeVar("Found")
Solve = Callable[[Sequence[Question]], list[Outcome]]


@dataclass(frozen=True)
class Shared:
    """A kind of particle that scenes share, the index of one such scene, and of an appearance's wavelength."""

    particles: str
    place: tuple[int, ...]
    wavelength: int = 0


Job = int | Shared  # a chunk of scenes by its number


def perform(work: Work, job: Job, solve: Solve, backend: str = "openmp") -> int:
    """Does a job; returns its number of scenes."""
    with keep_to_one_thread():
        if isinstance(job, Shared):
            prepare(work, job)
            return 0
        return compute(work, job, solve, backend)


@lru_cache(maxsize=4)
def open_work(folder: str, stamp: str) -> Work:
    """A worker process's view of a sweep; ``stamp`` tells it from another that was begun in the same folder."""
    work = read_work(Path(folder))
    if work.stamp != stamp:
        raise SweepError(f"{folder} has been begun anew")
    return work


def prepare(work: Work, job: Shared) -> None:
    """Computes one kind of particle and keeps it; each of its scenes will report what is wrong with it."""
    content = work.sweep.content(job.place)
    kind = work.sweep.kind
    if kind == TABLE:
        kind, content["brdf"] = "brdf", {"mu_i": 1.0, "mu_o": 1.0}  # for form's sake
        content["wavelength_um"] = float(work.sweep.asked.wavelengths_um[job.wavelength])
    alone: dict[str, Any] = {key: content[key] for key in ("wavelength_um", "host_index", kind) if key in content}
    alone["particles"] = {job.particles: content["particles"][job.particles]}
    alone["layer"] = []
    for layer in content["layer"]:
        held = layer.get("particles", layer.get("volume_fractions", []))  # a name, or a table of names
        if job.particles in ([held] if isinstance(held, str) else held):
            host = {"host_index": layer["host_index"]} if "host_index" in layer else {}
            alone["layer"].append({"particles": job.particles, "thickness": 1.0} | host)
    with suppress(SceneError), collect_warnings({}):
        make_scene_file(alone, kind, work.sweep.folder, work.optics.keep)


def compute(work: Work, chunk: int, solve: Solve, backend: str) -> int:
    """Computes a chunk, writes it, then marks it done; a chunk that is done is not computed again."""
    indices = list(work.grid.places(chunk))
    if work.mark(chunk).is_file():
        return len(indices)
    work.log("begin", chunk)
    start = time.perf_counter()
    warned: dict[str, Any] = {}
    with collect_warnings(warned):
        outcomes = compute_results(work, indices, solve, backend)
    variables = work.results.variables.items()
    arrays = {name: np.full((len(indices), *shape), np.nan) for name, (_, shape) in variables}
    failed = {}
    for row, outcome in enumerate(outcomes):
        if isinstance(outcome, Exception):
            kind = "" if isinstance(outcome, SceneError) else f"{type(outcome).__name__}: "
            failed[str(row)] = kind + put_in_one_line(str(outcome), LONGEST_MESSAGE)
            continue
        for name, values in arrays.items():
            value = outcome[name] if isinstance(outcome, Mapping) else getattr(outcome, name)
            values[row] = 0.0 if value is None else value  # of surfaces that others of the table may have
    work.keep(chunk, arrays, {"failed": failed, "warnings": warned, "seconds": time.perf_counter() - start})
    work.log("end", chunk)
    return len(indices)


def compute_results(work: Work, indices: Sequence[tuple[int, ...]], solve: Solve, backend: str) -> list[Outcome]:
    """The result of each scene, or why there is none."""
    first: dict[str, Request] = {}  # by options, which axes may change, as nothing else that is asked

    def make_question(index: tuple[int, ...]) -> Question:
        found = make_scene_at(work.sweep, index, work.optics)
        if isinstance(found, Sample):
            return found
        options = repr(found.options)
        alike = make_alike_request(first[options], found.scene) if options in first else None
        request = alike or make_scene_request(found, backend)
        first.setdefault(options, request)
        return request

    asked = [try_call(partial(make_question, index)) for index in indices]
    questions = [one for one in asked if not isinstance(one, Exception)]
    answers = iter(solve(questions) if questions else ())
    return [one if isinstance(one, Exception) else next(answers) for one in asked]


def try_call(attempt: Callable[[], Found]) -> Found | Exception:
    """What it returns, or the error that it ends in, unless that ends the sweep."""
    try:
        return attempt()
    except FATAL:
        raise
    except Exception as error:
        return error


def make_processor_solver(threads: Callable[[], int] = lambda: 1, stop: Any = None) -> Solve:
    """Solves alike scenes together, others on as many threads as there are to spare; ``stop``: the flag (1,)."""
    stop = np.zeros(1, np.int32) if stop is None else stop

    def one(request: Question) -> Outcome:
        if isinstance(request, Sample):
            with share_cores(Share(threads(), stop)):
                return request.read()
        run = make_run(replace(request, threads=threads()))
        run.stop = stop
        return warn_of_energy(make_result(request, *solve_request(request, run)))

    def solve(questions: Sequence[Question]) -> list[Outcome]:
        found = solve_alike_questions(questions, stop)
        return [
            found[index] if index in found else try_call(partial(one, each)) for index, each in enumerate(questions)
        ]

    return solve


def solve_alike_questions(questions: Sequence[Question], stop: Any) -> dict[int, Outcome]:
    """Results of a chunk's scenes that batches solve, by index; a batch with an error is left to single solves."""
    groups: dict[int, list[tuple[int, Request]]] = {}
    for index, each in enumerate(questions):
        if isinstance(each, Request):  # those that differ in their scenes alone share their directions
            groups.setdefault(id(each.mu0), []).append((index, each))
    found: dict[int, Outcome] = {}
    for group in groups.values():
        indices, requests = zip(*group, strict=True)
        for batch in sort_into_batches(requests):
            run = Run(1, kernels=make_run(requests[0]).kernels, stop=stop)  # one thread: warnings are heard in it alone
            some = try_call(partial(solve_batches, requests, [batch], run))
            if not isinstance(some, Exception):
                found.update({indices[k]: result for k, result in some.items()})
    return found


def solve_on_device(questions: Sequence[Question]) -> list[Outcome]:
    """Results of a chunk's BRDFs, all at once on a device; one by one where one fails, and of fields."""
    requests = [one for one in questions if isinstance(one, Request)]
    run = Run(1)

    def solve_all() -> list[Outcome]:
        if requests[0].kind == "brdf":
            return [warn_of_energy(one) for one in run_interruptible(run, lambda: solve_together(requests, run, None))]
        found = make_result(requests[0], *run_interruptible(run, lambda: solve_request(requests[0], run)))
        return [warn_of_energy(found)]

    if len(requests) == 1 or requests[0].kind == "brdf":
        found = try_call(solve_all)
        if not isinstance(found, Exception):
            return found
        if len(requests) == 1:
            return [found]
    return [outcome for request in requests for outcome in solve_on_device([request])]


def warn_of_energy(found: Brdf | Field) -> Brdf | Field:
    """The result, with a warning where its light does not balance: tables hold no notes."""
    for note in found.diagnostics.get("notes", ()):
        if note.startswith(ENERGY):
            warn_user(note, AccuracyWarning)
    return found


_lock = threading.Lock()
_listening: dict[int, dict[str, Any]] = {}  # by thread: its warnings
_outside: list[Any] = []


@contextmanager
def collect_warnings(warned: dict[str, Any]) -> Iterator[None]:
    """Puts this thread's warnings into ``warned``, count and first message by kind, whatever others do."""
    thread = threading.get_ident()
    with _lock:
        if not _listening:
            _outside.append(warnings.catch_warnings())
            _outside[-1].__enter__()
            warnings.simplefilter("always", UserWarning)
            warnings.simplefilter("ignore", LongSolveWarning)  # of one scene: one for the sweep is given
            warnings.showwarning = _note
        _listening[thread] = warned
    try:
        yield
    finally:
        with _lock:
            del _listening[thread]
            if not _listening:
                _outside.pop().__exit__(None, None, None)


def _note(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    warned = _listening.get(threading.get_ident())
    if warned is not None:
        entry = warned.setdefault(category.__name__, [0, put_in_one_line(str(message), LONGEST_MESSAGE)])
        entry[0] += 1
