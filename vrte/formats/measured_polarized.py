"""Files of Mitsuba's BSDF ``measured_polarized``: Mueller matrices over Rusinkiewicz angles, and tensor files as such.

The file's half vector has the angle theta_h with the normal, the light's direction i the angle theta_d with the half
vector, and phi_d is the azimuth of i about it, 0 where the half vector leans to. i and the view's direction o both
point away from the surface. Its Stokes axes are perpendicular to the plane of i and o and in it; ours are meridian
planes, so that each matrix is turned by two rotations.

A tensor file is a head that lists arrays, then their bytes, all little-endian. The head: "tensor_file" and a zero byte,
the version as two bytes (1, 0), the number of fields (uint32); then for each field the length of its name (uint16), the
name, its number of dimensions (uint16), its type (uint8), where its bytes begin (uint64) and its shape (uint64 each).
"""

import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, check_whole
from vrte.basics.errors import SceneError
from vrte.basics.splines import make_cosines
from vrte.formats.atomic import PathName, check_file_name, write_atomically

MAGIC, VERSION = b"tensor_file\0", (1, 0)
TYPES = ("", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")  # by number, as NumPy spells them
ALIGNMENT = 8  # bytes
MOST_FIELDS, MOST_DIMENSIONS = 1000, 16
LARGEST = 2e9  # bytes of a file


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
    """The arrays of a tensor file by their names. Raises SceneError for one damaged or too long, OSError."""
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


AXES = ("phi_d", "theta_d", "theta_h")  # [rad]: from -pi to pi, from 0 to pi/2 twice, all with both ends
Axes = tuple[Array, Array, Array]
COSINES, AZIMUTHS = 48, 73  # to solve for, by default
FEWEST, MOST = 8, 1024


def directions(cosines: int = COSINES, azimuths: int = AZIMUTHS) -> dict[str, Any]:
    """Directions mu_i, mu_o and phi [degrees] for a spectrum that is written as a table. Raises SceneError."""
    mu = make_cosines(check_whole("cosines", cosines, FEWEST, MOST))
    return {"mu_i": mu, "mu_o": mu, "phi": np.linspace(0.0, 180.0, check_whole("azimuths", azimuths, FEWEST, MOST))}


def make_unit_vectors(mu: Array, azimuth: Array) -> Array:
    """Unit vectors (n, 3)."""
    across = np.sqrt(1.0 - mu**2)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), mu], axis=1)


def make_pairs(mu_i: Array, mu_o: Array, phi_deg: Array) -> tuple[Array, Array]:
    """Directions of light, which travels along azimuth 0, and view, (n, 3) each, of cosines and azimuths [degrees]."""
    cosine, seen, azimuth = (axis.ravel() for axis in np.broadcast_arrays(mu_i, mu_o, phi_deg))
    return make_unit_vectors(cosine, np.full_like(cosine, np.pi)), make_unit_vectors(seen, np.radians(azimuth))


def find_half_angles(into: Array, out: Array) -> Array:
    """phi_d, theta_d and theta_h (n, 3) [rad] of directions (n, 3) of light and view."""
    middle = normalise(into + out)
    sideways = normalise(np.cross([0.0, 0.0, 1.0], middle))
    phi = np.arctan2((sideways * into).sum(axis=1), (np.cross(sideways, middle) * into).sum(axis=1))
    spread = np.arccos(np.clip((middle * into).sum(axis=1), -1.0, 1.0))
    return np.stack([phi, spread, np.arccos(np.clip(middle[:, 2], -1.0, 1.0))], axis=1)


def evaluate_table(table: NDArray[np.floating], axes: Axes, into: Array, out: Array) -> Array:
    """What Mitsuba makes of the table M at pairs of directions (n, 3), in meridian planes: (n, wavelength, 4, 4)."""
    from scipy.interpolate import RegularGridInterpolator

    indices = find_half_angles(into, out)
    across = normalise(np.cross(into, out))
    from_light, to_view = turn(-into, across)[:, None], turn(out, across)[:, None]
    return np.asarray(to_view.swapaxes(2, 3) @ RegularGridInterpolator(axes, table)(indices) @ from_light)


def normalise(vectors: Array) -> Array:
    """Vectors (n, 3) of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def turn(travel: Array, across: Array) -> Array:
    """Matrices (n, 4, 4) from the meridian plane of ``travel`` to the plane across ``across``, Q turned over."""
    azimuth = np.arctan2(travel[:, 1], travel[:, 0])
    horizontal = np.hypot(travel[:, 0], travel[:, 1])
    # theta-hat, along which l lies, and r with r x l along the direction of travel: minus phi-hat
    meridian = np.stack([travel[:, 2] * np.cos(azimuth), travel[:, 2] * np.sin(azimuth), -horizontal], axis=1)
    beside = np.stack([np.sin(azimuth), -np.cos(azimuth), 0.0 * azimuth], axis=1)
    inside = np.cross(travel, across)  # l of the other plane, or its opposite, which is the same axis
    cosine, sine = (meridian * inside).sum(axis=1), (beside * inside).sum(axis=1)
    found = np.zeros((len(travel), 4, 4))
    found[:, 0, 0] = found[:, 3, 3] = 1.0
    found[:, 2, 2] = cosine**2 - sine**2
    found[:, 1, 1] = -found[:, 2, 2]
    found[:, 1, 2] = found[:, 2, 1] = -2.0 * sine * cosine
    return found
