"""Fields of several beams in one solve, lists of geometries, and light that is light."""

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.formats import load

from .helpers import assert_close

MU0, MU, PHI, TAU = [0.3, 0.6, 1.0], [0.2, 0.7, -0.4], [0.0, 60.0, 190.0], [0.0, 0.4, 1.5]
LIGHT = [1.0, 0.3, -0.4, 0.2]
SCENE = vrte.Scene(
    [vrte.Layer(vrte.rayleigh(0.05), 0.99, 1.0), vrte.Layer(vrte.henyey_greenstein(0.5, 12), 0.8, 0.5)],
    vrte.Lambertian(0.2),
)


def free(scene):
    return vrte.Scene(scene.layers)


@pytest.mark.parametrize(
    "how",
    [
        {"nodes": 8},
        {"accuracy": 1e-3},
        {"nodes": 6, "method": "adding-doubling"},
        {"method": "single-scattering"},
        {"nodes": 6, "illuminate": "bottom"},
    ],
    ids=str,
)
def test_many_beams_are_what_single_calls_give(how):
    scene = free(SCENE) if "illuminate" in how else SCENE
    asked = {"stokes": LIGHT, "mu": MU, "phi": PHI, "tau": TAU, **how}
    many = vrte.radiance(scene, MU0, **asked)
    assert many.stokes.shape == (3, 3, 3, 3, 4)
    assert many.flux_up.shape == many.direct.shape == (3, 3)
    # nodes that are chosen are chosen for all beams together
    right = 2e-3 if "accuracy" in how else 1e-12
    for place, mu0 in enumerate(MU0):
        one = vrte.radiance(scene, mu0, **asked)
        assert one.mu0 == mu0
        assert one.stokes.shape == (3, 3, 3, 4)
        for found in (many.beam(place), one):
            np.testing.assert_array_equal(found.tau, TAU)
        for name in ("stokes", "flux_up", "flux_down", "direct"):
            expected = getattr(one, name)
            assert_close(getattr(many, name)[place], expected, rtol=0.0, atol=right * expected.max())
            np.testing.assert_array_equal(getattr(many.beam(place), name), getattr(many, name)[place])


def test_a_list_of_one_beam_keeps_its_axis():
    field = vrte.radiance(SCENE, [0.6], mu=[], nodes=4)
    assert field.stokes.shape == (1, 1, 0, 1, 4)
    assert repr(field.beam(0)) == repr(vrte.radiance(SCENE, 0.6, mu=[], nodes=4))
    assert "1 mu0" in repr(field)
    with pytest.raises(SceneError, match="place must be one of 1 beams, from 0 on, not 1"):
        field.beam(1)
    with pytest.raises(SceneError, match="field of one beam"):
        field.beam(0).beam(0)


@pytest.mark.parametrize("name", ["field.csv", "field.nc"])
def test_many_beams_are_written_and_read(tmp_path, name):
    field = vrte.radiance(SCENE, MU0, LIGHT, MU, PHI, TAU, nodes=4)
    field.save(tmp_path / name)
    again = load(tmp_path / name)
    for part in ("stokes", "flux_up", "direct", "mu0", "tau", "mu", "phi", "incident_stokes"):
        np.testing.assert_array_equal(getattr(again, part), getattr(field, part))
    assert again.diagnostics == field.diagnostics


def test_many_beams_are_labelled_and_drawn_beside_each_other():
    field = vrte.radiance(SCENE, MU0, LIGHT, MU, PHI, TAU, nodes=4)
    data = field.to_xarray()
    assert data["stokes"].dims == ("mu0", "tau", "mu", "phi_deg", "stokes_parameter")
    np.testing.assert_array_equal(data["flux_up"].sel(mu0=0.6), field.flux_up[1])
    assert "3 from" not in field._repr_html_()
    assert "0.3, 0.6, 1" in field._repr_html_()
    assert [axes.get_title() for axes in field.plot().axes[:3]] == [f"μ₀ = {mu0:g}" for mu0 in MU0]
    assert field.beam(1).plot().get_suptitle().endswith("μ₀ = 0.6")


def test_scene_files_list_beams(tmp_path):
    from vrte.cli import main

    scene = tmp_path / "scene.toml"
    layer = '[[layer]]\nphase = "rayleigh"\nalbedo = 1\nthickness = 0.5\n'
    scene.write_text(f"nodes = 4\n{layer}[field]\nmu0 = [0.3, 0.6]\nmu = 0.5\n")
    assert main(["field", str(scene), "-o", str(tmp_path / "out.nc")]) == 0
    assert load(tmp_path / "out.nc").stokes.shape == (2, 1, 1, 1, 4)


@pytest.mark.parametrize("stokes", [(1, 2, 0, 0), (-1, 0, 0, 0), (0, 0, 0, 1e-3), (1, 0.8, 0.5, 0.4)])
def test_light_that_is_none_is_refused(stokes):
    with pytest.raises(SceneError, match=r"stokes must be light, I >= 0 and I\^2 >= Q\^2 \+ U\^2 \+ V\^2: \["):
        vrte.radiance(SCENE, 0.5, stokes, nodes=4)
    brdf = vrte.brdf(SCENE, vrte.hemisphere(2)[0], 0.5, phi=[0.0, 180.0], nodes=4)
    with pytest.raises(SceneError, match="the incident light must be light"):
        brdf.under(stokes)


def test_light_polarized_to_rounding_is_light():
    tilted = np.float32([1.0, *np.array([0.6, 0.0, 0.8])])
    assert np.isfinite(vrte.radiance(SCENE, 0.5, tilted, nodes=4).stokes).all()
    assert not vrte.radiance(SCENE, 0.5, (0, 0, 0, 0), nodes=4).stokes.any()


def test_light_too_bright_for_sums_is_refused():
    brdf = vrte.brdf(SCENE, vrte.hemisphere(2)[0], 0.5, phi=[0.0, 180.0], nodes=4)
    with pytest.raises(SceneError, match=r"the incident light must be numbers of at most 1e\+100 in size, not 1e\+308"):
        brdf.under([1e308] * 4)


def test_a_list_of_geometries_is_a_row_each(monkeypatch):
    """Of one solve and of several, what single calls give."""
    rng = np.random.default_rng(5)
    mu0, mu, phi = rng.uniform(0.2, 1.0, 12), rng.uniform(0.1, 1.0, 12), rng.uniform(0.0, 360.0, 12)
    mu0[3:9] = mu0[3]
    found = vrte.views(SCENE, mu0, mu, phi, LIGHT, nodes=6, accuracy=1e-14)
    assert len(found.diagnostics["solves"]) == 1
    monkeypatch.setattr("vrte.calls.views.LARGEST_GRID", 60.0)
    again = vrte.views(SCENE, mu0, mu, phi, LIGHT, nodes=6, accuracy=1e-14)
    assert len(again.diagnostics["solves"]) > 2
    assert_close(again.stokes, found.stokes, rtol=0.0, atol=1e-13)
    for row in range(12):
        one = vrte.radiance(SCENE, mu0[row], LIGHT, mu[row], phi[row], nodes=6, accuracy=1e-14)
        assert_close(found.stokes[row], one.stokes[0, 0, 0], rtol=0.0, atol=1e-13)
    data = found.to_xarray()
    assert data["stokes"].sel(stokes_parameter="Q")[3] == found.stokes[3, 1]
    assert data["mu0"].dims == ("geometry",)


def test_geometries_broadcast_or_are_refused():
    found = vrte.views(SCENE, 0.5, [-0.2, -0.7], 30.0, tau=1.5, nodes=4)
    assert found.stokes.shape == (2, 4)
    assert repr(found) == "Views(2 geometries, tau=1.5, incident_stokes=[1.0, 0.0, 0.0, 0.0])"
    with pytest.raises(SceneError, match="mu0, mu and phi must be of one length, a geometry each, not of 3, 2, 1"):
        vrte.views(SCENE, MU0, [0.5, 0.6], nodes=4)
    with pytest.raises(SceneError, match="mu0 must satisfy"):
        vrte.views(SCENE, [0.5, -0.5], [0.5, 0.6], nodes=4)
