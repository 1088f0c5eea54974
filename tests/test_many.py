"""Many scenes in one call, each as by itself to the last bit; fields of many beams, lists of geometries; light that is
light."""

import warnings

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.calls import brdfs
from vrte.calls.brdfs import solve_side_by_side
from vrte.calls.plan import make_request

from .helpers import assert_close

MU = np.array([0.1, 0.45, 1.0])
PHI = np.array([0.0, 30.0, 180.0, 300.0])
GREY = vrte.henyey_greenstein(0.4, 16)
HOW = {"nodes": 8, "threads": 1}


def layer(phase=GREY, albedo=0.9, thickness=0.7):
    """A layer, thick enough to be solved by modes."""
    return vrte.Layer(phase, albedo, thickness)


def make_scenes(count=14):
    """Scalar and polarizing ones of one to three layers, over black and Lambertian bases."""
    draw = np.random.default_rng(3)
    found = []
    for k in range(count):
        phases = [
            vrte.rayleigh(draw.uniform(0.0, 0.1)) if k % 2 else vrte.henyey_greenstein(draw.uniform(0.1, 0.5), 16)
            for _ in range(1 + k % 3)
        ]
        layers = [layer(phase, draw.uniform(0.3, 1.0), 10 ** draw.uniform(-0.5, 0.4)) for phase in phases]
        found.append(vrte.Scene(layers, vrte.Lambertian(draw.uniform(0.0, 1.0)) if k % 4 else None))
    return found


def assert_same(found, alone):
    """Every array, to the last bit, and all diagnostics but those of the run."""
    for name in ("mueller", "reflectance", "transmission", "direct_transmittance", "specular"):
        np.testing.assert_array_equal(getattr(found, name), getattr(alone, name), err_msg=name)
    for name, value in alone.diagnostics.items():
        if name not in ("stages", "wall_seconds", "threads", "polarized_light"):
            assert found.diagnostics[name] == value, name


def count_together(results):
    """How many were solved in a batch."""
    return sum("solved_together" in one.diagnostics for one in results)


def test_each_is_as_by_itself_whatever_threads_and_batches(monkeypatch):
    """Beside one that cannot be shared; scenes of every kind: tests/test_every_way.py."""
    scenes, reported = make_scenes(), []
    everything = [*scenes, vrte.Scene([vrte.Interface(1.0, 1.3), layer()])]
    together = vrte.brdfs(everything, MU, MU, PHI, **HOW, progress=lambda *at: reported.append(at))
    assert count_together(together) == len(scenes)
    assert reported == sorted(reported)
    assert reported[-1] == (1500, 1500)
    for scene, found in zip(everything, together, strict=True):
        assert_same(found, vrte.brdf(scene, MU, MU, PHI, **HOW))
    assert all(found.diagnostics["solved_together"] > 1 for found in together[: len(scenes)])
    monkeypatch.setattr(brdfs, "BATCH_BYTES", 1.0)
    again = vrte.brdfs(scenes, MU, MU, PHI, nodes=8, threads=2)
    for one, other in zip(together, again, strict=False):
        assert np.array_equal(one.mueller, other.mueller)


def test_the_last_scene_joins_the_batch_before(monkeypatch):
    """Where it would be alone, in tables that are too large to be made in the caller's thread."""
    monkeypatch.setattr(brdfs, "BATCH_BYTES", 1.0)
    mu, scenes = np.linspace(0.05, 1.0, 40), [vrte.Scene([layer(albedo=albedo)]) for albedo in (0.5, 0.6, 0.7)]
    together = vrte.brdfs(scenes, mu, mu, PHI, **HOW)
    assert [found.diagnostics["solved_together"] for found in together] == [3, 3, 3]
    for scene, found in zip(scenes, together, strict=True):
        assert_same(found, vrte.brdf(scene, mu, mu, PHI, **HOW))


def make_films(base=None):
    """Under one smooth surface: thin and thick, white and absorbing, with a forward peak that few nodes cut."""
    peaked = vrte.henyey_greenstein(0.7)
    parts = [(vrte.rayleigh(), 1.0, 0.7), (vrte.rayleigh(0.1), 0.6, 1.3), (peaked, 0.9, 2.0), (peaked, 1.0, 40.0)]
    return [vrte.Scene([vrte.Interface(1.0, 1.5), layer(*part)], base) for part in parts]


@pytest.mark.parametrize("base", [None, vrte.Lambertian(0.3), vrte.Lambertian(1.0)])
def test_films_under_a_smooth_surface_are_solved_together(base):
    """As by themselves, but for rounding: fields of fluxes and along the normal, which few orders take."""
    films = make_films(base)
    for mu0, mu in ((MU, []), (1.0, MU.tolist()), (1.0, [])):
        requests = [make_request("radiance", film, mu0, mu=mu, phi=PHI, **HOW) for film in films]
        for film, found in zip(films, solve_side_by_side(requests), strict=True):
            alone = vrte.radiance(film, np.atleast_1d(mu0), mu=mu, phi=PHI, **HOW)
            for name in ("stokes", "flux_up", "flux_down", "direct_up"):
                assert_close(getattr(found, name), getattr(alone, name), rtol=1e-14, atol=1e-16)
            assert found.diagnostics["solved_together"] > 1


@pytest.mark.parametrize("how", [HOW, HOW | {"grading": 2, "accuracy": 1e-5}])
def test_thick_films_are_solved_together(how):
    """Light of high orders does not come back from their ends; on nodes of any grading, along any directions."""
    top, base = [vrte.Interface(1.0, 1.5), layer(GREY, 0.7, 1.0)], vrte.Lambertian(0.3)
    films = [vrte.Scene([*top, layer(GREY, 0.8, 60.0 + k)], base) for k in range(4)]
    requests = [make_request("radiance", film, MU, mu=MU.tolist(), phi=PHI, **how) for film in films]
    for film, found in zip(films, solve_side_by_side(requests), strict=True):
        assert found.diagnostics["solved_together"] > 1
        alone = vrte.radiance(film, MU, mu=MU, phi=PHI, **how)
        assert found.diagnostics["orders"] == alone.diagnostics["orders"]
        for name in ("stokes", "flux_up", "flux_down", "direct_up"):
            assert_close(getattr(found, name), getattr(alone, name), rtol=1e-14, atol=1e-16)


def test_films_under_other_surfaces_are_solved_by_themselves():
    mirror = vrte.Mirror(0.2 + 3.0j)
    rough, between = vrte.Interface(1.0, 1.5, roughness=0.3), vrte.Interface(1.5, 1.3)
    others = [vrte.Scene([vrte.Interface(1.0, 1.5), layer()], mirror), vrte.Scene([rough, layer()])]
    others += [vrte.Scene([vrte.Interface(1.0, 1.5), layer(), between, layer()])]
    assert not brdfs.sort_into_batches([make_request("radiance", one, MU, mu=[], nodes=4) for one in 2 * others])
    below = {"side": "below", "nodes": 4}
    assert not brdfs.sort_into_batches([make_request("radiance", one, MU, mu=[], **below) for one in make_films()])


@pytest.mark.parametrize("truncation", ["auto", "delta-m", "none"])
def test_peaks_are_cut_as_by_itself(truncation):
    peaked = [vrte.henyey_greenstein(g) for g in (0.5, 0.6, 0.7, 0.75)]
    scenes = [vrte.Scene([layer(one, 0.8, 0.9), layer(two)]) for one, two in zip(peaked, reversed(peaked), strict=True)]
    scenes += [vrte.Scene([layer(GREY), layer(vrte.henyey_greenstein(0.2, 16))])]
    asked = HOW | {"truncation": truncation}
    with warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("always")
        together = vrte.brdfs(scenes, MU, MU, PHI, **asked)
    assert count_together(together) == len(scenes)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for scene, found in zip(scenes, together, strict=True):
            assert_same(found, vrte.brdf(scene, MU, MU, PHI, **asked))
    assert sorted(str(one.message) for one in reported) == sorted(str(one.message) for one in said)


def test_an_interruption_stops_them(monkeypatch):
    calls = []

    def interrupt(requests, places, run):
        calls.append(places)
        raise KeyboardInterrupt

    monkeypatch.setattr(brdfs, "solve_batch", interrupt)
    with pytest.raises(KeyboardInterrupt):
        vrte.brdfs(make_scenes(), MU, MU, PHI, **HOW)
    assert len(calls) == 1


def test_bad_scenes_are_named():
    assert vrte.brdfs([], MU, MU) == []
    with pytest.raises(SceneError, match=r"scene 2 of 2: scene must be a vrte\.Scene, not str"):
        vrte.brdfs([make_scenes(1)[0], "gold"], MU, MU)


MU0, SEEN, TURNS, TAU = [0.3, 0.6, 1.0], [0.2, 0.7, -0.4], [0.0, 60.0, 190.0], [0.0, 0.4, 1.5]
LIGHT = [1.0, 0.3, -0.4, 0.2]
SCENE = vrte.Scene(
    [vrte.Layer(vrte.rayleigh(0.05), 0.99, 1.0), vrte.Layer(vrte.henyey_greenstein(0.5, 12), 0.8, 0.5)],
    vrte.Lambertian(0.2),
)


@pytest.mark.parametrize(
    "how",
    [
        {"nodes": 8},
        {"accuracy": 1e-3},
        {"nodes": 3, "method": "matrix-operator"},
        {"method": "single-scattering"},
        {"nodes": 6, "illuminate": "bottom"},
    ],
    ids=str,
)
def test_many_beams_are_what_single_calls_give(how):
    scene = vrte.Scene(SCENE.layers) if "illuminate" in how else SCENE
    asked = {"stokes": LIGHT, "mu": SEEN, "phi": TURNS, "tau": TAU, **how}
    many = vrte.radiance(scene, MU0, **asked)
    assert many.stokes.shape == (3, 3, 3, 3, 4)
    assert many.flux_up.shape == many.direct.shape == (3, 3)
    # nodes that are chosen are chosen for all beams together
    right = 2e-3 if "accuracy" in how else 1e-12
    for index, mu0 in enumerate(MU0):
        one = vrte.radiance(scene, mu0, **asked)
        assert one.mu0 == mu0
        assert one.stokes.shape == (3, 3, 3, 4)
        for found in (many.beam(index), one):
            np.testing.assert_array_equal(found.tau, TAU)
        for name in ("stokes", "flux_up", "flux_down", "direct"):
            expected = getattr(one, name)
            assert_close(getattr(many, name)[index], expected, rtol=0.0, atol=right * expected.max())
            np.testing.assert_array_equal(getattr(many.beam(index), name), getattr(many, name)[index])


def test_a_list_of_one_beam_keeps_its_axis():
    field = vrte.radiance(SCENE, [0.6], mu=[], nodes=4)
    assert field.stokes.shape == (1, 1, 0, 1, 4)
    assert repr(field.beam(0)) == repr(vrte.radiance(SCENE, 0.6, mu=[], nodes=4))
    assert "1 mu0" in repr(field)


def test_many_beams_are_labelled_and_drawn_beside_each_other():
    field = vrte.radiance(SCENE, MU0, LIGHT, SEEN, TURNS, TAU, nodes=4)
    data = field.to_xarray()
    assert data["stokes"].dims == ("mu0", "tau", "mu", "phi_deg", "stokes_parameter")
    np.testing.assert_array_equal(data["flux_up"].sel(mu0=0.6), field.flux_up[1])
    assert "3 from" not in field._repr_html_()
    assert "0.3, 0.6, 1" in field._repr_html_()
    assert [axes.get_title() for axes in field.plot().axes[:3]] == [f"μ₀ = {mu0:g}" for mu0 in MU0]
    assert field.beam(1).plot().get_suptitle().endswith("μ₀ = 0.6")


def test_light_is_light():
    """Polarized to rounding, or none at all."""
    assert np.isfinite(vrte.radiance(SCENE, 0.5, np.float32([1.0, 0.6, 0.0, 0.8]), nodes=4).stokes).all()
    assert not vrte.radiance(SCENE, 0.5, (0, 0, 0, 0), nodes=4).stokes.any()


def test_a_list_of_geometries_is_a_row_each(monkeypatch):
    """Of one solve and of several, what single calls give."""
    rng = np.random.default_rng(5)
    mu0, mu, phi = rng.uniform(0.2, 1.0, 12), rng.uniform(0.1, 1.0, 12), rng.uniform(0.0, 360.0, 12)
    mu0[3:9] = mu0[3]
    found = vrte.views(SCENE, mu0, mu, phi, LIGHT, nodes=6, accuracy=1e-14)
    assert len(found.diagnostics["solves"]) == 1
    monkeypatch.setattr("vrte.calls.radiance.LARGEST_GRID", 60.0)
    again = vrte.views(SCENE, mu0, mu, phi, LIGHT, nodes=6, accuracy=1e-14)
    assert len(again.diagnostics["solves"]) > 2
    assert_close(again.stokes, found.stokes, rtol=0.0, atol=1e-13)
    for row in range(12):
        one = vrte.radiance(SCENE, mu0[row], LIGHT, mu[row], phi[row], nodes=6, accuracy=1e-14)
        assert_close(found.stokes[row], one.stokes[0, 0, 0], rtol=0.0, atol=1e-13)
    data = found.to_xarray()
    assert data["stokes"].sel(stokes_parameter="Q")[3] == found.stokes[3, 1]
    assert data["mu0"].dims == ("geometry",)


def test_geometries_broadcast():
    found = vrte.views(SCENE, 0.5, [-0.2, -0.7], 30.0, tau=1.5, nodes=4)
    assert found.stokes.shape == (2, 4)
    assert repr(found) == "Views(2 geometries, tau=1.5, incident_stokes=[1.0, 0.0, 0.0, 0.0])"
