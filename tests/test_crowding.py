"""Crowded particles: hard spheres of one and many sizes, effective media, and where each of them ends."""

import math
import re
import warnings
from typing import Any

import numpy as np
import pytest
from flint import arb, ctx

import vrte
from vrte.optics.crowding import (
    PACKINGS,
    compute_structure_factor,
    find_coherent_potential_index,
    find_maxwell_garnett_index,
    join_amplitudes,
    pack,
)
from vrte.optics.spheres import compute_mie_coefficients
from vrte.scene.layer import Layer

from .helpers import assert_close, close_to
from .sphere_oracle import sum_amplitudes

ANGLES = np.array([0.0, 3.0, 20.0, 77.0, 121.0, 170.0, 180.0])
SIZES = {"wavelength_um": 0.6, "host_index": 1.33}


def latex(radius_um: float = 0.2, **how: Any) -> vrte.Particles:
    """Polystyrene in water."""
    return vrte.spheres(1.59, radius_um=radius_um, **(SIZES | how))


def rutile(**how: Any) -> vrte.Particles:
    """Titania in resin, in green light."""
    return vrte.spheres(2.7, wavelength_um=0.55, host_index=1.5, **({"radius_um": 0.1} | how))


def structure_factor_by_wertheim(x: float, fraction: float) -> float:
    """S(x = q d) of one size, to all digits of a double: cancellation is left to 400 bits."""
    with ctx.workprec(400):
        y, e = arb(x), arb(fraction)
        sine, cosine = y.sin(), y.cos()
        first, second = (1 + 2 * e) ** 2 / (1 - e) ** 4, -((1 + e / 2) ** 2) / (1 - e) ** 4
        a = first * (sine - y * cosine) / y**3
        b = -6 * e * second * (y**2 * cosine - 2 * y * sine - 2 * cosine + 2) / y**4
        c = y**4 * cosine - 4 * y**3 * sine - 12 * y**2 * cosine + 24 * y * sine + 24 * cosine - 24
        return float(1 / (1 + 24 * e * (a + b - e * first / 2 * c / y**6)))


def structure_matrix_by_integration(q: float, radii: np.ndarray, shares: np.ndarray, fraction: float) -> np.ndarray:
    """S_ij(q) of a mixture: Baxter's functions integrated by 100 Gauss-Legendre nodes, the dense matrix inverted."""
    diameters, densities = 2.0 * radii, shares * fraction / (4.0 / 3.0 * math.pi * shares @ radii**3)
    xi = [math.pi / 6.0 * densities @ diameters**power for power in range(4)]
    nodes, weights = np.polynomial.legendre.leggauss(100)
    a = (1.0 - xi[3] + 3.0 * diameters * xi[2]) / (1.0 - xi[3]) ** 2
    b = -1.5 * diameters**2 * xi[2] / (1.0 - xi[3]) ** 2
    factor = np.eye(diameters.size, dtype=np.complex128)
    for i, j in np.ndindex(factor.shape):
        low, high = 0.5 * (diameters[i] - diameters[j]), 0.5 * (diameters[i] + diameters[j])
        t = 0.5 * (high - low) * nodes + 0.5 * (high + low)
        inside = (0.5 * a[i] * (t**2 - high**2) + b[i] * (t - high)) * np.exp(1j * q * t)
        integral = 0.5 * (high - low) * (weights @ inside)
        factor[i, j] -= 2.0 * math.pi * math.sqrt(densities[i] * densities[j]) * integral
    return np.linalg.inv(factor.conj().T @ factor)


@pytest.mark.parametrize("fraction", [1e-6, 0.05, 0.2, 0.4, 0.6])
def test_structure_factor_of_one_size_keeps_all_digits_at_any_angle(fraction):
    x = [1e-8, 1e-5, 1e-3, 0.01, 0.1, 0.5, 1.0, 3.0, 7.0, 30.0, 500.0]
    exact = [structure_factor_by_wertheim(one, fraction) for one in x]
    assert_close(compute_structure_factor(x, 0.5, fraction), exact, rtol=1e-12, atol=0.0)
    ahead = (1.0 - fraction) ** 4 / (1.0 + 2.0 * fraction) ** 2
    assert_close(compute_structure_factor([0.0], 0.5, fraction), ahead, rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("q", [0.0, 0.7, 5.0, 31.0])
def test_mixture_is_that_of_the_dense_matrix(q):
    """S_ij(q) as `join_amplitudes` has it: what becomes of one size's amplitude, for each size."""
    crowd = np.array([0.1, 0.25, 0.4, 0.41]), np.array([3.0, 1.0, 0.5, 0.2]), 0.35
    dense = structure_matrix_by_integration(q, *crowd)
    assert np.abs(dense.imag).max() < 1e-12
    joined = join_amplitudes(np.eye(4, dtype=np.complex128)[:, :, None], np.array([q]), *crowd)[:, :, 0]
    assert_close(joined @ joined.conj().T, dense, rtol=0.0, atol=1e-12)


def test_nothing_interferes_where_there_is_nobody():
    alone = latex()
    packed = pack(alone, 5e-324, "percus-yevick")
    np.testing.assert_array_equal(compute_structure_factor([0.0, 1.0, 10.0], 0.3, 0.0), 1.0)
    n = alone.phase_matrix.terms
    assert packed.scattering_um2 == close_to(alone.scattering_um2, rtol=1e-14, atol=0.0)
    assert_close(packed.phase_matrix.coefficients[:, :n], alone.phase_matrix.coefficients, rtol=0.0, atol=2e-13)
    assert np.abs(packed.phase_matrix.coefficients[:, n:]).max(initial=0.0) < 2e-12
    for name in ("effective-medium", "coherent-potential"):
        assert pack(alone, 1e-12, name).scattering_um2 == close_to(alone.scattering_um2, rtol=1e-10, atol=0.0)


def test_a_mixture_is_the_sum_over_all_pairs():
    """Two substances and three sizes, every pair of amplitudes by itself: all elements of the matrix."""
    radii, indices, shares = np.array([0.1, 0.2, 0.3]), [1.59, 1.45, 1.59 + 0.02j], np.array([0.5, 0.3, 0.2])
    kinds = [vrte.spheres(m, radius_um=r, **SIZES) for m, r in zip(indices, radii, strict=True)]
    packed = pack(vrte.mixture(list(zip(kinds, shares, strict=True))), 0.25, "percus-yevick")
    k = 2.0 * math.pi * 1.33 / 0.6
    mie = [compute_mie_coefficients(m / 1.33, k * r) for m, r in zip(indices, radii, strict=True)]
    s1, s2 = np.array([sum_amplitudes(*each, ANGLES) for each in mie]).swapaxes(0, 1)
    q = 2.0 * k * np.sin(np.radians(ANGLES) / 2.0)
    matrix = np.array([structure_matrix_by_integration(one, radii, shares, 0.25).real for one in q])
    weights = matrix * np.sqrt(np.outer(shares, shares))
    first, second, cross = (
        np.einsum("ia,aij,ja->a", one, weights, other.conj()) for one, other in ((s1, s1), (s2, s2), (s2, s1))
    )
    f = np.array([0.5 * (first + second), 0.5 * (second - first), cross.real, cross.imag]).real
    found = packed.phase_matrix.scattering_matrix(ANGLES)[:, [0, 0, 2, 2], [0, 1, 2, 3]].T
    # of one particle: dC/dOmega = F11/k^2, whose mean over the sphere is C/(4 pi)
    expected = 4.0 * math.pi / (k**2 * packed.scattering_um2) * f
    assert (np.abs(found - expected) <= 1e-10 * expected[0]).all()
    absorbed = np.dot(shares, [kind.extinction_um2 - kind.scattering_um2 for kind in kinds])
    assert packed.extinction_um2 - packed.scattering_um2 == close_to(absorbed, rtol=1e-12, atol=0.0)
    assert packed.volume_um3 == close_to(4.0 / 3.0 * math.pi * shares @ radii**3, rtol=1e-6, atol=0.0)
    assert [ball.size.radius_um for ball, _ in packed.balls] == radii.tolist()


@pytest.mark.parametrize("name", list(PACKINGS))
def test_no_photon_is_lost_between_neighbours(name):
    pigment = vrte.spheres(1.7, size=vrte.Lognormal(0.1, 1.3), wavelength_um=0.55, host_index=1.5)
    layer = Layer.of(pigment, thickness_um=10.0, volume_fraction=0.08, packing=name)
    assert (layer.albedo, layer.phase_matrix.a1[0]) == (1.0, 1.0)
    field = vrte.radiance(vrte.Scene([layer], vrte.Lambertian(1.0)), 0.6, mu=[], tau=[0.0], nodes=8)
    assert field.flux_up[0] == close_to(0.6, rtol=1e-10, atol=0.0)


@pytest.mark.parametrize("name", ["percus-yevick", "effective-medium", "coherent-potential"])
def test_absorption_stays_and_host_and_recipe_are_kept(name):
    brown = vrte.spheres((1.7, 0.05), size=vrte.Gamma(0.1, 0.1), wavelength_um=0.55, host_index=(1.5, 1e-4))
    packed = pack(brown, 0.2, name)
    assert (packed.host_index, packed.host_absorption, packed.balls) == (1.5, brown.host_absorption, brown.balls)
    assert packed.volume_um3 == close_to(brown.volume_um3, rtol=1e-9, atol=0.0)
    absorbed = [one.extinction_um2 - one.scattering_um2 for one in (packed, brown)]
    assert absorbed[0] == close_to(absorbed[1], rtol=1e-12 if name == "percus-yevick" else 0.05, atol=0.0)


def test_maxwell_garnett_is_the_rule_by_hand():
    """(e - h)/(e + 2 h) of the effective permittivity e is the sum of the spheres'."""
    kinds = vrte.mixture([(latex(0.01), 0.25), (vrte.spheres((1.2, 2.0), radius_um=0.02, **SIZES), 0.75)]).balls
    volumes = np.array([0.25 * 0.01**3, 0.75 * 0.02**3])
    host, inside = 1.33**2, np.array([1.59, 1.2 + 2.0j]) ** 2
    dipoles = 0.3 * (volumes / volumes.sum()) @ ((inside - host) / (inside + 2.0 * host))
    e = complex(host)
    for _ in range(50):  # Newton's steps
        e -= ((e - host) / (e + 2.0 * host) - dipoles) * (e + 2.0 * host) ** 2 / (3.0 * host)
    assert find_maxwell_garnett_index(kinds, 0.3) == close_to(np.sqrt(e).real, rtol=1e-13, atol=0.0)


def test_coherent_potential_of_small_spheres_is_maxwell_garnetts_and_of_few_van_de_hulsts():
    """n = n_host (1 - 2 pi N Im S(0)/k^3): van de Hulst (1957), 4.3."""
    for fraction in (0.01, 0.2, 0.4):
        small = rutile(radius_um=0.002).balls
        expected = find_maxwell_garnett_index(small, fraction)
        within = 1e-4 * (expected - 1.5) + 2e-5
        assert find_coherent_potential_index(small, fraction) == close_to(expected, rtol=0.0, atol=within)
    some, k = rutile(radius_um=0.2), 2.0 * math.pi * 1.5 / 0.55
    a, b = compute_mie_coefficients(2.7 / 1.5, 0.2 * k)
    forward = 0.5 * np.sum((2 * np.arange(1, a.size + 1) + 1) * (a + b))
    rise = -2.0 * math.pi * 1e-6 / (4.0 / 3.0 * math.pi * 0.2**3) * forward.imag / k**3 * 1.5
    assert find_coherent_potential_index(some.balls, 1e-6) - 1.5 == close_to(rise, rtol=0.03, atol=0.0)


@pytest.mark.parametrize("fraction", [0.05, 0.3])
def test_coherent_potential_leaves_the_phase_of_light_alone(fraction):
    index = find_coherent_potential_index(rutile().balls, fraction)
    k = 2.0 * math.pi * index / 0.55
    a, b = compute_mie_coefficients(2.7 / index, 1.5 / index, k * 0.1, k * 0.1 * fraction ** (-1.0 / 3.0))
    forward = np.sum((2 * np.arange(1, a.size + 1) + 1) * (a + b))
    assert abs(forward.imag) < 1e-9 * abs(forward)
    packed = pack(rutile(), fraction, "coherent-potential")
    alone = vrte.spheres(2.7, radius_um=0.1, wavelength_um=0.55, host_index=index)
    assert packed.scattering_um2 == close_to(alone.scattering_um2, rtol=1e-12, atol=0.0)
    assert_close(packed.phase_matrix.a1, alone.phase_matrix.a1, rtol=0.0, atol=1e-12)


def test_a_coated_sphere_has_the_permittivity_that_its_dipole_says():
    tiny = vrte.coated_spheres((1.0, 0.0), 1.59, core_ratio=0.8, radius_um=1e-4, wavelength_um=0.55, host_index=1.33)
    ((ball, _),) = tiny.balls
    inside, host = ball.find_permittivity(1e-4), 1.33**2
    a, _ = ball.find_coefficients(np.array([1e-4]))
    x = 2.0 * math.pi * 1.33 / 0.55 * 1e-4
    dipole = ((inside - host) / (inside + 2.0 * host)).real
    assert a[0, 0].imag == close_to(-2.0 / 3.0 * x**3 * dipole, rtol=1e-5, atol=0.0)
    assert pack(tiny, 0.2, "coherent-potential").albedo == 1.0


def test_equal_crowds_are_packed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the scenes of a sweep over a thickness have them; another host, size or fraction is another crowd."""
    asked: list[float] = []
    scatter = PACKINGS["percus-yevick"].scatter

    def counted(particles: vrte.Particles, volume_fraction: float) -> vrte.Particles:
        asked.append(volume_fraction)
        return scatter(particles, volume_fraction)

    monkeypatch.setitem(PACKINGS, "percus-yevick", PACKINGS["percus-yevick"]._replace(scatter=counted))
    first = (0.123, 1.33, 0.2)
    for radius, host, fraction in (first, first, (0.124, 1.33, 0.2), (0.123, 1.34, 0.2), (0.123, 1.33, 0.21)):
        latex = vrte.spheres(1.4, radius_um=radius, wavelength_um=0.55, host_index=host)
        packed = pack(vrte.mixture([(latex, 1.0), (latex, 2.0)]), fraction, "percus-yevick")
        assert packed.albedo == 1.0
    assert asked == [0.2, 0.2, 0.2, 0.21]


UNKNOWN = vrte.Particles(vrte.rayleigh(), 1.0, 0.0, 1.0, 1.0, 1.0)
METAL = vrte.spheres((0.2, 3.4), radius_um=0.05, wavelength_um=0.6)
TWO = vrte.mixture([(latex(), 1.0), (latex(wavelength_um=0.5), 1.0)])
ENDS: list[tuple[vrte.Particles, float, str, type | None, str]] = [  # volume fraction, packing; error or warning, words
    (latex(), 0.3, "percus-yevick", None, ""),
    (rutile(), 0.3, "effective-medium", None, ""),
    (rutile(radius_um=0.13), 0.3, "coherent-potential", None, ""),
    (latex(), 0.11, "independent", vrte.PackingWarning, '0.11 is above 0.1: .*; packing="percus-yevick" or .* acc'),
    (latex(), 0.31, "percus-yevick", vrte.PackingWarning, "volume_fraction of 0.31 is above 0.3"),
    (rutile(), 0.2, "percus-yevick", vrte.PackingWarning, r"\|m - 1\| is 0.8 here, .* 0.35 .*\"coherent-potential\""),
    (rutile(radius_um=0.13), 0.2, "effective-medium", vrte.PackingWarning, r"\|m - 1\| is 3.56 here, and up to 3 al"),
    (latex(), 0.65, "percus-yevick", vrte.SceneError, "volume_fraction must be at most 0.64 .*, not 0.65: hard sph"),
    (latex(), 0.2, "crystal", vrte.SceneError, 'packing must be "independent" or "percus-yevick" .* not .crystal'),
    (UNKNOWN, 0.2, "percus-yevick", vrte.SceneError, "of known substance and size"),
    (TWO, 0.2, "percus-yevick", vrte.SceneError, "needs particles at one wavelength"),
    (METAL, 0.5, "coherent-potential", vrte.SceneError, "no solution"),
]


@pytest.mark.parametrize(("particles", "fraction", "packing", "kind", "words"), ENDS)
def test_packings_say_where_their_domain_ends(
    particles: vrte.Particles, fraction: float, packing: str, kind: Any, words: str
) -> None:
    with warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("always")
        if kind is vrte.SceneError:
            with pytest.raises(kind, match=words):
                Layer.of(particles, thickness_um=1.0, volume_fraction=fraction, packing=packing)
            return
        assert Layer.of(particles, thickness_um=1.0, volume_fraction=fraction, packing=packing).thickness > 0.0
    assert len(reported) == (kind is not None)
    for one in reported:
        assert issubclass(one.category, kind)
        assert re.search(words, str(one.message))
        assert one.filename == __file__
