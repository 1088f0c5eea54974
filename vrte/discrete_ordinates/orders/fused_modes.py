"""All of section 2.C: by one call, for orders of one scene or of many, or stage after stage."""

import time
from dataclasses import dataclass

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

STAGES = ("assembly", "homogeneous", "particular", "boundary", "reconstruction")


@dataclass(frozen=True, eq=False)
class FusedModes:
    """Radiance (item, n_tau, n_in, n_col, n_out, S) of an order of a scene for a unit beam, public frame; flux (item,
    2, n_tau, n_in, n_col) up and down; rising (item, n_rhs, n): see `Amplitudes`; residual (2, item, layer): of the
    modes, of the boundary; missed (item, 2): the stage that failed, 0 for none, and its layer."""

    radiance: Array
    flux: Array
    rising: Array
    residual: Array
    missed: IntArray


def run_fused_modes(
    problem: Problem,
    orders: IntArray,
    slab_stack: IntArray,
    base: Base,
    base_row: IntArray,
    quick: bool,
    run: Run,
    twin: IntArray,
    top: Top = OPEN,
) -> FusedModes:
    """What the stages find of ``orders`` (item,) of the scenes ``slab_stack`` (item,), bit for bit. Of several scenes
    the problem's layers and levels lie one behind the other; ``base_row`` (item,): the base's row, -1 for none;
    ``twin`` (layer,): of each layer of a scene the first that is made of the same."""
    count, n_rhs, n_tau = orders.size, problem.n_rhs, problem.level_layer.size
    residual, spent, missed = np.zeros((2, count, twin.size)), np.zeros((count, 5)), np.zeros((count, 2), np.int32)
    radiance, flux = np.empty((count, n_tau, n_rhs, problem.rows_out)), np.zeros((count, 2, n_tau, n_rhs))
    sent = top.sent_in(orders)
    rising = np.empty(sent.shape)
    crew = ThreadTeam(run.threads, np.zeros(run.threads), run.stop)
    begin = time.perf_counter()
    _core.fused_modes(
        crew,
        orders=orders,
        slab_stack=slab_stack,
        twin=twin,
        **problem.phase_arguments,
        n_up=problem.n_up,
        columns=problem.columns,
        conserving=problem.conserves,
        balanced=not problem.is_exact,
        quick=quick,
        clear=problem.skip_flags.clear,
        clear_layers=((problem.albedo == 0.0) & problem.skip_flags.clear).astype(np.int32),
        thickness=problem.thickness,
        above=problem.above,
        base_row=base_row,
        base=base.matrix,
        base_source=base.source,
        base_out=base.out,
        top_row=top.rows_of(orders),
        top=top.reflection,
        sent=sent,
        flip=problem.flip,
        level=problem.level,
        level_layer=problem.level_layer,
        rising=rising,
        residual=residual,
        spent=spent,
        missed=missed,
        flux=flux,
        out=radiance,
    )
    note_stages(run, time.perf_counter() - begin, spent.sum(axis=0).tolist())
    shape = problem.mu0.size, problem.columns.shape[0]
    radiance = radiance.reshape(count, n_tau, *shape, problem.mu_out.size, len(problem.stokes))
    return FusedModes(radiance, flux.reshape(count, 2, n_tau, *shape), rising, residual, missed)


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
    first, twin = np.zeros_like(orders), find_twins(problem)
    found = run_fused_modes(problem, orders, first, base, base.row[orders], quick, run, twin, top)
    if found.missed.any():
        complain_of_order(orders, found.missed)
    return Orders(found.radiance, found.flux[0, 0], found.flux[0, 1], name_residuals(*found.residual)), found.rising


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
    return Orders(kernels, *fluxes, name_residuals(residual, amplitudes.residual)), amplitudes.rising


def name_residuals(of_modes: Array, of_boundary: Array) -> dict[str, Array]:
    """The largest of each order, by name; (order, layer) each."""
    return {"residual_of_modes": of_modes.max(axis=1), "residual_of_boundary": of_boundary.max(axis=1)}


def solve_fused_scenes(
    problem: Problem, orders: IntArray, wanted: BoolArray, base: Base, quick: bool, run: Run
) -> Orders:
    """The ``orders`` that are ``wanted`` (order, scene) of many scenes, nothing of the others; residuals (scene,), no
    numbers where a stage failed."""
    row, slab_stack = (each.astype(np.int32) for each in np.nonzero(wanted))
    numbers, twin = orders[row], np.arange(problem.layers, dtype=np.int32)
    found = run_fused_modes(problem, numbers, slab_stack, base, base.find_rows(numbers, slab_stack), quick, run, twin)
    kernels = np.zeros((*wanted.shape, *found.radiance.shape[1:]))
    kernels[row, slab_stack] = found.radiance
    flux = np.zeros((wanted.shape[1], *found.flux.shape[1:]))
    first = numbers == 0
    flux[slab_stack[first]] = found.flux[first]
    residuals = {}
    for name, residual in zip(("residual_of_modes", "residual_of_boundary"), found.residual, strict=True):
        residuals[name] = np.zeros(wanted.shape[1])
        worst = np.where(found.missed[:, 0] != 0, np.nan, residual.max(axis=1))
        np.maximum.at(residuals[name], slab_stack, worst)
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
