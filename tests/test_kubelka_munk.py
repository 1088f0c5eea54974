"""Kubelka and Munk's formulas: their limits, their inverse, and where the exact solve must give the same."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expn

import vrte
from vrte.appearance import kubelka_munk as km
from vrte.appearance.geometries import read_geometry
from vrte.appearance.panel import Panel, make_panel
from vrte.appearance.two_flux_fit import find_kubelka_munk, find_surface_shares
from vrte.pictures.appearance import draw_errors

from .helpers import close_to

LENGTH = 7.0
slopes = st.floats(1e-4, 2.0)


@pytest.mark.parametrize(("albedo", "thickness"), [(1.0, 3.0), (0.3, 0.5), (0.999, 40.0)])
def test_two_fluxes_are_discrete_ordinates_with_one_node(albedo: float, thickness: float) -> None:
    """Of isotropic scattering, at mu = 1/2: K = 2 (1 - albedo) and S = albedo, per optical depth."""
    K, S = 2.0 * (1.0 - albedo), albedo
    film = vrte.Layer(vrte.isotropic(), albedo, thickness)
    field = vrte.radiance(vrte.Scene([film]), mu0=0.5, mu=[], tau=[0.0, thickness], nodes=1)
    alone, through = km.find_film(K, S, thickness)
    assert 2.0 * field.flux_up[0] == close_to(alone, rtol=0.0, atol=1e-12)
    assert 2.0 * (field.flux_down[1] + field.direct[1]) == close_to(through, rtol=0.0, atol=1e-12)
    white = vrte.brdf(vrte.Scene([film], vrte.Lambertian(0.8)), 0.5, 0.5, nodes=1).reflectance
    assert white == close_to(km.reflect_film(K, S, thickness, 0.8), rtol=0.0, atol=1e-12)
    again = km.find_coefficients(2.0 * field.flux_up[0], white[0], 0.8, thickness)
    assert np.array(again) == close_to([K, S], rtol=0.0, atol=1e-8 if thickness > 10.0 else 1e-12)


@settings(max_examples=60, deadline=None)
@given(slopes, slopes, st.floats(0.1, 10.0), st.floats(0.05, 1.0), st.floats(0.0, 0.5), st.floats(0.0, 0.9))
def test_coefficients_come_back(K: float, S: float, length: float, base: float, k1: float, k2: float) -> None:
    alone, through = km.find_film(K, S, length)
    assert km.remove_surface(km.add_surface(alone, k1, k2), k1, k2) == close_to(alone, rtol=0.0, atol=1e-12)
    assert np.array(km.find_slab_coefficients(alone, through, length)) == close_to([K, S], rtol=1e-8, atol=0.0)
    over = km.reflect_film(K, S, length, base)
    lost = 1e-15 / min(float(over - alone), 1.0) if over > alone else 1.0  # digits that a hidden base leaves
    if lost < 1e-9:
        found = np.array(km.find_coefficients(alone, over, base, length))
        assert found == close_to([K, S], rtol=1e-8 + 1e3 * lost, atol=0.0)


def test_limits_are_exact() -> None:
    K, S = np.array([1e-12, 1e-6, 0.01, 1.0]), 0.5
    clear, white = (0.0, np.exp(-2.1)), (S * LENGTH / (1 + S * LENGTH), 1 / (1 + S * LENGTH))
    with np.errstate(all="raise", under="ignore"):
        assert km.reflect_film(0.0, S, np.inf, 0.9) == 1.0
        expected = 1 + K / S - np.sqrt((K / S) ** 2 + 2 * K / S)
        assert km.reflect_film(K, S, np.inf) == close_to(expected, rtol=1e-9, atol=0.0)
        assert km.find_film(0.0, S, LENGTH) == close_to(white, rtol=1e-6, atol=0.0)
        assert sum(km.find_film(0.0, S, np.geomspace(1e-12, 1e12, 9))) == close_to(np.ones(9), rtol=0.0, atol=1e-15)
        alone, through = km.find_film(0.3, 0.0, np.array([0.0, LENGTH, np.inf]))
        assert alone.tolist() == [0.0, 0.0, 0.0]
        assert through == close_to(np.exp([0.0, -0.3 * LENGTH, -np.inf]), rtol=1e-6, atol=0.0)
        assert [float(one) for one in km.find_film(0.0, 0.0, np.inf)] == [0.0, 1.0]
        for film, length, coefficients, rtol in (
            (white, LENGTH, [0.0, S], 1e-6),
            (clear, LENGTH, [0.3, 0.0], 1e-6),
            ((1e-9, 1.0 - 1e-9), LENGTH, [0.0, 1e-9 / LENGTH], 1e-6),
            (km.find_film(0.2, S, 900.0), 900.0, [0.2, S], 1e-12),
        ):
            found = np.array(km.find_slab_coefficients(*film, length))
            assert found == close_to(coefficients, rtol=rtol, atol=0.0)


def make_film(albedo: float = 0.99, thickness: float = 4.0, *, g: float = 0.0, index: float = 1.5, **more) -> Panel:
    """One film under a surface, of no geometrical thickness, at one wavelength."""
    nodes = more.pop("nodes", 16)
    surface = [{"interface": {"above": 1.0, "below": index, **more}}] if index > 1.0 else []
    phase = {"henyey_greenstein": g} if g else "isotropic"
    film = {"phase": phase, "albedo": albedo, "thickness": thickness}
    return make_panel({"layer": [*surface, film]}, [0.55], nodes=nodes)


def test_saunderson_is_exact_over_a_lambertian_base() -> None:
    """k1 of Fresnel at 8 degrees, k2 of even light in closed form, 1 - (1 - r_e)/n^2, r_e by quad of Fresnel's
    formulas, and k2 from the field are one to 1e-9; rough surfaces send back what their facets say."""
    albedo, mu = 0.7, float(np.cos(np.radians(8.0)))
    panel = make_film(0.5, 0.0, nodes=48).put_over(vrte.Lambertian(albedo))
    k1, k2, even = find_surface_shares(panel, read_geometry("8:di"), albedo)
    read = panel.solve(mu).total_reflectance[0, 0]
    assert even[0] == close_to(0.5963457597, rtol=0.0, atol=1e-9)
    assert k2[1, 0] == close_to(even[0], rtol=0.0, atol=1e-9)
    assert k2[0, 0] == even[0]  # nothing comes up over black
    assert km.add_surface(albedo, k1[0], even[0]) == close_to(read, rtol=0.0, atol=1e-9)
    seen = find_surface_shares(panel, read_geometry("di:di"), albedo)[0][0]
    assert seen == close_to(1.0 - (1.0 - even[0]) * 1.5**2, rtol=0.0, atol=1e-9)
    panel = make_film(0.5, 0.0, nodes=24, roughness=0.3, shadowing=True, conserving=True)
    k1, k2, even = find_surface_shares(panel, read_geometry("8:di"), albedo)
    assert k2[1, 0] == close_to(even[0], rtol=0.0, atol=2e-4)
    assert k1[0] == close_to(panel.surface[0].share([mu])[0][0], rtol=0.0, atol=1e-12)


def test_limits_of_films_that_do_not_scatter_and_of_thick_white_ones() -> None:
    """T = 2 E_3(tau), so that K X = -ln 2 E_3: twice the absorption for thin films, once for thick ones; 2e-4 is what
    16 cosines leave of the corner of exp(-tau/mu) at the horizon. Milne's problem: 1/T = 3/4 tau + 3/2 0.710446..., so
    that S X = 1/T - 1 has both constants. What hides its base still has S, by what gets through."""
    for tau in (0.01, 0.5, 3.0):
        found = find_kubelka_munk(make_film(0.0, tau, index=1.0), geometry="inside")
        assert found.K[0] == close_to(-np.log(2.0 * expn(3, tau)), rtol=2e-4, atol=0.0)
        assert (found.S[0], found.transport[0][0]) == (0.0, tau)
    for thickness in (10.0, 40.0):
        found = find_kubelka_munk(make_film(1.0, thickness, index=1.0, nodes=32), geometry="inside")
        assert found.S[0] == close_to(0.75 * thickness + 1.5 * 0.7104460895987 - 1.0, rtol=1e-5, atol=0.0)
        assert found.K[0] == close_to(0.0, rtol=0.0, atol=1e-10)
        assert found.diffusion[1][0] == close_to(0.75 * thickness, rtol=1e-6, atol=0.0)
    assert find_kubelka_munk(make_film(0.5, 30.0), geometry="inside").S[0] > 0.0


@pytest.mark.parametrize(("geometry", "more"), [("inside", {}), ("8:di", {}), ("di:di", {"k1": 0.09, "k2": 0.55})])
def test_k_and_s_give_back_what_they_are_from(geometry: str, more: dict) -> None:
    """At their own thickness, both bases; elsewhere they are off, semi-infinite by what the exact solve says."""
    panel = make_film(0.98, 3.0, g=0.5)
    found = find_kubelka_munk(panel, 0.7, geometry=geometry, **more)
    errors = found.compare([1.0, 2.0, np.inf])
    assert errors.error[:, 0, 0] == close_to(0.0, rtol=0.0, atol=1e-9)
    assert (np.abs(errors.error[:, 1, 0]) > 1e-6).all()
    assert errors.predicted[:, 2, 0] == close_to(found.predict(np.inf)[0], rtol=0.0, atol=1e-12)
    assert errors.exact[0, 2] == close_to(errors.exact[1, 2], rtol=0.0, atol=1e-12)
    assert (found.k2[0], found.unit) == (more.get("k2", found.k2_over.mean()), "1/film")
    assert np.array(found.transport) == close_to(np.array([[0.06], [0.98 * 0.5 * 3.0]]), rtol=1e-6, atol=0.0)


def test_lengths_of_a_film_in_micrometres() -> None:
    """Of a paint: K and S per micrometre, near to diffusion's, and films solved at the lengths that are asked for."""
    film = {"material": "rutile in alkyd", "thickness_um": 10.0, "volume_fraction": 0.05}
    panel = make_panel({"layer": [{"interface": {"above": 1.0, "below": "alkyd"}}, film]}, [0.5, 0.6], nodes=8)
    found = find_kubelka_munk(panel)
    assert (found.unit, found.length) == ("1/um", 10.0)
    assert found.over_diffusion[1] == close_to(1.0, rtol=0.0, atol=0.15)
    assert 0.55 < found.k2.min() <= found.k2.max() < 0.65
    assert len(str(found).splitlines()) == 3
    read = panel.make_as_thick(20.0).put_over(vrte.Lambertian(0.8)).solve(np.cos(np.radians(8.0)))
    assert found.compare([20.0]).exact[1, 0] == close_to(read.total_reflectance[:, 0], rtol=0.0, atol=1e-12)


def test_errors_are_colours_too_and_a_picture() -> None:
    pytest.importorskip("colour")
    panel = make_film(0.98, 3.0)
    panel = replace(panel, wavelength_um=np.linspace(0.4, 0.7, 9), scenes=9 * panel.scenes)
    found = find_kubelka_munk(panel, geometry="inside")
    errors = found.compare([0.5, 1.0])
    assert errors.difference[:, 1] == close_to(0.0, rtol=0.0, atol=1e-6)
    assert (errors.difference[:, 0] > 0.01).all()
    grey = errors.exact[0, :, 0] / errors.exact[1, :, 0]  # of the same reflectance at all wavelengths
    assert errors.contrast_ratio[0] == close_to(grey, rtol=1e-6, atol=0.0)
    axes = draw_errors(found, errors).axes
    assert len(axes) == 4
    assert axes[0].lines[1].get_ydata() == close_to(errors.exact[0, :, 0], rtol=1e-6, atol=0.0)
    with pytest.raises(vrte.SceneError, match="two or more"):
        draw_errors(found, found.compare([1.0, np.inf]))
