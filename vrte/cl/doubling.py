"""Impedance doubling of many slabs in one call, `double_one` of core/doubling.pxi on a device."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import ThreadTeam
from vrte.cl.assembly import Assembled
from vrte.cl.extended import (
    COMPLEMENT,
    FADE,
    NOTHING,
    TANH,
    Algebra,
    BoolArray,
    Extended,
    Sizes,
    make_row_stack,
    take_row,
)
from vrte.cl.matrices import STRIP, upload_stack
from vrte.cl.session import Reading, Session
from vrte.cl.stages import stand_in_for

# How far Zo Ze of a semi-infinite slab is from 1 before the last doubling, which squares that.
CONVERGED = {"double": 1e-9, "single": 1e-4}


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
    def steepest(self) -> float:
        """The largest 1/mu."""
        return float(1.0 / np.concatenate([self.nodes, self.mu0, self.mu_out]).min())

    @property
    def flux(self) -> Array:
        """sqrt(weight mu), (N,)."""
        return np.sqrt(self.weights * self.nodes)


@dataclass(frozen=True, eq=False)
class Items:
    """One slab and Fourier order each: thickness, albedo, asymmetry (item,); of (item,): place of its matrices; turned
    (item,): whether it is order 0 and carries the flux; clear (item,): whether it is not to be doubled."""

    thickness: Array
    albedo: Array
    asymmetry: Array
    of: NDArray[np.int32]
    turned: BoolArray
    clear: BoolArray


@dataclass(frozen=True, eq=False)
class Slabs:
    """R and T of every item, lost (item, n) and info (item,) on the device; residual (item, 2), yet to be read;
    doublings (item,)."""

    R: Extended
    T: Extended
    lost: Any
    info: Any
    residual: Reading
    doublings: NDArray[np.int32]


def compute_householder_vector(frame: Frame) -> tuple[Array, Array]:
    """The Householder vector that turns sqrt(weight mu) on I to the flux's axis, and the turned row of M^-1 there,
    (n,) each."""
    s, flux = frame.sizes, frame.flux
    length = float(np.sqrt((flux**2).sum()))
    v, row = np.zeros(s.n), np.zeros(s.n)
    v[:: s.stokes] = flux
    v[s.axis] += length
    v *= np.sqrt(2.0 / (v @ v))
    row[:: s.stokes] = -flux / (frame.nodes * length)
    return v, row - (v @ row) * v


class Doubling:
    """The work on one stack of slabs: its matrices, and what is known of each item on the host."""

    def __init__(self, session: Session, frame: Frame, items: Items, matrices: Assembled) -> None:
        self.session, self.frame, self.items = session, frame, items
        self.sizes, self.count = frame.sizes, items.thickness.size
        stokes, n_col = self.sizes.stokes, frame.columns.shape[0]
        rates = (
            np.repeat(1.0 / frame.mu_out, stokes) if self.sizes.o else np.zeros(1),
            np.repeat(1.0 / frame.mu0, n_col) if self.sizes.r else np.zeros(1),
        )
        self.algebra = Algebra(session, self.sizes, self.count, rates)
        upload, new = session.constant, self.algebra.new
        self.columns, self.v = upload(frame.columns), upload(compute_householder_vector(frame)[0])
        self.e, self.f = (self.algebra.with_rates(new()) for _ in range(2))
        self.Ze, self.Zo, self.C, self.a, self.b, self.spare = (new() for _ in range(6))
        self.doublings = np.zeros(self.count, np.int32)
        self.doubled: BoolArray = ~items.clear
        self.semi_infinite: BoolArray = (items.thickness >= _core.SEMI_INFINITE) & self.doubled
        self.finite: BoolArray = (items.thickness < _core.SEMI_INFINITE) & self.doubled
        self.extend(matrices)
        self.turn()

    def extend(self, matrices: Assembled) -> None:
        """E and F with the sources as incident columns and G as outgoing rows."""
        s, of = self.sizes, self.session.constant(self.items.of)
        shared = s, s.stokes, self.columns.shape[0], self.columns, self.algebra.rate_OO, of
        for target, *given in (
            (self.e, matrices.E, matrices.G_E, matrices.source_d),
            (self.f, matrices.F, matrices.G_F, matrices.source_s),
        ):
            self.algebra.launch("extend", self.doubled, *shared, *given, target.data, columns=s.columns)

    def turn(self) -> None:
        """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly."""
        chosen, s = self.items.turned & self.doubled, self.sizes
        for matrix in (self.e, self.f):
            self.turn_both(chosen, matrix)
        size = float(np.sqrt((self.frame.flux**2).sum()))
        clear_row, albedo = (
            self.session.constant(values) for values in (compute_householder_vector(self.frame)[1], self.items.albedo)
        )
        known = clear_row, self.columns, self.algebra.rate_OO, albedo, self.e.data
        self.algebra.launch("conserve", chosen, s, s.stokes, self.columns.shape[0], s.axis, size, *known)

    def turn_both(self, chosen: BoolArray, a: Extended) -> None:
        """(1 - v v^T) a (1 - v v^T) on the nodes."""
        s = self.sizes
        for name, columns in (("turn_columns", s.columns), ("turn_rows", s.ld // STRIP)):
            self.algebra.launch(name, chosen, s, s.stokes, self.v, a.data, columns=self.algebra.count_pieces(columns))

    def steepest(self) -> Array:
        """The largest rate of each item, (item,): 1/mu, or the root of the 1-norm of F E."""
        self.algebra.product(self.doubled, 1.0, self.f, self.e, self.a)
        norms = self.session.download(self.algebra.largest(self.doubled, self.a.N, sums=True))
        return np.maximum(self.frame.steepest, np.sqrt(norms))

    def run(self, stop: NDArray[np.int32]) -> Slabs:
        """R and T of every item."""
        R, T = self.algebra.new(), self.algebra.new()
        lost = self.session.zeros((self.count, self.sizes.n))
        if self.doubled.any():
            steepest = self.steepest()
            self.double_plainly(steepest, stop)
            self.double_semi_infinite(steepest, stop)
            self.reflect_and_transmit(R, T, lost)
        self.clear_slabs(T, lost)
        residual = Reading((), partial(np.zeros, (self.count, 2)))
        if self.doubled.any() and not stop[0]:
            for half, target in ((0.5, self.a), (-0.5, self.b)):  # alpha and beta of what adds a thin layer
                self.algebra.combine(self.doubled, 0.5, self.e, target, half, self.f)
            self.reflect_by_invariance(R, T)
            residual = self.invariance(R, T)
        return Slabs(R, T, lost, self.algebra.info, residual, self.doublings)

    def double_plainly(self, steepest: Array, stop: NDArray[np.int32]) -> None:
        """Ze, Zo and C = 1 - Zo Ze of finite slabs: a rational start, then Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1,
        L = 1 + Zo Ze; C is formed while that keeps its digits, then carried, C <- (C L^-1)^2."""
        if not self.finite.any():
            return
        h = np.where(self.finite, 0.5 * np.minimum(self.items.thickness, _core.SEMI_INFINITE), 0.0)
        left = np.zeros(self.count, np.int32)
        while (above := self.finite & (h * steepest > 0.5)).any():
            h[above] *= 0.5
            left[above] += 1
        self.doublings[self.finite] = left[self.finite]
        self.rational_start(h)
        carried = np.zeros(self.count, bool)
        for step in range(int(left.max())):
            if stop[0]:
                return
            active: BoolArray = self.finite & (left > step)
            now = active & ~carried & (2.0 * h > _core.COMPLEMENTED)
            whole = not now.any()  # L at once; C is made of what it is without the 1
            self.algebra.product(active, 1.0, self.Zo, self.Ze, self.a, gamma=float(whole))
            self.complement(now, h)
            carried |= now
            h[active] *= 2.0
            self.double(active, whole, (TANH, h.copy()))
            self.algebra.mirror_flux(active & self.items.turned, self.Zo)
            self.carry(active & carried, h)
            self.session.finish()  # so that a stop is soon obeyed
        late = self.finite & ~carried
        self.algebra.product(late, 1.0, self.Zo, self.Ze, self.a)
        self.complement(late, h)

    def double(self, active: BoolArray, whole: bool = False, straight: tuple[int, Array] | None = None) -> None:
        """Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1 where `a` holds L - 1, or the ``whole`` L; leaves L^-1 in it."""
        if not whole:
            self.algebra.combine(active, 1.0, self.a, self.a, gamma=1.0)
        self.a, self.spare = self.algebra.invert(active, self.a, self.spare)
        self.algebra.product(active, 2.0, self.a, self.Zo, self.b, straight=straight)
        self.Zo, self.b = self.algebra.replace(active, self.Zo, self.b)
        self.algebra.product(active, 2.0, self.Ze, self.a, self.b, straight=straight)
        self.Ze, self.b = self.algebra.replace(active, self.Ze, self.b)

    def complement(self, chosen: BoolArray, h: Array) -> None:
        """C = 1 - Zo Ze, which `a` holds."""
        self.algebra.combine(chosen, -1.0, self.a, self.C, gamma=1.0)
        self.algebra.go_straight(chosen, COMPLEMENT, h, self.C)

    def carry(self, chosen: BoolArray, h: Array) -> None:
        """C <- (C L^-1)^2."""
        self.algebra.product(chosen, 1.0, self.C, self.a, self.b)
        self.algebra.product(chosen, 1.0, self.b, self.b, self.C, straight=(COMPLEMENT, h))

    def rational_start(self, h: Array) -> None:
        """Ze = E f, Zo = f F with f = tanh(h sqrt A)/sqrt A, A = F E, which `a` holds."""
        algebra, items = self.algebra, self.finite
        z, power, above, below = self.a, self.b, self.C, self.spare
        algebra.combine(items, 1.0, z, z, factor=h * h)
        algebra.combine(items, _core.TANH_NUMERATOR[1], z, above, gamma=_core.TANH_NUMERATOR[0])
        algebra.combine(items, _core.TANH_DENOMINATOR[1], z, below, gamma=_core.TANH_DENOMINATOR[0])
        algebra.combine(items, 1.0, z, power)
        for up, down in zip(_core.TANH_NUMERATOR[2:], _core.TANH_DENOMINATOR[2:], strict=True):
            algebra.product(items, 1.0, z, power, self.Ze)
            algebra.combine(items, 1.0, self.Ze, power)
            algebra.combine(items, 1.0, above, above, up, power)
            algebra.combine(items, 1.0, below, below, down, power)
        below, power = algebra.invert(items, below, power)
        algebra.combine(items, 1.0, above, above, factor=h)
        algebra.product(items, 1.0, below, above, z)
        algebra.product(items, 1.0, self.e, z, self.Ze, straight=(TANH, h))
        algebra.product(items, 1.0, z, self.f, self.Zo, straight=(TANH, h))

    def double_semi_infinite(self, steepest: Array, stop: NDArray[np.int32]) -> None:
        """Ze and Zo of semi-infinite slabs, where Zo Ze = 1, by scaled doublings: before each, both are multiplied by
        ratio^(-1/2), the ratio being the smallest over the largest eigenvalue of sqrt(Zo Ze), guessed from below."""
        albedo, m0 = self.items.albedo, self.items.turned
        slowest = np.sqrt((1.0 - albedo) * (1.0 - albedo * self.items.asymmetry))
        slowest = np.where(~m0 | (albedo == 1.0), np.maximum(slowest, 0.05), slowest)
        ratio = np.minimum(1.0, slowest / steepest)
        algebra, active = self.algebra, self.semi_infinite.copy()
        factor = 1.0 / steepest
        for matrix, target in ((self.e, self.Ze), (self.f, self.Zo)):
            algebra.combine(active, 1.0, matrix, target, factor=factor)
        skip = self.session.constant((m0 & (albedo == 1.0)).astype(np.int32))
        for _ in range(_core.MOST_DOUBLINGS):
            if stop[0] or not active.any():
                return
            used = np.maximum(ratio, _core.STEEPEST_RATIO)
            factor = 1.0 / np.sqrt(used)
            for matrix in (self.Ze, self.Zo):
                algebra.combine(active, 1.0, matrix, matrix, factor=factor)
            algebra.product(active, 1.0, self.Zo, self.Ze, self.a)
            difference = self.gap(active, skip) if (ratio[active] > 0.999).any() else np.ones(self.count)
            self.double(active)
            self.doublings[active] += 1
            active &= ~((difference < CONVERGED[self.session.precision]) & (ratio > 0.999))
            ratio = np.minimum(2.0 * ratio * np.sqrt(used) / (used + ratio * ratio), 2.0 * np.sqrt(used) / (1.0 + used))

    def gap(self, chosen: BoolArray, skip: Any) -> Array:
        """How far Zo Ze is from 1 on the diagonal, (item,)."""
        found = self.session.zeros((self.count,))
        self.algebra.launch("diagonal_gap", chosen, self.sizes, self.sizes.axis, skip, self.a, found)
        return self.session.download(found)

    def reflect_and_transmit(self, R: Extended, T: Extended, lost: Any) -> None:
        """R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; semi-infinite: R = 1 - 2 Se and T = 0; lost = 2 Se, the flux's
        row."""
        algebra, finite, semi_infinite = self.algebra, self.finite, self.semi_infinite
        algebra.combine(self.doubled, 1.0, self.Ze, self.a, gamma=1.0)
        self.a, self.spare = algebra.invert(self.doubled, self.a, self.spare)
        thick: BoolArray = finite & (self.items.thickness > _core.THICK)
        thin: BoolArray = finite & ~thick
        for chosen, twice in ((semi_infinite, 2.0), (finite, 1.0)):
            algebra.product(chosen, -twice, self.Ze, self.a, R)
            flux_row = take_row(R.N, self.sizes.axis)
            algebra.blend(chosen & self.items.turned, -2.0 / twice, flux_row, make_row_stack(lost))
        algebra.combine(semi_infinite, 1.0, R, R, gamma=1.0)
        algebra.product(finite, 1.0, self.C, self.a, self.b)
        algebra.combine(finite, 1.0, self.Zo, self.a, gamma=1.0)
        self.a, self.spare = algebra.invert(finite, self.a, self.spare)
        algebra.product(finite, 1.0, self.a, self.b, T)
        algebra.combine(thick, 1.0, R, R, -1.0, self.a, 1.0)
        algebra.product(thin, 1.0, self.Zo, self.a, self.b)
        algebra.combine(thin, 1.0, R, R, 1.0, self.b)
        algebra.go_straight(self.doubled, NOTHING, None, R)

    def clear_slabs(self, T: Extended, lost: Any) -> None:
        """Slabs that do not scatter: T alone."""
        chosen, s, frame, upload = self.items.clear, self.sizes, self.frame, self.session.constant
        if not chosen.any():
            return
        thickness = np.where(chosen, self.items.thickness, 0.0)
        self.algebra.launch("clear_nodes", chosen, s, s.stokes, upload(thickness), upload(frame.nodes), T.data)
        self.algebra.go_straight(chosen, FADE, thickness, T)
        turned = chosen & self.items.turned
        if turned.any():
            self.turn_both(turned, T)
            v, _ = compute_householder_vector(frame)
            rows = self.session.download(lost)
            for item in np.flatnonzero(turned):  # the axis is minus the unit null vector
                row = np.zeros(s.n)
                row[:: s.stokes] = (
                    frame.flux / np.sqrt((frame.flux**2).sum()) * np.expm1(-thickness[item] / frame.nodes)
                )
                rows[item] = row - (v @ row) * v
            self.session.put(rows, lost)

    def reflect_by_invariance(self, R: Extended, T: Extended) -> None:
        """R's OI anew where a slab is thick, from R's and T's other blocks: a thin layer added on top and taken off
        below changes nothing. a and b hold alpha and beta: (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R -
        T beta T)."""
        s, spare, alpha, beta = self.sizes, self.spare, self.a, self.b
        chosen = self.doubled & (self.items.thickness > _core.THICK)
        if s.r == 0 or s.o == 0:
            return

        def add(a: Any, b: Any, c: Any, factor: float = 1.0, beta: float = 1.0) -> None:
            self.algebra.multiply(chosen, a, b, c, factor, beta)

        self.algebra.blend(chosen, 1.0, alpha.NI, spare.NI)
        add(beta.N, R.NI, spare.NI)
        add(R.ON, spare.NI, R.OI, -1.0, 0.0)
        arguments = s, beta.data, T.OO, T.II, spare.data
        self.algebra.launch("lead_straight", chosen, *arguments, columns=s.columns)
        add(beta.N, T.NI, spare.NI)
        add(T.ON, spare.NI, R.OI)
        add(alpha.ON, R.NI, R.OI, -1.0)
        add(spare.ON, T.NI, R.OI)
        rates = self.algebra.rate_OO, self.algebra.rate_II
        self.algebra.launch("divide_by_rates", chosen, s, *rates, R.data, columns=s.r)

    def invariance(self, R: Extended, T: Extended) -> Reading:
        """How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative, (item,
        2): beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R)."""
        algebra, doubled, finite = self.algebra, self.doubled, self.finite
        multiply, largest, blend = algebra.multiply, algebra.largest, algebra.blend
        R_, T_, alpha, beta, x, y, z = (matrix.N for matrix in (R, T, self.a, self.b, self.e, self.f, self.spare))
        blend(doubled, 1.0, alpha, x)
        multiply(doubled, R_, beta, x, beta=1.0)
        multiply(doubled, R_, alpha, z)
        sizes = [largest(doubled, matrix) for matrix in (alpha, z, beta)]
        blend(doubled, 1.0, beta, z, 1.0, z)
        multiply(doubled, x, R_, z, beta=1.0)
        multiply(finite, T_, beta, y)
        multiply(finite, y, T_, z, -1.0, 1.0)
        missing = [largest(doubled, z)]
        multiply(finite, x, T_, z)
        sizes.append(largest(finite, z))
        multiply(finite, T_, alpha, z, -1.0, 1.0)
        multiply(finite, y, R_, z, -1.0, 1.0)
        missing.append(largest(finite, z))
        known = self.items.thickness, self.doubled, finite, self.session.faintest
        return Reading((*missing, *sizes), partial(find_relative_residual, *known))


def find_relative_residual(
    thickness: Array, doubled: BoolArray, finite: BoolArray, faintest: float, *sizes: Array
) -> Array:
    """Of what R and T miss, (item,) each, and the sizes of alpha, of what R meets, of beta and of T, (item, 2): R's
    relative to the light that it meets, T's to itself; 0 where there is nothing."""
    residual = np.zeros((thickness.size, 2))
    R_misses, T_misses, of_alpha, met, of_beta, of_T = sizes
    with np.errstate(divide="ignore", invalid="ignore"):
        largest = of_alpha * np.minimum(1.0, thickness * of_alpha)
        largest = np.maximum(np.maximum(met, of_beta), largest)
        residual[:, 0] = np.where(largest > 0.0, R_misses / largest, 0.0)
        residual[:, 1] = np.where(finite & (of_T > faintest), T_misses / of_T, 0.0)
    residual[~doubled] = 0.0
    return residual


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
    items = Items(thick, scattering, forward, of.ravel(), turned.ravel(), (scattering == 0.0) & given.clear)
    matrices = given.E, given.F, given.G_E, given.G_F, given.source_s, given.source_d
    stacks = (upload_stack(session, a.reshape(-1, *a.shape[2:])) for a in matrices)
    found = Doubling(session, frame, items, Assembled(*stacks)).run(crew.stop)
    given.R[:], given.T[:] = (download_blocks(session, matrix).reshape(*shape, -1) for matrix in (found.R, found.T))
    given.lost[:] = session.download(found.lost).reshape(given.lost.shape)
    given.info[:] = session.download(found.info).reshape(shape)
    (residual,) = session.read([found.residual])
    given.residual[:], given.doublings[:] = residual.reshape(*shape, 2), found.doublings.reshape(shape)


def download_blocks(session: Session, matrix: Extended) -> Array:
    """(item, extended size): N, NI, ON, OI, OO, II one behind the other, as `_core` has them."""
    s, whole = matrix.sizes, session.download(matrix.data)
    parts = [whole[:, columns, rows].reshape(len(whole), -1) for columns, rows in list_block_places(s)]
    return np.concatenate(
        [*parts, session.download(matrix.OO)[:, : s.o], session.download(matrix.II)[:, : s.r]], axis=1
    )


def upload_blocks(session: Session, s: Sizes, rows: Array) -> Extended:
    """Extended matrices from what `blocks` makes of them."""
    counts = s.n * s.n, s.r * s.n, s.n * s.o, s.r * s.o, s.o, s.r
    *parts, OO, II = np.split(rows, np.cumsum(counts)[:-1], axis=1)
    whole = np.zeros((rows.shape[0], s.columns, s.ld))
    for part, (columns, among) in zip(parts, list_block_places(s), strict=True):
        here = whole[:, columns, among]
        here[:] = part.reshape(here.shape)
    return Extended(s, session.upload(whole), session.upload(OO), session.upload(II))


def list_block_places(s: Sizes) -> list[tuple[slice, slice]]:
    """Columns and rows of N, NI, ON and OI."""
    nodes, incident, outgoing = slice(0, s.n), slice(s.n, s.columns), slice(s.p, s.p + s.o)
    return [(nodes, nodes), (incident, nodes), (nodes, outgoing), (incident, outgoing)]
