"""The oracle: light of any scene in ball arithmetic (python-flint), so that every digit is right.

How to ask: ``brdf(scene, mu_i, mu_o, nodes, orders)`` has what leaves a `vrte.Scene`, as Fourier orders (for light from
below give ``scene.turned()``); ``solve(scene, mu0, mu, levels, nodes, order)`` has the light of one order at levels,
which are pairs (layer, depth below its top): (-1, 0.0) lies above the stack, (0, 0.0) inside the first layer, below an
interface on it, (len(scene.layers), 0.0) right above the base. Cosines are those in the medium at the level, ``mu``
positive upward. A scene has layers, the last of them finite or semi-infinite, smooth interfaces anywhere, and below
them nothing, a `Lambertian` or `Mirror` base, or the lobe of bench/cases.py. ``derivative`` names a number as vrte does
("layer[1].albedo", "layer[2].coefficients[3].b1", "layer[1].thickness", "base.albedo"): every array of the answer is
then the derivative with it. `find_order` and `find_field_order` find a Fourier order of light at equal steps of
azimuth, `literal.azimuthal_sum` sums orders. On 8 nodes an order takes a second or so.

It solves the discrete system that the package solves: double-Gauss nodes, those that Snell's law joins where media
differ; multiple scattering of l < 2 N terms (N terms in several media), a beam's first scattering with all terms; the
flux of order 0 exact on the nodes of each medium. Each part of a stack is a set of operators on directions: nodes,
directions looked along (nodes of weight 0), beams. Shared with the package are the scene and where its nodes lie.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from flint import acb, arb, arb_mat, ctx

import vrte
from bench.cases import LOBE_AMPLITUDE, LOBE_MATRIX, LOBE_WIDTH_DEG, evaluate_mueller_lobe
from vrte.basics.quadrature import Panel, make_refracted_nodes

BITS, BITS_OF_DERIVATIVES, MOST_BITS = 192, 384, 3072
STEP = arb(2) ** -100  # of numbers that derivatives are with, either way: what it leaves out is 1e-60 of a derivative
RIGHT, FAINT = 1e-20, 1e-45  # radius of a ball, relative to the largest value of its array, or to this
# optical thicknesses that stand for infinite: light decays at a rate of 1e-6 or more, or 1/thickness of it is left
SEMI_INFINITE, SEMI_INFINITE_CONSERVATIVE = 2**34, 2**72
FLIP = (1, 1, -1, -1)  # D: Stokes parameters of light that goes up are those of a mirrored frame inside operators
NAMES = ("a1", "a2", "a3", "a4", "b1", "b2")
Level = tuple[int, float]


class DoubtfulError(ArithmeticError):
    """The balls are too wide: the scene has no stable answer."""


def unit(n: int) -> arb_mat:
    """1."""
    return arb_mat([[int(i == j) for j in range(n)] for i in range(n)])


def put(target: arb_mat, row: int, column: int, block: arb_mat) -> None:
    """Writes a block into a matrix."""
    for i in range(block.nrows()):
        for j in range(block.ncols()):
            target[row + i, column + j] = block[i, j]


def find_norm(matrix: arb_mat) -> float:
    """The largest sum of a row's sizes."""
    return max((sum(abs(float(x.mid())) + float(x.rad()) for x in row) for row in matrix.tolist()), default=0.0)


def flip(matrix: arb_mat) -> arb_mat:
    """D times a matrix of four rows."""
    return arb_mat([[FLIP[i] * matrix[i, j] for j in range(matrix.ncols())] for i in range(4)])


def wigner(m: int, k: int, terms: int, mu: arb) -> list[arb]:
    """d^l_{m,k}(mu) for l = 0 .. terms - 1, upward in l; m >= 0, k = 0 or +-2."""
    start = max(m, abs(k))
    values = [arb(0)] * terms
    if start >= terms:
        return values
    scale = arb(math.factorial(2 * start)) / (math.factorial(abs(m - k)) * math.factorial(abs(m + k)))
    roots = [
        base ** (n // 2) * (base.sqrt() if n % 2 else 1) for base, n in ((1 - mu, abs(m - k)), (1 + mu, abs(m + k)))
    ]
    now, before = (1 if k >= m else (-1) ** (m - k)) * scale.sqrt() / 2**start * roots[0] * roots[1], arb(0)
    for l in range(start, terms):
        values[l] = now
        if l == 0:
            after = mu
        else:
            lower = (l + 1) * arb((l * l - m * m) * (l * l - k * k)).sqrt()
            upper = l * arb(((l + 1) ** 2 - m * m) * ((l + 1) ** 2 - k * k)).sqrt()
            after = ((2 * l + 1) * (l * (l + 1) * mu - m * k) * now - lower * before) / upper
        before, now = now, after
    return values


def find_functions(m: int, terms: int, mu: arb) -> list[arb_mat]:
    """P_l^m of a cosine, l = m .. terms - 1. Balls lose up to 1.3 bits a step of the recurrence in l: they begin with
    as many more."""
    with ctx.workprec(ctx.prec + 2 * terms):
        p, plus, minus = (wigner(m, k, terms, mu) for k in (0, 2, -2))
    matrices = []
    for l in range(m, terms):
        r, t = (plus[l] + minus[l]) / 2, (plus[l] - minus[l]) / 2
        matrices.append(arb_mat([[p[l], 0, 0, 0], [0, r, -t, 0], [0, -t, r, 0], [0, 0, 0, p[l]]]))
    return matrices


def reflect_fresnel(mu: arb, index: complex, of: float) -> tuple[arb_mat, arb_mat]:
    """Mueller matrices of what an index sends back and lets through of light along mu in a medium of index ``of``, as
    fractions of power."""
    relative = arb(index.real) / arb(of) if index.imag == 0.0 else acb(index.real, index.imag) / arb(of)
    behind = acb(1 - (1 - mu**2) / relative**2).sqrt()
    s, p = mu + relative * behind, relative * mu + behind
    found = []
    for along, across, power in (
        ((relative * mu - behind) / p, (mu - relative * behind) / s, arb(1)),
        (2 * mu / p, 2 * mu / s, acb(relative).real * behind.real / mu),
    ):
        mixed, a, b = along * across.conjugate(), abs(along) ** 2 / 2, abs(across) ** 2 / 2
        x, y = mixed.real, mixed.imag
        found.append(power * arb_mat([[a + b, a - b, 0, 0], [a - b, a + b, 0, 0], [0, 0, x, y], [0, 0, -y, x]]))
    return found[0], found[1]


def find_lobe_order(m: int, mu_i: arb, mu_o: arb) -> arb_mat:
    """Of `evaluate_mueller_lobe`, amplitude exp(-(1 - c)/width^2) M: 2 pi e^-x I_m(x) M."""
    kappa = 1 / arb(math.radians(LOBE_WIDTH_DEG)) ** 2
    x = kappa * ((1 - mu_i**2) * (1 - mu_o**2)).sqrt()
    size = (x + kappa * (mu_i * mu_o - 1)).exp() * x.bessel_i(m, scaled=True)  # the scaled function carries e^-x
    return 2 * arb.pi() * LOBE_AMPLITUDE * size * arb_mat([[arb(value) for value in row] for row in LOBE_MATRIX])


@dataclass(frozen=True, eq=False)
class Medium:
    """Directions in a medium: cosines (None: it has no such direction), weights in mu (0 of those looked along, 1 of
    beams), and which of them are nodes, looked along, beams."""

    mu: list[arb]
    weights: list[arb]
    nodes: list[int]
    seen: list[int]
    beams: list[int]


@dataclass(frozen=True, eq=False)
class Order:
    """One Fourier order of a scene on nodes, directions looked along (index of the medium, cosine there) and beams: the
    operators of its parts, (4 direction, 4 direction) each, act on radiance, and on flux across of beams. The number of
    the scene that is called ``moved`` is larger by ``step``."""

    scene: vrte.Scene
    mu0: tuple[float, ...]
    seen: tuple[tuple[float, float], ...]
    count: int
    m: int
    moved: str | None = None
    step: arb = field(default_factory=arb)
    known: dict[Any, Any] = field(default_factory=dict)

    @cached_property
    def nodes(self) -> list[tuple[float, arb, arb]]:
        """Of each node the index b that bounds it, b^2 - s^2, and its weight in s ds, s = n sin(theta), as
        `make_refracted_nodes` has them."""
        found, media = [], self.scene.media
        gauss = ((0, self.count, Panel(0.0, media[0], math.inf)),)
        for first, last, panel in (
            make_refracted_nodes(media, self.count, layers=self.scene.indices).panels if len({*media}) > 1 else gauss
        ):
            size, most = arb(panel.high) ** 2 - arb(panel.low) ** 2, arb.pi() / 2 if panel.low else arb(1)
            for k in range(last - first):
                x, weight = arb.legendre_p_root(last - first, k, weight=True)
                x, rate = (x + 1) / 2, weight / 2
                if math.isfinite(panel.above):
                    near = ((arb(panel.above) ** 2 - arb(panel.high) ** 2) / size).sqrt() / most
                    steep = (1 / near).asinh()
                    x, rate = near * (steep * x).sinh(), rate * near * steep * (steep * x).cosh()
                sine, slope = ((most * x).sin(), most * (most * x).cos()) if panel.low else (x, arb(1))
                found.append((panel.high, size * sine**2, size * sine * slope * rate))
        return found

    @property
    def size(self) -> int:
        return len(self.nodes) + len(self.seen) + len(self.mu0)

    def find_medium(self, index: float) -> Medium:
        """The directions in a medium of that index."""
        if index not in self.known:
            n, mu, weights = arb(index), [], []
            for b, depth, measure in self.nodes:
                mu.append((n**2 - arb(b) ** 2 + depth).sqrt() / n if b <= index else None)
                weights.append(measure / (n**2 * mu[-1]) if b <= index else arb(0))
            for start, cosine in (*self.seen, *((self.scene.index_above, mu0) for mu0 in self.mu0)):
                squared = (n**2 - arb(start) ** 2 + (arb(start) * arb(cosine)) ** 2) / n**2
                unchanged = start == index or cosine == 1.0
                mu.append(arb(cosine) if unchanged else squared.sqrt() if squared > 0 else None)
                weights.append(arb(0 if len(mu) <= self.size - len(self.mu0) else 1))
            bounds = 0, len(self.nodes), len(self.nodes) + len(self.seen), self.size
            kinds = ([i for i in range(*pair) if mu[i] is not None] for pair in itertools.pairwise(bounds))
            self.known[index] = Medium(mu, weights, *kinds)
        return self.known[index]

    def assemble(self, blocks: dict[tuple[int, int], arb_mat]) -> arb_mat:
        """The operator of 4x4 blocks of pairs of directions, to and from."""
        found = arb_mat(4 * self.size, 4 * self.size)
        for (i, j), block in blocks.items():
            put(found, 4 * i, 4 * j, block)
        return found

    def find_number(self, name: str, value: float) -> arb:
        """A number of the scene, by its name."""
        return arb(value) + self.step if name == self.moved else arb(value)

    def find_name(self, k: int, name: str = "") -> str:
        """The name of a number of layer k, or how all of them begin."""
        index = self.scene.places[k]
        return "nothing" if index is None else f"layer[{index + 1}].{name}"

    def find_functions(self, medium: Medium, terms: int) -> dict[int, list[arb_mat]]:
        """P_l^m of each direction for multiple scattering: on nodes of several media the intensity's p_l of order 0
        have the means right that Gauss's have, by a factor or a difference."""
        found = {i: find_functions(self.m, terms, medium.mu[i]) for i in (*medium.nodes, *medium.seen, *medium.beams)}
        if self.m > 0 or len({*self.scene.media}) == 1:
            return found
        total = sum((medium.weights[i] for i in medium.nodes), arb(0))
        means = [sum((medium.weights[i] * found[i][l][0, 0] for i in medium.nodes), arb(0)) for l in range(terms)]
        for functions in found.values():
            functions[0][0, 0] /= total.sqrt()
            for l in range(2, terms, 2):
                functions[l][0, 0] -= means[l] / total
        return found

    def expand(self, k: int, l: int) -> arb_mat:
        """B_l of layer k, (1:9)."""
        row = zip(NAMES, self.scene.layers[k].phase_matrix.coefficients[l].tolist(), strict=True)
        numbers = (self.find_number(self.find_name(k, f"coefficients[{l}].{name}"), value) for name, value in row)
        a1, a2, a3, a4, b1, b2 = numbers
        return arb_mat([[a1, -b1, 0, 0], [-b1, a2, 0, 0], [0, 0, a3, -b2], [0, 0, b2, a4]])

    def scatter(self, k: int) -> list[arb_mat]:
        """A^m(mu, mu') and A^m(mu, -mu') D, (1:9), times weights of mu', over mu."""
        medium, terms = self.find_medium(self.scene.indices[k]), self.scene.layers[k].phase_matrix.terms
        many = min(terms, self.count if len({*self.scene.media}) > 1 else 2 * self.count)
        once = {i: find_functions(self.m, terms, medium.mu[i]) for i in (*medium.seen, *medium.beams)}
        parts = (
            ((*medium.nodes, *medium.seen), (*medium.nodes, *medium.beams), self.find_functions(medium, many)),
            (medium.seen, medium.beams, once),  # a beam's first scattering has all terms
        )
        found = []
        for sign in (1, -1):
            blocks: dict[tuple[int, int], arb_mat] = {}
            for to, of, functions in parts:
                degrees = len(functions[to[0]]) if to else 0
                left, right = arb_mat(4 * len(to), 4 * degrees), arb_mat(4 * degrees, 4 * len(of))
                for b, l in itertools.product(range(len(of)), range(degrees)):
                    p = functions[of[b]][l]  # P_l^m(-u) = (-1)^(l - m) D P_l^m(u) D
                    put(right, 4 * l, 4 * b, p if sign > 0 else (-1) ** l * flip(p))
                for l in range(degrees):
                    middle = self.expand(k, self.m + l)
                    for a in range(len(to)):
                        put(left, 4 * a, 4 * l, functions[to[a]][l] * middle)
                product = left * right
                for (a, i), (b, j) in itertools.product(enumerate(to), enumerate(of)):
                    block = arb_mat([[product[4 * a + s, 4 * b + t] for t in range(4)] for s in range(4)])
                    blocks[i, j] = medium.weights[j] / medium.mu[i] * block
            found.append(self.assemble(blocks))
        return found

    def generate(self, k: int) -> tuple[arb_mat, arb_mat]:
        """E, F = alpha +- beta of I+' = alpha I+ + beta I~, I~' = -beta I+ - alpha I~ in a layer."""
        half = self.find_number(self.find_name(k, "albedo"), self.scene.layers[k].albedo) / 2
        same, other = (half * part for part in self.scatter(k))
        mu = self.find_medium(self.scene.indices[k]).mu
        rates = self.assemble({(i, i): 1 / mu[i] * unit(4) for i in range(self.size) if mu[i] is not None})
        return same + other - rates, same - other - rates

    def find_slab(self, k: int, thickness: arb) -> list[arb_mat]:
        """R, T, R, T of a homogeneous slab: a power series, then doublings. Equal ones are worked out once."""
        layer, is_moved = self.scene.layers[k], (self.moved or "").startswith(self.find_name(k))
        kind = ("layer", k) if is_moved else (layer.phase_matrix, layer.albedo, self.scene.indices[k])
        key = kind, thickness.str(90)
        if key in self.known:
            return self.known[key]
        if kind not in self.known:
            self.known[kind] = self.generate(k)
        e, f = self.known[kind]
        steepest = math.sqrt(find_norm(e) * find_norm(f))
        doublings = max(0, math.ceil(math.log2(2.0 * float(thickness.mid()) * steepest)))
        h = thickness / arb(2) ** (doublings + 1)
        even, odd = find_response(e, f, h), find_response(f, e, h)
        R, T = (even - odd) / 2, (even + odd) / 2
        for _ in range(doublings):
            inner = (unit(4 * self.size) - R * R).solve(T)
            R, T = R + T * (R * inner), T * inner
        self.known[key] = [R, T, R, T]
        return self.known[key]

    def find_interface(self, above: float, below: float) -> list[arb_mat]:
        """R and T from above, R and T from below, of a smooth interface."""
        found, first_beam = [], self.size - len(self.mu0)
        for n, behind in ((above, below), (below, above)):
            back, through = {}, {}
            for i, (mu, there) in enumerate(zip(self.find_medium(n).mu, self.find_medium(behind).mu, strict=True)):
                if mu is not None:
                    reflected, sent_on = reflect_fresnel(mu, behind, n)
                    back[i, i] = flip(reflected)
                    if there is not None:  # n^-2 radiance stays
                        through[i, i] = (mu / there if i >= first_beam else (arb(behind) / arb(n)) ** 2) * sent_on
            found += [self.assemble(back), self.assemble(through)]
        return found

    def find_base(self) -> arb_mat:
        """R of what lies below, of light that falls on it."""
        base, n, medium = self.scene.base, self.scene.index_below, self.find_medium(self.scene.index_below)
        blocks: dict[tuple[int, int], arb_mat] = {}
        if base is None or math.isinf(self.scene.thickness):
            return self.assemble({})
        if isinstance(base, vrte.Mirror):
            for i in (*medium.nodes, *medium.seen, *medium.beams):
                blocks[i, i] = flip(reflect_fresnel(medium.mu[i], base.index, n)[0])
            return self.assemble(blocks)
        is_lobe = getattr(base, "function", None) is evaluate_mueller_lobe
        assert is_lobe or isinstance(base, vrte.Lambertian)
        white, alone = sum((2 * medium.weights[i] * medium.mu[i] for i in medium.nodes), arb(0)), arb_mat(4, 4)
        alone[0, 0] = 2 if self.m == 0 else 0
        for i, j in itertools.product((*medium.nodes, *medium.seen), (*medium.nodes, *medium.beams)):
            block = flip(find_lobe_order(self.m, medium.mu[j], medium.mu[i])) if is_lobe else alone
            by_nodes = not is_lobe and (i in medium.nodes or j in medium.nodes)  # white sends all back on nodes, too
            blocks[i, j] = medium.weights[j] * medium.mu[j] / (white if by_nodes else 1) * block
        found = self.assemble(blocks)
        return found if is_lobe else self.find_number("base.albedo", base.albedo) * found

    def list_parts(self, levels: Sequence[Level]) -> tuple[list[list[arb_mat]], dict[Level, int]]:
        """R, T, R, T of all that light meets above the base, top first, and between which of them each level is."""
        scene, parts, index = self.scene, [], {(-1, 0.0): 0}
        for k, layer in enumerate(scene.layers):
            if scene.interfaces[k] is not None:
                parts.append(self.find_interface(*scene.media[k : k + 2]))
            most = SEMI_INFINITE_CONSERVATIVE if layer.albedo == 1.0 and self.m == 0 else SEMI_INFINITE
            end, depth = self.find_number(self.find_name(k, "thickness"), min(layer.thickness, most)), arb(0)
            for level in (*sorted({d for at, d in levels if at == k}), None):
                below = end if level in (None, layer.thickness) else arb(level)
                if below - depth > 0:
                    parts.append(self.find_slab(k, below - depth))
                depth, index[k, level] = below, len(parts)
        if scene.interfaces[-1] is not None:
            parts.append(self.find_interface(*scene.media[-2:]))
        return parts, index | {(len(scene.layers), 0.0): len(parts)}

    def find_fields(self, levels: Sequence[Level]) -> list[tuple[arb_mat, arb_mat]]:
        """Light of all beams down and up at each level, (4 direction, 4 beam)."""
        parts, index = self.list_parts(levels)
        reflected, passing = [self.find_base()], []
        for Ra, Ta, Rb, Tb in reversed(parts):
            passing.append((unit(4 * self.size) - Rb * reflected[-1]).solve(Ta))
            reflected.append(Ra + Tb * (reflected[-1] * passing[-1]))
        beams = arb_mat(4 * self.size, 4 * len(self.mu0))
        put(beams, 4 * (self.size - len(self.mu0)), 0, unit(4 * len(self.mu0)))
        down = [beams]
        for through in reversed(passing):
            down.append(through * down[-1])
        fields = [(light, back * light) for light, back in zip(down, reversed(reflected), strict=True)]
        return [fields[index[level]] for level in levels]


def find_response(e: arb_mat, f: arb_mat, h: arb) -> arb_mat:
    """From light into a slab of thickness 2 h, the same from both sides, to light out of it: (C + h E S) (C - h E S)^-1
    with C = cosh(h sqrt(F E)) and S = sinh(h sqrt(F E))/(h sqrt(F E)). With E and F swapped, the negative of opposite
    light from both sides."""
    z, terms = h * h * (f * e), 4
    size, powers = find_norm(z), [unit(z.nrows()), z, z * z, z * (z * z)]
    while size**terms / math.factorial(2 * terms) > 2.0 ** -(ctx.prec + 8):
        terms += 4
    assert size < 0.5
    blur = arb_mat([[arb(0, arb(2) ** -ctx.prec)] * z.ncols()] * z.nrows())  # what lies beyond the last term
    whole, found = powers[2] * powers[2], []
    for odd in (0, 1):
        total = 0 * z
        for first in range(terms - 4, -1, -4):
            parts = (1 / arb(math.factorial(2 * (first + j) + odd)) * power for j, power in enumerate(powers))
            total = sum(parts, total * whole)
        found.append(total + blur)
    C, S = found
    s = h * (e * S)
    return (C - s).transpose().solve((C + s).transpose()).transpose()


@dataclass(frozen=True, eq=False)
class Light:
    """One Fourier order of what beams of unit flux across become, by Mueller matrices in the public frame.

    radiance (level, beam, mu, 4, 4), diffuse [1/sr]; beams_down and beams_up (level, beam, 4, 4), unscattered, per
    area across; cosines (level, beam), of beams there, 0 for none; flux_down and flux_up (level, beam, 4), diffuse
    through a horizontal plane, in order 0.
    """

    radiance: np.ndarray
    beams_down: np.ndarray
    beams_up: np.ndarray
    cosines: np.ndarray
    flux_down: np.ndarray
    flux_up: np.ndarray


def solve(
    scene: vrte.Scene,
    mu0: Sequence[float],
    mu: Sequence[float],
    levels: Sequence[Level],
    nodes: int,
    order: int = 0,
    derivative: str | None = None,
) -> Light:
    """The light of one Fourier order at some levels, with as many bits as it takes. Raises DoubtfulError where no
    number of bits is enough."""
    media = [scene.media[at + 1] for at, _ in levels]
    seen = tuple(dict.fromkeys((n, abs(float(u))) for n in media for u in mu))
    bits = BITS if derivative is None else BITS_OF_DERIVATIVES
    while True:
        try:
            with ctx.workprec(bits):
                asked = Order(scene, tuple(map(float, mu0)), seen, nodes, order)
                if derivative is None:
                    return collect(asked, mu, media, asked.find_fields(levels))
                ahead, behind = (
                    replace(asked, moved=derivative, step=step, known={}).find_fields(levels) for step in (STEP, -STEP)
                )
                pairs = (zip(*each, strict=True) for each in zip(ahead, behind, strict=True))
                slopes = [tuple((more - less) / (2 * STEP) for more, less in pair) for pair in pairs]
                return collect(asked, mu, media, slopes)
        except (DoubtfulError, ZeroDivisionError):
            if bits >= MOST_BITS:
                raise DoubtfulError("even wide balls leave the answer open") from None
        bits *= 2


def collect(asked: Order, mu: Sequence[float], media: Sequence[float], fields: Sequence[Any]) -> Light:
    """Radiance, beams and fluxes of the fields at levels that lie in these media."""
    count, indices = len(asked.mu0), range(len(asked.mu0))
    radiance, beams, fluxes, cosines = [], [], [], []
    for n, both in zip(media, fields, strict=True):
        medium = asked.find_medium(n)
        blocks = (np.array(one.tolist(), dtype=object).reshape(asked.size, 4, count, 4) for one in both)
        down, up = (block.swapaxes(1, 2) for block in blocks)  # (direction, beam, 4, 4)
        up = up * np.array(FLIP)[:, None]
        rows = [len(asked.nodes) + asked.seen.index((n, abs(float(u)))) for u in mu]
        radiance.append([[(up if u > 0 else down)[i, b] for i, u in zip(rows, mu, strict=True)] for b in indices])
        beams.append([[light[b - count, b] for b in indices] for light in (down, up)])
        through = [(i, medium.weights[i] * medium.mu[i]) for i in medium.nodes] if asked.m == 0 else []
        fluxes.append([sum((w * light[i, :, 0] for i, w in through), 0 * light[0, :, 0]) for light in (down, up)])
        cosines.append([float(x.mid()) if (x := medium.mu[b - count]) is not None else 0.0 for b in indices])
    seen = find_centres(radiance).reshape(len(media), count, len(mu), 4, 4) / (2 * math.pi)
    straight, passing = (np.moveaxis(find_centres(each), 1, 0) for each in (beams, fluxes))
    return Light(seen, *straight, np.array(cosines), *passing)


def find_centres(balls: list[Any]) -> np.ndarray:
    """The centres of nested lists of balls as doubles. Raises DoubtfulError where one is too wide."""
    flat = np.array(balls, dtype=object)
    values = np.array([float(ball.mid()) for ball in flat.ravel()]).reshape(flat.shape)
    widest = max((float(ball.rad()) for ball in flat.ravel()), default=0.0)
    if not widest <= RIGHT * max(np.abs(values).max(initial=0.0), FAINT):
        raise DoubtfulError(f"a ball of radius {widest:.1g} beside values up to {np.abs(values).max():.1g}")
    return values


@dataclass(frozen=True, eq=False)
class Answer:
    """What leaves a scene: BRDF and BTDF (order, in, out, 4, 4) [1/sr], of beams the fractions sent on as beams (in, 4,
    4), of unpolarized light the fractions that come out diffuse above and below (in,)."""

    reflected: np.ndarray
    transmitted: np.ndarray
    specular: np.ndarray
    specular_transmission: np.ndarray
    reflectance: np.ndarray
    transmittance: np.ndarray


def brdf(
    scene: vrte.Scene,
    mu_i: Sequence[float],
    mu_o: Sequence[float],
    nodes: int,
    orders: Iterable[int],
    derivative: str | None = None,
    least: float = 0.0,
) -> Answer:
    """All that leaves a scene, in the Fourier orders asked for, up to one that is less than ``least`` of the largest;
    mu_o in the medium above of what is reflected, below of what is transmitted."""
    mu = np.array([*mu_o, *(-np.array(mu_o))])
    levels: list[Level] = [(-1, 0.0), *([(len(scene.layers), 0.0)] if math.isfinite(scene.thickness) else [])]
    found: list[Light] = []
    for m in orders:
        found.append(solve(scene, mu_i, mu, levels, nodes, m, derivative))
        if np.abs(found[-1].radiance).max(initial=0.0) < least * np.abs(found[0].radiance).max(initial=0.0):
            break
    per_area = np.array(mu_i)[:, None, None, None]
    top, bottom = found[0], len(levels) - 1
    light = np.array([each.radiance for each in found])  # (order, level, in, mu, 4, 4)
    through = 1.0 if bottom else 0.0
    inside = top.cosines[bottom] / mu_i * through
    return Answer(
        light[:, 0, :, : len(mu_o)] / per_area,
        light[:, bottom, :, len(mu_o) :] / per_area * through,
        top.beams_up[0],
        top.beams_down[bottom] * inside[:, None, None],
        top.flux_up[0, :, 0] / mu_i,
        top.flux_down[bottom, :, 0] / mu_i * through,
    )


def find_order(f: np.ndarray, m: int) -> np.ndarray:
    """Order m of Mueller matrices sampled at equal steps of azimuth, (..., phi, 4, 4): (..., 4, 4)."""
    count = f.shape[-3]
    phi = np.arange(count) * (2 * math.pi / count)
    cosine, sine = (np.einsum("p,...pab->...ab", w(m * phi) / count, f) for w in (np.cos, np.sin))
    cosine[..., 2:, :2], cosine[..., :2, 2:] = sine[..., 2:, :2], -sine[..., :2, 2:]
    return cosine


def split_beam(matrices: np.ndarray, stokes: Sequence[float]) -> np.ndarray:
    """What (I, Q) and (U, V) of an incident beam make of Mueller matrices (..., 4, 4) each: (2, ..., 4)."""
    parts = np.array([[*stokes[:2], 0.0, 0.0], [0.0, 0.0, *stokes[2:]]])
    return np.moveaxis(matrices @ parts.T, -1, 0)


def find_field_order(stokes: np.ndarray, m: int) -> np.ndarray:
    """Order m of light at equal steps of azimuth, (..., phi, 4), as `split_beam` has it: told apart by parity."""
    phi = np.arange(stokes.shape[-2]) * (2 * math.pi / stokes.shape[-2])
    even, odd = (np.einsum("p,...ps->...s", w(m * phi) / phi.size, stokes) for w in (np.cos, np.sin))
    first = np.concatenate([even[..., :2], odd[..., 2:]], axis=-1)
    return np.stack([first, np.concatenate([-odd[..., :2], even[..., 2:]], axis=-1)])
