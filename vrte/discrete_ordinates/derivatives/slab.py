"""How R and T of a homogeneous slab change with its matrices E and F, by modes, and with its thickness, by invariance.

With X and Y of core/homogeneous.pxi, F Y = X and E X = Y lambda, the impedances are Ze = Y g(lambda) X^-1 and
Zo = X f(lambda) Y^-1. A change dE, dF has e = Y^-1 dE X and p = X^-1 dF Y, and to first order, element by element with
divided differences (Daletskii and Krein's formula, docs/explanation/derivatives.md),

    dZe = Y (g[a, b] e + a b f[a, b] p) X^-1,    dZo = X (f[a, b] e + g[a, b] p) Y^-1,

which is as exact where eigenvalues coincide or are zero. R = So - Se, T = 1 - So - Se with S = Z (1 + Z)^-1, so
dS = (1 + Z)^-1 dZ (1 + Z)^-1. Where little light gets through, So + Se is nearly 1, and the change of T is found from
C = 1 - Zo Ze = X c(lambda) X^-1, c = 1 - f g, to the last digits of T itself:

    dT = (1 + Zo)^-1 [X c[a, b] (e + p b) X^-1 (1 + Ze)^-1 - dZo T] - T dZe (1 + Ze)^-1.

Directions off the nodes are nodes without weight, as in core/extended.pxi: matrices of
(incident, nodes, outgoing) are block triangular, with rates 1/mu that have eigenvalues 1/mu^2 of their own. Where one
of these is close to a mode's, eigenvectors grow without bound and the sum of them loses digits: there the rate is moved
to either side and what it would be in between is interpolated, as smooth a function as it is.

A thin sheet more at the bottom, b = (F - E)/2, c = (F + E)/2, tells the thickness: dR = T b T, dT = -(c - R b) T.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.discrete_ordinates.derivatives.functions import Decay

APART = 7e-4  # relative distance of an eigenvalue to a direction's rate below which interpolation replaces it
STEPS = (2.5e-3, 3.5e-3, 5e-3, 7e-3)  # relative steps of the rate for that interpolation, tried in turn
FLAT = 0.02  # largest change of thickness times rate over a step: the interpolation is right to 1e-11 there
LOST = 40.0  # attenuation exponent: exp(-40) of the transmitted light is below rounding
ASIDE, SHARES = np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0]), np.array([1.0, -6.0, 15.0, 15.0, -6.0, 1.0]) / 20.0


@dataclass(frozen=True, eq=False)
class Blocks:
    """A matrix on nodes and directions off them, one direction's Stokes parameters side by side: N (n, n), NI (n, r),
    ON (o, n), OI (o, r)."""

    N: Array
    NI: Array
    ON: Array
    OI: Array

    def plus(self, other: "Blocks", factor: float = 1.0) -> "Blocks":
        """The sum, ``factor`` times the other."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Blocks(*(one + factor * more for one, more in pairs))

    def times(self, factor: float) -> "Blocks":
        """All of it times a factor."""
        return Blocks(*(factor * part for part in vars(self).values()))


@dataclass(frozen=True, eq=False)
class Aside:
    """Rates of directions, some of them stepped around: rate (k,), share (k,), and the direction (k,) of each."""

    rate: Array
    share: Array
    of: Array

    def gather(self, values: Array) -> Array:
        """Values (..., k) added up direction by direction, (..., count)."""
        first = np.flatnonzero(np.diff(self.of, prepend=-1))
        if first.size == self.of.size:
            return values
        return np.add.reduceat(values * self.share, first, axis=-1)


def step_aside(mu: Array, lam: Array, stokes: int, thickness: float = 0.0) -> Aside:
    """The rates 1/mu of directions (d,) of a slab, each for its Stokes parameters, or six around those near a mode's:
    the thicker, the closer, where light of that rate is not lost beside the slowest."""
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
    """The least distance of each rate's square (k,) from the eigenvalues, relative."""
    return np.abs(lam / rate[:, None] ** 2 - 1.0).min(axis=1)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Modes that oscillate come in pairs, whose real columns are the real and the imaginary part of one of them.

    Matrix products are taken of real ones; what goes element by element with eigenvalues, of complex ones. first
    (pairs,): where each pair begins."""

    first: IntArray

    def part_rows(self, values: Array) -> Array:
        """Complex modes' rows from real ones'."""
        if not self.first.size:
            return values
        found = values.astype(complex)
        found[self.first] = 0.5 * (values[self.first] - 1j * values[self.first + 1])
        found[self.first + 1] = found[self.first].conj()
        return found

    def part_columns(self, values: Array) -> Array:
        """Complex modes' columns from real ones'."""
        if not self.first.size:
            return values
        found = values.astype(complex)
        found[:, self.first] += 1j * values[:, self.first + 1]
        found[:, self.first + 1] = values[:, self.first] - 1j * values[:, self.first + 1]
        return found

    def join_rows(self, values: Array) -> Array:
        """Real modes' rows from complex ones'."""
        if not self.first.size:
            return values.real
        found = values.copy()
        found[self.first] = values[self.first] + values[self.first + 1]
        found[self.first + 1] = 1j * (values[self.first] - values[self.first + 1])
        return found

    def join_columns(self, values: Array) -> Array:
        """Real modes' columns from complex ones'."""
        if not self.first.size:
            return values.real
        found = values.copy()
        found[:, self.first] = 0.5 * (values[:, self.first] + values[:, self.first + 1])
        found[:, self.first + 1] = -0.5j * (values[:, self.first] - values[:, self.first + 1])
        return found

    def scale_columns(self, values: Array, factors: Array) -> Array:
        """Real modes' columns times a function of the eigenvalues."""
        return np.ascontiguousarray(self.join_columns(self.part_columns(values) * factors).real)


class SlabModes:
    """One order of a slab by its modes, lam (n,), X and Y (n, n) with pairs as real columns: what all derivatives
    share."""

    def __init__(
        self, E: Blocks, F: Blocks, lam: Array, X: Array, Y: Array, mu_in: Array, mu_out: Array, thickness: float
    ) -> None:
        stokes = E.NI.shape[1] // mu_in.size
        self.decaying = decaying = Decay(0.5 * thickness)
        self.X, self.Y = X, Y
        self.pairs = pairs = Pairs(np.flatnonzero(lam.imag > 0.0).astype(np.int32))
        self.X_inverse, self.Y_inverse = np.asarray(np.linalg.inv(X), float), np.asarray(np.linalg.inv(Y), float)
        self.into, self.out = step_aside(mu_in, lam, stokes, thickness), step_aside(mu_out, lam, stokes, thickness)
        rate, rate_out = self.into.rate, self.out.rate[:, None]
        f, g = decaying.find_f(lam), decaying.find_g(lam)
        # eigenvectors that lead in (columns) and out (rows), with what F makes of them
        f_in, e_in = (self.X_inverse @ F.NI)[:, self.into.of], (self.Y_inverse @ E.NI)[:, self.into.of]
        x_in = pairs.part_rows(rate * f_in + e_in) / (rate**2 - lam[:, None])
        self.x_in = np.ascontiguousarray(pairs.join_rows(x_in).real)
        self.y_in = self.x_in - f_in / rate
        e_out, f_out = (E.ON @ X)[self.out.of], (F.ON @ Y)[self.out.of]
        x_out = (pairs.part_columns(rate_out * e_out) + pairs.part_columns(f_out) * lam) / (lam - rate_out**2)
        self.x_out = np.ascontiguousarray(pairs.join_columns(x_out).real)
        self.y_out = (self.x_out - f_out) / rate_out
        # (1 + Z)^-1 to the right, from the light that comes in to modes, and to the left
        t_in = np.tanh(decaying.half * rate)
        t_out = np.tanh(decaying.half * rate_out)
        f_in, g_in = t_in / rate, t_in * rate
        even = np.asarray(np.linalg.inv(X + pairs.scale_columns(Y, g)))
        even_in: Array = 1.0 / (1.0 + t_in)
        even_from_in = -even @ (X @ self.x_in + (Y @ self.y_in) * g_in) * even_in
        even_left = X @ even @ Y
        impedance = (pairs.scale_columns(self.y_out, g) - t_out * self.x_out) @ self.X_inverse
        even_out = (self.y_out - impedance @ even_left) / (1.0 + t_out)
        self.even = Side(even, even_in, even_from_in, even_left, even_out, 1.0 / (rate_out * (1.0 + t_out)))
        self.odd: Side | None = None
        if not decaying.is_semi_infinite:
            odd = np.asarray(np.linalg.inv(Y + pairs.scale_columns(X, f)))
            odd_in: Array = rate / (1.0 + t_in)
            odd_from_in = -odd @ (Y @ self.y_in + (X @ self.x_in) * f_in) * odd_in
            odd_left = Y @ odd @ X
            impedance = (pairs.scale_columns(self.x_out, f) - t_out * self.y_out) @ self.Y_inverse
            odd_out = (self.x_out - impedance @ odd_left) / (1.0 + t_out)
            self.odd = Side(odd, odd_in, odd_from_in, odd_left, odd_out, 1.0 / (1.0 + t_out))
            self.passing = self.make_passing(decaying, lam)
        self.tables = self.make_tables(lam, rate**2, self.out.rate**2)

    def make_passing(self, decaying: Decay, lam: Array) -> tuple["Side", "Side", "Side"]:
        """What encloses changes of C, Zo and Ze, for that of T: Y^-1 T stands right of the second, T Y left of the
        third."""
        even, odd, pairs = self.even, self.odd, self.pairs
        assert odd is not None
        rate, rate_out = self.into.rate, self.out.rate[:, None]
        c, c_in, c_out = (decaying.find_c(points) for points in (lam, rate**2, rate_out**2))
        through = odd.nodes @ pairs.scale_columns(self.X, c)
        from_in = through @ even.from_in + (odd.from_in + odd.nodes @ (self.X @ self.x_in)) * (c_in * even.into)
        right = Side(through @ even.nodes, odd.into * c_in * even.into, from_in, odd.left, odd.out_left, odd.out)
        behind = even.nodes @ self.Y  # X^-1 (1 + Ze)^-1 Y
        left = pairs.scale_columns(odd.left, c) @ behind
        out_left = pairs.scale_columns(odd.out_left, c) @ behind + odd.out * c_out * (
            even.out_left - self.x_out @ behind
        )
        out = odd.out * c_out * even.out
        return (
            Side(even.nodes, even.into, even.from_in, odd.left, odd.out_left, odd.out),
            right,
            Side(even.nodes, even.into, even.from_in, left, out_left, out),
        )

    def make_tables(self, lam: Array, square: Array, square_out: Array) -> dict[str, tuple[Array, ...]]:
        """f[a, b], g[a, b] and a b f[a, b] for each block, and c[a, b] and c[a, b] b of a slab that has an end."""
        points, index = np.unique(np.concatenate([lam, square, square_out]), return_inverse=True)
        f, g = self.decaying.divide(points)
        with np.errstate(invalid="ignore"):
            product = points[:, None] * points * f
        # semi-infinite and not absorbing: g[0, 0] is infinite, and what it is multiplied with is zero: the flux is kept
        tables = [f, np.where(np.isfinite(g), g, 0.0), np.where(np.isfinite(product), product, 0.0)]
        if self.odd is not None:
            c = self.decaying.divide_c(points)
            tables += [c, c * points]
        nodes, into, out = np.split(index, [lam.size, lam.size + square.size])
        blocks = {"N": (nodes, nodes), "NI": (nodes, into), "ON": (out, nodes), "OI": (out, into)}
        return {name: tuple(table[rows][:, columns] for table in tables) for name, (rows, columns) in blocks.items()}

    def part(self, name: str, values: Array) -> Array:
        """A block on complex modes from that on real ones."""
        values = self.pairs.part_rows(values) if name in ("N", "NI") else values
        return self.pairs.part_columns(values) if name in ("N", "ON") else values

    def join(self, name: str, values: Array) -> Array:
        """A block on real modes from that on complex ones."""
        values = self.pairs.join_rows(values) if name in ("N", "NI") else values
        return np.ascontiguousarray((self.pairs.join_columns(values) if name in ("N", "ON") else values).real)

    def differentiate(self, dE: Blocks, dF: Blocks, on_nodes: bool = True) -> tuple[Blocks, Blocks]:
        """dR and dT; without those ``on_nodes``, of what no other slab, base or surface sends light to, OI alone."""
        into, out = self.into.of, self.out.of
        rate, rate_out = self.into.rate, self.out.rate[:, None]
        own = self.Y_inverse @ dE.N @ self.X
        in_ = (self.Y_inverse @ dE.NI)[:, into] + own @ self.x_in
        row = (dE.ON @ self.X)[out]
        e = Blocks(own, in_, rate_out * (row - self.y_out @ own), rate_out * (row @ self.x_in - self.y_out @ in_))
        own = self.X_inverse @ dF.N @ self.Y
        in_ = (self.X_inverse @ dF.NI)[:, into] / rate + own @ self.y_in
        row = (dF.ON @ self.Y)[out]
        p = Blocks(own, in_, row - self.x_out @ own, row @ self.y_in - self.x_out @ in_)
        even: dict[str, Array] = {}
        odd: dict[str, Array] = {}
        both: dict[str, Array] = {}
        for name, (f, g, product, *more) in self.tables.items():
            one, other = (self.part(name, getattr(part, name)) for part in (e, p))
            even[name] = self.join(name, g * one + product * other)
            if self.odd is not None:
                odd[name] = self.join(name, f * one + g * other)
                both[name] = self.join(name, more[0] * one + more[1] * other)
        enclose = partial(Side.enclose, into=self.into, out=self.out, on_nodes=on_nodes)
        dSe = enclose(self.even, Blocks(**even))
        if self.odd is None:
            return dSe.times(-2.0), dSe.times(0.0)
        dSo = enclose(self.odd, Blocks(**odd))
        through, before, behind = self.passing
        dT = enclose(through, Blocks(**both)).plus(enclose(before, Blocks(**odd)), -1.0)
        return dSo.plus(dSe, -1.0), dT.plus(enclose(behind, Blocks(**even)), -1.0)


@dataclass(frozen=True, eq=False)
class Side:
    """(1 + Z)^-1 of even or odd light on both sides of what a change does to modes: to the right from nodes (n, n),
    from beams to themselves (k,) and to the nodes' modes (n, k); to the left onto the nodes (n, n), from these and
    from directions onto directions (q, n), (q, 1)."""

    nodes: Array
    into: Array
    from_in: Array
    left: Array
    out_left: Array
    out: Array

    def enclose(self, middle: Blocks, into: Aside, out: Aside, on_nodes: bool) -> Blocks:
        """dS of a change between modes, what was stepped around put together again."""
        in_ = into.gather(middle.NI * self.into + middle.N @ self.from_in)
        both = into.gather(middle.OI * self.into + middle.ON @ self.from_in)
        corner = out.gather((self.out_left @ in_ + self.out * both).T).T
        if not on_nodes:
            nothing = np.zeros((0, 0))
            return Blocks(nothing, nothing, nothing, corner)
        nodes = middle.N @ self.nodes
        rows = out.gather((self.out_left @ nodes + self.out * (middle.ON @ self.nodes)).T).T
        return Blocks(self.left @ nodes, self.left @ in_, rows, corner)


def deepen_slab(
    E: Blocks, F: Blocks, R: Blocks, T: Blocks, mu_out: Array, decay_in: Array, decay_out: Array
) -> tuple[Blocks, Blocks]:
    """dR and dT with optical thickness, from both; mu_out (o,), and e^(-thickness/mu) of beams (r,) and of directions
    (o,)."""
    b, c = F.plus(E, -1.0).times(0.5), F.plus(E).times(0.5)
    # T behind a beam and on the nodes, what b makes of it, and T of that
    b_in = b.NI * decay_in + b.N @ T.NI
    b_nodes = b.N @ T.N
    decay = decay_out[:, None]
    dR = Blocks(
        T.N @ b_nodes,
        T.N @ b_in,
        T.ON @ b_nodes + decay * (b.ON @ T.N),
        T.ON @ b_in + decay * (b.ON @ T.NI),
    )
    dT = Blocks(
        R.N @ b_nodes - c.N @ T.N,
        R.N @ b_in - c.NI * decay_in - c.N @ T.NI,
        R.ON @ b_nodes - c.ON @ T.N - T.ON / mu_out[:, None],
        R.ON @ b_in - c.ON @ T.NI - T.OI / mu_out[:, None],
    )
    return dR, dT
