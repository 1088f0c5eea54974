"""A request solved: planned and executed, in two parts where polarized incident light wants another truncation."""

from dataclasses import replace

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.problem import Progress, Run
from vrte.discrete_ordinates.solver import Solution, sized, solve, steps
from vrte.discrete_ordinates.truncating import has_scalar_among_polarizing
from vrte.plan import Plan, make_plan
from vrte.request import Request

UNPOLARIZED, POLARIZED = np.diag([1.0, 0.0, 0.0, 0.0]), np.diag([0.0, 1.0, 1.0, 1.0])


def solved(request: Request, run: Run, progress: Progress | None = None) -> tuple[Plan, Solution]:
    """The plan of a request and its solution, incident columns added up as wanted."""
    plan = make_plan(request, run)
    if not wants_two(plan):
        return plan, solve(plan, run, progress)
    known = plan.choice, plan.accuracy
    first, second = (make_plan(lit_by(request, part), run, known=known) for part in (UNPOLARIZED, POLARIZED))
    total = steps(first) + steps(second)
    one = solve(first, run, counted(progress, 0, total))
    return plan, joined(one, solve(second, run, counted(progress, steps(first), total)))


def wants_two(plan: Plan) -> bool:
    """Whether the rule of `choose_truncation` has two answers: for light that arrives unpolarized, and for Q, U, V."""
    columns, scene = plan.request.columns, plan.request.scene
    if plan.request.truncation != "auto" or not (columns[:, 0].any() and columns[:, 1:].any()):
        return False
    peaks = plan.problem.fraction.tolist()
    peaked = any(f > 0.0 and layer.phase_matrix.is_scalar for f, layer in zip(peaks, scene.layers, strict=True))
    return peaked and has_scalar_among_polarizing(scene)


def lit_by(request: Request, part: Array) -> Request:
    """The request for a part (4, 4) of the incident Stokes vectors."""
    columns = request.columns @ part
    kept = columns.any(axis=1)
    wanted = request.wanted
    if wanted is not None:
        wanted = replace(wanted, place=wanted.place[kept])
    return replace(request, columns=columns[kept], wanted=wanted)


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
