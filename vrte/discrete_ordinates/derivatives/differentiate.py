"""Derivatives of what a plan asks for, one for each variation: orders, light scattered once, and fluxes."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vrte.basics.arrays import Array, IntArray, replace_unchecked
from vrte.basics.errors import SceneError
from vrte.basics.quadrature import make_refracted_nodes
from vrte.basics.running import Progress, Run
from vrte.discrete_ordinates.derivatives.changes import (
    Change,
    change_layer,
    find_changes,
    find_lowest,
    find_surface_gap,
    move_problem,
    moves_surfaces,
)
from vrte.discrete_ordinates.derivatives.once import OnceScattered
from vrte.discrete_ordinates.derivatives.semi_infinite import change_semi_infinite
from vrte.discrete_ordinates.derivatives.slab_stack import ChangedOrders, Differentiating
from vrte.discrete_ordinates.execution.carry_out import make_target
from vrte.discrete_ordinates.execution.engines.cpu import PROCESSOR, choose_threads
from vrte.discrete_ordinates.execution.sums import Light, Share, make_parts
from vrte.discrete_ordinates.execution.through_interfaces import (
    Scatter,
    Vertex,
    add_scattered,
    add_vertices,
    list_vertices,
)
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.invariance import find_allowed_residuals
from vrte.discrete_ordinates.orders.media import LEAVING, Media, find_beams, find_escapes
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.skip_flags import EVERYTHING
from vrte.discrete_ordinates.orders.truncating import count_terms_carried
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.order_bounds import list_stokes_sets
from vrte.discrete_ordinates.planning.plan import Plan, make_plan, split_by_polarization
from vrte.request.request import find_under
from vrte.results.result import Solution
from vrte.scene.beams import locate_depths
from vrte.scene.boundary import BLACK
from vrte.scene.scene import Scene
from vrte.scene.vary import Variation, turn_variation

LONGER = 10.0  # all orders are kept where tails of coefficient derivatives exceed the phase matrix's by this factor


def find_gap(plan: Plan, variation: Variation) -> str | None:
    """Why the algebra of slabs does not tell this derivative of what is planned; None where it does."""
    scene = plan.request.scene
    if plan.request.illuminate == "bottom":
        variation = turn_variation(variation)
    if scene.has_flakes:
        return "layers hold oriented flakes"
    if words := find_surface_gap(scene, variation, find_lowest(plan.problem)):
        return words
    if find_spread(plan):
        return "light of the forward peak is separated"
    if any(boundary.keeps_beams for weight, boundary in variation.base if weight) and not moves_surfaces(variation):
        return "the base mirrors beams"
    if variation.base and not moves_surfaces(variation) and not scene.below.orders_reflected:
        return "the base is black"
    if any(has_more_terms(part, variation) for part in plan.parts or (plan,)):
        return "its coefficients go beyond the last of the scene's"
    return None


def find_spread(plan: Plan) -> bool:
    """Whether light of the forward peak is separated in any part of a plan."""
    return any(part.truncation.spread != "none" and bool(part.problem.fraction.any()) for part in plan.parts or (plan,))


def check_finite(scene: Scene, variation: Variation) -> None:
    """Raises SceneError where a derivative does not exist: the albedo of a semi-infinite layer that absorbs nothing,
    whose light changes as the root of what is absorbed; the thickness of a semi-infinite layer."""
    for k, layer in enumerate(scene.layers, 1):
        if not np.isinf(layer.thickness):
            continue
        if variation.thickness[k - 1]:
            raise SceneError(f"layer {k} has no end: its thickness cannot change", "derivatives", variation.name)
        if layer.albedo == 1.0 and variation.albedo[k - 1]:
            raise SceneError(
                f"layer {k} has no end and absorbs nothing: there the derivative with its albedo is infinite, as light "
                "changes with the root of what is absorbed; ask at an albedo below 1 or for a finite thickness",
                "derivatives",
                variation.name,
            )


def differentiate_plan(
    plan: Plan, variations: Sequence[Variation], run: Run, progress: Progress | None = None, orders: int | None = None
) -> list[Solution]:
    """The derivatives of a plan's light, as solutions of which every number is a derivative.

    ``orders``: how many of its orders the light itself took, where that is known: those behind add as little to
    derivatives. Raises SceneError where one does not exist, AccuracyError where modes cannot be trusted."""
    if plan.request.illuminate == "bottom":
        variations = [turn_variation(variation) for variation in variations]
    for variation in variations:
        check_finite(plan.request.scene, variation)
    variations = put_bases_in_medium(plan, variations)
    return differentiate_parts(
        plan, lambda part: differentiate_together(shorten_plan(part, orders), variations, run, progress)
    )


def put_bases_in_medium(plan: Plan, variations: Sequence[Variation]) -> list[Variation]:
    """Variations whose bases lie in the medium that the scene's lies in."""
    medium = plan.request.scene.index_below
    return [
        replace(one, base=tuple((weight, base.put_in_medium(medium)) for weight, base in one.base))
        for one in variations
    ]


def differentiate_parts(plan: Plan, differentiate: Callable[[Plan], list[Solution]]) -> list[Solution]:
    """What is found of a plan's parts, added up."""
    found, *others = map(differentiate, plan.parts or (plan,))
    for other in others:
        found = [add_solutions(*pair) for pair in zip(found, other, strict=True)]
    return found


def shorten_plan(plan: Plan, orders: int | None) -> Plan:
    """The plan with the first of its orders alone."""
    there = np.unique([order for block in plan.blocks for order in block.orders.tolist()])
    if orders is None or orders >= there.size:
        return plan
    return replace(plan, orders=int(there[max(orders, 1) - 1]) + 1)


def add_solutions(one: Solution, other: Solution) -> Solution:
    """Both parts of polarized light together."""
    for values, more in zip(other.parts, one.parts, strict=True):
        values[..., : more.shape[-1]] += more
    up, down = (
        np.concatenate(pair, axis=-1) for pair in ((one.flux_up, other.flux_up), (one.flux_down, other.flux_down))
    )
    return Solution(other.parts, up, down, one.diagnostics)


def has_more_terms(plan: Plan, variation: Variation) -> bool:
    """Whether a variation has coefficients, of those that the nodes carry, beyond the last of all layers."""
    last = max(
        (int(np.flatnonzero(table.any(axis=1))[-1]) for table in variation.coefficients if table.any()), default=0
    )
    return min(last + 1, find_carried(plan)) > plan.problem.coefficients.shape[1]


def is_mixing_stokes(problem: Problem, scene: Scene, variation: Variation) -> bool:
    """Whether Stokes parameters that are solved apart would mix with the variation."""
    if not problem.skip_flags.stokes or scene.below.mixes_stokes:
        return False
    rows = max(problem.coefficients.shape[1], *(len(table) for table in variation.coefficients))
    here = np.pad(np.abs(problem.coefficients), ((0, 0), (0, rows - problem.coefficients.shape[1]), (0, 0)))
    moved = here.copy()
    for own, table in zip(moved, variation.coefficients, strict=True):
        own[: len(table)] += np.abs(table)
    changed = replace_unchecked(problem, coefficients=moved, albedo=problem.albedo + np.abs(variation.albedo))
    return list_stokes_sets(changed) != list_stokes_sets(replace_unchecked(problem, coefficients=here))


def is_longer(plan: Plan, variation: Variation) -> bool:
    """Whether a variation has more of the coefficients beyond the orders that are solved than the light itself, each
    over the largest: the orders that matter are those of the light else."""
    for layer, table in zip(plan.request.scene.layers, variation.coefficients, strict=True):
        mine, own = (
            np.abs(part).max(axis=1) / (2.0 * np.arange(part.shape[0]) + 1.0) if part.any() else np.zeros(1)
            for part in (table, layer.phase_matrix.coefficients)
        )
        beyond = mine[plan.orders :].max(initial=0.0) * own.max()
        if beyond > LONGER * own[plan.orders :].max(initial=0.0) * mine.max() and beyond > 0.0:
            return True
    return False


def differentiate_together(
    plan: Plan, variations: Sequence[Variation], run: Run, progress: Progress | None
) -> list[Solution]:
    """Of a plan without parts: all Stokes parameters together for variations that mix those it keeps apart, and all
    orders for those that reach farther than the light."""
    groups: dict[tuple[bool, bool], list[Variation]] = {}
    for one in variations:
        key = is_mixing_stokes(plan.problem, plan.request.scene, one), is_longer(plan, one)
        groups.setdefault(key, []).append(one)
    found: dict[Variation, Solution] = {}
    for (mixing, longer), members in groups.items():
        whole = plan
        if mixing or longer:
            less = replace(EVERYTHING, stokes=not mixing, orders=not longer)
            truncation = replace(plan.truncation, whole=mixing)
            whole = make_plan(plan.request, run, less, (plan.choice, plan.accuracy), truncation)
            whole = split_by_polarization(whole, run)
        solutions = differentiate_parts(
            whole, partial(differentiate_part, variations=members, run=run, progress=progress)
        )
        found.update(zip(members, solutions, strict=True))
    return [found[one] for one in variations]


def differentiate_part(
    plan: Plan, variations: Sequence[Variation], run: Run, progress: Progress | None
) -> list[Solution]:
    """Of a plan without parts."""
    start = time.perf_counter()
    request = plan.request
    routes = Routes(plan, variations)
    lights: list[list[Light]] = [[] for _ in variations]
    flux = np.zeros((len(variations), 2, request.tau.size, request.mu0.size, request.columns.shape[0]))
    worst, done, total = 0.0, 0, sum(block.orders.size for block in plan.blocks) + len(variations)
    with PROCESSOR.at_work():
        for block in plan.blocks:
            orders = block.orders[block.orders < plan.orders]
            if not orders.size:
                continue
            for some, found in differentiate_block(routes, block, orders, run):
                worst = max(worst, float(found.residual.max()))
                for k in range(len(variations)):
                    lights[k].append(
                        Light(
                            some, np.array(block.stokes, np.int32), np.array(block.columns, np.int32), found.kernels[k]
                        )
                    )
                if some[0] == 0:
                    flux[..., list(block.columns)] += found.flux
                done += some.size
                if progress is not None:
                    progress(done, total)
        values = add_up_all(routes, lights, run)
        if progress is not None:
            progress(total, total)
    flux += change_peak_fluxes(routes)
    diagnostics = {"residual_of_modes": worst, "wall_seconds": time.perf_counter() - start}
    return [Solution(own, up, down, dict(diagnostics)) for own, (up, down) in zip(values, flux, strict=True)]


class Routes:
    """The ways through a plan's blocks, which share media, beams and how variations change these."""

    def __init__(self, plan: Plan, variations: Sequence[Variation]) -> None:
        self.plan, self.variations = plan, variations
        self.problem, self.carried = put_in_media(plan), find_carried(plan)
        self.media: dict[tuple[int, bool, int], Media] = {}
        self.known: dict[Media, tuple[BeamPaths, list[tuple[Change, Array | None]]]] = {}

    def make(self, block: Block, last: int) -> Differentiating:
        """The way through a block, up to an order."""
        own = block.problem
        if own.media is None:
            key = own.thickness.size, bool(np.isinf(own.thickness[-1])), own.nodes.size
            whole = self.problem
            assert whole.media is not None
            if key == (whole.thickness.size, bool(np.isinf(whole.thickness[-1])), whole.nodes.size):
                self.media[key] = whole.media
            elif key not in self.media:
                self.media[key] = put_block_in_media(self.plan, block)
            own = replace_unchecked(own, media=self.media[key])
        return Differentiating(own, block.base, last + 1, self.plan.accuracy, self.find_changes(own)[1])

    def find_changes(self, problem: Problem) -> tuple[BeamPaths, list[tuple[Change, Array | None]]]:
        """The beams of a problem in media, how these change with each variation, and the light that escapes from the
        sources of all pieces and of the base."""
        assert problem.media is not None
        if problem.media not in self.known:
            whole = replace_unchecked(problem, stokes=ALL, columns=self.problem.columns)
            beam_paths = BeamPaths(whole, BLACK, 1, 1.0)
            sources = list_all_sources(beam_paths)
            given = self.plan.request.scene, self.variations, self.carried, sources
            self.known[problem.media] = beam_paths, find_changes(beam_paths, *given)
        return self.known[problem.media]


def list_all_sources(beam_paths: BeamPaths) -> Array:
    """The sources of a stack and that of its base, whether this reflects or not, (source, 2)."""
    found: Array = np.array([*beam_paths.sources, (beam_paths.cut.interface.size - 1, LEAVING)])
    return found


def differentiate_block(
    routes: Routes, block: Block, orders: IntArray, run: Run
) -> Iterator[tuple[IntArray, ChangedOrders]]:
    """Some of a block's orders at a time, with their derivatives: by invariance what its light is found by, but for
    orders that this does not verify, and through slabs all else."""
    plan, own_run = routes.plan, choose_threads(run, block.problem, orders)
    if block.choice.name == "invariance" and block.problem.media is None:
        tables = [
            change_layer(plan.problem, plan.request.scene, 0, variation, routes.carried).scattering
            for variation in routes.variations
        ]
        found = change_semi_infinite(block.problem, tables, orders, plan.accuracy, own_run)
        good = found.residual <= find_allowed_residuals(plan.accuracy)["residual_of_invariance"]
        if good.any():
            yield orders[good], ChangedOrders(found.kernels[:, good], found.flux, np.zeros(1))
        orders = orders[~good]
    if orders.size:
        route = routes.make(block, int(orders[-1]))
        step = route.chunk(run.threads)
        for first in range(0, orders.size, step):
            some = orders[first : first + step]
            yield some, route.differentiate(some, own_run)


def add_up_all(routes: Routes, lights: list[list[Light]], run: Run) -> list[list[Array]]:
    """For each variation its orders and what is scattered once, as the parts that are wanted."""
    target, (beam_paths, known) = (
        replace_unchecked(make_target(routes.plan), problem=routes.problem),
        routes.find_changes(routes.problem),
    )
    wanted, problem, media, sights = target.wanted, routes.problem, beam_paths.media, beam_paths.sights
    escapes = find_escapes(media, beam_paths.cut, sights, problem.n_up, list(ALL), list_all_sources(beam_paths))
    once = OnceScattered(beam_paths, routes.plan.request.scene.below, escapes, target.azimuths, run)
    scattered: dict[Scatter, list[tuple[int, Vertex]]] = {}  # what several variations share is found once
    parts = []
    for k, (own, change) in enumerate(zip(lights, known, strict=True)):
        parts.append(make_parts(target))
        add_orders = PROCESSOR.prepare_orders(target, own, replace(run, threads=1))
        for part in parts[-1]:
            add_orders(Share(part, 0, wanted.scale.size))
        for vertex in once.differentiate(*change):
            scattered.setdefault(vertex.scatter, []).append((k, vertex))
        for weight, moved in change[0].moved:
            one = move_problem(replace_unchecked(problem, stokes=ALL), moved)
            own_sights, vertices = list_vertices(one, moved.scene.below, target.azimuths, run)
            weighted = [vertex.weigh(weight * wanted.scale) for vertex in vertices]
            for part in parts[-1]:
                given = problem.n_up, part.levels, part.rows, wanted.place, part.values
                add_vertices(own_sights, weighted, *given)
    for scatter, pairs in scattered.items():
        found = scatter(0, wanted.scale.size)
        for k, vertex in pairs:
            for part in parts[k]:
                given = problem.n_up, part.levels, part.rows, wanted.place, part.values
                add_scattered(sights, vertex.weigh(wanted.scale), found, *given)
    return [[part.values for part in some] for some in parts]


def find_carried(plan: Plan) -> int:
    """How many terms of a phase matrix the nodes of a plan carry."""
    return count_terms_carried(plan.request.scene, plan.choice.nodes)


def put_in_media(plan: Plan) -> Problem:
    """A plan's problem as one of several media, of which a transparent stack has only one."""
    problem, request = plan.problem, plan.request
    if problem.media is not None:
        return problem
    nodes = make_refracted_nodes(request.scene.media, problem.nodes.size, problem.grading, request.scene.indices)
    depths = locate_depths(request.scene, request.tau, find_under(request))
    return replace_unchecked(problem, media=Media(request.scene, nodes, depths))


def put_block_in_media(plan: Plan, block: Block) -> Media:
    """The same of a block: on its nodes, and down to where its light reaches."""
    request, problem, scene = plan.request, block.problem, plan.request.scene
    reached, semi_infinite = problem.thickness.size, bool(np.isinf(problem.thickness[-1]))
    layers = list(scene.layers[:reached])
    if semi_infinite:
        layers[-1] = replace(layers[-1], thickness=np.inf)
    seen = Scene(layers, scene.base if reached == len(scene.layers) and not semi_infinite else None)
    whole, count = plan.problem, problem.nodes.size
    all_ = make_refracted_nodes(scene.media, whole.nodes.size, whole.grading, scene.indices)
    nodes = replace(all_, highest=all_.highest[:count], depth=all_.depth[:count], measure=all_.measure[:count])
    return Media(seen, nodes, locate_depths(seen, request.tau, find_under(request)))


def change_peak_fluxes(routes: Routes) -> Array:
    """Derivatives with each variation of the flux that forward peaks take along with the beam, (variation, 2, n_tau,
    n_in, n_col): that of the beam in truncated layers less that of the true one."""
    problem, (beam_paths, known) = routes.problem, routes.find_changes(routes.problem)
    found = np.zeros((len(known), 2, problem.level.size, problem.mu0.size, problem.columns.shape[0]))
    if not problem.fraction.any():
        return found
    plain = beam_paths.media.scene.layers
    stretch = np.array([1.0 - f * layer.albedo for f, layer in zip(problem.fraction, plain, strict=True)])
    true = replace_unchecked(
        problem,
        thickness=np.array([layer.thickness for layer in plain]),
        fraction=np.zeros(len(plain)),
        level=problem.level / stretch[problem.level_layer],
    )
    straight = BeamPaths(true, BLACK, 1, 1.0)
    given = routes.plan.request.scene, routes.variations, routes.carried, list_all_sources(straight)
    others = find_changes(straight, *given)
    for one, changes, sign in ((beam_paths, known, 1.0), (straight, others, -1.0)):
        for k, (change, _) in enumerate(changes):
            weighted = [] if change.beams is None else [(sign, change.beams)]
            weighted += [(sign * weight, find_beams(media, one.cut, problem.mu0)[1]) for weight, media in change.moved]
            for weight, beams in weighted:
                for t, (at, under) in enumerate(zip(one.cut.at.tolist(), one.media.depths.under.tolist(), strict=True)):
                    ways = (beams.rising, beams.entering) if under else (beams.leaving, beams.arriving)
                    light = np.stack([way[at, :, 0] for way in ways]) @ problem.columns.T
                    found[k, :, t] += weight * light * problem.mu0[:, None]
    return found
