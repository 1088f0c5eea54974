"""Derivatives of sixty scenes, thickness 1e-6 to 1e4 and endless, against differences of ball arithmetic."""

import numpy as np
import pytest

from bench.cases import Slab, store_phase_matrices

from . import exact
from .derivative_oracle import MU_I, MU_O, NODES, Case, differentiate_brdf, list_cases, read_table, restore_cases
from .helpers import assert_close
from .test_ball_oracle import fourier_order_of_brdf

PHI = np.arange(32) * (360.0 / 32)
TABLE = read_table()
CASES = restore_cases(TABLE)
ROUNDING = 1e-15  # of the largest element: some derivatives are zero, or of light that a thick layer lets through
EVERY = 6  # of the cases runs always, the others with the slow tests


def errors(case: Case) -> dict[str, float]:
    """By name the largest gap beyond a rounding of the BRDF or BTDF, relative to the derivative's largest element."""
    how = {"nodes": NODES, "derivatives": case.names, "transmission": case.is_transparent, "threads": 1}
    found = exact.brdf(case.scene, MU_I, MU_O, PHI, **how)
    result = {}
    for name, orders in zip(case.names, TABLE[case.key], strict=True):
        values = [found.jacobian[name], *([found.transmission_jacobian[name]] if case.is_transparent else [])]
        gap = 0.0
        light = (found.mueller, found.transmission)[: len(values)]
        for value, whole, right in zip(values, light, orders.swapaxes(0, 1), strict=True):
            assert np.isfinite(value).all(), name
            got = np.array([fourier_order_of_brdf(value, m) for m in case.orders])
            far = np.abs(got - right).max() - ROUNDING * np.abs(whole).max()
            gap = max(gap, far / max(np.abs(right).max(), 1e-300))
        result[name, found.diagnostics["derivatives"][name].split()[0]] = gap
    return result


@pytest.mark.parametrize(
    "case",
    [case if k % EVERY == 0 else pytest.param(case, marks=pytest.mark.slow) for k, case in enumerate(CASES)],
    ids=lambda case: case.name,
)
def test_derivatives_are_those_of_ball_arithmetic(case: Case) -> None:
    """Measured: 3e-13; with the albedo of a layer of thickness 1e4 that absorbs 1e-9 or nothing 1e-10."""
    for (name, how), error in errors(case).items():
        assert how == "algebra", name
        assert error < 1e-9, name


SPHEROIDS = Slab("spheroids", 0.3, 60.0)
DARK = (
    Case((Slab("rayleigh", 0.2, 60.0),), None, ("layer[1].albedo",), (0,)),
    Case((Slab("rayleigh", 0.2, 30.0),), None, ("layer[1].albedo", "layer[1].coefficients[2].b1"), (0, 1)),
    Case((Slab("rayleigh", 0.2, 90.0),), None, ("layer[1].albedo", "layer[1].coefficients[2].a1"), (0, 1)),
    Case((SPHEROIDS,), None, ("layer[1].albedo", "layer[1].coefficients[2].b2"), (0, 1)),
    Case((Slab("rayleigh", 0.9, 1.0), SPHEROIDS), None, ("layer[1].albedo", "layer[2].albedo"), (0, 1)),
)


@pytest.mark.parametrize(
    "case", [DARK[0], *(pytest.param(case, marks=pytest.mark.slow) for case in DARK[1:])], ids=lambda case: case.name
)
def test_what_a_thick_absorber_lets_through(case: Case) -> None:
    """1e-40 of the light at the least, relative to itself; near 1 a cosine on a mode of Rayleigh's, at 0.2."""
    on_a_mode = (0.6, 0.9916877394597053)
    for cosines in ((MU_I, MU_O), (on_a_mode, on_a_mode)):
        asked = {"nodes": NODES, "derivatives": case.names, "transmission": True, "threads": 1}
        found = exact.brdf(case.scene, *cosines, PHI, **asked)
        for name in case.names:
            for order in case.orders:
                right = differentiate_brdf(case, name, order, *cosines)[1]
                got = fourier_order_of_brdf(found.transmission_jacobian[name], order)
                assert np.abs(right).max() > 1e-45
                assert np.abs(got - right).max() < 1e-10 * np.abs(right).max(), (name, order)


def test_the_table_is_what_the_oracle_says() -> None:
    """One entry, worked out again."""
    found = differentiate_brdf(CASES[0], CASES[0].names[1], CASES[0].orders[1])
    np.testing.assert_array_equal(found, TABLE[CASES[0].key][1, 1])


def test_the_table_is_complete_and_up_to_date() -> None:
    assert len(CASES) == 60
    assert {case.key for case in CASES} == {key for key in TABLE if not key.startswith("phase/")}
    assert all(len(TABLE[case.key]) == len(case.names) for case in CASES)


def test_its_phase_matrices_are_those_of_today() -> None:
    """But for the rounding that differs from one processor to another."""
    computed = store_phase_matrices(slab for case in list_cases() for slab in case.slabs)
    for name, coefficients in computed.items():
        assert_close(TABLE[name], coefficients, rtol=0.0, atol=1e-13)
