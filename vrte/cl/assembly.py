"""Spherical functions, phase matrices, and E and F of (1:41) with the rows and columns that lead out of and into the
nodes, on a device: `_core.generalized_spherical_functions`, `phase_matrices` and `assemble` for all items at once.

An item is a Fourier order and a material, ``order[item]`` and ``material[item]`` on the device; materials have
``coefficients`` (material, term, 6), ``terms`` and ``albedo`` (material,). ``members``: places of Stokes parameters.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vrte import _core
from vrte.basics.arrays import Array, IntArray
from vrte.basics.running import Crew
from vrte.cl.matrices import GROUP, STRIP, TILE, Stack, download_stack, padded
from vrte.cl.session import Session

DIRECTIONS_A_PIECE = 10  # on a processor, where a piece of work must last some microseconds; 1 elsewhere
STRIPS_A_PIECE = 8
STRIPS_TOGETHER = 10  # of a product: they share what is read of the other factor
LANES = 32  # work-items of a work-group on a GPU, where pieces are small


@dataclass(frozen=True, eq=False)
class Scattering:
    """What scatters in each item, on the device: the listed items; order, material (item,); coefficients (material,
    term, 6); terms, albedo (material,); and the members of the Stokes vector, on the host."""

    items: Any
    order: Any
    material: Any
    members: tuple[int, ...]
    coefficients: Any
    terms: Any
    albedo: Any

    @property
    def stokes(self) -> int:
        """S."""
        return len(self.members)

    @property
    def bits(self) -> np.int32:
        """The members as a number."""
        return np.int32(sum(1 << member for member in self.members))

    @property
    def room(self) -> int:
        """Items that there is room for."""
        return int(self.order.size)

    @property
    def n_term(self) -> int:
        """Degrees that there is room for."""
        return int(self.coefficients.shape[1])


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of P_l^m, all degrees: phi (rows, columns), E's and behind them F's; counts (item, 2): how many.
    Rows: the nodes', times sqrt(weight/mu), from ``starts[1]`` on the next directions', from ``starts[2]`` on the last.
    """

    phi: Stack
    counts: Any
    starts: tuple[int, int, int]

    def rows(self, part: int, rows: int) -> Stack:
        """phi on the nodes (0), on the next (1) or on the last directions (2)."""
        return self.phi.part(self.starts[part], 0, rows, self.phi.columns)


@dataclass(frozen=True, eq=False)
class Assembled:
    """E, F (n, n); G_E, G_F (S n_out, n); source_s, source_d (n, S n_in): stacks of an item's matrices, as the columns
    that `_core.assemble` leaves."""

    E: Stack
    F: Stack
    G_E: Stack
    G_F: Stack
    source_s: Stack
    source_d: Stack


def pieces(session: Session, size: int, each: int) -> tuple[int, int, int]:
    """How many pieces of how much, and how many of them make a work-group: on a CPU few, each longer."""
    if session.form == "cpu":
        return -(-size // each), each, 1
    return -(-size // LANES) * LANES, 1, LANES


def bare_stack(session: Session, items: int, rows: int, columns: int) -> Stack:
    """Matrices yet to be written, the rows up to the next multiple of 8 too."""
    ld, columns = padded(max(rows, 1)), max(columns, 1)
    return Stack(session.empty((items, columns, ld)), rows, columns, ld, columns * ld)


def most_columns(members: Sequence[int], n_term: int) -> int:
    """Columns that E and F of any order have together, at most.

    >>> most_columns((0, 1, 2, 3), 80)
    320
    """
    alone, polar = len({0, 3} & set(members)), len({1, 2} & set(members))
    return max(n_term * (alone + polar), (n_term - 1) * (alone + 2 * min(polar, 1)))


def wigner_factors(session: Session, items: Any, order: Any, n_term: int) -> Any:
    """What the recurrence over degrees needs of an order, (item, n_term + 1, 4)."""
    factors = session.empty((order.size, n_term + 1, 4))
    session.launch("wigner_factors", (items.size,), np.int32(n_term), order, factors, items)
    return factors


def spherical(session: Session, items: Any, order: Any, n_term: int, mu: Any) -> Any:
    """p, r, t of `_core.generalized_spherical_functions` of the listed items, (item, n_term, 3, n_mu); mu (n_mu,)."""
    out = session.empty((order.size, n_term, 3, mu.size))
    number, each, group = pieces(session, mu.size, DIRECTIONS_A_PIECE)
    session.launch(
        "spherical",
        (number, items.size),
        *(np.int32(n_term), np.int32(mu.size), np.int32(each)),
        *(mu, order, wigner_factors(session, items, order, n_term), out, items),
        group=(group, 1),
    )
    return out


def parity_columns(session: Session, what: Scattering, directions: Any, weights: Any, n_out: int) -> Columns:
    """The columns of P_l^m on the nodes (as many as weights), the next ``n_out`` directions, and the rest."""
    n_node, n_all, n_term = weights.size, directions.size, what.n_term
    second = padded(what.stokes * n_node)
    third = second + padded(what.stokes * n_out)
    rows, columns = third + padded(what.stokes * (n_all - n_node - n_out)), most_columns(what.members, n_term)
    phi, counts = bare_stack(session, what.room, rows, columns), session.empty((what.room, 2), np.int32)
    number, each, group = pieces(session, n_all, DIRECTIONS_A_PIECE)
    session.launch(
        "parity_columns",
        (number, what.items.size),
        *(np.int32(size) for size in (n_term, n_all, n_node, n_out, each)),
        *(what.bits, directions, weights, what.order, what.material, what.terms, what.albedo),
        *(wigner_factors(session, what.items, what.order, n_term), phi.data, np.int32(phi.ld), np.int64(phi.stride)),
        *(counts, what.items),
        group=(group, 1),
    )
    return Columns(phi, counts, (0, second, third))


def times_coefficients(
    session: Session, what: Scattering, counts: Any, phi: Stack, psi: Stack, v_sign: float = 1.0, odd_sign: float = 1.0
) -> None:
    """psi = albedo phi B^T; V's column of phi counts v_sign times, F's columns odd_sign times."""
    strips = padded(phi.rows) // STRIP
    number, each, group = pieces(session, strips, STRIPS_A_PIECE)
    session.launch(
        "times_coefficients",
        (number, what.items.size),
        *(np.int32(what.n_term), np.int32(strips), np.int32(each), what.bits, np.float64(v_sign), np.float64(odd_sign)),
        *(what.coefficients, what.order, what.material, what.terms, what.albedo, counts),
        *(*phi.place, *psi.place, what.items),
        group=(group, 1),
    )


def tiles_of(rows: int, columns: int) -> tuple[int, int]:
    """Work-items for the tiles of a matrix.

    >>> tiles_of(160, 80)
    (48, 32)
    """
    return -(-rows // TILE) * GROUP, -(-columns // TILE) * GROUP


def product_over_columns(
    session: Session,
    items: Any,
    counts: Any,
    part: int,
    a: Stack,
    b: Stack,
    c: Stack,
    alpha: float = 1.0,
    beta: float = 0.0,
) -> None:
    """c = alpha a b^T + beta c over the columns of a and b that are E's (part 0), F's (1) or either's (2)."""
    rows = padded(c.rows)
    sums = np.int32(c.columns), np.int32(part), np.float64(alpha), np.float64(beta)
    arguments = *sums, counts, *a.place, *b.place, *c.place, items
    if session.form == "cpu":
        number, each, _ = pieces(session, rows // STRIP, STRIPS_TOGETHER)
        session.launch(
            "product_over_columns", (number, 1, items.size), np.int32(rows // STRIP), np.int32(each), *arguments
        )
    else:
        tiles = (*tiles_of(rows, c.columns), items.size)
        session.launch("product_over_columns_gpu", tiles, np.int32(rows), *arguments, group=(GROUP, GROUP, 1))


def assemble(
    session: Session,
    items: Any,
    order: Any,
    material: Any,
    members: Sequence[int],
    coefficients: Any,
    terms: Any,
    albedo: Any,
    directions: Any,
    weights: Any,
    n_out: int,
) -> Assembled:
    """E and F of (1:41), what leads out of the nodes and the beam's sources, for the listed items.

    directions: nodes, then n_out outgoing, then incident cosines; weights (N,). Enqueues only."""
    what = Scattering(items, order, material, tuple(members), coefficients, terms, albedo)
    n_in = directions.size - weights.size - n_out
    n, out, into = (what.stokes * number for number in (weights.size, n_out, n_in))
    columns = parity_columns(session, what, directions, weights, n_out)
    psi, psi_in = (bare_stack(session, what.room, rows, columns.phi.columns) for rows in (n, into))
    times_coefficients(session, what, columns.counts, columns.rows(0, n), psi)
    if into:
        times_coefficients(session, what, columns.counts, columns.rows(2, into), psi_in)
    shapes = [(n, n), (n, n), (out, n), (out, n), (n, into), (n, into)]
    made = Assembled(*(bare_stack(session, what.room, *shape) for shape in shapes))
    multiply = products_at_once if session.form == "cpu" else products_by_kind
    multiply(session, what, directions, columns, psi, psi_in, made)
    return made


def products_at_once(
    session: Session, what: Scattering, mu: Any, columns: Columns, psi: Stack, psi_in: Stack, made: Assembled
) -> None:
    """All products of an item by work-items that follow each other: its factors stay in the cache."""
    phi, E, G, source = columns.phi, made.E, made.G_E, made.source_d
    n, out, into, each = E.rows, G.rows, psi_in.rows, STRIPS_TOGETHER
    pieces_of_rows = sum(-(-padded(rows) // (STRIP * each)) for rows in (n, out))
    session.launch(
        "assembly_products",
        (2 * pieces_of_rows, what.items.size),
        *(np.int32(size) for size in (n, out, into, columns.starts[1], what.stokes, each)),
        *(mu, columns.counts),
        *(value for stack in (phi, psi, psi_in) for value in (stack.data, np.int32(stack.ld), np.int64(stack.stride))),
        *(E.data, made.F.data, np.int32(E.ld), np.int64(E.stride)),
        *(G.data, made.G_F.data, np.int32(G.ld), np.int64(G.stride)),
        *(source.data, made.source_s.data, np.int32(source.ld), np.int64(source.stride)),
        what.items,
    )


def products_by_kind(
    session: Session, what: Scattering, mu: Any, columns: Columns, psi: Stack, psi_in: Stack, made: Assembled
) -> None:
    """One product of all items after the other."""
    items, counts, n, out = what.items, columns.counts, made.E.rows, made.G_E.rows
    phi, phi_out = columns.rows(0, n), columns.rows(1, out)
    for part, matrix, leading_out, source in [
        (0, made.E, made.G_E, made.source_d),
        (1, made.F, made.G_F, made.source_s),
    ]:
        product_over_columns(session, items, counts, part, phi, psi, matrix, alpha=-1.0)
        product_over_columns(session, items, counts, part, phi_out, psi, leading_out)
        if psi_in.rows:
            product_over_columns(session, items, counts, part, phi, psi_in, source)
    session.launch(
        "add_rates",
        (items.size,),
        *(np.int32(n), np.int32(what.stokes), mu, made.E.data, made.F.data),
        *(np.int32(made.E.ld), np.int64(made.E.stride), items),
    )


def generalized_spherical_functions(session: Session, m: int, terms: int, mu: ArrayLike) -> Array:
    """As `_core.generalized_spherical_functions`: (terms, n_mu, 3)."""
    cosines = np.atleast_1d(np.asarray(mu, float))
    if m < 0 or terms < 1 or not np.all(np.abs(cosines) <= 1.0) or cosines.size == 0:
        return _core.generalized_spherical_functions(m, terms, cosines)  # it says what is wrong
    one = session.constant(np.zeros(1, np.int32))
    order = session.constant(np.full(1, m, np.int32))
    found = session.download(spherical(session, one, order, terms, session.upload(cosines)))
    return np.ascontiguousarray(found[0].transpose(0, 2, 1))


def assemble_arrays(
    session: Session,
    crew: Crew,
    *,
    orders: IntArray,
    members: IntArray,
    coefficients: Array,
    terms: IntArray,
    albedo: Array,
    directions: Array,
    weights: Array,
    n_out: int,
    E: Array,
    F: Array,
    G_E: Array,
    G_F: Array,
    source_s: Array,
    source_d: Array,
) -> None:
    """As `_core.assemble`: fills E, F, G_E, G_F, source_s and source_d."""
    start = time.perf_counter()
    order, material = np.meshgrid(orders, np.arange(terms.size, dtype=np.int32), indexing="ij")
    upload = session.constant
    if order.size and not crew.stop[0]:
        items = upload(np.arange(order.size, dtype=np.int32))
        pairs = items, upload(order.ravel()), upload(material.ravel())
        materials = upload(coefficients), upload(terms), upload(albedo)
        cosines = upload(directions), upload(weights), n_out
        made = assemble(session, *pairs, members.tolist(), *materials, *cosines)
        targets = [(made.E, E), (made.F, F), (made.G_E, G_E), (made.G_F, G_F)]
        for stack, array in [*targets, (made.source_s, source_s), (made.source_d, source_d)]:
            if array.size:
                array[...] = download_stack(session, stack).reshape(array.shape)
    crew.seconds[0] += time.perf_counter() - start


def phase_matrices(session: Session, m: int, coefficients: ArrayLike, mu: ArrayLike, mu_from: ArrayLike) -> Array:
    """As `_core.phase_matrices`: A^m(mu, mu_from) of (1:9), (n, k, 4, 4), cosines positive downward."""
    table = np.ascontiguousarray(coefficients, dtype=float)
    to, frm = (np.atleast_1d(np.asarray(cosines, float)) for cosines in (mu, mu_from))
    both = np.concatenate([to, frm])
    if table.ndim != 2 or table.shape[1] != 6 or m < 0 or not np.all(np.abs(both) <= 1.0):
        return _core.phase_matrices(m, table, to, frm)  # it says what is wrong
    if 0 in (to.size, frm.size, table.shape[0]):
        return np.zeros((to.size, frm.size, 4, 4))
    upload, zero = session.constant, session.constant(np.zeros(1, np.int32))
    one = np.ones(1)
    materials = upload(table[np.newaxis]), upload(np.array([table.shape[0]], np.int32)), upload(one)
    what = Scattering(zero, upload(np.full(1, m, np.int32)), zero, (0, 1, 2, 3), *materials)
    # a node that is not asked for: there has to be one
    columns = parity_columns(session, what, upload(np.concatenate([one, both])), upload(one), to.size)
    phi, phi_from = columns.rows(1, 4 * to.size), columns.rows(2, 4 * frm.size)
    psi, found = (bare_stack(session, 1, 4 * frm.size, phi.columns), bare_stack(session, 1, 4 * to.size, 4 * frm.size))
    times_coefficients(session, what, columns.counts, phi_from, psi)
    product_over_columns(session, zero, columns.counts, 2, phi, psi, found)
    flat = download_stack(session, found)[0].T
    return np.ascontiguousarray(flat.reshape(to.size, 4, frm.size, 4).transpose(0, 2, 1, 3))
