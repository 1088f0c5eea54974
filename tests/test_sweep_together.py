"""Small scenes of a sweep that are alike, solved together: each as by itself, whatever goes wrong beside it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vrte
from tests.test_sweep import StoppedError, stop_after
from tests.test_sweep_engines import SAME, gap
from vrte.calls import alike
from vrte.formats import phases
from vrte.optics import phase_matrix as optics
from vrte.request.request import make_brdf_request
from vrte.sweep import chunks
from vrte.sweep.run import SweepWarning

MU, PHI = [0.2, 0.6, 1.0], [0.0, 70.0, 180.0]
AXES = {
    "depth": {"key": "layer[2].thickness", "values": [0.4, 1.0, np.inf, 2.0]},
    "layer[1].albedo": [0.0, 0.7, 1.0],
    "base.albedo": [0.0, 0.4],
}


def piles(**more: Any) -> dict[str, Any]:
    """Two layers over a floor; what lies below one without end is not seen, and it is solved by itself."""
    layers = [
        {"phase": "rayleigh", "albedo": 0.9, "thickness": 1.0},
        {"phase": "isotropic", "albedo": 0.8, "thickness": 0.8},
    ]
    floor = {"kind": "lambertian", "albedo": 0.2}
    asked = {"mu_i": MU, "mu_o": MU, "phi_deg": PHI}
    return {"nodes": 6, "truncation": "none", "layer": layers, "base": floor, "brdf": asked, "axes": AXES} | more


@pytest.fixture
def batches(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many scenes were solved together, batch by batch."""
    told: list[int] = []
    solve = alike.solve_batch

    def noted(*given: Any) -> Any:
        found = solve(*given)
        told.append(len(found))
        return found

    monkeypatch.setattr(alike, "solve_batch", noted)
    return told


def test_each_is_as_by_itself(batches: list[int]) -> None:
    finite = {**AXES, "depth": {"key": "layer[2].thickness", "values": [0.4, 1.0, 2.0]}}
    given = piles(axes=finite)
    alone = vrte.sweep(given, workers=1, chunk=1)
    assert not batches
    together = vrte.sweep(given, workers=1, chunk=7)
    assert sum(batches) == 18
    assert vrte.sweep(given, workers=2, chunk=18).equals(together)
    assert together.equals(alone)
    axes = [together[name] for name in together.error.dims]
    for place in np.ndindex(3, 3, 2):
        depth, albedo, floor = (axis.values[k] for axis, k in zip(axes, place, strict=True))
        layers = [vrte.Layer(vrte.rayleigh(), float(albedo), 1.0), vrte.Layer(vrte.isotropic(), 0.8, float(depth))]
        scene = vrte.Scene(layers, vrte.Lambertian(float(floor)))
        one = vrte.brdf(scene, MU, MU, PHI, nodes=6, truncation="none")
        for name in ("mueller", "reflectance", "direct_transmittance"):
            np.testing.assert_array_equal(together[name].values[place], getattr(one, name))


def test_axes_may_change_what_is_asked(batches: list[int]) -> None:
    given = piles(axes={"nodes": [5, 6], "accuracy": [1e-8, 1e-6], "layer[1].albedo": [0.3, 0.6, 0.9]})
    together = vrte.sweep(given, workers=1, chunk=12)
    assert batches == [3, 3, 3, 3]
    assert together.equals(vrte.sweep(given, workers=1, chunk=1))


def test_one_that_fails_spoils_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    given = piles(axes={"layer[1].thickness": [0.4, 0.7, 1.0, 1.5], "layer[1].albedo": [0.5, 0.9]})
    expected = vrte.sweep(given, workers=1, chunk=1)
    solve_batch, solve_request = alike.solve_batch, chunks.solve_request

    def stumble(requests: Any, likeness: Any, places: Any, run: Any) -> Any:
        if any(requests[place].scene.layers[0].thickness == 0.7 for place in places):
            raise vrte.AccuracyError("not with these")
        return solve_batch(requests, likeness, places, run)

    def refuse(request: Any, run: Any) -> Any:
        if request.scene.layers[0].thickness == 0.7:
            raise vrte.AccuracyError("not this one")
        return solve_request(request, run)

    monkeypatch.setattr(alike, "solve_batch", stumble)
    monkeypatch.setattr(chunks, "solve_request", refuse)
    with pytest.warns(SweepWarning, match="2 of 8 scenes failed; the first said: AccuracyError: not this one"):
        table = vrte.sweep(given, workers=1, chunk=8)
    assert (table.error.values[1] == "AccuracyError: not this one").all()
    rest = {"layer[1].thickness": [0, 2, 3]}
    assert table.isel(rest).equals(expected.isel(rest))


def test_a_bad_point_is_named_and_the_others_go_together(batches: list[int]) -> None:
    given = piles(axes={"layer[1].albedo": [0.5, 0.9], "layer[2].thickness": [0.5, 1.0, np.inf]})
    given["brdf"] = given["brdf"] | {"transmission": True}
    with pytest.warns(SweepWarning, match="2 of 6 scenes failed; the first said: brdf.transmission needs a finite"):
        table = vrte.sweep(given, workers=1, chunk=6)
    assert batches == [4]
    assert all("layer without end" in error for error in table.error.values[:, 2])
    assert not table.error.values[:, :2].any()


def test_phase_matrices_are_made_once_for_each_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float] = []
    rayleigh = optics.rayleigh
    monkeypatch.setattr(optics, "rayleigh", lambda given: made.append(given) or rayleigh(given))
    phases.make_by_name.cache_clear()
    layers = [{"phase": {"rayleigh": 0.03}, "albedo": 0.9, "thickness": 1.0} for _ in range(2)]
    table = vrte.sweep(piles(layer=layers, axes={"layer[1].thickness": [0.5, 1.0, 2.0]}), workers=1)
    assert made == [0.03, 0.03]
    matrices = [vrte.rayleigh(0.03) for _ in range(2)]
    for place, depth in enumerate([0.5, 1.0, 2.0]):
        scene = [vrte.Layer(one, 0.9, thickness) for one, thickness in zip(matrices, (depth, 1.0), strict=True)]
        alone = vrte.brdf(vrte.Scene(scene, vrte.Lambertian(0.2)), MU, MU, PHI, nodes=6)
        np.testing.assert_array_equal(table.mueller.values[place], alone.mueller)


def test_stopped_it_goes_on_to_the_same_bits(tmp_path: Path, batches: list[int]) -> None:
    given, output = piles(), tmp_path / "table.zarr"
    with pytest.raises(StoppedError):
        vrte.sweep(given, output, workers=1, chunk=6, progress=stop_after(12))
    done = sum(batches)
    vrte.sweep(given, output, workers=2, chunk=6).close()
    assert 0 < done < sum(batches)
    with vrte.sweep(given, output) as table:
        assert table.load().equals(vrte.sweep(given, workers=1, chunk=1))


def test_the_flag_stops_a_batch() -> None:
    stop = np.zeros(1, np.int32)
    solve = chunks.make_processor_solver(lambda: 1, stop)
    first = make_brdf_request(
        vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.5, 1.0)]), MU[:2], MU, PHI, nodes=6, algorithm="direct"
    )
    other = alike.make_alike_request(first, vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 1.0)]))
    assert other is not None
    assert len(chunks.solve_alike_questions([first, other], stop)) == 2
    stop[0] = 1
    with pytest.raises(KeyboardInterrupt):
        solve([first, other])


@pytest.mark.slow
def test_a_device_finds_the_same(batches: list[int]) -> None:
    given = piles()
    together, there = (vrte.sweep(given, workers=1, chunk=24, engine=engine) for engine in ("threads", "opencl"))
    assert sum(batches) >= 12
    scenes = {"scene": list(together.error.dims)}
    assert gap(*(each.stack(scenes).transpose("scene", ...) for each in (together, there))) < SAME
