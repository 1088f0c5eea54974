"""Derivatives: closed forms; the numbers of scenes, chosen and drawn by chance, against differences of solves; adjoints
as transposes; functions in ball arithmetic. Sixty scenes in ball arithmetic: tests/test_oracle.py."""

import math
import time
from dataclasses import replace
from typing import Any

import flint
import numpy as np
import pytest

import vrte
from bench.cases import find_phase_matrix
from vrte.basics.differences import sample_around
from vrte.basics.errors import SceneError
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.derivatives.functions import Decay
from vrte.discrete_ordinates.derivatives.slab import step_aside
from vrte.discrete_ordinates.planning.plan import plan_request
from vrte.methods import choose_method, make_run
from vrte.request.request import make_brdf_request
from vrte.scene.vary import list_numbers, vary_scene

from .helpers import assert_close, close_to
from .samples import slow_but

MU_I, MU_O, PHI, NODES = (0.15, 0.6), (0.35, 0.8), (20.0, 140.0), 4
RAYLEIGH, HG, PEAKED = vrte.rayleigh(), vrte.henyey_greenstein(0.75, 40), vrte.henyey_greenstein(0.6, 80)
SPHERES = vrte.spheres(1.7 + 0.02j, wavelength_um=0.5, radius_um=0.08).phase_matrix
PHASES = {
    "isotropic": vrte.isotropic(),
    "rayleigh": RAYLEIGH,
    "depolarizing": vrte.rayleigh(0.3),
    "scalar": vrte.henyey_greenstein(0.4, 6),
    "scalar, peaked": HG,
    "backward": vrte.henyey_greenstein(-0.6, 30),
    "spheroids": find_phase_matrix("spheroids"),
    "haze, peaked": find_phase_matrix("haze-L"),
    "nearly scalar": vrte.PhaseMatrix(*(HG.coefficients + 1e-5 * (np.arange(40) == 5)[:, None] * np.eye(6)[2]).T),
}
AMOUNTS = ((0.0, 0.5), (0.2, 30.0), (0.9, 0.6), (0.6, 1e-4), (1.0, 0.8), (1.0 - 1e-6, 20.0), (0.95, 3.0))
GLASS, OUT, GREY = vrte.Interface(1.0, 1.5), vrte.Interface(1.5, 1.0), vrte.Lambertian(0.3)
HAZE = vrte.Layer(RAYLEIGH, 0.9, 0.5)


def depolarize(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
    """A base that turns Q, U and V."""
    turned = np.diag([0.3, 0.1, 0.1, 0.05]) + 0.04 * np.eye(4)[[1, 0, 3, 2]] * np.array([1.0, 1.0, 0.5, -0.5])
    return turned * (1.0 + mu_i * mu_o * np.cos(np.radians(phi_deg)))[..., None, None] / np.pi


BASES: tuple[vrte.scene.boundary.Boundary | None, ...] = (
    None,
    vrte.Lambertian(0.0),
    GREY,
    vrte.Lambertian(1.0),
    vrte.RPV(0.1, 0.8, -0.1),
    vrte.Hapke(0.4),
    vrte.RossLi(0.2, 0.1, 0.0),
    vrte.MuellerBase(depolarize),
    vrte.Mirror((0.2, 3.0)),
    vrte.Facets((1.34, 0.0), 0.4),
    vrte.Facets((0.2, 3.0), 0.3, "ggx", shadowing=True, conserving=True),
)
SURFACES = ("none", "none", "smooth", "between", "plate", "rough", "rough between", "stack")
KINDS = ("brdf", "brdf", "field", "bottom")
COLUMNS = ("a1", "a2", "a3", "a4", "b1", "b2")
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
        assert straight.diagnostics["derivatives"][name].startswith("differences of the solve (it moves a surface")
    film = vrte.brdf(vrte.Scene([GLASS, HAZE], GREY), MU_I, MU_O, nodes=4, derivatives=[depth], transmission=True)
    inside = np.sqrt(1.0 - (1.0 - np.square(MU_I)) / 1.5**2)
    by_depth = film.direct_transmittance_jacobian[depth]
    assert_close(by_depth, -film.direct_transmittance / inside, rtol=1e-9, atol=0.0)


def test_energy_is_conserved_at_every_thickness() -> None:
    """At omega = 1 the net flux is the same at every depth, and so are its derivatives."""
    white, name = vrte.Scene([vrte.Layer(RAYLEIGH, 1.0, 2.0)], GREY), "layer[1].thickness"
    found = vrte.radiance(white, 0.6, mu=[], tau=[0.0, 0.7, 2.0], nodes=4, derivatives=[name])
    net = found.flux_up_jacobian[name] - found.flux_down_jacobian[name] - found.direct_jacobian[name]
    assert np.abs(net - net[0]).max() < 1e-10


def test_semi_infinite_and_white_goes_with_the_root_of_what_is_absorbed() -> None:
    """So it has no derivative with the albedo, and the sentence says so."""
    layers = [vrte.Layer(RAYLEIGH, albedo, math.inf) for albedo in (1.0, 1.0 - 1e-6, 1.0 - 4e-6)]
    white, less, darker = (vrte.brdf(vrte.Scene([layer]), 0.6, 0.5, nodes=4).mueller[0, 0, 0, 0, 0] for layer in layers)
    assert (white - darker) / (white - less) == close_to(2.0, rtol=1e-2, atol=0.0)
    with pytest.raises(vrte.SceneError, match="infinite") as caught:
        vrte.brdf(vrte.Scene(layers[:1]), 0.6, 0.5, nodes=4, derivatives=["layer[1].albedo"])
    assert str(caught.value).count(". ") == 0


# Differences of solves. Where those of two steps do not agree they tell nothing and are left out, and how many agree is
# asserted. Numbers at which the discrete problem has a kink are left out as well.


def draw_scene(chance: np.random.Generator, surfaces: tuple[str, ...] = SURFACES) -> vrte.Scene:
    """One layer to three over any base, without surfaces, under them, between them."""
    layers: list[Any] = []
    for _ in range(chance.choice([1, 2, 2, 3])):
        albedo, thickness = AMOUNTS[chance.integers(len(AMOUNTS))]
        layers.append(vrte.Layer(PHASES[str(chance.choice(list(PHASES)))], albedo, thickness))
    base, surface = BASES[chance.integers(len(BASES))], str(chance.choice(surfaces))
    if surface != "plate" and chance.random() < 0.15:
        layers[-1] = vrte.Layer(layers[-1].phase_matrix, min(layers[-1].albedo, 0.9), np.inf)
    facets = {"distribution": str(chance.choice(["beckmann", "ggx"])), "shadowing": bool(chance.random() < 0.5)}
    rough = vrte.Interface(1.0, 1.4, roughness=0.3, **facets)
    if surface in ("smooth", "stack"):
        layers.insert(0, GLASS)
    if surface in ("between", "stack") and len(layers) > 1:
        layers.insert(len(layers) - 1, vrte.Interface(1.5 if surface == "stack" else 1.0, 1.3))
    if surface == "plate":
        layers, base = [GLASS, *layers, vrte.Interface(1.5, 1.2)], None
    if surface.startswith("rough"):
        layers.insert(len(layers) - 1 if surface == "rough between" else 0, rough)
    return vrte.Scene(layers, base)


def draw_request(chance: np.random.Generator, scene: vrte.Scene) -> tuple[str, dict[str, Any]]:
    """What is asked of a scene, and how it is solved: a field inside, a BRDF, from below where nothing else lies."""
    kind = str(chance.choice(KINDS))
    open_below = scene.base is None and bool(np.isfinite(scene.thickness))
    how = {"nodes": NODES, "accuracy": 1e-13, "threads": 1}
    how["truncation"] = str(chance.choice(["auto", "delta-m", "none"]))
    if kind != "field":
        how["transmission"] = open_below
        if kind == "bottom" and open_below and not scene.has_interfaces:
            how["illuminate"] = "bottom"
    return kind, how


def list_names(scene: vrte.Scene, chance: np.random.Generator) -> list[str]:
    """All numbers, of coefficients some; the first that the nodes do not carry has a kink where it is zero."""
    found = []
    for layer, index in zip(scene.layers, scene.places, strict=True):
        if index is None:  # nothing between two surfaces
            continue
        name = f"layer[{index + 1}]"
        found += [f"{name}.{key}" for key in ("thickness", "albedo", "index")]
        peaked = layer.phase_matrix.terms > 2 * NODES and layer.phase_matrix.asymmetry > 0.0
        degrees = [1, 2, 3, 5, *([2 * NODES] if peaked and not scene.keeps_beams else [])]
        found += [f"{name}.coefficients[{chance.choice(degrees)}].{chance.choice(COLUMNS)}" for _ in range(3)]
    if scene.base is not None:
        found += [f"base.{key}" for key in list_numbers(scene.base)]
    count = sum(interface is not None for interface in scene.interfaces)
    found += [f"interface[{k + 1}].{key}" for k in range(count) for key in ("index", "roughness")]
    return [str(name) for name in dict.fromkeys(found) if not has_kink(scene, name)]


def has_kink(scene: vrte.Scene, name: str) -> bool:
    """A k of 0 of what light in a denser medium is reflected by totally: light goes there as k log k."""
    return name == "base.index.k" and scene.base is not None and scene.base.index.imag == 0.0  # type: ignore[attr-defined]


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


def compare(seed: int, most: int, surfaces: tuple[str, ...] = SURFACES) -> tuple[int, list[str]]:
    """How many derivatives of a scene were compared, and what is wrong of them."""
    chance = np.random.default_rng(seed)
    scene = draw_scene(chance, surfaces)
    kind, how = draw_request(chance, scene)
    if kind == "field":
        how["inside"] = 0.3 * min(scene.layers[0].thickness, 2.0)
    return check_names(scene, kind, how, chance.permutation(list_names(scene, chance))[:most].tolist())


def check_names(
    scene: vrte.Scene, kind: str, how: dict[str, Any], names: list[str], algebra: bool = False
) -> tuple[int, list[str]]:
    """The same of numbers of those names; ``algebra``: whether all but numbers of surfaces and bases come from it."""
    compared, wrong = 0, []
    for name in names:
        try:
            values, jacobians, reported = solve(scene, kind, how, name)
            step = find_step(name, vary_scene(scene, name).value)
        except SceneError:  # a number that does nothing, in a sentence
            continue
        if algebra and name.startswith("layer") and reported != "algebra":
            wrong.append(f"{name}: {reported}")
        far, near = (differentiate(scene, kind, how, name, part * step) for part in (1.0, 0.5))
        for index, (got, one, right, value) in enumerate(zip(jacobians, far, near, values, strict=True)):
            size, difference = np.abs(right).max(initial=0.0), np.abs(one - right).max(initial=0.0)
            rounding = 1e-13 * np.abs(value).max(initial=0.0) / step
            if not np.isfinite(got).all():
                wrong.append(f"{name}, {kind} {index}: not finite ({reported})")
            elif difference <= 1e-4 * size + rounding:
                compared += 1
                error = np.abs(got - right).max(initial=0.0)
                if error > 1e-6 * size + 20.0 * difference + rounding:
                    wrong.append(
                        f"{name}, {kind} {index}: {error / size:.1e} off, by differences {difference / size:.1e}"
                    )
    return compared, wrong


@pytest.mark.parametrize("seed", range(5))
def test_derivatives_of_a_scene_drawn_by_chance(seed: int) -> None:
    compared, wrong = compare(seed, 3)
    assert not wrong
    assert compared >= 6


@pytest.mark.slow
@pytest.mark.parametrize(("surfaces", "seeds", "most"), [(SURFACES[:5], range(40), 8), (SURFACES[5:7], range(5), 3)])
def test_derivatives_of_many_scenes(surfaces: tuple[str, ...], seeds: range, most: int) -> None:
    found = {seed: compare(seed, most, surfaces) for seed in seeds}
    assert not {seed: wrong for seed, (_, wrong) in found.items() if wrong}
    assert sum(compared for compared, _ in found.values()) > 8 * len(seeds)


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
        vrte.Scene([GLASS, vrte.Layer(SPHERES, 0.9, 0.7)], GREY),
        ["layer[2].thickness", "layer[2].albedo", "layer[2].coefficients[2].b1", "base.albedo", "interface[1].index"],
    ),
    "plate": (
        vrte.Scene([GLASS, vrte.Layer(SPHERES, 0.9, 0.7), OUT]),
        ["layer[2].thickness", "layer[2].coefficients[2].a3"],
    ),
    "facets": (
        vrte.Scene([replace(GLASS, roughness=0.4), vrte.Layer(RAYLEIGH, 0.9, 0.7)], GREY),
        ["layer[2].thickness", "layer[2].albedo", "base.albedo"],
    ),
    "more nodes than asked for": (
        vrte.Scene(
            [vrte.Interface(1.0, 1.3), vrte.Layer(vrte.henyey_greenstein(0.3, 6), 0.9, 0.3), vrte.Interface(1.3, 1.1)]
        ),
        ["layer[2].thickness", "layer[2].albedo", "layer[2].coefficients[2].a1"],
    ),
    "a layer that scatters nothing": (
        vrte.Scene([vrte.Layer(RAYLEIGH, 0.0, 0.5), vrte.Layer(PHASES["scalar"], 0.9, 1.0)]),
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
        vrte.Scene([vrte.Layer(PHASES["scalar"], 0.9, 1.0)]),
        ["layer[1].coefficients[2].b1"],
    ),
    "V was scattered apart": (vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1.0)], GREY), ["layer[1].coefficients[2].b2"]),
    "a named base": (vrte.Scene([HAZE], vrte.RPV(0.1, 0.8, -0.1)), ["base.k"]),
    "a metal": (vrte.Scene([HAZE], vrte.Mirror(0.2 + 3j)), ["base.index.k"]),
}


@pytest.mark.parametrize("title", CHOSEN)
def test_derivatives_of_a_chosen_scene(title: str) -> None:
    scene, names = CHOSEN[title]
    is_open = scene.base is None and bool(np.isfinite(scene.thickness))
    how = {"nodes": NODES, "accuracy": 1e-13, "threads": 1, "truncation": "delta-m", "transmission": is_open}
    compared, wrong = check_names(scene, "brdf", how, names, algebra=True)
    assert not wrong
    assert compared >= len(names)


# Adjoints, and parts of the algebra.


@pytest.mark.parametrize("half", [1e-6, 0.3, 40.0, 5e3])
def test_divided_differences_keep_their_digits(half: float) -> None:
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


def test_a_direction_on_a_mode_is_stepped_around() -> None:
    lam = np.array([1.0, 4.0, 9.0])
    aside = step_aside(np.array([0.5, 0.6]), lam, 2)
    assert aside.rate.size == 14
    smooth = np.exp(-aside.rate)[None]  # what is interpolated is as smooth as this
    assert np.abs(aside.gather(smooth)[0] - np.exp([-2.0, -2.0, -1.0 / 0.6, -1.0 / 0.6])).max() < 1e-12
    assert (np.abs(lam[:, None] - aside.rate**2) > 1e-2).all()


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


def test_modes_that_are_not_trusted_leave_it_to_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {"mu_i": 0.3, "mu_o": 0.5, "nodes": 4, "derivatives": ["layer[1].albedo"]}
    expected = vrte.brdf(CHOSEN["one layer"][0], **asked)
    assert expected.diagnostics["derivatives"] == {"layer[1].albedo": "algebra"}
    monkeypatch.setattr("vrte.discrete_ordinates.derivatives.differentiate.ALLOWED", 0.0)
    found = vrte.brdf(CHOSEN["one layer"][0], **asked)
    assert "differ by" in found.diagnostics["derivatives"]["layer[1].albedo"]
    difference = found.jacobian["layer[1].albedo"] - expected.jacobian["layer[1].albedo"]
    assert 0.0 < np.abs(difference).max() < 1e-8


@pytest.mark.slow
def test_orders_on_fewer_nodes_keep_their_peak() -> None:
    """The fraction of the peak changes with the coefficients."""
    phase, how = vrte.henyey_greenstein(0.7, 140), {"nodes": 32, "accuracy": 1e-9}
    table = 0.3 * phase.coefficients
    table[0] = 0.0

    def move(h: float) -> vrte.Scene:
        moved = vrte.PhaseMatrix(*(phase.coefficients + h * table).T)
        return vrte.Scene([vrte.Layer(moved, 0.97 + 0.1 * h, 3.0 + 0.5 * h)], vrte.Lambertian(0.2))

    found = vrte.linearize(move(0.0), mu_i=MU_I, mu_o=MU_O, phi=PHI, **how)
    assert len({block.problem.nodes.size for block in found.plan.blocks}) > 1
    variation = vrte.Variation("all", 1.0, [0.5], [0.1], (table,))
    far, near, back, farther = (vrte.brdf(move(k * 1e-3), MU_I, MU_O, PHI, **how).mueller for k in (2, 1, -1, -2))
    expected = (8.0 * (near - back) - (far - farther)) / 12e-3
    assert np.abs(found.jvp(variation) - expected).max() < 1e-8 * np.abs(expected).max()


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
