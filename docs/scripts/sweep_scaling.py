"""What a sweep takes of two cores, and what a table of a million scenes costs: `python -m docs.scripts.sweep_scaling`.

The same 200 scenes, in turns: by two independent processes with one thread and half of them each, by two threads, and
by two Dask worker processes. A sweep's share is its scenes a second over those of the two processes. Prints the figures
of docs/how_to/sweeps.md.
"""

import json
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bench.workers import Worker
from vrte.basics.cost import format_duration

ROUNDS = 5
WAVELENGTHS = [0.45, 0.48, 0.51, 0.54, 0.57, 0.6, 0.63, 0.66]
DEPTHS = 25
SCENES = len(WAVELENGTHS) * DEPTHS
WORTH = 0.85
MILLION = 1_000_000
CORES = 8  # of a machine of the worked-out table
MACHINES = (1, 100, 1000)

WORKER = """
import json, shutil, sys, time
import vrte

print("ready", flush=True)
for line in sys.stdin:
    job = json.loads(line)
    shutil.rmtree(job["output"], ignore_errors=True)
    start = time.perf_counter()
    vrte.sweep(job["sweep"], job["output"], **job["how"]).close()
    print(json.dumps(time.perf_counter() - start), flush=True)
"""


def sweep_of(wavelengths: list[float], depths: int = DEPTHS) -> dict[str, Any]:
    """A powder of rutile on many wavelengths and thicknesses: a BRDF of 10 x 10 x 37 directions each."""
    cosines = {"start": 0.1, "stop": 1.0, "count": 10}
    return {
        "wavelength_um": 0.55,
        "nodes": 20,
        "particles": {"rutile": {"index": [2.7, 1e-4], "radius_um": 0.12}},
        "layer": [{"particles": "rutile", "thickness": 1.0}],
        "brdf": {"mu_i": cosines, "mu_o": cosines, "phi_deg": {"start": 0, "stop": 360, "count": 37}},
        "axes": {
            "wavelength_um": wavelengths,
            "depth": {"key": "layer[1].thickness", "start": 0.1, "stop": 100.0, "count": depths, "spacing": "log"},
        },
    }


def job(wavelengths: list[float], output: Path, **how: Any) -> str:
    """A sweep, as a worker is told."""
    return json.dumps({"sweep": sweep_of(wavelengths), "output": str(output), "how": how})


@contextmanager
def processes(count: int) -> Iterator[list[Worker]]:
    found = [Worker(WORKER) for _ in range(count)]
    try:
        yield found
    finally:
        for process in found:
            process.end()


@contextmanager
def dask_cluster() -> Iterator[str]:
    """The address of a scheduler with two worker processes of one thread; starting it takes seconds, once."""
    import logging

    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=None, silence_logs=logging.CRITICAL
    ) as cluster:
        yield cluster.scheduler_address


def measure(rounds: int = ROUNDS) -> dict[str, list[float]]:
    """Seconds of 200 scenes, round after round, by each way; the first round warms up and is left out."""
    with tempfile.TemporaryDirectory() as name, dask_cluster() as scheduler, processes(3) as (both, one, other):
        folder = Path(name)
        half = len(WAVELENGTHS) // 2
        taken: dict[str, list[float]] = {"one thread": [], "two processes": [], "threads": [], "dask": []}
        for _ in range(rounds + 1):
            both.begin(job(WAVELENGTHS, folder / "a.zarr", workers=1))
            taken["one thread"].append(both.seconds())
            one.begin(job(WAVELENGTHS[:half], folder / "b.zarr", workers=1))
            other.begin(job(WAVELENGTHS[half:], folder / "c.zarr", workers=1))
            taken["two processes"].append(max(one.seconds(), other.seconds()))
            both.begin(job(WAVELENGTHS, folder / "a.zarr", workers=2))
            taken["threads"].append(both.seconds())
            both.begin(job(WAVELENGTHS, folder / "a.zarr", engine="dask", scheduler=scheduler))
            taken["dask"].append(both.seconds())
        bytes_of_a_scene = sum(file.stat().st_size for file in (folder / "a.zarr").rglob("*")) / SCENES
    found = {way: seconds[1:] for way, seconds in taken.items()}
    return found | {"bytes": [bytes_of_a_scene]}


def shares(taken: dict[str, list[float]]) -> dict[str, float]:
    """Of what two processes reach, round by round: the median."""
    return {
        way: statistics.median(two / seconds for two, seconds in zip(taken["two processes"], taken[way], strict=True))
        for way in ("threads", "dask")
    }


def report(taken: dict[str, list[float]]) -> str:
    """The two tables of docs/how_to/sweeps.md."""
    share = shares(taken)
    alone = statistics.median(taken["one thread"])
    lines = ["| 200 scenes | s | scenes a second | times one thread | of two processes |", "|---|---|---|---|---|"]
    for way in ("one thread", "two processes", "threads", "dask"):
        seconds = statistics.median(taken[way])
        of_two = f"{share[way]:.2f}" if way in share else ""
        lines.append(f"| {way} | {seconds:.2f} | {SCENES / seconds:.1f} | {alone / seconds:.2f} | {of_two} |")
    cost, size = alone / SCENES, taken["bytes"][0]
    scaling = statistics.median(one / two for one, two in zip(taken["one thread"], taken["dask"], strict=True)) / 2.0
    lines += ["", f"One scene: {1e3 * cost:.1f} ms of one core, {size / 1e3:.0f} kB on disk.", ""]
    lines += ["| machines | cores | time | written a second | table |", "|---|---|---|---|---|"]
    for machines in MACHINES:
        seconds = MILLION * cost / (machines * CORES * scaling)
        rate, total = MILLION * size / seconds, MILLION * size
        took = format_duration(seconds)
        lines.append(f"| {machines} | {machines * CORES} | {took} | {rate / 1e6:,.1f} MB | {total / 1e9:,.0f} GB |")
    return "\n".join(lines)


def main() -> None:
    start = time.monotonic()
    taken = measure(int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS)
    print(report(taken))
    print(f"\nmeasured in {time.monotonic() - start:.0f} s on {len(os.sched_getaffinity(0))} cores")


if __name__ == "__main__":
    main()
