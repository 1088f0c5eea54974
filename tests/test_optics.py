"""Refractive indices, size distributions and spheres, against tables, limits and sums written out."""

import csv
import math
import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.optics.particle_kind import SizeAverageWarning
from vrte.optics.refractive_index import MATERIALS, RefractiveIndex, refractive_index
from vrte.optics.spheres import compute_mie_coefficients

from .helpers import assert_close, close_to, printed_by
from .sphere_oracle import solve_exactly

WAVELENGTH = 2.0 * math.pi  # um: the radius in um is the size parameter
ball = partial(vrte.spheres, wavelength_um=WAVELENGTH)


def amplitudes(index: complex, size: float, angle_deg: Any) -> tuple[np.ndarray, np.ndarray]:
    """S1, S2 of Bohren and Huffman (4.74), order by order."""
    a, b = compute_mie_coefficients(index, size)
    cosine = np.cos(np.radians(angle_deg))
    s1, s2 = np.zeros((2, cosine.size), dtype=complex)
    before, pi = np.zeros_like(cosine), np.ones_like(cosine)
    for n in range(1, a.size + 1):
        tau = n * cosine * pi - (n + 1) * before
        factor = (2 * n + 1) / (n * (n + 1))
        s1 += factor * (a[n - 1] * pi + b[n - 1] * tau)
        s2 += factor * (a[n - 1] * tau + b[n - 1] * pi)
        before, pi = pi, ((2 * n + 1) * cosine * pi - (n + 1) * before) / n
    return s1, s2


def efficiencies(index: complex, size: float) -> tuple[float, float, float]:
    """Qext, Qsca, g from the coefficients: Bohren and Huffman (4.61), (4.62) and section 4.5."""
    a, b = compute_mie_coefficients(index, size)
    n = np.arange(1, a.size + 1)
    extinction, scattering = (2 * n + 1) @ (a + b).real, (2 * n + 1) @ (abs(a) ** 2 + abs(b) ** 2)
    g = (n * (n + 2) / (n + 1))[:-1] @ (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real
    g += (2 * n + 1) / (n * (n + 1)) @ (a * b.conj()).real
    return 2 * extinction / size**2, 2 * scattering / size**2, 2 * g / scattering


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
    the sodium D line; uniaxial crystals have the mean permittivity."""
    gold, silica = refractive_index("gold", 1.23984198 / 2.01), refractive_index("silica", 0.5893)
    assert_close([gold.n, gold.k], [0.21, 3.272], rtol=0.0, atol=2e-3)
    assert (silica.n, silica.k) == (close_to(1.45840, rtol=0.0, atol=1e-4), 0.0)
    assert "no k in the table: k = 0" in silica.source
    assert refractive_index("main/Au/Johnson", 0.5) == refractive_index("  Gold", 0.5)
    assert refractive_index("zinc_oxide", 0.6) == refractive_index("zinc oxide", 0.6)
    for name, book in (("hematite", "Fe2O3/Querry"), ("rutile", "TiO2/Devore")):
        o, e = (refractive_index(f"main/{book}-{ray}", 0.55).value for ray in "oe")
        mean = refractive_index(name, 0.55)
        assert mean.value**2 == close_to((2 * o**2 + e**2) / 3, rtol=1e-6, atol=0.0)
        assert "mean permittivity (2 o + e)/3" in mean.source


def test_numbers_are_taken_as_they_are() -> None:
    assert refractive_index(1.5, 0.5) == RefractiveIndex(1.5, 0.0, "given")
    for given in (1.5 + 0.01j, (1.5, 0.01), np.array([1.5, 0.01])):
        assert refractive_index(given, 0.5).value == 1.5 + 0.01j
    gold = refractive_index("gold", 0.5)
    assert refractive_index(gold, 0.5) == gold


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


SIZES = [vrte.Lognormal(0.2, 1.4), vrte.Gamma(0.2, 0.07), vrte.Tabulated([0.1, 0.3, 0.4], [1, 2, 0])]


@pytest.mark.parametrize("distribution", SIZES, ids=repr)
def test_radii_come_back_when_their_number_doubles_and_after_pickling(distribution: Any) -> None:
    few, many = (set(distribution.quadrature(count)[0]) for count in (129, 257))
    assert few < many
    again = pickle.loads(pickle.dumps(distribution))
    np.testing.assert_array_equal(again.quadrature(129), distribution.quadrature(129))
    assert repr(again) == repr(distribution)


# ---- spheres


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
# a gamma distribution of 0.2 um, variance 0.07, index 1.44, at 0.951 um, as published to 8 decimals: l; a1 ... b2
GAMMA = {
    0: [1.0, 0.0, 0.0, 0.71206342, 0.0, 0.0],
    1: [1.45529318, 0.0, 0.0, 1.76014119, 0.0, 0.0],
    2: [1.05402631, 3.3091220433, 2.577320735, 1.06682431, 0.7552491434, -0.0420726849],
    4: [0.11659302, 0.24741243, 0.163817764, 0.09576412, 0.1155748765, -0.0154318422],
    8: [0.00006372, 0.0000987266, 0.0000490182, 0.00003583, 0.0000677828, -0.0000042818],
}


def test_miev0_amplitudes() -> None:
    """And the efficiencies that are quoted here. Amplitudes are printed for n - ik: conjugate ones."""
    angle, *printed = np.array(AMPLITUDES).T
    assert_close(np.conj(amplitudes(1.5 + 1j, 1.0, angle.real)), printed, rtol=0.0, atol=7.1e-7)
    for index, size, scattering, g in MIEV0:
        assert_close(efficiencies(index, size)[1:], [scattering, g], rtol=0.0, atol=1.1e-6)


def test_miev0_all(reference: Callable[[str], Path]) -> None:
    with reference("mie/miev0_testcases.csv").open() as file:
        cases = [row for row in csv.DictReader(file) if "PEC" not in row["m_im"]]
    assert len(cases) == 19
    for row in cases:
        found = efficiencies(complex(float(row["m_re"]), -float(row["m_im"])), float(row["x"]))
        for value, column in zip(found, ("Qext", "Qsca", "g"), strict=True):
            if row[column]:
                digits = len(row[column].partition(".")[2])
                assert abs(value - float(row[column])) <= 1.1 * 10.0**-digits, (row, column)


@pytest.mark.parametrize(
    ("m", "x", "orders", "within"),
    [
        (1.5 + 1.0j, 1e-3, (1, 2), 1e-15),
        (1.5 + 0.0j, math.pi, (1, 3, 8), 1e-15),
        (0.2 + 3.4j, 5.9, (1, 5, 9), 1e-15),
        (1.0001 + 0.0j, 50.0, (1, 30, 51), 1e-12),
        (10.0 + 10.0j, 100.0, (1, 50, 101, 125), 1e-15),
        (2.7 + 0.0j, 30.0, (1, 20, 31, 40), 2e-14),
        (1.33 + 0.0j, 1000.0, (1, 700, 1001, 1040), 2e-13),
        pytest.param(10.0 + 0.0j, 5000.0, (1, 3000, 5001), 2e-12, marks=pytest.mark.slow),
    ],
)
def test_the_coefficients_against_ball_arithmetic(m: complex, x: float, orders: Any, within: float) -> None:
    found = np.array(compute_mie_coefficients(m, x))
    for n in orders:
        assert np.abs(found[:, n - 1] - solve_exactly(n, (m, x))).max() <= within * np.abs(found).max()


def test_the_orders_kept_are_all_that_hold_something() -> None:
    a, b = compute_mie_coefficients(1.5 + 0.1j, 50.0)
    wiscombe = int(50.0 + 4.05 * 50.0 ** (1.0 / 3.0) + 2.0)
    assert abs(a[wiscombe - 1]) > 1e-10  # what stopping there would leave out
    assert max(abs(a[-1]), abs(b[-1])) < 1e-14


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
    s1, s2 = amplitudes(index, size, angle)
    norm = 4.0 * math.pi / particles.scattering_um2
    one, two, cross = norm * abs(s1) ** 2, norm * abs(s2) ** 2, norm * s1 * s2.conj()
    a, b, c, d = (one + two) / 2, (two - one) / 2, cross.real, -cross.imag
    rows = [[a, b, 0 * a, 0 * a], [b, a, 0 * a, 0 * a], [0 * a, 0 * a, c, d], [0 * a, 0 * a, -d, c]]
    assert_close(matrix.scattering_matrix(angle), np.moveaxis(np.array(rows), 2, 0), rtol=0.0, atol=peak * one.max())
    extinction, scattering, g = efficiencies(index, size)
    assert matrix.a1[0] == 1.0
    assert matrix.a1[1] / 3.0 == particles.asymmetry == close_to(g, rtol=0.0, atol=1e-12)
    assert particles.scattering_um2 == close_to(scattering * area, rtol=1e-12, atol=0.0)
    assert particles.extinction_um2 == close_to(extinction * area, rtol=1e-9, atol=0.0)
    assert particles.extinction_um2 == close_to(4.0 * math.pi * s1[0].real, rtol=1e-9, atol=0.0)
    assert particles.albedo == close_to(scattering / extinction, rtol=1e-9, atol=0.0)
    assert particles.albedo == 1.0 or complex(index).imag > 0.0
    assert particles.volume_um3 == close_to(4 / 3 * math.pi * size**3, rtol=1e-6, atol=0.0)
    assert_close(matrix.coefficients[-1], 0.0, rtol=0.0, atol=1e-9)


def test_tiny_spheres_are_rayleighs_dipoles() -> None:
    particles, m2 = ball(1.5 + 0.1j, radius_um=1e-3), (1.5 + 0.1j) ** 2
    assert_close(particles.phase_matrix.coefficients[:3], vrte.rayleigh().coefficients, rtol=0.0, atol=1e-5)
    polarizability = (m2 - 1) / (m2 + 2)
    scattering, absorption = 8 / 3 * math.pi * 1e-18 * abs(polarizability) ** 2, 4e-9 * math.pi * polarizability.imag
    assert particles.scattering_um2 == close_to(scattering, rtol=1e-5, atol=0.0)
    assert particles.extinction_um2 - particles.scattering_um2 == close_to(absorption, rtol=1e-5, atol=0.0)


def test_a_host_changes_wavelength_and_contrast() -> None:
    in_water = vrte.spheres(1.5, radius_um=0.3, wavelength_um=0.5, host_index=1.33)
    alone = vrte.spheres(1.5 / 1.33, radius_um=0.3, wavelength_um=0.5 / 1.33)
    assert in_water.scattering_um2 == close_to(alone.scattering_um2, rtol=1e-12, atol=0.0)
    assert_close(in_water.phase_matrix.coefficients, alone.phase_matrix.coefficients, rtol=0.0, atol=1e-11)
    assert vrte.spheres(1.0, radius_um=0.3, wavelength_um=0.5, host_index=1.33).albedo == 1.0  # a bubble


def test_averages_are_sums_over_radii_and_say_how_far_they_have_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = vrte.spheres("gold", size=vrte.Tabulated([0.10, 0.1001], [1.0, 1.0]), wavelength_um=0.6)
    single = vrte.spheres("gold", radius_um=0.10005, wavelength_um=0.6)
    assert narrow.extinction_um2 == close_to(single.extinction_um2, rtol=1e-5, atol=0.0)
    assert_close(narrow.phase_matrix.a1[:8], single.phase_matrix.a1[:8], rtol=0.0, atol=1e-5)
    sizes = vrte.Lognormal(0.2, 1.3)
    radii, weights = sizes.quadrature(257)
    areas = [efficiencies(1.4 + 0.02j, math.tau * r / 0.5)[0] * math.pi * r**2 for r in radii]
    many = vrte.spheres(1.4 + 0.02j, size=sizes, wavelength_um=0.5)
    assert many.extinction_um2 == close_to(weights @ areas, rtol=1e-6, atol=0.0)
    smooth = vrte.spheres("gold", size=vrte.Lognormal(0.1, 1.4), wavelength_um=0.5)
    assert "257 radii" in smooth.description
    assert "main/Au/Johnson" in smooth.description
    volume = 4 / 3 * math.pi * 1e-3 * math.exp(4.5 * math.log(1.4) ** 2)
    assert smooth.volume_um3 == close_to(volume, rtol=1e-9, atol=0.0)
    monkeypatch.setattr("vrte.optics.populations.MOST_RADII", 257)
    with pytest.warns(SizeAverageWarning, match="not converged; .* 257 radii, cross sections converged to .e-0"):
        vrte.spheres(2.7, size=vrte.Gamma(1.0, 0.2), wavelength_um=0.5)


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


def test_particles_pickle_and_stay_read_only() -> None:
    gold = vrte.spheres("gold", size=vrte.Tabulated([0.1, 0.2], [1.0, 2.0]), wavelength_um=0.5)
    copy = pickle.loads(pickle.dumps(gold))
    assert copy.extinction_um2 == gold.extinction_um2
    np.testing.assert_array_equal(copy.phase_matrix.coefficients, gold.phase_matrix.coefficients)
    for array in (copy.phase_matrix.a1, copy.balls[0][0].size.radius_um):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError):
        copy.albedo = 0.5
