"""Section 3.C.1, base reflection: the Fourier orders of the base's Mueller BRDF, R^m of (1:35)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.polarization import FLIP
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.scene.scene import Lambertian, MuellerBase, azimuth_rule

SHARE = 0.1  # of the accuracy asked for, that the Fourier integrals of a base may use up
UNTOLD = 1e-9  # accuracy of methods that are not asked for one
FINEST = 1e-12  # relative error that is always allowed
ROUNDING = 1e-13  # of R^m itself
FEWEST_AZIMUTHS, MOST_AZIMUTHS = 32, 1 << 13  # from 0 to 180 degrees
SAMPLES_AT_ONCE = 1 << 16  # of 4 x 4 numbers


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


def expand_base(
    base: Lambertian | MuellerBase | None, problem: Problem, n_order: int, accuracy: float = UNTOLD
) -> Base:
    """The base's operators for the orders 0 .. n_order - 1; ``accuracy``: relative, of the light they lead to."""
    if base is None or (isinstance(base, Lambertian) and not problem.conserves):
        return black(problem, n_order)
    if isinstance(base, Lambertian):  # (1:66)
        into, out = problem.nodes.size + problem.mu0.size, problem.nodes.size + problem.mu_out.size
        orders = np.zeros((rows_beyond_flux(problem, n_order), into, out, 4, 4))
        orders[0, ..., 0, 0] = 2.0 * base.albedo
        azimuths = 0
    else:
        orders, azimuths = mueller_orders(base, problem, n_order, accuracy)
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


def mueller_orders(base: MuellerBase, problem: Problem, n_order: int, accuracy: float = UNTOLD) -> tuple[Array, int]:
    """R^m of (1:35), the integral of f with cos, sin(m phi): (n_order, in, out, 4, 4), and the most azimuths it took.

    In: nodes, then beams; out: nodes, then outgoing directions; zero from beams to outgoing directions, which light
    scattered once leads to in closed form. Each pair of directions is sampled until twice as many azimuths change it by
    less than its share of the accuracy (`allowed_errors`). Raises AccuracyError where MOST_AZIMUTHS do not settle it.
    """
    n_node = problem.nodes.size
    into, out = np.concatenate([problem.nodes, problem.mu0]), np.concatenate([problem.nodes, problem.mu_out])
    here, there = np.nonzero((np.arange(into.size) < n_node)[:, None] | (np.arange(out.size) < n_node))
    mu_i, mu_o = into[here], out[there]
    azimuths = FEWEST_AZIMUTHS
    while azimuths < n_order:
        azimuths *= 2
    before = fourier_sums(base, mu_i, mu_o, n_order, np.arange(1, azimuths), azimuths)
    found = np.zeros((n_order, into.size, out.size, 4, 4))
    left = np.arange(here.size)
    while azimuths < MOST_AZIMUTHS:
        azimuths *= 2
        between = fourier_sums(base, mu_i[left], mu_o[left], n_order, np.arange(1, azimuths, 2), azimuths)
        now = 0.5 * before + between
        found[:, here[left], there[left]] = now
        error = np.abs(now - before).max(axis=(0, 2, 3))
        allowed = allowed_errors(problem, np.abs(found).max(axis=(0, 3, 4)), accuracy)[here, there][left]
        open_ = error > allowed
        if not open_.any():
            return found, azimuths
        before, left, error, allowed = now[:, open_], left[open_], error[open_], allowed[open_]
    worst = int(np.argmax(error / allowed))
    pair = left[worst]
    raise AccuracyError(
        f"the base's azimuthal orders do not settle with {azimuths} azimuths: from mu_i {mu_i[pair]:.3g} to mu_o "
        f"{mu_o[pair]:.3g} they change by {error[worst]:.2g}, and {allowed[worst]:.2g} is allowed at accuracy "
        f"{accuracy:g}: ask for a coarser one, or give a smoother function"
    )


def allowed_errors(problem: Problem, size: Array, accuracy: float) -> Array:
    """How far each R^m may be off, (in, out), where ``size`` (in, out) is its largest element.

    Weighted as the operators are, by sqrt(weight mu) of a node, the errors of all pairs together are a share of the
    accuracy times the operator: that between the nodes as a whole, each beam's by itself, that of the outgoing
    directions as the brightest of them.
    """
    n_node, scale = problem.nodes.size, np.sqrt(problem.weights * problem.nodes)
    into = np.concatenate([scale, np.ones(size.shape[0] - n_node)])[:, None]
    out = np.concatenate([scale, np.ones(size.shape[1] - n_node)])
    weighted = (size * into * out) ** 2
    strength = np.zeros_like(size)
    strength[:n_node, :n_node] = weighted[:n_node, :n_node].sum() / n_node**2
    strength[n_node:, :n_node] = weighted[n_node:, :n_node].sum(axis=1, keepdims=True) / n_node
    strength[:n_node, n_node:] = weighted[:n_node, n_node:].sum(axis=0).max(initial=0.0) / n_node
    share: Array = max(SHARE * accuracy, FINEST) * np.sqrt(strength) / (into * out)
    return share + ROUNDING * size


def fourier_sums(
    base: MuellerBase, mu_i: Array, mu_o: Array, n_order: int, steps: NDArray[np.int64], azimuths: int
) -> Array:
    """What ``steps`` of the rule of so many azimuths add to R^m of each pair of directions, (n_order, pair, 4, 4).

    cos in the blocks (I,Q)-(I,Q) and (U,V)-(U,V), sin in (U,V)-(I,Q), -sin in (I,Q)-(U,V), as in (1:6); azimuths beyond
    180 degrees are the mirror image.
    """
    phi, weight = azimuth_rule(steps, azimuths)
    angle = np.arange(n_order)[:, None] * phi
    cosine, sine = 2.0 * weight * np.cos(angle), 2.0 * weight * np.sin(angle)
    sums = np.empty((n_order, mu_i.size, 4, 4))
    for part in np.array_split(np.arange(mu_i.size), -(-mu_i.size * steps.size // SAMPLES_AT_ONCE)):  # bounds memory
        f = base(mu_i[part], mu_o[part], np.degrees(phi)[:, None]).reshape(steps.size, -1)
        even, odd = ((matrix @ f).reshape(n_order, part.size, 4, 4) for matrix in (cosine, sine))
        even[..., 2:, :2], even[..., :2, 2:] = odd[..., 2:, :2], -odd[..., :2, 2:]
        sums[:, part] = even
    return sums
