"""Mitsuba's files: its container of named arrays, and a scene file with its own dielectric on a table.

A tensor file is a head that lists arrays, then their bytes, all little-endian. The head: "tensor_file" and a zero byte,
the version as two bytes (1, 0), the number of fields (uint32); then for each field the length of its name (uint16), the
name, its number of dimensions (uint16), its type (uint8), where its bytes begin in the file (uint64) and its shape
(uint64 each).
"""

import math
import struct
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.errors import SceneError
from vrte.formats.atomic import PathName, check_file_name, write_atomically

MAGIC, VERSION = b"tensor_file\0", (1, 0)
TYPES = ("", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")  # by number, as NumPy spells them
ALIGNMENT = 8  # bytes
MOST_FIELDS, MOST_DIMENSIONS = 1000, 16
LARGEST = 2e9  # bytes of a file
GAP = 5e-4  # of two spheres of radius 1: rays start 1.8e-4 off what they leave; angles change by its square root


def write_tensors(fields: Mapping[str, NDArray[Any]], path: PathName) -> None:
    """Writes arrays by their names to ``path``, all of it or nothing. Raises OSError, SceneError for another type."""
    arrays = {name.encode("utf-8"): np.asarray(values, order="C") for name, values in fields.items()}
    index = len(MAGIC) + 6 + sum(13 + len(name) + 8 * array.ndim for name, array in arrays.items())
    head, starts = [MAGIC, struct.pack("<BBI", *VERSION, len(arrays))], []
    for name, array in arrays.items():
        kind = array.dtype.str[1:]
        if kind not in TYPES:
            raise SceneError(f"{name.decode()} must be real numbers of a plain type, not {array.dtype}")
        index += -index % ALIGNMENT
        about = array.ndim, TYPES.index(kind), index, *array.shape
        head.append(struct.pack("<H", len(name)) + name + struct.pack(f"<HBQ{array.ndim}Q", *about))
        starts.append(index)
        index += array.nbytes
    with write_atomically(path) as part, open(part, "wb") as file:
        file.write(b"".join(head))
        for start, array in zip(starts, arrays.values(), strict=True):
            file.write(b"\0" * (start - file.tell()))
            file.write(array.astype(array.dtype.newbyteorder("<"), copy=False).data)


def read_tensors(path: PathName, most_bytes: float = LARGEST) -> dict[str, NDArray[Any]]:
    """The arrays of a tensor file by their names. Raises SceneError for a file that is none, is cut off or is longer
    than ``most_bytes``, OSError."""
    name = check_file_name(path)
    with open(name, "rb") as file:
        content = file.read(int(most_bytes) + 1)
    try:
        if len(content) > most_bytes:
            raise SceneError(f"the file is longer than the {most_bytes / 1e9:g} GB that are read")
        return _read_fields(content)
    except SceneError as error:
        raise error.behind(name) from error
    except (struct.error, ValueError, OverflowError) as error:  # a shape that no array has, among others
        raise SceneError(f"{name} is no tensor file, or it is damaged") from error


def _read_fields(content: bytes) -> dict[str, NDArray[Any]]:
    if not content.startswith(MAGIC):
        raise SceneError("not a tensor file")
    major, minor, count = struct.unpack_from("<BBI", content, len(MAGIC))
    if (major, minor) != VERSION or count > MOST_FIELDS:
        raise SceneError(f"not a tensor file of version 1.0 with at most {MOST_FIELDS} fields")
    index, found = len(MAGIC) + 6, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", content, index)
        (label,) = struct.unpack_from(f"<{length}s", content, index + 2)
        dimensions, number, start = struct.unpack_from("<HBQ", content, index + 2 + length)
        if dimensions > MOST_DIMENSIONS or not 0 < number < len(TYPES):
            raise SceneError(f"a field has {dimensions} dimensions and is of type {number}, which is no tensor")
        shape = struct.unpack_from(f"<{dimensions}Q", content, index + 13 + length)
        index += 13 + length + 8 * dimensions
        kind, size = np.dtype(f"<{TYPES[number]}"), math.prod(shape)
        if start + size * kind.itemsize > len(content):
            raise SceneError("the file is cut off: it ends before its fields do")
        found[label.decode("utf-8")] = np.frombuffer(content, kind, size, start).reshape(shape)
    return found


def write_nested_scene(path: PathName, table: PathName, index_above: float, index_below: float) -> None:
    """Writes a scene file (XML): a sphere of the table ``table``, which must lie beside ``path``, in one of a smooth
    dielectric. Mitsuba has no sum of BSDFs (blendbsdf mixes up beams and other light), so the surface is a shape of its
    own: Mitsuba follows the light through it, and up and down between the two as often as it goes. Raises OSError."""
    name = f'"{escape(Path(table).name)}"'
    template = Path(__file__).with_name("nested_dielectric.xml").read_text("utf-8")
    text = template.format(above=index_above, below=index_below, table=name, inside=1.0 - GAP)
    with write_atomically(path) as part:
        Path(part).write_text(text, encoding="utf-8")
