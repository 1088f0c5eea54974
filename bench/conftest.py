"""Scenes of the GPU paper, and the LAPACK floor that speeds are compared with."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

import vrte
from vrte.discrete_ordinates.phase_assembly import assemble
from vrte.discrete_ordinates.problem import Run
from vrte.discrete_ordinates.solver import discretise

ROUNDS = 5

# Siewert, JQSRT 64, 227 (2000), problem IIA: a1, a2, a3, a4, b1, b2 of the twelve degrees
SIEWERT_IIA = np.array(
    [
        [1.0, 0.0, 0.0, 0.915207, 0.0, 0.0],
        [2.104031, 0.0, 0.0, 2.095727, 0.0, 0.0],
        [2.095158, 3.726079, 3.615946, 2.008624, 0.116688, 0.065456],
        [1.414939, 2.202868, 2.240516, 1.436545, 0.20937, 0.221658],
        [0.703593, 1.190694, 1.139473, 0.706244, 0.227137, 0.097752],
        [0.235001, 0.391203, 0.365605, 0.238475, 0.144524, 0.052458],
        [0.064039, 0.105556, 0.082779, 0.056448, 0.05264, 0.009239],
        [0.012837, 0.020484, 0.013649, 0.009703, 0.0124, 0.001411],
        [0.00201, 0.003097, 0.001721, 0.001267, 0.002093, 0.000133],
        [0.000246, 0.000366, 0.000172, 0.00013, 0.000267, 1.1e-05],
        [2.4e-05, 3.5e-05, 1.4e-05, 1.1e-05, 2.7e-05, 1e-06],
        [2e-06, 3e-06, 1e-06, 1e-06, 2e-06, 0.0],
    ]
)


@pytest.fixture(scope="session")
def gold() -> vrte.Scene:
    """Table 3 of the paper: gold, 400 nm, radius 0.6 um, thickness 100."""
    return vrte.Scene([vrte.Layer.of(vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4), thickness=100.0)])


@pytest.fixture(scope="session")
def spheroids() -> vrte.Scene:
    """Table 2 of the paper: the benchmark of Wauben and Hovenier, as in Siewert (2000)."""
    return vrte.Scene([vrte.Layer(vrte.PhaseMatrix(*SIEWERT_IIA.T), 0.973527, 1.0)])


def eigenproblems(scene: vrte.Scene, nodes: int, orders: int) -> list[np.ndarray]:
    """The matrices FE of the first `orders` orders."""
    one = np.ones(1)
    problem = discretise(scene, one, np.eye(4), one, np.zeros(1), nodes)
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
    """Times a call, interleaved with its LAPACK floor, and returns the ratio of the medians."""

    def measure(call: Callable[[], Any], matrices: list[np.ndarray]) -> float:
        floors: list[float] = []
        result = benchmark.pedantic(
            call, setup=lambda: floors.append(floor_seconds(matrices)), rounds=ROUNDS, warmup_rounds=1
        )
        ratio = float(benchmark.stats.stats.median / np.median(floors))
        stages = result.diagnostics["stages"]
        benchmark.extra_info["floor_seconds"] = float(np.median(floors))
        benchmark.extra_info["ratio_to_floor"] = ratio
        benchmark.extra_info["orders"] = result.diagnostics["orders"]
        benchmark.extra_info["stage_seconds"] = {name: clock["wall_seconds"] for name, clock in stages.items()}
        median, floor = 1e3 * benchmark.stats.stats.median, 1e3 * float(np.median(floors))
        print(f"\n{benchmark.name}: {median:.1f} ms, {ratio:.2f} x the LAPACK floor of {floor:.1f} ms")
        return ratio

    return measure
