"""Derivatives: closed forms; numbers of scenes against differences of solves; adjoints as transposes; functions in ball
arithmetic. Sixty scenes in ball arithmetic: tests/test_oracle.py."""

import time
from dataclasses import fields
from typing import Any

import flint
import numpy as np
import pytest

import vrte
from bench import other_codes
from vrte.basics.differences import sample_around
from vrte.discrete_ordinates.derivatives import adjoint, semi_infinite
from vrte.discrete_ordinates.derivatives import differentiate as differentiating
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.derivatives.functions import Decay
from vrte.discrete_ordinates.derivatives.real_slab import RealSlab
from vrte.discrete_ordinates.derivatives.slab import Faces, SlabModes, step_aside
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.request.request import make_brdf_request
from vrte.scene.vary import vary_scene

from .helpers import assert_close, close_to
from .random_scenes import surfaced
from .samples import slow_but
from .scenes import COMPARED, KNOWN

MU_I, MU_O, PHI, NODES = (0.15, 0.6), (0.35, 0.8), (20.0, 140.0), 4
RAYLEIGH, HG, PEAKED = vrte.rayleigh(), vrte.henyey_greenstein(0.75, 40), vrte.henyey_greenstein(0.6, 80)
SPHERES = vrte.spheres(1.7 + 0.02j, wavelength_um=0.5, radius_um=0.08).phase_matrix
SCALAR = vrte.henyey_greenstein(0.4, 6)
NEARLY_SCALAR = vrte.PhaseMatrix(*(HG.coefficients + 1e-5 * (np.arange(40) == 5)[:, None] * np.eye(6)[2]).T)
GLASS, GREY = vrte.Interface(1.0, 1.5), vrte.Lambertian(0.3)
HAZE = vrte.Layer(RAYLEIGH, 0.9, 0.5)


STEP = 2.0**-8
Values = list[np.ndarray]


# Closed forms.

SLANT, PRODUCT = np.add.outer(1.0 / np.array(MU_I), 1.0 / np.array(MU_O)), np.multiply.outer(MU_I, MU_O)
COSINE = -PRODUCT[..., None] + np.sqrt(
    np.multiply.outer(1.0 - np.square(MU_I), 1.0 - np.square(MU_O))[..., None]
) * np.cos(np.radians(PHI))
CLEAR = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.0, thickness=0.5)], GREY)
BEER = np.exp(-0.5 * SLANT) / np.pi
THIN, ONCE = vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 1e-7)]), 1e-7 / (4.0 * np.pi * PRODUCT)
CLOSED = {
    "Beer's law": (CLEAR, "layer[1].thickness", -0.3 * SLANT * BEER, 1e-9),
    "a base under a clear layer": (CLEAR, "base.albedo", BEER, 1e-11),
    "a base under nothing": (
        *(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 0.0)], vrte.Lambertian(1.0)), "base.albedo"),
        *(np.full((2, 2), 1.0 / np.pi), 1e-12),
    ),
    "a layer that begins": (
        *(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.8, 0.0)]), "layer[1].thickness", 0.8e7 * ONCE, 1e-8),
    ),
    "light scattered once": (THIN, "layer[1].albedo", ONCE[..., None] * (0.75 + 0.75 * COSINE**2), 1e-5),
    "a coefficient": (THIN, "layer[1].coefficients[2].a1", ONCE[..., None] * (1.5 * COSINE**2 - 0.5), 1e-5),
}


@pytest.mark.parametrize("title", CLOSED)
def test_closed_forms(title: str) -> None:
    scene, name, expected, rtol = CLOSED[title]
    found = vrte.brdf(scene, MU_I, MU_O, PHI, nodes=NODES, derivatives=[name])
    right = expected if expected.ndim == 3 else np.repeat(expected[..., None], 2, axis=2)
    assert_close(found.jacobian[name][..., 0, 0], right, rtol=0.0, atol=rtol * np.abs(right).max())
    assert found.diagnostics["derivatives"].keys() == {name}
    if scene is not THIN:
        assert not found.jacobian[name][..., 1:, :].any()
    if title == "a base under nothing":
        assert_close(found.reflectance_jacobian[name], 1.0, rtol=1e-11, atol=0.0)


def test_surfaces_mirror_with_derivatives() -> None:
    """((n - 1)/(n + 1))^2 at normal incidence, and beams through an absorbing film."""
    name, depth = "interface[1].index", "layer[2].thickness"
    for index in (1.5, 1.01):
        surface = vrte.Scene([vrte.Interface(1.0, index), HAZE])
        straight = vrte.brdf(surface, 1.0, 0.5, nodes=4, derivatives=[name])
        slope = 4.0 * (index - 1.0) / (index + 1.0) ** 3
        assert straight.specular_jacobian[name][0, 0, 0] == close_to(slope, rtol=1e-9, atol=0.0)
        assert straight.diagnostics["derivatives"][name] == "algebra"
    film = vrte.brdf(vrte.Scene([GLASS, HAZE], GREY), MU_I, MU_O, nodes=4, derivatives=[depth], transmission=True)
    inside = np.sqrt(1.0 - (1.0 - np.square(MU_I)) / 1.5**2)
    by_depth = film.direct_transmittance_jacobian[depth]
    assert_close(by_depth, -film.direct_transmittance / inside, rtol=1e-9, atol=0.0)


# Differences of solves. Where those of two steps do not agree they tell nothing and are left out, and how many agree is
# asserted. Numbers at which the discrete problem has a kink are left out as well.


def solve(scene: vrte.Scene, kind: str, how: dict[str, Any], name: str | None = None) -> tuple[Values, Values, str]:
    """All numbers of a result, their derivatives with one of the scene, and how these were found."""
    names = [] if name is None else [name]
    if kind == "field":
        tau = [0.0, how["inside"], *([scene.thickness] if np.isfinite(scene.thickness) else [])]
        asked = {key: value for key, value in how.items() if key != "inside"}
        mu = [0.35, 0.8, -0.25, -0.7]
        field = vrte.radiance(scene, 0.6, (1.0, 0.4, -0.3, 0.2), mu, PHI, tau, derivatives=names, **asked)
        keys, found = ["flux_up", "flux_down", "direct"], field
        values, jacobians = [field.stokes], [field.jacobian]
    else:
        brdf = vrte.brdf(scene, MU_I, MU_O, PHI, derivatives=names, **how)
        keys, found = ["reflectance", "transmission", "direct_transmittance", "specular"], brdf
        values, jacobians = [brdf.mueller], [brdf.jacobian]
    there = [key for key in keys if getattr(found, key) is not None]
    values += [getattr(found, key) for key in there]
    jacobians += [getattr(found, f"{key}_jacobian") for key in there]
    reported = found.diagnostics.get("derivatives", {}).get(name, "")
    return values, [one[name] for one in jacobians] if name else [], reported


def find_step(name: str, value: float) -> float:
    """Of the number of that name, from its value."""
    if name.endswith("thickness"):
        return STEP * min(value + 0.1, 1.0)
    if name.startswith("layer") and name.endswith("albedo"):
        return STEP * (min(1.0 - value, 0.1) if value < 1.0 else 0.01)
    if "coefficients" in name:
        return STEP
    return STEP * 0.1 if name.endswith("index") else STEP * max(abs(value), 0.05)


def differentiate(scene: vrte.Scene, kind: str, how: dict[str, Any], name: str, step: float) -> Values:
    """By differences of solves at five points."""
    variation = vary_scene(scene, name)
    made = sample_around(variation.scene_at, variation.value, step)
    found = [(weight, solve(moved, kind, how)[0]) for weight, moved in made]
    return [sum(weight * values[k] for weight, values in found) for k in range(len(found[0][1]))]


def check_number(scene: vrte.Scene, kind: str, how: dict[str, Any], name: str, algebra: bool = False) -> int:
    """How many arrays of derivatives with a number were compared; ``algebra``: whether they are to come from it. The
    light is what it is without derivatives."""
    values, jacobians, reported = solve(scene, kind, how, name)
    assert reported == "algebra" or not algebra, (name, reported)
    step, compared = find_step(name, vary_scene(scene, name).value), 0
    plain = solve(scene, kind, how)[0]
    far, near = (differentiate(scene, kind, how, name, part * step) for part in (1.0, 0.5))
    for index, (got, one, right, value) in enumerate(zip(jacobians, far, near, values, strict=True)):
        largest = np.abs(value).max(initial=0.0)
        assert_close(value, plain[index], rtol=0.0, atol=1e-12 * largest)
        size, difference = np.abs(right).max(initial=0.0), np.abs(one - right).max(initial=0.0)
        rounding = 1e-13 * largest / step
        assert np.isfinite(got).all(), name
        if difference <= 1e-4 * size + rounding:
            compared += 1
            assert np.abs(got - right).max(initial=0.0) <= 1e-6 * size + 20.0 * difference + rounding, (name, index)
    return compared


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_derivatives_of_a_scene_drawn_by_chance(seed: int) -> None:
    scene, kind = surfaced(np.random.default_rng(seed)), ("brdf", "field")[seed % 2]
    layers = [f"layer[{at + 1}]" for at in scene.places if at is not None]
    names = [f"{one}.{key}" for one in layers for key in ("thickness", "albedo", "coefficients[2].a1")]
    names += ["base.albedo"] if scene.base is not None else []
    names += ["interface[1].index"] if scene.has_interfaces else []
    names += ["interface[1].roughness"] if any(one and not one.is_smooth for one in scene.interfaces[:1]) else []
    how = {"nodes": NODES, "accuracy": 1e-13, "threads": 1, "truncation": ("auto", "delta-m", "none")[seed % 3]}
    how |= {"inside": 0.3 * min(scene.layers[0].thickness, 2.0)} if kind == "field" else {"transmission": False}
    assert sum(check_number(scene, kind, how, name) for name in names) >= len(names)


CHOSEN: dict[str, tuple[vrte.Scene, list[str]]] = {
    "one layer": (vrte.Scene([vrte.Layer(SPHERES, 0.9, 0.7)]), ["layer[1].thickness", "layer[1].coefficients[3].a4"]),
    "two over a base": (
        vrte.Scene([vrte.Layer(SPHERES, 0.9, 0.7), vrte.Layer(RAYLEIGH, 0.8, 1.5)], vrte.Lambertian(0.4)),
        ["layer[2].thickness", "layer[1].albedo", "layer[1].coefficients[2].b2", "base.albedo"],
    ),
    "semi-infinite": (
        vrte.Scene([vrte.Layer(SPHERES, 0.9, 0.5), vrte.Layer(RAYLEIGH, 0.8, np.inf)]),
        ["layer[1].thickness", "layer[2].albedo", "layer[2].coefficients[2].a1"],
    ),
    "peak cut off": (
        vrte.Scene([vrte.Layer(PEAKED, 0.9, 2.0)], GREY),
        ["layer[1].albedo", "layer[1].coefficients[3].a1"],
    ),
    "under a surface": (
        KNOWN["varnish over paint"],
        ["layer[2].thickness", "layer[2].albedo", "layer[2].coefficients[2].b1", "base.albedo", "interface[1].index"],
    ),
    "plate": (
        KNOWN["gap of air in glass"],
        ["layer[2].thickness", "layer[2].coefficients[2].a3", "interface[1].index"],
    ),
    "a peak under a surface": (vrte.Scene([GLASS, vrte.Layer(PEAKED, 0.9, 2.0)], GREY), ["interface[1].index"]),
    "facets": (
        COMPARED["rough sea"],
        ["layer[3].thickness", "layer[1].albedo", "layer[3].albedo", "interface[1].roughness", "interface[1].index"],
    ),
    "a rough face": (
        vrte.Scene([vrte.Interface(1.0, 1.4, 0.3, conserving=False), HAZE]),
        ["interface[1].roughness"],
    ),
    "more nodes than asked for": (
        vrte.Scene(
            [vrte.Interface(1.0, 1.3), vrte.Layer(vrte.henyey_greenstein(0.3, 6), 0.9, 0.3), vrte.Interface(1.3, 1.1)]
        ),
        ["layer[2].thickness", "layer[2].albedo", "layer[2].coefficients[2].a1"],
    ),
    "a layer that scatters nothing": (
        vrte.Scene([vrte.Layer(RAYLEIGH, 0.0, 0.5), vrte.Layer(SCALAR, 0.9, 1.0)]),
        ["layer[1].albedo", "layer[1].thickness", "layer[2].albedo"],
    ),
    "facets under a surface": (
        vrte.Scene([vrte.Interface(1.0, 1.3), vrte.Layer(RAYLEIGH, 0.9, 1.0)], vrte.Facets(0.4, 1.5)),
        ["base.roughness", "base.index.n", "layer[2].albedo"],
    ),
    "a peak that scatters nothing": (vrte.Scene([vrte.Layer(HG, 0.0, 0.5)], vrte.Lambertian(0.4)), ["layer[1].albedo"]),
    "a white layer": (
        vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 0.8), vrte.Layer(HG, 0.9, np.inf)]),
        ["layer[1].albedo", "layer[2].coefficients[8].a2"],
    ),
    "I was scattered alone": (
        vrte.Scene([vrte.Layer(SCALAR, 0.9, 1.0)]),
        ["layer[1].coefficients[2].b1"],
    ),
    "V was scattered apart": (vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1.0)], GREY), ["layer[1].coefficients[2].b2"]),
    "nearly scalar": (vrte.Scene([vrte.Layer(NEARLY_SCALAR, 0.9, 0.6)], GREY), ["layer[1].coefficients[5].a2"]),
    "RPV": (COMPARED["soil under air"], ["base.k"]),
    "Hapke": (vrte.Scene([HAZE], vrte.Hapke(0.4)), ["base.albedo"]),
    "Ross-Li": (vrte.Scene([HAZE], vrte.RossLi(0.2, 0.1, 0.0)), ["base.f_vol"]),
    "a base that polarizes": (COMPARED["leaf"], ["layer[1].thickness"]),
    "a metal": (KNOWN["mirror"], ["base.index.k"]),
    "a rough metal": (
        vrte.Scene([HAZE], vrte.Facets((0.2, 3.0), 0.3, "ggx", shadowing=True, conserving=True)),
        ["base.roughness"],
    ),
    "an absorber under a surface": (
        vrte.Scene([GLASS, vrte.Layer(SPHERES, 0.3, 30.0), vrte.Layer(RAYLEIGH, 0.9, 1.0)], GREY),
        ["interface[1].index", "layer[3].index"],
    ),
}


@pytest.mark.parametrize("title", CHOSEN)
def test_derivatives_of_a_chosen_scene(title: str) -> None:
    scene, names = CHOSEN[title]
    is_open = scene.base is None and bool(np.isfinite(scene.thickness))
    how = {"nodes": NODES, "accuracy": 1e-13, "threads": 1, "truncation": "delta-m", "transmission": is_open}
    assert sum(check_number(scene, "brdf", how, name, algebra=True) for name in names) >= len(names)


@pytest.mark.parametrize(
    ("title", "kind"),
    [
        ("two over a base", "field"),
        ("facets", "field"),
        ("under a surface", "field"),
        ("a peak under a surface", "field"),
        ("a metal", "field"),
        ("one layer", "bottom"),
        ("a rough face", "bottom"),
    ],
)
def test_derivatives_inside_and_from_below(title: str, kind: str) -> None:
    scene, names = CHOSEN[title]
    how = {"nodes": NODES, "accuracy": 1e-13, "inside": 0.2} if kind == "field" else {"nodes": NODES, "accuracy": 1e-13}
    how |= {"illuminate": "bottom", "transmission": True} if kind == "bottom" else {}
    assert sum(check_number(scene, kind, how, name) for name in names) >= len(names)


@pytest.mark.parametrize("kind", ["brdf", "field"])
@pytest.mark.parametrize("title", ["under a surface", "more nodes than asked for", "an absorber under a surface"])
def test_an_index_by_the_algebra_is_right_to_1e_8(title: str, kind: str) -> None:
    scene, name = CHOSEN[title][0], "interface[1].index"
    how = {"nodes": 6, "accuracy": 1e-13, "threads": 1} | ({"inside": 0.2} if kind == "field" else {})
    _, jacobians, reported = solve(scene, kind, how, name)
    assert reported == "algebra"
    expected = differentiate(scene, kind, how, name, 2.0**-11)
    for got, right in zip(jacobians, expected, strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-8 * np.abs(right).max(initial=0.0))


def test_media_that_part_and_interfaces_that_come_are_no_matter_of_the_algebra() -> None:
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), HAZE, vrte.Interface(1.5, 1.0)])
    found = vrte.brdf(scene, MU_I, MU_O, nodes=4, derivatives=["interface[2].index"])
    assert "two media of one index part" in found.diagnostics["derivatives"]["interface[2].index"]

    def roughen(roughness: float) -> vrte.Scene:
        return vrte.Scene([vrte.Interface(1.0, 1.5, roughness if roughness > 0.3 else 0.0), HAZE])

    edge = vrte.Variation("edge", 0.3, [0.0], [0.0], scene_at=roughen, is_outside=True)
    with_edge = choose_method(make_brdf_request(roughen(0.3), MU_I, MU_O, PHI, nodes=NODES))
    assert "comes or goes" in find_gap(plan_request(with_edge, make_run(with_edge)), edge)


# Adjoints, and parts of the algebra.


@pytest.mark.parametrize("half", [1e-6, 0.3, 40.0, 5e3])
def test_divided_differences_keep_their_digits(half: float) -> None:
    points = np.array([1e-9, 1e-9 * (1.0 + 1e-7), 1e-3, 0.4, 0.4, 0.41, 0.45, 3.0, 1e3, 1.05e3])
    f, g, c = (part[0] for part in Decay(half).divide(points[None], points[None], True))
    complex_ = Decay(half).divide(points[None] + 0j, points[None], True)
    for real, other in zip((f, g, c), complex_, strict=True):
        assert_close(other[0].imag, 0.0, rtol=0.0, atol=0.0)
        assert_close(other[0].real, real, rtol=2e-12, atol=1e-300)
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
                decays = [1 / flint.arb.cosh(flint.arb(half) * p.sqrt()) ** 2 for p in (x, y)]
                expected = (decays[0] - decays[1]) / (x - y)
                assert c[i, k] == close_to(float(expected.mid()), rtol=1e-12, atol=1e-300)
    finally:
        flint.ctx.prec = 53


def test_a_direction_on_a_mode_is_stepped_around() -> None:
    lam = np.array([1.0, 4.0, 9.0])
    aside = step_aside(np.array([0.5, 0.6]), lam, 2)
    assert aside.rate.size == 14
    smooth = (np.exp(-aside.rate) * aside.share)[None, :, None]  # what is interpolated is as smooth as this
    assert np.abs(aside.gather(smooth, 4)[0, :, 0] - np.exp([-2.0, -2.0, -1.0 / 0.6, -1.0 / 0.6])).max() < 1e-12
    assert (np.abs(lam[:, None] - aside.rate**2) > 1e-2).all()


# by scene: layers, base, nodes, cosines; 0.9916... is that of a mode
SLABS: dict[str, tuple[list[vrte.Layer], vrte.Lambertian | None, tuple[float, ...]]] = {
    "two layers": ([HAZE, vrte.Layer(SPHERES, 0.95, 4.0)], GREY, (0.2, 0.7)),
    "an interface": ([GLASS, HAZE, vrte.Layer(PEAKED, 1.0, 4.0)], GREY, (0.2, 0.7)),
    "semi-infinite": ([HAZE, vrte.Layer(SPHERES, 0.9, np.inf)], None, (0.2, 0.7)),
    "absorbing": ([vrte.Layer(RAYLEIGH, 0.2, 20.0)], None, (0.2, 0.7)),
    "absorbing, a cosine on a mode": ([vrte.Layer(RAYLEIGH, 0.2, 20.0)], None, (0.6, 0.9916877394597053)),
}


@pytest.mark.parametrize("title", SLABS)
def test_compiled_slabs_do_what_slabs_in_numpy_do(title: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each slab what it makes of light, what random changes of its matrices make of it, and the transpose."""
    layers, base, mu = SLABS[title]
    random, compared, list_terms = np.random.default_rng(3), list[int](), RealSlab.list_terms

    def agree(one: np.ndarray, other: np.ndarray) -> bool:
        return bool(np.abs(one - other).max() <= 1e-10 * max(np.abs(other).max(), 1e-300))

    def compare(slab: RealSlab, light: Faces, weights: Faces) -> dict[str, np.ndarray]:
        terms, known, lit = list_terms(slab, light, weights), slab.known, light.above.shape[2]
        matrices = Assembled(**{name: known[name] for name in vars_of(Assembled)})
        modes = Modes(**{name: known[name] for name in vars_of(Modes)})
        changed = {name: random.standard_normal(part[:, :1].shape) for name, part in vars(matrices).items()}
        weighed = random.standard_normal((len(light.above), weights.above.shape[2], lit))
        found = slab.change(terms, Assembled(**changed))
        pulled = slab.pull(terms, weighed)
        for m in range(len(light.above)):
            at = slice(m, m + 1)
            own = [
                Kind(**{name: part[at] for name, part in vars(one).items()})
                for Kind, one in ((Assembled, matrices), (Modes, modes))
            ]
            other = SlabModes(slab.one, *own, known["layer"], 2.0 * known["half"])
            faces = [Faces(one.above[at], one.below[at], one.falling, one.rising) for one in (light, weights)]
            parts = other.list_terms(*faces)
            if other.is_dim != (slab.parts == 6):
                continue  # the slowest mode of all orders says which formula is taken
            change = Assembled(**{name: part[at] for name, part in changed.items()})
            assert all(agree(one[at], two) for one, two in zip(slab.respond(), other.respond(), strict=True)), m
            assert agree(found[at], other.change(parts, change)), m
            assert all(agree(one[at], two) for one, two in zip(pulled, other.pull(parts, weighed[at]), strict=True)), m
            compared.append(slab.parts)
        return terms

    monkeypatch.setattr(RealSlab, "list_terms", compare)
    scene = vrte.Scene(layers, base)
    name = f"layer[{len(layers)}].albedo" if layers[-1].albedo < 1.0 else "layer[2].albedo"
    vrte.brdf(
        scene, mu, mu, PHI, nodes=8, derivatives=[name], threads=1, transmission=not np.isinf(layers[-1].thickness)
    )
    assert set(compared) == {1 if "semi" in title else 6 if "absorbing" in title else 2}


def vars_of(kind: type) -> list[str]:
    """The fields of a dataclass."""
    return [field.name for field in fields(kind)]


def test_what_has_no_derivative_by_the_algebra() -> None:
    def plan(scene: vrte.Scene, **how: Any) -> Any:
        asked = choose_method(make_brdf_request(scene, MU_I, MU_O, PHI, nodes=NODES, accuracy=1e-11, **how))
        return plan_request(asked, make_run(asked)), make_run(asked)

    white, run = plan(vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, np.inf)]))
    for variation, words in (
        (vrte.Variation("layer[1].albedo", 1.0, [0.0], [1.0]), "infinite"),
        (vrte.Variation("depth", 1.0, [1.0], [0.0]), "no end"),
    ):
        with pytest.raises(vrte.SceneError, match=words):
            differentiate_plan(white, [variation], run)
    peaked, _ = plan(CHOSEN["peak cut off"][0], transmission=True)
    assert "forward peak" in find_gap(peaked, vrte.Variation("depth", 2.0, [1.0], [0.0]))


def make_variations(scene: vrte.Scene) -> list[vrte.Variation]:
    """Of each layer's thickness, albedo and coefficients, all that there is at once, and of a Lambertian base."""
    rng, count = np.random.default_rng(3), len(scene.layers)
    still, found = np.zeros(count), []
    for k, layer in enumerate(scene.layers):
        unit = np.eye(count)[k]
        if np.isfinite(layer.thickness):
            found.append(vrte.Variation("thickness", 1.0, unit, still))
        if layer.albedo:
            table = layer.phase_matrix.coefficients * rng.uniform(-0.1, 0.1, (layer.phase_matrix.terms, 6))
            table[0, 0] = 0.0
            tables = [np.zeros((0, 6))] * count
            tables[k] = table
            found.append(vrte.Variation("scattering", 1.0, still, 0.3 * unit, tuple(tables)))
    if isinstance(scene.base, vrte.Lambertian):
        found.append(vrte.Variation("base", 0.4, still, still, base=((1.0, vrte.Lambertian(1.0)),)))
    return found


ADJOINT = ("two over a base", "peak cut off", "facets", "more nodes than asked for")


@pytest.mark.parametrize("name", slow_but(tuple(CHOSEN)[:10], *ADJOINT))
def test_the_adjoint_is_the_transpose(name: str) -> None:
    (scene, _), rng = CHOSEN[name], np.random.default_rng(5)
    found = vrte.linearize(scene, mu_i=[0.3, 1.0], mu_o=[0.2, 0.9, 0.9], phi=[20.0, 150.0], nodes=4, accuracy=1e-9)
    weights = rng.standard_normal(found.brdf.mueller.shape)
    gradient = found.vjp(weights)
    for variation in make_variations(scene):
        changed = found.jvp(variation) * weights
        assert abs(gradient.along(variation) - changed.sum()) < 1e-12 * np.abs(changed).sum(), variation.name
        assert np.abs(changed).sum() > 1e-6


@pytest.mark.parametrize("allowed", [1e-9, -1.0])
def test_invariance_finds_what_modes_find(allowed: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tangent and the adjoint of the invariance equation; none of its orders is verified below 0, and all go
    through slabs."""
    for module in (differentiating, adjoint):
        monkeypatch.setattr(module, "find_allowed_residuals", lambda accuracy: {"residual_of_invariance": allowed})
    rng = np.random.default_rng(3)
    scene = vrte.Scene([vrte.Layer(SPHERES, 0.9, np.inf)])
    asked = {"mu_i": [0.3, 1.0], "mu_o": [0.2, 0.3, 0.9], "phi": [20.0, 150.0], "nodes": 8, "accuracy": 1e-12}
    ways = [vrte.linearize(scene, algorithm=name, **asked) for name in ("invariance", "modes")]
    assert "invariance" in ways[0].brdf.diagnostics["orders_by"]
    weights = rng.standard_normal(ways[0].brdf.mueller.shape)
    for variation in make_variations(scene):
        got, right = (way.jvp(variation) for way in ways)
        assert np.abs(got - right).max() < 1e-11 * np.abs(right).max()
    got, right = (way.vjp(weights).coefficients[0] for way in ways)
    assert np.abs(got - right).max() < 1e-11 * np.abs(right).max()


def test_derivatives_take_what_the_light_has_found_by_invariance(monkeypatch: pytest.MonkeyPatch) -> None:
    """R of the light serves its derivatives, which are what they are without it."""
    recall, found = semi_infinite.recall_reflections, []

    def watch(*given: Any) -> Any:
        found.append(recall(*given))
        return found[-1]

    monkeypatch.setattr(semi_infinite, "recall_reflections", watch)
    scene, name = vrte.Scene([vrte.Layer(SPHERES, 0.9, np.inf)]), "layer[1].albedo"
    asked: Any = {"mu_i": [0.3, 1.0], "mu_o": [0.2, 0.9], "phi": [20.0], "nodes": 8, "algorithm": "invariance"}
    own = vrte.brdf(scene, derivatives=[name], **asked).jacobian[name]
    assert found
    assert all(one["kept_R"].any() for one in found)
    found.clear()
    assert_close(vrte.linearize(scene, **asked).jvp(name), own, rtol=0.0, atol=1e-13 * np.abs(own).max())
    assert found
    assert not any(found)


def test_very_many_terms_are_pulled_back_in_closed_form() -> None:
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


def test_the_jacobians_of_sasktran2_are_the_same() -> None:
    """Three layers at 16 streams: thickness, albedo, coefficients, base. Each layer has all degrees up to the last:
    where one ends earlier, sasktran2's own coefficients are 5e-4 off its own differences."""
    pytest.importorskip("sasktran2")
    few = vrte.henyey_greenstein(0.1, 14)
    layers = [
        vrte.Layer(vrte.mix([(RAYLEIGH, share), (few, 1.0 - share)]), albedo, thickness)
        for share, albedo, thickness in ((0.8, 0.9, 0.3), (0.4, 0.95, 0.8), (0.6, 0.8, 0.5))
    ]
    scene, mu, phi = vrte.Scene(layers, GREY), np.array([0.2, 0.5, 0.9]), np.array([0.0, 60.0, 150.0])
    asked = other_codes.Asked(scene, 0.6, np.array([np.pi, 0.0, 0.0, 0.0]), mu, phi, np.zeros(1))
    peer = other_codes.list_sasktran2_jacobians(asked, 16)
    keys = ["thickness", "albedo", *(f"coefficients[{l}].{name}" for l in (2, 5) for name in other_codes.COEFFICIENTS)]
    names = [f"layer[{k}].{key}" for k in (1, 2, 3) for key in keys] + ["base.albedo"]
    how: Any = {"mu": mu, "phi": phi, "tau": [0.0], "nodes": 8, "stokes": asked.stokes}
    found = vrte.radiance(scene, asked.mu0, derivatives=names, **how).jacobian
    for name in names:
        own = found[name][0, ..., :3]
        assert np.abs(own).max() > 1e-6
        assert_close(peer[name], own, rtol=0.0, atol=5e-10 * np.abs(own).max())


def test_eyes_where_the_lights_are_change_nothing() -> None:
    scene, rng = CHOSEN["under a surface"][0], np.random.default_rng(7)
    weights = rng.standard_normal((2, 2, 1, 4, 4))
    how = {"phi": 20.0, "nodes": 4}
    same = vrte.linearize(scene, mu_i=[0.3, 0.8], mu_o=[0.3, 0.8], **how).vjp(weights)
    wider = np.zeros((2, 3, 1, 4, 4))
    wider[:, :2] = weights
    apart = vrte.linearize(scene, mu_i=[0.3, 0.8], mu_o=[0.3, 0.8, 0.5], **how).vjp(wider)
    assert np.abs(same.coefficients[0] - apart.coefficients[0]).max() < 1e-11 * np.abs(same.coefficients[0]).max()
    assert abs(same.albedo[0] - apart.albedo[0]) < 1e-11 * abs(same.albedo[0])


def test_weights_of_another_shape_are_refused() -> None:
    found = vrte.linearize(CHOSEN["one layer"][0], mu_i=0.3, mu_o=0.5, nodes=4)
    with pytest.raises(vrte.SceneError, match="must have the shape"):
        found.vjp(np.ones((2, 2)))
    with pytest.raises(vrte.SceneError, match="finite"):
        found.vjp(np.full((1, 1, 1, 4, 4), np.nan))


def test_a_gradient_says_what_it_does_not_know() -> None:
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
    surfaced = vrte.Scene([GLASS, *scene.layers])
    found = vrte.linearize(surfaced, mu_i=0.3, mu_o=0.5, nodes=4).vjp(np.ones((1, 1, 1, 4, 4)))
    with pytest.raises(vrte.SceneError, match="knows no surfaces"):
        found.along(vary_scene(surfaced, "interface[1].index"))
