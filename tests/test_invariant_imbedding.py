"""Invariant imbedding: the Riccati equation in thickness, and its algebraic form."""

import numpy as np
import pytest

import vrte
from vrte.methods.parts.endless import doubled_until_settled

MU, PHI = np.array([0.05, 0.3, 1.0]), np.array([0.0, 40.0, 180.0])
HAZE = vrte.henyey_greenstein(0.4, 6)


def compare(scene: vrte.Scene, rtol: float, transmission: bool = False) -> float:
    """The largest error of the radiance reflected or transmitted, relative to the largest I."""
    ask = {"nodes": 4, "transmission": transmission}
    exact = vrte.brdf(scene, MU, MU, PHI, accuracy=1e-13, **ask)
    found = vrte.brdf(scene, MU, MU, PHI, method="invariant-imbedding", settings={"rtol": rtol}, **ask)
    cosine = MU[:, None, None, None, None]
    errors = [np.abs(cosine * (found.mueller - exact.mueller)).max() / (cosine * exact.mueller).max()]
    if transmission:
        errors.append(np.abs(cosine * (found.transmission - exact.transmission)).max())
    return float(max(errors))


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_a_slab_to_what_was_asked_for(rtol: float) -> None:
    assert compare(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.99, 2.0)]), rtol, transmission=True) < 10.0 * rtol


def test_layers_on_a_base() -> None:
    layers = [vrte.Layer(vrte.rayleigh(), 0.9, 0.5), vrte.Layer(HAZE, 1.0, 0.7)]
    assert compare(vrte.Scene(layers, vrte.Lambertian(0.3)), 1e-9, transmission=True) < 1e-8


def test_both_sides_of_the_lower_face() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.5)], vrte.Lambertian(0.3))
    ask = {"mu0": 0.6, "stokes": [1.0, 0.3, -0.2, 0.4], "mu": np.array([0.2, -0.3, 0.9, -0.6]), "phi": PHI}
    ask |= {"tau": [0.5, 0.0], "nodes": 6}
    exact = vrte.radiance(scene, accuracy=1e-13, **ask)
    found = vrte.radiance(scene, method="invariant-imbedding", settings={"rtol": 1e-10}, **ask)
    np.testing.assert_allclose(found.stokes, exact.stokes, atol=1e-9)
    np.testing.assert_allclose(found.flux_up, exact.flux_up, atol=1e-9)
    np.testing.assert_allclose(found.flux_down, exact.flux_down, atol=1e-9)


@pytest.mark.parametrize("albedo", [0.5, 0.99, 1.0 - 1e-6, 1.0])
@pytest.mark.parametrize("phase", [vrte.isotropic(), vrte.rayleigh(), HAZE], ids=["isotropic", "rayleigh", "haze"])
def test_layer_without_end(phase: vrte.PhaseMatrix, albedo: float) -> None:
    assert compare(vrte.Scene([vrte.Layer(phase, albedo, np.inf)]), 1e-8) < 1e-10


def test_a_layer_on_one_without_end() -> None:
    layers = [vrte.Layer(vrte.rayleigh(), 0.9, 0.5), vrte.Layer(HAZE, 0.99, np.inf)]
    assert compare(vrte.Scene(layers), 1e-10) < 1e-9


def test_white_layer_without_end_sends_all_back() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, np.inf)])
    field = vrte.radiance(scene, 0.6, mu=[], nodes=6, method="invariant-imbedding")
    np.testing.assert_allclose(field.flux_up, 0.6, rtol=1e-13)
    assert field.diagnostics["doublings"] < 20


def test_cost_of_a_low_cosine() -> None:
    """Some steps more, not steps as small as the cosine."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)])
    steps = [
        vrte.brdf(scene, [low], [low], nodes=6, method="invariant-imbedding").diagnostics["steps"]
        for low in (1e-1, 1e-6)
    ]
    assert steps[1] < steps[0] + 50


def test_structure_preserving_doubling_of_numbers() -> None:
    """x^2 c - x (a + d) + b = 0, the smaller root."""
    found, _ = doubled_until_settled(*(np.array([[value]]) for value in (2.0, 1.0, 0.5, 3.0)))
    np.testing.assert_allclose(found[0, 0], (5.0 - np.sqrt(25.0 - 2.0)) / 1.0, rtol=1e-14)
