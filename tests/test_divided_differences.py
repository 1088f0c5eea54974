"""Divided differences of exp, near and far, in Python and in the core."""

import numpy as np
import pytest

from vrte import _core
from vrte.basics.differences import divide_exp_once

from .helpers import assert_close


def test_first_differences_of_exp() -> None:
    a = np.array([0.0, -1.0, -1.0 + 1e-7, -30.0, -1.0 + 2j, -700.0])
    for b in (-1.0, -40.0, 0.0):
        direct = (np.exp(a.astype(np.clongdouble)) - np.exp(np.longdouble(b))) / np.where(a == b, 1.0, a - b)
        assert_close(
            divide_exp_once(a, b), np.where(a == b, np.exp(b), direct), rtol=1e-11 if b == -1.0 else 1e-14, atol=0.0
        )


@pytest.mark.parametrize("thickness", [1e-9, 0.3, 2.0, 80.0])
def test_the_core_has_the_same(thickness: float) -> None:
    """What a layer scatters once down through its bottom, h/mu exp[-h/mu0, -h/mu], at resonance and beside it."""
    mu0, mu = np.array([0.02, 0.5, 1.0]), np.array([0.02, 0.3, 0.5, 0.5 * (1.0 + 1e-9), 1.0])
    found = _core.path_integrals(
        above=np.zeros(2),
        thickness=np.array([thickness]),
        level=np.array([thickness]),
        level_layer=np.zeros(1, np.int32),
        chosen=np.zeros(1, np.int32),
        mu0=mu0,
        mu=-mu,
    )[0, 0]
    expected = thickness / mu * divide_exp_once(-thickness / mu0[:, None], -thickness / mu)
    assert_close(found, expected, rtol=1e-13, atol=0.0)
