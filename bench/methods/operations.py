"""Floating-point operations of a run, as far as its shapes and what it says of itself tell; NaN where they do not.

Leading terms of products (2 a b c), of factorisations (2/3 n^3) and of what they solve (2 n^2 a column), summed over
Fourier orders; exponentials, phase matrices and the sum over orders are left out, but in the plan's count.
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
from vrte.discrete_ordinates.orders.slabs import cut_layers, find_materials
from vrte.methods import adding_doubling, find_method, matrix_operator
from vrte.methods.parts import imbedding, panels
from vrte.methods.parts.on_nodes import OnNodes
from vrte.methods.parts.task import discretise_request
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.field import Field

EIGENVECTORS = 25.0  # operations over n^3 of a general real eigenproblem with its vectors
COMPLEX = 4.0  # real operations of a complex one, on average
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
        on_nodes = OnNodes(problem, request.scene.below)
        n, distinct = on_nodes.n, np.unique(problem.mu_out).size
        return Shape(n, n + distinct * len(on_nodes.members), on_nodes.columns.size, on_nodes.n_order)

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
    """Doublings of every distinct slab from its starting layer, and slabs and base joined from both ends; ``doublings``
    of a slab without end: the most of any order."""
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
    from_below = 4.0 * n**3 + count_solve(n, n) + 4.0 * r * n * n
    added = between + from_below + 4.0 * r * n * c + 4.0 * r * n * n
    slabs = pile.slabs.size + (0 if math.isinf(request.scene.thickness) else 1)  # the base is one
    joined = (slabs - 1) * (between + added) + max(0, slabs - 2) * added
    return shape.orders * (pile.thickness.size * start + doublings * (between + 4.0 * r * n * c) + joined)


def count_invariant_imbedding(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Sweeps of the Riccati equation over its Gauss points; of a layer without end, doublings of its algebraic form,
    the most of any order, and a solve for each beam and direction."""
    n, r, c = shape.n, shape.r, shape.c
    both, points = (request.tau > 0.0).any(), imbedding.POINTS
    force = 2.0 * n * n * c + (8.0 if both else 4.0) * r * n * c
    integral = (2.0 if both else 1.0) * 2.0 * points * r * c
    steps = said["steps"] + said["steps_repeated"]
    riccati = (said["sweeps"] + steps) * points * force + (said["sweeps"] * points + steps) * integral
    if not math.isinf(request.scene.thickness):
        return float(riccati)
    doubled = SDA_STEP * said["doublings"] + SDA_START
    return float(riccati + shape.orders * (doubled * n**3 + (shape.beams + shape.out) * count_solve(n, 1.0)))


def count_matrix_operator(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Modes of every distinct material, functions of them for every layer, layers and base joined; light at the two
    faces, not inside."""
    n, b, o = shape.n, shape.beams, shape.out
    beams = 2.0 * n * n * b + 2.0 * o * n * b
    product = 2.0 * n * n * (n + o) + beams
    solve = count_solve(n, n) + 2.0 * o * n * n + beams
    function = COMPLEX * product
    checked = 3.0 * COMPLEX * 2.0 * n**3  # an inverse, and two products to check it
    modes = product + EIGENVECTORS * n**3 + checked + COMPLEX * 2.0 * n * n * (b + o)
    slabs = sum(
        function + 2.0 * solve
        if math.isinf(tau)
        else 3.0 * (function + product + solve) + (solve if tau < matrix_operator.THIN else 0.0)
        for tau in problem.thickness.tolist()
    )
    layers, materials = problem.thickness.size, len(find_materials(problem)[0])
    faces = layers * (product + count_solve(n, b) + 4.0 * beams)
    joined = layers * (3.0 * product + solve) + (layers - 1) * (9.0 * product + 3.0 * solve)
    return shape.orders * (materials * modes + slabs + faces + joined)


def count_successive_orders(
    request: Request, problem: Problem, shape: Shape, settings: Mapping[str, Any], said: Mapping[str, Any]
) -> float:
    """Every scattering but the first, along the nodes, and the last one into the wanted directions: four products at
    each of the levels, and integrals over each panel."""
    n, b, levels = shape.n, shape.beams, said["levels"]
    a_row = levels * (8.0 * n * b + 4.0 * (panels.POINTS + 1) * b)
    return float((said["scatterings"] - shape.orders) * n * a_row + shape.orders * shape.out * a_row)


COUNTS = {
    "adding-doubling": count_adding_doubling,
    "invariant-imbedding": count_invariant_imbedding,
    "matrix-operator": count_matrix_operator,
    "successive-orders": count_successive_orders,
}
