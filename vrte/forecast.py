"""How long a solve will take, told before it starts, and refused where that is beyond a limit."""

import math
import warnings
from typing import TYPE_CHECKING

from vrte.backends import Backend
from vrte.discrete_ordinates.azimuths import fold
from vrte.discrete_ordinates.operations import operations_of_block, operations_of_sums
from vrte.discrete_ordinates.problem import Run
from vrte.errors import LongSolveWarning, SceneError
from vrte.request import EXACT, Request

if TYPE_CHECKING:
    from vrte.plan import Plan

LONG = 20.0  # seconds that are told
# operations a second of one thread, of a processor of 2024 that has other work as well; right to a factor of 3
RATE = {
    EXACT: 3.5e9,
    "adding-doubling": 2e9,
    "matrix-operator": 8e9,
    "invariant-imbedding": 3e9,
    "single-scattering": 3.5e9,
    "successive-orders": 6e9,
    "synthetic-iteration": 2e9,
}
PLANNING_RATE = 8e7  # squares of orders times directions, a second of one thread
VERIFYING = 4.0  # times as long, by both algorithms


def foretell(request: Request, seconds: float, dominated: str, change: str) -> None:
    """Says what a solve will take where that is long. Raises SceneError beyond the request's limit."""
    if seconds <= min(LONG, request.time_limit_s):
        return
    told = f"this will take about {in_words(seconds)}, most of it for {dominated}; {change}"
    if seconds > request.time_limit_s:
        limit = in_words(request.time_limit_s)
        raise SceneError(f"{told}, or go on with time_limit_s above its {limit} (math.inf for no limit)")
    warnings.warn(told, LongSolveWarning, stacklevel=2)


def foretell_planning(request: Request, run: Run) -> None:
    """Before a plan with so many nodes that the plan itself takes long."""
    if request.nodes is None:
        return
    orders = min(2 * request.nodes, max(layer.phase_matrix.terms for layer in request.scene.layers))
    seconds = request.nodes * float(orders) ** 2 * len(request.scene.layers) / (PLANNING_RATE * run.threads)
    foretell(request, seconds, f"the plan of {orders} orders on {request.nodes} nodes", "fewer nodes take less")


def foretell_plan(plan: "Plan", run: Run) -> None:
    """Before a plan is carried out; a device's speed is not known."""
    request = plan.request
    if request.backend is Backend.OPENCL:
        return
    parts = plan.parts or (plan,)
    seconds = sum(seconds_of(part) for part in parts) / run.threads * (VERIFYING if request.verify else 1.0)
    blocks = [block for part in parts for block in part.blocks]
    if not blocks:
        return
    largest = max(block.problem.size for block in blocks)
    names = " and ".join(sorted({block.choice.name for block in blocks}))
    orders, layers = max(part.orders for part in parts), len(request.scene.layers)
    dominated = f"{orders} Fourier orders of {largest} unknowns in {layers} layer{'s'[: layers > 1]} by {names}"
    change = "fewer nodes or a coarser accuracy take less"
    foretell(request, seconds, dominated, change)


def seconds_of(plan: "Plan") -> float:
    """Of a plan's blocks and sums on one thread."""
    azimuths = fold(plan.request.phi, plan.problem.leave_out.azimuths)
    sums = operations_of_sums(plan.problem, plan.blocks, plan.wanted, azimuths)
    solved = sum(operations_of_block(each, plan.needs.strength[each.orders], plan.accuracy) for each in plan.blocks)
    return (sums + solved) / RATE[EXACT]


def in_words(seconds: float) -> str:
    """A time that is only roughly known.

    >>> in_words(24.0), in_words(200.0), in_words(7200.0), in_words(1e6)
    ('24 s', '3 min', '2.0 h', '11.6 days')
    """
    if seconds < 100.0 or not math.isfinite(seconds):
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 172800.0 else f"{seconds / 86400.0:.3g} days"
