"""Fourier orders of light that oriented flakes scatter, on the nodes of a problem and from and to directions off them.

With Z per unit of depth the flakes' part of E and F, (1:41), is that of particles with omega A^m = 4 pi Z^m, Z^m the
mean over azimuth; their diagonal has k(mu)/mu where particles alone have 1/mu, and what is seen along mu is over k(mu).
"""

from typing import TYPE_CHECKING

import numpy as np

from vrte.basics.arrays import LARGEST_SHARE, MOST_BYTES, Array, IntArray, Remembered
from vrte.basics.memory import BYTES
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import RefractedNodes
from vrte.optics.flake_orders import gather_flake_orders
from vrte.optics.flakes import Flakes
from vrte.scene.oriented import Oriented

_EXPANDED = Remembered()
ACCURACY = 1e-9  # of the integrals over flakes
RECIPROCAL = np.diag([1.0, 1.0, 1.0, -1.0])
SAMPLES = 17  # directions in which the share of light that is scattered is looked at
LEAST, MOST = 1e-12, 1.0 - 1e-12  # of it

if TYPE_CHECKING:
    from vrte.discrete_ordinates.orders.phase_assembly import Assembled
    from vrte.discrete_ordinates.orders.problem import Problem


def expand_flakes(
    flakes: Flakes, nodes: RefractedNodes, out: Array, into: Array, n_order: int, threads: int, first_order: int = 0
) -> tuple[Array, Array]:
    """4 pi Z^m of a unit of flake area, n_order of them from a first one on, let through and reflected, in the flipped
    frame: from the nodes of the flakes' medium to these and to cosines ``out`` there, (2, order, N + n_out, N, 4, 4),
    and from cosines ``into`` to the nodes, (2, order, N, n_in, 4, 4). To directions off the nodes by reciprocity, Z_12
    = Q Z_21^T Q."""
    along = np.concatenate([out, into])
    found = 2.0 * gather_flake_orders(flakes, nodes, along, n_order, ACCURACY, threads, first_order)
    found = found.transpose(2, 0, 3, 1, 4, 5)  # (way, order, node, direction, 4, 4)
    found[1] *= FLIP[:, None]
    last, end = found.shape[2], found.shape[2] + out.size
    seen = RECIPROCAL @ found[:, :, :, last:end].transpose(0, 1, 3, 2, 5, 4) @ RECIPROCAL
    return np.concatenate([found[:, :, :, :last], seen], axis=2), found[:, :, :, end:]


def add_flakes(problem: "Problem", matrices: "Assembled", orders: IntArray, threads: int) -> None:
    """Adds what flakes do in each layer to the matrices of particles."""
    nodes, members, stokes = problem.nodes, list(problem.stokes), len(problem.stokes)
    for k, one in enumerate(problem.oriented):
        if one is None:
            continue
        step, first, flux = count_orders_together(problem), -1, find_flux(problem, one)
        for row, order in enumerate(orders.tolist()):
            if order // step * step != first:
                first = order // step * step
                of_nodes, of_beams = find_orders(problem, one, first, step, threads)
            for E, G, source, sign in (
                (matrices.E, matrices.G_E, matrices.source_d, 1.0),
                (matrices.F, matrices.G_F, matrices.source_s, -1.0),
            ):
                own = order - first
                parts = [0.5 * one.area * (part[0, own] + sign * part[1, own]) for part in (of_nodes, of_beams)]
                blocks, lit = (part[..., members, :][..., members] for part in parts)
                found = scale_on_nodes(problem, blocks, lit)
                if order == 0 and sign > 0.0 and problem.conserves:
                    found = balance_flakes(problem, one.area * flux, *found)
                E[row, k] -= found[0].T
                G[row, k] += found[1].T
                source[row, k] += found[2].T
        seen = np.repeat(one.attenuate(problem.mu_out), stokes)
        lost = (one.extinguish(nodes) - np.eye(4))[:, members][:, :, members] / nodes[:, None, None]
        apart = np.arange(problem.size).reshape(nodes.size, stokes)
        for E, G in ((matrices.E, matrices.G_E), (matrices.F, matrices.G_F)):
            E[:, k, apart[:, None], apart[:, :, None]] += lost  # the last axis of E is that of rows
            G[:, k] /= seen


def scale_on_nodes(problem: "Problem", blocks: Array, lit: Array) -> tuple[Array, Array, Array]:
    """Matrices on the scaled nodes, rows first, of blocks from the nodes to nodes and outgoing directions, (N + n_out,
    N, S, S), and from beams to the nodes, (N, n_in, S, S)."""
    last, scale = problem.nodes.size, np.sqrt(problem.weights / problem.nodes)[:, None, None]
    blocks = blocks * scale
    return lay_out(blocks[:last] * scale[:, None]), lay_out(blocks[last:]), lay_out(lit * scale[:, None])


def balance_flakes(problem: "Problem", flux: Array, E: Array, G: Array, source: Array) -> tuple[Array, Array, Array]:
    """Matrices of order 0, rows first, whose rows and columns of I have gained what the nodes miss of the flux of light
    scattered once, as `balance_one` of core/assembly.pxi has it for particles: then no flux is lost but to flakes.
    ``flux`` (n_all, 2): what is scattered of light along the nodes, outgoing and incident directions."""
    stokes, total, root = len(problem.stokes), problem.weights.sum(), np.sqrt(problem.weights * problem.nodes)
    null, unit = np.zeros(problem.size), np.zeros(problem.size)
    null[::stokes], unit[::stokes] = root, root / problem.nodes / total

    sent = np.zeros((len(flux), stokes))
    sent[:, :2] = flux[:, :stokes]
    of_nodes, of_out, of_beams = np.split(sent, np.cumsum([root.size, problem.mu_out.size]))
    missed = (of_nodes * (root / problem.nodes)[:, None]).ravel() - null @ E
    rest = missed - (missed @ null) * unit
    even = np.zeros(stokes)
    even[0] = 1.0 / total
    E = E + np.outer(unit, missed) + np.outer(rest, unit)
    G = G + np.outer(of_out.ravel() - G @ null, unit) + np.outer(np.tile(even, problem.mu_out.size), rest)
    source = source + np.outer(unit, of_beams.ravel() - null @ source)
    return E, G, source + np.outer(rest, np.tile(even, problem.mu0.size))


def find_largest_albedo(one: Oriented, scattered: float) -> float:
    """Share of light that is scattered along the direction that loses least, of particles that scatter so much per unit
    of depth and of flakes: below 1, as both lose some, and above 0, since flakes attenuate where nothing scatters."""
    mu = np.linspace(0.0, 1.0, SAMPLES)
    share = (scattered + one.area * one.flakes.scatter_flux(mu)[:, 0]) / one.attenuate(mu)
    return min(max(float(share.max()), LEAST), MOST)


def count_orders_together(problem: "Problem") -> int:
    """How many Fourier orders of flakes are made at a time, and remembered."""
    each = 32 * BYTES * problem.nodes.size * problem.directions.size
    return max(1, min(problem.coefficients.shape[1], int(LARGEST_SHARE * MOST_BYTES / each)))


def find_orders(problem: "Problem", one: Oriented, first: int, count: int, threads: int) -> tuple[Array, ...]:
    """`expand_flakes` of ``count`` orders from a first one on, or those that are left, for the directions of a problem
    in one of its media. They are remembered: neither how many flakes there are nor what else the scene has matters."""
    media, out, into = problem.media, problem.mu_out, problem.mu0
    assert media is not None
    nodes, some = media.nodes, min(count, problem.coefficients.shape[1] - first)
    placed = tuple(part.tobytes() for part in (nodes.highest, nodes.depth, nodes.measure, out, into))
    key = one.flakes, nodes.panels, placed, first, some
    return _EXPANDED.find(key, lambda: expand_flakes(one.flakes, nodes, out, into, some, threads, first))


def find_flux(problem: "Problem", one: Oriented) -> Array:
    """`Flakes.scatter_flux` for the directions of a problem, remembered likewise."""
    along = problem.directions
    return _EXPANDED.find((one.flakes, along.tobytes()), lambda: (one.flakes.scatter_flux(along),))[0]


def lay_out(blocks: Array) -> Array:
    """A matrix (n_out S, n_in S) of blocks (n_out, n_in, S, S)."""
    return blocks.transpose(0, 2, 1, 3).reshape(blocks.shape[0] * blocks.shape[2], -1)
