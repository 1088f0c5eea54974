"""Where a sweep's results go: a folder beside the output while it grows, the output itself once it is complete.

    OUTPUT.partial/sweep          what is computed, written when all else is in place
                   lock           held by the process that is at it
                   table/         the Zarr group: every chunk of scenes is a chunk of its arrays
                   done/000012    one file a finished chunk, written after the chunk, with the checksum of its results
                   optics/        particles that scenes share
                   log.txt        when which worker began and ended which chunk

A chunk counts from the moment that its file in done/ is there, as long as its results are those of the checksum: after
a power cut a file may be there, and what was written before it not. The output appears by one renaming, when all of it
is on the disk; it keeps the checksums, so that it can be looked over, and mended, as well. Nothing that a folder says
about itself is used to read it: descriptions of arrays are always those that vrte writes.
"""

import hashlib
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
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SweepError
from vrte.formats.atomic import write_atomically
from vrte.sweep.grid import Grid
from vrte.sweep.optics import Optics
from vrte.sweep.results import Results
from vrte.sweep.sealed import DamagedError, flush, read_json, write_json
from vrte.sweep.table import check_same, convert_to_netcdf, create_table, look_over_netcdf, open_group, read_box
from vrte.sweep.template import Sweep, describe_sweep_results, read_sweep

BEGUN = "sweep"


@dataclass(frozen=True, eq=False)
class Work:
    """A sweep at work in ``folder``, cut into chunks of a ``box``; what any worker needs to compute a chunk of it."""

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
        group = open_group(self.table, "r+")
        return {name: group[name] for name in self.data}

    @cached_property
    def optics(self) -> Optics:
        return Optics(self.folder / "optics")

    def is_done(self, chunk: int) -> bool:
        """Whether nobody needs to compute it any more."""
        return self._mark(chunk).is_file()

    def done(self) -> set[int]:
        """All finished chunks."""
        return {int(path.name) for path in (self.folder / "done").iterdir() if path.name.isdecimal()}

    def empty(self, chunk: int) -> dict[str, Array]:
        """A chunk's arrays, NaN all over, scenes flat: (scenes, ...)."""
        scenes = math.prod(self.grid.extent(chunk))
        return {name: np.full((scenes, *shape), np.nan) for name, (_, shape) in self.results.variables.items()}

    def keep(self, chunk: int, arrays: dict[str, Array], said: dict[str, Any]) -> None:
        """Writes a chunk's results, scenes flat, then what is ``said`` of it, "failed" by place: from now on it is
        done."""
        if not (self.folder / BEGUN).is_file():
            raise SweepError(f"{self.folder} is gone: nobody waits for this chunk")
        where, extent = self.grid.slices(chunk), self.grid.extent(chunk)
        for name, values in arrays.items():
            self.arrays[name][where] = values.reshape(*extent, *values.shape[1:])
        self.mark(chunk, said | {"checksum": compute_checksum(arrays, said["failed"])})

    def mark(self, chunk: int, said: dict[str, Any]) -> None:
        """From now on the chunk is done."""
        write_json(self._mark(chunk), said)

    def marks(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """What was said about each finished chunk."""
        for chunk in sorted(self.done()):
            yield chunk, self.told(chunk)

    def told(self, chunk: int) -> Any:
        """What was said about a finished chunk. Raises DamagedError."""
        return read_json(self._mark(chunk))

    def forget_damaged(self) -> int:
        """Takes away the marks that cannot be read, or whose chunk is not what it was; how many there were."""
        damaged = [chunk for chunk in self.done() if not self.whole(chunk, self.told)]
        for chunk in damaged:
            self._mark(chunk).unlink()
        return len(damaged)

    def whole(self, chunk: int, tell: Callable[[int], dict[str, Any]]) -> dict[str, Any]:
        """What is told of a chunk, if its results on the disk are those of the checksum; nothing otherwise."""
        try:
            said, where = tell(chunk), self.grid.slices(chunk)
            found = {name: np.asarray(self.arrays[name][where]) for name in self.results.variables}
            return said if said["checksum"] == compute_checksum(found, said["failed"]) else {}
        except Exception:  # whatever three libraries below make of damaged bytes
            return {}

    def log(self, *words: object) -> None:
        """One line, in one piece whoever else writes."""
        line = " ".join(map(str, (*words, f"{socket.gethostname()}:{os.getpid()}", f"{time.time():.3f}"))) + "\n"
        file = os.open(self.folder / "log.txt", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        try:
            os.write(file, line.encode())
        finally:
            os.close(file)

    def _mark(self, chunk: int) -> Path:
        return self.folder / "done" / f"{chunk:09d}"


def compute_checksum(arrays: Mapping[str, Array], failed: Mapping[str, str]) -> str:
    """Of a chunk's results and of what its scenes without result said.

    >>> compute_checksum({"a": np.zeros(2)}, {}) == compute_checksum({"a": np.array([0.0, -0.0])}, {})
    False
    """
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
        said = read_json(folder / BEGUN)
    except DamagedError as error:
        raise SweepError(str(error)) from error
    return Work(folder, read_sweep(said["content"], Path(said["folder"])), tuple(said["box"]), said["stamp"])


def name_partial_folder(output: Path) -> Path:
    """The folder beside an output where it grows."""
    return output.with_name(output.name + ".partial")


@contextmanager
def lock_output(output: Path) -> Iterator[Path]:
    """The folder where the output grows, while no other process is at it. Raises SweepError."""
    try:
        import fcntl
    except ImportError as error:  # Windows
        raise SweepError("sweeps need the file locks of Linux and macOS, which this system does not have") from error

    folder = name_partial_folder(output)
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
        # whoever held it has finished and taken the folder away


def resume_work(folder: Path, sweep: Sweep, grid: Grid, output: Path) -> tuple[Work, list[str]]:
    """The work in a folder, taken up where it was left, or begun; and what was damaged in it, in words.

    Raises SceneError for another sweep's folder.
    """
    damage = []
    if (folder / BEGUN).is_file():
        try:
            said = read_json(folder / BEGUN)
        except DamagedError:
            damage.append("all of it, because nothing says any more of what sweep it was")
        else:
            check_same(sweep, said, f"{output} was begun")
            work = Work(folder, sweep, tuple(said["box"]), said["stamp"])
            return work, repair_work(work)
    work = make_fresh_work(folder, sweep, grid.box)
    begin(work)
    return work, damage


def make_fresh_work(folder: Path, sweep: Sweep, box: tuple[int, ...]) -> Work:
    """Work in a folder where whatever was there is gone; not begun yet."""
    (folder / BEGUN).unlink(missing_ok=True)
    work = Work(folder, sweep, box, uuid.uuid4().hex)
    for name in ("table", "done", "optics"):
        remove(folder / name)
        (folder / name).mkdir()
    (folder / "log.txt").unlink(missing_ok=True)
    create_table(work.table, sweep, work.grid, work.results)
    return work


def begin(work: Work, **more: bool) -> None:
    """From now on the folder is taken up where it was left; on the disk before anything is computed."""
    sweep = work.sweep
    said: dict[str, Any] = {"content": sweep.described(), "folder": str(sweep.folder), "tables": sweep.tables()}
    said |= {"box": work.box, "stamp": work.stamp, "fingerprint": sweep.fingerprint()}
    write_json(work.folder / BEGUN, said | more, on_disk=True)


def repair_work(work: Work) -> list[str]:
    """Takes away what is damaged in a folder that was begun, so that it is made again; says in words what it was."""
    for name in ("table", "done", "optics"):
        (work.folder / name).mkdir(exist_ok=True)
    fresh = work.folder / "fresh"
    remove(fresh)
    create_table(fresh, work.sweep, work.grid, work.results)
    descriptions = list_changed_files(fresh, work.table)
    for place in descriptions:
        (work.table / place).parent.mkdir(parents=True, exist_ok=True)
        os.replace(fresh / place, work.table / place)
    remove(fresh)
    particles = work.optics.forget_damaged()
    damage = describe_damage(work, descriptions, work.forget_damaged())
    return damage + ([f"the optics of {particles} kinds of particle"] if particles else [])


def describe_damage(work: Work, descriptions: list[Path], chunks: int) -> list[str]:
    """What is damaged."""
    found = ["descriptions in the table"] if descriptions else []
    return found + ([f"{chunks} of {work.grid.chunks} chunks"] if chunks else [])


def list_changed_files(fresh: Path, table: Path) -> list[Path]:
    """Names of those in a table as it should be that are not so in another."""
    names = [path.relative_to(fresh) for path in sorted(fresh.rglob("*")) if path.is_file()]
    return [name for name in names if not has_same_bytes(fresh / name, table / name)]


def has_same_bytes(one: Path, other: Path) -> bool:
    try:
        return one.read_bytes() == other.read_bytes()
    except OSError:
        return False


def look_over(sweep: Sweep, output: Path, folder: Path) -> list[str]:
    """What is damaged in the finished table of a sweep, in words; if anything is, the rest of it is work begun again.

    Raises SceneError for another sweep's table, and where nothing tells whose it was.
    """
    if output.suffix != ".zarr":
        look_over_netcdf(sweep, output)
        return []
    work = make_fresh_work(folder, sweep, read_box(sweep, output))
    descriptions = list_changed_files(work.table, output)
    # its data, read by the descriptions that were written just now
    for name in work.data:
        (work.table / name / "c").symlink_to(output / name / "c")
    try:
        sums: list[str] = work.arrays["checksum"][...].tolist()
    except Exception:  # whatever three libraries below make of damaged bytes
        sums = [""] * work.grid.chunks

    def told(chunk: int) -> dict[str, Any]:
        words = np.asarray(work.arrays["error"][work.grid.slices(chunk)]).ravel().tolist()
        failed = {str(place): word for place, word in enumerate(words) if word}
        return {"failed": failed, "warnings": {}, "seconds": 0.0, "checksum": sums[chunk]}

    damaged = 0
    for chunk in range(work.grid.chunks):
        if said := work.whole(chunk, told):
            work.mark(chunk, said)
        else:
            damaged += 1
    found = describe_damage(work, descriptions, damaged)
    if found:
        begin(work, adopts=True)
        adopt(output, folder)
    return found


def adopt(output: Path, folder: Path) -> bool:
    """Whether the folder is the mending of a finished table, all of whose data it then has; there is no output left."""
    try:
        if not read_json(folder / BEGUN).get("adopts"):
            return False
    except DamagedError:
        return False
    work = read_work(folder)
    for name in work.data:
        data, place = output / name / "c", work.table / name / "c"
        if place.is_symlink():
            place.unlink()
        if data.is_dir():
            os.rename(data, place)
    remove(output)
    return True


def finish(work: Work, output: Path, on_disk: bool) -> None:
    """Errors and checksums into the table, the table to its place, the folder away; ``on_disk`` before all else."""
    remove(work.table / "error" / "c")
    sums = np.full(work.grid.chunks, "", object)
    for chunk, said in work.marks():
        sums[chunk] = said["checksum"]
        if said["failed"]:
            extent = work.grid.extent(chunk)
            words = np.full(math.prod(extent), "", object)
            words[[int(place) for place in said["failed"]]] = list(said["failed"].values())
            work.arrays["error"][work.grid.slices(chunk)] = words.reshape(extent)
    work.arrays["checksum"][...] = sums
    if output.suffix == ".zarr":
        if on_disk:
            for path in (*work.table.rglob("*"), work.table):
                flush(path)
        os.rename(work.table, output)
    else:
        with write_atomically(output) as part:
            convert_to_netcdf(work.table, work.grid, part)
            if on_disk:
                flush(part)
    if on_disk:
        flush(output.parent)
    clear(work.folder)


def clear(folder: Path) -> None:
    """Takes away a folder that is of no more use; what says so first, so that nobody takes up what is left of it."""
    (folder / BEGUN).unlink(missing_ok=True)
    remove(folder)


def remove(path: Path) -> None:
    """A folder, a file, a link or nothing at all."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
