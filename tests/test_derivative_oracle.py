"""Derivatives of sixty scenes, thickness 1e-6 to 1e4 and endless, against differences of ball arithmetic."""

import numpy as np
import pytest

from vrte.studies.cases import store_phase_matrices

from . import exact
from .derivative_oracle import MU_I, MU_O, NODES, Case, differentiate_brdf, list_cases, read_table, restore_cases
from .test_ball_oracle import fourier_order_of_brdf

PHI = np.arange(32) * (360.0 / 32)
TABLE = read_table()
CASES = restore_cases(TABLE)
ROUNDING = 1e-15  # of the largest element: some derivatives are zero, or of light that a thick layer lets through
EVERY = 6  # of the cases runs always, the others with the slow tests


def errors(case: Case) -> dict[str, float]:
    """By name the largest gap beyond the rounding of the BRDF itself, relative to the derivative's largest element."""
    how = {"nodes": NODES, "derivatives": case.names, "transmission": case.is_transparent, "threads": 1}
    found = exact.brdf(case.scene, MU_I, MU_O, PHI, **how)
    result = {}
    for name, orders in zip(case.names, TABLE[case.key], strict=True):
        values = [found.jacobian[name], *([found.transmission_jacobian[name]] if case.is_transparent else [])]
        gap = 0.0
        for value, right in zip(values, orders.swapaxes(0, 1), strict=True):
            assert np.isfinite(value).all(), name
            got = np.array([fourier_order_of_brdf(value, m) for m in case.orders])
            far = np.abs(got - right).max() - ROUNDING * np.abs(found.mueller).max()
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
        np.testing.assert_allclose(TABLE[name], coefficients, rtol=0.0, atol=1e-13)
