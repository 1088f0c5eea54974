"""A stack under one smooth surface by its modes: the surface is a boundary condition at the top, and nothing else."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from vrte.basics.arrays import Array, IntArray
from vrte.basics.memory import count_orders_at_once
from vrte.basics.polarization import FLIP
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.beam_paths import expand_lossless_base
from vrte.discrete_ordinates.orders.boundary import OPEN, Top
from vrte.discrete_ordinates.orders.fused_modes import solve_by_modes
from vrte.discrete_ordinates.orders.media import Media, list_sights
from vrte.discrete_ordinates.orders.modes import Modes
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.scene.beams import find_cosines, find_decaying
from vrte.scene.boundary import Boundary


def is_under_one_surface(media: Media) -> bool:
    """Whether all that refracts is a smooth interface on top, and no beam comes up again."""
    first, *others = media.scene.interfaces
    plain = first is not None and first.is_smooth and not any(other is not None for other in others)
    return plain and not media.scene.below.keeps_beams


class SingleInterface:
    """Modes of the layers as beams find them that were refracted once, and a boundary condition at the top."""

    allowed: ClassVar = {"residual_of_modes": 1e-9, "residual_of_boundary": 1e-9}

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float, quick: bool) -> None:
        assert problem.media is not None
        self.problem, self.media, self.quick = problem, problem.media, quick
        scene, members = self.media.scene, np.ix_(problem.stokes, problem.stokes)
        into = find_cosines(scene.media, scene.index_above, problem.mu0)
        index = scene.indices[0] / scene.index_above
        down = self.media.interfaces_along(into).down[0][:, members[0], members[1]] @ problem.columns.T
        lit = into[1] > 0.0
        mu_in = np.where(lit, into[1], 1.0)
        self.flux = down * (lit * problem.mu0 / mu_in)[:, None, None]  # across the refracted beam, (n_in, S, n_col)
        self.sights = list_sights(self.media, problem.mu_out)
        seen = self.sights.cosines[1]
        mu_out = np.where(seen > 0.0, seen, 1.0)
        within = (self.media.depths.interface != 0) | self.media.depths.under  # which depths are below the surface
        self.within = within
        both = mu_out if not within.any() else np.concatenate([mu_out, mu_out])
        nodes, weights = self.media.nodes.carried(scene.indices[0])
        self.inside = replace(
            problem,
            nodes=nodes,
            weights=weights,
            mu0=mu_in,
            mu_out=both,
            n_up=mu_out.size,
            columns=np.eye(len(problem.stokes)),
        )
        if within.any():  # what comes up at the top goes down again
            level, layer = np.concatenate([[0.0], problem.level]), np.concatenate([[0], problem.level_layer])
            self.inside = replace(self.inside, level=level, level_layer=layer.astype(np.int32))
        # of radiance that leaves, and that comes back (public frame: what comes up has not turned over yet)
        along, on_nodes = map(self.media.interfaces_along, (self.sights.cosines, self.media.cosines))
        self.through = along.up[0][:, members[0], members[1]] / index**2
        self.back = FLIP[:, None] * along.below[0]
        self.back = self.back[:, members[0], members[1]]
        back = (FLIP[:, None] * on_nodes.below[0])[-nodes.size :, members[0], members[1]]
        back = np.ascontiguousarray(back * problem.flip)[None]
        self.top = Top(np.zeros(n_order, np.int32), back, OPEN.sent)
        self.base = expand_lossless_base(base, self.inside, n_order, accuracy)

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""
        return count_orders_at_once(Modes.count_doubles(self.inside)[0], threads)

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""
        inside, _ = solve_by_modes(self.inside, orders, self.base, self.quick, run, self.top)
        fluxes = np.stack([inside.flux_up, inside.flux_down])  # (2, n_tau, n_in, S)
        fluxes = np.einsum("wtia,iac->wtic", fluxes[:, int(self.within.any()) :], self.flux)
        outside = ~self.within  # the surface keeps nothing of what passes it
        fluxes[:, outside] = np.stack([fluxes[0, outside] - fluxes[1, outside], np.zeros_like(fluxes[0, outside])])
        return Orders(self.see(inside.kernels), fluxes[0], fluxes[1], inside.residuals)

    def see(self, kernels: Array) -> Array:
        """Along the outgoing directions, (order, n_tau, n_in, n_col, n_out, S), from what sets out inside."""
        problem = self.problem
        shape = *kernels.shape[:3], problem.columns.shape[0], *kernels.shape[4:]
        power = np.ascontiguousarray(self.flux.swapaxes(1, 2))
        light = (power @ kernels.reshape(*kernels.shape[:4], -1)).reshape(shape)  # public frame
        n_sight, n_up, first = self.sights.cosines.shape[1], problem.n_up, int(self.within.any())
        found = np.zeros((light.shape[0], problem.level.size, *light.shape[2:4], problem.mu_out.size, light.shape[5]))
        for t, index in enumerate(self.sights.place):
            here, up, down = light[:, t + first], index[:n_up], index[n_up:]
            if self.within[t]:
                straight = find_decaying(problem.depth[t : t + 1], self.sights.cosines[:3, down])[0]
                returned = light[:, 0][..., down, None, :] @ self.back[down].swapaxes(1, 2)
                found[:, t, ..., :n_up, :] = here[..., up, :]
                found[:, t, ..., n_up:, :] = here[..., n_sight + down, :] + straight[:, None] * returned[..., 0, :]
            else:
                found[:, t, ..., :n_up, :] = (here[..., up, None, :] @ self.through[up].swapaxes(1, 2))[..., 0, :]
        return found
