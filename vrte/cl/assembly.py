"""E and F of (1:41) with the rows and columns that lead out of and into the nodes, on a device: `_core.assemble` for
all items at once, an item being a Fourier order and a material.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrte import _core
from vrte.basics.running import ThreadTeam
from vrte.cl.matrices import STRIP, Stack, download_stack, make_stack, multiply_stacks, pad_to_strips
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

DIRECTIONS_A_PIECE = 10  # directions per piece of work, or one a lane: some microseconds
DEGREES_A_PIECE = 20


@dataclass(frozen=True, eq=False)
class Scattering:
    """What scatters in each item, on the device: order, material (item,); coefficients (material, term, 6); terms,
    albedo (material,); and the members of the Stokes vector, on the host, also as the ``bits`` of a number."""

    members: tuple[int, ...]
    bits: int
    order: Any
    material: Any
    coefficients: Any
    terms: Any
    albedo: Any

    @property
    def stokes(self) -> int:
        """S."""
        return len(self.members)

    @property
    def items(self) -> int:
        """Number of items, each an order of a material."""
        return int(self.order.size)

    @property
    def n_term(self) -> int:
        """Degrees that there is room for."""
        return int(self.coefficients.shape[1])


def upload_scattering(
    session: Session, order: Any, material: Any, coefficients: Any, terms: Any, albedo: Any, members: Any
) -> Scattering:
    """What phase matrices of the host are made of, on the device."""
    places = (session.constant(np.asarray(each, np.int32)) for each in (order, material))
    materials = (session.constant(each) for each in (coefficients, terms, albedo))
    members = tuple(int(each) for each in members)
    return Scattering(members, sum(1 << member for member in members), *places, *materials)


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


def count_most_columns(members: Sequence[int], n_term: int) -> int:
    """Columns that E and F of any order have together, at most.

    >>> count_most_columns((0, 1, 2, 3), 80)
    320
    """
    alone, polar = len({0, 3} & set(members)), len({1, 2} & set(members))
    return max(n_term * (alone + polar), (n_term - 1) * (alone + 2 * min(polar, 1)))


def compute_parity_columns(session: Session, what: Scattering, directions: Any, weights: Any, n_out: int) -> Columns:
    """The columns of P_l^m on the nodes (as many as weights), the next ``n_out`` directions, and the rest; what an item
    has fewer of than others is left unwritten."""
    n_node, n_all = weights.size, directions.size
    second = pad_to_strips(what.stokes * n_node)
    third = second + pad_to_strips(what.stokes * n_out)
    rows = third + pad_to_strips(what.stokes * (n_all - n_node - n_out))
    phi = make_stack(session, what.items, rows, count_most_columns(what.members, what.n_term), bare=True)
    counts, factors = session.empty((what.items, 2), np.int32), session.empty((what.items, what.n_term + 1, 4))
    known = vars(what) | {"n_term": what.n_term, "factors": factors, "directions": directions, "weights": weights}
    session.launch("wigner_factors", (what.items,), known)
    each = max(DIRECTIONS_A_PIECE, session.lanes)
    pieces = -(-n_all // each), what.items
    session.launch("parity_columns", pieces, known, n_out=n_out, each=each, phi=phi, counts=counts)
    return Columns(phi, counts, (0, second, third))


def multiply_by_coefficients(
    session: Session, what: Scattering, counts: Any, phi: Stack, psi: Stack, v_sign: float = 1.0, odd_sign: float = 1.0
) -> None:
    """psi = albedo phi B^T; V's column of phi counts v_sign times, F's columns odd_sign times."""
    known = vars(what) | {"n_strip": pad_to_strips(phi.rows) // STRIP, "each": DEGREES_A_PIECE, "counts": counts}
    pieces = -(-what.n_term // DEGREES_A_PIECE), what.items
    session.launch("times_coefficients", pieces, known, v_sign=v_sign, odd_sign=odd_sign, phi=phi, psi=psi)


def assemble(session: Session, what: Scattering, directions: Any, weights: Any, n_out: int) -> Assembled:
    """E and F of (1:41), what leads out of the nodes and the beam's sources. Enqueues only.

    directions: nodes, then n_out outgoing, then incident cosines; weights (N,), both on the host."""
    n_in = directions.size - weights.size - n_out
    n, out, into = (what.stokes * number for number in (weights.size, n_out, n_in))
    columns = compute_parity_columns(session, what, directions, weights, n_out)
    phi, phi_out, phi_in = (columns.rows(part, rows) for part, rows in enumerate((n, out, into)))
    psi, psi_in = (make_stack(session, what.items, rows, phi.columns, bare=True) for rows in (n, into))
    for whole, product_of in ((phi, psi), (phi_in, psi_in)):
        if whole.rows:
            multiply_by_coefficients(session, what, columns.counts, whole, product_of)
    shapes = [(n, n), (n, n), (out, n), (out, n), (n, into), (n, into)]
    E, F, G_E, G_F, source_s, source_d = (make_stack(session, what.items, *shape, bare=True) for shape in shapes)
    for part, matrix, leading_out, source in ((0, E, G_E, source_d), (1, F, G_F, source_s)):
        for left, right, made, sign in (
            (phi, psi, matrix, -1.0),
            (phi_out, psi, leading_out, 1.0),
            (phi, psi_in, source, 1.0),
        ):
            if made.rows and made.columns:
                multiply_stacks(session, left, right, made, sign, 0.0, True, part, columns.counts)
    session.launch("add_rates", (what.items,), stokes=what.stokes, directions=directions, E=E, F=F)
    return Assembled(E, F, G_E, G_F, source_s, source_d)


@stand_in_for(_core.assemble)
def assemble_arrays(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills E, F, G_E, G_F, source_s and source_d."""
    order, material = np.meshgrid(given.orders, np.arange(given.terms.size), indexing="ij")
    if not order.size or crew.stop[0]:
        return
    materials = given.coefficients, given.terms, given.albedo, given.members
    what = upload_scattering(session, order.ravel(), material.ravel(), *materials)
    for name, stack in vars(assemble(session, what, given.directions, given.weights, given.n_out)).items():
        array = getattr(given, name)
        if array.size:
            array[...] = download_stack(session, stack).reshape(array.shape)
