"""How light that leaves a slab changes with its matrices E and F, by modes, and with its thickness, by invariance.

With X and Y of core/homogeneous.pxi, F Y = X and E X = Y lambda, the impedances are Ze = Y g(lambda) X^-1 and
Zo = X f(lambda) Y^-1. A change dE, dF has e = Y^-1 dE X and p = X^-1 dF Y, and to first order, element by element with
divided differences (Daletskii and Krein's formula, docs/explanation/derivatives.md),

    dZe = Y (g[a, b] e + a b f[a, b] p) X^-1,    dZo = X (f[a, b] e + g[a, b] p) Y^-1,

which is as exact where eigenvalues coincide or are zero. R = So - Se, T = 1 - So - Se with S = Z (1 + Z)^-1, so
dS = (1 + Z)^-1 dZ (1 + Z)^-1: what weighs light that leaves, times a matrix between modes, times light that enters.
Where little light gets through, So + Se is nearly 1, and the change of T is found from
C = 1 - Zo Ze = X c(lambda) X^-1, c = 1 - f g, to the last digits of T itself:

    dT = (1 + Zo)^-1 [X c[a, b] (e + p b) X^-1 (1 + Ze)^-1 - dZo T] - T dZe (1 + Ze)^-1.

Directions off the nodes are nodes without weight, as in core/extended.pxi: matrices of
(incident, nodes, outgoing) are block triangular, with rates 1/mu that have eigenvalues 1/mu^2 of their own. Where one
of these is close to a mode's, eigenvectors grow without bound and the sum of them loses digits: there the rate is moved
to either side and what it would be in between is interpolated, as smooth a function as it is.

All arrays have Fourier orders in front; where modes oscillate, they are complex.
"""

from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.discrete_ordinates.derivatives.functions import Decay
from vrte.discrete_ordinates.orders.homogeneous import Modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem

APART = 7e-4  # relative distance of an eigenvalue to a direction's rate below which interpolation replaces it
STEPS = (2.5e-3, 3.5e-3, 5e-3, 7e-3)  # relative steps of the rate for that interpolation, tried in turn
FLAT = 0.02  # largest change of thickness times rate over a step: the interpolation is right to 1e-11 there
LOST = 40.0  # attenuation exponent: exp(-40) of the transmitted light is below rounding
DIM = 8.0  # e-folds of the slowest mode from which on the change of T is found for itself: 3e-4 of the light
ASIDE, SHARES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0]), np.array([1.0, -6.0, 15.0, 15.0, -6.0, 1.0]) / 20.0


@record
class Blocks:
    """A matrix on nodes and directions off them, one direction's Stokes parameters side by side: N (n, n), NI (n, r),
    ON (o, n)."""

    N: Array
    NI: Array
    ON: Array


@record
class Faces:
    """Light that enters a slab, or what light that leaves it weighs, at the top and at the bottom: on the nodes,
    above and below (order, n, r), and along directions off them, falling and rising (d, r)."""

    above: Array
    below: Array
    falling: Array
    rising: Array


class Term(NamedTuple):
    """Part of a derivative: left^T M right, M the matrix between modes of even or odd light or of C."""

    name: str
    left: Array
    right: Array


@record
class Aside:
    """Rates of directions, some of them stepped around: rate (k,), share (k,), and the direction (k,) of each."""

    rate: Array
    share: Array
    of: Array

    def turn(self, ratio: Array) -> "Aside":
        """Those of directions whose rates are these, times a ratio (direction,)."""
        return replace_unchecked(self, rate=self.rate * ratio[self.of])

    def deal(self, values: Array) -> Array:
        """Values (count, r) of directions dealt out, (k, r)."""
        if self.of.size == len(values):
            return values
        return values[self.of] * self.share[:, None]

    def gather(self, values: Array, count: int) -> Array:
        """Rows (order, k, ...) added up direction by direction, (order, count, ...)."""
        if self.of.size == count:
            return values
        found = np.zeros((values.shape[0], count, values.shape[2]), values.dtype)
        for row, of in enumerate(self.of.tolist()):
            found[:, of] += values[:, row]
        return found


def step_aside(mu: Array, lam: Array, stokes: int, thickness: float = 0.0) -> Aside:
    """The rates 1/mu of directions (d,) of a slab, each for its Stokes parameters, or six around those near a mode's:
    the thicker, the closer, where light of that rate is not lost beside the slowest."""
    if (measure_gaps(1.0 / mu, lam) >= APART).all():
        return Aside(
            np.repeat(1.0 / mu, stokes), np.ones(stokes * mu.size), np.arange(stokes * mu.size, dtype=np.int32)
        )
    points, shares = [], []
    slowest = float(np.sqrt(lam).real.min())
    for own, difference in zip((1.0 / mu).tolist(), measure_gaps(1.0 / mu, lam).tolist(), strict=True):
        if difference < APART:
            seen = thickness * own if thickness * (own - slowest) < LOST else 0.0
            short = min(1.0, FLAT / max(seen * STEPS[-1], FLAT))
            around = [own * (1.0 + short * step * ASIDE) for step in STEPS]
            points.append(max(around, key=lambda each: float(measure_gaps(each, lam).min())))
            shares.append(SHARES)
        else:
            points.append(np.array([own]))
            shares.append(np.ones(1))
    count = np.repeat([part.size for part in points], stokes)
    rate, fraction = (np.concatenate([part for part in parts for _ in range(stokes)]) for parts in (points, shares))
    return Aside(rate, fraction, np.repeat(np.arange(count.size), count))


def measure_gaps(rate: Array, lam: Array) -> Array:
    """The least distance of each rate's square (k,) from the eigenvalues (..., n), relative, (..., k)."""
    return np.abs(lam[..., None, :] / rate[:, None] ** 2 - 1.0).min(axis=-1)


def group_by_gaps(lam: Array, mu: Array) -> list[IntArray]:
    """Orders, of modes (order, n), that are differentiated together: all in which no direction is near a mode; each of
    the others for itself."""
    near = (measure_gaps(1.0 / mu, lam) < APART).any(axis=-1)
    groups = [np.flatnonzero(~near)] if not near.all() else []
    return groups + [np.array([order]) for order in np.flatnonzero(near)]


def take_blocks(one: Problem, matrices: Assembled, layer: int = 0) -> tuple[Blocks, Blocks]:
    """E and F of a layer on nodes and directions off them, as core/extended.pxi has them."""
    rows = np.repeat(one.mu_out, len(one.stokes))[:, None]
    E, F = (
        Blocks(part[:, layer].swapaxes(1, 2), -source[:, layer].swapaxes(1, 2), -G[:, layer].swapaxes(1, 2) / rows)
        for part, source, G in (
            (matrices.E, matrices.source_d, matrices.G_E),
            (matrices.F, matrices.source_s, matrices.G_F),
        )
    )
    return E, F


def take_modes(modes: Modes, layer: int) -> tuple[Array, Array, Array, Array, Array]:
    """lambda (order, n), X, Y and their inverses (order, n, n), complex where modes oscillate."""
    lam, oscillation = modes.lam_re[:, layer], modes.lam_im[:, layer]
    X: Any
    Y: Any
    X, Y = modes.X[:, layer].swapaxes(1, 2), modes.Y[:, layer].swapaxes(1, 2)
    if (modes.X_pivots[:, layer, 0] < 0).all():
        return lam, X, Y, Y.swapaxes(1, 2), X.swapaxes(1, 2)
    if oscillation.any():
        X, Y = X.astype(complex), Y.astype(complex)
        for order, mode in np.argwhere(oscillation > 0.0):  # a pair's columns: the real and the imaginary part
            for part in (X, Y):
                part[order, :, mode] += 1j * part[order, :, mode + 1]
                part[order, :, mode + 1] = part[order, :, mode].conj()
        lam = lam + 1j * oscillation
    return lam, X, Y, np.linalg.inv(X), np.linalg.inv(Y)


def join_blocks(blocks: Blocks, r: int, o: int) -> Array:
    """Derivatives with a matrix from nodes and beams to nodes and directions, by columns, (order, n + r, n + o)."""
    n = blocks.N.shape[-1]
    found = np.zeros((len(blocks.N), n + r, n + o))
    found[:, :n, :n], found[:, n:, :n] = blocks.N.swapaxes(1, 2), blocks.NI.swapaxes(1, 2)
    found[:, :n, n:] = blocks.ON.swapaxes(1, 2)
    return found


class SlabModes:
    """Some orders of a slab by their modes, lam (order, n), X, Y and their inverses (order, n, n): what all derivatives
    share."""

    def __init__(self, one: Problem, matrices: Assembled, modes: Modes, material: int, thickness: float) -> None:
        """Of a problem's directions, made of one of its layers."""
        lam, X, Y, self.X_inverse, self.Y_inverse = self.lam, self.X, self.Y, *_ = take_modes(modes, material)
        self.one, self.material, self.stokes = one, material, len(one.stokes)
        self.decaying = decaying = Decay(0.5 * thickness)
        self.f, self.g = decaying.find_f(lam)[..., None], decaying.find_g(lam)[..., None]
        systems = [X + Y * self.g.swapaxes(1, 2)]
        systems += [] if decaying.is_semi_infinite else [Y + X * self.f.swapaxes(1, 2)]
        self.even, *odd = inverses = [np.linalg.inv(system) for system in systems]
        self.odd = odd[0] if odd else None
        missing = [np.abs(one @ other - np.eye(lam.shape[1])) for one, other in zip(systems, inverses, strict=True)]
        self.residual = np.max(missing, axis=(0, 2, 3))
        slowest = float(np.sqrt(lam).real.min())
        self.is_dim = self.odd is not None and slowest * thickness > DIM
        self.point(matrices, *(step_aside(mu, lam[0], self.stokes, thickness) for mu in (one.mu0, one.mu_out)))

    def turn(self, beside: Problem, matrices: Assembled) -> "SlabModes":
        """The same slab with the directions of another problem, each near one of its own."""
        found = copy(self)
        found.one = beside
        pairs = (self.into, self.one.mu0 / beside.mu0), (self.out, self.one.mu_out / beside.mu_out)
        found.point(matrices, *(own.turn(np.repeat(ratio, self.stokes)) for own, ratio in pairs))
        return found

    def point(self, matrices: Assembled, into: Aside, out: Aside) -> None:
        """Puts directions beside the modes: eigenvectors that lead in (columns) and out (rows), with what F makes of
        them."""
        E, F = take_blocks(self.one, matrices, self.material)
        lam, X, Y, self.into, self.out, self.along = self.lam, self.X, self.Y, into, out, (E.ON, F.ON)
        rate, rate_out = into.rate, out.rate[:, None]
        f_in, e_in = (self.X_inverse @ F.NI)[..., into.of], (self.Y_inverse @ E.NI)[..., into.of]
        self.x_in = (rate * f_in + e_in) / (rate**2 - lam[..., None])
        self.y_in = self.x_in - f_in / rate
        e_out, f_out = (E.ON @ X)[:, out.of], (F.ON @ Y)[:, out.of]
        self.x_out = (rate_out * e_out + f_out * lam[:, None]) / (lam[:, None] - rate_out**2)
        self.y_out = (self.x_out - f_out) / rate_out
        self.X_right, self.Y_right = (
            np.concatenate([one, one @ more], axis=-1) for one, more in ((X, self.x_in), (Y, self.y_in))
        )
        self.t_in, self.t_out = np.tanh(self.decaying.half * rate)[:, None], np.tanh(self.decaying.half * rate_out)

    @cached_property
    def tables(self) -> dict[str, tuple[Array, Array]]:
        """What e and p are multiplied with, element by element, in even and odd light and in C."""
        rows, columns = (
            np.concatenate([self.lam, np.tile(aside.rate**2, (len(self.lam), 1))], axis=1)
            for aside in (self.out, self.into)
        )
        f, g, c = self.decaying.divide(rows, columns, self.is_dim)
        found = {"even": (g, rows[:, :, None] * columns[:, None] * f), "odd": (f, g)}
        return found | ({"C": (c, c * columns[:, None])} if self.is_dim else {})

    def light_even(self, light: Array | float, beams: Array) -> Array:
        """X^-1 (1 + Ze)^-1 of light on the nodes (order, n, r) and along beams (k, r): (order, n + k, r)."""
        own = beams / (1.0 + self.t_in)
        rest = light - self.X @ (self.x_in @ own) - self.Y @ (self.y_in @ (self.t_in * self.into.rate[:, None] * own))
        return self.put_below(self.even @ rest, own)

    def light_odd(self, light: Array | float, beams: Array) -> Array:
        """Y^-1 (1 + Zo)^-1 of the same."""
        assert self.odd is not None
        own = beams * self.into.rate[:, None] / (1.0 + self.t_in)
        rest = light - self.Y @ (self.y_in @ own) - self.X @ (self.x_in @ (self.t_in / self.into.rate[:, None] * own))
        return self.put_below(self.odd @ rest, own)

    def weigh_even(self, weights: Array | float, sights: Array) -> tuple[Array, Array]:
        """On the nodes (1 + Ze)^-T of weights, X^T times those on the nodes (order, n, r), and along sights (k, r);
        and Y^T times it."""
        own = sights / (1.0 + self.t_out)
        y = self.y_out.swapaxes(1, 2) @ own
        rest = weights - self.g * y + self.x_out.swapaxes(1, 2) @ (self.t_out * own)
        found = self.even.swapaxes(1, 2) @ rest
        return found, self.put_below(self.Y.swapaxes(1, 2) @ found + y, own / self.out.rate[:, None])

    def weigh_odd(self, weights: Array | float, sights: Array) -> tuple[Array, Array]:
        """(1 + Zo)^-T of weights, Y^T times those on the nodes, and along sights: on the nodes, and X^T times it."""
        assert self.odd is not None
        own = sights / (1.0 + self.t_out)
        x = self.x_out.swapaxes(1, 2) @ own
        rest = weights - self.f * x + self.y_out.swapaxes(1, 2) @ (self.t_out * own)
        found = self.odd.swapaxes(1, 2) @ rest
        return found, self.put_below(self.X.swapaxes(1, 2) @ found + x, own)

    def respond(self) -> tuple[Array, Array, Array, Array]:
        """R and T on the nodes and along directions, as `Response` has them of a slab."""
        return self.respond_on_nodes(), *self.respond_along_directions()

    def respond_on_nodes(self) -> Array:
        """R and T on the nodes, (order, 2, n, n)."""
        one = np.eye(self.lam.shape[1])
        even = one - self.X @ self.even
        odd = one - even if self.odd is None else one - self.Y @ self.odd
        return np.stack([odd - even, one - odd - even], axis=1).real

    def respond_along_directions(self) -> tuple[Array, Array, Array]:
        """R and T from beams to the nodes, (order, 2, n, r), from the nodes along sights, (order, 2, o, n), and from
        beams along sights, (order, 2, o, r): that is linear in the rows of E and F that lead out, as a change is."""
        lit = self.into.deal(np.eye(self.one.n_rhs))
        seen = self.out.deal(np.eye(self.one.rows_out))
        own = seen / (1.0 + self.t_out)
        out, into = (np.tile(aside.rate**2, (len(self.lam), 1)) for aside in (self.out, self.into))
        columns = np.concatenate([self.lam, into], axis=1)
        f, g, _ = self.decaying.divide(out, columns)
        e, p = (part[:, self.out.of] for part in (self.along[0] @ self.X_right, self.along[1] @ self.Y_right))
        e = e * self.out.rate[:, None]
        light = self.light_even(0.0, lit)
        even = (
            -self.X_right @ light,
            -self.weigh_even(0.0, seen)[0].swapaxes(1, 2),
            (own / self.out.rate[:, None]).T @ ((g * e + out[..., None] * columns[:, None] * f * p) @ light),
        )
        odd = tuple(-part for part in even)
        if self.odd is not None:
            light = self.light_odd(0.0, lit)
            odd = (
                -self.Y_right @ light,
                -self.weigh_odd(0.0, seen)[0].swapaxes(1, 2),
                own.T @ ((f * e + g * p) @ light),
            )
        entering, leaving, passing = (
            np.stack([more - less, -more - less], axis=1).real for less, more in zip(even, odd, strict=True)
        )
        return entering, leaving, passing

    @staticmethod
    def put_below(nodes: Array, own: Array) -> Array:
        """Rows of directions below those of the modes."""
        own = np.broadcast_to(own, (len(nodes), *own.shape[-2:]))
        return np.concatenate([nodes, own], axis=1)

    def list_terms(self, light: Faces, weights: Faces) -> list[Term]:
        """The parts of a derivative, for light that enters and what light that leaves weighs."""
        falling, rising = self.into.deal(light.falling), self.into.deal(light.rising)
        up, down = self.out.deal(weights.falling), self.out.deal(weights.rising)
        X, Y = self.X.swapaxes(1, 2), self.Y.swapaxes(1, 2)
        if self.odd is None:
            return [
                Term("even", -2.0 * self.weigh_even(X @ weights.above, up)[1], self.light_even(light.above, falling))
            ]
        if not self.is_dim:
            total, difference = light.above + light.below, light.above - light.below
            weighs, differs = weights.above + weights.below, weights.above - weights.below
            return [
                Term("even", -self.weigh_even(X @ weighs, up + down)[1], self.light_even(total, falling + rising)),
                Term("odd", self.weigh_odd(Y @ differs, up - down)[1], self.light_odd(difference, falling - rising)),
            ]
        found = []
        sides = [(light.above, falling), (light.below, rising)]
        even, odd = ([find(*side) for side in sides] for find in (self.light_even, self.light_odd))
        given = [(weights.above, up), (weights.below, down)]
        odd_seen = [self.weigh_odd(Y @ nodes, own)[1] for nodes, own in given]
        even_seen = [self.weigh_even(X @ nodes, own)[1] for nodes, own in given]
        passed, let = (
            [self.pass_light(each) for each in even],
            [self.pass_weights(*each) for each in zip(odd_seen, given, strict=True)],
        )
        for here, there in ((0, 1), (1, 0)):
            found += [
                Term("odd", odd_seen[here], odd[here] - passed[there]),
                Term("even", -even_seen[here] - let[there], even[here]),
                Term("C", odd_seen[here], even[there]),
            ]
        return found

    def pass_light(self, even: Array) -> Array:
        """Y^-1 T of light, from X^-1 (1 + Ze)^-1 of it."""
        n, rate = self.lam.shape[1], self.into.rate[:, None]
        c = self.decaying.find_c(self.lam)[..., None]
        own = self.decaying.find_c(rate**2) * even[:, n:]
        return self.light_odd(self.X @ (c * even[:, :n] + self.x_in @ own), own)

    def pass_weights(self, odd: Array, given: tuple[Array, Array]) -> Array:
        """(T Y)^T of weights, from X^T (1 + Zo)^-T of them."""
        n = self.lam.shape[1]
        c, c_out = self.decaying.find_c(self.lam)[..., None], self.decaying.find_c(self.out.rate[:, None] ** 2)
        own = c_out * odd[:, n:]
        return self.weigh_even(c * odd[:, :n] - self.x_out.swapaxes(1, 2) @ own, own)[1]

    def list_bases(self, count: int) -> list[tuple[Array, ...]]:
        """Of E, then of F, in the first orders: inverse eigenvectors, eigenvectors with what leads in, what leads out,
        and the scales of rows out and of columns in."""
        one = np.ones(1)
        return [
            (self.Y_inverse[:count], self.X_right[:count], self.y_out[:count], self.out.rate[:, None], one),
            (self.X_inverse[:count], self.Y_right[:count], self.x_out[:count], one, 1.0 / self.into.rate),
        ]

    def expand(self, dE: Blocks, dF: Blocks) -> tuple[Array, Array]:
        """e and p of a change of the first orders, (order, n + k_out, n + k_in)."""
        found = []
        for d, (inverse, right, leads, factor, scale) in zip((dE, dF), self.list_bases(len(dE.N)), strict=True):
            nodes = d.N @ right
            nodes[..., self.lam.shape[1] :] += d.NI[..., self.into.of] * scale
            own = inverse @ nodes
            found.append(np.concatenate([own, factor * ((d.ON @ right)[:, self.out.of] - leads @ own)], axis=1))
        return found[0], found[1]

    def pull_expanded(self, e: Array, p: Array, r: int, o: int) -> tuple[Blocks, Blocks]:
        """The transpose of `expand`."""
        n, found = self.lam.shape[1], []
        for of, (inverse, right, leads, factor, scale) in zip((e, p), self.list_bases(len(e)), strict=True):
            row, turned = factor * of[:, n:], right.swapaxes(1, 2)
            own = inverse.swapaxes(1, 2) @ (of[:, :n] - leads.swapaxes(1, 2) @ row)
            aside = (own[..., n:] * scale).swapaxes(1, 2)
            parts = own @ turned, self.into.gather(aside, r).swapaxes(1, 2), self.out.gather(row, o) @ turned
            found.append(Blocks(*(part.real for part in parts)))
        return found[0], found[1]

    def change(self, terms: list[Term], matrices: Assembled) -> Array:
        """What weighs the light that a change of the first orders sends out, (order, r_weights, r); matrices of one
        layer, whose E and F are the change."""
        dE, dF = take_blocks(self.one, matrices)
        count = len(dE.N)
        e, p = self.expand(dE, dF)
        between = {name: one[:count] * e + other[:count] * p for name, (one, other) in self.tables.items()}
        parts = [term.left[:count].swapaxes(1, 2) @ (between[term.name] @ term.right[:count]) for term in terms]
        return np.asarray(sum(parts)).real

    def pull(self, terms: list[Term], weights: Array) -> tuple[Array, Array]:
        """Derivatives with E and F of all that `change` finds, weighed by (order, r_weights, r): each by columns from
        nodes and beams to nodes and directions, (order, n + r, n + o)."""
        r, o = self.one.n_rhs, self.one.rows_out
        e, p = np.zeros(()), np.zeros(())
        for name, (one, other) in self.tables.items():
            own = [term.left @ (weights @ term.right.swapaxes(1, 2)) for term in terms if term.name == name]
            e, p = e + one * sum(own), p + other * sum(own)
        E, F = self.pull_expanded(e, p, r, o)
        return join_blocks(E, r, o), join_blocks(F, r, o)
