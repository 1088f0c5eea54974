"""Scenes of the GPU paper, and the LAPACK floor that speeds are compared with."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

import vrte
from bench import cases
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.discretise import discretise_scene
from vrte.discrete_ordinates.orders.phase_assembly import assemble

from .peers import Row

ROUNDS = 9
PEER_ROWS = pytest.StashKey[list[Row]]()


@pytest.fixture(scope="session")
def gold() -> vrte.Scene:
    """Table 3 of the paper: gold, 400 nm, radius 0.6 um, thickness 100."""
    return cases.find_scene("gold")


@pytest.fixture(scope="session")
def spheroids() -> vrte.Scene:
    """Table 2 of the paper: the benchmark of Wauben and Hovenier, as in Siewert (2000)."""
    return cases.find_scene("spheroids")


def eigenproblems(scene: vrte.Scene, nodes: int, orders: int) -> list[np.ndarray]:
    """The matrices FE of the first `orders` orders."""
    one = np.ones(1)
    problem = discretise_scene(scene, one, np.eye(4), one, np.zeros(1), nodes)
    matrices = assemble(problem, np.arange(orders, dtype=np.int32), Run(1))
    return [matrices.F[m, 0].T @ matrices.E[m, 0].T for m in range(orders)]


def floor_seconds(matrices: list[np.ndarray]) -> float:
    """scipy.linalg.eig with right vectors on every matrix, one BLAS thread."""
    with threadpool_limits(1, user_api="blas"):
        start = time.perf_counter()
        for matrix in matrices:
            scipy.linalg.eig(matrix)
        return time.perf_counter() - start


@pytest.fixture
def against_floor(benchmark: Any) -> Callable[..., float]:
    """Times a call, interleaved with its LAPACK floor or another call, and returns the ratio of the medians."""

    def measure(call: Callable[[], Any], floor: list[np.ndarray] | Callable[[], Any]) -> float:
        floors: list[float] = []

        def time_floor() -> None:
            start = time.perf_counter()
            if isinstance(floor, list):
                floors.append(floor_seconds(floor))
            else:
                floor()
                floors.append(time.perf_counter() - start)

        result = benchmark.pedantic(call, setup=time_floor, rounds=ROUNDS, warmup_rounds=1)
        ratio = float(benchmark.stats.stats.median / np.median(floors))
        made = getattr(result, "diagnostics", {"orders": 0, "stages": {}})
        benchmark.extra_info["floor_seconds"] = float(np.median(floors))
        benchmark.extra_info["ratio_to_floor"] = ratio
        benchmark.extra_info["least_ratio_to_floor"] = float(benchmark.stats.stats.min / min(floors))
        benchmark.extra_info["orders"] = made["orders"]
        benchmark.extra_info["stage_seconds"] = {name: clock["wall_seconds"] for name, clock in made["stages"].items()}
        median, least = 1e3 * benchmark.stats.stats.median, 1e3 * float(np.median(floors))
        print(f"\n{benchmark.name}: {median:.1f} ms, {ratio:.2f} x the floor of {least:.1f} ms")
        return ratio

    return measure


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """The comparison with the peers as one table, whether its tests passed or not."""
    from .peers_page import table
    from .study import describe_load

    if rows := config.stash.get(PEER_ROWS, []):
        terminalreporter.section("vrte beside its peers")
        terminalreporter.write_line(f"{table(rows)}load (1, 5, 15 minutes) {describe_load()}")
