"""The azimuths of a result, folded by mirror symmetry: Z(-phi) = D Z(phi) D, D = diag(1, 1, -1, -1)."""

from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, IntArray, record

MOST_NUMBERS = 20_000  # in a table of cosines that is kept
MOST_AZIMUTHS = 4000  # that are kept with what was made of them


@record
class Azimuths:
    """Distinct azimuths from 0 to 180 degrees, and which of them each azimuth asked for is.

    phi (n_phi,), degrees: what was asked for; distinct (n_angle,), degrees; angle (n_phi,): index into it; sign
    (n_phi,): -1 for a mirror image, otherwise 1.
    """

    phi: Array
    distinct: Array
    angle: IntArray
    sign: Array

    def cos_sin(self, orders: IntArray) -> tuple[Array, Array]:
        """cos and sin of m phi, (order, n_angle) each, twice for m > 0."""
        small = orders.size * self.distinct.size <= MOST_NUMBERS
        tabulate = tabulate_again if small else tabulate_again.__wrapped__
        return tabulate(self.distinct.tobytes(), orders.tobytes())

    @cached_property
    def arguments(self) -> dict[str, Any]:
        """Those of single scattering, as the core takes them."""
        cosine, sine = compute_cos_sin(self.distinct)
        return {"cos_phi": cosine, "sin_phi": sine, "angle": self.angle, "sign": self.sign}


def fold_azimuths(phi: Array, mirror: bool = True) -> Azimuths:
    """The azimuths phi (n_phi,), degrees of any size, folded; without ``mirror`` all that differ are distinct.
    Those asked for again come with what was made of them.

    >>> fold_azimuths(np.array([10.0, 350.0, -10.0, 370.0])).sign.tolist()
    [1.0, -1.0, -1.0, 1.0]
    """
    fold = fold_again if phi.size <= MOST_AZIMUTHS else fold_again.__wrapped__
    return fold(np.asarray(phi, float).tobytes(), mirror)


@lru_cache(maxsize=16)
def fold_again(numbers: bytes, mirror: bool) -> Azimuths:
    """The same of numbers as they lie in memory."""
    phi = np.frombuffer(numbers)
    turn = np.remainder(phi, 360.0)
    mirrored = (turn > 180.0) & mirror
    turned = np.where(mirrored, 360.0 - turn, turn)
    distinct, angle = np.unique(turned, return_inverse=True) if phi.size > 1 else (turned, np.zeros(1, np.int32))
    return Azimuths(phi, distinct, angle.astype(np.int32), np.where(mirrored, -1.0, 1.0))


@lru_cache(maxsize=64)
def tabulate_again(distinct: bytes, orders: bytes) -> tuple[Array, Array]:
    """Cosines and sines by azimuths and orders as they lie in memory."""
    m = np.frombuffer(orders, np.int32)[:, None]
    cosine, sine = compute_cos_sin(m * np.frombuffer(distinct))
    twice = np.where(m == 0, 1.0, 2.0)
    return twice * cosine, twice * sine


def compute_cos_sin(angle_deg: Array) -> tuple[Array, Array]:
    """cos and sin, exact at multiples of 90 degrees."""
    turn = np.remainder(angle_deg, 360.0)
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    cosine = np.where((turn == 90.0) | (turn == 270.0), 0.0, cosine)
    sine = np.where((turn == 0.0) | (turn == 180.0), 0.0, sine)
    return cosine, sine
