"""The paper's scenes against the LAPACK floor: two threads, accuracy 1e-8, from PhaseMatrix to result."""

import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

import vrte
from bench.tables import FULL_SIZE
from bench.workers import PEAK

from .conftest import eigenproblems

Measure = Callable[..., float]
DIRECTIONS = np.linspace(0.05, 1.0, 20)
GOLD = """
import numpy as np, vrte
from bench import cases

scene = cases.find_scene("gold")
"""


def run_alone(code: str) -> str:
    """What code about gold prints, in a process of its own."""
    return subprocess.run([sys.executable, "-c", PEAK + GOLD + code], capture_output=True, check=True, text=True).stdout


def test_table_3_radiance(gold: vrte.Scene, against_floor: Measure) -> None:
    """(a) 11 x 19 directions at tau 0, 40 nodes; the target is 0.35 x the floor."""
    mu, phi = np.linspace(0.05, 1.0, 11), np.arange(0, 181, 10)
    solve = partial(vrte.radiance, gold, 0.6, mu=mu, phi=phi, tau=0.0, nodes=40, threads=2)
    assert against_floor(solve, eigenproblems(gold, 40, 41)) <= 0.35


def test_table_2_siewert(spheroids: vrte.Scene, against_floor: Measure) -> None:
    """(b) the benchmark's seven depths, 20 x 3 directions, 30 nodes; the target is 0.4 x the floor."""
    solve = partial(FULL_SIZE[0].solve, {"threads": 2})
    assert against_floor(solve, eigenproblems(spheroids, 30, 12)) <= 0.4


def test_brdf_20_20_37(gold: vrte.Scene, against_floor: Measure) -> None:
    """(c) the full Mueller BRDF of the same gold layer; the target is 0.5 x the floor."""
    solve = partial(vrte.brdf, gold, DIRECTIONS, DIRECTIONS, np.arange(0, 361, 10), nodes=40, threads=2)
    assert against_floor(solve, eigenproblems(gold, 40, 41)) <= 0.5


@pytest.mark.parametrize("kind", ["radiance", "brdf"])
def test_tiny_call(kind: str) -> None:
    """One Rayleigh layer, 4 nodes, one direction, one thread, the same scene again and scenes never seen. CPU time,
    medians of 200 calls; the target is 0.4 ms."""
    call = getattr(vrte, kind)
    scenes = [vrte.Scene([vrte.Layer(vrte.rayleigh(), 0.9, 0.5 + 1e-4 * index)]) for index in range(250)]

    def measure(asked: list[vrte.Scene]) -> float:
        seconds = []
        for scene in asked:
            start = time.thread_time()
            call(scene, 0.6, **({"mu": 0.5} if kind == "radiance" else {"mu_o": 0.5}), nodes=4, threads=1)
            seconds.append(time.thread_time() - start)
        return 1e3 * float(np.median(seconds[50:]))

    again, new = measure(250 * scenes[:1]), measure(scenes)
    print(f"\na tiny {kind}: {again:.2f} ms of a scene seen before, {new:.2f} ms of another")
    assert again <= 0.4


def test_brdf_peak_memory() -> None:
    """Peak memory of (c) above the process after import: at most 300 MB."""
    code = """
before, mu = peak(), np.linspace(0.05, 1.0, 20)
vrte.brdf(scene, mu, mu, np.arange(0, 361, 10), nodes=40, threads=2)
print(peak() - before)
"""
    megabytes = float(run_alone(code))
    print(f"\npeak memory of the 20 x 20 x 37 BRDF: {megabytes:.0f} MB")
    assert megabytes <= 300.0


TABLE = """
before, mu = peak(), np.linspace(0.05, 1.0, 90)
done = []

def report(steps, all_steps):
    done.append(steps / all_steps)

table = vrte.brdf(scene, mu, mu, np.arange(181.0), nodes=40, threads=2, progress=report)
stages = table.diagnostics["stages"]
print(peak() - before - table.mueller.nbytes / 2**20)
print(stages["fourier sum"]["wall_seconds"], stages["single scattering"]["wall_seconds"])
print(table.diagnostics["wall_seconds"], len(done), done[-1])
"""


def test_table_for_a_renderer() -> None:
    """90 x 90 x 181 directions, all distinct: memory beside the result, seconds from Fourier orders to the table."""
    megabytes, orders, single, wall, calls, fraction = (float(word) for word in run_alone(TABLE).split())
    print(
        f"\n90 x 90 x 181 table: {wall:.2f} s, of which {orders:.2f} s the sum over Fourier orders and {single:.2f} s "
        f"single scattering; peak memory beside the result {megabytes:.0f} MB; {calls:.0f} steps of progress"
    )
    assert orders + single < 3.0
    assert megabytes <= 300.0
    assert fraction == 1.0
    assert calls > 10
