"""Refractive indices, size distributions, spheres and coated ones, against tables, limits and ball arithmetic."""

import csv
import itertools
import math
import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte._core import coated_sphere_coefficients, sphere_coefficients
from vrte.optics.particles import SizeAverageWarning
from vrte.optics.refractive_index import MATERIALS, RefractiveIndex, refractive_index
from vrte.optics.spheres import check_coated_spheres, compute_mie_coefficients, count_orders

from .helpers import assert_close, close_to, printed_by
from .sphere_oracle import solve_exactly, sum_amplitudes, sum_efficiencies

WAVELENGTH = 2.0 * math.pi  # um: the radius in um is the size parameter
ball = partial(vrte.spheres, wavelength_um=WAVELENGTH)


def solve(*sphere: Any) -> np.ndarray:
    """a_n and b_n (2, orders) of indices and size parameters, both from the inside out."""
    indices, sizes = np.split(np.array(sphere, complex), 2)
    kernel: Any = sphere_coefficients if indices.size == 1 else coated_sphere_coefficients
    numbers = *indices[:, None], *sizes.real[:, None], np.array([count_orders(sizes[-1].real)], np.int32)
    return kernel(*numbers)[0]


# ---- refractive indices


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_every_named_material_has_an_index(name: str) -> None:
    index = refractive_index(name, 0.64)
    assert index.n > 0.0
    assert index.k >= 0.0
    assert all(page in index.source for page in MATERIALS[name].pages)
    assert MATERIALS[name].reason


def test_indices_are_those_of_their_tables() -> None:
    """Johnson and Christy, Phys. Rev. B 6, 4370 (1972), 2.01 eV; Malitson, J. Opt. Soc. Am. 55, 1205 (1965), 1.45846 at
    the sodium D line; uniaxial crystals have the mean permittivity; numbers are taken as they are."""
    gold, silica = refractive_index("gold", 1.23984198 / 2.01), refractive_index("silica", 0.5893)
    assert_close([gold.n, gold.k], [0.21, 3.272], rtol=0.0, atol=2e-3)
    assert (silica.n, silica.k) == (close_to(1.45840, rtol=0.0, atol=1e-4), 0.0)
    assert "no k in the table: k = 0" in silica.source
    assert refractive_index("main/Au/Johnson", 0.5) == refractive_index("  Gold", 0.5)
    assert refractive_index("zinc_oxide", 0.6) == refractive_index("zinc oxide", 0.6)
    for name, book in (("hematite", "Fe2O3/Querry"), ("rutile", "TiO2/Devore")):
        o, e = (refractive_index(f"main/{book}-{ray}", 0.55).value for ray in "oe")
        mean, absorbed = refractive_index(name, 0.55), 1e-5j if name == "rutile" else 0.0
        assert mean.value**2 == close_to((2 * (o + absorbed) ** 2 + (e + absorbed) ** 2) / 3, rtol=1e-6, atol=0.0)
        assert "mean permittivity (2 o + e)/3" in mean.source
    assert refractive_index(1.5, 0.5) == RefractiveIndex(1.5, 0.0, "given")
    for given in (1.5 + 0.01j, (1.5, 0.01), np.array([1.5, 0.01])):
        assert refractive_index(given, 0.5).value == 1.5 + 0.01j
    assert refractive_index(gold, 0.5) == gold


def test_rutiles_formulas_go_on_below_their_range_and_its_absorption_is_published_values_and_tails() -> None:
    """n, k of Ribarsky in Palik (1985), the ordinary ray at 0.400 and 0.358 um, the other at 0.400 and 0.360 um; k of
    0.008 at 0.402 um, and between its rows the same factor for each step of photon energy."""
    for wavelength, n, within in ((0.4, (2 * 3.00 + 3.40) / 3, 0.01), (0.36, (2 * 3.38 + 3.87) / 3, 0.08)):
        assert refractive_index("rutile", wavelength).n == close_to(n, rtol=0.0, atol=within)
    for wavelength, k in ((0.36, (2 * 0.11 + 0.251) / 3), (0.402, 0.008), (0.45, 1e-5), (0.7, 1e-5)):
        assert refractive_index("rutile", wavelength).k == close_to(k, rtol=0.02, atol=0.0)
    energies = np.linspace(1.0 / 0.45, 1.0 / 0.402, 5)
    k = np.array([refractive_index("rutile", 1.0 / energy).k for energy in energies])
    assert_close(k[1:] / k[:-1], np.full(4, 800.0**0.25), rtol=1e-3, atol=0.0)
    with pytest.raises(vrte.SceneError, match=r"rutile goes from 0\.36 to 1\.53 um; a wavelength of 0\.35 um is"):
        refractive_index("rutile", 0.35)


OFFLINE = """
import os, socket, sys
def refuse(*a, **k): raise OSError('no network here')
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
os.environ['HOME'] = os.environ['XDG_CACHE_HOME'] = os.getcwd()
from vrte.optics.refractive_index import refractive_index
print(refractive_index('gold', 0.64).n)
"""


def test_the_database_needs_no_network_and_no_home(tmp_path: Path) -> None:
    assert printed_by(OFFLINE, tmp_path) == [repr(refractive_index("gold", 0.64).n)]
    assert list(tmp_path.iterdir()) == []


# ---- size distributions


def test_moments_of_distributions_are_those_of_their_formulas() -> None:
    radii, weights = vrte.Lognormal(0.3, 1.5).quadrature(257)
    for power in (0, 2, 3, 4, 6):
        exact = 0.3**power * math.exp((power * math.log(1.5)) ** 2 / 2)
        assert weights @ radii**power == close_to(exact, rtol=1e-9 if power else 1e-6, atol=0.0)
    for v_eff in (0.01, 0.07, 0.25, 0.4):
        radii, weights = vrte.Gamma(0.2, v_eff).quadrature(513)
        shape, scale = (1 - 2 * v_eff) / v_eff, 0.2 * v_eff
        for power in (2, 3, 4, 6):
            exact = scale**power * math.exp(math.lgamma(shape + power) - math.lgamma(shape))
            assert weights @ radii**power == close_to(exact, rtol=1e-9, atol=0.0)
        area = weights @ radii**2
        effective = weights @ radii**3 / area
        variance = weights @ (radii**2 * (radii - effective) ** 2) / area / effective**2
        assert (effective, variance) == (close_to(0.2, rtol=1e-9, atol=0.0), close_to(v_eff, rtol=1e-8, atol=0.0))
    radii, weights = vrte.Tabulated([0.1, 0.2, 0.4], [0.0, 5.0, 0.0]).quadrature(2049)
    assert weights @ radii == close_to(0.7 / 3, rtol=1e-6, atol=0.0)  # the centroid of a triangle
    assert weights.sum() == close_to(1.0, rtol=1e-6, atol=0.0)
    assert vrte.Tabulated(np.linspace(1, 2, 300), np.ones(300)).quadrature(10)[0].size == 300


def test_cloud_c1_is_the_published_one() -> None:
    """Deirmendjian's modified gamma distribution r^6 exp(-1.5 r), its mode at 4 um."""
    radii, weights = vrte.Gamma(r_eff_um=6.0, v_eff=1.0 / 9.0).quadrature(400)
    density, expected = (weights / radii)[1:-1], (radii**6 * np.exp(-1.5 * radii))[1:-1]  # equal steps in the logarithm
    assert_close(density / density.max(), expected / expected.max(), rtol=1e-10, atol=0.0)


@pytest.mark.parametrize(
    "distribution",
    [vrte.Lognormal(0.2, 1.4), vrte.Gamma(0.2, 0.07), vrte.Tabulated([0.1, 0.3, 0.4], [1, 2, 0])],
    ids=repr,
)
def test_radii_come_back_when_their_number_doubles_and_after_pickling(distribution: Any) -> None:
    few, many = (set(distribution.quadrature(count)[0]) for count in (129, 257))
    assert few < many
    again = pickle.loads(pickle.dumps(distribution))
    np.testing.assert_array_equal(again.quadrature(129), distribution.quadrature(129))
    assert repr(again) == repr(distribution)


# ---- a_n and b_n, and efficiencies that were published

TENTH = 0.1 ** (1.0 / 3.0)  # ratio of radii where the core has a tenth of the volume
SHARP = 100.0 * (1.0 + 3.1e-7)
PUBLISHED = {  # indices and size parameters from the inside out; extinction, scattering, absolute tolerance of both
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
    assert_close(sum_efficiencies(*solve(*sphere), sphere[-1])[:2], printed, rtol=0.0, atol=tolerance)


# Wiscombe's MIEV0 test cases (NCAR/TN-140+STR), refractive index n + ik: index, size parameter, Qsca, g
MIEV0 = [
    (1.33 + 1e-5j, 1.0, 0.093923, 0.184517),
    (1.33 + 1e-5j, 100.0, 2.096594, 0.868959),
    (1.5 + 1j, 0.055, 0.000011, 0.000491),
    (1.5 + 1j, 100.0, 1.283697, 0.850252),
    (10 + 10j, 1.0, 2.049405, -0.110664),
    (0.75, 10.0, 2.232265, 0.896473),
]
# the same report: angle, S1, S2 of index 1.5 - 1i, size parameter 1
AMPLITUDES = [
    (0, 0.58408 + 0.190515j, 0.58408 + 0.190515j),
    (30, 0.565702 + 0.1872j, 0.500161 + 0.145611j),
    (60, 0.517525 + 0.178443j, 0.287964 + 0.041054j),
    (90, 0.45634 + 0.167167j, 0.0362285 - 0.0618265j),
    (120, 0.400212 + 0.156643j, -0.174875 - 0.122959j),
    (150, 0.362157 + 0.149391j, -0.305682 - 0.143846j),
    (180, 0.348844 + 0.146829j, -0.348844 - 0.146829j),
]


def test_miev0_amplitudes() -> None:
    """And the efficiencies that are quoted here. Amplitudes are printed for n - ik: conjugate ones."""
    angle, *printed = np.array(AMPLITUDES).T
    assert_close(np.conj(sum_amplitudes(*solve(1.5 + 1j, 1.0), angle.real)), printed, rtol=0.0, atol=7.1e-7)
    for index, size, scattering, g in MIEV0:
        found = sum_efficiencies(*solve(index, size), size)[1:]
        assert_close(found, [scattering, g], rtol=0.0, atol=1.1e-6)


def test_miev0_all(reference: Callable[[str], Path]) -> None:
    with reference("mie/miev0_testcases.csv").open() as file:
        cases = [row for row in csv.DictReader(file) if "PEC" not in row["m_im"]]
    assert len(cases) == 19
    for row in cases:
        size = float(row["x"])
        found = sum_efficiencies(*solve(complex(float(row["m_re"]), -float(row["m_im"])), size), size)
        for value, column in zip(found, ("Qext", "Qsca", "g"), strict=True):
            if row[column]:
                digits = len(row[column].partition(".")[2])
                assert abs(value - float(row[column])) <= 1.1 * 10.0**-digits, (row, column)


SPHERES: list[tuple[Any, ...]] = [  # index, size parameter; what a_n and b_n may be off, over the largest
    (1.5 + 1.0j, 1e-3, 1e-15),
    (1.5, math.pi, 1e-15),
    (0.2 + 3.4j, 5.9, 1e-15),
    (1.0001, 50.0, 1e-12),
    (10.0 + 10.0j, 100.0, 1e-15),
    (2.7, 30.0, 2e-14),
    (1.33, 1000.0, 2e-13),
]
COATED: list[tuple[Any, ...]] = [  # core, shell, size parameters of core and whole
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
LARGE: list[tuple[Any, ...]] = [
    (10.0, 5000.0, 2e-12),
    (2.7, 1.45, 300.0, 310.0),
    (2 + 1j, 1.5 + 1e-3j, 999.999, 1000.0),
    (10 + 10j, 3 + 5j, 500.0, 600.0),
    (1.5, 1.33, 1.0, 1000.0),
    (1.5, 0.1 + 0.001j, 50.0, 1000.0),
    (1.33, 10 + 10j, 1000.0 * (1 - 1e-6), 1000.0),
]


@pytest.mark.parametrize(
    "case", [*SPHERES, *COATED, *(pytest.param(case, marks=pytest.mark.slow) for case in LARGE)], ids=str
)
def test_coefficients_are_those_of_ball_arithmetic(case: tuple[Any, ...]) -> None:
    """Of coated spheres to the rounding of the arguments m x, and what m makes of it where fields meet: |a_n|, |b_n|
    are 1 at most."""
    sphere = case[: len(case) // 2 * 2]
    found, size = solve(*sphere), sphere[-1]
    orders = {1, 2, *(max(1, int(part)) for part in (size / 2, size, size + 2 * size ** (1 / 3)))}
    if len(sphere) == 4:
        orders.add(max(1, int(sphere[2])))
        within = 1e-15 + 2e-16 * max(*map(abs, sphere[:2]), 1.0) ** 2 * size
    else:
        within = case[-1] * np.abs(found).max()
    for n in orders:
        exact = solve_exactly(n, sphere)
        assert abs(found[:, n - 1] - exact).max() <= within
        if len(sphere) == 4:
            assert found[:, n - 1] == close_to(exact, rtol=1e-10, atol=1e-300)


def test_limits_are_homogeneous_spheres_and_clear_ones_lose_nothing() -> None:
    """Equal indices, no coat, a vanishing core, and a shell of the host's index, to 1e-12."""
    random = np.random.default_rng(18)
    for _ in range(150):
        core, shell = random.uniform(0.5, 3.0, 2) + 1j * 10.0 ** random.uniform(-4.0, 1.0, 2) * random.integers(0, 2, 2)
        ratio, size = random.uniform(0.01, 1.0), 10.0 ** random.uniform(-2.0, 2.5)
        whole, inside = solve(core, size), solve(core, ratio * size)
        for limit, found in (
            (whole, solve(core, core, ratio * size, size)),
            (whole, solve(core, shell, size, size)),
            (solve(shell, size), solve(core, shell, 1e-8 * size, size)),
            (inside, solve(core, 1.0, ratio * size, size)[:, : inside.shape[1]]),
        ):
            assert abs(found - limit).max() < 1e-12
        extinction, scattering, _ = sum_efficiencies(*solve(core, shell, ratio * size, size), size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0) or extinction > scattering
        extinction, scattering, _ = sum_efficiencies(*solve(core.real, shell.real, ratio * size, size), size)
        assert extinction == close_to(scattering, rtol=2e-11, atol=0.0)


def test_nothing_overflows_at_the_ends_of_what_is_allowed() -> None:
    ends = (1e-4, 1e4 + 1e4j), (1e-4, 1e-4 + 1e4j, 1e4), (1e-11, 1.0), (1e-6, 1 - 1e-15)
    for core, shell, size, ratio in itertools.product(*ends):
        found = solve(core, shell, ratio * size, size)
        assert np.isfinite(found).all()
        assert abs(found).max() < 1.0 + 1e-9


def test_the_orders_kept_are_all_that_hold_something() -> None:
    a, b = compute_mie_coefficients(1.5 + 0.1j, 50.0)
    wiscombe = int(50.0 + 4.05 * 50.0 ** (1.0 / 3.0) + 2.0)
    assert abs(a[wiscombe - 1]) > 1e-10  # what stopping there would leave out
    assert max(abs(a[-1]), abs(b[-1])) < 1e-14


# ---- particles

# a gamma distribution of 0.2 um, variance 0.07, index 1.44, at 0.951 um, as published to 8 decimals: l; a1 ... b2
GAMMA = {
    0: [1.0, 0.0, 0.0, 0.71206342, 0.0, 0.0],
    1: [1.45529318, 0.0, 0.0, 1.76014119, 0.0, 0.0],
    2: [1.05402631, 3.3091220433, 2.577320735, 1.06682431, 0.7552491434, -0.0420726849],
    4: [0.11659302, 0.24741243, 0.163817764, 0.09576412, 0.1155748765, -0.0154318422],
    8: [0.00006372, 0.0000987266, 0.0000490182, 0.00003583, 0.0000677828, -0.0000042818],
}


def test_the_gamma_distributions_expansion(request: pytest.FixtureRequest) -> None:
    """The rows that are quoted here, and all of the published table where it is."""
    found = vrte.spheres(1.44, size=vrte.Gamma(0.2, 0.07), wavelength_um=0.951).phase_matrix.coefficients
    assert_close(found[list(GAMMA)], list(GAMMA.values()), rtol=0.0, atol=1e-8)
    path = request.getfixturevalue("reference")("mie/gamma_distribution_expansion.csv")
    table = np.genfromtxt(path, delimiter=",", names=True)
    columns = np.stack([table[name] for name in ("a1", "a2", "a3", "a4", "b1", "b2")], axis=1)
    assert_close(found[: len(table)], columns, rtol=0.0, atol=1e-8)
    assert np.abs(found[len(table) :]).max() < 1e-8


@pytest.mark.parametrize(
    ("index", "size", "peak"),
    [(1.5, 1e-2, 1e-13), (0.97 + 1.87j, 9.42, 1e-13), (1.33, 40.0, 1e-11), (0.05 + 4j, 5.0, 1e-13), (2.7, 100, 1e-10)],
)
def test_particles_are_what_amplitudes_say(index: complex, size: float, peak: float) -> None:
    """All elements of the matrix, cross sections and asymmetry, and the optical theorem."""
    particles, angle = ball(index, radius_um=size), np.linspace(0.0, 180.0, 91)
    matrix, area = particles.phase_matrix, math.pi * size**2
    coefficients = compute_mie_coefficients(index, size)
    s1, s2 = sum_amplitudes(*coefficients, angle)
    norm = 4.0 * math.pi / particles.scattering_um2
    one, two, cross = norm * abs(s1) ** 2, norm * abs(s2) ** 2, norm * s1 * s2.conj()
    a, b, c, d = (one + two) / 2, (two - one) / 2, cross.real, -cross.imag
    rows = [[a, b, 0 * a, 0 * a], [b, a, 0 * a, 0 * a], [0 * a, 0 * a, c, d], [0 * a, 0 * a, -d, c]]
    assert_close(matrix.scattering_matrix(angle), np.moveaxis(np.array(rows), 2, 0), rtol=0.0, atol=peak * one.max())
    extinction, scattering, g = sum_efficiencies(*coefficients, size)
    assert matrix.a1[0] == 1.0
    assert matrix.a1[1] / 3.0 == particles.asymmetry == close_to(g, rtol=0.0, atol=1e-12)
    assert particles.scattering_um2 == close_to(scattering * area, rtol=1e-12, atol=0.0)
    assert particles.extinction_um2 == close_to(extinction * area, rtol=1e-9, atol=0.0)
    assert particles.extinction_um2 == close_to(4.0 * math.pi * s1[0].real, rtol=1e-9, atol=0.0)
    assert particles.albedo == close_to(scattering / extinction, rtol=1e-9, atol=0.0)
    assert particles.albedo == 1.0 or complex(index).imag > 0.0
    assert particles.volume_um3 == close_to(4 / 3 * math.pi * size**3, rtol=1e-6, atol=0.0)
    assert_close(matrix.coefficients[-1], 0.0, rtol=0.0, atol=1e-9)


def test_a_host_changes_wavelength_and_contrast() -> None:
    """And a coat of the host's index is none, but for the volume."""
    how: dict[str, Any] = {"wavelength_um": 0.5, "host_index": 1.33}
    in_water, alone = vrte.spheres(1.5, radius_um=0.3, **how), ball(1.5 / 1.33, radius_um=0.3 * WAVELENGTH * 1.33 / 0.5)
    coated = vrte.coated_spheres(1.5, 1.33, core_radius_um=0.3, radius_um=0.45, **how)
    scale = (0.5 / 1.33 / WAVELENGTH) ** 2
    for found, area, volume in ((alone, scale, scale**1.5), (coated, 1.0, 1.0 / 3.375)):
        assert in_water.scattering_um2 == close_to(area * found.scattering_um2, rtol=1e-12, atol=0.0)
        assert in_water.phase_matrix.coefficients == close_to(found.phase_matrix.coefficients, rtol=0.0, atol=1e-11)
        assert in_water.volume_um3 == close_to(volume * found.volume_um3, rtol=1e-12, atol=0.0)
    assert vrte.spheres(1.0, radius_um=0.3, **how).albedo == 1.0  # a bubble


def test_averages_are_sums_over_radii_and_say_how_far_they_have_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = vrte.spheres("gold", size=vrte.Tabulated([0.10, 0.1001], [1.0, 1.0]), wavelength_um=0.6)
    single = vrte.spheres("gold", radius_um=0.10005, wavelength_um=0.6)
    assert narrow.extinction_um2 == close_to(single.extinction_um2, rtol=1e-5, atol=0.0)
    assert_close(narrow.phase_matrix.a1[:8], single.phase_matrix.a1[:8], rtol=0.0, atol=1e-5)
    for make, sizes in (
        (partial(vrte.spheres, 1.4 + 0.02j), vrte.Lognormal(0.2, 1.1)),
        (partial(vrte.coated_spheres, 1.0, 1.59, host_index=1.33, shell_um=0.02), vrte.Lognormal(0.15, 1.1)),
        (partial(vrte.coated_spheres, 1.0, 1.59, host_index=1.33, core_ratio=0.8), vrte.Lognormal(0.15, 1.1)),
    ):
        many = make(size=sizes, wavelength_um=0.55)
        radii, weights = sizes.quadrature(65)
        apart = [make(radius_um=radius, wavelength_um=0.55) for radius in radii]
        assert many.extinction_um2 == close_to(weights @ [one.extinction_um2 for one in apart], rtol=1e-6, atol=0.0)
        g = weights @ [one.scattering_um2 * one.asymmetry for one in apart]
        assert many.asymmetry * many.scattering_um2 == close_to(g, rtol=1e-6, atol=0.0)
        assert many.volume_um3 == close_to(weights @ (4 / 3 * math.pi * radii**3), rtol=1e-6, atol=0.0)
    assert many.albedo == 1.0
    smooth = vrte.spheres("gold", size=vrte.Lognormal(0.1, 1.4), wavelength_um=0.5)
    assert "257 radii" in smooth.description
    volume = 4 / 3 * math.pi * 1e-3 * math.exp(4.5 * math.log(1.4) ** 2)
    assert smooth.volume_um3 == close_to(volume, rtol=1e-9, atol=0.0)
    monkeypatch.setattr("vrte.optics.populations.MOST_RADII", 257)
    with pytest.warns(SizeAverageWarning, match="not converged; .* 257 radii, cross sections converged to .e-0"):
        vrte.spheres(2.7, size=vrte.Gamma(1.0, 0.2), wavelength_um=0.5)


def test_coated_spheres_say_what_they_are_and_are_checked_without_work() -> None:
    """Three ways to say one shell."""
    how: dict[str, Any] = {"radius_um": 0.2, "wavelength_um": 0.55, "host_index": 1.5}
    shapes = ({"core_radius_um": 0.16}, {"shell_um": 0.04}, {"core_ratio": 0.8})
    ways = [vrte.coated_spheres("rutile", (1.46, 0.0), **how, **shape) for shape in shapes]
    assert_close([one.extinction_um2 for one in ways], ways[0].extinction_um2, rtol=1e-12, atol=0.0)
    for words in (
        "a core of 0.8 of the radius, index 2.7533",
        "main/TiO2/Devore-o",
        "in a shell, index 1.46 + 0i (giv",
    ):
        assert words in ways[2].description
    assert "a shell of 0.04 um" in ways[1].description
    checked = check_coated_spheres(1.0, 1.59, shell_um=0.01, **how)
    assert checked.balls[0][0].find_core_radius(0.2) == close_to(0.19, rtol=1e-6, atol=0.0)
    assert checked.volume_um3 == 1.0


def test_mixture_of_species() -> None:
    gold, silica = (vrte.spheres(name, radius_um=0.1, wavelength_um=0.6) for name in ("gold", "silica"))
    mixed = vrte.mixture([(gold, 0.7), (silica, 0.3)])
    extinction = 0.7 * gold.extinction_um2 + 0.3 * silica.extinction_um2
    assert mixed.extinction_um2 == close_to(extinction, rtol=1e-6, atol=0.0)
    assert mixed.albedo == close_to(mixed.scattering_um2 / mixed.extinction_um2, rtol=1e-6, atol=0.0)
    fraction = 0.7 * gold.scattering_um2 / mixed.scattering_um2
    f = [one.phase_matrix.scattering_matrix([0.0, 60.0, 150.0]) for one in (gold, silica, mixed)]
    assert_close(f[2], fraction * f[0] + (1 - fraction) * f[1], rtol=0.0, atol=1e-12)
    assert vrte.mixture([(gold, 7), (silica, 3)]).asymmetry == close_to(mixed.asymmetry, rtol=1e-14, atol=0.0)
    assert vrte.mixture([(silica, 1.0)]).albedo == 1.0
    assert "0.7 of spheres" in mixed.description
    hollow = vrte.coated_spheres("air", 1.59, core_ratio=0.8, radius_um=0.1, wavelength_um=0.6)
    assert [len(one.substances) for one, _ in vrte.mixture([(hollow, 0.4), (silica, 0.6)]).balls] == [2, 1]
