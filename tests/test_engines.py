"""Engines: every stage of each against the compiled core, and what becomes of solves that fail their checks.

Whole solves are beside the processor's in tests/test_every_way.py."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import vrte
from vrte import _core
from vrte.basics.errors import SceneError
from vrte.basics.running import Run, ThreadTeam
from vrte.cl import errors
from vrte.cl.session import Session
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines import ENGINES, load_stages
from vrte.discrete_ordinates.execution.engines import opencl as device
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR

from .helpers import assert_close
from .opencl_scenes import scenes

SCENES = scenes()
ALGORITHMS = ("modes", "doubling", "invariance")
MU, PHI = np.array([0.05, 0.4, 1.0]), np.array([0.0, 30.0, 200.0, 330.0])
OTHER_ENGINES = sorted(set(ENGINES.values()) - {"cpu"})
ROUNDING = {"residual": 1e-8, "steps": np.inf}  # up to which a stage says of itself how right it is


# T is small where nothing absorbs; what a thin layer's modes add up to cancels
KNOWN = {"thick": 1e-11, "thin": 1e-9}


class Recorder:
    """The stages of the core, which keep their arguments as they were before each call and after it."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, dict[str, Any], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        def call(crew: ThreadTeam, **given: Any) -> None:
            before = copied(given)
            getattr(_core, name)(crew, **given)
            self.calls.append((name, before, copied(given)))

        return call


def copied(given: dict[str, Any]) -> dict[str, Any]:
    """Arrays as they are now."""
    return {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in given.items()}


@cache
def recorded(name: str, algorithm: str) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """All calls of stages of a solve."""
    recorder, scene = Recorder(), SCENES[name]
    finite = bool(np.isfinite(scene.thickness))
    plan = vrte.plan("brdf", scene, MU, MU, PHI, nodes=5, transmission=finite, algorithm=algorithm)
    carry_out([plan], PROCESSOR, Run(1, kernels=recorder))
    return recorder.calls


@pytest.fixture(autouse=True)
def form(request: pytest.FixtureRequest, opencl: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sessions with products and inverses in the form that a test asks for."""
    if wanted := getattr(request, "param", None):
        monkeypatch.setattr(device, "open_session", lambda: opencl.in_form(wanted))


@pytest.mark.parametrize("form", ["cpu", pytest.param("gpu", marks=pytest.mark.slow)], indirect=True)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", OTHER_ENGINES)
def test_every_stage_is_that_of_the_core(engine: str, name: str, algorithm: str) -> None:
    """On the same arguments, in every call of a solve."""
    stages = load_stages(engine)
    for stage, before, after in recorded(name, algorithm):
        if not hasattr(stages, stage):
            continue
        found = copied(before)
        getattr(stages, stage)(ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)), **found)
        for key, values in found.items():
            if key in ROUNDING:
                assert np.max(values, initial=0.0) <= ROUNDING[key]
            elif isinstance(values, np.ndarray) and not np.array_equal(values, after[key]):
                tolerance = KNOWN.get(name, 1e-12) * np.abs(after[key]).max(initial=0.0)
                assert_close(values, after[key], rtol=0.0, atol=tolerance)


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
    expected = vrte.brdf(SCENES["endless and dark"], MU, MU, PHI, nodes=6, backend="opencl", algorithm="doubling")
    monkeypatch.setattr(device, "find_allowed_residuals", lambda accuracy: {"residual_of_invariance": -1.0})
    found = vrte.brdf(SCENES["endless and dark"], MU, MU, PHI, nodes=6, backend="opencl", algorithm="invariance")
    assert found.diagnostics["orders_repeated"]["by"] == "doubling"
    np.testing.assert_array_equal(found.mueller, expected.mueller)
    monkeypatch.setattr(device.Doubling, "allowed", dict.fromkeys(device.Doubling.allowed, -1.0))
    with pytest.raises(
        vrte.AccuracyError, match=r"the OpenCL device cannot vouch for Fourier order 0 by doubling \(res"
    ):
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


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"backend": "cuda"}, r"backend must be 'openmp', 'sequential', .*, not 'cuda'"),
        (
            {"backend": "opencl", "algorithm": "modes"},
            "'modes' needs an eigensolver, which backend 'opencl' does not have",
        ),
        ({"backend": "sequential", "threads": 2}, "backend 'sequential' has one thread"),
    ],
)
def test_what_is_refused(how: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        vrte.brdf(SCENES["one layer"], MU, MU, **how)


def test_verify_compares_with_the_processor() -> None:
    found = vrte.brdf(SCENES["over a base"], MU, MU, PHI, nodes=6, backend="opencl", verify=True)
    agreement = found.diagnostics["agreement"]
    assert agreement["with"] == "openmp: modes"
    assert agreement["radiance"] < 1e-10
    assert agreement["flux"] < 1e-10
