"""Synthetic iteration: what it converges to, what one iteration is worth, what it refuses."""

from itertools import pairwise

import numpy as np
import pytest

import vrte
from vrte.basics.errors import SceneError
from vrte.methods.parts.method import Method
from vrte.methods.synthetic_iteration import METHOD

from .helpers import assert_close

MU, PHI, MU0 = np.array([0.3, 0.9, -0.3, -0.9]), [0.0, 50.0, 180.0], 0.6
HG = vrte.henyey_greenstein(0.8, 60)
MATRIX = vrte.PhaseMatrix(  # all six differ from zero
    [1.0, 1.2, 0.9, 0.2], [0.0, 0.0, 2.4, 0.5], [0.0, 0.0, 1.9, 0.4], [0.6, 1.3, 0.7, 0.2], [0.0, 0.0, 0.3, 0.05],
    [0.0, 0.0, 0.2, 0.1],
)  # fmt: skip
SCENES = {
    "scalar": vrte.Scene([vrte.Layer(HG, 0.95, 2.0)]),
    "pile": vrte.Scene([vrte.Layer(HG, 0.9, 0.5), vrte.Layer(vrte.isotropic(), 0.7, 1.0)], vrte.Lambertian(0.4)),
    "vector": vrte.Scene([vrte.Layer(MATRIX, 0.9, 0.4), vrte.Layer(vrte.rayleigh(), 0.8, 0.5)], vrte.Lambertian(0.3)),
}


def off(found, exact):
    """The largest difference at each depth over the largest I there."""
    gap = np.abs(found.stokes - exact.stokes).max(axis=(1, 2, 3))
    return float((gap / np.abs(exact.stokes[..., 0]).max(axis=(1, 2))).max())


@pytest.mark.parametrize(
    ("name", "regular"),
    [
        ("scalar", "two-stream"),
        ("pile", "discrete-ordinates"),
        ("vector", "diffusion"),
        ("vector", "single-scattering"),
    ],
)
def test_converges_to_discrete_ordinates(name, regular):
    """On the same nodes, whatever the guess: what is left is of the 8th order in the panels of depths."""
    scene = SCENES[name]
    asked = {"mu0": MU0, "mu": MU, "phi": PHI, "tau": [0.0, 0.7, scene.thickness], "nodes": 4}
    asked["stokes"] = [1.0, 0.0, 0.0, 0.0] if name != "vector" else [1.0, 0.2, -0.5, 0.3]
    exact = vrte.radiance(scene, truncation="small-angle", accuracy=1e-13, **asked)
    told = {"iterations": 60, "regular": regular}
    coarse, fine = (
        vrte.radiance(scene, method="synthetic-iteration", settings={**told, "depths": depths}, **asked)
        for depths in (16, 32)
    )
    assert off(fine, exact) < 1e-7
    assert off(fine, exact) < off(coarse, exact) / 32.0


def test_iterations_help():
    """From the coarse guess to the exact answer, step by step."""
    asked = {"mu0": MU0, "mu": MU, "phi": PHI, "tau": [0.0, 2.0], "nodes": 4}
    exact = vrte.radiance(SCENES["scalar"], truncation="small-angle", **asked)

    def of(count):
        return vrte.radiance(SCENES["scalar"], method="synthetic-iteration", settings={"iterations": count}, **asked)

    errors = [off(of(count), exact) for count in (2, 4, 8, 16)]
    assert all(later < 0.8 * earlier for earlier, later in pairwise(errors)), errors


@pytest.mark.parametrize("regular", ["two-stream", "diffusion"])
def test_one_iteration_of_a_thin_peaked_layer(regular):
    """Light below the layer, where the peak is: within 3 % of the brightest, where two-stream alone is far off."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.97, 400), 0.99, 0.3)])
    asked = {"mu0": MU0, "mu": [-0.3, -0.55, -0.6, -0.7, -1.0], "phi": PHI, "tau": 0.3}
    exact = vrte.radiance(scene, nodes=20, truncation="small-angle", **asked)
    found = vrte.radiance(scene, method="synthetic-iteration", settings={"regular": regular}, **asked)
    alone = vrte.radiance(scene, method=regular, truncation="delta-m", **asked)
    assert off(found, exact) < 0.03
    assert off(alone, exact) > 0.3
    assert off(found, vrte.radiance(scene, method=regular, truncation="small-angle", **asked)) < 1e-14  # it is the same


@pytest.mark.parametrize("regular", ["two-stream", "diffusion"])
def test_closed_form_is_the_grid(regular):
    """One iteration in closed form, and the same with the regular part on the grid: an even phase function has no
    order 1, by which they differ."""
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 2.0)], vrte.Lambertian(0.4))
    asked = {"mu0": MU0, "mu": MU, "tau": [0.0, 0.7, 2.0], "nodes": 8}
    closed = vrte.radiance(scene, method="synthetic-iteration", settings={"regular": regular}, **asked)
    same = vrte.radiance(scene, method=regular, **asked)
    assert off(closed, same) < 1e-14
    by_name = vrte.radiance(scene, method="synthetic-iteration", settings={"regular": "discrete-ordinates"}, **asked)
    assert off(by_name, vrte.radiance(scene, **asked)) < 0.1


def test_fluxes_are_those_of_the_regular_part():
    for name in ("two-stream", "diffusion", "discrete-ordinates"):
        asked = {"mu0": MU0, "mu": [], "tau": [0.0, 1.0, 2.0], "nodes": 8}
        found = vrte.radiance(SCENES["scalar"], method="synthetic-iteration", settings={"regular": name}, **asked)
        regular = vrte.radiance(SCENES["scalar"], method=name, truncation="delta-m", **asked)
        assert_close(found.flux_up, regular.flux_up, rtol=1e-12, atol=0.0)
        assert_close(found.flux_down, regular.flux_down, rtol=1e-12, atol=1e-13)


def test_what_it_refuses():
    assert isinstance(METHOD, Method)
    scene = SCENES["scalar"]
    with pytest.raises(SceneError, match="separates small angles: leave truncation out"):
        vrte.brdf(scene, 0.5, 0.5, method="synthetic-iteration", truncation="none")
    with pytest.raises(SceneError, match="setting 'regular' of method 'synthetic-iteration' must be"):
        vrte.brdf(scene, 0.5, 0.5, method="synthetic-iteration", settings={"regular": "synthetic-iteration"})
    endless = vrte.Scene([vrte.Layer(HG, 0.9, np.inf)])
    with pytest.raises(SceneError, match="needs layers that end"):
        vrte.brdf(endless, 0.5, 0.5, method="synthetic-iteration", settings={"iterations": 2})
    assert vrte.brdf(endless, 0.5, 0.5, method="synthetic-iteration").mueller[..., 0, 0].min() > 0.0
