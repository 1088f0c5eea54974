"""A slab over black ground by partial fractions of tanh: light at its faces, for phase matrices of few terms."""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.linalg

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.phase_assembly import Assembled
from vrte.discrete_ordinates.orders.problem import Problem

STEEPEST = 8192.0  # half a thickness over the lowest mu, up to which fractions are found to FINEST in doubles
FINEST = 1e-9  # accuracy that they are taken for; they are right to a tenth of it
PLACES_A_FACTOR = 60  # places a factor of two in x, where the fractions are fitted
LOWEST = 1e-2  # of them
EXACT = ((np.arange(2) + 0.5) * np.pi) ** 2  # the lowest poles, which are those of tanh itself
SETTLED = 1e-3  # of the accuracy asked for: what moments of the light of an order may be off by


@dataclass(frozen=True, eq=False)
class Tangent:
    """tanh(x)/x = constant + sum share/(x^2 + place), all positive; ``place``, ``share`` (pole,)."""

    place: Array
    share: Array
    constant: float


def find_tangent(largest: float) -> Tangent:
    """The fractions for x up to ``largest``, one set a factor of two. Raises AccuracyError beyond STEEPEST."""
    if not largest <= STEEPEST:
        raise AccuracyError(f"partial fractions are for slabs of at most {STEEPEST:g} half thicknesses over mu")
    return fit_tangent(2.0 ** max(2, math.ceil(math.log2(largest))))


@cache
def fit_tangent(largest: float) -> Tangent:
    """By the AAA algorithm, beside the lowest poles: rational interpolation where the error is largest, with the
    smallest singular vector as weights; poles by an eigenproblem, shares by least squares."""
    x = np.geomspace(LOWEST, largest, PLACES_A_FACTOR * math.ceil(math.log2(largest / LOWEST)))
    square, whole = (x / largest) ** 2, np.tanh(x) / x
    wanted = whole - (2.0 / np.add.outer(x * x, EXACT)).sum(axis=1)
    chosen: list[int] = []
    weights = np.ones(0)
    found = np.full_like(wanted, wanted.mean())
    while True:
        error = np.abs(found - wanted) / whole
        if error.max() < 0.1 * FINEST:
            break
        chosen.append(int(np.argmax(error)))
        left = np.setdiff1d(np.arange(x.size), chosen)
        cauchy = 1.0 / np.subtract.outer(square[left], square[chosen])
        gaps = np.subtract.outer(wanted[left], wanted[chosen]) * cauchy / whole[left, None]
        weights = np.linalg.svd(gaps, full_matrices=False)[2][-1]
        found = wanted.copy()
        found[left] = (cauchy @ (weights * wanted[chosen])) / (cauchy @ weights)
    count = len(chosen) + 1
    arrow, ones = np.zeros((count, count)), np.eye(count)
    arrow[0, 1:], arrow[1:, 0], ones[0, 0] = weights, 1.0, 0.0
    arrow[1:, 1:] = np.diag(square[chosen])
    roots = np.asarray(scipy.linalg.eigvals(arrow, ones).real, float)
    place: Array = np.concatenate([EXACT / largest**2, np.sort(-1.0 * roots[np.isfinite(roots)])])
    columns = np.hstack([1.0 / np.add.outer(square, place), np.ones((x.size, 1))]) / whole[:, None]
    lengths = np.linalg.norm(columns, axis=0)
    shares = np.linalg.lstsq(columns / lengths, np.ones(x.size), rcond=None)[0] / lengths
    return Tangent(place * largest**2, shares[:-1] * largest**2, float(shares[-1]))


@dataclass(frozen=True, eq=False)
class Faces:
    """Light that leaves slabs, up at the top and down at the bottom: ``out`` (order, scene, 2, n_rhs, S n_out), times
    2 pi for a unit beam, ``on_nodes`` (order, scene, 2, n_rhs, n), times sqrt(weight mu); residual (order, scene)."""

    out: Array
    on_nodes: Array
    residual: Array


def prepare_faces(problem: Problem, orders: IntArray) -> tuple[Faces, Tangent, IntArray]:
    """Room for what is found, the fractions, and info (order, scene)."""
    shape, n_rhs = (orders.size, problem.albedo.size), problem.n_rhs
    faces = Faces(
        out=np.empty((*shape, 2, n_rhs, problem.rows_out)),
        on_nodes=np.empty((*shape, 2, n_rhs, problem.size)),
        residual=np.empty(shape),
    )
    tangent = find_tangent(0.5 * float(problem.thickness.max()) / float(problem.directions.min()))
    return faces, tangent, np.zeros(shape, np.int32)


def reflect_by_fractions(problem: Problem, orders: IntArray, matrices: Assembled, run: Run) -> Faces:
    """Both faces of every layer, each a scene by itself. Raises AccuracyError where a system is singular."""
    faces, tangent, info = prepare_faces(problem, orders)
    with run.timed("fractions") as crew:
        _core.reflect_by_fractions(
            crew,
            orders=orders,
            members=np.array(problem.stokes, np.int32),
            coefficients=problem.coefficients,
            terms=problem.terms,
            albedo=problem.albedo,
            thickness=problem.thickness,
            directions=problem.directions,
            weights=problem.weights,
            n_out=problem.mu_out.size,
            columns=problem.columns,
            place=tangent.place,
            share=tangent.share,
            constant=tangent.constant,
            E=matrices.E,
            F=matrices.F,
            G_E=matrices.G_E,
            G_F=matrices.G_F,
            source_s=matrices.source_s,
            source_d=matrices.source_d,
            out=faces.out,
            on_nodes=faces.on_nodes,
            residual=faces.residual,
            info=info,
        )
    if info.any():
        raise AccuracyError(f"a system of the fractions of order {orders[np.argwhere(info)[0][0]]} is singular")
    return faces


def scatter_by_fractions(problem: Problem, orders: IntArray, accuracy: float, run: Run) -> Faces:
    """The same for a few beams, without matrices. Raises AccuracyError where scatterings do not settle."""
    faces, tangent, info = prepare_faces(problem, orders)
    with run.timed("fractions") as crew:
        _core.scatter_by_fractions(
            crew,
            orders=orders,
            members=np.array(problem.stokes, np.int32),
            coefficients=problem.coefficients,
            terms=problem.terms,
            albedo=problem.albedo,
            thickness=problem.thickness,
            directions=problem.directions,
            weights=problem.weights,
            n_out=problem.mu_out.size,
            columns=problem.columns,
            place=tangent.place,
            share=tangent.share,
            constant=tangent.constant,
            tolerance=SETTLED * accuracy,
            out=faces.out,
            on_nodes=faces.on_nodes,
            residual=faces.residual,
            info=info,
        )
    if info.any():
        raise AccuracyError(f"scatterings of order {orders[np.argwhere(info)[0][0]]} do not settle")
    return faces


def find_face_kernels(problem: Problem, faces: Faces) -> Array:
    """(order, n_tau, n_in, n_col, n_out, S): radiance at levels that are faces of the one layer, public frame."""
    found = faces.out[:, 0].reshape(
        len(faces.out), 2, problem.mu0.size, len(problem.columns), problem.mu_out.size, len(problem.stokes)
    )
    kernels = np.zeros((found.shape[0], problem.level.size, *found.shape[2:]))
    top, up = np.asarray(problem.level == 0.0), problem.n_up
    kernels[:, top, ..., :up, :] = found[:, :1, ..., :up, :] * (problem.flip / (2.0 * np.pi))
    kernels[:, ~top, ..., up:, :] = found[:, 1:, ..., up:, :] / (2.0 * np.pi)
    return kernels


def find_face_fluxes(problem: Problem, orders: IntArray, faces: Faces) -> tuple[Array, Array]:
    """Diffuse flux up and down at the levels, (n_tau, n_in, n_col); 0 without order 0."""
    shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
    up, down = np.zeros(shape), np.zeros(shape)
    if problem.conserves and orders[0] == 0:
        weight = np.sqrt(problem.weights * problem.nodes)
        flux = (faces.on_nodes[0, 0, :, :, :: len(problem.stokes)] @ weight).reshape(2, *shape[1:])
        top = problem.level == 0.0
        up[top], down[~top] = flux[0], flux[1]
    return up, down
