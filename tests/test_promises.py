"""What is promised is kept: scenes drawn by chance, solved to an accuracy, beside as many nodes as it takes."""

import numpy as np
import pytest

import vrte
from tests.random_scenes import Asked, asked, surfaced

ORDERLY = {"algorithm": "doubling"}  # of references: no eigenproblem on steep nodes


def find_reference(one: Asked, accuracy: float, counts: tuple[int, ...]) -> tuple[object, float]:
    """The answer on the first of these counts of graded nodes that differs from the one before by a tenth of the
    accuracy at most, and by how much it differs."""
    before, gap = one.solved(nodes=counts[0], grading=2, accuracy=1e-9, **ORDERLY), np.inf
    for count in counts[1:]:
        found = one.solved(nodes=count, grading=2, accuracy=1e-9, **ORDERLY)
        before, gap = found, before.error(found)
        if gap <= 0.1 * accuracy:
            break
    return before, gap


def check(seeds: range, finest: float, counts: tuple[int, ...]) -> None:
    promised = undecided = 0
    broken = []
    for seed in seeds:
        one = asked(seed, surfaced)
        accuracy = float(10.0 ** np.random.default_rng(seed).uniform(finest if not one.scene.is_rough else -3.0, -2.0))
        found = one.solved(accuracy=accuracy)
        if not found.made["promised"]:
            continue
        promised += 1
        assert found.made["achieved"] <= accuracy
        right, gap = find_reference(one, accuracy, counts if not one.scene.is_rough else counts[:3])
        undecided += gap > 0.3 * accuracy
        if found.error(right) > accuracy + gap:
            broken.append((seed, accuracy, found.error(right), found.made["nodes_rule"]))
    assert broken == []
    assert promised >= 0.9 * len(seeds)
    assert undecided <= 0.05 * len(seeds)


@pytest.mark.filterwarnings("ignore::vrte.LongSolveWarning")
def test_sixty_scenes() -> None:
    check(range(60), -4.0, (16, 24, 32, 48, 64))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vrte.LongSolveWarning")
def test_five_hundred_scenes() -> None:
    check(range(100, 600), -5.0, (24, 32, 48, 64, 96, 128))


def test_the_scenes_that_broke_them() -> None:
    """Once right to 6e-07 by 18 nodes and 2.6e-3 off; 146 times, 42 times more than promised."""
    rayleigh = vrte.rayleigh()
    thin = vrte.Scene([vrte.Interface(1.0, 1.2025), vrte.Layer(rayleigh, 0.9, 0.001451), vrte.Interface(1.2025, 1.0)])
    one = vrte.Scene([vrte.Interface(1.0, 1.3212), vrte.Layer(rayleigh, 1.0, 0.004246)])
    glass = vrte.Scene([vrte.Interface(1.0, 1.5), vrte.Layer(rayleigh, 0.9, 0.01), vrte.Interface(1.5, 1.0)])
    for scene, mu_i, mu_o, accuracy in (
        (thin, 0.3927, [0.7885, 0.9388, 0.5347], 1e-5),
        (one, 0.0511, [0.5441, 0.9415, 0.0774], 1e-5),
        (glass, 0.5, [0.2, 0.5, 0.9], 1e-4),
    ):
        found = vrte.brdf(scene, mu_i, mu_o, accuracy=accuracy, threads=1)
        right = vrte.brdf(scene, mu_i, mu_o, nodes=128, accuracy=1e-9, threads=1)
        assert found.diagnostics["promised"]
        assert np.abs(found.mueller - right.mueller).max() <= accuracy * right.mueller[..., 0, 0].max()


def test_counts_without_a_node_below_the_thickness_are_not_believed() -> None:
    """8 and 12 nodes agree to 7e-6, and both are 4.7e-5 off: the lowest of 8 lies above the thickness."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.3, 40), 1.0, 1.73211e-4)])
    call = {"mu0": 0.86, "mu": [0.48775549, 0.17467204], "phi": [0.0, 70.0, 180.0], "threads": 1}
    few, fewer = (vrte.radiance(scene, nodes=n, grading=2, accuracy=1e-9, **call).stokes for n in (12, 8))
    right = vrte.radiance(scene, nodes=48, grading=2, algorithm="doubling", accuracy=1e-9, **call).stokes
    brightest, accuracy = right[..., 0].max(), 3e-5
    assert np.abs(few - fewer).max() < 0.5 * accuracy * brightest  # the two agree
    assert np.abs(few - right).max() > accuracy * brightest
    found = vrte.radiance(scene, accuracy=accuracy, **call)
    assert found.diagnostics["promised"]
    assert np.abs(found.stokes - right).max() <= accuracy * brightest
    checked = vrte.radiance(scene, nodes=8, grading=2, accuracy=accuracy, verify=True, **call).diagnostics
    assert not checked["promised"]
    assert "too few nodes to see the thin layer" in checked["notes"][-1]


def test_polarized_light_is_compared_as_such() -> None:
    """9 nodes by I of natural light alone: 2.2e-4 off where 1e-4 was promised."""
    aerosol = vrte.spheres(1.385, radius_um=0.4, wavelength_um=0.55).phase_matrix
    scene = vrte.Scene([vrte.Layer(aerosol, 0.957, 5.0)], vrte.Lambertian(0.3))
    call = {"mu0": 0.8, "stokes": [1.0, -0.6, 0.3, -0.5], "mu": [0.05, 0.4, 0.9], "phi": [0.0, 60.0], "threads": 1}
    found, right = vrte.radiance(scene, accuracy=1e-4, **call), vrte.radiance(scene, nodes=64, **call)
    error = np.abs(found.stokes - right.stokes).max() / right.stokes[..., 0].max()
    assert found.diagnostics["promised"]
    assert error <= found.diagnostics["achieved"] <= 1e-4
