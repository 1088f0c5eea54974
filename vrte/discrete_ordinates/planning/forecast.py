"""How long a plan, and carrying it out, will take."""

from vrte.basics import cost
from vrte.basics.running import Run
from vrte.discrete_ordinates.planning.operations import count_operations_of_plan
from vrte.discrete_ordinates.planning.plan import Plan, plan_request
from vrte.request.how import EXACT, Backend
from vrte.request.request import Request


def plan_within_limit(request: Request, run: Run) -> Plan:
    """The plan of a request, after it was told what the plan and the solve take. Raises SceneError beyond the limit."""
    warn_runtime_of_planning(request, run)
    plan = plan_request(request, run)
    warn_runtime_of_plan(plan, run)
    return plan


def warn_runtime_of_planning(request: Request, run: Run) -> None:
    """Before a plan with so many nodes that the plan itself takes long."""
    why = f", most of it for the plan alone, of {count_planned_orders(request)} orders on {request.nodes} nodes"
    cost.warn_runtime(
        predict_planning_seconds(request, run), request.time_limit_s, why, "fewer nodes take less", run.runtime_warned
    )


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


def warn_runtime_of_plan(plan: Plan, run: Run) -> None:
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
    stacked = f"{layers} layer{'s'[: layers > 1]}"
    why = f", most of it for {orders} Fourier orders of {largest} unknowns in {stacked} by {names}"
    change = "fewer nodes or a coarser accuracy take less"
    cost.warn_runtime(predict_total_seconds(plan) / run.threads, request.time_limit_s, why, change, run.runtime_warned)


def predict_total_seconds(plan: Plan) -> float:
    """Of all parts of a plan on one thread, with what verifies them and with the search for nodes."""
    request = plan.request
    times, solves, each = cost.VERIFYING if request.verify else 1.0, 1.0, 0.0
    if request.scene.has_interfaces:
        each = cost.ROUGH if request.scene.is_rough else cost.SMOOTH
    if request.nodes is None:
        times, solves, each = times * cost.SEARCHING, cost.COUNTS, each + cost.A_TRIAL
    return count_operations_of_plan(plan) / cost.RATE[EXACT] * times + solves * each
