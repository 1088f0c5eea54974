"""Every scene of tests/scenes.py, solved in every way that can solve it: the light is right, energy is conserved, light
is reciprocal and mirror symmetric, and scenes together are each as alone."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import vrte
from bench import stability
from bench.stability_cases import BEAM
from vrte.methods import find_method

from . import oracle
from .helpers import assert_close
from .literal import azimuthal_sum
from .samples import slow_but
from .scenes import Problem, find_problems

PROBLEMS = find_problems()
FLIP = np.outer([1.0, 1.0, -1.0, -1.0], [1.0, 1.0, -1.0, -1.0])  # U and V of light seen from the other side
Q = np.array([1.0, 1.0, 1.0, -1.0])
FEW = (
    "sun and view on a node", "mu beside mu0", "1 - omega = 1e-9, thickness 1e4", "infinite, conservative",
    "infinite, 1 - omega = 1e-12", "thickness 0 over a lobe", "thick between thin", "clear layer between",
    "rayleigh w=0.99 t=inf two white sun=node view=1 N=8", "plate", "leaf under glass",
)  # fmt: skip  # for ways that take long: the others are slow tests
ON_DEVICES = (
    "infinite, conservative", "infinite, absorbing", "conservative metal, thickness 1e6", "clear layer between",
    "white base under a white slab", "thick between thin, absorbing", "thickness 1e-10", "lobe under a white slab",
    "identical neighbours, conservative, thick", "sun and view on an eigenvalue", "leaf", "varnish over paint",
)  # fmt: skip


@dataclass(frozen=True)
class Way:
    """Arguments of a call; the largest error, relative to the largest I at a depth; which problems it takes, and which
    of them in the quick tests; whether it finds light inside and conserves energy to rounding."""

    how: dict[str, Any]
    tolerance: float = 1e-12
    takes: Callable[[str, Problem], bool] = lambda name, problem: True
    quick: tuple[str, ...] = tuple(PROBLEMS)
    inside: bool = True
    conserves: bool = True


def make_method(name: str, settings: dict[str, Any], tolerance: float, most: float = np.inf) -> Way:
    """One of the methods beside the exact one; ``most``: the optical thickness up to which it ends soon, if light gets
    out as well. Along grazing directions none claims that many digits."""
    method = find_method(name)

    def takes(_: str, problem: Problem) -> bool:
        scene = problem.scene
        return (
            (method.interfaces != "none" or not scene.needs_beam_paths)
            and not scene.is_rough
            and scene.thickness <= most
            and problem.nodes > 1
            and np.abs(problem.mu).min() > 1e-3
            and (np.isinf(most) or max(scene.media) < 2.0)
        )

    return Way({"method": name, "settings": settings}, tolerance, takes, FEW, method.depths, method.conserves_energy)


def is_on_device(name: str, problem: Problem) -> bool:
    return name in ON_DEVICES


EXACT = {"accuracy": 1e-15, "truncation": "none"}
WAYS = {
    "doubling": Way(EXACT | {"algorithm": "doubling"}),
    "modes": Way(EXACT | {"algorithm": "modes"}),
    "by rule": Way(EXACT | {"accuracy": 1e-9}, 1e-10, lambda _, problem: not problem.scene.is_rough),
    "by rule, rough": Way(EXACT | {"accuracy": 1e-9}, 1e-9, lambda _, problem: problem.scene.is_rough),
    "invariance": Way(
        EXACT | {"algorithm": "invariance", "accuracy": 1e-12}, 1e-11, lambda _, problem: not problem.ends, inside=False
    ),
    "sequential": Way(EXACT | {"backend": "sequential"}, takes=is_on_device),
    "opencl": Way(EXACT | {"backend": "opencl"}, takes=is_on_device),
    "opencl+lapack": Way(EXACT | {"backend": "opencl+lapack"}, takes=is_on_device, quick=ON_DEVICES[::4]),
    "sequential+device": Way(EXACT | {"backend": "sequential+device"}, takes=is_on_device, quick=ON_DEVICES[1::4]),
    "adding-doubling": make_method("adding-doubling", {"start": 4}, 1e-11),
    "matrix-operator": make_method("matrix-operator", {}, 1e-11),
    "invariant-imbedding": make_method("invariant-imbedding", {"rtol": 1e-10}, 1e-9, 2.0),
    "successive-orders": make_method("successive-orders", {"tolerance": 1e-12, "levels": 160}, 1e-10, 2.0),
}
ROWS = [
    pytest.param(name, way, marks=[] if name in how.quick else [pytest.mark.slow])
    for way, how in WAYS.items()
    for name, problem in PROBLEMS.items()
    if how.takes(name, problem)
]


@cache
def solve(name: str, way: str) -> tuple[vrte.Field | None, vrte.Brdf]:
    """The field, where the way finds one, and the table of both reflection and transmission."""
    problem, how = PROBLEMS[name], WAYS[way].how
    field = vrte.radiance(problem.scene, **problem.ask_field(), **how) if WAYS[way].inside else None
    return field, vrte.brdf(problem.scene, **problem.ask_table(), **how)


def check_light(problem: Problem, field: vrte.Field, tolerance: float) -> None:
    """Order by order against ball arithmetic, relative to the largest I at each depth; fluxes to the larger one."""
    answer = problem.answer
    found = stability.compute_fourier_orders(answer.case, field.stokes, tuple(answer.orders))
    size = np.max([np.abs(light[..., 0]).max(axis=(0, 2)) for light in answer.orders.values()], axis=0)
    for order, light in answer.orders.items():
        limit = max(tolerance, 10.0 * answer.c[order]) * size + stability.NOTHING
        assert (np.abs(found[order] - light).max(axis=(0, 2, 3)) <= limit).all(), order
    flux, right = np.stack([field.flux_up, field.flux_down]), np.stack([answer.flux_up, answer.flux_down])
    limit = max(tolerance, 10.0 * problem.c) * np.abs(right).max(axis=0) + stability.NOTHING
    if answer.case.is_thin and field.diagnostics.get("algorithm") == "modes":
        limit = limit + 1e-15 * problem.mu0  # modes find the fluxes as differences from the beam
    assert (np.abs(flux - right).max(axis=0) <= limit).all()


def check_same(found: Any, right: Any, tolerance: float, names: tuple[str, ...]) -> None:
    """Arrays of two results, relative to the largest of each."""
    for name in names:
        one, other = getattr(found, name), getattr(right, name)
        if other is not None and np.size(other):
            assert_close(one, other, rtol=0.0, atol=tolerance * max(np.abs(other).max(), 1e-2), err_msg=name)


TABLE = ("mueller", "transmission", "specular", "specular_transmission", "reflectance", "direct_transmittance")
FIELD = ("stokes", "flux_up", "flux_down", "direct", "direct_up")
AZIMUTHS = np.array([0.0, 45.0, 180.0, 315.0])


@pytest.fixture
def way(request: pytest.FixtureRequest) -> str:
    """The name of a way, and a device where it needs one."""
    name = str(request.param)
    if "opencl" in name or "device" in name:
        request.getfixturevalue("opencl")
    return name


@pytest.mark.parametrize(("name", "way"), ROWS, indirect=["way"])
def test_light_is_right(name: str, way: str) -> None:
    """Beside ball arithmetic, and doubling on the processor."""
    problem, tolerance, (field, table) = PROBLEMS[name], WAYS[way].tolerance, solve(name, way)
    if problem.answer and field:
        check_light(problem, field, tolerance)
    if problem.known:
        right = problem.right
        pairs = [(table.mueller, azimuthal_sum(right.reflected, AZIMUTHS)), (table.specular, right.specular)]
        pairs += [(table.reflectance, right.reflectance)]
        if problem.scene.base is None and table.transmission is not None:
            pairs += [(table.transmission, azimuthal_sum(right.transmitted, AZIMUTHS))]
            if problem.scene.needs_beam_paths:
                pairs += [(table.specular_transmission, right.specular_transmission)]
        for found, expected in pairs:
            found = np.zeros_like(expected) if found is None else found  # nothing is refracted
            assert_close(found, expected, rtol=0.0, atol=tolerance * max(np.abs(expected).max(), 1e-2))
    reference = solve(name, "doubling")
    check_same(table, reference[1], max(tolerance, 10.0 * problem.c), TABLE)
    if field:
        check_same(field, reference[0], max(tolerance, 10.0 * problem.c), FIELD)


@pytest.mark.parametrize(
    "name", slow_but((name for name, each in PROBLEMS.items() if each.known), "varnish over paint")
)
def test_light_between_interfaces_is_right(name: str) -> None:
    """Beside ball arithmetic: on both sides of every interface and between them, fluxes and beams, 1e-11 of the
    largest."""
    problem, scene = PROBLEMS[name], PROBLEMS[name].scene
    levels = [(k, x * min(one.thickness, 3.0)) for k, one in enumerate(scene.layers) for x in (0.0, 0.3, 1.0)]
    tops = np.cumsum([0.0, *(one.thickness for one in scene.layers)])
    right = [oracle.solve(scene, [problem.mu0], problem.mu, levels, problem.nodes, m) for m in (0, 1)]
    fluxes = [right[0].flux_up, right[0].flux_down, right[0].beams_up[..., 0, :], right[0].beams_down[..., 0, :]]
    fluxes = [flux[:, 0] @ BEAM for flux in fluxes]
    for index, (k, depth) in enumerate(levels):
        # inside a layer is the lower side of the interface above it
        side = "below" if depth == 0.0 and scene.interfaces[k] is not None else "above"
        for way in ("modes", "doubling"):
            asked = problem.ask_field() | WAYS[way].how | {"tau": tops[k] + depth, "side": side}
            field = vrte.radiance(scene, **asked)
            for m, light in enumerate(right):
                expected = oracle.split_beam(light.radiance[index, 0], BEAM)
                difference = np.abs(oracle.find_field_order(field.stokes[0], m) - expected).max()
                assert difference < 1e-11 * max(np.abs(expected).max(), 1e-2), (k, depth, way)
            cosine = right[0].cosines[index, 0]
            up, down, beam_up, beam_down = (flux[index] for flux in fluxes)
            beams = [0.0 if field.direct_up is None else field.direct_up[0], field.direct[0]]
            assert_close(beams, [cosine * beam_up, cosine * beam_down], rtol=0.0, atol=1e-14)
            assert_close([field.flux_up[0], field.flux_down[0]], [up, down], rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize(("name", "way"), ROWS, indirect=["way"])
def test_light_keeps_the_laws(name: str, way: str) -> None:
    """Mirror symmetry, Helmholtz's reciprocity, light that is light, and energy: to the rounding of the sums of 2 N
    numbers over nodes where nothing is refracted."""
    problem, (field, table) = PROBLEMS[name], solve(name, way)
    assert stability.measure_mirror_gap(table) <= 1e-13
    assert stability.measure_unphysical_matrix(table.mueller) <= 1e-12
    if "leaf" not in name:
        assert stability.measure_reciprocity_gap(table) <= max(1e-13, 20.0 * WAYS[way].tolerance)
    if field is None:
        return
    assert stability.measure_unphysical_light(field.stokes) <= 1e-12
    few, up = np.array([0, 1, 4, 7]) * (problem.phi.size // 8), np.isin(table.mu_o, problem.mu)
    indices = [problem.mu.tolist().index(mu) for mu in table.mu_o[up]]
    radiance = (table.mueller[0, up] @ (problem.mu0 * np.array(BEAM)))[None]
    difference = stability.measure_relative_difference(radiance, field.stokes[:1, indices][:, :, few])
    assert difference <= max(WAYS[way].tolerance, 10.0 * problem.c)
    net = field.flux_down + field.direct - field.flux_up - (0.0 if field.direct_up is None else field.direct_up)
    lost = np.abs(np.diff(net)) if problem.is_white else np.maximum(np.diff(net), 0.0)
    if problem.reflects_everything:
        lost = np.append(lost, np.abs(net[0]))
    rounding = 1e-12 if problem.scene.needs_beam_paths else 2 * problem.nodes * 2.0**-53
    assert lost.max(initial=0.0) <= (rounding if WAYS[way].conserves else WAYS[way].tolerance)


TOGETHER = {"nodes": 6, "threads": 1, "accuracy": 1e-10, "truncation": "none"}
MU = np.array([0.35, 0.9])


@pytest.mark.parametrize(
    ("way", "transmission"), [("openmp", False), ("openmp", True), ("opencl", False)], indirect=["way"]
)
def test_scenes_together_are_each_as_alone(way: str, transmission: bool) -> None:
    """To the last bit: scenes that are solved in one batch, and those that have nothing in common with any other."""
    names = [
        name
        for name, each in PROBLEMS.items()
        if (each.ends or not transmission) and (way == "openmp" or name in ON_DEVICES)
    ]
    scenes, asked = [PROBLEMS[name].scene for name in names], TOGETHER | {"backend": way, "transmission": transmission}
    together = vrte.brdfs(scenes, MU, MU, AZIMUTHS, **asked)
    for name, scene, found in zip(names, scenes, together, strict=True):
        alone = vrte.brdf(scene, MU, MU, AZIMUTHS, **asked)
        for each in TABLE:
            np.testing.assert_array_equal(getattr(found, each), getattr(alone, each), err_msg=f"{name}: {each}")
        for each in ("orders", "algorithm", "orders_by", "truncation"):
            assert found.diagnostics[each] == alone.diagnostics[each], name


@pytest.mark.parametrize("name", [name for name, each in PROBLEMS.items() if each.ends and each.scene.base is None])
def test_light_from_below_is_that_of_the_scene_upside_down(name: str) -> None:
    """And what gets through is the same in both directions: t(a, b) = (n'/n)^2 Q t'(b, a)^T Q. Fields as well, along
    the directions asked for and along the nodes."""
    problem, scene = PROBLEMS[name], PROBLEMS[name].scene
    turned = vrte.Scene(scene.layers[::-1], None, [each and each.turned for each in scene.interfaces[::-1]])
    asked = problem.ask_table() | EXACT | {"mu_o": [problem.mu0, 0.35]}
    below, above = vrte.brdf(scene, **asked, illuminate="bottom"), vrte.brdf(turned, **asked)
    down = vrte.brdf(scene, **asked).transmission
    for each in ("mueller", "transmission"):
        found, right = getattr(below, each), getattr(above, each) * FLIP
        assert_close(found, right, rtol=0.0, atol=1e-13 * np.abs(right).max())
    ratio = (scene.index_below / scene.index_above) ** 2
    back = ratio * Q[:, None] * below.transmission.transpose(1, 0, 2, 4, 3) * Q
    assert_close(down, back, rtol=0.0, atol=max(1e-12, 20.0 * problem.c) * np.abs(down).max())
    for mu in (problem.mu, None):
        asked = problem.ask_field() | EXACT | {"mu": mu, "tau": 0.3 * scene.thickness}
        field = vrte.radiance(scene, **asked, illuminate="bottom")
        asked |= {"stokes": BEAM * FLIP[0], "mu": -field.mu, "tau": 0.7 * scene.thickness}
        right = vrte.radiance(turned, **asked)
        assert_close(field.stokes, right.stokes * FLIP[0], rtol=0.0, atol=1e-13 * right.stokes.max())
        pairs = [(field.flux_up, right.flux_down), (field.flux_down, right.flux_up)]
        if right.direct_up is None:  # the beam alone, whichever way it goes
            pairs += [(field.direct, right.direct)]
        else:
            pairs += [(field.direct, right.direct_up), (field.direct_up, right.direct)]
        for found, expected in pairs:
            assert_close(found, expected, rtol=0.0, atol=1e-13)
