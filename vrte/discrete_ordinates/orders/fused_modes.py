"""All of section 2.C by one call, for the orders that one thread does: each goes from its matrices to its light."""

import time

import numpy as np

from vrte import _core
from vrte.basics.arrays import IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run, ThreadTeam
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import Amplitudes
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.particular import Beam
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import find_nodal_fluxes
from vrte.discrete_ordinates.orders.solved import Orders

NOTHING = np.zeros(0)  # stands for arrays that no later stage reads
NO_PIVOTS = np.zeros(0, np.int32)
STAGES = ("assembly", "homogeneous", "particular", "boundary", "reconstruction")


def solve_fused_modes(problem: Problem, orders: IntArray, base: Base, quick: bool, run: Run) -> Orders:
    """What the five stages find of orders, bit for bit. Raises AccuracyError where an eigenproblem does not converge or
    a boundary system is singular."""
    count, layers, n, n_rhs = orders.size, problem.albedo.size, problem.size, problem.n_rhs
    rates, modes = np.empty((count, 2, layers, n)), np.empty((count, 2, layers, n, n))
    amplitudes, decaying = np.empty((count, 4, layers, n_rhs, n)), np.empty((count, layers), np.int32)
    residual, spent, missed = np.zeros((2, count, layers)), np.zeros((count, 5)), np.zeros((count, 2), np.int32)
    kernels = np.empty((count, problem.level.size, n_rhs, problem.rows_out))
    crew = ThreadTeam(run.threads, np.zeros(run.threads), run.stop)
    begin = time.perf_counter()
    _core.fused_modes(
        crew,
        orders=orders,
        **problem.phase_arguments,
        n_up=problem.n_up,
        columns=problem.columns,
        conserving=problem.conserves,
        quick=quick,
        clear=problem.skip_flags.clear,
        clear_layers=((problem.albedo == 0.0) & problem.skip_flags.clear).astype(np.int32),
        thickness=problem.thickness,
        above=problem.above,
        base_row=base.row[orders],
        base=base.matrix,
        base_source=base.source,
        base_out=base.out,
        flip=problem.flip,
        level=problem.level,
        level_layer=problem.level_layer,
        rates=rates,
        modes=modes,
        amplitudes=amplitudes,
        decaying=decaying,
        residual=residual,
        spent=spent,
        missed=missed,
        out=kernels,
    )
    note_stages(run, time.perf_counter() - begin, spent.sum(axis=0).tolist())
    if missed.any():
        complain_of_order(orders, missed)
    shape = problem.mu0.size, problem.columns.shape[0], problem.mu_out.size, len(problem.stokes)
    fields = (
        Modes(rates[:, 0], rates[:, 1], modes[:, 0], modes[:, 1], NOTHING, NO_PIVOTS, residual[0]),
        Beam(amplitudes[:, 0], amplitudes[:, 1]),
        Amplitudes(amplitudes[:, 2], amplitudes[:, 3], NOTHING, decaying, residual[1]),
    )
    worst = residual.max(axis=2)
    residuals = {"residual_of_modes": worst[0], "residual_of_boundary": worst[1]}
    up, down = find_nodal_fluxes(problem, orders, *fields)
    return Orders(kernels.reshape(*kernels.shape[:2], *shape), up, down, residuals)


def note_stages(run: Run, wall: float, busy: list[float]) -> None:
    """Books the wall time of all stages together in the shares of what each kept a thread busy with."""
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
