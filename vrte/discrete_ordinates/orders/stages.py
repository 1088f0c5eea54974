"""Section 2.C stage by stage: each reads what it needs, by the core's names, and adds what it finds."""

from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.solved import Orders

TIMED = {
    "respond": "boundary",
    "leave_slabs": "reconstruction",
    "reconstruct": "reconstruction",
}  # as what stages are timed that have another name
OF_LAYERS = ("G_E", "G_F", "lam_re", "lam_im", "X", "Y", "c", "zeta")  # what is found of each material
RESIDUALS = ("residual_of_modes", "residual_of_boundary")


def list_known(
    problem: Problem, orders: IntArray, quick: bool, base: Base | None = None, top: Top = OPEN
) -> dict[str, Any]:
    """What stages read of a problem, its base and what lies above, by the core's names; ``quick``: whether symmetric
    eigenproblems go to the solver that is."""
    known: dict[str, Any] = {
        "orders": orders,
        **problem.phase_arguments,
        "conserving": problem.conserves,
        "quick": quick,
        "clear": problem.skip_flags.clear,
        "clear_layers": problem.clear_layers,
        "nodes": problem.nodes,
        "mu0": problem.mu0,
        "mu_out": problem.mu_out,
        "n_up": problem.n_up,
        "columns": problem.columns,
        "thickness": problem.thickness,
        "above": problem.above,
        "level": problem.level,
        "level_layer": problem.level_layer,
        **top.arguments_of(orders),
        **problem.slants,
    }
    return known if base is None else known | base.arguments


def run_stage(name: str, known: dict[str, Any], run: Run) -> Any:
    """What a stage finds of what is ``known``, which is added to that, by name. Raises AccuracyError where it fails."""
    with run.timed(TIMED.get(name, name)) as crew:
        found = getattr(run.kernels, name)(crew, **select_read(name, known))
    if isinstance(found, dict):
        known |= found
        if "info" in found and found["info"].any():
            complain_of_order(name, known["orders"], np.argwhere(found["info"])[0])
    return found


def select_read(name: str, known: dict[str, Any]) -> dict[str, Any]:
    """Of what is known what a stage reads."""
    return {key: known[key] for key in getattr(_core, name).reads if key in known}


def complain_of_order(stage: str, orders: IntArray, item: IntArray) -> None:
    """Raises AccuracyError for an order, and a layer, that missed a stage; item: their numbers, of slabs and orders in
    `respond`."""
    if stage == "homogeneous":
        raise AccuracyError(f"the eigenproblem of order {orders[item[0]]}, layer {item[1] + 1} did not converge")
    raise AccuracyError(f"the boundary system of order {orders[item[-1]]} is singular")


def finish_stages(
    problem: Problem, known: dict[str, Any], run: Run, kinds: IntArray | None = None
) -> tuple[Orders, Array]:
    """The field from matrices that are known, and the light on the nodes that comes up to what lies above. ``kinds``:
    the material of each layer of the problem, where matrices are of materials."""
    run_stage("homogeneous", known, run)
    residual = known["residual"]
    if "sent" in known:
        known["c"], known["zeta"] = np.zeros((2, *known["lam_re"].shape[:2], problem.n_rhs, problem.size))
    else:
        run_stage("particular", known, run)
    if kinds is not None:
        known |= {name: np.take(known[name], kinds, axis=1) for name in OF_LAYERS}
    run_stage("boundary", known, run)
    kernels = run_stage("reconstruct", known, run)
    kernels = kernels.reshape(*kernels.shape[:2], problem.mu0.size, -1, problem.mu_out.size, len(problem.stokes))
    kernels[..., : problem.n_up, :] *= problem.flip
    fluxes = np.zeros((2, problem.level.size, problem.mu0.size, problem.columns.shape[0]))
    if problem.conserves and known["orders"][0] == 0:
        of_order = {name: known[name][:1] for name in (*OF_LAYERS[2:], "even", "odd", "decaying")}
        fluxes = _core.nodal_fluxes(**select_read("nodal_fluxes", known | of_order)).reshape(fluxes.shape)
    worst = residual.max(axis=1), known["residual"].max(axis=1)
    residuals = dict(zip(RESIDUALS, worst, strict=True))
    return Orders(kernels / (2.0 * np.pi), fluxes[0], fluxes[1], residuals), known["rising"]
