"""Fourier integrals over azimuth of what a surface does, as closely as is allowed and no closer.

Each pair of directions is sampled by itself: by a rule that converges at once on smooth functions, and where that does
not converge, since f jumps or bends at some azimuth, in pieces that are halved where it does.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, BoolArray, make_readonly
from vrte.basics.errors import AccuracyError

FEWEST_AZIMUTHS, ENOUGH, MOST_AZIMUTHS = 32, 1 << 9, 1 << 11  # of the rule for smooth functions, from 0 to 180 degrees
WORTH = 0.1  # part of the error that twice as many azimuths may leave on a smooth function
MOST_SAMPLES = 1 << 14  # samples of f at one pair of directions, in pieces
FEWEST_PIECES = 48  # whose points are nowhere farther apart than the smooth rule's: what that saw is not missed
NARROW = 1.0 / 32.0  # of a half turn: pieces below have a share of the error of their own
SMALLEST = 2.0**-44  # of a half turn: width of the smallest piece, down to which a jump of f is halved
SAMPLES_AT_ONCE = 1 << 16  # of 4 x 4 numbers
SMOOTH = 200.0  # how much closer all points are than half of them where both are close, as QUADPACK has it

INTERVALS = 16  # of a piece, halved for the error: points at its ends, where no jump can hide
CROSSING = np.kron([[0.0, -1.0], [1.0, 0.0]], np.ones((2, 2)))  # sign of sin(m phi) in R^m, 0 where it is cos, (1:6)

Allowed = Callable[[Array], Array]  # how far R^m may be off, (in, out), from the largest element of each, (in, out)
Orders = tuple[Array, int]  # R^m (order, in, out, S, S), and the most azimuths that a pair of directions took
Sample = Callable[[Array, Array, Array], Array]  # f (..., S, S) of mu_i, mu_o, phi_deg that broadcast


class ConvergenceError(AccuracyError):
    """Fourier integrals that do not converge: R^m with the most azimuths, and its error over the allowed one."""

    def __init__(self, message: str, found: Orders, excess: float) -> None:
        super().__init__(message)
        self.found, self.excess = found, excess


def integrate_orders(
    sample: Sample, mu_i: Array, mu_o: Array, pairs: BoolArray, n_order: int, allowed: Allowed
) -> Orders:
    """R^m of (1:35), the integral of f with cos, sin(m phi), (order, in, out, S, S), and the most azimuths of a pair,
    doubled until they converge, or in pieces. Raises ConvergenceError beyond MOST_SAMPLES."""
    here, there = np.nonzero(pairs)
    into, out = mu_i[here], mu_o[there]
    azimuths = FEWEST_AZIMUTHS
    while azimuths < n_order:
        azimuths *= 2
    before = sum_over_azimuths(sample, into, out, n_order, np.arange(1, azimuths), azimuths)
    found = np.zeros((n_order, mu_i.size, mu_o.size, *before.shape[2:]))
    left, torn = np.arange(here.size), np.zeros(0, np.int64)
    last = np.full(here.size, np.inf)
    while left.size:
        azimuths *= 2
        between = sum_over_azimuths(sample, into[left], out[left], n_order, np.arange(1, azimuths, 2), azimuths)
        now = 0.5 * before + between
        found[:, here[left], there[left]] = now
        error = np.abs(now - before).max(axis=(0, 2, 3))
        open_ = error > allowed(np.abs(found).max(axis=(0, 3, 4)))[here, there][left]
        stuck = open_ & (azimuths >= ENOUGH) & ((error > WORTH * last) | (azimuths >= MOST_AZIMUTHS))
        torn, open_ = np.concatenate([torn, left[stuck]]), open_ & ~stuck
        before, left, last = now[:, open_], left[open_], error[open_]
    if not torn.size:
        return found, azimuths
    into, out = into[torn], out[torn]
    most = allowed(np.abs(found).max(axis=(0, 3, 4)))[here, there][torn]
    sums, error, samples = sum_pieces(sample, into, out, n_order, most)
    found[:, here[torn], there[torn]] = sums
    azimuths += samples
    worst = int(np.argmax(error / most))
    if error[worst] > most[worst]:
        raise ConvergenceError(
            f"the base's azimuthal orders do not converge with {azimuths} azimuths: from mu_i {into[worst]:.3g} to "
            f"mu_o {out[worst]:.3g} they may be off by {error[worst]:.2g}, and {most[worst]:.2g} is allowed",
            (found, azimuths),
            error[worst] / most[worst],
        )
    return found, azimuths


def sum_over_azimuths(
    sample: Sample, mu_i: Array, mu_o: Array, n_order: int, steps: NDArray[np.int64], azimuths: int
) -> Array:
    """What ``steps`` of the rule of so many azimuths add to R^m of each pair of directions, (n_order, pair, S, S): cos
    in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V), as in (1:6)."""
    phi, weight = make_azimuth_rule(steps, azimuths)
    angle = np.arange(n_order)[:, None] * phi
    cosine, sine = 2.0 * weight * np.cos(angle), 2.0 * weight * np.sin(angle)
    parts, count = [], max(1, -(-mu_i.size * steps.size // SAMPLES_AT_ONCE))  # bounds memory
    for part in np.array_split(np.arange(mu_i.size), count):
        f = sample(mu_i[part], mu_o[part], np.degrees(phi)[:, None])
        shape, f = f.shape[2:], f.reshape(steps.size, -1)
        even, odd = ((matrix @ f).reshape(n_order, part.size, *shape) for matrix in (cosine, sine))
        even[..., 2:, :2], even[..., :2, 2:] = odd[..., 2:, :2], -odd[..., :2, 2:]
        parts.append(even)
    return np.concatenate(parts, axis=1)


def sum_pieces(sample: Sample, mu_i: Array, mu_o: Array, n_order: int, most: Array) -> tuple[Array, Array, int]:
    """R^m (n_order, pair, S, S) by pieces halved until they converge, errors (pair,), and most samples of a pair."""
    pieces = max(FEWEST_PIECES, n_order // 2)
    pair = np.repeat(np.arange(mu_i.size), pieces)
    first, size = np.tile(np.arange(pieces) / pieces, mu_i.size), np.full(pair.size, 1.0 / pieces)
    sums, errors = np.zeros((0, 0, 0, 0)), np.zeros(mu_i.size)
    taken = np.zeros(mu_i.size, np.int64)
    while pair.size:
        taken += (INTERVALS + 1) * np.bincount(pair, minlength=mu_i.size)
        split = np.zeros(pair.size, bool)
        for part in np.array_split(np.arange(pair.size), -(-pair.size * (INTERVALS + 1) // SAMPLES_AT_ONCE)):
            own = pair[part]
            values, error = sum_piece(sample, mu_i[own], mu_o[own], n_order, first[part], size[part])
            may = (size[part] > SMALLEST) & (taken[own] < MOST_SAMPLES)
            split[part] = (error > 0.5 * most[own] * np.maximum(size[part], NARROW)) & may
            if not sums.size:
                sums = np.zeros((mu_i.size, *values.shape[1:]))
            if (done := ~split[part]).any():
                ended, start = np.unique(own[done], return_index=True)  # pieces of a pair lie side by side
                sums[ended] += np.add.reduceat(values[done], start)
                errors[ended] += np.add.reduceat(error[done], start)
        half = 0.5 * size[split]
        pair = np.repeat(pair[split], 2)
        first, size = np.stack([first[split], first[split] + half], axis=1).ravel(), np.repeat(half, 2)
    return sums.swapaxes(0, 1), errors, int(taken.max())


def sum_piece(sample: Sample, mu_i: Array, mu_o: Array, n_order: int, first: Array, size: Array) -> tuple[Array, Array]:
    """What pieces of azimuth (piece,), half turns of t, add to R^m, (piece, n_order, S, S), and errors (piece,)."""
    points, weights = make_piece_rule(INTERVALS)
    fewer = np.zeros(points.size)
    fewer[::2] = make_piece_rule(INTERVALS // 2)[1]
    t = np.pi * (first + size * points[:, None])
    phi, rate = t - 0.5 * np.sin(2.0 * t), np.pi * size * 4.0 * np.sin(t) ** 2  # both halves of the turn
    f = sample(mu_i, mu_o, np.degrees(phi)) * rate[..., None, None]  # (point, piece, S, S)
    shape = f.shape[2:]
    crossing = CROSSING[: shape[0], : shape[1]].ravel()
    by_rule = np.einsum("kpe,kr->pkre", f.reshape(*phi.shape, -1), np.stack([weights, weights - fewer], axis=1))
    waves = multiply_angles(phi.T, n_order, (crossing != 0.0).any())
    summed = np.empty((mu_i.size, n_order, 2, crossing.size))
    for wave, indices in zip(waves, (crossing == 0.0, crossing != 0.0), strict=False):
        part = wave @ by_rule[..., indices].reshape(mu_i.size, points.size, -1)
        summed[..., indices] = part.reshape(*summed.shape[:3], -1)
    values, difference = (
        summed[:, :, 0] * np.where(crossing == 0.0, 1.0, crossing),
        np.abs(summed[:, :, 1]).max(axis=(1, 2)),
    )
    whole = np.maximum(np.einsum("kpab,k->pab", np.abs(f), weights).max(axis=(1, 2)), 1e-300)
    return values.reshape(*values.shape[:2], *shape), np.minimum(
        difference, whole * (SMOOTH * difference / whole) ** 1.5
    )


def multiply_angles(phi: Array, n_order: int, with_sine: bool) -> tuple[Array, ...]:
    """cos(m phi), and sin(m phi) where asked for, (piece, n_order, point), of phi (piece, point) [rad]."""
    turn = np.exp(1j * phi)
    waves = [np.empty((phi.shape[0], n_order, phi.shape[1])) for _ in range(1 + with_sine)]
    now = np.ones_like(turn)
    for order in range(n_order):
        for wave, part in zip(waves, (now.real, now.imag), strict=False):
            wave[:, order] = part
        now = now * turn
    return tuple(waves)


@cache
def make_piece_rule(intervals: int) -> tuple[Array, Array]:
    """Clenshaw and Curtis's points from 0 to 1, both among them, and weights; ``intervals`` even."""
    k = np.arange(intervals + 1)
    j = np.arange(1, intervals // 2 + 1)
    share = np.where(j == intervals // 2, 1.0, 2.0) / (4.0 * j**2 - 1.0)
    inner = np.where(k % intervals == 0, 0.5, 1.0) / intervals
    weights = inner * (1.0 - np.cos(2.0 * np.pi * np.outer(k, j) / intervals) @ share)
    return make_readonly(np.sin(0.5 * np.pi * k / intervals) ** 2), make_readonly(weights)


def make_azimuth_rule(steps: NDArray[np.int64], count: int) -> tuple[Array, Array]:
    """Azimuths [rad] and weights of the trapezoidal rule in t, phi = t - sin(2 t)/2, t = pi steps/count."""
    t = np.pi * steps / count
    return t - 0.5 * np.sin(2.0 * t), 2.0 * np.pi / count * np.sin(t) ** 2
