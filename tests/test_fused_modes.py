"""All stages of modes by one call beside the five calls, one after another."""

import numpy as np
import pytest

import vrte
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.fused_modes import STAGES, complain_of_order
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import Modes
from vrte.scene.boundary import BLACK, Boundary

HAZE = vrte.Layer(vrte.henyey_greenstein(0.6, 24), 0.95, 0.7)
AIR = vrte.Layer(vrte.rayleigh(), 1.0, 0.4)
CLEAR = vrte.Layer(vrte.isotropic(), 0.0, 0.3)
MIXING = vrte.Layer(vrte.spheres("gold", radius_um=0.1, wavelength_um=0.64).phase_matrix, 0.9, np.inf)


def problem_of(layers: list[vrte.Layer], base: Boundary | None) -> Problem:
    scene = vrte.Scene(layers, base)
    levels = np.array([0.0, 0.5])
    return discretise_scene(scene, np.array([0.3, 0.8]), np.eye(4), np.array([0.2, 0.9, -0.5]), levels, 6)


@pytest.mark.parametrize(
    ("layers", "base"),
    [([HAZE, CLEAR, AIR], vrte.Lambertian(0.3)), ([AIR, HAZE], None), ([MIXING], None)],
    ids=["over Lambertian", "over black", "endless"],
)
def test_one_call_finds_what_five_find(layers: list[vrte.Layer], base: Boundary | None) -> None:
    """To the last bit: light, fluxes, residuals; and every stage is timed."""
    problem, orders = problem_of(layers, base), np.arange(4, dtype=np.int32)
    route = Modes(problem, base or BLACK, 4, 1e-8)
    alone, together = Run(1), Run(2)
    one, other = route.solve(orders, alone), route.solve(orders, together)
    np.testing.assert_array_equal(one.kernels, other.kernels)
    np.testing.assert_array_equal(one.flux_up, other.flux_up)
    np.testing.assert_array_equal(one.flux_down, other.flux_down)
    for name, values in other.residuals.items():
        np.testing.assert_array_equal(one.residuals[name], values)
    assert sorted(alone.stages) == sorted(together.stages) == sorted(STAGES)
    assert all(clock["thread_seconds"] > 0.0 for clock in alone.stages.values())


def test_a_run_that_is_stopped_gives_up() -> None:
    problem, run = problem_of([AIR, HAZE], None), Run(1)
    run.stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        Modes(problem, BLACK, 2, 1e-8).solve(np.arange(2, dtype=np.int32), run)


def test_what_fails_is_named() -> None:
    orders = np.array([3, 5], np.int32)
    with pytest.raises(AccuracyError, match="eigenproblem of order 5, layer 2 did not converge"):
        complain_of_order(orders, np.array([[0, 0], [1, 1]], np.int32))
    with pytest.raises(AccuracyError, match="boundary system of order 3 is singular"):
        complain_of_order(orders, np.array([[3, 0], [0, 0]], np.int32))
