"""Matrices that act on the nodes, on the beams that light them and on the directions off the nodes, all at once."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vrte.basics.arrays import Array
from vrte.basics.divided_differences import ComplexArray, Function, divide_once, divide_twice

IntArray = NDArray[np.intp]
AT_ONCE = 2e6  # divided differences held in memory: some hundred MB


@dataclass(frozen=True, eq=False)
class Operator:
    """A block lower triangular matrix on (beams, nodes, directions off the nodes), a node of weight zero each.

    beam (r,), out (o,): diagonals; nodes (n, n), into (n, r), leaving (o, n), through (o, r). A beam feeds and is not
    fed, a direction off the nodes is fed and does not feed.
    """

    beam: Array
    nodes: Array
    into: Array
    out: Array
    leaving: Array
    through: Array

    def __matmul__(self, other: "Operator") -> "Operator":
        return Operator(
            beam=self.beam * other.beam,
            nodes=self.nodes @ other.nodes,
            into=self.into * other.beam + self.nodes @ other.into,
            out=self.out * other.out,
            leaving=self.leaving @ other.nodes + self.out[:, None] * other.leaving,
            through=self.through * other.beam + self.leaving @ other.into + self.out[:, None] * other.through,
        )

    def __add__(self, other: "Operator") -> "Operator":
        return Operator(*(one + two for one, two in zip(self.blocks, other.blocks, strict=True)))

    def __sub__(self, other: "Operator") -> "Operator":
        return Operator(*(one - two for one, two in zip(self.blocks, other.blocks, strict=True)))

    @property
    def blocks(self) -> tuple[Array, ...]:
        """In the order of the fields."""
        return self.beam, self.nodes, self.into, self.out, self.leaving, self.through

    def times(self, factor: float) -> "Operator":
        """All of it multiplied by a number."""
        return Operator(*(factor * block for block in self.blocks))

    def plus_one(self, sign: float = 1.0) -> "Operator":
        """1 + A, or 1 - A."""
        signed = self.times(sign)
        return replace(
            signed, beam=1.0 + signed.beam, nodes=np.eye(len(self.nodes)) + signed.nodes, out=1.0 + signed.out
        )

    def solve(self, right: "Operator") -> "Operator":
        """A^-1 B. Raises numpy.linalg.LinAlgError where A is singular."""
        beam, out = right.beam / self.beam, right.out / self.out
        columns = np.linalg.solve(self.nodes, np.concatenate([right.nodes, right.into - self.into * beam], axis=1))
        nodes, into = np.split(columns, [right.nodes.shape[1]], axis=1)
        leaving = (right.leaving - self.leaving @ nodes) / self.out[:, None]
        through = (right.through - self.through * beam - self.leaving @ into) / self.out[:, None]
        return Operator(beam, nodes, into, out, leaving, through)


def make_empty_operator(r: int, n: int, o: int) -> Operator:
    """Nothing at all: every block zero."""
    return Operator(np.zeros(r), np.zeros((n, n)), np.zeros((n, r)), np.zeros(o), np.zeros((o, n)), np.zeros((o, r)))


@dataclass(frozen=True, eq=False)
class Modes:
    """Eigenvectors of the nodes' part of an operator ``of``, right diag(lam) left with left = right^-1; ``stokes``: how
    many rows a direction off the nodes has."""

    of: Operator
    lam: ComplexArray
    right: ComplexArray
    left: ComplexArray
    stokes: int

    @cached_property
    def excited(self) -> ComplexArray:
        """By each beam, (n, r)."""
        return np.asarray(self.left @ self.of.into)

    @cached_property
    def radiated(self) -> ComplexArray:
        """Into each direction off the nodes, (o, n)."""
        return np.asarray(self.of.leaving @ self.right)

    def function(self, function: Function) -> Operator:
        """f(A), divided differences of f in the blocks off the diagonal: no two values are too close."""
        lam, outs = self.lam, self.of.out[:: self.stokes]
        beams, fed = np.unique(self.of.beam, return_inverse=True)
        by_beam = divide_once(function, lam[:, None], beams)[:, fed]
        by_out = np.repeat(divide_once(function, outs[:, None], lam), self.stokes, axis=0)
        straight = np.repeat(divide_once(function, outs[:, None], beams)[:, fed], self.stokes, axis=0)
        pieces = max(1, math.ceil(lam.size * outs.size * fed.size / AT_ONCE))
        through = [self.from_beams(function, part, beams, fed) for part in np.array_split(np.arange(outs.size), pieces)]
        return Operator(
            beam=function(self.of.beam.astype(complex)).real,
            nodes=((self.right * function(lam)) @ self.left).real,
            into=(self.right @ (by_beam * self.excited)).real,
            out=function(self.of.out.astype(complex)).real,
            leaving=((by_out * self.radiated) @ self.left).real,
            through=(np.concatenate(through) + straight * self.of.through).real,
        )

    def from_beams(self, function: Function, places: IntArray, beams: Array, fed: IntArray) -> ComplexArray:
        """What goes from each beam by way of the nodes to some directions off them, (stokes * places, r)."""
        outs = self.of.out[places * self.stokes]
        three = divide_twice(function, outs[:, None, None], self.lam[None, :, None], beams)[..., fed]
        radiated = self.radiated.reshape(-1, self.stokes, self.lam.size)[places]
        return np.asarray(np.matmul(radiated, three * self.excited).reshape(-1, fed.size))
