"""Fourier orders of a stack and how they change: every slab's change sends out light of its own, which the unchanged
stack passes on. The stack is solved once; each derivative is one more right-hand side of its factors."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.derivatives.changes import Change, change_escapes, find_change
from vrte.discrete_ordinates.derivatives.slab import Blocks, SlabModes, deepen_slab
from vrte.discrete_ordinates.orders.base import Base
from vrte.discrete_ordinates.orders.beam_paths import expand_lossless_base
from vrte.discrete_ordinates.orders.homogeneous import Modes, find_modes
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble, balance_flux
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.refracting import NodalStack, Piece, Refracting, share
from vrte.discrete_ordinates.orders.slab_response import Response, respond_by_doubling
from vrte.scene.boundary import Boundary
from vrte.scene.variation import Variation


@dataclass(frozen=True, eq=False)
class ChangedOrders:
    """Of some Fourier orders, for each variation: kernels (variation, order, n_tau, n_in, n_col, n_out, S), as those of
    `Orders`, and of order 0 flux (variation, 2, n_tau, n_in, n_col), up and down; residual (order,): the largest gap
    between R + T by modes and by doubling."""

    kernels: Array
    flux: Array
    residual: Array


class Differentiating(Refracting):
    """The way through a stack, transparent or refracting, for its derivatives."""

    def __init__(
        self,
        problem: Problem,
        base: Boundary,
        n_order: int,
        accuracy: float,
        variations: Sequence[Variation],
        carried: int,
    ) -> None:
        super().__init__(respond_by_doubling, problem, base, n_order, accuracy)
        self.changes = [find_change(self, variation, carried) for variation in variations]
        sources = np.array(self.sources)
        members = list(problem.stokes)
        self.changed_escapes = [change_escapes(self, change, sources, members) for change in self.changes]
        self.changed_bases = [self.change_base(change, n_order, accuracy) for change in self.changes]

    def change_base(self, change: Change, n_order: int, accuracy: float) -> Base | None:
        """The derivative of the base's operators, None where it stays."""
        pairs = [(weight, boundary) for weight, boundary in change.variation.base if weight]
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

    def beams_of(self, change: Change) -> tuple[Array, Array, Array] | None:
        """Derivatives of the power of beams: falling, mirrored and arriving, as of `BeamPaths`."""
        if change.beams is None:
            return None
        members, problem = np.ix_(self.problem.stokes, self.problem.stokes), self.problem
        lit, columns = problem.mu0[:, None, None], problem.columns.T
        parts = change.beams.entering[:-1], change.beams.leaving[1:], change.beams.arriving[-1]
        falling, mirrored, arriving = (lit * (part[..., members[0], members[1]] @ columns) for part in parts)
        return falling, mirrored, arriving

    def is_alone(self, order: int) -> bool:
        """Whether the one slab there is meets no light but the beam, and the order carries no flux."""
        mirrors = any(
            part is not None and (part.above is not None or part.below is not None) for part in self.interface_operators
        )
        flux = self.problem.conserves and order == 0
        return self.cut.layer.size == 1 and self.base is None and not (mirrors or self.rough or flux)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        n = self.problem.size + len(self.problem.stokes) * (self.problem.mu0.size + 2 * self.sights.cosines.shape[1])
        return count_orders_at_once((16.0 * len(self.places.slab) + 12.0) * n * n, threads)

    def differentiate(self, orders: IntArray, run: Run) -> ChangedOrders:
        """Derivatives of the given orders."""
        problem = self.problem
        # R and T are needed where slabs light each other, and for their change with thickness
        needed = any(change.pieces.any() for change in self.changes) or not all(map(self.is_alone, orders.tolist()))
        responses = [
            self.respond(one, material, thickness, orders, run) if needed else []
            for _, one, material, thickness in self.places.media
        ]
        sheets = [assemble(one, orders, run) for _, one, _, _ in self.places.media]
        scattering = any(any(change.scatters) for change in self.changes)
        modes = [
            find_modes(one, orders, sheet, run, True) if scattering else None
            for (_, one, _, _), sheet in zip(self.places.media, sheets, strict=True)
        ]
        turned = self.assemble_changes(orders, run)
        shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0], problem.mu_out.size)
        kernels = np.zeros((len(self.changes), orders.size, *shape, len(problem.stokes)))
        flux = np.zeros((len(self.changes), 2, problem.level.size, problem.n_rhs))
        residual = np.zeros(orders.size)

        def solve(index: int) -> None:
            order = OrderOfStack(self, index, int(orders[index]), responses, sheets, modes)
            for k, (light, fluxes) in enumerate(order.change_all(turned)):
                kernels[k, index] = light
                if problem.conserves and orders[index] == 0:
                    flux[k] = fluxes
            residual[index] = order.residual

        with run.timed("derivatives"):
            if run.threads > 1 and orders.size > 1:
                with ThreadPoolExecutor(run.threads) as pool:
                    list(pool.map(solve, range(orders.size)))
            else:
                for index in range(orders.size):
                    solve(index)
        return ChangedOrders(kernels, flux.reshape(*flux.shape[:3], *shape[1:3]), residual)

    def assemble_changes(self, orders: IntArray, run: Run) -> list[dict[int, Assembled]]:
        """For each change, by layer: what the phase matrix's change makes of E and F, less the rates of the nodes."""
        found: list[dict[int, Assembled]] = []
        for change in self.changes:
            mine: dict[int, Assembled] = {}
            for k, scatters in enumerate(change.scatters):
                if not scatters:
                    continue
                medium = self.media.scene.indices[k]
                one = next(one for index, one, _, _ in self.places.media if index == medium)
                table = np.ascontiguousarray(change.layers[k].scattering[None])
                own = replace(one, coefficients=table, terms=np.array([table.shape[1]], np.int32), albedo=np.ones(1))
                matrices = assemble(own, orders, run)
                if own.conserves and 0 in orders and own.is_exact:  # to the last digit, where little is lost
                    balance_flux(own, matrices, int(np.argmax(orders == 0)))
                rates = np.repeat(1.0 / own.nodes, len(own.stokes))
                for part in (matrices.E, matrices.F):
                    part[..., np.arange(own.size), np.arange(own.size)] -= rates
                mine[k] = matrices
            found.append(mine)
        return found


def take_blocks(one: Problem, matrices: Assembled, index: int, layer: int) -> tuple[Blocks, Blocks]:
    """E and F on nodes and directions off them, as core/extended.pxi has them."""
    rows = np.repeat(one.mu_out, len(one.stokes))[:, None]
    corner = np.zeros((rows.size, matrices.source_d.shape[2]))
    E = Blocks(
        matrices.E[index, layer].T, -matrices.source_d[index, layer].T, -matrices.G_E[index, layer].T / rows, corner
    )
    F = Blocks(
        matrices.F[index, layer].T, -matrices.source_s[index, layer].T, -matrices.G_F[index, layer].T / rows, corner
    )
    return E, F


def take_modes(modes: Modes, index: int, layer: int) -> tuple[Array, Array, Array]:
    """lambda (n,), complex where pairs are, X and Y (n, n) of one order and layer, pairs as real columns."""
    lam, oscillation = modes.lam_re[index, layer], modes.lam_im[index, layer]
    return lam + 1j * oscillation if oscillation.any() else lam, modes.X[index, layer].T, modes.Y[index, layer].T


class OrderOfStack:
    """One order of a stack, solved, and its slabs' modes where they are asked for."""

    def __init__(
        self,
        route: Differentiating,
        index: int,
        order: int,
        responses: list[list[Response]],
        sheets: list[Assembled],
        modes: list[Modes | None],
        alone: bool = True,
    ) -> None:
        self.route, self.place, self.order, self.sheets, self.modes = route, index, order, sheets, modes
        self.responses = [responses[medium][own] if responses[medium] else None for medium, own in route.places.slab]
        self.is_alone = alone and route.is_alone(order)
        self.known: dict[int, SlabModes] = {}
        self.residual = 0.0
        self.sent: Array | None = None
        if not self.is_alone:
            self.pieces = [
                Piece(self.response_of(piece), index, *self.medium_of(piece)) for piece in range(route.cut.layer.size)
            ]
            self.slab_stack = NodalStack(route, order, self.pieces)
            self.slab_stack.upward_sweep()
            self.slab_stack.downward_sweep()

    def response_of(self, piece: int) -> Response:
        """The reflection and transmission that doubling found of a piece's slab."""
        found = self.responses[int(self.route.places.of[piece])]
        assert found is not None
        return found

    def medium_of(self, piece: int) -> tuple[float, Array]:
        """The index around a piece, and the cosines of beams there."""
        layer = int(self.route.cut.layer[piece])
        return self.route.media.scene.media[1 + layer], self.route.into[1 + layer]

    def slab_of(self, piece: int) -> tuple[Problem, int, int, float]:
        """A piece's problem, medium, material and thickness."""
        medium, own = self.route.places.slab[int(self.route.places.of[piece])]
        _, one, material, thickness = self.route.places.media[medium]
        return one, medium, int(material[own]), float(thickness[own])

    def response_blocks(self, piece: int) -> tuple[Blocks, Blocks]:
        """Reflection and transmission of a piece's slab as matrices."""
        response, k = self.response_of(piece), self.place
        n = response.nodes.shape[-1]
        r, o = int(np.prod(response.entering.shape[-2:])), int(np.prod(response.leaving.shape[2:4]))
        R, T = (
            Blocks(
                response.nodes[k, way],
                response.entering[k, way].reshape(n, r),
                response.leaving[k, way].reshape(o, n),
                response.passing[k, way].reshape(o, r),
            )
            for way in (0, 1)
        )
        return R, T

    def modes_of(self, piece: int) -> SlabModes:
        """A piece's slab by its modes, found once."""
        which = int(self.route.places.of[piece])
        if which not in self.known:
            one, medium, material, thickness = self.slab_of(piece)
            E, F = take_blocks(one, self.sheets[medium], self.place, material)
            modes = self.modes[medium]
            assert modes is not None
            found = SlabModes(E, F, *take_modes(modes, self.place, material), one.mu0, one.mu_out, thickness)
            if self.responses[which] is not None:
                R, T = self.response_blocks(piece)
                both = 2.0 * found.X @ found.even.nodes - np.eye(one.size)
                self.residual = max(self.residual, float(np.abs(both - R.N - T.N).max()))
            self.residual = max(self.residual, float(modes.residual[self.place, material]))
            self.known[which] = found
        return self.known[which]

    def change_slab(
        self, piece: int, change: Change, turned: dict[int, Assembled], on_nodes: bool
    ) -> tuple[Blocks, Blocks] | None:
        """How a piece's R and T change, None where they do not; without those ``on_nodes``, OI alone."""
        layer = int(self.route.cut.layer[piece])
        deeper = float(change.pieces[piece])
        if layer not in turned and deeper == 0.0:
            return None
        one, medium, material, thickness = self.slab_of(piece)
        found = None
        if layer in turned:
            found = self.modes_of(piece).differentiate(*take_blocks(one, turned[layer], self.place, 0), on_nodes)
        if deeper:
            R, T = self.response_blocks(piece)
            stokes = len(one.stokes)
            into, out = np.repeat(one.mu0, stokes), np.repeat(one.mu_out, stokes)
            E, F = take_blocks(one, self.sheets[medium], self.place, material)
            decays = np.exp(-thickness / into), np.exp(-thickness / out)
            more = deepen_slab(E, F, R, T, out, *decays)
            if not on_nodes:
                nothing = np.zeros((0, 0))
                more = Blocks(nothing, nothing, nothing, more[0].OI), Blocks(nothing, nothing, nothing, more[1].OI)
            if found is None:
                return more[0].times(deeper), more[1].times(deeper)
            found = found[0].plus(more[0], deeper), found[1].plus(more[1], deeper)
        return found

    def make_changed_piece(self, piece: int, dR: Blocks, dT: Blocks) -> Piece:
        """Changes of R and T, to be applied as they are themselves."""
        old = self.pieces[piece]
        shapes = old.response
        changed = Response(
            np.stack([dR.N, dT.N])[None],
            np.stack([dR.NI, dT.NI]).reshape(1, *shapes.entering.shape[1:]),
            np.stack([dR.ON, dT.ON]).reshape(1, *shapes.leaving.shape[1:]),
            np.stack([dR.OI, dT.OI]).reshape(1, *shapes.passing.shape[1:]),
            {},
        )
        return Piece(changed, 0, old.index, old.into)

    def change_alone(self, change: Change, turned: dict[int, Assembled]) -> tuple[Array, Array]:
        """As `change`, of a slab that is alone."""
        route, problem = self.route, self.route.problem
        index, into = self.medium_of(0)
        sent = np.zeros((2, route.sights.cosines.shape[1], len(problem.stokes), problem.n_rhs))
        changed = self.change_slab(0, change, turned, on_nodes=False)
        if changed is not None:
            light = route.falling[0] / into[:, None, None] / index**2
            stokes = len(problem.stokes)
            for way, blocks in enumerate(changed):
                passing = blocks.OI.reshape(-1, stokes, into.size, stokes)
                sent[way] = np.einsum("osia,iac->osic", passing, light).reshape(sent.shape[1:])
        return route.look(sent), np.zeros((2, problem.level.size, problem.n_rhs))

    def change_all(self, turned: list[dict[int, Assembled]]) -> list[tuple[Array, Array]]:
        """Of each change the derivatives of what is seen, (n_tau, n_in, n_col, n_out, S), and of the fluxes, (2, n_tau,
        r): the light that all of them send out goes through the stack together."""
        route = self.route
        if self.is_alone:
            return [self.change_alone(change, own) for change, own in zip(route.changes, turned, strict=True)]
        if not route.changes:
            return []
        slab_stack, r = self.slab_stack, self.slab_stack.r
        parts = [self.change_parts(change, k, turned[k]) for k, change in enumerate(route.changes)]
        sources = [
            (np.hstack([part.sources[k][0] for part in parts]), np.hstack([part.sources[k][1] for part in parts]))
            for k in range(len(self.pieces))
        ]
        rough = {
            index: (
                np.hstack([part.rough[index][0] for part in parts]),
                np.hstack([part.rough[index][1] for part in parts]),
            )
            for index in route.rough_interfaces
        }
        tangent = TangentStack(slab_stack, sources, np.hstack([part.below for part in parts]), rough)
        tangent.upward_sweep()
        tangent.downward_sweep()
        sent = self.send(tangent)
        found = []
        for k, part in enumerate(parts):
            own = slice(k * r, (k + 1) * r)
            light = route.look(sent[..., own] + self.send_changed(part))
            escapes = route.changed_escapes[k]
            if escapes is not None:
                light = light + route.look(self.value_sent(), escapes)
            flux = np.zeros((2, route.problem.level.size, r))
            if route.problem.conserves and self.order == 0:
                fields = (tangent.arriving, tangent.leaving, tangent.entering, tangent.rising)
                flux = route.sum_fluxes(*([one[:, own] for one in field] for field in fields))
            found.append((light, flux))
        return found

    def change_parts(self, change: Change, number: int, turned: dict[int, Assembled]) -> "Parts":
        """What a change does to the slabs, the base and the beams, and the light that they send out for it."""
        route, slab_stack = self.route, self.slab_stack
        base, beams = route.changed_bases[number], route.beams_of(change)
        blocks = [self.change_slab(k, change, turned, on_nodes=True) for k in range(len(self.pieces))]
        moved = [None if own is None else self.make_changed_piece(k, *own) for k, own in enumerate(blocks)]
        sources = []
        for k, (piece, own) in enumerate(zip(self.pieces, moved, strict=True)):
            up, down = np.zeros((slab_stack.n, slab_stack.r)), np.zeros((slab_stack.n, slab_stack.r))
            if own is not None:
                above, below = slab_stack.entering[k], slab_stack.leaving[k + 1]
                up, down = own.send_to_nodes(slab_stack.n, route.falling[k], route.mirrored[k])
                up = up + own.scatter(above, 0) + own.scatter(below, 1)
                down = down + own.scatter(above, 1) + own.scatter(below, 0)
            if beams is not None:
                more = piece.send_to_nodes(slab_stack.n, beams[0][k], beams[1][k])
                up, down = up + more[0], down + more[1]
            sources.append((up, down))
        return Parts(moved, base, beams, sources, self.change_below(base, beams), self.change_rough(change))

    def change_rough(self, change: Change) -> dict[int, tuple[Array, Array]]:
        """What changed beams send to the nodes at rough interfaces, going up above and down below, by interface."""
        route = self.route
        found: dict[int, tuple[Array, Array]] = {}
        if change.beams is None:
            dark = np.zeros((self.slab_stack.n, self.slab_stack.r))
            return dict.fromkeys(route.rough_interfaces, (dark, dark))
        members, problem = np.ix_(route.problem.stokes, route.problem.stokes), route.problem
        for index, rough in route.rough_interfaces.items():
            falls, rises = (
                problem.mu0[:, None, None] * (part[index][..., members[0], members[1]] @ problem.columns.T)
                for part in (change.beams.arriving, change.beams.rising)
            )
            order = self.order
            found[index] = (
                rough.above.collect(order, falls) + rough.up.collect(order, rises),
                rough.down.collect(order, falls) + rough.below.collect(order, rises),
            )
        return found

    def change_below(self, base: Base | None, beams: tuple[Array, Array, Array] | None) -> Array:
        """What the base sends up of changed beams, and, itself changed, of all light, (n, r)."""
        route, slab_stack = self.route, self.slab_stack
        found = np.zeros((slab_stack.n, slab_stack.r))
        if base is not None:
            matrix, light = route.reflect_on_base(self.order, base)
            found += light if matrix is None else light + matrix @ slab_stack.arriving[-1]
        if beams is not None and route.base is not None:
            found += route.reflect_on_base(self.order, arriving=beams[2])[1]
        return found

    def value_sent(self) -> Array:
        """All light that is sent out along the sights, (source, n_sight, S, r), unchanged."""
        if self.sent is None:
            beams = self.route.falling, self.route.mirrored, self.route.arriving
            self.sent = self.send(self.slab_stack) + self.send_beams(beams)
        return self.sent

    def send(self, slab_stack: NodalStack) -> Array:
        """What light on the nodes (n, r) of a stack like this one sends along the sights, (source, n_sight, S, r)."""
        route = self.route
        shape = len(route.sources), route.sights.cosines.shape[1], len(route.problem.stokes), slab_stack.r
        sent = np.zeros(shape)
        for k, piece in enumerate(self.pieces):
            dark = np.zeros_like(route.falling[k])
            sent[2 * k], sent[2 * k + 1] = piece.send(slab_stack.entering[k], slab_stack.leaving[k + 1], dark, dark)
        for k, (index, rough) in enumerate(route.rough_interfaces.items(), len(self.pieces)):
            arriving, rising = slab_stack.arriving[index], slab_stack.rising[index]
            sent[2 * k] = rough.above.send(self.order, arriving) + rough.up.send(self.order, rising)
            sent[2 * k + 1] = rough.below.send(self.order, rising) + rough.down.send(self.order, arriving)
        if route.base is not None:
            sent[-1] = route.leave_base(self.order, slab_stack.arriving[-1])
        return sent

    def send_beams(self, beams: tuple[Array, Array, Array]) -> Array:
        """The same of beams alone, falling and mirrored power."""
        route = self.route
        dark = np.zeros((self.slab_stack.n, self.slab_stack.r))
        sent = np.zeros(
            (len(route.sources), route.sights.cosines.shape[1], len(route.problem.stokes), self.slab_stack.r)
        )
        for k, piece in enumerate(self.pieces):
            sent[2 * k], sent[2 * k + 1] = piece.send(dark, dark, beams[0][k], beams[1][k])
        return sent

    def send_changed(self, part: "Parts") -> Array:
        """What changed beams, changed slabs and a changed base send along the sights."""
        route, slab_stack = self.route, self.slab_stack
        shape = len(route.sources), route.sights.cosines.shape[1], len(route.problem.stokes), slab_stack.r
        sent = np.zeros(shape) if part.beams is None else self.send_beams(part.beams)
        for k, own in enumerate(part.moved):
            if own is not None:
                up, down = own.send(
                    slab_stack.entering[k], slab_stack.leaving[k + 1], route.falling[k], route.mirrored[k]
                )
                sent[2 * k] += up
                sent[2 * k + 1] += down
        if part.base is not None:
            sent[-1] += route.leave_base(self.order, slab_stack.arriving[-1], part.base)
        return sent


@dataclass(frozen=True, eq=False)
class Parts:
    """One change in a stack: how its pieces, its base and its beams change, None where they do not, and what these send
    out: of each piece up and down (n, r), of the base, and at rough interfaces up and down."""

    moved: list[Piece | None]
    base: Base | None
    beams: tuple[Array, Array, Array] | None
    sources: list[tuple[Array, Array]]
    below: Array
    rough: dict[int, tuple[Array, Array]]


class TangentStack(NodalStack):
    """Light that changes send out, passed on by a stack that is solved already."""

    def __init__(
        self,
        slab_stack: NodalStack,
        sources: list[tuple[Array, Array]],
        below: Array,
        rough: dict[int, tuple[Array, Array]],
    ) -> None:
        self.route, self.order, self.pieces, self.n, self.r = (
            slab_stack.route,
            slab_stack.order,
            slab_stack.pieces,
            slab_stack.n,
            below.shape[1],
        )
        self.residual, self.interface_operators, self.beams, self.below = (
            0.0,
            slab_stack.interface_operators,
            sources,
            below,
        )
        self.seen, self.seen_below, self.at_joint, self.in_slab = (
            slab_stack.seen,
            slab_stack.seen_below,
            slab_stack.at_joint,
            slab_stack.in_slab,
        )
        dark, count = np.zeros((self.n, self.r)), len(slab_stack.pieces) + 1
        self.arriving, self.leaving, self.entering, self.rising = ([dark] * count for _ in range(4))
        self.own, self.own_below = [dark] * count, [dark] * count
        self.leaving_beams, self.entering_beams = [dark] * count, [dark] * count
        for index, (leaving, entering) in rough.items():
            self.leaving_beams[index], self.entering_beams[index] = leaving, entering

    def put_slab(self, k: int) -> None:
        """Its own light and that from below, up at the top of slab k."""
        piece, (up, down), factors, seen = self.pieces[k], self.beams[k], self.in_slab[k], self.seen[k + 1]
        own = self.own[k + 1]
        if seen is not None:
            assert factors is not None
            own = factors.solve(seen @ down + own)
        self.own_below[k] = up + piece.scatter(own, 1)

    def add_interface(self, k: int, last: int) -> None:
        """What goes up above interface k."""
        sharing, seen, own = self.interface_operators[k], self.seen_below[k], self.own_below[k]
        if k == last and self.route.base is not None:
            self.own[k] = self.below
            return
        if sharing is None:
            self.own[k] = own
            return
        if seen is not None:
            own = own + seen @ self.entering_beams[k]
            factors = self.at_joint[k]
            own = own if factors is None else factors.solve(own)
        self.own[k] = share(sharing.up, own) + self.leaving_beams[k]
