"""Peaked phase matrices at few nodes: nothing is lost, nothing is changed without need, and more nodes agree."""

import numpy as np
import pytest

import vrte
from vrte.optics.truncation import TRUNCATIONS, delta_m, truncated
from vrte.report.stability.phases import phase_matrix

HG = vrte.henyey_greenstein(0.9, 200)
MU = np.concatenate([np.linspace(0.05, 1.0, 12), -np.linspace(0.05, 1.0, 12)])
PHI = [0.0, 30.0, 90.0, 180.0]
TRUNCATING = [name for name in TRUNCATIONS if name != "none"]


def two_layers(albedo: float = 1.0, base: float = 0.3) -> vrte.Scene:
    return vrte.Scene(
        [vrte.Layer(HG, albedo, 3.0), vrte.Layer(phase_matrix("haze-L"), albedo, 1.0)], vrte.Lambertian(base)
    )


@pytest.mark.parametrize("name", TRUNCATING)
def test_energy_is_conserved(name: str) -> None:
    field = vrte.radiance(two_layers(), 0.6, mu=0.5, tau=[0.0, 1.3, 3.0, 3.5, 4.0], nodes=8, truncation=name)
    net = field.flux_down + field.direct - field.flux_up
    np.testing.assert_allclose(net, net[-1], rtol=0, atol=1e-14)
    white = vrte.radiance(two_layers(base=1.0), 0.6, mu=0.5, nodes=8, truncation=name)
    assert white.flux_up[0] == pytest.approx(0.6, abs=1e-12)


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
def test_both_algorithms_take_truncated_layers(algorithm: str) -> None:
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 1.3, 4.0], "nodes": 6, "truncation": "delta-m"}
    field = vrte.radiance(two_layers(0.9), 0.6, (1, 0.3, 0.2, 0.1), **asked, algorithm=algorithm)
    other = vrte.radiance(two_layers(0.9), 0.6, (1, 0.3, 0.2, 0.1), **asked)
    np.testing.assert_allclose(field.stokes, other.stokes, atol=1e-11)


@pytest.mark.parametrize("name", TRUNCATING)
def test_where_the_nodes_carry_all_terms_nothing_changes(name: str) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0), vrte.Layer(vrte.henyey_greenstein(0.3, 30), 1.0, 0.4)])
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 0.7, 1.4], "nodes": 15}
    plain = vrte.radiance(scene, 0.6, (1, 0.5, 0.3, 0.1), **asked)
    field = vrte.radiance(scene, 0.6, (1, 0.5, 0.3, 0.1), **asked, truncation=name)
    assert np.array_equal(field.stokes, plain.stokes)
    assert np.array_equal(field.flux_down, plain.flux_down)
    assert field.diagnostics["peak_fractions"] == [0.0, 0.0]


def test_conservative_layers_stay_exactly_conservative() -> None:
    for terms in range(1, 200):
        layer = delta_m(HG, 1.0, 7.0, terms)
        assert layer.albedo == 1.0
        assert layer.coefficients[0, 0] == 1.0
        assert layer.fraction == pytest.approx(0.9**terms)


def test_the_first_coefficient_left_out_is_the_peaks() -> None:
    # moments of layer and peak, weighted, are those of the phase matrix: a1[l]/(2l+1) = f + (1-f) a1'[l]/(2l+1)
    matrix = phase_matrix("haze-L")
    layer = delta_m(matrix, 0.9, 1.0, 12)
    f, degree = layer.fraction, 2.0 * np.arange(12) + 1.0
    assert f == matrix.a1[12] / 25.0
    for column, whole in ((0, matrix.a1), (3, matrix.a4)):
        np.testing.assert_allclose((1 - f) * layer.coefficients[:, column] + f * degree, whole[:12], atol=1e-15)
    for column, whole in ((1, matrix.a2), (2, matrix.a3)):
        np.testing.assert_allclose(((1 - f) * layer.coefficients[:, column] + f * degree)[2:], whole[2:12], atol=1e-15)
    for column, whole in ((4, matrix.b1), (5, matrix.b2)):
        np.testing.assert_allclose((1 - f) * layer.coefficients[:, column], whole[:12], atol=1e-15)
    assert layer.stretch * layer.gain == pytest.approx(0.9)
    # what is not scattered into the peak is as much as before: absorption per length, and the rest of the scattering
    assert (1 - layer.albedo) * layer.stretch == pytest.approx(0.1)
    assert layer.albedo * layer.stretch == pytest.approx(0.9 * (1 - f))


@pytest.mark.parametrize("backward", [vrte.henyey_greenstein(-0.8, 100), vrte.isotropic()])
def test_without_a_forward_peak_there_is_nothing_to_take_off(backward: vrte.PhaseMatrix) -> None:
    layer = delta_m(backward, 0.9, 2.0, 7)
    assert (layer.fraction, layer.albedo, layer.thickness) == (0.0, 0.9, 2.0)


@pytest.mark.parametrize("terms", [8, 16, 24, 40])
def test_truncated_haze_is_still_physical(terms: int) -> None:
    """As PhaseMatrix checks it: the coherency matrix is positive. (Nothing makes sure of that in general.)"""
    layer = delta_m(phase_matrix("haze-L"), 1.0, 1.0, terms)
    assert vrte.PhaseMatrix(*layer.coefficients.T).terms == terms


def test_depths_inside_layers_are_those_of_the_scene() -> None:
    """Light at a depth is that of the layer cut there, though delta-M stretches both parts."""
    whole = vrte.Scene([vrte.Layer(HG, 0.9, 3.0)])
    parts = vrte.Scene([vrte.Layer(HG, 0.9, 1.1), vrte.Layer(HG, 0.9, 1.9)])
    asked = {"mu": MU, "phi": PHI, "tau": [0.0, 1.1, 2.0, 3.0], "nodes": 6, "truncation": "delta-m"}
    one, two = (vrte.radiance(scene, 0.6, **asked) for scene in (whole, parts))
    np.testing.assert_allclose(one.stokes, two.stokes, atol=1e-13)
    np.testing.assert_allclose(one.flux_down, two.flux_down, atol=1e-14)


def error_of_reflection(scene: vrte.Scene, nodes: int, name: str, converged: np.ndarray) -> float:
    field = vrte.brdf(scene, [0.3, 0.8], MU[:12], PHI, nodes=nodes, truncation=name)
    return float(np.abs(field.mueller[..., 0, :] - converged[..., 0, :]).max() / converged[..., 0, 0].max())


def test_fewer_nodes_are_enough() -> None:
    """Against 40 nodes, which carry all 75 terms of haze L: 6 nodes with delta-M are better than 12 without."""
    scene = vrte.Scene([vrte.Layer(phase_matrix("haze-L"), 1.0, 2.0)])
    converged = vrte.brdf(scene, [0.3, 0.8], MU[:12], PHI, nodes=40).mueller
    coarse = error_of_reflection(scene, 6, "delta-m", converged)
    assert coarse < error_of_reflection(scene, 12, "none", converged)
    assert coarse < 5e-3
    assert error_of_reflection(scene, 12, "delta-m", converged) < 2e-4


def test_names_are_checked() -> None:
    with pytest.raises(vrte.SceneError, match="truncation must be 'none', 'delta-m', 'small-angle', not 'sharp'"):
        vrte.radiance(two_layers(), 0.6, truncation="sharp")
    assert truncated("none", HG, 1.0, 2.0, 10).coefficients.shape == (10, 6)
