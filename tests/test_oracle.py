"""The oracle in ball arithmetic: against closed forms, published values, a literal solver and another's program; and
what the package finds for layers over bases, and for their derivatives, against the oracle."""

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest

import vrte
from bench import stability, stability_cases
from bench.cases import Slab, evaluate_mueller_lobe, find_phase_matrix, store_phase_matrices
from tests import exact

from . import literal, oracle, oracle_table
from .closed_forms import airy_sum, bare_base, walsh
from .helpers import assert_close
from .samples import slow_but

MU_I, MU_O = [0.1, 0.6, 1.0], [0.2, 0.9]
COMPARED = {"yes": 260, "no stable answer": 1}  # of the cases of the table of stability; its page says how many
SPHEROIDS, RAYLEIGH = find_phase_matrix("spheroids"), vrte.rayleigh()


def test_walsh() -> None:
    """As the literature has it for paint and plastic."""
    assert_close(walsh(1.5), [0.0917780, 0.5963458], rtol=0.0, atol=5e-8)


def test_it_is_the_literal_solver_with_more_digits() -> None:
    """Two slabs over a base, reflection and transmission: doubles that share nothing with it."""
    stack = [(SPHEROIDS, 0.9, 1.3), (RAYLEIGH, 0.99, 0.4)]
    scene = vrte.Scene([vrte.Layer(*layer) for layer in stack], vrte.Lambertian(0.3))
    layers = [(matrix.coefficients, *numbers) for matrix, *numbers in stack]
    orders = literal.brdf_orders(layers, 0.3, np.array([0.6]), np.array([0.35]), 6, 2)
    found = oracle.brdf(scene, [0.6], [0.35], 6, range(2))
    for got, right in zip((found.reflected, found.transmitted), orders, strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize(("index", "nodes"), [(1.0001, 48), (1.5, 24)])
def test_a_lambertian_base_under_a_surface(index: float, nodes: int) -> None:
    scene = vrte.Scene([vrte.Interface(1.0, index), vrte.Layer(RAYLEIGH, 0.0, 0.0)], vrte.Lambertian(0.5))
    found = oracle.brdf(scene, MU_I, MU_O, nodes, [0])
    assert_close(found.reflected[0, ..., 0, 0], bare_base(index, 0.5, MU_I, MU_O), rtol=1e-13, atol=0.0)


def test_derivatives_are_those_of_closed_forms() -> None:
    """Of a layer that scatters nothing, and of one so thin that light is scattered once."""
    slant, product = np.add.outer(1 / np.array(MU_I), 1 / np.array(MU_O)), np.multiply.outer(MU_I, MU_O)
    clear = vrte.Scene([vrte.Layer(RAYLEIGH, 0.0, 0.5)], vrte.Lambertian(0.3))
    beer, black = np.exp(-0.5 * slant) / np.pi, vrte.Scene([vrte.Layer(vrte.isotropic(), 0.0, 0.5)])
    thin = vrte.Scene([vrte.Layer(RAYLEIGH, 0.9, 1e-30)])
    p2 = [1.5 * np.square(mu) - 0.5 for mu in (MU_I, MU_O)]
    for scene, name, right in (
        (clear, "base.albedo", beer),
        (clear, "layer[1].thickness", -0.3 * slant * beer),
        (black, "layer[1].albedo", -np.expm1(-0.5 * slant) / (4 * np.pi * slant * product)),
        (thin, "layer[1].coefficients[2].a1", 0.9e-30 / (4 * np.pi * product) * np.multiply.outer(*p2)),
    ):
        found = oracle.brdf(scene, MU_I, MU_O, 4, [0], name).reflected[0, ..., 0, 0]
        assert_close(found, right, rtol=1e-14, atol=0.0, err_msg=name)


def test_a_plate_is_the_airy_sum_of_intensities() -> None:
    """Glass that absorbs, between air and water: no light but beams."""
    stack = [vrte.Interface(1.0, 1.5), vrte.Layer(RAYLEIGH, 0.0, 0.3), vrte.Interface(1.5, 1.33)]
    found = oracle.brdf(vrte.Scene(stack), MU_I, MU_O, 4, [0])
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
    stack = [
        vrte.Layer(RAYLEIGH, 0.9, 0.3),
        vrte.Interface(1.0, 1.5),
        vrte.Layer(SPHEROIDS, 0.97, 1.0),
        vrte.Interface(1.5, 1.3),
    ]
    q, phi = np.diag([1.0, 1.0, 1.0, -1.0]), np.array([0.0, 70.0])
    over = literal.azimuthal_sum(
        oracle.brdf(vrte.Scene(stack, vrte.Mirror(0.2 + 3.0j)), MU_I[:2], MU_I[:2], 4, range(2)).reflected, phi
    )
    assert_close(over, q @ over.transpose(1, 0, 2, 4, 3) @ q, rtol=0.0, atol=1e-14)
    plate = vrte.Scene(stack)
    down, up = (
        literal.azimuthal_sum(oracle.brdf(scene, MU_I[:2], MU_I[:2], 4, range(2)).transmitted, phi)
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
    stack = [vrte.Interface(1.0, index), vrte.Layer(vrte.isotropic(), albedo, thickness), vrte.Interface(index, 1.0)]
    found = [oracle.brdf(vrte.Scene(stack), [1.0], [], 24, [0], None, polarized) for polarized in (False, True)]
    (R, T), (polarized, _) = (
        (x.reflectance[0] + x.specular[0, 0, 0], x.transmittance[0] + x.specular_transmission[0, 0, 0]) for x in found
    )
    limit = np.array(fine) + (np.array(fine) - np.array(coarse)) / ((48 / 32) ** 3 - 1)
    assert_close([R, T], limit, rtol=0.0, atol=3e-7)
    if thickness == 1.0:
        assert 5e-5 < R - polarized < 6e-5


# What the package finds, beside it. Where light is refracted: tests/test_interfaces.py.

NODES, STOKES, PHI = 8, (1.0, 0.3, 0.2, 0.1), np.arange(64) * (360.0 / 64)
METAL_SPHERES = vrte.spheres(0.2 + 3.0j, radius_um=0.1, wavelength_um=0.5).phase_matrix
MATRICES = {"spheroids": SPHEROIDS, "rayleigh": find_phase_matrix("rayleigh"), "metal": METAL_SPHERES}


def find_largest_error(got: np.ndarray, right: np.ndarray) -> float:
    """Of the largest over all directions out, beam by beam; a beam that gives nothing must give nothing."""
    scale, error = np.abs(right).max(axis=(1, 2, 3)), np.abs(got - right).max(axis=(1, 2, 3))
    assert (error[scale == 0.0] < 1e-15).all()
    return float((error / np.where(scale == 0.0, 1.0, scale)).max())


# one that mixes U and V in every quick run, the others with the slow tests
@pytest.mark.parametrize("matrix", slow_but(MATRICES, "spheroids"))
@pytest.mark.parametrize(
    ("albedo", "thickness", "transmitted"),
    [
        *((0.5, 1e-6, 1e-13), (1.0, 1.0, 1e-12), (1.0, 1e6, 1e-8)),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((0.5, 1.0, 1e-12), (1.0 - 1e-9, 100.0, 1e-12), (1.0, 1e-6, 1e-13), (1.0, 1e4, 1e-10))
        ),
    ],
)
def test_reflection_and_transmission(matrix: str, albedo: float, thickness: float, transmitted: float) -> None:
    """Measured: reflection to 1e-13, transmission (relative) to 3e-12 at thickness 1e4 and 2e-10 at 1e6."""
    scene = vrte.Scene([vrte.Layer(MATRICES[matrix], albedo, thickness)])
    orders, mu_i, mu_o = (0, 1) if thickness < 10.0 else (0,), [1e-3, 0.5, 1.0], [1e-3, 0.35, 1.0]
    f = exact.brdf(scene, mu_i, mu_o, PHI, nodes=NODES, transmission=True)
    right = oracle.brdf(scene, mu_i, mu_o, NODES, orders)
    for m in orders:
        assert find_largest_error(oracle.find_order(f.mueller, m), right.reflected[m]) < 1e-12
    assert find_largest_error(oracle.find_order(f.transmission, 0), right.transmitted[0]) < transmitted


SCENES: dict[str, tuple[list[tuple[vrte.PhaseMatrix, float, float]], Any]] = {
    "two layers over a grey base": ([(SPHEROIDS, 0.9, 0.7), (RAYLEIGH, 0.99, 1.5)], vrte.Lambertian(0.3)),
    "a lobe as the base": ([(SPHEROIDS, 0.9, 0.7)], vrte.MuellerBase(evaluate_mueller_lobe)),
    "semi-infinite": ([(RAYLEIGH, 0.5, 0.2), (SPHEROIDS, 0.99, math.inf)], None),
    "semi-infinite and conservative": ([(SPHEROIDS, 1.0, math.inf)], None),
    "more terms than the nodes carry": ([(vrte.henyey_greenstein(0.6, 40), 0.9, 1.0)], None),
    "thick, conservative, over white": ([(SPHEROIDS, 1.0, 1e4), (RAYLEIGH, 1.0, 1e-3)], vrte.Lambertian(1.0)),
    "faint light": ([(SPHEROIDS, 0.5, 60.0)], None),
    "a clear layer between": (
        [(SPHEROIDS, 0.9, 0.5), (vrte.isotropic(), 0.0, 2.0), (SPHEROIDS, 0.9, 0.5)],
        vrte.Lambertian(0.1),
    ),
}


@pytest.mark.parametrize(
    "name", slow_but(SCENES, "a lobe as the base", "semi-infinite and conservative", "faint light")
)
def test_both_algorithms_inside_and_out(name: str) -> None:
    """Up, down, at every depth, and fluxes."""
    layers, base = [vrte.Layer(*layer) for layer in SCENES[name][0]], SCENES[name][1]
    scene, last = vrte.Scene(layers, base), layers[-1].thickness
    levels = [(0, 0.0), (0, 0.1), (len(layers) - 1, 0.3 if math.isinf(last) else last)]
    above = np.cumsum([0.0, *(layer.thickness for layer in layers[:-1])])
    mu, tau = (0.35, 1.0, 1e-3, -0.35, -1.0, -1e-3), [above[layer] + depth for layer, depth in levels]
    right = [oracle.solve(scene, [0.6], mu, levels, 4, m) for m in (0, 1)]
    size = np.abs(right[0].radiance[:, 0, :, 0] @ STOKES).max(axis=1)
    fluxes = [flux[:, 0] @ STOKES for flux in (right[0].flux_up, right[0].flux_down)]
    for algorithm in ("modes", "doubling"):
        how = {"mu": mu, "phi": np.arange(180) * 2.0, "tau": tau, "nodes": 4, "algorithm": algorithm}
        field = exact.radiance(scene, 0.6, STOKES, **how)
        error = np.abs(np.subtract([field.flux_up, field.flux_down], fluxes)).max(axis=0)
        assert (error / np.max(fluxes, axis=0)).max() < 1e-11
        for m, light in enumerate(right):
            expected = oracle.split_beam(light.radiance[:, 0], STOKES)
            difference = np.abs(oracle.find_field_order(field.stokes, m) - expected).max(axis=(0, 2, 3)) / size
            assert difference.max() < 1e-11


def test_a_last_place_of_a_conservative_layer_is_worth_its_thickness() -> None:
    """omega = 1 - 1e-16 instead of 1 takes (thickness k)^2 / 2 of the transmission: 1e-8 of it at thickness 1e4."""

    def c(thickness: float) -> float:
        case = stability_cases.Case("thick", 2, (Slab("rayleigh", 1.0, thickness),), sun=0.6, orders=(0,))
        return float(oracle_table.answer_stability(case)["thick/0/c"])

    assert 1e-17 < c(1.0) < 1e-15
    assert 1e-9 < c(1e4) < 1e-7


# The stored tables, and the derivatives of sixty scenes.

STABILITY, DERIVATIVES = stability.read_oracle_table(), oracle_table.read_table(oracle_table.DERIVATIVES)
CASES = oracle_table.restore_cases(DERIVATIVES)
ROUNDING = 1e-15  # of the largest element: some derivatives are zero, or of light that a thick layer lets through
AZIMUTHS = np.arange(32) * (360.0 / 32)


@pytest.mark.parametrize("case", slow_but(CASES, *CASES[::6]), ids=lambda case: case.name)
def test_derivatives_are_those_of_ball_arithmetic(case: oracle_table.Case) -> None:
    """Thickness 1e-6 to 1e4 and semi-infinite. Measured: 3e-13; with the albedo of a layer of thickness 1e4 that
    absorbs 1e-9 or nothing 1e-10."""
    how = {"nodes": NODES, "derivatives": case.names, "transmission": case.is_transparent, "threads": 1}
    found = exact.brdf(case.scene, oracle_table.MU_I, oracle_table.MU_O, AZIMUTHS, **how)
    for name, orders in zip(case.names, DERIVATIVES[case.key], strict=True):
        assert found.diagnostics["derivatives"][name] == "algebra"
        values = [(found.jacobian[name], found.mueller)]
        values += [(found.transmission_jacobian[name], found.transmission)] if case.is_transparent else []
        for (value, whole), right in zip(values, orders.swapaxes(0, 1), strict=True):
            assert np.isfinite(value).all(), name
            difference = np.abs([oracle.find_order(value, m) for m in case.orders] - right).max()
            assert difference < 1e-9 * np.abs(right).max() + ROUNDING * np.abs(whole).max(), name


RAYLEIGH_DARK, SPHEROIDS_DARK = (Slab("rayleigh", 0.2, 60.0),), (Slab("spheroids", 0.3, 60.0),)
DARK = (
    oracle_table.Case(RAYLEIGH_DARK, None, ("layer[1].albedo",), (0,)),
    oracle_table.Case((Slab("rayleigh", 0.2, 30.0),), None, ("layer[1].albedo", "layer[1].coefficients[2].b1"), (0, 1)),
    oracle_table.Case((Slab("rayleigh", 0.2, 90.0),), None, ("layer[1].albedo", "layer[1].coefficients[2].a1"), (0, 1)),
    oracle_table.Case(SPHEROIDS_DARK, None, ("layer[1].albedo", "layer[1].coefficients[2].b2"), (0, 1)),
    oracle_table.Case(
        (Slab("rayleigh", 0.9, 1.0), *SPHEROIDS_DARK), None, ("layer[1].albedo", "layer[2].albedo"), (0, 1)
    ),
)


@pytest.mark.parametrize("case", slow_but(DARK, DARK[0]), ids=lambda case: case.name)
def test_what_a_thick_absorber_lets_through(case: oracle_table.Case) -> None:
    """1e-40 of the light at the least, relative to itself; near 1 a cosine on a mode of Rayleigh's, at 0.2."""
    on_a_mode = (0.6, 0.9916877394597053)
    for mu_i, mu_o in ((oracle_table.MU_I, oracle_table.MU_O), (on_a_mode, on_a_mode)):
        asked = {"nodes": NODES, "derivatives": case.names, "transmission": True, "threads": 1}
        found = exact.brdf(case.scene, mu_i, mu_o, AZIMUTHS, **asked)
        for name in case.names:
            for m in case.orders:
                right = oracle.brdf(case.scene, mu_i, mu_o, NODES, [m], name).transmitted[0]
                got = oracle.find_order(found.transmission_jacobian[name], m)
                assert np.abs(right).max() > 1e-45
                assert np.abs(got - right).max() < 1e-10 * np.abs(right).max(), (name, m)


def test_the_tables_are_what_the_oracle_says() -> None:
    """One entry of each, worked out again."""
    case, name = CASES[0], CASES[0].names[1]
    found = oracle.brdf(case.scene, oracle_table.MU_I, oracle_table.MU_O, NODES, case.orders, name)
    both = np.array([found.reflected, found.transmitted])
    right = DERIVATIVES[case.key][1].swapaxes(0, 1)
    assert_close(both, right, rtol=0.0, atol=1e-15 * np.abs(right).max())
    listed = next(case for case in stability_cases.list_oracle_cases() if case.base == "lobe" and case.nodes == 2)
    answer = oracle_table.answer_stability(stability.restore_case(listed, STABILITY))
    for key, values in answer.items():
        right, *_, kind = STABILITY[key], *key.split("/")
        if kind == "hash":
            assert str(values) == str(right)
        else:  # c is a difference in the last places
            assert_close(values, right, rtol=0.0, atol=(0.5 if kind == "c" else 1e-15) * np.abs(right).max())


def test_the_tables_are_complete_and_their_numbers_those_of_today() -> None:
    """But for the rounding that differs from one processor to another; of eigenvalues in the ninth digit."""
    assert len(CASES) == 60
    assert {case.key for case in CASES} == {key for key in DERIVATIVES if not key.startswith("phase/")}
    assert all(len(DERIVATIVES[case.key]) == len(case.names) for case in CASES)
    listed = stability_cases.list_oracle_cases()
    answers = [stability.find_oracle_answer(case, STABILITY) for case in listed]
    assert Counter(answer if isinstance(answer, str) else "yes" for answer in answers) == COMPARED
    for case in listed:
        assert_close(STABILITY[f"{case.name}/mu"], [case.mu0, *case.mu], rtol=0.0, atol=1e-9)
    for table, cases, atol in ((STABILITY, listed, 1e-12), (DERIVATIVES, oracle_table.list_cases(), 1e-13)):
        for name, computed in store_phase_matrices(slab for case in cases for slab in case.slabs).items():
            assert_close(table[name], computed, rtol=0.0, atol=atol)
