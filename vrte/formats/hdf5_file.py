"""HDF5 files that anyone may have made: checked before a value is read, and never led to another file."""

import math
import os
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, put_in_one_line
from vrte.basics.errors import SceneError

LARGEST_RESULT = 2e9  # bytes of values in memory, unless a caller allows more
BEST_COMPRESSION = 1100  # times; what is stored by deflate is at most 1032 times smaller
LARGEST_TEXT = 50_000_000  # bytes of an attribute
BESIDE = "_nc4_non_coord_"  # NetCDF-4 calls so what shares its name with a dimension, but is no coordinate
FILTERS = ("shuffle", "deflate", "fletcher32")  # part of HDF5 itself; any other one may load a library


def read_text(file: Any, name: str) -> str | None:
    """The text of an attribute of an open `h5py.File`, None where there is none. Raises SceneError for anything else.

    >>> import h5py
    >>> with h5py.File("result.h5", "w") as file:
    ...     file.attrs["kind"] = "brdf"
    ...     read_text(file, "kind")
    'brdf'
    """
    import h5py

    if not h5py.h5a.exists(file.id, name.encode()):
        return None
    found = h5py.h5a.open(file.id, name.encode())
    kind = found.get_type()
    if not isinstance(kind, h5py.h5t.TypeStringID) or math.prod(found.shape) != 1:
        raise SceneError(f"its attribute {name} must be one text")
    size = 0 if kind.is_variable_str() else kind.get_size()
    if size > min(LARGEST_TEXT, os.fstat(file.id.get_vfd_handle()).st_size):
        raise SceneError(f"its attribute {name} declares {size} bytes, more than {LARGEST_TEXT} or than the file has")
    text = file.attrs[name]
    text = text.item() if isinstance(text, np.ndarray | np.generic) else text
    return text.decode() if isinstance(text, bytes) else str(text)


def has_array(file: Any, name: str) -> bool:
    """Whether an open file has something of that name, without going where it may lead."""
    return bool(file.id.links.exists(name.encode()))


def find_stored_name(file: Any, name: str) -> str:
    """What HDF5 calls a variable of NetCDF."""
    return BESIDE + name if has_array(file, BESIDE + name) else name


def read_arrays(file: Any, names: list[str], most_bytes: float) -> dict[str, Array]:
    """The arrays of these names in an open `h5py.File`, all checked before the first is read.

    Raises SceneError for one whose values are not plainly numbers in this very file (a link, external storage, a
    virtual dataset, a filter that HDF5 does not bring along), or that declares more than the file can hold, and where
    all together take more than ``most_bytes`` in memory.

    >>> import h5py
    >>> with h5py.File("result.h5", "w") as file:
    ...     file["mu"] = [0.5, 1.0]
    ...     read_arrays(file, ["mu"], 1e9)["mu"].tolist()
    [0.5, 1.0]
    """
    found = {name: check_array(file, find_stored_name(file, name)) for name in names}
    check_size(8.0 * sum(dataset.size for dataset in found.values()), most_bytes)
    return {name: np.asarray(dataset[()]) for name, dataset in found.items()}


def check_size(size: float, most_bytes: float) -> None:
    """Raises SceneError, which says how to go on, where a result takes more memory than it may."""
    if size > most_bytes:
        raise SceneError(
            f"its values take {size / 1e9:.3g} GB, more than the {most_bytes / 1e9:.3g} GB that are read: "
            f"if you trust it, vrte.load(path, most_bytes={math.ceil(size / 1e9)}e9)"
        )


def open_dataset(file: Any, name: str) -> Any:
    """The dataset of that name, if it lies in the open file itself."""
    import h5py

    if file.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise SceneError(f"its {name} is a link to elsewhere: only what lies in the file itself is read")
    found = file[name]
    if not isinstance(found, h5py.Dataset):
        raise SceneError(f"its {name} must be an array")
    return found


def check_array(file: Any, name: str) -> Any:
    """The dataset of that name, unread, if its values are numbers that lie in the open file itself."""
    dataset = open_dataset(file, name)
    if dataset.shape is None or dataset.dtype.kind not in "fiu":
        raise SceneError(f"its {name} must be an array of numbers")
    check_storage(dataset, name)
    stored = min(dataset.id.get_storage_size(), os.fstat(file.id.get_vfd_handle()).st_size)
    declared = max(dataset.nbytes, math.prod(dataset.chunks or (0,)) * dataset.dtype.itemsize)
    compressed = dataset.chunks and dataset.id.get_create_plist().get_nfilters()
    if declared > stored * (BEST_COMPRESSION if compressed else 1):
        raise SceneError(f"its {name} declares {declared} bytes of numbers, and holds {stored}")
    return dataset


def check_storage(dataset: Any, name: str) -> None:
    """Raises SceneError unless the values of an open dataset lie in the file itself, packed in known ways only."""
    import h5py

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
