"""The end of a solve: light scattered once against its formulas, and results that are made in pieces.

Whether orders are added up rightly is tested in tests/test_every_way.py.
"""

import numpy as np
import pytest

import vrte
from vrte.discrete_ordinates.execution.engines.cpu import Processor

from .helpers import assert_close
from .literal import a_matrix, azimuthal_sum
from .samples import scattered

FULL_TURN = np.array([0.0, 10.0, 75.0, 180.0, 285.0, 350.0, 360.0, -10.0, 90.0, 33.3])


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
