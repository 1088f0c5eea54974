"""Results as Zarr (format 3): a folder of unpacked arrays, which other languages and object stores read, too.

An attribute has a checksum of the numbers and texts, not of files: a copy that others make, in other chunks, keeps it.
"""

import hashlib
import json
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vrte.basics.errors import SceneError, import_extra
from vrte.formats.atomic import PathName, check_file_name, write_atomically
from vrte.formats.contents import ARRAYS, TEXTS, Result, check_size, collect_arrays, restore_result, to_xarray
from vrte.formats.netcdf import LARGEST_TEXT

PURPOSE = "reading or writing Zarr"
FORMAT = 3
METADATA = "zarr.json"

SEAL = "sha256"  # the attribute


def save_zarr(result: Result, path: PathName) -> None:
    """Writes ``result`` to the Zarr folder ``path``, all of it or nothing; one that is there is replaced, and nothing
    else is. Raises MissingExtraError without the extra "files", OSError."""
    import_extra("zarr", PURPOSE, "files")
    dataset = to_xarray(result)
    dataset.attrs[SEAL] = hash_content(dataset.attrs, collect_arrays(result))
    unpacked: Any = {name: {"compressors": []} for name, array in dataset.variables.items() if array.dtype.kind == "f"}
    with write_atomically(path, METADATA) as part, warnings.catch_warnings():
        # words are not part of Zarr's specification yet; they only label the Stokes parameters
        warnings.filterwarnings("ignore", "The data type")
        dataset.to_zarr(part, mode="w", zarr_format=FORMAT, consolidated=False, encoding=unpacked)


def load_zarr(path: PathName, most_bytes: float) -> Result:
    """The result that `save_zarr` wrote to ``path``; ``most_bytes`` and errors as of `vrte.load`. Only plain numbers of
    format 3 are read, unpacked: nothing of a foreign folder is run."""
    zarr = import_extra("zarr", PURPOSE, "files")
    folder = Path(check_file_name(path))
    if not folder.is_dir():
        raise SceneError("it is no folder, but a file, a pipe or a device")
    for found in folder.rglob("*"):
        if found.is_symlink() or not (found.is_file() or found.is_dir()):
            raise SceneError("something in it is a link, a pipe or a device: only files in the folder are read")
    attributes = read_metadata(folder).get("attributes", {})
    names = [name for name in ARRAYS if (folder / name).is_dir()]
    check_size(sum(count_declared_bytes(folder, name) for name in names), most_bytes)
    group = zarr.open_group(folder, mode="r", zarr_format=FORMAT)
    arrays = {name: np.asarray(group[name][...]) for name in names}
    if SEAL in attributes and attributes[SEAL] != hash_content(attributes, arrays):
        words = f"if they were changed on purpose, take its attribute {SEAL} away"
        raise SceneError(f"it is damaged: its numbers or texts are not those that were written (checksum); {words}")
    return restore_result(attributes, arrays)


def hash_content(attributes: Mapping[str, Any], arrays: Mapping[str, Any]) -> str:
    """SHA-256 of all that makes a result: texts, and arrays by their names, every bit."""
    made = hashlib.sha256(json.dumps([attributes.get(name) for name in TEXTS]).encode())
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name], "<f8")
        made.update(json.dumps([name, values.shape]).encode())
        made.update(values.data)
    return made.hexdigest()


def read_metadata(folder: Path) -> Any:
    """What a folder says of itself."""
    with open(folder / METADATA, "rb") as file:
        text = file.read(LARGEST_TEXT + 1)
    if len(text) > LARGEST_TEXT:
        raise SceneError(f"its {METADATA} is longer than {LARGEST_TEXT} bytes")
    found = json.loads(text)
    if found["zarr_format"] != FORMAT:
        raise SceneError(f"it is of Zarr format {found['zarr_format']!r}: only {FORMAT} is read")
    return found


def count_declared_bytes(folder: Path, name: str) -> float:
    """Bytes of an array, if it is of plain numbers that are all there. Raises SceneError."""
    about = read_metadata(folder / name)
    shape, codecs = [int(length) for length in about["shape"]], [codec["name"] for codec in about["codecs"]]
    if about["data_type"] != "float64" or codecs != ["bytes"] or about.get("storage_transformers"):
        raise SceneError(f"its {name} must be plain numbers of 8 bytes, not {about['data_type']} by {codecs}")
    size = 8.0 * math.prod(shape)
    if size > sum(file.stat().st_size for file in (folder / name).rglob("*") if file.is_file()):
        raise SceneError(f"its {name} declares {size:.4g} bytes of numbers, and parts of them are not there")
    return size
