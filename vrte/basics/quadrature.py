"""Double-Gauss quadrature, (1:15): Gauss-Legendre nodes on each hemisphere, and nodes of media that light passes."""

import itertools
import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np

from vrte.basics.arrays import Array
from vrte.basics.spherical_functions import find_gauss_legendre


def make_double_gauss(nodes: int, grading: int = 1) -> tuple[Array, Array]:
    """Nodes mu in (0, 1), ascending, and their weights (they sum to 1), each (nodes,), of (1:15); graded ones, mu =
    x^grading of Gauss's x, crowd at the horizon, where light varies as e^(-tau/mu) and mu log(mu)."""
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
    """Directions that belong together by Snell's law, n sin(theta) = s, as nodes of several media, by ascending
    cosines: ``highest`` (N,), the index b that bounds a node's panel from above; ``depth`` (N,), b^2 - s^2; ``measure``
    (N,), the weight in s ds = n^2 mu dmu; a medium has the last nodes, where s < n. ``panels``: first and last + 1 node
    of each."""

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


def count_panel_nodes(indices: Iterable[float], nodes: int) -> list[int]:
    """How many of the nodes of the densest medium each panel of `make_refracted_nodes` has, from the lowest index."""
    edges = sorted(set(indices))
    shares = [1.0, *(math.sqrt((high - low) * (high + low)) / high for low, high in itertools.pairwise(edges))]
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
    edges, counts = sorted(set(indices)), count_panel_nodes(indices, nodes)
    rows, panels, first = [], [], 0
    parts = zip([(0.0, edges[0]), *itertools.pairwise(edges)], [*edges[1:], math.inf], counts, strict=True)
    for (low, high), above, count in reversed(list(parts)):
        x, weights = make_double_gauss(count)
        panel = Panel(low, high, above, grading if layers is None or high in layers else 1)
        depth, rate = panel.spread(x)
        rows.append((np.full(count, high), depth, weights * rate))
        panels.append((first, first + count, panel))
        first += count
    highest, depths, measure = map(np.concatenate, zip(*rows, strict=True))
    return RefractedNodes(highest, depths, measure, tuple(panels))
