"""Engines: every stage of each against the compiled core, and what becomes of solves that fail their checks.

Whole solves are beside the processor's in tests/test_every_way.py."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.running import Run, ThreadTeam
from vrte.cl import errors, reconstruction
from vrte.cl.session import Session
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines import ENGINES, load_stages
from vrte.discrete_ordinates.execution.engines import opencl as device
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.phase_assembly import assemble

from .conftest import open_width
from .helpers import assert_close
from .opencl_scenes import SCENES
from .samples import spheroids

layer = vrte.Layer
MU, PHI = np.array([0.05, 0.4, 1.0]), np.array([0.0, 30.0, 200.0, 330.0])
OTHER_ENGINES = sorted(set(ENGINES.values()) - {"cpu"})
GOLD = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.4).phase_matrix
LAYERS = [layer(spheroids(), 0.9, 0.5), layer(vrte.rayleigh(), 0.0, 0.2), layer(GOLD, 0.6, 9.0)]


def find_rates(scene: vrte.Scene, nodes: int) -> np.ndarray:
    """k of the modes of order 1, complex."""
    problem = discretise_scene(scene, np.ones(1), np.eye(4), np.ones(1), np.zeros(1), nodes)
    orders = np.array([1], np.int32)
    modes = find_modes(problem, orders, assemble(problem, orders, Run(1)), Run(1))
    return np.sqrt(modes.lam_re[0, 0] + 1j * modes.lam_im[0, 0])


def ask_for_resonances() -> tuple[str, vrte.Scene, dict[str, Any]]:
    """Directions and a beam on reciprocals of eigenvalues, real and complex, beside them, and on each other."""
    scene = vrte.Scene([layer(spheroids(), 0.99, 0.5)])
    rates = find_rates(scene, 5)
    near = np.sort(1.0 / np.abs(rates[np.abs(rates) > 1.0]))[[0, 4, 9]]
    assert (rates.imag != 0.0).any()
    mu = np.concatenate([near, -near, -near * 1.005, -near * 1.03, [-0.45]])
    return "radiance", scene, {"mu0": [near[1], near[2] * 1.001], "mu": mu, "tau": [0.05, 0.45]}


# name: kind, scene, what is asked
Requests = dict[str, tuple[str, vrte.Scene, dict[str, Any]]]
REQUESTS: Requests = {name: ("brdf", scene, {}) for name, scene in SCENES.items()}
REQUESTS |= {
    f"albedo {albedo:g}, thickness {thickness:g}": (
        "radiance",
        vrte.Scene([layer(spheroids(), albedo, thickness)]),
        {"tau": [0.0, 0.7, 3.0] if np.isinf(thickness) else [0.0, 0.3 * thickness, thickness]},
    )
    for albedo in (0.9, 1.0)
    for thickness in (1e-6, 0.02, 30.0, np.inf)
}
HAZE, PEAKED = vrte.henyey_greenstein(0.3, 6), vrte.henyey_greenstein(0.9, 76)
REQUESTS |= {
    name: ("radiance", vrte.Scene(layers), asked)
    for name, layers, asked in (
        ("inside layers", [*LAYERS, layer(spheroids(), 1.0, 0.4)], {"tau": [0.5, 0.6, 3.0, 9.7, 10.1]}),
        ("above a semi-infinite one", [*LAYERS, layer(spheroids(), 1.0, np.inf)], {"tau": [0.0, 0.5, 9.7, 20.0]}),
        ("scalar", [layer(vrte.isotropic(), 0.9, 0.5), layer(HAZE, 0.7, 2.0)], {"tau": [0.1, 2.5]}),
        ("V apart", [layer(vrte.rayleigh(), 0.9, 0.5)], {"tau": [0.0, 0.2]}),
        ("one node", [layer(GOLD, 0.6, 2.0)], {"mu": [-1.0], "nodes": 1, "truncation": "none"}),
        ("thirteen nodes", [layer(GOLD, 0.6, 2.0)], {"mu": [0.5], "nodes": 13}),
        ("many orders, one azimuth", [layer(PEAKED, 0.9, 1.0)], {"phi": 33.0, "nodes": 40, "mu": 0.4}),
    )
}
REQUESTS["resonances"] = ask_for_resonances()
ALGORITHMS = {name: ("modes", "doubling", "invariance") if name in SCENES else ("modes",) for name in REQUESTS}
LIGHT = {"mu0": [0.45, 1.0], "stokes": (1.0, 0.3, -0.2, 0.1), "mu": [1.0, 0.6, 0.07, -0.3, -0.77], "phi": PHI}
# T is small where nothing absorbs; what a thin layer's modes add up to, and light on a resonance, cancels
KNOWN = {"thick": 1e-11, "thin": 1e-9, "thickness 1e-06": 1e-9, "resonances": 1e-11, "one azimuth": 1e-9}


class Recorder:
    """The stages of the core, which keep their arguments as they were before each call and after it."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, dict[str, Any], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        def call(crew: ThreadTeam, **given: Any) -> Any:
            stage = getattr(_core, name)
            found = stage.allocate(given) if hasattr(stage, "allocate") else {}
            before = copied(given | found)
            stage(crew, **given, **found)
            self.calls.append((name, before, copied(given | found)))
            return _core.result_of(found)

        return call


def copied(given: dict[str, Any]) -> dict[str, Any]:
    """Arrays as they are now."""
    return {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in given.items()}


@cache
def recorded(name: str, algorithm: str) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """All calls of stages of a solve."""
    (kind, scene, asked), recorder = REQUESTS[name], Recorder()
    if kind == "brdf":
        asked = {"mu_i": MU, "mu_o": MU, "phi": PHI, "transmission": bool(np.isfinite(scene.thickness))} | asked
    plan = vrte.plan(
        kind, scene, **{"nodes": 5, "algorithm": algorithm} | (LIGHT if kind == "radiance" else {}) | asked
    )
    carry_out([plan], PROCESSOR, Run(1, kernels=recorder))
    return recorder.calls


def play(stages: Any, stage: str, given: dict[str, Any], stopped: bool = False) -> dict[str, Any]:
    """The arguments of a stage after it."""
    found = copied(given)
    getattr(stages, stage)(ThreadTeam(1, np.zeros(1), np.full(1, stopped, np.int32)), **found)
    return found


@pytest.fixture(autouse=True)
def lanes(request: pytest.FixtureRequest, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sessions with as many work-items for a piece of work as a test asks for."""
    if wanted := getattr(request, "param", None):
        monkeypatch.setattr(device, "open_session", lambda: open_width(opencl.device, wanted))


@pytest.mark.parametrize("lanes", [1, pytest.param(64, marks=pytest.mark.slow)], indirect=True)
@pytest.mark.parametrize(("name", "algorithm"), [(name, each) for name in REQUESTS for each in ALGORITHMS[name]])
@pytest.mark.parametrize("engine", OTHER_ENGINES)
def test_every_stage_is_that_of_the_core(engine: str, name: str, algorithm: str) -> None:
    """On the same arguments, in every call of a solve: light to the largest of each order and depth."""
    stages, tolerance = load_stages(engine), KNOWN.get(name.split(", ")[-1], KNOWN.get(name, 1e-12))
    for stage, before, after in recorded(name, algorithm):
        if not hasattr(stages, stage):
            continue
        for key, values in play(stages, stage, before).items():
            if key == "residual":
                assert np.max(values, initial=0.0) <= 1e-8
            elif isinstance(values, np.ndarray) and key != "steps" and not np.array_equal(values, after[key]):
                size = np.abs(after[key])
                size = size.max(axis=(2, 3), keepdims=True) if stage == "reconstruct" else size.max(initial=0.0)
                allowed = tolerance * size + 1e-16 * size.max(initial=0.0)
                assert (np.abs(values - after[key]) <= allowed).all(), (stage, key)


def test_light_is_reconstructed_in_groups_and_ends_when_told(monkeypatch: pytest.MonkeyPatch) -> None:
    stages = load_stages("opencl")
    (given, after), *_ = [call[1:] for call in recorded("inside layers", "modes") if call[0] == "reconstruct"]
    whole = play(stages, "reconstruct", given)["out"]
    monkeypatch.setattr(reconstruction, "MOST_DOUBLES", 1)
    np.testing.assert_array_equal(play(stages, "reconstruct", given)["out"], whole)
    np.testing.assert_array_equal(play(stages, "reconstruct", given, stopped=True)["out"], given["out"])
    assert (given["out"] != after["out"]).any()
    summed = next(call[1] for call in recorded("inside layers", "modes") if call[0] == "azimuthal_sum")
    nothing = play(stages, "azimuthal_sum", summed | {"last": summed["first"]})
    np.testing.assert_array_equal(nothing["out"], summed["out"])


def test_accuracy_is_kept() -> None:
    """Orders are counted again on the device as on the processor: invariance to the accuracy asked for."""
    gold = vrte.spheres("gold", radius_um=0.3, wavelength_um=0.64)
    scene = vrte.Scene([vrte.Layer.of(gold, thickness=np.inf)])
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=16, accuracy=1e-14, algorithm="doubling")
    for accuracy in (1e-3, 1e-6, 1e-10):
        found = vrte.brdf(scene, MU, MU, PHI, nodes=16, accuracy=accuracy, backend="opencl")
        assert "invariance" in found.diagnostics["orders_by"]
        assert_close(found.mueller, exact.mueller, rtol=0.0, atol=accuracy * exact.mueller.max())


def test_a_device_repeats_what_fails_its_checks_by_doubling_or_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = vrte.brdf(SCENES["semi-infinite and dark"], MU, MU, PHI, nodes=6, backend="opencl", algorithm="doubling")
    monkeypatch.setattr(device, "find_allowed_residuals", lambda accuracy: {"residual_of_invariance": -1.0})
    found = vrte.brdf(SCENES["semi-infinite and dark"], MU, MU, PHI, nodes=6, backend="opencl", algorithm="invariance")
    assert found.diagnostics["orders_repeated"]["by"] == "doubling"
    np.testing.assert_array_equal(found.mueller, expected.mueller)
    monkeypatch.setattr(device.Doubling, "allowed", dict.fromkeys(device.Doubling.allowed, -1.0))
    with pytest.raises(vrte.AccuracyError, match=r"the OpenCL device cannot verify Fourier order 0 by doubling \(res"):
        vrte.brdf(SCENES["one layer"], MU, MU, nodes=6, backend="opencl")


def test_little_room_makes_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = SCENES["over a base"]
    whole = vrte.brdf(scene, MU, MU, PHI, nodes=6, backend="opencl")
    monkeypatch.setattr(device, "CACHED", 1.0)
    monkeypatch.setattr(device, "LARGEST_SHARE", 1e-9)
    found = vrte.brdf(scene, MU, MU, PHI, nodes=6, backend="opencl")
    assert_close(found.mueller, whole.mueller, rtol=0.0, atol=1e-14 * whole.mueller.max())


def test_too_little_memory_is_said_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "SHARE", 1e-6)  # of whatever memory the device has
    with pytest.raises(vrte.DeviceError, match=r"this needs about .* GB on the OpenCL device"):
        vrte.brdf(SCENES["one layer"], np.linspace(0.01, 1, 200), np.linspace(0.01, 1, 200), nodes=6, backend="opencl")


def test_verify_compares_with_the_processor() -> None:
    found = vrte.brdf(SCENES["over a base"], MU, MU, PHI, nodes=6, backend="opencl", verify=True)
    agreement = found.diagnostics["agreement"]
    assert agreement["with"] == "openmp: modes"
    assert agreement["radiance"] < 1e-10
    assert agreement["flux"] < 1e-10
