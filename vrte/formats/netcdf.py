"""Results as labelled data sets, in memory (xarray) and on disk (NetCDF), by the CF conventions."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.basics.memory import limit_memory, limit_time
from vrte.formats.atomic import check_file_name, is_sealed, make_seal, write_atomically
from vrte.formats.contents import (
    BRDF,
    FIELD,
    KINDS,
    MEANINGLESS,
    NAMES,
    PARAMETER,
    STOKES_AXIS,
    Result,
    collect_arrays,
    describe_result,
    explain_error,
    find_kind,
    list_derivatives,
    restore_result,
)
from vrte.formats.hdf5_file import LARGEST_RESULT, check_storage, has_array, open_dataset, read_arrays, read_text
from vrte.results.quantities import STOKES
from vrte.results.spectrum import SCENE
from vrte.results.views import Views

if TYPE_CHECKING:
    import xarray

LABELLED, NETCDF = "a labelled or NetCDF result", "reading or writing NetCDF"
CF = "CF-1.11"
PATIENCE, SLOWEST = 30.0, 5e6  # seconds for a foreign file, and bytes of it that are read in each second more
START = "import sys; sys.path[:] = {path!r}; from vrte.formats.netcdf import answer; answer()"
SIGNATURE = b"\x89HDF\r\n\x1a\n"
REFUSED = 3  # exit code
SMALL = 1e9  # bytes beside the arrays
Stored = tuple[dict[str, str], dict[str, Any]]  # texts, arrays


def to_xarray(result: Result) -> "xarray.Dataset":
    """A labelled copy of ``result``; every variable and coordinate has ``units`` and ``long_name``.

    ``mueller`` has the dims (mu_i, mu_o, phi_deg, stokes_out, stokes_in), with wavelength_um in front for a spectrum;
    ``stokes`` has (tau, mu, phi_deg, stokes_parameter), with mu0 in front for several beams; labels are "I", "Q", "U"
    and "V". Derivatives have parameter in front, labelled by names. Raises MissingExtraError without xarray.

    >>> to_xarray(brdf).mueller.sel(stokes_out="I", stokes_in="I").dims
    ('mu_i', 'mu_o', 'phi_deg')
    """
    xarray = import_extra("xarray", LABELLED, "files")
    kind, arrays = find_kind(result), collect_arrays(result)
    labels = (STOKES_AXIS,) if "stokes" in kind.variables else ("stokes_out", "stokes_in")
    data = {
        name: (about.dims, arrays[name], about.attributes) for name, about in kind.variables.items() if name in arrays
    }
    coords: dict[str, Any] = {
        name: (about.dims, arrays[name], about.attributes) for name, about in kind.coordinates.items()
    }
    coords |= {axis: (axis, list(STOKES), {"long_name": "Stokes parameter"}) for axis in labels}
    if names := list_derivatives(result):
        coords[PARAMETER] = PARAMETER, names, {"long_name": "number of the scene that derivatives are by"}
    return xarray.Dataset(data, coords, _name_conventions(arrays, kind.coordinates) | describe_result(result)).copy(
        deep=True
    )


def convert_views(views: Views) -> "xarray.Dataset":
    """A labelled copy of the Stokes vectors of single geometries, ``stokes`` (geometry, stokes_parameter)."""
    about = {name: FIELD.variables.get(name) or FIELD.coordinates[name] for name in ("stokes", "mu0", "mu", "phi_deg")}
    rows = {"mu0": views.mu0, "mu": views.mu, "phi_deg": views.phi}
    data = {"stokes": (("geometry", STOKES_AXIS), views.stokes, about["stokes"].attributes)}
    coords = {name: ("geometry", values, about[name].attributes) for name, values in rows.items()}
    labels = {STOKES_AXIS: list(STOKES), "tau": ((), views.tau, FIELD.coordinates["tau"].attributes)}
    labels |= {} if views.index is None else {"index": ((), views.index, FIELD.variables["index"].attributes)}
    return import_extra("xarray", LABELLED, "files").Dataset(data, coords | labels).copy(deep=True)


def _name_conventions(arrays: dict[str, Any], coordinates: Any) -> dict[str, str]:
    """The name of the conventions, where they hold: their coordinates must be strictly monotonic."""
    steps = [np.diff(arrays[name]) for name in coordinates]
    return {"Conventions": CF} if all(np.all(step > 0.0) or np.all(step < 0.0) for step in steps) else {}


def save_netcdf(result: Result, path: str | os.PathLike[str]) -> None:
    """Writes ``result`` to the NetCDF file ``path``, all of it or nothing; the same result makes the same bytes.

    It is made in memory, and ends in a checksum by which `load_netcdf` knows damage. Raises MissingExtraError without
    the extra "files", or OSError.

    >>> save_netcdf(brdf, "result.nc")
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


@contextmanager
def create_netcdf(path: str | os.PathLike[str]) -> Iterator[Any]:
    """An `h5netcdf.File` at ``path`` to write to piece by piece. Raises OSError at its end where the disk was full.

    >>> with create_netcdf("table.nc") as file:
    ...     file.attrs["title"] = "empty"
    """
    h5netcdf = import_extra("h5netcdf", NETCDF, "files")
    with WrittenFile(path) as written:
        with h5netcdf.File(written, "w") as file:
            yield file
        written.check()


class WrittenFile(io.RawIOBase):
    """A file for HDF5 to write to. An error of the disk is kept for `check`: HDF5 crashes where it is told of one."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = open(path, "w+b", buffering=0)  # noqa: SIM115
        self._error: OSError | None = None

    def check(self) -> None:
        """Raises the OSError of whatever could not be written so far."""
        if self._error is not None:
            raise self._error

    def write(self, content: Any) -> int:
        rest = memoryview(content).cast("B")
        size = len(rest)
        try:
            while rest and self._error is None:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._error = error
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._error = self._error or error
            return size or 0

    def readinto(self, buffer: Any) -> int | None:
        return self._file.readinto(buffer)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()
        super().close()


def load_netcdf(path: str | os.PathLike[str], most_bytes: float = LARGEST_RESULT) -> Result:
    """The result that `save_netcdf` wrote to ``path``, every digit as it was; ``most_bytes`` as in `vrte.load`.

    A file whose checksum is not that of its bytes is refused. One without a checksum, changed by another program or
    made by one, is read in a process of its own: HDF5 can hang or crash on damaged bytes.
    Raises FileNotFoundError, SceneError for a file that holds no result of this package, MissingExtraError.

    >>> save_netcdf(brdf, "result.nc")
    >>> load_netcdf("result.nc").mueller.shape
    (2, 20, 37, 4, 4)
    """
    import_extra("h5netcdf", NETCDF, "files")
    name = check_file_name(path)
    if not os.path.exists(name):
        raise FileNotFoundError(f"no such file: {name}")
    try:
        check_signature(name)
        told, arrays = (read_stored if is_sealed(name) else read_foreign)(name, most_bytes)
    except SceneError as error:
        raise SceneError(f"{name} {error}") from error
    try:
        names = json.loads(told[NAMES]) if NAMES in told else None
        return restore_result(KINDS[told["kind"]], arrays, json.loads(told["diagnostics"]), told.get(SCENE), names)
    except MEANINGLESS as error:
        raise SceneError(f"{name} holds no BRDF, field or spectrum written by vrte: {explain_error(error)}") from error


def check_signature(name: str) -> None:
    """Raises SceneError for what cannot be HDF5, whose first bytes are known, and for what may have no end."""
    if not os.path.isfile(name):
        raise SceneError("is no file, but a folder, a pipe or a device")
    with open(name, "rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            raise SceneError("is not a NetCDF file: it does not begin as one of NetCDF-4, which is HDF5")


def check_netcdf(path: str | os.PathLike[str]) -> None:
    """Raises SceneError where something in a NetCDF file leads to another file, OSError where it is none.

    >>> save_netcdf(brdf, "result.nc")
    >>> check_netcdf("result.nc")
    """
    import h5py

    with h5py.File(check_file_name(path), "r") as file:
        for name in file.id:
            check_storage(open_dataset(file, name.decode()), name.decode())


def read_stored(name: str, most_bytes: float) -> Stored:
    """The texts and the arrays of a result in a NetCDF file. Raises SceneError."""
    import h5py

    try:
        with h5py.File(name, "r") as file:
            texts = {key: read_text(file, key) for key in ("kind", "diagnostics", SCENE, NAMES)}
            told = {key: text for key, text in texts.items() if text is not None}
            # files of version 0.1 do not say their kind
            kind = told.setdefault("kind", BRDF.name if has_array(file, "mueller") else FIELD.name)
            known = KINDS.get(kind, BRDF)
            names = [key for key in (*known.coordinates, *known.variables) if has_array(file, key)]
            return told, read_arrays(file, names, most_bytes)
    except MemoryError:
        raise
    except SceneError as error:
        raise SceneError(f"is refused: {error}") from error
    except Exception as error:  # whatever two libraries below make of bytes that mean nothing
        raise SceneError(f"is not a NetCDF file: {explain_error(error)}") from error


def read_foreign(name: str, most_bytes: float, reader: str = "vrte.formats.netcdf:read_stored") -> Stored:
    """As `read_stored`, or another ``reader`` of vrte's, "module:function", in a process of its own.

    It has as much time and memory as such a file can take.
    """
    seconds = PATIENCE + os.path.getsize(name) / SLOWEST
    asked = json.dumps([os.path.abspath(name), most_bytes, seconds, reader])
    command = [sys.executable, "-c", START.format(path=sys.path)]
    try:
        done = subprocess.run(command, input=asked.encode(), capture_output=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        raise SceneError(f"is damaged: HDF5 has not read it after {seconds:.0f} s") from None
    if done.returncode == REFUSED:
        raise SceneError(done.stdout.decode(errors="replace"))
    if done.returncode != 0:
        raise SceneError(f"is not a NetCDF file: the process that reads it has ended with code {done.returncode}")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
        arrays = {key: found[key] for key in found}
    return json.loads(str(arrays.pop("told"))), arrays


def answer() -> None:
    """What the process for foreign files does: reads the name on its input, writes what is in the file."""
    name, most_bytes, seconds, reader = json.load(sys.stdin)
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    limit_time(seconds)
    limit_memory(4 * most_bytes + SMALL)
    try:
        module, function = reader.split(":")
        told, arrays = getattr(import_module(module), function)(name, most_bytes)
    except (SceneError, MemoryError) as error:
        output.write((str(error) or "takes more memory than there is").encode(errors="replace"))
        output.flush()
        os._exit(REFUSED)
    np.savez(output, told=np.array(json.dumps(told)), **arrays)
    output.flush()
    os._exit(0)  # at once: what HDF5 made of a damaged file is not taken down
