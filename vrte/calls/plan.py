"""The plan of a call of `vrte.brdf` or `vrte.radiance`, from the same arguments; and how long many solves will take,
predicted before the first starts, and refused where that is beyond a limit."""

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import fmean, median
from typing import Any, Literal

from vrte import methods
from vrte.basics import cost
from vrte.basics.errors import SceneError
from vrte.basics.running import Run, run_interruptible, start_run
from vrte.calls.derivatives import Derivatives, check_differentiable, plan_derivatives, read_derivatives
from vrte.discrete_ordinates.planning.forecast import (
    predict_planning_seconds,
    predict_total_seconds,
    warn_runtime_of_planning,
)
from vrte.discrete_ordinates.planning.plan import Plan, plan_request
from vrte.methods import choose_method
from vrte.request.how import AUTO, EXACT, Backend, complete_docstring
from vrte.request.request import Request, estimate_operations, make_brdf_request, make_radiance_request
from vrte.scene.scene import Scene


@complete_docstring
def plan(
    kind: Literal["brdf", "radiance"], scene: Scene, *arguments: Any, derivatives: Derivatives = None, **keywords: Any
) -> Plan:
    """What `vrte.brdf` or `vrte.radiance` would do, without doing it.

    Parameters
    ----------
    kind : {'brdf', 'radiance'}
        The function.
    scene, *arguments, **keywords
        As that function takes them, but for the name of another ``method``, which has no plan. With method="auto" the
        plan says which method the rules take; without ``nodes`` they are chosen, by a small solve.
    {derivatives}

    Returns
    -------
    Plan
        ``print(plan)`` shows the Fourier orders and what each block of them costs, what is left out and why, the
        predicted operations and memory; ``plan.as_dict()`` has the same for programs.

    Raises
    ------
    {SceneError}
    TypeError
        For a keyword that the function does not have.

    Examples
    --------
    >>> import vrte
    >>> scene = vrte.Scene([vrte.Layer(vrte.isotropic(), albedo=0.9, thickness=1.0)])
    >>> vrte.plan("radiance", scene, mu0=0.6, nodes=8)
    Plan(radiance, 1 orders at most, 1 blocks)
    """
    request = make_request(kind, scene, *arguments, **keywords)
    if request.method != EXACT and not request.method_rule:
        words = f"has no plan: there are plans of {EXACT!r} and {AUTO!r}"
        raise SceneError(f"method {request.method!r} {words}", "method")
    variations = read_derivatives(scene, derivatives)
    if variations:
        check_differentiable(request)
    run = start_run(request.threads)
    warn_runtime_of_planning(request, run)
    found = run_interruptible(run, lambda: plan_request(request, run))
    found = replace(found, derivatives=plan_derivatives(found, variations))
    # what the rules gave to another method has no Fourier order to solve
    return replace(found, blocks=(), orders=0) if request.method_rule and request.method != EXACT else found


def make_request(kind: Any, scene: Any, *arguments: Any, **keywords: Any) -> Request:
    """The request that `vrte.brdf` or `vrte.radiance` would make of its arguments, its method named."""
    if keywords.pop("derivatives", None) is not None:
        words = "are not for panels and tables: vrte.brdf, brdfs, radiance and spectrum have them"
        raise SceneError.of("derivatives", words)
    make: Any = make_brdf_request if kind == "brdf" else make_radiance_request
    return choose_method(make(scene, *arguments, **keywords))


FEW = 5  # solves of many that are looked at


def warn_runtime_of_all(
    count: int,
    asked_at: Callable[[int], tuple[Request, float]],
    what: str,
    limit: float | None = None,
    beside: float = 0.0,
    workers: int = 1,
) -> bool:
    """Warns of the time of ``count`` solves on ``workers``, ``beside`` other seconds, by a few: ``asked_at`` gives
    request and seconds of particles at a place (invalid ones are passed over). Raises SceneError beyond the limit."""
    if count < 2:
        return False
    begin, looked, solving = time.perf_counter(), [], []
    steps = max(min(FEW, count) - 2, 1)
    for index in dict.fromkeys([0, *(count - 1 - step * (count - 2) // steps for step in range(min(FEW, count) - 1))]):
        try:
            request, made = asked_at(index)
            start = time.perf_counter()
            seconds, planned = predict_seconds(request, count)
        except SceneError:
            continue
        looked.append(made + time.perf_counter() - start + planned + cost.A_CALL)
        solving.append(seconds)
        limit = request.time_limit_s if limit is None else limit
        quick = beside + count * (looked[-1] + seconds) < cost.LONG / 100.0
        # the first alone says little: what is loaded for it is no matter of the others
        patience = cost.LOOKING if len(looked) > 1 else cost.LOADING
        if (index and quick) or time.perf_counter() - begin > patience:
            break
    if limit is None or not looked:
        return False
    # what is loaded for the first is no matter of each
    each = median(looked[1:] or looked) + fmean(solving)
    total = (beside + count * each) / workers
    cost.warn_runtime(
        total, limit, f" for {what} together", "fewer nodes, a coarser accuracy or fewer of them take less"
    )
    return total > cost.LONG


def predict_seconds(request: Request, count: int = 1) -> tuple[float, float]:
    """Seconds of a solve, and of its plan where that is too long to be made here; nothing of a device. A plan is made
    where ``count`` solves like it are not brief."""
    if request.backend is Backend.OPENCL:
        return 0.0, 0.0
    run = Run(1)  # no threads of OpenMP in the caller's own: a child forked later would wait for them
    if request.method != EXACT:
        return methods.predict_seconds(request, run), 0.0
    operations = estimate_operations(request)
    if count * operations < cost.BRIEF:
        return operations / cost.RATE[EXACT], 0.0
    threads = methods.make_run(request).threads
    planning = predict_planning_seconds(request, run)
    if planning > cost.LOOKING:
        return 0.0, planning / threads
    plan = plan_request(request, run)
    return predict_total_seconds(plan) / threads, 0.0
