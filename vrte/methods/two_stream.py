"""Discrete ordinates with one node in closed form, 4.1 of the second paper: one direction down, one up, at cosine 1/2.

One node carries two terms of the phase function and so two Fourier orders, each a pair of fluxes of its own. Other
directions come by integration of the source function along them, light scattered once with all terms in closed form.
"""

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.errors import SceneError
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.small_angle import Ray
from vrte.methods.parts.method import Answer, Method
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

NODE = 0.5  # the cosine of one Gaussian node on a hemisphere; its weight is 1


def solve_by_two_streams(task: Task) -> Answer:
    """Orders 0 and 1; fluxes on the node. ``request.nodes`` says along which directions light is wanted by default."""
    problem, base_albedo = cut_to_two(task.request), find_base_albedo(task.request)
    pile = build_pile(problem, base_albedo)
    orders = compute_orders(problem, pile, base_albedo)
    return answer_two_fluxes(task, problem, orders, compute_fluxes(problem, pile))


def build_pile(problem: Problem, base_albedo: float) -> Pile:
    """Order 0: radiance on the node."""
    return stack_slabs(build_slabs(problem, 0), base_albedo, compute_direct_beam(problem, base_albedo) / np.pi)


def compute_fluxes(problem: Problem, pile: Pile) -> tuple[Array, Array]:
    """Down and up at every depth, (n_tau, n_in), of the layers as they were cut."""
    down, up = compute_level_fluxes(problem, pile)
    return np.pi * down, np.pi * up


def compute_orders(problem: Problem, pile: Pile, base_albedo: float) -> list[Array]:
    """Multiply scattered light of each order, (n_tau, n_in, n_out)."""
    orders = [integrate_scattered_light(problem, pile, 0) + compute_base_light(problem, base_albedo * pile.x_base)]
    if list_asymmetries(problem).any():
        orders.append(
            integrate_scattered_light(problem, stack_slabs(build_slabs(problem, 1), 0.0, np.zeros_like(problem.mu0)), 1)
        )
    return orders


def build_slabs(problem: Problem, order: int) -> list[Slab]:
    """The layers for a Fourier order. Raises SceneError where one node makes light grow with depth."""
    return [build_slab(problem, layer, order) for layer in range(problem.albedo.size)]


def build_slab(problem: Problem, layer: int, order: int) -> Slab:
    """One of them: (1:41) for one node."""
    albedo, g = float(problem.albedo[layer]), float(list_asymmetries(problem)[layer])
    ahead, back = (evaluate_phase_function(order, g, sign * NODE, problem.mu0) for sign in (1.0, -1.0))
    onto_node = 3.0 * albedo * g * NODE**2 if order == 0 else 1.5 * albedo * g * (1.0 - NODE**2)
    E, F = (1.0 - albedo, 1.0 - onto_node) if order == 0 else (1.0 - onto_node, 1.0)
    if E < 0.0:
        raise SceneError(
            f"method 'two-stream': on one node an asymmetry of {g:g} with an albedo of {albedo:g} makes light of "
            "order 1 from nothing (9/8 of their product is above 1): ask for truncation 'delta-m'"
        )
    reaching = albedo / (4.0 * np.pi * NODE) * np.exp(-problem.above[layer] / problem.mu0)
    thickness = float(problem.thickness[layer])
    return Slab(thickness, E / NODE, F / NODE, 1.0 / problem.mu0, reaching * ahead, reaching * back)


def evaluate_phase_function(order: int, g: float, mu: Array | float, mu_from: Array | float) -> Array:
    """A^m(mu, mu_from) of two terms, (1:9), cosines positive downward."""
    if order == 0:
        return np.asarray(1.0 + 3.0 * g * np.multiply(mu, mu_from))
    return np.asarray(1.5 * g * np.sqrt((1.0 - np.square(mu)) * (1.0 - np.square(mu_from))))


def integrate_scattered_light(problem: Problem, pile: Pile, order: int) -> Array:
    """Light of the node scattered into the wanted directions, (n_tau, n_in, n_out)."""

    def along(ray: Ray, mu: Array) -> Array:
        x, y = pile.slabs[ray.layer].seen(ray, mu)
        signed, g = (-mu if ray.up else mu), float(list_asymmetries(problem)[ray.layer])
        ahead, back = (evaluate_phase_function(order, g, signed, sign * NODE) for sign in (1.0, -1.0))
        found: Array = 0.5 * problem.albedo[ray.layer] * (ahead * x + back * y)
        return found

    return sum_over_rays(problem, along)


METHOD = Method(
    name="two-stream",
    solve=solve_by_two_streams,
    purpose="fluxes of any layer without a matrix; coarse radiance",
    conserves="energy, to the last digits; the wanted directions do not sum to the fluxes",
    source="4.1, (2:5)-(2:9) with N = 1",
    conserves_energy=True,
    base="even",
    options=("nodes", "truncation", "backend"),
    polarization=False,
)
