"""All of section 2.C by one call, for orders of one scene or of many: each goes from its matrices to its light."""

import time
from dataclasses import dataclass

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run, ThreadTeam
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.solved import Orders

STAGES = ("assembly", "homogeneous", "particular", "boundary", "reconstruction")


@dataclass(frozen=True, eq=False)
class FusedModes:
    """Radiance (item, n_tau, n_in, n_col, n_out, S) of an order of a scene for a unit beam, public frame; flux (item,
    2, n_tau, n_in, n_col) up and down; residual (2, item, layer): of the modes, of the boundary; missed (item, 2): the
    stage that failed, 0 for none, and its layer."""

    radiance: Array
    flux: Array
    residual: Array
    missed: IntArray


def run_fused_modes(
    problem: Problem, orders: IntArray, slab_stack: IntArray, base: Base, base_row: IntArray, quick: bool, run: Run
) -> FusedModes:
    """What the stages find of ``orders`` (item,) of the scenes ``slab_stack`` (item,), bit for bit. Of several scenes
    the problem's layers and levels lie one behind the other; ``base_row`` (item,): the base's row, -1 for none."""
    count, n_rhs, n_tau = orders.size, problem.n_rhs, problem.level_layer.size
    layers = problem.albedo.size * n_tau // problem.level.size
    residual, spent, missed = np.zeros((2, count, layers)), np.zeros((count, 5)), np.zeros((count, 2), np.int32)
    radiance, flux = np.empty((count, n_tau, n_rhs, problem.rows_out)), np.zeros((count, 2, n_tau, n_rhs))
    crew = ThreadTeam(run.threads, np.zeros(run.threads), run.stop)
    begin = time.perf_counter()
    _core.fused_modes(
        crew,
        orders=orders,
        slab_stack=slab_stack,
        **problem.phase_arguments,
        n_up=problem.n_up,
        columns=problem.columns,
        conserving=problem.conserves,
        quick=quick,
        clear=problem.skip_flags.clear,
        clear_layers=((problem.albedo == 0.0) & problem.skip_flags.clear).astype(np.int32),
        thickness=problem.thickness,
        above=problem.above,
        base_row=base_row,
        base=base.matrix,
        base_source=base.source,
        base_out=base.out,
        flip=problem.flip,
        level=problem.level,
        level_layer=problem.level_layer,
        residual=residual,
        spent=spent,
        missed=missed,
        flux=flux,
        out=radiance,
    )
    note_stages(run, time.perf_counter() - begin, spent.sum(axis=0).tolist())
    shape = problem.mu0.size, problem.columns.shape[0]
    radiance = radiance.reshape(count, n_tau, *shape, problem.mu_out.size, len(problem.stokes))
    return FusedModes(radiance, flux.reshape(count, 2, n_tau, *shape), residual, missed)


def solve_fused_modes(problem: Problem, orders: IntArray, base: Base, quick: bool, run: Run) -> Orders:
    """The given orders of one scene. Raises AccuracyError where an eigenproblem does not converge or a boundary system
    is singular."""
    found = run_fused_modes(problem, orders, np.zeros_like(orders), base, base.row[orders], quick, run)
    if found.missed.any():
        complain_of_order(orders, found.missed)
    worst = found.residual.max(axis=2)
    residuals = {"residual_of_modes": worst[0], "residual_of_boundary": worst[1]}
    return Orders(found.radiance, found.flux[0, 0], found.flux[0, 1], residuals)


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
