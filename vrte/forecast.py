"""How long a solve, or many, will take, told before it starts, and refused where that is beyond a limit."""

import math
import time
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from vrte.backends import Backend
from vrte.discrete_ordinates.azimuths import fold
from vrte.discrete_ordinates.operations import operations_of_block, operations_of_sums
from vrte.discrete_ordinates.problem import Run
from vrte.errors import LongSolveWarning, SceneError
from vrte.request import EXACT, Request

if TYPE_CHECKING:
    from vrte.plan import Plan

LONG = 20.0  # seconds that are told
# operations a second of one thread, of a processor of 2024 with nothing else to do; right to a factor of 3
RATE = {
    EXACT: 2.5e10,
    "adding-doubling": 2.2e10,
    "matrix-operator": 1.5e11,
    "invariant-imbedding": 2e10,
    "single-scattering": 2.5e10,
    "successive-orders": 2.5e10,
}
PLANNING_RATE = 2e8  # squares of orders times directions, a second of one thread
VERIFYING = 4.0  # times as long, by both algorithms
FEW, LOOKING = 5, 0.7  # solves of many that are looked at, and seconds after which no other one is
A_CALL = 3e-3  # seconds of any solve, beside its plan and its operations


def foretell(seconds: float, limit: float, why: str, change: str, told: bool = False) -> None:
    """Says what will take long, unless that was ``told``. Raises SceneError beyond the limit in seconds."""
    if seconds <= min(LONG, limit):
        return
    said = f"this will take about {in_words(seconds)}{why}; {change}"
    if seconds > limit:
        raise SceneError(f"{said}, or go on with time_limit_s above its {in_words(limit)} (math.inf for no limit)")
    if not told:
        warnings.warn(said, LongSolveWarning, stacklevel=2)


def foretell_all(
    count: int,
    asked_at: Callable[[int], tuple[Request, int, float]],
    what: str,
    limit: float | None = None,
    beside: float = 0.0,
    workers: int = 1,
) -> bool:
    """Says what ``count`` solves take together, by a few that are spread among them; whether it is long.

    ``asked_at``: the request at a place, its threads, and the seconds that its particles took; ``what`` they are;
    ``limit`` in seconds, by default that of the requests; ``beside``: seconds of other work; ``workers`` share all of
    it. What cannot be asked is passed over: it will say so itself. Raises SceneError beyond the limit.
    """
    if count < 2:
        return False
    begin, looked, solving = time.perf_counter(), [], []
    for place in [0, *np.unique(np.linspace(count - 1, 1, min(FEW, count) - 1).astype(int))[::-1].tolist()]:
        try:
            request, threads, made = asked_at(place)
            start = time.perf_counter()
            seconds, planned = predicted(request, threads)
        except SceneError:
            continue
        looked.append(made + time.perf_counter() - start + planned + A_CALL)
        solving.append(seconds)
        limit = request.time_limit_s if limit is None else limit
        quick = beside + count * (looked[-1] + seconds) < LONG / 100.0
        if (place and quick) or time.perf_counter() - begin > LOOKING:
            break
    if limit is None or not looked:
        return False
    # what is loaded for the first is no matter of each
    each = float(np.median(looked[1:] or looked) + np.mean(solving))
    total = (beside + count * each) / workers
    foretell(total, limit, f" for {what} together", "fewer nodes, a coarser accuracy or fewer of them take less")
    return total > LONG


def predicted(request: Request, threads: int) -> tuple[float, float]:
    """Seconds of a solve, and of its plan where that is too long to be made here; nothing of a device."""
    from vrte.plan import plan_of

    if request.backend is Backend.OPENCL:
        return 0.0, 0.0
    run = Run(1)  # no threads of OpenMP in the caller's own: a child forked later would wait for them
    if request.method != EXACT:
        from vrte import methods

        return methods.predicted(request, run), 0.0
    planning = seconds_of_planning(request, run)
    if planning > LOOKING:
        return 0.0, planning / threads
    plan = plan_of(request, run)
    return seconds_of_all(plan) / threads, 0.0


def foretell_planning(request: Request, run: Run) -> None:
    """Before a plan with so many nodes that the plan itself takes long."""
    why = f", most of it for the plan alone, of {orders_of(request)} orders on {request.nodes} nodes"
    foretell(seconds_of_planning(request, run), request.time_limit_s, why, "fewer nodes take less", run.told)


def seconds_of_planning(request: Request, run: Run) -> float:
    """Of a plan on the nodes that are given; where they are chosen it is quick."""
    if request.nodes is None:
        return 0.0
    squares = request.nodes * float(orders_of(request)) ** 2 * len(request.scene.layers)
    return squares / (PLANNING_RATE * run.threads)


def orders_of(request: Request) -> int:
    """Fourier orders that a plan on given nodes looks at."""
    longest = max(layer.phase_matrix.terms for layer in request.scene.layers)
    return longest if request.nodes is None else min(2 * request.nodes, longest)


def foretell_plan(plan: "Plan", run: Run) -> None:
    """Before a plan is carried out; a device's speed is not known."""
    request = plan.request
    if request.backend is Backend.OPENCL:
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
    foretell(seconds_of_all(plan) / run.threads, request.time_limit_s, why, change, run.told)


def seconds_of_all(plan: "Plan") -> float:
    """Of all parts of a plan on one thread, with what verifies them."""
    return sum(seconds_of(part) for part in plan.parts or (plan,)) * (VERIFYING if plan.request.verify else 1.0)


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
