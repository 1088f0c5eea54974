"""Refractive indices, size distributions and spheres, against tables, limits and sums written out."""

import csv
import math
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import vrte.basics.errors
from vrte.basics.errors import SceneError
from vrte.optics.particle_kind import SizeAverageWarning
from vrte.optics.particles import Particles, mixture
from vrte.optics.refractive_index import MATERIALS, RefractiveIndex, refractive_index
from vrte.optics.size_distribution import Gamma, Lognormal, Monodisperse, Tabulated
from vrte.optics.spheres import compute_mie_coefficients, spheres

from .helpers import assert_close, close_to
from .sphere_oracle import solve_exactly

# Wiscombe's MIEV0 test cases (NCAR/TN-140+STR), refractive index n + ik: index, size parameter, Qsca, g
MIEV0 = [
    (1.33 + 1e-5j, 1.0, 0.093923, 0.184517),
    (1.33 + 1e-5j, 100.0, 2.096594, 0.868959),
    (1.5 + 1j, 0.055, 0.000011, 0.000491),
    (1.5 + 1j, 100.0, 1.283697, 0.850252),
    (10 + 10j, 1.0, 2.049405, -0.110664),
    (0.75, 10.0, 2.232265, 0.896473),
]
WAVELENGTH = 2.0 * math.pi  # um: the radius in um is the size parameter


def amplitudes(index, size, angle_deg):
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


def efficiencies(index, size):
    """Qext, Qsca, g from the coefficients: Bohren and Huffman (4.61), (4.62) and section 4.5."""
    a, b = compute_mie_coefficients(index, size)
    n = np.arange(1, a.size + 1)
    extinction = np.sum((2 * n + 1) * (a + b).real)
    scattering = np.sum((2 * n + 1) * (abs(a) ** 2 + abs(b) ** 2))
    g = np.sum((n * (n + 2) / (n + 1))[:-1] * (a[:-1] * a[1:].conj() + b[:-1] * b[1:].conj()).real)
    g += np.sum((2 * n + 1) / (n * (n + 1)) * (a * b.conj()).real)
    return 2 * extinction / size**2, 2 * scattering / size**2, 2 * g / scattering


# ---- refractive indices


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_every_named_material_has_an_index(name):
    index = refractive_index(name, 0.64)
    assert index.n > 0.0
    assert index.k >= 0.0
    assert all(page in index.source for page in MATERIALS[name].pages)
    assert MATERIALS[name].reason


def test_tabulated_values_come_back():
    # Johnson and Christy, Phys. Rev. B 6, 4370 (1972): 2.01 eV and 3.00 eV
    hc = 1.23984198
    gold = refractive_index("gold", hc / 2.01)
    assert (gold.n, gold.k) == (close_to(0.21, rtol=0.0, atol=2e-3), close_to(3.272, rtol=0.0, atol=2e-3))
    assert refractive_index("main/Au/Johnson", 0.5) == refractive_index("  Gold", 0.5)
    # Malitson, J. Opt. Soc. Am. 55, 1205 (1965): 1.45846 at the sodium D line
    silica = refractive_index("silica", 0.5893)
    assert silica.n == close_to(1.45840, rtol=0.0, atol=1e-4)
    assert silica.k == 0.0
    assert "no k in the table: k = 0" in silica.source
    assert refractive_index("zinc_oxide", 0.6) == refractive_index("zinc oxide", 0.6)


@pytest.mark.parametrize(("name", "book"), [("hematite", "Fe2O3/Querry"), ("rutile", "TiO2/Devore")])
def test_uniaxial_crystals_have_the_mean_permittivity(name, book):
    o, e = (refractive_index(f"main/{book}-{ray}", 0.55).value for ray in "oe")
    mean = refractive_index(name, 0.55)
    assert mean.value**2 == close_to((2 * o**2 + e**2) / 3, rtol=1e-6, atol=0.0)
    assert "mean permittivity (2 o + e)/3" in mean.source


def test_numbers_are_taken_as_they_are():
    assert refractive_index(1.5, 0.5) == RefractiveIndex(1.5, 0.0, "given")
    assert refractive_index(1.5 + 0.01j, 0.5).value == 1.5 + 0.01j
    assert refractive_index((1.5, 0.01), 0.5).value == 1.5 + 0.01j
    assert refractive_index(np.array([1.5, 0.01]), 0.5).value == 1.5 + 0.01j
    gold = refractive_index("gold", 0.5)
    assert refractive_index(gold, 0.5) == gold


@pytest.mark.parametrize(
    ("material", "wavelength", "words"),
    [
        ("golld", 0.5, r"'golld' is neither a known name .* did you mean 'gold'"),
        ("main/Au/Jonson", 0.5, "did you mean 'main/Au/Johnson'"),
        ("main/Au", 0.5, "neither a known name"),
        ("iron", 0.5, "did you mean 'main/Fe/"),
        ("nowhere at all", 0.5, "such as 'main/Au/Johnson'$"),
        ("", 0.5, "neither a known name"),
        ("gold", 3.0, r"main/Au/Johnson goes from 0.1879 to 1.937 um; a wavelength of 3 um is outside"),
        ("rutile", 0.4, r"from 0.43 to 1.53 um"),
        ("gold", 0.0, "wavelength_um"),
        ("gold", math.nan, "wavelength_um must be .* not nan"),
        (1.5 - 0.1j, 0.5, r"k must be >= 0 .* not -0.1"),
        ((1.5, -0.1), 0.5, "k must be >= 0"),
        (0.0, 0.5, "n must be above 0"),
        (math.nan, 0.5, "finite"),
        ((1.0, 2.0, 3.0), 0.5, "a pair"),
        (None, 0.5, "material must be a text, a number"),
        ([[1.5]], 0.5, "item 1 of material must be a number"),
    ],
)
def test_index_errors(material, wavelength, words):
    with pytest.raises(SceneError, match=words):
        vrte.refractive_index(material, wavelength)


def test_the_database_needs_no_network_and_no_home(tmp_path):
    program = (
        "import socket\n"
        "def refuse(*a, **k): raise OSError('no network here')\n"
        "socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse\n"
        "from vrte.optics.refractive_index import refractive_index\n"
        "print(refractive_index('gold', 0.64).n)\n"
    )
    root = Path(vrte.basics.errors.__file__).parents[1]
    environment = {
        "HOME": str(tmp_path),
        "PATH": "/usr/bin:/bin",
        "PYTHONPATH": str(root),
        "XDG_CACHE_HOME": str(tmp_path),
    }
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == refractive_index("gold", 0.64).n
    assert list(tmp_path.iterdir()) == []


# ---- size distributions


def test_lognormal_moments():
    radii, weights = Lognormal(0.3, 1.5).quadrature(257)
    width = math.log(1.5)
    for power in (2, 3, 4, 6):
        assert weights @ radii**power == close_to(0.3**power * math.exp((power * width) ** 2 / 2), rtol=1e-9, atol=0.0)
    assert weights.sum() == close_to(1.0, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("v_eff", [0.01, 0.07, 0.25, 0.4])
def test_gamma_moments(v_eff):
    radii, weights = Gamma(0.2, v_eff).quadrature(513)
    shape, scale = (1 - 2 * v_eff) / v_eff, 0.2 * v_eff
    for power in (2, 3, 4, 6):
        exact = scale**power * math.exp(math.lgamma(shape + power) - math.lgamma(shape))
        assert weights @ radii**power == close_to(exact, rtol=1e-9, atol=0.0)
    area = weights @ radii**2
    effective = weights @ radii**3 / area
    assert effective == close_to(0.2, rtol=1e-9, atol=0.0)
    assert weights @ (radii**2 * (radii - effective) ** 2) / area / effective**2 == close_to(v_eff, rtol=1e-8, atol=0.0)


def test_tabulated_is_linear_between_its_radii():
    radii, weights = Tabulated([0.1, 0.2, 0.4], [0.0, 5.0, 0.0]).quadrature(2049)
    assert weights.sum() == close_to(1.0, rtol=1e-6, atol=0.0)
    assert weights @ radii == close_to(0.7 / 3, rtol=1e-6, atol=0.0)  # the centroid of a triangle
    assert Tabulated(np.linspace(1, 2, 300), np.ones(300)).quadrature(10)[0].size == 300
    assert repr(Tabulated([0.1, 0.2], [1, 1])) == "Tabulated(2 radii from 0.1 to 0.2 um)"


@pytest.mark.parametrize("distribution", [Lognormal(0.2, 1.4), Gamma(0.2, 0.07), Tabulated([0.1, 0.3, 0.4], [1, 2, 0])])
def test_radii_come_back_when_their_number_doubles(distribution):
    few, many = (set(distribution.quadrature(count)[0]) for count in (129, 257))
    assert few < many


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Lognormal(0.2, 1.0), "sigma must be a geometric standard deviation above 1"),
        (lambda: Lognormal(-0.2, 1.5), "median_um must be a length"),
        (lambda: Gamma(0.2, 0.5), "v_eff must be an effective variance .* below 0.5"),
        (lambda: Gamma(0.0, 0.1), "r_eff_um"),
        (lambda: Monodisperse(math.nan), "radius_um"),
        (lambda: Tabulated([0.1], [1.0]), "equally long"),
        (lambda: Tabulated([0.1, 0.2], [1.0]), "equally long"),
        (lambda: Tabulated([0.2, 0.1], [1.0, 1.0]), "must increase"),
        (lambda: Tabulated([0.0, 0.1], [1.0, 1.0]), "must be a length"),
        (lambda: Tabulated([0.1, 0.2], [0.0, 0.0]), "not zero everywhere"),
        (lambda: Tabulated([0.1, 0.2], [1.0, -1.0]), ">= 0"),
        (lambda: Tabulated([], []), "non-empty"),
    ],
)
def test_size_errors(make, words):
    with pytest.raises(SceneError, match=words):
        make()


# ---- spheres


@pytest.mark.parametrize(("index", "size", "scattering", "g"), MIEV0)
def test_miev0_quoted(index, size, scattering, g):
    found = efficiencies(index, size)
    assert found[1] == close_to(scattering, rtol=0.0, atol=1.1e-6)
    assert found[2] == close_to(g, rtol=0.0, atol=1.1e-6)


def test_miev0_all(reference):
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
        (10.0 + 0.0j, 5000.0, (1, 3000, 5001), 2e-12),
    ],
)
def test_the_coefficients_against_ball_arithmetic(m, x, orders, within):
    found = np.array(compute_mie_coefficients(m, x))
    for n in orders:
        error = np.abs(found[:, n - 1] - solve_exactly(n, (m, x))).max()
        assert error <= within * np.abs(found).max()


def test_the_orders_kept_are_all_that_hold_something():
    a, b = compute_mie_coefficients(1.5 + 0.1j, 50.0)
    wiscombe = int(50.0 + 4.05 * 50.0 ** (1.0 / 3.0) + 2.0)
    assert abs(a[wiscombe - 1]) > 1e-10  # what stopping there would leave out
    assert max(abs(a[-1]), abs(b[-1])) < 1e-14


# Wiscombe (NCAR/TN-140+STR): angle, S1, S2 of index 1.5 - 1i, size parameter 1
AMPLITUDES = [
    (0, 0.58408 + 0.190515j, 0.58408 + 0.190515j),
    (30, 0.565702 + 0.1872j, 0.500161 + 0.145611j),
    (60, 0.517525 + 0.178443j, 0.287964 + 0.041054j),
    (90, 0.45634 + 0.167167j, 0.0362285 - 0.0618265j),
    (120, 0.400212 + 0.156643j, -0.174875 - 0.122959j),
    (150, 0.362157 + 0.149391j, -0.305682 - 0.143846j),
    (180, 0.348844 + 0.146829j, -0.348844 - 0.146829j),
]


def test_miev0_amplitudes():
    angle, first, second = np.array(AMPLITUDES).T
    s1, s2 = amplitudes(1.5 + 1j, 1.0, angle.real)
    # printed for n - ik: conjugate amplitudes; half a unit of the last digit of both parts
    assert_close(s1.conj(), first, rtol=0.0, atol=7.1e-7)
    assert_close(s2.conj(), second, rtol=0.0, atol=7.1e-7)


# a gamma distribution of 0.2 um, variance 0.07, index 1.44, at 0.951 um, as published to 8 decimals: l; a1 ... b2
GAMMA = {
    0: [1.0, 0.0, 0.0, 0.71206342, 0.0, 0.0],
    1: [1.45529318, 0.0, 0.0, 1.76014119, 0.0, 0.0],
    2: [1.05402631, 3.3091220433, 2.577320735, 1.06682431, 0.7552491434, -0.0420726849],
    4: [0.11659302, 0.24741243, 0.163817764, 0.09576412, 0.1155748765, -0.0154318422],
    8: [0.00006372, 0.0000987266, 0.0000490182, 0.00003583, 0.0000677828, -0.0000042818],
}


def test_the_gamma_distributions_expansion_quoted():
    found = spheres(1.44, size=Gamma(0.2, 0.07), wavelength_um=0.951).phase_matrix
    assert_close(found.coefficients[list(GAMMA)], list(GAMMA.values()), rtol=0.0, atol=1e-8)


def test_the_gamma_distributions_expansion(reference):
    table = np.genfromtxt(reference("mie/gamma_distribution_expansion.csv"), delimiter=",", names=True)
    found = spheres(1.44, size=Gamma(0.2, 0.07), wavelength_um=0.951).phase_matrix
    for name in ("a1", "a2", "a3", "a4", "b1", "b2"):
        assert_close(getattr(found, name)[: len(table)], table[name], rtol=0.0, atol=1e-8)
    assert np.abs(found.coefficients[len(table) :]).max() < 1e-8


@pytest.mark.parametrize(
    ("index", "size", "peak"),
    [
        (1.5, 1e-3, 1e-13),
        (0.97 + 1.87j, 9.42, 1e-13),
        (1.33, 40.0, 1e-11),
        (0.05 + 4j, 5.0, 1e-13),
        (2.7, 100.0, 1e-10),
    ],
)
def test_the_expansion_gives_the_amplitudes_back(index, size, peak):
    particles = spheres(index, radius_um=size, wavelength_um=WAVELENGTH)
    angle = np.linspace(0.0, 180.0, 91)
    s1, s2 = amplitudes(index, size, angle)
    norm = 4.0 * math.pi / particles.scattering_um2
    one, two, cross = norm * abs(s1) ** 2, norm * abs(s2) ** 2, norm * s1 * s2.conj()
    f = particles.phase_matrix.scattering_matrix(angle)
    tolerance = peak * one.max()
    assert_close(f[:, 0, 0], (one + two) / 2, rtol=0.0, atol=tolerance)
    assert_close(f[:, 1, 1], (one + two) / 2, rtol=0.0, atol=tolerance)
    assert_close(f[:, 0, 1], (two - one) / 2, rtol=0.0, atol=tolerance)
    assert_close(f[:, 2, 2], cross.real, rtol=0.0, atol=tolerance)
    assert_close(f[:, 3, 3], cross.real, rtol=0.0, atol=tolerance)
    assert_close(f[:, 2, 3], -cross.imag, rtol=0.0, atol=tolerance)
    assert_close(f[:, 3, 2], cross.imag, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize(("index", "size"), [(1.5, 0.01), (1.5 + 0.1j, 7.0), (1.33, 60.0), (0.2 + 3j, 200.0)])
def test_sum_rules(index, size):
    particles = spheres(index, radius_um=size, wavelength_um=WAVELENGTH)
    extinction, scattering, g = efficiencies(index, size)
    pm, area = particles.phase_matrix, math.pi * size**2
    assert pm.a1[0] == 1.0
    assert pm.a1[1] / 3.0 == close_to(g, rtol=0.0, atol=1e-12)
    assert particles.asymmetry == pm.asymmetry
    assert particles.scattering_um2 == close_to(scattering * area, rtol=1e-12, atol=0.0)
    assert particles.extinction_um2 == close_to(extinction * area, rtol=1e-9, atol=0.0)
    assert particles.albedo == close_to(scattering / extinction, rtol=1e-9, atol=0.0)
    assert particles.volume_um3 == close_to(4 / 3 * math.pi * size**3, rtol=1e-6, atol=0.0)
    assert_close(pm.coefficients[-1], 0.0, rtol=0.0, atol=1e-9)
    # the optical theorem, from the forward amplitude
    forward = amplitudes(index, size, np.zeros(1))[0][0]
    assert particles.extinction_um2 == close_to(4.0 * math.pi * forward.real, rtol=1e-9, atol=0.0)


def test_clear_spheres_have_the_albedo_1_exactly():
    for size in (1e-3, 3.0, 77.0):
        assert spheres(1.5, radius_um=size, wavelength_um=WAVELENGTH).albedo == 1.0


def test_tiny_spheres_are_rayleighs_dipoles():
    particles = spheres(1.5 + 0.1j, radius_um=1e-3, wavelength_um=WAVELENGTH)
    from vrte.optics.phase_matrix import rayleigh

    assert_close(particles.phase_matrix.coefficients[:3], rayleigh().coefficients, rtol=0.0, atol=1e-5)
    m2 = (1.5 + 0.1j) ** 2
    polarizability = (m2 - 1) / (m2 + 2)
    assert particles.scattering_um2 == close_to(8 / 3 * math.pi * 1e-18 * abs(polarizability) ** 2, rtol=1e-5, atol=0.0)
    absorption = 4 * math.pi * 1e-9 * polarizability.imag
    assert particles.extinction_um2 - particles.scattering_um2 == close_to(absorption, rtol=1e-5, atol=0.0)


def test_a_host_changes_wavelength_and_contrast():
    in_water = spheres(1.5, radius_um=0.3, wavelength_um=0.5, host_index=1.33)
    alone = spheres(1.5 / 1.33, radius_um=0.3, wavelength_um=0.5 / 1.33)
    assert in_water.scattering_um2 == close_to(alone.scattering_um2, rtol=1e-12, atol=0.0)
    assert_close(in_water.phase_matrix.coefficients, alone.phase_matrix.coefficients, rtol=0.0, atol=1e-11)
    bubble = spheres(1.0, radius_um=0.3, wavelength_um=0.5, host_index=1.33)
    assert bubble.albedo == 1.0


def test_an_average_is_the_sum_over_its_radii():
    table = Tabulated([0.10, 0.1001], [1.0, 1.0])
    narrow = spheres("gold", size=table, wavelength_um=0.6)
    single = spheres("gold", radius_um=0.10005, wavelength_um=0.6)
    assert narrow.extinction_um2 == close_to(single.extinction_um2, rtol=1e-5, atol=0.0)
    assert_close(narrow.phase_matrix.a1[:8], single.phase_matrix.a1[:8], rtol=0.0, atol=1e-5)
    radii, weights = Lognormal(0.2, 1.3).quadrature(257)
    areas = [efficiencies(1.4 + 0.02j, math.tau * r / 0.5)[0] * math.pi * r**2 for r in radii]
    assert spheres(1.4 + 0.02j, size=Lognormal(0.2, 1.3), wavelength_um=0.5).extinction_um2 == close_to(
        weights @ areas, rtol=1e-6, atol=0.0
    )


def test_averages_say_how_far_they_have_settled(monkeypatch):
    smooth = spheres("gold", size=Lognormal(0.1, 1.4), wavelength_um=0.5)
    assert "257 radii" in smooth.description
    assert "main/Au/Johnson" in smooth.description
    assert smooth.volume_um3 == close_to(
        4 / 3 * math.pi * 1e-3 * math.exp(4.5 * math.log(1.4) ** 2), rtol=1e-9, atol=0.0
    )
    monkeypatch.setattr("vrte.optics.populations.MOST_RADII", 257)
    with pytest.warns(SizeAverageWarning, match="not converged; .* 257 radii, cross sections converged to .e-0"):
        spheres(2.7, size=Gamma(1.0, 0.2), wavelength_um=0.5)


def test_mixture_of_species():
    gold, silica = (spheres(name, radius_um=0.1, wavelength_um=0.6) for name in ("gold", "silica"))
    mixed = mixture([(gold, 0.7), (silica, 0.3)])
    assert isinstance(mixed, Particles)
    assert mixed.extinction_um2 == close_to(
        0.7 * gold.extinction_um2 + 0.3 * silica.extinction_um2, rtol=1e-6, atol=0.0
    )
    assert mixed.albedo == close_to(mixed.scattering_um2 / mixed.extinction_um2, rtol=1e-6, atol=0.0)
    share = 0.7 * gold.scattering_um2 / mixed.scattering_um2
    angle = [0.0, 60.0, 150.0]
    f = [one.phase_matrix.scattering_matrix(angle) for one in (gold, silica, mixed)]
    assert_close(f[2], share * f[0] + (1 - share) * f[1], rtol=0.0, atol=1e-12)
    assert mixture([(gold, 7), (silica, 3)]).asymmetry == close_to(mixed.asymmetry, rtol=1e-14, atol=0.0)
    assert mixture([(silica, 1.0)]).albedo == 1.0
    assert "0.7 of spheres" in mixed.description


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"radius_um": 0.3, "host_index": 1.5}, "refractive index of their host, 1.5, so they scatter nothing"),
        ({}, "either radius_um or size"),
        ({"radius_um": 0.3, "size": Gamma(0.2, 0.1)}, "either radius_um or size"),
        ({"radius_um": -0.3}, "radius_um must be a length"),
        ({"radius_um": 1e4}, "size parameter .* at most 10000"),
        ({"size": 0.3}, "size must be a Lognormal"),
        ({"radius_um": 0.3, "host_index": 0.0}, "host_index"),
        ({"radius_um": 0.3, "host_index": 1.3 + 0.1j}, "host_index: .* absorbs too much"),
    ],
)
def test_sphere_errors(arguments, words):
    with pytest.raises(SceneError, match=words):
        spheres(1.5, wavelength_um=0.5, **arguments)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ([], "at least one kind"),
        ([("gold", 1.0)], "not str"),
        ([0.3], "pairs"),
        ([(spheres(1.5, radius_um=0.1, wavelength_um=0.5), -1.0)], "number fraction must be a number >= 0"),
        ([(spheres(1.5, radius_um=0.1, wavelength_um=0.5), 0.0)], "needs more than 0"),
    ],
)
def test_mixture_errors(parts, words):
    with pytest.raises(SceneError, match=words):
        mixture(parts)


def test_everything_pickles_and_stays_read_only():
    table = pickle.loads(pickle.dumps(Tabulated([0.1, 0.2], [1.0, 2.0])))
    with pytest.raises(ValueError, match="read-only"):
        table.radius_um[0] = 1.0
    gold = spheres("gold", size=table, wavelength_um=0.5)
    copy = pickle.loads(pickle.dumps(gold))
    assert copy.extinction_um2 == gold.extinction_um2
    np.testing.assert_array_equal(copy.phase_matrix.coefficients, gold.phase_matrix.coefficients)
    assert not copy.phase_matrix.a1.flags.writeable
    with pytest.raises(AttributeError):
        copy.albedo = 0.5
    for distribution in (Lognormal(0.2, 1.4), Gamma(0.2, 0.07), Monodisperse(0.1)):
        assert pickle.loads(pickle.dumps(distribution)) == distribution
