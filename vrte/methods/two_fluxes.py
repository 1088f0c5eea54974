"""Two fluxes: the two-stream and the diffusion method.

Light going down and up is x(t) and y(t), t from the top of a layer. With s = x + y and d = x - y, a = 1/mu0,

    s' = -F d + source_s e^(-a t),    d' = -E s + source_d e^(-a t),    E >= 0 and F > 0,

which is discrete ordinates on one node, (1:40)-(1:41): its stages solve it. Other directions come by integration of
the source function along them, light scattered once with all terms in closed form. The two-stream method, 4.1 of the
second paper, has one node at the cosine 1/2: two terms of the phase function and so two Fourier orders.

The diffusion method, P1 of the spherical harmonics, (2:16)-(2:20), keeps the irradiance from all sides E_0 and the
light vector E of the diffuse field. Along the depth (2:19) is

    E_z' = -(1 - omega) E_0 + s_0 e^(-t/mu0),    E_0' = -3 (1 - omega g) E_z + 3 s_z e^(-t/mu0),

s_0 = omega, s_z = omega g mu0 for a beam of unit flux at the layer's top: solved as it stands, so an albedo of 1 is no
special case, as it is of (2:20). Across it E_x (1 - omega g) = omega g sqrt(1 - mu0^2) e^(-t/mu0). The boundary has
E_0 + c E_z = 0 at the top and E_0 - c E_z = 0 at a black base, with c named by the setting "boundary".
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array, record
from vrte.basics.errors import SceneError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base, expand_base
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.discrete_ordinates.orders.stages import finish_stages, list_known
from vrte.discrete_ordinates.orders.truncating import (
    Truncation,
    choose_truncation,
    find_peak_flux,
    find_spread_directions,
)
from vrte.methods.parts.method import Answer, Task, discretise_request, find_cosines
from vrte.request.how import FINEST
from vrte.request.request import Request
from vrte.scene.boundary import Boundary

CARRIED = 2  # terms of a phase function


@record
class TwoFluxes:
    """Orders of I, (order, n_tau, n_in, n_out), and fluxes (n_tau, n_in), of unit beams and of layers as cut."""

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
    known = list_known(problem, orders, False, base) | vars(matrices) | {"base_row": base.row[orders]}
    found, _ = finish_stages(problem, known, run)
    return TwoFluxes([*found.kernels[:, :, :, 0, :, 0]], found.flux_down[..., 0], found.flux_up[..., 0])


def cut_to_two(request: Request) -> Problem:
    """The scene with two terms of each phase function, truncated as discrete ordinates on one node would."""
    return discretise_request(request, CARRIED // 2, find_truncation(request, find_cosines(request)).peaks)


def find_truncation(request: Request, mu: Array) -> Truncation:
    """What discrete ordinates with one node would take, light near the beam counting wherever there is any."""
    given = request.scene, request.mu0, request.columns, mu, request.tau
    return choose_truncation(request.truncation, *given, CARRIED // 2, FINEST)


def list_asymmetries(problem: Problem) -> Array:
    """g of each layer, (layer,), as it was cut."""
    if problem.coefficients.shape[1] < CARRIED:
        return np.zeros(problem.albedo.size)
    return problem.coefficients[:, 1, 0] / 3.0


def convert_to_kernels(problem: Problem, orders: Sequence[Array]) -> Array:
    """Orders (n_tau, n_in, n_out) of I for unit light as (order, n_tau, n_in, n_col, n_out, 4)."""
    unit = np.stack(orders)[:, :, :, None, :] * problem.columns[:, 0][:, None]
    kernels = np.zeros((*unit.shape, 4))
    kernels[..., 0] = unit
    return kernels


def answer_two_fluxes(task: Task, problem: Problem, found: TwoFluxes) -> Answer:
    """The result of two fluxes of the problem."""
    cut = find_truncation(task.request, task.mu)
    spread = find_spread_directions(cut, problem, task.mu)  # directions where the beam spreads before it scatters once
    parts = task.sum_orders(problem, convert_to_kernels(problem, found.orders), spread)
    down, up = (flux[..., None] * problem.columns[:, 0] for flux in (found.down, found.up))
    down = down + find_peak_flux(problem, task.request.tau)[1]
    return task.answer(parts, (up, down), problem, orders=len(found.orders), truncation=cut.name)


NODE, WEIGHT = 0.5, 1.0  # of Gauss's rule with one node on a hemisphere


def solve_by_two_streams(task: Task) -> Answer:
    """Orders 0 and 1; fluxes on the node. ``request.nodes`` says along which directions light is wanted by default."""
    problem = cut_to_two(task.request)
    return answer_two_fluxes(task, problem, solve_two_streams(problem, task.request.scene.below, task.run))


def solve_two_streams(problem: Problem, below: Boundary, run: Run) -> TwoFluxes:
    """The field of a problem cut to two terms. Raises SceneError where one node makes light grow with depth."""
    asymmetries = list_asymmetries(problem)
    one = put_on_one_node(problem, NODE, WEIGHT)
    matrices = assemble(one, np.arange(2 if asymmetries.any() else 1, dtype=np.int32), run)
    for g, albedo in zip(asymmetries.tolist(), problem.albedo.tolist(), strict=True):
        if 1.5 * albedo * g * (1.0 - NODE**2) > 1.0:  # E of order 1 below 0
            raise SceneError(
                f"method 'two-stream': on one node an asymmetry of {g:g} with an albedo of {albedo:g} makes light of "
                "order 1 from nothing (9/8 of their product is above 1): ask for truncation 'delta-m'"
            )
    return solve_one_node(one, matrices, expand_base(below, one, len(matrices.E)), run)


# c of E_0 = c times the net flux out: no flux comes in; no light along P1's node; the exact extrapolation length of a
# half space that conserves energy and scatters evenly, 0.71045 mean free paths
BOUNDARIES = {"marshak": 2.0, "mark": float(np.sqrt(3.0)), "milne": 3.0 * 0.7104460895}


def solve_by_diffusion(task: Task) -> Answer:
    """Diffusion: the moments of order 0 and 1 of the radiance."""
    problem = cut_to_two(task.request)
    c = BOUNDARIES[task.settings["boundary"]]
    return answer_two_fluxes(task, problem, solve_diffusion(problem, task.request.scene.below, c, task.run))


def solve_diffusion(problem: Problem, below: Boundary, c: float, run: Run) -> TwoFluxes:
    """The field of a problem cut to two terms, (2:16)-(2:20): s = E_0 and d = c E_z on a node of the cosine and weight
    1/c, half fluxes (E_0/c +- E_z)/2, so that they vanish where the boundary says so."""
    one = put_on_one_node(problem, 1.0 / c, 1.0 / c)
    omega, g = problem.albedo[:, None], list_asymmetries(problem)[:, None]
    sources = omega * np.ones_like(problem.mu0), 3.0 * g * omega * problem.mu0  # of E_z', of E_0'

    def shape(values: Array) -> Array:  # (order, layer, ...)
        return np.ascontiguousarray(values[None])

    matrices = Assembled(
        E=shape(c * (1.0 - omega)[..., None]),
        F=shape(3.0 / c * (1.0 - omega * g)[..., None]),
        G_E=shape((omega * np.ones_like(problem.mu_out))[:, None]),
        G_F=shape((3.0 / c * omega * g * problem.mu_out)[:, None]),
        source_s=shape(sources[1][..., None]),
        source_d=shape(c * sources[0][..., None]),
    )
    albedo = below.even_albedo
    base = Base(
        row=np.zeros(1, np.int32),
        matrix=np.full((1, 1, 1), albedo),
        source=c * albedo * problem.mu0[None, :, None],
        out=np.full((1, 1, problem.mu_out.size), 2.0 * albedo / c),
    )
    found = solve_one_node(one, matrices, base, run)
    orders = [*found.orders, integrate_scattered_across(problem)] if g.any() else found.orders
    return TwoFluxes(orders, found.down, found.up)


def integrate_scattered_across(problem: Problem) -> Array:
    """Order 1: omega/(4 pi) 3 g sqrt(1 - mu^2) E_x/2 integrated along them, (n_tau, n_in, n_out)."""
    mu = np.concatenate([problem.mu_out[: problem.n_up], -problem.mu_out[problem.n_up :]])
    paths = integrate_paths(problem, np.arange(problem.level.size, dtype=np.int32), mu)
    share = problem.albedo * list_asymmetries(problem)  # of the light that goes on across
    strength = 3.0 / (8.0 * np.pi) * share**2 / (1.0 - share)
    sines = np.sqrt((1.0 - problem.mu0[:, None] ** 2) * (1.0 - mu**2))
    return np.einsum("k,ktio->tio", strength, paths) * sines
