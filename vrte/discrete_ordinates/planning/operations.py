"""How many floating-point operations a plan takes, roughly: products and factorisations counted, lower orders not."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from vrte.basics import cost
from vrte.basics.arrays import Array
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_interface import is_under_one_surface, round_orders
from vrte.discrete_ordinates.orders.slabs import cut_layers, merge_materials, select_materials
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.choice import (
    count_doubling_steps,
    count_operations_of_invariance,
    count_operations_of_modes,
    count_operations_of_scatterings,
)
from vrte.optics.facet_integrals import choose_points
from vrte.optics.facets import RoughSurface
from vrte.scene.scene import Scene

if TYPE_CHECKING:
    from vrte.discrete_ordinates.planning.plan import Plan


def count_operations_of_block(block: Block, strength: Array, accuracy: float) -> float:
    """Of all its orders; strength (order,): their q."""
    problem, between = block.problem, count_operations_of_responses(block)
    if block.choice.name == "invariance":
        return float(count_operations_of_invariance(problem, strength, accuracy).sum()) + between
    if block.choice.name == "scatterings":
        return float(count_operations_of_scatterings(problem, block.orders).sum())
    each = (
        count_operations_of_doubling(problem)
        if block.choice.name == "doubling"
        else count_operations_of_layers(problem)
    )
    return each * block.orders.size + between


def count_operations_of_responses(block: Block) -> float:
    """Of all orders of a block, of slabs between interfaces; none where one surface is a boundary condition."""
    problem, media = block.problem, block.problem.media
    if media is None or is_under_one_surface(media):
        return 0.0
    n, stokes, into = float(problem.size), len(problem.stokes), problem.mu0.size
    out = np.unique(problem.mu_out).size
    each = cost.RESPONSE * problem.albedo.size * n * (n + stokes * into) * (n + stokes * out)
    return block.orders.size * each


class Integral(NamedTuple):
    """Integrals over facets from nodes along directions, of so many Fourier orders."""

    surface: RoughSurface
    transmitted: bool
    nodes: int
    directions: int
    orders: int


def count_operations_of_facets(one: Integral, accuracy: float) -> float:
    """Of integrals over facets: more azimuths, and more of each, where there are more orders."""
    points, _ = choose_points(accuracy)
    reflected, through = cost.ORDERS
    width = min(0.1, one.surface.roughness * abs(one.surface.ratio.real - 1.0))
    orders = 1.0 + one.orders**2 * (width**2 / through if one.transmitted else 1.0 / reflected)
    slower = cost.TOTALLY if one.surface.reflects_totally and not one.transmitted else 1.0
    return cost.LOBES * points**2 * slower * orders * one.directions * (one.nodes + cost.PIECES)


def list_integrals(block: Block) -> Iterator[Integral]:
    """What `FacetOrders` integrates for a block, of light on nodes inside the stack, beams from above, and directions
    seen above and below."""
    problem, media, count = block.problem, block.problem.media, int(block.orders[-1]) + 1
    into, up = problem.mu0.size, problem.n_up
    if media is not None and is_under_one_surface(media):
        count = round_orders(count)
    if block.base.facets is not None:
        yield Integral(block.base.facets, False, problem.nodes.size, problem.nodes.size + into + up, count)
    if media is None:
        return
    rough = [k for k, each in enumerate(media.scene.interfaces) if each is not None and not each.is_smooth]
    seen, ends = (up, problem.mu_out.size - up), (rough[0], rough[-1]) if rough else ()
    for k in rough:
        interface = media.scene.interfaces[k]
        assert interface is not None
        inside = k > 0, k < problem.layers or media.scene.base is not None
        nodes = [media.nodes.count(index) for index in media.scene.media[k : k + 2]]
        for side, surface in enumerate((interface.facets, interface.turned.facets)):
            other = 1 - side
            yield Integral(surface, True, nodes[side], nodes[other], count if all(inside) else 1)
            if inside[side]:
                yield Integral(surface, False, nodes[side], nodes[side] + seen[side] * (k == ends[side]), count)
                yield Integral(surface, True, nodes[side], seen[other] * (k == ends[other]), count)
            if k == rough[0] and (side == 0 or inside[1]):  # beams, the other way round
                yield Integral(surface, side == 1, nodes[side], into, count if inside[1] else 1)


def count_operations_of_flakes(problem: Problem) -> float:
    """Of the Fourier matrices of all orders, for each kind of flakes in each medium."""
    kinds = {id(one.flakes) for one in problem.oriented if one is not None}
    pairs = float(problem.directions.size) * (problem.nodes.size + cost.PIECES)
    return len(kinds) * cost.FLAKES * pairs * (1.0 + problem.coefficients.shape[1] * cost.A_FLAKE_ORDER)


def count_operations_of_layers(problem: Problem) -> float:
    """Of an order by modes: those of each material that scatters, and of layers that meet others."""
    materials, _ = merge_materials(problem)
    scatters = (problem.albedo > 0.0) | (not problem.skip_flags.clear)
    solved = [k for k in range(materials.albedo.size) if materials.albedo[k] > 0.0 or not problem.skip_flags.clear]
    joined = cost.BOUNDARY * float(problem.size) ** 3 * int(scatters.sum()) if scatters.size > 1 else 0.0
    return joined + (count_operations_of_modes(select_materials(materials, solved)) if solved else 0.0)


def count_operations_of_doubling(problem: Problem) -> float:
    """Of an order by doubling: every distinct slab that scatters, and where two slabs meet."""
    slab_stack = cut_layers(problem)
    n, edges = float(slab_stack.problem.size), float(slab_stack.problem.n_rhs + slab_stack.problem.rows_out)
    product = 2.0 * n * n * (n + edges) + 2.0 * n * slab_stack.problem.n_rhs * slab_stack.problem.rows_out
    lowest = float(slab_stack.problem.directions.min())
    steps = np.array([count_doubling_steps(each, lowest) for each in slab_stack.thickness.tolist()])
    scatters = (slab_stack.problem.albedo[slab_stack.material] > 0.0) | (not problem.skip_flags.clear)
    doubled = float((cost.PRODUCTS_A_STEP * steps + cost.PRODUCTS_BESIDE)[scatters].sum())
    return product * (doubled + cost.PRODUCTS_A_JOINT * (slab_stack.slabs.size - 1))


def count_operations_of_plan(plan: "Plan") -> float:
    """Of all blocks of a plan, or of those of its parts, and of what adds them up."""
    if plan.parts:
        return sum(count_operations_of_plan(part) for part in plan.parts)
    strengths = [plan.needs.strength[0, block.orders] for block in plan.blocks]
    blocks = zip(plan.blocks, strengths, strict=True)
    beside = count_operations_of_sums(plan) + count_operations_of_flakes(plan.problem)
    lobes = dict.fromkeys(one for block in plan.blocks for one in list_integrals(block))  # integrated once for all
    beside += sum(count_operations_of_facets(one, plan.accuracy) for one in lobes)
    return beside + sum(count_operations_of_block(*each, plan.accuracy) for each in blocks)


def count_operations_of_sums(plan: "Plan") -> float:
    """Of the sum over orders, and of single scattering."""
    problem, parts = plan.problem, plan.wanted.parts
    rows = sum(float(levels.size) * directions.size for levels, directions in parts) * problem.mu0.size
    entries = sum(float(block.orders.size) * len(block.stokes) * len(block.columns) for block in plan.blocks)
    return 2.0 * plan.azimuths.distinct.size * rows * entries + count_operations_of_single_scattering(plan)


def count_operations_of_single_scattering(plan: "Plan") -> float:
    """In closed form, with all terms of the phase matrices."""
    problem = plan.problem
    pairs = float(problem.mu0.size) * max((directions.size for _, directions in plan.wanted.parts), default=0)
    return plan.azimuths.distinct.size * cost.A_TERM * pairs * count_terms_scattered(problem, plan.request.scene)


def count_operations_of_derivatives(plan: "Plan", of_orders: float, once: float) -> float:
    """Of derivatives by the algebra of slabs, or by invariance: so many times those of one with all orders, and times
    light that is scattered once."""
    total = 0.0
    for part in plan.parts or (plan,):
        for block in part.blocks:
            problem = block.problem
            if block.choice.name == "invariance" and problem.media is None:
                strength = part.needs.strength[0, block.orders]
                light = count_operations_of_invariance(problem, strength, part.accuracy)
                total += of_orders * cost.BY_INVARIANCE * float(light.sum())
                continue
            size = problem.size + len(problem.stokes) * max(problem.mu0.size, problem.mu_out.size)
            each = cost.ALGEBRA + cost.ALGEBRA_SIZE * float(size) ** 3
            total += of_orders * each * block.orders.size * problem.albedo.size
        total += once * count_operations_of_single_scattering(part)
    return total


def count_terms_scattered(problem: Problem, scene: Scene) -> float:
    """Terms of all phase matrices that scatter once, those of scalar ones by what they take: where light is refracted,
    beams go both ways, and each is seen on both sides of a layer."""
    there = [layer.phase_matrix for layer, gain in zip(scene.layers, problem.gain, strict=True) if gain > 0.0]
    twice = 4.0 if problem.media is not None else 1.0
    once = there if problem.media is not None else {id(each): each for each in there}.values()
    return twice * sum(each.terms * (cost.SCALAR_TERM if each.is_scalar else 1.0) for each in once)
