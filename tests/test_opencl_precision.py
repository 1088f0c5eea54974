"""Kernels in single precision, and semi-infinite layers in floats with corrections: how far from doubles they are, and
what becomes of what fails its checks."""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from vrte.cl import device, invariance, mixed
from vrte.cl import precision as rules
from vrte.cl.matrices import download_stack, make_stack, multiply_stacks, upload_stack
from vrte.cl.session import OPTIONS_OF, REALS, read_sources
from vrte.discrete_ordinates.orders.discretise import discretise_scene

from . import opencl_scenes
from .samples import spheroids

COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
EITHER = re.compile(r"#ifdef SINGLE\n(.*?)#else\n.*?#endif\n", re.DOTALL)
MU = np.array([0.05, 0.3, 1.0])
TIGHT = 1e-15
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
    assert not re.search(r"double|fp64|\blong4\b|#ifdef", left)


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
        made, items = make_stack(session, 3, 20, 20), session.upload(np.arange(3, dtype=np.int32))
        multiply_stacks(session, items, upload_stack(session, a), upload_stack(session, b), made)
        difference = np.abs(download_stack(session, made) - expected).max() / np.abs(expected).max()
        assert difference < 20 * np.finfo(REALS[precision]).eps
        assert precision == "double" or difference > np.finfo(np.float64).eps * 1e4


GOLD = vrte.spheres("gold", radius_um=0.2, wavelength_um=0.64)
SCENES = {name: scene for name, scene in opencl_scenes.SCENES.items() if name != "three kinds"} | {
    "gold, semi-infinite": vrte.Scene([layer.of(GOLD, thickness=np.inf)]),
    "gold, thickness 2": vrte.Scene([layer.of(GOLD, thickness=2.0)]),
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
    precisions = "single", "double", "mixed", "single"
    scene = vrte.Scene([layer(vrte.rayleigh(), 0.9, 0.5)])  # the very same: plans go by that
    asked = {"nodes": 4, "backend": "opencl", "accuracy": 1e-4}
    made = [vrte.brdf(scene, 0.5, 0.5, precision=one, **asked).diagnostics["precision"] for one in precisions]
    assert tuple(made) == precisions


@pytest.mark.parametrize("name", ["gold, semi-infinite", "over a base"])
def test_a_device_without_doubles(opencl: Any, name: str, without_doubles: None) -> None:
    """As far from doubles as floats are; but for single scattering, by the processor, as a device with doubles is in
    floats."""
    found = solve(name, accuracy=1e-4)
    assert found.diagnostics["precision"] == "single"
    assert found.diagnostics["precision_rule"] == "the device has no doubles"
    device.forget()
    assert 1e-8 < find_error(found, solve(name, accuracy=1e-10)) < 1e-5
    assert find_error(found, solve(name, accuracy=1e-4, precision="single")) < 1e-14


def test_what_is_refused_in_single_precision(opencl: Any, without_doubles: None) -> None:
    with pytest.raises(vrte.DeviceError, match=r"has no doubles.* accuracy of 0.0001, not 1e-08: ask for accuracy"):
        solve("thin")
    with pytest.raises(vrte.DeviceError, match=r"has no doubles, which precision 'double' needs"):
        solve("thin", precision="double")
    with pytest.raises(vrte.AccuracyError, match="there are no doubles to solve it in"):
        solve("thick", precision="single")
    scene = vrte.Scene([vrte.Interface(1.0, 1.5), layer(vrte.rayleigh(), 0.9, 1.0)])
    with pytest.raises(vrte.SceneError, match="precision 'single' is not for scenes that refract"):
        vrte.brdf(scene, 0.5, 0.5, nodes=4, backend="opencl", precision="single")


def test_scenes_together_are_as_alone(opencl: Any) -> None:
    scenes = [vrte.Scene([layer(spheroids(), albedo, 1.0)]) for albedo in (0.5, 0.9)]
    asked = {"nodes": 8, "backend": "opencl", "precision": "single"}
    together = vrte.brdfs(scenes, MU, MU, 0.0, **asked)
    for scene, found in zip(scenes, together, strict=True):
        assert (found.mueller == vrte.brdf(scene, MU, MU, 0.0, **asked).mueller).all()


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


def ask(
    albedos: Sequence[float], orders: Sequence[int], tolerance: float, nodes: int = 6, scalar: bool = False
) -> list[Any]:
    """What `reflect_semi_infinite` takes behind its session: every order of a layer of each albedo."""
    phase = vrte.henyey_greenstein(0.5) if scalar else spheroids()
    mu = np.array([0.08, 0.5, 1.0])
    problem = discretise_scene(vrte.Scene([vrte.Layer(phase, 0.5, np.inf)]), mu, np.eye(4), mu, np.zeros(1), nodes)
    off, indices = np.unique(np.concatenate([problem.mu_out, problem.mu0]), return_inverse=True)
    order = np.tile(np.array(orders, np.int32), len(albedos))
    material = np.repeat(np.arange(len(albedos), dtype=np.int32), len(orders))
    count = problem.mu_out.size
    return [
        np.arange(order.size, dtype=np.int32),
        order,
        material,
        tuple(problem.stokes),
        np.repeat(problem.coefficients[:1], len(albedos), axis=0),
        np.repeat(problem.terms[:1].astype(np.int32), len(albedos)),
        np.array(albedos),
        np.concatenate([problem.nodes, off]),
        problem.weights,
        indices[:count].astype(np.int32),
        indices[count:].astype(np.int32),
        problem.columns,
        np.full(order.size, tolerance),
    ]


def in_doubles(session: Any, asked: Sequence[Any], tolerance: float = TIGHT) -> invariance.SemiInfinite:
    """The same in doubles, to another tolerance."""
    return invariance.reflect_semi_infinite(
        session, *mixed.upload_all(session, [*asked[:-1], np.full(asked[1].size, tolerance)])
    )


def find_gaps(session: Any, found: Any, expected: Any) -> np.ndarray:
    """The largest difference of each item, relative to its largest element."""
    one, other = (session.download(each).reshape(each.shape[0], -1) for each in (found, expected))
    differences: np.ndarray = np.abs(one - other).max(axis=1) / np.abs(other).max(axis=1)
    return differences


@pytest.mark.parametrize("scalar", [False, True])
@pytest.mark.parametrize("tolerance", [5e-9, 1e-13])
def test_as_exact_as_in_doubles(either_form: Any, tolerance: float, scalar: bool) -> None:
    """The residual is that of doubles, and it keeps its word."""
    asked = ask([0.6, 0.97], [0, 1, 3], tolerance, scalar=scalar)
    found, doubted = mixed.reflect_semi_infinite_mixed(either_form, asked)
    exact, residual = in_doubles(either_form, asked), either_form.download(found.residual)
    assert not doubted.size
    assert (residual <= tolerance).all()
    for name in ("up", "on_nodes"):
        assert (find_gaps(either_form, getattr(found, name), getattr(exact, name)) < 3 * tolerance).all()


def test_floats_alone_are_not_enough(opencl: Any) -> None:
    """So that it is the corrections that are measured above."""
    asked = ask([0.9], [0, 1], 5e-9)
    single = opencl.in_precision("single")
    rough = invariance.reflect_semi_infinite(single, *mixed.upload_all(single, asked))
    differences = find_gaps(opencl, rough.up, in_doubles(opencl, asked).up)
    assert (differences > 1e-8).any()
    assert (differences < 1e-4).all()


def test_an_item_does_not_depend_on_the_others(either_form: Any) -> None:
    asked = ask([0.6, 0.97], [0, 2], 1e-9)
    whole = either_form.download(mixed.reflect_semi_infinite_mixed(either_form, asked)[0].up)
    for item in range(4):
        alone = [np.array([item], np.int32), *asked[1:]]
        found = either_form.download(mixed.reflect_semi_infinite_mixed(either_form, alone)[0].up)
        assert (found[item] == whole[item]).all()


def test_what_does_not_converge_is_solved_in_doubles(opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of the items here: the others keep what floats and corrections found."""
    asked = ask([0.6, 0.97], [0, 1], 5e-9)
    usual = opencl.download(mixed.reflect_semi_infinite_mixed(opencl, asked)[0].up)
    whole = mixed.Mixing.correct

    def spoil(self: Any, rows: Any, r: Any, d: Any, *rest: Any) -> None:
        whole(self, rows, r, d, *rest)
        values = opencl.download(d)
        values[2] = np.nan
        self.low.put(values, d)

    monkeypatch.setattr(mixed.Mixing, "correct", spoil)
    found, doubted = mixed.reflect_semi_infinite_mixed(opencl, asked)
    assert doubted.tolist() == [2]
    double = in_doubles(opencl, asked, 5e-9)
    for name in ("up", "on_nodes", "residual", "steps"):
        here, there = (opencl.download(getattr(one, name)) for one in (found, double))
        assert (here[2] == there[2]).all()
    assert (opencl.download(found.up)[[0, 1, 3]] == usual[[0, 1, 3]]).all()


def test_a_brdf_in_mixed_precision(opencl: Any) -> None:
    """To the accuracy asked for; what has a bottom is solved in doubles, to the same bits."""
    exact, found = (solve("gold, semi-infinite", **how) for how in ({"accuracy": 1e-12}, {"precision": "mixed"}))
    assert np.abs(found.mueller - exact.mueller).max() < 1e-8 * exact.mueller[..., 0, 0].max()
    made = found.diagnostics
    assert (made["precision"], made["precision_rule"], made["orders_doubted"]) == ("mixed", "asked for", 0)
    assert made["residual_of_invariance"] < 1e-8
    pair = [solve("gold, thickness 2", precision=one).mueller for one in ("mixed", "double")]
    assert (pair[0] == pair[1]).all()


CARD = device.Device("Maker", "Card", "gpu", True, 1 << 33, 1 << 31, 40, "1")


def test_which_precision_the_rule_takes(opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Doubles are timed: on a processor one takes twice the room of a float, and no more than that."""
    with monkeypatch.context() as patch:
        for ratio, precision in ((2.0, "double"), (32.0, "mixed")):
            patch.setattr(rules, "measure_ratio", lambda session, ratio=ratio: ratio)
            rule = f"doubles take {ratio:.2g} times as long as floats here"
            assert rules.choose_precision("auto", 1e-8, CARD, lambda: None) == (precision, rule)
    processor = rules.choose_precision("auto", 1e-3, replace(CARD, kind="cpu"))
    assert processor == ("double", "a processor's doubles are quick")
    with pytest.raises(vrte.DeviceError, match="Card has no doubles, which precision 'mixed' needs"):
        rules.choose_precision("mixed", 1e-8, replace(CARD, double_precision=False))
    monkeypatch.setattr(rules, "TIMED", (1 << 11, 64))
    ratios = []
    for _ in range(3):  # others may be at work in one of them
        monkeypatch.setattr(opencl, "constants", {})
        ratios.append(rules.measure_ratio(opencl))
    assert any(0.5 < ratio < rules.SLOW for ratio in ratios) or not opencl.on_host
