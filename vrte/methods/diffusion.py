"""The diffusion method, P1 of the spherical harmonics, (2:16)-(2:20).

Of the diffuse field the irradiance from all sides E_0 and the light vector E are kept. Along the depth (2:19) is

    E_z' = -(1 - omega) E_0 + s_0 e^(-t/mu0),    E_0' = -3 (1 - omega g) E_z + 3 s_z e^(-t/mu0),

s_0 = omega, s_z = omega g mu0 for a beam of unit flux at the layer's top: solved as it stands, so an albedo of 1 is no
special case, as it is of (2:20). Across it E_x (1 - omega g) = omega g sqrt(1 - mu0^2) e^(-t/mu0). The boundary has
E_0 + c E_z = 0 at the top and E_0 - c E_z = 0 at a black base, with c named by the setting "boundary". Radiance is the
source function of this field integrated along each direction, light scattered once with all terms in closed form.
"""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.methods.parts.method import Answer, Task
from vrte.methods.parts.two_fluxes import (
    TwoFluxes,
    answer_two_fluxes,
    cut_to_two,
    list_asymmetries,
    put_on_one_node,
    solve_one_node,
)
from vrte.scene.boundary import Boundary

# c of E_0 = c times the net flux out: no flux comes in; no light along P1's node; the exact extrapolation length of a
# half space that conserves energy and scatters evenly, 0.71045 mean free paths
BOUNDARIES = {"marshak": 2.0, "mark": float(np.sqrt(3.0)), "milne": 3.0 * 0.7104460895}


def solve_by_diffusion(task: Task) -> Answer:
    """Orders 0 and 1."""
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
