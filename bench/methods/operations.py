"""Floating-point operations of a run, as far as its shapes and what it says of itself tell; NaN where they do not.

Leading terms of products (2 a b c), of factorisations (2/3 n^3) and of what they solve (2 n^2 a column), summed over
Fourier orders; exponentials, phase matrices, the joining of slabs and the sum over orders are left out, but in the
plan's count.
n: unknowns of a hemisphere; r: rows, with the directions off the nodes; c: columns, with the beams.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.knobs import Options
from bench.methods.scenes import PHI, Case
from vrte.calls.plan import make_request, plan
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import cut_layers
from vrte.methods import adding_doubling, find_method, successive_orders
from vrte.methods.parts import slab
from vrte.methods.parts.on_nodes import count_sizes
from vrte.methods.parts.task import discretise_request
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.field import Field

SDA_STEP, SDA_START = 64.0 / 3.0, 80.0 / 3.0  # operations over n^3 of a doubling: 2 solves and 8 products; before them


@dataclass(frozen=True)
class Shape:
    """Sizes that matrices have, and how many Fourier orders there are."""

    n: float
    r: float
    c: float
    orders: int

    @staticmethod
    def of(request: Request, problem: Problem) -> "Shape":
        """Of the problem that methods on nodes solve; directions up and down along the same cosine are one row."""
        return Shape(*count_sizes(request, problem), problem.coefficients.shape[1])

    @property
    def beams(self) -> float:
        """Columns that are no nodes."""
        return self.c - self.n

    @property
    def out(self) -> float:
        """Rows that are no nodes."""
        return self.r - self.n


def count_operations(case: Case, method: str, options: Options, field: Field) -> float:
    """Of a run with these keywords of `vrte.radiance`, and what it made; NaN for what is not counted."""
    if method == EXACT:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            return count_planned_operations(plan("radiance", *list_arguments(case), threads=1, **options).as_dict())
    if method not in COUNTS:
        return math.nan
    request = make_request("radiance", case.scene, *list_arguments(case)[1:], **{**options, "method": method})
    problem = discretise_request(request)
    settings = find_method(method).checked(request)
    return COUNTS[method](request, problem, Shape.of(request, problem), settings, field.diagnostics)


def list_arguments(case: Case) -> tuple[Any, ...]:
    """As `vrte.radiance` takes them."""
    return case.scene, case.mu0, case.stokes, case.signed_mu, PHI, case.tau


def count_planned_operations(facts: Mapping[str, Any]) -> float:
    """What the plan predicts, or each of its parts: at most, for orders may turn out too faint to be solved."""
    if "parts" in facts:
        return sum(count_planned_operations(part) for part in facts["parts"].values())
    return float(facts["operations"])


def count_solve(n: float, columns: float) -> float:
    """A factorisation, and what it solves."""
    return 2.0 / 3.0 * n**3 + 2.0 * n * n * columns


def count_adding_doubling(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Doublings of every distinct slab from its starting layer; ``doublings`` of a semi-infinite layer: the most of any
    order."""
    n, r, c = shape.n, shape.r, shape.c
    pile = cut_layers(problem)
    thin = settings["thin"] * max(adding_doubling.LOWEST, float(np.min([*problem.nodes, *problem.mu0])))
    doublings = sum(
        said["doublings"] if math.isinf(tau) else adding_doubling.count_doublings(tau, thin)
        for tau in pile.thickness.tolist()
    )
    levels = 2.0 * settings["start"] * n
    start = count_solve(levels, c) + 4.0 * settings["start"] * 2.0 * r * n * c
    between = 2.0 * n**3 + count_solve(n, c) + 2.0 * n * n * c + 4.0 * r * n * c
    return shape.orders * (pile.thickness.size * start + doublings * (between + 4.0 * r * n * c))


def count_invariant_imbedding(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Sweeps of the Riccati equation over its Gauss points; of a semi-infinite layer, doublings of its algebraic form,
    the most of any order, and a solve for each beam and direction."""
    n, r, c = shape.n, shape.r, shape.c
    points = slab.POINTS
    force = 2.0 * n * n * c + 8.0 * r * n * c
    integral = 4.0 * points * r * c
    steps = said["steps"] + said["steps_repeated"]
    riccati = (said["sweeps"] + steps) * points * force + (said["sweeps"] * points + steps) * integral
    if not math.isinf(request.scene.thickness):
        return float(riccati)
    doubled = SDA_STEP * said["doublings"] + SDA_START
    return float(riccati + shape.orders * (doubled * n**3 + (shape.beams + shape.out) * count_solve(n, 1.0)))


def count_successive_orders(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Every scattering but the first, along the nodes, and the last one into the wanted directions: four products at
    each of the levels, and integrals over each panel."""
    n, b, levels = shape.n, problem.n_rhs, said["levels"]
    a_row = levels * (8.0 * n * b + 4.0 * (successive_orders.POINTS + 1) * b)
    return float((said["scatterings"] - shape.orders) * n * a_row + shape.orders * shape.out * a_row)


COUNTS = {
    "adding-doubling": count_adding_doubling,
    "invariant-imbedding": count_invariant_imbedding,
    "successive-orders": count_successive_orders,
}
