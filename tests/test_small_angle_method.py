"""The small-angle method against (2:29) written out, and its moments against their exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

import vrte
from vrte.basics.spherical_functions import find_gauss_legendre
from vrte.methods.parts.task import discretise_request
from vrte.methods.small_angle import expand_diffuse_part
from vrte.request.request import make_radiance_request

from .helpers import assert_close
from .oracle import a_matrix, azimuthal_sum

MU0, PHI = 0.7, np.array([0.0, 50.0, 180.0])
HG = vrte.henyey_greenstein(0.5, 16)
MATRIX = vrte.PhaseMatrix(  # all six differ from zero
    [1.0, 1.2, 0.9, 0.2], [0.0, 0.0, 2.4, 0.5], [0.0, 0.0, 1.9, 0.4], [0.6, 1.3, 0.7, 0.2], [0.0, 0.0, 0.3, 0.05],
    [0.0, 0.0, 0.2, 0.1],
)  # fmt: skip


def tables_of(layers, tau):
    """The expansion about the beam, (n_tau, terms, 6)."""
    request = make_radiance_request(vrte.Scene(layers), MU0, mu=-0.5, tau=tau, nodes=8, method="small-angle")
    return expand_diffuse_part(request.scene, discretise_request(request))[:, 0]


@pytest.mark.parametrize("albedo", [1.0, 0.7])
def test_moments(albedo):
    """exp(-(1 - omega x_k) tau/mu0) less exp(-tau/mu0); of a sum over the sphere as well."""
    tau = np.array([0.0, 1e-8, 0.3, 2.0, 400.0])
    layers = [vrte.Layer(HG, albedo, 1.0), vrte.Layer(HG, albedo, 399.0)]
    tables, k = tables_of(layers, tau), np.arange(16)
    x_k = HG.a1 / (2.0 * k + 1.0)
    expected = np.exp(-tau[:, None] / MU0) * np.expm1(albedo * x_k * tau[:, None] / MU0)
    assert_close(tables[..., 0] / (2.0 * k + 1.0), expected, rtol=1e-12, atol=0.0)
    cosine, weights = find_gauss_legendre(20)
    field = np.polynomial.legendre.legval(cosine, tables[3, :, 0]) / (4.0 * np.pi)
    moments = [2.0 * np.pi * weights @ (field * np.polynomial.legendre.legval(cosine, np.eye(16)[n])) for n in k]
    assert_close(moments, expected[3], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("layers", [[(HG, 0.9, 2.0)], [(MATRIX, 0.95, 2.0)], [(MATRIX, 0.9, 0.5), (MATRIX, 0.8, 1.0)]])
def test_is_the_sum_over_orders(layers):
    """(2:29) literally: Fourier orders of generalized spherical functions, S_l through the matrix exponential."""
    scene, mu = vrte.Scene([vrte.Layer(*layer) for layer in layers]), np.array([0.2, 0.7, 0.95])
    a = layers[0][0].coefficients
    path = sum(layer[2] for layer in layers) / MU0
    albedo = sum(layer[1] * layer[2] for layer in layers) / MU0  # times the path
    degrees = np.zeros_like(a)
    for l, (a1, a2, a3, a4, b1, b2) in enumerate(a):
        S = albedo / (2.0 * l + 1.0) * np.array([[a1, b1, 0, 0], [b1, a2, 0, 0], [0, 0, a3, b2], [0, 0, -b2, a4]])
        E = (2.0 * l + 1.0) * np.exp(-path) * (expm(S) - np.eye(4))
        degrees[l] = E[0, 0], E[1, 1], E[2, 2], E[3, 3], E[0, 1], E[2, 3]
    orders = [a_matrix(m, degrees, mu, np.array([MU0])).reshape(mu.size, 4, 1, 4)[:, :, 0] for m in range(len(a))]
    expected = azimuthal_sum([each[None] for each in orders], PHI)[0] / (4.0 * np.pi)  # (mu, phi, 4, 4)
    found = vrte.brdf(scene, MU0, mu, PHI, transmission=True, method="small-angle", nodes=8)
    assert_close(MU0 * found.transmission[0], expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
    assert not found.mueller.any()


def test_flux_and_note():
    """The flux down is that of the radiance; up there is nothing, and it says so."""
    scene = vrte.Scene([vrte.Layer(HG, 0.9, 2.0)])
    x, w = find_gauss_legendre(40)
    mu, w = 0.5 * (x + 1.0), 0.5 * w
    phi = np.arange(0.0, 360.0, 10.0)
    field = vrte.radiance(scene, MU0, mu=-mu, phi=phi, tau=[0.5, 2.0], method="small-angle")
    flux = 2.0 * np.pi * np.einsum("tup,u->t", field.stokes[..., 0], w * mu) / phi.size
    assert_close(field.flux_down, flux, rtol=1e-12, atol=0.0)
    assert not field.flux_up.any()
    up = vrte.radiance(scene, MU0, mu=0.5, method="small-angle")
    assert not up.stokes.any()
    assert up.diagnostics["notes"] == ["small-angle: nothing goes up; radiance there is zero by definition"]


def test_near_the_beam_it_is_close():
    """Figure 2 of the paper: Henyey-Greenstein 0.9, at the beam's own direction, within 2 % where tau is 0.3."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.9, 120), 0.99, 0.3)])
    asked = {"mu0": 0.5, "mu": -0.5, "tau": 0.3}
    exact = vrte.radiance(scene, nodes=24, **asked).stokes[0, 0, 0, 0]
    assert_close(vrte.radiance(scene, method="small-angle", **asked).stokes[0, 0, 0, 0], exact, rtol=0.02, atol=0.0)
