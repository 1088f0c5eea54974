"""Derivatives of what a call finds: which are asked for, and how each is found."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import check_list
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.memory import check_bytes
from vrte.basics.running import Progress, Run, share_progress
from vrte.calls.differences import differentiate_once
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.planning.operations import count_operations_of_derivatives, count_operations_of_plan
from vrte.discrete_ordinates.planning.plan import Differentiated, Plan, plan_request
from vrte.discrete_ordinates.planning.plan_table import count_bytes_of_derivatives
from vrte.methods import solve_request
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.scene.scene import Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import vary_scene

MOST_DERIVATIVES = 10_000
Derivatives = str | Variation | Iterable[str | Variation] | None  # as calls take them
ALGEBRA, BY_SOLVES = "algebra", "differences of the solve"  # how derivatives are found


@dataclass(frozen=True, eq=False)
class Derivative:
    """The derivative of a solution with the number of a variation, and how it was found."""

    variation: Variation
    solution: Solution
    how: str

    @property
    def name(self) -> str:
        """What the number that light was differentiated with is called."""
        return self.variation.name


def read_derivatives(scene: Scene, derivatives: Derivatives) -> list[Variation]:
    """The variations that are asked for, names among them looked up in the scene. Raises SceneError for a name that
    there is not, that does nothing or stands there twice, and for a variation of another scene."""
    if derivatives is None:
        return []
    several = (derivatives,) if isinstance(derivatives, str | Variation) else derivatives
    given = check_list("derivatives", several, MOST_DERIVATIVES)
    found = [one if isinstance(one, Variation) else vary_scene(scene, one) for one in given]
    names = [one.name for one in found]
    for one in found:
        if names.count(one.name) > 1:
            raise SceneError(f"derivatives: {one.name} is asked for twice", "derivatives", one.name)
        if one.thickness.size != len(scene.layers):
            words = f"it is of {one.thickness.size} layers, and the scene has {len(scene.layers)}"
            raise SceneError(f"derivatives: {one.name}: {words}", "derivatives", one.name)
        if one.changes_nothing:
            raise SceneError(f"derivatives: {one.name}: it does nothing to the scene", "derivatives", one.name)
        check_semi_infinite(scene, one)
    return found


def check_semi_infinite(scene: Scene, variation: Variation) -> None:
    """Whether there is such a derivative: of a semi-infinite layer, not with its thickness, and with its albedo only
    where it absorbs: light goes with the root of what is absorbed. Raises SceneError."""
    last, name = scene.layers[-1], variation.name
    if not np.isinf(last.thickness):
        return
    if variation.thickness[-1]:
        raise SceneError(f"derivatives: {name}: a semi-infinite layer has no thickness to change", "derivatives", name)
    if last.albedo == 1.0 and variation.albedo[-1]:
        words = "of a semi-infinite layer the derivative with the albedo is infinite at 1"
        raise SceneError(f"derivatives: {name}: {words}", "derivatives", name)


def check_differentiable(request: Request) -> None:
    """Whether derivatives can be had of a request. Raises SceneError for another method, and for a device."""
    if request.method != EXACT:
        raise SceneError(f"derivatives are those of method {EXACT!r}, not of {request.method!r}", "derivatives")
    if request.backend.needs_device:
        words = "are found on the processor: ask for backend 'openmp' or 'sequential'"
        raise SceneError(f"derivatives {words}, not {request.backend.label!r}", "derivatives")


def solve_with_derivatives(
    request: Request, variations: Sequence[Variation], run: Run, progress: Progress | None = None
) -> tuple[Any, Solution, list[Derivative]]:
    """The cosines and the solution of a request with its method named, as without derivatives, and these."""
    if not variations:
        return *solve_request(request, run, progress), []
    check_differentiable(request)
    parts = 1 + len(variations)
    directions, solution = solve_request(request, run, share_progress(progress, 0, parts))

    def told(done: int, total: int) -> None:
        assert progress is not None
        progress(100 + (100 * (parts - 1) * done) // max(total, 1), 100 * parts)

    orders = count_orders_found(solution.diagnostics)
    plan = plan_request(converge_on_nodes(request, solution), run)
    found = differentiate(plan, variations, run, told if progress else None, orders)
    how = {"derivatives": {one.name: one.how for one in found}}
    return directions, replace(solution, diagnostics=solution.diagnostics | how), found


def count_orders_found(diagnostics: Mapping[str, Any]) -> int:
    """How many Fourier orders a solution took, in the part of it that took more."""
    other = diagnostics.get("polarized_light", {})
    return max(int(diagnostics["orders"]), int(other.get("orders", 0)))


def converge_on_nodes(request: Request, solution: Solution) -> Request:
    """The request with the nodes that its solution took, and the accuracy that these were solved to."""
    if request.nodes is not None:
        return request
    found = solution.diagnostics
    return replace(
        request, nodes=found["nodes"], grading=found["grading"], nodes_rule=found["nodes_rule"], refined=True
    )


def differentiate(
    plan: Plan,
    variations: Sequence[Variation],
    run: Run,
    progress: Progress | None = None,
    orders: int | None = None,
) -> list[Derivative]:
    """The derivatives of a plan's solution, by the algebra of slabs where it tells them, else by differences;
    ``orders``: how many the solution took."""
    ways = plan_derivatives(plan, variations)
    exact = [one for one, way in zip(variations, ways, strict=True) if way.how == ALGEBRA]
    others = [one for one, way in zip(variations, ways, strict=True) if way.how != ALGEBRA]
    words = f"{len(ways)} derivative{'s'[: len(ways) > 1]}"
    operations = count_operations_of_plan(plan) * sum(way.solves for way in ways)
    warn_runtime_of_derivatives(plan, operations, f"for {words} beside the light", run)
    check_bytes(
        count_bytes_of_derivatives(replace(plan, derivatives=ways)), "derivatives", "ask for fewer nodes, mu or phi"
    )
    together = share_progress(progress, 0, 1 + len(others))
    how = {one: way.how for one, way in zip(variations, ways, strict=True)}
    found: dict[Variation, Solution] = {}
    if exact:
        try:
            found = dict(zip(exact, differentiate_plan(plan, exact, run, together, orders), strict=True))
        except AccuracyError as error:  # modes that cannot be trusted; solves have other ways
            others, how = list(variations), how | dict.fromkeys(exact, f"{BY_SOLVES} ({error})")
    for place, one in enumerate(others, 1):
        found[one] = differentiate_once(plan, one, run, share_progress(progress, place, 1 + len(others)))
    return [Derivative(one, found[one], how[one]) for one in variations]


def warn_runtime_of_derivatives(plan: Plan, operations: float, what: str, run: Run) -> None:
    """What takes so many operations beside the light of a plan. Raises SceneError beyond the limit of its request."""
    seconds = operations / (cost.RATE[EXACT] * run.threads)
    cost.warn_runtime(
        seconds, plan.request.time_limit_s, f" {what}", "fewer nodes or derivatives take less", run.runtime_warned
    )


def plan_derivatives(plan: Plan, variations: Sequence[Variation]) -> tuple[Differentiated, ...]:
    """How each is found of what is planned, and in how many times the operations of the light."""
    if not variations:
        return ()
    gaps = [find_gap(plan, one) for one in variations]
    algebra = count_operations_of_derivatives(plan, 1.0, cost.ONCE) / max(1.0, count_operations_of_plan(plan))
    return tuple(
        Differentiated(one.name, *((ALGEBRA, algebra) if gap is None else (f"{BY_SOLVES} ({gap})", cost.DIFFERENCES)))
        for one, gap in zip(variations, gaps, strict=True)
    )
