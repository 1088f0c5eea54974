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
    asymmetry,
    base_albedo_of,
    collected,
    cut_to_two,
    direct_beam,
    from_base,
    levels_of,
    piled,
)

NODE = 0.5  # the cosine of one Gaussian node on a hemisphere; its weight is 1


def solve_by_two_streams(task: Task) -> Answer:
    """Orders 0 and 1; fluxes on the node. ``request.nodes`` says along which directions light is wanted by default."""
    problem, base_albedo = cut_to_two(task.request), base_albedo_of(task.request)
    pile = pile_of(problem, base_albedo)
    orders = field_of(problem, pile, base_albedo)
    return answer_two_fluxes(task, problem, orders, fluxes_of(problem, pile))


def pile_of(problem: Problem, base_albedo: float) -> Pile:
    """Order 0: radiance on the node."""
    return piled(slabs_of(problem, 0), base_albedo, direct_beam(problem, base_albedo) / np.pi)


def fluxes_of(problem: Problem, pile: Pile) -> tuple[Array, Array]:
    """Down and up at every depth, (n_tau, n_in), of the layers as they were cut."""
    down, up = levels_of(problem, pile)
    return np.pi * down, np.pi * up


def field_of(problem: Problem, pile: Pile, base_albedo: float) -> list[Array]:
    """Multiply scattered light of each order, (n_tau, n_in, n_out)."""
    orders = [scattered(problem, pile, 0) + from_base(problem, base_albedo * pile.x_base)]
    if asymmetry(problem).any():
        orders.append(scattered(problem, piled(slabs_of(problem, 1), 0.0, np.zeros_like(problem.mu0)), 1))
    return orders


def slabs_of(problem: Problem, order: int) -> list[Slab]:
    """The layers for a Fourier order. Raises SceneError where one node makes light grow with depth."""
    return [slab_of(problem, layer, order) for layer in range(problem.albedo.size)]


def slab_of(problem: Problem, layer: int, order: int) -> Slab:
    """One of them: (1:41) for one node."""
    albedo, g = float(problem.albedo[layer]), float(asymmetry(problem)[layer])
    ahead, back = (phase_of(order, g, sign * NODE, problem.mu0) for sign in (1.0, -1.0))
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


def phase_of(order: int, g: float, mu: Array | float, mu_from: Array | float) -> Array:
    """A^m(mu, mu_from) of two terms, (1:9), cosines positive downward."""
    if order == 0:
        return np.asarray(1.0 + 3.0 * g * np.multiply(mu, mu_from))
    return np.asarray(1.5 * g * np.sqrt((1.0 - np.square(mu)) * (1.0 - np.square(mu_from))))


def scattered(problem: Problem, pile: Pile, order: int) -> Array:
    """Light of the node scattered into the wanted directions, (n_tau, n_in, n_out)."""

    def along(ray: Ray, mu: Array) -> Array:
        x, y = pile.slabs[ray.layer].seen(ray, mu)
        signed, g = (-mu if ray.up else mu), float(asymmetry(problem)[ray.layer])
        ahead, back = (phase_of(order, g, signed, sign * NODE) for sign in (1.0, -1.0))
        found: Array = 0.5 * problem.albedo[ray.layer] * (ahead * x + back * y)
        return found

    return collected(problem, along)


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
