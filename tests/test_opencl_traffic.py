"""How often a solve on a device launches kernels and waits for what they found."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import vrte
from bench.cases import find_scene
from vrte.cl.session import Reading, Session, Traffic
from vrte.discrete_ordinates.execution.engines import device_sums
from vrte.discrete_ordinates.execution.engines import opencl as engine


def test_what_goes_to_and_from_a_device_is_counted(opencl: Any) -> None:
    before = Traffic(**vars(opencl.traffic))
    small, large = opencl.upload(np.ones(3)), opencl.upload(np.ones(3000))
    opencl.zeros((5,))
    opencl.launch("invariance_rate", (0,))  # of nothing: not launched
    opencl.download(small)
    opencl.download(large)
    opencl.finish()
    size = np.dtype(opencl.real).itemsize
    found = opencl.traffic.since(before)
    assert found == Traffic(
        launches=0, fills=1, reads=2, waits=2, bytes_up=3003 * size, bytes_down=3003 * size
    )  # a large array is waited for on its way up


def count_traffic(
    session: Any, monkeypatch: pytest.MonkeyPatch, scene: vrte.Scene, algorithm: str, nodes: int, n_mu: int
) -> Traffic:
    """Of one BRDF, as its diagnostics tell it."""
    monkeypatch.setattr(engine, "open_session", lambda precision="double": session.in_precision(precision))
    mu = np.linspace(0.05, 1.0, n_mu)
    made = vrte.brdf(scene, mu, mu, np.arange(0, 361, 10), nodes=nodes, backend="opencl", algorithm=algorithm)
    return Traffic(**made.diagnostics["traffic"])


def test_a_result_tells_what_went_to_and_from_the_device(either_form: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = count_traffic(either_form, monkeypatch, find_scene("gold"), "invariance", 8, 2)
    assert found.launches > 0
    assert found.reads > 0
    assert found.bytes_down >= 8 * 2 * 2 * 37 * 16


def test_sums_of_many_scenes_take_as_many_launches_as_those_of_one(
    either_form: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same Fourier orders; each result is that of its scene alone to the last bit, in chunks as well."""
    monkeypatch.setattr(engine, "open_session", lambda precision="double": either_form.in_precision(precision))
    launched: list[str] = []
    launch = Session.launch

    def noted(session: Session, name: str, *arguments: Any, **named: Any) -> None:
        launched.append(name)
        launch(session, name, *arguments, **named)

    monkeypatch.setattr(Session, "launch", noted)
    mu, phi = np.array([0.3, 0.9]), np.array([0.0, 50.0, 310.0])
    scenes = [vrte.Scene([vrte.Layer(vrte.rayleigh(), albedo, np.inf)]) for albedo in (0.9, 0.5, 0.7)]

    def solve(scenes: list[vrte.Scene]) -> tuple[list[np.ndarray], int]:
        launched.clear()
        found = vrte.brdfs(scenes, mu, mu, phi, nodes=4, backend="opencl", algorithm="invariance")
        return [one.mueller for one in found], sum(
            name.startswith(("add_orders", "add_scattering")) for name in launched
        )

    together, few = solve(scenes)
    alone = [solve([scene]) for scene in scenes]
    assert few == max(launches for _, launches in alone)
    with monkeypatch.context() as patch:
        patch.setattr(device_sums, "TOGETHER", 1.0)
        in_chunks, many = solve(scenes)
    assert many == sum(launches for _, launches in alone)
    for whole, chunk, (one, _) in zip(together, in_chunks, alone, strict=True):
        np.testing.assert_array_equal(whole, one[0])
        np.testing.assert_array_equal(chunk, one[0])


# Gold, 40 nodes, 20 x 20 x 37 directions: launches and reads at most, by form of the kernels
THICK = {"cpu": (100, 25), "gpu": (200, 15)}


@pytest.mark.slow
def test_few_launches_and_reads_of_thick_gold(either_form: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = count_traffic(either_form, monkeypatch, find_scene("gold"), "invariance", 40, 20)
    launches, reads = THICK[either_form.form]
    assert found.launches < launches
    assert found.reads < reads


def test_doubling_reads_twice_a_group(either_form: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Norms, and what it ends with, of each block of Fourier orders; the host does not wait after a step on a GPU."""
    layer = vrte.Layer(vrte.rayleigh(), 0.9, 5.0)
    found = count_traffic(either_form, monkeypatch, vrte.Scene([layer]), "doubling", 4, 2)
    assert found.launches < 120  # 109, of four groups
    assert found.reads <= 9


def test_arrays_are_read_in_one_wait(opencl: Any) -> None:
    before = Traffic(**vars(opencl.traffic))
    halves = Reading([opencl.upload(np.arange(3.0)), opencl.upload(np.arange(5.0))], lambda a, b: a.sum() + b.sum())
    nothing = Reading([opencl.empty((0,))], lambda a: a.size)
    assert opencl.read([halves, nothing, Reading((), lambda: "none")]) == [13.0, 0, "none"]
    assert opencl.traffic.since(before).reads == 1


@pytest.mark.slow
def test_few_reads_of_gold_by_doubling(opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    gold = find_scene("gold")
    scene = replace(gold, layers=[replace(gold.layers[0], thickness=5.0)])
    found = count_traffic(opencl, monkeypatch, scene, "doubling", 40, 20)
    assert found.launches < 180
    assert found.reads < 20


@pytest.mark.slow  # compiles for long
def test_orders_of_all_blocks_go_together_on_a_gpu(opencl: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same numbers as block by block, to the last bit, and no order more."""
    session = opencl.in_form("gpu")
    monkeypatch.setattr(engine, "open_session", lambda precision="double": session.in_precision(precision))
    mu, scene = np.array([0.2, 0.6]), find_scene("gold")

    def solve() -> vrte.Brdf:
        return vrte.brdf(scene, mu, mu, [0.0, 40.0], nodes=8, backend="opencl", algorithm="invariance")

    together = solve()
    monkeypatch.setattr(engine.Device, "looks_ahead", ())
    apart = solve()
    np.testing.assert_array_equal(together.mueller, apart.mueller)
    for name in ("orders", "orders_by", "unknowns", "residual_of_invariance"):
        assert together.diagnostics[name] == apart.diagnostics[name]
    few, many = (Traffic(**made.diagnostics["traffic"]) for made in (together, apart))
    assert few.launches < 0.7 * many.launches
    assert few.reads < min(15, many.reads)
