"""The solver against ball arithmetic, where doubles are known to lose digits: omega = 1, thick, thin, grazing."""

import math

import numpy as np
import pytest

import vrte
from tests import exact

from .ball_oracle import brdf_order
from .oracle import brdf_orders
from .samples import spheroids

MU_I, MU_O = [1e-3, 0.5, 1.0], [1e-3, 0.35, 1.0]
NODES = 8
METAL = (0.2 + 3.0j, 0.1, 0.5)  # index, radius and wavelength in um


def phase_matrix(name: str) -> vrte.PhaseMatrix:
    if name == "metal":
        return vrte.spheres(METAL[0], radius_um=METAL[1], wavelength_um=METAL[2]).phase_matrix
    return spheroids() if name == "spheroids" else vrte.rayleigh()


def fourier_order(f: np.ndarray, m: int) -> np.ndarray:
    """Order m of f, sampled at equal steps of azimuth: (in, out, 4, 4)."""
    phi = np.arange(f.shape[2]) * (2 * math.pi / f.shape[2])
    cosine, sine = (np.einsum("p,iopab->ioab", w(m * phi) / f.shape[2], f) for w in (np.cos, np.sin))
    cosine[..., 2:, :2] = sine[..., 2:, :2]
    cosine[..., :2, 2:] = -sine[..., :2, 2:]
    return cosine


def largest_error(got: np.ndarray, right: np.ndarray) -> float:
    """Of the largest over all directions out, beam by beam; a beam that gives nothing must give nothing."""
    scale = np.abs(right).max(axis=(1, 2, 3))
    error = np.abs(got - right).max(axis=(1, 2, 3))
    assert (error[scale == 0.0] < 1e-15).all()
    return float((error / np.where(scale == 0.0, 1.0, scale)).max())


def test_the_oracle_is_the_literal_solver_with_more_digits() -> None:
    layer = (spheroids().coefficients, 0.9, 1.3)
    balls = brdf_order(1, *layer, [0.8], [0.35], 4)
    doubles = brdf_orders([layer], 0.0, np.array([0.8]), np.array([0.35]), 4, 2)
    for ball, double in zip(balls, doubles, strict=True):
        assert largest_error(double[1], ball) < 1e-13


@pytest.mark.parametrize("matrix", ["rayleigh", "spheroids", "metal"])
@pytest.mark.parametrize(
    ("albedo", "thickness", "transmitted"),
    [
        (0.5, 1e-6, 1e-13),
        (0.5, 1.0, 1e-12),
        (1.0 - 1e-9, 100.0, 1e-12),
        (1.0, 1e-6, 1e-13),
        (1.0, 1.0, 1e-12),
        (1.0, 1e4, 1e-10),
        (1.0, 1e6, 1e-8),
    ],
)
def test_reflection_and_transmission(matrix: str, albedo: float, thickness: float, transmitted: float) -> None:
    """Measured: reflection to 1e-13, transmission (relative) to 3e-12 at thickness 1e4 and 2e-10 at 1e6."""
    kind = phase_matrix(matrix)
    scene = vrte.Scene([vrte.Layer(kind, albedo, thickness)])
    f = exact.brdf(scene, MU_I, MU_O, np.arange(64) * (360.0 / 64), nodes=NODES, transmission=True)
    assert f.transmission is not None
    orders = (0, 1) if thickness < 10.0 else (0,)
    for m in orders:
        R, T = brdf_order(m, kind.coefficients, albedo, thickness, MU_I, MU_O, NODES)
        assert largest_error(fourier_order(f.mueller, m), R) < 1e-12
        if m == 0:
            assert largest_error(fourier_order(f.transmission, m), T) < transmitted
