"""All of section 2.C: by one call, for orders of one scene or of many, or stage after stage."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray, record
from vrte.basics.running import Run, ThreadTeam
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slabs import find_materials, merge_materials
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.orders.stages import RESIDUALS, complain_of_order, finish_stages, list_known

STAGES = ("assembly", "homogeneous", "particular", "boundary", "reconstruction")


@record
class FusedModes:
    """Radiance (item, n_tau, n_in, n_col, n_out, S) of an order of a scene for a unit beam, public frame; flux (item,
    2, n_tau, n_in, n_col) up and down; rising (item, n_rhs, n): light that comes up to what lies above; residual (2,
    item): of the modes, of the boundary, no number where a stage failed; missed (item, 2): which, 0 for none, and its
    layer."""

    radiance: Array
    flux: Array
    rising: Array
    residual: Array
    missed: IntArray


@record
class Part:
    """What one set of Stokes parameters has in a call: its problem, ``orders`` (item,) of the scenes ``slab_stack``
    (item,), the base with the row (item,) of each, -1 for none, and what lies above."""

    problem: Problem
    orders: IntArray
    slab_stack: IntArray
    base: Base
    base_row: IntArray
    top: Top = OPEN


def run_fused_modes(parts: Sequence[Part], quick: bool, run: Run, twin: IntArray) -> list[FusedModes]:
    """What the stages find of each part, bit for bit. Their problems differ in Stokes parameters and columns alone. Of
    several scenes the problems' layers and levels lie one behind the other; ``twin`` (layer,): of each layer of a scene
    the first that is made of the same."""
    team, begin = ThreadTeam(run.threads, np.zeros(run.threads), run.stop), time.perf_counter()
    shared = list_known(parts[0].problem, parts[0].orders, quick)
    shared |= {"twin": twin, "balanced": not parts[0].problem.is_exact}
    answers = _core.call_together("fused_modes", team, [gather_arguments(part) for part in parts], shared)
    spent, missed, residual = (
        np.concatenate([answer[name] for answer in answers], axis=axis)
        for name, axis in (("spent", 0), ("missed", 0), ("residual", 1))
    )
    note_stages(run, time.perf_counter() - begin, spent.sum(axis=0).tolist())
    worst, last, found = residual.max(axis=2), 0, []
    if np.count_nonzero(missed):
        worst[:, missed[:, 0] != 0] = np.nan
    for part, answer in zip(parts, answers, strict=True):
        own, first, last = part.problem, last, last + part.orders.size
        beams, radiance, flux = (own.mu0.size, own.columns.shape[0]), answer["out"], answer["flux"]
        radiance = radiance.reshape(*radiance.shape[:2], *beams, own.mu_out.size, len(own.stokes))
        flux = flux.reshape(*flux.shape[:3], *beams)
        found.append(FusedModes(radiance, flux, answer["rising"], worst[:, first:last], missed[first:last]))
    return found


def gather_arguments(part: Part) -> dict[str, Any]:
    """What the core takes for a part beside what is the same of all."""
    problem, base, top = part.problem, part.base, part.top
    own = {
        "orders": part.orders,
        "slab_stack": part.slab_stack,
        "members": problem.members,
        "columns": problem.columns,
        "conserving": problem.conserves,
        "base_row": part.base_row,
        "flip": problem.flip,
    }
    return own | ({} if base.is_black else base.arguments) | (top.arguments_of(part.orders) if top is not OPEN else {})


def find_twins(problem: Problem) -> IntArray:
    """Of each layer the first that is made of the same, (layer,)."""
    materials, kinds = find_materials(problem)
    return np.array(materials, np.int32)[kinds]


def solve_by_modes(
    problem: Problem, orders: IntArray, base: Base, quick: bool, run: Run, top: Top = OPEN
) -> tuple[Orders, Array]:
    """The given orders of one scene, and the light on the nodes that comes up to ``top``, (order, n_rhs, n): by
    one call, or by stages, where some of these are no loops of the core or more threads than orders share the layers.
    Raises AccuracyError where an eigenproblem does not converge or a boundary system is singular."""
    if run.kernels is not _core or run.threads > orders.size:
        return solve_by_stages(problem, orders, base, quick, run, top)
    part = Part(problem, orders, np.zeros_like(orders), base, base.row[orders], top)
    (found,) = run_fused_modes([part], quick, run, find_twins(problem))
    if np.count_nonzero(found.missed):
        index = int(np.argmax(found.missed[:, 0] != 0))
        stage, layer = found.missed[index].tolist()
        complain_of_order(STAGES[stage], orders, np.array([index, layer][: 1 + (stage == 1)]))
    return make_orders(found), found.rising


def make_orders(found: FusedModes) -> Orders:
    """What a call found of the orders of one scene."""
    residuals = dict(zip(RESIDUALS, found.residual, strict=True))
    return Orders(found.radiance, found.flux[0, 0], found.flux[0, 1], residuals)


def solve_by_stages(
    problem: Problem, orders: IntArray, base: Base, quick: bool, run: Run, top: Top
) -> tuple[Orders, Array]:
    """The same, all orders and layers through one stage before the next."""
    distinct, kinds = merge_materials(problem)
    matrices = assemble(distinct, orders, run)
    known = list_known(problem, orders, quick, base, top) | {"albedo": distinct.albedo} | vars(matrices)
    return finish_stages(problem, known | {"base_row": base.row[orders]}, run, kinds)


def spread_over_scenes(part: Part, orders: IntArray, wanted: BoolArray, found: FusedModes) -> Orders:
    """What was found of those ``orders`` that are ``wanted`` (order, scene) of many scenes, nothing of the others;
    residuals (scene,), no numbers where a stage failed."""
    row, slab_stack = np.nonzero(wanted)
    kernels = np.zeros((*wanted.shape, *found.radiance.shape[1:]))
    kernels[row, slab_stack] = found.radiance
    flux = np.zeros((wanted.shape[1], *found.flux.shape[1:]))
    first = part.orders == 0
    flux[slab_stack[first]] = found.flux[first]
    residuals = {name: np.zeros(wanted.shape[1]) for name in RESIDUALS}
    for largest, residual in zip(residuals.values(), found.residual, strict=True):
        np.maximum.at(largest, slab_stack, residual)
    up, down = (each.reshape(-1, *each.shape[2:]) for each in (flux[:, 0], flux[:, 1]))
    return Orders(kernels.reshape(orders.size, -1, *kernels.shape[3:]), up, down, residuals)


def note_stages(run: Run, wall: float, busy: list[float]) -> None:
    """Records the wall time of all stages together, divided as the seconds ``busy`` that threads spent in each."""
    total = max(sum(busy), 1e-300)
    for name, seconds in zip(STAGES, busy, strict=True):
        run.record(name, wall * seconds / total, seconds)
    if run.stop[0]:
        raise KeyboardInterrupt
