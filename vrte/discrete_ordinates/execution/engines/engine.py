"""What an engine is: where Fourier orders are solved, and their light is added up."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import field, replace
from typing import Any, Protocol

import numpy as np

from vrte.basics.arrays import Array, IntArray, record
from vrte.basics.running import Run
from vrte.discrete_ordinates.execution.sums import Adding, Light
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.planning.blocks import Block
from vrte.discrete_ordinates.planning.plan import Plan


@record
class Piece:
    """Orders of a block, to be solved by the algorithm ``name``.

    plan: the ``place``-th of those carried out together; tried: where these orders were solved before and failed the
    checks, by which algorithm, and what was wrong, by order.
    """

    place: int
    plan: Plan
    block: Block
    orders: IntArray
    name: str
    tried: Mapping[int, tuple[str, str]] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """What they are orders of."""
        return self.block.problem

    def halves(self) -> tuple["Piece", "Piece"]:
        """The first orders and the others."""
        middle = self.orders.size // 2
        return replace(self, orders=self.orders[:middle]), replace(self, orders=self.orders[middle:])


@record
class Answer:
    """What an engine found for a piece.

    light: of the orders that pass the checks, in the engine's keeping; flux (2, n_tau, n_in, n_col), up and down, of
    order 0 where that is the first; largest (order, n_tau, n_in): the largest radiance of each order; brightest (n_tau,
    n_in): the brightest I of the first, per unit of incident light, None where no orders are counted again; residuals
    by name, of each order (order,), of several scenes (scene,); doubts: what is wrong with each of the other orders.
    """

    light: Light
    flux: Array
    largest: Array | None
    brightest: Array | None
    residuals: Mapping[str, Array]
    doubts: Mapping[int, str]


def make_empty_answer(doubts: Mapping[int, str]) -> Answer:
    """Where no order of a piece passes the checks."""
    nothing = np.zeros(0)
    light = Light(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0, np.int32), None)
    return Answer(light, nothing, nothing, nothing, {}, doubts)


class Engine(Adding, Protocol):
    """A processor or a device with the stages of a solve as methods; `carry_out` has the loop around them."""

    @property
    def stages(self) -> Any:
        """Loops that stages on arrays of the host run, with the arguments of those of `vrte._core`."""

    @property
    def others(self) -> Mapping[str, str]:
        """By which algorithm an order is solved again that fails the checks of one."""

    @property
    def takes_many(self) -> bool:
        """Whether the plans of many scenes are carried out together."""

    def at_work(self) -> AbstractContextManager[Any]:
        """Held while plans are carried out."""

    def check_memory(self, plans: Sequence[Plan], run: Run) -> None:
        """Raises SceneError or DeviceError where the plans need more memory than there is."""

    def grouped(self, pieces: Sequence[Piece]) -> Iterator[list[Piece]]:
        """Pieces that are solved in one call, as many as there is room for; in halves where one is too large."""

    def solve(self, pieces: list[Piece], run: Run, report: Callable[[int], None]) -> list[Answer]:
        """Assembly and one of the algorithms for all orders of a group; report(k) is called when k of them are done."""

    def failure(self, piece: Piece, order: int, reason: str) -> str:
        """What to tell of an order that no algorithm of this engine can verify."""

    def diagnostics(self) -> dict[str, Any]:
        """What a result says of the engine."""
