"""What facets do with the energy of light: shares reflected and let through once, and what they hide given back.

Facets see of light along mu what Smith's factor G(mu) leaves, and send all of that on, R + T = 1, into directions that
other facets hide by G(mu_o). Light let through that meets another facet is let through there as well, the straighter
the closer both indices are: it goes on where it was going, and f_t has the lesser of G(mu_i) and G(mu_o) in place of
their product. That is reciprocal, makes nothing, and all of the light goes on as the indices become one.

What is lost then, l(mu) = 1 - R - T of I and Q, leaves after more bounces. Given back it is even but for what makes it
reciprocal, f = c l(mu_o) l(mu_i)^T on either side: with L the integral of l mu over the hemisphere, c = (1 - t)/L on
the side it came from, t/L' on the other, so that R + T = 1 for every mu_i. t and t' are as large as exchange between
both sides, t n^2 L = t' n'^2 L', and the shares let through of light from everywhere allow. Where light that gets in
stays there, l is that of facets which reflect everything, and each further bounce takes its mean share.

Source: Kulla and Conty, Revisiting physically based shading at Imageworks (2017), for one side.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.quadrature import Panel, RefractedNodes, make_double_gauss, make_refracted_nodes
from vrte.basics.running import ThreadTeam
from vrte.optics.facet_integrals import find_cosines, interpolate_nodes, list_panels
from vrte.optics.facets import RoughSurface
from vrte.optics.fresnel import reflect_smooth

NODES = 40  # of a mean over the hemisphere of flat facets
POINTS = 10  # Gauss points of a piece of the integrals over facets: shares are right to 5e-6, at alpha 1.5 to 2e-5
DEGREE = 16  # points of a piece of the polynomials in cosines: mu l is right to 4e-6, from alpha 1 on to 2e-5
NEAR = np.array([1.5, 6.0, 24.0])  # cosines over alpha at which pieces meet near the horizon
CRITICAL = 2.0  # and so far from the edge of total reflection, over alpha, in the square of the cosine
SLOPES = {"beckmann": np.array([1.0, 2.2, 3.6, 5.0]), "ggx": np.array([0.7, 2.0, 5.0, 16.0, 64.0, 512.0])}  # over alpha
REACH = 6.0  # slopes over alpha that count (Beckmann's)
EVERYTHING = 1e6j  # times the index before: facets that reflect all, whatever the angle


def share_energy(surface: RoughSurface, mu: Array) -> tuple[Array, Array]:
    """Shares R, T of unpolarized light along mu (n,) that facets reflect and let through, (n,) each."""
    reflected, through, _ = share_bounces(surface, mu)[:, ::2].T
    if not surface.is_clear:
        through = np.zeros_like(through)
    if not surface.conserving:
        return reflected, through
    own, other = find_strengths(surface)
    if surface.closed:
        return reflected + own * find_lost(surface).find(mu)[:, 0] * find_lost(surface).total, through
    lost = 1.0 - reflected - through
    reflected = reflected + own * lost * find_lost(surface).total
    return reflected, through + other * lost * find_lost(surface.turned).total


def restore_lost(surface: RoughSurface, mu_i: Array, mu_o: Array, transmitted: bool) -> Array:
    """What single bounces lose, given back: f of I and Q [1/sr], (..., 2, 2), mu_o on the side it goes to."""
    there = find_lost(surface.turned if transmitted else surface).find(mu_o)
    both: Array = there[..., :, None] * find_lost(surface).find(mu_i)[..., None, :]
    return find_strengths(surface)[transmitted] / (2.0 * np.pi) * both


def share_bounces(surface: RoughSurface, mu: Array) -> Array:
    """Shares of light along mu (n,) in single bounces, reflected, let through, hidden, of I and by Q, (n, 6)."""
    x, weights = make_double_gauss(POINTS)
    ratio, theta = complex(surface.ratio), np.arccos(np.minimum(mu, 1.0))[:, None]
    right, slopes = 0.5 * np.pi, SLOPES[surface.distribution]
    tilt = np.arctan(surface.roughness * slopes)
    edges = [np.abs(theta + np.concatenate([-tilt, [0.0], tilt])), right - theta, 0.5 * (right + theta)]
    edges += [0.5 * (right - theta), np.zeros_like(theta), np.full_like(theta, right)]
    if ratio.imag == 0.0:
        n, way = ratio.real, math.copysign(1.0, ratio.real - 1.0)
        for bent in (2.0 * theta, right - theta):  # by what refraction turns it
            edges.append(np.arctan2(n * np.sin(bent), way * (n * np.cos(bent) - 1.0)))
        edges.append(np.full_like(theta, math.asin(min(n, 1.0))))
    return _core.facet_shares(
        ThreadTeam(1, np.zeros(1), np.zeros(1, np.int32)),
        index=ratio.real,
        absorption=ratio.imag,
        roughness=surface.roughness,
        is_ggx=surface.distribution == "ggx",
        shadowing=surface.shadows(False),
        hiding=surface.shadows(True),
        mu_i=np.ascontiguousarray(np.minimum(mu, 1.0)),
        edges=np.sort(np.clip(np.concatenate(edges, axis=1), 0.0, right), axis=1),
        slopes=slopes,
        points=np.ascontiguousarray(x),
        point_weights=np.ascontiguousarray(weights),
        reach=REACH,
    )


@dataclass(frozen=True, eq=False)
class Lost:
    """Light l of I and Q that single bounces lose on one side, (piece, DEGREE, 2) polynomials on panels from the
    ``first`` cosines (piece,); ``total`` integral of l mu of I, L over 2 pi; ``share`` of it that goes through."""

    index: float
    pieces: list[tuple[Panel, float, float]]
    first: Array
    values: Array
    total: float
    share: float

    def find(self, mu: Array) -> Array:
        """l along mu (...), (..., 2)."""
        cosines = np.atleast_1d(np.asarray(mu, float)).ravel()
        found, at = np.zeros((cosines.size, 2)), np.maximum(np.searchsorted(self.first, cosines, "right") - 1, 0)
        points, _ = make_double_gauss(DEGREE)
        for k in np.unique(at).tolist():
            panel, start, end = self.pieces[k]
            here = at == k
            depth = (panel.high - self.index) * (panel.high + self.index) + (self.index * cosines[here]) ** 2
            found[here] = interpolate_nodes(points, (locate(panel, depth) - start) / (end - start)) @ self.values[k]
        return found.reshape(*np.shape(mu), 2)

    def spread(self, nodes: RefractedNodes) -> Array:
        """The same of light that is interpolated between nodes, of the medium that it comes from, (node, 2)."""
        mu_node, weight = nodes.carried(self.index)
        found = np.zeros((mu_node.size, 2))
        for own, panel, x_node in list_panels(nodes, self.index):
            depth = (panel.high - self.index) * (panel.high + self.index) + (self.index * self.first) ** 2
            edges = np.unique(np.append(panel.locate(depth), [0.0, 1.0]))
            x, share = place_points(edges, DEGREE + x_node.size // 2)
            depth, rate = panel.spread(x)
            light = (share * rate / self.index**2)[:, None] * self.find(find_cosines(self.index, panel, depth))
            found[own] = interpolate_nodes(x_node, x).T @ light
        return found / (weight * mu_node)[:, None]


def locate(panel: Panel, depth: Array) -> Array:
    """Places in a panel by 1 - sqrt(1 - x): losses are powers of the angle to the normal, where x is 1."""
    found: Array = 1.0 - np.sqrt(np.maximum(1.0 - panel.locate(depth), 0.0))
    return found


def place_points(edges: Array, count: int) -> tuple[Array, Array]:
    """Gauss points and weights of pieces between edges, so many each, (point,) both."""
    x, weights = make_double_gauss(count)
    size = np.diff(edges)[:, None]
    return (edges[:-1, None] + size * x).ravel(), (size * weights).ravel()


@lru_cache(maxsize=128)
def find_lost(surface: RoughSurface) -> Lost:
    """What single bounces lose from one side; of facets that reflect all where light that gets in stays."""
    lit = replace(surface, index=EVERYTHING * surface.index_from) if surface.closed else surface
    index, behind = surface.index_from, [surface.index.real] if surface.is_clear else []
    pieces, cosines, weights = [], [], []
    for _, panel, _ in list_panels(make_refracted_nodes([index, *behind], 4), index):
        edges = np.array(list(find_edges(surface, panel)))
        x, share = place_points(edges, DEGREE)
        depth, rate = panel.spread(x * (2.0 - x))
        cosines.append(find_cosines(index, panel, depth))
        weights.append(share * 2.0 * (1.0 - x) * rate / index**2)
        pieces += [(panel, *ends) for ends in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)]
    mu, weight = np.concatenate(cosines), np.concatenate(weights)
    shares = share_bounces(lit, mu)
    values = shares[:, 4:].reshape(-1, DEGREE, 2)
    starts = [find_cosines(index, panel, panel.spread(np.array(x * (2.0 - x)))[0]).item() for panel, x, _ in pieces]
    reflected, through, hidden = weight @ shares[:, ::2]
    return Lost(index, pieces, np.array(starts), values, float(hidden), through / (reflected + through))


def find_edges(surface: RoughSurface, panel: Panel) -> Iterator[float]:
    """Where polynomials meet in a panel's x, ascending: near the horizon and where total reflection begins."""
    alpha, at_horizon = surface.roughness, panel.high >= surface.index_from
    depths = (alpha * panel.high * NEAR) ** 2 if at_horizon else np.array([panel.size * CRITICAL * alpha])
    if panel.low > 0.0:
        depths = np.append(depths, panel.size * (1.0 - CRITICAL * alpha))
    last = 0.0
    yield last
    for edge in np.sort(np.append(locate(panel, depths), [0.25, 0.5])).tolist():
        if 1.3 * last < edge < 0.9 and edge > 0.002:
            yield (last := edge)
    yield 1.0


@lru_cache(maxsize=128)
def find_strengths(surface: RoughSurface) -> tuple[float, float]:
    """2 pi c on the side that light comes from, and on the other."""
    lost = find_lost(surface).total
    if lost == 0.0:
        return 0.0, 0.0
    if surface.closed:
        mu, weights = make_double_gauss(NODES)
        each, kept = float(2.0 * (weights * mu) @ reflect_smooth(surface.ratio, mu)[:, 0, 0]), 1.0 - 2.0 * lost
        return each**2 * kept / (1.0 - each * (1.0 - kept)) / lost, 0.0
    sides = [find_lost(surface), find_lost(surface.turned)]
    through = min(side.share * side.index**2 * side.total for side in sides) / (surface.index_from**2 * lost)
    return (1.0 - through) / lost, through / sides[1].total
