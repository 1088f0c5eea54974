"""Small-angle separation, section 2 of Budak and Efremenko: light scattered often, and little, beyond the nodes' reach.

The field is split, (2:4), into an anisotropic part, which keeps to the beam's direction, and the rest. As the beam
spreads by small angles, degree l of its expansion about that direction decays as E_l = exp(-(1 - albedo S_l) tau/mu0),
S_l the 4x4 matrix of the coefficients of degree l over 2 l + 1. Discrete ordinates solve for the rest. They carry 2 N
degrees, and on those the anisotropic part obeys the same equations as the rest: there both are solved together, as
light of the layers truncated by delta-M. Of the anisotropic part the degrees beyond remain, and one scattering of all
its light, integrated along the ray in closed form: this takes the place of single scattering.

With x = tau/mu0 along the beam, x' the same in truncated layers and f the peak's share, degree l of this source is, but
for the factor albedo/(1 - albedo f),

    (S_l - f) exp(-x') + f exp(-x)   for l < 2 N,        (S_l - f) E_l + f exp(-x)   for l >= 2 N.

S_l of different layers do not commute: of their product the part is kept that a scattering matrix can have.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.differences import divide_exp_once
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.single_scattering import measure_distance
from vrte.discrete_ordinates.orders.truncating import ALONE, is_scalar
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.optics.truncation import expand_peak
from vrte.scene.layer import Layer
from vrte.scene.scene import Scene

NEARLY_EQUAL = 1e-7  # difference of eigenvalues of S_l (at most 1) below which the derivative is used
STEP = 1e-6  # step of that derivative: rounding 1e-10, truncation as much times (tau/mu0)^2
TOGETHER = 30_000  # degrees times directions per batch: matrices of about 30 MB
ComplexArray = NDArray[np.complex128]


@record
class Spreading:
    """S_l of one phase matrix, in its blocks (I, Q) and (U, V).

    ``mean`` (l, 2): half the trace; ``shape`` (l, 2, 2, 2): S_l less the mean; ``root`` (l, 2): half the difference of
    the eigenvalues, complex where one of them is.
    """

    mean: Array
    shape: Array
    root: Array | ComplexArray

    @staticmethod
    def of(matrix: PhaseMatrix, terms: int) -> "Spreading":
        """Degrees 0 .. terms - 1, zero where the matrix has none."""
        a1, a2, a3, a4, b1, b2 = np.pad(matrix.coefficients, ((0, terms - matrix.terms), (0, 0))).T
        blocks = np.moveaxis(np.array([[[a1, b1], [b1, a2]], [[a3, b2], [-b2, a4]]]), -1, 0)
        blocks /= (2.0 * np.arange(terms) + 1.0)[:, None, None, None]
        mean = 0.5 * np.trace(blocks, axis1=-2, axis2=-1)
        shape = blocks - mean[..., None, None] * np.eye(2)
        square = -np.linalg.det(shape)
        return Spreading(mean, shape, np.sqrt(square.astype(complex) if (square < 0.0).any() else square))

    def beyond(self, first: int) -> "Spreading":
        """The degrees from ``first``."""
        return Spreading(self.mean[first:], self.shape[first:], self.root[first:])

    def function(self, values: Callable[[Any], Any]) -> Array:
        """The matrix function ``values``(S_l): (..., l, block, 2, 2) where ``values`` adds axes in front."""
        high, low = values(self.mean + self.root), values(self.mean - self.root)
        close = np.abs(self.root) < NEARLY_EQUAL
        slope = (high - low) / np.where(close, 1.0, 2.0 * self.root)
        if close.any():
            around = np.where(close, self.mean, 0.0)
            slope = np.where(close, (values(around + STEP) - values(around - STEP)) / (2.0 * STEP), slope)
        return 0.5 * (high + low).real[..., None, None] * np.eye(2) + slope.real[..., None, None] * self.shape

    def coefficients(self, blocks: Array, first: int) -> Array:
        """Columns a1 .. b2 (..., l, 6) of matrices (..., l, block, 2, 2) of the degrees from ``first``, at least 2."""
        plus, minus = blocks[..., 0, 1] + blocks[..., 1, 0], blocks[..., 0, 1] - blocks[..., 1, 0]
        diagonal = np.diagonal(blocks, axis1=-2, axis2=-1)
        columns = np.empty((*blocks.shape[:-3], 6))
        columns[..., :4] = diagonal.reshape(*diagonal.shape[:-2], 4)
        columns[..., 4], columns[..., 5] = 0.5 * plus[..., 0], 0.5 * minus[..., 1]
        return compute_degree_factors(first, columns.shape[-2])[:, None] * columns

    @staticmethod
    def product(one: Array, other: Array) -> Array:
        """Of two functions."""
        return one @ other

    @staticmethod
    def identity(terms: int) -> Array:
        """The function that is 1."""
        return np.broadcast_to(np.eye(2), (terms, 2, 2, 2))


@record
class ScalarSpreading:
    """S_l where polarization plays no part, ``mean`` (l,): the same calls, functions (..., l)."""

    mean: Array

    @staticmethod
    def of(matrix: PhaseMatrix, terms: int) -> "ScalarSpreading":
        """Degrees 0 .. terms - 1, zero where the matrix has none."""
        mean = np.zeros(terms)
        mean[: matrix.terms] = matrix.a1 / compute_degree_factors(0, matrix.terms)
        return ScalarSpreading(mean)

    def beyond(self, first: int) -> "ScalarSpreading":
        """The degrees from ``first``."""
        return ScalarSpreading(self.mean[first:])

    def function(self, values: Callable[[Any], Any]) -> Array:
        """``values``(S_l)."""
        return values(self.mean)

    def coefficients(self, values: Array, first: int) -> Array:
        """Columns a1 .. b2 (..., l, 6), all but the first zero."""
        columns = np.zeros((*values.shape, 6))
        columns[..., 0] = compute_degree_factors(first, values.shape[-1]) * values
        return columns

    @staticmethod
    def product(one: Array, other: Array) -> Array:
        """Of two functions."""
        return one * other

    @staticmethod
    def identity(terms: int) -> Array:
        """The function that is 1."""
        return np.ones(terms)


AnySpreading = Spreading | ScalarSpreading


def compute_degree_factors(first: int, count: int) -> Array:
    """2 l + 1."""
    return 2.0 * np.arange(first, first + count, dtype=float) + 1.0


@dataclass(frozen=True)
class Beam:
    """The beam at the top of a layer, for a unit one at the top of the scene: ``direct``, never scattered, exp(-x);
    ``degrees`` E_l, a function of its layer's kind of spreading."""

    direct: float
    degrees: Array


@record
class Anisotropic:
    """The anisotropic part of a scene, and what one scattering of it sends out; ``problem``: truncated by delta-M."""

    scene: Scene
    problem: Problem

    @cached_property
    def terms(self) -> int:
        """Of the longest phase matrix."""
        return max(layer.phase_matrix.terms for layer in self.scene.layers)

    @cached_property
    def scalar(self) -> bool:
        """Whether polarization plays no part."""
        return is_scalar(self.scene)

    @cached_property
    def spreadings(self) -> list[AnySpreading]:
        """One a layer, layers of one phase matrix share it."""
        kind: Any = ScalarSpreading if self.scalar else Spreading
        matrices = {id(layer.phase_matrix): layer.phase_matrix for layer in self.scene.layers}
        found = {key: kind.of(matrix, self.terms) for key, matrix in matrices.items()}
        return [found[id(layer.phase_matrix)] for layer in self.scene.layers]

    def beams(self, mu0: float) -> list[Beam]:
        """The beam at the top of every layer."""
        beams = [Beam(1.0, self.spreadings[0].identity(self.terms))]
        for layer, spreading in zip(self.scene.layers[:-1], self.spreadings[:-1], strict=True):
            passed = spread_through_layer(spreading, layer.albedo, layer.thickness / mu0)
            direct = beams[-1].direct * float(np.exp(-layer.thickness / mu0))
            beams.append(Beam(direct, spreading.product(passed, beams[-1].degrees)))
        return beams

    def sources(self, mu0: float, beams: list[Beam], level: int, mu: Array) -> Iterator[tuple[IntArray, Array]]:
        """What comes to a depth out of the directions mu (n_mu,), signed: some of their places, and their expansion
        coefficients (place, terms, 6), columns a1 .. b2. Directions that no light comes from are left out."""
        together = max(1, TOGETHER // self.terms)
        for up in (True, False):
            indices = np.flatnonzero((mu > 0.0) == up).astype(np.int32)
            rays = [Ray(self.problem, level, k, up) for k in range(len(self.scene.layers))]
            rays = [ray for ray in rays if ray.length > 0.0 and self.problem.gain[ray.layer] > 0.0]
            for start in range(0, indices.size if rays else 0, together):
                some = indices[start : start + together]
                yield some, sum(self.source(mu0, beams[ray.layer], ray, np.abs(mu[some])) for ray in rays)

    def source(self, mu0: float, beam: Beam, ray: "Ray", mu: Array) -> Any:
        """What one layer adds to the coefficients: the formula on top, integrated along rays of the cosines mu > 0."""
        layer, spreading = self.scene.layers[ray.layer], self.spreadings[ray.layer]
        f, carried = float(self.problem.fraction[ray.layer]), self.problem.coefficients.shape[1]
        per_depth = 1.0 / ((1.0 - layer.albedo * f) * mu0)
        whole, cut = ray.integral(np.array([per_depth, 1.0 / mu0]), mu).T
        never = f * beam.direct * whole
        decay = np.exp(-self.problem.above[ray.layer] / mu0) * cut
        forward, residual = expand_peak(self.terms), -f * expand_peak(carried)
        known = min(carried, layer.phase_matrix.terms)
        residual[:known] += layer.phase_matrix.coefficients[:known]
        if self.scalar:
            forward, residual = forward * ALONE, residual * ALONE
        table: Array = never[:, None, None] * forward
        table[:, :carried] += decay[:, None, None] * residual
        if carried < self.terms:
            table[:, carried:] += self.beyond(layer, spreading.beyond(carried), beam, ray, mu, f, per_depth)
        return self.problem.gain[ray.layer] * table

    def beyond(
        self, layer: Layer, spreading: AnySpreading, beam: Beam, ray: "Ray", mu: Array, f: float, per_depth: float
    ) -> Array:
        """The degrees that the nodes do not carry."""
        first = self.problem.coefficients.shape[1]
        found = spreading.function(lambda s: (s - f) * ray.integral((1.0 - layer.albedo * s) * per_depth, mu))
        return spreading.coefficients(spreading.product(found, beam.degrees[first:]), first)


def spread_through_layer(spreading: AnySpreading, albedo: float, path: float) -> Array:
    """E_l of a layer, the exp(-d_l tau/mu0) of (2:14); ``path``: its optical thickness along the beam."""
    return spreading.function(lambda s: np.exp((albedo * s - 1.0) * path))


def count_scratch_doubles(scene: Scene) -> float:
    """Doubles of an `Anisotropic` and of what it returns, at most."""
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    matrices = len({id(layer.phase_matrix) for layer in scene.layers})
    return 8.0 * len(scene.layers) * terms + 16.0 * matrices * terms + 120.0 * max(TOGETHER, terms)


@record
class Ray:
    """The part of layer ``layer`` that light at level ``level``, on its way up or down, comes through."""

    problem: Problem
    level: int
    layer: int
    up: bool

    @property
    def top(self) -> float:
        """Where the part begins, below the top of the layer."""
        return self._level if self.up and self._here else 0.0

    @property
    def length(self) -> float:
        """Optical depth of the part, 0 for none."""
        at, thickness = int(self.problem.level_layer[self.level]), float(self.problem.thickness[self.layer])
        if self._here:
            return thickness - self._level if self.up else self._level
        return thickness if (self.layer > at) == self.up else 0.0

    @property
    def _here(self) -> bool:
        return int(self.problem.level_layer[self.level]) == self.layer

    @property
    def _level(self) -> float:
        return float(self.problem.level[self.level])

    def integral(self, rate: Any, mu: Array) -> Any:
        """Of exp(-rate t) exp(-|t - tau|/mu) dt/mu over the part, t from the layer's top, both depths of the truncated
        layers: (n_mu, ...) for mu (n_mu,) > 0 and rates of any shape, real part >= 0.
        """
        length = self.length
        mu = mu.reshape(-1, *(1 for _ in rate.shape))
        way = np.exp(-measure_distance(self.problem, self.level, self.layer) / mu)
        if not self.up:
            return way * (length / mu) * divide_exp_once(-length * rate, -length / mu)
        reach = -np.expm1(-length * (rate + 1.0 / mu)) if np.isfinite(length) else 1.0
        return way * np.exp(-self.top * rate) * reach / (1.0 + mu * rate)
