"""Peaked phase matrices at few nodes: nothing is lost, nothing is changed without need, and more nodes agree."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import find_phase_matrix
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import Run, start_run
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.execution.sums import Target, fill_parts
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.planning.azimuths import fold_azimuths
from vrte.methods import solve_request
from vrte.optics.truncation import TRUNCATIONS, remove_forward_peak, truncate_layer
from vrte.request.request import Wanted, make_radiance_request
from vrte.results.result import Solution

from .helpers import assert_close, close_to

HG = vrte.henyey_greenstein(0.9, 200)
MU = np.concatenate([np.linspace(0.05, 1.0, 12), -np.linspace(0.05, 1.0, 12)])
PHI = [0.0, 30.0, 90.0, 180.0]
TRUNCATING = [name for name in TRUNCATIONS if name != "none"]


def two_layers(albedo: float = 1.0, base: float = 0.3) -> vrte.Scene:
    return vrte.Scene(
        [vrte.Layer(HG, albedo, 3.0), vrte.Layer(find_phase_matrix("haze-L"), albedo, 1.0)], vrte.Lambertian(base)
    )


@pytest.mark.parametrize("name", TRUNCATING)
def test_energy_is_conserved_and_scalar_layers_polarize_nothing(name: str) -> None:
    """Between depths, over white, in a semi-infinite layer."""
    field = vrte.radiance(two_layers(), 0.6, mu=0.5, tau=[0.0, 1.3, 3.0, 3.5, 4.0], nodes=8, truncation=name)
    net = field.flux_down + field.direct - field.flux_up
    assert_close(net, net[-1], rtol=0.0, atol=1e-14)
    white = vrte.radiance(two_layers(base=1.0), 0.6, mu=0.5, nodes=8, truncation=name)
    assert white.flux_up[0] == close_to(0.6, rtol=0.0, atol=1e-12)
    half_space = vrte.Scene([vrte.Layer(HG, 1.0, np.inf)])
    assert_close(
        vrte.brdf(half_space, [0.3, 0.8], 0.5, nodes=8, truncation=name).reflectance, 1.0, rtol=0.0, atol=1e-12
    )
    scene = vrte.Scene([vrte.Layer(HG, 1.0, 5.0)], vrte.Lambertian(0.5))
    mueller = vrte.brdf(scene, 0.5, MU[:12], PHI, nodes=6, truncation=name, transmission=True)
    assert mueller.diagnostics["peak_fractions"][0] > 0.2
    for values in (mueller.mueller, mueller.transmission):
        assert not values[..., 1:, :].any()
        assert not values[..., :, 1:].any()


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
def test_both_algorithms_take_truncated_layers(algorithm: str) -> None:
    """As the rule that chooses between them does, at depths that are those of the scene: light there is that of the
    layer cut there, though delta-M stretches both parts."""
    asked: dict[str, Any] = {"mu": MU, "phi": PHI, "tau": [0.0, 1.3, 4.0], "nodes": 6, "truncation": "delta-m"}
    field = vrte.radiance(two_layers(0.9), 0.6, (1, 0.3, 0.2, 0.1), **asked, algorithm=algorithm)
    other = vrte.radiance(two_layers(0.9), 0.6, (1, 0.3, 0.2, 0.1), **asked)
    assert_close(field.stokes, other.stokes, rtol=0.0, atol=1e-11)
    parts = [vrte.Layer(HG, 0.9, depth) for depth in (1.3, 2.7)]
    scenes = vrte.Scene([vrte.Layer(HG, 0.9, 4.0)]), vrte.Scene(parts)
    one, two = (vrte.radiance(scene, 0.6, **asked, algorithm=algorithm) for scene in scenes)
    assert_close(one.stokes, two.stokes, rtol=0.0, atol=1e-13)
    assert_close(one.flux_down, two.flux_down, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("name", TRUNCATING)
def test_where_the_nodes_carry_all_terms_nothing_changes(name: str) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0), vrte.Layer(vrte.henyey_greenstein(0.3, 30), 1.0, 0.4)])
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 0.7, 1.4], "nodes": 15}
    plain = vrte.radiance(scene, 0.6, (1, 0.5, 0.3, 0.1), **asked)
    field = vrte.radiance(scene, 0.6, (1, 0.5, 0.3, 0.1), **asked, truncation=name)
    assert np.array_equal(field.stokes, plain.stokes)
    assert np.array_equal(field.flux_down, plain.flux_down)
    assert field.diagnostics["peak_fractions"] == [0.0, 0.0]
    assert truncate_layer("none", HG, 1.0, 2.0, 10).coefficients.shape == (10, 6)


def test_the_first_coefficient_left_out_is_the_peaks() -> None:
    # moments of layer and peak, weighted, are those of the phase matrix: a1[l]/(2l+1) = f + (1-f) a1'[l]/(2l+1)
    matrix = find_phase_matrix("haze-L")
    layer = remove_forward_peak(matrix, 0.9, 1.0, 12)
    f, degree = layer.fraction, 2.0 * np.arange(12) + 1.0
    assert f == matrix.a1[12] / 25.0
    whole = matrix.coefficients[:12].copy()
    whole[:2, 1:3] = layer.coefficients[:2, 1:3] = 0.0  # where a2 and a3 mean nothing
    peak = f * degree[:, None] * [1, 1, 1, 1, 0, 0]
    peak[:2, 1:3] = 0.0
    assert_close((1 - f) * layer.coefficients + peak, whole, rtol=0.0, atol=1e-15)
    assert layer.stretch * layer.gain == close_to(0.9, rtol=1e-6, atol=0.0)
    # what is not scattered into the peak is as much as before: absorption per length, and the rest of the scattering
    assert (1 - layer.albedo) * layer.stretch == close_to(0.1, rtol=1e-6, atol=0.0)
    assert layer.albedo * layer.stretch == close_to(0.9 * (1 - f), rtol=1e-6, atol=0.0)


def error_of_reflection(scene: vrte.Scene, nodes: int, name: str, converged: np.ndarray) -> float:
    found = vrte.brdf(scene, 0.8, MU[:12], PHI, nodes=nodes, truncation=name).mueller[..., 0, 0]
    return float(np.abs(found - converged).max() / converged.max())


def test_fewer_nodes_are_enough() -> None:
    """Against 44 nodes, which are right to 3e-6: g = 0.9, with 8 nodes as well as with 16 where terms are cut."""
    scene, half_space = (vrte.Scene([vrte.Layer(HG, 1.0, depth)]) for depth in (5.0, np.inf))
    converged, deep = (
        vrte.brdf(given, 0.8, MU[:12], PHI, nodes=nodes).mueller[..., 0, 0]
        for given, nodes in ((scene, 44), (half_space, 36))
    )
    for name in TRUNCATING:
        assert error_of_reflection(scene, 8, name, converged) < 0.025
        assert error_of_reflection(scene, 16, name, converged) < 1.5e-3
        assert error_of_reflection(scene, 32, name, converged) < 1.5e-5
        assert error_of_reflection(half_space, 16, name, deep) < 3e-3
    assert error_of_reflection(scene, 8, "none", converged) > 0.2
    assert error_of_reflection(scene, 16, "none", converged) > 0.015


def test_light_near_the_beam() -> None:
    """Inside and below, polarized, through layers of two kinds, against nodes that carry all terms that count."""
    scene, beam = two_layers(0.95), (1.0, 0.3, 0.2, 0.5)
    mu = np.array([-0.52, -0.6, -0.68, -0.2, -1.0, 0.3])
    asked = {"mu": mu, "phi": [0.0, 6.0, 120.0], "tau": [1.0, 3.4, 4.0]}
    converged = vrte.radiance(scene, 0.6, beam, nodes=40, **asked, accuracy=1e-5, truncation="none").stokes
    for name, near, aside in (("delta-m", 0.3, 0.02), ("small-angle", 5e-3, 5e-3)):
        error = np.abs(vrte.radiance(scene, 0.6, beam, nodes=8, **asked, truncation=name).stokes - converged)
        error /= converged[..., 0].max(axis=(1, 2), keepdims=True)[..., None]
        assert error[:, :3, :2].max() < near
        assert np.delete(error, [0, 1, 2], axis=1).max() < aside


def test_spread_light_is_the_flux() -> None:
    """Radiance integrated over the lower hemisphere; delta-M leaves a hundredth of it out."""
    nodes, weights = make_double_gauss(60)
    scene, phi = vrte.Scene([vrte.Layer(HG, 1.0, 2.0)]), np.arange(1.0, 360.0, 2.0)
    for name, difference in (("delta-m", 0.014), ("small-angle", 1e-5)):
        field = vrte.radiance(scene, 0.6, mu=-nodes, phi=phi, tau=2.0, nodes=8, truncation=name)
        flux = 2.0 * np.pi * (field.stokes[0, ..., 0].mean(axis=1) @ (weights * nodes))
        assert abs(flux / field.flux_down[0] - 1.0) < difference


def test_without_a_peak_the_anisotropic_part_is_single_scattering() -> None:
    """The closed forms agree where the nodes carry all terms: one integrates over depths matrix by matrix."""
    scene, parts = two_layers(0.9), []
    problem = discretise_scene(scene, np.array([0.3, 1.0]), np.eye(4), MU, np.array([0.0, 1.0, 3.0, 4.0]), 100, "all")
    assert not problem.fraction.any()
    part = np.arange(4, dtype=np.int32), np.arange(MU.size, dtype=np.int32)
    wanted, azimuths = Wanted([part], np.arange(4, dtype=np.int32), np.ones(2)), fold_azimuths(np.array(PHI))
    for spreads in (np.zeros(MU.size, bool), np.ones(MU.size, bool)):
        target = Target(wanted, [scene], problem, MU, azimuths, spreads)
        parts.append(fill_parts(target, [], PROCESSOR, start_run(1))[0])
    assert_close(parts[1], parts[0], rtol=0.0, atol=1e-13 * np.abs(parts[0]).max())


def peaked_over_rayleigh() -> vrte.Scene:
    """A scalar layer that nodes cut, above a polarizing one."""
    return vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.8, 100), 1.0, 1.0), vrte.Layer(vrte.rayleigh(), 1.0, 0.5)])


def test_what_auto_takes() -> None:
    def rule(nodes: int, scene: vrte.Scene | None = None, **asked: Any) -> str:
        diagnostics = vrte.radiance(scene or two_layers(), 0.6, nodes=nodes, **asked).diagnostics
        assert diagnostics["truncation_rule"].startswith("auto: ")
        return str(diagnostics["truncation"])

    resolved = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 16), 0.9, 1.0)])
    assert rule(8, resolved, mu=MU, tau=[0.0, 1.0]) == "none"
    assert rule(8, mu=MU[:12]) == rule(8, mu=MU) == rule(8, mu=MU[:12], tau=1.0) == "delta-m"
    assert rule(8, mu=MU, tau=[0.0, 1.0]) == "delta-m, small-angle for light going down"
    haze = vrte.Scene([vrte.Layer(find_phase_matrix("haze-L"), 0.9, 1.0)])
    for scene, expected in ((haze, "delta-m"), (peaked_over_rayleigh(), "delta-m of polarizing layers")):
        assert lit_by_q(scene, 1.0, mu=MU[:12], nodes=8).diagnostics["truncation"] == expected


def test_auto_takes_each_where_it_is_better() -> None:
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 1.0, 4.0], "nodes": 6}
    auto, once, spread = (
        vrte.radiance(two_layers(), 0.6, **asked, truncation=name) for name in ("auto", "delta-m", "small-angle")
    )
    assert_close(auto.stokes[:, MU > 0.0], once.stokes[:, MU > 0.0], rtol=0.0, atol=1e-14)
    assert_close(auto.stokes[:, MU < 0.0], spread.stokes[:, MU < 0.0], rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(auto.flux_down, once.flux_down)
    # one of the two for all incident Stokes vectors: reciprocal
    haze = vrte.Scene([vrte.Layer(find_phase_matrix("haze-L"), 1.0, 3.0)], vrte.Lambertian(0.3))
    brdf = vrte.brdf(haze, MU[3:6], MU[3:6], [0.0, 120.0], nodes=6)
    forth, turned = brdf.mueller, brdf.mueller.transpose(1, 0, 2, 4, 3)
    minus = np.array([1.0, 1.0, 1.0, -1.0])
    assert_close(forth, minus[:, None] * turned * minus, rtol=0.0, atol=1e-13 * forth.max())


def test_polarized_light_through_scalar_layers() -> None:
    """The peak of a scalar layer has no Q, U and V; for these the layer is cut, which to them is no error."""
    scene = peaked_over_rayleigh()
    asked = {"mu_i": [0.3, 0.8], "mu_o": MU[:12], "phi": PHI, "transmission": True}
    exact = vrte.brdf(scene, nodes=24, truncation="none", **asked)
    once, auto = (vrte.brdf(scene, nodes=6, truncation=name, **asked) for name in ("delta-m", "auto"))

    def errors(found: vrte.Brdf) -> list[float]:
        """Of the columns for unpolarized and for polarized light, reflected and transmitted, over the largest I."""
        pairs = ((found.mueller, exact.mueller), (found.transmission, exact.transmission))
        return [
            float(np.abs(mine - right)[..., columns].max() / right[..., 0, 0].max())
            for mine, right in pairs
            for columns in (slice(0, 1), slice(1, 4))
        ]

    assert np.all(np.array(errors(once)) < [1.5e-2, 5e-6, 1.1, 1e-5])
    assert np.all(np.array(errors(auto)) < [1.5e-2, 5e-6, 1e-3, 1e-5])
    assert_close(auto.mueller[..., 0], once.mueller[..., 0], rtol=0.0, atol=1e-13)
    assert auto.diagnostics["polarized_light"]["truncation"].startswith("delta-m of polarizing layers")


DIMMED = vrte.PhaseMatrix(HG.a1[:100] * np.where(np.arange(100) == 0, 1.0, 0.7))  # a scalar one, which nodes cut


def add_to_dimmed(column: int, size: float) -> vrte.Scene:
    """A layer with a coefficient of degree 5 more."""
    table = DIMMED.coefficients.copy()
    table[5, column] += size
    return vrte.Scene([vrte.Layer(vrte.PhaseMatrix(*table.T, tolerance=1.0), 0.9, 1.0)])


@pytest.mark.parametrize("name", ["auto", *TRUNCATING])
@pytest.mark.parametrize("column", range(1, 6))
def test_a_little_polarization_changes_light_a_little(name: str, column: int) -> None:
    asked = {"mu": MU[[3, 9, 15, 20]], "phi": PHI, "tau": [0.0, 0.6, 1.0], "nodes": 8, "truncation": name}
    scalar, polarizing = (
        vrte.radiance(add_to_dimmed(column, size), 0.6, (1.0, 0.5, 0.4, 0.3), **asked).stokes for size in (0.0, 1e-6)
    )
    assert 0.0 < np.abs(polarizing - scalar).max() < 1e-6


@pytest.mark.parametrize(("column", "allowed"), [(1, 1e-8), (2, 1e-8), (3, 1e-8), (4, 5e-3), (5, 1e-8)])
def test_derivatives_of_a_scalar_phase_function_that_begins_to_polarize(column: int, allowed: float) -> None:
    """With 8 nodes, against differences with 50, which carry all terms; b1 makes and takes I, which has a peak."""
    name = f"layer[1].coefficients[5].{('a1', 'a2', 'a3', 'a4', 'b1', 'b2')[column]}"
    found = vrte.brdf(add_to_dimmed(column, 0.0), [0.1, 0.6], [0.35, 0.9], PHI, nodes=8, derivatives=[name])
    more, less = (
        vrte.brdf(add_to_dimmed(column, size), [0.1, 0.6], [0.35, 0.9], PHI, nodes=50).mueller for size in (1e-3, -1e-3)
    )
    right = (more - less) / 2e-3
    assert np.abs(found.jacobian[name] - right).max() < allowed * np.abs(right).max()


def lit_by_q(scene: vrte.Scene, part: float, mu: Any, phi: Any = 0.0, tau: Any = 0.0, nodes: int = 8) -> Solution:
    """What the Q of a beam does by itself, which is a part of a plan and no light."""
    request = make_radiance_request(scene, 0.6, (1, part, 0, 0), mu, phi, tau, nodes)
    return solve_request(replace(request, columns=np.array([[0.0, part, 0.0, 0.0]])), Run(1))[1]


def test_two_solutions_make_one_field() -> None:
    """Light that is polarized in part is the sum of what is and what is not; progress goes through both."""
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 0.7, 1.5], "nodes": 6}
    reported: list[tuple[int, int]] = []
    field = vrte.radiance(
        peaked_over_rayleigh(), 0.6, (1, 0.3, 0.2, 0.1), **asked, progress=lambda *done: reported.append(done)
    )
    unpolarized = vrte.radiance(peaked_over_rayleigh(), 0.6, **asked)
    opposite = vrte.radiance(peaked_over_rayleigh(), 0.6, (1, -0.3, -0.2, -0.1), **asked)
    scale = np.abs(field.stokes).max()
    assert np.abs(field.stokes - opposite.stokes).max() > 1e-3 * scale
    for name, atol in (("stokes", 2e-14 * scale), ("flux_up", 2e-15), ("flux_down", 2e-15)):
        twice, both = 2.0 * getattr(unpolarized, name), getattr(field, name) + getattr(opposite, name)
        assert_close(both, twice, rtol=0.0, atol=atol)
    assert reported == sorted(reported)
    assert reported[-1][0] == reported[-1][1]
    # what Q alone does is what Q does beside I: no order is left out for want of an I to compare it with
    scene = vrte.Scene([vrte.Layer(find_phase_matrix("haze-L"), 0.99, 3.0)])
    asked = {"mu": [0.3, 0.7, -0.5], "phi": [0.0, 40.0, 90.0], "tau": [0.0, 1.0], "nodes": 12}
    whole, light = (vrte.radiance(scene, 0.6, beam, **asked).stokes for beam in ((1, 0.4, 0, 0), (1, 0, 0, 0)))
    alone = lit_by_q(scene, 0.4, **asked).parts[0][:, 0, ..., 0]
    assert_close(alone, whole - light, rtol=0.0, atol=1e-8 * np.abs(light).max())


def test_counts_of_nodes_without_an_answer_are_passed_over() -> None:
    """Where 16 nodes of cut layers find no answer, and truncated ones are right to 1e-2."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.97, 600), 1.0, 20.0)], vrte.Lambertian(0.3))
    asked = {"mu": [0.3, 0.9, -0.5, -0.9], "tau": [0.0, 20.0]}
    right = vrte.radiance(scene, 0.6, nodes=96, **asked).stokes
    for name in ("auto", "none"):
        found = vrte.radiance(scene, 0.6, accuracy=1e-2, truncation=name, **asked)
        difference = np.abs(found.stokes - right).max(axis=(1, 2, 3)) / right[..., 0].max(axis=(1, 2))
        assert found.diagnostics["promised"]
        assert difference.max() <= 1e-2


def test_light_decays_over_truncated_depths() -> None:
    """Light deep inside is what it is beside light at the top: none of its orders is taken for that of the whole."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.99, 1500), 1.0, 300.0)])
    asked = {"mu": [-0.61, -0.5], "phi": [0.0, 90.0], "nodes": 8, "truncation": "delta-m"}
    alone, beside = (vrte.radiance(scene, 0.6, tau=tau, **asked).stokes[-1, ..., 0] for tau in (300.0, [0.0, 300.0]))
    assert_close(alone, beside, rtol=1e-7, atol=0.0)
