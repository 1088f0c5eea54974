"""Derivatives of piles: against differences of solves; the adjoint as a transpose; functions in ball arithmetic."""

import time
from dataclasses import replace

import flint
import numpy as np
import pytest

import vrte
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.derivatives.functions import Decay
from vrte.discrete_ordinates.derivatives.slab import step_aside
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.request.request import make_brdf_request

from .helpers import close_to

MU, PHI, NODES = [0.3, 0.9, 1.0], [0.0, 50.0, 180.0], 4
SPHERES = vrte.spheres(1.7 + 0.02j, wavelength_um=0.5, radius_um=0.08).phase_matrix
PEAKED = vrte.henyey_greenstein(0.6, 80)
COAT = vrte.Interface(1.0, 1.5)


def make_layer(phase=SPHERES, albedo=0.9, thickness=0.7):
    return vrte.Layer(phase, albedo, thickness)


SCENES = {
    "one layer": vrte.Scene([make_layer()]),
    "two over a base": vrte.Scene([make_layer(), make_layer(vrte.rayleigh(), 0.8, 1.5)], vrte.Lambertian(0.4)),
    "endless": vrte.Scene([make_layer(thickness=0.5), make_layer(vrte.rayleigh(), 0.8, np.inf)]),
    "peak cut off": vrte.Scene([make_layer(PEAKED, 0.9, 2.0)], vrte.Lambertian(0.3)),
    "under a surface": vrte.Scene([make_layer()], vrte.Lambertian(0.3), [COAT, None]),
    "plate": vrte.Scene([make_layer()], interfaces=[COAT, vrte.Interface(1.5, 1.0)]),
    "facets": vrte.Scene([make_layer(vrte.rayleigh())], vrte.Lambertian(0.3), [replace(COAT, roughness=0.4), None]),
    "more nodes than asked for": vrte.Scene(
        [make_layer(vrte.henyey_greenstein(0.3, 6), 0.9, 0.3)],
        interfaces=[vrte.Interface(1.0, 1.3), vrte.Interface(1.3, 1.1)],
    ),
    "clear": vrte.Scene([make_layer(albedo=0.0), make_layer()], vrte.Lambertian(0.5)),
    "facets below": vrte.Scene([make_layer(vrte.rayleigh(), 0.8, 0.6)], vrte.Facets(0.4, 1.5)),
}


def make_request(scene, **how):
    given = {"nodes": NODES, "accuracy": 1e-11, "phi": PHI, "mu_i": MU, "mu_o": MU, **how}
    defaults = {
        "threads": 1, "transmission": False, "progress": None, "algorithm": None, "verify": None, "truncation": None,
        "backend": None, "method": "discrete-ordinates", "settings": None, "illuminate": "top", "time_limit_s": None,
    }  # fmt: skip
    return choose_method(make_brdf_request(scene=scene, **(defaults | given)))


def differentiate_request(request, variations):
    run = make_run(request)
    return differentiate_plan(plan_request(request, run), variations, run)


def make_variations(scene):
    """Of each layer's thickness, albedo and coefficients, all that there is at once."""
    rng, count = np.random.default_rng(3), len(scene.layers)
    found = []
    for k, layer in enumerate(scene.layers):
        unit = np.eye(count)[k]
        if np.isfinite(layer.thickness):
            found.append(vrte.Variation("thickness", 1.0, unit, np.zeros(count)))
        if layer.albedo:
            table = layer.phase_matrix.coefficients * rng.uniform(-0.1, 0.1, (layer.phase_matrix.terms, 6))
            table[0, 0] = 0.0
            tables = [np.zeros((0, 6))] * count
            tables[k] = table
            found.append(vrte.Variation("scattering", 1.0, np.zeros(count), 0.3 * unit, tuple(tables)))
    return found


def move_scene(scene, variation, h):
    layers = []
    for k, layer in enumerate(scene.layers):
        table = layer.phase_matrix.coefficients + 0.0
        change = variation.coefficients[k]
        table[: change.shape[0]] += h * change
        albedo, thickness = layer.albedo + h * variation.albedo[k], layer.thickness + h * variation.thickness[k]
        layers.append(replace(layer, phase_matrix=vrte.PhaseMatrix(*table.T), albedo=albedo, thickness=thickness))
    return replace(scene, layers=layers)


def difference(function, h):
    """Of fourth order."""
    far, near = function(2.0 * h) - function(-2.0 * h), function(h) - function(-h)
    return (8.0 * near - far) / (12.0 * h)


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_are_what_differences_of_solves_tend_to(name):
    scene, mu = SCENES[name], np.array(MU)
    ends = name == "plate"
    request = make_request(scene, transmission=ends)
    variations = make_variations(scene)
    solutions = differentiate_request(request, variations)
    for variation, found in zip(variations, solutions, strict=True):

        def solve(h, variation=variation):
            how = {"mu_i": MU, "mu_o": MU, "phi": PHI, "nodes": NODES, "accuracy": 1e-11, "transmission": ends}
            solved = vrte.brdf(move_scene(scene, variation, h), **how)
            parts = [solved.mueller.ravel(), solved.reflectance]
            return np.concatenate(parts + ([solved.transmission.ravel()] if ends else []))

        parts = [found.parts[0][0].ravel(), found.flux_up[0, :, 0] / mu]
        got = np.concatenate(parts + ([found.parts[1][0].ravel()] if ends else []))
        expected = difference(solve, 3e-4)
        assert np.abs(got - expected).max() < 1e-8 * np.abs(expected).max(), variation.name
        assert np.abs(expected).max() > 1e-6


def test_the_base_changes_alone():
    scene = SCENES["two over a base"]
    request = make_request(scene)
    variation = vrte.Variation("base", 0.4, np.zeros(2), np.zeros(2), base=((1.0, vrte.Lambertian(1.0)),))
    (found,) = differentiate_request(request, [variation])
    how = {"mu_i": MU, "mu_o": MU, "phi": PHI, "nodes": NODES, "accuracy": 1e-11}
    expected = difference(lambda h: vrte.brdf(replace(scene, base=vrte.Lambertian(0.4 + h)), **how).mueller, 1e-3)
    assert np.abs(found.parts[0][0] - expected).max() < 1e-10


@pytest.mark.parametrize("half", [1e-6, 0.3, 40.0, 5e3])
def test_divided_differences_keep_their_digits(half):
    points = np.array([1e-9, 1e-9 * (1.0 + 1e-7), 1e-3, 0.4, 0.4, 0.41, 0.45, 3.0, 1e3, 1.05e3])
    f, g = Decay(half).divide(points)
    flint.ctx.prec = 300
    try:
        for i, a in enumerate(points.tolist()):
            for k, b in enumerate(points.tolist()):
                x, y = flint.arb(a), flint.arb(b)
                if a == b:
                    y = x * (1 + flint.arb(2) ** -100)
                values = [flint.arb.tanh(flint.arb(half) * p.sqrt()) / p.sqrt() for p in (x, y)]
                expected = (values[0] - values[1]) / (x - y)
                product = (x * values[0] - y * values[1]) / (x - y)
                assert f[i, k] == close_to(float(expected.mid()), rtol=1e-12, atol=0.0)
                assert g[i, k] == close_to(float(product.mid()), rtol=1e-12, atol=0.0)
    finally:
        flint.ctx.prec = 53


def test_a_direction_on_a_mode_is_stepped_around():
    lam = np.array([1.0, 4.0, 9.0])
    aside = step_aside(np.array([0.5, 0.6]), lam, 2)
    assert aside.rate.size == 14
    smooth = np.exp(-aside.rate)[None]  # what is interpolated is as smooth as this
    assert np.abs(aside.gather(smooth)[0] - np.exp([-2.0, -2.0, -1.0 / 0.6, -1.0 / 0.6])).max() < 1e-12
    assert (np.abs(lam[:, None] - aside.rate**2) > 1e-2).all()


def test_what_cannot_be_told_is_refused_or_named():
    endless = vrte.Scene([make_layer(vrte.rayleigh(), 1.0, np.inf)])
    request = make_request(endless)
    variation = vrte.Variation("layer[1].albedo", 1.0, [0.0], [1.0])
    with pytest.raises(vrte.SceneError, match="infinite"):
        differentiate_request(request, [variation])
    with pytest.raises(vrte.SceneError, match="no end"):
        differentiate_request(request, [vrte.Variation("depth", 1.0, [1.0], [0.0])])
    peaked = make_request(SCENES["peak cut off"], transmission=True)
    plan = plan_request(peaked, make_run(peaked))
    assert "small angles" in find_gap(plan, vrte.Variation("depth", 2.0, [1.0], [0.0]))


@pytest.mark.parametrize(
    "name",
    [
        "two over a base",
        "peak cut off",
        "facets",
        "more nodes than asked for",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("one layer", "endless", "under a surface", "plate", "clear")
        ),
    ],
)
def test_the_adjoint_is_the_transpose(name):
    scene, rng = SCENES[name], np.random.default_rng(5)
    found = vrte.linearize(scene, mu_i=[0.3, 1.0], mu_o=[0.2, 0.9, 0.9], phi=[20.0, 150.0], nodes=4, accuracy=1e-9)
    weights = rng.standard_normal(found.brdf.mueller.shape)
    gradient = found.vjp(weights)
    variations = make_variations(scene)
    if isinstance(scene.base, vrte.Lambertian):
        still = np.zeros(len(scene.layers))
        variations.append(vrte.Variation("base", 0.4, still, still, base=((1.0, vrte.Lambertian(1.0)),)))
    for variation in variations:
        expected = float((found.jvp(variation) * weights).sum())
        scale = np.abs(found.jvp(variation) * weights).sum()
        assert abs(gradient.along(variation) - expected) < 1e-12 * scale, variation.name
        assert scale > 1e-6


def test_very_many_terms_are_pulled_back_in_closed_form():
    """16,988 terms, each an order: one after another they did not end."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.997), 0.9, 2.0)], vrte.Lambertian(0.3))
    found = vrte.linearize(scene, mu_i=[0.3, 1.0], mu_o=[0.2, 0.9], phi=[0.0, 20.0, 150.0], nodes=4)
    weights = np.random.default_rng(5).standard_normal(found.brdf.mueller.shape)
    begin = time.process_time()
    gradient = found.vjp(weights)
    assert time.process_time() - begin < 5.0
    table = 0.1 * scene.layers[0].phase_matrix.coefficients
    table[0] = 0.0
    variation = vrte.Variation("all", 1.0, [0.5], [0.1], (table,))
    expected = found.jvp(variation) * weights
    assert abs(gradient.along(variation) - expected.sum()) < 1e-11 * np.abs(expected).sum()


def test_eyes_where_the_lights_are_change_nothing():
    scene, rng = SCENES["under a surface"], np.random.default_rng(7)
    weights = rng.standard_normal((2, 2, 1, 4, 4))
    how = {"phi": 20.0, "nodes": 4}
    same = vrte.linearize(scene, mu_i=[0.3, 0.8], mu_o=[0.3, 0.8], **how).vjp(weights)
    wider = np.zeros((2, 3, 1, 4, 4))
    wider[:, :2] = weights
    apart = vrte.linearize(scene, mu_i=[0.3, 0.8], mu_o=[0.3, 0.8, 0.5], **how).vjp(wider)
    assert np.abs(same.coefficients[0] - apart.coefficients[0]).max() < 1e-11 * np.abs(same.coefficients[0]).max()
    assert abs(same.albedo[0] - apart.albedo[0]) < 1e-11 * abs(same.albedo[0])


def test_weights_of_another_shape_are_refused():
    found = vrte.linearize(SCENES["one layer"], mu_i=0.3, mu_o=0.5, nodes=4)
    with pytest.raises(vrte.SceneError, match="must have the shape"):
        found.vjp(np.ones((2, 2)))
    with pytest.raises(vrte.SceneError, match="finite"):
        found.vjp(np.full((1, 1, 1, 4, 4), np.nan))


def test_modes_that_are_not_trusted_leave_it_to_differences(monkeypatch):
    asked = {"mu_i": 0.3, "mu_o": 0.5, "nodes": 4, "derivatives": ["layer[1].albedo"]}
    expected = vrte.brdf(SCENES["one layer"], **asked)
    assert expected.diagnostics["derivatives"] == {"layer[1].albedo": "algebra"}
    monkeypatch.setattr("vrte.discrete_ordinates.derivatives.differentiate.ALLOWED", 0.0)
    found = vrte.brdf(SCENES["one layer"], **asked)
    assert "differ by" in found.diagnostics["derivatives"]["layer[1].albedo"]
    gap = found.jacobian["layer[1].albedo"] - expected.jacobian["layer[1].albedo"]
    assert 0.0 < np.abs(gap).max() < 1e-8


@pytest.mark.slow
def test_orders_on_fewer_nodes_keep_their_peak():
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, 140), 0.97, 3.0)], vrte.Lambertian(0.2))
    how = {"mu_i": [0.4, 0.9], "mu_o": [0.3, 0.8], "phi": PHI, "nodes": 32, "accuracy": 1e-9}
    found = vrte.linearize(scene, **how)
    assert len({block.problem.nodes.size for block in found.plan.blocks}) > 1
    table = 0.3 * scene.layers[0].phase_matrix.coefficients  # the share of the peak changes with it
    table[0] = 0.0
    variation = vrte.Variation("all", 1.0, [0.5], [0.1], (table,))
    expected = difference(lambda h: vrte.brdf(move_scene(scene, variation, h), **how).mueller, 1e-3)
    assert np.abs(found.jvp(variation) - expected).max() < 1e-8 * np.abs(expected).max()


def test_a_gradient_says_what_it_does_not_know():
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.3, 8), 0.9, 1.0)])
    found = vrte.linearize(scene, mu_i=0.3, mu_o=0.5, nodes=4).vjp(np.ones((1, 1, 1, 4, 4)))
    assert np.isfinite(found.coefficients[0][:, 0]).all()
    assert np.isnan(found.coefficients[0][2:, 4]).all()
    table = np.zeros((8, 6))
    table[2, 4] = 0.1
    with pytest.raises(vrte.SceneError, match="jvp"):
        found.along(vrte.Variation("polarizing", 1.0, [0.0], [0.0], (table,)))
    longer = np.zeros((9, 6))
    longer[8, 0] = 0.1
    with pytest.raises(vrte.SceneError, match="jvp"):
        found.along(vrte.Variation("longer", 1.0, [0.0], [0.0], (longer,)))
