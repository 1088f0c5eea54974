"""Impedance doubling of many slabs in one call, `double_one` of core/doubling.pxi on a device."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrte import _core
from vrte.basics.arrays import Array
from vrte.basics.running import Crew
from vrte.cl.assembly import Assembled
from vrte.cl.extended import COMPLEMENT, FADE, NOTHING, TANH, Algebra, BoolArray, Extended, Sizes
from vrte.cl.matrices import STRIP, product, upload_stack
from vrte.cl.session import Session


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
        found: Array = np.sqrt(self.weights * self.nodes)
        return found


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
    """R and T of every item, lost (item, n) and info (item,) on the device; residual (item, 2) and doublings (item,)
    come down as numbers."""

    R: Extended
    T: Extended
    lost: Any
    info: Any
    residual: Array
    doublings: NDArray[np.int32]


def axis_of(sizes: Sizes) -> int:
    """The axis that carries the flux once order 0 is turned: I of the last node."""
    return sizes.n - sizes.stokes


def turning(frame: Frame) -> tuple[Array, Array]:
    """The Householder vector that turns sqrt(weight mu) on I to the flux's axis, and the turned row of M^-1 there,
    (n,) each."""
    s, flux = frame.sizes, frame.flux
    length = float(np.sqrt((flux**2).sum()))
    v, row = np.zeros(s.n), np.zeros(s.n)
    v[:: s.stokes] = flux
    v[axis_of(s)] += length
    v *= np.sqrt(2.0 / (v @ v))
    row[:: s.stokes] = -flux / (frame.nodes * length)
    return v, row - (v @ row) * v


class Doubling:
    """The work on one stack of slabs: its matrices, and what is known of each item on the host."""

    def __init__(self, session: Session, frame: Frame, items: Items, matrices: Assembled) -> None:
        self.session, self.frame, self.items = session, frame, items
        self.sizes, self.count = frame.sizes, items.thickness.size
        self.algebra = Algebra(session, self.sizes, self.count)
        stokes, n_col = self.sizes.stokes, frame.columns.shape[0]
        upload, new = session.constant, self.algebra.new
        self.rate_OO = upload(np.repeat(1.0 / frame.mu_out, stokes) if self.sizes.o else np.zeros(1))
        self.rate_II = upload(np.repeat(1.0 / frame.mu0, n_col) if self.sizes.r else np.zeros(1))
        self.columns = upload(frame.columns)
        self.e, self.f = (self.with_rates(new()) for _ in range(2))
        self.Ze, self.Zo, self.C, self.a, self.b, self.spare = (new() for _ in range(6))
        self.doublings = np.zeros(self.count, np.int32)
        self.doubled: BoolArray = ~items.clear
        self.endless: BoolArray = (items.thickness >= _core.ENDLESS) & self.doubled
        self.finite: BoolArray = (items.thickness < _core.ENDLESS) & self.doubled
        self.extend(matrices)
        v, clear_row = turning(frame)
        self.v, self.clear_row = upload(v), upload(clear_row)
        self.turn()

    def with_rates(self, a: Extended) -> Extended:
        """The same with 1/mu as its light that goes straight."""
        return Extended(a.sizes, a.data, self.rate_OO, self.rate_II, True)

    def where(self, chosen: BoolArray) -> Any:
        """Items as kernels take them."""
        return self.algebra.where(chosen)

    def extend(self, matrices: Assembled) -> None:
        """E and F with the sources as incident columns and G as outgoing rows."""
        items, s = self.where(self.doubled), self.sizes
        of = self.session.constant(self.items.of)
        shape = np.int32(s.stokes), np.int32(self.frame.columns.shape[0])
        for target, matrix, G, source in (
            (self.e, matrices.E, matrices.G_E, matrices.source_d),
            (self.f, matrices.F, matrices.G_F, matrices.source_s),
        ):
            places = *matrix.place, *G.place, *source.place
            arguments = *s.arguments, *shape, self.columns, self.rate_OO, of, *places, target.data
            self.algebra.each_column("extend", s.columns, items, *arguments)

    def turn(self) -> None:
        """Order 0: one axis becomes sqrt(weight mu) on I, whose row and column of E are known exactly."""
        chosen, s = self.items.turned & self.doubled, self.sizes
        if not chosen.any():
            return
        items, axis = self.where(chosen), np.int32(axis_of(s))
        place = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(s.stokes)
        for matrix in (self.e, self.f):
            self.turn_both(items, matrix)
        size = np.float64(np.sqrt((self.frame.flux**2).sum()))
        albedo = self.session.constant(self.items.albedo)
        shape = *s.arguments, place[3], np.int32(self.frame.columns.shape[0]), axis, size
        known = self.clear_row, self.columns, self.rate_OO, albedo, self.e.data
        self.session.launch("conserve", (items.size,), *shape, *known, items)

    def turn_both(self, items: Any, a: Extended) -> None:
        """(1 - v v^T) a (1 - v v^T) on the nodes."""
        s = self.sizes
        place = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(s.stokes)
        self.session.launch("turn_columns", (s.columns, items.size), *place, self.v, a.data, items)
        self.session.launch("turn_rows", (s.ld // STRIP, items.size), *place, self.v, a.data, items)

    def steepest(self) -> Array:
        """The largest rate of each item, (item,): 1/mu, or the root of the 1-norm of F E."""
        items = self.where(self.doubled)
        self.algebra.product(items, 1.0, self.f, self.e, self.a)
        norms = self.session.download(self.algebra.largest(items, self.a.N, sums=True))
        found: Array = np.maximum(self.frame.steepest, np.sqrt(norms))
        return found

    def run(self, stop: NDArray[np.int32]) -> Slabs:
        """R and T of every item."""
        new = self.algebra.new
        R, T, lost = new(), new(), self.session.zeros((self.count, self.sizes.n))
        if self.doubled.any():
            steepest = self.steepest()
            if self.finite.any():
                self.double_plainly(steepest, stop)
            if self.endless.any():
                self.double_endless(steepest, stop)
            R, T = self.reflect_and_transmit(R, T, lost)
        self.clear_slabs(T, lost)
        residual = np.zeros((self.count, 2))
        if self.doubled.any() and not stop[0]:
            items = self.where(self.doubled)
            place = np.int32(self.sizes.ld), np.int64(self.sizes.stride)
            self.algebra.each_column(
                "half_sum_and_difference", self.sizes.columns, items, *place, self.e.data, self.f.data
            )
            self.reflect_by_invariance(R, T)
            residual = self.invariance(R, T)
        return Slabs(R, T, lost, self.algebra.info, residual, self.doublings)

    def double_plainly(self, steepest: Array, stop: NDArray[np.int32]) -> None:
        """Ze, Zo and C = 1 - Zo Ze of finite slabs: a rational start, then Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1,
        L = 1 + Zo Ze; C is formed while that keeps its digits, then carried, C <- (C L^-1)^2."""
        h = np.where(self.finite, 0.5 * np.minimum(self.items.thickness, _core.ENDLESS), 0.0)
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
            self.algebra.product(self.where(active), 1.0, self.Zo, self.Ze, self.a)
            now = active & ~carried & (2.0 * h > _core.COMPLEMENTED)
            self.complement(now, h)
            carried |= now
            self.double(active)
            self.mirror(active)
            h[active] *= 2.0
            self.straight(TANH, active, h, self.Ze, self.Zo)
            self.carry(active & carried, h)
            self.session.finish()
        late = self.finite & ~carried
        if late.any():
            self.algebra.product(self.where(late), 1.0, self.Zo, self.Ze, self.a)
            self.complement(late, h)

    def double(self, active: BoolArray) -> None:
        """Zo <- 2 L^-1 Zo, Ze <- 2 Ze L^-1 where `a` holds L - 1; leaves L^-1 in it."""
        items = self.where(active)
        self.algebra.combine(items, 1.0, self.a, self.a, gamma=1.0)
        self.algebra.invert(items, self.a, self.spare)
        self.algebra.product(items, 2.0, self.a, self.Zo, self.b)
        self.Zo, self.b = self.algebra.replace(active, self.Zo, self.b)
        self.algebra.product(items, 2.0, self.Ze, self.a, self.b)
        self.Ze, self.b = self.algebra.replace(active, self.Ze, self.b)

    def mirror(self, active: BoolArray) -> None:
        """Reciprocity of the flux's row and column of Zo in order 0."""
        s, chosen = self.sizes, active & self.items.turned
        if not chosen.any():
            return
        items = self.where(chosen)
        v_place = 3 if s.stokes == 4 else -1
        shape = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(axis_of(s)), np.int32(v_place)
        self.session.launch("mirror_flux", (items.size,), *shape, np.int32(s.stokes), self.Zo.data, items)

    def complement(self, chosen: BoolArray, h: Array) -> None:
        """C = 1 - Zo Ze, which `a` holds."""
        if chosen.any():
            self.algebra.combine(self.where(chosen), -1.0, self.a, self.C, gamma=1.0)
            self.straight(COMPLEMENT, chosen, h, self.C)

    def straight(self, kind: int, chosen: BoolArray, h: Array, *matrices: Extended) -> None:
        """Their OO and II over h."""
        uploaded = self.session.constant(h)
        for matrix in matrices:
            self.algebra.go_straight(self.where(chosen), kind, uploaded, self.with_rates(matrix), matrix)

    def carry(self, chosen: BoolArray, h: Array) -> None:
        """C <- (C L^-1)^2."""
        if chosen.any():
            items = self.where(chosen)
            self.algebra.product(items, 1.0, self.C, self.a, self.b)
            self.algebra.product(items, 1.0, self.b, self.b, self.C)
            self.straight(COMPLEMENT, chosen, h, self.C)

    def rational_start(self, h: Array) -> None:
        """Ze = E f, Zo = f F with f = tanh(h sqrt A)/sqrt A, A = F E, which `a` holds."""
        algebra, items = self.algebra, self.where(self.finite)
        z, power, above, below = self.a, self.b, self.C, self.spare
        algebra.combine(items, 1.0, z, z, factor=self.session.constant(h * h))
        algebra.combine(items, _core.TANH_NUMERATOR[1], z, above, gamma=_core.TANH_NUMERATOR[0])
        algebra.combine(items, _core.TANH_DENOMINATOR[1], z, below, gamma=_core.TANH_DENOMINATOR[0])
        algebra.combine(items, 1.0, z, power)
        for up, down in zip(_core.TANH_NUMERATOR[2:], _core.TANH_DENOMINATOR[2:], strict=True):
            algebra.product(items, 1.0, z, power, self.Ze)
            algebra.combine(items, 1.0, self.Ze, power)
            algebra.combine(items, 1.0, above, above, up, power)
            algebra.combine(items, 1.0, below, below, down, power)
        algebra.invert(items, below, power)
        algebra.combine(items, 1.0, above, above, factor=self.session.constant(h))
        algebra.product(items, 1.0, below, above, z)
        algebra.product(items, 1.0, self.e, z, self.Ze)
        algebra.product(items, 1.0, z, self.f, self.Zo)
        self.straight(TANH, self.finite, h, self.Ze, self.Zo)

    def double_endless(self, steepest: Array, stop: NDArray[np.int32]) -> None:
        """Ze and Zo of slabs without end, where Zo Ze = 1, by scaled doublings: before each, both are multiplied by
        ratio^(-1/2), the ratio being the smallest over the largest eigenvalue of sqrt(Zo Ze), guessed from below."""
        albedo, m0 = self.items.albedo, self.items.turned
        slowest = np.sqrt((1.0 - albedo) * (1.0 - albedo * self.items.asymmetry))
        slowest = np.where(~m0 | (albedo == 1.0), np.maximum(slowest, 0.05), slowest)
        ratio = np.minimum(1.0, slowest / steepest)
        algebra, active = self.algebra, self.endless.copy()
        factor = self.session.constant(1.0 / steepest)
        for matrix, target in ((self.e, self.Ze), (self.f, self.Zo)):
            algebra.combine(self.where(active), 1.0, matrix, target, factor=factor)
        skip = self.session.constant((m0 & (albedo == 1.0)).astype(np.int32))
        for _ in range(_core.MOST_DOUBLINGS):
            if stop[0] or not active.any():
                return
            items, used = self.where(active), np.maximum(ratio, _core.STEEPEST_RATIO)
            factor = self.session.constant(1.0 / np.sqrt(used))
            for matrix in (self.Ze, self.Zo):
                algebra.combine(items, 1.0, matrix, matrix, factor=factor)
            algebra.product(items, 1.0, self.Zo, self.Ze, self.a)
            gap = self.gap(items, skip) if (ratio[active] > 0.999).any() else np.ones(self.count)
            self.double(active)
            self.doublings[active] += 1
            active &= ~((gap < 1e-9) & (ratio > 0.999))
            ratio = np.minimum(2.0 * ratio * np.sqrt(used) / (used + ratio * ratio), 2.0 * np.sqrt(used) / (1.0 + used))

    def gap(self, items: Any, skip: Any) -> Array:
        """How far Zo Ze is from 1 on the diagonal, (item,)."""
        s, found = self.sizes, self.session.zeros((self.count,))
        shape = *map(np.int32, (s.n, s.r, s.o, s.ld)), np.int64(s.stride), np.int32(axis_of(s)), skip
        self.session.launch("diagonal_gap", (items.size,), *shape, *self.a.arguments, found, items)
        return self.session.download(found)

    def reflect_and_transmit(self, R: Extended, T: Extended, lost: Any) -> tuple[Extended, Extended]:
        """R = So - Se and T = (1 + Zo)^-1 C (1 + Ze)^-1; without end R = 1 - 2 Se and T = 0; lost = 2 Se, the flux's
        row."""
        algebra, doubled = self.algebra, self.where(self.doubled)
        algebra.combine(doubled, 1.0, self.Ze, self.a, gamma=1.0)
        algebra.invert(doubled, self.a, self.spare)
        thick: BoolArray = self.finite & (self.items.thickness > _core.THICK)
        thin: BoolArray = self.finite & ~thick
        for chosen, twice in ((self.endless, 2.0), (self.finite, 1.0)):
            if chosen.any():
                algebra.product(self.where(chosen), -twice, self.Ze, self.a, R)
                self.flux_row(chosen & self.items.turned, -2.0 / twice, R, lost)
        if self.endless.any():
            algebra.combine(self.where(self.endless), 1.0, R, R, gamma=1.0)
        if self.finite.any():
            finite = self.where(self.finite)
            algebra.product(finite, 1.0, self.C, self.a, self.b)
            algebra.combine(finite, 1.0, self.Zo, self.a, gamma=1.0)
            algebra.invert(finite, self.a, self.spare)
            algebra.product(finite, 1.0, self.a, self.b, T)
        if thick.any():
            algebra.combine(self.where(thick), 1.0, R, R, -1.0, self.a, 1.0)
        if thin.any():
            algebra.product(self.where(thin), 1.0, self.Zo, self.a, self.b)
            algebra.combine(self.where(thin), 1.0, R, R, 1.0, self.b)
        algebra.go_straight(doubled, NOTHING, self.rate_OO, self.with_rates(R), R)
        return R, T

    def flux_row(self, chosen: BoolArray, factor: float, R: Extended, lost: Any) -> None:
        """What is lost of the flux."""
        if chosen.any():
            s, items = self.sizes, self.where(chosen)
            shape = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(axis_of(s)), np.float64(factor)
            self.session.launch("flux_row", (items.size,), *shape, R.data, lost, items)

    def clear_slabs(self, T: Extended, lost: Any) -> None:
        """Slabs that do not scatter: T alone."""
        chosen, s, frame = self.items.clear, self.sizes, self.frame
        if not chosen.any():
            return
        items, thickness = self.where(chosen), np.where(chosen, self.items.thickness, 0.0)
        uploaded = self.session.constant(thickness)
        shape = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(s.stokes)
        nodes = self.session.constant(frame.nodes)
        self.session.launch("clear_nodes", (items.size,), *shape, uploaded, nodes, T.data, items)
        self.algebra.go_straight(items, FADE, uploaded, self.with_rates(T), T)
        turned = chosen & self.items.turned
        if turned.any():
            self.turn_both(self.where(turned), T)
            v, _ = turning(frame)
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
        below changes nothing. e and f hold alpha and beta: (1/mu + 1/mu0) R = -(alpha R + R alpha + R beta R -
        T beta T)."""
        s, session, spare = self.sizes, self.session, self.spare
        chosen = self.doubled & (self.items.thickness > _core.THICK)
        if not chosen.any() or s.r == 0 or s.o == 0:
            return
        items, alpha, beta = self.where(chosen), self.e, self.f
        place = np.int32(s.n), np.int32(s.ld), np.int64(s.stride)
        one, none = np.float64(1.0), np.float64(0.0)
        block = *place[:1], *place[1:], np.int32(0), np.int32(s.n), one, alpha.data, none, alpha.data, spare.data
        self.algebra.each_column("add_blocks", s.r, items, *block)
        product(session, items, beta.N, R.NI, spare.NI, beta=1.0)
        product(session, items, R.ON, spare.NI, R.OI, alpha=-1.0)
        straight = *map(np.int32, (s.n, s.p, s.o, s.ld)), np.int64(s.stride), beta.data, T.OO, T.II, np.int32(s.r)
        self.algebra.each_column("lead_straight", s.columns, items, *straight, spare.data)
        product(session, items, beta.N, T.NI, spare.NI, beta=1.0)
        product(session, items, T.ON, spare.NI, R.OI, beta=1.0)
        product(session, items, alpha.ON, R.NI, R.OI, alpha=-1.0, beta=1.0)
        product(session, items, spare.ON, T.NI, R.OI, beta=1.0)
        shape = *map(np.int32, (s.n, s.p, s.o, s.ld)), np.int64(s.stride)
        self.algebra.each_column("divide_by_rates", s.r, items, *shape, self.rate_OO, self.rate_II, R.data)

    def invariance(self, R: Extended, T: Extended) -> Array:
        """How far R and T are from not caring whether a thin layer is added on top or at the bottom, relative, (item,
        2): beta + alpha R + R alpha + R beta R = T beta T and (alpha + R beta) T = T (alpha + beta R)."""
        session, algebra, alpha, beta = self.session, self.algebra, self.e, self.f
        x, y, z, items = self.a, self.b, self.spare, self.where(self.doubled)
        self.copy_nodes(items, alpha, x)
        product(session, items, R.N, beta.N, x.N, beta=1.0)
        product(session, items, R.N, alpha.N, z.N)
        sizes = [algebra.largest(items, matrix.N) for matrix in (alpha, z, beta)]
        self.copy_nodes(items, beta, z, z)
        product(session, items, x.N, R.N, z.N, beta=1.0)
        if self.finite.any():
            finite = self.where(self.finite)
            product(session, finite, T.N, beta.N, y.N)
            product(session, finite, y.N, T.N, z.N, alpha=-1.0, beta=1.0)
        missing = [algebra.largest(items, z.N)]
        if self.finite.any():
            product(session, finite, x.N, T.N, z.N)
            sizes.append(algebra.largest(finite, z.N))
            product(session, finite, T.N, alpha.N, z.N, alpha=-1.0, beta=1.0)
            product(session, finite, y.N, R.N, z.N, alpha=-1.0, beta=1.0)
            missing.append(algebra.largest(finite, z.N))
        return self.relative(
            [session.download(found) for found in missing], [session.download(found) for found in sizes]
        )

    def copy_nodes(self, items: Any, a: Extended, c: Extended, b: Extended | None = None) -> None:
        """c's N = a's N, or the sum of a's and b's."""
        s = self.sizes
        place = np.int32(s.n), np.int32(s.ld), np.int64(s.stride), np.int32(0), np.int32(0)
        other = (np.float64(0.0), a.data) if b is None else (np.float64(1.0), b.data)
        self.algebra.each_column("add_blocks", s.n, items, *place, np.float64(1.0), a.data, *other, c.data)

    def relative(self, missing: list[Array], sizes: list[Array]) -> Array:
        """R counts relative to the light that it meets, T to itself; 0 where there is nothing."""
        residual = np.zeros((self.count, 2))
        of_alpha, met, of_beta = sizes[:3]
        with np.errstate(divide="ignore", invalid="ignore"):
            largest = of_alpha * np.minimum(1.0, self.items.thickness * of_alpha)
            largest = np.maximum(np.maximum(met, of_beta), largest)
            residual[:, 0] = np.where(largest > 0.0, missing[0] / largest, 0.0)
            if len(missing) > 1:
                residual[:, 1] = np.where(self.finite & (sizes[3] > 1e-280), missing[1] / sizes[3], 0.0)
        residual[~self.doubled] = 0.0
        return residual


def double_slabs(
    session: Session,
    crew: Crew,
    *,
    orders: NDArray[np.int32],
    conserving: bool,
    clear: bool,
    settled: bool,
    material: NDArray[np.int32],
    thickness: Array,
    albedo: Array,
    asymmetry: Array,
    nodes: Array,
    weights: Array,
    mu0: Array,
    columns: Array,
    mu_out: Array,
    E: Array,
    F: Array,
    G_E: Array,
    G_F: Array,
    source_s: Array,
    source_d: Array,
    R: Array,
    T: Array,
    lost: Array,
    residual: Array,
    doublings: NDArray[np.int32],
    info: NDArray[np.int32],
) -> None:
    """`_core.double_slabs` on a device: the same arrays. settled plays no part."""
    start = time.perf_counter()
    frame = Frame(nodes, weights, mu0, columns, mu_out)
    shape = orders.size, material.size
    material_count = albedo.size
    of = (np.arange(orders.size)[:, None] * material_count + material).astype(np.int32)
    turned = np.broadcast_to((orders[:, None] == 0) & conserving, shape)
    thick, scattering, forward = (
        np.broadcast_to(values, shape).ravel() for values in (thickness, albedo[material], asymmetry[material])
    )
    items = Items(thick, scattering, forward, of.ravel(), turned.ravel(), (scattering == 0.0) & clear)
    with session.lock:
        stacks = (upload_stack(session, a.reshape(-1, *a.shape[2:])) for a in (E, F, G_E, G_F, source_s, source_d))
        found = Doubling(session, frame, items, Assembled(*stacks)).run(crew.stop)
        R[:], T[:] = (blocks(session, matrix).reshape(*shape, -1) for matrix in (found.R, found.T))
        lost[:] = session.download(found.lost).reshape(lost.shape)
        info[:] = session.download(found.info).reshape(shape)
    residual[:], doublings[:] = found.residual.reshape(residual.shape), found.doublings.reshape(shape)
    crew.seconds[0] += time.perf_counter() - start


def blocks(session: Session, matrix: Extended) -> Array:
    """(item, extended size): N, NI, ON, OI, OO, II one behind the other, as `_core` has them."""
    s = matrix.sizes
    whole = session.download(matrix.data)
    count = whole.shape[0]
    parts = (
        whole[:, : s.n, : s.n],
        whole[:, s.n :, : s.n],
        whole[:, : s.n, s.p : s.p + s.o],
        whole[:, s.n :, s.p : s.p + s.o],
    )
    straight = session.download(matrix.OO)[:, : s.o], session.download(matrix.II)[:, : s.r]
    return np.concatenate([part.reshape(count, -1) for part in (*parts, *straight)], axis=1)
