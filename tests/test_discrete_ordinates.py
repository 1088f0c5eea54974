"""Of the exact solver: signs of phase matrices, checks and what becomes of what fails them, threads, memory, requests.

Whether its light is right is tested in tests/test_every_way.py.
"""

import threading
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests import exact
from vrte import _core
from vrte.basics.cost import BRIEF
from vrte.basics.quadrature import make_double_gauss
from vrte.basics.running import start_run
from vrte.discrete_ordinates.orders.routes import OTHER, ROUTES
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.planning import memory
from vrte.request.request import estimate_operations, make_radiance_request

from .helpers import assert_close, close_to, printed_by
from .literal import azimuthal_sum
from .samples import BOTH, largest_gap, scattered, spheroids
from .sphere_oracle import solve_exactly

MU = np.array([0.05, 0.1, 0.5, 1.0])
PHI = np.array([0.0, 30.0, 111.0, 180.0])


SCALAR = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.5, 16), 0.9, 1.0)])
POLAR = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)], vrte.Lambertian(0.2))
LARGE = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.9, 400), 0.9, 1.0)])


def spheres() -> vrte.PhaseMatrix:
    return vrte.spheres(1.5 + 0.02j, radius_um=0.12, wavelength_um=0.5).phase_matrix


def closed_form(matrix: vrte.PhaseMatrix, mu: float, mu0: float, phi: float) -> np.ndarray:
    """The phase matrix between meridian planes, phi in degrees; light that comes goes down along mu0."""
    out = np.zeros((1, 1, 1, 1, 4, 4))
    one = np.ones((1, 1, 1)), np.array([mu0]), np.array([mu]), np.array([phi])
    scattered(matrix.coefficients, *one, np.eye(4), range(4), out)
    return out[0, 0, 0, 0]


# I, Q, U, V from E_l E_l*, E_l E_r*, E_r E_l*, E_r E_r* of fields exp(-i omega t): V = i (E_l E_r* - E_r E_l*)
STOKES_OF_FIELDS = np.array([[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]])


def frame(u: float, azimuth: float) -> np.ndarray:
    """Direction of travel k, l along theta-hat, r = l x k."""
    s = np.sqrt(1 - u * u)
    k = np.array([s * np.cos(azimuth), s * np.sin(azimuth), u])
    l = np.array([u * np.cos(azimuth), u * np.sin(azimuth), -s])
    return np.array([k, l, np.cross(l, k)])


def mueller_of(jones: np.ndarray) -> np.ndarray:
    """What (E_l, E_r)' = jones (E_l, E_r) makes of Stokes vectors."""
    return (STOKES_OF_FIELDS @ np.kron(jones, jones.conj()) @ np.linalg.inv(STOKES_OF_FIELDS)).real


def sphere(mu: float, mu0: float, phi: float, index: complex, size: float) -> np.ndarray:
    """A sphere's Mueller matrix from Jones vectors: Bohren and Huffman (1983), (4.74) and (3.12), fields
    exp(-i omega t): E' = S2 along the plane of k and k', S1 across it. Its mean over the sphere is that of S11."""
    (k, *into), (k_out, *out) = frame(-mu0, 0.0), frame(mu, np.radians(phi))
    n = np.arange(1, 30)
    a, b = np.array([solve_exactly(int(degree), (index, size)) for degree in n]).T
    cosine, angular = k @ k_out, [0.0, 1.0]
    for degree in n[1:]:
        angular.append(((2 * degree - 1) * cosine * angular[-1] - degree * angular[-2]) / (degree - 1))
    pi = np.array(angular[1:])
    tau = n * cosine * pi - (n + 1) * np.array(angular[:-1])
    factor = (2 * n + 1) / (n * (n + 1))
    s1, s2 = factor @ (a * pi + b * tau), factor @ (a * tau + b * pi)
    r = np.cross(k_out, k) / np.linalg.norm(np.cross(k_out, k))  # r x l = k for l = k x r, in both frames
    l, l_out = np.cross(k, r), np.cross(k_out, r)
    jones = s2 * np.outer(out @ l_out, into @ l) + s1 * np.outer(out @ r, into @ r)
    mean = ((2 * n + 1) @ (abs(a) ** 2 + abs(b) ** 2)) / 2.0  # of S11 over the sphere: k^2 C_sca/(4 pi)
    return mueller_of(jones) / mean


@pytest.mark.parametrize(("mu", "mu0", "phi"), [(0.4, 0.6, 40.0), (-0.6, 0.05, 230.0), (0.95, 0.3, 115.0)])
def test_v_is_that_of_fields(mu: float, mu0: float, phi: float) -> None:
    """A large absorbing sphere (b2 up to half of F11) in the meridian planes, without any rotation angle."""
    index, size = 1.5 + 0.1j, 6.0
    found = vrte.spheres(index, radius_um=size, wavelength_um=2.0 * np.pi).phase_matrix
    expected = sphere(mu, mu0, phi, index, size)
    assert abs(expected[:3, 3]).max() > 0.05 * expected[0, 0]
    assert_close(closed_form(found, mu, mu0, phi), expected, rtol=0.0, atol=1e-11 * found.a1.sum())


def test_phase_matrix_three_ways() -> None:
    """Jones vectors of a dipole, E' = E - (E.k')k', the Fourier sum, and the closed form at the scattering angle."""
    for mu, mu0, phi in product([1.0, 0.4, -0.6, -1.0], [0.6, 0.05, 1.0], [0.0, 40.0, 180.0, 230.0]):
        dipole = 1.5 * mueller_of(frame(mu, np.radians(phi))[1:] @ frame(-mu0, 0.0)[1:].T)
        assert_close(closed_form(vrte.rayleigh(), mu, mu0, phi), dipole, rtol=0.0, atol=1e-14)
        for matrix in (vrte.rayleigh(), spheroids()):
            orders = [_core.phase_matrices(m, matrix.coefficients, [-mu], [mu0])[:1] for m in range(matrix.terms)]
            total = azimuthal_sum(np.array(orders), np.array([phi]))[0, 0, 0]
            atol = 1e-14 * matrix.coefficients[:, 0].sum()
            assert_close(closed_form(matrix, mu, mu0, phi), total, rtol=0.0, atol=atol)


@BOTH
def test_energy_is_conserved_on_many_nodes(algorithm: str) -> None:
    """One mode, or one axis of doubling, carries all flux, so that only sums are rounded: of 2 N amplitudes of I and Q,
    each by 2^-53 of what falls in at most, whatever the thickness."""
    nodes, levels = 40, [0.0, 3e3, 1e4]
    scene = vrte.Scene([vrte.Layer(spheroids(), 1.0, levels[-1])], vrte.Lambertian(1.0))
    field = exact.radiance(scene, 0.6, mu=[], tau=levels, nodes=nodes, algorithm=algorithm)
    assert np.abs(field.flux_down + field.direct - field.flux_up).max() < 2 * nodes * 2.0**-53


@BOTH
@pytest.mark.parametrize("nodes", [1, 4])
def test_a_base_sends_the_same_light_in_many_more_directions_than_nodes(algorithm: str, nodes: int) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 0.1)], vrte.Lambertian(0.4))
    asked: dict[str, Any] = {"mu": np.linspace(0.01, 1.0, 60), "tau": 0.1, "nodes": nodes, "algorithm": algorithm}
    light = vrte.radiance(scene, 0.7, **asked).stokes[0, :, 0, 0]
    assert_close(light, light[0], rtol=1e-14, atol=0.0)


def test_a_layer_as_the_base_of_another() -> None:
    """The BRDF of the lower layer, as a Mueller base with b2 != 0, must act as that layer does: no sign can hide."""
    low = vrte.Layer(spheroids(), 0.9, 2.0)

    def function(mu_i: Any, mu_o: Any, phi_deg: Any) -> np.ndarray:
        axes, index = zip(
            *(np.unique(v, return_inverse=True) for v in np.broadcast_arrays(mu_i, mu_o, phi_deg)), strict=True
        )
        return exact.brdf(vrte.Scene([low]), *axes, nodes=10).mueller[index]

    upper = vrte.Layer(spheres(), 0.9, 1.0)
    based = exact.brdf(vrte.Scene([upper], vrte.MuellerBase(function)), [0.3, 0.8], [0.2, 1.0], PHI, nodes=10)
    layered = exact.brdf(vrte.Scene([upper, low]), [0.3, 0.8], [0.2, 1.0], PHI, nodes=10)
    assert largest_gap(based.mueller, layered.mueller) < 1e-10


@BOTH
def test_threads_and_callers_at_once_change_no_bit(algorithm: str) -> None:
    layers = [vrte.Layer(spheroids(), 0.9, 1.0), vrte.Layer(spheres(), 1.0, 0.3)]

    def solve(threads: int) -> np.ndarray:
        scene = vrte.Scene(layers, vrte.Lambertian(0.2))
        return exact.brdf(scene, MU, MU, PHI, nodes=8, threads=threads, algorithm=algorithm).mueller

    alone = solve(1)
    with ThreadPoolExecutor(8) as pool:
        assert all(np.array_equal(alone, found) for found in [solve(2), solve(3), *pool.map(solve, [1, 2] * 4)])


INTERRUPTED = """
import signal, threading, time, warnings, vrte
warnings.simplefilter("ignore", vrte.LongSolveWarning)
gold = vrte.spheres((1.5, 0.01), radius_um=3.0, wavelength_um=0.5).phase_matrix
sent = []
def interrupt():
    sent.append(time.monotonic())
    signal.raise_signal(signal.SIGINT)
signal.signal(signal.SIGINT, signal.default_int_handler)
vrte.brdf(vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, 1.0)]), 0.5, 0.5, nodes=2)  # loads what it needs
threading.Timer(1.0, interrupt).start()
try:
    vrte.brdf(vrte.Scene([vrte.Layer(gold, 0.9, 1.0)]), 0.5, 0.5, nodes=200, algorithm={algorithm!r})
except KeyboardInterrupt:
    print(time.monotonic() - sent[0])
"""


@pytest.mark.parametrize("algorithm", ["modes", pytest.param("doubling", marks=pytest.mark.slow)])
def test_interrupt_stops_a_long_solve_within_a_second(algorithm: str, tmp_path: Path) -> None:
    """SIGINT a second into minutes of work, where one eigenproblem takes more than a second."""
    (seconds,) = printed_by(INTERRUPTED.format(algorithm=algorithm), tmp_path)
    assert float(seconds) < 1.0


@pytest.mark.parametrize("threads", [1, 2])
def test_progress_ends_at_its_end(threads: int) -> None:
    """Where orders turn out not to matter, and where terms are cut: orders, some at a time, then pieces of the result,
    here one."""
    reported: list[tuple[int, int]] = []
    asked: dict[str, Any] = {"threads": threads, "progress": lambda *at: reported.append(at)}
    found = exact.brdf(LARGE, 0.5, 0.5, nodes=8, **asked).diagnostics
    assert found["terms_cut"] == 384
    assert reported[-2:] == [(found["orders"], found["orders"] + 1), (found["orders"] + 1, found["orders"] + 1)]
    assert set(found["stages"]) >= {"assembly", "homogeneous", "boundary", "reconstruction"}
    reported.clear()
    gold, mu = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4), np.linspace(0.05, 1.0, 20)
    made = vrte.brdf(vrte.Scene([vrte.Layer.of(gold, thickness=100.0)]), mu, mu, [0.0, 90.0], nodes=16, **asked)
    assert made.diagnostics["orders"] < reported[-1][1] - 1, "otherwise there is nothing to see here"
    assert reported[-1][0] == reported[-1][1]
    assert reported == sorted(reported)


def test_default_directions_are_the_nodes() -> None:
    """Where the light, single scattering included, adds up to the fluxes."""
    layer = vrte.Layer(spheroids(), 0.9, 1.0)
    field = exact.radiance(vrte.Scene([layer]), 0.6, tau=0.5, phi=np.arange(16) * 22.5, nodes=8)
    nodes, weights = make_double_gauss(8)
    assert np.array_equal(field.mu, np.concatenate([nodes, -nodes]))
    mean = field.stokes[0, :, :, 0].mean(axis=1)
    for flux, light in ((field.flux_up, mean[:8]), (field.flux_down, mean[8:])):
        assert 2 * np.pi * (weights * nodes) @ light == close_to(flux[0], rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("layers", "nodes", "asked", "algorithm"),
    [
        ([(0.9, 1.0)], 4, "modes", "modes"),
        ([(0.9, 1.0)], 4, "doubling", "doubling"),
        ([(1.0, 1.0)], 4, "invariance", "modes"),  # where there is a bottom, or nothing absorbs
        ([(0.9, 1.0)], 40, "auto", "modes"),
        ([(0.9, 1e-7), (0.0, 1.0)], 16, "auto", "doubling"),  # fluxes of what scatters so little
        ([(0.9, 0.1), (0.5, 0.1)] * 20, 8, "auto", "doubling"),  # two slabs for forty eigenproblems
        ([(0.9, 1e6)], 40, "auto", "modes"),
    ],
)
def test_which_algorithm_is_taken(layers: list[tuple[float, float]], nodes: int, asked: str, algorithm: str) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), *layer) for layer in layers])
    made = exact.brdf(scene, 0.5, 0.5, nodes=nodes, algorithm=asked).diagnostics
    rule = {"auto": "auto: ", "invariance": "invariance was asked for"}.get(asked, "asked for")
    assert made["algorithm"] == algorithm
    assert made["algorithm_rule"].startswith(rule)
    assert made["orders_repeated"] is None


@BOTH
def test_an_order_that_fails_its_checks_is_repeated_by_the_other_route(
    algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.9, 1.0)])
    expected = exact.radiance(scene, 0.6, phi=PHI, tau=[0.0, 1.0], nodes=8)
    monkeypatch.setattr(ROUTES[algorithm], "allowed", dict.fromkeys(ROUTES[algorithm].allowed, -1.0))
    repeated = exact.radiance(scene, 0.6, phi=PHI, tau=[0.0, 1.0], nodes=8, algorithm=algorithm)
    reported = repeated.diagnostics["orders_repeated"]
    assert reported == {"by": OTHER[algorithm], "orders": list(range(repeated.diagnostics["orders"]))}
    assert largest_gap(repeated.stokes, expected.stokes) < 1e-13
    assert np.abs(repeated.flux_up - expected.flux_up).max() < 1e-14
    monkeypatch.setattr(ROUTES[OTHER[algorithm]], "allowed", dict.fromkeys(ROUTES[OTHER[algorithm]].allowed, -1.0))
    with pytest.raises(vrte.AccuracyError, match="neither algorithm can verify Fourier order 0") as raised:
        exact.radiance(scene, 0.6, nodes=8, algorithm=algorithm)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("algorithm", ["modes", "doubling", "invariance"])
def test_the_orders_of_a_block_that_pass_their_checks_stay(algorithm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = vrte.Scene([vrte.Layer(spheroids(), 0.9, np.inf)])
    expected = exact.brdf(scene, MU, MU, PHI, nodes=8, algorithm="doubling")
    solve = ROUTES[algorithm].solve

    def spoil_two(route: Any, orders: np.ndarray, run: Any) -> Orders:
        found = solve(route, orders, run)
        for values in found.residuals.values():
            values[np.isin(orders, [0, 2])] = 1.0
        return found

    monkeypatch.setattr(ROUTES[algorithm], "solve", spoil_two)
    monkeypatch.setattr("vrte.discrete_ordinates.execution.engines.cpu.are_for_one_call", lambda *_: False)
    found = exact.brdf(scene, MU, MU, PHI, nodes=8, algorithm=algorithm, accuracy=1e-12)
    assert found.diagnostics["orders_repeated"] == {"by": OTHER[algorithm], "orders": [0, 2]}
    assert largest_gap(found.mueller, expected.mueller) < 1e-12
    assert_close(found.reflectance, expected.reflectance, rtol=0.0, atol=1e-12)


@pytest.mark.filterwarnings("ignore::vrte.AccuracyWarning")  # 8 nodes are too few for 1500 terms
def test_growing_modes_are_left_to_doubling() -> None:
    """1500 terms on 8 nodes: FE has negative eigenvalues, which modes refuse; the discrete problem has an answer. Only
    what both routes verify is compared."""
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.99, 1500), 0.9, 0.5)])
    auto, doubled = (exact.brdf(scene, MU, MU, nodes=8, algorithm=a, verify=a == "auto") for a in ("auto", "doubling"))
    repeated, agreement = (auto.diagnostics[name] for name in ("orders_repeated", "agreement"))
    assert repeated["by"] == "doubling"
    assert largest_gap(auto.mueller, doubled.mueller) < 1e-12
    assert agreement["with"] == "doubling"
    assert agreement["orders_compared"] == auto.diagnostics["orders"] - len(repeated["orders"]) > 0
    assert 0.0 < agreement["radiance"] < 1e-9
    plain = exact.radiance(POLAR, 0.6, tau=[0.0, 0.1], nodes=12, verify=True).diagnostics["agreement"]
    assert 0.0 < plain["radiance"] < 1e-12
    assert 0.0 < plain["flux"] < 1e-12


def test_nodes_near_the_horizon_cost_no_digits() -> None:
    """Graded, the lowest lies at 1e-7: modes would miss the accuracy, so auto doubles."""
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, 1.0) for albedo in (0.9, 1.0)], vrte.Lambertian(0.3))
    asked = {"mu_i": [0.5, 1.0], "mu_o": [1e-3, 0.9], "nodes": 24, "grading": 2}
    found, right = (vrte.brdf(scene, **asked, accuracy=1e-10, algorithm=way) for way in ("auto", "doubling"))
    assert largest_gap(found.mueller, right.mueller) < 1e-10


FOUR = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0 + 0.1 * k) for k in range(4)])
ROUGH = vrte.Scene([vrte.Interface(1, 1.33, 0.2), vrte.Layer(vrte.rayleigh(), 0.9, 2.0)], vrte.Lambertian(0.3))


@BOTH
@pytest.mark.parametrize(
    ("scene", "request_of"),
    [
        (FOUR, {"nodes": 40}),
        (FOUR, {"nodes": 8, "phi": np.arange(300_000.0)}),
        (ROUGH, {"nodes": 24, "mu": np.linspace(-1.0, 1.0, 90)}),
    ],
)
def test_memory_is_estimated_before_it_is_taken(
    scene: vrte.Scene, request_of: dict[str, Any], algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of rough surfaces, too: all orders of what facets send on are there at once, three times what all else takes."""
    reported: list[float] = []
    count = memory.count_doubles_needed
    monkeypatch.setattr(
        memory, "count_doubles_needed", lambda *given: reported.append(8 * count(*given)) or reported[-1] / 8
    )
    tracemalloc.start()
    exact.radiance(scene, 0.6, **{"mu": [0.5, -0.5], "tau": [0.0, 1.0], "algorithm": algorithm} | request_of)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.5 * peak < reported[0] < 3.0 * peak


@pytest.mark.parametrize(
    "request_of",
    [{"nodes": 4096}, {"nodes": 4, "mu": np.linspace(0.1, 1.0, 100000), "phi": np.linspace(0.0, 360.0, 100000)}],
)
@pytest.mark.filterwarnings("ignore::vrte.LongSolveWarning")  # of days, were there the memory
def test_a_request_larger_than_the_memory_is_refused_before_it_starts(request_of: dict[str, Any]) -> None:
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0 + 0.01 * k) for k in range(100)])
    start = time.process_time()
    with pytest.raises(vrte.SceneError, match=r"GB of memory and .* GB are available"):
        exact.radiance(scene, 0.6, time_limit_s=np.inf, **request_of)
    assert time.process_time() - start < 2.0


@pytest.mark.parametrize("algorithm", ["modes", "doubling"])
@pytest.mark.parametrize("illuminate", ["top", "bottom"])
def test_a_depth_next_to_an_interface_lies_on_it(algorithm: str, illuminate: str) -> None:
    """.1 + .2 + .3 is one unit in the last place above the sum of the layers, 0.7 + 0.1 is not 0.8: the last place is a
    path of 1e-8 along a cosine of 1e-8, and no light comes along it."""
    how: dict[str, Any] = {"nodes": 4, "algorithm": algorithm, "illuminate": illuminate}
    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, depth) for depth in (0.7, 0.1)], vrte.Lambertian(1))
    for tau in (scene.thickness, 0.7 + 0.1, np.nextafter(scene.thickness, 0.0)) if illuminate == "top" else ():
        up = exact.radiance(scene, 0.5, mu=[0.5, 1e-8], tau=tau, **how).stokes[0, :, 0, 0]
        assert up[1] == close_to(up[0], rtol=1e-14, atol=0.0)
    scene = vrte.Scene([vrte.Layer(vrte.isotropic(), 0.9, thickness) for thickness in (0.1, 0.2, 0.3)])
    below, above = 0.1 + 0.2 + 0.3, 0.3 - 0.2 - 0.1
    assert above < 0.0 < scene.thickness < below
    field, right = (
        vrte.radiance(scene, 0.6, mu=[0.5, -0.5], tau=tau, **how) for tau in ([above, below], [0.0, scene.thickness])
    )
    np.testing.assert_array_equal(field.stokes, right.stokes)
    np.testing.assert_array_equal(field.tau, right.tau)
    for far in (0.6 + 1e-14, -1e-14):
        with pytest.raises(vrte.SceneError, match=r"tau must lie between 0 and the total optical thickness 0\.6"):
            vrte.radiance(scene, 0.6, tau=far, nodes=4)


def operations(scene: vrte.Scene, nodes: int | None, mu: Any = 0.5, algorithm: str = "auto") -> float:
    return estimate_operations(make_radiance_request(scene, 0.6, mu=mu, nodes=nodes, algorithm=algorithm))


def test_what_is_brief() -> None:
    assert operations(SCALAR, 8) < operations(POLAR, 8) < BRIEF
    assert operations(SCALAR, 8) < operations(SCALAR, 8, algorithm="doubling")
    assert operations(LARGE, 100) > BRIEF
    assert operations(LARGE, 16) < BRIEF < operations(LARGE, 16, mu=np.linspace(0.1, 1.0, 5_000))
    assert operations(SCALAR, 8, mu=np.linspace(0.1, 1.0, 100_000)) > BRIEF
    assert operations(SCALAR, None) == operations(SCALAR, 8, mu=None) == np.inf
    based = vrte.Scene(SCALAR.layers, vrte.MuellerBase(lambda i, o, phi: np.eye(4) / np.pi))
    assert operations(based, 4) == np.inf
    assert start_run(3, BRIEF / 2).threads == 1
    assert (start_run(3, BRIEF * 2).threads, start_run(3, BRIEF * 2).brief) == (3, False)
    assert not start_run(1, BRIEF * 2).brief


@pytest.mark.parametrize("scene", [SCALAR, POLAR])
def test_a_brief_call_starts_no_thread(scene: vrte.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {"mu0": 0.6, "mu": [0.5, -0.5], "tau": [0.0, 1.0], "nodes": 8, "threads": 2}
    monkeypatch.setattr(vrte.basics.cost, "BRIEF", 0.0)
    waited = vrte.radiance(scene, **asked)
    monkeypatch.undo()
    monkeypatch.setattr(threading.Thread, "start", lambda self: pytest.fail("a thread was started"))
    at_once = vrte.radiance(scene, **asked)
    np.testing.assert_array_equal(at_once.stokes, waited.stokes)
    np.testing.assert_array_equal(at_once.flux_up, waited.flux_up)
    assert (waited.diagnostics["threads"], at_once.diagnostics["threads"]) == (2, 1)
