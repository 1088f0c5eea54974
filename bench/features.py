"""What features cost over the plain solve: a surface, derivatives; rows of the same table as the peers."""

import functools
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

import vrte
from bench import cases
from bench.peers import Row, time_in_turn
from vrte.basics.arrays import Array
from vrte.scene.vary import vary_scene

MU, PHI = np.linspace(0.1, 1.0, 10), np.linspace(0.0, 180.0, 19)
FINE_MU, FINE_PHI = np.linspace(0.05, 1.0, 20), np.linspace(0.0, 180.0, 37)
HOW: dict[str, Any] = {"threads": 1, "accuracy": 1e-6}
NODES = 24  # of a hemisphere, under a rough surface
STEP = 1e-5  # of central differences
SURFACE, THREE, ALL = 1.8, 3.5, 5.0  # times the plain solve that were asked for

PILE = [vrte.Layer(vrte.rayleigh(), 0.99, 0.5), vrte.Layer(vrte.henyey_greenstein(0.7, 32), 0.95, 4.0)]
# by name: the scene, the layer whose thickness, albedo and one coefficient are varied, nodes
DIFFERENTIATED = {
    "gold": (cases.find_scene("gold"), "layer[1]", 40),
    "Rayleigh on Henyey-Greenstein": (vrte.Scene(PILE, vrte.Lambertian(0.3)), "layer[2]", 16),
    "paint under a surface": (vrte.Scene([vrte.Interface(1.0, 1.5), *PILE], vrte.Lambertian(0.3)), "layer[3]", 16),
}

Solve = Callable[[], Any]


@functools.cache
def make_paint() -> vrte.Layer:
    """Rutile of 0.25 um in a binder of index 1.5, 15 % by volume, 40 um thick, at 0.55 um."""
    pigment = vrte.spheres("rutile", radius_um=0.125, wavelength_um=0.55, host_index=1.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vrte.IndependentScatteringWarning)
        return vrte.Layer.of(pigment, thickness_um=40.0, volume_fraction=0.15)


def list_surface_calls() -> dict[str, tuple[Solve, float | None]]:
    """A paint bare and under a smooth surface, nodes chosen: what is called, and the times asked for."""
    return {
        "vrte": (solve_under, None),
        "vrte, smooth surface": (functools.partial(solve_under, vrte.Interface(1.0, 1.5)), SURFACE),
    }


def list_rough_calls() -> dict[str, tuple[Solve, float | None]]:
    """The same on as many nodes each, and under a rough surface."""
    smooth, rough = (vrte.Interface(1.0, 1.5, roughness=roughness) for roughness in (0.0, 0.2))
    return {
        "vrte": (functools.partial(solve_under, nodes=NODES), None),
        "vrte, smooth surface": (functools.partial(solve_under, smooth, nodes=NODES), None),
        "vrte, rough surface": (functools.partial(solve_under, rough, nodes=NODES), None),
    }


def solve_under(*above: vrte.Interface, nodes: int | None = None) -> vrte.Brdf:
    """The paint's BRDF below what lies above it."""
    return vrte.brdf(vrte.Scene([*above, make_paint()]), FINE_MU, FINE_MU, FINE_PHI, nodes=nodes, **HOW)


def list_derivative_calls(name: str) -> dict[str, tuple[Solve, float | None]]:
    """The plain solve; three derivatives by the algebra, by central differences; all coefficients by vjp."""
    scene, layer, nodes = DIFFERENTIATED[name]
    names = [f"{layer}.thickness", f"{layer}.albedo", f"{layer}.coefficients[1].a1"]
    asked = MU, MU, PHI
    weights: Array = np.random.default_rng(1).standard_normal((MU.size, MU.size, PHI.size, 4, 4))

    def differ() -> None:
        for each in (vary_scene(scene, one) for one in names):
            for step in (STEP, -STEP):
                vrte.brdf(each.scene_at(each.value + step), *asked, nodes=nodes, **HOW)

    return {
        "vrte": (lambda: vrte.brdf(scene, *asked, nodes=nodes, **HOW), None),
        "vrte, three derivatives": (lambda: vrte.brdf(scene, *asked, nodes=nodes, derivatives=names, **HOW), THREE),
        "the same by central differences": (differ, None),
        "vrte, all coefficients by vjp": (lambda: vrte.linearize(scene, *asked, nodes=nodes, **HOW).vjp(weights), ALL),
    }


# by scene: streams, and what is called
FEATURES: dict[str, tuple[int | None, Callable[[], dict[str, tuple[Solve, float | None]]]]] = {
    "rutile paint, 40 um, 20 x 20 x 37 directions": (None, list_surface_calls),
    "the same paint, 24 nodes": (2 * NODES, list_rough_calls),
    **{
        f"{name}, 10 x 10 x 19 directions": (2 * nodes, functools.partial(list_derivative_calls, name))
        for name, (_, _, nodes) in DIFFERENTIATED.items()
    },
}


def measure_feature(name: str) -> list[Row]:
    """The plain solve and what costs more, in turn, one thread: median CPU times, and their ratios."""
    streams, list_calls = FEATURES[name]
    with threadpool_limits(1):
        calls = list_calls()
        first, medians = time_in_turn({code: call for code, (call, _) in calls.items()})
    return [
        Row(
            *(name, streams, code, first[code], first[code] / first["vrte"], medians[code]),
            *(medians[code] / medians["vrte"], (), target),
            at_most=True,
        )
        for code, (_, target) in calls.items()
    ]
