"""Small requests: solved where they are called, and what their kernels are checked by."""

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from tests import exact
from vrte import _core
from vrte.basics.blas import find_blas_libraries, keep_to_one_thread
from vrte.basics.cost import BRIEF
from vrte.basics.running import Run, ThreadTeam, start_run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.particular import find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.discrete_ordinates.planning.blocks import choose_node_counts
from vrte.request.request import estimate_operations, make_radiance_request

from .helpers import assert_close

SCALAR = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 16), 0.9, 1.0)])
POLAR = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.2))
LARGE = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.9, 400), 0.9, 1.0)])


def operations(scene: vrte.Scene, nodes: int | None, mu: Any = 0.5, algorithm: str = "auto") -> float:
    return estimate_operations(make_radiance_request(scene, 0.6, mu=mu, nodes=nodes, algorithm=algorithm))


def test_what_is_brief() -> None:
    assert operations(SCALAR, 8) < operations(POLAR, 8) < BRIEF
    assert operations(SCALAR, 8) < operations(SCALAR, 8, algorithm="doubling")
    assert operations(LARGE, 100) > BRIEF
    assert operations(LARGE, 16) < BRIEF < operations(LARGE, 16, mu=np.linspace(0.1, 1.0, 5_000))
    assert operations(SCALAR, 8, mu=np.linspace(0.1, 1.0, 100_000)) > BRIEF
    assert operations(SCALAR, None) == operations(SCALAR, 8, mu=None) == np.inf
    based = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.MuellerBase(lambda i, o, phi: np.eye(4) / np.pi))
    assert operations(based, 4) == np.inf
    assert start_run(3, BRIEF / 2).threads == 1
    assert (start_run(3, BRIEF * 2).threads, start_run(3, BRIEF * 2).brief) == (3, False)
    assert not start_run(1, BRIEF * 2).brief


@pytest.mark.parametrize("scene", [SCALAR, POLAR])
def test_a_brief_call_starts_no_thread(scene: vrte.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vrte.basics.cost, "BRIEF", 0.0)
    waited = vrte.radiance(scene, 0.6, mu=[0.5, -0.5], tau=[0.0, 1.0], nodes=8, threads=2)
    monkeypatch.undo()
    monkeypatch.setattr(threading.Thread, "start", lambda self: pytest.fail("a thread was started"))
    at_once = vrte.radiance(scene, 0.6, mu=[0.5, -0.5], tau=[0.0, 1.0], nodes=8, threads=2)
    np.testing.assert_array_equal(at_once.stokes, waited.stokes)
    np.testing.assert_array_equal(at_once.flux_up, waited.flux_up)
    assert (waited.diagnostics["threads"], at_once.diagnostics["threads"]) == (2, 1)


def problem_of(stokes: tuple[int, ...], nodes: int) -> Problem:
    """Of the Stokes parameters that Rayleigh scattering keeps together."""
    columns = np.eye(4)[:1]
    whole = discretise_scene(POLAR, np.array([0.6]), columns, np.array([0.5]), np.zeros(1), nodes)
    return replace(whole, stokes=stokes, columns=np.ascontiguousarray(columns[:, stokes]))


@pytest.mark.parametrize("nodes", [4, 16, pytest.param(40, marks=pytest.mark.slow)])
def test_symmetric_modes_invert_themselves(nodes: int) -> None:
    """X^-1 = Y^T: the beam's solution is that of the general modes, to what the eigensolver is good for."""
    problem = problem_of((0, 1, 2), nodes)
    orders, run = np.arange(3, dtype=np.int32), Run(1)
    matrices = assemble(problem, orders, run)
    fields = []
    for quick in (True, False):
        modes = find_modes(problem, orders, matrices, run, quick)
        beam = find_beam_field(problem, matrices, modes, run)
        fields.append(np.stack([np.einsum("olrj,olji->olri", c, modes.X) for c in (beam.c, beam.zeta)]))
        if quick:
            paired = modes.X_pivots[..., 0] == -1
            assert paired[1:].all()
            assert not paired[0].any()  # order 0 conserves the flux: its modes are polished
            identity = np.einsum("olji,olki->oljk", modes.Y, modes.X)[1:]
            assert_close(identity, np.broadcast_to(np.eye(problem.size), identity.shape), rtol=0.0, atol=1e-11)
    # each c alone depends on how k stands to 1/mu0, but c X summed over the modes does not depend on their scale
    assert_close(fields[0], fields[1], rtol=0.0, atol=1e-10 * np.abs(fields[1]).max())


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("n_phi", [1, 8, 37])
def test_scalar_series_apiece(n_phi: int, wide: bool) -> None:
    """F11 alone, of another phase function for each direction, against Legendre series; U and V scatter nothing."""
    random = np.random.default_rng(3)
    mu, mu0, phi = np.array([0.9, -0.3, 1.0]), 0.6, np.linspace(0.0, np.pi, n_phi)
    coefficients = np.zeros((mu.size, 31, 6))
    coefficients[..., 0] = random.uniform(-1.0, 1.0, (mu.size, 31))
    out, path = np.zeros((1, 1, mu.size, n_phi, 4, 2)), random.uniform(0.5, 1.0, (1, 1, mu.size))
    _core.add_single_scattering(
        ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)),
        table=_core.series_table(coefficients.reshape(-1, 6), mu.size),
        path=path,
        mu0=np.array([mu0]),
        mu=mu,
        cos_phi=np.cos(phi),
        sin_phi=np.sin(phi),
        angle=np.arange(n_phi, dtype=np.int32),
        sign=np.ones(n_phi),
        columns=np.array([[2.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]]),
        kind=np.array([0, 1], np.int32),
        place=np.array([0, 1], np.int32),
        first=0,
        last=1,
        out=out,
        wide=wide,
        apiece=True,
    )
    cosine = np.sqrt((1.0 - mu**2) * (1.0 - mu0**2))[:, None] * np.cos(phi) - mu0 * mu[:, None]
    for o, series in enumerate(coefficients[..., 0]):
        expected = 2.0 * path[0, 0, o] * np.polynomial.legendre.legval(cosine[o], series)
        assert_close(out[0, 0, o, :, 0, 0], expected, rtol=1e-12, atol=1e-12)
    assert not out[..., 1:, :].any()
    assert not out[..., 1].any()


def test_path_integrals_by_quadrature() -> None:
    layers = [vrte.Layer(vrte.isotropic(), 0.9, thickness) for thickness in (0.3, 1.2, 0.5)]
    mu, mu0, tau = np.array([0.3, -0.7, -0.4]), np.array([0.4, 0.8]), np.array([0.0, 0.9, 1.5, 2.0])
    problem = discretise_scene(vrte.Scene(layers), mu0, np.eye(4)[:1], mu, tau, 4)
    found = integrate_paths(problem, np.arange(4, dtype=np.int32), mu)
    x, weights = np.polynomial.legendre.leggauss(60)
    for k, (top, thickness) in enumerate(zip(problem.above, problem.thickness, strict=True)):
        for t, depth in enumerate(tau):
            for j, direction in enumerate(mu):
                low, high = (max(top, depth), top + thickness) if direction > 0 else (top, min(top + thickness, depth))
                place = 0.5 * (low + high) + 0.5 * max(high - low, 0.0) * x
                light = np.exp(-place / mu0[:, None] - np.abs(place - depth) / abs(direction)) / abs(direction)
                expected = 0.5 * max(high - low, 0.0) * light @ weights
                assert_close(found[k, t, :, j], expected, rtol=1e-12, atol=1e-15)


def test_nodes_seen_and_their_counts() -> None:
    effect = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 0.1, 0.01], [1.0, 0.0, 0.0, 0.0]])
    seen = _core.nodes_seen(strength=np.array([0.5, 0.0, 0.0]), effect=effect, allowed=0.02, largest_gain=1e4)
    assert seen.tolist() == [4, 3, 1]
    assert choose_node_counts(4, seen, 1) == [4, 4, 4]  # another block takes longer than all of them
    wide = np.repeat(np.array([100, 70, 30], np.int32), 9)
    assert choose_node_counts(100, wide, 4) == 9 * [100] + 10 * [70] + 8 * [30]  # in pairs from order 1 on
    assert choose_node_counts(100, wide[:10], 1) == 9 * [100] + [70]


def test_blas_gets_its_threads_back() -> None:
    libraries = find_blas_libraries()
    before = [library.get_num_threads() for library in libraries]
    with keep_to_one_thread(), keep_to_one_thread():
        assert {library.get_num_threads() for library in libraries} == {1}
    assert [library.get_num_threads() for library in libraries] == before


@pytest.mark.parametrize("thickness", [0.1, 1.0, 30.0, np.inf])
def test_real_modes_in_real_arithmetic(thickness: float) -> None:
    """Up and down at the faces and inside, scalar, against doubling, which has no modes."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.7, 16), 0.95, thickness)])
    tau = [0.0, 0.05, 0.1] if np.isinf(thickness) else [0.0, 0.3 * thickness, thickness]
    found = [
        exact.radiance(scene, 0.6, mu=[0.05, 0.6, 1.0, -0.05, -0.6, -1.0], tau=tau, nodes=8, algorithm=algorithm).stokes
        for algorithm in ("modes", "doubling")
    ]
    assert_close(found[0], found[1], rtol=0.0, atol=1e-13 * np.abs(found[1]).max())
