"""Reconstruction on a device against that of the compiled core, on the same modes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.running import Run, ThreadTeam
from vrte.cl import reconstruction
from vrte.discrete_ordinates.orders.base import expand_base
from vrte.discrete_ordinates.orders.boundary import solve_boundary
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.particular import find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import assemble

from .samples import spheroids

UP_AND_DOWN = np.array([1.0, 0.6, 0.07, -0.3, -0.77])
GOLD = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.4).phase_matrix


def solved(
    scene: vrte.Scene,
    tau: list[float],
    mu0: tuple[float, ...] = (0.45, 1.0),
    mu: np.ndarray = UP_AND_DOWN,
    nodes: int = 5,
    orders: tuple[int, ...] = (0, 1, 3),
    stokes: tuple[int, ...] = (0, 1, 2, 3),
) -> dict[str, Any]:
    """A scene solved by modes: the arguments of `reconstruct`."""
    problem = discretise_scene(scene, np.array(mu0), np.eye(4), mu, np.array(tau), nodes)
    problem = replace(problem, stokes=stokes, columns=np.eye(len(stokes)))
    places, run = np.array(orders, np.int32), Run(1)
    matrices = assemble(problem, places, run)
    modes = find_modes(problem, places, matrices, run)
    beam = find_beam_field(problem, matrices, modes, run)
    base = expand_base(scene.below, problem, max(orders) + 1)
    amplitudes = solve_boundary(problem, places, modes, beam, base, run)
    return {
        "G_E": matrices.G_E,
        "G_F": matrices.G_F,
        "lam_re": modes.lam_re,
        "lam_im": modes.lam_im,
        "X": modes.X,
        "Y": modes.Y,
        "c": beam.c,
        "zeta": beam.zeta,
        "even": amplitudes.even,
        "odd": amplitudes.odd,
        "base_down": amplitudes.base_down,
        "decaying": amplitudes.decaying,
        "base_row": base.row[places],
        "base_out": base.out,
        "thickness": problem.thickness,
        "above": problem.above,
        "mu0": problem.mu0,
        "mu_out": problem.mu_out,
        "n_up": problem.n_up,
        "level": problem.level,
        "level_layer": problem.level_layer,
        "out": np.full((places.size, problem.level.size, problem.n_rhs, problem.rows_out), np.nan),
    }


def both(opencl: Any, arguments: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """What the core and what the device make of the same arguments."""
    expected = arguments["out"].copy()
    _core.reconstruct(ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)), **{**arguments, "out": expected})
    return expected, on_device(opencl, arguments)


def on_device(opencl: Any, arguments: dict[str, Any], stopped: bool = False) -> np.ndarray:
    """What the device makes of the arguments."""
    out: np.ndarray = arguments["out"].copy()
    crew = ThreadTeam(1, np.zeros(1), np.full(1, stopped, np.int32))
    reconstruction.reconstruct(opencl, crew, **{**arguments, "out": out})
    return out


def assert_alike(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-13, cancelling: float = 0.0) -> None:
    """To a part of the largest of each order and depth, and a last place of terms that cancel."""
    largest = np.abs(expected).max(axis=(2, 3), keepdims=True)
    assert (np.abs(found - expected) <= tolerance * largest + 1e-14 * cancelling).all()


@pytest.mark.parametrize("thickness", [1e-9, 0.02, 1.0, 30.0, np.inf])
@pytest.mark.parametrize("albedo", [0.9, 1.0])
def test_one_layer(opencl: Any, thickness: float, albedo: float) -> None:
    """Modes that fade and that do not, complex pairs, the top, the base and between; in a thin layer the modes and the
    beam, each as large as its thickness, leave its square."""
    tau = [0.0, 0.7, 3.0] if thickness == np.inf else [0.0, 0.3 * thickness, thickness]
    expected, found = both(opencl, solved(vrte.Scene([vrte.Layer(spheroids(), albedo, thickness)]), tau))
    assert_alike(found, expected, cancelling=thickness if thickness < 1e-6 else 0.0)


@pytest.mark.parametrize("last", [0.4, np.inf])
@pytest.mark.parametrize("base", [None, vrte.Lambertian(0.3)])
def test_layers_over_a_base(opencl: Any, last: float, base: vrte.Lambertian | None) -> None:
    layers = [
        vrte.Layer(spheroids(), 0.9, 0.5),
        vrte.Layer(vrte.rayleigh(), 0.0, 0.2),
        vrte.Layer(GOLD, 0.6, 9.0),
        vrte.Layer(spheroids(), 1.0, last),
    ]
    end = [] if last == np.inf else [10.1]
    expected, found = both(opencl, solved(vrte.Scene(layers, base if end else None), [0.0, 0.5, 0.6, 3.0, 9.7, *end]))
    assert_alike(found, expected)


@pytest.mark.parametrize(
    ("matrix", "stokes", "orders"),
    [
        (vrte.isotropic(), (0,), (0,)),
        (spheroids(), (0, 1), (0,)),
        (spheroids(), (2, 3), (0,)),
        (vrte.rayleigh(), (0, 1, 2), (0, 1, 2)),
        (vrte.rayleigh(), (3,), (0, 1)),
    ],
)
def test_sets_of_stokes_parameters(
    opencl: Any, matrix: vrte.PhaseMatrix, stokes: tuple[int, ...], orders: tuple[int, ...]
) -> None:
    layers = [vrte.Layer(matrix, 0.9, 0.5), vrte.Layer(matrix, 0.7, 2.0)]
    expected, found = both(opencl, solved(vrte.Scene(layers), [0.0, 0.1, 1.0, 2.5], stokes=stokes, orders=orders))
    assert_alike(found, expected)


@pytest.mark.parametrize("thickness", [0.5, 30.0])
def test_resonances(opencl: Any, thickness: float) -> None:
    """Directions and a beam on reciprocals of eigenvalues, beside them, and on each other."""
    scene, tau = vrte.Scene([vrte.Layer(spheroids(), 0.99, thickness)]), [0.1, 0.9 * thickness]
    modes = solved(scene, tau)
    rates = np.sqrt(modes["lam_re"] + 1.0j * modes["lam_im"]).ravel()
    near = np.sort(1.0 / np.abs(rates[np.abs(rates) > 1.0]))[[0, 7, 20]]
    mu = np.concatenate([near, -near, -near * 1.005, -near * 1.03, [-0.45]])
    arguments = solved(scene, tau, (0.45, near[1], near[2] * 1.001), mu)
    k = np.sqrt(arguments["lam_re"] + 1j * arguments["lam_im"])
    close = np.abs(arguments["mu_out"][arguments["n_up"] :, None] * k.ravel() - 1.0) < 0.02
    assert close[:, k.ravel().imag == 0.0].any()
    assert close[:, k.ravel().imag != 0.0].any()
    expected, found = both(opencl, arguments)
    assert_alike(found, expected, 1e-12)


@pytest.mark.parametrize(("nodes", "mu"), [(1, UP_AND_DOWN), (1, [-1.0]), (13, [0.5]), (40, UP_AND_DOWN)])
def test_sizes(opencl: Any, nodes: int, mu: np.ndarray) -> None:
    """No multiples of eight; a result of the wide use too: one order of forty nodes."""
    scene = vrte.Scene([vrte.Layer(GOLD, 0.6, 2.0)])
    orders = (2,) if nodes == 40 else (0, 1)
    expected, found = both(opencl, solved(scene, [0.0, 1.5], mu=np.array(mu), nodes=nodes, orders=orders))
    assert_alike(found, expected)


def test_orders_may_be_done_in_groups_and_stopped(opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = solved(vrte.Scene([vrte.Layer(spheroids(), 0.9, 0.5), vrte.Layer(GOLD, 0.6, 2.0)]), [0.0, 1.5])
    whole = on_device(opencl, arguments)
    monkeypatch.setattr(reconstruction, "MOST_DOUBLES", 1)
    np.testing.assert_array_equal(on_device(opencl, arguments), whole)
    assert np.isnan(on_device(opencl, arguments, stopped=True)).all()


@pytest.mark.parametrize("steps", range(-3, 4))
def test_which_modes_decay_is_decided_once(opencl: Any, steps: int) -> None:
    """Thicknesses about which the judgement turns, to the last digit: it comes with the amplitudes, and all follow."""
    slowest = np.sqrt(solved(vrte.Scene([vrte.Layer(GOLD, 0.9, 1.0)]), [0.0])["lam_re"][0, 0].min())
    thickness = 4.0 / slowest
    for _ in range(abs(steps)):
        thickness = float(np.nextafter(thickness, np.inf if steps > 0 else 0.0))
    arguments = solved(vrte.Scene([vrte.Layer(GOLD, 0.9, thickness)]), [0.0, 0.3, thickness])
    if abs(steps) == 3:
        assert arguments["decaying"][0, 0] == (steps > 0)
    expected, found = both(opencl, arguments)
    assert_alike(found, expected)
