"""What a slab of one material does to all light: its reflection and transmission on the nodes, and from and to
directions off them, by modes or by doubling.

Scaled by sqrt(weight mu) on the nodes and flipped, light going up has U and V turned over: a homogeneous slab then does
the same to light from above and from below.
"""

from dataclasses import dataclass, field

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.stages import list_known, run_stage


@dataclass(frozen=True, eq=False)
class Response:
    """R (0) and T (1) of slabs, each (slab, order, 2, ...), rows first: nodes (n, n) from the scaled field on the
    nodes; entering (n, r) from beams of unit flux; leaving (o, n) into directions off the nodes, radiance times 2 pi;
    passing (o, r), what is scattered once left out; r = n_in S and o = n_out S. residuals by name, (slab, order)."""

    nodes: Array
    entering: Array
    leaving: Array
    passing: Array
    residuals: dict[str, Array] = field(default_factory=dict)


def respond(
    name: str, problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> Response:
    """Of slabs (slab,) of the problem's layers, taken as materials, with unit Stokes vectors as its columns; its mu_out
    are seen from above and from below."""
    if name == "doubling":
        return respond_by_doubling(problem, material, thickness, orders, run)
    return respond_by_modes(problem, material, thickness, orders, run, quick)


def respond_by_doubling(
    problem: Problem,
    material: IntArray,
    thickness: Array,
    orders: IntArray,
    run: Run,
    matrices: Assembled | None = None,
) -> Response:
    """By impedance doubling, whose matrices have all of it; ``matrices`` where they are known."""
    matrices = assemble(problem, orders, run) if matrices is None else matrices
    slabs = double_slabs(problem, material, thickness, orders, matrices, run)
    n, r, o = problem.size, problem.n_rhs, problem.rows_out
    shapes = (n, n), (r, n), (n, o), (r, o)
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    both = np.stack([slabs.R, slabs.T]).transpose(2, 1, 0, 3)
    nodes, entering, leaving, passing = (
        part.reshape(*both.shape[:3], *shape).swapaxes(-1, -2)
        for part, shape in zip(np.split(both[..., : ends[-1]], ends[:-1], axis=-1), shapes, strict=True)
    )
    if problem.conserves and orders[0] == 0:  # back from the frame in which one axis carries the flux
        axis = make_flux_axis(problem)
        nodes[:, 0] -= 2.0 * axis[:, None] * (axis @ nodes[:, 0])[..., None, :]
        nodes[:, 0] -= 2.0 * (nodes[:, 0] @ axis)[..., None] * axis
        entering[:, 0] -= 2.0 * axis[:, None] * (axis @ entering[:, 0])[..., None, :]
        leaving[:, 0] -= 2.0 * (leaving[:, 0] @ axis)[..., None] * axis
    residual = slabs.residual.T  # (2, slab, order)
    residuals = {"residual_of_reflection": residual[0], "residual_of_transmission": residual[1]}
    return Response(nodes, entering, leaving, passing, residuals)


def make_flux_axis(problem: Problem) -> Array:
    """The unit vector whose reflection turns the flux to one axis, see core/flux.pxi: (n,)."""
    v = np.zeros(problem.size)
    v[:: len(problem.stokes)] = np.sqrt(problem.weights * problem.nodes)
    v[problem.size - len(problem.stokes)] += np.linalg.norm(v)
    return v / np.linalg.norm(v)


def respond_by_modes(
    problem: Problem, material: IntArray, thickness: Array, orders: IntArray, run: Run, quick: bool
) -> Response:
    """By the modes of each material, see core/response.pxi."""
    matrices = assemble(problem, orders, run)
    modes = find_modes(problem, orders, matrices, run, quick)
    return respond_with_modes(problem, material, thickness, orders, matrices, modes, run)


def respond_with_modes(
    problem: Problem,
    material: IntArray,
    thickness: Array,
    orders: IntArray,
    matrices: Assembled,
    modes: Modes,
    run: Run,
) -> Response:
    """By modes that are known."""
    known = list_known(problem, orders, False) | vars(matrices) | vars(modes)
    run_stage("particular", known, run)
    found = run_stage("respond", known | {"material": material, "thickness": thickness}, run)
    residuals = {"residual_of_modes": modes.residual.T[material], "residual_of_boundary": found["residual"]}
    parts = {name: found[name].swapaxes(-1, -2) for name in ("nodes", "entering", "leaving", "passing")}
    return Response(**parts, residuals=residuals)
