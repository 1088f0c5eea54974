"""The oracle's answers that tests and bench.stability compare with: ``python -m tests.oracle_table [--fresh]``.

stability_oracle.npz has light and fluxes of the cases of bench/stability_cases.py; an hour on two cores. What it holds
already and still fits its scene is kept. It holds the phase matrices that its answers were made from, to the last bit,
and these are what is solved.
"""

import math
import multiprocessing
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

import vrte
from bench import stability, stability_cases
from vrte.formats.atomic import write_atomically

from .oracle import DoubtfulError, Light, solve, split_beam

SAVE_EVERY = 60.0  # seconds
Arrays = dict[str, np.ndarray]


def answer_stability(case: stability_cases.Case) -> Arrays:
    """The case's answers by key; a case without a stable answer has its hash alone."""
    found: Arrays = {f"{case.name}/hash": np.array(case.key)}
    levels = tuple(case.levels)
    try:
        orders = {m: ask(case, case.scene, levels, m) for m in case.orders}
        sizes = [np.abs(light.radiance[..., 0, :] @ case.beam).max(axis=(1, 2)) for light in orders.values()]
        c = {m: find_sensitivity(case, light, m, np.max(sizes, axis=0)) for m, light in orders.items()}
    except DoubtfulError:
        return found
    for m, light in orders.items():
        found[f"{case.name}/{m}/radiance"] = split_beam(light.radiance[:, 0], case.beam)
        found[f"{case.name}/{m}/c"] = np.array(c[m])
    for name in ("flux_up", "flux_down"):
        found[f"{case.name}/{name}"] = split_beam(getattr(orders[0], name), case.beam)[..., 0]
    return found


def ask(case: stability_cases.Case, scene: vrte.Scene, levels: Iterable[tuple[int, float]], m: int) -> Light:
    """The light of one order of a case's scene, or of one that was moved a little."""
    return solve(scene, [case.mu0], case.mu.tolist(), tuple(levels), case.nodes, m)


def find_sensitivity(case: stability_cases.Case, light: Light, m: int, size: np.ndarray) -> float:
    """c: the largest change when albedo, thickness or a coefficient of every layer moves by one unit in the last place.

    Of radiance relative to ``size`` (level,), of fluxes (order 0) relative to the larger one at that depth.
    """
    worst, layers = 0.0, case.scene.layers
    fluxes = [split_beam(flux, case.beam)[..., 0] for flux in (light.flux_up, light.flux_down)]
    for what in ("albedo", "thickness", "coefficients"):
        moved = [move_layer(layer, what) for layer in layers]
        if all(one is other for one, other in zip(moved, layers, strict=True)):
            continue
        levels = ((k, moved[k].thickness if depth == layers[k].thickness else depth) for k, depth in case.levels)
        other = ask(case, vrte.Scene(moved, case.scene.base), levels, m)
        difference = split_beam((other.radiance - light.radiance)[:, 0], case.beam)
        worst = max(worst, find_largest(np.abs(difference).max(axis=(0, 2, 3)), size))
        if m == 0:
            others = [split_beam(flux, case.beam)[..., 0] for flux in (other.flux_up, other.flux_down)]
            change = np.abs(np.subtract(others, fluxes)).max(axis=(0, 1))
            worst = max(worst, find_largest(change, np.abs(fluxes).max(axis=(0, 1))))
    return worst


def find_largest(difference: np.ndarray, size: np.ndarray) -> float:
    """The largest ratio; where there is no light there is no gap."""
    return float((difference / np.maximum(size, 1e-300)).max())


def move_layer(layer: vrte.Layer, what: str) -> vrte.Layer:
    """One unit in the last place off the albedo or the first coefficient beyond a1[0] that is not zero, or onto the
    thickness; the layer itself where there is none."""
    if what == "albedo" and layer.albedo > 0.0:
        return replace(layer, albedo=float(np.nextafter(layer.albedo, 0.0)))
    if what == "thickness" and math.isfinite(layer.thickness):
        return replace(layer, thickness=float(np.nextafter(layer.thickness, np.inf)))
    table = layer.phase_matrix.coefficients.copy()
    degrees = np.flatnonzero(table[1:, 0]) + 1
    if what == "coefficients" and degrees.size:
        table[degrees[0], 0] = np.nextafter(table[degrees[0], 0], 0.0)
        return replace(layer, phase_matrix=vrte.PhaseMatrix(*table.T))
    return layer


def read_table(path: Path) -> Arrays:
    """All of a table; nothing where there is none."""
    if not path.is_file():
        return {}
    with np.load(path) as table:
        return dict(table)


def estimate_effort(case: stability_cases.Case) -> float:
    """Roughly proportional to the time it takes: cheap cases first."""
    kinds = len({(slab.phase, slab.albedo, slab.thickness) for slab in case.slabs})
    return kinds * (case.nodes + 4.0) ** 3


def main(fresh: bool = False, path: Path = stability.TABLE) -> None:
    """Works out what is missing, two cases at a time, and saves the table now and then: all of it or nothing."""
    known, cases = {} if fresh else read_table(path), stability_cases.list_oracle_cases()
    kept = {"phase", *(case.name for case in cases if str(known.get(f"{case.name}/hash")) == case.key)}
    table = {key: values for key, values in known.items() if key.split("/")[0] in kept}
    missing = sorted((case for case in cases if case.name not in kept), key=estimate_effort)
    for case in missing:
        table = stability.store_case(case) | table
    print(f"{path.name}: {len(missing)} cases to do", flush=True)
    saved = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        restored = [stability.restore_case(case, table) for case in missing]
        for done, found in enumerate(pool.imap_unordered(answer_stability, restored), 1):
            table.update(found)
            if time.monotonic() - saved > SAVE_EVERY or done == len(missing):
                with write_atomically(path) as part, part.open("wb") as file:
                    np.savez_compressed(file, **table)
                saved = time.monotonic()
                print(f"{done} of {len(missing)}", flush=True)


if __name__ == "__main__":
    main("--fresh" in sys.argv[1:])
