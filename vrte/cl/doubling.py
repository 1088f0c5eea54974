"""Impedance doubling of many slabs in one call, `double_one` of core/doubling.pxi on a device."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.assembly import Assembled
from vrte.cl.matrices import make_scratch, pad_to_strips, upload_stack
from vrte.cl.session import Session
from vrte.cl.stages import stand_in_for

MATRICES = 8  # extended ones at work for each slab
DOUBLINGS = 4  # of a launch: a stop is obeyed after as many
REALS = "thickness", "albedo", "slowest", "steepest", "h", "ratio"  # of vrte_slab in core/kernels/doubling.h
INTEGERS = "source", "turned", "clear", "conservative", "left", "carried", "doublings", "singular"


@dataclass(frozen=True)
class Sizes:
    """Of extended matrices, see extended.cl: n unknowns of a hemisphere, r incident columns, o outgoing rows, S Stokes
    parameters a direction."""

    n: int
    r: int
    o: int
    stokes: int

    @property
    def p(self) -> int:
        """Where the rows of the outgoing directions begin."""
        return pad_to_strips(self.n)

    @property
    def ld(self) -> int:
        """Distance of two columns."""
        return pad_to_strips(self.p + self.o)

    @property
    def axis(self) -> int:
        """The axis that carries the flux once order 0 is turned: I of the last node."""
        return self.n - self.stokes

    @property
    def numbers(self) -> int:
        """How many numbers an extended matrix takes, padding included."""
        return pad_to_strips(self.ld * (self.n + self.r) + self.o + self.r)


@dataclass(frozen=True, eq=False)
class Frame:
    """What all slabs share: nodes, weights (N,), incident cosines mu0 (n_in,) and Stokes columns (n_col, S), outgoing
    cosines mu_out (n_out,)."""

    nodes: Array
    weights: Array
    mu0: Array
    columns: Array
    mu_out: Array

    @property
    def sizes(self) -> Sizes:
        """Of the extended matrices."""
        n_col, stokes = self.columns.shape
        return Sizes(stokes * self.nodes.size, self.mu0.size * n_col, stokes * self.mu_out.size, stokes)

    @property
    def rates(self) -> Array:
        """1/mu of the nodes, the outgoing rows and the incident columns, (n + o + r,)."""
        stokes = self.sizes.stokes
        each = (self.nodes, stokes), (self.mu_out, stokes), (self.mu0, self.columns.shape[0])
        return np.concatenate([np.repeat(1.0 / mu, times) for mu, times in each])

    @property
    def flux(self) -> Array:
        """sqrt(weight mu), (N,)."""
        return np.sqrt(self.weights * self.nodes)

    @property
    def flux_size(self) -> float:
        """The root of the sum of its squares."""
        return float(np.sqrt((self.flux**2).sum()))


@dataclass(frozen=True, eq=False)
class Slabs:
    """On the device: R and T (item, numbers of a matrix), lost (item, n), residual (item, 2); state (item,): vrte_slab
    of core/kernels/doubling.h, its doublings and whether a matrix was singular."""

    R: Any
    T: Any
    lost: Any
    residual: Any
    state: Any


def compute_householder_vector(frame: Frame) -> tuple[Array, Array]:
    """The Householder vector that turns sqrt(weight mu) on I to the flux's axis, and the turned row of M^-1 there,
    (n,) each."""
    s = frame.sizes
    v, row = np.zeros(s.n), np.zeros(s.n)
    v[:: s.stokes] = frame.flux
    v[s.axis] += frame.flux_size
    v *= np.sqrt(2.0 / (v @ v))
    row[:: s.stokes] = -frame.flux / (frame.nodes * frame.flux_size)
    return v, row - (v @ row) * v


def describe_slabs(
    session: Session,
    frame: Frame,
    thickness: Array,
    albedo: Array,
    asymmetry: Array,
    of: NDArray[np.int32],
    turned: NDArray[np.bool_],
    clear: NDArray[np.bool_],
) -> Any:
    """vrte_slab of core/kernels/doubling.h of every slab and Fourier order, (item,), before it is doubled. of: place of
    its matrices; turned: whether it is order 0 and carries the flux; clear: whether it is not to be doubled."""
    kinds = [(name, session.real) for name in REALS] + [(name, np.int32) for name in INTEGERS]
    found, conservative = np.zeros(of.size, np.dtype(kinds, align=True)), albedo == 1.0
    slowest = np.sqrt((1.0 - albedo) * (1.0 - albedo * asymmetry))
    known = {"thickness": thickness, "albedo": albedo, "steepest": frame.rates.max(), "source": of, "turned": turned}
    known["slowest"] = np.where(~turned | conservative, np.maximum(slowest, 0.05), slowest)
    known |= {"clear": clear, "conservative": conservative}
    with np.errstate(over="ignore"):
        for name, values in known.items():
            found[name] = values
    return found


def double(session: Session, frame: Frame, slabs: Any, matrices: Assembled, stop: NDArray[np.int32]) -> Slabs:
    """R and T of all `describe_slabs`: some doublings a launch, until none is left."""
    s, count = frame.sizes, slabs.size
    v, clear_row = compute_householder_vector(frame)
    state = session.upload(slabs)
    R, T, lost, residual = (session.zeros((count, size)) for size in (s.numbers, s.numbers, s.n, 2))
    known = make_scratch(session, count, s.n) | {
        "slabs": state,
        "room": session.zeros((count, MATRICES, s.numbers)),
        "n_rhs": s.r,
        "n_out_rows": s.o,
        "stokes": s.stokes,
        "n_col": frame.columns.shape[0],
        "columns": frame.columns,
        "rates": frame.rates,
        "R": R,
        "T": T,
        "lost": lost,
    }
    left = every = np.arange(count, dtype=np.int32)
    turning = {"flux": frame.flux, "flux_size": frame.flux_size, "v": v, "clear_row": clear_row}
    session.launch("start_doubling", (count,), known | vars(matrices) | turning, items=every)

    def perform(which: int, most: int, chosen: NDArray[np.int32]) -> None:
        session.launch("double_slabs", (chosen.size,), known, which=which, most=most, items=chosen, residual=residual)

    perform(0, 1, every)
    while not stop[0] and left.size:
        perform(1, DOUBLINGS, left)
        left = np.flatnonzero(session.download(state)["left"]).astype(np.int32)
    if not stop[0]:
        perform(2, 1, every)
    return Slabs(R, T, lost, residual, state)


@stand_in_for(_core.double_slabs)
def double_slabs(session: Session, crew: ThreadTeam, given: Any) -> None:
    """Fills R, T, lost, residual, doublings and info; converged plays no part."""
    frame = Frame(given.nodes, given.weights, given.mu0, given.columns, given.mu_out)
    orders, material, albedo = given.orders, given.material, given.albedo
    shape = orders.size, material.size
    of = (np.arange(orders.size)[:, None] * albedo.size + material).astype(np.int32)
    turned = np.broadcast_to((orders[:, None] == 0) & given.conserving, shape)
    thick, scattering, forward = (
        np.broadcast_to(values, shape).ravel()
        for values in (given.thickness, albedo[material], given.asymmetry[material])
    )
    kinds = of.ravel(), turned.ravel(), (scattering == 0.0) & given.clear
    slabs = describe_slabs(session, frame, thick, scattering, forward, *kinds)
    matrices = given.E, given.F, given.G_E, given.G_F, given.source_s, given.source_d
    stacks = (upload_stack(session, a.reshape(-1, *a.shape[2:])) for a in matrices)
    found = double(session, frame, slabs, Assembled(*stacks), crew.stop)
    R, T, lost, residual, state = session.download_all([found.R, found.T, found.lost, found.residual, found.state])
    given.R[:], given.T[:] = (take_blocks(frame.sizes, rows).reshape(*shape, -1) for rows in (R, T))
    given.lost[:], given.residual[:] = lost.reshape(given.lost.shape), residual.reshape(*shape, 2)
    given.doublings[:], given.info[:] = (state[name].reshape(shape) for name in ("doublings", "singular"))


def take_blocks(s: Sizes, rows: Array) -> Array:
    """(item, extended size): N, NI, ON, OI, OO, II one behind the other, as `_core` has them."""
    whole, straight = np.split(rows, [s.ld * (s.n + s.r)], axis=1)
    whole = whole.reshape(len(rows), s.n + s.r, s.ld)
    parts = [whole[:, columns, among].reshape(len(rows), -1) for columns, among in list_block_places(s)]
    return np.concatenate([*parts, straight[:, : s.o + s.r]], axis=1)


def put_blocks(s: Sizes, blocks: Array) -> Array:
    """Extended matrices (item, numbers) of those blocks."""
    counts = s.n * s.n, s.r * s.n, s.n * s.o, s.r * s.o
    *parts, straight = np.split(blocks, np.cumsum(counts), axis=1)
    rows = np.zeros((len(blocks), s.numbers))
    size = s.ld * (s.n + s.r)
    whole = rows[:, :size].reshape(len(rows), s.n + s.r, s.ld)
    for part, (columns, among) in zip(parts, list_block_places(s), strict=True):
        here = whole[:, columns, among]
        here[:] = part.reshape(here.shape)
    rows[:, :size], rows[:, size : size + s.o + s.r] = whole.reshape(len(rows), -1), straight
    return rows


def list_block_places(s: Sizes) -> list[tuple[slice, slice]]:
    """Columns and rows of N, NI, ON and OI."""
    nodes, incident, outgoing = slice(0, s.n), slice(s.n, s.n + s.r), slice(s.p, s.p + s.o)
    return [(nodes, nodes), (incident, nodes), (nodes, outgoing), (incident, outgoing)]
