"""A request solved: planned and executed, in two parts where polarized incident light wants another truncation."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from vrte.backends import Backend
from vrte.discrete_ordinates.kernels import kernels_of
from vrte.discrete_ordinates.problem import Progress, Run
from vrte.discrete_ordinates.solver import Solution, sized, solve, steps
from vrte.errors import SceneError
from vrte.plan import Plan, plan_of
from vrte.request import Request, operations_of
from vrte.running import new_run


def run_of(request: Request, threads: Any) -> Run:
    """The run of a request: its threads, one of a sequential backend, and its backend's kernels."""
    backend = request.backend
    if backend.kernels == "sequential":
        if threads not in (None, 1):
            raise SceneError(f"backend {backend.label!r} has one thread: leave threads out, or ask for 'openmp'")
        threads = 1
    run = new_run(threads, operations_of(request))
    return run if backend is Backend.OPENCL else replace(run, kernels=kernels_of(backend))


def solved(request: Request, run: Run, progress: Progress | None = None) -> tuple[Plan, Solution]:
    """The plan of a request and its solution, incident columns added up as wanted."""
    plan = plan_of(request, run)
    execute = executor(request.backend)
    if not plan.parts:
        return plan, execute(plan, run, progress)
    first, second = plan.parts
    total = steps(first) + steps(second)
    one = execute(first, run, counted(progress, 0, total))
    return plan, joined(one, execute(second, run, counted(progress, steps(first), total)))


def executor(backend: Backend) -> Callable[[Plan, Run, Progress | None], Solution]:
    """What executes a plan: the stages in turn, or all of them on the device."""
    if backend is not Backend.OPENCL:
        return solve
    from vrte.discrete_ordinates import on_device

    return on_device.solve


def counted(progress: Progress | None, before: int, total: int) -> Progress:
    """The call-back of one of two solutions."""
    told = sized(progress, before, total)
    return lambda done, _: told(done)


def joined(one: Solution, other: Solution) -> Solution:
    """Both together: radiances added place by place, fluxes side by side."""
    for values, more in zip(other.parts, one.parts, strict=True):
        values[..., : more.shape[-1]] += more
    flux_up, flux_down = (
        np.concatenate(pair, axis=-1) for pair in ((one.flux_up, other.flux_up), (one.flux_down, other.flux_down))
    )
    return Solution(other.parts, flux_up, flux_down, one.diagnostics | {"polarized_light": other.diagnostics})
