"""Stiff and extreme scenes under surfaces: both algorithms against the literal solver, what the cases cover."""

import numpy as np
import pytest

import vrte

from .interface_oracle import brdf_orders
from .oracle import azimuthal_sum


def make_turning_matrix() -> vrte.PhaseMatrix:
    """Rayleigh scattering that turns U into V as well, in three terms, which few nodes carry."""
    coefficients = vrte.rayleigh(0.1).coefficients.copy()
    coefficients[2, 5] = 0.3
    return vrte.PhaseMatrix(*coefficients.T)


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
def test_light_on_few_nodes_is_the_literal_solvers(algorithm: str) -> None:
    """One discrete problem in all Stokes parameters: on few nodes the flux that they miss is put right in I alone."""
    scene = vrte.Scene(
        [vrte.Interface(1.0, 1.33), vrte.Layer(make_turning_matrix(), 0.9, 1.0)], vrte.Mirror(0.2 + 3.0j)
    )
    mu, phi = [0.2, 0.9], [0.0, 70.0]
    how = {"nodes": 6, "algorithm": algorithm, "truncation": "none", "accuracy": 1e-14}
    found = vrte.brdf(scene, mu, mu, phi, **how)
    right = brdf_orders(scene, mu, mu, 6, 3)
    np.testing.assert_allclose(found.mueller, azimuthal_sum(right.reflected, np.array(phi)), atol=1e-14)
    np.testing.assert_allclose(found.specular, right.specular, atol=1e-15)
    np.testing.assert_allclose(found.reflectance, right.reflectance, atol=1e-14)
