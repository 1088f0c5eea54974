"""The matrices that methods on nodes share: what a thin layer and the base scatter, Fourier order by Fourier order.

Light is a column of Stokes vectors along positive cosines, upward light in the flipped frame D I(-mu). Rows are the
nodes, then the outgoing directions, which are nodes of weight zero; columns are the nodes, then the beams, which carry
light and get none. Outgoing directions get nothing from beams: light scattered once is summed in closed form over all
orders, so that what these matrices lead to is multiple scattering alone.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.polarization import FLIP
from vrte.discrete_ordinates.orders.base import find_reflected_orders
from vrte.discrete_ordinates.orders.phase_assembly import find_even_shifts
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.responses import scatter_once
from vrte.methods.parts.task import Task
from vrte.scene.boundary import Boundary


class Scattered(NamedTuple):
    """What a layer scatters per optical depth, forwards and backwards, each (r, c): (omega/2) A W/mu of the row."""

    ahead: Array
    back: Array


@dataclass(frozen=True, eq=False)
class OnNodes:
    """A problem with distinct outgoing cosines, seen as rows and columns, over a base."""

    problem: Problem
    base: Boundary

    @cached_property
    def members(self) -> list[int]:
        """Stokes parameters at work: I alone where it is the only one that is scattered and no surface mirrors it."""
        alone = self.problem.is_scalar and not self.base.mixes_stokes and self.problem.media is None
        return [0] if alone else [0, 1, 2, 3]

    @property
    def n(self) -> int:
        """Unknowns of a hemisphere, S N."""
        return len(self.members) * self.problem.nodes.size

    @cached_property
    def rows(self) -> Array:
        """Cosines of the rows, (r,)."""
        return np.repeat(np.concatenate([self.problem.nodes, self.problem.mu_out]), len(self.members))

    @cached_property
    def columns(self) -> Array:
        """Cosines of the columns, (c,)."""
        nodes = np.repeat(self.problem.nodes, len(self.members))
        return np.concatenate([nodes, np.repeat(self.problem.mu0, self.problem.columns.shape[0])])

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Unknowns of a hemisphere, rows with the outgoing directions, columns with the beams, for predictions."""
        return float(self.n), float(self.rows.size), float(self.columns.size)

    @property
    def n_order(self) -> int:
        """Fourier orders that any layer scatters."""
        return int(self.problem.coefficients.shape[1])

    def scattered(self, order: int, layer: int) -> Scattered:
        """What a layer scatters, (1:18)-(1:23)."""
        problem = self.problem
        table = problem.coefficients[layer, : problem.terms[layer]]
        rows, into = (np.concatenate([problem.nodes, more]) for more in (problem.mu_out, problem.mu0))
        strength = 0.5 * problem.albedo[layer] / rows[:, None, None, None]
        if order == 0 and not problem.is_exact:
            shifts = find_even_shifts(problem, int(problem.terms.max()))
            back, ahead = scatter_once(order, table, rows, into, shifts) * strength
            return Scattered(self.operator(ahead), self.operator(back))
        ahead = _core.phase_matrices(order, table, rows, into) * strength
        back = _core.phase_matrices(order, table, rows, -into) * strength * FLIP
        return Scattered(self.operator(ahead), self.operator(back))

    def ground(self) -> Array:
        """What the base sends back of light that falls onto it, (order, r, c): R^m mu W, (1:35), (1:66)."""
        problem = self.problem
        result = np.zeros((self.n_order, self.rows.size, self.columns.size))
        into = np.concatenate([problem.nodes, problem.mu0])
        orders = find_reflected_orders(self.base, problem, self.n_order)[0]
        for found, matrix in zip(result, orders, strict=False):
            found[:] = self.operator((matrix * into[:, None, None, None] * FLIP[:, None]).transpose(1, 0, 2, 3))
        return result

    def operator(self, matrices: Array) -> Array:
        """(r, c) from Mueller matrices (row, node or beam, 4, 4), weights put in."""
        problem, n_node = self.problem, self.problem.nodes.size
        on_nodes = matrices[:, :n_node][:, :, self.members][..., self.members] * problem.weights[:, None, None]
        beams = np.einsum("riab,cb->raic", matrices[:, n_node:], problem.columns)[:, self.members]
        beams[n_node:] = 0.0
        left = on_nodes.transpose(0, 2, 1, 3).reshape(self.rows.size, self.n)
        return np.concatenate([left, beams.reshape(self.rows.size, -1)], axis=1)

    def kernels(self, up: Array, down: Array, out: IntArray, n_up: int) -> Array:
        """Radiance for a unit beam, public frame, (..., n_in, n_col, n_out, 4), light going up first.

        up, down (..., r, n_rhs): light along the rows; out (n_out,): places among the distinct outgoing cosines.
        """
        problem, stokes = self.problem, len(self.members)
        shape = (problem.mu_out.size, stokes, problem.mu0.size, problem.columns.shape[0])
        along = [
            np.moveaxis(light[..., self.n :, :].reshape(*light.shape[:-2], *shape), (-4, -3), (-2, -1))
            for light in (up, down)
        ]
        result = np.zeros((*along[0].shape[:-2], out.size, 4))
        result[..., :n_up, self.members] = along[0][..., out[:n_up], :] * FLIP[self.members]
        result[..., n_up:, self.members] = along[1][..., out[n_up:], :]
        return result / (2.0 * np.pi)

    def flux(self, light: Array) -> Array:
        """Flux (..., n_in, n_col) of the diffuse light of order 0, (..., r, n_rhs)."""
        problem = self.problem
        intensity = light[..., : self.n : len(self.members), :]
        found = np.einsum("...nb,n->...b", intensity, problem.weights * problem.nodes)
        return found.reshape(*found.shape[:-1], problem.mu0.size, problem.columns.shape[0])


def solve_in_turn(
    task: Task, on_nodes: OnNodes, out: IntArray, field: Callable[[int, Array], tuple[Array, Array]]
) -> tuple[Array, tuple[Array, Array]]:
    """Kernels of all Fourier orders (order, n_tau, n_in, n_col, n_out, 4) and fluxes up and down (n_tau, n_in, n_col).

    ``field``(order, what the base sends back): light up and down at the depths wanted, each (n_tau, r, n_rhs).
    """
    problem = task.problem
    beams = problem.mu0.size, problem.columns.shape[0]
    shape = (on_nodes.n_order, problem.level.size, *beams, out.size, 4)
    kernels, fluxes = np.empty(shape), (np.zeros(shape[1:4]), np.zeros(shape[1:4]))
    ground = on_nodes.ground()
    for order in range(on_nodes.n_order):
        up, down = field(order, ground[order])
        kernels[order] = on_nodes.kernels(up, down, out, problem.n_up)
        if order == 0:
            fluxes = on_nodes.flux(up), on_nodes.flux(down)
        task.tell(order + 1, on_nodes.n_order)
    return kernels, fluxes


def find_distinct_directions(problem: Problem) -> tuple[Problem, IntArray]:
    """The problem with each outgoing cosine once, and which of them each direction has."""
    cosines, out = np.unique(problem.mu_out, return_inverse=True)
    return replace(problem, mu_out=cosines), out.astype(np.int32)
