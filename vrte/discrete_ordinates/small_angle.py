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

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.arrays import Array
from vrte.discrete_ordinates.problem import Problem, Run
from vrte.discrete_ordinates.single_scattering import cos_sin_deg, distance
from vrte.optics.phase_matrix import PhaseMatrix
from vrte.optics.truncation import Truncated, peak
from vrte.scene import Scene

NEARLY_EQUAL = 1e-7  # eigenvalues of S_l, which are of size 1 at most: closer ones take the derivative
STEP = 1e-6  # of the derivative: rounding of 1e-10, and as much times (tau/mu0)^2
SMALL = 1e-5  # exponents that a series is for
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Spreading:
    """S_l of one phase matrix, in its blocks (I, Q) and (U, V).

    ``mean`` (l, 2): half the trace; ``shape`` (l, 2, 2, 2): S_l less the mean; ``root`` (l, 2): half the difference of
    the eigenvalues, complex.
    """

    mean: Array
    shape: Array
    root: ComplexArray

    @staticmethod
    def of(matrix: PhaseMatrix, terms: int) -> "Spreading":
        """Degrees 0 .. terms - 1, zero where the matrix has none."""
        a1, a2, a3, a4, b1, b2 = np.pad(matrix.coefficients, ((0, terms - matrix.terms), (0, 0))).T
        blocks = np.moveaxis(np.array([[[a1, b1], [b1, a2]], [[a3, b2], [-b2, a4]]]), -1, 0)
        blocks /= (2.0 * np.arange(terms) + 1.0)[:, None, None, None]
        mean = 0.5 * np.trace(blocks, axis1=-2, axis2=-1)
        shape = blocks - mean[..., None, None] * np.eye(2)
        return Spreading(mean, shape, np.sqrt(-np.linalg.det(shape).astype(complex)))

    def function(self, values: Callable[[ComplexArray], ComplexArray]) -> Array:
        """The matrix function ``values``(S_l): (l, block, 2, 2)."""
        high, low = values(self.mean + self.root), values(self.mean - self.root)
        close = np.abs(self.root) < NEARLY_EQUAL
        slope = (high - low) / np.where(close, 1.0, 2.0 * self.root)
        around: ComplexArray = self.mean[close].astype(complex)
        slope[close] = (values(around + STEP) - values(around - STEP)) / (2.0 * STEP)
        return 0.5 * (high + low).real[..., None, None] * np.eye(2) + slope.real[..., None, None] * self.shape


def add_anisotropic(
    radiance: Array,
    scene: Scene,
    layers: list[Truncated],
    problem: Problem,
    mu: Array,
    phi: Array,
    scalar: bool,
    run: Run,
) -> None:
    """Adds what the anisotropic part sends into the directions ``mu`` (signed), ``phi`` to radiance, in place.

    Shapes as in `solver.add_scattered_once`; ``scalar``: as the layers were truncated.
    """
    terms = max(layer.phase_matrix.terms for layer in scene.layers)
    spreadings = {id(matrix): Spreading.of(matrix, terms) for matrix in (layer.phase_matrix for layer in scene.layers)}
    spread = [spreadings[id(layer.phase_matrix)] for layer in scene.layers]
    cosine, sine = (np.ascontiguousarray(values) for values in cos_sin_deg(phi))
    phase = np.empty((1, 1, phi.size, 4, 4))
    for i, mu0 in enumerate(problem.mu0):
        beams = spread_beams(scene, spread, float(mu0))
        for t, o in np.ndindex(problem.level.size, mu.size):
            begin = time.perf_counter()
            table = np.zeros((terms, 6))
            for k, layer in enumerate(layers):
                ray = Ray(problem, t, k, float(mu[o]))
                if ray.length > 0.0 and layer.gain > 0.0:
                    table += source(scene, layer, spread[k], beams[k], float(mu0), ray, scalar)
            run.book("small angles", time.perf_counter() - begin)
            if not table.any():
                continue
            into, out = problem.mu0[i : i + 1], np.ascontiguousarray(mu[o : o + 1])
            run.timed("small angles", _core.scattered_once, table, into, out, cosine, sine, phase, 1)
            radiance[t, i, o] += (phase[0, 0] @ problem.columns.T) / (4.0 * np.pi)


@dataclass(frozen=True)
class Beam:
    """The beam at the top of a layer, for a unit one at the top of the scene: ``direct``, never scattered, exp(-x);
    ``degrees`` E_l (l, block, 2, 2)."""

    direct: float
    degrees: Array


def spread_beams(scene: Scene, spread: list[Spreading], mu0: float) -> list[Beam]:
    """The beam at the top of every layer."""
    terms = spread[0].mean.shape[0]
    beams = [Beam(1.0, np.broadcast_to(np.eye(2), (terms, 2, 2, 2)))]
    for layer, here in zip(scene.layers[:-1], spread[:-1], strict=True):
        passed = spread_through(here, layer.albedo, layer.thickness / mu0)
        beams.append(Beam(beams[-1].direct * float(np.exp(-layer.thickness / mu0)), passed @ beams[-1].degrees))
    return beams


def spread_through(spread: Spreading, albedo: float, path: float) -> Array:
    """E_l of a layer, ``path`` its optical thickness along the beam: (l, block, 2, 2)."""
    return spread.function(lambda s: np.exp((albedo * s - 1.0) * path))


@dataclass(frozen=True, eq=False)
class Ray:
    """The part of layer ``layer`` that light at level ``level``, in the direction ``mu`` (> 0: up), comes through."""

    problem: Problem
    level: int
    layer: int
    mu: float

    @property
    def top(self) -> float:
        """Where the part begins, below the top of the layer."""
        return self._level if self.mu > 0.0 and self._here else 0.0

    @property
    def length(self) -> float:
        """Optical depth of the part, 0 for none."""
        at, thickness = int(self.problem.level_layer[self.level]), float(self.problem.thickness[self.layer])
        if self._here:
            return thickness - self._level if self.mu > 0.0 else self._level
        return thickness if (self.layer > at) == (self.mu > 0.0) else 0.0

    @property
    def _here(self) -> bool:
        return int(self.problem.level_layer[self.level]) == self.layer

    @property
    def _level(self) -> float:
        return float(self.problem.level[self.level])

    def integral(self, rate: Any) -> Any:
        """Of exp(-rate t) exp(-|t - tau|/|mu|) dt/|mu| over the part, t from the layer's top, both depths of the
        truncated layers.

        ``rate``: any shape, complex, real part >= 0.
        """
        mu, length = abs(self.mu), self.length
        way = np.exp(-distance(self.problem, self.level, self.layer) / mu)
        if self.mu < 0.0:
            return way * (length / mu) * exp_difference(-length * rate, -length / mu)
        reach = -np.expm1(-length * (rate + 1.0 / mu)) if np.isfinite(length) else 1.0
        return way * np.exp(-self.top * rate) * reach / (1.0 + mu * rate)


def exp_difference(a: Any, b: float) -> Any:
    """(e^a - e^b)/(a - b) for complex a of any shape, e^b where they meet; real parts <= 0."""
    gap = a - b
    small = np.abs(gap) < SMALL
    # the larger one in front: expm1 of what does not grow
    ahead = np.where(gap.real > 0.0, a, b)
    turned = np.where(gap.real > 0.0, -gap, gap)
    slope = np.where(small, 1.0 + turned / 2.0 + turned**2 / 6.0, np.expm1(turned) / np.where(small, 1.0, turned))
    return np.exp(ahead) * slope


def source(scene: Scene, layer: Truncated, spread: Spreading, beam: Beam, mu0: float, ray: Ray, scalar: bool) -> Array:
    """The expansion coefficients (terms, 6), columns a1 .. b2, of the light that one scattering of the anisotropic part
    in one layer sends along the ray: the formula on top, integrated."""
    matrix, albedo = scene.layers[ray.layer].phase_matrix, scene.layers[ray.layer].albedo
    terms, carried, f = spread.mean.shape[0], ray.problem.coefficients.shape[1], layer.fraction
    per_depth = 1.0 / (layer.stretch * mu0)
    forward = peak(terms)
    table = f * beam.direct * complex(ray.integral(complex(per_depth))).real * forward
    fade = np.exp(-ray.problem.above[ray.layer] / mu0) * complex(ray.integral(complex(1.0 / mu0))).real
    known = min(carried, matrix.terms)
    table[:carried] -= fade * f * forward[:carried]
    table[:known] += fade * matrix.coefficients[:known]
    if carried < terms:
        beyond = Spreading(spread.mean[carried:], spread.shape[carried:], spread.root[carried:])
        blocks = beyond.function(lambda s: (s - f) * ray.integral((1.0 - albedo * s) * per_depth))
        table[carried:] += coefficients(blocks @ beam.degrees[carried:], carried)
    if scalar:
        table[:, 1:] = 0.0
    return layer.gain * table


def coefficients(blocks: Array, first: int) -> Array:
    """Columns a1 .. b2 (l, 6) of matrices (l, block, 2, 2) of the degrees from ``first``, which is 2 at least."""
    plus, minus = blocks[..., 0, 1] + blocks[..., 1, 0], blocks[..., 0, 1] - blocks[..., 1, 0]
    diagonal = np.diagonal(blocks, axis1=-2, axis2=-1)
    columns = np.stack([*diagonal.reshape(-1, 4).T, 0.5 * plus[:, 0], 0.5 * minus[:, 1]], axis=1)
    return (2.0 * np.arange(first, first + blocks.shape[0]) + 1.0)[:, None] * columns
