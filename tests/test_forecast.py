"""Long solves: told before they start, refused beyond a limit, and predicted about right."""

import math
import re
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import find_scene
from vrte.basics import cost
from vrte.basics.running import start_run
from vrte.calls import plan
from vrte.calls.plan import make_request
from vrte.calls.plan import predict_seconds as predict_call
from vrte.methods import find_method, make_run, predict_seconds
from vrte.request.how import METHODS
from vrte.request.request import Request

from .helpers import close_to

POLARIZING = vrte.mix([(vrte.rayleigh(), 0.5), (vrte.henyey_greenstein(0.7, 40), 0.5)])
THICK = vrte.Scene([vrte.Layer(POLARIZING, 1.0, 100.0)])
LONG: dict[str, dict[str, Any]] = {
    "discrete-ordinates": {"nodes": 1024},
    "adding-doubling": {"nodes": 256},
    "matrix-operator": {"nodes": 256},
    "invariant-imbedding": {"nodes": 32},
    "successive-orders": {"nodes": 32, "settings": {"orders": 100_000}},
}


PEAKED = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.999), 0.9, 2.0)], vrte.Lambertian(0.3))
MANY = np.random.default_rng(0).uniform(0.1, 1.0, (2, 20_000))
AROUND = np.arange(180.0)
LIMITED: dict[str, Callable[[], object]] = {  # calls whose limit is below what they take
    **{method: partial(vrte.brdf, THICK, 0.5, 0.5, method=method, time_limit_s=5.0, **LONG[method]) for method in LONG},
    **{
        f"{method}, field": partial(vrte.radiance, THICK, 0.5, mu=0.5, method=method, time_limit_s=5.0, **LONG[method])
        for method in LONG
    },
    "all nodes": lambda: vrte.radiance(
        THICK, 0.5, mu=[0.001, -0.001], tau=[0.0, 50.0, 100.0], accuracy=1e-15, time_limit_s=0.5
    ),
    "linearize": lambda: vrte.linearize(THICK, 0.5, 0.5, nodes=1024, time_limit_s=5.0),
    "plan": lambda: vrte.plan("brdf", PEAKED, 0.5, 0.5, nodes=4096, time_limit_s=5.0),
    "solve_base": lambda: vrte.solve_base(PEAKED, accuracy=1e-3, nodes=8, time_limit_s=1.0),
    "views": lambda: vrte.views(PEAKED, *MANY, nodes=8, time_limit_s=1.0),
    "closed form": lambda: vrte.brdf(PEAKED, MANY[0, :99], MANY[1, :99], AROUND, nodes=8, time_limit_s=9.0),
    "rough": lambda: vrte.brdf(
        vrte.Scene([vrte.Interface(1, 1.33, 0.2), *THICK.layers]), 0.5, 0.5, nodes=256, time_limit_s=5.0
    ),
}


@pytest.mark.parametrize("kind", LIMITED)
def test_every_call_has_the_limit(kind: str) -> None:
    begin = time.process_time()
    words = r"^this will take about \d.*most of it for .*" if kind in LONG else "this will take about .*"
    with pytest.raises(
        vrte.SceneError, match=words + r"fewer.*, or go on with time_limit_s above its \S+ s \(math.inf"
    ):
        LIMITED[kind]()
    assert time.process_time() - begin < 5.0


def test_derivatives_have_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    found = vrte.linearize(vrte.Scene([vrte.Layer(POLARIZING, 0.9, 1.0)]), 0.5, 0.5, nodes=8, time_limit_s=5.0)
    monkeypatch.setitem(cost.RATE, "discrete-ordinates", 1e6)
    with pytest.raises(vrte.SceneError, match="for 1 derivative beside the light"):
        found.jvp("layer[1].albedo")
    with pytest.raises(vrte.SceneError, match="for the derivatives with everything"):
        found.vjp(np.ones((1, 1, 1, 4, 4)))
    monkeypatch.undo()
    monkeypatch.setattr("vrte.basics.memory.find_available_bytes", lambda: 1e6)
    monkeypatch.setattr("vrte.basics.memory.ALWAYS_THERE", 0.0)
    monkeypatch.setattr("vrte.calls.derivatives.count_bytes_of_derivatives", lambda plan: 1e7)
    with pytest.raises(vrte.SceneError, match=r"derivatives need about .* of memory and .* are available"):
        found.jvp("layer[1].albedo")


ROUGH = vrte.Scene([vrte.Interface(1, 1.33, 0.2), vrte.Layer(POLARIZING, 0.9, 2.0)], vrte.Lambertian(0.3))


@pytest.mark.parametrize(
    ("scene", "nodes", "azimuths"), [(PEAKED, 8, 60), (ROUGH, 16, 19)], ids=["closed form", "rough"]
)
def test_what_orders_are_the_least_of_is_predicted(scene: vrte.Scene, nodes: int, azimuths: int) -> None:
    """Light scattered once, 1e-4 of what it took as predicted once, and what is between interfaces, a fiftieth."""
    mu = np.linspace(0.1, 1.0, 12)
    asked = "brdf", scene, mu, mu, np.linspace(0.0, 180.0, azimuths)
    request = make_request(*asked, nodes=nodes, threads=1)
    predicted, _ = predict_call(request)
    begin = time.process_time()
    vrte.brdf(*asked[1:], nodes=nodes, threads=1)
    assert 0.1 < (time.process_time() - begin) / predicted < 10.0


def test_rough_scenes_are_predicted_beside_each_other() -> None:
    """A plate was forecast five times too long beside a surface on top; the machine's speed does not matter."""
    layer, mu = vrte.Layer(vrte.rayleigh(), 0.9, 1.0), np.linspace(0.1, 1.0, 12)
    faces = [vrte.Interface(1.0, 1.5, 0.3), layer, vrte.Interface(1.5, 1.0, 0.3)]
    ratios = []
    for scene, nodes in ((ROUGH, 64), (vrte.Scene(faces), 32)):
        predicted, _ = predict_call(make_request("brdf", scene, mu, mu, nodes=nodes, threads=1))
        begin = time.process_time()
        vrte.brdf(scene, mu, mu, nodes=nodes, threads=1)
        ratios.append(predicted / (time.process_time() - begin))
    assert 0.4 < ratios[1] / ratios[0] < 2.5


def test_searches_for_nodes_are_predicted_beside_given_nodes() -> None:
    """Two to four counts are solved: a search was forecast at 0.1 to 0.6 of its time under rough surfaces."""
    layer, mu = vrte.Layer(vrte.rayleigh(), 0.9, 1.0), np.linspace(0.1, 1.0, 12)
    plate = vrte.Scene([vrte.Interface(1.0, 1.5, 0.3), layer, vrte.Interface(1.5, 1.0, 0.3)])
    bare = vrte.Scene([vrte.Layer(POLARIZING, 0.99, 5.0)], vrte.Lambertian(0.5))
    ratios = []
    for scene, how in ((ROUGH, {"nodes": 48}), (plate, {"accuracy": 1e-3}), (bare, {"accuracy": 1e-5})):
        predicted, _ = predict_call(make_request("brdf", scene, mu, mu, threads=1, **how))
        begin = time.process_time()
        vrte.brdf(scene, mu, mu, threads=1, **how)
        ratios.append(predicted / (time.process_time() - begin))
    assert all(0.4 < ratio / ratios[0] < 2.5 for ratio in ratios), ratios


def test_flakes_and_facets_are_not_brief() -> None:
    """Four nodes in a few milliseconds, were it not for the lobes: those get threads, and Ctrl-C reaches them."""
    flakes = vrte.Layer.of(vrte.flakes("aluminium", tilt_deg=20.0, wavelength_um=0.55), flake_area=3.0)
    faces = [vrte.Interface(1.0, 1.5, roughness) for roughness in (0.0, 0.3)]
    for top, is_brief in (
        (vrte.Layer(vrte.rayleigh(), 0.9, 1.0), True),
        (flakes, False),
        (faces[0], True),
        (faces[1], False),
    ):
        layers = [top] if isinstance(top, vrte.Layer) else [top, vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]
        request = make_request("brdf", vrte.Scene(layers), 0.5, 0.5, nodes=4, threads=2)
        assert make_run(request).brief is is_brief


def test_derivatives_by_invariance_are_predicted() -> None:
    """Beside the light they were forecast three times too long, by what the algebra of slabs takes."""
    scene, mu, phi = find_scene("gold"), np.linspace(0.1, 1.0, 10), [0.0, 90.0]
    how: dict[str, Any] = {"nodes": 32, "accuracy": 1e-6, "threads": 1}
    names = ["layer[1].thickness", "layer[1].albedo", "layer[1].coefficients[1].a1"]
    seconds: list[float] = []
    for derivatives in (None, names):
        rounds: list[float] = []
        for _ in range(3):
            begin = time.process_time()
            vrte.brdf(scene, mu, mu, phi, derivatives=derivatives, **how)
            rounds.append(time.process_time() - begin)
        seconds.append(min(rounds))
    predicted = vrte.plan("brdf", scene, mu, mu, phi, derivatives=names, **how).as_dict()["solves_of_derivatives"]
    assert 0.4 < predicted / (seconds[1] / seconds[0] - 1.0) < 2.5


def test_what_takes_long_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "LONG", 0.0)
    scene = vrte.Scene([vrte.Layer(POLARIZING, 0.9, 1.0)])
    for method in ("discrete-ordinates", *(name for name in METHODS if find_method(name).operations)):
        nodes = {"nodes": 4} if method != "monte-carlo" else {}
        with pytest.warns(vrte.LongSolveWarning, match=r"this will take about \d s, most of it for"):
            found = vrte.brdf(scene, 0.5, 0.5, **nodes, method=method, time_limit_s=math.inf)
        assert np.isfinite(found.mueller).all()
    with pytest.raises(vrte.SceneError, match="time_limit_s must be seconds"):
        vrte.brdf(scene, 0.5, 0.5, nodes=4, time_limit_s=-1.0)


SCENES = {
    "nodes": 4,
    "layer": [{"phase": "rayleigh", "albedo": 1.0, "thickness": 1.0}],
    "brdf": {"mu_i": 0.5, "mu_o": 0.5},
}
AXES = {"depth": {"key": "layer[1].thickness", "values": np.linspace(0.1, 2.0, 40).tolist()}}


def told_of(call: Callable[[], object]) -> list[str]:
    """What is said of long times."""
    with warnings.catch_warnings(record=True) as reported:
        warnings.simplefilter("always")
        call()
    return [str(each.message) for each in reported if each.category is vrte.LongSolveWarning]


@pytest.mark.parametrize("kind", ["brdfs", "spectrum", "sweep"])
def test_many_solves_say_together_what_they_take(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cost, "LONG", 1e-9)
    calls: dict[str, tuple[str, Callable[[], object]]] = {
        "brdfs": ("5 scenes", lambda: vrte.brdfs([THICK] * 5, 0.5, 0.5, nodes=4)),
        "spectrum": ("3 wavelengths", lambda: vrte.spectrum(SCENES, [0.4, 0.5, 0.6])),
        "sweep": ("40 scenes on 2 workers", lambda: vrte.sweep({**SCENES, "axes": AXES}, workers=2)),
    }
    what, call = calls[kind]
    (reported,) = told_of(call)
    assert re.match(rf"this will take about \d+ s for {what} together; fewer", reported)


def test_brief_solves_are_not_planned_to_be_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of them took twice the time of two calls; what is not brief together is planned."""
    planned: list[Request] = []
    make = plan.plan_request
    monkeypatch.setattr(plan, "plan_request", lambda request, run: planned.append(request) or make(request, run))
    vrte.brdfs([THICK] * 2, 0.5, 0.5, nodes=4)
    assert not planned
    vrte.brdfs([THICK] * 400, 0.5, 0.5, nodes=4)
    assert planned


def test_many_solves_that_take_too_long_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand solves of a second: no one of them is long."""
    monkeypatch.setitem(cost.RATE, "discrete-ordinates", 1e4)
    begin = time.process_time()
    for call, what in (
        (lambda: vrte.brdfs([THICK] * 1000, 0.5, 0.5, nodes=16, time_limit_s=1000.0), "1000 scenes"),
        (lambda: vrte.spectrum(SCENES, np.linspace(0.4, 0.7, 1000), nodes=16, time_limit_s=100.0), "1000 wavelengths"),
    ):
        with pytest.raises(vrte.SceneError, match=f"this will take about .* for {what} together.*time_limit_s above"):
            call()
    assert time.process_time() - begin < 4.0


def test_a_sweep_is_refused_where_a_limit_is_given_and_counts_what_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = {**SCENES, "axes": AXES}
    out = tmp_path / "table.zarr"

    def stop(done: int, total: int) -> None:
        if done > 0:
            raise KeyboardInterrupt

    monkeypatch.setattr(cost, "A_CALL", 1000.0)
    with pytest.raises(vrte.SceneError, match=r"about 11.1 h for 40 scenes on 1 worker together.*above its 2.8 h"):
        vrte.sweep(content, out, workers=1, chunk=10, time_limit_s=10_000.0)
    assert not list(tmp_path.glob("*.partial"))
    with pytest.warns(vrte.LongSolveWarning, match="about 11.1 h for 40 scenes"), pytest.raises(KeyboardInterrupt):
        vrte.sweep(content, out, workers=1, chunk=10, progress=stop)
    done: list[int] = []
    with pytest.warns(vrte.LongSolveWarning) as reported:
        table = vrte.sweep(content, out, workers=1, chunk=10, progress=lambda some, total: done.append(some))
    assert 0 < done[0] < 40, "chunks that were at work when it was stopped may have been finished"
    assert f"for {40 - done[0]} scenes on 1 worker together" in str(reported[0].message)
    assert (table["error"] == "").all()
    table.close()


def test_the_plan_of_very_many_nodes_is_told_of_at_once() -> None:
    scene = vrte.Scene([vrte.Layer(vrte.henyey_greenstein(0.9, terms=1950), 1.0, 1.0)])
    begin = time.process_time()
    with pytest.raises(vrte.SceneError, match="the plan alone, of 1950 orders on 1024 nodes"):
        vrte.brdf(scene, 0.5, 0.5, nodes=1024, time_limit_s=5.0)
    with pytest.raises(vrte.SceneError, match="3 scenes together"):
        vrte.brdfs([scene] * 3, 0.5, 0.5, nodes=1024, time_limit_s=5.0)
    assert time.process_time() - begin < 2.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "nodes"),
    [
        ("adding-doubling", 40),
        ("matrix-operator", 40),
        ("invariant-imbedding", 16),
        ("monte-carlo", None),
        ("successive-orders", 16),
    ],
)
def test_predictions_are_about_right(method: str, nodes: int | None) -> None:
    """To a factor of 3 on the machine that the rates are of; here with room for others and for work beside."""
    scene = vrte.Scene([vrte.Layer(POLARIZING, 0.99, 10.0)])
    asked = ([0.3, 0.8], [0.2, 0.5, 0.9], [0.0, 90.0, 180.0])
    request = make_request("brdf", scene, *asked, method=method, nodes=nodes)
    seconds = predict_seconds(request, start_run(1))
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vrte.LongSolveWarning)
        vrte.brdf(scene, *asked, method=method, threads=1, nodes=nodes)
    assert 0.1 < (time.process_time() - begin) / seconds < 10.0


def test_small_angles_of_many_terms_fit_into_memory() -> None:
    """112 GB of spherical functions were asked for at 100 000 terms, for a flux that is a sum of them."""
    phase = vrte.henyey_greenstein(0.99, 10_000)
    scene = vrte.Scene([vrte.Layer(phase, 1.0, 5.0)])
    field = vrte.radiance(scene, 1.0, mu=-1.0, tau=2.0, method="small-angle")
    assert field.flux_up[0] == 0.0
    # nothing turns back, and what goes down at mu = 1 keeps E_1 = exp(-(1 - g) tau) of its flux
    assert field.flux_down[0] + field.direct[0] == close_to(math.exp(-0.01 * 2.0), rtol=0.0, atol=3e-3)


def test_particles_of_many_terms_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrte.basics.cost.LONG", 0.0)
    with pytest.warns(vrte.LongSolveWarning, match="most of it for a phase matrix of .* smaller particles"):
        vrte.spheres(1.5, radius_um=1.0, wavelength_um=0.5)


def test_what_the_first_of_many_loads_is_no_matter_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[float] = []
    monkeypatch.setattr(cost, "LOOKING", 0.02)
    monkeypatch.setattr(cost, "warn_runtime", lambda seconds, *others: reported.append(seconds))
    request = make_request("brdf", vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]), mu_i=0.5, mu_o=0.5, nodes=4)

    def asked_at(place: int) -> tuple[Request, float]:
        return request, 0.5 if place == 0 else 0.0  # 240 times 0.5 s would be 2 minutes

    monkeypatch.setattr(plan, "predict_seconds", lambda asked, count: time.sleep(0.03) or (0.0, 0.0))
    plan.warn_runtime_of_all(240, asked_at, "scenes")
    assert 240 * 0.03 < reported[0] < 240 * 0.2
