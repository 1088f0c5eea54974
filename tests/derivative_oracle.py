"""Derivatives nobody can argue with: differences of the oracle's answers, of numbers moved by 2^-66 of themselves.

What the ball arithmetic (tests/ball_oracle.py) finds for a number moved up and down differs in the 20th digit; with 512
bits and more the difference has all digits of a double, and what it leaves out is 1e-40 of it.
"""

import hashlib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from flint import arb, arb_mat, ctx

import vrte
from vrte.studies.cases import Slab, find_phase_matrix, make_scene

from .ball_oracle import (
    Answer,
    Directions,
    DoubtfulError,
    Layer,
    Request,
    collect,
    exact,
    find_fields,
    generator,
    homogeneous,
)

TABLE = Path(__file__).with_name("derivative_oracle.npz")
NODES, MU_I, MU_O = 8, (0.1, 0.6), (0.35, 0.9)
COLUMNS = ("a1", "a2", "a3", "a4", "b1", "b2")
STEP, BITS, MOST_BITS = -66, 512, 4096
UNIT = tuple(map(tuple, np.eye(4).tolist()))
Operators = tuple[arb_mat, arb_mat, arb_mat, arb_mat]


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
        """A digest of all numbers that determine the answers."""
        numbers = [*MU_I, *MU_O, NODES, *self.orders, math.nan if self.base is None else self.base]
        digest = hashlib.sha256(np.array(numbers).tobytes() + " ".join(self.names).encode())
        for slab in self.slabs:
            digest.update(find_phase_matrix(slab.phase).coefficients.tobytes())
            digest.update(np.array([slab.albedo, slab.thickness]).tobytes())
        return digest.hexdigest()[:16]

    def ask(self, order: int) -> Request:
        """Light back from the top and, where it gets through, on from the bottom, for beams of all four kinds."""
        layers = tuple(
            Layer(find_phase_matrix(slab.phase).coefficients, slab.albedo, slab.thickness) for slab in self.slabs
        )
        levels: tuple[tuple[int, float], ...] = ((0, 0.0),)
        if self.is_transparent:
            levels += ((len(layers) - 1, layers[-1].thickness),)
        mu = (*MU_O, *(-mu for mu in MU_O)) if self.is_transparent else MU_O
        return Request(order, layers, self.base, MU_I, mu, levels, NODES, UNIT)

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


def differentiate_field(request: Request, name: str) -> Answer:
    """The derivative of one Fourier order of the field by one number. Raises DoubtfulError where there is none."""
    bits = BITS
    while True:
        ctx.prec = bits
        try:
            directions = Directions(request)
            (above, step), (below, _) = (move(request, name, steps) for steps in (1, -1))
            fields = zip(find_fields(above, directions), find_fields(below, directions), strict=True)
            scale = 1 / (2 * step)
            return collect(
                request,
                directions,
                [(scale * (down - less_down), scale * (up - less_up)) for (down, up), (less_down, less_up) in fields],
            )
        except (DoubtfulError, ZeroDivisionError):
            bits *= 2
            if bits > MOST_BITS:
                raise DoubtfulError(f"no number of bits settles the derivative by {name}") from None


def differentiate_brdf(case: Case, name: str, order: int) -> list[np.ndarray]:
    """f^m and, where it is asked for, the btdf's, by one number: (in, out, 4, 4) [1/sr] per unit of it."""
    radiance = differentiate_field(case.ask(order), name).radiance
    light = radiance.reshape(len(MU_I), 4, *radiance.shape[1:]) / np.reshape(MU_I, (-1, 1, 1, 1, 1))
    light = np.moveaxis(light, 1, -1)  # (in, level, direction, 4, column)
    return [light[:, 0, : len(MU_O)], *([light[:, 1, len(MU_O) :]] if case.is_transparent else [])]


def differentiate_operators(request: Request, name: str) -> tuple[Operators, Operators]:
    """E, F, R and T of a slab, doubles that stand for balls, and their derivatives; unit rows and columns are those of
    `Directions`, but for the nodes of order 0: one axis carries the flux there (see `turn`)."""
    ctx.prec = BITS
    directions = Directions(request)
    (above, step), (below, _) = (move(request, name, steps) for steps in (1, -1))
    value, more, less = (find_operators(asked, directions) for asked in (request, above, below))
    changes = (1 / (2 * step) * (high - low) for high, low in zip(more, less, strict=True))
    return tuple(map(round_off, value)), tuple(map(round_off, changes))


def find_operators(request: Request, directions: Directions) -> Operators:
    """E, F, R, T of a request's only layer."""
    (layer,) = request.layers
    a, b = generator(directions, request, layer)
    thickness = exact(2**72) if math.isinf(layer.thickness) else exact(layer.thickness)
    R, T = homogeneous(directions, a, b, thickness)
    return tuple(turn(directions, request, matrix) for matrix in (-1 * (a + b), -1 * (a - b), R, T))


def turn(directions: Directions, request: Request, matrix: arb_mat) -> arb_mat:
    """On nodes scaled so that reciprocity is a symmetry; in order 0 their first axis becomes sqrt(weight mu) on I."""
    roots = [(w * mu).sqrt() for w, mu in zip(directions.weight, directions.mu, strict=False)]
    scales = [roots[i // 4] if i < 4 * directions.nodes else arb(1) for i in range(directions.size)]
    n = matrix.nrows()
    scaled = arb_mat([[scales[i] * matrix[i, j] / scales[j] for j in range(n)] for i in range(n)])
    if request.order > 0:
        return scaled
    size = sum((root**2 for root in roots), arb(0)).sqrt()
    axis = [roots[i // 4] / size if i < 4 * directions.nodes and i % 4 == 0 else arb(0) for i in range(n)]
    axis[0] += 1
    reflector = arb_mat([[(i == j) - axis[i] * axis[j] / axis[0] for j in range(n)] for i in range(n)])
    return reflector * scaled * reflector


def round_off(matrix: arb_mat) -> np.ndarray:
    """As doubles."""
    return np.array([[float(matrix[i, j].mid()) for j in range(matrix.ncols())] for i in range(matrix.nrows())])
