"""The table of a sweep on disk: a Zarr group, always the same bytes for the same sweep, or NetCDF made of it. Its
numbers are read by descriptions of arrays that are written anew, never by its own."""

import hashlib
import itertools
import json
import math
import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import make_seal, read_blocks
from vrte.formats.contents import CONVENTIONS
from vrte.formats.netcdf import check_netcdf, create_netcdf
from vrte.results.quantities import STOKES
from vrte.sweep.results import TABLE, Results
from vrte.sweep.template import Sweep

if TYPE_CHECKING:
    import xarray

SUFFIXES = (".zarr", ".nc")
ZARR = 3  # the format: of version 2, reading can run code that a table brings along
TITLES = {"brdf": "Polarized BRDFs", "field": "Polarized radiance fields", "appearance": "Appearance"}
CODECS = {"bytes", "vlen-utf8", "zstd"}
LARGEST_CHUNK = 32e6  # bytes of results in a chunk, unless the user asks for more scenes
MOST_AT_ONCE, PIECES = 64, 32  # scenes of a chunk, and chunks of a sweep that workers can share


@dataclass(frozen=True)
class Grid:
    """A grid of scenes of this ``shape`` cut into boxes, smaller where the shape ends: each is a chunk of the table."""

    shape: tuple[int, ...]
    box: tuple[int, ...]

    @property
    def boxes(self) -> tuple[int, ...]:
        """How many boxes there are along each dimension."""
        return tuple(-(-length // side) for length, side in zip(self.shape, self.box, strict=True))

    @property
    def chunks(self) -> int:
        return math.prod(self.boxes)

    def slices(self, chunk: int) -> tuple[slice, ...]:
        """Where in the table a chunk lies."""
        corner = np.unravel_index(chunk, self.boxes)
        starts = [int(index) * side for index, side in zip(corner, self.box, strict=True)]
        ends = zip(starts, self.box, self.shape, strict=True)
        return tuple(slice(start, min(start + side, length)) for start, side, length in ends)

    def extent(self, chunk: int) -> tuple[int, ...]:
        """The shape of a chunk."""
        return tuple(part.stop - part.start for part in self.slices(chunk))

    def places(self, chunk: int) -> Iterator[tuple[int, ...]]:
        """The indices of a chunk's scenes, the last dimension fastest."""
        return itertools.product(*(range(part.start, part.stop) for part in self.slices(chunk)))


def cut_grid(shape: tuple[int, ...], most: int) -> Grid:
    """Boxes of at most ``most`` scenes, whole along the last dimensions, evenly cut along the one before."""
    box = [1] * len(shape)
    room = most
    for index in reversed(range(len(shape))):
        pieces = -(-shape[index] // max(1, room))
        box[index] = -(-shape[index] // pieces)
        room //= shape[index]
    return Grid(shape, tuple(box))


def choose_chunk_size(count: int, bytes_of_a_scene: int) -> int:
    """Scenes of a chunk: enough chunks to share, none too large, and not a file for each of very many scenes."""
    return max(1, min(MOST_AT_ONCE, -(-count // PIECES), int(LARGEST_CHUNK // bytes_of_a_scene)))


def open_group(path: Path, mode: str = "r") -> Any:
    """A Zarr group of the one format. Raises MissingExtraError."""
    return import_extra("zarr", "a sweep", "files").open_group(path, mode=mode, zarr_format=ZARR)


def create_table(path: Path, sweep: Sweep, grid: Grid, results: Results) -> None:
    """Writes the group with its coordinates, and arrays without data; always the same bytes."""
    zarr = import_extra("zarr", "a sweep", "files")
    group, about = open_group(path, "w"), {**results.kind.coordinates, **results.kind.variables}
    group.attrs.update(describe_table(sweep, grid.box))
    known: list[tuple[str, tuple[str, ...], Any, dict[str, str]]] = [
        *((axis.name, (axis.dimension,), axis.values, axis.attributes) for axis in sweep.axes),
        *((name, (name,), values, about[name].attributes) for name, values in results.coordinates.items()),
        *((name, (name,), np.array(STOKES, object), {"long_name": "Stokes parameter"}) for name in results.labels),
        *((name, dims, values, about[name].attributes) for name, (dims, values) in results.constants.items()),
    ]
    for name, dims, values, attributes in known:
        dtype = str if values.dtype == object else values.dtype
        how: dict[str, Any] = {"dimension_names": dims, "attributes": attributes, "compressors": None}
        group.create_array(name, shape=values.shape, dtype=dtype, **how)[...] = values
    scenes, every = tuple(sweep.dimensions), (grid.chunks,)
    why = {"long_name": "why a scene has no result, empty if it has"}
    sums = {"long_name": "SHA-256 of the results of each chunk of scenes"}
    growing: list[tuple[Any, ...]] = [
        *(
            (name, (*grid.shape, *shape), (*grid.box, *shape), "float64", (*scenes, *dims), about[name].attributes)
            for name, (dims, shape) in results.variables.items()
        ),
        ("error", grid.shape, grid.box, str, scenes, why),
        ("checksum", every, every, str, ("chunk",), sums),
    ]
    packing = zarr.codecs.ZstdCodec(level=0, checksum=True)
    for name, shape, chunks, dtype, dims, attributes in growing:
        how = {"dimension_names": dims, "attributes": attributes, "compressors": packing}
        group.create_array(
            name, shape=shape, chunks=chunks, dtype=dtype, fill_value="" if dtype is str else math.nan, **how
        )
    with warnings.catch_warnings():  # all metadata in one place, where xarray looks for them first
        warnings.filterwarnings("ignore", "Consolidated metadata is currently not part")
        zarr.consolidate_metadata(path)


def describe_table(sweep: Sweep, box: tuple[int, ...]) -> dict[str, Any]:
    """Attributes of the whole table: its sweep, the box of a chunk, and a checksum over all."""
    from vrte import __version__

    attributes: dict[str, Any] = {
        "title": f"{TITLES[sweep.kind]} of particulate layers",
        "source": f"vrte {__version__}",
        "comment": sweep.asked.conditions.words if sweep.kind == TABLE else CONVENTIONS,
        "sweep": json.dumps(sweep.described(), default=str),
        "tables": json.dumps(sweep.tables()),
        "fingerprint": sweep.fingerprint(),
    }
    listed = [axis.name for axis in sweep.axes if axis.name != axis.dimension]
    attributes |= ({"coordinates": " ".join(listed)} if listed else {}) | {"chunk": list(box)}
    return attributes | {"sha256": hash_attributes(attributes)}


def hash_attributes(attributes: dict[str, Any]) -> str:
    """The description that a table holds."""
    return hashlib.sha256(json.dumps(attributes, sort_keys=True).encode()).hexdigest()


def read_box(sweep: Sweep, output: Path) -> tuple[int, ...]:
    """The chunks' box of a finished Zarr table of this sweep, read without the library. Raises SceneError."""
    try:
        attributes: dict[str, Any] = json.loads((output / "zarr.json").read_bytes())["attributes"]
        whole = attributes.pop("sha256") == hash_attributes(attributes)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        whole = False
    if not whole:
        raise SceneError(
            f"{output} is no table of a sweep, or too damaged to say of which: take another output, or remove it"
        )
    check_made(sweep, attributes, output)
    return tuple(attributes["chunk"])


def check_made(sweep: Sweep, attributes: Any, output: Path) -> None:
    """Whether a finished table, by its attributes, is that of this sweep. Raises SceneError."""
    try:
        content, tables = json.loads(attributes["sweep"]), json.loads(attributes["tables"])
        before = {"content": content, "tables": tables, "fingerprint": attributes["fingerprint"]}
    except (ValueError, LookupError, TypeError) as error:
        raise SceneError(f"{output} is no table of a sweep") from error
    check_same(sweep, before, f"{output} was made")


def check_same(sweep: Sweep, before: dict[str, Any], what: str) -> None:
    """Whether this is the sweep that was begun."""
    if before["fingerprint"] == sweep.fingerprint():
        return
    changed = list_changes(before["content"], json.loads(json.dumps(sweep.described())))
    changed = changed or list_changes(before["tables"], sweep.tables(), "table ") or ["the version of vrte"]
    raise SceneError(
        f"{what} with another sweep: {', '.join(changed[:5])} changed. Take another output, or remove the old one"
    )


def list_changes(before: Any, now: Any, name: str = "") -> list[str]:
    """Dotted keys where two contents differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = sorted({*before, *now})
        dotted = f"{name}." if name and not name.endswith(" ") else name
        return [found for key in keys for found in list_changes(before.get(key), now.get(key), f"{dotted}{key}")]
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True), 1)
        return [found for index, pair in pairs for found in list_changes(*pair, f"{name}[{index}]")]
    return [] if before == now else [name]


def convert_to_netcdf(table: Path, grid: Grid, path: Path) -> None:
    """The Zarr table as NetCDF, one chunk of scenes after another, with a checksum at its end."""
    import h5py

    group = open_group(table)
    scenes = group["error"].metadata.dimension_names
    with create_netcdf(path) as file:
        file.attrs.update(group.attrs.asdict())
        for name, array in sorted(group.arrays()):
            dims = array.metadata.dimension_names
            for dim, length in zip(dims, array.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = length
            text = array.dtype.kind in "OT"
            variable = file.create_variable(name, dims, h5py.string_dtype() if text else array.dtype)
            variable.attrs.update(array.attrs.asdict())
            for where in map(grid.slices, range(grid.chunks)) if dims[: len(scenes)] == scenes else [...]:
                values = array[where]
                variable[where] = values.astype(object) if text else values
    with open(path, "r+b") as whole:
        whole.write(make_seal(read_blocks(whole)))


def check_codecs(path: Path) -> None:
    """Raises SceneError where a Zarr table packs its numbers and words in other ways than a sweep does."""
    for name, array in open_group(path).arrays():
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
