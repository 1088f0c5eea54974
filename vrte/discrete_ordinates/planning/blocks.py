"""Fourier orders that are solved alike: the same Stokes parameters, layers and algorithm."""

import itertools
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array, BoolArray, IntArray, record, replace_unchecked
from vrte.discrete_ordinates.orders.base import EvenBases
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.single_interface import is_under_one_surface
from vrte.discrete_ordinates.planning.choice import (
    Choice,
    DoublingSteps,
    choose_algorithms,
    count_all_doubling_steps,
    find_scenes_for_modes,
)
from vrte.discrete_ordinates.planning.facet_bounds import couples_orders
from vrte.discrete_ordinates.planning.order_bounds import (
    OrderBounds,
    Sets,
    find_bottoms_seen,
    list_layers_reached,
    list_stokes_sets,
)
from vrte.request.how import BY_RULE
from vrte.scene.boundary import BLACK, Boundary

TRAPPED = 30.0  # largest gain by internal reflection at a surface, in light returned from a depth


@record
class Block:
    """orders (k,), the Stokes parameters and the incident columns (places in the request's) they are solved for, the
    reduced problem and its base, and which algorithm takes it. Of several scenes ``wanted`` (k, scene) says which
    orders each of them needs."""

    orders: IntArray
    stokes: tuple[int, ...]
    columns: tuple[int, ...]
    problem: Problem
    base: Boundary
    choice: Choice
    wanted: BoolArray | None = None


class Part(NamedTuple):
    """What makes two orders alike; ``stage``: how many times what was found is looked at before they are solved;
    ``straight``: the Stokes parameters that light them along the normal."""

    stage: int
    stokes: tuple[int, ...]
    straight: tuple[int, ...]
    layers: int
    has_end: bool


@lru_cache(maxsize=64)
def sort_orders(
    sets: Sets, stages: tuple[int, ...], along_normal: bool, reached: tuple[tuple[int, bool], ...]
) -> tuple[tuple[tuple[Part, IntArray], ...], bool]:
    """The orders, of which ``sets`` and ``reached`` tell what is solved of each, that are alike; ascending, and I
    before V. And whether `are_solved_at_once`."""
    parts: dict[Part, list[int]] = {}
    for order, (found, depth) in enumerate(zip(sets, reached, strict=True)):
        stage, straight = sum(order >= first for first in stages), find_normal_stokes(order) if along_normal else ALL
        for stokes in found:
            parts.setdefault(Part(stage, stokes, straight, *depth), []).append(order)
    ordered = sorted(parts.items(), key=lambda item: (item[1][0], item[0].stokes))
    members = [np.array(found, np.int32) for _, found in ordered]
    for each in members:
        each.setflags(write=False)  # shared by all who ask
    return tuple(zip((part for part, _ in ordered), members, strict=True)), are_solved_at_once(members)


def are_solved_at_once(orders: Sequence[IntArray]) -> bool:
    """Whether the orders of all blocks are solved without a second look at how many are left: where no block begins
    beyond the orders of those before it.

    >>> are_solved_at_once([np.array([0]), np.array([0, 1]), np.array([1, 2])])
    True
    """
    return all(then[0] <= before[-1] for before, then in itertools.pairwise(orders))


def make_blocks(
    problem: Problem,
    base: Boundary,
    count: int,
    stages: tuple[int, ...],
    needs: OrderBounds,
    accuracy: float,
    algorithm: str,
    eigensolver: bool = True,
) -> list[Block]:
    """So many orders of one scene, sorted into blocks. No block goes across the orders in ``stages``."""
    base_couples_orders, skip_flags = couples_orders(problem, base), problem.skip_flags
    sets: Sets = ((ALL,),) * count
    if skip_flags.stokes and not base.mixes_stokes:
        sets = list_stokes_sets(problem)[0][:count]
        rough = any(problem.oriented) or (problem.media is not None and problem.media.scene.is_rough)
        if (
            rough and base_couples_orders
        ):  # facets and flakes scatter all of them, and at order 0 keep (I, Q) and (U, V) apart
            sets = (((0, 1), (2, 3)), *[(ALL,)] * (count - 1))
    along_normal = skip_flags.normal and is_along_normal(problem)
    reached = ((problem.albedo.size, not bool(np.isinf(problem.thickness[-1]))),) * count
    if skip_flags.depth and not base_couples_orders:
        reached = find_ends_seen(problem, needs, accuracy)[0][:count]
    steps: dict[tuple[int, bool], DoublingSteps] = {}
    blocks, lit = [], list_lit_stokes(problem)
    for part, members in sort_orders(sets, stages, along_normal, reached)[0]:
        columns = find_lit_columns(problem, part, lit, along_normal)
        if not columns:
            continue
        reduced = reduce_problem(problem, part, columns)
        is_first = int(members[0]) == 0
        seen = base_couples_orders or (is_first and part.stokes[0] == 0) or not skip_flags.base
        below = base if part.has_end and seen else BLACK
        strength = needs.strength[0, members]
        if is_first and not problem.is_exact:  # whose flux invariance would not conserve to rounding
            strength = np.concatenate([[1.0], strength[1:]])
        alone, depth = members if below is BLACK else None, (part.layers, part.has_end)
        asked = algorithm, reduced, strength, accuracy, eigensolver, alone
        if depth not in steps and eigensolver and algorithm in BY_RULE:
            steps[depth] = count_all_doubling_steps(reduced)[0]
        for indices, choice in choose_algorithms(*asked, steps.get(depth)):
            blocks.append(Block(members[indices], part.stokes, columns, reduced, below, choice))
    return blocks


def make_shared_blocks(
    problem: Problem, bases: Sequence[Boundary], counts: IntArray, needs: OrderBounds, accuracy: float, algorithm: str
) -> tuple[list[Block], BoolArray]:
    """The orders of many scenes by modes, so many of each, in blocks that are alike; and which scenes they stand for,
    (scene,): for others, by themselves, another algorithm is chosen, fewer layers, or several looks at how many orders
    are left."""
    along_normal, there = is_along_normal(problem), list_lit_stokes(problem)
    may_end = problem.layers > 1 or algorithm != "auto"  # invariance is for one layer without an end
    fits, shape = np.ones(problem.scenes, bool), (problem.coefficients.shape[1], problem.scenes)
    wanted: dict[Part, BoolArray] = {}
    lit: dict[Part, tuple[int, ...]] = {}
    kinds: dict[tuple[Any, ...], list[int]] = {}  # scenes with the same parts
    of_scenes = counts.tolist(), list_stokes_sets(problem), find_ends_seen(problem, needs, accuracy)
    for index, kind in enumerate(zip(*of_scenes, strict=True)):
        kinds.setdefault(kind, []).append(index)
    for (count, sets, ends), indices in kinds.items():
        parts = sort_orders(sets[:count], (), along_normal, ends[:count])[0]
        lit |= {part: find_lit_columns(problem, part, there, along_normal) for part, _ in parts}
        parts = tuple((part, members) for part, members in parts if lit[part])
        at_once = not is_worth_stages(problem, count) or are_solved_at_once([members for _, members in parts])
        fits[indices] = at_once and all([p.layers == problem.layers and (p.has_end or may_end) for p, _ in parts])
        for part, members in parts if fits[indices[0]] else ():
            wanted.setdefault(part, np.zeros(shape, bool))[members[:, None], indices] = True
    reduced = {part: reduce_problem(problem, part, lit[part]) for part in wanted}
    steps: dict[bool, list[DoublingSteps]] = {}
    for part, which in wanted.items():
        if part.has_end not in steps:
            steps[part.has_end] = count_all_doubling_steps(reduced[part])
        for_modes = find_scenes_for_modes(reduced[part], steps[part.has_end], algorithm, accuracy)
        fits &= for_modes | ~which.any(axis=0)
    blocks: list[Block] = []
    below, choice = EvenBases(tuple(bases)), Choice("modes", "many scenes that are alike")
    for part, which in wanted.items():
        orders = np.flatnonzero((which & fits).any(axis=1)).astype(np.int32)
        if orders.size:
            own = reduced[part], below if part.has_end else BLACK, choice, (which & fits)[orders]
            blocks.append(Block(orders, part.stokes, lit[part], *own))
    return sorted(blocks, key=lambda block: (int(block.orders[0]), block.stokes)), fits


def is_worth_stages(problem: Problem, orders: int) -> bool:
    """Whether it pays to look again, between orders, at how many are left: a block more takes as long as small ones."""
    if orders * float(problem.size) ** 3 <= cost.WORTH_STAGES:
        return False
    return not problem.is_scalar or orders * float(problem.nodes.size) ** 3 > cost.WORTH_STAGES


def is_along_normal(problem: Problem) -> bool:
    """Whether all light comes, or all is seen, along the normal."""
    return bool((problem.mu0 == 1.0).all() or (problem.mu_out == 1.0).all())


def find_ends_seen(problem: Problem, needs: OrderBounds, accuracy: float) -> list[tuple[tuple[int, bool], ...]]:
    """How many layers light of each order of each scene comes back from, and whether from the end of the last; under
    surfaces the layers stay those that these lie between."""
    n_order, media, layers = problem.coefficients.shape[1], problem.media, problem.layers
    careful = 1.0 if media is None else TRAPPED
    found = [((layers, True),) * n_order] * problem.scenes
    for index, is_seen in enumerate(find_bottoms_seen(problem, accuracy / careful)):
        if not is_seen:
            strengths = needs.by_layer[index * layers : (index + 1) * layers]
            found[index] = list_layers_reached(problem.select_scene(index), strengths, accuracy / careful)
            if media is not None:
                ends = not is_under_one_surface(media)
                found[index] = tuple([(layers, end or ends or k < layers) for k, end in found[index]])
    return found


def find_normal_stokes(order: int) -> tuple[int, ...]:
    """At normal incidence I and V have order 0 alone, Q and U order 2; at normal exit those orders alone are left."""
    return {0: (0, 3), 2: (1, 2)}.get(order, ())


def explain_normal(problem: Problem) -> str:
    """Why orders that are zero along the normal are left out, "" where they are not."""
    for name, cosines in (("incidence", problem.mu0), ("exit", problem.mu_out)):
        if (cosines == 1.0).all():
            return f"all orders but 0 (I, V) and 2 (Q, U): there are no others at normal {name}"
    return ""


def list_lit_stokes(problem: Problem) -> list[set[int]]:
    """The Stokes parameters that are not zero, of each incident column."""
    return [{k for k, value in enumerate(column) if value} for column in problem.columns.tolist()]


def find_lit_columns(
    problem: Problem, part: Part, lit: Sequence[set[int]], along_normal: bool = False
) -> tuple[int, ...]:
    """Places of the incident Stokes columns that light the part, of those that `list_lit_stokes` tells."""
    if not problem.skip_flags.columns:
        return tuple(range(len(lit)))
    seen = set(part.stokes)
    if along_normal and (problem.mu0 == 1.0).all():
        seen &= set(part.straight)
    elif along_normal and not part.straight:  # all is seen along the normal
        return ()
    return tuple([index for index, column in enumerate(lit) if not seen.isdisjoint(column)])


@lru_cache(maxsize=256)
def make_grid(rows: tuple[int, ...], columns: tuple[int, ...]) -> tuple[Any, ...]:
    """Places of these rows and columns, as NumPy takes them."""
    return np.ix_(rows, columns)


def reduce_problem(problem: Problem, part: Part, columns: tuple[int, ...]) -> Problem:
    """The problem of the part's layers and Stokes parameters."""
    incident: Array = problem.columns[make_grid(columns, part.stokes)]
    thickness = problem.thickness[: part.layers] if problem.scenes == 1 else problem.thickness
    if not part.has_end and not np.isinf(thickness[-1]):
        thickness = thickness.copy()
        thickness[part.layers - 1 :: part.layers] = np.inf
    if part.layers == problem.layers:
        found = problem.select_stokes(part.stokes, incident)
        return found if part.has_end else replace_unchecked(found, thickness=thickness)
    return replace_unchecked(
        problem,
        coefficients=problem.coefficients[: part.layers],
        terms=problem.terms[: part.layers],
        albedo=problem.albedo[: part.layers],
        thickness=thickness,
        above=problem.above[: part.layers],
        gain=problem.gain[: part.layers],
        fraction=problem.fraction[: part.layers],
        columns=incident,
        stokes=part.stokes,
    )
