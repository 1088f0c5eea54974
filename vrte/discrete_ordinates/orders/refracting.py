"""Fourier orders of stacks with interfaces: slabs by any of the exact routes, joined by what lies between them, (2:8).

Light is counted as radiance over the square of the refractive index, scaled on the nodes by the root of n^2 weight mu:
both are the same on either side of an interface, which then only shares out what comes.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from vrte import _core
from vrte.basics.arrays import Array, IntArray, record, replace_unchecked
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.beam_paths import BeamPaths
from vrte.discrete_ordinates.orders.media import ARRIVING, ENTERING, LEAVING, RISING
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slab_response import Responding, take_slabs
from vrte.discrete_ordinates.orders.slabs import find_materials, select_materials
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary
from vrte.scene.oriented import polarizes_beams

# R and T of slabs (slab,) of a problem's layers, taken as materials: problem, material, thickness, orders, run
Responder = Callable[[Problem, IntArray, Array, IntArray, Run], Responding]
CUT, SMOOTH, ROUGH = range(3)  # kinds of interfaces in core/stack.pxi


@record
class Medium:
    """Layers of one refractive index: the distinct materials as a problem's layers, the distinct slabs made of them,
    material and thickness (slab,), and in the stack the pieces (piece,), each of a slab, of (piece,)."""

    index: float
    problem: Problem
    material: IntArray
    thickness: Array
    pieces: IntArray
    of: IntArray

    def take(self, parts: Array) -> Array:
        """Of every piece what its slab has, (slab, ...)."""
        return take_slabs(self.of, parts)


Slabs = Sequence[tuple[Medium, Responding]]  # those of each medium


class Refracting(BeamPaths):
    """A route for stacks in several media, whose slabs another one finds."""

    def __init__(
        self,
        respond: Responder,
        problem: Problem,
        base: Boundary,
        n_order: int,
        accuracy: float,
        run: Run | None = None,
    ) -> None:
        super().__init__(problem, base, n_order, accuracy, run)
        self.respond = respond
        self.allowed = {
            "residual_of_modes": 1e-9,
            "residual_of_boundary": 1e-9,
            "residual_of_reflection": 1e-9,
            "residual_of_transmission": 1e-6,
            "residual_of_adding": 1e-9,
        }
        self.each = self.find_media()
        self.kind = self.find_kinds()
        self.which = np.array([np.count_nonzero(self.kind[:k] == kind) for k, kind in enumerate(self.kind)], np.int32)
        self.blocks = self.find_blocks()

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        problem = self.problem
        n, r, ways = problem.size, problem.n_rhs, self.sights.cosines.shape[1] * len(problem.stokes)
        slabs = sum(medium.material.size for medium in self.each)
        if polarizes_beams(problem.oriented):  # whose slabs have directions off the nodes as nodes
            n, ways = 2 * n + r, ways + r
        light = float(self.cut.interface.size) * r * (8.0 * n + 4.0 * ways)
        return count_orders_at_once(4.0 * slabs * (n + r) * (n + ways) + light, threads)

    def find_media(self) -> list[Medium]:
        """The distinct slabs of each medium."""
        indices = self.media.scene.indices
        found = []
        for index in sorted(set(indices)):
            layers = [k for k, own in enumerate(indices) if own == index]
            one = select_materials(replace_unchecked(self.of_medium(index, 1 + layers[0]), media=self.media), layers)
            materials, kinds = find_materials(one)
            keys: dict[tuple[int, float], int] = {}
            pieces = np.flatnonzero(np.isin(self.cut.layer, layers)).astype(np.int32)
            of = [
                keys.setdefault((int(kinds[layers.index(layer)]), length), len(keys))
                for layer, length in zip(
                    self.cut.layer[pieces].tolist(), self.cut.thickness[pieces].tolist(), strict=True
                )
            ]
            material, thickness = np.array([kind for kind, _ in keys], np.int32), np.array([each for _, each in keys])
            found.append(
                Medium(index, select_materials(one, materials), material, thickness, pieces, np.array(of, np.int32))
            )
        return found

    def find_blocks(self) -> Array:
        """Of smooth interfaces, in the order of the pieces, reflection above and below, transmission down and up,
        node by node, (smooth, 4, n, S)."""
        interfaces = self.media.interfaces_along(self.media.cosines)
        members = np.ix_(self.problem.stokes, self.problem.stokes)
        parts = np.stack(list(vars(interfaces).values()))[:, self.cut.interface[self.kind == SMOOTH]]
        found = parts[..., members[0], members[1]].swapaxes(0, 1)
        return np.ascontiguousarray(found.reshape(len(found), 4, self.problem.size, len(self.problem.stokes)))

    def find_kinds(self) -> IntArray:
        """Which interfaces are cuts, smooth or rough, (interface,)."""
        scene, at = self.media.scene, self.cut.interface
        there = [interface is not None for interface in scene.interfaces]
        there[-1] |= scene.base is not None
        kind = np.where((at >= 0) & np.array(there)[at], SMOOTH, CUT).astype(np.int32)
        kind[self.rough] = ROUGH
        return kind

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        slabs = self.find_slabs(orders, run)
        light = self.set_out(orders, slabs)
        residuals = {"residual_of_adding": self.join(orders, slabs, light, run)}
        problem, fluxes = self.problem, np.zeros((2, self.problem.level.size, self.problem.n_rhs))
        sent = self.send(orders, slabs, light)
        for _, response in slabs:
            for key, values in response.residuals.items():
                residuals[key] = np.maximum(residuals.get(key, 0.0), values.max(axis=0))
        with run.timed("joining"):
            kernels = self.look(sent + self.send_beams(slabs, self.falling, self.mirrored))
            if problem.conserves and orders[0] == 0:
                fluxes = self.sum_fluxes(light[0])
        tail = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
        return Orders(kernels, fluxes[0].reshape(tail), fluxes[1].reshape(tail), residuals)

    def find_slabs(self, orders: IntArray, run: Run) -> Slabs:
        """The slabs of each medium with their responses in the orders."""
        return [(one, self.respond(one.problem, one.material, one.thickness, orders, run)) for one in self.each]

    def join(self, orders: IntArray, slabs: Slabs, light: Array, run: Run, transposed: bool = False) -> Array:
        """Puts all light on the nodes in the place of what sets out there, (order, interface, 4, r, n), see
        core/stack.pxi; residual (order,). ``transposed``: every matrix of the stack is, and what interfaces let down
        and up change places. Raises AccuracyError where a system is singular."""
        each = [response.nodes if transposed else response.nodes.swapaxes(-1, -2) for _, response in slabs]
        each = [np.ascontiguousarray(nodes) for nodes in each]
        size, at = np.empty((2, self.cut.layer.size), np.int32)
        begins = np.cumsum([0, *(nodes.size for nodes in each)])
        for (medium, _), nodes, begin in zip(slabs, each, begins.tolist(), strict=False):
            size[medium.pieces] = nodes.shape[-1]
            at[medium.pieces] = begin + medium.of * nodes[0].size
        rough = [
            np.stack([way.nodes[orders] for way in (one.above, one.below, one.down, one.up)], axis=1)
            for one in self.rough_interfaces.values()
        ]
        stokes, n = len(self.problem.stokes), self.problem.size
        smooth, base = self.blocks, np.zeros((1, 1, 1)) if self.base is None else self.base.matrix
        if transposed:
            rough = [np.ascontiguousarray(part[:, [0, 1, 3, 2]].swapaxes(-1, -2)) for part in rough]
            apart = smooth[:, [0, 1, 3, 2]].reshape(len(smooth), 4, n // stokes, stokes, stokes)
            smooth = np.ascontiguousarray(apart.swapaxes(-1, -2)).reshape(smooth.shape)
            base = np.ascontiguousarray(base.swapaxes(-1, -2))
        with run.timed("joining") as crew:
            found = _core.join_media(
                crew,
                pieces=np.concatenate([nodes.ravel() for nodes in each]) if len(each) > 1 else each[0].ravel(),
                slab_size=size,
                slab_at=at,
                kind=self.kind,
                which=self.which,
                smooth=smooth,
                rough=np.stack(rough) if rough else np.zeros((0, orders.size, 4, n, n)),
                base_row=np.full(orders.size, -1, np.int32) if self.base is None else self.base.row[orders],
                base=base,
                stokes=stokes,
                light=light,
            )
        if found["info"].any():
            raise AccuracyError(
                f"two slabs cannot be joined at order {orders[np.argmax(found['info'])]}: the system is singular"
            )
        residual: Array = found["residual"]
        return residual

    def set_out(self, orders: IntArray, slabs: Slabs) -> Array:
        """What beams send to the nodes, (order, interface, 4, r, n)."""
        light = np.zeros((orders.size, self.cut.interface.size, 4, self.problem.n_rhs, self.problem.size))
        self.light_nodes(light, slabs, self.falling, self.mirrored)
        for index, rough in self.rough_interfaces.items():
            rough.light(light[:, index], orders, self.power_at(index, ARRIVING), self.power_at(index, RISING))
        light[:, -1, LEAVING] += self.reflect_on_base(orders, self.arriving)
        return light

    def light_nodes(self, light: Array, slabs: Slabs, falling: Array, mirrored: Array) -> None:
        """Adds what slabs send of beams of that power (piece, n_in, S, n_col) to the nodes."""
        for medium, response in slabs:
            own = light[..., light.shape[-1] - response.nodes.shape[-1] :]
            for end, sent in self.shine(medium, response.entering, falling, mirrored):
                own[:, medium.pieces + end, ARRIVING if end else RISING] += sent / medium.index

    def shine(self, medium: Medium, blocks: Array, falling: Array, mirrored: Array) -> Iterator[tuple[int, Array]]:
        """What slabs make by blocks (slab, order, 2, x, n_in S) of beams, up at the top (0) and down at the bottom (1):
        (order, piece, r, x)."""
        into = self.into[1 + self.cut.layer[medium.pieces[0]], :, None, None]
        for below, power in enumerate((falling[medium.pieces], mirrored[medium.pieces])):
            if power.any():
                rows = medium.take(blocks).swapaxes(-1, -2)
                rows = rows.reshape(*rows.shape[:3], *power.shape[1:3], -1)
                found = spread(power, into)[:, None, None].swapaxes(-1, -2) @ rows
                found = found.reshape(*found.shape[:3], -1, found.shape[-1]).swapaxes(0, 1)
                yield from ((end, found[:, :, end ^ below]) for end in range(2))

    def send(self, orders: IntArray, slabs: Slabs, light: Array) -> Array:
        """What light on the nodes (order, interface, 4, r, n) sends along the sights, (order, source, r, n_sight S)."""
        sent = self.send_slabs(slabs, light)
        for k, (index, rough) in enumerate(self.rough_interfaces.items(), self.cut.layer.size):
            sent[:, 2 * k], sent[:, 2 * k + 1] = rough.send(orders, light[:, index, ARRIVING], light[:, index, RISING])
        if self.base is not None:
            sent[:, -1] = self.leave_base(orders, light[:, -1, ARRIVING])
        return sent

    def send_slabs(self, slabs: Slabs, light: Array) -> Array:
        """The same of slabs alone."""
        rows = self.sights.cosines.shape[1] * len(self.problem.stokes)
        sent = np.zeros((len(light), len(self.sources), light.shape[-2], rows))
        for medium, response in slabs:
            own = light[..., light.shape[-1] - response.nodes.shape[-1] :]
            above, below = own[:, medium.pieces, ENTERING], own[:, medium.pieces + 1, LEAVING]
            for end, leaves in enumerate(response.send(medium.of, above, below)):
                sent[:, 2 * medium.pieces + end] = leaves / medium.index
        return sent

    def send_beams(self, slabs: Slabs, falling: Array, mirrored: Array) -> Array:
        """What slabs send of beams of that power along the sights, (order, source, r, n_sight S)."""
        rows = self.sights.cosines.shape[1] * len(self.problem.stokes)
        sent = np.zeros((slabs[0][1].nodes.shape[1], len(self.sources), self.problem.n_rhs, rows))
        for medium, response in slabs:
            for end, own in self.shine(medium, response.passing, falling, mirrored):
                sent[:, 2 * medium.pieces + end] += own / medium.index**2
        return sent


def spread(power: Array, into: Array) -> Array:
    """Flux of beams across themselves from their power through a horizontal plane, 0 where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(into > 0.0, power / into, 0.0)
