"""A stack in several media, however its slabs are solved: its pieces, beams, base, and what is seen of its light."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrte.basics.arrays import Array, IntArray, replace_unchecked
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.base import Base, EvenBases, expand_base
from vrte.discrete_ordinates.orders.media import (
    ARRIVING,
    ENTERING,
    LEAVING,
    RISING,
    Cut,
    find_beams,
    find_escapes,
    find_rough_places,
    list_sights,
)
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.rough_interfaces import RoughInterface, Side, make_rough_interface
from vrte.scene.boundary import Boundary
from vrte.scene.interface import Interface


class BeamPaths:
    """A stack in several media but for what its slabs do: where it is cut, beams on their way through it, what is seen
    of light along the directions off the nodes, and its base."""

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float, run: Run | None = None) -> None:
        assert problem.media is not None
        self.problem, self.media = problem, problem.media
        self.cut = self.media.cut(problem.thickness, problem.level)
        self.sights = list_sights(self.media, problem.mu_out)
        self.into, beams = find_beams(self.media, self.cut, problem.mu0)
        # power per unit flux of the beam that comes in, (piece, n_in, S, n_col), down at the top and up at the bottom
        self.falling, self.mirrored = self.power_of(beams.entering[:-1]), self.power_of(beams.leaving[1:])
        self.arriving = self.power_of(beams.arriving[-1])
        self.beams = beams
        self.sources = list_sources(self.cut, self.rough, base)
        self.escapes = find_escapes(
            self.media, self.cut, self.sights, problem.n_up, list(problem.stokes), np.array(self.sources)
        )
        self.base = self.expand(base, n_order, accuracy)
        self.rough_interfaces = {
            index: self.expand_facets(index, self.find_interface(index), n_order, accuracy, run or Run(1))
            for index in self.rough
        }

    @property
    def rough(self) -> list[int]:
        """Which interfaces of the pieces are rough."""
        return find_rough_places(self.media, self.cut)

    def find_interface(self, index: int) -> Interface:
        """The interface of the scene that is that one of the pieces."""
        found = self.media.scene.interfaces[int(self.cut.interface[index])]
        assert found is not None
        return found

    def expand_facets(
        self, index: int, interface: Interface, n_order: int, accuracy: float, run: Run
    ) -> RoughInterface:
        """A rough interface, or another one in its place."""
        given = self.list_sides(index), list(self.problem.stokes), n_order, accuracy, run
        return make_rough_interface(interface, self.media, *given)

    def list_sides(self, index: int) -> tuple[Side, Side]:
        """Both sides of a rough interface."""
        source = 2 * (self.cut.layer.size + self.rough.index(index))
        number, scene = int(self.cut.interface[index]), self.media.scene
        is_inside = number > 0, number < len(scene.layers) or scene.base is not None
        found = []
        for side, beams in enumerate((self.beams.arriving, self.beams.rising)):
            into = self.into[number + side] if beams[index].any() else None
            seen = self.sights.cosines[number + side] if self.escapes[:, :, :, source + side].any() else None
            found.append(Side(scene.media[number + side], into, seen, is_inside[side]))
        return found[0], found[1]

    def power_at(self, index: int, way: int) -> Array:
        """Power of beams at a interface, (n_in, S, n_col), coming up below it or down above it."""
        return self.power_of((self.beams.rising if way == RISING else self.beams.arriving)[index])

    def power_of(self, light: Array) -> Array:
        """Power of beams (..., n_in, S, n_col) from their Mueller matrices (..., n_in, 4, 4)."""
        members = np.ix_(self.problem.stokes, self.problem.stokes)
        return self.problem.mu0[:, None, None] * (light[..., members[0], members[1]] @ self.problem.columns.T)

    def of_medium(self, index: float, place: int) -> Problem:
        """The problem as one medium has it: its nodes, and the directions off them that go there (others point along
        the normal, and no light does)."""
        nodes, weights = self.media.nodes.carried(index)
        into, out = self.into[place], self.sights.cosines[place]
        return replace_unchecked(
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

    def reflect_on_base(self, orders: IntArray, arriving: Array, base: Base | None = None) -> Array:
        """What the base, or another one, sends to the nodes of a beam of that power (n_in, S, n_col): (order, r, n)."""
        base, problem = self.base if base is None else base, self.problem
        light = np.zeros((orders.size, problem.n_rhs, problem.size))
        if base is None:
            return light
        row, index, into = base.row[orders], self.media.scene.media[-1], self.into[-1][:, None, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            flux = np.where(into > 0.0, arriving / into, 0.0).swapaxes(-1, -2) / index
        source = base.source[row[row >= 0]]  # for unit Stokes vectors
        count = source.shape[-1]
        sent = flux @ source.reshape(-1, *arriving.shape[:2], count)
        light[row >= 0, :, problem.size - count :] = sent.reshape(-1, problem.n_rhs, count)
        return light

    def spread_from_base(self, orders: IntArray, arriving: Array, base: Base) -> Array:
        """What a base sends to the nodes of light on them, both (order, r, n)."""
        found, row, count = np.zeros_like(arriving), base.row[orders], base.matrix.shape[1]
        lit, first = row >= 0, arriving.shape[-1] - count
        found[lit, :, first:] = arriving[lit, :, first:] @ base.matrix[row[lit]]
        return found

    def leave_base(self, orders: IntArray, arriving: Array, base: Base | None = None) -> Array:
        """What the base, or another one, sends along the sights of light on the nodes, (order, r, n): (order, r,
        n_sight S)."""
        base = self.base if base is None else base
        found = np.zeros((*arriving.shape[:2], self.sights.cosines.shape[1] * len(self.problem.stokes)))
        if base is not None:
            row = base.row[orders]
            own = arriving[row >= 0, :, arriving.shape[-1] - base.out.shape[1] :]
            found[row >= 0] = own @ base.out[row[row >= 0]] / self.media.scene.media[-1]
        return found

    def look(self, sent: Array, escapes: Array | None = None) -> Array:
        """What is seen of light ``sent`` out along the sights (order, source, r, n_sight S): radiance for unit beams,
        (order, n_tau, n_in, n_col, n_out, S), public frame. ``escapes``: other ones than those of the stack."""
        escapes = self.escapes if escapes is None else escapes
        problem, stokes = self.problem, len(self.problem.stokes)
        apart = sent.reshape(*sent.shape[:3], -1, stokes).transpose(0, 3, 1, 4, 2)  # (order, n_sight, source, S, r)
        light = np.empty((len(sent), *self.sights.place.shape, stokes, problem.n_rhs))
        for t, row in enumerate(self.sights.place):
            seen = apart[:, row].reshape(len(sent), row.size, -1, problem.n_rhs)
            light[:, t] = escapes[t].reshape(row.size, stokes, -1) @ seen * self.sights.index[t] ** 2
        light[:, :, : problem.n_up] *= problem.flip[:, None]
        light /= 2.0 * np.pi
        return light.reshape(*light.shape[:4], problem.mu0.size, -1).transpose(0, 1, 4, 5, 2, 3)

    def sum_fluxes(self, light: Array) -> Array:
        """Fluxes up and down at the depths, (2, n_tau, r), of light on the nodes (interface, way, r, n)."""
        found = np.empty((2, self.cut.at.size, self.problem.n_rhs))
        sides = zip(self.cut.at.tolist(), self.media.depths.under.tolist(), strict=True)
        for t, (interface, under) in enumerate(sides):
            index = float(self.sights.index[t])
            nodes, weights = self.media.nodes.carried(index)
            scale = index * np.sqrt(weights * nodes)
            for way, place in enumerate((RISING, ENTERING) if under else (LEAVING, ARRIVING)):
                found[way, t] = light[interface, place, :, :: len(self.problem.stokes)][:, -nodes.size :] @ scale
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
    reflects = isinstance(base, EvenBases) or (base.orders_reflected and not base.is_uneven)
    if not reflects or problem.is_exact:
        return found
    white = 2.0 * float(problem.weights @ problem.nodes)
    return replace(found, matrix=found.matrix / white, source=found.source / white, out=found.out / white)
