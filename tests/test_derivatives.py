"""Derivatives against differences of vrte at five steps, what the scene itself has nothing of, and what has none."""

import math

import numpy as np
import pytest

import vrte
from vrte.scene.vary import vary_scene

from . import exact
from .helpers import close_to

MU_I, MU_O, PHI = (0.1, 0.6), (0.35, 0.9), np.arange(8) * 45.0


def test_endless_and_white_goes_with_the_root_of_what_is_absorbed() -> None:
    """So it has no derivative with the albedo, and the sentence says so."""
    layers = [vrte.Layer(vrte.rayleigh(), albedo, math.inf) for albedo in (1.0, 1.0 - 1e-6, 1.0 - 4e-6)]
    white, less, darker = (vrte.brdf(vrte.Scene([layer]), 0.6, 0.5, nodes=4).mueller[0, 0, 0, 0, 0] for layer in layers)
    assert (white - darker) / (white - less) == close_to(2.0, rtol=1e-2, atol=0.0)
    with pytest.raises(vrte.SceneError, match="infinite") as told:
        vrte.brdf(vrte.Scene(layers[:1]), 0.6, 0.5, nodes=4, derivatives=["layer[1].albedo"])
    assert str(told.value).count(". ") == 0


SPHERES = vrte.spheres(1.5 + 0.01j, size=vrte.Gamma(0.2, 0.1), wavelength_um=0.55).phase_matrix
PILE = [vrte.Layer(vrte.rayleigh(), 0.95, 0.4), vrte.Layer(SPHERES, 0.99, 3.0)]
SCENES = {
    "two layers over a grey base": (vrte.Scene(PILE, vrte.Lambertian(0.3)), 20),
    "semi-infinite spheres": (vrte.Scene([vrte.Layer(SPHERES, 0.99, math.inf)]), 24),
    "under a smooth surface": (vrte.Scene([vrte.Interface(1.0, 1.5), *PILE], vrte.Lambertian(0.3)), 16),
    "coincident eigenvalues": (vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 2.0)]), 16),
}
QUICK = "coincident eigenvalues", "layer[1].albedo"
STEPS = (0.1, 0.03, 0.01, 3e-3, 1e-3)


def names_of(scene: vrte.Scene) -> list[str]:
    """Thickness, albedo and two coefficients of its last layer, and its base."""
    last = f"layer[{scene.places[-1] + 1}]"
    names = [f"{last}.albedo", f"{last}.coefficients[1].a1", f"{last}.coefficients[2].b1"]
    if math.isfinite(scene.layers[-1].thickness):
        names.append(f"{last}.thickness")
    return [*names, *(["base.albedo"] if scene.below.even_albedo else [])]


def differences(scene: vrte.Scene, name: str, nodes: int) -> np.ndarray:
    """Of fourth order, at each of STEPS relative to how far the number can go: (step, in, out, phi, 4, 4)."""
    variation = vary_scene(scene, name)
    assert variation.scene_at is not None
    reach = 1.0 - variation.value if name.endswith("albedo") else max(abs(variation.value), 0.3)

    def solve(step: float) -> np.ndarray:
        moved = variation.scene_at(variation.value + step)
        return exact.brdf(moved, MU_I, MU_O, PHI, nodes=nodes, threads=1).mueller

    found = []
    for step in STEPS:
        h = 0.4 * step * reach
        far, near = solve(2.0 * h) - solve(-2.0 * h), solve(h) - solve(-h)
        found.append((8.0 * near - far) / (12.0 * h))
    return np.array(found)


@pytest.mark.parametrize(
    ("title", "name"),
    [
        (title, name) if (title, name) == QUICK else pytest.param(title, name, marks=pytest.mark.slow)
        for title, (scene, _) in SCENES.items()
        for name in names_of(scene)
    ],
)
def test_differences_at_five_steps_come_to_the_derivative(title: str, name: str) -> None:
    """Their error falls with the fourth power of the step until rounding takes over, of 1e-11 at best."""
    scene, nodes = SCENES[title]
    found = exact.brdf(scene, MU_I, MU_O, PHI, nodes=nodes, threads=1, derivatives=[name]).jacobian[name]
    gaps = np.abs(differences(scene, name, nodes) - found).reshape(len(STEPS), -1).max(axis=1) / np.abs(found).max()
    print(title, name, dict(zip(STEPS, (f"{gap:.1e}" for gap in gaps), strict=True)))
    assert gaps.min() < 1e-9


@pytest.mark.parametrize(
    ("scene", "name"),
    [
        (vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 6), 0.9, 1.0)]), "layer[1].coefficients[2].b1"),
        (vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.3)), "layer[1].coefficients[2].b2"),
    ],
)
def test_a_coefficient_that_mixes_what_the_scene_keeps_apart(scene: vrte.Scene, name: str) -> None:
    """I alone is scattered by the one, V apart from I, Q and U by the other: with the coefficient they are not."""
    found = exact.brdf(scene, MU_I, MU_O, PHI, nodes=4, threads=1, derivatives=[name])
    variation = vary_scene(scene, name)
    above, below = (
        exact.brdf(variation.scene_at(step), MU_I, MU_O, PHI, nodes=4, threads=1).mueller for step in (1e-4, -1e-4)
    )
    right = (above - below) / 2e-4
    gap = np.abs(found.jacobian[name] - right).max()
    assert found.diagnostics["derivatives"][name] == "algebra"
    assert gap < 1e-6 * np.abs(right).max()
