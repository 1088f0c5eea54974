"""What the package finds for layers over bases, and for their derivatives, beside the oracle in ball arithmetic, which
is what closed forms say and whose tables are complete. Scenes of every kind: tests/test_every_way.py."""

from collections import Counter

import numpy as np
import pytest

import vrte
from bench import stability, stability_cases
from bench.cases import Slab, find_phase_matrix, store_phase_matrices
from tests import exact

from . import oracle, oracle_table
from .closed_forms import airy_sum, bare_base
from .helpers import assert_close
from .samples import slow_but
from .scenes import KNOWN

COMPARED = {"yes": 260, "no stable answer": 1}  # of the cases of the table of stability; its page says how many


def test_it_is_what_closed_forms_say() -> None:
    """A plate of absorbing glass between air and water, a Lambertian base under a surface, and derivatives of light
    through a layer that scatters nothing."""
    mu_i, mu_o, glass = [0.1, 0.6, 1.0], [0.2, 0.9], vrte.Interface(1.0, 1.5)
    absorbing, grey = vrte.Layer(vrte.rayleigh(), 0.0, 0.3), vrte.Lambertian(0.5)
    plate = oracle.brdf(vrte.Scene([glass, absorbing, vrte.Interface(1.5, 1.33)]), mu_i, mu_o, 4, [0])
    for got, right in zip((plate.specular, plate.specular_transmission), airy_sum(mu_i, 1.5, 1.33, 0.3), strict=True):
        assert_close(got, right, rtol=0.0, atol=1e-15)
    found = oracle.brdf(vrte.Scene([glass], grey), mu_i, mu_o, 24, [0]).reflected[0, ..., 0, 0]
    assert_close(found, bare_base(1.5, 0.5, mu_i, mu_o), rtol=1e-13, atol=0.0)
    slant = np.add.outer(1 / np.array(mu_i), 1 / np.array(mu_o))
    beer = np.exp(-0.3 * slant) / np.pi
    for name, right in (("base.albedo", beer), ("layer[1].thickness", -0.5 * slant * beer)):
        found = oracle.brdf(vrte.Scene([absorbing], grey), mu_i, mu_o, 4, [0], name).reflected[0, ..., 0, 0]
        assert_close(found, right, rtol=1e-14, atol=0.0, err_msg=name)


NODES, PHI = 8, np.arange(64) * (360.0 / 64)


def find_largest_error(got: np.ndarray, right: np.ndarray) -> float:
    """Of the largest over all directions out, beam by beam; a beam that gives nothing must give nothing."""
    scale, error = np.abs(right).max(axis=(1, 2, 3)), np.abs(got - right).max(axis=(1, 2, 3))
    assert (error[scale == 0.0] < 1e-15).all()
    return float((error / np.where(scale == 0.0, 1.0, scale)).max())


@pytest.mark.parametrize(
    ("albedo", "thickness", "transmitted"),
    [(0.5, 1e-6, 1e-13), (1.0, 1e6, 1e-8), pytest.param(1.0, 1e4, 1e-10, marks=pytest.mark.slow)],
)
def test_reflection_and_transmission(albedo: float, thickness: float, transmitted: float) -> None:
    """Of spheroids, which mix U and V. Measured: reflection to 1e-13, transmission (relative) to 3e-12 at thickness
    1e4 and 2e-10 at 1e6."""
    scene = vrte.Scene([vrte.Layer(find_phase_matrix("spheroids"), albedo, thickness)])
    orders, mu_i, mu_o = (0, 1) if thickness < 10.0 else (0,), [1e-3, 0.5, 1.0], [1e-3, 0.35, 1.0]
    f = exact.brdf(scene, mu_i, mu_o, PHI, nodes=NODES, transmission=True)
    right = oracle.brdf(scene, mu_i, mu_o, NODES, orders)
    for m in orders:
        assert find_largest_error(oracle.find_order(f.mueller, m), right.reflected[m]) < 1e-12
    assert find_largest_error(oracle.find_order(f.transmission, 0), right.transmitted[0]) < transmitted


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


SPHEROIDS_DARK = (Slab("spheroids", 0.3, 60.0),)
DARK = (
    oracle_table.Case((Slab("rayleigh", 0.2, 60.0),), None, ("layer[1].albedo",), (0,)),
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


@pytest.mark.parametrize(
    ("scene", "number"),
    [
        ("plate, conservative", "layer[2].coefficients[2].b2"),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                ("glass over white", "base.albedo"),
                ("varnish over paint", "layer[2].albedo"),
                ("three media", "layer[3].thickness"),
            )
        ),
    ],
)
def test_derivatives_between_interfaces(scene: str, number: str) -> None:
    """Of numbers of layers and of the base; relative to the largest: 1e-10."""
    asked, orders = (KNOWN[scene], [0.1, 0.6], [0.2, 0.7]), (0, 1)
    right = oracle.brdf(*asked, 6, orders, number)
    f = exact.brdf(*asked, AZIMUTHS, nodes=6, derivatives=[number])
    for m in orders:
        difference = np.abs(oracle.find_order(f.jacobian[number], m) - right.reflected[m]).max()
        assert difference < 1e-10 * np.abs(right.reflected).max()


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
