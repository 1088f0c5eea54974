"""A stack in several media, however its slabs are solved: its pieces, beams, base, and what is seen of its light."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array
from vrte.discrete_ordinates.orders.base import Base, expand_base
from vrte.discrete_ordinates.orders.media import (
    Cut,
    cut_pieces,
    find_beams,
    find_escapes,
    find_rough_places,
    list_sights,
)
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.rough_interfaces import make_rough_interface
from vrte.scene.boundary import Boundary

RISING, ARRIVING, LEAVING, ENTERING = range(4)  # ways of light at a interface, see `find_escapes`


class BeamPaths:
    """A stack in several media but for what its slabs do: where it is cut, beams on their way through it, what is seen
    of light along the directions off the nodes, and its base."""

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None:
        assert problem.media is not None
        self.problem, self.media = problem, problem.media
        self.cut = cut_pieces(self.media.depths, problem.thickness, problem.level)
        self.sights = list_sights(self.media, problem.mu_out)
        self.into, beams = find_beams(self.media, self.cut, problem.mu0)
        members = np.ix_(problem.stokes, problem.stokes)
        # power per unit flux of the beam that comes in, (piece, n_in, S, n_col), down at the top and up at the bottom
        lit = problem.mu0[:, None, None]
        columns = problem.columns.T
        self.falling = lit * (beams.entering[:-1][..., members[0], members[1]] @ columns)
        self.mirrored = lit * (beams.leaving[1:][..., members[0], members[1]] @ columns)
        self.arriving = lit * (beams.arriving[-1][..., members[0], members[1]] @ columns)
        self.beams = beams
        self.sources = list_sources(self.cut, self.rough, base)
        self.escapes = find_escapes(
            self.media, self.cut, self.sights, problem.n_up, list(problem.stokes), np.array(self.sources)
        )
        self.base = self.expand(base, n_order, accuracy)
        self.rough_interfaces = {
            index: make_rough_interface(
                self.media,
                int(self.cut.interface[index]),
                self.into,
                self.sights.cosines,
                list(problem.stokes),
                n_order,
                accuracy,
            )
            for index in self.rough
        }

    @property
    def rough(self) -> list[int]:
        """Which interfaces of the pieces are rough."""
        return find_rough_places(self.media, self.cut)

    def power_at(self, index: int, way: int) -> Array:
        """Power of beams at a interface, (n_in, S, n_col), coming up below it or down above it."""
        members, part = np.ix_(self.problem.stokes, self.problem.stokes), self.beams
        light = (part.rising if way == RISING else part.arriving)[index]
        return self.problem.mu0[:, None, None] * (light[..., members[0], members[1]] @ self.problem.columns.T)

    def of_medium(self, index: float, place: int) -> Problem:
        """The problem as one medium has it: its nodes, and the directions off them that go there (others point along
        the normal, and no light does)."""
        nodes, weights = self.media.nodes.carried(index)
        into, out = self.into[place], self.sights.cosines[place]
        return replace(
            self.problem,
            nodes=nodes,
            weights=weights,
            mu0=np.where(into > 0.0, into, 1.0),
            mu_out=np.where(out > 0.0, out, 1.0),
            n_up=out.size,
            columns=np.eye(len(self.problem.stokes)),
        )

    def expand(self, base: Boundary, n_order: int, accuracy: float) -> Base | None:
        """The base's operators on the nodes of the medium that it lies in."""
        if not base.orders_reflected:
            return None
        index = self.media.scene.media[-1]
        return expand_lossless_base(base, self.of_medium(index, len(self.media.scene.media) - 1), n_order, accuracy)

    def reflect_on_base(
        self, order: int, base: Base | None = None, arriving: Array | None = None
    ) -> tuple[Array | None, Array]:
        """The base's operator on all nodes (n, n), None for none, and its reflection of the beam, (n, r); or those of
        another base, or of a beam of other power ``arriving`` (n_in, S, n_col)."""
        base, problem = self.base if base is None else base, self.problem
        arriving = self.arriving if arriving is None else arriving
        light = np.zeros((problem.size, problem.n_rhs))
        row = -1 if base is None else int(base.row[order])
        if base is None or row < 0:
            return None, light
        count = base.matrix.shape[1]
        matrix = np.zeros((problem.size, problem.size))
        matrix[problem.size - count :, problem.size - count :] = base.matrix[row].T
        index, into = self.media.scene.media[-1], self.into[-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            flux = np.where(into[:, None, None] > 0.0, arriving / into[:, None, None], 0.0) / index
        source = base.source[row].reshape(into.size, -1, count)  # (n_in, S, n), for unit Stokes vectors
        light[problem.size - count :] = np.einsum("ian,iac->nic", source, flux).reshape(count, -1)
        return matrix, light

    def leave_base(self, order: int, arriving: Array, base: Base | None = None) -> Array:
        """What the base, or another one, sends along the sights of light on the nodes, (n, r): (n_sight, S, r)."""
        base, stokes = self.base if base is None else base, len(self.problem.stokes)
        shape = self.sights.cosines.shape[1], stokes, arriving.shape[1]
        row = -1 if base is None else int(base.row[order])
        if base is None or row < 0:
            return np.zeros(shape)
        own = arriving[arriving.shape[0] - base.out.shape[1] :]
        found: Array = base.out[row].T @ own / self.media.scene.media[-1]
        return found.reshape(shape)

    def look(self, sent: Array, escapes: Array | None = None) -> Array:
        """What is seen of light ``sent`` out along the sights (source, n_sight, S, r): radiance for unit beams, (n_tau,
        n_in, n_col, n_out, S), public frame. ``escapes``: other ones than those of the stack."""
        escapes = self.escapes if escapes is None else escapes
        problem, stokes = self.problem, len(self.problem.stokes)
        light = np.empty((*self.sights.place.shape, stokes, problem.n_rhs))
        for t, row in enumerate(self.sights.place):
            seen = sent[:, row].transpose(1, 0, 2, 3).reshape(row.size, -1, problem.n_rhs)
            light[t] = escapes[t].reshape(row.size, stokes, -1) @ seen * self.sights.index[t] ** 2
        light[:, : problem.n_up] *= problem.flip[:, None]
        light /= 2.0 * np.pi
        return light.reshape(*light.shape[:3], problem.mu0.size, -1).transpose(0, 3, 4, 1, 2)

    def sum_fluxes(
        self, arriving: Sequence[Array], leaving: Sequence[Array], entering: Sequence[Array], rising: Sequence[Array]
    ) -> Array:
        """Fluxes up and down at the depths, (2, n_tau, r), of light on the nodes at every interface, each (n, r)."""
        found = np.empty((2, self.cut.at.size, self.problem.n_rhs))
        sides = zip(self.cut.at.tolist(), self.media.depths.under.tolist(), strict=True)
        for t, (interface, under) in enumerate(sides):
            index = float(self.sights.index[t])
            nodes, weights = self.media.nodes.carried(index)
            scale = index * np.sqrt(weights * nodes)
            for way, field in enumerate((rising, entering) if under else (leaving, arriving)):
                found[way, t] = scale @ field[interface][:: len(self.problem.stokes)][-nodes.size :]
        return found


def list_sources(cut: Cut, rough: Sequence[int], base: Boundary) -> list[tuple[int, int]]:
    """Where light sets out for directions off the nodes, the interface and the way: two of each piece, two of each
    rough surface, one of a base that reflects."""
    found = [source for piece in range(cut.layer.size) for source in ((piece, RISING), (piece + 1, ARRIVING))]
    found += [source for index in rough for source in ((index, LEAVING), (index, ENTERING))]
    return [*found, (cut.interface.size - 1, LEAVING)] if base.orders_reflected else found


def expand_lossless_base(base: Boundary, problem: Problem, n_order: int, accuracy: float) -> Base:
    """A base's operators on nodes that are not Gauss's: one that reflects evenly loses no light by what they miss."""
    found = expand_base(base, problem, n_order, accuracy)
    if base.is_uneven or not base.orders_reflected or problem.is_exact:
        return found
    white = 2.0 * float(problem.weights @ problem.nodes)
    return replace(found, matrix=found.matrix / white, source=found.source / white, out=found.out / white)
