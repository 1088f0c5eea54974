"""Derivatives of solves by differences of solves, all on the nodes and with the truncation of the one in the middle."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.differences import FARTHEST, STEP, sample_around
from vrte.basics.errors import SceneError
from vrte.basics.running import Progress, Run, share_progress
from vrte.discrete_ordinates.orders.discretise import place_levels
from vrte.discrete_ordinates.planning.plan import Plan, make_plan, split_by_polarization
from vrte.methods.discrete_ordinates import solve_plans
from vrte.request.request import Request
from vrte.results.solution import Solution
from vrte.scene.scene import LEAST_STEP, Scene
from vrte.scene.variation import Variation
from vrte.scene.vary import measure_base_rate, move_scene, turn_variation

FINEST = 1e-14  # accuracy of each solve: what is left out, and iterates, would show in the differences
MOST_NEGATIVE = 0.1  # of the mean of F11, that a step may take off phase matrices
DIFFUSES = 0.8  # over the square of a thickness: absorption that it notices, pi^2/12


def differentiate_once(plan: Plan, variation: Variation, run: Run, progress: Progress | None = None) -> Solution:
    """The derivative of a plan's solution with one variation, as a solution: by five points, four solves or five.

    Each solve has the nodes and the truncation of the plan, and leaves nothing out that is not lost in rounding. Depths
    at the faces of layers stay there, others where they are below the top of all. Raises SceneError where there is no
    derivative: a bound on either side of the number.
    """
    scenes = sample_scenes(plan.request, variation)
    plans = [plan_batch(plan, scene, run) for _, scene in scenes]
    sums: list[Array] = []
    for index, ((weight, _), each) in enumerate(zip(scenes, plans, strict=True)):
        (found,) = solve_plans([each], run, share_progress(progress, index, len(plans)))
        weighted = [weight * array for array in (found.flux_up, found.flux_down, *found.parts)]
        sums = [one + other for one, other in zip(sums, weighted, strict=True)] if sums else weighted
    return Solution(sums[2:], sums[0], sums[1], found.diagnostics)


def differentiate_beams(
    request: Request, variation: Variation, find: Callable[[Request], dict[str, Array]]
) -> dict[str, Array]:
    """The derivatives of light that meets no particle, arrays that ``find`` has of a request of another scene."""
    here = find(request)  # what does not change then cancels to the last digit
    total = {name: np.zeros_like(values) for name, values in here.items()}
    for weight, scene in sample_scenes(request, variation, beams=True):
        for name, values in find(place_request(request, scene)).items():
            total[name] += weight * (values - here[name])
    return total


def sample_scenes(request: Request, variation: Variation, beams: bool = False) -> list[tuple[float, Scene]]:
    """Weights and scenes, as the request's light meets them, whose weighted light, or its ``beams``, is the derivative.
    Raises SceneError where a bound is on either side."""
    if request.illuminate == "bottom":
        variation = turn_variation(variation)
    # steps are those of the number itself where ingredients do not say all, and of facets, whose lobes are averaged
    # over the nodes as long as nothing is added to them
    facets = any(part.facets is not None for _, part in variation.base)
    if variation.scene_at is not None and (variation.is_outside or facets):
        return sample_around(variation.scene_at, variation.value, find_whole_step(request, variation))
    return sample_around(lambda at: move_scene(request.scene, variation, at), 0.0, find_step(request, variation, beams))


def find_whole_step(request: Request, variation: Variation) -> float:
    """How far to go with the number itself: a small share of it, of what two media that it moves differ by, and of what
    bends the flattest direction's light along a medium that it moves."""
    assert variation.scene_at is not None
    step = STEP * (abs(variation.value) or 1.0)
    media = np.array(request.scene.media)
    outside, lowest = media[0], find_lowest_cosine(request)
    for way in (step, -step):
        try:
            after = np.array(variation.scene_at(variation.value + way).media)
        except SceneError:  # a bound, or too far already: steps from there on say which
            continue
        bent = np.abs(media**2 - outside**2 * (1.0 - lowest**2)) / (2.0 * media)
        room = np.concatenate([np.abs(np.diff(media)), np.maximum(bent, 4.0 * LEAST_STEP / STEP)])
        moved = np.abs(np.concatenate([np.diff(after - media), after - media - (after[0] - outside)]))
        close = (moved > 0.0) & (room > 0.0)
        return float(min(step, (step * STEP * room[close] / moved[close]).min(initial=np.inf)))
    return step


def plan_batch(plan: Plan, scene: Scene, run: Run) -> Plan:
    """A plan's request of another scene, on its nodes and with its truncation, nothing left out."""
    known, request = (plan.choice, FINEST), place_request(plan.request, scene)
    found = make_plan(request, run, known=known, truncation=plan.truncation)
    if not plan.parts:
        return split_by_polarization(found, run)  # a step may polarize what a scalar scene does not
    return replace(found, parts=tuple(plan_batch(part, scene, run) for part in plan.parts))


def place_request(request: Request, scene: Scene) -> Request:
    """The same asked of another scene, whose layers may have other thicknesses: depths at faces of layers stay there,
    all others stay where they are below the top of all."""
    given, now = (np.array([layer.thickness for layer in one.layers]) for one in (request.scene, scene))
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
    """Of the beams and of the directions asked for."""
    seen = [request.mu0] if request.mu is None else [request.mu0, np.abs(request.mu)]
    return float(np.concatenate(seen).min())


def find_step(request: Request, variation: Variation, beams: bool) -> float:
    """How far to go along a variation: a small share of that in which light changes by something like itself.

    Thickness: of itself, or of the flattest direction's cosine, of this alone for beams. Albedo: of what is absorbed,
    or would matter beside diffusion through the layers down to it. Coefficients: of 2 l + 1, the largest they can be.
    Bases: of all that they reflect, with what is lost between them and the layers.
    """
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
