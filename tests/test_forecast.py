"""Long solves: told before they start, refused beyond a limit, and predicted about right."""

import math
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import vrte
from vrte import forecast
from vrte.cli import main
from vrte.methods import method_of
from vrte.methods.costs import COSTS, operations_before
from vrte.plan_call import request_of
from vrte.running import new_run

POLARIZING = vrte.mix([(vrte.rayleigh(), 0.5), (vrte.henyey_greenstein(0.7, 40), 0.5)])
THICK = vrte.Scene([vrte.Layer(POLARIZING, 1.0, 100.0)])
LONG = {
    "discrete-ordinates": {"nodes": 1024},
    "adding-doubling": {"nodes": 256},
    "matrix-operator": {"nodes": 256},
    "invariant-imbedding": {"nodes": 32},
    "successive-orders": {"nodes": 32, "settings": {"orders": 100_000}},
}


@pytest.mark.parametrize("method", LONG)
def test_what_takes_too_long_is_refused_at_once(method: str) -> None:
    begin = time.perf_counter()
    told = (
        r"^this will take about \d.*most of it for .*fewer nodes.*, or go on with time_limit_s above its 5 s \(math.inf"
    )
    with pytest.raises(vrte.SceneError, match=told):
        vrte.brdf(THICK, 0.5, 0.5, method=method, time_limit_s=5.0, **LONG[method])
    assert time.perf_counter() - begin < 5.0
    with pytest.raises(vrte.SceneError, match="this will take about"):
        vrte.radiance(THICK, 0.5, mu=0.5, method=method, time_limit_s=5.0, **LONG[method])


def test_accuracy_that_takes_all_nodes_is_refused_at_once() -> None:
    with pytest.raises(vrte.SceneError, match="this will take about"):
        vrte.radiance(THICK, 0.5, mu=[0.001, -0.001], tau=[0.0, 50.0, 100.0], accuracy=1e-15, time_limit_s=0.5)


def test_what_takes_long_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecast, "LONG", 0.0)
    scene = vrte.Scene([vrte.Layer(POLARIZING, 0.9, 1.0)])
    for method in ("discrete-ordinates", *COSTS):
        with pytest.warns(vrte.LongSolveWarning, match=r"this will take about \d s, most of it for"):
            found = vrte.brdf(scene, 0.5, 0.5, nodes=4, method=method, time_limit_s=math.inf)
        assert np.isfinite(found.mueller).all()
    with pytest.raises(vrte.SceneError, match="time_limit_s must be seconds"):
        vrte.brdf(scene, 0.5, 0.5, nodes=4, time_limit_s=-1.0)


def test_the_command_line_says_so_and_has_a_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, out = tmp_path / "scene.toml", str(tmp_path / "out.csv")
    scene.write_text(
        'nodes = 512\n[[layer]]\nphase = "rayleigh"\nalbedo = 1\nthickness = 0.5\n[brdf]\nmu_i = 0.5\nmu_o = 0.5\n'
    )
    assert main(["brdf", str(scene), "-o", out, "--time-limit-s", "1"]) == 2
    assert "this will take about" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["brdf", str(scene), "-o", out, "--time-limit-s", "never"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "albedo", "thickness", "how"),
    [
        ("adding-doubling", 0.99, 10.0, {"nodes": 40}),
        ("matrix-operator", 0.99, 10.0, {"nodes": 40}),
        ("invariant-imbedding", 0.99, 10.0, {"nodes": 16}),
        ("successive-orders", 0.99, 10.0, {"nodes": 16}),
    ],
)
def test_predictions_are_about_right(method: str, albedo: float, thickness: float, how: dict[str, int]) -> None:
    """To a factor of 3 on the machine that the rates are of; here with room for others and for work beside."""
    scene = vrte.Scene([vrte.Layer(POLARIZING, albedo, thickness)])
    asked = ([0.3, 0.8], [0.2, 0.5, 0.9], [0.0, 90.0, 180.0])
    request, _ = request_of("brdf", scene, asked, {"method": method, **how})
    predicted = operations_before(request, method_of(method).checked(request), new_run(1)) / forecast.RATE[method]
    begin = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vrte.LongSolveWarning)
        vrte.brdf(scene, *asked, method=method, threads=1, **how)
    assert 0.1 < (time.perf_counter() - begin) / predicted < 10.0


def test_small_angles_of_many_terms_fit_into_memory() -> None:
    """112 GB of spherical functions were asked for at 100 000 terms, for a flux that is a sum of them."""
    phase = vrte.henyey_greenstein(0.99, 10_000)
    scene = vrte.Scene([vrte.Layer(phase, 1.0, 5.0)])
    field = vrte.radiance(scene, 1.0, mu=-1.0, tau=2.0, method="small-angle")
    assert field.flux_up[0] == 0.0
    # nothing turns back, and what goes down at mu = 1 keeps E_1 = exp(-(1 - g) tau) of its flux
    assert field.flux_down[0] + field.direct[0] == pytest.approx(math.exp(-0.01 * 2.0), abs=3e-3)


def test_particles_of_many_terms_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrte.optics.spheres.LONG", 0.0)
    with pytest.warns(vrte.LongSolveWarning, match="most of it for a phase matrix of .* smaller particles"):
        vrte.spheres(1.5, radius_um=1.0, wavelength_um=0.5)
