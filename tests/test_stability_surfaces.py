"""Stiff and extreme scenes under surfaces: both algorithms against the literal solver, what the cases cover."""

import numpy as np
import pytest

import vrte
from bench import stability_cases

from .helpers import assert_close, close_to
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
    assert_close(found.mueller, azimuthal_sum(right.reflected, np.array(phi)), rtol=0.0, atol=1e-14)
    assert_close(found.specular, right.specular, rtol=0.0, atol=1e-15)
    assert_close(found.reflectance, right.reflectance, rtol=0.0, atol=1e-14)


def test_light_on_either_side_where_nothing_scatters() -> None:
    """A layer without thickness under a surface: both sides of it are at one depth."""
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.isotropic(), 0.0, 0.0)], vrte.Lambertian(0.5))
    outside, inside = (vrte.radiance(scene, 0.6, mu=0.9, nodes=16, side=side) for side in ("above", "below"))
    assert (outside.index[0], inside.index[0]) == (1.0, 1.5)
    net = [field.flux_down + field.direct - field.flux_up - field.direct_up for field in (outside, inside)]
    assert_close(*net, rtol=0.0, atol=1e-14)
    assert_close(inside.flux_up, 0.5 * (inside.flux_down + inside.direct), rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("mu0", [1e-8, 1e-3])
def test_grazing_light_is_reciprocal_through_a_surface(mu0: float) -> None:
    """Into the surface and out of it along one direction: inside it is the critical one, which tells nothing of mu0."""
    mu = [mu0, 0.5]
    pile = [vrte.Interface(1.0, 1.5), vrte.Layer(make_turning_matrix(), 0.9, 1.0), vrte.Interface(1.5, 1.0)]
    found = vrte.brdf(vrte.Scene(pile), mu, mu, 30.0, nodes=8).mueller[:, :, 0]
    q = np.diag([1.0, 1.0, 1.0, -1.0])
    assert_close(found[0, 1], q @ found[1, 0].T @ q, rtol=1e-11, atol=1e-12 * found[0, 1, 0, 0])


def test_the_critical_angle_is_hit_to_the_last_bit() -> None:
    """From inside glass one unit in the last place decides whether light gets out."""
    case = next(case for case in stability_cases.SURFACE_CORNERS if case.name == "n=1.5, view at the critical cosine")
    sines = 1.5 * np.sqrt((1.0 - case.mu) * (1.0 + case.mu))
    assert (np.abs(sines - 1.0) < 5e-16).sum() >= 4
    assert case.mu0 == 0.6


def test_facets_that_create_light_without_end_are_told() -> None:
    """Steep facets without shadowing return more than they get: between a dense medium and a white base that grows."""
    layer, white = vrte.Layer(make_turning_matrix(), 1.0, 1.0), vrte.Lambertian(1.0)

    def solve(shadowing: bool) -> vrte.Brdf:
        steep = vrte.Interface(1.0, 4.0, roughness=1.0, distribution="ggx", shadowing=shadowing)
        return vrte.brdf(vrte.Scene([steep, layer], white), 0.5, [0.3, 0.5], nodes=16)

    with pytest.warns(vrte.AccuracyWarning, match="give the interface shadowing"):
        assert solve(False).reflectance[0] < 0.0
    assert solve(True).reflectance[0] == close_to(1.0, rtol=0.0, atol=2e-3)  # 16 nodes under index 4
