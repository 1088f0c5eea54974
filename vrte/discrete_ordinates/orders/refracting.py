"""Fourier orders of stacks with interfaces: slabs by any of the exact routes, joined by what lies between them, (2:8).

Light is counted as radiance over the square of the refractive index, scaled on the nodes by the root of n^2 weight mu:
both are the same on either side of an interface, which then only shares out what comes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from vrte.basics.arrays import Array, IntArray
from vrte.basics.errors import AccuracyError
from vrte.basics.memory import count_orders_at_once
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.beam_paths import ARRIVING, RISING, BeamPaths
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.slab_response import Response
from vrte.discrete_ordinates.orders.slabs import find_materials, select_materials
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.boundary import Boundary

# R and T of slabs (slab,) of a problem's layers, taken as materials: problem, material, thickness, orders, run
Responder = Callable[[Problem, IntArray, Array, IntArray, Run], list[Response]]


@dataclass(frozen=True, eq=False)
class InterfaceOperators:
    """What a interface does to light on the nodes of all media: blocks (N, S, S) of a smooth one, matrices (n, n) of
    one that scatters, None where nothing goes that way."""

    above: Array | None
    below: Array | None
    down: Array | None
    up: Array | None


@dataclass(frozen=True, eq=False)
class Places:
    """Which slab lies where: medium (slab,) and its place among that medium's responses; of (piece,): the slab."""

    media: list[tuple[float, Problem, IntArray, Array]]
    slab: list[tuple[int, int]]
    of: IntArray


class Refracting(BeamPaths):
    """A route for stacks in several media, whose slabs another one finds."""

    def __init__(self, respond: Responder, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        super().__init__(problem, base, n_order, accuracy)
        self.respond = respond
        self.allowed = {
            "residual_of_modes": 1e-9,
            "residual_of_boundary": 1e-9,
            "residual_of_reflection": 1e-9,
            "residual_of_transmission": 1e-6,
            "residual_of_invariance": 1e-9,
            "residual_of_adding": 1e-9,
        }
        self.places = self.find_places()
        self.interface_operators = self.find_interface_operators()

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        n = self.problem.size + len(self.problem.stokes) * (self.problem.mu0.size + 2 * self.sights.cosines.shape[1])
        return count_orders_at_once(4.0 * len(self.places.slab) * n * n, threads)

    def find_places(self) -> Places:
        """The distinct slabs of each medium."""
        indices = self.media.scene.indices
        media: list[tuple[float, Problem, IntArray, Array]] = []
        slabs: list[tuple[int, int]] = []
        of = np.zeros(self.cut.layer.size, np.int32)
        for index in sorted(set(indices)):
            layers = [k for k, own in enumerate(indices) if own == index]
            one = replace(self.of_medium(index, 1 + layers[0]), media=self.media)
            one = select_materials(one, layers)
            materials, kinds = find_materials(one)
            one = select_materials(one, materials)
            keys: dict[tuple[int, float], int] = {}
            for piece in np.flatnonzero(np.isin(self.cut.layer, layers)).tolist():
                kind = int(kinds[layers.index(int(self.cut.layer[piece]))])
                key = (kind, float(self.cut.thickness[piece]))
                if key not in keys:
                    keys[key] = len(keys)
                    slabs.append((len(media), keys[key]))
                of[piece] = slabs.index((len(media), keys[key]))
            material = np.array([kind for kind, _ in keys], np.int32)
            media.append((index, one, material, np.array([length for _, length in keys])))
        return Places(media, slabs, of)

    def find_interface_operators(self) -> list[InterfaceOperators | None]:
        """Of smooth interfaces, in the order of the pieces; None for mere cuts."""
        interfaces = self.media.interfaces_along(self.media.cosines)
        members = np.ix_(self.problem.stokes, self.problem.stokes)
        found: list[InterfaceOperators | None] = []
        scene = self.media.scene
        for index, at in enumerate(self.cut.interface.tolist()):
            mere_cut = at < 0 or (scene.interfaces[at] is None and at < len(scene.layers))
            if mere_cut or index in self.rough:
                found.append(None)
                continue
            parts = [part[at][:, members[0], members[1]] for part in vars(interfaces).values()]
            found.append(InterfaceOperators(*(part if part.any() else None for part in parts)))
        return found

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        responses = [
            self.respond(one, material, thickness, orders, run) for _, one, material, thickness in self.places.media
        ]
        problem = self.problem
        shape = (orders.size, problem.level.size, problem.mu0.size, problem.columns.shape[0], problem.mu_out.size)
        kernels = np.empty((*shape, len(problem.stokes)))
        fluxes = np.zeros((2, problem.level.size, problem.n_rhs))
        residual = np.zeros(orders.size)

        def join(index: int) -> None:
            slabs = [responses[medium][own] for medium, own in self.places.slab]
            kernels[index], residual[index] = self.join_order(index, int(orders[index]), slabs, fluxes)

        with run.timed("joining"):
            if run.threads > 1 and orders.size > 1:
                from concurrent.futures import ThreadPoolExecutor  # takes as long to import as a tenth of vrte

                with ThreadPoolExecutor(run.threads) as pool:
                    list(pool.map(join, range(orders.size)))
            else:
                for index in range(orders.size):
                    join(index)
        residuals: dict[str, Array] = {"residual_of_adding": residual}
        for medium in responses:
            for slab in medium:
                for key, values in slab.residuals.items():
                    residuals[key] = np.maximum(residuals.get(key, 0.0), values)
        tail = (problem.level.size, problem.mu0.size, problem.columns.shape[0])
        return Orders(kernels, fluxes[0].reshape(tail), fluxes[1].reshape(tail), residuals)

    def join_order(self, index: int, order: int, slabs: list[Response], fluxes: Array) -> tuple[Array, float]:
        """One order: radiance (n_tau, n_in, n_col, n_out, S) for unit beams, public frame, and the residual of the
        interfaces; the fluxes of order 0 (2, n_tau, n_rhs) are put where they belong."""
        problem = self.problem
        pieces = [
            Piece(slabs[which], index, self.media.scene.media[1 + layer], self.into[1 + layer])
            for which, layer in zip(self.places.of.tolist(), self.cut.layer.tolist(), strict=True)
        ]
        slab_stack = NodalStack(self, order, pieces)
        slab_stack.upward_sweep()
        slab_stack.downward_sweep()
        light = self.see(slab_stack, pieces)
        if problem.conserves and order == 0:
            fluxes[:] = self.sum_fluxes(slab_stack.arriving, slab_stack.leaving, slab_stack.entering, slab_stack.rising)
        return light, slab_stack.residual

    def see(self, slab_stack: "NodalStack", pieces: list["Piece"]) -> Array:
        """Light along the sights from all that sends it out, (n_tau, n_in, n_col, n_out, S), public frame."""
        problem, stokes = self.problem, len(self.problem.stokes)
        n_sight = self.sights.cosines.shape[1]
        sent = np.empty((len(self.sources), n_sight, stokes, problem.n_rhs))
        for k, piece in enumerate(pieces):
            up, down = piece.send(slab_stack.entering[k], slab_stack.leaving[k + 1], self.falling[k], self.mirrored[k])
            sent[2 * k], sent[2 * k + 1] = up, down
        for k, (index, rough) in enumerate(self.rough_interfaces.items(), len(pieces)):
            arriving, rising = slab_stack.arriving[index], slab_stack.rising[index]
            sent[2 * k] = rough.above.send(slab_stack.order, arriving) + rough.up.send(slab_stack.order, rising)
            sent[2 * k + 1] = rough.below.send(slab_stack.order, rising) + rough.down.send(slab_stack.order, arriving)
        if self.base is not None:
            sent[-1] = self.leave_base(slab_stack.order, slab_stack.arriving[-1])
        return self.look(sent)


@dataclass(frozen=True, eq=False)
class Piece:
    """A slab of one order in its medium of that ``index``; cosines (n_in,) of the beams there, 0 where there is
    none."""

    response: Response
    place: int
    index: float
    into: Array

    def scatter(self, field: Array, way: int) -> Array:
        """Light on all nodes, (n, r), reflected (way 0) or let through (1)."""
        matrix = self.response.nodes[self.place, way]
        found = np.zeros_like(field)
        n = matrix.shape[0]
        found[field.shape[0] - n :] = matrix @ field[field.shape[0] - n :]
        return found

    def fill(self, n: int, way: int) -> Array:
        """R or T on all nodes, (n, n)."""
        matrix = self.response.nodes[self.place, way]
        if matrix.shape[0] == n:
            return matrix
        found = np.zeros((n, n))
        found[n - matrix.shape[0] :, n - matrix.shape[0] :] = matrix
        return found

    def flux(self, power: Array) -> Array:
        """Flux (n_in, S, n_col) of beams across themselves from their power through a horizontal plane."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.into[:, None, None] > 0.0, power / self.into[:, None, None], 0.0)

    def send_to_nodes(self, n: int, falling: Array, mirrored: Array) -> tuple[Array, Array]:
        """What beams from above and from below send to the nodes, up at the top and down at the bottom, (n, r)."""
        parts = self.response.entering[self.place]
        found = np.zeros((2, n, falling.shape[0] * falling.shape[2]))
        for power, ways in ((falling, (0, 1)), (mirrored, (1, 0))):
            if power.any():
                light = self.flux(power) / self.index
                for end, way in enumerate(ways):
                    sent = np.einsum("nia,iac->nic", parts[way], light)
                    found[end, n - sent.shape[0] :] += sent.reshape(sent.shape[0], -1)
        return found[0], found[1]

    def send(self, entering: Array, leaving: Array, falling: Array, mirrored: Array) -> tuple[Array, Array]:
        """Along the sights, up at the top and down at the bottom, (n_sight, S, r): from the nodes' light that enters
        from above and from below, and from beams."""
        rows, passing = self.response.leaving[self.place], self.response.passing[self.place]
        n = rows.shape[-1]
        shape = (*rows.shape[1:3], entering.shape[1])
        found = np.zeros((2, *shape))
        for field, ways in ((entering, (0, 1)), (leaving, (1, 0))):
            own = field[field.shape[0] - n :]
            for end, way in enumerate(ways):
                found[end] += (rows[way].reshape(-1, n) @ own).reshape(shape) / self.index
        for power, ways in ((falling, (0, 1)), (mirrored, (1, 0))):
            if power.any():
                light = self.flux(power) / self.index**2
                for end, way in enumerate(ways):
                    found[end] += np.einsum("osia,iac->osic", passing[way], light).reshape(shape)
        return found[0], found[1]


def share(part: Array | None, field: Array) -> Array:
    """A interface's part applied to light on the nodes (n, r)."""
    if part is None:
        return np.zeros_like(field)
    if part.ndim == 2:
        return part @ field
    stokes = part.shape[-1]
    return (part @ field.reshape(-1, stokes, field.shape[1])).reshape(field.shape)


def share_columns(field: Array, part: Array | None) -> Array:
    """A matrix (r, n) times a interface's part."""
    if part is None:
        return np.zeros_like(field)
    if part.ndim == 2:
        return field @ part
    stokes = part.shape[-1]
    blocks = field.reshape(field.shape[0], -1, stokes).transpose(1, 0, 2) @ part
    return blocks.transpose(1, 0, 2).reshape(field.shape)


class Factors:
    """LU of 1 - product, and how well a system was solved by it."""

    def __init__(self, product: Array, order: int) -> None:
        self.matrix = np.eye(product.shape[0]) - product
        self.lu = lu_factor(self.matrix, check_finite=False)
        if not np.isfinite(self.lu[0]).all() or not np.diagonal(self.lu[0]).all():
            raise AccuracyError(f"two slabs cannot be joined at order {order}: the system is singular")

    def solve(self, right: Array) -> Array:
        """The solution for right-hand sides (n, r)."""
        return lu_solve(self.lu, right, check_finite=False)

    def residual(self, right: Array, found: Array) -> float:
        """What is left of the right-hand sides, relative."""
        largest = float(np.abs(right).max(initial=0.0))
        return float(np.abs(right - self.matrix @ found).max(initial=0.0)) / largest if largest > 1e-290 else 0.0


class NodalStack:
    """One order's light on the nodes of a stack: from the base up, then from the top down, as in `pass_along`."""

    def __init__(self, route: Refracting, order: int, pieces: list[Piece]) -> None:
        self.route, self.order, self.pieces = route, order, pieces
        problem = route.problem
        self.n, self.r = problem.size, problem.n_rhs
        self.residual = 0.0
        self.beams = [
            piece.send_to_nodes(self.n, route.falling[k], route.mirrored[k]) for k, piece in enumerate(pieces)
        ]
        count = len(pieces) + 1
        dark = np.zeros((self.n, self.r))
        self.interface_operators = list(route.interface_operators)
        # what beams send to the nodes where they meet a rough interface, going up above it and down below it
        self.leaving_beams, self.entering_beams = [dark] * count, [dark] * count
        for index, rough in route.rough_interfaces.items():
            ways = (rough.above, rough.below, rough.down, rough.up)
            self.interface_operators[index] = InterfaceOperators(*(way.nodes[order] for way in ways))
            falls, rises = route.power_at(index, ARRIVING), route.power_at(index, RISING)
            self.leaving_beams[index] = rough.above.collect(order, falls) + rough.up.collect(order, rises)
            self.entering_beams[index] = rough.down.collect(order, falls) + rough.below.collect(order, rises)
        self.arriving, self.leaving, self.entering, self.rising = ([dark] * count for _ in range(4))
        # of what lies below: seen (n, n) or None, own (n, r); above each interface, and below it
        self.seen: list[Array | None] = [None] * count
        self.own = [dark] * count
        self.seen_below: list[Array | None] = [None] * count
        self.own_below = [dark] * count
        self.at_joint: list[Factors | None] = [None] * count
        self.in_slab: list[Factors | None] = [None] * count

    def upward_sweep(self) -> None:
        """What lies below every interface reflects and sends up, from the bottom."""
        last = len(self.pieces)
        for k in range(last, -1, -1):
            if k < last:
                self.put_slab(k)
            self.add_interface(k, last)

    def put_slab(self, k: int) -> None:
        """The slab under interface k upon what the interface below it shows."""
        piece, seen = self.pieces[k], self.seen[k + 1]
        up, down = self.beams[k]
        reflection = piece.fill(self.n, 0)
        if seen is None:
            self.seen_below[k] = reflection
            self.own_below[k] = up + piece.scatter(self.own[k + 1], 1) if self.own[k + 1].any() else up
            return
        factors = self.in_slab[k] = Factors(seen @ reflection, self.order)
        own = factors.solve(seen @ down + self.own[k + 1])
        self.own_below[k] = up + piece.scatter(own, 1)
        if self.needs_matrix(k):
            through = piece.fill(self.n, 1)
            self.seen_below[k] = reflection + through @ factors.solve(seen @ through)

    def needs_matrix(self, k: int) -> bool:
        """Whether anything looks at the reflection of what lies below interface k: not through a first one that sends
        nothing back down."""
        sharing = self.interface_operators[k]
        return k > 0 or (sharing is not None and sharing.below is not None)

    def add_interface(self, k: int, last: int) -> None:
        """What interface k does to what lies below it."""
        sharing = self.interface_operators[k]
        if k == last and self.route.base is not None:
            matrix, self.own[k] = self.route.reflect_on_base(self.order)
            if sharing is not None and sharing.above is not None:  # what it mirrors beside what it scatters
                mirror = np.asarray(expand_blocks(sharing.above))
                matrix = mirror if matrix is None else matrix + mirror
            self.seen[k] = matrix
            return
        if sharing is None:
            self.seen[k], self.own[k] = self.seen_below[k], self.own_below[k]
            return
        seen, own = self.seen_below[k], self.own_below[k]
        above = None if sharing.above is None else np.asarray(expand_blocks(sharing.above))
        if seen is None:
            self.seen[k], self.own[k] = above, share(sharing.up, own) + self.leaving_beams[k]
            return
        if self.entering_beams[k].any():
            own = own + seen @ self.entering_beams[k]
        if sharing.below is not None:
            factors = self.at_joint[k] = Factors(share_columns(seen, sharing.below), self.order)
            found = factors.solve(own)
            self.residual = max(self.residual, factors.residual(own, found))
            own = found
        self.own[k] = share(sharing.up, own) + self.leaving_beams[k]
        if k > 0 and sharing.down is not None:
            through = share_columns(seen, sharing.down)
            through = self.at_joint[k].solve(through) if self.at_joint[k] else through  # type: ignore[union-attr]
            back = share(sharing.up, through)
            self.seen[k] = back if above is None else above + back
        else:
            self.seen[k] = above

    def downward_sweep(self) -> None:
        """Light on either side of every interface, from the top down."""
        arriving = np.zeros((self.n, self.r))
        for k in range(len(self.pieces) + 1):
            self.arriving[k] = arriving
            self.cross_joint(k)
            if k < len(self.pieces):
                arriving = self.cross_slab(k)

    def cross_joint(self, k: int) -> None:
        """Rising, leaving and entering light from what arrives."""
        arriving, sharing = self.arriving[k], self.interface_operators[k]
        seen = self.seen_below[k]
        lit = bool(arriving.any())
        if k == len(self.pieces) and (self.route.base is not None):
            matrix = self.seen[k]
            self.leaving[k] = self.own[k] if matrix is None else self.own[k] + matrix @ arriving
            return
        if sharing is None:
            self.entering[k] = arriving
            rising = self.own_below[k]
            self.rising[k] = rising + seen @ arriving if seen is not None and lit else rising
            self.leaving[k] = self.rising[k]
            return
        through = share(sharing.down, arriving) + self.entering_beams[k]
        right = self.own_below[k] if seen is None or not through.any() else self.own_below[k] + seen @ through
        factors = self.at_joint[k]
        self.rising[k] = right if factors is None else factors.solve(right)
        self.leaving[k] = share(sharing.up, self.rising[k]) + share(sharing.above, arriving) + self.leaving_beams[k]
        self.entering[k] = through + share(sharing.below, self.rising[k])

    def cross_slab(self, k: int) -> Array:
        """What arrives at the interface below slab k."""
        piece, factors, seen = self.pieces[k], self.in_slab[k], self.seen[k + 1]
        down = self.beams[k][1] + piece.scatter(self.entering[k], 1)
        if seen is None:
            up = self.own[k + 1]
        else:
            assert factors is not None
            right = self.own[k + 1] + seen @ down
            up = factors.solve(right)
            self.residual = max(self.residual, factors.residual(right, up))
        return down + piece.scatter(up, 0) if up.any() else down


def expand_blocks(part: Array) -> Array:
    """Blocks (N, S, S) as a matrix (n, n)."""
    if part.ndim == 2:
        return part
    count, stokes, _ = part.shape
    found = np.zeros((count, stokes, count, stokes))
    found[np.arange(count), :, np.arange(count)] = part
    return found.reshape(count * stokes, -1)
