"""Layers under a rough surface, literally: Jones vectors of facets in space, quadrature over azimuths and directions in
pieces, adding-doubling from a matrix exponential. Nothing is shared with the package but formulas and conventions."""

import math

import numpy as np
from scipy.linalg import expm
from scipy.special import erfc

from .literal import D, a_matrix

POINTS, AZIMUTHS = 14, 14  # Gauss points of a piece of directions, of azimuths
NODES = 10, 12, 16, 18, 20, 8  # in panels of cosines


def gauss(edges, count, smooth=False):
    """Points and weights (..., point) of pieces between edges (..., edge), ascending; ``smooth``: roots at both ends of
    each piece are smooth functions of what is summed over."""
    x, weight = np.polynomial.legendre.leggauss(count)
    x, weight = 0.5 * (x + 1.0), 0.5 * weight
    if smooth:
        x, weight = x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x) * weight
    size = np.diff(edges, axis=-1)[..., None]
    shape = *np.shape(edges)[:-1], -1
    return (edges[..., :-1, None] + size * x).reshape(shape), (size * weight).reshape(shape)


def hide(surface, mu):
    """Smith's factor of Gaussian slopes, or of GGX's."""
    slope = np.abs(mu) / (surface.roughness * np.sqrt((1.0 - mu) * (1.0 + mu)))
    if surface.distribution == "ggx":
        return 2.0 / (1.0 + np.sqrt(1.0 + slope**-2))
    slope = np.minimum(slope, 25.0)
    return 1.0 / (1.0 + 0.5 * (np.exp(-(slope**2)) / (slope * np.sqrt(np.pi)) - erfc(slope)))


def frame(mu, phi):
    """Directions of travel of signed cosines, l = theta-hat and r = -phi-hat: (..., 3) each."""
    sine, c, s = np.sqrt((1.0 - mu) * (1.0 + mu)), np.cos(phi), np.sin(phi)
    way, along = np.stack([sine * c, sine * s, mu + 0.0 * c], -1), np.stack([mu * c, mu * s, -sine + 0.0 * c], -1)
    return way, along, np.stack([s, -c, 0.0 * c], -1)


def facets(surface, n, mu_i, mu_o, phi):
    """f of facets, (..., 4, 4), from mu_i to mu_o, signed cosines of travel, n: index behind over that before."""
    mu_i, mu_o, phi = np.broadcast_arrays(mu_i, mu_o, phi)
    through = mu_i.flat[0] * mu_o.flat[0] > 0.0
    (k_i, l_i, r_i), (k_o, l_o, r_o) = frame(mu_i, np.zeros_like(phi)), frame(mu_o, phi)
    up = -np.sign(mu_i)  # of facets' normals, towards the side that light comes from
    h = k_i - n.real * k_o if through else k_o - k_i
    size = np.linalg.norm(h, axis=-1)
    h = h / size[..., None] * np.sign(h[..., 2] * up)[..., None]
    c_i, c_o = -(k_i * h).sum(-1), (k_o * h).sum(-1) * (-1.0 if through else 1.0)
    lit = (c_i > 0.0) & (c_o > 0.0)
    if through:
        lit &= (n.real - 1.0) * (n.real * c_o - c_i) > 0.0
    c_i, c_o = np.where(lit, c_i, 0.5), np.where(lit, c_o, 0.5)
    slope2, alpha2 = (1.0 - h[..., 2] ** 2) / h[..., 2] ** 2, surface.roughness**2
    density = np.exp(-slope2 / alpha2) if surface.distribution == "beckmann" else (1.0 + slope2 / alpha2) ** -2
    density = density / (np.pi * alpha2 * h[..., 2] ** 4) * lit / np.abs(mu_i * mu_o)
    if surface.shadowing:
        density = density * hide(surface, mu_i) * hide(surface, mu_o)
    inside = np.sqrt(1.0 - (1.0 - c_i**2) / n**2 + 0j)
    if through:
        p, s = 2.0 * c_i / (n * c_i + inside), 2.0 * c_i / (c_i + n * inside)
        density = density * c_i * c_o * n.real**2 / size**2 * n.real * c_o / c_i
    else:
        p, s = (n * c_i - inside) / (n * c_i + inside), (c_i - n * inside) / (c_i + n * inside)
        density = density / 4.0
    across = np.cross(k_i, k_o)
    across = across / np.linalg.norm(across, axis=-1)[..., None]
    p_i, p_o = np.cross(across, k_i), np.cross(across, k_o)
    (a, b), (c, d) = (
        [
            p * (o * p_o).sum(-1) * (p_i * i).sum(-1) + s * (o * across).sum(-1) * (across * i).sum(-1)
            for i in (l_i, r_i)
        ]
        for o in (l_o, r_o)
    )
    aa, bb, cc, dd = (np.abs(x) ** 2 / 2.0 for x in (a, b, c, d))
    ab, cd, ac, bd, ad, bc = (x * np.conj(y) for x, y in ((a, b), (c, d), (a, c), (b, d), (a, d), (b, c)))
    rows = [
        [aa + bb + cc + dd, aa - bb + cc - dd, (ab + cd).real, (ab + cd).imag],
        [aa + bb - cc - dd, aa - bb - cc + dd, (ab - cd).real, (ab - cd).imag],
        [(ac + bd).real, (ac - bd).real, (ad + bc).real, (ad - bc).imag],
        [-(ac + bd).imag, -(ac - bd).imag, -(ad + bc).imag, (ad - bc).real],
    ]
    return density[..., None, None] * np.stack([np.stack(row, -1) for row in rows], -2)


def expand(surface, n, mu_i, mu_o, n_order):
    """Integrals of f with cos and sin(m phi), (order, pair, 4, 4), of pairs of signed cosines (pair,)."""
    n = complex(n)
    through = mu_i[0] * mu_o[0] > 0.0
    product, sines = np.abs(mu_i * mu_o), np.sqrt((1.0 - mu_i**2) * (1.0 - mu_o**2))
    # where facets turn away, and where they begin to reflect totally
    cosine = (min(n.real, 1.0 / n.real) - product if through else 2.0 * n.real**2 - 1.0 + product) / sines
    cut = np.arccos(np.clip(cosine, -1.0, 1.0))[:, None] * (n.imag == 0.0)
    even = np.pi / 6.0 * np.concatenate([[0.0], 0.5 ** np.arange(9, 0, -1), np.arange(1, 7)])
    edges = np.sort(np.concatenate([np.broadcast_to(even, (mu_i.size, even.size)), cut], axis=1), axis=1)
    phi, weight = gauss(edges, AZIMUTHS, smooth=True)
    f = facets(surface, n, mu_i[:, None], mu_o[:, None], phi) * 2.0 * weight[..., None, None]
    found = np.empty((n_order, mu_i.size, 4, 4))
    odd = np.block([[np.zeros((2, 2)), -np.ones((2, 2))], [np.ones((2, 2)), np.zeros((2, 2))]])
    for m in range(n_order):
        cosines = np.einsum("pa,paij->pij", np.cos(m * phi), f) * (odd == 0.0)
        found[m] = cosines + np.einsum("pa,paij->pij", np.sin(m * phi), f) * odd
    return found


class Medium:
    """Inside a rough surface, where the index is n times that outside: nodes, and integrals of Fourier orders."""

    def __init__(self, surface, n, n_order, finer=1.0):
        self.surface, self.n, self.n_order = surface, n, n_order
        self.twice = 2.0 * np.arcsin(1.0 / n)  # the angle by which facets turn light at their critical angle
        # panels meet at the critical angle, and at the angles to which facets at theirs send the horizon and the normal
        ends = [0.02, np.cos(self.twice), 0.4, np.sqrt(1.0 - n**-2), np.sin(self.twice), 1.0]
        self.edges, self.counts = np.array([0.0, *ends]), [math.ceil(finer * count) for count in NODES]
        pairs = zip(self.edges[:-1], self.edges[1:], self.counts, strict=True)
        parts = [gauss(np.array([low, high]), count) for low, high, count in pairs]
        self.mu, self.weight = (np.concatenate(part) for part in zip(*parts, strict=True))

    def interpolate(self, mu):
        """Of light on the nodes along any cosines, (n, node)."""
        found, first = np.zeros((mu.size, self.mu.size)), 0
        for low, high, count in zip(self.edges[:-1], self.edges[1:], self.counts, strict=True):
            here, own = (mu >= low) & (mu < high), self.mu[first : first + count]
            for k in range(count):
                others = np.delete(own, k)
                found[here, first + k] = np.prod((mu[here, None] - others) / (own[k] - others), axis=1)
            first += count
        return found

    def spread(self, angles):
        """Points and weights of integrals over cosines, in pieces that meet at nodes' panels and at these angles."""
        edges = np.cos(np.clip(np.abs(angles), 0.0, 0.5 * np.pi))
        return gauss(np.unique(np.concatenate([self.edges, edges])), POINTS, smooth=True)

    def beyond(self, mu):
        """From nodes, with weights, through the surface along mu outside, and the other way: (order, node, 4, 4) each,
        integrals over light between nodes."""
        theta, steps = np.arccos(mu), np.array([0.03, 0.1, 0.2, 0.4, 0.7])
        bent, limit = np.arcsin(np.sin(theta) / self.n), np.arccos(1.0 / self.n)
        turned = theta + limit, theta - limit, np.arccos(mu / self.n)  # facets met edge-on, and upright ones
        x, weight = self.spread(np.concatenate([[bent], bent + steps, bent - steps, turned]))
        into, one = self.interpolate(x) * (weight * x)[:, None], np.full(x.size, mu)
        up = expand(self.surface, 1.0 / self.n, x, one, self.n_order)
        down = expand(self.surface, self.n, -one, -x, self.n_order)
        return [np.einsum("qn,oqij->onij", rows, part) for rows, part in ((into, up), (into / x[:, None], down))]

    def within(self):
        """From nodes to nodes by reflection on the surface, (order, 4 node, 4 node), both sides between nodes."""
        y, weight_y = self.spread(np.array([self.twice, 0.5 * np.pi - self.twice]))
        rows, steps = self.interpolate(y) * weight_y[:, None], np.array([0.1, 0.25, 0.5, 0.9])
        found = np.zeros((self.n_order, self.mu.size, 4, self.mu.size, 4))
        for theta, one, row in zip(np.arccos(y), y, rows, strict=True):
            angles = [
                [theta],
                theta + steps,
                theta - steps,
                [self.twice - theta, self.twice + theta, theta - self.twice],
            ]
            x, weight = self.spread(np.concatenate(angles))
            part = expand(self.surface, 1.0 / self.n, x, np.full(x.size, -one), self.n_order)
            part = np.einsum("qn,oqij->oinj", self.interpolate(x) * (weight * x)[:, None], part)
            found += row[:, None, None, None] * part[:, None]
        return (found / self.weight[:, None, None, None]).reshape(self.n_order, 4 * self.mu.size, -1)

    def reflect(self, layer, m, albedo):
        """What a homogeneous layer over a Lambertian base sends back, (4 node, 4 node), flipped frame."""
        mu, weight = np.repeat(self.mu, 4), np.repeat(self.weight, 4)
        flip = np.tile(np.diag(D), self.mu.size)
        c = layer.phase_matrix.coefficients
        forth = 0.5 * layer.albedo * a_matrix(m, c, self.mu, self.mu) * weight
        back = 0.5 * layer.albedo * a_matrix(m, c, self.mu, -self.mu) * flip * weight
        alpha, beta = (np.eye(mu.size) - forth) / mu[:, None], back / mu[:, None]
        steps = int(np.ceil(np.log2(layer.thickness / self.mu[0])))
        size = mu.size
        E = expm(np.block([[-alpha, beta], [-beta, alpha]]) * layer.thickness / 2.0**steps)
        R = -np.linalg.solve(E[size:, size:], E[size:, :size])
        T = E[:size, :size] + E[:size, size:] @ R
        for _ in range(steps):
            both = np.linalg.solve((np.eye(size) - R @ R).T, T.T).T
            R, T = R + both @ R @ T, both @ T
        if m == 0:
            unpolarized = np.arange(size) % 4 == 0
            base = 2.0 * albedo * np.outer(unpolarized, unpolarized * weight * mu)
            R = R + T @ base @ np.linalg.solve(np.eye(size) - R @ base, T)
        return R


def find_brdf(surface, n, layer, albedo, mu_i, mu_o, finer=1.0):
    """Orders of f but for what facets reflect by themselves, (order, in, out, 4, 4)."""
    n_order = layer.phase_matrix.terms
    medium = Medium(surface, n, n_order, finer)
    size, flip = 4 * medium.mu.size, np.tile(np.diag(D), medium.mu.size)
    within, found = medium.within(), np.empty((n_order, len(mu_i), len(mu_o), 4, 4))
    ways = {mu: medium.beyond(mu) for mu in {*mu_i, *mu_o}}
    for m in range(n_order):
        R = flip[:, None] * medium.reflect(layer, m, albedo)  # of falling light, rising as it is
        solve = np.linalg.inv(np.eye(size) - within[m] @ R)
        for i, one in enumerate(mu_i):
            down = (ways[one][1][m] / medium.weight[:, None, None]).reshape(size, 4) / (2.0 * np.pi)
            rising = R @ solve @ down
            for o, other in enumerate(mu_o):
                found[m, i, o] = np.einsum("nij,njk->ik", ways[other][0][m], rising.reshape(-1, 4, 4))
    return found
