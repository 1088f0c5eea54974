"""Smooth interfaces and mirrors, solved: against closed forms, what nature keeps, and programs of other makes."""

import numpy as np
import pytest

import vrte
from tests import exact
from vrte.studies.cases import find_phase_matrix

from .interface_oracle import brdf_orders
from .oracle import azimuthal_sum

MU_I, MU_O, PHI = [0.1, 0.6, 1.0], [0.2, 0.7, 1.0], np.array([0.0, 40.0, 150.0, 250.0])
RAYLEIGH, SPHEROIDS = vrte.rayleigh(), find_phase_matrix("spheroids")
METAL = vrte.Mirror(0.2 + 3.0j)


def turn_some_u_into_v() -> vrte.PhaseMatrix:
    """Rayleigh's, depolarized, with a b2: what has every element in three terms."""
    coefficients = vrte.rayleigh(0.1).coefficients.copy()
    coefficients[2, 5] = 0.3
    return vrte.PhaseMatrix(*coefficients.T)


SHORT = turn_some_u_into_v()
SCENES = {
    "under a surface, over white": ([(1.0, 1.5), (SHORT, 1.0, 1.0)], vrte.Lambertian(1.0)),
    "a plate": ([(1.0, 1.5), (SHORT, 0.95, 1.0), (1.5, 1.1)], None),
    "air over a sea": ([(RAYLEIGH, 0.99, 0.2), (1.0, 1.34), (SPHEROIDS, 0.9, 1.0)], vrte.Lambertian(0.1)),
    "air over metal": ([(RAYLEIGH, 0.99, 0.2)], METAL),
    "varnish over paint on metal": ([(1.0, 1.34), (RAYLEIGH, 0.5, 0.1), (1.34, 1.5), (SHORT, 0.9, 0.5)], METAL),
    "a bubble": ([(1.5, 1.0), (SHORT, 1.0, 0.7), (1.0, 1.5)], None),
    "lit from glass, over glass": ([(1.5, 1.25), (SPHEROIDS, 0.9, 0.5)], vrte.Mirror(1.4)),
    "three media": (
        [(RAYLEIGH, 0.9, 0.3), (1.0, 1.5), (SHORT, 1.0, 1.0), (1.5, 1.3), (RAYLEIGH, 0.9, 0.4)],
        vrte.Lambertian(0.5),
    ),
}
QUICK = ("under a surface, over white", "a plate", "varnish over paint on metal", "three media")


def make_scene(name: str) -> vrte.Scene:
    pile, base = SCENES[name]
    return vrte.Scene([vrte.Interface(*part) if len(part) == 2 else vrte.Layer(*part) for part in pile], base)


def slow_but(*quick: str) -> list[object]:
    """Every scene, those not named with the slow tests."""
    return [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in SCENES]


@pytest.mark.parametrize("algorithm", ["doubling", "modes"])
@pytest.mark.parametrize("name", slow_but(*QUICK))
def test_the_literal_solver_says_the_same(name: str, algorithm: str) -> None:
    """All that leaves, as beams too. Measured: 5e-14 of the largest."""
    scene = make_scene(name)
    nodes = terms = max(layer.phase_matrix.terms for layer in scene.layers)
    nodes = max(nodes, 6)
    right = brdf_orders(scene, MU_I, MU_O, nodes, terms)
    f = exact.brdf(scene, MU_I, MU_O, PHI, nodes=nodes, algorithm=algorithm, transmission=scene.base is None)
    pairs = [(f.mueller, azimuthal_sum(right.reflected, PHI)), (f.reflectance, right.reflectance)]
    if f.transmission is not None:
        pairs.append((f.transmission, azimuthal_sum(right.transmitted, PHI)))
    for beams, expected in ((f.specular, right.specular), (f.specular_transmission, right.specular_transmission)):
        if scene.base is None or beams is f.specular:
            pairs.append((np.zeros_like(expected) if beams is None else beams, expected))
    for got, expected in pairs:
        assert np.abs(got - expected).max() < 1e-11 * max(np.abs(expected).max(), 1e-3)
