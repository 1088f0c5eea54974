"""Discrete ordinates, the exact method: planned and executed, in two parts where polarized light wants another cut."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vrte.basics.arrays import Array, replace_unchecked
from vrte.basics.errors import AccuracyWarning, warn_user
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.execution.carry_out import carry_out
from vrte.discrete_ordinates.execution.engines import choose_engine
from vrte.discrete_ordinates.planning.choose_quadrature import CAREFUL, OF_NODES, estimate_nodes
from vrte.discrete_ordinates.planning.forecast import plan_within_limit
from vrte.discrete_ordinates.planning.plan import Plan
from vrte.methods.parts.method import Answer, Task
from vrte.request.how import EXACT, Backend
from vrte.request.request import Request
from vrte.results.result import NO_LIGHT, Solution

GOOD = 1e-2  # accuracy for which a warning of too few nodes proposes their number
RUNAWAY = 1e-3  # of the largest light: negative light of rough surfaces beyond is no matter of accuracy


def solve_by_discrete_ordinates(task: Task) -> Answer:
    """The plan of the request, carried out; on a device checked against the processor where that is asked for."""
    request, run = task.request, task.run
    if request.verify and request.backend is Backend.OPENCL:
        return verify_solution(task)
    plan = plan_within_limit(request, run)
    (solution,) = solve_plans([plan], run, task.progress)
    return plan.mu, solution


def solve_plans(plans: Sequence[Plan], run: Run, progress: Progress | None = None) -> list[Solution]:
    """The solutions of plans for one backend, together where its engine takes many; a plan's two parts joined."""
    flat = [part for plan in plans for part in plan.parts or (plan,)]
    solutions: dict[int, Solution] = {}
    kinds = [(plan.request.scene.needs_beam_paths, plan.request.scene.has_flakes) for plan in flat]
    for refracts, oriented in sorted(set(kinds)):
        indices = [index for index, kind in enumerate(kinds) if kind == (refracts, oriented)]
        if indices:
            request = flat[0].request
            engine = choose_engine(request.backend, refracts, request.precision, request.accuracy, oriented)
            own = replace_unchecked(run, kernels=engine.stages) if refracts else run
            solutions |= dict(zip(indices, carry_out([flat[k] for k in indices], engine, own, progress), strict=True))
    found = (solutions[index] for index in range(len(flat)))
    return [join_solutions(next(found), next(found)) if plan.parts else next(found) for plan in plans]


def verify_solution(task: Task) -> Answer:
    """The device's solution, and what it differs by from that of the processor's eigensolver."""
    plain = replace(task.request, verify=False)
    mu, found = solve_by_discrete_ordinates(replace(task, request=plain))
    other = replace(plain, backend=Backend.OPENMP, algorithm="modes", precision="auto")
    again = solve_by_discrete_ordinates(Task(other, {}, Run(task.run.threads, stop=task.run.stop)))[1]
    radiance = [measure_largest_gap(*pair) for pair in zip(found.parts, again.parts, strict=True)]
    fluxes = [np.stack([each.flux_up, each.flux_down], axis=1) for each in (found, again)]
    agreement = {
        "with": "openmp: modes",
        "orders_compared": again.diagnostics["orders"],
        "radiance": max(radiance),
        "flux": measure_largest_gap(*fluxes),
    }
    return mu, replace(found, diagnostics=found.diagnostics | {"agreement": agreement})


def warn_of_negative(request: Request, intensity: Array, diagnostics: Mapping[str, Any]) -> None:
    """Warns of negative light of the exact method where terms are cut, or of much under a rough surface."""
    if request.method != EXACT or not intensity.size or not (request.scene.is_rough or diagnostics["terms_cut"]):
        return
    each = intensity.reshape(intensity.shape[0], -1)
    least = (each.min(axis=1) / np.maximum(np.abs(each).max(axis=1), NO_LIGHT)).min()
    if request.scene.is_rough and least < -RUNAWAY:
        warn_user(
            f"light comes out negative, {least:.1g} of the largest: facets without shadowing reflect more light than "
            "they receive, and multiple reflections diverge; give the interface shadowing = True",
            AccuracyWarning,
        )
        return
    if diagnostics["terms_cut"] and least < -request.accuracy:
        mu = np.concatenate([OF_NODES, -OF_NODES]) if request.mu is None else request.mu
        enough = estimate_nodes(request.scene, request.mu0, mu, request.tau, CAREFUL * GOOD)
        warn_user(
            f"{diagnostics['nodes']} nodes are too few for the phase matrix: light comes out negative, {least:.1g} of "
            f"the largest; {enough} nodes do by an estimate for an accuracy of {GOOD:g}, or leave nodes out",
            AccuracyWarning,
        )


def measure_largest_gap(found: Array, expected: Array) -> float:
    """The largest difference at each depth, axis 0, over the largest there."""
    size, difference = (
        np.abs(values).reshape(values.shape[0], -1).max(axis=1) for values in (expected, found - expected)
    )
    return float((difference / np.maximum(size, NO_LIGHT)).max())


def join_solutions(one: Solution, other: Solution) -> Solution:
    """Both together: radiances added place by place, fluxes side by side."""
    for values, more in zip(other.parts, one.parts, strict=True):
        values[..., : more.shape[-1]] += more
    flux_up, flux_down = (
        np.concatenate(pair, axis=-1) for pair in ((one.flux_up, other.flux_up), (one.flux_down, other.flux_down))
    )
    return Solution(other.parts, flux_up, flux_down, one.diagnostics | {"polarized_light": other.diagnostics})
