"""Divided differences, near and far: of any function, and of exp, in Python and in the core."""

import numpy as np
import pytest

from vrte import _core
from vrte.basics.divided_differences import divide_exp_once, divide_exp_twice, divide_once, divide_twice
from vrte.basics.spherical_functions import find_gauss_legendre

from .helpers import assert_close


def expected_second(a: float, b: float, c: float) -> float:
    """f[a, b, c] of sqrt, by hand: -1/((sqrt a + sqrt b)(sqrt b + sqrt c)(sqrt a + sqrt c))."""
    a, b, c = np.sqrt([a, b, c])
    return float(-1.0 / ((a + b) * (b + c) * (a + c)))


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-6, 1e-3, 0.05, 0.0999, 0.1001, 0.3, 10.0])
def test_divided_differences_near_and_far(gap: float) -> None:
    a, b, c = 2.0, 2.0 * (1.0 + gap), 2.0 * (1.0 - gap / 11.0)
    one = divide_once(np.sqrt, np.array([a]), np.array([b]))
    two = divide_twice(np.sqrt, np.array([a]), np.array([b + 0j]), np.array([c]))
    assert_close(one, 1.0 / (np.sqrt(a) + np.sqrt(b)), rtol=1e-13, atol=0.0)
    assert_close(two, expected_second(a, b, c), rtol=2e-12, atol=0.0)


def test_first_differences_of_exp() -> None:
    a = np.array([0.0, -1.0, -1.0 + 1e-7, -30.0, -1.0 + 2j, -700.0])
    for b in (-1.0, -40.0, 0.0):
        direct = (np.exp(a.astype(np.clongdouble)) - np.exp(np.longdouble(b))) / np.where(a == b, 1.0, a - b)
        assert_close(
            divide_exp_once(a, b), np.where(a == b, np.exp(b), direct), rtol=1e-11 if b == -1.0 else 1e-14, atol=0.0
        )


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 0.3, 1.0, 30.0])
def test_second_differences_of_exp(scale: float):
    """Against the integral over the simplex, by Gauss-Legendre quadrature of many nodes."""
    x, w = find_gauss_legendre(60)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    for points in ((0.0, 0.4, 1.0), (0.2, 0.2, 0.7), (1.0, 1.0, 1.0), (0.0, 1e-8, 1.0)):
        p, q, r = -scale * np.array(points)
        u, v = x[:, None], x[:, None] * x
        integral = np.sum(w[:, None] * w * u * np.exp(p + (q - p) * u + (r - q) * v))
        assert_close(divide_exp_twice(r, p, q), integral, rtol=2e-14, atol=0.0)


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
