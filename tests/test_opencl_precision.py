"""Kernels in single precision: how far from doubles they are, and what becomes of what fails its checks."""

import os
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.cl import device
from vrte.cl.matrices import download_stack, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import OPTIONS_OF, REALS, read_sources

from . import opencl_scenes
from .samples import spheroids

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
EITHER = re.compile(r"#ifdef SINGLE\n(.*?)#else\n.*?#endif\n", re.DOTALL)
MU = np.array([0.05, 0.3, 1.0])
layer = vrte.Layer


@pytest.fixture
def without_doubles(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The devices that there are, said to have none."""
    hidden = tuple(replace(found, double_precision=False) for found in device.devices())
    state = {"process": os.getpid(), "devices": hidden, "sessions": {}, "complaints": {}}
    with monkeypatch.context() as patched:
        patched.setattr(device, "_state", state)
        yield


def test_nothing_is_double_in_single_precision() -> None:
    """As a compiler without doubles sees the sources: literals are floats by an option."""
    assert "-cl-single-precision-constant" in OPTIONS_OF["single"]
    left = EITHER.sub(r"\1", COMMENT.sub("", read_sources("single")))
    assert "#define real float\n" in left
    assert not re.search(r"\bdouble\d*\b|fp64|\blong4\b|#ifdef", left)


def test_sessions_of_both_precisions(opencl: Any) -> None:
    """On one queue; numbers go up as floats and come down as doubles, and products have the rounding of each."""
    single = opencl.in_precision("single")
    assert single.in_precision("single") is opencl.in_precision("single") is single
    assert single.in_precision("double").queue is single.queue
    assert single.lock is opencl.lock
    assert single.constants is not opencl.constants
    for values in (np.array([1.0 / 3.0, np.inf, 1e300]), np.full(5000, 1.0 / 3.0)):
        up = single.upload(values)
        assert up.dtype == REALS["single"]
        with np.errstate(over="ignore"):
            assert (single.download(up) == values.astype(np.float32)).all()
        assert single.download(up).dtype == np.float64
    assert single.download(single.upload(np.arange(3, dtype=np.int32))).dtype == np.int32
    a, b = np.random.default_rng(0).normal(size=(2, 3, 20, 20))
    expected = np.swapaxes(np.swapaxes(a, 1, 2) @ np.swapaxes(b, 1, 2), 1, 2)
    for precision in ("double", "single"):
        session = opencl.in_precision(precision)
        made = make_stack(session, 3, 20, 20)
        multiply_stacks(session, upload_stack(session, a), upload_stack(session, b), made)
        difference = np.abs(download_stack(session, made) - expected).max() / np.abs(expected).max()
        assert difference < 20 * np.finfo(REALS[precision]).eps
        assert precision == "double" or difference > np.finfo(np.float64).eps * 1e4


GOLD = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.64)
SCENES = {name: scene for name, scene in opencl_scenes.SCENES.items() if name != "three kinds"} | {
    "gold, semi-infinite": vrte.Scene([layer.of(GOLD, thickness=np.inf)]),
    "peaked": vrte.Scene([layer(vrte.henyey_greenstein(0.85), 0.99, 4.0)]),
    "grazing": vrte.Scene([layer(spheroids(), 0.97, 2.0)]),
}


def solve(name: str, **how: Any) -> vrte.Brdf:
    """The BRDF of one of the scenes, and its transmission where it has a bottom."""
    scene = SCENES[name]
    asked = {
        "nodes": 16 if name == "peaked" else 8,
        "backend": "opencl",
        "transmission": bool(np.isfinite(scene.thickness)),
    }
    mu = [1e-3, 0.3, 1.0] if name == "grazing" else MU
    return vrte.brdf(scene, mu, mu, [0.0, 40.0, 180.0], **asked, **how)


def find_error(found: vrte.Brdf, expected: vrte.Brdf) -> float:
    """The largest of reflection, transmission and fluxes, relative to the largest I of each."""
    pairs = [(found.mueller, expected.mueller)]
    if found.transmission is not None:
        pairs.append((found.transmission, expected.transmission))
    differences = [np.abs(one - other).max() / np.abs(other[..., 0, 0]).max() for one, other in pairs]
    return float(max(*differences, np.abs(found.reflectance - expected.reflectance).max()))


@pytest.mark.parametrize("name", SCENES)
def test_single_precision_keeps_its_promise(opencl: Any, name: str) -> None:
    """1e-4 of the largest I, against doubles at an accuracy of 1e-10. Where nothing absorbs, light that crosses 1e4 has
    lost its digits in floats: that is solved in doubles."""
    exact, found = solve(name, accuracy=1e-10), solve(name, precision="single")
    assert find_error(found, exact) < 1e-4
    assert find_error(found, exact) > 1e-9 or name == "thin"  # it is not doubles that are measured
    made = found.diagnostics
    assert (made["precision"], made["precision_rule"], made["accuracy"]) == ("single", "asked for", 1e-4)
    if name == "thick":
        assert made["orders_repeated"] == {"by": "doubling in doubles", "orders": [0]}
        assert made["orders_by"]["doubling"] > 0


def test_each_precision_is_planned_for_itself(opencl: Any) -> None:
    """Plans are kept from call to call: what is asked for afterwards is not what was asked for before."""
    precisions = "single", "double", "auto", "single"
    scene = vrte.Scene([layer(vrte.rayleigh(), 0.9, 0.5)])  # the very same: plans go by that
    asked = {"nodes": 4, "backend": "opencl", "accuracy": 1e-4}
    made = [vrte.brdf(scene, 0.5, 0.5, precision=one, **asked).diagnostics["precision"] for one in precisions]
    assert made == ["single", "double", "double", "single"]


@pytest.mark.parametrize("name", ["gold, semi-infinite", "over a base"])
def test_a_device_without_doubles(opencl: Any, name: str, without_doubles: None) -> None:
    """As far from doubles as floats are; but for single scattering, by the processor, as a device with doubles is in
    floats."""
    with pytest.warns(
        vrte.AccuracyWarning, match="has no doubles: single precision, for an accuracy of 0.0001 in place"
    ):
        found = solve(name)
    made = found.diagnostics
    assert (made["precision"], made["precision_rule"], made["accuracy"]) == (
        "single",
        "the device has no doubles",
        1e-4,
    )
    device.forget()
    assert 1e-8 < find_error(found, solve(name, accuracy=1e-10)) < 1e-5
    assert find_error(found, solve(name, accuracy=1e-4, precision="single")) < 1e-14


def test_what_is_refused_in_single_precision(opencl: Any, without_doubles: None) -> None:
    with pytest.raises(vrte.DeviceError, match=r"has no doubles.* accuracy of 0.0001, not 1e-08: ask for accuracy"):
        solve("thin", accuracy=1e-8)
    with pytest.raises(vrte.DeviceError, match=r"has no doubles, which precision 'double' needs"):
        solve("thin", precision="double")
    with pytest.raises(vrte.AccuracyError, match="there are no doubles to solve it in"):
        solve("thick", precision="single")
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), layer(vrte.rayleigh(), 0.9, 1.0)])
    with pytest.raises(vrte.SceneError, match="precision 'single' is not for scenes that refract"):
        vrte.brdf(scene, 0.5, 0.5, nodes=4, backend="opencl", precision="single")


def test_sweeps_on_a_device(opencl: Any) -> None:
    """By an argument, or by the file."""
    content = {"nodes": 4, "layer": [{"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0}]}
    content |= {"brdf": {"mu_i": 0.5, "mu_o": 1.0}, "axes": {"layer[1].thickness": [0.1, 1.0]}}
    single = vrte.sweep(content, engine="opencl", precision="single").mueller.values
    assert (vrte.sweep({**content, "precision": "single"}, engine="opencl").mueller.values == single).all()
    double = vrte.sweep(content, engine="opencl").mueller.values
    assert 1e-12 < np.abs(single - double).max() / double.max() < 1e-4
    with pytest.raises(vrte.SceneError, match="precision goes with engine 'opencl' only"):
        vrte.sweep(content, precision="single")
