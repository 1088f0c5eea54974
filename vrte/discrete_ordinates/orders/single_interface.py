"""A stack under one surface, by its modes or by invariance: the surface is a boundary condition at the top."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array, BoolArray, IntArray
from vrte.basics.memory import count_orders_at_once
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.beam_paths import expand_lossless_base
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.fused_modes import Part, run_fused_modes, solve_by_modes, spread_over_scenes
from vrte.discrete_ordinates.orders.invariance import TIGHTER, find_allowed_residuals, solve_by_invariance
from vrte.discrete_ordinates.orders.media import Media, list_sights
from vrte.discrete_ordinates.orders.modes import Modes, is_quick
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.rough import FacetOrders
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.beams import find_cosines, find_decaying
from vrte.scene.boundary import Boundary

TOGETHER = 8  # orders but 0 that facets are integrated for at once


def is_under_one_surface(media: Media) -> bool:
    """Whether all that refracts is an interface on top, over particles alone, and no beam comes up again."""
    first, *others = media.scene.interfaces
    beams = media.scene.below.keeps_beams or media.scene.has_flakes
    return first is not None and not any(others) and not beams


def round_orders(n_order: int) -> int:
    """So many orders or more, that facets are integrated for: blocks of orders come one after another."""
    return 1 + TOGETHER * max(1, math.ceil((n_order - 1) / TOGETHER))


def find_depths_within(media: Media) -> BoolArray:
    """Which depths lie below the surface on top, (n_tau,)."""
    found: BoolArray = (media.depths.interface != 0) | media.depths.under
    return found


def replace_dark(cosines: Array) -> Array:
    """The cosines with the normal in the place of directions that light does not go."""
    return np.where(cosines > 0.0, cosines, 1.0)


def act(matrices: Array, light: Array) -> Array:
    """What matrices (n, S, S) of as many directions make of light (..., n, S)."""
    first = np.moveaxis(light, -2, 0)
    found = first.reshape(len(matrices), math.prod(first.shape[1:-1]), light.shape[-1]) @ matrices.swapaxes(1, 2)
    return np.moveaxis(found.reshape(first.shape), 0, -2)


class SingleInterface(ABC):
    """Layers under one interface, which is a boundary condition at their top."""

    def __init__(self, name: str, problem: Problem, base: Boundary, n_order: int, accuracy: float, run: Run) -> None:
        assert problem.media is not None
        self.problem, self.media, self.quick = problem, problem.media, is_quick(problem, accuracy)
        self.tolerance = TIGHTER * accuracy if name == "invariance" else None
        self.allowed = Modes.allowed if self.tolerance is None else find_allowed_residuals(accuracy)
        self.sights = list_sights(self.media, problem.mu_out)
        self.seen = replace_dark(self.sights.cosines)
        self.within = find_depths_within(self.media)
        nodes, weights = self.media.nodes.carried(self.media.scene.indices[0])
        self.inside = self.enter(replace(problem, nodes=nodes, weights=weights))
        self.base = expand_lossless_base(base, self.inside, n_order, accuracy)
        self.top = self.close_top(n_order, accuracy, run)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(Modes.count_doubles(self.inside)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        if self.tolerance is None:
            inside, rising = solve_by_modes(self.inside, orders, self.base, self.quick, run, self.top)
        else:
            inside, rising = solve_by_invariance(self.inside, orders, self.tolerance, run, self.top)
        up, down = self.find_fluxes(np.stack([inside.flux_up, inside.flux_down]), orders, rising)
        return Orders(self.see(inside.kernels, orders, rising), up, down, inside.residuals)

    @abstractmethod
    def enter(self, problem: Problem) -> Problem:
        """The problem as the layers meet it: beams, directions and depths."""

    @abstractmethod
    def close_top(self, n_order: int, accuracy: float, run: Run) -> Top:
        """What the layers meet at their top."""

    @abstractmethod
    def find_fluxes(self, inside: Array, orders: IntArray, rising: Array) -> Array:
        """Up and down at every depth, (2, n_tau, n_in, n_col), from those inside, (2, level, n_in, column), or from
        light on the nodes that comes up to the surface."""

    @abstractmethod
    def see(self, kernels: Array, orders: IntArray, rising: Array) -> Array:
        """Along the outgoing directions, (order, n_tau, n_in, n_col, n_out, S), from what goes along the sights inside,
        and from light on the nodes that comes up to the surface."""

    def list_depths(self, light: Array) -> tuple[Array, list[tuple[IntArray, IntArray, Array]]]:
        """Room for what is seen, from light of as many orders; and of every depth which sights its outgoing directions
        up and down are, and how light going down from the surface is attenuated on its way there."""
        problem, n_up = self.problem, self.problem.n_up
        columns = problem.mu0.size, problem.columns.shape[0]
        levels = problem.level_layer.size
        found = np.zeros((light.shape[0], levels, *columns, problem.mu_out.size, len(problem.stokes)))
        rows = []
        for t, index in enumerate(self.sights.place):
            straight = find_decaying(problem.depth[t : t + 1], self.sights.cosines[1:2, index[n_up:]])[0]
            rows.append((index[:n_up], index[n_up:], straight[:, None]))
        return found, rows


class UnderSmooth(SingleInterface):
    """Beams go on refracted, and what comes up along a direction goes on or down along one."""

    def enter(self, problem: Problem) -> Problem:
        scene, members = self.media.scene, np.ix_(problem.stokes, problem.stokes)
        into = find_cosines(scene.media, scene.index_above, problem.mu0)
        down = self.media.interfaces_along(into).down[0][:, members[0], members[1]] @ problem.columns.T
        lit = into[1] > 0.0
        mu_in = np.where(lit, into[1], 1.0)
        self.flux = down * (lit * problem.mu0 / mu_in)[:, None, None]  # across the refracted beam, (n_in, S, n_col)
        below = self.within.any()
        mu_out = self.seen[1]
        problem = replace(
            problem,
            mu0=mu_in,
            mu_out=np.concatenate([mu_out, mu_out]) if below else mu_out,
            n_up=mu_out.size,
            columns=np.eye(len(problem.stokes)),
        )
        if not below:
            return problem
        level, layer = np.concatenate([[0.0], problem.level]), np.concatenate([[0], problem.level_layer])
        return replace(problem, level=level, level_layer=layer.astype(np.int32))  # what comes up there goes down again

    def close_top(self, n_order: int, accuracy: float, run: Run) -> Top:
        scene, members = self.media.scene, np.ix_(self.problem.stokes, self.problem.stokes)
        along, on_nodes = map(self.media.interfaces_along, (self.sights.cosines, self.media.cosines))
        # of radiance that leaves, and that comes back (public frame: what comes up has not turned over yet)
        self.through = along.up[0][:, members[0], members[1]] / (scene.indices[0] / scene.index_above) ** 2
        self.back = (FLIP[:, None] * along.below[0])[:, members[0], members[1]]
        back = (FLIP[:, None] * on_nodes.below[0])[-self.inside.nodes.size :, members[0], members[1]]
        back = np.ascontiguousarray(back * self.problem.flip)
        return Top(np.zeros(n_order, np.int32), back[None], OPEN.sent)

    def find_fluxes(self, inside: Array, orders: IntArray, rising: Array) -> Array:
        fluxes: Array = np.einsum("wtia,iac->wtic", inside[:, int(self.within.any()) :], self.flux)
        outside = ~self.within  # the surface keeps nothing of what passes it
        fluxes[:, outside] = np.stack([fluxes[0, outside] - fluxes[1, outside], np.zeros_like(fluxes[0, outside])])
        return fluxes

    def solve_scenes(self, orders: IntArray, wanted: BoolArray, run: Run) -> Orders:
        """Those of the orders that are ``wanted`` (order, scene) of many scenes, seen from above the surface."""
        row, scene = np.nonzero(wanted)
        numbers, slab_stack = orders[row], scene.astype(np.int32)
        part = Part(self.inside, numbers, slab_stack, self.base, self.base.find_rows(numbers, slab_stack), self.top)
        (found,) = run_fused_modes([part], self.quick, run, np.arange(self.problem.layers, dtype=np.int32))
        inside = spread_over_scenes(part, orders, wanted, found)
        kernels = inside.kernels
        seen = self.see(kernels.reshape(-1, 1, *kernels.shape[2:]), orders, np.zeros(0))
        up, down = (np.einsum("tia,iac->tic", flux, self.flux) for flux in (inside.flux_up, inside.flux_down))
        return Orders(seen.reshape(*kernels.shape[:2], *seen.shape[2:]), up - down, np.zeros_like(up), inside.residuals)

    def see(self, kernels: Array, orders: IntArray, rising: Array) -> Array:
        shape = *kernels.shape[:3], self.problem.columns.shape[0], *kernels.shape[4:]
        power = np.ascontiguousarray(self.flux.swapaxes(1, 2))
        light = (power @ kernels.reshape(*kernels.shape[:4], -1)).reshape(shape)  # public frame
        n_sight, n_up, first = self.seen.shape[1], self.problem.n_up, int(self.within.any())
        found, depths = self.list_depths(light)
        for t, (up, down, straight) in enumerate(depths):
            here = light[:, t + first]
            if self.within[t]:
                returned = act(self.back[down], light[:, 0][..., down, :])
                found[:, t, ..., :n_up, :] = here[..., up, :]
                found[:, t, ..., n_up:, :] = here[..., n_sight + down, :] + straight * returned
            else:
                found[:, t, ..., :n_up, :] = act(self.through[up], here[..., up, :])
        return found


class UnderRough(SingleInterface):
    """Beams end at the facets, which send light to the nodes below, and from these to the nodes and along the sights;
    scattered by facets alone it is seen in closed form."""

    def enter(self, problem: Problem) -> Problem:
        below = self.within.any()
        seen = self.seen[1] if below else np.zeros(0)
        return replace(
            problem,
            mu0=np.ones(problem.mu0.size),  # of no beam
            mu_out=np.concatenate([seen, seen]),
            n_up=seen.size,
            level=problem.level if below else np.zeros(1),
            level_layer=problem.level_layer if below else np.zeros(1, np.int32),
        )

    def close_top(self, n_order: int, accuracy: float, run: Run) -> Top:
        problem, inside, surface = self.problem, self.inside, self.media.scene.interfaces[0]
        assert surface is not None
        members, (mu, weights) = list(problem.stokes), self.media.nodes.carried(self.media.scene.index_above)
        root, n = np.sqrt(inside.weights * inside.nodes), inside.size
        above = FacetOrders(surface.facets, self.media.nodes, accuracy, run)
        below, count = above.turned, round_orders(n_order)

        def along(orders: Array, cosines: Array, scale: Array | float = 1.0) -> Array:
            """From the scaled field to directions of those ``cosines``, 0 where they do not go, in the flipped frame:
            (order, out, S, n)."""
            chosen = orders[:n_order, ..., members, :][..., members] * FLIP[members, None]
            chosen = chosen.transpose(0, 2, 3, 1, 4) * (
                np.where(cosines > 0.0, scale, 0.0)[:, None, None, None] * root[:, None]
            )
            return chosen.reshape(*chosen.shape[:3], n)

        def leave(orders: Array) -> Array:
            """I of the power that leaves upwards, (into, S), of order 0."""
            found: Array = np.einsum("iob,o->ib", orders[0, ..., 0, :][..., members], weights * mu)
            return found

        self.up, self.down = along(below.seen(True, self.seen[0], count), self.sights.cosines[0]), np.zeros(0)
        if self.within.any():
            self.down = along(below.seen(False, self.seen[1], count), self.sights.cosines[1])
        back = along(below.between(False, count), inside.nodes, root)
        power = problem.mu0[:, None, None] * problem.columns
        sent = above.sent(True, problem.mu0, count)[:n_order, ..., members, :][..., members]
        sent = np.einsum("mioab,icb->micoa", sent * root[:, None, None], power)
        self.leaving = (leave(below.between(True, 1)) * root[:, None]).ravel()
        self.mirrored = np.einsum("ib,icb->ic", leave(above.sent(False, problem.mu0, 1)), power)
        rows = np.arange(n_order, dtype=np.int32)
        reflection = np.ascontiguousarray(back.reshape(n_order, 1, n, n))
        return Top(rows, reflection, np.ascontiguousarray(sent.reshape(n_order, problem.n_rhs, n)))

    def find_fluxes(self, inside: Array, orders: IntArray, rising: Array) -> Array:
        n_tau = self.problem.level.size
        fluxes = inside if inside.shape[1] == n_tau else np.zeros((2, n_tau, *inside.shape[2:]))
        up = np.zeros(self.mirrored.shape)
        if self.problem.conserves and orders[0] == 0:
            up = (rising[0] @ self.leaving).reshape(up.shape) + self.mirrored
        fluxes[0, ~self.within], fluxes[1, ~self.within] = up, 0.0
        return fluxes

    def see(self, kernels: Array, orders: IntArray, rising: Array) -> Array:
        n_sight, n_up = self.seen.shape[1], self.problem.n_up
        found, depths = self.list_depths(rising)

        def send(rows: Array, sights: IntArray) -> Array:
            """Along some sights, (order, n_in, n_col, n_sight, S), of light that comes up."""
            chosen = rows[orders][:, sights]
            light = rising @ chosen.reshape(orders.size, -1, rising.shape[2]).swapaxes(1, 2) / (2.0 * np.pi)
            shape = (
                orders.size,
                *self.problem.mu0.shape,
                len(self.problem.columns),
                sights.size,
                len(self.problem.stokes),
            )
            return light.reshape(shape)

        for t, (up, down, straight) in enumerate(depths):
            if self.within[t]:
                found[:, t, ..., :n_up, :] = kernels[:, t][..., up, :]
                entered = straight * send(self.down, down)
                found[:, t, ..., n_up:, :] = kernels[:, t][..., n_sight + down, :] + entered
            else:
                found[:, t, ..., :n_up, :] = send(self.up, up)
        return found


def make_single_interface(
    name: str, problem: Problem, base: Boundary, n_order: int, accuracy: float, run: Run
) -> SingleInterface:
    """The way through layers under one interface, by "modes" or by "invariance"."""
    assert problem.media is not None
    top = problem.media.scene.interfaces[0]
    kind = UnderSmooth if top is not None and top.is_smooth else UnderRough
    return kind(name, problem, base, n_order, accuracy, run)
