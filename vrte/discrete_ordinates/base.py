"""Section 3.C.1, base reflection: the Fourier orders of the base's Mueller BRDF, R^m of (1:35)."""

from dataclasses import dataclass

import numpy as np

from vrte.arrays import Array
from vrte.discrete_ordinates.problem import FLIP, IntArray, Problem
from vrte.errors import AccuracyError
from vrte.scene import Lambertian, MuellerBase

SETTLED = 1e-10
MOST_AZIMUTHS = 1 << 14


@dataclass(frozen=True, eq=False)
class Base:
    """What the base does, order by order, in the scaled and flipped frame.

    row (order,): row of the arrays, -1 for orders it does not reflect; matrix (row, n, n), source (row, n_rhs, n),
    out (row, n, S n_out): all (column, row); azimuths: samples the Fourier integrals took.
    """

    row: IntArray
    matrix: Array
    source: Array
    out: Array
    azimuths: int = 0


def black(problem: Problem, n_order: int) -> Base:
    """No reflection at any order."""
    n, rows = problem.size, rows_beyond_flux(problem, n_order)
    empty = np.zeros((rows, n, n)), np.zeros((rows, problem.n_rhs, n)), np.zeros((rows, n, problem.rows_out))
    return Base(np.arange(n_order, dtype=np.int32) if rows > 1 else np.full(n_order, -1, np.int32), *empty)


def rows_beyond_flux(problem: Problem, n_order: int) -> int:
    """Orders of a base that reflects order 0 at most: one, unless those that are zero shall not be left out."""
    return 1 if problem.leave_out.base or np.isinf(problem.thickness[-1]) else max(n_order, 2)


def expand_base(base: Lambertian | MuellerBase | None, problem: Problem, n_order: int) -> Base:
    """The base's operators for the orders 0 .. n_order - 1."""
    if base is None or (isinstance(base, Lambertian) and not problem.conserves):
        return black(problem, n_order)
    into = np.concatenate([problem.nodes, problem.mu0])
    out = np.concatenate([problem.nodes, problem.mu_out])
    if isinstance(base, Lambertian):  # (1:66)
        orders = np.zeros((rows_beyond_flux(problem, n_order), into.size, out.size, 4, 4))
        orders[0, ..., 0, 0] = 2.0 * base.albedo
        azimuths = 0
    else:
        orders, azimuths = mueller_orders(base, into, out, n_order)
    row = np.where(np.arange(n_order) < orders.shape[0], np.arange(n_order), -1).astype(np.int32)
    members = list(problem.stokes)
    orders = (FLIP[:, None] * orders)[..., members, :][..., members]
    return Base(row, *operators(problem, orders), azimuths)


def operators(problem: Problem, orders: Array) -> tuple[Array, Array, Array]:
    """Matrix, source and outgoing rows from R^m (order, in, out, S, S): weights and scaling put in."""
    n_node, n_order = problem.nodes.size, orders.shape[0]
    scale = np.sqrt(problem.weights * problem.nodes)
    on_nodes = orders * np.concatenate([scale, problem.mu0])[:, None, None, None]
    to_nodes = on_nodes[:, :, :n_node] * scale[:, None, None]
    # (order, in, out, row, column) -> (order, in, column, out, row)
    matrix = to_nodes[:, :n_node].transpose(0, 1, 4, 2, 3).reshape(n_order, problem.size, problem.size)
    leaving = on_nodes[:, :n_node, n_node:].transpose(0, 1, 4, 2, 3).reshape(n_order, problem.size, -1)
    beam = np.einsum("mioab,cb->micoa", to_nodes[:, n_node:], problem.columns)
    source = beam.reshape(n_order, problem.n_rhs, problem.size)
    return np.ascontiguousarray(matrix), np.ascontiguousarray(source), np.ascontiguousarray(leaving)


def mueller_orders(base: MuellerBase, into: Array, out: Array, n_order: int) -> tuple[Array, int]:
    """R^m = integral of f over azimuth with cos, sin(m phi): (n_order, in, out, 4, 4), and the samples it took.

    The samples are doubled until nothing changes by more than 1e-10 of the largest. Raises AccuracyError where
    16384 do not settle it.
    """
    azimuths = 32
    while azimuths < 2 * n_order:
        azimuths *= 2
    before = fourier_orders(base, into, out, n_order, azimuths)
    while azimuths < MOST_AZIMUTHS:
        azimuths *= 2
        now = fourier_orders(base, into, out, n_order, azimuths)
        if np.abs(now - before).max() <= SETTLED * np.abs(now).max():
            return now, azimuths
        before = now
    raise AccuracyError(f"the base's azimuthal orders do not settle with {azimuths} samples: its lobe is too narrow")


def fourier_orders(base: MuellerBase, into: Array, out: Array, n_order: int, azimuths: int) -> Array:
    """cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V), as in (1:6)."""
    phi = np.arange(azimuths) * (360.0 / azimuths)
    orders = np.empty((n_order, into.size, out.size, 4, 4))
    for i, mu in enumerate(into):  # one incident direction at a time bounds the memory
        spectrum = np.fft.rfft(base(mu, out[:, None], phi), axis=1)[:, :n_order] * (2.0 * np.pi / azimuths)
        spectrum = spectrum.transpose(1, 0, 2, 3)
        orders[:, i] = spectrum.real
        orders[:, i, :, 2:, :2] = -spectrum.imag[..., 2:, :2]
        orders[:, i, :, :2, 2:] = spectrum.imag[..., :2, 2:]
    return orders
