"""Derivatives of what a call finds: which are asked for, and how each is found."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from vrte.basics import cost
from vrte.basics.arrays import Array, check_list
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.memory import check_bytes
from vrte.basics.running import Progress, Run, run_interruptible, share_progress
from vrte.calls.differences import differentiate_beams, differentiate_once
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.planning.operations import count_operations_of_derivatives, count_operations_of_plan
from vrte.discrete_ordinates.planning.plan import Differentiated, Plan, plan_request
from vrte.discrete_ordinates.planning.plan_table import count_bytes_of_derivatives
from vrte.methods import make_run, solve_request
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
        if words := find_fault(scene, one):
            raise SceneError(f"derivatives: {one.name}: {words}", "derivatives", one.name)
    return found


def find_fault(scene: Scene, variation: Variation) -> str:
    """Why there is no such derivative of a scene, otherwise empty: of a semi-infinite layer, with its thickness, and
    with its albedo where it absorbs nothing: light goes with the root of what is absorbed."""
    last, of = scene.layers[-1], variation.thickness.size
    if of != len(scene.layers):
        return f"it is of {of} layers, and the scene has {len(scene.layers)}"
    if variation.changes_nothing:
        return "it does nothing to the scene"
    if last.thickness < float("inf"):
        return ""
    if variation.thickness[-1]:
        return "a semi-infinite layer has no thickness to change"
    is_singular = last.albedo == 1.0 and variation.albedo[-1]
    return "of a semi-infinite layer the derivative with the albedo is infinite at 1" if is_singular else ""


def check_differentiable(request: Request) -> None:
    """Whether derivatives can be had of a request. Raises SceneError for another method, and for a device."""
    if request.method != EXACT:
        raise SceneError(f"derivatives are those of method {EXACT!r}, not of {request.method!r}", "derivatives")
    if request.backend.needs_device:
        words = "are found on the processor: ask for backend 'openmp' or 'sequential'"
        raise SceneError(f"derivatives {words}, not {request.backend.label!r}", "derivatives")


def find_light(
    request: Request,
    variations: Sequence[Variation] = (),
    progress: Progress | None = None,
    runtime_warned: bool = False,
) -> tuple[Array, Solution, list[Derivative]]:
    """As `solve_with_derivatives`, in a run of its own; ``runtime_warned``: how long it takes was said."""
    run = make_run(request)
    run.runtime_warned = runtime_warned
    return run_interruptible(run, lambda: solve_with_derivatives(request, variations, run, progress))


def solve_with_derivatives(
    request: Request, variations: Sequence[Variation], run: Run, progress: Progress | None = None
) -> tuple[Array, Solution, list[Derivative]]:
    """The cosines and the solution of a request with its method named, as without derivatives, and these."""
    if not variations:
        return *solve_request(request, run, progress), []
    check_differentiable(request)
    parts = 1 + len(variations)
    directions, solution = solve_request(request, run, share_progress(progress, 0, parts))

    def tell(done: int, total: int) -> None:
        assert progress is not None
        progress(100 + (100 * (parts - 1) * done) // max(total, 1), 100 * parts)

    made, nodes = solution.diagnostics, request
    if request.nodes is None:  # the derivatives are of the nodes that were found, to the accuracy of their solve
        chosen = {name: made[name] for name in ("nodes", "grading", "nodes_rule")}
        nodes = replace(request, refined=True, **chosen)
    plan = plan_request(nodes, run)
    found = differentiate(plan, variations, run, tell if progress else None, count_orders_found(made))
    how = {"derivatives": {one.variation.name: one.how for one in found}}
    return directions, replace(solution, diagnostics=made | how), found


def count_orders_found(diagnostics: Mapping[str, Any]) -> int:
    """How many Fourier orders a solution took, in the part of it that took more."""
    other = diagnostics.get("polarized_light", {})
    return max(int(diagnostics["orders"]), int(other.get("orders", 0)))


def differentiate(
    plan: Plan, variations: Sequence[Variation], run: Run, progress: Progress | None = None, orders: int | None = None
) -> list[Derivative]:
    """The derivatives of a plan's solution, by the algebra of slabs where it has them, else by differences;
    ``orders``: how many the solution took."""
    ways = plan_derivatives(plan, variations)
    how = {one: way.how for one, way in zip(variations, ways, strict=True)}
    exact = [one for one in variations if how[one] == ALGEBRA]
    others = [one for one in variations if how[one] != ALGEBRA]
    operations = count_operations_of_plan(plan) * sum(way.solves for way in ways)
    words = f"for {len(ways)} derivative{'s'[: len(ways) > 1]} beside the light"
    warn_runtime_of_derivatives(plan, operations, words, run)
    size = count_bytes_of_derivatives(replace(plan, derivatives=ways))
    check_bytes(size, "derivatives", "ask for fewer nodes, mu or phi")
    together = share_progress(progress, 0, 1 + len(others))
    found: dict[Variation, Solution] = {}
    if exact:
        try:
            found = dict(zip(exact, differentiate_plan(plan, exact, run, together, orders), strict=True))
        except AccuracyError as error:  # modes that cannot be trusted; solves have other ways
            others, how = list(variations), how | dict.fromkeys(exact, f"{BY_SOLVES} ({error})")
    for index, one in enumerate(others, 1):
        found[one] = differentiate_once(plan, one, run, share_progress(progress, index, 1 + len(others)))
    return [Derivative(one, found[one], how[one]) for one in variations]


def warn_runtime_of_derivatives(plan: Plan, operations: float, what: str, run: Run) -> None:
    """Says how long so many operations beside the light of a plan take. Raises SceneError beyond its limit."""
    seconds = operations / (cost.RATE[EXACT] * run.threads)
    words = f" {what}", "fewer nodes or derivatives take less"
    cost.warn_runtime(seconds, plan.request.time_limit_s, *words, run.runtime_warned)


def plan_derivatives(plan: Plan, variations: Sequence[Variation]) -> tuple[Differentiated, ...]:
    """How each is found of what is planned, and in how many times the operations of the light."""
    if not variations:
        return ()
    algebra = count_operations_of_derivatives(plan, 1.0, cost.ONCE) / max(1.0, count_operations_of_plan(plan))
    reasons = {one.name: find_gap(plan, one) for one in variations}
    ways = {None: (ALGEBRA, algebra)} | {
        reason: (f"{BY_SOLVES} ({reason})", cost.DIFFERENCES) for reason in reasons.values() if reason
    }
    return tuple(Differentiated(name, *ways[reason]) for name, reason in reasons.items())


def collect_jacobians(
    of: Mapping[str, str],
    there: Collection[str],
    request: Request,
    derivatives: Sequence[Derivative],
    gather: Callable[[Request, Solution], dict[str, Array]],
    find_beams: Callable[[Request], dict[str, Array]],
) -> dict[str, Any]:
    """Derivatives by attribute of a result, then by name of the number; ``of`` maps each attribute to the array that it
    differentiates, if ``there``. ``gather`` reads arrays from a solution, ``find_beams`` beams of a request."""
    changes = {
        one.variation.name: gather(request, one.solution) | differentiate_beams(request, one.variation, find_beams)
        for one in derivatives
    }
    return {
        attribute: {name: arrays[value] for name, arrays in changes.items()}
        for attribute, value in of.items()
        if value in there
    }
