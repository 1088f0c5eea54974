"""Fourier orders of a stack and how they change. Each number of a result weighs light wherever it sets out: weights are
fields of the transposed stack, and tell what the light counts for that a change sends out."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import DERIVATIVE_BYTES, count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.changes import Change, move_problem
from vrte.discrete_ordinates.derivatives.real_slab import RESPONSE, RealSlab, lay_faces
from vrte.discrete_ordinates.derivatives.slab import (
    DIM,
    Blocks,
    Faces,
    SlabModes,
    group_by_gaps,
)
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.beam_paths import expand_lossless_base
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.media import ARRIVING, ENTERING, LEAVING, RISING
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble, balance_flux
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.refracting import CUT, ROUGH, SMOOTH, Medium, Refracting, Slabs, spread
from vrte.discrete_ordinates.orders.slab_response import Response, respond_by_doubling
from vrte.scene.boundary import BLACK, Boundary

Moved = list[tuple[float, Refracting]]
Matrices = TypeVar("Matrices", Assembled, Modes)
REVERSED = {RISING: ENTERING, ENTERING: RISING, ARRIVING: LEAVING, LEAVING: ARRIVING}
FACETS = 1e-8  # accuracy of integrals over facets whose differences are derivatives
ALLOWED = 1e-9  # largest residual of modes and of what slabs do for which derivatives by modes are used


@record
class ChangedOrders:
    """Of some Fourier orders, for each variation: kernels (variation, order, n_tau, n_in, n_col, n_out, S), as those of
    `Orders`, and of order 0 flux (variation, 2, n_tau, n_in, n_col), up and down; residual (order,)."""

    kernels: Array
    flux: Array
    residual: Array


@record
class Piece:
    """A slab in the stack: its place, layer and medium, material and slab of this, and light along directions off the
    nodes, over the index of refraction: beams (n_in S, r) and weights of sights (n_sight S, r_weights)."""

    place: int
    layer: int
    medium: int
    material: int
    slab: int
    beams: tuple[Array, Array]
    sights: tuple[Array, Array]


class Differentiating(Refracting):
    """The way through a stack, transparent or refracting, for its derivatives."""

    def __init__(
        self,
        problem: Problem,
        base: Boundary,
        n_order: int,
        accuracy: float,
        changes: Sequence[tuple[Change, Array | None]] = (),
    ) -> None:
        super().__init__(self.refuse, problem, base, n_order, accuracy)
        self.changes, self.quick = [change for change, _ in changes], problem.skip_flags.symmetric
        self.changed_bases = [self.change_base(change, n_order, accuracy) for change in self.changes]
        self.moved = [self.move(change, base, n_order, accuracy) for change in self.changes]
        members, sources = list(problem.stokes), len(self.sources)
        self.changed_escapes = [
            None if escapes is None else escapes[:, :, members, :sources][..., members] for _, escapes in changes
        ]
        self.weighing = self.weigh_sources(self.escapes)
        self.pieces = list(self.list_pieces())

    @staticmethod
    def refuse(*given: object) -> Response:
        """Slabs are found with their modes."""
        raise NotImplementedError

    def weigh_sources(self, escapes: Array) -> Array:
        """What is seen of unit light sent out along each sight by each source, times its medium's share: (source,
        n_sight S, r_weights), r_weights = n_tau n_out S."""
        problem, stokes = self.problem, len(self.problem.stokes)
        n_tau, n_out = self.sights.place.shape
        found = np.zeros((len(self.sources), self.sights.cosines.shape[1], stokes, n_tau, n_out, stokes))
        at, out = np.arange(n_tau)[:, None], np.arange(n_out)
        share = np.where(out[:, None] < problem.n_up, problem.flip, 1.0) / (2.0 * np.pi)
        seen = escapes * self.sights.index[:, None, None, None, None] ** 2 * share[:, :, None, None]
        found[:, self.sights.place, :, at, out] = seen.transpose(0, 1, 3, 4, 2)
        return found.reshape(len(self.sources), -1, n_tau * n_out * stokes)

    def list_pieces(self) -> Iterator[Piece]:
        """The pieces, medium by medium."""
        for number, medium in enumerate(self.each):
            for k, slab in zip(medium.pieces.tolist(), medium.of.tolist(), strict=True):
                layer = int(self.cut.layer[k])
                into, powers = self.into[1 + layer][:, None, None], (self.falling[k], self.mirrored[k])
                falling, rising = (lay_out(spread(power, into) / medium.index) for power in powers)
                up, down = self.weighing[2 * k : 2 * k + 2] / medium.index
                yield Piece(k, layer, number, int(medium.material[slab]), slab, (falling, rising), (up, down))

    def change_base(self, change: Change, n_order: int, accuracy: float) -> Base | None:
        """The derivative of the base's operators, None where it stays."""
        pairs = change.base
        if not pairs or self.base is None:
            return None
        index, place = self.media.scene.media[-1], len(self.media.scene.media) - 1
        one = self.of_medium(index, place)
        parts = [(weight, expand_lossless_base(boundary, one, n_order, accuracy)) for weight, boundary in pairs]
        rows = max(int(part.row.max()) for _, part in parts) + 1
        found = [np.zeros((rows, *getattr(parts[0][1], name).shape[1:])) for name in ("matrix", "source", "out")]
        for weight, part in parts:
            count = int(part.row.max()) + 1
            for total, name in zip(found, ("matrix", "source", "out"), strict=True):
                total[:count] += weight * getattr(part, name)[:count]
        order = np.arange(n_order, dtype=np.int32)
        return Base(np.where(order < rows, order, np.int32(-1)), found[0], found[1], found[2])

    def move(self, change: Change, base: Boundary, n_order: int, accuracy: float) -> Moved:
        """The stacks whose weighted operators are the derivatives of what is no layer."""
        found = []
        for weight, media in change.moved:
            below = media.scene.below if base.orders_reflected else BLACK
            given = move_problem(self.problem, media), below, n_order, min(accuracy, FACETS)
            found.append((weight, Refracting(self.refuse, *given)))
        return found

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        n = self.problem.size + max(self.problem.n_rhs, self.problem.rows_out, self.weighing.shape[-1])
        return count_orders_at_once(
            (16.0 * sum(one.material.size for one in self.each) + 12.0) * n * n, threads, DERIVATIVE_BYTES
        )

    def differentiate(self, orders: IntArray, run: Run) -> ChangedOrders:
        """Derivatives of the given orders."""
        fields, problem, count = Fields(self, orders, run), self.problem, len(self.changes)
        turned = [self.assemble_change(change, orders, run) for change in self.changes]
        moved = [fields.move_slabs(moved, own, run) for moved, own in zip(self.moved, turned, strict=True)]

        def change(number: int) -> Array:
            return fields.change(self.changes[number], number, turned[number], moved[number])

        with run.timed("derivatives"):
            if run.threads > 1 and count > 1:
                with ThreadPoolExecutor(run.threads) as pool:
                    found = list(pool.map(change, range(count)))
            else:
                found = [change(k) for k in range(count)]
        n_tau, n_out = self.sights.place.shape
        seen = n_tau * n_out * len(problem.stokes)
        both = np.stack(found)
        kernels = both[:, :, :seen].reshape(
            count, orders.size, n_tau, n_out, -1, problem.mu0.size, problem.columns.shape[0]
        )
        flux = np.zeros((count, 2, n_tau, problem.mu0.size, problem.columns.shape[0]))
        if fields.has_flux:
            flux[...] = both[:, int(np.argmax(orders == 0)), seen:].reshape(flux.shape)
        return ChangedOrders(kernels.transpose(0, 1, 2, 5, 6, 3, 4), flux, fields.residual)

    def assemble_change(self, change: Change, orders: IntArray, run: Run) -> dict[int, Assembled]:
        """By layer what the phase matrix's change makes of E and F, of the orders up to its last coefficient."""
        found = {}
        for k, layer in enumerate(change.layers):
            if not layer.scattering.any():
                continue
            last = int(np.flatnonzero(layer.scattering.any(axis=1))[-1])
            some = orders[orders <= last]
            if not some.size:
                continue
            medium = self.media.scene.indices[k]
            one = next(one.problem for one in self.each if one.index == medium)
            table = np.ascontiguousarray(layer.scattering[None, : last + 1])
            own = replace_unchecked(one, coefficients=table, terms=np.array([last + 1], np.int32), albedo=np.ones(1))
            matrices = assemble(own, some, run)
            diagonal = np.arange(own.size)
            rates = np.zeros((own.size, own.size))
            rates[diagonal, diagonal] = np.repeat(1.0 / own.nodes, len(own.stokes))
            if (rates == matrices.E).all() and (rates == matrices.F).all():
                continue  # it is of other Stokes parameters
            if own.conserves and 0 in some and own.is_exact:  # to the last digit, where little is lost
                balance_flux(own, matrices, int(np.argmax(some == 0)))
            for part in (matrices.E, matrices.F):
                part -= rates
            found[k] = matrices
        return found


def is_dim(medium: Medium) -> bool:
    """Whether a slab may let so little light through that it is doubled: right relative to that light itself."""
    return bool((np.isfinite(medium.thickness) & (medium.thickness > DIM)).any())


def lay_out(beams: Array) -> Array:
    """Beams (n_in, S, n_col) as columns of their own, (n_in S, n_in n_col)."""
    n_in, stokes, columns = beams.shape
    found = np.zeros((n_in, stokes, n_in, columns))
    at = np.arange(n_in)
    found[at, :, at] = beams
    return found.reshape(n_in * stokes, n_in * columns)


def take_orders(of: Matrices, some: IntArray) -> Matrices:
    """Matrices or modes in some orders, ascending."""
    first = some.size == some[-1] + 1
    return type(of)(*(part[: some.size] if first else part[some] for part in vars(of).values()))


class Fields:
    """Some orders of a stack, solved: all light on its nodes, (order, interface, 4, r, n), and what light that sets out
    weighs, (order, interface, 4, r_weights, n), at the place of its reverse."""

    def __init__(self, route: Differentiating, orders: IntArray, run: Run) -> None:
        self.route, self.orders = route, orders
        self.sheets = [assemble(one.problem, orders, run) for one in route.each]
        self.modes = [
            find_modes(one.problem, orders, sheet, run, route.quick)
            for one, sheet in zip(route.each, self.sheets, strict=True)
        ]
        self.run = run
        self.known: dict[tuple[int, int], list[tuple[IntArray, RealSlab | SlabModes]]] = {}
        self.slabs = [(one, self.respond(number)) for number, one in enumerate(route.each)]
        residuals = [modes.residual.max(axis=1) for modes in self.modes]
        residuals += [
            each.max(axis=0)
            for _, found in self.slabs
            for key, each in found.residuals.items()
            if key != "residual_of_transmission"
        ]
        self.residual = np.max(residuals, axis=0)
        worst = float(self.residual.max())
        if not worst <= ALLOWED:
            raise AccuracyError(f"modes have residuals of {worst:.2g}, allowed {ALLOWED:g}")
        self.light = route.set_out(orders, self.slabs)
        route.join(orders, self.slabs, self.light, run)
        self.has_flux = route.problem.conserves and orders[0] == 0
        self.weights, self.extra = self.weigh_light(run)
        self.terms: dict[int, list[tuple[IntArray, RealSlab | SlabModes, Any]]] = {}
        self.sent: Array | None = None

    def respond(self, number: int, beside: Problem | None = None) -> Response:
        """What the slabs of a medium do to all light, or along the directions of another problem near its own."""
        medium, orders, sheets, run = self.route.each[number], self.orders, self.sheets[number], self.run
        one, count = beside or medium.problem, medium.thickness.size
        if beside is not None:
            sheets = assemble(one, orders, run)
        if is_dim(medium):
            return respond_by_doubling(one, medium.material, medium.thickness, orders, run, sheets)
        n, r, o = one.size, one.n_rhs, one.rows_out
        shapes = (n, n), (r, n), (n, o), (r, o)  # as the core has them, columns first
        parts = [np.empty((count, orders.size, 2, *shape)).swapaxes(-1, -2) for shape in shapes]
        residual = np.empty((count, orders.size))
        for slab in range(count):
            for some, modes in self.slab_modes(number, slab):
                if beside is not None:
                    modes = modes.turn(one, take_orders(sheets, some))
                residual[slab, some] = modes.residual
                for part, own in zip(parts, modes.respond(), strict=True):
                    part[slab, some] = own
        return Response(parts[0], parts[1], parts[2], parts[3], {"residual_of_boundary": residual})

    def weigh_light(self, run: Run) -> tuple[Array, int]:
        """What light that sets out on the nodes weighs, and how many fluxes follow what is seen."""
        route, problem = self.route, self.route.problem
        seen, n_tau = route.weighing.shape[-1], route.cut.at.size
        extra = 2 * n_tau if self.has_flux else 0
        found = np.zeros((*self.light.shape[:3], seen + extra, problem.size))
        for piece in route.pieces:
            R, T = self.blocks_of(piece)
            own = found[..., :seen, problem.size - R.N.shape[-1] :]
            (top, bottom), k = piece.sights, piece.place
            own[:, k, RISING] += top.T @ R.ON + bottom.T @ T.ON
            own[:, k + 1, ARRIVING] += top.T @ T.ON + bottom.T @ R.ON
        for k, (index, rough) in enumerate(route.rough_interfaces.items(), route.cut.layer.size):
            for source, ways in ((2 * k, (rough.above, rough.up)), (2 * k + 1, (rough.down, rough.below))):
                for way, part in zip((LEAVING, ENTERING), ways, strict=True):
                    found[:, index, way, :seen] += part.weigh(self.orders, route.weighing[source])
        if route.base is not None:
            row = route.base.row[self.orders]
            out = route.base.out[row[row >= 0]].swapaxes(1, 2) / route.media.scene.media[-1]
            count = out.shape[-1]
            found[row >= 0, -1, LEAVING, :seen, problem.size - count :] += route.weighing[-1].T @ out
        if extra:
            self.weigh_flux(found[0], seen)
        above = found[:, 0, ARRIVING].copy()  # what comes down upon the top goes on as what lies there lets it
        found[:, 0, ARRIVING] = 0.0
        if extra and route.kind[0] == SMOOTH:
            found[:, 0, ENTERING] += self.pass_smooth(above, route.blocks[0, 3])
        elif extra and route.kind[0] == ROUGH:
            found[:, 0, ENTERING] += above @ route.rough_interfaces[0].up.nodes[self.orders]
        elif extra:
            R, T = self.blocks_of(next(piece for piece in route.pieces if piece.place == 0))
            first = problem.size - R.N.shape[-1]
            found[:, 0, RISING, :, first:] += above[..., first:] @ R.N
            found[:, 1, ARRIVING, :, first:] += above[..., first:] @ T.N
        below = found[:, -1, RISING].copy()  # as much of what rises upon the bottom from below
        found[:, -1, RISING] = 0.0
        if extra and route.kind[-1] == SMOOTH:
            found[:, -1, LEAVING] += self.pass_smooth(below, route.blocks[-1, 2])
        elif extra and route.kind[-1] == ROUGH:
            found[:, -1, LEAVING] += below @ list(route.rough_interfaces.values())[-1].down.nodes[self.orders]
        elif extra:
            found[:, -1, LEAVING] += below
        route.join(self.orders, self.slabs, found, run, transposed=True)
        found[:, 0, ARRIVING], found[:, -1, RISING] = above, below
        if route.kind[0] == CUT:
            found[:, 0, ENTERING] += above
        return found, extra

    def pass_smooth(self, weights: Array, blocks: Array) -> Array:
        """Weights (order, r, n) of light behind a smooth interface, of ``blocks`` (n, S), as those of what meets it."""
        each = blocks.reshape(-1, *2 * [len(self.route.problem.stokes)])
        lit = weights.reshape(*weights.shape[:2], *each.shape[:2])
        return np.einsum("orja,jab->orjb", lit, each).reshape(weights.shape)

    def weigh_flux(self, found: Array, seen: int) -> None:
        """Puts what fluxes weigh into order 0 (interface, 4, r_weights, n), up at all depths, then down."""
        route = self.route
        for t, (at, under) in enumerate(zip(route.cut.at.tolist(), route.media.depths.under.tolist(), strict=True)):
            index = float(route.sights.index[t])
            nodes, weights = route.media.nodes.carried(index)
            is_cut = route.kind[at] == CUT and at < route.cut.layer.size
            for way, place in enumerate((RISING, ENTERING) if under else (LEAVING, ARRIVING)):
                source = REVERSED[place]
                if is_cut:
                    source = {ENTERING: ARRIVING, LEAVING: RISING}.get(source, source)
                own = found[at, source, seen + way * route.cut.at.size + t, :: len(route.problem.stokes)]
                own[-nodes.size :] += index * np.sqrt(weights * nodes)

    def blocks_of(self, piece: Piece) -> tuple[Blocks, Blocks]:
        """Reflection and transmission of a piece."""
        response = self.slabs[piece.medium][1]
        R, T = (
            Blocks(*(part[piece.slab, :, way] for part in (response.nodes, response.entering, response.leaving)))
            for way in (0, 1)
        )
        return R, T

    def modes_of(self, piece: Piece) -> list[tuple[IntArray, RealSlab | SlabModes, Any]]:
        """A piece by its slab's modes: places of orders, what these have, and the parts of a derivative, found once."""
        if piece.place not in self.terms:
            self.terms[piece.place] = [
                (some, modes, modes.list_terms(*self.faces_of(piece, some)))
                for some, modes in self.slab_modes(piece.medium, piece.slab)
            ]
        return self.terms[piece.place]

    def slab_modes(self, number: int, slab: int) -> list[tuple[IntArray, RealSlab | SlabModes]]:
        """A slab of a medium by its modes, found once: places of orders that go together, and what these have. Orders
        whose modes oscillate go alone where a direction is near a mode."""
        if (number, slab) not in self.known:
            medium, modes, sheets = self.route.each[number], self.modes[number], self.sheets[number]
            one, material = medium.problem, int(medium.material[slab])
            thickness = float(medium.thickness[slab])
            oscillation = modes.lam_im[:, material]
            found: list[tuple[IntArray, RealSlab | SlabModes]] = []
            real, others = (
                np.flatnonzero(oscillation.any(axis=1) == oscillates).astype(np.int32) for oscillates in (False, True)
            )
            if real.size:
                given = take_orders(sheets, real), take_orders(modes, real)
                found.append((real, RealSlab(one, *given, material, thickness, self.run)))
            lam = modes.lam_re[others, material] + 1j * oscillation[others]
            for some in group_by_gaps(lam, np.concatenate([one.mu0, one.mu_out])) if others.size else []:
                given = take_orders(sheets, others[some]), take_orders(modes, others[some])
                found.append((others[some], SlabModes(one, *given, material, thickness)))
            self.known[number, slab] = found
        return self.known[number, slab]

    def faces_of(self, piece: Piece, some: IntArray | slice = slice(None)) -> tuple[Faces, Faces]:
        """Light that enters a piece in some orders, and what weighs the light that leaves it."""
        size, k = self.slabs[piece.medium][1].nodes.shape[-1], piece.place
        nodes = [
            field[some, at, way, :, field.shape[-1] - size :].swapaxes(1, 2)
            for field in (self.light, self.weights)
            for at, way in ((k, ENTERING), (k + 1, LEAVING))
        ]
        sights = piece.sights
        if self.extra:
            sights = (np.pad(sights[0], ((0, 0), (0, self.extra))), np.pad(sights[1], ((0, 0), (0, self.extra))))
        return Faces(nodes[0], nodes[1], *piece.beams), Faces(nodes[2], nodes[3], sights[0], sights[1])

    def change(self, change: Change, number: int, turned: dict[int, Assembled], moved: Sequence[Slabs] = ()) -> Array:
        """The derivative of all that is seen, and of fluxes, (order, r_weights, r)."""
        route = self.route
        found = np.zeros((self.orders.size, self.weights.shape[3], self.light.shape[3]))
        for piece in route.pieces:
            if piece.layer in turned:
                matrices = turned[piece.layer]
                for some, modes, terms in self.modes_of(piece):
                    own = some[some < len(matrices.E)]
                    if own.size:
                        found[own] += modes.change(terms, take_orders(matrices, own))
            deeper = float(change.pieces[piece.place])
            if deeper:
                found += deeper * self.find_depth_change(piece)
        base = route.changed_bases[number]
        if base is not None:
            reflected = route.reflect_on_base(self.orders, route.arriving, base)
            reflected += route.spread_from_base(self.orders, self.light[:, -1, ARRIVING], base)
            found += self.weights[:, -1, ARRIVING] @ reflected.swapaxes(1, 2)
            sent = route.leave_base(self.orders, self.light[:, -1, ARRIVING], base)
            found[:, : route.weighing.shape[-1]] += route.weighing[-1].T @ sent.swapaxes(1, 2)
        if change.beams is not None:
            found += self.follow_beams(change)
        for (weight, stack), slabs in zip(route.moved[number], moved, strict=False):
            found += weight * self.pass_through(stack, slabs)
        escapes = route.changed_escapes[number]
        if escapes is not None:
            weighing = route.weigh_sources(escapes)
            found[:, : weighing.shape[-1]] += (weighing.swapaxes(1, 2) @ self.all_sent().swapaxes(-1, -2)).sum(axis=1)
        return found

    def find_depth_change(self, piece: Piece) -> Array:
        """The derivative with a piece's thickness of what it sends out itself."""
        medium, response = self.route.each[piece.medium], self.slabs[piece.medium][1]
        one = medium.problem
        given = lay_faces(*self.faces_of(piece)) | vars(self.sheets[piece.medium])
        for name in RESPONSE:
            given[name] = np.ascontiguousarray(getattr(response, name)[piece.slab].swapaxes(-1, -2))
        given |= {"mu0": one.mu0, "mu_out": one.mu_out, "stokes": len(one.stokes)}
        given |= {"layer": piece.material, "half": 0.5 * float(medium.thickness[piece.slab])}
        with self.run.timed("derivatives") as crew:
            found: Array = _core.deepen_slab(crew, **given)
        return found.swapaxes(1, 2)

    def move_slabs(self, moved: Moved, turned: dict[int, Assembled], run: Run) -> Sequence[Slabs]:
        """What slabs do along the directions of stacks of other surfaces; what their nodes make of E and F is added to
        how layers change."""
        route = self.route
        if all(stack.media.scene.media == route.media.scene.media for _, stack in moved):
            return [self.slabs for _ in moved]
        found: list[list[tuple[Medium, Response]]] = [[] for _ in moved]
        for number, medium in enumerate(route.each):
            one, others = medium.problem, [stack.each[number] for _, stack in moved]
            total: dict[str, Array] = {}
            for (weight, _), other in zip(moved, others, strict=True):
                own = replace_unchecked(one, nodes=other.problem.nodes, weights=other.problem.weights)
                for name, part in vars(assemble(own, self.orders, run)).items():
                    total[name] = total.get(name, 0.0) + weight * part
            materials = {piece.layer: piece.material for piece in route.pieces if piece.medium == number}
            for layer, material in materials.items():
                more = Assembled(
                    **{name: np.ascontiguousarray(part[:, material : material + 1]) for name, part in total.items()}
                )
                if layer in turned:
                    for name, part in vars(turned[layer]).items():
                        getattr(more, name)[: len(part)] += part
                turned[layer] = more
            for slabs, other in zip(found, others, strict=True):
                beside = replace_unchecked(other.problem, nodes=one.nodes, weights=one.weights)
                slabs.append((other, self.respond(number, beside)))
        return found

    def pass_through(self, stack: Refracting, slabs: Slabs) -> Array:
        """What a stack of other surfaces makes of this stack's light, once, but for what nodes send to nodes through
        slabs: the derivative is its weighted sum."""
        orders, stokes = self.orders, len(self.route.problem.stokes)
        arriving, rising = self.light[:, :, ARRIVING], self.light[:, :, RISING]
        light = stack.set_out(orders, slabs)
        for k, blocks in zip(np.flatnonzero(stack.kind == SMOOTH).tolist(), stack.blocks, strict=True):
            above, below, down, up = blocks.reshape(4, -1, stokes, stokes).swapaxes(-1, -2)
            light[:, k, LEAVING] += self.pass_smooth(arriving[:, k], above) + self.pass_smooth(rising[:, k], up)
            light[:, k, ENTERING] += self.pass_smooth(arriving[:, k], down) + self.pass_smooth(rising[:, k], below)
        for k, rough in stack.rough_interfaces.items():
            for way, sent in zip((LEAVING, ENTERING), rough.collect(orders, arriving[:, k], rising[:, k]), strict=True):
                light[:, k, way] += sent
        if stack.base is not None:
            light[:, -1, LEAVING] += stack.spread_from_base(orders, arriving[:, -1], stack.base)
        found = self.weigh(light)
        both = stack.send(orders, slabs, self.light) + stack.send_beams(slabs, stack.falling, stack.mirrored)
        seen = stack.look(both).transpose(0, 1, 4, 5, 2, 3).reshape(orders.size, -1, found.shape[-1])
        found[:, : seen.shape[1]] += seen
        if self.extra:
            found[0, seen.shape[1] :] += stack.sum_fluxes(self.light[0]).reshape(self.extra, -1)
        return found

    def weigh(self, light: Array) -> Array:
        """What light that sets out (order, interface, 4, r, n) counts for, (order, r_weights, r)."""
        found = np.zeros((self.orders.size, self.weights.shape[3], light.shape[3]))
        for way, reverse in REVERSED.items():
            for k in np.flatnonzero(light[:, :, way].any(axis=(0, 2, 3))):
                found += self.weights[:, k, reverse] @ light[:, k, way].swapaxes(1, 2)
        return found

    def follow_beams(self, change: Change) -> Array:
        """The derivative with the power of beams of what these light."""
        route, orders = self.route, self.orders
        assert change.beams is not None
        beams, power = change.beams, route.power_of
        falling, mirrored, arriving = (
            power(part) for part in (beams.entering[:-1], beams.leaving[1:], beams.arriving[-1])
        )
        light = np.zeros_like(self.light)
        route.light_nodes(light, self.slabs, falling, mirrored)
        light[:, -1, LEAVING] += route.reflect_on_base(orders, arriving)
        for index, rough in route.rough_interfaces.items():
            rough.light(light[:, index], orders, *(power(part[index]) for part in (beams.arriving, beams.rising)))
        found = self.weigh(light)
        sent = route.send_beams(self.slabs, falling, mirrored)
        seen = route.weighing.shape[-1]
        found[:, :seen] += (route.weighing.swapaxes(1, 2) @ sent.swapaxes(-1, -2)).sum(axis=1)
        return found

    def all_sent(self) -> Array:
        """All light that is sent out along the sights, (order, source, r, n_sight S), unchanged."""
        if self.sent is None:
            route = self.route
            self.sent = route.send(self.orders, self.slabs, self.light)
            self.sent += route.send_beams(self.slabs, route.falling, route.mirrored)
        return self.sent
