"""Double-Gauss quadrature, (1:15): Gauss-Legendre nodes on each hemisphere, and nodes of media that light passes; and
Wigner's functions d^l_mn of the scattering angle, whose products such nodes integrate.

Both recurrences run on the difference of neighbouring degrees and on 1 - |cosine|, which keeps the digits near
forward and backward scattering, where the textbook form loses l^2 of them.
"""

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, make_readonly

DEGREES_AT_ONCE = 256  # bounds the memory, whatever the number of terms
KEPT = 40_000  # doubles of functions that are kept for the next time, 16 times at most


def compute_wigner_functions(
    pairs: Sequence[tuple[int, int]], terms: int, cosine: Array, difference: Array | None = None
) -> Iterator[tuple[int, Array]]:
    """Yields first l and d^l_mn (l, pair, n), l < ``terms``, pairs (0, n) or (m, m) and (m, -m), at ascending cosines
    with ``difference`` 1 - |cosine|: Hovenier and van der Mee, Astron. Astrophys. 128, 1 (1983)."""
    if terms > DEGREES_AT_ONCE or len(pairs) * terms * cosine.size > KEPT:
        yield from _compute_blocks(pairs, terms, cosine, 1.0 - np.abs(cosine) if difference is None else difference)
        return
    gap = None if difference is None else difference.tobytes()
    yield 0, _find_kept(tuple(pairs), terms, cosine.tobytes(), gap)


@lru_cache(maxsize=16)
def _find_kept(pairs: tuple[tuple[int, int], ...], terms: int, cosine: bytes, gap: bytes | None) -> Array:
    """The one block of few terms and angles, which are often asked for again: at other wavelengths, say."""
    at = np.frombuffer(cosine)
    ((_, block),) = _compute_blocks(pairs, terms, at, 1.0 - np.abs(at) if gap is None else np.frombuffer(gap))
    return make_readonly(block)


def _compute_blocks(
    pairs: Sequence[tuple[int, int]], terms: int, cosine: Array, difference: Array
) -> Iterator[tuple[int, Array]]:
    """All blocks of degrees, worked out."""
    behind = int(np.searchsorted(cosine, 0.0))
    gain, shift, memory = _find_recurrence(pairs, terms)
    step, change = np.zeros((2, len(pairs), cosine.size))
    now = np.zeros_like(step)
    for first in range(0, terms, DEGREES_AT_ONCE):
        degrees = np.arange(first, min(first + DEGREES_AT_ONCE, terms))
        block = np.empty((degrees.size, len(pairs), cosine.size))
        for row, degree in enumerate(degrees):
            np.multiply(gain[degree], difference, out=change)
            np.subtract(shift[degree], change, out=change)
            change *= now
            step *= memory[degree]
            step += change
            now = np.add(now, step, out=block[row])
            for index, (m, n) in enumerate(pairs if degree <= 2 else ()):
                if degree == max(m, abs(n)):
                    minus, plus = abs(m - n), abs(m + n)
                    count = math.factorial(minus + plus) / (math.factorial(minus) * math.factorial(plus))
                    now[index] = (
                        math.sqrt(count) * (0.5 * difference) ** (minus / 2) * (1.0 - 0.5 * difference) ** (plus / 2)
                    )
        now = now.copy()
        _turn_back(block[:, :, :behind], pairs, degrees)
        yield first, block


def find_gap(angle: Array) -> Array:
    """1 - |cos(angle)| of angles from 0 to pi, to the last digits."""
    return 2.0 * np.sin(0.5 * np.minimum(angle, np.pi - angle)) ** 2


def _find_recurrence(pairs: Sequence[tuple[int, int]], terms: int) -> tuple[Array, Array, Array]:
    """gain, shift and memory of the step to degree l, zero up to the lowest degree, (terms, pair, 1) each: d^l -
    d^(l-1) = memory (d^(l-1) - d^(l-2)) + (shift - gain gap) d^(l-1), without differences of nearly equal numbers."""
    m, n = np.array(pairs, dtype=np.float64).T[:, None, :, None]
    new = np.arange(float(terms))[:, None, None]
    old = np.maximum(new - 1.0, 0.0)
    under_way = new > np.maximum(m, np.abs(n))

    def root(degree: Array, order: Array) -> Array:
        return np.sqrt(np.where(under_way, degree**2 - order**2, 1.0))

    divisor = np.where(old > 0.0, old, 1.0)  # at old = 0 what it divides vanishes
    steepness = root(new, m) * root(new, n)
    gain = (old + new) * new / steepness
    memory = new * root(old, m) * root(old, n) / (divisor * steepness)
    zonal = n**2 * (1.0 / (new + root(new, n)) + 1.0 / (old + root(old, n) + (old == 0.0))) / root(new, n)
    opposite = 2.0 * (old + new) * m**2 / (divisor * steepness)
    shift = np.where(m == 0.0, zonal, np.where(n == m, 0.0, opposite))
    return gain * under_way, shift * under_way, memory * under_way


def _turn_back(block: Array, pairs: Sequence[tuple[int, int]], degrees: NDArray[np.int64]) -> None:
    """Makes d^l_mn(x) into d^l_mn(-x) = (-1)^(l+m) d^l_m,-n(x), in place."""
    partners = [index if m == 0 else list(pairs).index((m, -n)) for index, (m, n) in enumerate(pairs)]
    sign = (-1.0) ** (degrees[:, None, None] + np.array([m for m, _ in pairs])[:, None])
    np.multiply(sign, block[:, partners], out=block)


@lru_cache(maxsize=32)
def find_gauss_legendre(count: int) -> tuple[Array, Array]:
    """Gauss nodes in (-1, 1), ascending, and weights, (count,): Abramowitz and Stegun (1964), 22.16.6, 25.4.29."""
    half = (count + 1) // 2
    guess = (4.0 * np.arange(1, half + 1) - 1.0) / (4.0 * count + 2.0) * math.pi
    angle = guess + (count - 1.0) / (8.0 * count**3) / np.tan(guess)
    if count % 2:
        angle[-1] = 0.5 * math.pi
    for _ in range(3):
        last, before = _evaluate_legendre(count, angle)
        slope = count * (np.cos(angle) * last - before) / np.sin(angle)  # dP/d(angle)
        angle = angle - last / slope
    last, before = _evaluate_legendre(count, angle)
    slope = count * (np.cos(angle) * last - before)
    nodes, weights = np.cos(angle), 2.0 * (np.sin(angle) / slope) ** 2
    if count % 2:
        nodes[-1] = 0.0
    inner = half - count % 2
    both = np.concatenate([0.0 - nodes, nodes[:inner][::-1]]), np.concatenate([weights, weights[:inner][::-1]])
    return make_readonly(both[0]), make_readonly(both[1])


def _evaluate_legendre(degree: int, angle: Array) -> tuple[Array, Array]:
    """P_l and P_(l-1) of cos(angle), angle up to 90 degrees."""
    difference = 2.0 * np.sin(0.5 * angle) ** 2
    now, step, before = np.ones_like(difference), np.zeros_like(difference), np.zeros_like(difference)
    for known in range(degree):
        step = (known * step - (2 * known + 1) * difference * now) / (known + 1)
        before, now = now, now + step
    return now, before


def make_double_gauss(nodes: int, grading: int = 1) -> tuple[Array, Array]:
    """Nodes mu in (0, 1), ascending, and weights of sum 1, (nodes,) each, (1:15); mu = x^grading of Gauss's x."""
    x, weights = find_gauss_legendre(nodes)
    x, weights = 0.5 * (x + 1.0), 0.5 * weights
    return (x, weights) if grading == 1 else (x**grading, weights * grading * x ** (grading - 1))


@dataclass(frozen=True)
class Panel:
    """Directions n sin(theta) = s from low to high as a variable x from 1 to 0 in which light is smooth; ``above``: the
    next higher index of a medium, or infinity; ``grading``: x is that power of the variable of Gauss's nodes."""

    low: float
    high: float
    above: float
    grading: int = 1

    @property
    def size(self) -> float:
        """How far the panel reaches in s^2: high^2 - low^2."""
        return (self.high - self.low) * (self.high + self.low)

    @property
    def most(self) -> float:
        """What the angle t, or without one the cosine, has at the low end."""
        return 1.0 if self.low == 0.0 else 0.5 * np.pi

    @property
    def near(self) -> float:
        """How far beyond the high end the next medium's edge is, in the same variable."""
        return math.sqrt((self.above - self.high) * (self.above + self.high) / self.size)

    def spread(self, x: Array) -> tuple[Array, Array]:
        """high^2 - s^2, and |s ds/dx|."""
        rate = np.ones_like(x)
        if self.grading > 1:
            x, rate = x**self.grading, self.grading * x ** (self.grading - 1)
        if math.isfinite(self.above):
            near, steep = self.near / self.most, math.asinh(self.most / self.near)
            x, rate = near * np.sinh(steep * x), near * steep * np.cosh(steep * x) * rate
        if self.low == 0.0:
            return self.size * x**2, self.size * rate * x
        sine, cosine = np.sin(self.most * x), np.cos(self.most * x)
        return self.size * sine**2, self.size * self.most * rate * sine * cosine

    def locate(self, depth: Array) -> Array:
        """x where high^2 - s^2 is ``depth``, the nearest end beyond the panel."""
        root = np.sqrt(np.clip(depth / self.size, 0.0, 1.0))
        x = root if self.low == 0.0 else np.arcsin(root) / self.most
        if math.isfinite(self.above):
            x = np.arcsinh(x * self.most / self.near) / math.asinh(self.most / self.near)
        return x ** (1.0 / self.grading)


@dataclass(frozen=True, eq=False)
class RefractedNodes:
    """Directions of several media that belong together by Snell's law, n sin(theta) = s, ascending: ``highest`` (N,),
    index b that bounds a node's panel from above; ``depth`` (N,), b^2 - s^2; ``measure`` (N,), the weight in s ds = n^2
    mu dmu; a medium has the last nodes, where s < n. ``panels``: first and last + 1 node."""

    highest: Array
    depth: Array
    measure: Array
    panels: tuple[tuple[int, int, Panel], ...]

    def count(self, index: float) -> int:
        """How many of them a medium has."""
        return int(np.count_nonzero(self.highest <= index))

    def carried(self, index: float) -> tuple[Array, Array]:
        """Cosines in (0, 1), ascending, and weights (they sum to 1, nearly) of the nodes that a medium has."""
        here = self.highest <= index
        highest, depth = self.highest[here], self.depth[here]
        cosines = np.sqrt((index - highest) * (index + highest) + depth) / index
        return cosines, self.measure[here] / (index * index * cosines)

    def move(self, indices: Mapping[float, float]) -> "RefractedNodes":
        """The same nodes, as many a panel, of media whose indices became others."""
        moved = {0.0: 0.0, math.inf: math.inf} | dict(indices)
        panels = [
            (first, last, replace(one, low=moved[one.low], high=moved[one.high], above=moved[one.above]))
            for first, last, one in self.panels
        ]
        return lay_nodes(panels, self.measure.size)


def count_panel_nodes(indices: Iterable[float], nodes: int, layers: Collection[float] | None = None) -> list[int]:
    """How many of the nodes of the densest medium each panel of `make_refracted_nodes` has, from the lowest index: that
    one has fewer where no ``layers`` lie in its medium, since the next medium mirrors its own horizon."""
    edges = sorted(set(indices))
    shares = [1.0, *(math.sqrt((high - low) * (high + low)) / high for low, high in itertools.pairwise(edges))]
    if len(edges) > 1 and layers is not None and edges[0] not in layers:
        shares[0] = max(1.0 - shares[1], 0.9 * shares[1])
    fewest = max(2, nodes // 6)
    counts = [max(fewest, round(nodes * share / sum(shares))) for share in shares]
    counts[0] = max(fewest, nodes - sum(counts[1:]))
    return counts


def make_refracted_nodes(
    indices: Iterable[float], nodes: int, grading: int = 1, layers: Collection[float] | None = None
) -> RefractedNodes:
    """Nodes of media of these refractive indices, ``nodes`` in the densest of them, at least two a panel.

    Panels of s lie between the indices: from a to b, s^2 = a^2 + (b^2 - a^2) cos^2 t with Gauss in t from 0 to pi/2, in
    which sqrt(b^2 - s^2) and sqrt(s^2 - a^2) are both smooth; from 0 to the lowest, b, Gauss in the cosine. Where there
    is a medium c beyond, both are the hyperbolic sine of what Gauss is in: then sqrt(c^2 - s^2) is smooth as well. A
    ``grading`` is for panels that end at the horizon of ``layers``, the indices of media that scatter (None: all).
    """
    indices = list(indices)
    edges, counts = sorted(set(indices)), count_panel_nodes(indices, nodes, layers)
    panels, first = [], 0
    parts = zip([(0.0, edges[0]), *itertools.pairwise(edges)], [*edges[1:], math.inf], counts, strict=True)
    for (low, high), above, count in reversed(list(parts)):
        panel = Panel(low, high, above, grading if layers is None or high in layers else 1)
        panels.append((first, first + count, panel))
        first += count
    return lay_nodes(panels, first)


def lay_nodes(panels: Sequence[tuple[int, int, Panel]], count: int) -> RefractedNodes:
    """The first so many nodes of panels, each with its first and last + 1 node."""
    rows = []
    for first, last, panel in panels:
        x, weights = make_double_gauss(last - first)
        depth, rate = panel.spread(x)
        rows.append((np.full(x.size, panel.high), depth, weights * rate))
    highest, depths, measure = (np.concatenate(each)[:count] for each in zip(*rows, strict=True))
    return RefractedNodes(highest, depths, measure, tuple(panels))
