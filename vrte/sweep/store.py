"""Where a sweep's results go: a folder beside the output while it grows, the output itself once it is complete.

    OUTPUT.partial/sweep          the journal: which sweep is computed, written when all else is in place
                   lock           held by the process that computes the sweep
                   table/         the Zarr group: every chunk of scenes is a chunk of its arrays
                   done/000012    a journal for each finished chunk, written after it, with its checksum
                   optics/        particles that scenes share
                   log.txt        when which worker began and ended which chunk

A chunk counts once its file in done/ is there, as long as its results have the checksum: after a power cut that file
may be there, and what was written before it not. The output appears by one renaming, when all of it is on the disk; it
keeps the checksums, so that a damaged output is found and mended, too. Nothing that a folder says about itself is used
to read it: descriptions of arrays are always those that vrte writes.
"""

import dataclasses
import hashlib
import io
import json
import math
import os
import shutil
import socket
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError, SweepError
from vrte.formats.atomic import (
    flush,
    is_sealed,
    read_journal,
    read_sealed,
    write_atomically,
    write_journal,
    write_sealed,
)
from vrte.formats.particle_sources import check_particles, describe_value, make_particles
from vrte.optics.particles import Particles
from vrte.optics.phase_matrix import SEQUENCES, PhaseMatrix
from vrte.sweep import table as tables
from vrte.sweep.results import Results
from vrte.sweep.table import Grid, create_table
from vrte.sweep.template import Sweep, describe_sweep_results, read_sweep

IN_MEMORY = 256  # kinds of particle that a process remembers, some 10 kB each
NUMBERS = ("albedo", "asymmetry", "extinction_um2", "scattering_um2", "volume_um3", "host_index", "host_absorption")


class KeptOptics:
    """Makes particles of a source and its keywords, but looks first in ``folder``, whose last ones it remembers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._read = lru_cache(IN_MEMORY)(read)

    def __call__(self, source: str, given: dict[str, Any]) -> Particles:
        try:
            found = self._read(self.folder / make_file_name(source, given))
        except (SceneError, OSError):  # a damaged file, or none
            return make_particles(source, given)
        return dataclasses.replace(found, balls=check_particles(source, given).balls)  # a recipe, and no work

    def keep(self, source: str, given: dict[str, Any]) -> Particles:
        """The same particles, written to the disk where they were not; of several callers at once, one computes."""
        import fcntl

        path = self.folder / make_file_name(source, given)
        if not path.is_file():
            with open(path.with_suffix(".lock"), "a") as lock:  # a killed process releases it
                fcntl.flock(lock, fcntl.LOCK_EX)
                if not path.is_file():
                    write(make_particles(source, given), path)
        return self(source, given)

    def remove_damaged(self) -> int:
        """Removes the files that cannot be read any more; returns their number."""
        damaged = []
        for path in self.folder.iterdir():
            try:
                path.suffix == ".lock" or read_sealed(path)
            except (SceneError, OSError):
                damaged.append(path)
        for path in damaged:
            path.unlink()
        return len(damaged)


def make_file_name(source: str, given: dict[str, Any]) -> str:
    """A file's name that stands for all digits of the keywords, and for the names of the numbers in the file."""
    key = [NUMBERS, source, sorted((name, describe_value(value)) for name, value in given.items())]
    return hashlib.sha256(repr(key).encode()).hexdigest()[:40]


def write(particles: Particles, path: Path) -> None:
    """Writes one kind of particle, all of it or nothing."""
    matrix = particles.phase_matrix
    sequences = {name: getattr(matrix, name) for name in SEQUENCES}
    numbers = {name: getattr(particles, name) for name in NUMBERS}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, description=particles.description, **sequences, **numbers)
    write_sealed(path, content.getvalue())


def read(path: Path) -> Particles:
    """The particles that `write` wrote, every digit as it was. Raises SceneError, OSError."""
    with np.load(io.BytesIO(read_sealed(path)), allow_pickle=False) as file:
        matrix = PhaseMatrix(**{name: file[name] for name in SEQUENCES})
        numbers = {name: float(file[name]) for name in NUMBERS}
        return Particles(matrix, description=str(file["description"]), **numbers)  # type: ignore[arg-type]


BEGUN = "sweep"
FOLDERS = ("table", "done", "optics")
UNREADABLE = (SceneError, OSError)  # what reading a damaged journal raises


@dataclass(frozen=True, eq=False)
class Work:
    """A sweep under way in ``folder``, cut into chunks of a ``box``: what any worker needs to compute a chunk."""

    folder: Path
    sweep: Sweep
    box: tuple[int, ...]
    stamp: str

    @property
    def table(self) -> Path:
        return self.folder / "table"

    @cached_property
    def grid(self) -> Grid:
        return Grid(self.sweep.shape, self.box)

    @cached_property
    def results(self) -> Results:
        return describe_sweep_results(self.sweep)

    @property
    def data(self) -> tuple[str, ...]:
        """Names of the arrays that grow."""
        return (*self.results.variables, "error", "checksum")

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """The Zarr arrays of these names."""
        group = tables.open_group(self.table, "r+")
        return {name: group[name] for name in self.data}

    @cached_property
    def optics(self) -> KeptOptics:
        return KeptOptics(self.folder / "optics")

    def mark(self, chunk: int) -> Path:
        """The journal of a chunk, which is there once the chunk is done."""
        return self.folder / "done" / f"{chunk:09d}"

    def done(self) -> set[int]:
        """All finished chunks."""
        return {int(path.name) for path in (self.folder / "done").iterdir() if path.name.isdecimal()}

    def keep(self, chunk: int, arrays: dict[str, Array], record: dict[str, Any]) -> None:
        """Writes a chunk's results (scenes, ...), then its ``record``, "failed" by index: now it is done."""
        if not (self.folder / BEGUN).is_file():
            raise SweepError(f"{self.folder} is gone: nobody waits for this chunk")
        where, extent = self.grid.slices(chunk), self.grid.extent(chunk)
        for name, values in arrays.items():
            self.arrays[name][where] = values.reshape(*extent, *values.shape[1:])
        write_journal(self.mark(chunk), record | {"checksum": compute_checksum(arrays, record["failed"])})

    def records(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """The record of each finished chunk."""
        for chunk in sorted(self.done()):
            yield chunk, read_journal(self.mark(chunk))

    def find_whole(self, chunk: int, read: Callable[[int], dict[str, Any]]) -> dict[str, Any]:
        """The record of a chunk, if its results on the disk have the record's checksum; empty otherwise."""
        try:
            record, where = read(chunk), self.grid.slices(chunk)
            found = {name: np.asarray(self.arrays[name][where]) for name in self.results.variables}
            return record if record["checksum"] == compute_checksum(found, record["failed"]) else {}
        except Exception:  # whatever three libraries below make of damaged bytes
            return {}

    def log(self, *words: object) -> None:
        """Appends one line to the log, in one piece whoever else writes."""
        line = " ".join(map(str, (*words, f"{socket.gethostname()}:{os.getpid()}", f"{time.time():.3f}"))) + "\n"
        file = os.open(self.folder / "log.txt", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        try:
            os.write(file, line.encode())
        finally:
            os.close(file)


def compute_checksum(arrays: Mapping[str, Array], failed: Mapping[str, str]) -> str:
    """SHA-256 of a chunk's results and of the errors of its scenes without result."""
    made = hashlib.sha256(json.dumps(failed, sort_keys=True).encode())
    for name in sorted(arrays):
        made.update(np.ascontiguousarray(arrays[name], "<f8").data)
    return made.hexdigest()


def read_work(folder: Path) -> Work:
    """The work that was begun in a folder. Raises SweepError."""
    if not (folder / BEGUN).is_file():
        host = socket.gethostname()
        raise SweepError(f"{host} does not see {folder}: the output must lie where all workers can read and write it")
    try:
        record = read_journal(folder / BEGUN)
    except UNREADABLE as error:
        raise SweepError(str(error)) from error
    return Work(folder, read_sweep(record["content"], Path(record["folder"])), tuple(record["box"]), record["stamp"])


@contextmanager
def lock_output(output: Path) -> Iterator[Path]:
    """The folder where the output grows, while no other process works on it. Raises SweepError."""
    try:
        import fcntl
    except ImportError as error:  # Windows
        raise SweepError("sweeps need the file locks of Linux and macOS, which this system does not have") from error

    folder = output.with_name(output.name + ".partial")
    while True:
        folder.mkdir(exist_ok=True)
        with open(folder / "lock", "a") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise SweepError(f"another process is at work on {output}: wait for it, or end it") from error
            try:
                same = os.path.samestat(os.fstat(lock.fileno()), os.stat(folder / "lock"))
            except FileNotFoundError:
                same = False
            if same:
                yield folder
                return
        # the process that held the lock has finished and removed the folder


def resume_work(folder: Path, sweep: Sweep, grid: Grid, output: Path) -> tuple[Work, list[str]]:
    """The work in a folder, resumed or begun, and in words what was damaged. Raises SceneError for another sweep's."""
    damage = []
    if (folder / BEGUN).is_file():
        try:
            record = read_journal(folder / BEGUN)
        except UNREADABLE:
            damage.append("all of it, because nothing says any more of what sweep it was")
        else:
            tables.check_same(sweep, record, f"{output} was begun")
            work = Work(folder, sweep, tuple(record["box"]), record["stamp"])
            return work, repair_work(work)
    work = make_fresh_work(folder, sweep, grid.box)
    begin(work)
    return work, damage


def make_fresh_work(folder: Path, sweep: Sweep, box: tuple[int, ...]) -> Work:
    """Work in a folder from which everything before was removed; not begun yet."""
    (folder / BEGUN).unlink(missing_ok=True)
    work = Work(folder, sweep, box, uuid.uuid4().hex)
    for name in FOLDERS:
        remove(folder / name)
        (folder / name).mkdir()
    (folder / "log.txt").unlink(missing_ok=True)
    create_table(work.table, sweep, work.grid, work.results)
    return work


def begin(work: Work) -> None:
    """Writes the journal, on the disk before anything is computed: from now on the work can be resumed."""
    sweep = work.sweep
    record: dict[str, Any] = {"content": sweep.described(), "folder": str(sweep.folder), "tables": sweep.tables()}
    record |= {"box": work.box, "stamp": work.stamp, "fingerprint": sweep.fingerprint()}
    write_journal(work.folder / BEGUN, record, on_disk=True)


def repair_work(work: Work) -> list[str]:
    """Removes what is damaged in a folder that was begun, so that it is made again; returns what it was, in words."""
    for name in FOLDERS:
        (work.folder / name).mkdir(exist_ok=True)
    fresh = work.folder / "fresh"
    remove(fresh)
    create_table(fresh, work.sweep, work.grid, work.results)
    descriptions = list_changed_files(fresh, work.table)
    for index in descriptions:
        (work.table / index).parent.mkdir(parents=True, exist_ok=True)
        os.replace(fresh / index, work.table / index)
    remove(fresh)
    particles = work.optics.remove_damaged()
    damaged = [chunk for chunk in work.done() if not work.find_whole(chunk, lambda one: read_journal(work.mark(one)))]
    for chunk in damaged:
        work.mark(chunk).unlink()
    found = describe_damage(work, descriptions, len(damaged))
    return found + ([f"the optics of {particles} kinds of particle"] if particles else [])


def describe_damage(work: Work, descriptions: list[Path], chunks: int) -> list[str]:
    """What is damaged, in words."""
    found = ["descriptions in the table"] if descriptions else []
    return found + ([f"{chunks} of {work.grid.chunks} chunks"] if chunks else [])


def list_changed_files(fresh: Path, table: Path) -> list[Path]:
    """Names of the files of a fresh table that have other bytes in another table, or are not there."""
    changed = []
    for path in sorted(path for path in fresh.rglob("*") if path.is_file()):
        name = path.relative_to(fresh)
        try:
            same = path.read_bytes() == (table / name).read_bytes()
        except OSError:
            same = False
        changed += [] if same else [name]
    return changed


def check_output(sweep: Sweep, output: Path, folder: Path) -> list[str]:
    """Damage of a finished table, in words; if any, it is work begun again. Raises SceneError for another table."""
    if output.suffix != ".zarr":  # damage to one byte is damage to all
        try:
            whole = is_sealed(str(output))
        except SceneError as error:
            raise SceneError(f"{output} {error}: remove it, and it is computed again") from error
        if not whole:
            raise SceneError(f"{output} is no table of a sweep, or cut: take another output, or remove it")
        with tables.open_table(output) as table:
            tables.check_made(sweep, table.attrs, output)
        return []
    work = make_fresh_work(folder, sweep, tables.read_box(sweep, output))
    descriptions = list_changed_files(work.table, output)
    # its data, read by the descriptions that were written just now
    for name in work.data:
        (work.table / name / "c").symlink_to(output / name / "c")
    try:
        sums: list[str] = work.arrays["checksum"][...].tolist()
    except Exception:  # whatever three libraries below make of damaged bytes
        sums = [""] * work.grid.chunks

    def read(chunk: int) -> dict[str, Any]:
        words = np.asarray(work.arrays["error"][work.grid.slices(chunk)]).ravel().tolist()
        failed = {str(index): word for index, word in enumerate(words) if word}
        return {"failed": failed, "warnings": {}, "seconds": 0.0, "checksum": sums[chunk]}

    damaged = 0
    for chunk in range(work.grid.chunks):
        if record := work.find_whole(chunk, read):
            write_journal(work.mark(chunk), record)
        else:
            damaged += 1
    found = describe_damage(work, descriptions, damaged)
    if found:
        begin(work)
        remove(work.table)
        os.rename(output, work.table)
    return found


def finish(work: Work, output: Path, on_disk: bool) -> None:
    """Writes errors and checksums into the table, renames it to the output, ``on_disk`` before, removes the folder."""
    remove(work.table / "error" / "c")
    sums = np.full(work.grid.chunks, "", object)
    for chunk, record in work.records():
        sums[chunk] = record["checksum"]
        if record["failed"]:
            extent = work.grid.extent(chunk)
            words = np.full(math.prod(extent), "", object)
            words[[int(index) for index in record["failed"]]] = list(record["failed"].values())
            work.arrays["error"][work.grid.slices(chunk)] = words.reshape(extent)
    work.arrays["checksum"][...] = sums
    if output.suffix == ".zarr":
        if on_disk:
            for path in (*work.table.rglob("*"), work.table):
                flush(path)
        os.rename(work.table, output)
    else:
        with write_atomically(output) as part:
            tables.convert_to_netcdf(work.table, work.grid, part)
            if on_disk:
                flush(part)
    if on_disk:
        flush(output.parent)
    clear(work.folder)


def clear(folder: Path) -> None:
    """Removes a folder that is of no more use, its journal first, so that its rest is not resumed."""
    (folder / BEGUN).unlink(missing_ok=True)
    remove(folder)


def remove(path: Path) -> None:
    """Removes a folder, a file, a link or nothing at all."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
