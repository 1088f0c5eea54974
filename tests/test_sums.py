"""The sums at the end of a solve against their formulas, written out in NumPy."""

from collections.abc import Sequence

import numpy as np
import pytest

from vrte import _core
from vrte.discrete_ordinates.azimuths import cos_sin_deg, fold

FULL_TURN = np.array([0.0, 10.0, 75.0, 180.0, 285.0, 350.0, 360.0, -10.0, 90.0, 33.3])


def fourier_sum(kernels: np.ndarray, orders: np.ndarray, kind: Sequence[int], phi: np.ndarray) -> np.ndarray:
    """(1:6)-(1:8), (1:12) without its 1/2, for kernels (order, tau, in, col, out, 4): (tau, in, out, phi, 4, col)."""
    cosine, sine = cos_sin_deg(orders[:, None] * phi)
    twice = np.where(orders == 0, 1.0, 2.0)[:, None]
    cosine, sine = twice * cosine, twice * sine
    parts = []
    for col, second in enumerate(kind):
        upper, lower = (-sine, cosine) if second else (cosine, sine)
        values = [np.einsum("mtio,mf->tiof", kernels[:, :, :, col, :, s], (upper, lower)[s // 2]) for s in range(4)]
        parts.append(np.stack(values, axis=-1))
    return np.stack(parts, axis=-1)


def summed(
    kernels: np.ndarray,
    orders: np.ndarray,
    stokes: Sequence[int],
    kind: Sequence[int],
    place: Sequence[int],
    phi: np.ndarray,
    out: np.ndarray,
    levels: Sequence[int],
    rows: Sequence[int],
    scale: np.ndarray,
    threads: int = 2,
) -> None:
    """The kernel under test, in two pieces of the incident directions."""
    azimuths = fold(phi)
    cosine, sine = azimuths.cos_sin(orders)
    work = np.empty((threads, _core.azimuthal_work(orders.size, len(kind), len(stokes), azimuths.distinct.size)))
    integers = [np.array(values, np.int32) for values in (stokes, kind, place)]
    where = [np.array(values, np.int32) for values in (levels, rows)]
    middle = out.shape[1] // 2
    for first, last in ((0, middle), (middle, out.shape[1])):
        _core.azimuthal_sum(
            np.ascontiguousarray(kernels),
            *integers,
            cosine,
            sine,
            azimuths.angle,
            azimuths.sign,
            *where,
            scale,
            first,
            last,
            out,
            threads,
            work,
            np.zeros(threads),
            np.zeros(1, np.int32),
        )


def some_kernels(n_order: int, n_col: int, n_out: int = 21) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((n_order, 3, 4, n_col, n_out, 4))


@pytest.mark.parametrize("stokes", [(0,), (0, 1), (2, 3), (0, 1, 2), (3,), (0, 1, 2, 3)])
@pytest.mark.parametrize("kind", [(0, 0, 1, 1), (0,), (1,), (0, 1)])
def test_azimuthal_sum_adds_orders_of_some_stokes_components_and_columns(
    stokes: tuple[int, ...], kind: tuple[int, ...]
) -> None:
    kernels, orders = some_kernels(7, len(kind)), np.array([0, 1, 2, 5, 6, 9, 30], np.int32)
    place, levels, rows = [3, 0, 2, 1][: len(kind)], [2, 0], [20, 3, 3, 0, 7, 8, 9, 10, 11, 12, 13]
    scale = np.array([1.0, 0.5, 2.0, -3.0])
    out = np.ones((2, 4, len(rows), FULL_TURN.size, 4, 4))
    expected = np.ones_like(out)
    missing = np.setdiff1d(range(4), stokes)
    masked = kernels.copy()
    masked[..., missing] = 0.0
    whole = fourier_sum(masked, orders, kind, FULL_TURN)[np.ix_(levels, range(4), rows)]
    expected[..., place] += scale[:, None, None, None, None] * whole
    summed(kernels[..., list(stokes)], orders, stokes, kind, place, FULL_TURN, out, levels, rows, scale)
    np.testing.assert_allclose(out, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


def test_azimuthal_sum_puts_columns_at_one_place_and_does_not_depend_on_threads() -> None:
    kernels, orders, phi = some_kernels(5, 2), np.arange(5, dtype=np.int32), np.arange(0.0, 361.0, 1.5)
    results = []
    for threads in (1, 3):
        out = np.zeros((3, 4, 21, phi.size, 4, 1))
        summed(kernels, orders, range(4), (0, 1), (0, 0), phi, out, range(3), range(21), np.ones(4), threads)
        results.append(out)
    expected = fourier_sum(kernels, orders, (0, 1), phi).sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(results[0], expected, rtol=0, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_array_equal(results[0], results[1])


def test_azimuths_beyond_half_a_turn_are_mirror_images() -> None:
    phi = np.arange(0.0, 361.0, 2.0)
    azimuths = fold(phi)
    assert azimuths.distinct.size == 91
    np.testing.assert_array_equal(np.cos(np.radians(azimuths.distinct)), np.cos(np.radians(np.arange(0, 181, 2))))
    folded = azimuths.sign * azimuths.distinct[azimuths.angle]
    np.testing.assert_allclose(np.sin(np.radians(folded)), np.sin(np.radians(phi)), atol=1e-15)
