"""The engines of a sweep: the same numbers from each."""

import http.client
import logging
import types
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import vrte
from vrte.basics.errors import SweepError
from vrte.sweep import chunks, dask_engine

SAME = 1e-12  # of the largest element of a scene


def powder(**more: Any) -> dict[str, Any]:
    """Gold spheres over a floor, thin, thick and without end, on few nodes and on as many as it takes."""
    return {
        "wavelength_um": 0.5,
        "particles": {"gold": {"index": "gold", "radius_um": 0.1}},
        "layer": [{"particles": "gold", "thickness": 1.0}],
        "base": {"kind": "lambertian", "albedo": 0.5},
        "brdf": {"mu_i": [0.4, 1.0], "mu_o": [0.2, 0.5, 0.9], "phi_deg": [0, 70, 180]},
        "axes": {
            "wavelength_um": [0.45, 0.6],
            "depth": {"key": "layer[1].thickness", "values": [0.1, 10, np.inf]},
            "radius": {"key": "particles.gold.radius_um", "values": [0.05, 0.2]},
        },
    } | more


def gap(one: Any, other: Any) -> float:
    """The largest difference of two tables, of the largest element of each scene."""
    assert dict(one.sizes) == dict(other.sizes)
    assert one.error.equals(other.error)
    there = one.error.values == ""
    assert there.any()
    gaps = []
    for name in ("mueller", "reflectance", "direct_transmittance"):
        first, second = one[name].values[there], other[name].values[there]
        size = np.abs(first).reshape(len(first), -1).max(axis=1)
        difference = np.abs(second - first).reshape(len(first), -1).max(axis=1)
        gaps.append((difference / np.maximum(size, 1e-290)).max())
    return float(max(gaps))


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A Dask cluster somewhere else, of two workers with a thread each (here: in this process, to be quick)."""
    from distributed import LocalCluster

    with (
        warnings.catch_warnings(),
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as found,
    ):
        yield found


@pytest.mark.parametrize(
    "nodes", [{"nodes": 6}, pytest.param({}, marks=pytest.mark.slow)], ids=["6 nodes", "nodes by accuracy"]
)
def test_same_numbers_from_each_engine(nodes: dict[str, int], cluster: Any, tmp_path: Path) -> None:
    given = powder(**nodes)
    sequential = vrte.sweep(given, workers=1, chunk=1)
    assert not (sequential.error != "").any()
    assert vrte.sweep(given, workers=2).equals(sequential)
    assert vrte.sweep(given, engine="dask", scheduler=cluster.scheduler_address).equals(sequential)
    assert gap(sequential, vrte.sweep(given, engine="opencl", chunk=4)) < SAME


def test_orders_and_scenes_share_many_cores(tmp_path: Path) -> None:
    given = powder(nodes=6)
    assert gap(vrte.sweep(given, workers=1), vrte.sweep(given, workers=8, chunk=6)) < SAME


def test_on_a_device_a_scene_that_fails_does_not_stop_its_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    given = powder(nodes=4)
    given["axes"]["wavelength_um"] = [0.01, 0.6]  # gold has no data for the first
    with pytest.warns(UserWarning, match="6 of 12 scenes failed"):
        expected = vrte.sweep(given, workers=1)
    batches = []
    solved = chunks.solve_together

    def picky(requests: Any, *rest: Any) -> Any:
        batches.append(len(requests))
        if any(request.scene.thickness == 10.0 for request in requests):
            raise vrte.AccuracyError("not this one")
        return solved(requests, *rest)

    monkeypatch.setattr(chunks, "solve_together", picky)
    with pytest.warns(UserWarning, match="8 of 12 scenes failed"):
        table = vrte.sweep(given, engine="opencl", chunk=12)
    assert batches == [6, 1, 1, 1, 1, 1, 1]
    assert (table.error.values[1, 1] == "AccuracyError: not this one").all()
    both = {"depth": [0, 2]}
    assert gap(expected.isel(both), table.isel(both)) < SAME


def test_an_address_where_nobody_answers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(dask_engine, "PATIENCE", 0.5)
    with pytest.raises(SweepError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        vrte.sweep(powder(nodes=4), tmp_path / "t.zarr", engine="dask", scheduler="tcp://127.0.0.1:9")
    vrte.sweep(powder(nodes=4), tmp_path / "t.zarr").close()  # and the output is nobody's


def test_a_cluster_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr(dask_engine, "PATIENCE", 1.0)
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address=":0", silence_logs=logging.CRITICAL) as empty,
        pytest.raises(SweepError, match="had no worker for 1 seconds"),
    ):
        vrte.sweep(powder(nodes=4), engine="dask", scheduler=empty.scheduler_address)


def test_workers_that_do_not_see_the_output_say_so(tmp_path: Path) -> None:
    with pytest.raises(SweepError, match="the output must lie where all workers can read and write it"):
        dask_engine.perform_there(str(tmp_path / "elsewhere"), "stamp", chunks.Chunk(0))


def listening() -> set[Any]:
    """Addresses where this process and its children wait for connections."""
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    return {each.laddr for process in processes for each in process.net_connections() if each.status == "LISTEN"}


def ask_plainly(place: Any) -> None:
    with closing(http.client.HTTPConnection(*place, timeout=2)) as plain:
        plain.request("GET", "/info/main/workers.html")
        plain.getresponse()


def test_the_cluster_of_a_sweep_is_for_nobody_else(tmp_path: Path) -> None:
    from distributed import Client, Security

    before = listening()  # that of other tests
    with dask_engine.start_own_cluster(types.SimpleNamespace(folder=tmp_path), 1) as client:  # type: ignore[arg-type]
        assert client.submit(abs, -7).result() == 7
        address = client.scheduler.address
        sockets = listening() - before
        assert {place.ip for place in sockets} == {"127.0.0.1"}
        # without encryption, and with a certificate that anybody can make
        for strange, security in ((address.replace("tls:", "tcp:"), Security()), (address, Security.temporary())):
            with pytest.raises(OSError, match=r"reset|Timed out|SSL|certificate"):
                Client(strange, timeout=1.0, security=security)
        for place in sockets:  # and nothing but TLS is spoken
            with pytest.raises((OSError, http.client.HTTPException)):
                ask_plainly(place)
        assert client.submit(abs, -8).result() == 8
