"""Two threads against two processes of one thread each: what the machine can give, and what is taken of it."""

import subprocess
import sys

import numpy as np

PAIRS = 5
WORTH = 0.9

WORKER = """
import sys, time
import numpy as np, vrte

gold = vrte.spheres("gold", radius_um=0.6, wavelength_um=0.4)
scene = vrte.Scene([vrte.Layer.of(gold, thickness=100.0)])
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


class Worker:
    """A process that solves the scene once for each line it is sent, and says how long it took."""

    def __init__(self, threads: int) -> None:
        command = [sys.executable, "-c", WORKER, str(threads), "10"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.answer()

    def start(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def answer(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def seconds(self) -> float:
        self.start()
        return float(self.answer())

    def end(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait(10)
        self.process.stdout.close()


def test_two_threads_scale_like_two_processes() -> None:
    """The 20 x 20 x 37 BRDF of gold: solves a second of two threads, over those of two processes side by side."""
    both, alone, second = Worker(2), Worker(1), Worker(1)
    taken = []
    for _ in range(PAIRS):
        threads = both.seconds()
        alone.start()
        second.start()
        processes = max(float(alone.answer()), float(second.answer())) / 2.0
        taken.append(processes / threads)
    for worker in (both, alone, second):
        worker.end()
    share = float(np.median(taken))
    print(f"\ntwo threads: {share:.2f} of what two processes reach (each pair: {', '.join(f'{x:.2f}' for x in taken)})")
    assert share >= WORTH
