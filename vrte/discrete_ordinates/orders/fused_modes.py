"""All of section 2.C: by one call, for orders of one scene or of many, or stage after stage."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run, ThreadTeam
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import OPEN, Top, solve_boundary
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.particular import Beam, copy_to_layers, find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import find_nodal_fluxes, reconstruct
from vrte.discrete_ordinates.orders.slabs import find_materials, merge_materials
from vrte.discrete_ordinates.orders.solved import Orders

RESIDUALS = ("residual_of_modes", "residual_of_boundary")
STAGES = ("assembly", "homogeneous", "particular", "boundary", "reconstruction")


@dataclass(frozen=True, eq=False)
class FusedModes:
    """Radiance (item, n_tau, n_in, n_col, n_out, S) of an order of a scene for a unit beam, public frame; flux (item,
    2, n_tau, n_in, n_col) up and down; rising (item, n_rhs, n): see `Amplitudes`; residual (2, item): of the modes, of
    the boundary, no number where a stage failed; missed (item, 2): which, 0 for none, and its layer."""

    radiance: Array
    flux: Array
    rising: Array
    residual: Array
    missed: IntArray


@dataclass(frozen=True, eq=False)
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
    answers = _core.call_together("fused_modes", team, gather_arguments(parts, quick, twin))
    spent, missed, residual = (
        np.concatenate([answer[name] for answer in answers], axis=axis)
        for name, axis in (("spent", 0), ("missed", 0), ("residual", 1))
    )
    note_stages(run, time.perf_counter() - begin, spent.sum(axis=0).tolist())
    worst, last, found = residual.max(axis=2), 0, []
    if missed.any():
        worst[:, missed[:, 0] != 0] = np.nan
    for part, answer in zip(parts, answers, strict=True):
        own, first, last = part.problem, last, last + part.orders.size
        beams, radiance, flux = (own.mu0.size, own.columns.shape[0]), answer["out"], answer["flux"]
        radiance = radiance.reshape(*radiance.shape[:2], *beams, own.mu_out.size, len(own.stokes))
        flux = flux.reshape(*flux.shape[:3], *beams)
        found.append(FusedModes(radiance, flux, answer["rising"], worst[:, first:last], missed[first:last]))
    return found


def gather_arguments(parts: Sequence[Part], quick: bool, twin: IntArray) -> list[dict[str, Any]]:
    """What the core takes for each part."""
    problem = parts[0].problem
    shared = {
        "twin": twin,
        **problem.phase_arguments,
        "n_up": problem.n_up,
        "balanced": not problem.is_exact,
        "quick": quick,
        "clear": problem.skip_flags.clear,
        "clear_layers": problem.clear_layers,
        "thickness": problem.thickness,
        "above": problem.above,
        "level": problem.level,
        "level_layer": problem.level_layer,
    }
    found = []
    for part in parts:
        own, base = part.problem, part.base
        below = {} if base.is_black else {"base": base.matrix, "base_source": base.source, "base_out": base.out}
        rows = {"orders": part.orders, "slab_stack": part.slab_stack, "base_row": part.base_row}
        unknowns = {"members": own.members, "flip": own.flip, "columns": own.columns, "conserving": own.conserves}
        found.append({**shared, **unknowns, **rows, **below, **part.top.arguments_of(part.orders)})
    return found


def find_twins(problem: Problem) -> IntArray:
    """Of each layer the first that is made of the same, (layer,)."""
    materials, kinds = find_materials(problem)
    return np.array(materials, np.int32)[kinds]


def solve_by_modes(
    problem: Problem, orders: IntArray, base: Base, quick: bool, run: Run, top: Top = OPEN
) -> tuple[Orders, Array]:
    """The given orders of one scene, and the light on the nodes that comes up to ``top``, as `Amplitudes` have it: by
    one call, or by stages, where some of these are no loops of the core or more threads than orders share the layers.
    Raises AccuracyError where an eigenproblem does not converge or a boundary system is singular."""
    if run.kernels is not _core or run.threads > orders.size:
        return solve_by_stages(problem, orders, base, quick, run, top)
    part = Part(problem, orders, np.zeros_like(orders), base, base.row[orders], top)
    (found,) = run_fused_modes([part], quick, run, find_twins(problem))
    if found.missed.any():
        complain_of_order(orders, found.missed)
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
    modes = find_modes(distinct, orders, matrices, run, quick)
    beam = Beam(*np.zeros((2, *modes.lam_re.shape[:2], problem.n_rhs, problem.size)))
    if not top.sent.size:
        beam = find_beam_field(distinct, matrices, modes, run)
    residual = modes.residual
    if kinds is not None:
        matrices, modes, beam = copy_to_layers(kinds, matrices, modes, beam)
    amplitudes = solve_boundary(problem, orders, modes, beam, base, run, top)
    kernels = reconstruct(problem, orders, matrices, modes, beam, amplitudes, base, run)
    fluxes = find_nodal_fluxes(problem, orders, modes, beam, amplitudes)
    worst = residual.max(axis=1), amplitudes.residual.max(axis=1)
    return Orders(kernels, *fluxes, dict(zip(RESIDUALS, worst, strict=True))), amplitudes.rising


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


def complain_of_order(orders: IntArray, missed: IntArray) -> None:
    """Raises AccuracyError for the first of the orders (order, 2) that missed a stage: which, and its layer."""
    index = int(np.argmax(missed[:, 0] != 0))
    stage, layer = missed[index].tolist()
    if stage == 1:
        raise AccuracyError(f"the eigenproblem of order {orders[index]}, layer {layer + 1} did not converge")
    raise AccuracyError(f"the boundary system of order {orders[index]} is singular")
