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
about itself is used to read it: descriptions of arrays are always those that this module writes.
"""

import hashlib
import json
import math
import mmap
import os
import shutil
import socket
import time
import uuid
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError, SweepError, import_extra
from vrte.formats.atomic import atomic_write
from vrte.formats.contents import CONVENTIONS, WAVELENGTH
from vrte.formats.netcdf import check_netcdf, new_netcdf
from vrte.formats.seal import is_sealed, seal_of
from vrte.results.quantities import STOKES
from vrte.sweep.grid import Grid
from vrte.sweep.optics import Optics
from vrte.sweep.results import Results, results_of
from vrte.sweep.sealed import DamagedError, flush, read_json, write_json
from vrte.sweep.template import Axis, Sweep, scene_at, sweep_of, unseen

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".zarr", ".nc")
BEGUN = "sweep"
ZARR = 3  # the format: of version 2, reading can run code that a table brings along
TITLES = {"brdf": "BRDFs", "field": "radiance fields"}
CODECS = {"bytes", "vlen-utf8", "zstd"}


@dataclass(frozen=True, eq=False)
class Layout:
    """Shapes of a table: ``grid`` of scenes along its ``dimensions``, and the ``results`` of each scene."""

    grid: Grid
    dimensions: tuple[str, ...]
    results: Results

    def empty(self, chunk: int) -> dict[str, Array]:
        """A chunk's arrays, NaN all over, scenes flat: (scenes, ...)."""
        scenes = math.prod(self.grid.extent(chunk))
        return {name: np.full((scenes, *shape), np.nan) for name, (_, shape) in self.results.variables.items()}


def results_of_sweep(sweep: Sweep) -> Results:
    """What each of its scenes brings."""
    return results_of(scene_at(sweep, (0,) * len(sweep.shape), unseen))


@dataclass(frozen=True, eq=False)
class Work:
    """A sweep at work in ``folder``; what any worker needs to compute a chunk of it."""

    folder: Path
    sweep: Sweep
    layout: Layout
    stamp: str

    @property
    def table(self) -> Path:
        return self.folder / "table"

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """The Zarr arrays of the results."""
        group = zarr().open_group(self.table, mode="r+", zarr_format=ZARR)
        return {name: group[name] for name in (*self.layout.results.variables, "error", "checksum")}

    @cached_property
    def optics(self) -> Optics:
        return Optics(self.folder / "optics")

    def is_done(self, chunk: int) -> bool:
        """Whether nobody needs to compute it any more."""
        return self._mark(chunk).is_file()

    def done(self) -> set[int]:
        """All finished chunks."""
        return {int(path.name) for path in (self.folder / "done").iterdir() if path.name.isdecimal()}

    def write(self, chunk: int, arrays: dict[str, Array]) -> None:
        """A chunk's results, scenes flat."""
        if not (self.folder / BEGUN).is_file():
            raise SweepError(f"{self.folder} is gone: nobody waits for this chunk")
        where, extent = self.layout.grid.slices(chunk), self.layout.grid.extent(chunk)
        for name, values in arrays.items():
            self.arrays[name][where] = values.reshape(*extent, *values.shape[1:])

    def read(self, chunk: int) -> dict[str, Array]:
        """A chunk's results as they lie on the disk."""
        where = self.layout.grid.slices(chunk)
        return {name: np.asarray(self.arrays[name][where]) for name in self.layout.results.variables}

    def mark(self, chunk: int, arrays: dict[str, Array], said: dict[str, Any]) -> None:
        """From now on the chunk is done: these are its results, and what is ``said`` of it, "failed" by place."""
        write_json(self._mark(chunk), said | {"checksum": checksum(arrays, said["failed"])})

    def marks(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """What was said about each finished chunk."""
        for chunk in sorted(self.done()):
            yield chunk, read_json(self._mark(chunk))

    def forget_damaged(self) -> int:
        """Takes away the marks that cannot be read, or whose chunk is not what it was; how many there were."""
        damaged = [chunk for chunk in self.done() if not self._is_whole(chunk)]
        for chunk in damaged:
            self._mark(chunk).unlink()
        return len(damaged)

    def _is_whole(self, chunk: int) -> bool:
        try:
            said = read_json(self._mark(chunk))
            return bool(said["checksum"] == checksum(self.read(chunk), said["failed"]))
        except Exception:  # whatever three libraries below make of damaged bytes
            return False

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


def checksum(arrays: Mapping[str, Array], failed: Mapping[str, str]) -> str:
    """Of a chunk's results and of what its scenes without result said.

    >>> checksum({"a": np.zeros(2)}, {}) == checksum({"a": np.array([0.0, -0.0])}, {})
    False
    """
    made = hashlib.sha256(json.dumps(failed, sort_keys=True).encode())
    for name in sorted(arrays):
        made.update(np.ascontiguousarray(arrays[name], "<f8").data)
    return made.hexdigest()


def work_in(folder: Path) -> Work:
    """The work that was begun in a folder. Raises SweepError."""
    if not (folder / BEGUN).is_file():
        host = socket.gethostname()
        raise SweepError(f"{host} does not see {folder}: the output must lie where all workers can read and write it")
    try:
        said = read_json(folder / BEGUN)
    except DamagedError as error:
        raise SweepError(str(error)) from error
    return work_of(folder, sweep_from(said), tuple(said["box"]), said["stamp"])


def sweep_from(said: dict[str, Any]) -> Sweep:
    """The sweep that a folder was begun for."""
    return sweep_of(said["content"], Path(said["folder"]))


def work_of(folder: Path, sweep: Sweep, box: tuple[int, ...], stamp: str) -> Work:
    return Work(folder, sweep, Layout(Grid(sweep.shape, box), tuple(sweep.dimensions), results_of_sweep(sweep)), stamp)


def partial_of(output: Path) -> Path:
    """The folder beside an output where it grows."""
    return output.with_name(output.name + ".partial")


@contextmanager
def alone_at(output: Path) -> Iterator[Path]:
    """The folder where the output grows, while no other process is at it. Raises SweepError."""
    import fcntl

    folder = partial_of(output)
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


def begun(folder: Path, sweep: Sweep, grid: Grid, output: Path) -> tuple[Work, list[str]]:
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
            work = work_of(folder, sweep, tuple(said["box"]), said["stamp"])
            return work, mended(work)
    work = fresh_work(folder, sweep, grid.box)
    begin(work)
    return work, damage


def fresh_work(folder: Path, sweep: Sweep, box: tuple[int, ...]) -> Work:
    """Work in a folder where whatever was there is gone; not begun yet."""
    (folder / BEGUN).unlink(missing_ok=True)
    work = work_of(folder, sweep, box, uuid.uuid4().hex)
    for name in ("table", "done", "optics"):
        remove(folder / name)
        (folder / name).mkdir()
    (folder / "log.txt").unlink(missing_ok=True)
    create_table(work, work.table)
    return work


def begin(work: Work, **more: bool) -> None:
    """From now on the folder is taken up where it was left; on the disk before anything is computed."""
    sweep = work.sweep
    said: dict[str, Any] = {"content": sweep.described(), "folder": str(sweep.folder), "tables": sweep.tables()}
    said |= {"box": work.layout.grid.box, "stamp": work.stamp, "fingerprint": sweep.fingerprint()}
    write_json(work.folder / BEGUN, said | more, on_disk=True)


def mended(work: Work) -> list[str]:
    """Takes away what is damaged in a folder that was begun, so that it is made again; says in words what it was."""
    for name in ("table", "done", "optics"):
        (work.folder / name).mkdir(exist_ok=True)
    fresh = work.folder / "fresh"
    remove(fresh)
    create_table(work, fresh)
    descriptions = changed_files(fresh, work.table)
    for place in descriptions:
        (work.table / place).parent.mkdir(parents=True, exist_ok=True)
        os.replace(fresh / place, work.table / place)
    remove(fresh)
    found = ["descriptions in the table"] if descriptions else []
    chunks, particles = work.forget_damaged(), work.optics.forget_damaged()
    found += [f"{chunks} of {work.layout.grid.chunks} chunks"] if chunks else []
    return found + ([f"the optics of {particles} kinds of particle"] if particles else [])


def changed_files(fresh: Path, table: Path) -> list[Path]:
    """Names of those in a table as it should be that are not so in another."""
    names = [path.relative_to(fresh) for path in sorted(fresh.rglob("*")) if path.is_file()]
    return [name for name in names if not same_bytes(fresh / name, table / name)]


def same_bytes(one: Path, other: Path) -> bool:
    try:
        return one.read_bytes() == other.read_bytes()
    except OSError:
        return False


def check_same(sweep: Sweep, said: dict[str, Any], what: str) -> None:
    """Whether this is the sweep that was begun."""
    if said["fingerprint"] == sweep.fingerprint():
        return
    changed = changes(said["content"], json.loads(json.dumps(sweep.described())))
    changed = changed or changes(said["tables"], sweep.tables(), "table ") or ["the version of vrte"]
    raise SceneError(
        f"{what} with another sweep: {', '.join(changed[:5])} changed. Take another output, or remove the old one"
    )


def changes(before: Any, now: Any, name: str = "") -> list[str]:
    """Dotted keys where two contents differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = sorted({*before, *now})
        dotted = f"{name}." if name and not name.endswith(" ") else name
        return [found for key in keys for found in changes(before.get(key), now.get(key), f"{dotted}{key}")]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True), 1)
        return [found for place, pair in pairs for found in changes(*pair, f"{name}[{place}]")]
    return [] if before == now else [name]


def zarr() -> Any:
    """The library, or what to install."""
    return import_extra("zarr", "a sweep", "files")


def create_table(work: Work, path: Path) -> None:
    """The Zarr group with its coordinates, and arrays without data; always the same bytes."""
    layout, sweep, results = work.layout, work.sweep, work.layout.results
    group = zarr().open_group(path, mode="w", zarr_format=ZARR)
    packing = zarr().codecs.ZstdCodec(level=0, checksum=True)
    group.attrs.update(sealed_attributes(sweep, layout.grid.box))
    for axis in sweep.axes:
        put_array(group, axis.name, (axis.dimension,), axis.values, attributes_of(axis))
    for name, values in results.coordinates.items():
        put_array(group, name, (name,), values, results.kind.coordinates[name].attributes)
    for name in results.labels:
        put_array(group, name, (name,), np.array(STOKES, object), {"long_name": "Stokes parameter"})
    for name, (dims, values) in results.constants.items():
        put_array(group, name, dims, values, results.kind.variables[name].attributes)
    for name, (dims, shape) in results.variables.items():
        group.create_array(
            name,
            shape=(*layout.grid.shape, *shape),
            chunks=(*layout.grid.box, *shape),
            dtype="float64",
            fill_value=math.nan,
            dimension_names=(*layout.dimensions, *dims),
            attributes=results.kind.variables[name].attributes,
            compressors=packing,
        )
    every = (layout.grid.chunks,)
    for name, shape, box, dims, meaning in (
        ("error", layout.grid.shape, layout.grid.box, layout.dimensions, "why a scene has no result, empty if it has"),
        ("checksum", every, every, ("chunk",), "SHA-256 of the results of each chunk of scenes"),
    ):
        group.create_array(
            name,
            shape=shape,
            chunks=box,
            dtype=str,
            fill_value="",
            dimension_names=dims,
            attributes={"long_name": meaning},
            compressors=packing,
        )
    consolidate(path)


def attributes_of(axis: Axis) -> dict[str, str]:
    """What is said of the values of an axis."""
    if axis.key == "wavelength_um":
        return WAVELENGTH.attributes
    return {"units": "um" if axis.key.endswith("_um") else "1", "long_name": axis.key}


def put_array(group: Any, name: str, dims: tuple[str, ...], values: Any, attrs: dict[str, str]) -> None:
    """A coordinate."""
    dtype = str if values.dtype == object else values.dtype
    array = group.create_array(
        name, shape=values.shape, dtype=dtype, dimension_names=dims, attributes=attrs, compressors=None
    )
    array[...] = values


def attributes(sweep: Sweep) -> dict[str, str]:
    """Of the whole table."""
    from vrte import __version__

    said = {
        "title": f"Polarized subsurface {TITLES[sweep.kind]} of particulate layers",
        "source": f"vrte {__version__}",
        "comment": CONVENTIONS,
        "sweep": json.dumps(sweep.described(), default=str),
        "tables": json.dumps(sweep.tables()),
        "fingerprint": sweep.fingerprint(),
    }
    listed = [axis.name for axis in sweep.axes if axis.name != axis.dimension]
    return said | ({"coordinates": " ".join(listed)} if listed else {})


def sealed_attributes(sweep: Sweep, box: tuple[int, ...]) -> dict[str, Any]:
    """The same with the chunks' box, and a checksum over all."""
    said = attributes(sweep) | {"chunk": list(box)}
    return said | {"sha256": seal_of_attributes(said)}


def seal_of_attributes(said: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def said_by(output: Path) -> dict[str, Any]:
    """What a finished Zarr table says of itself, read without the library. Raises SceneError."""
    try:
        said: dict[str, Any] = json.loads((output / "zarr.json").read_bytes())["attributes"]
        whole = said.pop("sha256") == seal_of_attributes(said)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        whole = False
    if not whole:
        raise SceneError(
            f"{output} is no table of a sweep, or too damaged to say of which: take another output, or remove it"
        )
    return said


def same_sweep(sweep: Sweep, said: Mapping[str, Any], output: Path) -> None:
    """Whether a finished table, by its attributes, is that of this sweep. Raises SceneError."""
    try:
        told = {"content": json.loads(said["sweep"]), "tables": json.loads(said["tables"])}
        told |= {"fingerprint": said["fingerprint"]}
    except (ValueError, LookupError, TypeError) as error:
        raise SceneError(f"{output} is no table of a sweep") from error
    check_same(sweep, told, f"{output} was made")


def look_over(sweep: Sweep, output: Path, folder: Path) -> list[str]:
    """What is damaged in the finished table of a sweep, in words; if anything is, the rest of it is work begun again.

    Raises SceneError for another sweep's table, and where nothing tells whose it was.
    """
    if output.suffix != ".zarr":
        look_over_netcdf(sweep, output)
        return []
    said = said_by(output)
    same_sweep(sweep, said, output)
    work = fresh_work(folder, sweep, tuple(said["chunk"]))
    found = ["descriptions in the table"] if changed_files(work.table, output) else []
    # its data, read by the descriptions that were written just now
    for name in data_of(work):
        (work.table / name / "c").symlink_to(output / name / "c")
    sums = checksums_of(work)
    damaged = sum(not mark_if_whole(work, chunk, sums[chunk]) for chunk in range(work.layout.grid.chunks))
    found += [f"{damaged} of {work.layout.grid.chunks} chunks"] if damaged else []
    if found:
        begin(work, adopts=True)
        adopt(output, folder)
    return found


def data_of(work: Work) -> tuple[str, ...]:
    return (*work.layout.results.variables, "error", "checksum")


def checksums_of(work: Work) -> list[str]:
    """Of all chunks of a finished table, empty where they are lost."""
    try:
        found: list[str] = work.arrays["checksum"][...].tolist()
    except Exception:  # whatever three libraries below make of damaged bytes
        return [""] * work.layout.grid.chunks
    return found


def mark_if_whole(work: Work, chunk: int, expected: str) -> bool:
    """Whether a chunk of a finished table is as its checksum says; then it is marked as done."""
    try:
        words = np.asarray(work.arrays["error"][work.layout.grid.slices(chunk)]).ravel().tolist()
        failed = {str(place): word for place, word in enumerate(words) if word}
        arrays = work.read(chunk)
        if checksum(arrays, failed) != expected:
            return False
    except Exception:  # whatever three libraries below make of damaged bytes
        return False
    work.mark(chunk, arrays, {"failed": failed, "warnings": {}, "seconds": 0.0})
    return True


def adopt(output: Path, folder: Path) -> bool:
    """Whether the folder is the mending of a finished table, all of whose data it then has; there is no output left."""
    try:
        if not read_json(folder / BEGUN).get("adopts"):
            return False
    except DamagedError:
        return False
    work = work_in(folder)
    for name in data_of(work):
        data, place = output / name / "c", work.table / name / "c"
        if place.is_symlink():
            place.unlink()
        if data.is_dir():
            os.rename(data, place)
    remove(output)
    return True


def look_over_netcdf(sweep: Sweep, output: Path) -> None:
    """Whether a finished table in NetCDF is that of this sweep, all its bytes as they were. Raises SceneError."""
    try:
        whole = is_sealed(str(output))
    except SceneError as error:
        raise SceneError(f"{output} {error}: remove it, and it is computed again") from error
    if not whole:
        raise SceneError(f"{output} is no table of a sweep, or cut: take another output, or remove it")
    with open_table(output) as table:
        same_sweep(sweep, table.attrs, output)


def finish(work: Work, output: Path, on_disk: bool) -> None:
    """Errors and checksums into the table, the table to its place, the folder away; ``on_disk`` before all else."""
    remove(work.table / "error" / "c")
    sums = np.full(work.layout.grid.chunks, "", object)
    for chunk, said in work.marks():
        sums[chunk] = said["checksum"]
        if said["failed"]:
            extent = work.layout.grid.extent(chunk)
            words = np.full(math.prod(extent), "", object)
            for place, message in said["failed"].items():
                words[int(place)] = message
            work.arrays["error"][work.layout.grid.slices(chunk)] = words.reshape(extent)
    work.arrays["checksum"][...] = sums
    if output.suffix == ".zarr":
        if on_disk:
            for path in (*work.table.rglob("*"), work.table):
                flush(path)
        os.rename(work.table, output)
    else:
        with atomic_write(output) as part:
            as_netcdf(work, part)
            if on_disk:
                flush(part)
    if on_disk:
        flush(output.parent)
    clear(work.folder)


def consolidate(table: Path) -> None:
    """All metadata in one place, where xarray looks for them first."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata is currently not part")
        zarr().consolidate_metadata(table)


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


def as_netcdf(work: Work, path: Path) -> None:
    """The Zarr table as NetCDF, one chunk after another, with a checksum at its end."""
    import h5py

    group, grid = zarr().open_group(work.table, mode="r", zarr_format=ZARR), work.layout.grid
    with new_netcdf(path) as file:
        file.attrs.update(group.attrs.asdict())
        for name, array in sorted(group.arrays()):
            for dim, length in zip(array.metadata.dimension_names, array.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = length
            text = array.dtype.kind in "OT"
            dtype = h5py.string_dtype() if text else array.dtype
            per_scene = name == "error" or name in work.layout.results.variables
            variable = file.create_variable(name, array.metadata.dimension_names, dtype)
            variable.attrs.update(array.attrs.asdict())
            for where in map(grid.slices, range(grid.chunks)) if per_scene else [...]:
                values = array[where]
                variable[where] = values.astype(object) if text else values
    with open(path, "r+b") as whole, mmap.mmap(whole.fileno(), 0) as content:
        with memoryview(content) as view:
            seal = seal_of(view)
        whole.seek(0, os.SEEK_END)
        whole.write(seal)


def check_codecs(path: Path) -> None:
    """Raises SceneError where a Zarr table packs its numbers and words in other ways than a sweep does."""
    group = zarr().open_group(path, mode="r", zarr_format=ZARR)
    for name, array in group.arrays():
        codecs = {str(codec.to_dict()["name"]) for codec in array.metadata.codecs}
        if not codecs <= CODECS or array.dtype.kind not in "fOT":
            strange = ", ".join(sorted(codecs - CODECS)) or str(array.dtype)
            raise SceneError(f"its {name} is packed as {strange}, as no table of a sweep is")


def open_table(path: str | os.PathLike[str]) -> "xarray.Dataset":
    """A complete table, its data read when they are asked for. Raises SceneError, MissingExtraError, OSError."""
    xarray = import_extra("xarray", "a table", "files")
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such table: {path}")
    try:
        if path.suffix == ".zarr":
            check_codecs(path)
            dataset = xarray.open_zarr(path, chunks=None, consolidated=True, zarr_format=ZARR)
        else:
            check_netcdf(path)
            dataset = xarray.open_dataset(path, engine="h5netcdf")
    except SceneError as error:
        raise SceneError(f"{path} is no table of a sweep: {error}") from error
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise SceneError(f"{path} is no table of a sweep") from error
    if "sweep" not in dataset.attrs:
        dataset.close()
        raise SceneError(f"{path} is no table of a sweep")
    return dataset.drop_vars("checksum", errors="ignore")
