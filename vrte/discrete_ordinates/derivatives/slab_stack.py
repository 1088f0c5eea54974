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
from vrte.discrete_ordinates.orders.media import ARRIVING, LEAVING, RISING
from vrte.discrete_ordinates.orders.phase_assembly import Assembled, assemble, balance_flux
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.refracting import Refracting, Slabs
from vrte.discrete_ordinates.orders.slab_response import Response, respond_by_doubling
from vrte.scene.boundary import Boundary
from vrte.scene.vary import Variation


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
        beams, power = change.beams, self.power_of
        return power(beams.entering[:-1]), power(beams.leaving[1:]), power(beams.arriving[-1])

    def is_alone(self, order: int) -> bool:
        """Whether the one slab there is meets no light but the beam, and the order carries no flux."""
        mirrors = bool(self.blocks[:, :2].any())
        flux = self.problem.conserves and order == 0
        return self.cut.layer.size == 1 and self.base is None and not (mirrors or self.rough or flux)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        n = self.problem.size + len(self.problem.stokes) * (self.problem.mu0.size + 2 * self.sights.cosines.shape[1])
        return count_orders_at_once((16.0 * sum(one.material.size for one in self.each) + 12.0) * n * n, threads)

    def differentiate(self, orders: IntArray, run: Run) -> ChangedOrders:
        """Derivatives of the given orders."""
        problem = self.problem
        # R and T are needed where slabs light each other, and for their change with thickness
        needed = any(change.pieces.any() for change in self.changes) or not all(map(self.is_alone, orders.tolist()))
        slabs = self.find_slabs(orders, run) if needed else None
        sheets = [assemble(one.problem, orders, run) for one in self.each]
        scattering = any(any(change.scatters) for change in self.changes)
        modes = [
            find_modes(one.problem, orders, sheet, run, True) if scattering else None
            for one, sheet in zip(self.each, sheets, strict=True)
        ]
        turned = self.assemble_changes(orders, run)
        shape = (problem.level.size, problem.mu0.size, problem.columns.shape[0], problem.mu_out.size)
        kernels = np.zeros((len(self.changes), orders.size, *shape, len(problem.stokes)))
        flux = np.zeros((len(self.changes), 2, problem.level.size, problem.n_rhs))
        residual = np.zeros(orders.size)

        def solve(index: int) -> None:
            order = OrderOfStack(self, index, int(orders[index]), slabs, sheets, modes)
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
                one = next(one.problem for one in self.each if one.index == medium)
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
    """One order of a stack, solved: all light on its nodes, (interface, 4, r, n), and its slabs' modes where they are
    asked for."""

    def __init__(
        self,
        route: Differentiating,
        index: int,
        order: int,
        slabs: Slabs | None,
        sheets: list[Assembled],
        modes: list[Modes | None],
        alone: bool = True,
    ) -> None:
        self.route, self.place, self.order, self.sheets, self.modes = route, index, order, sheets, modes
        self.orders = np.array([order], np.int32)
        self.slabs = [(medium, take_order(response, index)) for medium, response in slabs or ()]
        self.is_alone = alone and route.is_alone(order)
        self.known: dict[tuple[int, int], SlabModes] = {}
        self.residual = 0.0
        self.sent: Array | None = None
        if not self.is_alone:
            light = route.set_out(self.orders, self.slabs)
            route.join(self.orders, self.slabs, light, Run(1))
            self.light = light[0]

    def find_slab(self, piece: int) -> tuple[int, int]:
        """A piece's medium, and its slab among those of the medium."""
        for number, medium in enumerate(self.route.each):
            if piece in medium.pieces:
                return number, int(medium.of[np.searchsorted(medium.pieces, piece)])
        raise IndexError(piece)

    def slab_of(self, piece: int) -> tuple[Problem, int, int, float]:
        """A piece's problem, medium, material and thickness."""
        number, own = self.find_slab(piece)
        medium = self.route.each[number]
        return medium.problem, number, int(medium.material[own]), float(medium.thickness[own])

    def response_blocks(self, piece: int) -> tuple[Blocks, Blocks]:
        """Reflection and transmission of a piece's slab as matrices."""
        number, own = self.find_slab(piece)
        part = self.slabs[number][1]
        R, T = (
            Blocks(*(each[own, 0, way] for each in (part.nodes, part.entering, part.leaving, part.passing)))
            for way in (0, 1)
        )
        return R, T

    def modes_of(self, piece: int) -> SlabModes:
        """A piece's slab by its modes, found once."""
        which = self.find_slab(piece)
        if which not in self.known:
            one, medium, material, thickness = self.slab_of(piece)
            E, F = take_blocks(one, self.sheets[medium], self.place, material)
            modes = self.modes[medium]
            assert modes is not None
            found = SlabModes(E, F, *take_modes(modes, self.place, material), one.mu0, one.mu_out, thickness)
            if self.slabs:
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

    def change_alone(self, change: Change, turned: dict[int, Assembled]) -> tuple[Array, Array]:
        """As `change`, of a slab that is alone."""
        route, problem = self.route, self.route.problem
        medium = route.each[0]
        sent = np.zeros((1, len(route.sources), problem.n_rhs, route.sights.cosines.shape[1] * len(problem.stokes)))
        changed = self.change_slab(0, change, turned, on_nodes=False)
        if changed is not None:
            passing = np.stack([blocks.OI for blocks in changed])[None, None]
            for end, own in route.shine(medium, passing, route.falling, np.zeros_like(route.mirrored)):
                sent[:, end] = own[:, 0] / medium.index**2
        return route.look(sent)[0], np.zeros((2, problem.level.size, problem.n_rhs))

    def change_all(self, turned: list[dict[int, Assembled]]) -> list[tuple[Array, Array]]:
        """Of each change the derivatives of what is seen, (n_tau, n_in, n_col, n_out, S), and of the fluxes, (2, n_tau,
        r): the light that all of them send out goes through the stack together."""
        route = self.route
        if self.is_alone:
            return [self.change_alone(change, own) for change, own in zip(route.changes, turned, strict=True)]
        if not route.changes:
            return []
        r, problem = route.problem.n_rhs, route.problem
        parts = [self.change_parts(change, k, turned[k]) for k, change in enumerate(route.changes)]
        tangent = np.concatenate([part.light for part in parts], axis=-2)
        route.join(self.orders, self.slabs, tangent, Run(1))
        sent = route.send(self.orders, self.slabs, tangent)
        found = []
        for k, part in enumerate(parts):
            own = slice(k * r, (k + 1) * r)
            light = route.look(sent[:, :, own] + part.sent)
            escapes = route.changed_escapes[k]
            if escapes is not None:
                light = light + route.look(self.value_sent(), escapes)
            flux = np.zeros((2, problem.level.size, r))
            if problem.conserves and self.order == 0:
                flux = route.sum_fluxes(tangent[0, :, :, own])
            found.append((light[0], flux))
        return found

    def change_parts(self, change: Change, number: int, turned: dict[int, Assembled]) -> "Parts":
        """What changed slabs, a changed base and changed beams send out, of all light in the unchanged stack."""
        route, orders, value = self.route, self.orders, self.light[None]
        light = np.zeros_like(value)
        changed = self.change_slabs(change, turned)
        sent = route.send_slabs(changed, value)
        if changed:
            sent += route.send_beams(changed, route.falling, route.mirrored)
            route.light_nodes(light, changed, route.falling, route.mirrored)
        for medium, response in changed:
            up, down = route.scatter(medium, response.nodes, value)
            own = light[..., light.shape[-1] - response.nodes.shape[-1] :]
            own[:, medium.pieces, RISING] += up
            own[:, medium.pieces + 1, ARRIVING] += down
        base, beams = route.changed_bases[number], route.beams_of(change)
        if base is not None:
            light[:, -1, LEAVING] += route.reflect_on_base(orders, route.arriving, base)
            light[:, -1, LEAVING] += route.spread_from_base(orders, value[:, -1, ARRIVING], base)
            sent[:, -1] += route.leave_base(orders, value[:, -1, ARRIVING], base)
        if beams is not None and change.beams is not None:
            route.light_nodes(light, self.slabs, *beams[:2])
            light[:, -1, LEAVING] += route.reflect_on_base(orders, beams[2])
            sent += route.send_beams(self.slabs, *beams[:2])
            for index, rough in route.rough_interfaces.items():
                powers = (route.power_of(part[index]) for part in (change.beams.arriving, change.beams.rising))
                rough.light(light[:, index], orders, *powers)
        return Parts(light, sent)

    def change_slabs(self, change: Change, turned: dict[int, Assembled]) -> Slabs:
        """How R and T of those pieces change that do."""
        found: Slabs = []
        for medium in self.route.each:
            blocks = [(k, self.change_slab(k, change, turned, on_nodes=True)) for k in medium.pieces.tolist()]
            kept = [(k, own) for k, own in blocks if own is not None]
            if kept:
                N, NI, ON, OI = (
                    np.stack([[[getattr(part, name) for part in own]] for _, own in kept])
                    for name in ("N", "NI", "ON", "OI")
                )
                pieces = np.array([k for k, _ in kept], np.int32)
                of = np.arange(pieces.size, dtype=np.int32)
                found.append((replace(medium, pieces=pieces, of=of), Response(N, NI, ON, OI)))
        return found

    def value_sent(self) -> Array:
        """All light that is sent out along the sights, (1, source, r, n_sight S), unchanged."""
        if self.sent is None:
            route = self.route
            self.sent = route.send(self.orders, self.slabs, self.light[None])
            self.sent += route.send_beams(self.slabs, route.falling, route.mirrored)
        return self.sent


def take_order(response: Response, index: int) -> Response:
    """The response of slabs in one of the orders, by its place among them."""
    one = slice(index, index + 1)
    return Response(
        response.nodes[:, one], response.entering[:, one], response.leaving[:, one], response.passing[:, one]
    )


@dataclass(frozen=True, eq=False)
class Parts:
    """Light that one change in a stack makes its slabs, its base and its beams send out: to the nodes, (1, interface,
    4, r, n), and along the sights, (1, source, r, n_sight S)."""

    light: Array
    sent: Array
