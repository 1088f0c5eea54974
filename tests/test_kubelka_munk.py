"""Kubelka and Munk's formulas: their limits, their inverse, and where the exact solve must give the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vrte
from vrte.appearance import kubelka_munk as km

LENGTH = 7.0
slopes = st.floats(1e-4, 2.0)


@pytest.mark.parametrize(("albedo", "thickness"), [(1.0, 3.0), (0.9, 2.0), (0.3, 0.5), (0.999, 40.0)])
def test_two_fluxes_are_discrete_ordinates_with_one_node(albedo: float, thickness: float) -> None:
    """Of isotropic scattering, at mu = 1/2: K = 2 (1 - albedo) and S = albedo, per optical depth."""
    K, S = 2.0 * (1.0 - albedo), albedo
    film = vrte.Layer(vrte.isotropic(), albedo, thickness)
    field = vrte.radiance(vrte.Scene([film]), mu0=0.5, mu=[], tau=[0.0, thickness], nodes=1)
    alone, through = km.find_film(K, S, thickness)
    assert 2.0 * field.flux_up[0] == pytest.approx(alone, abs=1e-12)
    assert 2.0 * (field.flux_down[1] + field.direct[1]) == pytest.approx(through, abs=1e-12)
    white = vrte.brdf(vrte.Scene([film], vrte.Lambertian(0.8)), 0.5, 0.5, nodes=1).reflectance
    assert white == pytest.approx(km.reflect_film(K, S, thickness, 0.8), abs=1e-12)
    again = km.find_coefficients(2.0 * field.flux_up[0], white[0], 0.8, thickness)
    assert np.array(again) == pytest.approx([K, S], abs=1e-8 if thickness > 10.0 else 1e-12)


def test_a_film_over_a_lambertian_base_is_two_numbers() -> None:
    """Whatever scatters in it: exact, though its light is not even."""
    film = vrte.Layer(vrte.henyey_greenstein(0.7), 0.99, 3.0)
    mu, weights = vrte.hemisphere(16)
    field = vrte.radiance(vrte.Scene([film]), mu0=mu, mu=[], tau=[0.0, 3.0], nodes=16)
    alone, through = 2.0 * weights @ field.flux_up[:, 0], 2.0 * weights @ (field.flux_down[:, 1] + field.direct[:, 1])
    over = vrte.brdf(vrte.Scene([film], vrte.Lambertian(0.8)), mu, 1.0, nodes=16).bihemispherical_reflectance(weights)
    assert over == pytest.approx(km.put_film_over(alone, through, 0.8).item(), abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(slopes, slopes, st.floats(0.1, 10.0), st.floats(0.05, 1.0))
def test_coefficients_come_back(K: float, S: float, length: float, base: float) -> None:
    alone, through = km.find_film(K, S, length)
    assert np.array(km.find_slab_coefficients(alone, through, length)) == pytest.approx([K, S], rel=1e-8)
    over = km.reflect_film(K, S, length, base)
    lost = 1e-15 / min(float(over - alone), 1.0) if over > alone else 1.0  # digits that a hidden base leaves
    if lost < 1e-9:
        assert np.array(km.find_coefficients(alone, over, base, length)) == pytest.approx([K, S], rel=1e-8 + 1e3 * lost)


def test_limits_are_exact() -> None:
    K, S = np.array([0.0, 1e-12, 1e-6, 0.01, 1.0]), 0.5
    with np.errstate(all="raise", under="ignore"):
        assert km.reflect_film(K, S, np.inf, 0.9)[0] == 1.0
        assert km.reflect_thick_film(K[1:], S) == pytest.approx(
            1 + K[1:] / S - np.sqrt((K[1:] / S) ** 2 + 2 * K[1:] / S), rel=1e-9
        )
        assert km.find_film(0.0, S, LENGTH) == pytest.approx((S * LENGTH / (1 + S * LENGTH), 1 / (1 + S * LENGTH)))
        assert sum(km.find_film(0.0, S, np.geomspace(1e-12, 1e12, 9))) == pytest.approx(np.ones(9), abs=1e-15)
        alone, through = km.find_film(0.3, 0.0, np.array([0.0, LENGTH, np.inf]))
        assert alone.tolist() == [0.0, 0.0, 0.0]
        assert through == pytest.approx(np.exp([0.0, -0.3 * LENGTH, -np.inf]))
        assert [float(one) for one in km.find_film(0.0, 0.0, np.inf)] == [0.0, 1.0]
        assert np.array(km.find_slab_coefficients(*km.find_film(0.0, S, LENGTH), LENGTH)) == pytest.approx([0.0, S])
        assert np.array(km.find_slab_coefficients(0.0, np.exp(-2.1), LENGTH)) == pytest.approx([0.3, 0.0])
        assert np.array(km.find_slab_coefficients(1e-9, 1.0 - 1e-9, LENGTH)) == pytest.approx(
            [0.0, 1e-9 / LENGTH], rel=1e-6
        )
        thick = km.find_film(0.2, S, 900.0)
        assert np.array(km.find_slab_coefficients(*thick, 900.0)) == pytest.approx([0.2, S], rel=1e-12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: km.find_coefficients(0.5, 0.5, 0.8, 1.0), "over_base must be above over_black"),
        (lambda: km.find_coefficients(0.5, [0.6, 0.4], 0.8, 1.0), r"not 0\.4 \(at place 1\)"),
        (lambda: km.find_coefficients(0.1, 0.9, 0.8, 1.0), "keeps no light"),
        (lambda: km.find_coefficients(0.1, 0.2, 0.0, 1.0), "base must be above 0"),
        (lambda: km.find_coefficients(-0.1, 0.2, 0.8, 1.0), "over_black must be a share of light"),
        (lambda: km.find_coefficients(0.1, np.nan, 0.8, 1.0), "over_base must be a share of light"),
        (lambda: km.find_coefficients(0.1, 0.2, 0.8, 0.0), "length must be above 0"),
        (lambda: km.find_slab_coefficients(0.6, 0.5, 1.0), "must be 1 together at most, not 1.1"),
        (lambda: km.find_slab_coefficients(0.6, 0.0, 1.0), "K/S alone"),
        (lambda: km.reflect_film(-1.0, 1.0, 1.0), "K must be from 0"),
        (lambda: km.reflect_film(1.0, np.inf, 1.0), "S must be from 0"),
        (lambda: km.reflect_film(1.0, 1.0, -1.0), "length must be 0 or above"),
        (lambda: km.remove_surface(0.03, 0.04, 0.6), "measured must not be below k1"),
        (lambda: km.add_surface(0.5, 0.04, 1.0), "k2 must be below 1"),
    ],
)
def test_impossible_pairs_are_refused(call, words: str) -> None:
    with pytest.raises(vrte.SceneError, match=words):
        call()


@settings(max_examples=40, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(0.0, 0.5), st.floats(0.0, 0.9))
def test_a_surface_comes_off_again(inside: float, k1: float, k2: float) -> None:
    assert km.remove_surface(km.add_surface(inside, k1, k2), k1, k2) == pytest.approx(inside, abs=1e-12)
