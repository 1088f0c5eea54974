"""Where a sweep's results go: a folder beside the output while it grows, the output itself once it is complete.

    OUTPUT.partial/sweep.json     what is computed, written when all else is in place
                   lock           held by the process that is at it
                   table/         the Zarr group: every chunk of scenes is a chunk of its arrays
                   done/000012    one file a finished chunk, written after the chunk
                   optics/        particles that scenes share
                   log.txt        when which worker began and ended which chunk

A chunk counts from the moment that its file in done/ is there; what a killed worker left of others is written over. The
output appears by one renaming.
"""

import json
import math
import os
import shutil
import socket
import time
import uuid
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.arrays import Array
from vrte.errors import MissingExtraError, SceneError, SweepError
from vrte.formats.atomic import atomic_write
from vrte.formats.contents import BRDF, CONVENTIONS, WAVELENGTH
from vrte.formats.netcdf import STOKES, check_netcdf, new_netcdf
from vrte.sweep.grid import Grid
from vrte.sweep.optics import Optics
from vrte.sweep.template import Axis, Sweep, request_of, scene_at, sweep_of, unseen

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".zarr", ".nc")
STOKES_DIMS = ("stokes_out", "stokes_in")


@dataclass(frozen=True, eq=False)
class Layout:
    """Shapes and coordinates of a table: ``grid`` of scenes; ``coordinates`` (n,) of the directions by name;
    ``variables``: names of what each scene brings, with dimensions and shape."""

    grid: Grid
    dimensions: tuple[str, ...]
    coordinates: dict[str, Array]
    variables: dict[str, tuple[tuple[str, ...], tuple[int, ...]]]

    def empty(self, chunk: int) -> dict[str, Array]:
        """A chunk's arrays, NaN all over, scenes flat: (scenes, ...)."""
        scenes = math.prod(self.grid.extent(chunk))
        return {name: np.full((scenes, *shape), np.nan) for name, (_, shape) in self.variables.items()}


def directions_of(sweep: Sweep) -> tuple[dict[str, Array], bool]:
    """The coordinates that all scenes share, and whether transmission is asked for."""
    first = scene_at(sweep, (0,) * len(sweep.shape), unseen)
    transmission = bool(first.request.get("transmission", False))
    request = request_of(first)
    assert request.mu is not None
    return {"mu_i": request.mu0, "mu_o": request.mu[request.mu > 0.0], "phi_deg": request.phi}, transmission


def variables_of(coordinates: dict[str, Array], transmission: bool) -> dict[str, tuple[tuple[str, ...], Any]]:
    """What each scene brings: dimensions and shape."""
    lengths = {name: values.size for name, values in coordinates.items()} | dict.fromkeys(STOKES_DIMS, 4)
    return {
        name: (about.dims, tuple(lengths[dim] for dim in about.dims))
        for name, about in BRDF.variables.items()
        if name != "transmission" or transmission
    }


def bytes_of_a_scene(variables: dict[str, tuple[tuple[str, ...], Any]]) -> int:
    """Of its results."""
    return sum(8 * math.prod(shape) for _, shape in variables.values())


@dataclass(frozen=True, eq=False)
class Work:
    """A sweep at work in ``folder``; what any worker needs to compute a chunk of it."""

    folder: Path
    sweep: Sweep
    layout: Layout
    stamp: str

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """The Zarr arrays of the results."""
        group = zarr().open_group(self.folder / "table", mode="r+")
        return {name: group[name] for name in self.layout.variables}

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
        if not (self.folder / "sweep.json").is_file():
            raise SweepError(f"{self.folder} is gone: nobody waits for this chunk")
        where, extent = self.layout.grid.slices(chunk), self.layout.grid.extent(chunk)
        for name, values in arrays.items():
            self.arrays[name][where] = values.reshape(*extent, *values.shape[1:])

    def mark(self, chunk: int, said: dict[str, Any]) -> None:
        """From now on the chunk is done."""
        with atomic_write(self._mark(chunk)) as part:
            part.write_text(json.dumps(said))

    def marks(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """What was said about each finished chunk."""
        for chunk in sorted(self.done()):
            yield chunk, json.loads(self._mark(chunk).read_text())

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


def work_in(folder: Path) -> Work:
    """The work that was begun in a folder."""
    try:
        said = json.loads((folder / "sweep.json").read_text())
    except FileNotFoundError as error:
        host = socket.gethostname()
        raise SweepError(
            f"{host} does not see {folder}: the output must lie where all workers can read and write it"
        ) from error
    return work_of(folder, sweep_from(said), tuple(said["box"]), said["stamp"])


def sweep_from(said: dict[str, Any]) -> Sweep:
    """The sweep that a folder was begun for."""
    return sweep_of(said["content"], Path(said["folder"]))


def work_of(folder: Path, sweep: Sweep, box: tuple[int, ...], stamp: str) -> Work:
    coordinates, transmission = directions_of(sweep)
    layout = Layout(
        Grid(sweep.shape, box), tuple(sweep.dimensions), coordinates, variables_of(coordinates, transmission)
    )
    return Work(folder, sweep, layout, stamp)


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


def begun(folder: Path, sweep: Sweep, grid: Grid, output: Path) -> Work:
    """The work in a folder, taken up where it was left, or begun. Raises SceneError for another sweep's folder."""
    file = folder / "sweep.json"
    if file.is_file():
        said = json.loads(file.read_text())
        check_same(sweep, said, f"{output} was begun")
        return work_of(folder, sweep, tuple(said["box"]), said["stamp"])
    work = work_of(folder, sweep, grid.box, uuid.uuid4().hex)
    for name in ("table", "done", "optics"):
        shutil.rmtree(folder / name, ignore_errors=True)
        (folder / name).mkdir()
    (folder / "log.txt").unlink(missing_ok=True)
    create_table(work)
    said = {"content": sweep.described(), "folder": str(sweep.folder), "tables": sweep.tables(), "box": grid.box}
    with atomic_write(file) as part:
        part.write_text(json.dumps(said | {"stamp": work.stamp, "fingerprint": sweep.fingerprint()}))
    return work


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
    try:
        import zarr
    except ImportError as error:
        raise MissingExtraError("a sweep", "files") from error
    return zarr


def create_table(work: Work) -> None:
    """The Zarr group with its coordinates, and arrays without data."""
    layout, sweep = work.layout, work.sweep
    group = zarr().open_group(work.folder / "table", mode="w", zarr_format=3)
    group.attrs.update(attributes(sweep))
    for axis in sweep.axes:
        put_array(group, axis.name, (axis.dimension,), axis.values, attributes_of(axis))
    for name, values in layout.coordinates.items():
        put_array(group, name, (name,), values, BRDF.coordinates[name].attributes)
    for name in STOKES_DIMS:
        put_array(group, name, (name,), np.array(STOKES, object), {"long_name": "Stokes parameter"})
    for name, (dims, shape) in layout.variables.items():
        group.create_array(
            name,
            shape=(*layout.grid.shape, *shape),
            chunks=(*layout.grid.box, *shape),
            dtype="float64",
            fill_value=math.nan,
            dimension_names=(*layout.dimensions, *dims),
            attributes=BRDF.variables[name].attributes,
        )
    group.create_array(
        "error",
        shape=layout.grid.shape,
        chunks=layout.grid.box,
        dtype=str,
        fill_value="",
        dimension_names=layout.dimensions,
        attributes={"long_name": "why a scene has no result, empty where it has one"},
    )


def attributes_of(axis: Axis) -> dict[str, str]:
    """What is said of the values of an axis."""
    if axis.key == "wavelength_um":
        return WAVELENGTH.attributes
    return {"units": "um" if axis.key.endswith("_um") else "1", "long_name": axis.key}


def put_array(group: Any, name: str, dims: tuple[str, ...], values: Any, attrs: dict[str, str]) -> None:
    """A coordinate."""
    dtype = str if values.dtype == object else values.dtype
    array = group.create_array(name, shape=values.shape, dtype=dtype, dimension_names=dims, attributes=attrs)
    array[...] = values


def attributes(sweep: Sweep) -> dict[str, str]:
    """Of the whole table."""
    from vrte import __version__

    said = {
        "title": "Polarized subsurface BRDFs of particulate layers",
        "source": f"vrte {__version__}",
        "comment": CONVENTIONS,
        "sweep": json.dumps(sweep.described(), default=str),
        "tables": json.dumps(sweep.tables()),
        "fingerprint": sweep.fingerprint(),
    }
    listed = [axis.name for axis in sweep.axes if axis.name != axis.dimension]
    return said | ({"coordinates": " ".join(listed)} if listed else {})


def finish(work: Work, output: Path) -> None:
    """Errors into the table, the table to its place, the folder away."""
    table = work.folder / "table"
    errors = zarr().open_group(table, mode="r+")["error"]
    for chunk, said in work.marks():
        if said["failed"]:
            extent = work.layout.grid.extent(chunk)
            words = np.full(math.prod(extent), "", object)
            for place, message in said["failed"].items():
                words[int(place)] = message
            errors[work.layout.grid.slices(chunk)] = words.reshape(extent)
    if output.suffix == ".zarr":
        consolidate(table)
        os.rename(table, output)
    else:
        with atomic_write(output) as part:
            as_netcdf(work, part)
    clear(work.folder)


def consolidate(table: Path) -> None:
    """All metadata in one place, where xarray looks for them first."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata is currently not part")
        zarr().consolidate_metadata(table)


def clear(folder: Path) -> None:
    """Takes away a folder that is of no more use; sweep.json first, so that nobody takes up what is left of it."""
    (folder / "sweep.json").unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)


def as_netcdf(work: Work, path: Path) -> None:
    """The Zarr table as NetCDF, one chunk after another."""
    import h5py

    group, grid = zarr().open_group(work.folder / "table", mode="r"), work.layout.grid
    with new_netcdf(path) as file:
        file.attrs.update(group.attrs.asdict())
        for name, array in sorted(group.arrays()):
            for dim, length in zip(array.metadata.dimension_names, array.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = length
            text = array.dtype.kind in "OT"
            dtype = h5py.string_dtype() if text else array.dtype
            per_scene = name == "error" or name in work.layout.variables
            variable = file.create_variable(name, array.metadata.dimension_names, dtype)
            variable.attrs.update(array.attrs.asdict())
            for where in map(grid.slices, range(grid.chunks)) if per_scene else [...]:
                values = array[where]
                variable[where] = values.astype(object) if text else values


def open_table(path: str | os.PathLike[str]) -> "xarray.Dataset":
    """A complete table, its data read when they are asked for. Raises SceneError, MissingExtraError, OSError."""
    try:
        import xarray
    except ImportError as error:
        raise MissingExtraError("a table", "files") from error
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such table: {path}")
    try:
        if path.suffix == ".zarr":
            zarr()
            dataset = xarray.open_zarr(path, chunks=None, consolidated=True)
        else:
            check_netcdf(path)
            dataset = xarray.open_dataset(path, engine="h5netcdf")
    except SceneError as error:
        raise SceneError(f"{path} is no table of a sweep: {error}") from error
    except (ValueError, KeyError, OSError) as error:
        raise SceneError(f"{path} is no table of a sweep") from error
    if "sweep" not in dataset.attrs:
        dataset.close()
        raise SceneError(f"{path} is no table of a sweep")
    return dataset[[name for name in (*BRDF.variables, "error") if name in dataset]]
