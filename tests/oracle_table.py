"""The oracle's answers that tests and bench.stability compare with: ``python -m tests.oracle_table [--fresh]``.

stability_oracle.npz has light and fluxes of the cases of bench/stability_cases.py, derivative_oracle.npz derivatives of
sixty scenes; an hour or two on two cores. What a table holds already and still fits its scene is kept. Both hold the
phase matrices that their answers were made from, to the last bit, and these are what is solved.
"""

import hashlib
import math
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import vrte
from bench import stability, stability_cases
from bench.cases import Slab, make_scene, restore_slabs, store_phase_matrices
from vrte.formats.atomic import write_atomically

from .oracle import DoubtfulError, Light, brdf, solve, split_beam

DERIVATIVES = Path(__file__).with_name("derivative_oracle.npz")
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


NODES, MU_I, MU_O = 8, (0.1, 0.6), (0.35, 0.9)


@dataclass(frozen=True)
class Case:
    """Slabs over a Lambertian base or none, the numbers that derivatives are with, and the Fourier orders looked at."""

    slabs: tuple[Slab, ...]
    base: float | None
    names: tuple[str, ...]
    orders: tuple[int, ...]

    @property
    def name(self) -> str:
        """What it is, in words."""
        slabs = ", ".join(f"{slab.phase} {slab.albedo:.10g} {slab.thickness:g}" for slab in self.slabs)
        return f"{slabs} over {'nothing' if self.base is None else self.base}"

    @cached_property
    def scene(self) -> vrte.Scene:
        """As a user would write it."""
        return make_scene(self.slabs, self.base)

    @property
    def key(self) -> str:
        """A digest of the words and numbers that define the answers, phase matrices by their names."""
        parts = self.slabs, self.base, self.names, self.orders, MU_I, MU_O, NODES
        return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]

    @property
    def is_transparent(self) -> bool:
        """Whether a BTDF is asked for: nothing lies below, and what is transmitted is no number near zero."""
        return self.base is None and sum(slab.thickness for slab in self.slabs) <= 100.0

    def find_answers(self) -> np.ndarray:
        """(name, order, one or two, in, out, 4, 4) [1/sr] per unit: of the BRDF and, where asked for, the BTDF."""
        found = [brdf(self.scene, MU_I, MU_O, NODES, self.orders, name) for name in self.names]
        both = np.array([[one.reflected, one.transmitted] for one in found])
        return both.swapaxes(1, 2)[:, :, : 1 + self.is_transparent]


THICKNESSES, ALBEDOS = (1e-6, 1e-2, 1.0, 1e2, 1e4, math.inf), (0.5, 0.99, 1.0 - 1e-6, 1.0 - 1e-9, 1.0)
PHASES, BASES = ("rayleigh", "spheroids", "metal-x1", "HG 0.5 12", "glass-x1"), (None, 0.3, 1.0)
DIRECTIONS = (
    *("coefficients[1].a1", "coefficients[2].b1", "coefficients[2].a1", "coefficients[2].b2"),
    *("coefficients[1].a4", "coefficients[2].a2", "coefficients[2].a3"),
)


def list_cases() -> list[Case]:
    """Sixty of the stability grid: every thickness with every albedo, alone and with another layer."""
    cases: list[Case] = []
    for i, thickness in enumerate(THICKNESSES):
        for j, albedo in enumerate(ALBEDOS):
            for pair in (0, 1):
                has_no_end = math.isinf(thickness)
                main, other = (
                    Slab(PHASES[(i + j + 2 * pair) % len(PHASES)], albedo, thickness),
                    Slab("rayleigh", 0.9, 1.0),
                )
                base = None if has_no_end else BASES[(i + 2 * j + pair) % len(BASES)]
                slabs = [(main,), (other, main) if has_no_end else (main, other)][pair]
                at = 1 + slabs.index(main)
                names = [] if has_no_end else [f"layer[{at}].thickness"]
                names += [] if has_no_end and albedo == 1.0 else [f"layer[{at}].albedo"]
                names += [f"layer[{at}].{DIRECTIONS[len(cases) % len(DIRECTIONS)]}"]
                names += [f"layer[{3 - at}].thickness"] if pair and base is None else []
                names += [] if base is None else ["base.albedo"]
                cases.append(Case(slabs, base, tuple(names), (0, 1 + (i + j) % 2)))
    return cases


def restore_cases(table: Arrays) -> list[Case]:
    """The cases with the phase matrices of the table, where it has them."""
    cases = list_cases()
    phases = store_phase_matrices(slab for case in cases for slab in case.slabs) | table
    return [replace(case, slabs=restore_slabs(case.slabs, phases)) for case in cases]


def answer_derivatives(case: Case) -> Arrays:
    return {case.key: case.find_answers()}


def read_table(path: Path) -> Arrays:
    """All of a table; nothing where there is none."""
    if not path.is_file():
        return {}
    with np.load(path) as table:
        return dict(table)


def complete(path: Path, table: Arrays, missing: list[Any], answer: Callable[[Any], Arrays]) -> None:
    """Works out what is missing, two cases at a time, and saves the table now and then: all of it or nothing."""
    print(f"{path.name}: {len(missing)} cases to do", flush=True)
    saved = time.monotonic()
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for done, found in enumerate(pool.imap_unordered(answer, missing), 1):
            table.update(found)
            if time.monotonic() - saved > SAVE_EVERY or done == len(missing):
                with write_atomically(path) as part, part.open("wb") as file:
                    np.savez_compressed(file, **table)
                saved = time.monotonic()
                print(f"{done} of {len(missing)}", flush=True)


def estimate_effort(case: stability_cases.Case) -> float:
    """Roughly proportional to the time it takes: cheap cases first."""
    kinds = len({(slab.phase, slab.albedo, slab.thickness) for slab in case.slabs})
    return kinds * (case.nodes + 4.0) ** 3


def main(fresh: bool = False, path: Path = stability.TABLE, path_of_derivatives: Path = DERIVATIVES) -> None:
    """Both tables."""
    known, cases = {} if fresh else read_table(path), stability_cases.list_oracle_cases()
    kept = {"phase", *(case.name for case in cases if str(known.get(f"{case.name}/hash")) == case.key)}
    table = {key: values for key, values in known.items() if key.split("/")[0] in kept}
    missing = sorted((case for case in cases if case.name not in kept), key=estimate_effort)
    for case in missing:
        table = stability.store_case(case) | table
    complete(path, table, [stability.restore_case(case, table) for case in missing], answer_stability)
    known = {} if fresh else read_table(path_of_derivatives)
    derivative_cases = restore_cases(known)
    table = {case.key: known[case.key] for case in derivative_cases if case.key in known}
    todo = [case for case in derivative_cases if case.key not in table]
    table |= store_phase_matrices(slab for case in derivative_cases for slab in case.slabs)
    complete(path_of_derivatives, table, todo, answer_derivatives)


if __name__ == "__main__":
    main("--fresh" in sys.argv[1:])
