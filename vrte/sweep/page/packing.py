"""The BRDFs of a table in little room, and back again: f_00 as its logarithm and the other Mueller elements over it,
both in even steps, as differences between neighbours, deflated.

That is what `vrte.interpolate` works with, too, so that the page interpolates what it unpacks. Of azimuths those from 0
to 180 degrees are kept: the others are mirror images.
"""

import base64
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.splines import MIRROR, mirror_azimuths

if TYPE_CHECKING:
    import xarray

STEP = 2.0**-10  # of elements over f_00, and of the logarithm of f_00: f_00 is off by at most a 2048th of itself
LARGEST = 32_767  # in two bytes
ALONG = 4  # the last so many dimensions are differenced: an axis, incidence, exit and azimuth


@dataclass(frozen=True, eq=False)
class Packed:
    """``text`` base64, ``shape`` (element, axes ..., mu_i, mu_o, phi), f_00 = exp(``middle`` + ``step`` n)."""

    text: str
    shape: tuple[int, ...]
    middle: float
    step: float


def take_half_circle(table: "xarray.Dataset") -> tuple[Array, Array]:
    """Azimuths (n,) [degrees] from 0 to 180, and the Mueller matrices (axes ..., mu_i, mu_o, n, 4, 4) there."""
    given = np.asarray(table.phi_deg.values, np.float64)
    azimuths, places = mirror_azimuths(given)
    here = azimuths <= 180.0
    azimuths, places = azimuths[here], places[here]
    sign = np.where((places >= given.size)[:, None, None], MIRROR, 1.0)
    return azimuths, table.mueller.values[..., places % given.size, :, :] * sign


def pack_matrices(matrices: Array) -> Packed:
    """Mueller matrices (axes ..., mu_i, mu_o, phi, 4, 4) whose f_00 is above 0, packed.

    >>> packed = pack_matrices(np.full((1, 1, 1, 1, 4, 4), 0.25))
    >>> np.round(unpack_matrices(packed)[0, 0, 0, 0, 1], 6).tolist()
    [0.25, 0.25, 0.25, 0.25]
    """
    brightness = matrices[..., 0, 0]
    logarithm = np.log(brightness)
    low, high = float(logarithm.min()), float(logarithm.max())
    middle, step = 0.5 * (low + high), max(STEP, (high - low) / (2.0 * LARGEST))
    numbers = np.moveaxis(
        (matrices / (STEP * brightness[..., None, None])).reshape(*brightness.shape, 16), -1, 0
    ).copy()
    numbers[0] = (logarithm - middle) / step
    steps = np.round(numbers).astype(np.int16)
    for axis in list_packed_axes(steps.ndim):
        steps = np.diff(steps, axis=axis, prepend=np.int16(0))  # what overflows comes back when it is summed up again
    folded = ((steps << 1) ^ (steps >> 15)).astype("<u2")  # small numbers of either sign become small ones
    planes = np.ascontiguousarray(folded).view(np.uint8).reshape(-1, 2).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode()
    return Packed(text, steps.shape, middle, step)


def unpack_matrices(packed: Packed) -> Array:
    """The Mueller matrices (axes ..., mu_i, mu_o, phi, 4, 4) [sr-1] as the page has them."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed.text)), np.uint8)
    folded = np.ascontiguousarray(planes.reshape(2, -1).T).view("<u2").reshape(packed.shape)
    steps = ((folded >> 1) ^ (0 - (folded & 1))).astype(np.int16)
    for axis in reversed(list_packed_axes(steps.ndim)):
        steps = np.cumsum(steps, axis=axis, dtype=np.int16)
    elements = STEP * steps.astype(np.float64)
    elements[0] = 1.0
    elements *= np.exp(packed.middle + packed.step * steps[0])
    found: Array = np.moveaxis(elements, 0, -1).reshape(*packed.shape[1:], 4, 4)
    return found


def list_packed_axes(dimensions: int) -> list[Any]:
    """Which axes are differenced, in this order; the first is the Mueller element."""
    return list(range(dimensions - 1, max(0, dimensions - 1 - ALONG), -1))
