"""An oracle nobody can argue with: the field of any scene in ball arithmetic (python-flint).

Layers over a base, at any depth, one Fourier order, of the discrete system that the package solves: double-Gauss nodes,
multiple scattering with l < 2 N terms, a beam's scattering straight into a direction off the nodes with all terms.
Directions off the nodes are nodes of weight zero; slabs join by the star product. Every number is a ball that contains
the true value, so its digits are right, whatever the thickness and the albedo.

Under a smooth surface, in a medium denser than that above, mu0 is a cosine above it; levels and mu are inside, or, with
the level (-1, 0.0) alone, above too. Nodes are those that both media share, and carry l < N terms; what they
miss of the flux is put right as the package does (tests/oracle.py).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import acb, arb, arb_mat, ctx, fmpq

from vrte.basics.quadrature import make_refracted_nodes

Lobe = Callable[[int, arb, arb], arb_mat]
BITS, BITS_CONSERVATIVE = 256, 448
# thicknesses that stand for infinite: light dies out at a rate of 1e-6 or more, or 1/thickness of it gets through
ENDLESS, ENDLESS_CONSERVATIVE = 2**34, 2**72
COLUMNS = ((1.0, 0.3, 0.0, 0.0), (0.0, 0.0, 0.2, 0.1))  # incident Stokes vectors [W m-2]
FLIP = (1, 1, -1, -1)


def exact(value: float | arb) -> arb:
    """The double itself, not a rounding of it; a ball as it is."""
    if isinstance(value, arb):
        return value
    numerator, denominator = float(value).as_integer_ratio()
    return arb(fmpq(numerator, denominator))


def wigner(m: int, k: int, terms: int, mu: arb) -> list[arb]:
    """d^l_{m,k}(mu) for l = 0 .. terms - 1, upward in l; m >= 0, k = 0 or +-2."""
    start = max(m, abs(k))
    values = [arb(0)] * terms
    if start >= terms:
        return values
    sign = 1 if k >= m else (-1) ** (m - k)
    scale = arb(math.factorial(2 * start)) / (math.factorial(abs(m - k)) * math.factorial(abs(m + k)))
    now = sign * scale.sqrt() / 2**start * power(1 - mu, abs(m - k)) * power(1 + mu, abs(m + k))
    before = arb(0)
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


def power(base: arb, twice: int) -> arb:
    """base^(twice/2); base >= 0."""
    whole = base ** (twice // 2)
    return whole * base.sqrt() if twice % 2 else whole


def legendre_matrices(m: int, terms: int, mu: arb) -> list[arb_mat]:
    """P_l^m, l = 0 .. terms - 1."""
    p, plus, minus = (wigner(m, k, terms, mu) for k in (0, 2, -2))
    matrices = []
    for l in range(terms):
        r, t = (plus[l] + minus[l]) / 2, (plus[l] - minus[l]) / 2
        matrices.append(arb_mat([[p[l], 0, 0, 0], [0, r, -t, 0], [0, -t, r, 0], [0, 0, 0, p[l]]]))
    return matrices


def coefficient_matrix(row: Sequence[float]) -> arb_mat:
    """B_l of (1:9)."""
    a1, a2, a3, a4, b1, b2 = (exact(value) for value in row)
    return arb_mat([[a1, -b1, 0, 0], [-b1, a2, 0, 0], [0, 0, a3, -b2], [0, 0, b2, a4]])


@dataclass(frozen=True, eq=False)
class Layer:
    """Expansion coefficients (terms, 6), albedo, optical thickness: doubles, or balls (tests/derivative_oracle.py)."""

    coefficients: np.ndarray
    albedo: float
    thickness: float


@dataclass(frozen=True, eq=False)
class Request:
    """One order of the field of some beams: signed cosines mu, depths as (layer, depth below its top); ``columns``: the
    Stokes vectors of each beam."""

    order: int
    layers: tuple[Layer, ...]
    base: float | Lobe | None
    mu0: tuple[float, ...]
    mu: tuple[float, ...]
    levels: tuple[tuple[int, float], ...]
    nodes: int
    columns: tuple[tuple[float, ...], ...] = COLUMNS
    index: float = 1.0

    @property
    def incident(self) -> arb_mat:
        """The columns of a beam, (4, n_column)."""
        return arb_mat([[exact(column[i]) for column in self.columns] for i in range(4)])

    @property
    def is_refracted(self) -> bool:
        """Whether the layers lie under a surface, light above it in a medium of index 1."""
        return self.index != 1.0

    @property
    def is_seen_above(self) -> bool:
        """Whether the wanted directions are above the surface: all levels are, or none."""
        above = {at < 0 for at, _ in self.levels}
        assert len(above) == 1
        return above == {True}


@dataclass(frozen=True, eq=False)
class Answer:
    """radiance (n_column, n_tau, n_mu, 4), diffuse, the columns of one beam after those of another; flux_up, flux_down
    (n_column, n_tau), in order 0."""

    radiance: np.ndarray
    flux_up: np.ndarray
    flux_down: np.ndarray


class Directions:
    """Nodes, then the distinct cosines of `mu` as nodes of weight zero, then the beams' columns."""

    def __init__(self, request: Request) -> None:
        nodes = refracted_nodes(request) if request.is_refracted else gauss(request.nodes)
        self.nodes = request.nodes
        self.out = sorted({abs(u) for u in request.mu})
        self.weight = [w for _, w in nodes]
        self.mu0, seen = [exact(u) for u in request.mu0], [exact(u) for u in self.out]
        self.incident = [request.incident] * len(self.mu0)
        if request.is_refracted:
            index, outside = exact(request.index), self.mu0
            self.mu0 = [refracted(u, index) for u in outside]
            self.incident = [
                transmission(u, index) * request.incident * (u / mu) for u, mu in zip(outside, self.mu0, strict=True)
            ]
            seen = [refracted(u, index) for u in seen] if request.is_seen_above else seen
        self.mu = [x for x, _ in nodes] + seen
        self.columns = len(request.columns)
        self.field = 4 * len(self.mu)
        self.size = self.field + self.columns * len(self.mu0)

    def rate(self, row: int) -> arb:
        """1/mu of a row of the operators."""
        return 1 / (self.mu[row // 4] if row < self.field else self.mu0[(row - self.field) // self.columns])


def gauss(count: int) -> list[tuple[arb, arb]]:
    """Nodes in (0, 1) and weights."""
    roots = (arb.legendre_p_root(count, k, weight=True) for k in range(count))
    return [((x + 1) / 2, w / 2) for x, w in roots]


def refracted_nodes(request: Request) -> list[tuple[arb, arb]]:
    """Nodes that the layers' medium shares with that above it: the formulas of `make_refracted_nodes`, for that medium,
    the denser one."""
    assert request.index > 1.0
    index, found = exact(request.index), []
    for first, last, panel in make_refracted_nodes([1.0, request.index], request.nodes).panels:
        low, high = panel.low, panel.high
        size, most = exact(high) ** 2 - exact(low) ** 2, arb(1) if low == 0.0 else arb.pi() / 2
        for x, w in gauss(last - first):
            if high < request.index:
                near = ((index**2 - exact(high) ** 2) / size).sqrt()
                steep = (most / near).asinh()
                x, w = near / most * (steep * x).sinh(), near / most * steep * w * (steep * x).cosh()
            turn = most * x
            root, share = (x, w * x) if low == 0.0 else (turn.sin(), most * w * turn.sin() * turn.cos())
            mu = (index**2 - exact(high) ** 2 + size * root**2).sqrt() / index
            found.append((mu, size * share / (index**2 * mu)))
    return found


def refracted(mu: arb, index: arb) -> arb:
    """Snell: the cosine in a medium of that index of light along mu in one of index 1."""
    return (index**2 - 1 + mu**2).sqrt() / index


def amplitudes(mu: arb, relative: arb) -> tuple[tuple[acb, acb], tuple[acb, acb], arb]:
    """Fresnel's r_p, r_s and t_p, t_s, and how much power t^2 stands for."""
    behind = acb(1 - (1 - mu**2) / relative**2).sqrt()
    s, p = mu + relative * behind, relative * mu + behind
    reflected = (relative * mu - behind) / p, (mu - relative * behind) / s
    return reflected, (2 * mu / p, 2 * mu / s), relative * behind.real / mu


def mueller(p: acb, s: acb) -> arb_mat:
    """What amplitudes along p and s do to (I, Q, U, V)."""
    across, along, mixed = abs(s) ** 2, abs(p) ** 2, p * s.conjugate()
    a, b, x, y = (along + across) / 2, (along - across) / 2, mixed.real, mixed.imag
    return arb_mat([[a, b, 0, 0], [b, a, 0, 0], [0, 0, x, y], [0, 0, -y, x]])


def transmission(mu: arb, relative: arb) -> arb_mat:
    """Of power, into a medium of that index relative to the one where light goes along mu."""
    _, through, power = amplitudes(mu, relative)
    return power * mueller(*through)


def surface_operator(directions: Directions, index: arb) -> arb_mat:
    """What the surface gives back of light from within, flipped frame; no beam comes up."""
    found = arb_mat(directions.size, directions.size)
    for i, mu in enumerate(directions.mu):
        put(found, 4 * i, 4 * i, flipped(mueller(*amplitudes(mu, 1 / index)[0])))
    return found


def flux_shifts(request: Request, directions: Directions, terms: int) -> list[tuple[arb, arb]]:
    """The intensity's p_l are times and less these, in order 0 under a surface: the nodes then have the mean right."""
    shifts = [(arb(1), arb(0))] * terms
    if request.order == 0 and request.is_refracted:
        total = sum(directions.weight, arb(0))
        functions = [wigner(0, 0, terms, mu) for mu in directions.mu[: directions.nodes]]
        shifts[0] = (1 / total.sqrt(), arb(0))
        for l in range(2, terms, 2):
            mean = sum((w * p[l] for w, p in zip(directions.weight, functions, strict=True)), arb(0))
            shifts[l] = (arb(1), mean / total)
    return shifts


def scattering(
    request: Request,
    layer: Layer,
    to: list[arb],
    sources: list[tuple[arb, arb_mat]],
    shifts: list[tuple[arb, arb]],
) -> list[arb_mat]:
    """omega/2 Pp and omega/2 Pm from (cosine, factor) sources to cosines: (4 n_to, columns of all factors) each.

    Pm = A(mu, -mu') D, with P_l^m(-u) = (-1)^(l-m) D P_l^m(u) D. As many terms as ``shifts`` of the intensity's p_l.
    """
    m, half = request.order, exact(layer.albedo) / 2
    degrees = range(m, min(len(shifts), len(layer.coefficients)))
    widths = [factor.ncols() for _, factor in sources]
    left = arb_mat(4 * len(to), 4 * len(degrees))
    same, other = (arb_mat(4 * len(degrees), sum(widths)) for _ in range(2))
    if not degrees:
        return [left * same, left * other]
    middle = [half * coefficient_matrix(layer.coefficients[l]) for l in degrees]
    for i, mu in enumerate(to):
        for k, matrix in enumerate(sharp_legendre_matrices(m, degrees.stop, mu, shifts)):
            put(left, 4 * i, 4 * k, matrix * middle[k])
    for j, (mu, factor) in enumerate(sources):
        for k, matrix in enumerate(sharp_legendre_matrices(m, degrees.stop, mu, shifts)):
            put(same, 4 * k, sum(widths[:j]), matrix * factor)
            put(other, 4 * k, sum(widths[:j]), (-1) ** k * flipped(matrix) * factor)
    return [left * same, left * other]


def sharp_legendre_matrices(m: int, terms: int, mu: arb, shifts: list[tuple[arb, arb]]) -> list[arb_mat]:
    """P_l^m, l = m .. terms - 1: balls lose up to 1.3 bits a step of the recurrence in l."""
    bits = ctx.prec
    ctx.prec = bits + 2 * terms
    try:
        matrices = legendre_matrices(m, terms, mu)[m:]
    finally:
        ctx.prec = bits
    for matrix, (scale, less) in zip(matrices, shifts[m:], strict=False):
        matrix[0, 0] = scale * matrix[0, 0] - less
    return matrices


def flipped(matrix: arb_mat) -> arb_mat:
    """D matrix."""
    return arb_mat([[FLIP[i] * matrix[i, j] for j in range(matrix.ncols())] for i in range(4)])


def put(target: arb_mat, row: int, column: int, block: arb_mat) -> None:
    """Writes a block into a matrix."""
    for i in range(block.nrows()):
        for j in range(block.ncols()):
            target[row + i, column + j] = block[i, j]


def generator(directions: Directions, request: Request, layer: Layer) -> tuple[arb_mat, arb_mat]:
    """a, b of I+' = a I+ + b I~, I~' = -b I+ - a I~ on nodes, outgoing directions and beam."""
    n, on_nodes, carried = directions.size, 4 * directions.nodes, request.nodes * (1 if request.is_refracted else 2)
    shifts, all_terms = flux_shifts(request, directions, carried), [(arb(1), arb(0))] * len(layer.coefficients)
    nodes = [(mu, weight * identity(4)) for mu, weight in zip(directions.mu, directions.weight, strict=False)]
    beam = list(zip(directions.mu0, directions.incident, strict=True))
    among = scattering(request, layer, directions.mu, nodes, shifts)
    onto = scattering(request, layer, directions.mu[: directions.nodes], beam, shifts)
    once = scattering(request, layer, directions.mu[directions.nodes :], beam, all_terms)
    result = []
    for many, first, straight in zip(among, onto, once, strict=True):
        matrix = arb_mat(n, n)
        put(matrix, 0, 0, many)
        put(matrix, 0, directions.field, first)
        put(matrix, on_nodes, directions.field, straight)
        result.append(arb_mat([[directions.rate(i) * matrix[i, j] for j in range(n)] for i in range(n)]))
    a, b = result
    for i in range(n):
        a[i, i] -= directions.rate(i)
    return a, b


def homogeneous(directions: Directions, a: arb_mat, b: arb_mat, thickness: arb) -> tuple[arb_mat, arb_mat]:
    """R and T of a slab: a matrix exponential, then doublings."""
    n = directions.size
    steepest = max(sum(abs(float(a[i, j].mid())) + abs(float(b[i, j].mid())) for j in range(n)) for i in range(n))
    doublings = max(0, math.ceil(math.log2(max(float(thickness) * steepest, 1e-300))))
    h = thickness / 2**doublings
    whole = arb_mat(2 * n, 2 * n)
    for i in range(n):
        for j in range(n):
            whole[i, j], whole[i, n + j] = h * a[i, j], h * b[i, j]
            whole[n + i, j], whole[n + i, n + j] = -h * b[i, j], -h * a[i, j]
    start = whole.exp()
    R = -1 * part(start, n, n).solve(part(start, n, 0))
    T = part(start, 0, 0) + part(start, 0, n) * R
    for _ in range(doublings):
        inner = (identity(n) - R * R).solve(T)
        R, T = R + T * (R * inner), T * inner
    return R, T


def part(matrix: arb_mat, top: int, side: int) -> arb_mat:
    """One quarter."""
    n = matrix.nrows() // 2
    return arb_mat([[matrix[top + i, side + j] for j in range(n)] for i in range(n)])


def identity(n: int) -> arb_mat:
    """1."""
    return arb_mat([[int(i == j) for j in range(n)] for i in range(n)])


Quartet = tuple[arb_mat, arb_mat, arb_mat, arb_mat]


def star(upper: Quartet, lower: Quartet) -> Quartet:
    """R and T from above, R and T from below, of two parts joined."""
    Ra, Ta, Rb, Tb = upper
    Sa, Ua, Sb, Ub = lower
    one = identity(Ra.nrows())
    down = (one - Rb * Sa).solve(Ta)
    up = (one - Sa * Rb).solve(Ub)
    return Ra + Tb * (Sa * down), Ua * down, Sb + Ua * (Rb * up), Tb * up


def base_operator(directions: Directions, request: Request) -> arb_mat:
    """From light falling on the base, nodes and beam, to light going up, nodes and outgoing directions (flipped)."""
    n = directions.size
    result = arb_mat(n, n)
    white = sum((2 * w * mu for w, mu in zip(directions.weight, directions.mu, strict=False)), arb(0))
    is_grey = isinstance(request.base, float | arb)
    if request.base is None or (is_grey and request.order > 0):
        return result
    for i, mu_out in enumerate(directions.mu):
        for j, mu_in in enumerate([*directions.mu[: directions.nodes], *directions.mu0]):
            if is_grey:
                block = arb_mat(4, 4)
                block[0, 0] = 2 * exact(request.base)
                if request.is_refracted and min(i, j) < directions.nodes:  # exact for the nodes as for a sphere
                    block[0, 0] /= white
            else:
                block = flipped(request.base(request.order, mu_in, mu_out))
            if j < directions.nodes:
                put(result, 4 * i, 4 * j, directions.weight[j] * mu_in * block)
            else:
                place = directions.field + (j - directions.nodes) * directions.columns
                beam = directions.incident[j - directions.nodes]
                put(result, 4 * i, place, mu_in * (block * beam))
    return result


class Pile:
    """The slabs between the wanted depths; equal sequences are worked out once."""

    def __init__(self, directions: Directions, request: Request) -> None:
        self.directions, self.request = directions, request
        self.generators: dict[tuple[bytes, float], tuple[arb_mat, arb_mat]] = {}
        self.known: dict[tuple[tuple[int, str], ...], Quartet] = {}

    def slab(self, layer: Layer, thickness: arb) -> Quartet:
        """R, T, R, T of a piece of a layer."""
        key = (layer.coefficients.tobytes(), layer.albedo)
        if key not in self.generators:
            self.generators[key] = generator(self.directions, self.request, layer)
        R, T = homogeneous(self.directions, *self.generators[key], thickness)
        return R, T, R, T

    def sequence(self, pieces: tuple[tuple[Layer, arb], ...]) -> Quartet:
        """R and T of pieces on top of each other, halved again and again."""
        kinds = [(layer.coefficients.tobytes(), layer.albedo) for layer, _ in pieces]
        key = tuple((hash(kind), piece[1].str(80)) for kind, piece in zip(kinds, pieces, strict=True))
        if key not in self.known:
            if len(pieces) == 1:
                self.known[key] = self.slab(*pieces[0])
            else:
                half = 2 ** ((len(pieces) - 1).bit_length() - 1)
                self.known[key] = star(self.sequence(pieces[:half]), self.sequence(pieces[half:]))
        return self.known[key]


def cut(request: Request) -> tuple[list[tuple[tuple[Layer, arb], ...]], list[int]]:
    """The pieces between wanted depths, top first, and which boundary between them each level is."""
    groups: list[tuple[tuple[Layer, arb], ...]] = []
    place: dict[tuple[int, float], int] = {(-1, 0.0): -1}
    here: list[tuple[Layer, arb]] = []
    for k, layer in enumerate(request.layers):
        depth = arb(0)
        for level in sorted({d for at, d in request.levels if at == k}):
            if exact(level) > depth:
                here.append((layer, exact(level) - depth))
                depth = exact(level)
            if here:
                groups.append(tuple(here))
                here = []
            place[(k, level)] = len(groups)
        left = endless(layer, request) if math.isinf(layer.thickness) else exact(layer.thickness) - depth
        if left > 0:
            here.append((layer, left))
    if here:
        groups.append(tuple(here))
    return groups, [place[level] for level in request.levels]


def endless(layer: Layer, request: Request) -> arb:
    """A thickness that stands for infinite."""
    return arb(ENDLESS_CONSERVATIVE if layer.albedo == 1.0 and request.order == 0 else ENDLESS)


class DoubtfulError(ArithmeticError):
    """The balls are too wide: the scene has no stable answer, or needs more bits."""


def field_order(request: Request) -> Answer:
    """The field of one Fourier order, with as many bits as it takes. Raises DoubtfulError where 1280 are not enough.

    The public field is the sum over orders of (2 - delta_m0) times (cos, cos, sin, sin)(m phi) for the first column,
    and (-sin, -sin, cos, cos)(m phi) for the second.
    """
    conservative = any(math.isinf(layer.thickness) and layer.albedo == 1.0 for layer in request.layers)
    bits = BITS_CONSERVATIVE if conservative and request.order == 0 else BITS
    while True:
        try:
            return with_bits(request, bits)
        except (DoubtfulError, ZeroDivisionError):
            if bits >= 1024:
                raise DoubtfulError("even wide balls leave the answer open") from None
            bits *= 2


def with_bits(request: Request, bits: int) -> Answer:
    """The field of one Fourier order. Raises DoubtfulError where the balls leave 20 digits in doubt."""
    ctx.prec = bits
    directions = Directions(request)
    return collect(request, directions, find_fields(request, directions))


def find_fields(request: Request, directions: Directions) -> list[tuple[arb_mat, arb_mat]]:
    """Light down and up at each level, as balls."""
    groups, boundary = cut(request)
    pile = Pile(directions, request)
    parts = [pile.sequence(group) for group in groups]
    n = directions.size
    lit = not math.isinf(request.layers[-1].thickness)
    below = base_operator(directions, request) if lit else arb_mat(n, n)
    reflected, passing = [below], []
    for Ra, Ta, Rb, Tb in reversed(parts):
        through = (identity(n) - Rb * below).solve(Ta)
        passing.append(through)
        below = Ra + Tb * (below * through)
        reflected.append(below)
    down = arb_mat([[int(i - directions.field == j) for j in range(n - directions.field)] for i in range(n)])
    above = (down, down)
    if request.is_refracted:
        index, within = exact(request.index), down
        down = (identity(n) - surface_operator(directions, index) * reflected[-1]).solve(within)
        above = (within, leaving(directions, index) * (reflected[-1] * down))
    fields = [(down, reflected[-1] * down)]
    for through, lower in zip(reversed(passing), reversed(reflected[:-1]), strict=True):
        down = through * down
        fields.append((down, lower * down))
    return [above if place < 0 else fields[place] for place in boundary]


def leaving(directions: Directions, index: arb) -> arb_mat:
    """Radiance above the surface of that below it, in the wanted directions; on nodes n^2 times as much, of which they
    find the flux with cosines and weights from within."""
    found = arb_mat(directions.size, directions.size)
    for i, mu in enumerate(directions.mu):
        square = arb(1) if i < directions.nodes else index**2
        put(found, 4 * i, 4 * i, transmission(mu, 1 / index) * (1 / square))
    return found


def collect(request: Request, directions: Directions, fields: list[tuple[arb_mat, arb_mat]]) -> Answer:
    """Radiance in the wanted directions and fluxes, as doubles."""
    n_tau, columns = len(fields), range(directions.size - directions.field)
    radiance, flux = np.empty((len(columns), n_tau, len(request.mu), 4)), np.empty((len(columns), n_tau, 2))
    for t, (down, up) in enumerate(fields):
        light = [[light_at(request, directions, c, u, down, up) for u in request.mu] for c in columns]
        through = [[flux_of(directions, light_of, c) for light_of in (up, down)] for c in columns]
        radiance[:, t], flux[:, t] = centres(light), centres(through)
    return Answer(radiance, flux[..., 0], flux[..., 1])


def light_at(request: Request, directions: Directions, c: int, u: float, down: arb_mat, up: arb_mat) -> list[arb]:
    """The four Stokes parameters along a signed cosine, public frame."""
    row = 4 * (directions.nodes + directions.out.index(abs(u)))
    field, flip = (up, FLIP) if u > 0 else (down, (1, 1, 1, 1))
    return [field[row + i, c] * flip[i] / (2 * arb.pi()) for i in range(4)]


def flux_of(directions: Directions, light: arb_mat, c: int) -> arb:
    """Diffuse flux through a horizontal plane, from the nodes."""
    terms = (directions.weight[j] * directions.mu[j] * light[4 * j, c] for j in range(directions.nodes))
    return sum(terms, arb(0))


def centres(balls: list) -> np.ndarray:
    """The centres of nested lists of balls, none wider than 1e-20 of the largest. Raises DoubtfulError."""
    flat = np.array(balls, dtype=object)
    values = np.array([float(ball.mid()) for ball in flat.ravel()]).reshape(flat.shape)
    widest = max(float(ball.rad()) for ball in flat.ravel())
    if not widest <= 1e-20 * max(np.abs(values).max(), 1e-290):
        raise DoubtfulError(f"a ball of radius {widest:.1g} beside values up to {np.abs(values).max():.1g}")
    return values


def mueller_lobe_orders(width_deg: float, amplitude: float, matrix: np.ndarray) -> Lobe:
    """Orders of amplitude exp(-(1 - c)/width^2) M: 2 pi e^-x I_m(x) in the cosine blocks; M has no sine blocks."""
    constant = arb_mat([[exact(value) for value in row] for row in matrix])

    def orders(m: int, mu_in: arb, mu_out: arb) -> arb_mat:
        kappa = 1 / exact(math.radians(width_deg)) ** 2  # here, with the bits of the answer
        sines = ((1 - mu_in**2) * (1 - mu_out**2)).sqrt()
        x = kappa * sines
        # the scaled function carries e^-x
        scale = 2 * arb.pi() * exact(amplitude) * (x + kappa * (mu_in * mu_out - 1)).exp() * x.bessel_i(m, scaled=True)
        return scale * constant

    return orders


def sensitivity(request: Request, answer: Answer, size: np.ndarray) -> float:
    """c: the largest change when albedo, thickness or a coefficient of every layer moves by one unit in the last place.

    Of radiance relative to ``size`` (n_tau,), of fluxes (order 0) relative to the larger one at that depth.
    """
    worst = 0.0
    for change in (less_albedo, thicker, less_forward):
        layers = tuple(change(layer) for layer in request.layers)
        if all(a is b for a, b in zip(layers, request.layers, strict=True)):
            continue
        levels = tuple(moved_level(request.layers, layers, level) for level in request.levels)
        other = field_order(replace(request, layers=layers, levels=levels))
        worst = max(worst, largest(np.abs(other.radiance - answer.radiance).max(axis=(0, 2, 3)), size))
        if request.order == 0:
            fluxes, moved = (np.stack([found.flux_up, found.flux_down]) for found in (answer, other))
            worst = max(worst, largest(np.abs(moved - fluxes).max(axis=(0, 1)), np.abs(fluxes).max(axis=(0, 1))))
    return worst


def largest(gap: np.ndarray, size: np.ndarray) -> float:
    """The largest ratio; where there is no light there is no gap."""
    return float((gap / np.maximum(size, 1e-300)).max())


def less_albedo(layer: Layer) -> Layer:
    """One unit in the last place off the albedo."""
    return replace(layer, albedo=float(np.nextafter(layer.albedo, 0.0))) if layer.albedo > 0.0 else layer


def thicker(layer: Layer) -> Layer:
    """One unit in the last place onto the thickness."""
    if math.isinf(layer.thickness):
        return layer
    return replace(layer, thickness=float(np.nextafter(layer.thickness, np.inf)))


def less_forward(layer: Layer) -> Layer:
    """One unit in the last place off the first coefficient that is not zero beyond a1[0]."""
    coefficients = layer.coefficients.copy()
    for l in range(1, len(coefficients)):
        if coefficients[l, 0] != 0.0:
            coefficients[l, 0] = np.nextafter(coefficients[l, 0], 0.0)
            return replace(layer, coefficients=coefficients)
    return layer


def moved_level(before: tuple[Layer, ...], after: tuple[Layer, ...], level: tuple[int, float]) -> tuple[int, float]:
    """A level at a layer's bottom stays there."""
    at, depth = level
    return (at, after[at].thickness) if depth == before[at].thickness else level
