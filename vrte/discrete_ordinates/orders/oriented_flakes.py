"""Fourier orders of light that oriented flakes scatter, on the nodes of a problem and from and to directions off them.

With Z per unit of depth the flakes' part of E and F, (1:41), is that of particles with omega A^m = 4 pi Z^m, Z^m the
mean over azimuth; their diagonal has k(mu)/mu where particles alone have 1/mu, and what is seen along mu is over k(mu).
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import RefractedNodes, find_gauss_legendre, make_double_gauss
from vrte.optics.facet_integrals import NODES_AT_ONCE, find_cosines, interpolate_nodes, list_panels
from vrte.optics.flakes import Flakes
from vrte.scene.oriented import Oriented

POINTS = 16  # of Gauss's rule in a panel of tilts, and on either side of the azimuth where flakes are lit edgewise
AZIMUTHS = 40  # points of the rule over azimuths that flakes send light to
SEEN, ENDS, BESIDE = 1e-9, 50.0, 10  # of a lobe what counts; orders of it times its reach [rad], and beside them
GROUPED = 8  # orders that directions may differ by which are summed together
PIECE = 8  # points of a piece of an integral over cosines
FACTORS = 2.0 ** np.arange(-2, 8)  # of a cosine, between which integrals towards the horizon have pieces
STEPS_OF_TILT = np.arange(-8.0, 8.5, 2.0)  # of a direction, in widths of tilts, between which they have others
RECIPROCAL = np.diag([1.0, 1.0, 1.0, -1.0])
SAMPLES = 17  # directions in which the share of light that is scattered is looked at
LEAST, MOST = 1e-12, 1.0 - 1e-12  # of it

if TYPE_CHECKING:
    from vrte.discrete_ordinates.orders.phase_assembly import Assembled
    from vrte.discrete_ordinates.orders.problem import Problem


def expand_flakes(
    flakes: Flakes, nodes: RefractedNodes, index: float, out: Array, into: Array, n_order: int
) -> tuple[Array, Array]:
    """4 pi Z^m of a unit of flake area, let through and reflected, in the flipped frame: from the nodes of a medium to
    these and to cosines ``out`` of it, (2, order, N + n_out, N, 4, 4), and from cosines ``into`` to the nodes, (2,
    order, N, n_in, 4, 4). Z kinks where light goes straight on: light is interpolated between the nodes and integrated
    (product integration). What a beam sends to the nodes is the same the other way round, Z_12 = Q Z_21^T Q; between
    nodes it is the mean of both."""
    mu, _ = nodes.carried(index)
    found = gather_orders(flakes, nodes, index, np.concatenate([mu, out, into]), n_order)
    turned = RECIPROCAL @ found.transpose(0, 1, 3, 2, 5, 4) @ RECIPROCAL
    last = mu.size + out.size
    from_nodes = found[:, :, :last].copy()
    from_nodes[:, :, : mu.size] = 0.5 * (found[:, :, : mu.size] + turned[..., : mu.size, :, :])
    return from_nodes, turned[..., last:, :, :]


def gather_orders(flakes: Flakes, nodes: RefractedNodes, index: float, out: Array, n_order: int) -> Array:
    """4 pi Z^m from the nodes of a medium to cosines of it, (2, order, n_out, N, 4, 4), over the nodes' weights."""
    mu_node, weight = nodes.carried(index)
    found = np.zeros((2, n_order, out.size, mu_node.size, 4, 4))
    x_piece, w_piece = make_double_gauss(PIECE)
    for place, panel, x_node in list_panels(nodes, index):
        between = np.append(0.5 * (x_node[:-1] + x_node[1:])[NODES_AT_ONCE - 1 :: NODES_AT_ONCE], [0.0, 1.0])
        for row, mu in enumerate(out.tolist()):
            met = find_edges(flakes, mu)
            sine = index * np.sqrt((1.0 - met) * (1.0 + met))
            edges = np.unique(np.append(panel.locate((panel.high - sine) * (panel.high + sine)), between))
            size = np.diff(edges)[:, None]
            x, share = (edges[:-1, None] + size * x_piece).ravel(), (size * w_piece).ravel()
            depth, rate = panel.spread(x)
            met = find_cosines(index, panel, depth)
            weights = (4.0 * math.pi * share * rate / (index * index * met))[:, None] * interpolate_nodes(x_node, x)
            # light of odd orders is the sine times what is smooth
            odd = np.sqrt((1.0 - met) * (1.0 + met))[:, None] / np.sqrt((1.0 - mu_node[place]) * (1.0 + mu_node[place]))
            for way, sign in enumerate((-1.0, 1.0)):
                there = np.flatnonzero(find_reach(flakes, sign * mu, -met) > 0.0)
                for some, orders in integrate_azimuths(flakes, sign * mu, -met[there], n_order):
                    own = weights[there[some]], (weights * odd)[there[some]]
                    for parity, shares in enumerate(own):
                        summed = np.tensordot(orders[parity::2], shares, (1, 0))  # (order, 4, 4, node)
                        found[way, parity : len(orders) : 2, row, place] += np.moveaxis(summed, -1, 1)
    found[1] *= FLIP[:, None]
    found /= weight[:, None, None]
    return found


def count_flake_points(rows: int, nodes: int, n_order: int) -> float:
    """Directions that Z is evaluated for between so many rows and nodes, weighed by what their orders take."""
    points = PIECE * (FACTORS.size + STEPS_OF_TILT.size + nodes / NODES_AT_ONCE)
    return 2.0 * rows * points * AZIMUTHS * (1.0 + n_order / 64.0)


def find_edges(flakes: Flakes, mu: float) -> Array:
    """Cosines of light that flakes send along mu between which it is smooth: that cosine itself, its halves and doubles
    towards the horizon, and tilts apart."""
    tilt = find_tilt(flakes)
    theta = math.acos(mu) + tilt * STEPS_OF_TILT
    found = [mu * FACTORS, np.cos(theta[(theta > 0.0) & (theta < 0.5 * math.pi)])]
    edges = np.concatenate(found)
    return edges[(edges > 0.0) & (edges < 1.0)]


def find_reach(flakes: Flakes, out: float, into: Array) -> Array:
    """The largest azimuth that tilted flakes send light to, between signed cosines, (n_in,)."""
    sin_out, sin_in = math.sqrt((1.0 - out) * (1.0 + out)), np.sqrt((1.0 - into) * (1.0 + into))
    both, slope = sin_out * sin_in, math.tan(flakes.panels[-1])
    far = (slope * (out - into)) ** 2 - (sin_out - sin_in) ** 2
    square = np.where(both > 0.0, far / (4.0 * np.where(both > 0.0, both, 1.0)), far > 0.0)
    found: Array = 2.0 * np.arcsin(np.sqrt(np.clip(square, 0.0, 1.0)))
    return found


def integrate_azimuths(flakes: Flakes, out: float, into: Array, n_order: int) -> Iterator[tuple[Any, Array]]:
    """Means over azimuth of Z of a unit of area with cos and sin(m phi), in the solver's real form: the cosines in
    the blocks (I, Q) and (U, V), and sines off them. Some of the directions (n_in,) at a time, and their
    orders up to where the width of their lobe leaves nothing, (order, direction, 4, 4)."""
    x, weights = make_double_gauss(AZIMUTHS)
    # azimuths crowd where tilts are below 45 degrees: straight ahead of light that goes nearly straight on
    both = np.sqrt((1.0 - out) * (1.0 + out) * (1.0 - into) * (1.0 + into))
    near = (np.abs(out - into) / np.sqrt(np.maximum(both, 1e-300)))[:, None]
    far = np.arcsinh(find_reach(flakes, out, into)[:, None] / near)
    phi, rate = near * np.sinh(far * x), near * far * np.cosh(far * x)
    z = flakes.scatter(out, into[:, None], phi) * (weights * rate / math.pi)[..., None, None]
    size = z[..., 0, 0]
    lobe = np.where(size > SEEN * size.max(axis=1, keepdims=True), phi, 0.0).max(axis=1, initial=0.0)
    last = np.minimum(np.ceil(ENDS / np.maximum(lobe, 1e-3)) + BESIDE, n_order).astype(int)
    rank = np.argsort(last, kind="stable")
    for some in np.split(rank, np.flatnonzero(np.diff(last[rank] // GROUPED)) + 1):
        turns = np.arange(last[some].max(initial=0))[:, None] * phi[some][:, None]
        found = np.empty((some.size, turns.shape[1], 4, 4))
        for rows, columns, wave in (
            (slice(2), slice(2), cosine := np.cos(turns)),
            (slice(2, 4), slice(2, 4), cosine),
            (slice(2, 4), slice(2), sine := np.sin(turns)),
            (slice(2), slice(2, 4), -sine),
        ):
            block = wave @ z[some][..., rows, columns].reshape(*phi[some].shape, 4)
            found[..., rows, columns] = block.reshape(*found.shape[:2], 2, 2)
        yield some, found.swapaxes(0, 1)


def find_tilt(flakes: Flakes) -> float:
    """The width sigma [radians] of a Gaussian with the same mean square of tilts."""
    tilt, density = flakes.tilts
    share = density * np.sin(tilt)
    return math.sqrt(0.5 * float(np.trapezoid(share * tilt**2, tilt) / np.trapezoid(share, tilt)))


def add_flakes(problem: "Problem", matrices: "Assembled", orders: IntArray) -> None:
    """Adds what flakes do in each layer to the matrices of particles."""
    nodes, members, stokes = problem.nodes, list(problem.stokes), len(problem.stokes)
    for k, one in enumerate(problem.oriented):
        if one is None:
            continue
        of_nodes, of_beams, flux = find_orders(problem, one)
        for row, order in enumerate(orders.tolist()):
            for E, G, source, sign in (
                (matrices.E, matrices.G_E, matrices.source_d, 1.0),
                (matrices.F, matrices.G_F, matrices.source_s, -1.0),
            ):
                parts = [0.5 * one.area * (part[0, order] + sign * part[1, order]) for part in (of_nodes, of_beams)]
                blocks, lit = (part[..., members, :][..., members] for part in parts)
                found = scale_on_nodes(problem, blocks, lit)
                if order == 0 and sign > 0.0 and problem.conserves:
                    found = balance_flakes(problem, one.area * flux, *found)
                E[row, k] -= found[0].T
                G[row, k] += found[1].T
                source[row, k] += found[2].T
        rates, seen = np.repeat((one.attenuate(nodes) - 1.0) / nodes, stokes), one.attenuate(problem.mu_out)
        diagonal = np.arange(problem.size)
        for E, G in ((matrices.E, matrices.G_E), (matrices.F, matrices.G_F)):
            E[:, k, diagonal, diagonal] += rates
            G[:, k] /= np.repeat(seen, stokes)


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


def scatter_flux(flakes: Flakes, mu: Array) -> Array:
    """Flux that a unit of flake area scatters of light along cosines mu (n,): of I, and what Q adds to it, (n, 2)."""
    whole = flakes.project(mu)
    if flakes.is_conserving:
        return np.stack([whole, np.zeros_like(whole)], axis=1)
    x, weights = find_gauss_legendre(POINTS)
    x, weights = 0.5 * (x + 1.0), 0.5 * weights
    size = np.diff(flakes.panels)[:, None]
    tilt, share = (flakes.panels[:-1, None] + x * size).ravel(), (weights * size).ravel()
    share = share * np.sin(tilt) * flakes.find_density(tilt)
    cosine, sine = mu[:, None, None], np.sqrt((1.0 - mu) * (1.0 + mu))[:, None, None]
    along, across = cosine * np.cos(tilt)[:, None], sine * np.sin(tilt)[:, None]
    edge = np.arccos(np.clip(-along / np.maximum(across, 1e-300), -1.0, 1.0))  # where flakes are lit from below
    found = np.zeros((3, mu.size))
    for start, stop in ((0.0, edge), (edge, math.pi)):
        psi = start + x * (stop - start)
        c = along + across * np.cos(psi)
        r_p, r_s = (np.abs(each) ** 2 for each in flakes.reflect(np.abs(c)))
        part = share[:, None] * weights * (stop - start) * np.abs(c)
        # h along theta-hat and phi-hat of the light: the plane of incidence has the former's share of h across w
        square = (cosine * np.sin(tilt)[:, None] * np.cos(psi) - sine * np.cos(tilt)[:, None]) ** 2
        turned = 2.0 * square / np.maximum((1.0 - c) * (1.0 + c), 1e-300) - 1.0
        terms = (part, 0.5 * (r_p + r_s) * part, 0.5 * (r_p - r_s) * turned * part)
        found += np.stack([term.sum(axis=(1, 2)) for term in terms])
    return (found[1:] / found[0] * whole).T


def find_largest_albedo(one: Oriented, scattered: float) -> float:
    """Share of light that is scattered along the direction that loses least, of particles that scatter so much per unit
    of depth and of flakes: below 1, as both lose some, and above 0, since flakes attenuate where nothing scatters."""
    mu = np.linspace(0.0, 1.0, SAMPLES)
    share = (scattered + one.area * scatter_flux(one.flakes, mu)[:, 0]) / one.attenuate(mu)
    return min(max(float(share.max()), LEAST), MOST)


def find_orders(problem: "Problem", one: Oriented) -> tuple[Array, Array, Array]:
    """`expand_flakes` of all orders, and `scatter_flux`, for the directions of a problem in one of its media; found
    once."""
    media, out, into, count = problem.media, problem.mu_out, problem.mu0, problem.coefficients.shape[1]
    assert media is not None
    nodes = media.nodes
    index = next(n for n in media.scene.media if np.array_equal(nodes.carried(n)[0], problem.nodes))
    name = f"orders of flakes {id(one.flakes)}, {index}, {count}"

    def find() -> tuple[Array, Array, Array]:
        flux = scatter_flux(one.flakes, problem.directions)
        return *expand_flakes(one.flakes, nodes, index, out, into, count), flux

    return media.find_once(find, name, out, into)


def lay_out(blocks: Array) -> Array:
    """A matrix (n_out S, n_in S) of blocks (n_out, n_in, S, S)."""
    return blocks.transpose(0, 2, 1, 3).reshape(blocks.shape[0] * blocks.shape[2], -1)
