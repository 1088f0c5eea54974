"""The diffusion method against its closed-form laws, written down anew."""

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.methods.diffusion import BOUNDARIES

from .helpers import assert_close

G, MU0 = 0.3, 0.6
PHASE = vrte.PhaseMatrix([1.0, 3.0 * G])


def fluxes(scene, tau, **settings):
    return vrte.radiance(scene, MU0, mu=[], tau=tau, method="diffusion", settings=settings)


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("albedo", [0.0, 0.1])
def test_conservative_law(boundary, albedo):
    """(2:19) at albedo 1: the net flux of all light is constant, and E_0 is linear but for the beam's exponential."""
    h, c = 7.0, BOUNDARIES[boundary]
    tau = np.linspace(0.0, h, 6)
    field = fluxes(vrte.Scene([vrte.Layer(PHASE, 1.0, h)], vrte.Lambertian(albedo)), tau, boundary=boundary)
    # E_z = J - mu0 e^(-t/mu0); E_0' = -3 (1 - g) E_z + 3 g mu0 e^(-t/mu0)
    beam = MU0 * np.exp(-tau / MU0)
    bent = 3.0 * MU0 * (MU0 - beam)  # integral of 3 (1 - g + g) mu0 e^(-t/mu0)
    # E_0(0) = -c (J - mu0); at the base (1 + albedo)/(1 - albedo) c E_z = E_0 - albedo 2 c beam/(1 - albedo)
    k = (1.0 + albedo) / (1.0 - albedo)
    side = 2.0 * albedo * c * beam[-1] / (1.0 - albedo)
    J = (c * MU0 + bent[-1] + k * c * beam[-1] - side) / (c + 3.0 * (1.0 - G) * h + k * c)
    E_0 = c * (MU0 - J) - 3.0 * (1.0 - G) * J * tau + bent
    assert_close(field.flux_down + field.direct - field.flux_up, J, rtol=1e-13, atol=0.0)
    assert_close(c * (field.flux_down + field.flux_up), E_0, rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("albedo", [0.3, 0.9, 1.0 - 1e-9])
def test_absorbing_law(albedo):
    """The two exponentials e^(-+k t) and the beam's of (2:20), k^2 = 3 (1 - omega)(1 - omega g), by a 2 x 2 system."""
    h, c = 3.0, 2.0
    tau = np.linspace(0.0, h, 5)
    field = fluxes(vrte.Scene([vrte.Layer(PHASE, albedo, h)]), tau)
    away = 3.0 * (1.0 - albedo * G)
    k = np.sqrt((1.0 - albedo) * away)
    # E_0 = p e^(-t/mu0): p/mu0^2 = k^2 p - 3 (1 - w g) w - 3 w g
    p = -(away * albedo + 3.0 * albedo * G) / (1.0 / MU0**2 - k**2)

    def of(t, rate):
        return np.exp(-rate * t), rate / away * np.exp(-rate * t)

    def beam(t):  # E_z = (3 w g mu0 e - E_0')/(3 (1 - w g))
        e = np.exp(-t / MU0)
        return p * e, (3.0 * albedo * G * MU0 + p / MU0) / away * e

    rows = [[E_0 + sign * c * E_z for E_0, E_z in (of(t, k), of(t, -k))] for t, sign in ((0.0, 1.0), (h, -1.0))]
    known = [-(beam(0.0)[0] + c * beam(0.0)[1]), -(beam(h)[0] - c * beam(h)[1])]
    one, other = np.linalg.solve(rows, known)
    E_0, E_z = (one * of(tau, k)[i] + other * of(tau, -k)[i] + beam(tau)[i] for i in (0, 1))
    rtol = 1e-12 if albedo < 0.99 else 1e-10  # what the exponentials cost near 1
    assert_close(2.0 * (field.flux_down + field.flux_up), E_0, rtol=rtol, atol=0.0)
    assert_close(field.flux_down - field.flux_up, E_z, rtol=rtol, atol=rtol)


def test_radiance_is_its_source_integrated():
    """At the top and inside, against quadrature over E_0 and E_z, found from fluxes at many depths."""
    albedo, h, mu = 0.8, 1.5, np.array([0.3, 1.0])
    scene = vrte.Scene([vrte.Layer(PHASE, albedo, h)])
    x, w = np.polynomial.legendre.leggauss(24)
    t, w = 0.5 * h * (x + 1.0), 0.5 * h * w
    inside = fluxes(scene, t)
    E_0, E_z = 2.0 * (inside.flux_down + inside.flux_up), inside.flux_down - inside.flux_up
    E_x = albedo * G * np.sqrt(1.0 - MU0**2) / (1.0 - albedo * G) * np.exp(-t / MU0)
    phi = np.array([0.0, 60.0])
    across = np.sqrt(1.0 - mu**2)[:, None, None] * np.cos(np.radians(phi))[:, None] * E_x
    source = albedo / (4.0 * np.pi) * (E_0 + 3.0 * G * (-mu[:, None, None] * E_z + across))
    expected = np.einsum("upt,t,ut->up", source, w, np.exp(-t / mu[:, None]) / mu[:, None])
    once = vrte.radiance(scene, MU0, mu=mu, phi=phi, method="single-scattering")
    found = vrte.radiance(scene, MU0, mu=mu, phi=phi, method="diffusion")
    assert_close((found.stokes - once.stokes)[0, ..., 0], expected, rtol=1e-10, atol=0.0)


def test_thick_layers_reflect_as_the_exact_method_says():
    """Scattering evenly and conservatively: the albedo within 2 %, whatever the boundary."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 20.0)])
    exact = vrte.radiance(scene, MU0, mu=[], nodes=16).flux_up
    for boundary in BOUNDARIES:
        assert_close(fluxes(scene, 0.0, boundary=boundary).flux_up, exact, rtol=0.02, atol=0.0)


def test_boundary_has_a_name():
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 20.0)])
    with pytest.raises(
        SceneError, match=r"setting 'boundary' of method 'diffusion' must be 'marshak', .*not 'dirichlet'"
    ):
        fluxes(scene, 0.0, boundary="dirichlet")
