"""The one spline of a BRDF against exact solves, for each that draws, tabulates or renders by it; exp[a, b]."""

import itertools
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.differences import divide_exp_once
from vrte.basics.splines import compute_weights, repeat_grid
from vrte.exports.lobes import Splines
from vrte.formats.measured_polarized import directions
from vrte.render.tables import Resolution, tabulate_brdf
from vrte.results.over_hemisphere import stokes_over_hemisphere

from .helpers import assert_close

LIGHT = np.array([1.0, 0.3, -0.4, 0.5])


@pytest.fixture(scope="module")
def scene() -> vrte.Scene:
    powder = vrte.spheres(1.5 + 0.01j, radius_um=0.3, wavelength_um=0.55)
    return vrte.Scene([vrte.Layer(powder.phase_matrix, powder.albedo, 3.0)], vrte.Lambertian(0.3))


def solved(scene: vrte.Scene, mu_i: Any, mu_o: Any, phi: Any) -> vrte.Brdf:
    return vrte.brdf(scene, mu_i, mu_o, phi, nodes=16, threads=1, transmission=True)


def exact_pairs(scene: vrte.Scene, lowest: float, seed: int) -> tuple[Array, Array, Array, Array]:
    """Cosines and azimuths [rad] of 512 pairs of directions, and the matrices there."""
    random = np.random.default_rng(seed)
    axes = random.uniform(lowest, 1.0, 8), random.uniform(lowest, 1.0, 8), random.uniform(0.0, 360.0, 8)
    mu_i, mu_o, phi = np.array(list(itertools.product(*axes))).T
    return mu_i, mu_o, np.radians(phi), solved(scene, *axes).mueller.reshape(-1, 4, 4)


# bounds are the largest and the median error that pictures, tables and renderer had with splines of their own
@pytest.mark.parametrize(
    ("mu_o", "phi", "largest", "median"),
    [
        pytest.param(np.linspace(0.1, 1.0, 12), np.arange(0, 360, 15), 1.42e-3, 1.08e-4, id="all around"),
        pytest.param(np.linspace(0.05, 1.0, 20), np.arange(0, 181, 15), 1.62e-3, 6.22e-5, id="half a turn"),
        pytest.param(np.linspace(0.2, 0.95, 6), np.arange(0, 181, 30), 2.7e-2, 1.0e-3, id="coarse"),
        pytest.param(np.linspace(0.1, 1.0, 12), [0.0, 60.0, 120.0, 180.0], 1.09e-1, 2.93e-3, id="four azimuths"),
    ],
)
def test_pictures(scene: vrte.Scene, mu_o: Array, phi: Array, largest: float, median: float) -> None:
    random = np.random.default_rng(0)
    theta = np.degrees(np.arccos(mu_o.min())) * np.sqrt(np.append([1e-3, 1e-2], random.uniform(0.0, 1.0, 10)))
    azimuths = random.uniform(0.0, 360.0, 9)
    exact = solved(scene, 0.6, np.cos(np.radians(theta)), azimuths).mueller[0] @ LIGHT
    found = stokes_over_hemisphere(solved(scene, 0.6, mu_o, phi), 0, theta, azimuths, LIGHT)
    off = np.abs(found - exact) / np.abs(exact).max()
    assert off.max() < largest
    assert np.median(off) < median


@pytest.mark.parametrize(
    ("count", "lowest", "largest"),  # all of the hemisphere, and around the pole
    [
        ((24, 37), 0.02, 6.0e-5),
        ((24, 37), 0.999, 1.44e-5),
        pytest.param((48, 73), 0.02, 2.8e-6, marks=pytest.mark.slow),
        pytest.param((48, 73), 0.999, 7.2e-7, marks=pytest.mark.slow),
    ],
)
def test_tables_for_mitsuba(scene: vrte.Scene, count: tuple[int, int], lowest: float, largest: float) -> None:
    mu_i, mu_o, phi, exact = exact_pairs(scene, lowest, 3)
    one = solved(scene, **directions(*count))
    spline = Splines(one.mu_o, one.phi, one.mueller)
    off = np.abs(spline(mu_i, mu_o, np.degrees(phi)) - exact).max(axis=(1, 2))
    assert (off / exact[:, 0, 0]).max() < largest


@pytest.mark.parametrize(
    ("resolution", "largest"), [(Resolution(angles=20, azimuths=36), 1.09e-3), (Resolution(), 1.28e-4)]
)
def test_tables_of_the_renderer(scene: vrte.Scene, resolution: Resolution, largest: float) -> None:
    mu_i, mu_o, phi, exact = exact_pairs(scene, 0.02, 5)
    table = tabulate_brdf(solved(scene, resolution.mu, resolution.mu, resolution.phi), resolution)
    off = np.abs(table.mueller(mu_i, mu_o, phi) - exact).max(axis=(1, 2))
    assert (off / exact[:, 0, 0]).max() < largest


def test_tables_of_sweeps(scene: vrte.Scene) -> None:
    """Cosines in their angle: in the cosine itself the errors were 6e-3 in the median and 1e-1 at most."""
    grid = {"mu_i": np.linspace(0.2, 1.0, 7), "mu_o": np.linspace(0.1, 1.0, 12), "phi_deg": np.arange(0, 181, 15)}
    layer = {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}
    axes = {"depth": {"key": "layer[1].thickness", "start": 0.05, "stop": 5, "count": 9, "spacing": "log"}}
    table = vrte.sweep({"nodes": 6, "layer": [layer], "brdf": grid, "axes": axes}, workers=1)
    random, off = np.random.default_rng(0), []
    for _ in range(20):
        depth = float(np.exp(random.uniform(np.log(0.05), np.log(5.0))))
        point = {name: float(random.uniform(values.min(), values.max())) for name, values in grid.items()}
        layered = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, depth)])
        exact = vrte.brdf(layered, *point.values(), nodes=6).mueller[0, 0, 0]
        found = vrte.interpolate(table, {"depth": depth, **point}).mueller.values
        off.append(np.abs(found - exact).max() / exact[0, 0])
    assert np.median(off) < 2.5e-3
    assert max(off) < 2e-2


@pytest.mark.parametrize("count", [1, 2, 5, 40])
def test_azimuths_go_on_for_ever(count: int) -> None:
    """A period's spline is that of many periods, however few points it has."""
    phi = 360.0 * np.sort(np.random.default_rng(count).uniform(size=count))
    grid, indices = repeat_grid(phi, 360.0)
    assert (grid[0], grid[-1]) < (0.0, 720.0)
    values = np.sin(np.radians(phi))
    at = np.linspace(0.0, 360.0, 19)
    found = compute_weights(grid, at) @ values[indices]
    turns = 2 + 30 // count
    many = np.concatenate([phi + 360.0 * turn for turn in range(-turns, turns + 1)])
    assert_close(found, compute_weights(many, at) @ np.tile(values, 2 * turns + 1), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("thickness", [1e-9, 0.3, 2.0, 80.0])
def test_divided_differences_of_exp_near_and_far_and_in_the_core(thickness: float) -> None:
    """What a layer scatters once down through its bottom, h/mu exp[-h/mu0, -h/mu], at resonance and beside it."""
    a = np.array([0.0, -1.0, -1.0 + 1e-7, -30.0, -1.0 + 2j, -700.0])
    for b, within in ((-1.0, 1e-11), (-40.0, 1e-14), (0.0, 1e-14)):
        direct = (np.exp(a.astype(np.clongdouble)) - np.exp(np.longdouble(b))) / np.where(a == b, 1.0, a - b)
        assert_close(divide_exp_once(a, b), np.where(a == b, np.exp(b), direct), rtol=within, atol=0.0)
    mu0, mu = np.array([0.02, 0.5, 1.0]), np.array([0.02, 0.3, 0.5, 0.5 * (1.0 + 1e-9), 1.0])
    none, depth = np.zeros(1, np.int32), np.array([thickness])
    layer = {"above": np.zeros(1), "thickness": depth, "level": depth, "level_layer": none, "chosen": none}
    found = _core.path_integrals(**layer, mu0=mu0, mu=-mu)[0, 0]
    expected = thickness / mu * divide_exp_once(-thickness / mu0[:, None], -thickness / mu)
    assert_close(found, expected, rtol=1e-13, atol=0.0)
