"""NetCDF files that anyone may have made: checked before a value is read, and never led to another file."""

import math
import os
from collections.abc import Collection
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import put_in_one_line
from vrte.basics.errors import SceneError
from vrte.formats.contents import TEXTS, check_size, explain_error

BEST_COMPRESSION = 1100  # times; what is stored by deflate is at most 1032 times smaller
LARGEST_TEXT = 50_000_000  # bytes of an attribute
BESIDE = "_nc4_non_coord_"  # NetCDF-4 calls so what shares its name with a dimension, but is no coordinate
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"  # how the NAME of such a dataset begins
FILTERS = ("shuffle", "deflate", "fletcher32")  # part of HDF5 itself; any other one may load a library
WORDS = ("quantity", "geometry", "illuminant", "phamat")  # arrays of words, whatever file they are in
CLASSIC = (b"CDF\x01", b"CDF\x02")  # what a file of NetCDF before HDF5 begins with


class Stored(NamedTuple):
    """What a file holds: those of TEXTS that it has as attributes; arrays of numbers or words, their units and dims."""

    texts: dict[str, str]
    arrays: dict[str, NDArray[Any]]
    units: dict[str, str]
    dims: dict[str, list[str]]


def read_stored(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """The ``wanted`` ones of the arrays of a NetCDF file, or all; checked before the first is read.

    Raises SceneError for one that is not plainly numbers or words in this very file (a link, external storage, a
    virtual dataset, a filter that HDF5 does not bring along), or that declares more than the file can hold, and where
    all together take more than ``most_bytes`` in memory.
    """
    try:
        with open(name, "rb") as file:
            classic = file.read(4) in CLASSIC
        return (read_classic if classic else read_hdf5)(name, wanted, most_bytes)
    except (SceneError, MemoryError):
        raise
    except Exception as error:  # whatever libraries below make of bytes that mean nothing
        raise SceneError(f"it is not a NetCDF file: {explain_error(error)}") from error


def read_classic(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """Of a file of NetCDF before HDF5, which holds all it has; no texts."""
    from scipy.io import netcdf_file

    check_size(float(os.path.getsize(name)), most_bytes)
    found = Stored({}, {}, {}, {})
    with netcdf_file(name, "r", mmap=False) as file:
        for key, variable in file.variables.items():
            if wanted is not None and key not in wanted:
                continue
            if variable.data.dtype.kind not in "fiu":
                raise SceneError(f"its {key} must be an array of numbers")
            found.arrays[key] = np.array(variable.data, dtype=np.float64)
            found.dims[key] = [*variable.dimensions]
            if isinstance(units := getattr(variable, "units", None), bytes):
                found.units[key] = units.decode(errors="replace")
    return found


def read_hdf5(name: str, wanted: Collection[str] | None, most_bytes: float) -> Stored:
    """Of one in HDF5."""
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
    """The text of an attribute of an open file or dataset, None where there is none. Raises SceneError for anything
    else.

    >>> import h5py
    >>> with h5py.File("result.h5", "w") as file:
    ...     file.attrs["kind"] = "brdf"
    ...     read_attribute(file, "kind")
    'brdf'
    """
    import h5py

    if not h5py.h5a.exists(holder.id, name.encode()):
        return None
    found = h5py.h5a.open(holder.id, name.encode())
    kind = found.get_type()
    if not isinstance(kind, h5py.h5t.TypeStringID) or math.prod(found.shape) != 1:
        raise SceneError(f"its attribute {name} must be one text")
    size = 0 if kind.is_variable_str() else kind.get_size()
    if size > min(LARGEST_TEXT, count_bytes(holder)):
        raise SceneError(f"its attribute {name} declares {size} bytes, more than {LARGEST_TEXT} or than the file has")
    text = np.asarray(holder.attrs[name]).item()
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)


def count_bytes(holder: Any) -> int:
    """The size of the file of an open dataset, or of an open file."""
    return os.fstat(holder.file.id.get_vfd_handle()).st_size


def open_dataset(file: Any, name: str) -> Any:
    """The dataset of that name in an open `h5py.File`, if its values lie in the file itself, packed in known ways only.
    Raises SceneError."""
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
    for place in range(made.get_nfilters()):
        code, _, _, words = made.get_filter(place)
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
    stored = min(dataset.id.get_storage_size(), count_bytes(dataset))
    declared = max(dataset.nbytes, math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize)
    compressed = dataset.chunks and dataset.id.get_create_plist().get_nfilters()
    if declared > stored * (BEST_COMPRESSION if compressed else 1):
        raise SceneError(f"its {name} declares {declared} bytes of numbers, and holds {stored}")
