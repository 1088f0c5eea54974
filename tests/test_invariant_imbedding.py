"""Invariant imbedding: the Riccati equation in thickness, and its algebraic form."""

import numpy as np
import pytest

import vrte
from vrte.methods.parts.slab import solve_riccati

from .helpers import assert_close

MU, PHI = np.array([0.05, 0.3, 1.0]), np.array([0.0, 40.0, 180.0])


@pytest.mark.parametrize("rtol", [1e-4, 1e-7, 1e-10])
def test_a_slab_to_what_was_asked_for(rtol: float) -> None:
    """The largest error of the radiance reflected and transmitted, relative to the largest I reflected."""
    scene, ask = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.99, 2.0)]), {"nodes": 4, "transmission": True}
    exact = vrte.brdf(scene, MU, MU, PHI, accuracy=1e-13, **ask)
    found = vrte.brdf(scene, MU, MU, PHI, method="invariant-imbedding", settings={"rtol": rtol}, **ask)
    cosine = MU[:, None, None, None, None]
    assert np.abs(cosine * (found.mueller - exact.mueller)).max() < 10.0 * rtol * (cosine * exact.mueller).max()
    assert np.abs(cosine * (found.transmission - exact.transmission)).max() < 10.0 * rtol


def test_white_layer_without_end_sends_all_back() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, np.inf)])
    field = vrte.radiance(scene, 0.6, mu=[], nodes=6, method="invariant-imbedding")
    assert_close(field.flux_up, 0.6, rtol=1e-13, atol=0.0)
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
    found, _ = solve_riccati(*(np.array([[value]]) for value in (2.0, 1.0, 0.5, 3.0)))
    assert_close(found[0, 0], (5.0 - np.sqrt(25.0 - 2.0)) / 1.0, rtol=1e-14, atol=0.0)
