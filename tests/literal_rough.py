"""Layers above and under a rough surface, literally: Jones vectors of facets in space, quadrature over azimuths and
directions in pieces, adding-doubling from a power series. Nothing is shared with the package but formulas and
conventions."""

import math

import numpy as np
from scipy.special import erfc

from .literal import D, a_matrix

POINTS, AZIMUTHS, PIECES = 14, 14, 9  # Gauss points of a piece of directions, of azimuths; pieces of azimuths
NODES, HORIZON = 10, 18  # Gauss points in a panel of cosines, in the one at the horizon
GRAZING, WIDEST, RATIO = 0.02, 0.15, 3.0  # end of the latter; widths of others, and their ends over their starts
STEPS = np.array([0.03, 0.08, 0.15, 0.25, 0.4, 0.6, 0.9])  # [rad] from the middle of a lobe, where pieces meet
NEGLECTED = 45.0  # exponent of Gaussian slopes from which on they are left out
TERMS, SHORT = 7, 1.0 / 16.0  # of the series, and thickness over the smallest cosine up to which it is taken


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
    ratio = n.real if through else 1.0
    product, sines = np.abs(mu_i * mu_o), np.sqrt((1.0 - mu_i**2) * (1.0 - mu_o**2))
    across = (np.sqrt(1.0 - mu_i**2) - ratio * np.sqrt(1.0 - mu_o**2)) ** 2
    upright = surface.roughness**2 * (mu_i - ratio * mu_o) ** 2
    found = np.zeros((n_order, mu_i.size, 4, 4))
    if surface.distribution == "beckmann":
        some = across < NEGLECTED * upright
        if not some.all():
            if some.any():
                found[:, some] = expand(surface, n, mu_i[some], mu_o[some], n_order)
            return found
    # pieces grow from the width of the lobe, in the sine of half the azimuth
    lobe = upright + (across if surface.distribution == "ggx" else 0.0)
    width = np.sqrt(np.minimum(lobe / np.maximum(4.0 * ratio * sines, 1e-300), 1.0))[:, None]
    widest = np.minimum(1.0, math.sqrt(NEGLECTED) * width) if surface.distribution == "beckmann" else 1.0
    halves = 0.5 * width * (2.0 * widest / width) ** (np.arange(PIECES) / (PIECES - 1.0))
    even = np.concatenate([0.0 * width, 2.0 * np.arcsin(np.minimum(halves, 1.0))], axis=1)
    # where facets turn away, and where they begin to reflect totally
    cosine = (min(n.real, 1.0 / n.real) - product if through else 2.0 * n.real**2 - 1.0 + product) / sines
    cut = np.minimum(np.arccos(np.clip(cosine, -1.0, 1.0))[:, None] * (n.imag == 0.0), even[:, -1:])
    phi, weight = gauss(np.sort(np.concatenate([even, cut], axis=1), axis=1), AZIMUTHS, smooth=True)
    f = facets(surface, n, mu_i[:, None], mu_o[:, None], phi) * 2.0 * weight[..., None, None]
    odd = np.block([[np.zeros((2, 2)), -np.ones((2, 2))], [np.ones((2, 2)), np.zeros((2, 2))]])
    for m in range(n_order):
        cosines = np.einsum("pa,paij->pij", np.cos(m * phi), f) * (odd == 0.0)
        found[m] = cosines + np.einsum("pa,paij->pij", np.sin(m * phi), f) * odd
    return found


class Side:
    """Directions on one side of a rough surface: nodes in panels, then those that are seen, and beams, whose light is
    their flux over 2 pi; ``weight`` of the light that comes along each, and which ``gain`` light by scattering."""

    def __init__(self, meet, seen, beams, finer=1.0):
        self.edges = np.array(meet)
        while len(meet) and (wide := np.flatnonzero(np.diff(self.edges[1:]) > self.find_widest())).size:
            low, high = self.edges[1 + wide[0]], self.edges[2 + wide[0]]
            self.edges = np.insert(self.edges, 2 + wide[0], max(math.sqrt(low * high), 0.5 * (low + high)))
        self.counts = [math.ceil(finer * (NODES if k else HORIZON)) for k in range(max(0, self.edges.size - 1))]
        parts = [self.place(k, *gauss(np.array([0.0, 1.0]), count)) for k, count in enumerate(self.counts)]
        nodes, weight = (np.concatenate([part[axis] for part in parts] or [np.zeros(0)]) for axis in range(2))
        self.count, self.beams = nodes.size, nodes.size + len(seen)
        self.mu = np.concatenate([nodes, seen, beams])
        self.weight = np.concatenate([weight, np.zeros(len(seen)), np.ones(len(beams))])
        self.gain = np.arange(self.mu.size) < self.beams

    def find_widest(self):
        """Of panels but the first."""
        return np.minimum(WIDEST, (RATIO - 1.0) * self.edges[1:-1])

    def place(self, panel, x, weight):
        """Cosines and weights in a panel from those in 0 to 1: at the horizon light has a logarithm."""
        low, high = self.edges[panel : panel + 2]
        if panel:
            return low + (high - low) * x, (high - low) * weight
        return high * x**3, 3.0 * high * x**2 * weight

    def interpolate(self, mu):
        """Of light on the nodes along any cosines, (n, node)."""
        found, first = np.zeros((mu.size, self.count)), 0
        for k, count in enumerate(self.counts):
            low, high = self.edges[k : k + 2]
            here, (own, _) = (mu >= low) & (mu < high), gauss(np.array([0.0, 1.0]), count)
            x = np.cbrt(mu[here] / high) if k == 0 else (mu[here] - low) / (high - low)
            for j in range(count):
                others = np.delete(own, j)
                found[here, first + j] = np.prod((x[:, None] - others) / (own[j] - others), axis=1)
            first += count
        return found

    def spread(self, angles):
        """Points and weights of integrals over cosines, in pieces that meet at the panels and at these angles; at the
        horizon in the variable of its nodes."""
        edges = np.unique(np.concatenate([self.edges, np.cos(np.clip(np.abs(angles), 0.0, 0.5 * np.pi))]))
        low = np.unique(np.concatenate([np.cbrt(edges[edges <= GRAZING] / GRAZING), [0.3, 0.6]]))
        pieces = [self.place(0, *gauss(low, POINTS, smooth=True))]
        pieces.append(gauss(edges[edges >= GRAZING], POINTS, smooth=True))
        x, weight = (np.concatenate(part) for part in zip(*pieces, strict=True))
        return x[weight > 0.0], weight[weight > 0.0]


def find_angles(mu, n, through):
    """Of light on this side whose facets' lobe lies along mu on the other, or on this one: n is the index there over
    that here."""
    theta = np.arccos(mu)
    lesser = np.arcsin(min(n, 1.0 / n))
    if not through:  # and the angle by which facets turn light at their critical angle
        special = [2.0 * lesser - theta, 2.0 * lesser + theta, theta - 2.0 * lesser] if n < 1.0 else []
        return np.concatenate([[theta], theta + STEPS, theta - STEPS, special])
    middle, steps = np.arcsin(min(n * np.sin(theta), 1.0)), STEPS * (0.3 if n > 1.0 else 1.0)
    turned = theta + 0.5 * np.pi - lesser, theta - 0.5 * np.pi + lesser, np.arccos(min(n * mu, 1.0))
    return np.concatenate([[middle], middle + steps, middle - steps, turned])  # facets met edge-on, and upright ones


def send(surface, n, here, there, up, n_order):
    """What a surface reflects or lets through from one side to one, (order, 4 there, 4 here), light going up or down;
    n is the index behind over that before. What is seen lacks what beams send there by facets alone."""
    through = here is not there
    way, on = (1.0 if up else -1.0), (1.0 if up else -1.0) * (1.0 if through else -1.0)
    found = np.zeros((n_order, there.mu.size, 4, here.mu.size, 4))
    for k, mu in enumerate(there.mu[: there.beams] if here.count else ()):
        x, weight = here.spread(find_angles(mu, n, through))
        part = expand(surface, n, way * x, np.full(x.size, on * mu), n_order)
        rows = here.interpolate(x) * (weight * x)[:, None]
        found[:, k, :, : here.count] = np.einsum("qn,oqij->oinj", rows, part)
    for k in range(here.beams, here.mu.size if there.count else 0):
        x, weight = there.spread(find_angles(here.mu[k], 1.0 / n if through else n, through))
        part = expand(surface, n, np.full(x.size, way * here.mu[k]), on * x, n_order) * here.mu[k]
        rows = there.interpolate(x) * weight[:, None] / there.weight[: there.count]
        found[:, : there.count, :, k] = np.einsum("qn,oqij->onij", rows, part)
    return found.reshape(n_order, 4 * there.mu.size, -1)


def solve_slab(layer, thickness, side, m):
    """Reflection and transmission of a homogeneous layer, flipped frame, (4 n, 4 n) each."""
    mu, weight, gain = (np.repeat(each, 4) for each in (side.mu, side.weight, side.gain))
    flip, c = np.tile(np.diag(D), side.mu.size), layer.phase_matrix.coefficients
    scale = 0.5 * layer.albedo * (gain / mu)[:, None] * weight
    forth, back = scale * a_matrix(m, c, side.mu, side.mu), scale * a_matrix(m, c, side.mu, -side.mu) * flip
    steps = max(0, math.ceil(np.log2(thickness / (SHORT * side.mu.min()))))
    t = thickness / 2.0**steps
    straight = [(-1.0 / mu) ** k / math.factorial(k) for k in range(TERMS)]
    R, T, turned = [np.zeros_like(forth)], [np.zeros_like(forth)], []  # T without what goes straight
    for k in range(TERMS):
        turned.append(back @ R[k])
        more = back * (k == 0) - R[k] / mu[:, None] - R[k] / mu + forth @ R[k] + R[k] @ forth
        R.append((more + sum(R[j] @ turned[k - j] for j in range(k + 1))) / (k + 1))
        more = straight[k][:, None] * forth - T[k] / mu + T[k] @ forth
        T.append((more + sum((T[j] + np.diag(straight[j])) @ turned[k - j] for j in range(k + 1))) / (k + 1))
    R, T = (sum(part * t**k for k, part in enumerate(parts)) for parts in (R, T))
    for step in range(steps):
        decay = np.exp(-t * 2.0**step / mu)
        whole = T + np.diag(decay)
        both = R @ np.linalg.solve(np.eye(mu.size) - R @ R, whole)
        R, T = R + whole @ both, whole @ R @ both + decay[:, None] * T + T * decay + T @ T
    return R, T + np.diag(np.exp(-thickness / mu))


def find_light(surface, n, above, below, albedo, mu_in, seen, finer=1.0):
    """Orders of light for unit Stokes vectors of flux 1 across beams, (order, 4, direction, 4, beam) each, of all
    directions of either side: above all, rising and falling above the surface, rising and falling under it, and so on
    between the layers ``below``, over a Lambertian base; both sides. What is seen of beams that met facets alone is
    missing. n: index of the layers ``below`` over that of the one ``above``, which may be None."""
    n_order = max(layer.phase_matrix.terms for layer in (above, *below) if layer is not None)
    critical, twice = [math.sqrt(1.0 - n**-2), 1.0 / n], 2.0 * math.asin(1.0 / n)
    meet = [0.0, GRAZING, *sorted({*critical, abs(math.cos(twice)), math.sin(twice)}), 1.0]
    outside = Side([0.0, GRAZING, *sorted(critical), 1.0] if above else [], seen, mu_in, finer)
    inside = Side(meet, seen, [], finer)
    down, up = (n, outside, outside, False, n_order), (1.0 / n, inside, inside, True, n_order)
    mirrored, returned = send(surface, *down), send(surface, *up)
    entered = send(surface, n, outside, inside, False, n_order)
    left = send(surface, 1.0 / n, inside, outside, True, n_order)
    flips = [np.tile(np.diag(D), side.mu.size)[:, None] for side in (outside, inside)]
    first, found = 4 * outside.beams, []
    for m in range(n_order):
        R, T = (
            solve_slab(above, above.thickness, outside, m) if above else (0.0 * mirrored[m], np.eye(len(mirrored[m])))
        )
        slabs = [solve_slab(layer, layer.thickness, inside, m) for layer in below]
        size = 4 * inside.mu.size
        rows = np.arange(size) % 4 == 0
        power = np.repeat(inside.weight * inside.mu, 4) * rows
        seen_below = [2.0 * albedo * (m == 0) * np.outer(rows, power)]  # reflection of all that lies below
        for r, t in slabs[::-1]:
            seen_below.insert(0, r + t @ seen_below[0] @ np.linalg.solve(np.eye(size) - r @ seen_below[0], t))
        # falling light above the surface, and rising light under it
        above_, below_ = R * flips[0].T, flips[1] * seen_below[0]
        system = np.block([[above_ @ mirrored[m], above_ @ left[m]], [below_ @ entered[m], below_ @ returned[m]]])
        come = np.concatenate([T[:, first:], np.zeros((size, T.shape[1] - first))])
        falls, rises = np.split(np.linalg.solve(np.eye(len(system)) - system, come), [len(T)])
        goes_up, goes_down = mirrored[m] @ falls + left[m] @ rises, entered[m] @ falls + returned[m] @ rises
        top = flips[0] * (R[:, first:] + T @ (flips[0] * goes_up))
        light = [top, goes_up, falls, rises, goes_down]
        for (r, t), rest in zip(slabs[:-1], seen_below[1:], strict=False):
            goes_down = np.linalg.solve(np.eye(size) - r @ rest, t @ goes_down)
            light += [flips[1] * (rest @ goes_down), goes_down]
        found.append([part.reshape(-1, 4, len(mu_in), 4) / (2.0 * np.pi) for part in light])
    return found, outside, inside
