"""Engines: every stage of each against the compiled core, and whole solves on each against the processor's."""

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
WITH_DEVICE = ("sequential+device", "opencl+lapack", "opencl")
ROUNDING = {"residual": 1e-8, "steps": np.inf}  # up to which a stage says of itself how right it is


# T is small where nothing absorbs; what a thin layer's modes add up to cancels
KNOWN = {"thick": 1e-11, "thin": 1e-9}


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    """Relative to the largest."""
    assert np.abs(found - expected).max(initial=0.0) <= tolerance * np.abs(expected).max(initial=0.0)


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
                close(values, after[key], KNOWN.get(name, 1e-12))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("backend", WITH_DEVICE)
def test_a_field(name: str, backend: str) -> None:
    scene = SCENES[name]
    depth = min(scene.thickness, 5.0)
    request = {"mu": [0.3, -0.5, 1.0], "phi": PHI, "tau": [0.0, 0.4 * depth, depth], "nodes": 6}
    expected = vrte.radiance(scene, 0.6, (1.0, 0.3, -0.2, 0.1), **request)
    found = vrte.radiance(scene, 0.6, (1.0, 0.3, -0.2, 0.1), **request, backend=backend)
    close(found.stokes, expected.stokes, 1e-9)
    close(found.flux_up, expected.flux_up, 1e-9)
    assert_close(found.flux_down, expected.flux_down, rtol=0.0, atol=1e-9)
    assert found.diagnostics["backend"] == backend


@pytest.mark.parametrize("backend", WITH_DEVICE)
def test_a_brdf_with_transmission(backend: str) -> None:
    layer = vrte.Layer(vrte.henyey_greenstein(0.8, 60), 0.99, 3.0)
    scene = vrte.Scene([layer, vrte.Layer(vrte.rayleigh(), 0.9, 0.5)], vrte.Lambertian(0.4))
    expected, found = (
        vrte.brdf(scene, MU, MU, PHI, nodes=8, transmission=True, backend=name) for name in ("openmp", backend)
    )
    close(found.mueller, expected.mueller, 1e-9)
    assert found.transmission is not None
    assert expected.transmission is not None
    close(found.transmission, expected.transmission, 1e-9)
    close(found.reflectance, expected.reflectance, 1e-9)


def test_a_base_that_mixes_orders() -> None:
    def lobe(mu_i: np.ndarray, mu_o: np.ndarray, phi: np.ndarray) -> np.ndarray:
        strength = 0.2 + 0.1 * np.asarray(mu_i) * np.asarray(mu_o) * np.cos(np.radians(phi))
        return strength[..., None, None] * np.diag([1.0, 0.4, 0.4, 0.3])

    scene = vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.5)], vrte.MuellerBase(lobe))
    expected, found = (vrte.brdf(scene, MU, MU, PHI, nodes=5, backend=name) for name in ("openmp", "opencl"))
    close(found.mueller, expected.mueller, 1e-9)


def test_accuracy_is_kept() -> None:
    """Orders are counted again on the device as on the processor: invariance to the accuracy asked for."""
    gold = vrte.spheres("gold", radius_um=0.3, wavelength_um=0.64)
    scene = vrte.Scene([vrte.Layer.of(gold, thickness=np.inf)])
    exact = vrte.brdf(scene, MU, MU, PHI, nodes=16, accuracy=1e-14, algorithm="doubling")
    for accuracy in (1e-3, 1e-6, 1e-10):
        found = vrte.brdf(scene, MU, MU, PHI, nodes=16, accuracy=accuracy, backend="opencl")
        assert "invariance" in found.diagnostics["orders_by"]
        close(found.mueller, exact.mueller, accuracy)


def test_many_scenes_at_once_are_each_as_alone() -> None:
    particles = [vrte.spheres("gold", radius_um=0.2, wavelength_um=w) for w in (0.45, 0.55, 0.65)]
    many = [vrte.Scene([vrte.Layer.of(p, thickness=t)]) for p, t in zip(particles, (5.0, np.inf, 1.0), strict=True)]
    many += [SCENES["three kinds"], vrte.Scene([vrte.Layer(vrte.isotropic(), 0.5, 1.0)])]
    together = vrte.brdfs(many, MU, MU, PHI, nodes=8, backend="opencl")
    for scene, found in zip(many, together, strict=True):
        alone = vrte.brdf(scene, MU, MU, PHI, nodes=8, backend="opencl")
        np.testing.assert_array_equal(found.mueller, alone.mueller)
        assert found.diagnostics["orders"] == alone.diagnostics["orders"]
        close(found.mueller, vrte.brdf(scene, MU, MU, PHI, nodes=8).mueller, 1e-9)


def test_many_scenes_by_the_processor() -> None:
    many = [SCENES["one layer"], SCENES["endless"]]
    steps: list[tuple[int, int]] = []
    found = vrte.brdfs(many, MU, MU, nodes=6, progress=lambda *done: steps.append(done))
    for scene, one in zip(many, found, strict=True):
        np.testing.assert_array_equal(one.mueller, vrte.brdf(scene, MU, MU, nodes=6).mueller)
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
    assert vrte.brdfs([], MU, MU) == []
    with pytest.raises(SceneError, match=r"scene 2 of 2: scene must be a vrte\.Scene, not str"):
        vrte.brdfs([many[0], "gold"], MU, MU)  # type: ignore[list-item]


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
    from vrte.discrete_ordinates.execution.engines import opencl as engine

    scene = SCENES["over a base"]
    whole = vrte.brdf(scene, MU, MU, PHI, nodes=6, backend="opencl")
    monkeypatch.setattr(engine, "CACHED", 1.0)
    monkeypatch.setattr(engine, "LARGEST_SHARE", 1e-9)
    close(vrte.brdf(scene, MU, MU, PHI, nodes=6, backend="opencl").mueller, whole.mueller, 1e-14)


@pytest.mark.slow
def test_the_form_for_a_gpu_solves_too(monkeypatch: pytest.MonkeyPatch, opencl: Session) -> None:
    from vrte.discrete_ordinates.execution.engines import opencl as engine

    opened = opencl.in_form("gpu")
    for name in ("over a base", "endless"):
        expected = vrte.brdf(SCENES[name], MU, MU, PHI, nodes=6)
        with monkeypatch.context() as patch:
            patch.setattr(engine, "open_session", lambda precision="double": opened.in_precision(precision))
            found = vrte.brdf(SCENES[name], MU, MU, PHI, nodes=6, backend="opencl")
        close(found.mueller, expected.mueller, 1e-9)


def test_too_little_memory_is_said_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "SHARE", 1e-6)  # of whatever memory the device has
    with pytest.raises(vrte.DeviceError, match=r"this needs about .* GB on the OpenCL device"):
        vrte.brdf(SCENES["one layer"], np.linspace(0.01, 1, 200), np.linspace(0.01, 1, 200), nodes=6, backend="opencl")


def test_what_is_refused() -> None:
    scene = SCENES["one layer"]
    with pytest.raises(SceneError, match=r"backend must be 'openmp', 'sequential', .*, not 'cuda'"):
        vrte.brdf(scene, MU, MU, backend="cuda")
    with pytest.raises(SceneError, match="'modes' needs an eigensolver, which backend 'opencl' does not have"):
        vrte.brdf(scene, MU, MU, backend="opencl", algorithm="modes")
    with pytest.raises(SceneError, match="backend 'sequential' has one thread"):
        vrte.brdf(scene, MU, MU, backend="sequential", threads=2)


def test_sequential_is_the_same_on_one_thread() -> None:
    found = vrte.radiance(SCENES["one layer"], 0.6, mu=0.5, nodes=6, backend="sequential")
    expected = vrte.radiance(SCENES["one layer"], 0.6, mu=0.5, nodes=6, threads=1)
    np.testing.assert_array_equal(found.stokes, expected.stokes)
    assert found.diagnostics["threads"] == 1


def test_verify_compares_with_the_processor() -> None:
    found = vrte.brdf(SCENES["over a base"], MU, MU, PHI, nodes=6, backend="opencl", verify=True)
    agreement = found.diagnostics["agreement"]
    assert agreement["with"] == "openmp: modes"
    assert agreement["radiance"] < 1e-10
    assert agreement["flux"] < 1e-10
