"""Derivatives of what a call finds: which are asked for, and how each is found, by the algebra of slabs or by
differences of solves, all on the nodes and with the truncation of the one in the middle."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray, check_list, put_in_one_line
from vrte.basics.differences import FARTHEST, STEP, sample_around
from vrte.basics.errors import AccuracyError, SceneError
from vrte.basics.memory import check_bytes
from vrte.basics.running import Progress, Run, run_interruptible, share_progress
from vrte.discrete_ordinates.derivatives.changes import find_whole_step
from vrte.discrete_ordinates.derivatives.differentiate import differentiate_plan, find_gap
from vrte.discrete_ordinates.orders.discretise import place_levels
from vrte.discrete_ordinates.planning.operations import count_operations_of_derivatives, count_operations_of_plan
from vrte.discrete_ordinates.planning.plan import Differentiated, Plan, make_plan, plan_request, split_by_polarization
from vrte.discrete_ordinates.planning.plan_table import count_bytes_of_derivatives
from vrte.methods import make_run, solve_request
from vrte.methods.discrete_ordinates import solve_plans
from vrte.request.how import EXACT
from vrte.request.request import Request
from vrte.results.result import Solution
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation, measure_base_rate, move_scene, turn_variation, vary_scene

FINEST = 1e-14  # accuracy of each solve: what is left out, and iterates, would show in the differences
MOST_NEGATIVE = 0.1  # of the mean of F11, that a step may take off phase matrices
DIFFUSES = 0.8  # over the square of a thickness: absorption that it notices, pi^2/12


def differentiate_once(plan: Plan, variation: Variation, run: Run, progress: Progress | None = None) -> Solution:
    """The derivative of a plan's solution with one variation, by five points. Raises SceneError at bounds."""
    scenes = sample_scenes(plan.request, variation)
    plans = [plan_batch(plan, scene, run) for _, scene in scenes]
    sums: list[Array] = []
    for index, ((weight, _), each) in enumerate(zip(scenes, plans, strict=True)):
        (found,) = solve_plans([each], run, share_progress(progress, index, len(plans)))
        weighted = [weight * array for array in (found.flux_up, found.flux_down, *found.parts)]
        sums = [one + other for one, other in zip(sums, weighted, strict=True)] if sums else weighted
    return Solution(sums[2:], sums[0], sums[1], found.diagnostics)


def differentiate_beams(
    request: Request, variation: Variation, find: Callable[[Request], dict[str, Array]], here: dict[str, Array]
) -> dict[str, Array]:
    """Derivatives of light that meets no particle, arrays that ``find`` has of a request, and ``here`` of this one."""
    total = {name: np.zeros_like(values) for name, values in here.items()}
    mirrors = any(boundary.keeps_beams for weight, boundary in variation.base if weight)
    if not (variation.thickness.any() or variation.is_outside or mirrors):
        return total
    for weight, scene in sample_scenes(request, variation, beams=True):
        for name, values in find(place_request(request, scene)).items():
            total[name] += weight * (values - here[name])
    return total


def sample_scenes(request: Request, variation: Variation, beams: bool = False) -> list[tuple[float, Scene]]:
    """Weights and scenes whose weighted light, or ``beams``, is the derivative. Raises SceneError at bounds."""
    if request.illuminate == "bottom":
        variation = turn_variation(variation)
    # steps are those of the number itself where ingredients do not say all, and of facets, whose lobes are averaged
    # over the nodes as long as nothing is added to them
    facets = any(part.facets is not None for _, part in variation.base)
    if variation.scene_at is not None and (variation.is_outside or facets):
        return sample_around(
            variation.scene_at, variation.value, find_whole_step(request.scene, variation, find_lowest_cosine(request))
        )
    return sample_around(lambda at: move_scene(request.scene, variation, at), 0.0, find_step(request, variation, beams))


def plan_batch(plan: Plan, scene: Scene, run: Run) -> Plan:
    """A plan's request of another scene, on its nodes and with its truncation, nothing left out."""
    known, request = (plan.choice, FINEST), place_request(plan.request, scene)
    found = make_plan(request, run, known=known, truncation=plan.truncation)
    if not plan.parts:
        return split_by_polarization(found, run)  # a step may polarize what a scalar scene does not
    return replace(found, parts=tuple(plan_batch(part, scene, run) for part in plan.parts))


def place_request(request: Request, scene: Scene) -> Request:
    """The same asked of a scene of other thicknesses: depths at faces stay there, others below the top of all."""
    given, now = (np.array([layer.extent for layer in one.layers]) for one in (request.scene, scene))
    tau = request.tau
    if request.kind == "brdf":
        tau = np.array([0.0, scene.thickness])[: tau.size]
    elif not np.array_equal(given, now):
        at, upper, lower = find_faces(request)
        faces = np.concatenate([[0.0], np.cumsum(now)])
        found = np.where(upper, faces[at], np.where(lower, faces[at + 1], tau))
        tau = np.where(tau >= request.scene.thickness, scene.thickness, np.where(found > 0.0, found, 0.0))
    return replace(request, scene=scene, tau=tau, verify=False)


def find_faces(request: Request) -> tuple[IntArray, BoolArray, BoolArray]:
    """The layer that each depth lies in, and whether it lies at its upper face, and at its lower one, (n_tau,)."""
    thickness = np.array([layer.thickness for layer in request.scene.layers])
    (level,), at = place_levels(request.tau[None], [request.scene])
    return at, level == 0.0, level == thickness[at]


def find_lowest_cosine(request: Request) -> float:
    """The lowest cosine of the beams and of the wanted directions."""
    seen = [request.mu0] if request.mu is None else [request.mu0, np.abs(request.mu)]
    return float(np.concatenate(seen).min())


def find_step(request: Request, variation: Variation, beams: bool) -> float:
    """The step along a variation: a small part of that in which light changes by something like itself (thickness: of
    itself or the flattest cosine; albedo: of absorption; coefficients: of 2 l + 1; bases: of reflection)."""
    scene = request.scene
    thickness, albedo = (np.array([getattr(one, name) for one in scene.layers]) for name in ("thickness", "albedo"))
    lowest = find_lowest_cosine(request)
    total = scene.thickness
    absorbed = np.minimum(1.0, 1.0 - albedo + DIFFUSES / np.maximum(np.cumsum(thickness), 1.0) ** 2)
    with np.errstate(divide="ignore"):
        reach = lowest + (0.0 if beams else np.minimum(thickness, 1e300))
        rates = np.abs(variation.thickness) / reach + np.divide(
            np.abs(variation.albedo), absorbed, out=np.zeros(albedo.size), where=variation.albedo != 0.0
        )
    degrees = [np.abs(table) / (2.0 * np.arange(len(table))[:, None] + 1.0) for table in variation.coefficients]
    rate = float(rates.sum()) + sum(float(table.max(initial=0.0)) for table in degrees)
    even = max(1.0 - scene.below.even_albedo, 0.0) + 1.0 / (1.0 + total)
    rate += measure_base_rate(scene, variation) / min(1.0, even)
    taken_off = max(float(np.abs(table).sum()) for table in variation.coefficients)
    moved = float(np.abs(variation.thickness).sum())
    _, upper, lower = find_faces(request)
    inside = request.tau[~(upper | lower)]
    faces = np.concatenate([[0.0], np.cumsum(thickness[np.isfinite(thickness)])])
    room = float(np.abs(inside[:, None] - faces).min(initial=np.inf)) if request.kind != "brdf" else np.inf
    return min(
        STEP / rate,
        MOST_NEGATIVE / taken_off if taken_off else np.inf,
        room / (2.0 * FARTHEST * moved) if moved else np.inf,  # no face passes a depth
    )


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
    """The variations asked for, names looked up in the scene. Raises SceneError for unknown, idle or double ones."""
    if derivatives is None:
        return []
    several = (derivatives,) if isinstance(derivatives, str | Variation) else derivatives
    given = check_list("derivatives", several, MOST_DERIVATIVES)
    found = [one if isinstance(one, Variation) else vary_scene(scene, one) for one in given]
    names = [one.name for one in found]
    for one in found:
        if names.count(one.name) > 1:
            raise SceneError(f"derivatives: {put_in_one_line(one.name)} is asked for twice", "derivatives", one.name)
        if words := find_fault(scene, one):
            raise SceneError(f"derivatives: {put_in_one_line(one.name)}: {words}", "derivatives", one.name)
    return found


def find_fault(scene: Scene, variation: Variation) -> str:
    """Why a scene has no such derivative, or "": thickness or white albedo of a semi-infinite layer."""
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
    """`solve_with_derivatives` in a run of its own; ``runtime_warned``: no second warning of a long solve."""
    run = make_run(request)
    run.runtime_warned = runtime_warned
    return run_interruptible(run, lambda: solve_with_derivatives(request, variations, run, progress))


def solve_with_derivatives(
    request: Request, variations: Sequence[Variation], run: Run, progress: Progress | None = None
) -> tuple[Array, Solution, list[Derivative]]:
    """The cosines, the solution (the same as without derivatives) and the derivatives of a request."""
    if not variations:
        return *solve_request(request, run, progress), []
    check_differentiable(request)
    parts, run.kept = 1 + len(variations), {}
    directions, solution = solve_request(request, run, share_progress(progress, 0, parts))

    def report(done: int, total: int) -> None:
        assert progress is not None
        progress(100 + (100 * (parts - 1) * done) // max(total, 1), 100 * parts)

    made, nodes = solution.diagnostics, request
    if request.nodes is None:  # the derivatives are of the nodes that were found, to the accuracy of their solve
        chosen = {name: made[name] for name in ("nodes", "grading", "nodes_rule")}
        nodes = replace(request, refined=True, **chosen)
    plan = plan_request(nodes, run)
    found = differentiate(plan, variations, run, report if progress else None, count_orders_found(made))
    how = {"derivatives": {one.variation.name: one.how for one in found}}
    return directions, replace(solution, diagnostics=made | how), found


def count_orders_found(diagnostics: Mapping[str, Any]) -> int:
    """The number of Fourier orders of a solution, in the part of it with more."""
    other = diagnostics.get("polarized_light", {})
    return max(int(diagnostics["orders"]), int(other.get("orders", 0)))


def differentiate(
    plan: Plan, variations: Sequence[Variation], run: Run, progress: Progress | None = None, orders: int | None = None
) -> list[Derivative]:
    """Derivatives of a plan's solution, by the algebra of slabs or by differences; ``orders``: of the solution."""
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
    """Derivatives by attribute and name of number of arrays ``there``, from solutions and from beams of requests."""
    here = find_beams(request) if derivatives else {}
    changes = {
        one.variation.name: gather(request, one.solution)
        | differentiate_beams(request, one.variation, find_beams, here)
        for one in derivatives
    }
    return {
        attribute: {name: arrays[value] for name, arrays in changes.items()}
        for attribute, value in of.items()
        if value in there
    }
