"""How long a plan, and carrying it out, will take."""

from typing import TYPE_CHECKING

from vrte.basics import cost
from vrte.basics.running import Run
from vrte.discrete_ordinates.planning.operations import count_operations_of_block, count_operations_of_sums
from vrte.request.backends import Backend
from vrte.request.how import EXACT
from vrte.request.request import Request

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan


def foretell_planning(request: Request, run: Run) -> None:
    """Before a plan with so many nodes that the plan itself takes long."""
    why = f", most of it for the plan alone, of {count_planned_orders(request)} orders on {request.nodes} nodes"
    cost.foretell(predict_planning_seconds(request, run), request.time_limit_s, why, "fewer nodes take less", run.told)


def predict_planning_seconds(request: Request, run: Run) -> float:
    """Of a plan on the nodes that are given; where they are chosen it is quick."""
    if request.nodes is None:
        return 0.0
    squares = request.nodes * float(count_planned_orders(request)) ** 2 * len(request.scene.layers)
    return squares / (cost.PLANNING_RATE * run.threads)


def count_planned_orders(request: Request) -> int:
    """Fourier orders that a plan on given nodes looks at."""
    longest = max(layer.phase_matrix.terms for layer in request.scene.layers)
    return longest if request.nodes is None else min(2 * request.nodes, longest)


def foretell_plan(plan: "Plan", run: Run) -> None:
    """Before a plan is carried out; a device's speed is not known."""
    request = plan.request
    if request.backend is Backend.OPENCL or (run.brief and request.time_limit_s >= cost.LONG):
        return
    parts = plan.parts or (plan,)
    blocks = [block for part in parts for block in part.blocks]
    if not blocks:
        return
    largest = max(block.problem.size for block in blocks)
    names = " and ".join(sorted({block.choice.name for block in blocks}))
    orders, layers = max(part.orders for part in parts), len(request.scene.layers)
    piled = f"{layers} layer{'s'[: layers > 1]}"
    why = f", most of it for {orders} Fourier orders of {largest} unknowns in {piled} by {names}"
    change = "fewer nodes or a coarser accuracy take less"
    cost.foretell(predict_total_seconds(plan) / run.threads, request.time_limit_s, why, change, run.told)


def predict_total_seconds(plan: "Plan") -> float:
    """Of all parts of a plan on one thread, with what verifies them."""
    return sum(predict_plan_seconds(part) for part in plan.parts or (plan,)) * (
        cost.VERIFYING if plan.request.verify else 1.0
    )


def predict_plan_seconds(plan: "Plan") -> float:
    """Of a plan's blocks and sums on one thread."""
    sums = count_operations_of_sums(plan)
    solved = sum(
        count_operations_of_block(each, plan.needs.strength[each.orders], plan.accuracy) for each in plan.blocks
    )
    return (sums + solved) / cost.RATE[EXACT]
