"""Derivatives by name in calls, results, files, plans and the command; and what has none."""

import math

import numpy as np
import pytest

import vrte
from vrte.basics.differences import sample_around

from .helpers import assert_close, close_to

MU_I, MU_O = np.array([0.2, 0.9]), np.array([0.3, 0.7])
DEPTH, ALBEDO, BASE = "layer[1].thickness", "layer[1].albedo", "base.albedo"
CLEAR = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=0.5)], vrte.Lambertian(0.3))
HAZE = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=0.9, thickness=0.5)], vrte.Lambertian(0.3))
DEEP = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo=1.0, thickness=math.inf)], vrte.Lambertian(0.3))
GLOSSY = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(vrte.rayleigh(), 0.9, 0.5)], vrte.Lambertian(0.3))


def differentiate(scene, *names, **how):
    return vrte.brdf(scene, MU_I, MU_O, [0.0, 70.0], nodes=4, derivatives=names, **how)


def test_modes_without_digits_give_no_derivatives():
    """1500 terms on 8 nodes have modes that neither decay nor grow: differences of solves take their place."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.99, 1500), 0.9, 0.5)])
    with pytest.warns(vrte.AccuracyWarning):
        found = vrte.brdf(scene, 0.5, [0.1, 0.9], nodes=8, truncation="none", derivatives=[ALBEDO])
    assert "modes have residuals of 1" in found.diagnostics["derivatives"][ALBEDO]


def test_a_variation_without_a_scene_is_the_name_of_its_ingredients():
    names = differentiate(HAZE, DEPTH, "layer[1].coefficients[1].a1")
    table = np.zeros((2, 6))
    table[1, 0] = 2.0
    own = vrte.Variation("both", 0.0, [0.5], [0.0], (table,))
    found = differentiate(HAZE, own).jacobian["both"]
    expected = 0.5 * names.jacobian[DEPTH] + 2.0 * names.jacobian["layer[1].coefficients[1].a1"]
    assert_close(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_light_from_the_bottom_counts_layers_from_the_top():
    two = vrte.Scene([HAZE.layers[0], vrte.Layer(vrte.isotropic(), 0.5, 0.2)])
    upside_down = vrte.Scene(two.layers[::-1])
    below = differentiate(two, DEPTH, illuminate="bottom").jacobian[DEPTH]
    above = differentiate(upside_down, "layer[2].thickness").jacobian["layer[2].thickness"]
    assert_close(below[..., 0, 0], above[..., 0, 0], rtol=1e-9, atol=0.0)


def test_many_scenes_have_the_same_derivatives_each():
    both = vrte.brdfs([CLEAR, HAZE], MU_I, MU_O, [0.0, 70.0], nodes=4, derivatives=[BASE])
    for scene, found in zip((CLEAR, HAZE), both, strict=True):
        assert (found.jacobian[BASE] == differentiate(scene, BASE).jacobian[BASE]).all()


def test_nodes_that_an_accuracy_chose_stay():
    found = vrte.brdf(HAZE, 0.5, 0.5, accuracy=1e-3, derivatives=BASE)
    fixed = vrte.brdf(HAZE, 0.5, 0.5, nodes=found.diagnostics["nodes"], derivatives=[BASE])
    assert_close(found.jacobian[BASE], fixed.jacobian[BASE], rtol=1e-11, atol=0.0)


def test_five_points_are_exact_for_fourth_powers_at_bounds_too():
    def take(x):
        if not 0.0 <= x <= 1.0:
            raise vrte.SceneError("outside")
        return x**4

    for at in (0.0, 0.5, 1.0):
        assert [x for _, x in sample_around(lambda x: x, 0.5, 0.3)] == [0.0, 0.25, 0.75, 1.0]  # steps of 2^-2
        assert sum(w * y for w, y in sample_around(take, at, 0.01)) == close_to(4.0 * at**3, rtol=0.0, atol=1e-12)
    with pytest.raises(vrte.SceneError, match="outside"):
        sample_around(take, 0.5, 0.4)


def test_results_check_derivatives():
    found = differentiate(HAZE, BASE)
    assert "1 derivative" in repr(found)
    assert found.transmission_jacobian is None
    with pytest.raises(vrte.SceneError, match="jacobian of p must have the shape"):
        vrte.Brdf(found.mueller, found.reflectance, MU_I, MU_O, found.phi, {}, jacobian={"p": np.zeros(3)})


@pytest.mark.parametrize(
    ("scene", "asked", "said"),
    [
        (HAZE, "layer[2].thickness", "no such layer; the scene has layer 1"),
        (GLOSSY, DEPTH, "no such layer; the scene has layer 2"),
        (HAZE, "layer[1].colour", "no number of a scene is called so"),
        (HAZE, 3.0, "list"),
        (HAZE, [3.0], "item 1 of derivatives must be a text or a vrte.Variation, not 3.0"),
        (HAZE, [DEPTH, DEPTH], "asked for twice"),
        (HAZE, "layer[1].coefficients[0].a1", "cannot change"),
        (HAZE, "layer[1].coefficients[1].b1", "does nothing"),
        (CLEAR, "layer[1].coefficients[2].a1", "scatters nothing"),
        (HAZE, "layer[1].index", "refracted nowhere"),
        (HAZE, "interface[1].roughness", "0 interfaces"),
        (GLOSSY, "interface[1].roughness", "smooth interface has no derivative"),
        (HAZE, "base.roughness", "whose numbers are base.albedo"),
        (vrte.Scene(HAZE.layers), BASE, "no base"),
        (DEEP, DEPTH, "no thickness to change"),
        (DEEP, ALBEDO, "infinite at 1"),
        (DEEP, BASE, "no light reaches the base"),
        (HAZE, vrte.Variation("p", 1.0, [0.0], [0.0]), "does nothing"),
        (HAZE, vrte.Variation("p", 1.0, [0.0, 1.0], [0.0, 0.0]), "of 2 layers"),
    ],
)
def test_what_has_no_derivative_is_refused_in_a_sentence(scene, asked, said):
    with pytest.raises(vrte.SceneError, match=said) as caught:
        vrte.brdf(scene, MU_I, MU_O, nodes=4, derivatives=asked)
    assert caught.value.place[:1] == ("derivatives",)


CONTENT = {
    "nodes": 4,
    "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 0.5}],
    "base": {"kind": "lambertian", "albedo": 0.3},
    "brdf": {"mu_i": [0.2, 0.9], "mu_o": [0.3, 0.7], "phi_deg": [0.0, 70.0]},
}

SCATTERING = {"derivatives": ["layer[1].coefficients[1].a1"], "nodes": 4}
DEVICE = "derivatives are found on the processor: .*, not 'opencl'"
SWEPT = {**CONTENT, "axes": {"depth": {"key": DEPTH, "values": [0.1, 0.2]}}}
VISIBLE = [0.4, 0.45, 0.5, 0.55, 0.6]
REFUSED = [
    ("derivatives are those of", lambda: differentiate(HAZE, BASE, method="single-scattering")),
    (DEVICE, lambda: differentiate(HAZE, BASE, backend="opencl")),
    (DEVICE, lambda: vrte.brdfs([HAZE, HAZE], 0.5, 0.5, nodes=4, backend="opencl", derivatives=[BASE])),
    (DEVICE, lambda: vrte.radiance(HAZE, 0.5, mu=0.5, nodes=4, backend="opencl", derivatives=[BASE])),
    (DEVICE, lambda: vrte.spectrum(CONTENT, [0.45], backend="opencl", derivatives=[BASE])),
    (DEVICE, lambda: vrte.plan("brdf", HAZE, 0.5, 0.5, nodes=4, backend="opencl", derivatives=[BASE])),
    (DEVICE, lambda: vrte.linearize(HAZE, 0.5, 0.5, nodes=4, backend="opencl")),
    ("derivatives are not for panels", lambda: vrte.appearance(CONTENT, [0.4, 0.5], derivatives=[BASE])),
    ("derivatives has no place in a file", lambda: vrte.export(CONTENT, "t.bsdf", VISIBLE, derivatives=[BASE])),
    (r'derivatives = \["base.albedo"\]: unknown key', lambda: vrte.sweep({**SWEPT, "derivatives": [BASE]})),
    ("not for single geometries", lambda: vrte.views(HAZE, 0.5, 0.5, nodes=4, derivatives=[BASE])),
    ("derivatives is not asked for here", lambda: vrte.solve_base(HAZE, derivatives=[BASE])),
    ("for 1 derivative beside the light", lambda: differentiate(HAZE, BASE, time_limit_s=1e-5)),
    (r"scene 2 of 2: derivatives: layer\[1\]", lambda: vrte.brdfs([HAZE, CLEAR], MU_I, MU_O, **SCATTERING)),
    ("derivatives at 0.45 um: ", lambda: vrte.spectrum(CONTENT, [0.45], derivatives=["layer[2].albedo"])),
    (r"layer\[3\]", lambda: vrte.plan("brdf", GLOSSY, 0.5, 0.5, nodes=4, derivatives="layer[3].thickness")),
]


@pytest.mark.parametrize(("said", "call"), REFUSED)
def test_calls_that_have_no_derivatives_say_so(said, call):
    with pytest.raises(vrte.SceneError, match=said):
        call()


def test_fields_of_several_beams_and_of_fluxes_alone_have_derivatives():
    names, depths = [DEPTH, BASE], [0.0, 0.2, 0.5]
    found = vrte.radiance(HAZE, [0.4, 0.8], mu=[-0.5, 0.5], tau=depths, nodes=4, derivatives=names)
    assert not found.direct_jacobian[BASE].any()
    one = found.beam(1.0)  # type: ignore[arg-type]  # a whole number
    assert (one.jacobian[DEPTH] == found.jacobian[DEPTH][1]).all()
    assert "2 derivatives" in repr(one)
    fluxes = vrte.radiance(HAZE, 0.8, mu=[], tau=depths, nodes=4, derivatives=names)
    assert fluxes.jacobian[BASE].shape == (3, 0, 1, 4)
    assert_close(fluxes.flux_up_jacobian[BASE], one.flux_up_jacobian[BASE], rtol=1e-9, atol=0.0)


def test_a_spectrum_has_the_same_derivatives_everywhere():
    found = vrte.spectrum(CONTENT, [0.45, 0.6], derivatives=BASE)
    plain = vrte.spectrum(CONTENT, [0.6])
    assert found.jacobian[BASE].shape == (2, 2, 2, 2, 4, 4)
    assert found.at([0.6]).jacobian[BASE].shape[0] == 1
    with pytest.raises(vrte.SceneError, match="must all have the same derivatives"):
        vrte.Spectrum([0.45, 0.6], [found[0], plain[0]])


@pytest.mark.slow
def test_a_picture_has_cuts_of_derivatives_below_the_lobes():
    found = vrte.brdf(HAZE, [0.4, 0.9], [0.2, 0.6, 1.0], np.arange(0, 360, 60), nodes=4, derivatives=[DEPTH, BASE])
    below = found.plot().axes[4:6]  # two lobes and their cuts are above
    largest = [np.abs(line.get_ydata()).max() for panel in below for line in panel.lines[1:3]]
    assert max(largest) == close_to(1.0, rtol=1e-6, atol=0.0)


def test_a_plan_tells_how_derivatives_are_found_and_what_they_take():
    names = ["layer[2].thickness", "interface[1].index"]
    found = vrte.plan("brdf", GLOSSY, 0.5, 0.5, nodes=4, derivatives=names)
    facts, plain = found.as_dict(), vrte.plan("brdf", GLOSSY, 0.5, 0.5, nodes=4).as_dict()
    solved = vrte.brdf(GLOSSY, 0.5, 0.5, nodes=4, derivatives=names)
    assert facts["derivatives"] == solved.diagnostics["derivatives"]
    assert facts["operations"] == plain["operations"]
    assert facts["operations_of_derivatives"] > facts["operations"]
    assert "operations_of_derivatives" not in plain
    assert "- layer[2].thickness: algebra" in str(found)
    assert "Predicted for derivatives: " in str(found)
