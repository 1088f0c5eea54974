"""Section 3.C.1, base reflection: what the boundary below sends back, order by order, as the stages take it."""

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from vrte.basics.arrays import Array, IntArray, make_readonly, record
from vrte.basics.errors import AccuracyError, AccuracyWarning, warn_user
from vrte.basics.polarization import FLIP
from vrte.basics.quadrature import make_refracted_nodes
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.rough import reflect_off_facets
from vrte.scene.azimuths import ConvergenceError
from vrte.scene.boundary import Boundary

MOST_NUMBERS = 10_000  # of a black base that is kept
SHARE = 0.1  # fraction of the requested accuracy for the Fourier integrals of a base
DEFAULT_ACCURACY = 1e-9  # accuracy of these integrals under methods without an accuracy of their own
FINEST = 1e-12  # relative error of a base's Fourier integrals that is always allowed
ROUNDING = 1e-13  # rounding error of R^m, relative
LARGEST_ERROR = 1e-3  # error of light by integrals that do not converge, beyond which the solve is refused


@record
class Base:
    """What the base does, order by order, in the scaled and flipped frame.

    row (order,): row of the arrays, -1 for orders it does not reflect; matrix (row, n, n), source (row, n_rhs, n),
    out (row, n, S n_out): all (column, row); azimuths: samples the Fourier integrals took; is_black: no row is used.
    """

    row: IntArray
    matrix: Array
    source: Array
    out: Array
    azimuths: int = 0
    is_black: bool = False

    @property
    def arguments(self) -> dict[str, Array]:
        """Its operators, as the core takes them."""
        return {"base": self.matrix, "base_source": self.source, "base_out": self.out}

    def find_rows(self, orders: IntArray, slab_stack: IntArray) -> IntArray:
        """The row of each item (item,): of ``orders`` of the scenes ``slab_stack``."""
        return self.row[orders]


class BaseOfScenes(Base):
    """The same of the even bases of many scenes: row (scene,): that of each scene in order 0."""

    def find_rows(self, orders: IntArray, slab_stack: IntArray) -> IntArray:
        return np.where(orders == 0, self.row[slab_stack], -1).astype(np.int32)


@dataclass(frozen=True)
class EvenBases(Boundary):
    """What bounds many scenes below, evenly each of them."""

    members: tuple[Boundary, ...] = ()

    @property
    def albedos(self) -> Array:
        """Of each scene, (scene,)."""
        return np.array([member.even_albedo for member in self.members])


def make_black_base(problem: Problem, n_order: int) -> Base:
    """No reflection at any order."""
    sizes = count_base_rows(problem, n_order), problem.size, problem.n_rhs, problem.rows_out
    make = make_zero_base if sizes[0] * sizes[1] * sum(sizes[1:]) < MOST_NUMBERS else make_zero_base.__wrapped__
    return make(n_order, *sizes)


@lru_cache(maxsize=32)
def make_zero_base(n_order: int, rows: int, n: int, n_rhs: int, rows_out: int) -> Base:
    """The same of so many rows, made once where it is small."""
    empty = make_readonly(np.zeros((rows, n, n))), make_readonly(np.zeros((rows, n_rhs, n)))
    row = np.arange(n_order, dtype=np.int32) if rows > 1 else np.full(n_order, -1, np.int32)
    return Base(row, *empty, make_readonly(np.zeros((rows, n, rows_out))), is_black=rows == 1)


def count_base_rows(problem: Problem, n_order: int) -> int:
    """Orders of a base that reflects order 0 at most: one, unless those that are zero shall not be left out."""
    return 1 if problem.skip_flags.base or np.isinf(problem.thickness[-1]) else max(n_order, 2)


def expand_base(boundary: Boundary, problem: Problem, n_order: int, accuracy: float = DEFAULT_ACCURACY) -> Base:
    """The base's operators for the orders 0 .. n_order - 1; ``accuracy``: relative, of the light they lead to."""
    if isinstance(boundary, EvenBases):
        albedos = boundary.albedos
        sends = problem.conserves and albedos.any()
        return expand_even_bases(albedos, problem) if sends else make_black_base(problem, n_order)
    if not boundary.orders_reflected or not (boundary.mixes_stokes or problem.conserves):
        return make_black_base(problem, n_order)
    orders, azimuths = find_reflected_orders(boundary, problem, n_order, accuracy)
    if not boundary.mixes_stokes and (more := count_base_rows(problem, n_order) - orders.shape[0]) > 0:
        orders = np.concatenate([orders, np.zeros((more, *orders.shape[1:]))])
    row = np.where(np.arange(n_order) < orders.shape[0], np.arange(n_order), -1).astype(np.int32)
    members = list(problem.stokes)
    orders = (FLIP[:, None] * orders)[..., members, :][..., members]
    return Base(row, *make_base_operators(problem, orders), azimuths)


def expand_even_bases(albedo: Array, problem: Problem) -> BaseOfScenes:
    """What each scene's even base (scene,) does in order 0, a row each."""
    into, out, stokes = problem.nodes.size + problem.mu0.size, problem.nodes.size + problem.mu_out.size, problem.stokes
    orders = np.zeros((albedo.size, into, out, len(stokes), len(stokes)))
    orders[..., 0, 0] = FLIP[0] * (2.0 * albedo[:, None, None])
    row = np.where(albedo > 0.0, np.arange(albedo.size), -1).astype(np.int32)
    return BaseOfScenes(row, *make_base_operators(problem, orders))


def make_base_operators(problem: Problem, orders: Array) -> tuple[Array, Array, Array]:
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


def find_reflected_orders(
    boundary: Boundary, problem: Problem, n_order: int, accuracy: float = DEFAULT_ACCURACY
) -> tuple[Array, int]:
    """R^m of (1:35), (order, in, out, 4, 4), and the most azimuths it took.

    In: nodes, then beams; out: nodes, then outgoing directions; nothing from beams to outgoing directions, which light
    scattered once leads to in closed form.
    """
    n_node = problem.nodes.size
    if boundary.facets is not None:
        index = boundary.facets.index_from
        nodes = make_refracted_nodes([index], n_node, problem.grading) if problem.media is None else problem.media.nodes
        best = max(SHARE * accuracy, FINEST)
        return reflect_off_facets(boundary.facets, nodes, problem.mu0, problem.mu_out, n_order, best), 0
    into, out = np.concatenate([problem.nodes, problem.mu0]), np.concatenate([problem.nodes, problem.mu_out])
    pairs = (np.arange(into.size) < n_node)[:, None] | (np.arange(out.size) < n_node)
    allowed = partial(find_allowed_errors, problem, accuracy)
    try:
        return boundary.reflect_orders(into, out, pairs, n_order, allowed)
    except ConvergenceError as error:
        reached = error.excess * max(SHARE * accuracy, FINEST)
        words = f"{error} at accuracy {accuracy:g}"
        if reached > LARGEST_ERROR:
            raise AccuracyError(f"{words}: ask for a coarser one, or give a smoother function") from None
        warn_user(f"{words}: what the base adds to light has the accuracy {reached:.1g}", AccuracyWarning)
        return error.found


def find_allowed_errors(problem: Problem, accuracy: float, size: Array) -> Array:
    """How far each R^m may be off, (in, out), where ``size`` (in, out) is its largest element.

    Errors are weighted as the operators are, by sqrt(weight mu) of a node. Those of all pairs together are a fraction
    of the accuracy times the operator: of the operator between the nodes as a whole, of each beam by itself, of the
    outgoing directions as the brightest of them.
    """
    n_node, scale = problem.nodes.size, np.sqrt(problem.weights * problem.nodes)
    into = np.concatenate([scale, np.ones(size.shape[0] - n_node)])[:, None]
    out = np.concatenate([scale, np.ones(size.shape[1] - n_node)])
    weighted = (size * into * out) ** 2
    strength = np.zeros_like(size)
    strength[:n_node, :n_node] = weighted[:n_node, :n_node].sum() / n_node**2
    strength[n_node:, :n_node] = weighted[n_node:, :n_node].sum(axis=1, keepdims=True) / n_node
    strength[:n_node, n_node:] = weighted[:n_node, n_node:].sum(axis=0).max(initial=0.0) / n_node
    fraction: Array = max(SHARE * accuracy, FINEST) * np.sqrt(strength) / (into * out)
    return fraction + ROUNDING * size
