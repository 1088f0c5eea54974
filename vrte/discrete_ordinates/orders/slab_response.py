"""What a slab of one material does to all light: its reflection and transmission on the nodes, and from and to
directions off them, by modes or by doubling.

Scaled by sqrt(weight mu) on the nodes and flipped, light going up has U and V turned over: a homogeneous slab then does
the same to light from above and from below.
"""

from dataclasses import field
from typing import Any, Protocol

import numpy as np

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.doubling import double_slabs
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.stages import list_known, run_stage


class Responding(Protocol):
    """What slabs do to all light, however it is found: as `Response`, but for light that leaves the nodes."""

    @property
    def nodes(self) -> Array: ...
    @property
    def entering(self) -> Array: ...
    @property
    def passing(self) -> Array: ...
    @property
    def residuals(self) -> dict[str, Array]: ...

    def send(self, of: IntArray, above: Array, below: Array) -> Array:
        """What pieces, each of a slab, of (piece,), send of light on the nodes (order, piece, r, n) from above and from
        below, up at the top and down at the bottom: (2, order, piece, r, o)."""


@record
class Response:
    """R (0) and T (1) of slabs, each (slab, order, 2, ...), rows first: nodes (n, n) from the scaled field on the
    nodes; entering (n, r) from beams of unit flux; leaving (o, n) into directions off the nodes, radiance times 2 pi;
    passing (o, r), what is scattered once left out; r = n_in S and o = n_out S. residuals by name, (slab, order)."""

    nodes: Array
    entering: Array
    leaving: Array
    passing: Array
    residuals: dict[str, Array] = field(default_factory=dict)

    def send(self, of: IntArray, above: Array, below: Array) -> Array:
        """What light upon the pieces' ends sends along the sights, as `Responding.send` has it."""
        rows = take_slabs(of, self.leaving).swapaxes(0, 1).swapaxes(-1, -2)
        return np.stack([above @ rows[:, :, end] + below @ rows[:, :, 1 - end] for end in range(2)])


class ModalResponse:
    """Slabs by modes: what leaves them is found of the light that falls upon them, once that is known."""

    def __init__(self, known: dict[str, Any], residual_of_modes: Array, run: Run) -> None:
        self.known, self.run = known, run
        found = run_stage("respond", dict(known), run)
        self.nodes, self.entering = (found[name].swapaxes(-1, -2) for name in ("nodes", "entering"))
        self.passing = np.zeros((*self.nodes.shape[:3], 0, 0))  # until light leaves
        self.residuals = {"residual_of_modes": residual_of_modes, "residual_of_boundary": found["residual"]}

    def send(self, of: IntArray, above: Array, below: Array) -> Array:
        """The same as `Responding.send`: all pieces of a slab together, unless that is more than along every node."""
        most, (r, n) = int(np.bincount(of).max()), above.shape[2:]
        if most * r >= n:
            return self.expand().send(of, above, below)
        rank = rank_within(of)
        lights = np.zeros((2, len(self.nodes), above.shape[0], most, r, n))
        for own, light in zip(lights, (above, below), strict=True):
            own[of, :, rank] = light.swapaxes(0, 1)
        leaving = self.leave(*lights.reshape(*lights.shape[:3], most * r, n))
        leaving = leaving.reshape(*leaving.shape[:3], most, r, leaving.shape[-1])
        return leaving[of, :, :, rank].transpose(2, 1, 0, 3, 4)

    def leave(self, above: Array, below: Array) -> Array:
        """What leaves of light (slab, order, columns, n) from above and from below, (slab, order, 2, columns, o)."""
        found = run_stage("leave_slabs", self.known | {"light_above": above, "light_below": below}, self.run)
        self.passing = found["passing"].swapaxes(-1, -2)
        worst = np.maximum(self.residuals["residual_of_boundary"], found["residual"])
        self.residuals = self.residuals | {"residual_of_boundary": worst}
        leaving: Array = found["leaving"]
        return leaving

    def expand(self) -> Response:
        """The same with the matrices of all light that leaves."""
        slabs, orders, _, n, _ = self.nodes.shape
        along = np.ascontiguousarray(np.broadcast_to(np.eye(n), (slabs, orders, n, n)))
        leaving = self.leave(along, np.zeros_like(along)).swapaxes(-1, -2)
        return Response(self.nodes, self.entering, leaving, self.passing, self.residuals)


def take_slabs(of: IntArray, parts: Array) -> Array:
    """Of every piece, of (piece,), what its slab has, (slab, ...)."""
    return parts if np.array_equal(of, np.arange(len(parts))) else parts[of]


def rank_within(of: IntArray) -> IntArray:
    """How many pieces before each are of the same slab.

    >>> rank_within(np.array([0, 1, 0, 0]))
    array([0, 0, 1, 2])
    """
    order = np.argsort(of, kind="stable")
    first = np.searchsorted(of[order], of)
    found = np.empty_like(of)
    found[order] = np.arange(of.size) - first[order]
    return found


def respond(
    name: str,
    problem: Problem,
    material: IntArray,
    thickness: Array,
    orders: IntArray,
    run: Run,
    quick: bool,
    matrices: Assembled | None = None,
) -> Responding:
    """Of slabs (slab,) of the problem's layers, taken as materials, with unit Stokes vectors as its columns; its mu_out
    are seen from above and from below. ``matrices`` where they are known."""
    if name == "doubling":
        return respond_by_doubling(problem, material, thickness, orders, run, matrices)
    return respond_by_modes(problem, material, thickness, orders, run, quick, matrices)


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
    problem: Problem,
    material: IntArray,
    thickness: Array,
    orders: IntArray,
    run: Run,
    quick: bool,
    matrices: Assembled | None = None,
) -> ModalResponse:
    """By the modes of each material, see core/response.pxi."""
    matrices = assemble(problem, orders, run) if matrices is None else matrices
    modes = find_modes(problem, orders, matrices, run, quick)
    known = list_known(problem, orders, False) | vars(matrices) | vars(modes)
    run_stage("particular", known, run)
    return ModalResponse(known | {"material": material, "thickness": thickness}, modes.residual.T[material], run)
