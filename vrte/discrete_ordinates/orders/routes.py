"""The ways to solve Fourier orders of a discrete problem, by name, behind one signature."""

from collections.abc import Mapping
from functools import partial
from typing import Protocol

from vrte.basics.arrays import IntArray
from vrte.basics.running import Run
from vrte.discrete_ordinates.orders.doubling import Doubling
from vrte.discrete_ordinates.orders.invariance import Invariance
from vrte.discrete_ordinates.orders.modes import Modes, is_quick
from vrte.discrete_ordinates.orders.plates import respond_with_plates
from vrte.discrete_ordinates.orders.problem import Problem
from vrte.discrete_ordinates.orders.refracting import Refracting
from vrte.discrete_ordinates.orders.single_interface import is_under_one_surface, make_single_interface
from vrte.discrete_ordinates.orders.slab_response import respond
from vrte.discrete_ordinates.orders.solved import Orders
from vrte.discrete_ordinates.orders.tanh_poles import Scatterings
from vrte.scene.boundary import Boundary
from vrte.scene.oriented import polarizes_beams


class Route(Protocol):
    """Some Fourier orders of a problem, on their way; ``allowed``: residuals up to which the answer counts, by name."""

    @property
    def allowed(self) -> Mapping[str, float]: ...

    def chunk(self, threads: int) -> int:
        """Orders to be done at once."""

    def solve(self, orders: IntArray, run: Run) -> Orders:
        """The given orders."""


class Way(Route, Protocol):
    """A route for problems in one medium, ``other``: the way for orders that fail its checks."""

    name: str
    other: str

    def __init__(self, problem: Problem, base: Boundary, n_order: int, accuracy: float) -> None: ...

    @staticmethod
    def count_doubles(problem: Problem) -> tuple[float, float]:
        """Doubles of an order's arrays, and of a thread's scratch memory."""

    @staticmethod
    def list_left_out(problem: Problem, accuracy: float) -> list[tuple[str, str]]:
        """What is left out of the orders: the name of a switch, and the reason with {orders} in it."""


WAYS: tuple[type[Way], ...] = (Modes, Doubling, Invariance, Scatterings)
ROUTES = {way.name: way for way in WAYS}
OTHER = {way.name: way.other for way in WAYS}


def make_route(
    name: str, problem: Problem, base: Boundary, n_order: int, accuracy: float, run: Run | None = None
) -> Route:
    """The named way through a problem, in one medium or in several; on the threads of a run facets are integrated."""
    if problem.media is not None:
        if name in ("modes", "invariance") and is_under_one_surface(problem.media):
            return make_single_interface(name, problem, base, n_order, accuracy, run or Run(1))
        of_slabs = respond_with_plates if polarizes_beams(problem.oriented) else respond
        slabs = partial(of_slabs, name, quick=is_quick(problem, accuracy))
        return Refracting(slabs, problem, base, n_order, accuracy, run)
    return ROUTES[name](problem, base, n_order, accuracy)
