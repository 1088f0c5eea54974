"""Two fluxes: what the two-stream and the diffusion method have in common.

Light going down and up is x(t) and y(t), t from the top of a layer. With s = x + y and d = x - y, a = 1/mu0,

    s' = -F d + source_s e^(-a t),    d' = -E s + source_d e^(-a t),    E >= 0 and F > 0,

which is discrete ordinates on one node, (1:40)-(1:41): its stages solve it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vrte.basics.arrays import Array, BoolArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.boundary import solve_boundary
from vrte.discrete_ordinates.orders.homogeneous import find_modes
from vrte.discrete_ordinates.orders.particular import find_beam_field
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.reconstruction import find_nodal_fluxes, reconstruct
from vrte.discrete_ordinates.orders.truncating import (
    Truncation,
    choose_truncation,
    find_peak_flux,
    find_spread_directions,
)
from vrte.methods.parts.method import Answer, Task, discretise_request, find_cosines
from vrte.request.how import FINEST
from vrte.request.request import Request

CARRIED = 2  # terms of a phase function


@dataclass(frozen=True, eq=False)
class TwoFluxes:
    """I of multiply scattered light of each order, (order, n_tau, n_in, n_out), and diffuse fluxes down and up (n_tau,
    n_in), for unit beams, of the layers as they were cut."""

    orders: Sequence[Array]
    down: Array
    up: Array


def put_on_one_node(problem: Problem, cosine: float, weight: float) -> Problem:
    """The problem for I alone and one unit beam from each direction, on one node."""
    return replace(
        problem,
        nodes=np.array([cosine]),
        weights=np.array([weight]),
        stokes=(0,),
        columns=np.ones((1, 1)),
        skip_flags=replace(problem.skip_flags, clear=False),
    )


def solve_one_node(problem: Problem, matrices: Assembled, base: Base, run: Run) -> TwoFluxes:
    """The field of all orders that there are matrices of."""
    orders = np.arange(len(matrices.E), dtype=np.int32)
    modes = find_modes(problem, orders, matrices, run)
    beam = find_beam_field(problem, matrices, modes, run)
    amplitudes = solve_boundary(problem, orders, modes, beam, base, run)
    kernels = reconstruct(problem, orders, matrices, modes, beam, amplitudes, base, run)
    up, down = find_nodal_fluxes(problem, orders, modes, beam, amplitudes)
    return TwoFluxes([*kernels[:, :, :, 0, :, 0]], down[..., 0], up[..., 0])


def cut_to_two(request: Request) -> Problem:
    """The scene with two terms of each phase function: longer ones are cut or lose their forward peak, as discrete
    ordinates with one node would have it."""
    return discretise_request(request, CARRIED // 2, find_truncation(request, find_cosines(request)).peaks)


def find_truncation(request: Request, mu: Array) -> Truncation:
    """What discrete ordinates with one node would take, light near the beam counting wherever there is any."""
    given = request.scene, request.mu0, request.columns, mu, request.tau
    return choose_truncation(request.truncation, *given, CARRIED // 2, FINEST)


def choose_spread(request: Request, problem: Problem, mu: Array) -> BoolArray:
    """Towards which directions, (n_mu,), the beam spreads by small angles before it scatters once."""
    return find_spread_directions(find_truncation(request, mu), problem, mu)


def list_asymmetries(problem: Problem) -> Array:
    """g of each layer, (layer,), as it was cut."""
    if problem.coefficients.shape[1] < CARRIED:
        return np.zeros(problem.albedo.size)
    return problem.coefficients[:, 1, 0] / 3.0


def convert_to_kernels(problem: Problem, orders: Sequence[Array]) -> Array:
    """Orders (n_tau, n_in, n_out) of I for unit light as `Task.sum_orders` takes them, (order, n_tau, n_in, n_col,
    n_out, 4)."""
    unit = np.stack(orders)[:, :, :, None, :] * problem.columns[:, 0][:, None]
    kernels = np.zeros((*unit.shape, 4))
    kernels[..., 0] = unit
    return kernels


def answer_two_fluxes(task: Task, problem: Problem, found: TwoFluxes) -> Answer:
    """The result of two fluxes of the problem."""
    request, mu = task.request, task.mu
    parts = task.sum_orders(problem, convert_to_kernels(problem, found.orders), choose_spread(request, problem, mu))
    down, up = (flux[..., None] * problem.columns[:, 0] for flux in (found.down, found.up))
    down = down + find_peak_flux(problem, request.tau)[1]
    name = find_truncation(request, mu).name
    return task.answer(parts, (up, down), problem, orders=len(found.orders), truncation=name)
