"""Derivatives of scenes drawn by chance, with every name that they have, against differences of solves.

Every phase, absorber, surface and base. Where differences at two steps do not agree they tell nothing and are left out,
and how many agree is asserted. Numbers at which the discrete problem has a kink are left out as well.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import find_phase_matrix
from vrte.basics.differences import sample_around
from vrte.basics.errors import SceneError
from vrte.scene.vary import list_numbers, vary_scene

MU_I, MU_O, PHI, NODES = (0.15, 0.6), (0.35, 0.8), (20.0, 140.0), 4
HG = vrte.henyey_greenstein(0.75, 40)
PHASES = {
    "isotropic": vrte.isotropic(),
    "rayleigh": vrte.rayleigh(),
    "depolarizing": vrte.rayleigh(0.3),
    "scalar": vrte.henyey_greenstein(0.4, 6),
    "scalar, peaked": HG,
    "backward": vrte.henyey_greenstein(-0.6, 30),
    "spheroids": find_phase_matrix("spheroids"),
    "haze, peaked": find_phase_matrix("haze-L"),
    "nearly scalar": vrte.PhaseMatrix(*(HG.coefficients + 1e-5 * (np.arange(40) == 5)[:, None] * np.eye(6)[2]).T),
}
AMOUNTS = ((0.0, 0.5), (0.2, 30.0), (0.9, 0.6), (0.6, 1e-4), (1.0, 0.8), (1.0 - 1e-6, 20.0), (0.95, 3.0))
GLASS = vrte.Interface(1.0, 1.5)


def depolarize(mu_i: np.ndarray, mu_o: np.ndarray, phi_deg: np.ndarray) -> np.ndarray:
    """A base that turns Q, U and V."""
    turned = np.diag([0.3, 0.1, 0.1, 0.05]) + 0.04 * np.eye(4)[[1, 0, 3, 2]] * np.array([1.0, 1.0, 0.5, -0.5])
    return turned * (1.0 + mu_i * mu_o * np.cos(np.radians(phi_deg)))[..., None, None] / np.pi


BASES: tuple[vrte.scene.boundary.Boundary | None, ...] = (
    None,
    vrte.Lambertian(0.0),
    vrte.Lambertian(0.3),
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
    for layer, place in zip(scene.layers, scene.places, strict=True):
        if place is None:  # nothing between two surfaces
            continue
        name = f"layer[{place + 1}]"
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
    told = found.diagnostics.get("derivatives", {}).get(name, "")
    return values, [one[name] for one in jacobians] if name else [], told


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
    """By five points."""
    variation = vary_scene(scene, name)
    make: Callable[[float], vrte.Scene] | None = variation.scene_at
    assert make is not None
    found = [(weight, solve(moved, kind, how)[0]) for weight, moved in sample_around(make, variation.value, step)]
    return [sum(weight * values[k] for weight, values in found) for k in range(len(found[0][1]))]


def compare(seed: int, most: int, surfaces: tuple[str, ...] = SURFACES) -> tuple[int, list[str]]:
    """How many derivatives of a scene were compared, and what is wrong of them."""
    chance = np.random.default_rng(seed)
    scene = draw_scene(chance, surfaces)
    kind, how = draw_request(chance, scene)
    if kind == "field":
        how["inside"] = 0.3 * min(scene.layers[0].thickness, 2.0)
    return check_names(scene, kind, how, chance.permutation(list_names(scene, chance))[:most].tolist())


def check_names(scene: vrte.Scene, kind: str, how: dict[str, Any], names: list[str]) -> tuple[int, list[str]]:
    """The same of numbers of those names."""
    compared, wrong = 0, []
    for name in names:
        try:
            values, jacobians, told = solve(scene, kind, how, name)
            step = find_step(name, vary_scene(scene, name).value)
        except SceneError:  # a number that does nothing, in a sentence
            continue
        far, near = (differentiate(scene, kind, how, name, part * step) for part in (1.0, 0.5))
        for place, (got, one, right, value) in enumerate(zip(jacobians, far, near, values, strict=True)):
            size, gap = np.abs(right).max(initial=0.0), np.abs(one - right).max(initial=0.0)
            rounding = 1e-13 * np.abs(value).max(initial=0.0) / step
            if not np.isfinite(got).all():
                wrong.append(f"{name}, {kind} {place}: not finite ({told})")
            elif gap <= 1e-4 * size + rounding:
                compared += 1
                error = np.abs(got - right).max(initial=0.0)
                if error > 1e-6 * size + 20.0 * gap + rounding:
                    wrong.append(
                        f"{name}, {kind} {place}: {error / size:.1e} off, differences {gap / size:.1e} ({told})"
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


DARK = vrte.Layer(PHASES["rayleigh"], 0.0, 0.5)
HAZY = vrte.Layer(PHASES["scalar"], 0.9, 1.0)
FACETS = vrte.Scene([vrte.Interface(1.0, 1.3), vrte.Layer(PHASES["rayleigh"], 0.9, 1.0)], vrte.Facets(0.4, 1.5))


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        (vrte.Scene([DARK, HAZY]), ["layer[1].albedo", "layer[1].thickness", "layer[2].albedo"]),
        (FACETS, ["base.roughness", "base.index.n", "layer[2].albedo"]),
        (vrte.Scene([vrte.Layer(HG, 0.0, 0.5)], vrte.Lambertian(0.4)), ["layer[1].albedo"]),
        (
            vrte.Scene([vrte.Layer(PHASES["rayleigh"], 1.0, 0.8), vrte.Layer(HG, 0.9, np.inf)]),
            ["layer[1].albedo", "layer[2].coefficients[8].a2"],
        ),
    ],
    ids=["a layer that scatters nothing", "facets under a surface", "a peak that scatters nothing", "a white layer"],
)
def test_derivatives_where_there_were_none(scene: vrte.Scene, names: list[str]) -> None:
    how = {"nodes": NODES, "accuracy": 1e-13, "threads": 1, "truncation": "delta-m"}
    compared, wrong = check_names(scene, "brdf", how, names)
    assert not wrong
    assert compared >= len(names)
