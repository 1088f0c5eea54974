"""The oracle in ball arithmetic: against closed forms, published values, a literal solver and another's program."""

import numpy as np
import pytest

import vrte
from bench.cases import find_phase_matrix

from . import literal, oracle
from .closed_forms import airy_sum, bare_base, walsh
from .helpers import assert_close

MU_I, MU_O = [0.1, 0.6, 1.0], [0.2, 0.9]
SPHEROIDS, RAYLEIGH = find_phase_matrix("spheroids"), vrte.rayleigh()


def test_walsh() -> None:
    """As the literature has it for paint and plastic."""
    assert_close(walsh(1.5), [0.0917780, 0.5963458], rtol=0.0, atol=5e-8)


def test_it_is_the_literal_solver_with_more_digits() -> None:
    """Two slabs over a base, reflection and transmission: doubles that share nothing with it."""
    pile = [(SPHEROIDS, 0.9, 1.3), (RAYLEIGH, 0.99, 0.4)]
    scene = vrte.Scene([vrte.Layer(*layer) for layer in pile], vrte.Lambertian(0.3))
    layers = [(matrix.coefficients, *numbers) for matrix, *numbers in pile]
    orders = literal.brdf_orders(layers, 0.3, np.array([0.6]), np.array([0.35]), 6, 2)
    found = oracle.brdf(scene, [0.6], [0.35], 6, range(2))
    for got, right in zip((found.reflected, found.transmitted), orders, strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("index", "nodes"), [(1.0001, 48), (1.05, 32), (1.5, 24), (4.0, 40)])
def test_a_lambertian_base_under_a_surface(index: float, nodes: int) -> None:
    scene = vrte.Scene([vrte.Interface(1.0, index), vrte.Layer(RAYLEIGH, 0.0, 0.0)], vrte.Lambertian(0.5))
    found = oracle.brdf(scene, MU_I, MU_O, nodes, [0])
    assert_close(found.reflected[0, ..., 0, 0], bare_base(index, 0.5, MU_I, MU_O), rtol=1e-13, atol=0.0)


def test_a_plate_is_the_airy_sum_of_intensities() -> None:
    """Glass that absorbs, between air and water: no light but beams."""
    pile = [vrte.Interface(1.0, 1.5), vrte.Layer(RAYLEIGH, 0.0, 0.3), vrte.Interface(1.5, 1.33)]
    found = oracle.brdf(vrte.Scene(pile), MU_I, MU_O, 4, [0])
    for got, right in zip((found.specular, found.specular_transmission), airy_sum(MU_I, 1.5, 1.33, 0.3), strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-15)
    assert not found.reflected.any()


@pytest.mark.parametrize("index", [1.0001, 1.34, 4.0, 1 / 1.5])
def test_no_light_is_lost(index: float) -> None:
    """To the last places with any number of nodes: over a white base, and through a plate on water."""
    top, layer = vrte.Interface(1.0, index), vrte.Layer(SPHEROIDS, 1.0, 0.5)
    over = oracle.brdf(vrte.Scene([top, layer], vrte.Lambertian(1.0)), MU_I, MU_O, 8, [0])
    assert_close(over.reflectance + over.specular[:, 0, 0], 1.0, rtol=0.0, atol=1e-12)
    through = oracle.brdf(vrte.Scene([top, layer, vrte.Interface(index, 1.2)]), MU_I, MU_O, 8, [0])
    beams = through.specular[:, 0, 0] + through.specular_transmission[:, 0, 0]
    assert_close(through.reflectance + through.transmittance + beams, 1.0, rtol=0.0, atol=1e-12)


def test_it_is_reciprocal() -> None:
    """Layers and interfaces of all kinds over a metal, and through a plate, both ways."""
    pile = [
        vrte.Layer(RAYLEIGH, 0.9, 0.3),
        vrte.Interface(1.0, 1.5),
        vrte.Layer(SPHEROIDS, 0.97, 1.0),
        vrte.Interface(1.5, 1.3),
    ]
    q, phi = np.diag([1.0, 1.0, 1.0, -1.0]), np.array([0.0, 70.0])
    over = literal.azimuthal_sum(
        oracle.brdf(vrte.Scene(pile, vrte.Mirror(0.2 + 3.0j)), MU_I, MU_I, 4, range(2)).reflected, phi
    )
    assert_close(over, q @ over.transpose(1, 0, 2, 4, 3) @ q, rtol=0.0, atol=1e-14)
    plate = vrte.Scene(pile)
    down, up = (
        literal.azimuthal_sum(oracle.brdf(scene, MU_I, MU_I, 4, range(2)).transmitted, phi)
        for scene in (plate, plate.turned())
    )
    flip = np.diag([1.0, 1.0, -1.0, -1.0])  # the turned scene is mirrored: docs/reference/conventions.md
    up = flip @ up @ flip
    ratio = 1.3**2  # radiance over the square of the index is what is reciprocal
    assert_close(down, ratio * q @ up.transpose(1, 0, 2, 4, 3) @ q, rtol=0.0, atol=1e-14)


# iadpython 0.5.3 (PyPI), Sample(a, b, g, n).rt(): total reflection and transmission of a slab in air at normal
# incidence, quad_pts 32 and 48 (from 64 on its Radau nodes lose digits: R + T = 0.99992 at albedo 1)
IADPYTHON = [
    ((0.9, 1.0, 0.0, 1.4), (0.2231328953, 0.5270091314), (0.2231236972, 0.5270011476)),
    ((0.99, 10.0, 0.0, 1.5), (0.5938630964, 0.1042377109), (0.5938442760, 0.1042391412)),
    ((1.0, 2.0, 0.0, 1.5), (0.4890140948, 0.5109859052), (0.4890112456, 0.5109887708)),
]


@pytest.mark.parametrize(
    ("slab", "coarse", "fine"), [IADPYTHON[0], *(pytest.param(*one, marks=pytest.mark.slow) for one in IADPYTHON[1:])]
)
def test_without_polarization_it_is_iadpython(
    slab: tuple[float, ...], coarse: tuple[float, float], fine: tuple[float, float]
) -> None:
    """Adding-doubling that others wrote, of intensities alone, which two surfaces that see each other change: by 7e-5
    at thickness 1. Their Gauss points see the critical angle as noise of n^-3, which two numbers of them take off."""
    albedo, thickness, _, index = slab
    pile = [vrte.Interface(1.0, index), vrte.Layer(vrte.isotropic(), albedo, thickness), vrte.Interface(index, 1.0)]
    found = [oracle.brdf(vrte.Scene(pile), [1.0], [0.5], 32, [0], None, polarized) for polarized in (False, True)]
    (R, T), (polarized, _) = (
        (x.reflectance[0] + x.specular[0, 0, 0], x.transmittance[0] + x.specular_transmission[0, 0, 0]) for x in found
    )
    limit = np.array(fine) + (np.array(fine) - np.array(coarse)) / ((48 / 32) ** 3 - 1)
    assert_close([R, T], limit, rtol=0.0, atol=3e-7)
    if thickness == 1.0:
        assert 5e-5 < R - polarized < 6e-5
