"""Derivatives nobody can argue with: differences of the oracle's answers, of numbers moved by 2^-66 of themselves.

What the ball arithmetic (tests/ball_oracle.py) finds for a number moved up and down differs in the 20th digit; with 384
bits and more the difference has all digits of a double, and what it leaves out is 1e-40 of it.

``python -m tests.derivative_oracle [--fresh]`` works the table out that tests compare with, derivative_oracle.npz: half
an hour on a core; what it holds already and still fits its scene is kept. It has the phase matrices that its answers
are made from, to the last bit, and these are what is solved.
"""

import hashlib
import math
import multiprocessing
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from flint import arb, ctx

import vrte
from bench.cases import Slab, make_scene, restore_slabs, store_phase_matrices
from vrte.formats.atomic import write_atomically

from .ball_oracle import Directions, DoubtfulError, Layer, Request, exact, find_fields, light_at

TABLE = Path(__file__).with_name("derivative_oracle.npz")
NODES, MU_I, MU_O = 8, (0.1, 0.6), (0.35, 0.9)
COLUMNS = ("a1", "a2", "a3", "a4", "b1", "b2")
STEP, BITS, MOST_BITS = -66, 384, 3072
UNIT = tuple(map(tuple, np.eye(4).tolist()))
NOTHING = 1e-30  # a derivative so small is none
Cosines = tuple[float, ...]


@dataclass(frozen=True)
class Case:
    """Slabs over a Lambertian base or none, the numbers that are moved, and the Fourier orders looked at."""

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

    def ask(self, order: int, mu_i: Cosines = MU_I, mu_o: Cosines = MU_O) -> Request:
        """Light back from the top and, where it gets through, on from the bottom, for beams of all four kinds."""
        layers = tuple(Layer(slab.phase_matrix.coefficients, slab.albedo, slab.thickness) for slab in self.slabs)
        levels: tuple[tuple[int, float], ...] = ((0, 0.0),)
        if self.is_transparent:
            levels += ((len(layers) - 1, layers[-1].thickness),)
        mu = (*mu_o, *(-mu for mu in mu_o)) if self.is_transparent else mu_o
        return Request(order, layers, self.base, mu_i, mu, levels, NODES, UNIT)

    @property
    def is_transparent(self) -> bool:
        """Whether a btdf is asked for: nothing lies below, and what gets through is no number near zero."""
        return self.base is None and sum(slab.thickness for slab in self.slabs) <= 100.0


def move(request: Request, name: str, steps: int) -> tuple[Request, arb]:
    """The request with one number moved by so many steps, and the length of one: names as in ``derivatives=``."""
    where, _, field = name.rpartition(".")
    if name == "base.albedo":
        step = arb(2) ** STEP
        return replace(request, base=exact(request.base) + steps * step), step
    at = int(where.split("[")[1].split("]")[0]) - 1
    layer = request.layers[at]
    if field in COLUMNS:
        degree, column = int(where.split("[")[2].split("]")[0]), COLUMNS.index(field)
        step, coefficients = arb(2) ** STEP, layer.coefficients.astype(object)
        coefficients[degree, column] = exact(coefficients[degree, column]) + steps * step
        moved = replace(layer, coefficients=coefficients)
    else:
        value = getattr(layer, field)
        step = arb(2) ** (STEP + math.frexp(value)[1])
        moved = replace(layer, **{field: exact(value) + steps * step})
    layers = (*request.layers[:at], moved, *request.layers[at + 1 :])
    levels = tuple((k, moved.thickness) if k == at and depth else (k, depth) for k, depth in request.levels)
    return replace(request, layers=layers, levels=levels), step


def differentiate_radiance(request: Request, name: str) -> np.ndarray:
    """The derivative of one Fourier order by one number: (n_column, n_tau, n_mu, 4) as in `Answer`, each right to 1e-16
    of the largest, or to NOTHING. Raises DoubtfulError where no number of bits settles it."""
    bits = BITS
    while bits <= MOST_BITS:
        ctx.prec = bits
        try:
            directions = Directions(request)
            (above, step), (below, _) = (move(request, name, steps) for steps in (1, -1))
            fields = list(zip(find_fields(above, directions), find_fields(below, directions), strict=True))
        except ZeroDivisionError:
            fields = []
        found = [
            [
                [light_at(request, directions, c, u, high[0] - low[0], high[1] - low[1]) for u in request.mu]
                for high, low in fields
            ]
            for c in range(directions.size - directions.field)
        ]
        flat = np.array(found, dtype=object) / (2 * step)
        values, radii = (np.vectorize(lambda ball, of=of: float(of(ball)))(flat) for of in (arb.mid, arb.rad))
        if fields and radii.max() <= 1e-16 * max(np.abs(values).max(), NOTHING):
            return values
        bits *= 2
    raise DoubtfulError(f"no number of bits settles the derivative by {name}")


THICKNESSES, ALBEDOS = (1e-6, 1e-2, 1.0, 1e2, 1e4, math.inf), (0.5, 0.99, 1.0 - 1e-6, 1.0 - 1e-9, 1.0)
PHASES, BASES = ("rayleigh", "spheroids", "metal-x1", "HG 0.5 12", "glass-x1"), (None, 0.3, 1.0)
DIRECTIONS = (
    *("coefficients[1].a1", "coefficients[2].b1", "coefficients[2].a1", "coefficients[2].b2"),
    *("coefficients[1].a4", "coefficients[2].a2", "coefficients[2].a3"),
)


def list_cases() -> list[Case]:
    """Sixty of the stability grid: every thickness with every albedo, alone and with another layer."""
    cases = []
    for i, thickness in enumerate(THICKNESSES):
        for j, albedo in enumerate(ALBEDOS):
            for pair in (0, 1):
                endless = math.isinf(thickness)
                main, other = (
                    Slab(PHASES[(i + j + 2 * pair) % len(PHASES)], albedo, thickness),
                    Slab("rayleigh", 0.9, 1.0),
                )
                base = None if endless else BASES[(i + 2 * j + pair) % len(BASES)]
                slabs = [(main,), (other, main) if endless else (main, other)][pair]
                at = 1 + slabs.index(main)
                names = [] if endless else [f"layer[{at}].thickness"]
                names += [] if endless and albedo == 1.0 else [f"layer[{at}].albedo"]
                names += [f"layer[{at}].{DIRECTIONS[len(cases) % len(DIRECTIONS)]}"]
                names += [f"layer[{3 - at}].thickness"] if pair and base is None else []
                names += [] if base is None else ["base.albedo"]
                cases.append(Case(slabs, base, tuple(names), (0, 1 + (i + j) % 2)))
    return cases


def differentiate_brdf(
    case: Case, name: str, order: int, mu_i: Cosines = MU_I, mu_o: Cosines = MU_O
) -> list[np.ndarray]:
    """f^m and, where it is asked for, the btdf's, by one number: (in, out, 4, 4) [1/sr] per unit of it."""
    radiance = differentiate_radiance(case.ask(order, mu_i, mu_o), name)
    light = radiance.reshape(len(mu_i), 4, *radiance.shape[1:]) / np.reshape(mu_i, (-1, 1, 1, 1, 1))
    light = np.moveaxis(light, 1, -1)  # (in, level, direction, 4, column)
    return [light[:, 0, : len(mu_o)], *([light[:, 1, len(mu_o) :]] if case.is_transparent else [])]


def find_answers(case: Case) -> np.ndarray:
    """All of a case: (name, order, one or two, in, out, 4, 4), reflected and, where asked for, passed on."""
    return np.array([[differentiate_brdf(case, name, order) for order in case.orders] for name in case.names])


def read_table(path: Path = TABLE) -> dict[str, np.ndarray]:
    """The answers by the keys of their cases, and the phase matrices that they are made from."""
    if not path.is_file():
        return {}
    with np.load(path) as table:
        return dict(table)


def restore_cases(table: dict[str, np.ndarray]) -> list[Case]:
    """The cases with the phase matrices of the table, where it has them."""
    cases = list_cases()
    phases = store_phase_matrices(slab for case in cases for slab in case.slabs) | table
    return [replace(case, slabs=restore_slabs(case.slabs, phases)) for case in cases]


def main(fresh: bool = False, path: Path = TABLE) -> None:
    """Works out what is missing."""
    known = {} if fresh else read_table(path)
    cases = restore_cases(known)
    missing = [case for case in cases if case.key not in known]
    table = {case.key: known[case.key] for case in cases if case.key in known}
    table |= store_phase_matrices(slab for case in cases for slab in case.slabs)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for case, found in zip(missing, pool.imap(find_answers, missing), strict=True):
            table[case.key] = found
            with write_atomically(path) as part, part.open("wb") as file:
                np.savez_compressed(file, **table)
            print(f"{case.name}: {sum(each.key in table for each in cases)} of {len(cases)}", flush=True)


if __name__ == "__main__":
    main("--fresh" in sys.argv[1:])
