"""The OpenCL device beside OpenMP on two threads: every stage, and the whole BRDF, in turns."""

from typing import Any

import numpy as np
import pytest

import vrte

DIRECTIONS, AZIMUTHS = np.linspace(0.05, 1.0, 20), np.arange(0, 361, 10)
ROUNDS = 9
STAGE, WHOLE = 1.5, 3.0  # times what OpenMP takes, on a CPU device
FEWEST = 2e-3  # seconds of a stage that a ratio says something of


def diagnostics(scene: vrte.Scene, backend: str, algorithm: str) -> dict[str, Any]:
    """Of one BRDF."""
    threads = 2 if backend == "openmp" else None
    made = vrte.brdf(
        scene, DIRECTIONS, DIRECTIONS, AZIMUTHS, nodes=40, threads=threads, backend=backend, algorithm=algorithm
    )
    return made.diagnostics


def compared(scene: vrte.Scene, backend: str, algorithm: str, names: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    """Median seconds of each stage, and in all, by OpenMP and by the other."""
    rounds = []
    for turn in range(ROUNDS + 1):
        pair = [diagnostics(scene, name, algorithm) for name in ("openmp", backend)]
        if turn > 0:
            rounds.append(pair)
    found = {}
    for name in names:
        times = [[made["stages"][name]["wall_seconds"] for made in pair] for pair in rounds]
        found[name] = tuple(np.median(times, axis=0).tolist())
    found["in all"] = tuple(np.median([[made["wall_seconds"] for made in pair] for pair in rounds], axis=0).tolist())
    for name, (openmp, other) in found.items():
        print(f"\n{backend}, {algorithm}: {name} {1e3 * other:.1f} ms, {other / openmp:.2f} x OpenMP's", end="")
    print()
    return found


@pytest.mark.parametrize(
    ("backend", "algorithm", "thickness", "names"),
    [
        ("opencl", "doubling", 5.0, ("assembly", "doubling", "joining", "fourier sum", "single scattering")),
        ("opencl", "invariance", np.inf, ("invariance", "fourier sum", "single scattering")),
        ("opencl+lapack", "modes", 5.0, ("assembly", "reconstruction", "fourier sum", "single scattering")),
    ],
)
def test_stages(gold: vrte.Scene, backend: str, algorithm: str, thickness: float, names: tuple[str, ...]) -> None:
    """On a CPU device within 1.5 x of OpenMP; stages of less than 2 ms there are printed alone."""
    layer = gold.layers[0]
    scene = vrte.Scene([vrte.Layer(layer.phase_matrix, layer.albedo, thickness)])
    found = compared(scene, backend, algorithm, names)
    slow = {
        name: other / openmp for name, (openmp, other) in found.items() if openmp > FEWEST and other > STAGE * openmp
    }
    assert not slow


def test_whole_brdf(gold: vrte.Scene) -> None:
    """The paper's layer, by whichever algorithm each takes: on a CPU device within 3 x of OpenMP."""
    openmp, opencl = compared(gold, "opencl", "auto", ())["in all"]
    assert opencl <= WHOLE * openmp


def test_many_wavelengths() -> None:
    """Sixteen wavelengths in one call beside sixteen calls."""
    scenes = [
        vrte.Scene([vrte.Layer.of(vrte.spheres("gold", radius_um=0.3, wavelength_um=w), thickness=100.0)])
        for w in np.linspace(0.4, 0.7, 16)
    ]
    seconds: dict[str, list[float]] = {"together": [], "alone": []}
    from time import perf_counter

    for _ in range(4):
        start = perf_counter()
        vrte.brdfs(scenes, DIRECTIONS, DIRECTIONS, AZIMUTHS, nodes=40, backend="opencl")
        seconds["together"].append(perf_counter() - start)
        start = perf_counter()
        for scene in scenes:
            vrte.brdf(scene, DIRECTIONS, DIRECTIONS, AZIMUTHS, nodes=40, backend="opencl")
        seconds["alone"].append(perf_counter() - start)
    together, alone = (float(np.median(seconds[name][1:])) for name in ("together", "alone"))
    print(f"\n16 gold BRDFs on the device: {16 / together:.1f} a second together, {16 / alone:.1f} a second one by one")
    assert together <= 1.1 * alone
