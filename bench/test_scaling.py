"""Two threads against two processes of one thread each: what the machine can give, and what is taken of it."""

import numpy as np

from bench.workers import Worker
from docs.scripts import sweep_scaling

PAIRS = 5
WORTH = 0.95

WORKER = """
import sys, time
import numpy as np, vrte

from bench import cases

scene = cases.find_scene("gold")
mu, phi, threads, calls = np.linspace(0.05, 1.0, 20), np.arange(0, 361, 10), int(sys.argv[1]), int(sys.argv[2])

def solve():
    for _ in range(calls):
        vrte.brdf(scene, mu, mu, phi, nodes=40, threads=threads)

solve()
print("ready", flush=True)
for _ in sys.stdin:
    start = time.perf_counter()
    solve()
    print(time.perf_counter() - start, flush=True)
"""


def test_two_threads_scale_like_two_processes() -> None:
    """The 20 x 20 x 37 BRDF of gold: solves a second of two threads, over those of two processes side by side."""
    both, alone, second = (Worker(WORKER, threads, "10") for threads in "211")
    taken = []
    for _ in range(PAIRS):
        both.begin()
        threads = both.seconds()
        alone.begin()
        second.begin()
        processes = max(alone.seconds(), second.seconds()) / 2.0
        taken.append(processes / threads)
    for worker in (both, alone, second):
        worker.end()
    fraction = float(np.median(taken))
    print(
        f"\ntwo threads: {fraction:.2f} of what two processes reach (each pair: {', '.join(f'{x:.2f}' for x in taken)})"
    )
    assert fraction >= WORTH


def test_a_sweep_scales_like_independent_processes() -> None:
    """Two threads, and two Dask workers, against two independent processes of one thread: 200 scenes of a sweep."""
    taken = sweep_scaling.measure()
    print(f"\n{sweep_scaling.report(taken)}")
    found = sweep_scaling.shares(taken)
    assert min(found["threads"], found["dask"]) >= sweep_scaling.WORTH
