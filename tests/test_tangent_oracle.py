"""The doubling with every step differentiated, in plain numbers, against differences of ball arithmetic."""

import math

import numpy as np
import pytest

from bench.cases import find_phase_matrix

from .ball_oracle import Layer, Request
from .derivative_oracle import UNIT, differentiate_operators
from .helpers import assert_close
from .tangent_oracle import differentiate_slab, differentiate_thickness

NAMES = ("albedo", "coefficients[1].a1", "coefficients[2].b1", "coefficients[2].b2", "thickness")
QUICK = {("rayleigh", 1.0, 1e4, 0), ("spheroids", 0.5, 1e-6, 1), ("spheroids", 1.0 - 1e-9, math.inf, 0)}


def list_slabs() -> list[object]:
    """Phase matrix, albedo, thickness and order: a few always, the rest with the slow tests."""
    every = [
        (phase, albedo, thickness, m)
        for phase in ("rayleigh", "spheroids", "HG 0.5 12")
        for albedo in (0.5, 1.0 - 1e-9, 1.0)
        for thickness in (1e-6, 1.0, 100.0, 1e4, math.inf)
        for m in (0, 1)
    ]
    return [slab if slab in QUICK else pytest.param(*slab, marks=pytest.mark.slow) for slab in every]


@pytest.mark.parametrize(("phase", "albedo", "thickness", "order"), list_slabs())
def test_differentiated_doubling_is_right(phase: str, albedo: float, thickness: float, order: int) -> None:
    """Measured: 1e-14 of the largest element; 4e-11 of dR and dT where thick slabs absorb little or nothing."""
    layer = Layer(find_phase_matrix(phase).coefficients, albedo, thickness)
    quick = (phase, albedo, thickness, order) in QUICK
    asked = Request(order, (layer,), None, (0.6,), (0.35,), ((0, 0.0),), 2 if quick else 4, UNIT)
    for name in NAMES[::2] if quick else NAMES:
        if math.isinf(thickness) and (name == "thickness" or albedo == 1.0):
            continue
        (E, F, R, T), (dE, dF, dR, dT) = differentiate_operators(asked, f"layer[1].{name}")
        if name == "thickness":
            found = differentiate_thickness(E, F, R, T)
        else:
            *value, dr, dt = differentiate_slab(E, F, dE, dF, thickness)
            found = dr, dt
            assert_close(value[0], R, rtol=0.0, atol=1e-12 * np.abs(R).max())
        for got, right, whole in zip(found, (dR, dT), (R, T), strict=True):
            floor = 1e-15 * np.abs(whole).max() + 1e-90  # a rounding of R and T; the balls' own, where nothing is left
            assert np.abs(got - right).max() <= 1e-9 * np.abs(right).max() + floor, name


def test_a_conservative_layer_without_end_changes_with_its_phase_matrix_alone() -> None:
    """dR/d albedo is -infinite there, as -(1 - albedo)^(-1/2); dR along b1 is what it is."""
    layer = Layer(find_phase_matrix("rayleigh").coefficients, 1.0, math.inf)
    asked = Request(0, (layer,), None, (0.6,), (0.35,), ((0, 0.0),), 2, UNIT)
    (E, F, _, _), (dE, dF, dR, _) = differentiate_operators(asked, "layer[1].coefficients[2].b1")
    found = differentiate_slab(E, F, dE, dF, math.inf)[2]
    assert_close(found, dR, rtol=0.0, atol=1e-12 * np.abs(dR).max())
    (_, _, _, _), (dE, dF, _, _) = differentiate_operators(asked, "layer[1].albedo")
    with pytest.raises(ArithmeticError, match="no derivative with respect to its albedo"):
        differentiate_slab(E, F, dE, dF, math.inf)


def test_several_directions_at_once() -> None:
    """As one by one."""
    layer = Layer(find_phase_matrix("rayleigh").coefficients, 0.9, 3.0)
    asked = Request(1, (layer,), None, (0.6,), (0.35,), ((0, 0.0),), 2, UNIT)
    (E, F, _, _), (dE, dF, _, _) = differentiate_operators(asked, "layer[1].albedo")
    both = differentiate_slab(E, F, np.array([dE, 2.0 * dE]), np.array([dF, 2.0 * dF]), 3.0)
    one = differentiate_slab(E, F, dE, dF, 3.0)
    assert_close(both[2], [one[2], 2.0 * one[2]], rtol=0.0, atol=1e-15)
