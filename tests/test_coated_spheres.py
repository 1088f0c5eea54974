"""Spheres of a core and a shell: published values, equation (8.2) of Bohren and Huffman in ball arithmetic, limits."""

import math

import numpy as np
import pytest

import vrte
from vrte._core import coated_sphere_coefficients, sphere_coefficients
from vrte.basics.errors import SceneError
from vrte.optics.spheres import check_coated_spheres, count_orders

from .helpers import close_to
from .sphere_oracle import solve_exactly

WAVELENGTH = 2.0 * math.pi  # um: the radius in um is the size parameter
TENTH = 0.1 ** (1.0 / 3.0)  # ratio of radii where the core has a tenth of the volume


def find_coefficients(core, shell, core_size, size):
    return coated_sphere_coefficients(complex(core), complex(shell), core_size, size, count_orders(size))


def find_efficiencies(core, shell, core_size, size):
    """Qext, Qsca, Qback: Bohren and Huffman (4.61), (4.62), section 4.5."""
    a, b = find_coefficients(core, shell, core_size, size)
    n = np.arange(1, a.size + 1)
    extinction, scattering = (2 * n + 1) @ (a + b).real, (2 * n + 1) @ (abs(a) ** 2 + abs(b) ** 2)
    back = abs(((2 * n + 1) * (-1.0) ** n) @ (a - b)) ** 2
    return 2 * extinction / size**2, 2 * scattering / size**2, back / size**2


# ---- published values


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
    extinction, scattering, _ = find_efficiencies(*sphere)
    assert [extinction, scattering] == [close_to(each, rtol=0.0, atol=tolerance) for each in printed]


# ---- the equation as it is written, in ball arithmetic


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


@pytest.mark.parametrize(
    ("core", "shell", "core_size", "size"), CASES + [pytest.param(*case, marks=pytest.mark.slow) for case in LARGE]
)
def test_coefficients_are_those_of_ball_arithmetic(core, shell, core_size, size):
    """To the rounding of the arguments m x, and what m makes of it where fields meet: |a_n|, |b_n| are 1 at most."""
    found = find_coefficients(core, shell, core_size, size)
    for n in sorted({1, 2, *(max(1, int(part)) for part in (core_size, size / 2, size, size + 2 * size ** (1 / 3)))}):
        exact = solve_exactly(n, (core, shell, core_size, size))
        assert found[:, n - 1] == close_to(exact, rtol=1e-10, atol=1e-300)
        assert abs(found[:, n - 1] - exact).max() < 1e-15 + 2e-16 * max(abs(core), abs(shell), 1.0) ** 2 * size


# ---- limits


def draw_spheres(count):
    random = np.random.default_rng(18)
    for _ in range(count):
        indices = random.uniform(0.5, 3.0, 2) + 1j * 10.0 ** random.uniform(-4.0, 1.0, 2) * random.integers(0, 2, 2)
        yield *map(complex, indices), random.uniform(0.01, 1.0), 10.0 ** random.uniform(-2.0, 2.5)


def test_limits_are_homogeneous_spheres():
    """Equal indices, no coat, a vanishing core, and a shell of the host's index, to 1e-12."""
    for core, shell, ratio, size in draw_spheres(150):
        orders = count_orders(size)
        whole = sphere_coefficients(core, size, orders)
        assert abs(coated_sphere_coefficients(core, core, ratio * size, size, orders) - whole).max() < 1e-12
        assert abs(coated_sphere_coefficients(core, shell, size, size, orders) - whole).max() < 1e-12
        vanishing = coated_sphere_coefficients(core, shell, 1e-8 * size, size, orders)
        assert abs(vanishing - sphere_coefficients(shell, size, orders)).max() < 1e-12
        bare = sphere_coefficients(core, ratio * size, count_orders(ratio * size))
        in_host = coated_sphere_coefficients(core, 1.0, ratio * size, size, bare.shape[1])
        assert abs(in_host - bare).max() < 1e-12


def test_clear_spheres_lose_nothing_and_absorbing_ones_do():
    for core, shell, ratio, size in draw_spheres(150):
        extinction, scattering, _ = find_efficiencies(core, shell, ratio * size, size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0) or extinction > scattering
        extinction, scattering, _ = find_efficiencies(core.real, shell.real, ratio * size, size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0)


@pytest.mark.parametrize("core", [1e-4, 1e4 + 1e4j])
@pytest.mark.parametrize("shell", [1e-4, 1e-4 + 1e4j, 1e4])
@pytest.mark.parametrize("size", [1e-11, 1.0])
@pytest.mark.parametrize("ratio", [1e-6, 1 - 1e-15])
def test_nothing_overflows_at_the_ends_of_what_is_allowed(core, shell, size, ratio):
    found = find_coefficients(core, shell, ratio * size, size)
    assert np.isfinite(found).all()
    assert abs(found).max() < 1.0 + 1e-9


# ---- particles


@pytest.mark.parametrize("shape", [{"shell_um": 0.02}, {"core_ratio": 0.8}])
def test_sizes_are_averaged_with_a_fixed_shell_or_a_fixed_ratio(shape):
    """Against spheres of each radius, one by one."""
    how = {"wavelength_um": 0.55, "host_index": 1.33}
    sizes = vrte.Lognormal(0.15, 1.1)
    many = vrte.coated_spheres(1.0, 1.59, size=sizes, **how, **shape)
    radii, weights = sizes.quadrature(65)
    single = [vrte.coated_spheres(1.0, 1.59, radius_um=radius, **how, **shape) for radius in radii]
    assert many.extinction_um2 == close_to(weights @ [one.extinction_um2 for one in single], rtol=1e-6, atol=0.0)
    g = weights @ [one.scattering_um2 * one.asymmetry for one in single]
    assert many.asymmetry * many.scattering_um2 == close_to(g, rtol=1e-6, atol=0.0)
    assert many.volume_um3 == close_to(weights @ (4 / 3 * math.pi * radii**3), rtol=1e-6, atol=0.0)
    assert many.albedo == 1.0


def test_three_ways_to_say_the_same_shell():
    how = {"radius_um": 0.25, "wavelength_um": 0.55, "host_index": 1.5}
    shapes = ({"core_radius_um": 0.2}, {"shell_um": 0.05}, {"core_ratio": 0.8})
    first, *others = (vrte.coated_spheres(2.7, 1.46, **how, **shape) for shape in shapes)
    for other in others:
        assert other.extinction_um2 == close_to(first.extinction_um2, rtol=1e-12, atol=0.0)


def test_what_the_shell_does_not_change():
    """Rutile in a shell of its host's index is bare rutile, in a larger volume."""
    how = {"wavelength_um": 0.55, "host_index": 1.5}
    bare = vrte.spheres(2.7, radius_um=0.1, **how)
    coated = vrte.coated_spheres(2.7, 1.5, core_radius_um=0.1, radius_um=0.15, **how)
    assert coated.extinction_um2 == close_to(bare.extinction_um2, rtol=1e-12, atol=0.0)
    assert coated.phase_matrix.coefficients == close_to(bare.phase_matrix.coefficients, rtol=0.0, atol=1e-11)
    assert coated.volume_um3 == close_to(3.375 * bare.volume_um3, rtol=1e-12, atol=0.0)


def test_air_is_a_core() -> None:
    how = {"core_ratio": 0.8, "radius_um": 0.25, "wavelength_um": 0.55, "host_index": 1.5}
    air, nothing = (vrte.coated_spheres(core, 1.59, **how) for core in ("air", 1.0))
    assert air.extinction_um2 == nothing.extinction_um2
    assert "index 1 + 0i (air" in air.description


def test_particles_say_what_they_are():
    how = {"radius_um": 0.2, "wavelength_um": 0.55, "host_index": 1.5}
    said = vrte.coated_spheres("rutile", (1.46, 0.0), core_ratio=0.9, **how).description
    assert "a core of 0.9 of the radius, index 2.7533" in said
    assert "main/TiO2/Devore-o" in said
    assert "in a shell, index 1.46 + 0i (given)" in said
    assert "a shell of 0.01 um" in vrte.coated_spheres(1.0, 1.59, shell_um=0.01, **how).description


def test_coated_spheres_mix_and_fill_a_layer():
    how = {"wavelength_um": 0.55, "host_index": 1.33}
    hollow = vrte.coated_spheres(1.0, 1.59, core_ratio=0.8, radius_um=0.2, **how)
    grains = vrte.spheres(1.59, radius_um=0.1, **how)
    both = vrte.mixture([(hollow, 0.4), (grains, 0.6)])
    assert [len(ball.substances) for ball, _ in both.balls] == [2, 1]
    assert vrte.Layer.of(both, thickness=2.0).albedo == 1.0


@pytest.mark.parametrize(
    ("given", "words", "place"),
    [
        ({}, "exactly one of core_radius_um, shell_um and core_ratio", ()),
        ({"shell_um": 0.1, "core_ratio": 0.5}, "exactly one of core_radius_um, shell_um and core_ratio", ()),
        ({"core_ratio": 1.0}, "core_ratio must be a ratio of radii from 1e-06 to below 1, not 1.0", ("core_ratio",)),
        ({"core_ratio": 0.0}, "core_ratio must be a ratio", ("core_ratio",)),
        ({"core_ratio": math.nan}, "core_ratio must be a ratio", ("core_ratio",)),
        ({"core_ratio": "thin"}, "core_ratio must be a number", ("core_ratio",)),
        ({"shell_um": 0.0}, "shell_um must be a length", ("shell_um",)),
        ({"shell_um": -0.1}, "shell_um must be a length", ("shell_um",)),
        ({"shell_um": 0.2}, "shell_um must be less than the smallest radius .* 0.2 um, not 0.2", ("shell_um",)),
        ({"core_radius_um": 0.2}, "core_radius_um must be above 0 and less than radius_um", ("core_radius_um",)),
        ({"core_radius_um": -1.0}, "core_radius_um must be above 0", ("core_radius_um",)),
        ({"core_ratio": 0.5, "core": "golld"}, "^core: 'golld' is neither .* did you mean 'gold'", ("core",)),
        ({"core_ratio": 0.5, "shell": 1.5 - 0.1j}, "^shell: k must be >= 0", ("shell",)),
        ({"core_ratio": 0.5, "core": 1.0, "shell": 1.0}, "index of their host, 1, so they scatter nothing", ()),
        ({"core_ratio": 0.5, "size": vrte.Lognormal(0.1, 1.2)}, "either radius_um or size", ()),
        ({"core_ratio": 0.5, "radius_um": None}, "either radius_um or size", ()),
        ({"core_ratio": 0.5, "radius_um": 1e4}, "size parameter .* must be at most 10000", ()),
        ({"core_ratio": 0.5, "radius_um": 700.0, "shell": 40.0}, "times the size parameter must be at most", ()),
        ({"core_ratio": 0.5, "radius_um": 700.0, "core": 80.0}, "times the size parameter must be at most", ()),
        ({"core_ratio": 0.5, "host_index": (1.5, 0.1)}, "host_index: .* absorbs too much", ("host_index",)),
        ({"core_ratio": 0.5, "wavelength_um": 0.0}, "wavelength_um must be", ("wavelength_um",)),
        (
            {"core_radius_um": 0.1, "radius_um": None, "size": vrte.Lognormal(0.2, 1.2)},
            "core_radius_um goes with radius_um; spheres of many sizes need shell_um or core_ratio",
            ("core_radius_um",),
        ),
        (
            {"shell_um": 0.1, "radius_um": None, "size": vrte.Lognormal(0.2, 1.4)},
            r"shell_um must be less than the smallest radius that is averaged over, 0.02\d+ um, not 0.1",
            ("shell_um",),
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(given, words, place):
    given = {"core": 2.7, "shell": 1.5, "radius_um": 0.2, "wavelength_um": 0.5} | given
    for call in (vrte.coated_spheres, check_coated_spheres):
        with pytest.raises(SceneError, match=words) as caught:
            call(**given)
        assert caught.value.place == place


def test_checking_takes_the_same_arguments():
    particles = check_coated_spheres(1.0, 1.59, shell_um=0.01, radius_um=0.2, wavelength_um=0.5)
    assert particles.balls[0][0].find_core_radius(0.2) == close_to(0.19, rtol=1e-6, atol=0.0)
    assert particles.volume_um3 == 1.0
