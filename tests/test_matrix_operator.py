"""The matrix operator method: R and T of its slabs, the propagator, and fields beside discrete ordinates."""

import numpy as np
import pytest
import scipy.linalg

import vrte
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.responses import respond_by_beams
from vrte.methods.matrix_operator import propagator

from . import exact
from .helpers import assert_close
from .samples import spheroids

NODES = 6


@pytest.mark.parametrize("thickness", [1e-3, 0.5, 20.0])
def test_slab_solves_the_boundary_problem_of_the_paper(thickness: float) -> None:
    """(2:6)-(2:8) as they stand, order 1 of a layer with b2: all modes at both faces, each scaled to decay from its
    own."""
    scene, orders = vrte.Scene([vrte.Layer(spheroids(), 0.9, thickness)]), np.array([1], np.int32)
    problem = discretise_scene(scene, np.array([0.6]), np.eye(4), np.array([0.3, -0.8]), np.zeros(1), NODES)
    matrices = assemble(problem, orders, Run(1))
    E, F = matrices.E[0, 0].T, matrices.F[0, 0].T
    lam, X = scipy.linalg.eig(F @ E)
    k = np.sqrt(lam + 0j)
    Y = np.linalg.solve(F, X) * k
    with_light, against = (X + Y) / 2, (X - Y) / 2  # of a mode that decays downward, its light going down and up
    decay = np.exp(-k * thickness)
    falls_in = np.block([[with_light, against * decay], [against * decay, with_light]])
    comes_out = np.block([[against, with_light * decay], [with_light * decay, against]])
    whole = (comes_out @ np.linalg.inv(falls_in)).real
    (slab,) = respond_by_beams(
        "modes", problem, np.zeros(1, np.int32), np.array([thickness]), orders, Run(1), quick=False
    )
    R, T = slab.nodes[0]
    assert_close(whole, np.block([[R, T], [T, R]]), rtol=0.0, atol=1e-12)


def test_propagator_is_the_exponential_of_the_layer_matrix() -> None:
    """(2:7), in the public frame: the flux-scaled, flipped form of the other tests is not used here."""
    thin = vrte.Scene([vrte.Layer(spheroids(), 0.9, 0.1), vrte.Layer(vrte.rayleigh(), 0.7, 0.05)])
    found = propagator(thin, order=1, nodes=NODES).reshape(8 * NODES, 8 * NODES)
    points, weights = (np.polynomial.legendre.leggauss(NODES)[0] + 1) / 2, np.polynomial.legendre.leggauss(NODES)[1] / 2
    downward = np.concatenate([-points, points])  # cosines, light going up first
    expected = np.eye(8 * NODES)
    for layer in thin.layers:
        table = layer.phase_matrix.coefficients[: 2 * NODES]
        A = vrte._core.phase_matrices(1, table, downward, downward).transpose(0, 2, 1, 3).reshape(8 * NODES, -1)
        scattered = layer.albedo / 2 * A * np.repeat(np.tile(weights, 2), 4)
        slope = (scattered - np.eye(8 * NODES)) / np.repeat(downward, 4)[:, None]
        expected = scipy.linalg.expm(layer.thickness * slope) @ expected
    assert_close(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_propagator_of_a_thick_slab_is_refused() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 5.0)])
    with pytest.raises(vrte.AccuracyError, match=r"condition number of T_minus is .* R and T of \(2:8\)"):
        propagator(scene, nodes=NODES)
    with pytest.raises(vrte.SceneError, match="without a base"):
        propagator(vrte.Scene(scene.layers, vrte.Lambertian(0.5)), nodes=NODES)
    with pytest.raises(vrte.SceneError, match="which end"):
        propagator(vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, np.inf)]), nodes=NODES)
    with pytest.raises(vrte.SceneError, match="in one medium"):
        propagator(vrte.Scene([vrte.Interface(1.0, 1.5), *scene.layers]), nodes=NODES)


SCENES = {
    "mixing U and V": vrte.Scene([vrte.Layer(spheroids(), 0.9, 2.0)]),
    "conserving, thick": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 1e4)]),
    "nearly conserving": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0 - 1e-12, 1e4)]),
    "conserving without end": vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, np.inf)]),
    "over an endless layer": vrte.Scene([vrte.Layer(vrte.isotropic(), 0.0, 0.5), vrte.Layer(spheroids(), 0.9, np.inf)]),
    "three layers, base": vrte.Scene(
        [vrte.Layer(vrte.rayleigh(), 0.8, 0.5), vrte.Layer(spheroids(), 0.9, 2.0), vrte.Layer(vrte.rayleigh(), 0.8, 1)],
        vrte.Lambertian(0.4),
    ),
    "polarizing base": vrte.Scene(
        [vrte.Layer(vrte.isotropic(), 0.8, 0.5)],
        vrte.MuellerBase(
            lambda mu_i, mu_o, phi: 0.1 * np.diag([1.0, 0.5, -0.3, 0.2]) + 0.0 * (mu_i + mu_o + phi)[..., None, None]
        ),
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_equals_discrete_ordinates(name: str) -> None:
    """Inside and at the faces, at nodes' cosines, near them and near the beam's own."""
    scene, last = SCENES[name], min(SCENES[name].thickness, 4.0)
    asked = {
        "mu": [0.5, 0.5 * (1.0 + 1e-9), 0.2, 1.0, -0.2, -0.5, -0.500001, -1.0],
        "phi": [0.0, 50.0],
        "tau": [0.0, 0.3 * last, last],
        "nodes": NODES,
    }
    found = vrte.radiance(scene, 0.5, [1.0, 0.3, 0.2, -0.1], method="matrix-operator", **asked)
    expected = exact.radiance(scene, 0.5, [1.0, 0.3, 0.2, -0.1], **asked)
    assert_close(found.stokes, expected.stokes, rtol=0.0, atol=1e-11 * np.abs(expected.stokes).max())
    assert_close(found.flux_up, expected.flux_up, rtol=1e-11, atol=1e-13)
    assert_close(found.flux_down, expected.flux_down, rtol=1e-11, atol=1e-13)


def test_cosines_a_last_place_apart() -> None:
    """1/mu of neighbours may be the same number."""
    mu = np.array([0.7, np.nextafter(0.7, 1.0), np.nextafter(0.7, 0.0), 0.3])
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.9, 2.0)])
    found = vrte.brdf(scene, mu, mu, nodes=4, method="matrix-operator")
    expected = exact.brdf(scene, mu, mu, nodes=4)
    assert_close(found.mueller, expected.mueller, rtol=0.0, atol=1e-12 * np.abs(expected.mueller).max())
