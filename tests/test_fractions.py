"""Slabs by partial fractions of tanh, beside modes and doubling, from thin to thick and at grazing directions."""

import numpy as np
import pytest

import vrte
from vrte.basics.fields import change_fields
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.fractions import STEEPEST, find_tangent, reflect_by_fractions
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.routes import Doubling, Fractions
from vrte.discrete_ordinates.planning.choice import is_for_fractions
from vrte.scene.boundary import BLACK

from .samples import spheroids

ORDERS = np.array([0, 1, 4, 9], np.int32)
MU_OUT = np.array([0.02, 0.4, 1.0, -0.02, -0.4, -1.0])


def discretise(albedo: float, thickness: float, nodes: int = 6) -> Problem:
    """Two beams, one of them grazing, all incident Stokes columns; light wanted at both faces."""
    scene = vrte.Scene([vrte.Layer(spheroids(), albedo, thickness)])
    return discretise_scene(scene, np.array([0.05, 0.7]), np.eye(4), MU_OUT, np.array([0.0, thickness]), nodes)


@pytest.mark.parametrize("largest", [1e-3, 3.0, 70.0, STEEPEST])
def test_they_add_up_to_tanh(largest: float) -> None:
    """Everywhere up to the largest x, to a tenth of FINEST; all are positive."""
    tangent, x = find_tangent(largest), np.geomspace(1e-6, largest, 997)
    sums = tangent.constant + (tangent.share / np.add.outer(x * x, tangent.place)).sum(axis=1)
    assert np.abs(sums * x / np.tanh(x) - 1.0).max() < 3e-10
    assert min(tangent.place.min(), tangent.share.min(), tangent.constant) > 0.0


@pytest.mark.parametrize("albedo", [1.0, 0.97, 1e-6])
@pytest.mark.parametrize("thickness", [1e-6, 0.01, 1.0, 4.0])
def test_they_are_what_doubling_finds(albedo: float, thickness: float) -> None:
    """Kernels at both faces and fluxes, order by order, relative to the order's largest."""
    problem = discretise(albedo, thickness)
    found, wanted = (route(problem, BLACK, 12, 1e-8).solve(ORDERS, Run(1)) for route in (Fractions, Doubling))
    for mine, theirs in zip(found.kernels, wanted.kernels, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())
    for mine, theirs in ((found.flux_up, wanted.flux_up), (found.flux_down, wanted.flux_down)):
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())
    assert found.residuals["residual_of_fractions"].max() < 1e-13


def test_scenes_do_not_see_each_other() -> None:
    """Scenes side by side, on two threads, give the bits of each alone, the fractions being the same."""
    one, other = discretise(0.9, 3.9), discretise(1.0, 3.95)
    both = change_fields(
        one,
        coefficients=np.concatenate([one.coefficients, other.coefficients]),
        terms=np.concatenate([one.terms, other.terms]),
        albedo=np.array([0.9, 1.0]),
        thickness=np.array([3.9, 3.95]),
    )
    together = reflect_by_fractions(both, ORDERS, assemble(both, ORDERS, Run(2)), Run(2))
    for place, problem in enumerate((one, other)):
        alone = reflect_by_fractions(problem, ORDERS, assemble(problem, ORDERS, Run(1)), Run(1))
        assert np.array_equal(alone.out[:, 0], together.out[:, place])
        assert np.array_equal(alone.on_nodes[:, 0], together.on_nodes[:, place])


def test_the_rule_takes_them_where_terms_are_few() -> None:
    """By choice for light leaving a slab of few terms, and told; not for its inside, its multiples or full digits."""
    problem = discretise(0.9, 1.0)
    assert is_for_fractions(problem, 1e-8)
    assert not is_for_fractions(problem, 1e-12)
    assert not is_for_fractions(change_fields(problem, level=np.array([0.0, 0.5])), 1e-8)
    assert not is_for_fractions(discretise(0.9, 30.0), 1e-8)
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.97, 1.0)])
    found = vrte.radiance(scene, 0.6, mu=[0.2, 0.9], phi=[0.0, 90.0], nodes=24, accuracy=1e-8)
    modes = vrte.radiance(scene, 0.6, mu=[0.2, 0.9], phi=[0.0, 90.0], nodes=24, accuracy=1e-8, algorithm="modes")
    assert "few terms, one slab on black" in found.diagnostics["algorithm_rule"]
    np.testing.assert_allclose(found.stokes, modes.stokes, rtol=0.0, atol=1e-9 * modes.stokes.max())
