"""The top of a semi-infinite layer by invariance, against modes and doubling."""

import numpy as np
import pytest

import vrte
from tests.samples import largest_gap, spheroids
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.invariance import reflect_semi_infinite
from vrte.discrete_ordinates.orders.phase_assembly import assemble

MU = np.array([0.05, 0.4, 1.0])
PHI = [0.0, 40.0, 180.0]


@pytest.mark.parametrize(
    "matrix",
    [vrte.isotropic(), vrte.henyey_greenstein(-0.4, 12), vrte.rayleigh(0.1), spheroids()],
    ids=["isotropic", "backward", "rayleigh", "spheroids"],
)
@pytest.mark.parametrize("albedo", [0.2, 0.9, 1.0])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-8, 1e-12])
def test_it_is_as_exact_as_asked(matrix: vrte.PhaseMatrix, albedo: float, accuracy: float) -> None:
    scene = vrte.Scene([vrte.Layer(matrix, albedo, np.inf)])
    found = vrte.brdf(scene, MU, MU, PHI, nodes=12, accuracy=accuracy, algorithm="invariance")
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=12, accuracy=1e-15, algorithm="doubling")
    size = exact.mueller[..., 0, 0].max(axis=(1, 2))
    gap = np.abs(found.mueller - exact.mueller).max(axis=(1, 2, 3, 4))
    assert (gap <= accuracy * size).all()
    assert np.abs(found.reflectance - exact.reflectance).max() <= accuracy
    # a conservative order 0 never settles: modes do it
    assert "invariance" in found.diagnostics["orders_by"] or albedo == 1.0


def test_its_equation_holds_on_the_nodes() -> None:
    """D R + R D = ((1 + R) e (1 + R) - (1 - R) f (1 - R))/2, R from the field on the nodes for beams along them."""
    layer = vrte.Layer(spheroids(), 0.9, np.inf)
    nodes = discretise_scene(vrte.Scene([layer]), np.ones(1), np.eye(4), np.ones(1), np.zeros(1), 8).nodes
    problem = discretise_scene(vrte.Scene([layer]), nodes, np.eye(4), nodes, np.zeros(1), 8)
    orders = np.array([1], np.int32)
    found = reflect_semi_infinite(problem, orders, 1e-14, Run(1))
    # the source of a unit beam is sqrt(weight/mu) times less than that of a scaled node
    scale = np.repeat(np.sqrt(problem.weights / problem.nodes), 4)
    R = found.on_nodes[0].T * scale
    matrices = assemble(problem, orders, Run(1))
    rate = np.diag(np.repeat(1.0 / nodes, 4))
    e, f = rate - matrices.E[0, 0].T, rate - matrices.F[0, 0].T
    one = np.eye(R.shape[0])
    right = ((one + R) @ e @ (one + R) - (one - R) @ f @ (one - R)) / 2.0
    assert largest_gap(rate @ R + R @ rate, right) < 1e-12


def test_it_is_taken_where_the_bottom_is_out_of_sight() -> None:
    matrix = vrte.spheres((1.5, 0.05), radius_um=0.4, wavelength_um=0.5).phase_matrix
    deep, shallow = (vrte.Scene([vrte.Layer(matrix, 0.8, t)], vrte.Lambertian(0.9)) for t in (200.0, 0.5))
    assert vrte.brdf(deep, MU, MU, PHI, nodes=24).diagnostics["orders_by"].get("invariance", 0) > 5
    low = vrte.brdf(shallow, MU, MU, PHI, nodes=24).diagnostics["orders_by"]
    assert "invariance" not in low
    inside = vrte.radiance(deep, 0.5, mu=MU, tau=[0.0, 1.0], nodes=24).diagnostics["orders_by"]
    assert "invariance" not in inside


def test_asked_for_where_it_does_not_apply_modes_do_it() -> None:
    made = vrte.brdf(vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 1.0)]), 0.5, 0.5, nodes=4, algorithm="invariance")
    assert made.diagnostics["algorithm"] == "modes"
    assert "invariance was asked for" in made.diagnostics["algorithm_rule"]
