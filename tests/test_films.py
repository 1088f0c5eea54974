"""Stacks of thin films against characteristic matrices, the sum over bounces in one film, closed forms and energy."""

from typing import Any

import numpy as np
import pytest

import vrte
from vrte.basics.arrays import Array
from vrte.optics.films import Film, cross_interface, find_amplitudes, find_root
from vrte.optics.fresnel import reflect_amplitudes

from .helpers import assert_close

COSINES = np.array([1e-3, 0.1, 0.45, 0.8, 1.0])
GOLD: list[Film] = [(2.9 + 0.3j, 0.03), (1.46 + 0j, 0.35)]
METAL = 1.2 + 7.0j


def multiply_matrices(outside: float, films: list[Film], inside: complex, cosine: float, wavelength: float) -> Any:
    """r_p, r_s, t_p, t_s by the product of characteristic matrices of tangential fields (Born and Wolf, 1.6.2)."""

    def find(index: complex) -> complex:
        root = np.sqrt((index - outside) * (index + outside) + (outside * cosine) ** 2 + 0j)
        return -root if root.imag < 0.0 else root

    def admit(index: complex) -> tuple[complex, complex]:
        return index**2 / find(index), find(index)  # of p and s

    found = []
    for which in (0, 1):
        product = np.eye(2, dtype=complex)
        for index, thickness in films:
            phase, admittance = 2.0 * np.pi * thickness * find(index) / wavelength, admit(index)[which]
            film = [
                [np.cos(phase), -1j * np.sin(phase) / admittance],
                [-1j * admittance * np.sin(phase), np.cos(phase)],
            ]
            product = product @ film
        first, last = admit(outside)[which], admit(inside)[which]
        electric, magnetic = product @ [1.0, last]
        r, t = (
            (first * electric - magnetic) / (first * electric + magnetic),
            2.0 * first / (first * electric + magnetic),
        )
        if which == 0:  # of p tangential fields are cos E, and our sign is that of E x s
            r, t = -r, t * cosine * inside / find(inside)
        found.append((r, t))
    return found[0][0], found[1][0], found[0][1], found[1][1]


@pytest.mark.parametrize("inside", [METAL, 1.5, 2.7 + 0j])
@pytest.mark.parametrize(
    "films", [[], GOLD, [(0.95 + 0j, 0.1)], [(2.4 + 0j, 0.06), (1.59 + 0j, 0.4), (2.4 + 0j, 0.06)]]
)
def test_stacks_are_products_of_characteristic_matrices(films: list[Film], inside: complex) -> None:
    for cosine in COSINES.tolist():
        expected = multiply_matrices(1.5, films, inside, cosine, 0.55)
        assert_close(find_amplitudes(1.5, films, inside, cosine, 0.55), expected, rtol=0.0, atol=1e-12)


def test_no_film_is_fresnel() -> None:
    found = find_amplitudes(1.5, [], METAL, COSINES, 1.0)[:2]
    assert_close(found, reflect_amplitudes(METAL / 1.5, COSINES), rtol=0.0, atol=1e-14)


def test_one_film_is_the_sum_over_bounces() -> None:
    """Airy: what comes out after each bounce, added up one by one."""
    index, thickness, wavelength = 1.46 + 0.02j, 0.35, 0.55
    found = find_amplitudes(1.5, [(index, thickness)], METAL, COSINES, wavelength)
    roots = [find_root(each, 1.5, COSINES) for each in (1.5, index, METAL)]
    phase = np.exp(2j * np.pi * thickness * roots[1] / wavelength)
    for place, which in enumerate("ps"):
        r_01, t_01 = cross_interface(which, 1.5, index, *roots[:2])
        r_10, t_10 = cross_interface(which, index, 1.5, *roots[1::-1])
        r_12, t_12 = cross_interface(which, index, METAL, *roots[1:])
        inside, reflected, passed = t_01 * phase, r_01, np.zeros(COSINES.size, complex)
        for _ in range(4000):
            passed = passed + inside * t_12
            inside = inside * r_12 * phase
            reflected = reflected + inside * t_10
            inside = inside * r_10 * phase
        assert_close(found[place], reflected, rtol=0.0, atol=1e-12)
        assert_close(found[2 + place], passed, rtol=0.0, atol=1e-12)


def test_quarter_waves_have_closed_forms() -> None:
    """Born and Wolf, 1.6.3: pairs of quarter waves, high and low, on glass."""
    high, low, glass, wavelength = 2.3, 1.38, 1.52, 0.55
    pair: list[Film] = [(high + 0j, wavelength / (4 * high)), (low + 0j, wavelength / (4 * low))]
    for count in (1, 3, 6):
        ratio = glass * (high / low) ** (2 * count)
        r_p, r_s, _, _ = find_amplitudes(1.0, pair * count, glass, 1.0, wavelength)
        assert_close([r_p, r_s], [(ratio - 1.0) / (ratio + 1.0), (1.0 - ratio) / (1.0 + ratio)], rtol=0.0, atol=1e-13)


def test_films_without_absorption_keep_all_light() -> None:
    films: list[Film] = [(2.4 + 0j, 0.06), (1.59 + 0j, 0.4), (2.4 + 0j, 0.06)]
    r_p, r_s, t_p, t_s = find_amplitudes(1.5, films, 1.5, COSINES, 0.55)
    assert_close(np.abs(r_p) ** 2 + np.abs(t_p) ** 2, 1.0, rtol=0.0, atol=1e-13)
    assert_close(np.abs(r_s) ** 2 + np.abs(t_s) ** 2, 1.0, rtol=0.0, atol=1e-13)
    r_p, r_s, _, _ = find_amplitudes(1.5, films, None, COSINES, 0.55)
    assert_close([np.abs(r_p), np.abs(r_s)], 1.0, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("name", ["coated aluminium", "fabry-perot"])
def test_compiled_orders_take_amplitudes_from_a_table(name: str) -> None:
    flakes = vrte.flakes(name, 12.0, wavelength_um=0.55, host_index=1.5)
    phi = (np.arange(2000) + 0.5) * (np.pi / 1000)
    for mu, mu_in in ((0.6, -0.8), (0.3, -0.25), (-0.3, -0.4)):
        z: Array = flakes.scatter(mu, mu_in, phi)
        found = flakes.scatter_orders(mu, mu_in, 3)[0][2]
        assert_close(found, np.tensordot(np.cos(2 * phi), z, 1) / 2000, rtol=0.0, atol=2e-8)


def test_colours_shift_with_the_angle() -> None:
    """The fabry-perot is green at normal incidence and darker there at 40 degrees; its core lets nothing through."""
    flakes = [vrte.flakes("fabry-perot", wavelength_um=one, host_index=1.5) for one in (0.45, 0.55, 0.65)]
    share = [[np.abs(r) ** 2 for r in one.reflect([1.0, 0.766])] for one in flakes]
    normal, inclined = np.mean(share, axis=1).T
    assert normal[1] > 3 * max(normal[0], normal[2])
    assert inclined[0] > 2 * max(inclined[1:])
