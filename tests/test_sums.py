"""The sums at the end of a solve against their formulas, written out in NumPy."""

from collections.abc import Sequence

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.discrete_ordinates.execution.engines.cpu import Processor
from vrte.discrete_ordinates.planning.azimuths import compute_cos_sin, fold_azimuths

from .helpers import assert_close
from .literal import a_matrix, azimuthal_sum
from .samples import scattered

FULL_TURN = np.array([0.0, 10.0, 75.0, 180.0, 285.0, 350.0, 360.0, -10.0, 90.0, 33.3])


def fourier_sum(kernels: np.ndarray, orders: np.ndarray, kind: Sequence[int], phi: np.ndarray) -> np.ndarray:
    """(1:6)-(1:8), (1:12) without its 1/2, for kernels (order, tau, in, col, out, 4): (tau, in, out, phi, 4, col)."""
    cosine, sine = compute_cos_sin(orders[:, None] * phi)
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
    index: Sequence[int],
    phi: np.ndarray,
    out: np.ndarray,
    levels: Sequence[int],
    rows: Sequence[int],
    scale: np.ndarray,
    threads: int = 2,
) -> None:
    """The kernel under test, in two pieces of the incident directions."""
    azimuths = fold_azimuths(phi)
    cosine, sine = azimuths.cos_sin(orders)
    listed = {"stokes": stokes, "kind": kind, "place": index, "levels": levels, "rows": rows}
    integers = {name: np.array(values, np.int32) for name, values in listed.items()}
    middle = out.shape[1] // 2
    for first, last in ((0, middle), (middle, out.shape[1])):
        _core.azimuthal_sum(
            ThreadTeam(threads, np.zeros(threads), np.zeros(1, np.int32)),
            kernels=np.ascontiguousarray(kernels),
            **integers,
            cosine=cosine,
            sine=sine,
            angle=azimuths.angle,
            sign=azimuths.sign,
            scale=scale,
            first=first,
            last=last,
            out=out,
        )


def some_kernels(n_order: int, n_col: int, n_out: int = 21) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((n_order, 3, 4, n_col, n_out, 4))


@pytest.mark.parametrize("stokes", [(0,), (0, 1), (2, 3), (0, 1, 2), (3,), (0, 1, 2, 3)])
@pytest.mark.parametrize("kind", [(0, 0, 1, 1), (0,), (1,), (0, 1)])
def test_azimuthal_sum_adds_orders_of_some_stokes_components_and_columns(
    stokes: tuple[int, ...], kind: tuple[int, ...]
) -> None:
    kernels, orders = some_kernels(7, len(kind)), np.array([0, 1, 2, 5, 6, 9, 30], np.int32)
    index, levels, rows = [3, 0, 2, 1][: len(kind)], [2, 0], [20, 3, 3, 0, 7, 8, 9, 10, 11, 12, 13]
    scale = np.array([1.0, 0.5, 2.0, -3.0])
    out = np.ones((2, 4, len(rows), FULL_TURN.size, 4, 4))
    expected = np.ones_like(out)
    missing = np.setdiff1d(range(4), stokes)
    masked = kernels.copy()
    masked[..., missing] = 0.0
    whole = fourier_sum(masked, orders, kind, FULL_TURN)[np.ix_(levels, range(4), rows)]
    expected[..., index] += scale[:, None, None, None, None] * whole
    summed(kernels[..., list(stokes)], orders, stokes, kind, index, FULL_TURN, out, levels, rows, scale)
    assert_close(out, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


def test_sums_of_columns_that_share_a_place_on_any_number_of_threads() -> None:
    """Over orders, and of single scattering."""
    kernels, orders, phi = some_kernels(5, 2), np.arange(5, dtype=np.int32), np.arange(0.0, 361.0, 15.0)
    results = [np.zeros((3, 4, 21, phi.size, 4, 1)) for _ in range(2)]
    for threads, out in zip((1, 3), results, strict=True):
        summed(kernels, orders, range(4), (0, 1), (0, 0), phi, out, range(3), range(21), np.ones(4), threads)
    expected = fourier_sum(kernels, orders, (0, 1), phi).sum(axis=-1, keepdims=True)
    assert_close(results[0], expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    np.testing.assert_array_equal(*results)
    mu0, mu = np.array([0.3, 0.8]), np.array([0.4, -0.7])
    columns, path = np.array([[1.0, -0.3, 0.0, 0.0], [0.0, 0.0, 0.2, 0.4]]), np.ones((1, 2, 2))
    whole, *results = (np.zeros((1, 2, 2, phi.size, 4, count)) for count in (4, 1, 1))
    scattered(SPHERE, path, mu0, mu, phi, np.eye(4), range(4), whole)
    for threads, out in zip((1, 3), results, strict=True):
        scattered(SPHERE, path, mu0, mu, phi, columns, (0, 0), out, threads)
    assert_close(results[0], whole @ columns.sum(axis=0)[:, None], rtol=0.0, atol=1e-13 * np.abs(whole).max())
    np.testing.assert_array_equal(*results)


def test_azimuths_beyond_half_a_turn_are_mirror_images() -> None:
    phi = np.arange(0.0, 361.0, 2.0)
    azimuths = fold_azimuths(phi)
    assert azimuths.distinct.size == 91
    np.testing.assert_array_equal(np.cos(np.radians(azimuths.distinct)), np.cos(np.radians(np.arange(0, 181, 2))))
    folded = azimuths.sign * azimuths.distinct[azimuths.angle]
    assert_close(np.sin(np.radians(folded)), np.sin(np.radians(phi)), rtol=0.0, atol=1e-15)


SPHERE = vrte.spheres(1.5, radius_um=0.6, wavelength_um=0.5).phase_matrix.coefficients


@pytest.mark.parametrize("terms", [1, 2, 3, 4, 16])
def test_single_scattering_is_the_phase_matrix_between_meridian_planes(terms: int) -> None:
    """The sum over all orders, straight on and straight back included, where a plane has to be chosen; with AVX2
    and without."""
    coefficients = SPHERE[:terms]
    mu0, mu = np.array([0.25, 0.6, 1.0]), np.array([0.25, -0.6, -1.0, 0.6, 1.0, -0.3])
    path = np.random.default_rng(2).uniform(0.5, 2.0, (2, 3, 6))
    path[1, 2, 4] = path[:, 0, 1] = 0.0
    phi = np.append(FULL_TURN, np.linspace(1.0, 170.0, 7))  # more than one vector's
    orders = [a_matrix(m, coefficients, -mu, mu0).reshape(6, 4, 3, 4).transpose(2, 0, 1, 3) for m in range(terms)]
    expected = 1.0 + path[..., None, None, None] * azimuthal_sum(np.array(orders), phi)
    for wide in (True, False):
        out = np.ones((2, 3, 6, phi.size, 4, 4))
        scattered(coefficients, path, mu0, mu, phi, np.eye(4), range(4), out, wide=wide)
        assert_close(out, expected, rtol=0.0, atol=1e-13 * np.abs(coefficients).sum())
        np.testing.assert_array_equal(out[1, 2, 4], 1.0)


def test_single_scattering_of_very_many_terms() -> None:
    """More than the root of the largest 32-bit integer: a Henyey-Greenstein function, which is known in closed form."""
    g, terms = 0.9995, 60_000
    coefficients = np.zeros((terms, 6))
    coefficients[:, 0] = (2.0 * np.arange(terms) + 1.0) * g ** np.arange(terms)
    mu0, mu = np.array([0.6, 1.0]), np.array([-0.6, -0.61, -0.5, 0.7])
    out = np.zeros((1, 2, 4, 1, 4, 1))
    unpolarized = np.array([[1.0, 0.0, 0.0, 0.0]])
    scattered(coefficients, np.ones((1, 2, 4)), mu0, mu, np.zeros(1), unpolarized, [0], out)
    cosine = np.sqrt((1.0 - mu0[:, None] ** 2) * (1.0 - mu**2)) - mu0[:, None] * mu
    expected = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine) ** 1.5
    assert_close(out[0, :, :, 0, 0, 0], expected, rtol=1e-9, atol=1e-12 * expected.max())


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("n_phi", [1, 8, 37])
def test_scalar_series_apiece(n_phi: int, wide: bool) -> None:
    """F11 alone, of another phase function for each direction, against Legendre series; U and V scatter nothing."""
    random = np.random.default_rng(3)
    mu, mu0, phi = np.array([0.9, -0.3, 1.0]), 0.6, np.linspace(0.0, 180.0, n_phi)
    coefficients = np.zeros((mu.size, 31, 6))
    coefficients[..., 0] = random.uniform(-1.0, 1.0, (mu.size, 31))
    out, path = np.zeros((1, 1, mu.size, n_phi, 4, 2)), random.uniform(0.5, 1.0, (1, 1, mu.size))
    columns = np.array([[2.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    scattered(coefficients, path, np.array([mu0]), mu, phi, columns, (0, 1), out, wide=wide)
    cosine = np.sqrt((1.0 - mu**2) * (1.0 - mu0**2))[:, None] * np.cos(np.radians(phi)) - mu0 * mu[:, None]
    for o, series in enumerate(coefficients[..., 0]):
        expected = 2.0 * path[0, 0, o] * np.polynomial.legendre.legval(cosine[o], series)
        assert_close(out[0, 0, o, :, 0, 0], expected, rtol=1e-12, atol=1e-12)
    assert not out[..., 1:, :].any()
    assert not out[..., 1].any()


def speckled(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
    """A base whose every element depends on everything."""
    angle = np.radians(phi_deg)
    f = np.full((*np.broadcast_shapes(mu_i.shape, mu_o.shape, phi_deg.shape), 4, 4), 0.005) + np.diag(
        [0.1, 0.02, 0.02, 0.01]
    )
    f = f * (1.0 + 0.5 * mu_i * mu_o * np.cos(angle))[..., None, None]
    f[..., :2, 2:] *= np.sin(angle)[..., None, None]
    f[..., 2:, :2] *= np.sin(angle)[..., None, None]
    return f


@pytest.mark.parametrize("base", [None, vrte.Lambertian(0.3), vrte.MuellerBase(speckled)])
def test_a_result_does_not_depend_on_its_pieces(base: vrte.Lambertian | vrte.MuellerBase | None) -> None:
    """Reflection and transmission at once, one incident direction a piece; directions one by one by `radiance`."""
    particles = vrte.spheres(1.5, radius_um=0.2, wavelength_um=0.5).phase_matrix
    layers = [vrte.Layer(particles, 0.9, 0.3), vrte.Layer(vrte.rayleigh(), 0.5, 0.1), vrte.Layer(particles, 1.0, 0.2)]
    scene, mu_i, mu_o = vrte.Scene(layers, base), [0.2, 0.5, 0.9], [0.3, 1.0]
    calls: list[tuple[int, int]] = []

    def tables(**how: object) -> vrte.Brdf:
        return vrte.brdf(scene, mu_i, mu_o, FULL_TURN, nodes=8, transmission=True, accuracy=1e-15, **how)

    whole = tables()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vrte.discrete_ordinates.execution.engines.cpu.PROCESSOR", Processor(piece_bytes=1.0))
        split = tables(progress=lambda done, total: calls.append((done, total)))
    steps = calls[-1][1]
    assert steps >= whole.diagnostics["orders"] + 3
    assert calls[-3:] == [(steps - 2, steps), (steps - 1, steps), (steps, steps)]
    np.testing.assert_array_equal(whole.mueller, split.mueller)
    np.testing.assert_array_equal(whole.transmission, split.transmission)
    for k, mu0 in enumerate(mu_i):
        stokes = np.array([1.0, 0.2, -0.3, 0.1])
        field = vrte.radiance(
            scene, mu0, stokes, [0.3, 1.0, -0.3, -1.0], FULL_TURN, [0.0, 0.6], nodes=8, accuracy=1e-15
        )
        up, down = whole.mueller[k] @ (mu0 * stokes), whole.transmission[k] @ (mu0 * stokes)
        assert_close(field.stokes[0, :2], up, rtol=0.0, atol=1e-14)
        assert_close(field.stokes[1, 2:], down, rtol=0.0, atol=1e-14)


def test_a_large_result_is_not_copied_and_a_writable_one_is() -> None:
    b = vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), 0.5, [0.3, 1.0], FULL_TURN, nodes=4)
    arrays = {name: getattr(b, name) for name in ("reflectance", "mu_i", "mu_o", "phi", "diagnostics")}
    assert vrte.Brdf(mueller=b.mueller, **arrays).mueller is b.mueller
    mine = b.mueller.copy()
    seen = mine.view()
    seen.setflags(write=False)
    for given in (mine, seen):  # what can still be written into
        assert not np.shares_memory(vrte.Brdf(mueller=given, **arrays).mueller, mine)
