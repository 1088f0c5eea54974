"""Derivatives of a slab's R and T in plain numbers: the doubling of `vrte/core/doubling.pxi`, each step differentiated.

A `Tangent` is a matrix with its derivatives along any number of directions, and knows the product rule; the doubling is
written once, in Tangents. Directions off the nodes are rows and columns of the same matrices, with weight zero.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray
NUMERATOR, DENOMINATOR = (135135.0, 17325.0, 378.0, 1.0), (135135.0, 62370.0, 3150.0, 28.0)
STEEP, COMPLEMENTED, THICK, STEEPEST_RATIO, MOST_DOUBLINGS = 0.5, 0.75, 1.0, 1e-3, 80
ZERO = 1e-13  # of the largest: a singular value, or a row's sum, that rounding made


@dataclass(frozen=True, eq=False)
class Tangent:
    """A matrix (n, n) and its derivatives (direction, n, n)."""

    value: Array
    change: Array

    def __matmul__(self, other: "Tangent") -> "Tangent":
        return Tangent(self.value @ other.value, self.change @ other.value + self.value @ other.change)

    def __add__(self, other: "Tangent") -> "Tangent":
        return Tangent(self.value + other.value, self.change + other.change)

    def __sub__(self, other: "Tangent") -> "Tangent":
        return self + -1.0 * other

    def __rmul__(self, factor: float) -> "Tangent":
        return Tangent(factor * self.value, factor * self.change)

    def invert(self) -> "Tangent":
        """The inverse; its derivative is -X^-1 dX X^-1."""
        found = np.linalg.inv(self.value)
        return Tangent(found, -found @ self.change @ found)

    def squeeze(self, left: Array, right: Array) -> "Tangent":
        """Between two constant matrices."""
        return Tangent(left @ self.value @ right, left @ self.change @ right)


def differentiate_slab(E: Array, F: Array, dE: Array, dF: Array, thickness: float) -> tuple[Array, Array, Array, Array]:
    """R, T of a slab and their derivatives dR, dT along dE, dF, of one direction (n, n) or several (direction, n, n).

    E and F are alpha +- beta of I+' = -alpha I+ - beta I~, I~' = beta I+ + alpha I~, per unit of optical depth; T
    carries the unscattered light on its diagonal. Raises ArithmeticError where an endless slab that absorbs nothing
    begins to: its derivative is infinite.
    """
    steps = [np.reshape(part, (-1, *E.shape)) for part in (dE, dF)]
    e, f = Tangent(E, steps[0]), Tangent(F, steps[1])
    one = Tangent(np.eye(len(E)), np.zeros_like(steps[0]))
    steepest = max(math.sqrt(np.abs(F @ E).sum(axis=0).max()), np.abs(np.diag(E)).max(), np.abs(np.diag(F)).max())
    axis = find_axis(e, f)
    if math.isinf(thickness):
        if axis.is_null and not axis.stays:
            raise ArithmeticError("an endless layer of albedo 1 has no derivative with respect to its albedo")
        Ze = double_semi_infinite(e, f, one, steepest, axis)
        r, t = one - 2.0 * (Ze @ (one + Ze).invert()), 0.0 * one
    else:
        Ze, Zo, C = double_plainly(e, f, one, 0.5 * thickness, steepest, axis)
        above, below = (one + Zo).invert(), (one + Ze).invert()
        odd = one - above if thickness > THICK else Zo @ above  # Zo grows with the thickness, or is as small
        r = odd - Ze @ below
        t = above @ C @ below
    if thickness > THICK:
        r = reflect_by_invariance(e, f, r, t)
    return r.value, t.value, r.change.reshape(np.shape(dE)), t.change.reshape(np.shape(dE))


def differentiate_thickness(E: Array, F: Array, R: Array, T: Array) -> tuple[Array, Array]:
    """dR and dT per unit of thickness, by invariance: a thin layer added at the bottom. Nothing cancels, so what is
    left of T where a slab is thick keeps its digits."""
    alpha, beta = (E + F) / 2.0, (E - F) / 2.0
    return -T @ beta @ T, -(alpha + R @ beta) @ T


def reflect_by_invariance(e: Tangent, f: Tangent, r: Tangent, t: Tangent) -> Tangent:
    """R from directions that nothing scatters into to those that scatter into nothing, anew.

    What Zo, as large as the slab is thick, leaves there is a difference of two such numbers. A thin layer added on top
    and taken off below changes nothing: beta + alpha R + R alpha + R beta R = T beta T.
    """
    alpha, beta = 0.5 * (e + f), 0.5 * (e - f)
    rates = np.diag(alpha.value)
    beside = (abs(e.value) + abs(f.value) > 0.0) & ~np.eye(len(rates), dtype=bool)
    edge = np.outer(~beside.any(axis=0), ~beside.any(axis=1))
    rest = Tangent(np.where(edge, 0.0, r.value), np.where(edge, 0.0, r.change))
    gap = beta + alpha @ rest + rest @ alpha + rest @ beta @ rest - t @ beta @ t
    scale = edge / (rates[:, None] + rates)
    return rest - Tangent(scale * gap.value, scale * gap.change)


@dataclass(frozen=True, eq=False)
class Axis:
    """The direction that carries the flux where little is absorbed: E's smallest singular value is its.

    left and right: 1 - u u^T and 1 - v v^T of its singular vectors; is_null: whether the value is zero; stays: whether
    it is along dE, too.
    """

    left: Array
    right: Array
    is_null: bool
    stays: bool

    def keep(self, Ze: Tangent) -> Tangent:
        """Ze has E's null vectors for ever; what rounding puts there would double at each step."""
        if not self.is_null:
            return Ze
        return Ze.squeeze(self.left, self.right) if self.stays else replace(Ze, value=self.left @ Ze.value @ self.right)


def find_axis(e: Tangent, f: Tangent) -> Axis:
    """Of E and its derivatives; F's are for the size alone."""
    u, sizes, v = np.linalg.svd(e.value)
    left, right, one = u[:, -1], v[-1], np.eye(len(u))
    across = max(np.abs(left @ e.change).max(), np.abs(e.change @ right).max())
    return Axis(
        one - np.outer(left, left),
        one - np.outer(right, right),
        bool(sizes[-1] < ZERO * sizes[0]),
        bool(across <= ZERO * max(np.abs(e.change).max(), np.abs(f.change).max())),
    )


def double_both(Ze: Tangent, Zo: Tangent, one: Tangent, axis: Axis) -> tuple[Tangent, Tangent, Tangent]:
    """2 Ze L^-1, 2 L^-1 Zo, L^-1.

    2 L^-1 Zo is 2 Zo (1 + Ze Zo)^-1, too: the axis' row is taken from the latter, where nothing that grows with the
    thickness cancels.
    """
    back = (one + Zo @ Ze).invert()
    odd, row = back @ Zo, Zo @ (one + Ze @ Zo).invert()
    Zo = odd.squeeze(axis.right, one.value) + row.squeeze(one.value - axis.right, one.value)
    return axis.keep(2.0 * (Ze @ back)), 2.0 * Zo, back


def double_plainly(
    e: Tangent, f: Tangent, one: Tangent, half: float, steepest: float, axis: Axis
) -> tuple[Tangent, Tangent, Tangent]:
    """Ze, Zo and C = 1 - Zo Ze of half a slab's thickness: a rational start, then doublings; C <- (C L^-1)^2."""
    count = max(0, math.ceil(math.log2(half * steepest / STEEP)))
    h = half / 2.0**count
    z = h * h * (f @ e)
    powers = [one, z, z @ z, z @ z @ z]
    above, below = (
        sum((factor * power for factor, power in zip(factors, powers, strict=True)), 0.0 * one)
        for factors in (NUMERATOR, DENOMINATOR)
    )
    start = h * (below.invert() @ above)
    Ze, Zo, C = axis.keep(e @ start), start @ f, None
    for _ in range(count):
        if 2.0 * h > COMPLEMENTED and C is None:
            C = one - Zo @ Ze
        Ze, Zo, back = double_both(Ze, Zo, one, axis)
        h = 2.0 * h
        if C is not None:
            C = (C @ back) @ (C @ back)
    return Ze, Zo, one - Zo @ Ze if C is None else C


def double_semi_infinite(e: Tangent, f: Tangent, one: Tangent, steepest: float, axis: Axis) -> Tangent:
    """Ze of a semi-infinite slab, by scaled doublings until neither it nor its derivative changes.

    The scale is a constant: where Zo Ze comes to 1 it plays no part in Ze, nor in the derivative, which gets there one
    doubling later.
    """
    rates = np.sort(np.sqrt(np.linalg.eigvals(f.value @ e.value).real.clip(0.0)))
    ratio = min(1.0, rates[1 if axis.is_null else 0] / steepest)
    Ze, Zo = (1.0 / steepest) * e, (1.0 / steepest) * f
    settled = 0
    for _ in range(MOST_DOUBLINGS):
        used = max(ratio, STEEPEST_RATIO)
        scale = 1.0 / math.sqrt(used)
        before = Ze
        Ze, Zo, _ = double_both(scale * Ze, scale * Zo, one, axis)
        ratio = min(2.0 * ratio * math.sqrt(used) / (used + ratio**2), 2.0 * math.sqrt(used) / (1.0 + used))
        same = ratio > 0.999 and np.abs(Ze.value - before.value).max() < 1e-9 * np.abs(Ze.value).max()
        settled = settled + 1 if same else 0
        if settled == 3:
            break
    return Ze
