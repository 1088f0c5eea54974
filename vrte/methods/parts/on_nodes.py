"""What a layer scatters among the nodes, from beams and towards directions off the nodes, Fourier order by order.

Light is a column of Stokes vectors along positive cosines, upward light in the flipped frame D I(-mu). Rows are the
nodes, then the outgoing directions; columns are the nodes, then the beams. Beams scatter into the nodes alone: light
scattered once is added in closed form over all orders, so that these matrices lead to multiple scattering.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.quadrature import Panel, RefractedNodes
from vrte.discrete_ordinates.orders.media import Media
from vrte.discrete_ordinates.orders.phase_assembly import find_even_shifts
from vrte.discrete_ordinates.orders.problem import ALL, Problem
from vrte.discrete_ordinates.orders.slab_response import scatter_once
from vrte.request.request import Request
from vrte.scene.beams import locate_depths


def connect_media(request: Request, problem: Problem) -> Problem:
    """A request's problem with nodes that Snell's law links through its media, also where there is but one of these;
    for I alone where only I is scattered and mirrored."""
    scene = request.scene
    if problem.media is not None:
        return problem
    index, nodes = scene.media[0], problem.nodes
    panel = 0, nodes.size, Panel(0.0, index, np.inf, problem.grading)
    shared = RefractedNodes(
        np.full(nodes.size, index), (index * nodes) ** 2, index**2 * nodes * problem.weights, (panel,)
    )
    under = np.zeros(request.tau.size, bool) if request.under is None else request.under
    stokes = (0,) if problem.is_scalar and not scene.below.mixes_stokes else ALL
    columns = np.ascontiguousarray(problem.columns[:, list(stokes)])
    return replace(
        problem, media=Media(scene, shared, locate_depths(scene, request.tau, under)), stokes=stokes, columns=columns
    )


def count_sizes(request: Request, problem: Problem) -> tuple[float, float, float]:
    """Unknowns of a hemisphere, rows with the outgoing directions, columns with the beams, for predictions."""
    problem = connect_media(request, problem)
    stokes, n = len(problem.stokes), problem.size
    return float(n), float(n + stokes * np.unique(problem.mu_out).size), float(n + stokes * problem.mu0.size)


class Scattered(NamedTuple):
    """What a layer scatters per optical depth, forwards and backwards, each (r, c): (omega/2) A W/mu of the row."""

    ahead: Array
    back: Array


@dataclass(frozen=True, eq=False)
class OnNodes:
    """A problem seen as rows and columns; its columns (n_col, S) are incident Stokes vectors."""

    problem: Problem

    @property
    def n(self) -> int:
        """Unknowns of a hemisphere, S N."""
        return self.problem.size

    @cached_property
    def rows(self) -> Array:
        """Cosines of the rows, (r,)."""
        return np.repeat(np.concatenate([self.problem.nodes, self.problem.mu_out]), len(self.problem.stokes))

    @cached_property
    def columns(self) -> Array:
        """Cosines of the columns, (c,)."""
        nodes = np.repeat(self.problem.nodes, len(self.problem.stokes))
        return np.concatenate([nodes, np.repeat(self.problem.mu0, self.problem.columns.shape[0])])

    def scatter(self, order: int, layer: int) -> Scattered:
        """What a layer scatters, (1:18)-(1:23)."""
        problem = self.problem
        table = problem.coefficients[layer, : problem.terms[layer]]
        rows, into = (np.concatenate([problem.nodes, more]) for more in (problem.mu_out, problem.mu0))
        strength = 0.5 * problem.albedo[layer] / rows[:, None, None, None]
        shifts = find_even_shifts(problem, int(problem.terms.max()))
        back, ahead = scatter_once(order, table, rows, into, shifts) * strength
        return Scattered(self.put_in_weights(ahead), self.put_in_weights(back))

    def put_in_weights(self, matrices: Array) -> Array:
        """(r, c) from Mueller matrices (row, node or beam, 4, 4): quadrature weights of nodes, Stokes vectors of
        beams."""
        problem, n_node, members = self.problem, self.problem.nodes.size, list(self.problem.stokes)
        matrices = matrices[..., members, :][..., members]
        on_nodes = matrices[:, :n_node] * problem.weights[:, None, None]
        beams = np.einsum("riab,cb->raic", matrices[:, n_node:], problem.columns)
        beams[n_node:] = 0.0
        left = on_nodes.transpose(0, 2, 1, 3).reshape(self.rows.size, self.n)
        return np.concatenate([left, beams.reshape(self.rows.size, -1)], axis=1)
