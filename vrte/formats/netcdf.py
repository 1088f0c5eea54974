"""Results on disk as NetCDF, and files of others, read by a process of its own: HDF5 can hang or crash on damage."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.basics.memory import limit_memory, limit_time
from vrte.formats.atomic import PathName, check_file, is_sealed, make_seal, write_atomically
from vrte.formats.contents import ARRAYS, Result, restore_result, to_xarray
from vrte.formats.hdf5_file import CLASSIC, Stored, open_dataset, read_stored

NETCDF = "reading or writing NetCDF"
SIGNATURE = b"\x89HDF\r\n\x1a\n"
PATIENCE, SLOWEST = 30.0, 5e6  # seconds for a foreign file, and bytes of it that are read in each second more
START = "import sys; sys.path[:] = {path!r}; from vrte.formats.netcdf import answer; answer()"
REFUSED = 3  # exit code
SMALL = 1e9  # bytes beside the arrays


def save_netcdf(result: Result, path: PathName) -> None:
    """Writes ``result`` to the NetCDF file ``path``, all of it or nothing; the same result makes the same bytes.

    It is made in memory, and ends in a checksum by which `read_netcdf` knows damage. Raises MissingExtraError without
    the extra "files", or OSError.
    """
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
    """The result that `save_netcdf` wrote to ``path``, every digit as it was; ``most_bytes`` and errors as of
    `vrte.load`."""
    found = read_netcdf(path, ARRAYS, most_bytes)
    return restore_result(found.texts, found.arrays)


@contextmanager
def create_netcdf(path: PathName) -> Iterator[Any]:
    """An `h5netcdf.File` at ``path`` to write to piece by piece. Raises OSError at its end where the disk was full.

    >>> with create_netcdf("table.nc") as file:
    ...     file.attrs["title"] = "empty"
    """
    h5netcdf = import_extra("h5netcdf", NETCDF, "files")
    with WrittenFile(path, "wb+") as written:
        with h5netcdf.File(written, "w") as file:
            yield file
        written.check()


class WrittenFile(io.FileIO):
    """A file for HDF5 to write to. An error of the disk is kept for `check`: HDF5 crashes where it is told of one."""

    error: OSError | None = None

    def check(self) -> None:
        """Raises the OSError of whatever could not be written so far."""
        if self.error is not None:
            raise self.error

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


def check_netcdf(path: PathName) -> None:
    """Raises SceneError where something in a NetCDF file leads to another file, OSError where it is none."""
    import h5py

    with h5py.File(check_file(path), "r") as file:
        for name in file.id:
            open_dataset(file, name.decode())


def read_netcdf(path: PathName, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """The ``wanted`` ones of the arrays of a NetCDF file, or all, and its texts.

    A file whose checksum is not that of its bytes is refused. One without a checksum is read in a process of its own,
    with as much time and memory as such a file can take. Raises SceneError, MissingExtraError without the extra
    "files", OSError.
    """
    import_extra("h5netcdf", NETCDF, "files")
    name = check_file(path)
    with open(name, "rb") as file:
        begins = file.read(len(SIGNATURE))
    if begins != SIGNATURE and begins[:4] not in CLASSIC:
        raise SceneError("it is not a NetCDF file: it does not begin as one")
    return (read_stored if is_sealed(name) else read_foreign)(name, wanted, most_bytes)


def read_foreign(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """As `read_stored`, in a process of its own."""
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
    except (SceneError, MemoryError) as error:
        output.write((str(error) or "it takes more memory than there is").encode(errors="replace"))
        output.flush()
        os._exit(REFUSED)
    np.savez(
        output, np.array(json.dumps([found.texts, [*found.arrays], found.units, found.dims])), *found.arrays.values()
    )
    output.flush()
    os._exit(0)  # at once: what HDF5 made of a damaged file is not taken down
