"""Results on disk as NetCDF, and NetCDF files that anyone may have made.

These are checked before a value is read, and never led to another file. HDF5 can hang or crash on damaged bytes: files
without a checksum of vrte's are read by a process of its own.
"""

import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError, import_extra
from vrte.basics.memory import limit_memory, limit_time
from vrte.formats.atomic import PathName, check_file, is_sealed, make_seal, write_atomically
from vrte.formats.contents import ARRAYS, TEXTS, Result, check_size, explain_error, restore_result, to_xarray

NETCDF = "reading or writing NetCDF"
SIGNATURE, CLASSIC = b"\x89HDF\r\n\x1a\n", (b"CDF\x01", b"CDF\x02")  # how files begin, and those before HDF5 did
PATIENCE, SLOWEST = 30.0, 5e6  # seconds for a foreign file, and bytes of it that are read in each second more
START = "import sys; sys.path[:] = {path!r}; from vrte.formats.netcdf import answer; answer()"
REFUSED = 3  # exit code
SMALL = 1e9  # bytes beside the arrays
BEST_COMPRESSION = 1100  # times; what is stored by deflate is at most 1032 times smaller
LARGEST_TEXT = 50_000_000  # bytes of an attribute
BESIDE = "_nc4_non_coord_"  # NetCDF-4 calls so what shares its name with a dimension, but is no coordinate
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"  # how the NAME of such a dataset begins
FILTERS = ("shuffle", "deflate", "fletcher32")  # part of HDF5 itself; any other one may load a library
WORDS = ("quantity", "geometry", "illuminant", "phamat")  # arrays of words, whatever file they are in


class Stored(NamedTuple):
    """What a file holds: those of TEXTS that it has as attributes; arrays of numbers or words, their units and dims."""

    texts: dict[str, str]
    arrays: dict[str, NDArray[Any]]
    units: dict[str, str]
    dims: dict[str, list[str]]


def save_netcdf(result: Result, path: PathName) -> None:
    """Writes ``result``, all or nothing, behind it a checksum; same result, same bytes. Raises OSError."""
    dataset = to_xarray(result)
    h5netcdf = import_extra("h5netcdf", NETCDF, "files")
    from xarray.backends import H5NetCDFStore

    for variable in dataset.variables.values():
        variable.encoding = {"_FillValue": None} if variable.dtype.kind == "f" else {}
    made = io.BytesIO()
    with h5netcdf.File(made, "w") as file:
        dataset.dump_to_store(H5NetCDFStore(file))
    with write_atomically(path) as part, open(part, "wb") as written, made.getbuffer() as content:
        written.write(content)
        written.write(make_seal([content]))


def load_netcdf(path: PathName, most_bytes: float) -> Result:
    """The result that `save_netcdf` wrote, every digit as it was; ``most_bytes`` and errors as of `vrte.load`."""
    found = read_netcdf(path, ARRAYS, most_bytes)
    return restore_result(found.texts, found.arrays)


@contextmanager
def create_netcdf(path: PathName) -> Iterator[Any]:
    """An `h5netcdf.File` at ``path`` to write to piece by piece. Raises OSError at its end where the disk was full."""
    h5netcdf = import_extra("h5netcdf", NETCDF, "files")
    with WrittenFile(path, "wb+") as written:
        with h5netcdf.File(written, "w") as file:
            yield file
        if written.error is not None:
            raise written.error


class WrittenFile(io.FileIO):
    """A file for HDF5 to write to. The first ``error`` of the disk is kept: HDF5 crashes where a write fails."""

    error: OSError | None = None

    def write(self, content: Any) -> int:
        rest = memoryview(content).cast("B")
        size = len(rest)
        try:
            while rest and self.error is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0


def read_netcdf(path: PathName, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """Texts and ``wanted`` arrays (None: all) of a NetCDF file. Raises SceneError, MissingExtraError, OSError."""
    import_extra("h5netcdf", NETCDF, "files")
    name = check_file(path)
    with open(name, "rb") as file:
        begins = file.read(len(SIGNATURE))
    if begins != SIGNATURE and begins[:4] not in CLASSIC:
        raise SceneError("it is not a NetCDF file: it does not begin as one")
    return (read_stored if is_sealed(name) else read_foreign)(name, wanted, most_bytes)


def read_foreign(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """Reads as `read_stored` does, in a process of its own, with limits of time and memory."""
    seconds = PATIENCE + os.path.getsize(name) / SLOWEST
    asked = json.dumps([os.path.abspath(name), wanted and [*wanted], most_bytes, seconds])
    command = [sys.executable, "-c", START.format(path=sys.path)]
    try:
        done = subprocess.run(command, input=asked.encode(), capture_output=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        raise SceneError(f"it is damaged: HDF5 has not read it after {seconds:.0f} s") from None
    if done.returncode == REFUSED:
        raise SceneError(done.stdout.decode(errors="replace"))
    if done.returncode != 0:
        raise SceneError(f"it is not a NetCDF file: the process that reads it has ended with code {done.returncode}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
        about, *arrays = found.values()
    texts, names, units, dims = json.loads(about.item())
    return Stored(texts, dict(zip(names, arrays, strict=True)), units, dims)


def answer() -> None:
    """What the process for foreign files does: reads the name on its input, writes what is in the file."""
    name, wanted, most_bytes, seconds = json.load(sys.stdin)
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    limit_time(seconds)
    limit_memory(4 * most_bytes + SMALL)
    try:
        found = read_stored(name, wanted, most_bytes)
        about = json.dumps([found.texts, [*found.arrays], found.units, found.dims])
        np.savez(output, np.array(about), *found.arrays.values())
        code = 0
    except (SceneError, MemoryError) as error:
        output.write((str(error) or "it takes more memory than there is").encode(errors="replace"))
        code = REFUSED
    output.flush()
    os._exit(code)  # at once: what HDF5 made of a damaged file is not taken down


def read_stored(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """The ``wanted`` arrays of a NetCDF file (None: all). Raises SceneError for what is not plainly in it."""
    try:
        with open(name, "rb") as file:
            classic = file.read(4) in CLASSIC
        return (read_classic if classic else read_hdf5)(name, wanted, most_bytes)
    except (SceneError, MemoryError):
        raise
    except Exception as error:  # whatever libraries below make of bytes that mean nothing
        raise SceneError(f"it is not a NetCDF file: {explain_error(error)}") from error


def read_classic(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """All arrays of a NetCDF file of the classic format, without texts."""
    from scipy.io import netcdf_file

    check_size(float(os.path.getsize(name)), most_bytes)
    found = Stored({}, {}, {}, {})
    with netcdf_file(name, "r", mmap=False) as file:
        for key, variable in file.variables.items():
            if wanted is None or key in wanted:
                if variable.data.dtype.kind not in "fiu":
                    raise SceneError(f"its {key} must be an array of numbers")
                found.arrays[key] = np.array(variable.data, dtype=np.float64)
                found.dims[key] = [*variable.dimensions]
                found.units[key] = bytes(getattr(variable, "units", b"")).decode(errors="replace")
    return found


def read_hdf5(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """Arrays and texts of a NetCDF file in HDF5, checked before a value is read (`read_attribute`, `check_array`)."""
    import h5py

    found, datasets = Stored({}, {}, {}, {}), {}
    with h5py.File(name, "r") as file:
        for key in TEXTS:
            if (text := read_attribute(file, key)) is not None:
                found.texts[key] = text
        for stored in sorted(map(bytes.decode, file.id), key=lambda stored: stored.startswith(BESIDE)):
            key = stored.removeprefix(BESIDE)
            if wanted is None or key in wanted:
                dataset = open_dataset(file, stored)
                if not (read_attribute(dataset, "NAME") or "").startswith(NO_VARIABLE):
                    check_array(dataset, key)
                    datasets[key] = dataset
        check_size(8.0 * sum(dataset.size for dataset in datasets.values()), most_bytes)
        for key, dataset in datasets.items():
            found.arrays[key] = np.array(dataset.asstr(errors="replace")[()], str) if key in WORDS else dataset[()]
            with suppress(SceneError):
                found.units[key] = read_attribute(dataset, "units") or ""
            scales = [dimension[0].name[1:] for dimension in dataset.dims if len(dimension)]
            found.dims[key] = [key] if dataset.is_scale else [scale.removeprefix(BESIDE) for scale in scales]
    return found


def read_attribute(holder: Any, name: str) -> str | None:
    """The text of an attribute of an open file or dataset, or None. Raises SceneError for anything else."""
    import h5py

    if not h5py.h5a.exists(holder.id, name.encode()):
        return None
    found = h5py.h5a.open(holder.id, name.encode())
    kind = found.get_type()
    if not isinstance(kind, h5py.h5t.TypeStringID) or math.prod(found.shape) != 1:
        raise SceneError(f"its attribute {name} must be one text")
    size = 0 if kind.is_variable_str() else kind.get_size()
    if size > min(LARGEST_TEXT, holder.file.id.get_filesize()):
        raise SceneError(f"its attribute {name} declares {size} bytes, more than {LARGEST_TEXT} or than the file has")
    text = np.asarray(holder.attrs[name]).item()
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


def check_netcdf(path: PathName) -> None:
    """Raises SceneError where something in a NetCDF file leads to another file, OSError where it is none."""
    import h5py

    with h5py.File(check_file(path), "r") as file:
        for name in file.id:
            open_dataset(file, name.decode())


def open_dataset(file: Any, name: str) -> Any:
    """The dataset of an open `h5py.File`, if its values lie in the file, packed by FILTERS. Raises SceneError."""
    import h5py

    if file.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise SceneError(f"its {name} is a link to elsewhere: only what lies in the file itself is read")
    dataset = file[name]
    if not isinstance(dataset, h5py.Dataset):
        raise SceneError(f"its {name} must be an array")
    made = dataset.id.get_create_plist()
    if made.get_external_count():
        raise SceneError(f"its {name} lies in another file (external storage): only what lies in the file is read")
    if made.get_layout() == h5py.h5d.VIRTUAL:
        raise SceneError(f"its {name} is put together from other files (a virtual dataset): they are not read")
    known = {getattr(h5py.h5z, f"FILTER_{one.upper()}") for one in FILTERS}
    for code, _, _, words in map(made.get_filter, range(made.get_nfilters())):
        if code not in known:
            shown = put_in_one_line(words.decode(errors="replace") or str(code), 40)
            raise SceneError(f"its {name} is packed by the filter {shown!r}: only {', '.join(FILTERS)} are known here")
    return dataset


def check_array(dataset: Any, name: str) -> None:
    """Raises SceneError unless an open dataset declares numbers, or words of that name, and no more than it holds."""
    import h5py

    words = h5py.check_string_dtype(dataset.dtype) is not None
    if dataset.shape is None or (name in WORDS) != words or not (words or dataset.dtype.kind in "fiu"):
        raise SceneError(f"its {name} must be an array of {'words' if name in WORDS else 'numbers'}")
    stored = min(dataset.id.get_storage_size(), dataset.file.id.get_filesize())
    declared = max(dataset.nbytes, math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize * bool(dataset.size))
    compressed = dataset.chunks and dataset.id.get_create_plist().get_nfilters()
    if declared > stored * (BEST_COMPRESSION if compressed else 1):
        raise SceneError(f"its {name} declares {declared} bytes of numbers, and holds {stored}")
