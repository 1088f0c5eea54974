"""A literal solver of scenes with smooth interfaces and mirrors: adding-doubling, Fourier order by order.

Every part of the pile, an interface and a mirror too, is a pair of 4x4 operators on either side, acting on radiance in
directions that Snell's law joins across media (a direction that a medium cannot carry is zero there). Directions to
look from are nodes of weight zero; the beam's scattering straight into them has all terms, unchanged. Shared with the
package: the nodes, and the scene as it is given.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

import vrte
from vrte.basics.quadrature import RefractedNodes, make_refracted_nodes

from .oracle import D, legendre_matrix, star


@dataclass(frozen=True)
class Directions:
    """Nodes, then directions to look from, then beams; these two as pairs (index of the medium, cosine there)."""

    rule: RefractedNodes
    seen: tuple
    beams: tuple

    @property
    def size(self):
        """How many."""
        return self.rule.highest.size + len(self.seen) + len(self.beams)

    def cosines(self, n):
        """In a medium of index n; NaN where it has no such direction."""
        start, mu = np.array([*self.seen, *self.beams]).T
        squared = ((n - start) * (n + start) + (start * mu) ** 2) / n**2
        others = np.where((start == n) | (mu == 1.0), mu, np.sqrt(np.where(squared > 0.0, squared, np.nan)))
        nodes, _ = self.rule.carried(n)
        return np.concatenate([np.full(self.rule.highest.size - nodes.size, np.nan), nodes, others])

    def weights(self, n):
        """0 for what is looked from, 1 for beams."""
        _, nodes = self.rule.carried(n)
        missing = np.zeros(self.rule.highest.size - nodes.size)
        return np.concatenate([missing, nodes, np.zeros(len(self.seen)), np.ones(len(self.beams))])


def fresnel(n, mu):
    """Amplitudes of reflection p, s and transmission p, s, and the cosine behind, for n relative to where mu is."""
    behind = np.sqrt(1.0 - (1.0 - mu**2) / complex(n) ** 2)
    behind = np.where(behind.imag < 0.0, -behind, behind)
    s, p = mu + n * behind, n * mu + behind
    return (n * mu - behind) / p, (mu - n * behind) / s, 2.0 * mu / p, 2.0 * mu / s, behind


def mueller(p, s):
    """What amplitudes do to (I, Q, U, V)."""
    a, b, x = (abs(p) ** 2 + abs(s) ** 2) / 2, (abs(p) ** 2 - abs(s) ** 2) / 2, p * np.conj(s)
    return np.array([[a, b, 0, 0], [b, a, 0, 0], [0, 0, x.real, x.imag], [0, 0, -x.imag, x.real]])


def diagonal(blocks):
    """One 4x4 matrix a direction on the diagonal."""
    out = np.zeros((len(blocks), 4, len(blocks), 4))
    for k, block in enumerate(blocks):
        out[k, :, k] = block
    return out.reshape(4 * len(blocks), -1)


def mirror(directions, n, index):
    """What a smooth surface without another side gives back of light in n, flipped frame; nothing gets through."""
    back = np.zeros((directions.size, 4, 4))
    for k, mu in enumerate(directions.cosines(n)):
        if not np.isnan(mu):
            back[k] = D @ mueller(*fresnel(index / n, mu)[:2])
    zero = np.zeros((4 * len(back), 4 * len(back)))
    return diagonal(back), zero, zero, zero


def interface(directions, above, below, stokes=4):
    """R and T from above, R and T from below: of radiance, but of beams per area across."""
    operators = []
    for n1, n2 in ((above, below), (below, above)):
        R, T = np.zeros((2, directions.size, 4, 4))
        for k, (here, there) in enumerate(zip(directions.cosines(n1), directions.cosines(n2), strict=True)):
            if np.isnan(here):
                continue
            rp, rs, tp, ts, behind = fresnel(n2 / n1, here)
            R[k] = D @ mueller(rp, rs)
            if not np.isnan(there):
                power = n2 * behind.real / (n1 * here) * mueller(tp, ts)
                is_beam = k >= directions.size - len(directions.beams)
                T[k] = power * (here / there if is_beam else (n2 / n1) ** 2)
        R[:, stokes:] = R[:, :, stokes:] = T[:, stokes:] = T[:, :, stokes:] = 0.0
        operators += [diagonal(R), diagonal(T)]
    return operators


def legendre_matrices(m, terms, mu, shift):
    """P_l^m of cosines, l = m .. terms - 1, the intensity's p_l times and less ``shift`` (terms, 2)."""
    matrices = [legendre_matrix(l, m, mu) for l in range(m, terms)]
    for l, matrix in enumerate(matrices, m):
        matrix[:, 0, 0] = shift[l, 0] * matrix[:, 0, 0] - shift[l, 1]
    return matrices


def scattering(m, coefficients, u, v, shift):
    """A^m(u, v), (1:9), cosines positive downward: (4 n_u, 4 n_v)."""
    total = np.zeros((u.size, 4, v.size, 4))
    to, of = (legendre_matrices(m, len(coefficients), mu, shift) for mu in (u, v))
    for (a1, a2, a3, a4, b1, b2), left, right in zip(coefficients[m:], to, of, strict=True):
        middle = np.array([[a1, -b1, 0, 0], [-b1, a2, 0, 0], [0, 0, a3, -b2], [0, 0, b2, a4]])
        total += np.einsum("uij,jk,vkl->uivl", left, middle, right)
    return total.reshape(4 * u.size, 4 * v.size)


def conserving_shift(directions, n, m, terms):
    """What makes the flux of order 0 exact on nodes that several media share: p_0 over the root of their weights' sum,
    and p_l of even degree less its mean on them, as Gauss's nodes have it by themselves (terms, 2)."""
    shift = np.tile([1.0, 0.0], (terms, 1))
    if m == 0 and len(directions.rule.panels) > 1:
        nodes, weights = directions.rule.carried(n)
        shift[0, 0] = weights.sum() ** -0.5
        for l in range(2, terms, 2):
            shift[l, 1] = weights @ legendre_matrix(l, 0, nodes)[:, 0, 0] / weights.sum()
    return shift


def slab(directions, n, m, coefficients, albedo, thickness):
    """R, T, R, T of a layer of index n, total transmission, flipped frame."""
    here = ~np.isnan(directions.cosines(n))
    mu, weights = directions.cosines(n)[here], directions.weights(n)[here]
    shift = conserving_shift(directions, n, m, len(coefficients))
    unchanged = np.tile([1.0, 0.0], (len(coefficients), 1))
    first_beam = mu.size - here[directions.size - len(directions.beams) :].sum()
    first_seen = np.count_nonzero(here[: directions.rule.highest.size])
    inverse, flip = np.repeat(1 / mu, 4), np.kron(np.eye(mu.size), D)
    once = np.ix_(np.arange(4 * first_seen, 4 * first_beam), np.arange(4 * first_beam, 4 * mu.size))
    parts = []
    for of in (mu, -mu):
        many, true = (scattering(m, coefficients, mu, of, q) for q in (shift, unchanged))
        many[once] = true[once]
        part = albedo / 2 * inverse[:, None] * (many if of is mu else many @ flip) * np.repeat(weights, 4)
        part[4 * first_beam :] = 0.0  # nothing scatters into the beams
        parts.append(part)
    through, back = parts[0] - np.diag(inverse), parts[1]
    size, one = 4 * mu.size, np.eye(4 * mu.size)
    doublings = max(0, int(np.ceil(np.log2(max(thickness, 1e-300) * inverse.max() * 4))))
    start = expm(thickness / 2.0**doublings * np.block([[through, back], [-back, -through]]))
    R = -np.linalg.solve(start[size:, size:], start[size:, :size])
    T = start[:size, :size] + start[:size, size:] @ R
    for _ in range(doublings):
        inner = np.linalg.inv(one - R @ R)
        R, T = R + T @ inner @ R @ T, T @ inner @ T
    rows = np.repeat(here, 4)
    whole = np.zeros((2, rows.size, rows.size))
    whole[0][np.ix_(rows, rows)], whole[1][np.ix_(rows, rows)] = R, T
    return whole[0], whole[1], whole[0], whole[1]


def lambertian(directions, n, m, albedo):
    """What an even base gives back of light in n; nothing gets through."""
    mu, weights = np.nan_to_num(directions.cosines(n)), directions.weights(n)
    ground = np.zeros((4 * mu.size, 4 * mu.size))
    if m == 0:
        place = np.arange(mu.size)
        to, nodes = (mu > 0.0) & (place < mu.size - len(directions.beams)), place < directions.rule.highest.size
        white = np.where(nodes[:, None] | nodes, 2 * (mu * weights)[nodes].sum(), 1.0)  # 1 but for what the nodes miss
        ground[::4, ::4] = 2 * albedo * to[:, None] * mu * weights / white
    zero = np.zeros_like(ground)
    return ground, zero, zero, zero


@dataclass(frozen=True)
class Light:
    """What comes of a beam in one order: operators from beams to directions, down and up, in a medium of index n."""

    directions: Directions
    n: float
    down: np.ndarray
    up: np.ndarray

    def radiance(self, seen, upward):
        """Mueller matrices per unit flux across the beam (beam, n_seen, 4, 4), of the directions to look from."""
        first, beams = self.directions.rule.highest.size, len(self.directions.beams)
        operator, frame = (self.up, D) if upward else (self.down, np.eye(4))
        block = operator.reshape(self.directions.size, 4, self.directions.size, 4)
        return frame @ block[first:][seen][:, :, -beams:].transpose(2, 0, 1, 3) / (2 * np.pi)

    def beam(self, upward):
        """Mueller matrices of light that met no particle, per area across the beam, (beam, 4, 4)."""
        beams = len(self.directions.beams)
        operator, frame = (self.up, D) if upward else (self.down, np.eye(4))
        block = operator.reshape(self.directions.size, 4, self.directions.size, 4)
        return np.array([frame @ block[-k, :, -k] for k in range(beams, 0, -1)])

    def flux(self, upward, stokes=(1.0, 0.0, 0.0, 0.0)):
        """Diffuse flux of beams of that flux vector, through a horizontal plane, (beam,); order 0."""
        mu, weights = np.nan_to_num(self.directions.cosines(self.n)), self.directions.weights(self.n)
        beams = len(self.directions.beams)
        operator = self.up if upward else self.down
        return ((weights * mu)[:-beams] @ operator[: -4 * beams : 4, -4 * beams :]).reshape(beams, 4) @ stokes


def media_of(scene):
    """Above, of each layer, below."""
    return [scene.index_above, *scene.indices, scene.index_below]


def light_orders(scene, mu_i, seen, levels, nodes, n_order, stokes=4):
    """Light at levels, order by order: lists [order][level] of Light.

    seen: pairs (index of the medium, cosine there); levels: pairs (layer, depth below its top), layer -1 above the pile
    and that of the count of layers below it. stokes = 1 leaves out polarization, of interfaces and of particles.
    """
    media = media_of(scene)
    rule = make_refracted_nodes(media, nodes)
    directions = Directions(rule, tuple(seen), tuple((media[0], mu) for mu in mu_i))
    return [one_order(scene, directions, levels, m, stokes) for m in range(n_order)]


def one_order(scene, directions, levels, m, stokes):
    """Light at the levels in one order."""
    media, size = media_of(scene), 4 * directions.size
    nothing = (np.zeros((size, size)), np.eye(size), np.zeros((size, size)), np.eye(size))
    parts, place, n_of = [], {}, {}

    def mark(level):
        place[level], n_of[level] = len(parts), media[level[0] + 1]

    mark((-1, 0.0))
    for k, layer in enumerate(scene.layers):
        if scene.interfaces[k] is not None:
            parts.append(interface(directions, media[k], media[k + 1], stokes))
        coefficients = layer.phase_matrix.coefficients[:, :6] * (np.arange(6) < (6 if stokes == 4 else 1))
        depth = 0.0
        for level in sorted({level[1] for level in levels if level[0] == k}):
            if level > depth:
                parts.append(slab(directions, media[k + 1], m, coefficients, layer.albedo, level - depth))
            depth = level
            mark((k, level))
        if layer.thickness > depth:
            thickness = min(layer.thickness, 1e6) - depth
            parts.append(slab(directions, media[k + 1], m, coefficients, layer.albedo, thickness))
    if scene.interfaces[-1] is not None:
        parts.append(interface(directions, media[-2], media[-1], stokes))
    mark((len(scene.layers), 0.0))
    if isinstance(scene.base, vrte.Mirror):
        parts.append(mirror(directions, media[-1], scene.base.index))
    elif scene.base is not None:
        parts.append(lambertian(directions, media[-1], m, scene.base.albedo))
    upper, lower = [nothing], [nothing]
    for part in parts:
        upper.append(star(upper[-1], part))
    for part in reversed(parts):
        lower.append(star(part, lower[-1]))
    found = []
    for level in levels:
        (_, T, Rb, _), R = upper[place[level]], lower[len(parts) - place[level]][0]
        down = np.linalg.solve(np.eye(size) - Rb @ R, T)
        found.append(Light(directions, n_of[level], down, R @ down))
    return found


@dataclass(frozen=True)
class Answer:
    """BRDF and BTDF orders (order, in, out, 4, 4) [1/sr]; shares sent on as beams (in, 4, 4); shares of unpolarized
    light that come out diffuse above and below (in,)."""

    reflected: np.ndarray
    transmitted: np.ndarray
    specular: np.ndarray
    specular_transmission: np.ndarray
    reflectance: np.ndarray
    transmittance: np.ndarray


def brdf_orders(scene, mu_i, mu_o, nodes, n_order, stokes=4):
    """All that leaves a scene; mu_o in the medium above of what is reflected, below of what gets through."""
    above, below = scene.index_above, scene.index_below
    mu_i, mu_o = np.asarray(mu_i, float), np.asarray(mu_o, float)
    seen = [(above, mu) for mu in mu_o] + [(below, mu) for mu in mu_o]
    out, under = slice(0, mu_o.size), slice(mu_o.size, 2 * mu_o.size)
    levels = [(-1, 0.0), (len(scene.layers), 0.0)]
    orders = light_orders(scene, mu_i, seen, levels, nodes, n_order, stokes)
    top, bottom = orders[0]
    inside = np.nan_to_num(top.directions.cosines(below)[-mu_i.size :])
    reflected = np.array([order[0].radiance(out, True) for order in orders]) / mu_i[:, None, None, None]
    transmitted = np.array([order[1].radiance(under, False) for order in orders]) / mu_i[:, None, None, None]
    return Answer(
        reflected,
        transmitted,
        top.beam(True),
        bottom.beam(False) * (inside / mu_i)[:, None, None],
        top.flux(True) / mu_i,
        bottom.flux(False) / mu_i,
    )
