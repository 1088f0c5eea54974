"""Spheres of a core and a shell: published values, equation (8.2) of Bohren and Huffman in ball arithmetic, limits."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import vrte
from vrte._core import coated_sphere_coefficients, sphere_coefficients
from vrte.optics.spheres import check_coated_spheres, count_orders

from .helpers import assert_close, close_to
from .sphere_oracle import solve_exactly

TENTH = 0.1 ** (1.0 / 3.0)  # ratio of radii where the core has a tenth of the volume


def find_coefficients(core: complex, shell: complex, core_size: float, size: float) -> np.ndarray:
    return coated_sphere_coefficients(complex(core), complex(shell), core_size, size, count_orders(size))


def find_efficiencies(*sphere: Any) -> tuple[float, float]:
    """Qext, Qsca: Bohren and Huffman (4.61), (4.62)."""
    a, b = find_coefficients(*sphere)
    twice = 2.0 * np.arange(1, a.size + 1) + 1.0
    return 2 * twice @ (a + b).real / sphere[-1] ** 2, 2 * twice @ (abs(a) ** 2 + abs(b) ** 2) / sphere[-1] ** 2


SHARP = 100.0 * (1.0 + 3.1e-7)
PUBLISHED = {  # core, shell, size parameters of core and whole; extinction, scattering, absolute tolerance of both
    # Yang, Appl. Opt. 42, 1710 (2003), table 3: an absorber with a tenth of the volume around water, and inside
    "yang, shell": ((1.33, 2 + 1j, 0.9 ** (1 / 3) * 100, 100.0), (2.09947, 1.29372), 5.1e-6),
    "yang, core": ((2 + 1j, 1.33, TENTH * 100, 100.0), (2.20718, 1.87320), 6e-5),
    # b_107 is on the flank of a resonance 0.02 wide in x: a size that is wrong by 3.1e-7, a few roundings of single
    # precision, gives both of these numbers as printed
    "yang, core, single precision": ((2 + 1j, 1.33, TENTH * SHARP, SHARP), (2.20718, 1.87320), 5.1e-6),
    # Sun et al. (2004), as quoted in tpdsci.com/Tpc/ScaCtSphTestVal.php
    "sun": ((1.2 + 0.1j, 1.1 + 0.05j, 10.0, 12.0), (2.162570, 1.143034), 1e-6),
} | {  # carbon, x = 0.5, in water: the program of Liu et al. (2007), tpdsci.com/Tpc/ScaCtSphTestValLiu2007.php
    f"liu, x = {size:g}": ((1.59 + 0.66j, 1.33, 0.5, size), printed, 6e-7)
    for size, *printed in [
        (1.0, 0.366043, 0.124027),
        (10.0, 2.210291, 2.206762),
        (40.0, 1.987762, 1.987576),
        (70.0, 2.021424, 2.021344),
        (100.0, 2.101052, 2.101013),
        (500.0, 2.030372, 2.030371),
        (1000.0, 2.016579, 2.016578),
        (5000.0, 2.005736, 2.005736),
    ]
}


@pytest.mark.parametrize("case", PUBLISHED)
def test_published_efficiencies(case: str) -> None:
    sphere, printed, tolerance = PUBLISHED[case]
    assert_close(find_efficiencies(*sphere), printed, rtol=0.0, atol=tolerance)


CASES = [  # core, shell, size parameters of core and whole
    (1.5, 1.33, 0.5, 1.0),
    (1.0 / 1.33, 1.59 / 1.33, 3.0, 3.8),
    (2.7 / 1.5, 1.77 / 1.5, 1.9, 2.0),
    (1.5, 1.33, 5.0, 10.0),
    (2 + 1j, 1.33, TENTH * 100, 100.0),
    (1.33, 2 + 1j, 0.9 ** (1 / 3) * 100, 100.0),
    (2.7, 1.7, 10.0 * (1 - 1e-6), 10.0),  # thin shells
    (1.5, 10 + 10j, 10.0 * (1 - 1e-6), 10.0),
    (1.5, 0.05 + 4j, 20.0, 20.01),  # metals
    (1.5, 0.05 + 4j, 1.0, 1.2),
    (0.2 + 3.5j, 1.5, 20.0, 22.0),
    (0.97 + 1.87j, 2.71 + 0.28j, 30.0, 35.0),
    (30 + 20j, 1.5, 0.01, 0.02),
    (1.33, 30 + 20j, 0.01, 0.02),
    (2.7, 1.45, 1e-8, 5.0),  # hardly any core
    (2.7, 1e-3 + 1e-3j, 2.0, 5.0),
    (1.33, 1.0, 99.9, 100.0),
    (1.0, 1.33, 99.9, 100.0),
    (1.33, 1 + 3j, 1.0, 100.0),
    (0.75, 1.33 + 1e-5j, 70.0, 100.0),
]
LARGE = [
    (2.7, 1.45, 300.0, 310.0),
    (1.0 / 1.5, 1.59 / 1.5, 800.0, 1000.0),
    (2 + 1j, 1.5 + 1e-3j, 999.999, 1000.0),
    (10 + 10j, 3 + 5j, 500.0, 600.0),
    (1.5, 1.33, 1.0, 1000.0),
    (1.5, 0.1 + 0.001j, 50.0, 1000.0),
    (1.5, 1 + 0.5j, 900.0, 1000.0),
    (1.33, 10 + 10j, 1000.0 * (1 - 1e-6), 1000.0),
    (0.05 + 4j, 1.33, 990.0, 1000.0),
    (1.33, 0.05 + 4j, 990.0, 1000.0),
]


@pytest.mark.parametrize("case", CASES + [pytest.param(case, marks=pytest.mark.slow) for case in LARGE])
def test_coefficients_are_those_of_ball_arithmetic(case: tuple[Any, ...]) -> None:
    """To the rounding of the arguments m x, and what m makes of it where fields meet: |a_n|, |b_n| are 1 at most."""
    core, shell, core_size, size = case
    found = find_coefficients(*case)
    for n in sorted({1, 2, *(max(1, int(part)) for part in (core_size, size / 2, size, size + 2 * size ** (1 / 3)))}):
        exact = solve_exactly(n, case)
        assert found[:, n - 1] == close_to(exact, rtol=1e-10, atol=1e-300)
        assert abs(found[:, n - 1] - exact).max() < 1e-15 + 2e-16 * max(abs(core), abs(shell), 1.0) ** 2 * size


def draw_spheres(count: int) -> Iterator[tuple[complex, complex, float, float]]:
    random = np.random.default_rng(18)
    for _ in range(count):
        core, shell = random.uniform(0.5, 3.0, 2) + 1j * 10.0 ** random.uniform(-4.0, 1.0, 2) * random.integers(0, 2, 2)
        yield complex(core), complex(shell), random.uniform(0.01, 1.0), 10.0 ** random.uniform(-2.0, 2.5)


def test_limits_are_homogeneous_spheres_and_clear_ones_lose_nothing() -> None:
    """Equal indices, no coat, a vanishing core, and a shell of the host's index, to 1e-12."""
    for core, shell, ratio, size in draw_spheres(150):
        whole = sphere_coefficients(core, size, orders := count_orders(size))
        for inner, outer, part in ((core, core, ratio), (core, shell, 1.0)):
            assert abs(coated_sphere_coefficients(inner, outer, part * size, size, orders) - whole).max() < 1e-12
        vanishing = coated_sphere_coefficients(core, shell, 1e-8 * size, size, orders)
        assert abs(vanishing - sphere_coefficients(shell, size, orders)).max() < 1e-12
        bare = sphere_coefficients(core, ratio * size, count_orders(ratio * size))
        assert abs(coated_sphere_coefficients(core, 1.0, ratio * size, size, bare.shape[1]) - bare).max() < 1e-12
        extinction, scattering = find_efficiencies(core, shell, ratio * size, size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0) or extinction > scattering
        extinction, scattering = find_efficiencies(core.real, shell.real, ratio * size, size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0)


def test_nothing_overflows_at_the_ends_of_what_is_allowed() -> None:
    ends = (1e-4, 1e4 + 1e4j), (1e-4, 1e-4 + 1e4j, 1e4), (1e-11, 1.0), (1e-6, 1 - 1e-15)
    for core, shell, size, ratio in itertools.product(*ends):
        found = find_coefficients(core, shell, ratio * size, size)
        assert np.isfinite(found).all()
        assert abs(found).max() < 1.0 + 1e-9


@pytest.mark.parametrize("shape", [{"shell_um": 0.02}, {"core_ratio": 0.8}])
def test_sizes_are_averaged_with_a_fixed_shell_or_a_fixed_ratio(shape: dict[str, float]) -> None:
    """Against spheres of each radius, one by one."""
    how: dict[str, Any] = {"wavelength_um": 0.55, "host_index": 1.33} | shape
    sizes = vrte.Lognormal(0.15, 1.1)
    many = vrte.coated_spheres(1.0, 1.59, size=sizes, **how)
    radii, weights = sizes.quadrature(65)
    single = [vrte.coated_spheres(1.0, 1.59, radius_um=radius, **how) for radius in radii]
    assert many.extinction_um2 == close_to(weights @ [one.extinction_um2 for one in single], rtol=1e-6, atol=0.0)
    g = weights @ [one.scattering_um2 * one.asymmetry for one in single]
    assert many.asymmetry * many.scattering_um2 == close_to(g, rtol=1e-6, atol=0.0)
    assert many.volume_um3 == close_to(weights @ (4 / 3 * math.pi * radii**3), rtol=1e-6, atol=0.0)
    assert many.albedo == 1.0


def test_what_a_shell_changes_and_what_not() -> None:
    """Three ways to say one shell; rutile in a shell of its host's index is bare rutile, in a larger volume."""
    how: dict[str, Any] = {"wavelength_um": 0.55, "host_index": 1.5}
    shapes = ({"core_radius_um": 0.2}, {"shell_um": 0.05}, {"core_ratio": 0.8})
    reported = [vrte.coated_spheres(2.7, 1.46, radius_um=0.25, **how, **shape).extinction_um2 for shape in shapes]
    assert_close(reported, reported[0], rtol=1e-12, atol=0.0)
    bare = vrte.spheres(2.7, radius_um=0.1, **how)
    coated = vrte.coated_spheres(2.7, 1.5, core_radius_um=0.1, radius_um=0.15, **how)
    assert coated.extinction_um2 == close_to(bare.extinction_um2, rtol=1e-12, atol=0.0)
    assert coated.phase_matrix.coefficients == close_to(bare.phase_matrix.coefficients, rtol=0.0, atol=1e-11)
    assert coated.volume_um3 == close_to(3.375 * bare.volume_um3, rtol=1e-12, atol=0.0)


def test_particles_say_what_they_are_mix_and_are_checked_without_work() -> None:
    how: dict[str, Any] = {"radius_um": 0.2, "wavelength_um": 0.55, "host_index": 1.5}
    air, nothing = (vrte.coated_spheres(core, 1.59, core_ratio=0.8, **how) for core in ("air", 1.0))
    assert air.extinction_um2 == nothing.extinction_um2
    assert "index 1 + 0i (air" in air.description
    reported = vrte.coated_spheres("rutile", (1.46, 0.0), core_ratio=0.9, **how).description
    for words in (
        "a core of 0.9 of the radius, index 2.7533",
        "main/TiO2/Devore-o",
        "in a shell, index 1.46 + 0i (giv",
    ):
        assert words in reported
    assert "a shell of 0.01 um" in vrte.coated_spheres(1.0, 1.59, shell_um=0.01, **how).description
    both = vrte.mixture([(air, 0.4), (vrte.spheres(1.59, **how), 0.6)])
    assert [len(ball.substances) for ball, _ in both.balls] == [2, 1]
    assert vrte.Layer.of(both, thickness=2.0).albedo == 1.0
    checked = check_coated_spheres(1.0, 1.59, shell_um=0.01, **how)
    assert checked.balls[0][0].find_core_radius(0.2) == close_to(0.19, rtol=1e-6, atol=0.0)
    assert checked.volume_um3 == 1.0
