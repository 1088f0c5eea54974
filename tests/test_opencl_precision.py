"""Kernels in single precision: what they compute with, and how far their answers are from those in doubles."""

import os
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.cl import device
from vrte.cl.session import OPTIONS_OF, REALS, read_sources

from .samples import spheroids

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
EITHER = re.compile(r"#ifdef SINGLE\n(.*?)#else\n.*?#endif\n", re.DOTALL)


@pytest.fixture
def without_doubles(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The devices that there are, said to have none."""
    hidden = tuple(replace(found, double_precision=False) for found in device.devices())
    state = {"process": os.getpid(), "devices": hidden, "sessions": {}, "complaints": {}}
    with monkeypatch.context() as patched:
        patched.setattr(device, "_state", state)
        yield


class TestSessions:
    def test_nothing_is_double_in_single_precision(self) -> None:
        """As a compiler without doubles sees the sources: literals are floats by an option."""
        assert "-cl-single-precision-constant" in OPTIONS_OF["single"]
        left = EITHER.sub(r"\1", COMMENT.sub("", read_sources("single")))
        assert "#define real float\n" in left
        assert not re.search(r"double|fp64|\blong4\b|#ifdef", left)

    def test_numbers_go_up_as_floats_and_come_down_as_doubles(self, opencl: Any) -> None:
        single = opencl.in_precision("single")
        for values in (np.array([1.0 / 3.0, np.inf, 1e300]), np.full(5000, 1.0 / 3.0)):
            up = single.upload(values)
            assert up.dtype == REALS["single"]
            with np.errstate(over="ignore"):
                expected = values.astype(np.float32)
            assert (single.download(up) == expected).all()
            assert single.download(up).dtype == np.float64
        assert single.download(single.upload(np.arange(3, dtype=np.int32))).dtype == np.int32

    def test_one_session_a_precision_on_the_same_queue(self, opencl: Any) -> None:
        single = opencl.in_precision("single")
        assert single.in_precision("single") is single
        assert opencl.in_precision("single") is single
        assert single.in_precision("double").queue is single.queue
        assert single.lock is opencl.lock
        assert single.constants is not opencl.constants


@pytest.mark.parametrize("precision", ["double", "single"])
def test_products(opencl: Any, precision: str) -> None:
    """A stack of matrices times another, to the rounding of what is computed with."""
    from vrte.cl.matrices import download_stack, make_stack, multiply_stacks, upload_stack

    session = opencl.in_precision(precision)
    a, b = np.random.default_rng(0).normal(size=(2, 3, 20, 20))
    made = make_stack(session, 3, 20, 20)
    items = session.upload(np.arange(3, dtype=np.int32))
    multiply_stacks(session, items, upload_stack(session, a), upload_stack(session, b), made)
    expected = np.swapaxes(np.swapaxes(a, 1, 2) @ np.swapaxes(b, 1, 2), 1, 2)
    gap = np.abs(download_stack(session, made) - expected).max() / np.abs(expected).max()
    assert gap < 20 * np.finfo(REALS[precision]).eps
    assert precision == "double" or gap > np.finfo(np.float64).eps * 1e4


MU, GRAZING = np.array([0.05, 0.3, 0.7, 1.0]), np.array([1e-3, 0.02, 0.3, 1.0])
layer = vrte.Layer


def gold() -> vrte.Particles:
    """Spheres that absorb, b2 and all."""
    return vrte.spheres("gold", radius_um=0.3, wavelength_um=0.64)


# name: layers, base, nodes, cosines
SCENES: dict[str, tuple[Any, vrte.Scene | None, int, Any]] = {
    "gold, endless": (lambda: [layer.of(gold(), thickness=np.inf)], None, 24, MU),
    "gold, tau 5": (lambda: [layer.of(gold(), thickness=5.0)], None, 16, MU),
    "Siewert": (lambda: [layer(spheroids(), 0.973527, 1.0)], None, 12, MU),
    "Rayleigh": (lambda: [layer(vrte.rayleigh(), 1.0, 0.5)], None, 8, MU),
    "peaked": (lambda: [layer(vrte.henyey_greenstein(0.85), 0.99, 4.0)], None, 16, MU),
    "two layers over Lambertian": (
        lambda: [layer(spheroids(), 0.9, 0.3), layer(vrte.rayleigh(), 0.6, 2.0)],
        vrte.Lambertian(0.5),
        10,
        MU,
    ),
    "albedo 1, tau 100": (lambda: [layer(spheroids(), 1.0, 100.0)], None, 10, MU),
    "albedo 1, tau 1e4": (lambda: [layer(vrte.rayleigh(), 1.0, 1e4)], None, 8, MU),
    "albedo 1, endless": (lambda: [layer(spheroids(), 1.0, np.inf)], None, 10, MU),
    "thick and dark": (lambda: [layer(spheroids(), 0.5, 30.0)], None, 10, MU),
    "thin": (lambda: [layer(vrte.rayleigh(), 1.0, 1e-6)], None, 8, MU),
    "grazing": (lambda: [layer(spheroids(), 0.97, 2.0)], None, 10, GRAZING),
}


def solve(name: str, **how: Any) -> vrte.Brdf:
    """The BRDF of one of the scenes, and its transmission where it has a bottom."""
    layers, base, nodes, mu = SCENES[name]
    scene = vrte.Scene(layers(), base) if base else vrte.Scene(layers())
    asked = {"nodes": nodes, "backend": "opencl", "transmission": bool(np.isfinite(scene.thickness))}
    return vrte.brdf(scene, mu, mu, [0.0, 40.0, 180.0], **asked, **how)


def find_error(found: vrte.Brdf, expected: vrte.Brdf) -> float:
    """The largest of reflection, transmission and fluxes, relative to the largest I of each."""
    pairs = [(found.mueller, expected.mueller)]
    if found.transmission is not None:
        pairs.append((found.transmission, expected.transmission))
    gaps = [np.abs(one - other).max() / np.abs(other[..., 0, 0]).max() for one, other in pairs]
    return float(max(*gaps, np.abs(found.reflectance - expected.reflectance).max()))


class TestSingle:
    @pytest.mark.parametrize("name", SCENES)
    def test_it_keeps_its_promise(self, opencl: Any, name: str) -> None:
        """1e-4 of the largest I, against doubles at an accuracy of 1e-10."""
        exact, found = solve(name, accuracy=1e-10), solve(name, precision="single")
        assert find_error(found, exact) < 1e-4
        made = found.diagnostics
        assert (made["precision"], made["precision_rule"], made["accuracy"]) == ("single", "asked for", 1e-4)

    def test_it_is_not_doubles_that_are_measured(self, opencl: Any) -> None:
        assert find_error(solve("Rayleigh", precision="single"), solve("Rayleigh", accuracy=1e-4)) > 1e-9

    def test_each_precision_is_planned_for_itself(self, opencl: Any) -> None:
        """Plans are kept from call to call: what is asked for afterwards is not what was asked for before."""
        precisions = "single", "double", "mixed", "single"
        scene = vrte.Scene([layer(vrte.rayleigh(), 0.9, 0.5)])  # the very same: plans go by that
        asked = {"nodes": 4, "backend": "opencl", "accuracy": 1e-4}
        made = [vrte.brdf(scene, 0.5, 0.5, precision=one, **asked).diagnostics["precision"] for one in precisions]
        assert tuple(made) == precisions

    def test_what_is_in_doubt_is_solved_in_doubles(self, opencl: Any) -> None:
        """Where nothing absorbs, light that gets through 1e4 has lost its digits in floats."""
        made = solve("albedo 1, tau 1e4", precision="single").diagnostics
        assert made["orders_repeated"] == {"by": "doubling in doubles", "orders": [0]}
        assert made["orders_by"]["doubling"] > 0

    @pytest.mark.parametrize("name", ["gold, endless", "two layers over Lambertian"])
    def test_a_device_without_doubles(self, opencl: Any, name: str, without_doubles: None) -> None:
        """As far from doubles as floats are, 2.7e-7 and 1.8e-6, and what a device with doubles finds in floats but for
        single scattering, which comes from the processor; the rule says why it is in floats."""
        found = solve(name, accuracy=1e-4)
        assert found.diagnostics["precision"] == "single"
        assert found.diagnostics["precision_rule"] == "the device has no doubles"
        device.forget()
        assert 1e-8 < find_error(found, solve(name, accuracy=1e-10)) < 1e-5
        assert find_error(found, solve(name, accuracy=1e-4, precision="single")) < 1e-14

    def test_what_such_a_device_cannot_do(self, opencl: Any, without_doubles: None) -> None:
        with pytest.raises(vrte.DeviceError, match=r"has no doubles.* accuracy of 0.0001, not 1e-08: ask for accuracy"):
            solve("thin")
        with pytest.raises(vrte.DeviceError, match=r"has no doubles, which precision 'double' needs"):
            solve("thin", precision="double")
        with pytest.raises(vrte.AccuracyError, match="there are no doubles to solve it in"):
            solve("albedo 1, tau 1e4", precision="single")

    def test_scenes_together_are_as_alone(self, opencl: Any) -> None:
        scenes = [vrte.Scene([layer(spheroids(), albedo, 1.0)]) for albedo in (0.5, 0.9)]
        asked = {"nodes": 8, "backend": "opencl", "precision": "single"}
        together = vrte.brdfs(scenes, MU, MU, 0.0, **asked)
        for scene, found in zip(scenes, together, strict=True):
            assert (found.mueller == vrte.brdf(scene, MU, MU, 0.0, **asked).mueller).all()

    def test_surfaces_are_joined_in_doubles(self, opencl: Any) -> None:
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
