"""The diffusion method, P1 of the spherical harmonics, (2:16)-(2:20), in closed form.

Of the diffuse field the irradiance from all sides E_0 and the light vector E are kept. Along the depth (2:19) is

    E_z' = -(1 - omega) E_0 + s_0 e^(-t/mu0),    E_0' = -3 (1 - omega g) E_z + 3 s_z e^(-t/mu0),

s_0 = omega, s_z = omega g mu0 for a beam of unit flux at the layer's top: solved as it stands, so an albedo of 1 is no
special case, as it is of (2:20). Across it E_x (1 - omega g) = omega g sqrt(1 - mu0^2) e^(-t/mu0). The boundary has
E_0 + c E_z = 0 at the top and E_0 - c E_z = 0 at a black base, with c named by the setting "boundary". Radiance is the
source function of this field integrated along each direction, light scattered once with all terms in closed form.
"""

import numpy as np

from vrte.basics.arrays import Array, check_choice
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import integrate_paths
from vrte.discrete_ordinates.orders.small_angle import Ray
from vrte.methods.parts.method import Answer, Method, Setting
from vrte.methods.parts.task import Task
from vrte.methods.parts.two_fluxes import (
    Pile,
    Slab,
    answer_two_fluxes,
    compute_base_light,
    compute_direct_beam,
    compute_level_fluxes,
    cut_to_two,
    find_base_albedo,
    list_asymmetries,
    stack_slabs,
    sum_over_rays,
)

# c of E_0 = c times the net flux out: no flux comes in; no light along P1's node; the exact extrapolation length of a
# half space that conserves energy and scatters evenly, 0.71045 mean free paths
BOUNDARIES = {"marshak": 2.0, "mark": float(np.sqrt(3.0)), "milne": 3.0 * 0.7104460895}


def solve_by_diffusion(task: Task) -> Answer:
    """Orders 0 and 1. Half fluxes are (E_0/c +- E_z)/2, so that they vanish where the boundary says so."""
    c = BOUNDARIES[task.settings["boundary"]]
    problem, base_albedo = cut_to_two(task.request), find_base_albedo(task.request)
    pile = build_pile(problem, base_albedo, c)
    orders = compute_orders(problem, pile, base_albedo, c)
    return answer_two_fluxes(task, problem, orders, compute_fluxes(problem, pile, c))


def build_pile(problem: Problem, base_albedo: float, c: float) -> Pile:
    """Half fluxes times c."""
    slabs = [build_slab(problem, layer, c) for layer in range(problem.albedo.size)]
    return stack_slabs(slabs, base_albedo, c * compute_direct_beam(problem, base_albedo))


def compute_fluxes(problem: Problem, pile: Pile, c: float) -> tuple[Array, Array]:
    """Half fluxes down and up at every depth, (n_tau, n_in), of the layers as they were cut."""
    down, up = compute_level_fluxes(problem, pile)
    return down / c, up / c


def compute_orders(problem: Problem, pile: Pile, base_albedo: float, c: float) -> list[Array]:
    """Multiply scattered light of each order, (n_tau, n_in, n_out), from (2:16)-(2:18)."""
    orders = [
        integrate_scattered_light(problem, pile, c)
        + compute_base_light(problem, base_albedo / (np.pi * c) * pile.x_base)
    ]
    if list_asymmetries(problem).any():
        orders.append(integrate_scattered_across(problem))
    return orders


def build_slab(problem: Problem, layer: int, c: float) -> Slab:
    """A layer for x, y = (E_0 +- c E_z)/2: (2:19), which is (2:20)."""
    albedo, g = float(problem.albedo[layer]), float(list_asymmetries(problem)[layer])
    reaching = albedo * np.exp(-problem.above[layer] / problem.mu0)
    source, vector = c * reaching, 3.0 * g * problem.mu0 * reaching
    loss, hindrance = c * (1.0 - albedo), 3.0 * (1.0 - albedo * g) / c
    thickness = float(problem.thickness[layer])
    return Slab(thickness, loss, hindrance, 1.0 / problem.mu0, 0.5 * (source + vector), 0.5 * (source - vector))


def integrate_scattered_light(problem: Problem, pile: Pile, c: float) -> Array:
    """omega/(4 pi) (E_0 + 3 g mu E_z) integrated along the wanted directions, (n_tau, n_in, n_out)."""

    def along(ray: Ray, mu: Array) -> Array:
        x, y = pile.slabs[ray.layer].seen(ray, mu)
        vector = 3.0 * float(list_asymmetries(problem)[ray.layer]) / c * (-mu if ray.up else mu)
        found: Array = problem.albedo[ray.layer] / (4.0 * np.pi) * ((1.0 + vector) * x + (1.0 - vector) * y)
        return found

    return sum_over_rays(problem, along)


def integrate_scattered_across(problem: Problem) -> Array:
    """Order 1: omega/(4 pi) 3 g sqrt(1 - mu^2) E_x/2 integrated along them, (n_tau, n_in, n_out)."""
    mu = np.concatenate([problem.mu_out[: problem.n_up], -problem.mu_out[problem.n_up :]])
    paths = integrate_paths(problem, np.arange(problem.level.size, dtype=np.int32), mu)
    share = problem.albedo * list_asymmetries(problem)  # of the light that goes on across
    strength = 3.0 / (8.0 * np.pi) * share**2 / (1.0 - share)
    sines = np.sqrt((1.0 - problem.mu0[:, None] ** 2) * (1.0 - mu**2))
    found: Array = np.einsum("k,ktio->tio", strength, paths) * sines
    return found


METHOD = Method(
    name="diffusion",
    solve=solve_by_diffusion,
    purpose="fluxes of thick layers that absorb little; coarse radiance",
    conserves="energy, to the last digits; the wanted directions do not sum to the fluxes",
    source="(2:16)-(2:20)",
    conserves_energy=True,
    base="even",
    options=("nodes", "truncation", "backend"),
    polarization=False,
    settings={
        "boundary": Setting(
            "marshak",
            lambda value: check_choice("setting 'boundary' of method 'diffusion'", value, tuple(BOUNDARIES)),
            "'marshak' (no flux comes in), 'mark' (no light along the cosine 1/sqrt 3) or 'milne' (the exact "
            "extrapolation length of a conservative half space)",
        )
    },
)
