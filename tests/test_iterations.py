"""Ways that iterate: semi-infinite layers by invariance, slabs by partial fractions of tanh and GMRES, beside modes and
doubling, from thin to thick and at grazing directions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import replace_unchecked
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.doubling import Doubling
from vrte.discrete_ordinates.orders.invariance import reflect_semi_infinite
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.tanh_poles import (
    STEEPEST,
    STEEPEST_INSIDE,
    Scatterings,
    find_tangent,
    fit_depths,
    scatter_by_fractions,
)
from vrte.discrete_ordinates.planning.choice import choose_algorithms
from vrte.scene.boundary import BLACK

from .helpers import assert_close
from .samples import spheroids

ORDERS = np.array([0, 1, 4, 9], np.int32)
SPHEROIDS = spheroids()
MU_OUT = np.array([0.02, 0.4, 1.0, -0.02, -0.4, -1.0])


def discretise(
    albedo: float, thickness: float, share: tuple[float, ...] = (0.0, 1.0), phase: vrte.PhaseMatrix = SPHEROIDS
) -> Problem:
    """Two beams, one of them grazing, all incident Stokes columns; light wanted at both faces, or at shares of the
    thickness."""
    scene = vrte.Scene([vrte.Layer(phase, albedo, thickness)])
    return discretise_scene(scene, np.array([0.05, 0.7]), np.eye(4), MU_OUT, thickness * np.array(share), 6)


@pytest.mark.parametrize("largest", [1e-3, 3.0, 70.0, 700.0, STEEPEST])
def test_they_add_up_to_tanh(largest: float) -> None:
    """Everywhere up to the largest x, to a tenth of FINEST; all are positive."""
    tangent, x = find_tangent(largest), np.geomspace(1e-6, largest, 997)
    sums = tangent.constant + (tangent.share / np.add.outer(x * x, tangent.place)).sum(axis=1)
    assert np.abs(sums * x / np.tanh(x) - 1.0).max() < 1e-10
    assert min(tangent.place.min(), tangent.share.min(), tangent.constant) > 0.0


@pytest.mark.parametrize("largest", [1e-3, 3.0, 70.0, 700.0, STEEPEST_INSIDE])
def test_they_add_up_to_light_at_all_depths(largest: float) -> None:
    """cosh(z x)/cosh(x) and sinh(z x)/(x cosh(x)), the latter of tanh(x)/x, and tanh itself."""
    depths, x = np.array([-0.999, -0.5, 0.0, 1e-3, 0.7]), np.geomspace(1e-6, largest, 997)
    tangent, (even, odd) = fit_depths(largest, depths)
    terms = np.hstack([np.ones((x.size, 1)), 1.0 / np.add.outer(x * x, tangent.place)])
    zx, size = np.outer(x, depths), 2.0 / (1.0 + np.exp(-2.0 * x))[:, None]
    fade = np.exp(np.abs(zx) - x[:, None]) * size  # e^|z x| / cosh(x)
    assert_close(terms @ even.T, 0.5 * fade * (1.0 + np.exp(-2.0 * np.abs(zx))), rtol=0.0, atol=1e-11)
    shape = (x / np.tanh(x))[:, None]
    sinh = -0.5 * np.sign(zx) * fade * np.expm1(-2.0 * np.abs(zx)) / x[:, None]
    assert_close(terms @ odd.T * shape, sinh * shape, rtol=0.0, atol=1e-11)
    shares = np.append(tangent.constant, tangent.share)
    assert_close(terms @ shares * shape[:, 0], 1.0, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("albedo", [1.0, 0.97, 1e-6])
@pytest.mark.parametrize("thickness", [1e-6, 0.01, 1.0, 4.0])
@pytest.mark.parametrize("share", [(0.0, 1.0), (0.7, 1e-3, 1.0, 0.0, 0.5)])
@pytest.mark.parametrize("phase", [spheroids(), vrte.rayleigh(), vrte.isotropic(), vrte.henyey_greenstein(0.2, 24)])
def test_they_are_what_doubling_finds(
    phase: vrte.PhaseMatrix, share: tuple[float, ...], albedo: float, thickness: float
) -> None:
    """Light and fluxes at faces and inside, relative to the largest of all orders, or to a share of what is scattered
    once: where that is 1e12 times as much, what is scattered again need not have nine digits. Of matter with b2 = 0,
    without Q, U, V, and with more terms than columns as well."""
    problem, once = discretise(albedo, thickness, share=share, phase=phase), albedo * thickness
    found, wanted = (route(problem, BLACK, 12, 1e-8).solve(ORDERS, Run(1)) for route in (Scatterings, Doubling))
    for name in ("kernels", "flux_up", "flux_down"):
        mine, theirs = getattr(found, name), getattr(wanted, name)
        assert_close(mine, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max() + 1e-12 * once)
    (residual,) = found.residuals.values()
    assert residual.max() < 1e-11


FACES, INSIDE = [0.0, 1.0], [0.93, 1e-4, 0.3, 0.8, 1.0]  # over the thickness


@pytest.mark.parametrize(
    ("phase", "thickness", "mu0", "nodes", "albedo", "depths"),
    [
        (vrte.rayleigh(), 1e-12, 0.6, 24, 1.0, FACES),
        (vrte.rayleigh(), 6e-4, 0.3, 30, 1.0, FACES),
        (vrte.rayleigh(), 0.1, 2e-5, 25, 1.0, FACES),
        (vrte.rayleigh(), 2.5, 3e-4, 13, 1.0, FACES),
        (spheroids(), 6e-4, 0.3, 30, 1.0, INSIDE),
        (spheroids(), 3e-3, 3e-5, 28, 0.9, INSIDE),
        (spheroids(), 2.9, 0.0102, 11, 0.882, INSIDE),
        (spheroids(), 3.7, 0.0079, 27, 1.0, INSIDE),
        (spheroids(), 3.9, 0.07, 27, 6e-4, INSIDE),
    ],
)
def test_thin_slabs_and_grazing_beams_keep_the_accuracy(
    phase: vrte.PhaseMatrix, thickness: float, mu0: float, nodes: int, albedo: float, depths: list[float]
) -> None:
    """Relative to the largest I and the larger flux at each depth, of which the lowest have little where a grazing beam
    ends on top. Fluxes of the thinnest slabs, of which modes lose digits, are right to 1e-13."""
    scene, mu = vrte.Scene([vrte.Layer(phase, albedo, thickness)]), [-1.0, -0.3, -0.01, 0.01, 0.3, 1.0]
    tau = thickness * np.array(depths)
    asked: dict[str, Any] = {"mu": mu, "phi": [0.0, 50.0], "tau": tau, "nodes": nodes, "accuracy": 1e-9}
    found, right = (vrte.radiance(scene, mu0, **asked, algorithm=each) for each in ("auto", "doubling"))
    assert "scatterings" in found.diagnostics["orders_by"]
    largest = right.stokes[..., 0].max(axis=(1, 2))
    assert (np.abs(found.stokes - right.stokes).max(axis=(1, 2, 3)) < 1e-9 * largest).all()
    limit = (1e-13 if thickness < 1e-9 else 1e-9) * np.maximum(right.flux_up, right.flux_down)
    assert (np.abs(found.flux_up - right.flux_up) <= limit).all()
    assert (np.abs(found.flux_down - right.flux_down) <= limit).all()


def test_what_they_do_not_find_is_refused() -> None:
    """Light that finds no way out of a thick layer; slabs too steep for the sums."""
    with pytest.raises(AccuracyError, match="scatterings of order 0 do not converge"):
        scatter_by_fractions(discretise(1.0, 300.0), np.array([0], np.int32), 1e-8, Run(1))
    with pytest.raises(AccuracyError, match="at most 1024 half thicknesses over mu"):
        fit_depths(1.01 * STEEPEST_INSIDE, np.zeros(1))
    with pytest.raises(AccuracyError, match="at most 8192 half thicknesses over mu"):
        find_tangent(1.01 * STEEPEST)


def test_moments_that_still_change_are_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """GMRES that ends too early leaves a residual, and modes solve these orders again."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 1.0, 0.1)])
    asked: dict[str, Any] = {"mu": [0.2, 0.9], "phi": [0.0, 90.0], "nodes": 24, "accuracy": 1e-8}
    right = vrte.radiance(scene, 0.6, **asked)
    monkeypatch.setattr("vrte.discrete_ordinates.orders.tanh_poles.CONVERGED", 1e4)
    found = vrte.radiance(scene, 0.6, **asked)
    assert "scatterings" in right.diagnostics["orders_by"]
    assert found.diagnostics["orders_repeated"]["by"] == "modes"
    assert_close(found.stokes, right.stokes, rtol=0.0, atol=1e-8 * right.stokes.max())


def test_scenes_do_not_see_each_other() -> None:
    """Scenes side by side, on two threads, give the bits of each alone, the poles being the same."""
    one, other = discretise(0.9, 3.9), discretise(1.0, 3.95)
    both = replace_unchecked(
        one,
        coefficients=np.concatenate([one.coefficients, other.coefficients]),
        terms=np.concatenate([one.terms, other.terms]),
        albedo=np.array([0.9, 1.0]),
        thickness=np.array([3.9, 3.95]),
    )
    together = scatter_by_fractions(both, ORDERS, 1e-8, Run(2))
    for index, problem in enumerate((one, other)):
        alone = scatter_by_fractions(problem, ORDERS, 1e-8, Run(1))
        assert np.array_equal(alone.out[:, 0], together.out[:, index])
        assert np.array_equal(alone.on_nodes[:, 0], together.on_nodes[:, index])


def test_the_rule_takes_them_where_terms_are_few() -> None:
    """By choice for light of a slab of few terms and few beams, and told; not of thick ones, to full digits, or inside
    under beams that graze."""
    problem = discretise(0.9, 1.0)
    few = replace_unchecked(problem, mu0=problem.mu0[:1], directions=problem.directions[:-1], columns=np.eye(4)[:1])
    inside = replace_unchecked(few, level=np.array([0.0, 0.5]))
    grazing = replace_unchecked(inside, directions=np.append(few.directions, 1e-4))
    for asked, accuracy, taken in (
        (few, 1e-8, True),
        (few, 1e-12, False),
        (inside, 1e-8, True),
        (grazing, 1e-8, False),
        (replace_unchecked(few, thickness=np.array([30.0])), 1e-8, False),
        (problem, 1e-8, False),
    ):
        chosen = choose_algorithms("auto", asked, np.full(12, 0.5), accuracy, orders=np.arange(12, dtype=np.int32))
        assert ("scatterings" in [choice.name for _, choice in chosen]) is taken
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.97, 1.0)])
    found = vrte.radiance(scene, 0.6, mu=[0.2, 0.9], phi=[0.0, 90.0], nodes=24, accuracy=1e-8)
    modes = vrte.radiance(scene, 0.6, mu=[0.2, 0.9], phi=[0.0, 90.0], nodes=24, accuracy=1e-8, algorithm="modes")
    assert "few terms, few beams, one slab on black" in found.diagnostics["algorithm_rule"]
    assert found.diagnostics["orders_by"] == {"scatterings": found.diagnostics["orders"]}
    assert found.diagnostics["residual_of_scatterings"] < 1e-10
    assert_close(found.stokes, modes.stokes, rtol=0.0, atol=1e-9 * modes.stokes.max())


MU, PHI = np.array([0.05, 0.4, 1.0]), [0.0, 40.0, 180.0]


@pytest.mark.parametrize("matrix", [vrte.henyey_greenstein(-0.4, 12), spheroids()], ids=["backward", "spheroids"])
@pytest.mark.parametrize("albedo", [0.2, 0.9, 1.0])
def test_invariance_is_as_exact_as_asked(matrix: vrte.PhaseMatrix, albedo: float) -> None:
    scene = vrte.Scene([vrte.Layer(matrix, albedo, np.inf)])
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=12, accuracy=1e-15, algorithm="doubling")
    size = exact.mueller[..., 0, 0].max(axis=(1, 2))
    for accuracy in (1e-4, 1e-8, 1e-12):
        found = vrte.brdf(scene, MU, MU, PHI, nodes=12, accuracy=accuracy, algorithm="invariance")
        assert (np.abs(found.mueller - exact.mueller).max(axis=(1, 2, 3, 4)) <= accuracy * size).all()
        assert np.abs(found.reflectance - exact.reflectance).max() <= accuracy
        # a conservative order 0 does not converge: modes do it
        assert "invariance" in found.diagnostics["orders_by"] or albedo == 1.0


def test_invariance_is_taken_where_the_bottom_is_out_of_sight() -> None:
    matrix = vrte.spheres((1.5, 0.05), radius_um=0.4, wavelength_um=0.5).phase_matrix
    deep, shallow = (vrte.Scene([vrte.Layer(matrix, 0.8, t)], vrte.Lambertian(0.9)) for t in (200.0, 0.5))
    assert vrte.brdf(deep, MU, MU, PHI, nodes=24).diagnostics["orders_by"].get("invariance", 0) > 5
    assert "invariance" not in vrte.brdf(shallow, MU, MU, PHI, nodes=24).diagnostics["orders_by"]
    assert "invariance" not in vrte.radiance(deep, 0.5, mu=MU, tau=[0.0, 1.0], nodes=24).diagnostics["orders_by"]


def test_half_of_the_nodes_are_a_start() -> None:
    """Fixed points on Gauss's nodes begin on every other one: fewer of them, and the same light."""

    def solve(coarse: bool, nodes: int, grading: int = 1, phase: vrte.PhaseMatrix = SPHEROIDS) -> Any:
        scene = vrte.Scene([vrte.Layer(phase, 0.9, np.inf)])
        problem = discretise_scene(scene, MU, np.eye(4), MU, np.zeros(1), nodes, grading=grading)
        problem = replace_unchecked(problem, skip_flags=replace(problem.skip_flags, coarse=coarse))
        return reflect_semi_infinite(problem, ORDERS, 1e-10, Run(1))

    begun, plain = solve(True, 24), solve(False, 24)
    assert (begun.steps[:3] < 0.8 * plain.steps[:3]).all()
    assert_close(begun.kernels, plain.kernels, rtol=0.0, atol=1e-10 * np.abs(plain.kernels).max())
    # too few; nodes that no polynomial runs through: there the start is R = 0
    for nodes, grading in ((8, 1), (24, 2), (24, 3)):
        begun, plain = solve(True, nodes, grading), solve(False, nodes, grading)
        np.testing.assert_array_equal(begun.kernels, plain.kernels)
        np.testing.assert_array_equal(begun.steps, plain.steps)
    # half of the nodes see too little of a peak: R moves far from that start, which is given up
    peak = vrte.henyey_greenstein(-0.95)
    begun, plain = solve(True, 12, phase=peak), solve(False, 12, phase=peak)
    assert begun.steps[1] > plain.steps[1]
    assert_close(begun.kernels, plain.kernels, rtol=0.0, atol=1e-10 * np.abs(plain.kernels).max())
