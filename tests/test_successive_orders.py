"""Successive orders of scattering: their sum, how it converges, and what it says of that."""

import numpy as np
import pytest

import vrte
from vrte.methods.parts.in_depth import find_gauss_depths, weigh_downward, weigh_upward

from .helpers import assert_close

MU, PHI = np.array([0.2, 0.6, 1.0]), np.array([0.0, 40.0, 180.0])
PAIR = vrte.Scene(
    [vrte.Layer(vrte.rayleigh(), 0.9, 0.5), vrte.Layer(vrte.henyey_greenstein(0.4, 6), 0.95, 0.7)],
    vrte.Lambertian(0.3),
)


def brdf(scene: vrte.Scene, **settings: float) -> vrte.Brdf:
    """By successive orders."""
    return vrte.brdf(scene, MU, MU, PHI, nodes=4, method="successive-orders", settings=settings)


@pytest.mark.parametrize("z", [0.0, 1e-9, 0.3, 7.9, 8.1, 50.0, 1e9])
def test_integrals_in_depth(z: float) -> None:
    """Against the closed form for S = s."""
    weights = weigh_downward(np.array(z), 4)
    x = np.append(find_gauss_depths(4), 1.0)
    exact = (
        x**2 / 2.0
        - z * x**3 / 6.0
        + z**2 * x**4 / 24.0
        - z**3 * x**5 / 120.0
        + z**4 * x**6 / 720.0
        - z**5 * x**7 / 5040.0
        if z < 1.0
        else (x + np.expm1(-z * x) / z) / z
    )
    assert_close(weights @ find_gauss_depths(4), exact, rtol=1e-6 if z == 0.3 else 1e-12, atol=0.0)
    assert_close(weigh_upward(np.array(z), 4)[-1] @ (1.0 - find_gauss_depths(4)), exact[-1], rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9, 1e-12])
def test_tolerance(tolerance: float) -> None:
    exact = vrte.brdf(PAIR, MU, MU, PHI, nodes=4, accuracy=1e-13)
    found = brdf(PAIR, tolerance=tolerance, levels=120)
    left = 2.0 * tolerance if tolerance > 1e-12 else 1e-11  # 120 depths leave more
    assert np.abs(found.mueller - exact.mueller).max() <= left * np.abs(exact.mueller).max()
    assert found.diagnostics["converged"]
    assert found.diagnostics["remainder"] <= tolerance


def test_order_in_depth() -> None:
    """Twice the panels: the error falls towards 2^-8, and faster than 2^-5 from the start."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)])
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=4, accuracy=1e-13).mueller
    errors = [np.abs(brdf(scene, tolerance=1e-14, levels=n).mueller - exact).max() for n in (24, 48)]
    assert errors[1] < errors[0] / 32.0


def test_levels_by_themselves() -> None:
    """About 1e-8, in thin and thick layers, conservative ones too."""
    for albedo, thickness in ((0.9, 1e-3), (1.0, 3.0), (0.8, 30.0)):
        scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo, thickness)])
        exact = vrte.brdf(scene, MU, MU, nodes=8, accuracy=1e-13).mueller
        found = vrte.brdf(scene, MU, MU, nodes=8, method="successive-orders", settings={"tolerance": 1e-10})
        assert_close(found.mueller, exact, rtol=0.0, atol=5e-8 * exact.max())


def test_one_order_is_single_scattering() -> None:
    once = vrte.brdf(PAIR, MU, MU, PHI, nodes=4, method="single-scattering")
    np.testing.assert_array_equal(brdf(PAIR, orders=1).mueller, once.mueller)


def test_orders_add_up_as_powers_of_the_albedo() -> None:
    """The s-th order is albedo^s times that of albedo 1."""
    by_albedo = []
    for albedo in (1.0, 0.5):
        scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0)])
        two, three = (brdf(scene, orders=orders, tolerance=1e-15).mueller for orders in (2, 3))
        by_albedo.append((three - two) / albedo**3)
    assert_close(*by_albedo, rtol=0.0, atol=1e-14)


def test_it_says_that_it_did_not_converge() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 10.0)])
    told = brdf(scene, orders=20).diagnostics  # few orders on purpose: no warning
    assert told["scattering_orders"] == 20
    assert not told["converged"]
    assert not told["promised"]
    assert any("energy is not conserved" in note for note in told["notes"])
    settled = brdf(PAIR).diagnostics
    assert settled["converged"]
    assert not any("energy" in note for note in settled["notes"])


@pytest.mark.slow
def test_the_cap_of_orders_that_nobody_asked_for_is_a_warning() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 1.0, 100.0)])
    with pytest.warns(vrte.AccuracyWarning, match=r"1000 orders of scattering leave out about .* its setting 'orders'"):
        found = brdf(scene)
    assert found.reflectance[0] < 0.99
    assert not found.diagnostics["promised"]
